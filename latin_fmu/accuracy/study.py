"""Work-precision study of a scene: runs over meshes, time steps, tolerances, time schemes and propagators."""

from __future__ import annotations

import contextlib
import math
import tempfile
import time as clock
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .. import api
from ..errors import LatinError
from ..reader import scene_from_dict
from ..results.estimates import ErrorEstimate
from ..scene.describe import tables_in, tag_of
from ..scene.schema import Scene
from ..scene.settings import WHOLE, Solver, Time
from .estimate import coarser_runs_of
from .quantities import Quantities
from .reference import Reference, declared
from .resolution import Resolution, aligned, at_resolution, coarsens_mesh, in_short_windows, mesh_factor
from .runs import Log, Run, RunTimeFit, as_run, message_of

AS_WRITTEN = "as written"


@dataclass(frozen=True)
class Variant:
    """A way to solve a scene: its name in tables and curves, and the scene (None where refused, with the reason)."""

    name: str
    scene: Scene | None
    refusal: str = ""


def main_variant(scene: Scene) -> Variant:
    """The scene with its own scheme and propagator, in short windows (same solution, fewer sweeps)."""
    short = in_short_windows(scene)
    return Variant(_name(short), short)


def unreduced(scene: Scene) -> Variant | None:
    """The scene without reduced substructures, otherwise unchanged; None where nothing is reduced."""
    if scene.solver.propagator.type != "reduced":
        return None
    direct = changed(in_short_windows(scene), {"solver": {"propagator": "direct"}})
    return Variant(_name(direct), direct)


def variants_of(scene: Scene) -> list[Variant]:
    """The scene with every other scheme and propagator, then as written where it is one whole window.

    Quasi-static schemes are left out: they solve another problem.
    """
    short = in_short_windows(scene)
    own = (short.time.scheme.type, scene.solver.propagator.type)
    whole = unreduced(scene)
    of_its_own = {"time": {"scheme": "automatic"}} if own[0] == "generalized_alpha" else {}
    variants = [] if whole is None else [whole]
    variants += [
        _changed(short, tag, {"time": {"scheme": tag}, "solver": {"propagator": "automatic"}})
        for tag in _tags(Time, "scheme")
        if tag not in (own[0], "automatic") and "static" not in tag
    ]
    variants += [
        _changed(short, tag, {"solver": {"propagator": tag}, **(of_its_own if tag == "reduced" else {})})
        for tag in _tags(Solver, "propagator")
        if tag not in ("automatic", "direct", "explicit", own[1])
    ]
    if scene.solver.window == WHOLE:
        variants.append(Variant(AS_WRITTEN, scene))
    return variants


def directions_of(scene: Scene) -> list[str]:
    """Search directions that need no parameters."""
    tables = tables_in(Solver.model_fields["search_direction"].annotation)
    return (
        [
            str(tag_of(table))
            for table in tables
            if not any(field.is_required() for field in table.model_fields.values())
        ]
        if scene.interface
        else []
    )


def changed(scene: Scene, changes: dict[str, dict[str, Any]]) -> Scene:
    """The scene with keys of its tables replaced, checked as a whole.

    Raises
    ------
    SceneError : the changes do not go with the rest of the scene.
    """
    data = tomllib.loads(scene.text())
    for table, keys in changes.items():
        data[table] = {**data.get(table, {}), **keys}
    return scene_from_dict(data, scene.base_dir)


def _changed(scene: Scene, name: str, changes: dict[str, dict[str, Any]]) -> Variant:
    try:
        return Variant(name, changed(scene, changes))
    except LatinError as error:
        return Variant(name, None, "; ".join(str(error).splitlines()[1:]).strip() or str(error))


def _tags(table: type[Time] | type[Solver], field: str) -> list[str]:
    return [str(tag_of(t)) for t in tables_in(table.model_fields[field].annotation)]


def _name(scene: Scene) -> str:
    propagator = scene.solver.propagator.type
    scheme = scene.time.scheme
    text = f"hht {scheme.alpha:g}" if scheme.type == "hht" else scheme.type
    return text if propagator in ("automatic", "direct", "explicit") else f"{propagator}, {text}"


@dataclass
class Row:
    """One run of the study: series, variant, resolution and the run; ``failure`` is the reason where there is none."""

    series: str
    variant: str
    resolution: Resolution
    tolerance: float
    run: Run | None
    failure: str = ""


