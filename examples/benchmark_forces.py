"""Normal contact force of a benchmark case by this package, by CalculiX, and the reference for both."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from benchmark_exact import contact_stress
from benchmark_problems import Case
from benchmark_timing import contact_run, cpu, prepared
from calculix_deck import Choices, Deck
from calculix_run import run
from example_tools import Array

import latin_fmu
from latin_fmu.latin.outcome import Outcome

FINER = 8  # steps of the reference
SECTION = 1e-4  # of P1, m2


@dataclass(frozen=True)
class ForceHistory:
    """Normal force of the first interface by one code.

    ``seconds`` of CPU, time (n,) s, force (n,) N, compression positive; ``complete``: the window was finished.
    """

    name: str
    seconds: float
    time: Array
    force: Array
    complete: bool = True
    work: str = ""

    @property
    def separation(self) -> float:
        """Last instant with more than 1 % of the largest force, s."""
        return float(self.time[np.flatnonzero(self.force > 0.01 * self.force.max())[-1]])

    def distance(self, reference: ForceHistory) -> float:
        """Relative L2 distance of the histories on the instants of the reference."""
        here = np.interp(reference.time, self.time, self.force)
        return float(np.linalg.norm(here - reference.force) / np.linalg.norm(reference.force))


def of_package(case: Case, name: str, **solver: float) -> ForceHistory:
    """This package, from the scene to the histories."""
    found: list[Outcome] = []
    scene = latin_fmu.scene_from_dict({**case.description, "solver": {"share_identical": False, **solver}})

    def work() -> None:
        found.append(latin_fmu.solve(scene))

    work()
    seconds = float(np.median([cpu(work) for _ in range(3)]))
    last = found[-1]
    return ForceHistory(
        name, seconds, last.time, last.interfaces["i1"].normal_resultant(), work=f"{last.passes:.1f} passes"
    )


def reference(case: Case) -> ForceHistory:
    """Exact for P1, with finer steps of the same mesh elsewhere."""
    if case.case.startswith("P1"):
        time = np.linspace(0.0, case.description["time"]["end"], 250 * FINER + 1)
        return ForceHistory("exact", 0.0, time, SECTION * contact_stress(time))
    steps = case.description["time"] | {"instants": FINER * case.description["time"]["instants"]}
    finer = replace(case, description=case.description | {"time": steps})
    found = contact_run(prepared(finer, {"tolerance": 1e-4}))
    return ForceHistory("finer steps", 0.0, found.time, found.interfaces["i1"].normal_resultant())


def of_calculix(case: Case, name: str, choices: Choices, limit: float) -> ForceHistory:
    """CalculiX on the deck of the scene."""
    ready = prepared(case, {})
    found = run(Deck(ready, choices).text(), float(ready.time[-1]), limit)
    force = found.printed.force.get(("B2_ZMIN", "B1_ZMAX"), np.zeros((1, 3)))[:, 2]
    time = found.printed.time if len(found.printed.time) else np.zeros(1)
    work = f"{found.increments} increments, {found.iterations} iterations"
    return ForceHistory(f"CalculiX, {name}", found.seconds, time, force, found.complete, work)
