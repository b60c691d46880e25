"""One run of a study: its quantities and what it cost; time and memory of other runs foreseen."""

from __future__ import annotations

import math
import os
import time as clock
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .. import api
from ..errors import LatinError
from ..fem.mesh import nearest
from ..latin.record import Array, Timings
from ..results.solution import Solution
from ..scene.schema import Scene
from .quantities import Measured, measure
from .resolution import Resolution, at_resolution, counts_that_vary


@dataclass(frozen=True)
class Run:
    """Quantities and cost of a run.

    Attributes
    ----------
    resolution : relative to the scene. measured : its quantities. cpu : CPU seconds of the process, set-up included.
    timings : by part. iterations : per window, mean and largest. converged, status : as of the solution.
    steps : time steps.
    """

    resolution: Resolution
    measured: Measured
    cpu: float
    timings: Timings
    iterations: tuple[float, int]
    converged: bool
    status: str
    steps: int
    passes: float


def run_at(scene: Scene, resolution: Resolution, progress: api.ProgressSink | None = None) -> Run:
    """Solve the scene at a resolution.

    Raises
    ------
    SceneError : the scene cannot be built at this resolution.
    """
    start = clock.process_time()
    solution = api.solve(at_resolution(scene, resolution), progress=progress)
    return as_run(scene, solution, resolution, clock.process_time() - start)


def as_run(scene: Scene, solution: Solution, resolution: Resolution, cpu: float) -> Run:
    """A finished solution as a run of a study."""
    counts = [window.iterations for window in solution.windows] or [0]
    return Run(
        resolution=resolution,
        measured=measure_solution(scene, solution),
        cpu=cpu,
        timings=solution.timings,
        iterations=(float(np.mean(counts)), max(counts)),
        converged=solution.converged,
        status=solution.status,
        steps=len(solution.time) - 1,
        passes=solution.passes,
    )


def measure_solution(scene: Scene, solution: Solution) -> Measured:
    """Quantities of a solution on the interval of the scene; sensors where the fields were kept."""
    return measure(solution.time, solution.interfaces, scene.time.end, _sensors(scene, solution))


def _sensors(scene: Scene, solution: Solution) -> dict[str, tuple[Array, Array]]:
    found = {}
    for name, sensor in scene.sensor.items():
        history = solution.substructures.get(sensor.substructure)
        if history is None or history.displacement is None:
            continue
        _, node = nearest(np.asarray([sensor.point]), history.nodes)
        found[name] = (history.time, history.displacement[:, int(node[0])])
    return found


Tell = Callable[[str], None]


def told(error: LatinError) -> str:
    """The problems of an error in one line."""
    problems = getattr(error, "problems", ())
    return "; ".join(f"{p.where}: {p.what}" for p in problems) or str(error)


@dataclass(frozen=True)
class CostModel:
    """CPU seconds of a run foreseen from those made: fixed + per-work x work.

    Work = steps x cells^(4/3) for solids, steps x cells where one direction is refined (banded factors): what half
    solves cost on such meshes. The exponent is that of the scene, the factors are fitted to the runs.
    """

    fixed: float
    rate: float
    exponent: float

    @classmethod
    def fitted(cls, scene: Scene, runs: list[Run]) -> CostModel:
        """From runs at different resolutions (at least one): the largest and the cheapest.

        The first run of a process also pays for loading kernels: it may be neither the smallest nor cheap.
        """
        exponent = exponent_of(scene)
        work = [r.resolution.mesh**exponent * r.resolution.time for r in runs]
        large = max(range(len(runs)), key=work.__getitem__)
        cheap = min(range(len(runs)), key=lambda i: runs[i].cpu)
        if work[cheap] == work[large]:
            return cls(0.0, runs[large].cpu / work[large], exponent)
        rate = (runs[large].cpu - runs[cheap].cpu) / (work[large] - work[cheap])
        return cls(max(runs[cheap].cpu - rate * work[cheap], 0.0), rate, exponent)

    def seconds(self, mesh: float, time: float) -> float:
        """Foreseen CPU seconds at a resolution."""
        return float(self.fixed + self.rate * mesh**self.exponent * time)


def exponent_of(scene: Scene) -> float:
    """How the cost of a step grows with the number of elements along an edge: 1 for bars, 2 x 1.2 for plates, 4 for
    solids."""
    directions = {i for b in scene.substructure.values() if b.box for i, n in enumerate(b.box.elements) if n > 1}
    return {0: 0.0, 1: 1.0, 2: 2.4, 3: 4.0}[len(directions)] if counts_that_vary(scene) else 0.0


def memory_foreseen(scene: Scene, at: Resolution) -> float:
    """Bytes of factors and histories at a resolution: 60 entries a dof in bars, n^(4/3) growth in solids."""
    largest = 0.0
    for body in scene.substructure.values():
        if body.box is None:
            continue
        counts = [max(1.0, n * at.mesh) if n > 1 else 1.0 for n in body.box.elements]
        dofs = 3.0 * math.prod(n + 1 for n in counts)
        width = math.prod(sorted(n + 1 for n in counts)[:2]) * 3.0  # dofs of the smallest cross-section
        largest += 8.0 * dofs * min(width, 6.0 * dofs ** (1.0 / 3.0) * 10.0)
    return largest


def memory_of_the_machine() -> float:
    """Bytes of physical memory; infinite where the system does not tell."""
    try:
        return 0.8 * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return math.inf
