"""One run with its quantities and its cost; time and memory of other runs predicted from it."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .. import api
from ..assembly.propagator_choice import factor_bytes
from ..errors import LatinError
from ..latin.outcome import Array, SensorHistory, Timings
from ..latin.processes import Processes
from ..results.solution import Solution
from ..scene.schema import Scene
from .quantities import Quantities, measure
from .resolution import Resolution, at_resolution, mesh_files


@dataclass(frozen=True)
class Run:
    """Quantities and cost of a run.

    Attributes
    ----------
    resolution : relative to the scene. quantities : of the run. cpu : CPU seconds of the process, set-up included.
    timings : by part. iterations : per window, mean and largest. converged, status : as of the solution.
    steps : time steps. time, sensors : instants, s, and motions of the sensors.
    """

    resolution: Resolution
    quantities: Quantities
    cpu: float
    timings: Timings
    iterations: tuple[float, int]
    converged: bool
    status: str
    steps: int
    passes: float
    time: Array = field(default_factory=lambda: np.zeros(0))
    sensors: Mapping[str, SensorHistory] = field(default_factory=dict)


def run_at(
    scene: Scene,
    resolution: Resolution,
    progress: api.ProgressSink | None = None,
    processes: Processes | None = None,
    stream: Path | None = None,
    max_cpu: float | None = None,
) -> Run:
    """Solve the scene at a resolution; ``progress``, ``processes``, ``stream``, ``max_cpu`` as for ``api.solve``.

    Raises
    ------
    SceneError : the scene cannot be built at this resolution.
    """
    start = clock.process_time()
    coarse = at_resolution(scene, resolution)
    solution = api.solve(coarse, progress=progress, processes=processes, stream=stream, max_cpu=max_cpu)
    run = as_run(scene, solution, resolution, clock.process_time() - start)
    if solution.outcome.stream is not None:
        solution.outcome.stream.close()
    return run


def as_run(scene: Scene, solution: Solution, resolution: Resolution, cpu: float) -> Run:
    """A finished solution as a run of a study."""
    counts = [window.iterations for window in solution.windows] or [0]
    return Run(
        resolution=resolution,
        quantities=measure_solution(scene, solution),
        cpu=cpu,
        timings=solution.timings,
        iterations=(float(np.mean(counts)), max(counts)),
        converged=solution.trustworthy,
        status=solution.status,
        steps=len(solution.time) - 1,
        passes=solution.passes,
        time=solution.time,
        sensors=solution.sensors,
    )


def measure_solution(scene: Scene, solution: Solution) -> Quantities:
    """Quantities of a solution on the interval of the scene."""
    sensors = {name: (solution.time, sensor.displacement) for name, sensor in solution.sensors.items()}
    return measure(solution.outcome.interface_time, solution.interfaces, scene.time.end, sensors)


Log = Callable[[str], None]


def message_of(error: LatinError) -> str:
    """The problems of an error as one line of text."""
    problems = getattr(error, "problems", ())
    return "; ".join(f"{p.where}: {p.what}" for p in problems) or str(error)


@dataclass(frozen=True)
class RunTimeFit:
    """CPU seconds of a run at another resolution: fixed + rate x mesh^exponent x steps, fitted to measured runs."""

    fixed: float
    rate: float
    exponent: float

    @classmethod
    def of(cls, scene: Scene, runs: list[Run]) -> RunTimeFit:
        """Fit to the largest and the cheapest of runs at different resolutions (at least one).

        The first run of a process includes the time to load kernels, so the smallest may not be the cheapest.
        """
        exponent = cost_exponent(scene)
        work = [r.resolution.mesh**exponent * r.resolution.time for r in runs]
        large = max(range(len(runs)), key=work.__getitem__)
        cheap = min(range(len(runs)), key=lambda i: runs[i].cpu)
        if work[cheap] == work[large]:
            return cls(0.0, runs[large].cpu / work[large], exponent)
        rate = (runs[large].cpu - runs[cheap].cpu) / (work[large] - work[cheap])
        return cls(max(runs[cheap].cpu - rate * work[cheap], 0.0), rate, exponent)

    def seconds(self, mesh: float, time: float) -> float:
        """Predicted CPU seconds at a resolution."""
        return float(self.fixed + self.rate * mesh**self.exponent * time)


def cost_exponent(scene: Scene) -> float:
    """Growth of the cost of a step with the number of elements along an edge: solves with banded factors in bars,
    about n^1.2 for the n nodes of plates and n^(4/3) of solids."""
    if mesh_files(scene):
        return 4.0
    directions = {i for b in scene.substructure.values() if b.box for i, n in enumerate(b.box.elements) if n > 1}
    return (0.0, 1.0, 2.4, 4.0)[len(directions)]


def memory_at(scene: Scene, at: Resolution) -> float:
    """Bytes of the Cholesky factors of the boxes at a resolution (``assembly.propagator_choice.factor_bytes``)."""
    boxes = [b.box for b in at_resolution(scene, Resolution(at.mesh)).substructure.values() if b.box is not None]
    return sum(factor_bytes(3 * math.prod(n + 1 for n in box.elements)) for box in boxes)
