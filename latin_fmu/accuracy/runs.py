"""One run with its quantities and its cost; time and memory of other runs predicted from it."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .. import api
from ..assembly.propagator_choice import factor_bytes
from ..errors import LatinError
from ..latin.outcome import Array, SensorHistory, Timings
from ..results.solution import Solution
from ..scene.schema import Scene
from .quantities import Quantities, measure
from .resolution import Resolution, at_resolution, mesh_files


@dataclass(frozen=True)
class Run:
    """Quantities and cost of a run; NaN and no quantities where it was not made.

    Attributes
    ----------
    resolution : relative to the scene. quantities : of the run. cpu : CPU seconds of the process, set-up included.
    timings : by part. iterations : per window, mean and largest. converged, status : as of the solution; the reason
        where the run was not made, then ``steps`` is 0.
    steps : time steps. time, sensors : instants, s, and motions of the sensors.
    """

    resolution: Resolution
    quantities: Quantities = field(default_factory=Quantities)
    cpu: float = math.nan
    timings: Timings = field(default_factory=lambda: Timings(math.nan, math.nan, math.nan, math.nan))
    iterations: tuple[float, int] = (math.nan, 0)
    converged: bool = False
    status: str = ""
    steps: int = 0
    passes: float = math.nan
    time: Array = field(default_factory=lambda: np.zeros(0))
    sensors: Mapping[str, SensorHistory] = field(default_factory=dict)


def run_at(scene: Scene, resolution: Resolution, **options: Any) -> Run:
    """Solve the scene at a resolution; options as for ``api.solve`` (``progress``, ``processes``, ``stream``,
    ``max_cpu``).

    Raises
    ------
    SceneError : the scene cannot be built at this resolution.
    """
    run, solution = solved(scene, at_resolution(scene, resolution), resolution, **options)
    if solution.outcome.stream is not None:
        solution.outcome.stream.close()
    return run


def solved(scene: Scene, lean: Scene, resolution: Resolution, **options: Any) -> tuple[Run, Solution]:
    """The run and the solution of ``lean``, which is the scene at a resolution: its last instant may be a step later,
    so that quantities are those until the end of ``scene``. Options as for ``api.solve``.

    Raises
    ------
    LatinError : the scene cannot be built or solved.
    """
    start = clock.process_time()
    solution = api.solve(lean, **options)
    cpu = clock.process_time() - start
    counts = [window.iterations for window in solution.windows] or [0]
    run = Run(
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
    return run, solution


def measure_solution(scene: Scene, solution: Solution) -> Quantities:
    """Quantities of a solution on the interval of the scene."""
    sensors = {name: (solution.time, sensor.displacement) for name, sensor in solution.sensors.items()}
    return measure(solution.outcome.interface_time, solution.interfaces, scene.time.end, sensors)


Log = Callable[[str], None]
"""Takes a line of text."""


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
