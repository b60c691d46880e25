"""One run of a study: its quantities and what it cost."""

from __future__ import annotations

import time as clock
from dataclasses import dataclass

import numpy as np

from .. import api
from ..fem.mesh import nearest
from ..latin.record import Array, Timings
from ..results.solution import Solution
from ..scene.schema import Scene
from .measured import Measured, measure
from .refinement import Resolution, at_resolution


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
