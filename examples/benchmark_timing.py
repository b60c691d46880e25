"""CPU time of contact runs, from matrices in memory and compiled kernels to the interface histories.

They factorise in the timed region, as the floor does (``benchmark_floor``).
"""

from __future__ import annotations

import gc
import time as clock
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from statistics import median
from typing import Any

import numpy as np
from benchmark_problems import Case
from threadpoolctl import threadpool_limits

import latin_fmu
from latin_fmu.api import run
from latin_fmu.assembly.build import discretise
from latin_fmu.assembly.problem import DiscretisedProblem, SolverReadyProblem
from latin_fmu.latin.outcome import Outcome


def prepared(case: Case, solver: dict[str, Any]) -> DiscretisedProblem:
    """Matrices of a case with these settings of the iteration."""
    return discretise(latin_fmu.scene_from_dict({**case.description, "solver": solver}))


def stable(case: Case, solver: dict[str, Any]) -> DiscretisedProblem:
    """The same with as many more instants as an explicit propagator needs."""
    steps = case.description["time"]["instants"]
    for more in (1.0, 1.04, 1.1, 1.25, 1.5, 2.0, 3.0, 4.0, 6.0):
        time = case.description["time"] | {"instants": int(np.ceil(more * steps))}
        ready = prepared(replace(case, description=case.description | {"time": time}), solver)
        with suppress(latin_fmu.SceneError):
            ready.build()
            return ready
    raise ValueError(f"{case.case}: not stable with {6 * steps} steps")


def contact_run(ready: DiscretisedProblem) -> Outcome:
    """Factorise, march, contact included, to the interface histories."""
    return run(ready.build())


def second_run(
    ready: DiscretisedProblem, built: SolverReadyProblem, given: Mapping[str, np.ndarray] | None = None
) -> Outcome:
    """Another run with what was set up for the first; ``given`` amplitudes (n_time,) of loads by name."""
    for propagator in built.assembly.propagators:
        propagator.restart()
    built.timeline.begin(built.assembly, ready.time, given or {}, built.assembly.ground_start)
    return run(built)


def cpu(work: Callable[[], object]) -> float:
    """CPU seconds of one call."""
    gc.collect()
    start = clock.process_time()
    work()
    return clock.process_time() - start


def in_turn(works: dict[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Median CPU seconds of each, called in turn in every round, on one thread."""
    found: dict[str, list[float]] = {name: [] for name in works}
    with threadpool_limits(1):
        for _ in range(rounds):
            for name, work in works.items():
                found[name].append(cpu(work))
    return {name: median(values) for name, values in found.items()}


def rounds_for(seconds: float) -> int:
    """How often to repeat something that takes this long."""
    return 9 if seconds < 0.3 else 5 if seconds < 3.0 else 3


def force_error(found: Outcome, reference: Outcome) -> float:
    """Relative L2 distance of the force histories of all interfaces, at the instants of the reference."""
    there = np.concatenate([h.force().T for h in reference.interfaces.values()])
    forces = np.concatenate([found.interfaces[n].force().T for n in reference.interfaces])
    here = np.stack([np.interp(reference.time, found.time, row) for row in forces])
    return float(np.linalg.norm(here - there) / np.linalg.norm(there))
