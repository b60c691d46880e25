"""CPU time of a contact run and of its floor: the linear transient of the same mesh with the interfaces bonded.

Both sides start from meshes and matrices in memory and compiled kernels, and both factorise in the timed region. The
floor is one factorisation and one solve per instant; no implicit method that marches full finite elements is below.
"""

from __future__ import annotations

import gc
import time as clock
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from statistics import median
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from benchmark_problems import Case
from threadpoolctl import threadpool_limits

import latin_fmu
from latin_fmu.api import run
from latin_fmu.latin.record import Outcome
from latin_fmu.propagator import DirectPropagator
from latin_fmu.propagator.cholesky import interface_factor
from latin_fmu.propagator.model import reduced_rank
from latin_fmu.scene.build import Built, Prepared, prepare
from latin_fmu.scene.merge import Merged, merge

NOTHING = np.zeros((0, 1))


def prepared(case: Case, solver: dict[str, Any]) -> Prepared:
    """Matrices of a case with these settings of the iteration."""
    return prepare(latin_fmu.scene_from_dict({**case.description, "solver": solver}))


def stable(case: Case, solver: dict[str, Any]) -> Prepared:
    """The same with as many more instants as an explicit propagator needs."""
    steps = case.description["time"]["instants"]
    for more in (1.0, 1.04, 1.1, 1.25, 1.5, 2.0, 3.0, 4.0, 6.0):
        time = case.description["time"] | {"instants": int(np.ceil(more * steps))}
        ready = prepared(replace(case, description=case.description | {"time": time}), solver)
        with suppress(latin_fmu.SceneError):
            ready.build()
            return ready
    raise ValueError(f"{case.case}: not stable with {6 * steps} steps")


def contact_run(ready: Prepared) -> Outcome:
    """Factorise, march, contact included, to the interface histories."""
    return run(ready.build())


def second_run(ready: Prepared, built: Built, given: Mapping[str, np.ndarray] | None = None) -> Outcome:
    """Another run with what was set up for the first; ``given`` amplitudes (n_time,) of loads by name."""
    for propagator in built.assembly.propagators:
        propagator.restart()
    built.timeline.begin(built.assembly, ready.time, given or {}, built.assembly.ground_start)
    return run(built)


class Floor:
    """Linear transients of the bonded mesh: same steps, same scheme (HHT), same loads."""

    def __init__(self, ready: Prepared) -> None:
        self._ready = ready
        members = [m for c in ready.classes for m in c.members]
        self._merged: Merged = merge(members, ready.units, ready.info)
        _ = self._merged.model.reduced, self._rank

    @property
    def marches(self) -> dict[str, Callable[[], object]]:
        """What a linear transient can be marched with here."""
        return {"package march": self.package, "lean march": self.lean, "SuperLU": self.superlu}

    def package(self) -> DirectPropagator:
        """The propagator of the package, with no interface to wait for."""
        body = self._begun()
        for _ in range(len(self._ready.time) - 1):
            body.predict()
            body.commit(NOTHING)
        return body

    def displacements(self) -> Iterator[np.ndarray]:
        """Displacements of the nodes of all blocks (n_node, 3), m, instant by instant."""
        body = self._begun()
        for _ in range(len(self._ready.time) - 1):
            body.predict()
            body.commit(NOTHING)
            yield body.full_displacement(0)

    def _begun(self) -> DirectPropagator:
        ready = self._ready
        body = DirectPropagator([self._merged.model], ready.scheme, ready.dt, False)
        body.begin([self._merged.histories(ready.timeline, ready.time)], ready.dt)
        body.start(NOTHING, None)  # at rest, without load
        return body

    def lean(self) -> np.ndarray:
        """The factor of the package in the shortest loop there is."""
        return self.kept()()

    def kept(self) -> Callable[[], np.ndarray]:
        """``lean`` with a factor made now."""
        matrix = self._operator()
        factor = interface_factor(matrix, np.zeros(0, dtype=np.int64), self._rank)
        none = np.zeros((0, 1))

        def solve(b: np.ndarray) -> np.ndarray:
            y, _ = factor.forward(b[:, None])
            return factor.backward(y, none)[:, 0]

        return lambda: self._loop(solve)

    def superlu(self) -> np.ndarray:
        """SciPy's SuperLU in the nested-dissection order of the mesh, in the same loop."""
        order = np.argsort(self._rank, kind="stable")
        matrix = sp.csc_array(self._operator()[order][:, order])
        factor = spla.splu(
            matrix, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
        x = np.empty(len(order))

        def solve(b: np.ndarray) -> np.ndarray:
            x[order] = factor.solve(b[order])
            return x

        return self._loop(solve)

    @cached_property
    def _rank(self) -> np.ndarray:
        model = self._merged.model
        assert model.ordering is not None
        return reduced_rank(model.expansion, model.ordering)

    def _operator(self) -> sp.csr_array:
        mass, _, stiffness = self._merged.model.reduced
        c_mass, _, c_stiffness = self._ready.scheme.operator(self._ready.dt)
        return sp.csr_array(c_mass * mass + c_stiffness * stiffness)

    def _loop(self, solve: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """Displacements at the end of M a + K u = f by HHT, one product with K and one solve per instant."""
        ready, model, scheme = self._ready, self._merged.model, self._ready.scheme
        dt, memory, stiffness = ready.dt, scheme.memory_weight, model.reduced[2]
        history = self._merged.histories(ready.timeline, ready.time)
        pattern = np.stack([np.asarray(model.expansion.T @ load.pattern) for load in model.loads], axis=1)
        amplitude = np.stack(history.amplitudes, axis=1)
        weighted = scheme.force_weight * amplitude[1:] - memory * amplitude[:-1]
        u, v, a = np.zeros((3, pattern.shape[0]))
        for now in weighted:
            free_u, free_v = scheme.predict(u, v, a, dt)
            a = solve(pattern @ now - stiffness @ (scheme.force_weight * free_u - memory * u)).copy()
            u = free_u + scheme.displacement_gain(dt) * a
            v = free_v + scheme.velocity_gain(dt) * a
        return u


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
