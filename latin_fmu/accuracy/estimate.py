"""The error of a run, estimated from coarser runs of the same scene.

Mesh and time step are coarsened at one ratio: (h, dt), (2 h, 2 dt), (4 h, 4 dt), finest first; the third run only where
it costs little beside the first (``LONG``). The same estimator gives the error of a plain run or of a session
(``estimate_error``), that of each run in the search for a target accuracy (``adaptive_resolution``) and that of the
reference of a study. Its factors are those of the quantities of interest (``scene.quantity_table``).
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from ..assembly.body import elasticity_of
from ..errors import LatinError
from ..latin.outcome import Array
from ..latin.processes import Processes
from ..results.estimates import MOST_OF_HISTORY, ErrorEstimate, QuantityEstimate, TruncationError
from ..results.owner_records import Signal
from ..results.solution import Solution
from ..results.spectra import spectrum_error
from ..run_quantities import ELEMENTS_PER_WAVE, Quantities, measure_solution, relative, resolved_frequency
from ..scene.boundaries import AXES
from ..scene.fields import split_face
from ..scene.quantity_table import VELOCITY_RMS, QuantityOfInterest, definition_of
from ..scene.schema import Scene
from .price_list import PricedRuns, priced, split_of
from .runs import (
    FEWEST_STEPS,
    Resolution,
    RunCost,
    aligned,
    coarsens_mesh,
    cost_exponent,
    in_short_windows,
    mesh_factor,
    mesh_files,
    message_of,
    run_at,
    sampling_error,
)

UNREFINED: Final = (
    "the mesh comes from a file: its share of the error is not estimated; with mesh.refine = 1 the mesh of the file "
    "serves as the coarser one"
)
FACETED: Final = "refined meshes keep the facets of their files: the geometry error of curved surfaces is not estimated"

_ORDERS = (-3.0, 8.0)  # range of observed orders
SOLIDS: Final = 0.7
"""Factor on the last change of a value without a third run, in other scenes than bars: in bars fronts stay sharp, and
errors change their sign with the ripple behind them."""
SMOOTH: Final = 1.25
"""Order of convergence without fronts over that with them, where none is observed."""
LONG: Final = 1.0
"""Predicted CPU time of the march of a run beyond which there is a third one, s: it then costs a tenth of the run or
less, a quarter where the mesh is from a file that is not refined."""
SHORTEST_MEAN: Final = 1.4
"""Least duration of a mean that is a peak force, over the time a wave needs to cross an element beside the
interface."""


@dataclass(frozen=True)
class Changes:
    """Relative changes of one quantity between runs.

    Attributes
    ----------
    half : between the run (h, dt) and the next coarser one (r h, r dt), r the first of ``ratios``.
    quarter : between (r h, r dt) and (r' h, r' dt), r' the second ratio; NaN without a third run.
    same_way : both refinements change the quantity in the same direction.
    front : a force, or the velocity of a sensor, jumps. bars : of a scene of bars. beside : ``half`` of the quantity
        of which a share is added without a third run.
    sampling : relative error of the sampled loads. iteration : relative error left by the iteration.
    """

    half: float
    quarter: float = math.nan
    same_way: bool = True
    ratios: tuple[float, float] = (2.0, 4.0)
    front: bool = True
    bars: bool = True
    beside: float = 0.0
    sampling: float = 0.0
    iteration: float = 0.0

    @property
    def order(self) -> float:
        """Observed order of convergence; NaN where the changes give none."""
        if self.same_way:
            return observed_order(self.half, self.quarter, self.ratios)
        return math.nan


def expected_order(definition: QuantityOfInterest, changes: Changes) -> float:
    """Order of convergence that an estimate counts on: that with fronts; without, the observed one, up to twice as
    much, or ``SMOOTH`` times where none is observed.

    With fronts the observed order is no better guide: bounded by 2/3 and 1, or by 2/3 and 2, it made the estimates of
    random chains wider at the same share of cases in which they hold.
    """
    if changes.front:
        return definition.order
    if math.isnan(changes.quarter):
        return SMOOTH * definition.order
    if math.isnan(changes.order):
        return definition.order
    return min(max(changes.order, definition.order), 2.0 * definition.order)


def estimated_error(definition: QuantityOfInterest, changes: Changes) -> tuple[float, bool]:
    """Estimated relative error of a quantity, and whether it is only a bound.

        s (e + e'),  or  a e + b d  without a third run

    With the order p, the last refinement by r extrapolates to e = change / (r^p - 1) at the run; so does the one
    before, to e'. The sum holds where one of them is small by chance; a norm of a difference (``definition.norm``) is
    not, and e alone counts. Without a third run the change d of a history stands for e'. s, a, b are factors of the
    quantity (``safety``, ``alone``, ``share``). The error is at least that of the sampled loads; the error left by the
    iteration is added.

    It is only a bound where the changes do not decrease from one refinement to the next, and infinite without a change.
    """
    p = expected_order(definition, changes)
    ratio, second = changes.ratios
    last = changes.half / (ratio**p - 1.0)
    if math.isnan(changes.quarter):
        if changes.bars or definition.norm:
            fewer = 1.0
        else:
            fewer = SOLIDS
        error = fewer * definition.alone * last + definition.share * changes.beside
    else:
        if definition.norm:
            before = 0.0
        else:
            before = changes.quarter / ((second / ratio) ** p - 1.0) / ratio**p
        error = definition.safety * (last + before)
    error = max(error, changes.sampling) + changes.iteration
    if math.isnan(error):
        return math.inf, True
    # NaN, without a third run, compares as no bound
    return error, changes.half >= changes.quarter


def observed_order(half: float, quarter: float, ratios: tuple[float, float]) -> float:
    """Order p for which an error ~ h^p gives both changes: quarter / half = (r'^p - r^p) / (r^p - 1).

    NaN where a change is zero or missing.

    >>> round(observed_order(1.0, 2.0, (2.0, 4.0)), 6)
    1.0
    """
    if not (half > 0.0 and quarter > 0.0) or not 1.0 < ratios[0] < ratios[1]:
        return math.nan
    a, b = math.log(ratios[0]), math.log(ratios[1])

    def quotient(p: float) -> float:
        # the limit at p = 0
        if abs(p) < 1e-9:
            return (b - a) / a
        return (math.exp(p * b) - math.exp(p * a)) / math.expm1(p * a)

    low, high = _ORDERS
    if not quotient(low) < quarter / half < quotient(high):
        if quarter / half <= quotient(low):
            return low
        return high
    for _ in range(60):  # bisection to round-off: the quotient grows with p
        middle = 0.5 * (low + high)
        low, high = (middle, high) if quotient(middle) < quarter / half else (low, middle)
    return 0.5 * (low + high)


def same_way(quantity: str, fine: Quantities, half: Quantities, quarter: Quantities) -> bool:
    """Whether both refinements change the quantity in the same direction (always true for the norm of a difference)."""
    owner = quantity.rpartition(".")[0]
    definition = definition_of(quantity)
    if definition.norm or quantity not in half.values or quantity not in quarter.values:
        return True
    if definition.distance == "vector":
        last, before = fine.vectors[owner] - half.vectors[owner], half.vectors[owner] - quarter.vectors[owner]
        return float(last @ before) > 0.0
    values = [run.value(quantity, fine) for run in (fine, half, quarter)]
    return (values[0] - values[1]) * (values[1] - values[2]) > 0.0


def has_front(run: Quantities) -> bool:
    """Whether any force of a run jumps, within the duration of its peak, or the velocity of a sensor, within a
    twentieth of the run, by more than half of its peak."""
    if any(force.jumps(run.durations[name]) for name, force in run.forces.items() if name in run.durations):
        return True
    speeds = (signal for quantity, signal in run.signals.items() if definition_of(quantity) is VELOCITY_RMS)
    return any(_jumps(speed) for speed in speeds)


def _jumps(signal: Signal) -> bool:
    later = signal.at(np.minimum(signal.along + 0.05 * signal.along[-1], signal.along[-1]))
    return float(np.linalg.norm(later - signal.values, axis=1).max()) > 0.5 * signal.peak() > 0.0


def element_transit(scene: Scene, sides: Sequence[str], spacing: float) -> float:
    """Longest time a pressure wave needs to cross an element beside an interface, s.

    sides : faces of the interface, of the run: a search may have found them. spacing : size of an element whose mesh is
    from a file, m.
    """
    longest = 0.0
    for face in sides:
        name, side = split_face(face)
        body = scene.substructure.get(name)
        if body is None or body.rigid:
            continue
        material = scene.material[body.material]
        size = spacing
        if body.box is not None:
            edges = np.divide(body.box.size, body.box.elements)
            size = float(edges[AXES.index(side[0])] if side[0] in AXES else edges.max())
        # of a box along the normal of the face, else the slowest along an axis
        speeds = elasticity_of(material).pressure_speed(np.eye(3))
        if body.box is not None and side[0] in AXES:
            speed = speeds[AXES.index(side[0])]
        else:
            speed = speeds.min()
        longest = max(longest, size / float(speed))
    return longest


def quantity_estimate(
    scene: Scene,
    quantity: str,
    runs: Sequence[tuple[Resolution, Quantities]],
    sampling: float | None = None,
    front: bool | None = None,
) -> QuantityEstimate:
    """Estimated error of one quantity of the first of ``runs``.

    Parameters
    ----------
    scene : of the first run. runs : two or more, finest first; from the fourth on they do not count.
    sampling : of the loads of the scene (``sampling_error``), front : of the first run (``has_front``); computed where
        None.
    """
    definition, owner = definition_of(quantity), quantity.rpartition(".")[0]
    # ratios of the steps: the mesh has the same one, or cannot change
    (at, fine), (at_half, half) = runs[:2]
    ratios = (at.time / at_half.time, 2.0 * at.time / at_half.time)
    quarter = math.nan
    one_way = True
    if len(runs) > 2:
        at_last, coarsest = runs[2]
        ratios = ratios[0], at.time / at_last.time
        quarter, one_way = relative(quantity, fine, half, coarsest), same_way(quantity, fine, half, coarsest)
    # the error of sampled loads is one of impulses; instants do not follow from their size
    if definition.instant:
        sampling = 0.0
    history = f"{owner}.{definition.of}"
    if history in fine.values:
        beside = relative(history, fine, fine, half)
    else:
        beside = 0.0
    changes = Changes(
        half=relative(quantity, fine, fine, half),
        quarter=quarter,
        same_way=one_way,
        ratios=ratios,
        front=has_front(fine) if front is None else front,
        # elements along one axis alone
        bars=cost_exponent(scene) <= 1.0,
        beside=0.0 if math.isnan(beside) else beside,
        sampling=sampling_error(scene) if sampling is None else sampling,
        iteration=definition.iteration * scene.solver.tolerance,
    )
    error, bound_only = estimated_error(definition, changes)
    if definition.mean and definition.norm and not scene.time.quasi_static:
        shortest = SHORTEST_MEAN * element_transit(scene, fine.sides[owner], fine.spacings[owner])
        if not (fine.durations[owner] >= shortest):
            error = math.inf
    order, base = expected_order(definition, changes), 0.0
    if definition.rests:
        history = f"{owner}.{definition.rests}"
        base = quantity_estimate(scene, history, runs, sampling, changes.front).error
        # two runs may agree on a number whose histories have nothing in common
        if not (base <= MOST_OF_HISTORY):
            error = math.inf
    return QuantityEstimate(quantity, fine.values[quantity], error, changes.order, bound_only, order, base)


@dataclass(frozen=True)
class CoarserRuns:
    """Resolutions of the coarser runs from which the error of a run is estimated, relative to the run.

    Attributes
    ----------
    half : mesh and time step about twice as coarse, at one ratio. quarter : about four times; None where the scene
        is too coarse for it, or without a third run.
    remarks : what the estimate does not cover.
    """

    half: Resolution
    quarter: Resolution | None
    remarks: tuple[str, ...] = ()

    def by_name(self) -> dict[str, Resolution]:
        """The resolutions that exist, by the name of the attribute."""
        runs = {"half": self.half, "quarter": self.quarter}
        return {name: resolution for name, resolution in runs.items() if resolution is not None}

    def estimates(
        self, scene: Scene, fine: Quantities, coarser: Mapping[str, Quantities]
    ) -> tuple[QuantityEstimate, ...]:
        """Estimates of all quantities of a run of ``scene``; ``coarser`` by name, empty without ``half``."""
        if "half" not in coarser:
            return ()
        pairs = ((at, coarser[name]) for name, at in self.by_name().items() if name in coarser)
        runs = [(Resolution(), fine), *pairs]
        sampling = sampling_error(scene)
        front = has_front(fine)
        return tuple(quantity_estimate(scene, q, runs, sampling, front) for q in fine.values)


def coarser_runs_of(scene: Scene, third: bool = True) -> CoarserRuns | None:
    """Coarser runs of a scene, with a ``third`` one where it exists; None where the scene has too few time steps."""
    n = scene.time.n_step
    if n < 2 * FEWEST_STEPS:
        return None
    files = mesh_files(scene)
    if coarsens_mesh(scene):
        mesh, second = mesh_factor(scene, 0.5), mesh_factor(scene, 0.25)
        half, remarks = Resolution(mesh, aligned(scene, mesh)), (FACETED,) if files else ()
        # whole elements: a quarter of few elements may be nearly the half
        third = third and second < 0.8 * mesh and n * second >= FEWEST_STEPS
        return CoarserRuns(half, Resolution(second, aligned(scene, second)) if third else None, remarks)
    third = third and n >= 4 * FEWEST_STEPS
    half, quarter = Resolution(1.0, aligned(scene, 0.5)), Resolution(1.0, aligned(scene, 0.25)) if third else None
    return CoarserRuns(half, quarter, (UNREFINED,) if files else ())


class _Shares:
    """Shares of the work of several runs, by their predicted cost; ``report`` is called with the share done."""

    def __init__(self, scene: Scene, runs: list[Resolution], report: Callable[[float], None] | None) -> None:
        costs = np.array([r.mesh ** cost_exponent(scene) * r.time for r in runs])
        ends = np.cumsum(costs) / costs.sum()
        self._parts = dict(zip(runs, zip([0.0, *ends[:-1]], ends, strict=True), strict=True))
        self._report = report
        self._first, self._last = 0.0, 0.0

    def of(self, run: Resolution) -> _Shares | None:
        """Receiver of the progress of this run, None where no progress is reported."""
        self._first, self._last = self._parts[run]
        if self._report is None:
            return None
        return self

    def update(self, done: int, total: int, iteration: int, error: float) -> None:
        """Report how far the present run is, see ``api.ProgressSink``."""
        del iteration, error
        if self._report is not None:
            self._report(float(self._first + (self._last - self._first) * done / max(total, 1)))


def estimate_error(
    scene: Scene,
    solution: Solution,
    log: Callable[[str], None] | None = None,
    processes: Processes | None = None,
    report: Callable[[float], None] | None = None,
    stream: Path | None = None,
    max_cpu: float | None = None,
) -> ErrorEstimate:
    """Estimated relative error of every quantity of a finished run of ``scene``.

    Costs a coarser run with half the elements per length and half the steps (1/32 of the march of the run in 3-D, a
    quarter in bars), which is set up like any run. Where the march of the run is predicted to take more than a
    second there is a third run, with a quarter of both: it gives the observed order, and whether the changes decrease.

    Parameters
    ----------
    log : called with a line of text before each coarser run. processes : as for ``api.solve``; all of them call this.
    report : called with the share of the work that is done. stream : as for ``api.solve``, of the coarser runs: a run
        whose histories do not fit in memory has coarser ones that do not either. max_cpu : of all of them together, s.

    Raises
    ------
    SolverError : numbers that cannot be computed with. Coarser runs that fail or do not converge are remarks.

    Examples
    --------
    >>> scene = latin_fmu.load_scene("models/impact_bar/scene.toml")
    >>> estimate = latin_fmu.estimate_error(scene, latin_fmu.solve(scene))
    >>> 0.0 < estimate["wall.impulse"].error < 0.05
    True
    """
    start = clock.process_time()
    # a mesh that can be coarsened has an error of its own
    if solution.truncation is not None and not coarsens_mesh(scene):
        return estimate_by_modes(scene, solution, solution.truncation)
    plan = coarser_runs_of(scene, third=solution.timings.predicted > LONG)
    if plan is None:
        return ErrorEstimate((), ("too few time steps for an estimate",))
    remarks = list(plan.remarks)
    coarser: dict[str, Quantities] = {}
    lean = in_short_windows(scene, solution.outcome.settings.get("time scheme"))
    resolutions = plan.by_name()
    split = split_of(scene, plan.half) if plan.quarter is not None else None
    if split is not None:
        resolutions["split"] = split
    costs = [RunCost.of(Resolution(), solution.timings)]
    shares = _Shares(scene, list(resolutions.values()), report)
    for name, resolution in resolutions.items():
        text = f"mesh x {resolution.mesh:.3g}, steps x {resolution.time:.3g}"
        if log is not None:
            log(f"error estimate: {text}")
        budget = None if max_cpu is None else max(max_cpu - (clock.process_time() - start), 0.0)
        # several processes have run for unlike times: each coarser run stops all of them before the same instant
        if budget == 0.0 and processes is None:
            remarks.append(f"no coarser run ({text}): the limit of CPU time is reached; increase it")
            continue
        try:
            progress = shares.of(resolution)
            run = run_at(lean, resolution, progress=progress, processes=processes, stream=stream, max_cpu=budget)
            shares.update(1, 1, run.iterations[1], 0.0)
        except LatinError as error:
            remarks.append(f"no coarser run ({text}): {message_of(error)}")
            continue
        if run.converged:
            coarser[name] = run.quantities
            costs.append(run.cost)
        else:
            remarks.append(f"a coarser run ({text}) did not converge: {run.status}")
    fine = measure_solution(scene, solution)
    if not fine.values:
        remarks.append("no quantity to estimate: no interface and no sensor")
    remarks += band_remarks(scene, solution, list(solution.sensors))
    if not solution.converged:
        remarks.append("the run did not converge: the estimate does not include its iteration error")
    estimates = plan.estimates(lean, fine, coarser)
    if "half" not in coarser:
        return ErrorEstimate(estimates, tuple(remarks), clock.process_time() - start)
    spectra = spectrum_errors(fine, coarser["half"], 1.0 / plan.half.time)
    estimate = ErrorEstimate(estimates, tuple(remarks), clock.process_time() - start, spectra)
    measured = PricedRuns(fine, coarser["half"], coarser.get("split"), costs, solution.timings)
    return priced(lean, estimate, measured)


def estimate_by_modes(scene: Scene, solution: Solution, truncation: TruncationError) -> ErrorEstimate:
    """Estimate of a march by modes from the second one that its error was estimated by: nothing is run."""
    plan = CoarserRuns(Resolution(1.0, 0.5), None, (UNREFINED,) if mesh_files(scene) else ())
    fine = measure_solution(scene, solution)
    half = measure_solution(scene, replace(solution, outcome=truncation.coarse))
    estimates = plan.estimates(scene, fine, {"half": half})
    remarks = *plan.remarks, *band_remarks(scene, solution, list(solution.sensors))
    estimate = ErrorEstimate(estimates, remarks, 0.0, spectrum_errors(fine, half, 2.0))
    # the second march stands for the first in its costs: it has no timings of its own
    costs = [RunCost.of(Resolution(), solution.timings)]
    return priced(scene, estimate, PricedRuns(fine, half, None, costs, solution.timings))


def band_remarks(scene: Scene, solution: Solution, sensors: Sequence[str]) -> list[str]:
    """What the peaks of these sensors mean, where they have any."""
    moving = [name for name in sensors if solution.sensors[name].acceleration is not None]
    bare = [name for name in moving if scene.sensor[name].filter is None]
    if not bare:
        return []
    return [
        f"velocity_peak and acceleration_peak of {', '.join(bare)}: up to {resolved_frequency(scene):.3g} Hz, where "
        f"{ELEMENTS_PER_WAVE} elements make a wave; behind a front the unfiltered acceleration grows without limit as "
        "the mesh is refined"
    ]


def spectrum_errors(fine: Quantities, half: Quantities, ratio: float) -> dict[str, Array]:
    """Relative errors of spectra from a run coarser by ``ratio``, by sensor (``spectrum_error``)."""
    both = [name for name in fine.spectra if name in half.spectra]
    return {name: spectrum_error(fine.spectra[name], half.spectra[name], ratio) for name in both}
