"""Work-precision study of a scene: runs over meshes, time steps, tolerances, time schemes and propagators; and its
results as text: orders, sources of error, the cost of an accuracy, failed runs.

Errors are those against a reference: quantities declared with a model, exact or from refined runs.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import tempfile
import time as clock
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from ..api import solve
from ..errors import LatinError, Problem, SceneError, SolverError
from ..reader import scene_from_dict
from ..results.estimates import ErrorEstimate, QuantityEstimate
from ..results.interface_fields import Force
from ..results.prices import AS_WRITTEN
from ..results.solution import Solution
from ..run_quantities import Quantities, measure_solution, of_force, relative
from ..scene.describe import tables_in, tag_of
from ..scene.quantity_table import FLOOR
from ..scene.schema import Scene
from ..scene.settings import WHOLE, Solver, Time
from .adaptive_resolution import choose
from .estimate import coarser_runs_of, estimate_error, observed_order, same_way
from .runs import (
    Log,
    MeasuredRun,
    Resolution,
    RunTimeFit,
    aligned,
    at_resolution,
    coarsens_mesh,
    in_short_windows,
    mesh_factor,
    message_of,
    run_at,
    solved,
)

FILE: Final = "reference.json"
"""Name of the file with reference quantities, beside the scene file."""

_PHYSICS: Final = ("material", "substructure", "interface", "boundary", "load", "sensor")
# where a scene has them: a table of another kind changes no hash of the scenes without it
_MORE: Final = ("contact", "point_mass", "gravity", "temperature", "bolt", "spring", "coupling", "port")
_OF_TIME: Final = ("quasi_static", "start")


@dataclass(frozen=True)
class Reference:
    """Reference of the errors of a study.

    Attributes
    ----------
    quantities : of the reference. exact : closed form, else a run. text : its source.
    own_error : estimated error of a reference that is not exact. resolution : of a run of the study taken as reference.
    """

    quantities: Quantities
    exact: bool
    text: str
    own_error: ErrorEstimate | None = None
    resolution: Resolution | None = None


def physics_of(scene: Scene) -> str:
    """Hash of all settings of an exact solution: everything but meshes, time steps, schemes and solver settings.

    Settings left at their defaults do not count, so that a new key of the scene file changes no hash.
    """
    data = scene.model_dump(exclude_defaults=True, mode="json")
    settings: dict[str, Any] = {key: data.get(key, {}) for key in _PHYSICS}
    for body in settings["substructure"].values():
        body.get("box", {}).pop("elements", None)
    settings |= {key: data[key] for key in _MORE if data.get(key)}
    settings |= {key: data["time"][key] for key in _OF_TIME if key in data.get("time", {})}
    settings["end"] = scene.time.end
    return hashlib.sha256(json.dumps(settings, sort_keys=True).encode()).hexdigest()[:16]


def declared(scene: Scene) -> Reference | None:
    """The quantities declared beside a scene; None where there are none for this physics.

    The file has ``scene`` (name), ``source`` (text), ``holds_for`` (see ``physics_of``), ``values`` (quantities by
    name) and ``force`` by interface with ``time`` and ``value`` (N): linear pieces, a time met twice is a jump.
    Quantities that are not exact have their relative errors by name in ``errors``, all of them.

    Raises
    ------
    SceneError : a file for this scene that cannot be read or lacks something.
    """
    file = scene.base_dir / FILE
    if not file.is_file():
        return None
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
        if data["scene"] != scene.name or data["holds_for"] != physics_of(scene):
            return None
        quantities = _quantities(data, scene.time.end)
        errors = _own_error(quantities, data["errors"]) if "errors" in data else None
        text = f"{'exact' if errors is None else 'refined runs'}: {data['source']}"
        return Reference(quantities, errors is None, text, errors)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise SceneError([_unusable(file, error)], "the reference cannot be used") from error


def _quantities(data: dict[str, Any], end: float) -> Quantities:
    quantities = Quantities()
    for interface, table in data.get("force", {}).items():
        force = Force(np.asarray(table["time"], dtype=float), np.asarray(table["value"], dtype=float))
        quantities.forces[interface] = force
        quantities.add(interface, of_force(force, end, opens=True))
    for quantity, value in data.get("values", {}).items():
        quantities.values[quantity] = quantities.scales[quantity] = float(value)
    return quantities


def _own_error(quantities: Quantities, errors: dict[str, float]) -> ErrorEstimate:
    """The declared errors, one for every quantity (KeyError where one is missing)."""
    estimates = []
    for quantity, value in quantities.values.items():
        error = float(errors[quantity])
        if not 0.0 < error < 1.0:
            raise ValueError(f"error of {quantity} is {error:g}, not between 0 and 1")
        estimates.append(QuantityEstimate(quantity, value, error))
    return ErrorEstimate(tuple(estimates))


def _unusable(file: Path, error: Exception) -> Problem:
    allowed = "JSON with scene, source, holds_for, values, force (NAME: time, value), errors where not exact"
    return Problem(str(file), f"not a usable reference: {type(error).__name__}: {error}", allowed=allowed)


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


def unreduced(scene: Scene, runs: Sequence[MeasuredRun] = ()) -> Variant | None:
    """The scene without modes of substructures or of the assembly, otherwise unchanged; None where nothing is reduced.

    runs : of the scene, which leaves the choice of modes to the program.
    """
    by_choice = any(run.by_modes for run in runs)
    if scene.solver.propagator.type not in ("reduced", "modal") and not by_choice:
        return None
    direct = changed(in_short_windows(scene), {"solver": {"propagator": "direct"}})
    return Variant(_name(direct), direct)


def variants_of(scene: Scene) -> list[Variant]:
    """The scene with every other scheme and propagator, then as written where it is one whole window.

    Quasi-static schemes are left out: they solve another problem.
    """
    short = in_short_windows(scene)
    types = (short.time.scheme.type, scene.solver.propagator.type)
    whole = unreduced(scene)
    of_its_own = {"time": {"scheme": "automatic"}} if types[0] == "generalized_alpha" else {}
    variants = [] if whole is None else [whole]
    variants += [
        _changed(short, tag, {"time": {"scheme": tag}, "solver": {"propagator": "automatic"}})
        for tag in _tags(Time, "scheme")
        if tag not in (types[0], "automatic") and "static" not in tag
    ]
    variants += [
        _changed(short, tag, {"solver": {"propagator": tag}, **(of_its_own if tag == "reduced" else {})})
        for tag in _tags(Solver, "propagator")
        if tag not in ("automatic", "direct", "explicit", types[1])
    ]
    if scene.solver.window == WHOLE:
        variants.append(Variant(AS_WRITTEN, scene))
    return variants


def directions_of(scene: Scene) -> list[str]:
    """Search directions that need no parameters."""
    tables = tables_in(Solver.model_fields["search_direction"].annotation)
    if scene.interface:
        return [
            str(tag_of(table))
            for table in tables
            if not any(field.is_required() for field in table.model_fields.values())
        ]
    return []


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
    if scheme.type == "hht":
        text = f"hht {scheme.alpha:g}"
    else:
        text = scheme.type
    if propagator in ("automatic", "direct", "explicit"):
        return text
    return f"{propagator}, {text}"


@dataclass
class Row:
    """One run of the study: series, variant, tolerance on sqrt(eta), and the run, also one that could not be made."""

    series: str
    variant: str
    tolerance: float
    run: MeasuredRun

    @property
    def resolution(self) -> Resolution:
        """Of the run."""
        return self.run.resolution

    @property
    def factor(self) -> float:
        """By which the row is refined: of the mesh, or of the steps where the mesh is as written."""
        if self.resolution.mesh != 1.0:
            return self.resolution.mesh
        return self.resolution.time

    @property
    def failure(self) -> str:
        """Reason why the run was not made or did not converge; empty for a good one."""
        if self.run.converged:
            return ""
        return self.run.status


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
    _made: dict[tuple[str, Resolution], MeasuredRun] = field(default_factory=dict)

    def run(self, series: str, variant: Variant, resolution: Resolution, save: bool = False) -> MeasuredRun | None:
        """The run of a variant at a resolution; None where it failed (the row has the reason).

        ``save``: write its results to a temporary file, so that the cost of output is measured.
        """
        key = (variant.name, resolution)
        if key not in self._made:
            self._made[key] = self._solve(variant, resolution, save)
        run, scene = self._made[key], variant.scene
        tolerance = resolution.tolerance or (math.nan if scene is None else scene.solver.tolerance)
        self.rows.append(Row(series, variant.name, tolerance, run))
        if run.converged:
            return run
        return None

    def warm_up(self, variant: Variant, resolution: Resolution) -> None:
        """One run that is in no row, so that no row includes the time to load or compile kernels."""
        if variant.scene is not None:
            with contextlib.suppress(LatinError):
                run_at(variant.scene, resolution)

    def _solve(self, variant: Variant, resolution: Resolution, save: bool) -> MeasuredRun:
        label = f"{variant.name}, mesh x {resolution.mesh:.3g}, steps x {resolution.time:.3g}"
        if resolution.tolerance is not None:
            label += f", tolerance {resolution.tolerance:g}"
        start = clock.process_time()
        refusal = variant.refusal
        try:
            if variant.scene is not None:
                lean = at_resolution(variant.scene, resolution)
                run, solution = solved(variant.scene, lean, resolution, max_cpu=self.budget)
        except LatinError as error:
            refusal = message_of(error)
        if refusal:
            self.log(f"refused  {label}: {refusal}")
            return MeasuredRun(resolution, status=refusal)
        if save:
            with tempfile.TemporaryDirectory() as folder:
                solution.save(Path(folder) / "out.nc")
        self.spent += clock.process_time() - start
        self.log(f"{run.cpu:7.2f} s  {label}" + ("" if run.converged else f": {run.status}"))
        return run

    @property
    def rest(self) -> float:
        """Remaining CPU seconds of the budget."""
        return self.budget - self.spent


TOGETHER = "together"
SPACE = "space"
TIME = "time"
TOLERANCE = "tolerance"
REDUCTION = "reduction"
WINDOWS = "windows"
REFERENCE = "reference"
"""Series of runs."""
WAYS: Final = {TOGETHER: "finer mesh and shorter steps", SPACE: "finer mesh", TIME: "shorter steps"}
"""Series that refine a scene, in words."""

TOLERANCES = (1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 1e-4)
TIGHT = 1e-6


@dataclass(frozen=True)
class Searched:
    """A search for an accuracy, or the run as written with its estimate.

    Attributes
    ----------
    target : relative error of the target quantity; None of the run as written. reached : whether it was promised.
    cpu : of the search, or of the run and its estimate, s. resolution, quantities : of the run that it ends with.
    told : its estimated errors by quantity.
    """

    target: float | None
    reached: bool
    cpu: float
    resolution: Resolution
    quantities: Quantities
    told: dict[str, float]

    @classmethod
    def of(
        cls, target: float | None, reached: bool, cpu: float, at: Resolution, scene: Scene, solution: Solution
    ) -> Searched:
        """From the solution that it ends with, and its estimate."""
        told = () if solution.estimate is None else solution.estimate.quantities
        errors = {estimate.quantity: estimate.error for estimate in told}
        return cls(target, reached, cpu, at, measure_solution(scene, solution), errors)


@dataclass
class Study:
    """Result of a study.

    Attributes
    ----------
    scene : as given. main : name of the variant with the scene's own scheme and propagator. reference : of the errors.
    rows : every run, failed ones included. windows : (length, direction) -> (mean iterations, passes).
    seconds : CPU seconds in all. searches : the run as written with its estimate, and searches for ``SEARCHED``.
    """

    scene: Scene
    main: str
    reference: Reference
    rows: list[Row] = field(default_factory=list)
    windows: dict[tuple[str, str], tuple[float, float]] = field(default_factory=dict)
    seconds: float = 0.0
    searches: list[Searched] = field(default_factory=list)

    def of(self, series: str, variant: str | None = None) -> list[Row]:
        """Rows of a series without failure, in order of cost; of the main variant where none is named."""
        name = self.main if variant is None else variant
        rows = [r for r in self.rows if r.series == series and r.variant == name and r.run.converged]
        return sorted(rows, key=lambda r: (r.resolution.mesh, r.resolution.time, -r.tolerance))

    def error(self, row: Row, quantity: str) -> float:
        """Relative error of a quantity of a row against the reference; NaN where unknown, where the run has not
        converged, or where the reference is a run hardly finer."""
        if row.run.converged:
            return self.error_of(row.run.quantities, row.resolution, quantity)
        return math.nan

    def error_of(self, quantities: Quantities, at: Resolution, quantity: str) -> float:
        """The same of the quantities of a run at a resolution."""
        finest = self.reference.resolution
        # 0.75: the error of a reference hardly finer is as large as the one measured
        finer = finest is None or min(at.mesh / finest.mesh, at.time / finest.time) <= 0.75
        measured = quantity in quantities.values and quantity in self.reference.quantities.scales
        if finer and measured:
            return quantities.error(quantity, self.reference.quantities)
        return math.nan

    @property
    def quantities(self) -> list[str]:
        """Names of the quantities of both the reference and the runs."""
        measured = {q for row in self.rows for q in row.run.quantities.values}
        return [q for q in self.reference.quantities.values if q in measured]


def study(scene: Scene, budget: float, log: Log, methods: bool = False) -> Study:
    """Run the study of a scene in about ``budget`` CPU seconds.

    Mesh and step together, mesh alone, step alone, and a tight tolerance; where substructures or the assembly are
    reduced to modes, the same run without. The reference is declared with the model, else it is the finest run that a
    third of the budget allows.

    methods : also every other scheme and propagator, tolerances on several meshes, windows and search directions on a
        coarse mesh, and searches for an accuracy.

    Raises
    ------
    SceneError : the scene cannot be built as written.
    SolverError : no run converges.
    """
    study_runs = StudyRuns(budget, log)
    main = main_variant(scene)
    factors = _factors(scene, (0.25, 0.35, 0.5, 0.71, 1.0, 1.41, 2.0, 2.83, 4.0))
    study_runs.warm_up(main, _at(scene, factors[0]))
    coarse = [_at(scene, f) for f in factors if f <= 1.0]
    runs = [r for r in (study_runs.run(TOGETHER, main, at, save=True) for at in coarse) if r is not None]
    if not runs:
        at_resolution(scene, Resolution())  # raises the error of the scene
        raise SolverError(f"{scene.name}: no run as written or coarser has converged: {study_runs.rows[-1].failure}")
    reference = declared(scene)
    for f in (f for f in factors if f > 1.0):
        # of the budget: a reference of its own has to be finer than all others
        share = 0.35 if reference is None else 0.15
        costs = [run.cost for run in runs[-2:]]
        if costs and RunTimeFit.of(scene, costs).seconds(f, f) < share * budget:
            run = study_runs.run(TOGETHER, main, _at(scene, f), save=True)
            runs += [] if run is None else [run]
    result = Study(scene, main.name, reference or finest_reference(scene, study_runs, main, runs))
    _refine_separately(scene, study_runs, main, runs)
    if (whole := unreduced(scene, runs)) is not None:
        study_runs.run(REDUCTION, whole, _at(scene, 1.0))
    if methods:
        _refine_tolerances(scene, study_runs, main)
        _refine_others(scene, study_runs, factors)
        _vary_windows(scene, study_runs, result)
        result.searches = _searched(scene, budget, log)
    else:
        result.searches = _as_written(scene)
    result.rows, result.seconds = study_runs.rows, study_runs.spent + sum(search.cpu for search in result.searches)
    return result


def _as_written(scene: Scene) -> list[Searched]:
    """The run as written with its estimate; none where it fails."""
    with contextlib.suppress(LatinError):
        start = clock.process_time()
        solution = solve(scene)
        solution = replace(solution, estimate=estimate_error(scene, solution))
        if solution.converged:
            return [Searched.of(None, True, clock.process_time() - start, Resolution(), scene, solution)]
    return []


def _searched(scene: Scene, budget: float, log: Log) -> list[Searched]:
    """The run as written with its estimate, and searches for ever smaller errors of the target quantity, until one is
    refused; each may take a tenth of the budget."""
    results = _as_written(scene)
    with contextlib.suppress(LatinError):
        for target in SEARCHED:
            choice = choose(scene, target, 0.1 * budget, log)
            if choice.solution is None or not choice.reached:
                break
            results.append(Searched.of(target, True, choice.seconds, choice.resolution, scene, choice.solution))
    return results


def _factors(scene: Scene, wanted: tuple[float, ...]) -> list[float]:
    """The refinement factors near those wanted that the meshes allow."""
    if coarsens_mesh(scene):
        return sorted({mesh_factor(scene, f) for f in wanted})
    return list(wanted)


def _at(scene: Scene, factor: float) -> Resolution:
    """Mesh and step refined together (the step alone where no coarser mesh exists)."""
    return Resolution(factor if coarsens_mesh(scene) else 1.0, aligned(scene, factor))


def finest_reference(scene: Scene, study_runs: StudyRuns, main: Variant, runs: list[MeasuredRun]) -> Reference:
    """The finest run as reference, its error estimated from coarser runs."""
    finest = runs[-1]
    at = finest.resolution
    fine_scene = at_resolution(main.scene or scene, at)
    plan = coarser_runs_of(fine_scene)
    estimate: ErrorEstimate | None = None
    if plan is not None:
        coarser: dict[str, Quantities] = {}
        for name, relative in plan.by_name().items():
            run = study_runs.run(REFERENCE, main, Resolution(at.mesh * relative.mesh, at.time * relative.time))
            if run is not None:
                coarser[name] = run.quantities
        if estimates := plan.estimates(fine_scene, finest.quantities, coarser):
            estimate = ErrorEstimate(estimates)
    text = f"refined run: mesh x {at.mesh:.3g}, steps x {at.time:.3g}, {finest.cpu:.3g} CPU s"
    return Reference(finest.quantities, False, text, estimate, at)


def _refine_separately(scene: Scene, study_runs: StudyRuns, main: Variant, runs: list[MeasuredRun]) -> None:
    """Mesh alone with the steps as written, step alone on the mesh as written, as far as ``runs`` predict a sixth of
    the budget at most; the run as written with a tight tolerance."""
    fit = RunTimeFit.of(scene, [run.cost for run in runs[-2:]])
    if coarsens_mesh(scene):
        for f in _factors(scene, (0.35, 0.5, 0.71, 1.0, 1.41, 2.0, 2.83)):
            if f <= 1.0 or fit.seconds(f, 1.0) < study_runs.budget / 6.0:
                study_runs.run(SPACE, main, Resolution(f, aligned(scene, 1.0)))
    for f in (0.25, 0.5, 0.71, 1.0, 1.41, 2.0, 4.0):
        if f <= 1.0 or fit.seconds(1.0, f) < study_runs.budget / 6.0:
            study_runs.run(TIME, main, Resolution(1.0, aligned(scene, f)))
    at = _at(scene, 1.0)
    study_runs.run(TOLERANCE, main, Resolution(at.mesh, at.time, TIGHT))


def _refine_tolerances(scene: Scene, study_runs: StudyRuns, main: Variant) -> None:
    """Tolerances on several meshes."""
    for f in _factors(scene, (0.35, 0.5, 1.0, 1.41)):
        at = _at(scene, f)
        for tolerance in (TIGHT, *TOLERANCES):
            study_runs.run(TOLERANCE, main, Resolution(at.mesh, at.time, tolerance))


def _refine_others(scene: Scene, study_runs: StudyRuns, factors: list[float]) -> None:
    """Other schemes and propagators, mesh and step together; shorter steps where the step is refused."""
    others = variants_of(scene)
    for i, variant in enumerate(others):
        share = 0.6 * study_runs.rest / (len(others) - i)
        runs: list[MeasuredRun] = []
        for f in [g for g in factors if g > 0.3]:
            run = _with_stable_steps(scene, study_runs, variant, f)
            runs += [] if run is None else [run]
            if variant.scene is None:
                break
            # factors are a square root of two apart
            following = f * 2**0.5
            if (
                runs
                and RunTimeFit.of(scene, [run.cost for run in runs[-2:]]).seconds(following, following) > 0.4 * share
            ):
                break


def _with_stable_steps(scene: Scene, study_runs: StudyRuns, variant: Variant, factor: float) -> MeasuredRun | None:
    """A run with mesh and step refined together; a step refused as too long is halved, twice at most."""
    at = _at(scene, factor)
    for shorter in (1.0, 2.0, 4.0):
        run = study_runs.run(TOGETHER, variant, Resolution(at.mesh, at.time * shorter))
        if run is not None or "step is longer" not in study_runs.rows[-1].failure:
            return run
    return None


def _vary_windows(scene: Scene, study_runs: StudyRuns, result: Study) -> None:
    """Iterations and passes by window length and search direction, on half the mesh."""
    at = _at(scene, _factors(scene, (0.5,))[0])
    for length in (1, 2, 5, 10, 25, WHOLE):
        for direction in directions_of(scene):
            solver = {"window": length, "search_direction": direction, "acceleration": "anderson"}
            name = f"window {length}, {direction}"
            variant = Variant(name, changed(scene, {"solver": {**solver, "max_iterations": 100}}))
            run = study_runs.run(WINDOWS, variant, at)
            if run is not None:
                result.windows[(str(length), direction)] = (run.iterations[0], run.passes)


# -- what the runs give ------------------------------------------------------------------------------------------------
NEGLIGIBLE = 0.1
"""Share of the whole error below which the iteration error is negligible."""


@dataclass(frozen=True)
class ErrorSources:
    """Relative error of a quantity at the scene's own resolution by source, and observed orders (NaN: none).

    ``reduction``: change by the modes that reduced substructures leave out; NaN where none is reduced.
    """

    quantity: str
    total: float
    space: float
    time: float
    iteration: float
    reduction: float
    order_together: float
    order_space: float
    order_time: float


def sources(study: Study, quantity: str) -> ErrorSources:
    """Error by source: mesh and step from their own series, assuming first order beyond its finest run."""

    def at_scene(row: Row) -> bool:
        return row.resolution.mesh == row.resolution.time == 1.0

    as_written = next((r for r in study.of(TOGETHER) if at_scene(r)), None)
    tight = next((r for r in study.of(TOLERANCE) if r.tolerance == TIGHT and at_scene(r)), None)
    whole = next((r for r in study.rows if r.series == REDUCTION and r.run.converged), None)
    return ErrorSources(
        quantity,
        math.nan if as_written is None else study.error(as_written, quantity),
        _remaining(study.of(SPACE), quantity, mesh=True),
        _remaining(study.of(TIME), quantity, mesh=False),
        _distance(as_written, tight, quantity),
        _distance(as_written, whole, quantity),
        _order(study.of(TOGETHER), quantity, mesh=False),
        _order(study.of(SPACE), quantity, mesh=True),
        _order(study.of(TIME), quantity, mesh=False),
    )


def _distance(row: Row | None, other: Row | None, quantity: str) -> float:
    """Relative distance of a quantity between two rows, over the scale of the second; NaN where one is missing."""
    if row is None or other is None:
        return math.nan
    return relative(quantity, other.run.quantities, row.run.quantities, other.run.quantities)


def _remaining(rows: list[Row], quantity: str, mesh: bool) -> float:
    """Error at factor 1 from the distance d to the finest of a series: d / (1 - 1 / ratio), order 1."""
    by_factor = {_factor(r, mesh): r for r in rows}
    base = min(by_factor, key=lambda f: abs(f - 1.0), default=math.nan)
    # NaN compares as not finer
    finest = max(by_factor, default=math.nan)
    if not finest > base:
        return math.nan
    return _distance(by_factor[base], by_factor[finest], quantity) / (1.0 - base / finest)


def _order(rows: list[Row], quantity: str, mesh: bool) -> float:
    """Observed order of the finest runs whose factors are about 1 : 2 : 4 (NaN where the changes differ in sign)."""
    runs = {_factor(r, mesh): r.run.quantities for r in reversed(rows)}
    if len(runs) < 3:
        return math.nan
    finest = max(runs)
    # factors count by their ratio
    half, quarter = (min(runs, key=lambda f: abs(math.log(part * f / finest))) for part in (2.0, 4.0))
    if not finest > half > quarter:
        return math.nan
    a = runs[finest]
    b = runs[half]
    c = runs[quarter]
    if quantity not in a.values or not same_way(quantity, a, b, c):
        return math.nan
    changes = relative(quantity, a, a, b), relative(quantity, a, b, c)
    return observed_order(*changes, (finest / half, finest / quarter))


def _factor(row: Row, mesh: bool) -> float:
    if mesh:
        return row.resolution.mesh
    return row.resolution.time


def cheapest(study: Study, quantity: str, target: float, variant: str | None = None) -> Row | None:
    """The cheapest row that reaches a target accuracy, as all finer runs of its series do; None where none does.

    Over all variants refined in mesh and step together, in the mesh alone and in the step alone, or one of them. The
    error of a reference that is not exact is added to the errors.
    """
    best: Row | None = None
    estimate = study.reference.own_error
    if estimate is None:
        own_error = 0.0
    else:
        own_error = estimate[quantity].error
    tried = dict.fromkeys((r.series, r.variant) for r in study.rows if r.series in WAYS)
    for series, name in (key for key in tried if variant in (None, key[1])):
        # from the finest: one that is accurate by chance, with finer ones that are not, does not count
        for row in reversed(study.of(series, name)):
            error = study.error(row, quantity)
            if math.isnan(error):
                continue
            if error + own_error > target:
                break
            if best is None or row.run.cpu < best.run.cpu:
                best = row
    return best


def useful_tolerances(study: Study, quantity: str) -> dict[float, float]:
    """Largest tolerance by mesh factor below which the iteration error is negligible.

    The iteration error (against a tight tolerance on the same mesh) is then at most a tenth of the error of that mesh,
    or of 0.1 %.
    """
    useful = {}
    for factor in sorted({r.factor for r in study.of(TOLERANCE)}):
        rows = sorted((r for r in study.of(TOLERANCE) if r.factor == factor), key=lambda r: r.tolerance)
        tight = next((r for r in rows if r.tolerance == TIGHT), None)
        if tight is None:
            continue
        allowed = NEGLIGIBLE * max(study.error(tight, quantity), FLOOR)
        useful[factor] = math.nan
        for row in rows[rows.index(tight) + 1 :]:
            # "not <=": a missing quantity (NaN) ends the search, too
            if not _distance(row, tight, quantity) <= allowed:
                break
            useful[factor] = row.tolerance
    return useful


SEARCHED = (0.1, 0.05, 0.02, 0.01)
"""Target accuracies that are searched for."""
