"""The error of a run, estimated from coarser runs of the same scene.

The runs form a cross. Along its diagonal mesh and time step are coarsened at one ratio: (h, dt), (2 h, 2 dt),
(4 h, 4 dt), finest first. On the mesh 2 h one more run has about four times shorter steps, dt / 2: an error that
depends on the Courant number alone, and not on the mesh, leaves no trace along the diagonal. Its steps are no whole
fraction of the others, so that bodies land in another phase of a step. What neither direction shows, the overshoot of
a force that jumps (Gibbs), is stated as a floor. One estimator serves all callers: the estimate of a plain run or of a
session (``estimate_error``), the search for a target accuracy (``adaptive_resolution``) and the reference of a study.
Its constants are those of the quantities of interest (``results.quantities_of_interest``).
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from ..errors import LatinError
from ..latin.outcome import Array
from ..latin.processes import Processes
from ..results.estimates import ErrorEstimate, QuantityEstimate
from ..results.quantities_of_interest import (
    DISPLACEMENT,
    FIRST_CONTACT,
    FORCE_HISTORY,
    PEAK_FORCE,
    PEAK_FORCE_RAW,
    SEPARATION,
    QuantityOfInterest,
    definition_of,
)
from ..results.solution import Solution
from ..results.spectra import shock_response_spectrum, spectrum_error
from ..scene.schema import Scene
from ..scene.sensors import nyquist
from ..scene.settings import GeneralizedAlphaTable
from .runs import (
    FEWEST_STEPS,
    MeasuredRun,
    Quantities,
    Resolution,
    aligned,
    coarsens_mesh,
    cost_exponent,
    element_transit,
    in_short_windows,
    measure_solution,
    mesh_factor,
    mesh_files,
    message_of,
    run_at,
    sampling_error,
)

ORDER_BAND: Final = 0.3
"""A sequence whose observed order lies within this of the expected one is regular: its error is an estimate, else a
bound."""

UNREFINED: Final = (
    "the mesh comes from a file: its share of the error is not estimated; with mesh.refine = 1 the mesh of the file "
    "serves as the coarser one"
)
FACETED: Final = "refined meshes keep the facets of their files: the error of a curved shape is not estimated"

_BEFORE, _STEPS = 0.75, 0.75  # weights of the refinement before the last one, and of the step alone
_ORDERS = (-3.0, 8.0)  # range of observed orders
CROSS: Final = 31 / 8
"""Steps of the run across over those of the run beside it: no whole number, so that bodies land in another phase."""

_LEAST_DAMPING: Final = 0.5  # of the viscous contact layer, for the smaller overshoot


@dataclass(frozen=True)
class Changes:
    """Relative changes of one quantity over a cross of runs.

    Attributes
    ----------
    half : between the run (h, dt) and the next coarser one (r h, r dt), r the first of ``ratios``.
    quarter : between (r h, r dt) and (r' h, r' dt), r' the second ratio; NaN without a third run.
    steps : between (r h, r dt) and (r h, about r dt / 4), the change by the time step alone; NaN where not computed.
    same_way : both refinements change the quantity in the same direction.
    front : the quantity is that of a force that jumps. floor : error of the overshoot there.
    sampling : relative error of the sampled loads. iteration : relative error left by the iteration.
    """

    half: float
    quarter: float = math.nan
    steps: float = math.nan
    same_way: bool = True
    ratios: tuple[float, float] = (2.0, 4.0)
    front: bool = True
    floor: float = 0.0
    sampling: float = 0.0
    iteration: float = 0.0

    @property
    def order(self) -> float:
        """Observed order of convergence; NaN where the changes give none."""
        return observed_order(self.half, self.quarter, self.ratios) if self.same_way else math.nan


def expected_order(definition: QuantityOfInterest, front: bool) -> float:
    """Expected order of convergence of a quantity: that with fronts, or twice as much."""
    return definition.order if front else 2.0 * definition.order


def estimated_error(definition: QuantityOfInterest, changes: Changes) -> tuple[float, bool]:
    """Estimated relative error of a quantity, and whether it is only a bound.

        s (e + 3/4 (e' + d))

    With the expected order p, the last refinement by r extrapolates to e = change / (r^p - 1) at the run; so does the
    one before, to e' (e without a third run); d is the change by the time step alone on the mesh of the second run,
    over r^p. The sum of the three holds where one of them is small by chance. s is the safety factor of the
    quantity, larger where the sequence is irregular: the observed order is not within ``ORDER_BAND`` of p, or the
    floor is larger than the sum.
    The error is at least the floor of a force that jumps, that of the sampled loads and, of a raw peak, the change by
    the time step alone; the error left by the iteration is added. Of an irregular sequence it is only a bound.
    """
    p = expected_order(definition, changes.front)
    ratio, second = changes.ratios
    last = before = changes.half / (ratio**p - 1.0)
    if not math.isnan(changes.quarter):
        before = changes.quarter / ((second / ratio) ** p - 1.0) / ratio**p
    steps = 0.0 if math.isnan(changes.steps) else changes.steps / ratio**p
    error = definition.safety * (last + _BEFORE * before + _STEPS * steps)
    floor = max(changes.floor, changes.sampling)
    if definition is PEAK_FORCE_RAW and not math.isnan(changes.steps):
        floor = max(floor, changes.steps)
    regular = abs(changes.order - p) <= ORDER_BAND and floor <= error
    if not regular:
        error *= definition.irregular
    return max(error, floor) + changes.iteration, not regular


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
        return (b - a) / a if abs(p) < 1e-9 else (math.exp(p * b) - math.exp(p * a)) / math.expm1(p * a)

    low, high = _ORDERS
    if not quotient(low) < quarter / half < quotient(high):
        return low if quarter / half <= quotient(low) else high
    for _ in range(60):  # bisection to round-off: the quotient grows with p
        middle = 0.5 * (low + high)
        low, high = (middle, high) if quotient(middle) < quarter / half else (low, middle)
    return 0.5 * (low + high)


def relative(quantity: str, scale: Quantities, a: Quantities, b: Quantities) -> float:
    """Distance of a quantity between two runs, divided by its scale in a third; 0 where the scale is 0."""
    if quantity not in a.values or quantity not in b.values:
        return math.nan
    divisor = scale.scales[quantity]
    return a.distance(quantity, b, scale) / divisor if divisor > 0.0 else 0.0


def same_way(quantity: str, fine: Quantities, half: Quantities, quarter: Quantities) -> bool:
    """Whether both refinements change the quantity in the same direction (always true for the norm of a difference)."""
    owner = quantity.rpartition(".")[0]
    definition = definition_of(quantity)
    if definition is FORCE_HISTORY or quantity not in half.values or quantity not in quarter.values:
        return True
    if definition is DISPLACEMENT:
        last, before = fine.vectors[owner] - half.vectors[owner], half.vectors[owner] - quarter.vectors[owner]
        return float(last @ before) > 0.0
    values = [run.value(quantity, fine) for run in (fine, half, quarter)]
    return (values[0] - values[1]) * (values[1] - values[2]) > 0.0


def overshoot(scene: Scene, transit: float) -> tuple[float, float]:
    """Overshoot of the contact force after a jump, over the jump: of single instants, and integrated over tau.

    With generalised alpha and a viscous contact layer 12 % at every mesh and step, and 0.15 tau, tau the time a wave
    needs to cross an element. With the other schemes the landing layer of elements bounces: the values of single
    instants have no limit as the step shrinks, and their integral grows from 0.2 tau at a Courant number of 1 to 2 tau
    (measured on thrown bars, Courant numbers from 0.05 to 1.5).
    """
    scheme = scene.time.scheme
    if isinstance(scheme, GeneralizedAlphaTable) and scheme.landing_damping >= _LEAST_DAMPING:
        return 0.12, 0.15
    return math.inf, min(0.2 * (transit / scene.time.time_step) ** 1.5, 2.0)


def front_of(quantity: str, scene: Scene, fine: Quantities) -> tuple[bool, float]:
    """Whether a quantity is that of a force that jumps, and the floor of its error there.

    A mean over the time T keeps c tau / T of the overshoot, c its integral, and not more than one over tau; no
    refinement reduces that of the raw peak. Impulses, instants, histories and displacements have the order of a front
    where any force of the run jumps.
    """
    owner, definition = quantity.rpartition(".")[0], definition_of(quantity)
    if definition not in (PEAK_FORCE, PEAK_FORCE_RAW):
        return any(force.jumps(fine.durations[name]) for name, force in fine.forces.items()), 0.0
    force, duration, raw = fine.forces[owner], fine.durations[owner], definition is PEAK_FORCE_RAW
    if not force.jumps(duration, None if raw else force.peak_mean(duration)[1]):
        return False, 0.0
    transit = element_transit(scene, owner, fine.spacings[owner])
    instants, integral = overshoot(scene, transit)
    return True, instants if raw else min(instants, 0.6, integral * transit / duration)


def quantity_estimate(
    scene: Scene,
    quantity: str,
    runs: Sequence[tuple[Resolution, Quantities]],
    cross: Quantities | None = None,
    sampling: float | None = None,
) -> QuantityEstimate:
    """Estimated error of one quantity of the first of ``runs``.

    Parameters
    ----------
    scene : of the first run. runs : two or more, finest first; from the fourth on they do not count.
    cross : quantities on the mesh of the second run with about four times shorter steps.
    sampling : of the loads of the scene (``sampling_error``), computed where None.
    """
    definition = definition_of(quantity)
    (at, fine), (at_half, half) = runs[:2]
    ratios, quarter, one_way = (at.time / at_half.time, 2.0 * at.time / at_half.time), math.nan, True
    if len(runs) > 2:
        at_quarter, coarsest = runs[2]
        ratios = ratios[0], at.time / at_quarter.time
        quarter, one_way = relative(quantity, fine, half, coarsest), same_way(quantity, fine, half, coarsest)
    if definition in (FIRST_CONTACT, SEPARATION):
        sampling = 0.0
    front, floor = front_of(quantity, scene, fine)
    changes = Changes(
        half=relative(quantity, fine, fine, half),
        quarter=quarter,
        steps=math.nan if cross is None else relative(quantity, fine, half, cross),
        same_way=one_way,
        ratios=ratios,
        front=front,
        floor=floor,
        sampling=sampling_error(scene) if sampling is None else sampling,
        iteration=definition.iteration * scene.solver.tolerance,
    )
    error, bound_only = estimated_error(definition, changes)
    expected = expected_order(definition, front)
    mesh = math.nan if cross is None else relative(quantity, fine, fine, cross)
    time = changes.half if at.mesh == at_half.mesh else changes.steps
    return QuantityEstimate(quantity, fine.values[quantity], error, changes.order, bound_only, mesh, time, expected)


@dataclass(frozen=True)
class CoarserRuns:
    """Resolutions of the coarser runs from which the error of a run is estimated, relative to the run.

    Attributes
    ----------
    half : mesh and time step about twice as coarse, at one ratio. quarter : about four times; None where the scene
        is too coarse for it. cross : the mesh of ``half`` with about four times its steps; None where no mesh changes.
    remarks : what the estimate does not cover.
    """

    half: Resolution
    quarter: Resolution | None
    cross: Resolution | None
    remarks: tuple[str, ...] = ()

    def by_name(self) -> dict[str, Resolution]:
        """The resolutions that exist, by the name of the attribute."""
        runs = {"half": self.half, "quarter": self.quarter, "cross": self.cross}
        return {name: resolution for name, resolution in runs.items() if resolution is not None}

    def estimates(
        self, scene: Scene, fine: Quantities, coarser: Mapping[str, Quantities]
    ) -> tuple[QuantityEstimate, ...]:
        """Estimates of all quantities of a run of ``scene``; ``coarser`` by name, empty without ``half``."""
        if "half" not in coarser:
            return ()
        diagonal = {name: at for name, at in self.by_name().items() if name in coarser and name != "cross"}
        runs = [(Resolution(), fine), *((at, coarser[name]) for name, at in diagonal.items())]
        cross, sampling = coarser.get("cross"), sampling_error(scene)
        return tuple(quantity_estimate(scene, q, runs, cross, sampling) for q in fine.values)


def coarser_runs_of(scene: Scene) -> CoarserRuns | None:
    """Coarser runs of a scene; None where it has too few time steps."""
    n = scene.time.n_step
    if n < 2 * FEWEST_STEPS:
        return None
    files = mesh_files(scene)
    if not coarsens_mesh(scene):
        quarter = Resolution(1.0, aligned(scene, 0.25)) if n >= 4 * FEWEST_STEPS else None
        return CoarserRuns(Resolution(1.0, aligned(scene, 0.5)), quarter, None, (UNREFINED,) if files else ())
    mesh, second = mesh_factor(scene, 0.5), mesh_factor(scene, 0.25)
    half, cross, remarks = (
        Resolution(mesh, aligned(scene, mesh)),
        crossing(scene, mesh, mesh),
        (FACETED,) if files else (),
    )
    if second < 0.8 * mesh and n * second >= FEWEST_STEPS:
        return CoarserRuns(half, Resolution(second, aligned(scene, second)), cross, remarks)
    return CoarserRuns(half, None, cross, (*remarks, "too coarse for a third run: no order of convergence is observed"))


def crossing(scene: Scene, mesh: float, steps: float) -> Resolution:
    """The run beside (mesh, steps) with about four times the steps, in another phase of landing."""
    return Resolution(mesh, aligned(scene, CROSS * steps))


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
        return None if self._report is None else self

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

    Costs three coarser runs: mesh and step halved together (1/16 of the cost of the run in 3-D), quartered together
    (1/256), the mesh halved under steps half as long (1/4).

    Parameters
    ----------
    log : called with a line of text before each coarser run. processes : as for ``api.solve``; all of them call this.
    report : called with the share of the work that is done. stream : as for ``api.solve``, of the coarser runs: a run
        whose histories do not fit in memory has coarser ones that do not either. max_cpu : of all of them together, s.
    """
    start = clock.process_time()
    plan = coarser_runs_of(scene)
    if plan is None:
        return ErrorEstimate((), ("too few time steps for an estimate",))
    remarks, spectra = list(plan.remarks), dict[str, Array]()
    coarser: dict[str, Quantities] = {}
    lean = in_short_windows(scene)
    shares = _Shares(scene, list(plan.by_name().values()), report)
    for name, resolution in plan.by_name().items():
        text = f"mesh x {resolution.mesh:.3g}, steps x {resolution.time:.3g}"
        if log is not None:
            log(f"error estimate: {text}")
        left = None if max_cpu is None else max(max_cpu - (clock.process_time() - start), 0.0)
        try:
            progress = shares.of(resolution)
            run = run_at(lean, resolution, progress=progress, processes=processes, stream=stream, max_cpu=left)
            shares.update(1, 1, run.iterations[1], 0.0)
        except LatinError as error:
            remarks.append(f"no coarser run ({text}): {message_of(error)}")
            continue
        if run.converged:
            coarser[name] = run.quantities
            if resolution == plan.half:
                spectra = spectrum_errors(solution, run)
        else:
            remarks.append(f"a coarser run ({text}) did not converge: {run.status}")
    fine = measure_solution(scene, solution)
    if not fine.values:
        remarks.append("no quantity to estimate: no interface and no sensor")
    if not solution.converged:
        remarks.append("the run did not converge: the estimate does not include its iteration error")
    estimates = plan.estimates(lean, fine, coarser)
    return ErrorEstimate(estimates, tuple(remarks), clock.process_time() - start, spectra)


def spectrum_errors(solution: Solution, coarse: MeasuredRun) -> dict[str, Array]:
    """Relative errors of the spectra of a solution from the coarser run ``half``, by sensor (``spectrum_error``)."""
    errors, step = {}, float(coarse.time[1] - coarse.time[0])
    ratio = step * (len(solution.time) - 1) / float(solution.time[-1])
    for name, fine in solution.spectra.items():
        acceleration = coarse.sensors[name].acceleration
        below = fine.frequency[fine.frequency <= nyquist(step)]
        if acceleration is not None and len(below):
            same = shock_response_spectrum(acceleration, step, below, fine.quality)
            errors[name] = spectrum_error(fine, same, ratio)
    return errors