@dataclass
class StudyRuns:
    """Runs of a study, each made once.

    Attributes
    ----------
    budget : CPU seconds of the whole study. log : called with a line of text after each run. rows : of all runs.
    """

    budget: float
    log: Log
    rows: list[Row] = field(default_factory=list)
    spent: float = 0.0
    _made: dict[tuple[str, Resolution], tuple[Run | None, str]] = field(default_factory=dict)

    def run(self, series: str, variant: Variant, resolution: Resolution, save: bool = False) -> Run | None:
        """The run of a variant at a resolution; None where it failed (the row has the reason).

        ``save``: write its results to a temporary file, so that the cost of output is measured.
        """
        key = (variant.name, resolution)
        if key not in self._made:
            self._made[key] = self._solve(variant, resolution, save)
        run, failure = self._made[key]
        scene = variant.scene
        tolerance = resolution.tolerance or (math.nan if scene is None else scene.solver.tolerance)
        self.rows.append(Row(series, variant.name, resolution, tolerance, run, failure))
        return run if run is not None and not failure else None

    def warm_up(self, variant: Variant, resolution: Resolution) -> None:
        """One run that is in no row, so that no row includes the time to load or compile kernels."""
        if variant.scene is not None:
            with contextlib.suppress(LatinError):
                api.solve(at_resolution(variant.scene, resolution))

    def _solve(self, variant: Variant, resolution: Resolution, save: bool) -> tuple[Run | None, str]:
        label = f"{variant.name}, mesh x {resolution.mesh:.3g}, steps x {resolution.time:.3g}"
        if resolution.tolerance is not None:
            label += f", tolerance {resolution.tolerance:g}"
        if variant.scene is None:
            self.log(f"refused  {label}: {variant.refusal}")
            return None, variant.refusal
        start = clock.process_time()
        try:
            solution = api.solve(at_resolution(variant.scene, resolution), max_cpu=self.budget)
        except LatinError as error:
            failure = message_of(error)
            self.log(f"refused  {label}: {failure}")
            return None, failure
        cpu = clock.process_time() - start
        if save:
            with tempfile.TemporaryDirectory() as folder:
                solution.save(Path(folder) / "out.nc")
        run = as_run(variant.scene, solution, resolution, cpu)
        self.spent += clock.process_time() - start
        self.log(f"{cpu:7.2f} s  {label}" + ("" if run.converged else f": {run.status}"))
        return run, "" if run.converged else run.status

    @property
    def left(self) -> float:
        """Remaining CPU seconds of the budget."""
        return self.budget - self.spent


TOGETHER, SPACE, TIME, TOLERANCE = "together", "space", "time", "tolerance"
REDUCTION, WINDOWS, REFERENCE = "reduction", "windows", "reference"
"""Series of runs."""

TOLERANCES = (1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 1e-4)
TIGHT = 1e-6


@dataclass
class Study:
    """Result of a study.

    Attributes
    ----------
    scene : as given. main : name of the variant with the scene's own scheme and propagator. reference : of the errors.
    rows : every run, failed ones included. windows : (length, direction) -> (mean iterations, passes).
    seconds : CPU seconds in all.
    """

    scene: Scene
    main: str
    reference: Reference
    rows: list[Row] = field(default_factory=list)
    windows: dict[tuple[str, str], tuple[float, float]] = field(default_factory=dict)
    seconds: float = 0.0

    def of(self, series: str, variant: str | None = None) -> list[Row]:
        """Rows of a series without failure, in order of cost; of the main variant where none is named."""
        name = self.main if variant is None else variant
        rows = [r for r in self.rows if r.series == series and r.variant == name and r.run and not r.failure]
        return sorted(rows, key=lambda r: (r.resolution.mesh, r.resolution.time, -r.tolerance))

    def error(self, row: Row, quantity: str) -> float:
        """Relative error of a quantity of a row against the reference; NaN where unknown, where the run has not
        converged, or where the reference is a run hardly finer."""
        if row.run is None or row.failure or quantity not in row.run.quantities.values:
            return math.nan
        finest = self.reference.resolution
        if finest is not None and min(row.resolution.mesh / finest.mesh, row.resolution.time / finest.time) > 0.75:
            return math.nan
        return row.run.quantities.error(quantity, self.reference.quantities)

    @property
    def quantities(self) -> list[str]:
        """Names of the quantities of both the reference and the runs."""
        runs = [r.run for r in self.rows if r.run is not None]
        return [q for q in self.reference.quantities.values if any(q in r.quantities.values for r in runs)]


def study(scene: Scene, budget: float, log: Log) -> Study:
    """Run the study of a scene in about ``budget`` CPU seconds.

    Mesh and step together for every scheme and propagator; mesh alone, step alone and tolerance for the scene's own,
    and where it is reduced, the same without reduction; windows and search directions on a coarse mesh. The reference
    is declared with the model, else it is the finest run that a third of the budget allows.

    Raises
    ------
    SceneError : the scene cannot be built as written.
    """
    made = StudyRuns(budget, log)
    main = main_variant(scene)
    factors = _factors(scene, (0.25, 0.35, 0.5, 0.71, 1.0, 1.41, 2.0, 2.83, 4.0))
    made.warm_up(main, _at(scene, factors[0]))
    coarse = [_at(scene, f) for f in factors if f <= 1.0]
    runs = [r for r in (made.run(TOGETHER, main, at, save=True) for at in coarse) if r is not None]
    if not runs:
        at_resolution(scene, Resolution())  # raises the error of the scene
    reference = declared(scene)
    for f in (f for f in factors if f > 1.0):
        share = 0.35 if reference is None else 0.15
        if runs and RunTimeFit.of(scene, runs[-2:]).seconds(f, f) < share * budget:
            run = made.run(TOGETHER, main, _at(scene, f), save=True)
            runs += [] if run is None else [run]
    result = Study(scene, main.name, reference or finest_reference(scene, made, main, runs))
    _refine_separately(scene, made, main)
    if (whole := unreduced(scene)) is not None:
        made.run(REDUCTION, whole, _at(scene, 1.0))
    _refine_others(scene, made, factors)
    _vary_windows(scene, made, result)
    result.rows, result.seconds = made.rows, made.spent
    return result


