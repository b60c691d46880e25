"""The designed study: which runs tell what accuracy costs."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from ..results.estimates import ErrorEstimate
from ..scene.schema import Scene
from ..scene.solver_settings import WHOLE
from .bench import Bench, CostModel, Row, Tell
from .companions import companions_of, reachable
from .differences import judged
from .kinds import FLOOR
from .measured import Measured
from .reference import Reference, declared
from .refinement import Resolution, at_resolution, counts_that_vary, meshed_by_the_program
from .runs import Run
from .sampling import aligned
from .variants import Variant, changed, directions_of, main_variant, unreduced, variants_of

TOGETHER, SPACE, TIME, TOLERANCE, REDUCTION, WINDOWS, REFERENCE = (
    "together",
    "space",
    "time",
    "tolerance",
    "reduction",
    "windows",
    "reference",
)
"""Series of runs."""

TOLERANCES = (1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 1e-4)
TIGHT = 1e-6


@dataclass
class Study:
    """Outcome of a study.

    Attributes
    ----------
    scene : as given. rows : every run, failed ones included. reference : what errors are measured against.
    main : name of the scene's own way to march. windows : (length, direction) -> (mean iterations, passes).
    seconds : CPU seconds in all.
    """

    scene: Scene
    main: str
    reference: Reference
    rows: list[Row] = field(default_factory=list)
    windows: dict[tuple[str, str], tuple[float, float]] = field(default_factory=dict)
    seconds: float = 0.0

    def of(self, series: str, variant: str | None = None) -> list[Row]:
        """Rows of a series that succeeded, in order of cost."""
        wanted = self.main if variant is None else variant
        found = [r for r in self.rows if r.series == series and r.variant == wanted and r.run and not r.failure]
        return sorted(found, key=lambda r: (r.resolution.mesh, r.resolution.time, -r.tolerance))

    def error(self, row: Row, quantity: str) -> float:
        """Relative error of a quantity of a row against the reference; NaN where unknown, or where the reference is
        a run hardly finer."""
        if row.run is None or quantity not in row.run.measured.values:
            return math.nan
        finest = self.reference.resolution
        if finest is not None and min(row.resolution.mesh / finest.mesh, row.resolution.time / finest.time) > 0.75:
            return math.nan
        return row.run.measured.error(quantity, self.reference.measured)

    @property
    def quantities(self) -> list[str]:
        """Quantities that the reference has and the runs too."""
        runs = [r.run for r in self.rows if r.run is not None]
        return [q for q in self.reference.measured.values if any(q in r.measured.values for r in runs)]


def study(scene: Scene, budget: float, tell: Tell) -> Study:
    """Run the study of a scene in about ``budget`` CPU seconds.

    Mesh and step together for every scheme and propagator; mesh alone, step alone and tolerance for the scene's own,
    and where it is reduced, the same without reduction; windows against search directions on a coarse mesh. The
    reference is declared with the model or the finest run that a third of the budget pays.

    Raises
    ------
    SceneError : the scene cannot be built as written.
    """
    bench = Bench(budget, tell)
    main = main_variant(scene)
    factors = _factors(scene)
    bench.warm_up(main, _at(scene, factors[0]))
    coarse = [_at(scene, f) for f in factors if f <= 1.0]
    runs = [r for r in (bench.run(TOGETHER, main, at, save=True) for at in coarse) if r is not None]
    if not runs:
        at_resolution(scene, Resolution())  # nothing to learn: let what is wrong be told
    reference = declared(scene)
    for f in (f for f in factors if f > 1.0):
        share = 0.35 if reference is None else 0.15
        if runs and CostModel.fitted(scene, runs[-2:]).seconds(f, f) < share * budget:
            run = bench.run(TOGETHER, main, _at(scene, f), save=True)
            runs += [] if run is None else [run]
    found = Study(scene, main.name, reference or _finest(scene, bench, main, runs))
    _separate(scene, bench, main)
    if (whole := unreduced(scene)) is not None:
        bench.run(REDUCTION, whole, _at(scene, 1.0))
    _map(scene, bench, main)
    _others(scene, bench, factors)
    _windows(scene, bench, found)
    found.rows, found.seconds = bench.rows, bench.spent
    return found


def _factors(scene: Scene) -> list[float]:
    """Refinement factors, each leaving the largest number of elements whole."""
    wanted = (0.25, 0.35, 0.5, 0.71, 1.0, 1.41, 2.0, 2.83, 4.0)
    counts = counts_that_vary(scene)
    if not counts or not meshed_by_the_program(scene):
        return list(wanted)
    return sorted({reachable(counts, f) for f in wanted})


def _at(scene: Scene, factor: float) -> Resolution:
    """Mesh and step refined together (the step alone where the mesh is from a file)."""
    mesh = factor if counts_that_vary(scene) and meshed_by_the_program(scene) else 1.0
    return Resolution(mesh, aligned(scene, factor))


def _finest(scene: Scene, bench: Bench, main: Variant, runs: list[Run]) -> Reference:
    """The finest run, its error estimated from the coarser ones."""
    finest = runs[-1]
    at = finest.resolution
    fine_scene = at_resolution(main.scene or scene, at)
    companions = companions_of(fine_scene)
    own: ErrorEstimate | None = None
    if companions is not None:
        coarser: dict[str, Measured] = {}
        for name, relative in (
            ("half", companions.half),
            ("quarter", companions.quarter),
            ("half_mesh", companions.half_mesh),
        ):
            if relative is not None:
                point = Resolution(at.mesh * relative.mesh, at.time * relative.time)
                run = bench.run(REFERENCE, main, point)
                if run is not None:
                    coarser[name] = run.measured
        if "half" in coarser:
            own = ErrorEstimate(judged(fine_scene, finest.measured, coarser, companions), (), 0.0, FLOOR)
    text = f"refined run: mesh x {at.mesh:.3g}, steps x {at.time:.3g}, {finest.cpu:.3g} CPU s"
    return Reference(finest.measured, False, text, own, at)


def _separate(scene: Scene, bench: Bench, main: Variant) -> None:
    """Mesh alone at twice the steps; step alone on the mesh as written."""
    counts = counts_that_vary(scene)
    if counts and meshed_by_the_program(scene):
        for f in sorted({reachable(counts, f) for f in (0.35, 0.5, 1.0, 2.0)}):
            bench.run(SPACE, main, Resolution(f, aligned(scene, 2.0)))
    for f in (0.25, 0.5, 1.0, 2.0, 4.0):
        bench.run(TIME, main, Resolution(1.0, aligned(scene, f)))


def _map(scene: Scene, bench: Bench, main: Variant) -> None:
    """Tolerance against mesh; the tightest one tells what the iteration leaves."""
    counts = counts_that_vary(scene)
    meshes = sorted({reachable(counts, f) for f in (0.35, 0.5, 1.0, 1.41)}) if counts else [0.5, 1.0, 2.0]
    for f in meshes:
        at = _at(scene, f)
        for tolerance in (TIGHT, *TOLERANCES):
            bench.run(TOLERANCE, main, Resolution(at.mesh, at.time, tolerance))


def _others(scene: Scene, bench: Bench, factors: list[float]) -> None:
    """Other schemes and propagators, refined together like the scene's own; where the step is refused, shorter ones."""
    others = variants_of(scene)
    for i, variant in enumerate(others):
        share = 0.6 * bench.left / (len(others) - i)
        runs: list[Run] = []
        for f in [g for g in factors if g > 0.3]:
            run = _with_stable_steps(scene, bench, variant, f)
            runs += [] if run is None else [run]
            if variant.scene is None:
                break
            coming = f * 2**0.5
            if runs and CostModel.fitted(scene, runs[-2:]).seconds(coming, coming) > 0.4 * share:
                break


def _with_stable_steps(scene: Scene, bench: Bench, variant: Variant, factor: float) -> Run | None:
    """A run with mesh and step refined together; a step refused as too long is halved, twice at most."""
    at = _at(scene, factor)
    for shorter in (1.0, 2.0, 4.0):
        run = bench.run(TOGETHER, variant, Resolution(at.mesh, at.time * shorter))
        if run is not None or "step is longer" not in bench.rows[-1].failure:
            return run
    return None


def _windows(scene: Scene, bench: Bench, found: Study) -> None:
    """Iterations and passes against window length and search direction, on half the mesh."""
    counts = counts_that_vary(scene)
    at = _at(scene, reachable(counts, 0.5) if counts else 0.5)
    for length in (1, 2, 5, 10, 25, WHOLE):
        for direction in directions_of(scene):
            solver = {"window": length, "search_direction": direction, "acceleration": "anderson"}
            name = f"window {length}, {direction}"
            variant = Variant(name, changed(scene, {"solver": {**solver, "max_iterations": 100}}))
            run = bench.run(WINDOWS, variant, at)
            if run is not None:
                found.windows[(str(length), direction)] = (run.iterations[0], run.passes)
