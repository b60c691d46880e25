"""The error of a run, estimated from coarser runs of the same scene.

The runs form a sequence, finest first, in which mesh and time step are coarsened at one ratio. One estimator serves all
callers: the estimate of a plain run or of a session (``estimate_error``), the search for a target accuracy
(``adaptive_resolution``) and the reference of a study. Its constants are those of the quantities of interest
(``results.quantities_of_interest``).
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from ..errors import LatinError
from ..latin.record import Array
from ..results.estimates import ErrorEstimate, QuantityEstimate
from ..results.quantities_of_interest import (
    DISPLACEMENT,
    FIRST_CONTACT,
    FORCE_HISTORY,
    PEAK_FORCE_RAW,
    SEPARATION,
    QuantityOfInterest,
    definition_of,
)
from ..results.solution import Solution
from ..results.spectra import shock_response_spectrum, spectrum_error
from ..scene.schema import Scene
from ..scene.sensors import nyquist
from .quantities import Quantities
from .resolution import (
    FEWEST_STEPS,
    Resolution,
    aligned,
    counts_that_vary,
    in_short_windows,
    meshed_by_the_program,
    reachable,
    sampling_error,
)
from .runs import Run, measure_solution, message_of, run_at

ORDER_BAND: Final = 0.3
"""A sequence whose observed order lies within this of the expected one is regular: its error is an estimate, else a
bound."""

_ORDERS = (-3.0, 8.0)  # range of observed orders
_STEP_WEIGHT = 1.2  # in the bound


@dataclass(frozen=True)
class Changes:
    """Relative changes of one quantity along a sequence of runs.

    Attributes
    ----------
    half : between the run (h, dt) and the next coarser one (r h, r dt), r the first of ``ratios``.
    quarter : between (r h, r dt) and (r' h, r' dt), r' the second ratio; NaN without a third run.
    steps : between (r h, r dt) and (r h, dt), the change by the time step alone; NaN where not computed.
    same_way : both refinements change the quantity in the same direction.
    sampling : relative error of the sampled loads. iteration : relative error left by the iteration.
    """

    half: float
    quarter: float = math.nan
    steps: float = math.nan
    same_way: bool = True
    ratios: tuple[float, float] = (2.0, 4.0)
    sampling: float = 0.0
    iteration: float = 0.0

    @property
    def order(self) -> float:
        """Observed order of convergence; NaN where the changes give none."""
        return observed_order(self.half, self.quarter, self.ratios) if self.same_way else math.nan


def estimated_error(definition: QuantityOfInterest, changes: Changes) -> tuple[float, bool]:
    """Estimated relative error of a quantity, and whether it is only a bound.

    With the expected order p the last refinement by r extrapolates to e = change / (r^p - 1), the one before to e'.
    Regular sequence (three runs, observed order within ``ORDER_BAND`` of p): ``safety`` x e. Otherwise a bound, the
    largest of ``three_runs`` x (e, e') (``two_runs`` x e without a third run), 1.2 x the change by the time step alone.
    A last change that is small by chance is thus compared with the others. The raw peak on a front has no order: its
    error is always a bound. The error is at least that of the sampled loads, and the error
    left by the iteration is added.
    """
    p = definition.order
    ratio = changes.ratios[0]
    last = changes.half / (ratio**p - 1.0)
    regular = (
        abs(changes.order - p) <= ORDER_BAND and changes.sampling <= changes.half and definition is not PEAK_FORCE_RAW
    )
    if regular:
        error = definition.safety * last
    elif math.isnan(changes.quarter):
        error = definition.two_runs * last
    else:
        before = changes.quarter / ((changes.ratios[1] / ratio) ** p - 1.0)
        error = max(definition.three_runs[0] * last, definition.three_runs[1] * before)
    if not regular:
        steps = 0.0 if math.isnan(changes.steps) else changes.steps
        error = max(error, _STEP_WEIGHT * steps)
    return max(error, changes.sampling) + changes.iteration, not regular


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
        return (b - a) / a if abs(p) < 1e-9 else (math.exp(p * b) - math.exp(p * a)) / math.expm1(p * a)

    low, high = _ORDERS
    if not quotient(low) < quarter / half < quotient(high):
        return low if quarter / half <= quotient(low) else high
    for _ in range(60):
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


def quantity_estimate(
    scene: Scene,
    quantity: str,
    runs: Sequence[tuple[Resolution, Quantities]],
    mesh_alone: Quantities | None = None,
    sampling: float | None = None,
) -> QuantityEstimate:
    """Estimated error of one quantity of the first of ``runs``.

    Parameters
    ----------
    scene : of the first run. runs : two or more, finest first; from the fourth on they do not count.
    mesh_alone : quantities on the mesh of the second run with the time step of the first.
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
    changes = Changes(
        half=relative(quantity, fine, fine, half),
        quarter=quarter,
        steps=math.nan if mesh_alone is None else relative(quantity, fine, half, mesh_alone),
        same_way=one_way,
        ratios=ratios,
        sampling=sampling_error(scene) if sampling is None else sampling,
        iteration=definition.iteration * scene.solver.tolerance,
    )
    error, bound_only = estimated_error(definition, changes)
    mesh = math.nan if mesh_alone is None else relative(quantity, fine, fine, mesh_alone)
    time = changes.half if at.mesh == at_half.mesh else changes.steps
    return QuantityEstimate(quantity, fine.values[quantity], error, changes.order, bound_only, mesh, time)


@dataclass(frozen=True)
class CoarserRuns:
    """Resolutions of the coarser runs from which the error of a run is estimated, relative to the run.

    Attributes
    ----------
    half : mesh and time step about twice as coarse, at one ratio. quarter : about four times; None where the scene
        is too coarse for it. half_mesh : the mesh of ``half`` with the steps of the run; None where no mesh changes.
    remarks : what the estimate does not cover.
    """

    half: Resolution
    quarter: Resolution | None
    half_mesh: Resolution | None
    remarks: tuple[str, ...] = ()

    def by_name(self) -> dict[str, Resolution]:
        """The resolutions that exist, by the name of the attribute."""
        runs = {"half": self.half, "quarter": self.quarter, "half_mesh": self.half_mesh}
        return {name: resolution for name, resolution in runs.items() if resolution is not None}

    def estimates(
        self, scene: Scene, fine: Quantities, coarser: Mapping[str, Quantities]
    ) -> tuple[QuantityEstimate, ...]:
        """Estimates of all quantities of a run of ``scene``; ``coarser`` by name, empty without ``half``."""
        if "half" not in coarser:
            return ()
        runs = [(Resolution(), fine), *((at, coarser[n]) for n, at in self.by_name().items() if n in coarser)]
        sequence = [run for run in runs if run[0] != self.half_mesh]
        mesh_alone, sampling = coarser.get("half_mesh"), sampling_error(scene)
        return tuple(quantity_estimate(scene, q, sequence, mesh_alone, sampling) for q in fine.values)


def coarser_runs_of(scene: Scene) -> CoarserRuns | None:
    """Coarser runs of a scene; None where it has too few time steps."""
    n = scene.time.n_step
    if n < 2 * FEWEST_STEPS:
        return None
    counts = counts_that_vary(scene)
    if not counts or not meshed_by_the_program(scene):
        why = "the mesh comes from a file: its share of the error is not estimated"
        quarter = Resolution(1.0, aligned(scene, 0.25)) if n >= 4 * FEWEST_STEPS else None
        remarks = () if meshed_by_the_program(scene) else (why,)
        return CoarserRuns(Resolution(1.0, aligned(scene, 0.5)), quarter, None, remarks)
    mesh, second = reachable(counts, 0.5), reachable(counts, 0.25)
    half, mesh_alone = Resolution(mesh, aligned(scene, mesh)), Resolution(mesh, 1.0)
    if second < 0.8 * mesh and n * second >= FEWEST_STEPS:
        return CoarserRuns(half, Resolution(second, aligned(scene, second)), mesh_alone)
    return CoarserRuns(half, None, mesh_alone, ("too coarse for a third run: no order of convergence is observed",))


def estimate_error(scene: Scene, solution: Solution, tell: Callable[[str], None] | None = None) -> ErrorEstimate:
    """Estimated relative error of every quantity of a finished run of ``scene``.

    Costs three coarser runs: mesh and step halved together (1/16 of the cost of the run in 3-D), quartered together
    (1/256), mesh alone halved (1/8).

    Parameters
    ----------
    tell : called with a line of text before each coarser run.
    """
    start = clock.process_time()
    plan = coarser_runs_of(scene)
    if plan is None:
        return ErrorEstimate((), ("too few time steps for an estimate",))
    remarks, spectra = list(plan.remarks), dict[str, Array]()
    coarser: dict[str, Quantities] = {}
    lean = in_short_windows(scene)
    for name, resolution in plan.by_name().items():
        text = f"mesh x {resolution.mesh:.3g}, steps x {resolution.time:.3g}"
        if tell is not None:
            tell(f"error estimate: {text}")
        try:
            run = run_at(lean, resolution)
        except LatinError as error:
            remarks.append(f"no coarser run ({text}): {message_of(error)}")
            continue
        if run.converged:
            coarser[name] = run.quantities
            if resolution == plan.half:
                spectra = spectrum_errors(solution, run)
        else:
            remarks.append(f"a coarser run ({text}) did not converge")
    fine = measure_solution(scene, solution)
    if not fine.values:
        remarks.append("no quantity to estimate: no interface and no sensor")
    if not solution.converged:
        remarks.append("the run did not converge: the estimate does not cover the error this leaves")
    estimates = plan.estimates(scene, fine, coarser)
    return ErrorEstimate(estimates, tuple(remarks), clock.process_time() - start, spectra)


def spectrum_errors(solution: Solution, coarse: Run) -> dict[str, Array]:
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