def _factors(scene: Scene, wanted: tuple[float, ...]) -> list[float]:
    """The refinement factors near those wanted that the meshes allow."""
    return sorted({mesh_factor(scene, f) for f in wanted}) if coarsens_mesh(scene) else list(wanted)


def _at(scene: Scene, factor: float) -> Resolution:
    """Mesh and step refined together (the step alone where no coarser mesh exists)."""
    return Resolution(factor if coarsens_mesh(scene) else 1.0, aligned(scene, factor))


def finest_reference(scene: Scene, made: StudyRuns, main: Variant, runs: list[Run]) -> Reference:
    """The finest run as reference, its error estimated from coarser runs."""
    finest = runs[-1]
    at = finest.resolution
    fine_scene = at_resolution(main.scene or scene, at)
    plan = coarser_runs_of(fine_scene)
    own: ErrorEstimate | None = None
    if plan is not None:
        coarser: dict[str, Quantities] = {}
        for name, relative in plan.by_name().items():
            run = made.run(REFERENCE, main, Resolution(at.mesh * relative.mesh, at.time * relative.time))
            if run is not None:
                coarser[name] = run.quantities
        if estimates := plan.estimates(fine_scene, finest.quantities, coarser):
            own = ErrorEstimate(estimates)
    text = f"refined run: mesh x {at.mesh:.3g}, steps x {at.time:.3g}, {finest.cpu:.3g} CPU s"
    return Reference(finest.quantities, False, text, own, at)


def _refine_separately(scene: Scene, made: StudyRuns, main: Variant) -> None:
    """Mesh alone at twice the steps; step alone on the mesh as written; tolerances on several meshes."""
    if coarsens_mesh(scene):
        for f in _factors(scene, (0.35, 0.5, 1.0, 2.0)):
            made.run(SPACE, main, Resolution(f, aligned(scene, 2.0)))
    for f in (0.25, 0.5, 1.0, 2.0, 4.0):
        made.run(TIME, main, Resolution(1.0, aligned(scene, f)))
    for f in _factors(scene, (0.35, 0.5, 1.0, 1.41)):
        at = _at(scene, f)
        for tolerance in (TIGHT, *TOLERANCES):
            made.run(TOLERANCE, main, Resolution(at.mesh, at.time, tolerance))


def _refine_others(scene: Scene, made: StudyRuns, factors: list[float]) -> None:
    """Other schemes and propagators, mesh and step together; shorter steps where the step is refused."""
    others = variants_of(scene)
    for i, variant in enumerate(others):
        share = 0.6 * made.left / (len(others) - i)
        runs: list[Run] = []
        for f in [g for g in factors if g > 0.3]:
            run = _with_stable_steps(scene, made, variant, f)
            runs += [] if run is None else [run]
            if variant.scene is None:
                break
            following = f * 2**0.5
            if runs and RunTimeFit.of(scene, runs[-2:]).seconds(following, following) > 0.4 * share:
                break


def _with_stable_steps(scene: Scene, made: StudyRuns, variant: Variant, factor: float) -> Run | None:
    """A run with mesh and step refined together; a step refused as too long is halved, twice at most."""
    at = _at(scene, factor)
    for shorter in (1.0, 2.0, 4.0):
        run = made.run(TOGETHER, variant, Resolution(at.mesh, at.time * shorter))
        if run is not None or "step is longer" not in made.rows[-1].failure:
            return run
    return None


def _vary_windows(scene: Scene, made: StudyRuns, result: Study) -> None:
    """Iterations and passes by window length and search direction, on half the mesh."""
    at = _at(scene, _factors(scene, (0.5,))[0])
    for length in (1, 2, 5, 10, 25, WHOLE):
        for direction in directions_of(scene):
            solver = {"window": length, "search_direction": direction, "acceleration": "anderson"}
            name = f"window {length}, {direction}"
            variant = Variant(name, changed(scene, {"solver": {**solver, "max_iterations": 100}}))
            run = made.run(WINDOWS, variant, at)
            if run is not None:
                result.windows[(str(length), direction)] = (run.iterations[0], run.passes)
