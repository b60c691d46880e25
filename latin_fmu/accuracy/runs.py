"""Runs of a scene on other meshes, with other time steps or tolerances: error of loads sampled at the time steps;
quantities of interest and cost of a run; time and memory of other runs predicted from it.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from .. import api
from ..assembly.propagator_choice import factor_bytes
from ..building import discretise
from ..errors import LatinError
from ..latin.outcome import Array, SensorHistory, Timings
from ..results.solution import Solution
from ..run_quantities import Quantities, measure_solution
from ..scene.laws import InputLaw, RectangularPulseLaw, StepLaw, sampled_impulse_error
from ..scene.schema import Scene
from ..scene.settings import WHOLE, AutomaticScheme, GeneralizedAlphaTable, HHTTable
from ..scene.substructures import MAX_REFINEMENTS, MeshFile, Substructure

FEWEST_STEPS: Final = 8
"""Least number of time steps of a coarser run."""
_MOST_KEPT: Final = 50_000  # instants of interface histories, about


@dataclass(frozen=True)
class Resolution:
    """How fine a run is: elements per length and steps per time, relative to the scene as written.

    ``tolerance`` on sqrt(eta); that of the scene where None.
    """

    mesh: float = 1.0
    time: float = 1.0
    tolerance: float | None = None


def mesh_files(scene: Scene) -> list[MeshFile]:
    """Meshes from files: they can be refined, and be coarser again, but not coarser than the file."""
    return [body.mesh for body in scene.substructure.values() if body.mesh is not None]


def coarsens_mesh(scene: Scene) -> bool:
    """Whether a coarser mesh exists: of boxes, and of files that are refined."""
    files = mesh_files(scene)
    if files:
        return all(file.refine > 0 for file in files)
    return bool(counts_that_vary(scene))


def mesh_factor(scene: Scene, wanted: float) -> float:
    """The factor nearest to ``wanted`` by which the meshes can change.

    It leaves the largest number of elements of boxes whole; where a mesh is from a file it is a power of two.
    """
    files = mesh_files(scene)
    if not files:
        return reachable(counts_that_vary(scene), wanted)
    levels = [file.refine for file in files]
    power = math.floor(math.log2(wanted) + 0.5)
    return float(2.0 ** max(min(power, MAX_REFINEMENTS - max(levels)), -min(levels)))


def counts_that_vary(scene: Scene) -> list[int]:
    """Numbers of elements other than one: those that a change of the mesh scales."""
    boxes = [body.box for body in scene.substructure.values() if body.box is not None]
    return [n for box in boxes for n in box.elements if n > 1]


def reachable(counts: list[int], factor: float) -> float:
    """The factor nearest to ``factor`` that leaves the largest number of elements whole.

    >>> reachable([6, 6], 0.25), reachable([5], 0.5)
    (0.3333333333333333, 0.6)
    """
    largest = max(counts)
    # halves up, as ``_scaled``: round() takes 2.5 to 2, and 3.5 to 4
    return max(1, int(largest * factor + 0.5)) / largest


def at_resolution(scene: Scene, resolution: Resolution) -> Scene:
    """The scene with numbers of elements and steps multiplied, without the output that no quantity needs.

    The time step is divided by ``resolution.time`` exactly; the last instant falls at the end or less than a step
    after it. One element across stays one.

    Raises
    ------
    SceneError : the mesh or the number of steps leaves the range of a scene.
    """
    every = max(1, scene.output.interfaces_every, int(scene.time.n_step * resolution.time) // _MOST_KEPT)
    changes: dict[str, object] = {
        "output": type(scene.output)(peak_duration=scene.output.peak_duration, interfaces_every=max(1, every)),
        "spread": {},
    }
    if resolution.mesh != 1.0:
        changes["substructure"] = {n: _refined(body, resolution.mesh) for n, body in scene.substructure.items()}
    if resolution.time != 1.0:
        n = max(1, math.ceil(scene.time.n_step * resolution.time - 1e-6))  # round-off of a ratio makes no step more
        step = scene.time.time_step / resolution.time
        changes["time"] = scene.time.model_copy(update={"end": n * step, "step": None, "instants": n})
    if resolution.tolerance is not None:
        changes["solver"] = with_tolerance(scene, resolution.tolerance)
    return scene.model_copy(update=changes)


def with_tolerance(scene: Scene, tolerance: float) -> object:
    """Solver settings with another tolerance; a force tolerance that was given keeps its ratio to it."""
    solver = scene.solver
    update: dict[str, object] = {"tolerance": tolerance}
    if solver.force_tolerance is not None:
        update["force_tolerance"] = solver.force_tolerance * tolerance / solver.tolerance
    return solver.model_copy(update=update)


def in_short_windows(scene: Scene, scheme: str | None = None) -> Scene:
    """The scene with windows of one instant in the place of one whole window: same solution, far fewer sweeps. Its time
    scheme is the one chosen for this mesh, on coarser and finer ones too; ``scheme``: its name where a run was made."""
    if isinstance(scene.time.scheme, AutomaticScheme) and not scene.time.quasi_static:
        if scheme is None:
            name = discretise(scene).scheme.name
        else:
            name = scheme
        chosen = GeneralizedAlphaTable() if name.startswith("generalized_alpha") else HHTTable()
        scene = scene.model_copy(update={"time": scene.time.model_copy(update={"scheme": chosen})})
    if scene.solver.window != WHOLE:
        return scene
    update = {"window": 1, "acceleration": type(scene.solver)().acceleration}
    return scene.model_copy(update={"solver": scene.solver.model_copy(update=update)})


def _refined(body: Substructure, factor: float) -> Substructure:
    if body.box is not None:
        box = body.box.model_copy(update={"elements": _scaled(body.box.elements, factor)})
        return body.model_copy(update={"box": box})
    assert body.mesh is not None
    # a level of refinement halves all edges
    mesh = body.mesh.model_copy(update={"refine": body.mesh.refine + round(math.log2(factor))})
    return body.model_copy(update={"mesh": mesh})


def _scaled(elements: tuple[int, int, int], factor: float) -> tuple[int, ...]:
    return tuple(n if n == 1 else max(1, math.floor(n * factor + 0.5)) for n in elements)


def sampling_error(scene: Scene, step: float | None = None) -> float:
    """Largest relative error of the impulse of a load sampled with a step (s; that of the scene where None).

    Loads that are inputs count as exact.
    """
    if step is None:
        step = scene.time.time_step
    time = step * np.arange(math.ceil(scene.time.end / step - 1e-6) + 1)
    laws = [law for law in scene.force_laws.values() if not isinstance(law, InputLaw)]
    return max((abs(sampled_impulse_error(law, time)) for law in laws), default=0.0)


def aligned(scene: Scene, factor: float) -> float:
    """A number of steps relative to that of the scene, near ``factor`` (within 12 %), with jumps of loads at instants.

    A pulse that ends between two instants loses or gains up to half a step of impulse, which would count as an error
    of the run.
    """
    step = scene.time.time_step
    choices = [factor]
    for jump in _jumps(scene):
        first, last = math.ceil(0.88 * factor * jump / step), math.floor(1.12 * factor * jump / step)
        # steps that divide the time up to the jump
        choices += [k * step / jump for k in range(max(first, 1), min(last, first + 100) + 1)]
    # equal but for round-off: the one nearest to the factor is taken
    errors = np.round([sampling_error(scene, step / choice) for choice in choices], 6)
    best = np.flatnonzero(errors == errors.min())
    return min((choices[i] for i in best), key=lambda choice: abs(choice - factor))


def _jumps(scene: Scene) -> list[float]:
    """Instants inside the interval at which a load jumps, s."""
    jumps = set()
    for law in scene.force_laws.values():
        if isinstance(law, StepLaw | RectangularPulseLaw):
            jumps.add(law.start)
        if isinstance(law, RectangularPulseLaw):
            jumps.add(law.start + law.duration)
    return sorted(t for t in jumps if 0.0 < t < scene.time.end)


@dataclass(frozen=True)
class RunCost:
    """Measured cost of a run: CPU seconds of the set-up, and of all that is done at every time step.

    ``at`` : its resolution.
    """

    at: Resolution
    setup: float
    steps: float

    @classmethod
    def of(cls, at: Resolution, timings: Timings) -> RunCost:
        """From the CPU seconds by part of a run."""
        return cls(at, timings.setup, timings.march + timings.other)


@dataclass(frozen=True)
class MeasuredRun:
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
    by_modes: bool = False

    @property
    def cost(self) -> RunCost:
        """CPU seconds by part."""
        return RunCost.of(self.resolution, self.timings)


def run_at(scene: Scene, resolution: Resolution, **options: Any) -> MeasuredRun:
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


def solved(scene: Scene, lean: Scene, resolution: Resolution, **options: Any) -> tuple[MeasuredRun, Solution]:
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
    run = MeasuredRun(
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
        by_modes="propagator" in solution.outcome.settings,
    )
    return run, solution


Log = Callable[[str], None]
"""Takes a line of text."""


def message_of(error: LatinError) -> str:
    """The problems of an error as one line of text."""
    problems = getattr(error, "problems", ())
    return "; ".join(f"{p.where}: {p.what}" for p in problems) or str(error)


@dataclass(frozen=True)
class RunTimeFit:
    """CPU seconds of a run at another resolution, fitted to measured runs: with m elements per length and n steps over
    those of the scene

        a + b m^s + (c + d m^e) n

    of the set-up, and of the steps. The exponents are ``setup_exponent`` and ``cost_exponent``.
    """

    setup: tuple[float, float]
    step: tuple[float, float]
    setup_exponent: float
    exponent: float

    @classmethod
    def of(cls, scene: Scene, runs: Sequence[RunCost]) -> RunTimeFit:
        """Fit to the largest and the cheapest of runs at different resolutions (at least one).

        The first run of a process includes the time to load kernels, so the smallest may not be the cheapest.
        """
        s, e = setup_exponent(scene), cost_exponent(scene)
        large = max(runs, key=lambda run: run.at.mesh**e * run.at.time)
        cheap = min(runs, key=lambda run: run.setup + run.steps)
        meshes = large.at.mesh, cheap.at.mesh
        setup = _line(meshes, (large.setup, cheap.setup), s)
        return cls(setup, _line(meshes, (large.steps / large.at.time, cheap.steps / cheap.at.time), e), s, e)

    def seconds(self, mesh: float, time: float) -> float:
        """Predicted CPU seconds at a resolution."""
        (a, b), (c, d) = self.setup, self.step
        return float(a + b * mesh**self.setup_exponent + (c + d * mesh**self.exponent) * time)


def _line(meshes: tuple[float, float], costs: tuple[float, float], exponent: float) -> tuple[float, float]:
    """The terms a, b >= 0 of a + b m^exponent through the cost at the first mesh, and as near as may be at the other:
    the first alone counts where both are equal."""
    fine, coarse = (m**exponent for m in meshes)
    if fine > coarse:
        slope = max(costs[0] - costs[1], 0.0) / (fine - coarse)
        return max(costs[0] - slope * fine, 0.0), min(slope, costs[0] / fine)
    return 0.0, costs[0] / fine


_DIMENSIONS: Final = (0.0, 1.0, 2.4, 4.0)
_SETUPS: Final = (0.0, 1.0, 2.4, 3.5)


def cost_exponent(scene: Scene) -> float:
    """Growth of the cost of a step with the number of elements along an edge: solves with banded factors in bars,
    about n^1.2 for the n nodes of plates and n^(4/3) of solids."""
    return _DIMENSIONS[_directions(scene)]


def setup_exponent(scene: Scene) -> float:
    """Growth of the cost of the set-up with the number of elements along an edge: factors in bars, about n^1.2 for the
    n nodes of plates and solids of up to some 100,000 unknowns, between n of the assembly and n^2 of the factors."""
    return _SETUPS[_directions(scene)]


def _directions(scene: Scene) -> int:
    """Number of axes along which boxes have several elements; 3 with a mesh from a file."""
    if mesh_files(scene):
        return 3
    return len({i for b in scene.substructure.values() if b.box for i, n in enumerate(b.box.elements) if n > 1})


def memory_at(scene: Scene, at: Resolution) -> float:
    """Bytes of the Cholesky factors of the boxes at a resolution (``assembly.propagator_choice.factor_bytes``)."""
    boxes = [b.box for b in at_resolution(scene, Resolution(at.mesh)).substructure.values() if b.box is not None]
    # an upper bound: equal boxes share one factor
    return sum(factor_bytes(3 * math.prod(n + 1 for n in box.elements)) for box in boxes)
