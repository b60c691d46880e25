"""The error of a run, told by a few coarser ones."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from ..errors import LatinError
from ..results.estimates import ErrorEstimate, QuantityEstimate
from ..results.quantities_of_interest import (
    DISPLACEMENT,
    FIRST_CONTACT,
    FLOOR,
    FORCE_HISTORY,
    PEAK_FORCE,
    SEPARATION,
    Kind,
    kind_of,
)
from ..results.solution import Solution
from ..scene.schema import Scene
from .quantities import Measured
from .resolution import Resolution, aligned, counts_that_vary, in_short_windows, meshed_by_the_program, sampling_error
from .runs import measure_solution, run_at, told

ORDER_BAND = 0.3
"""An observed order within this of the expected one makes an estimate; elsewhere there is only a bound."""

_ORDERS = (-3.0, 8.0)  # where an observed order is looked for
_BOUND = (3.0, 1.2, 0.5, 2.0)  # weights in the bound of: half, steps, quarter, ringing


@dataclass(frozen=True)
class Differences:
    """Relative differences of one quantity between the run (h, dt) and coarser ones.

    Attributes
    ----------
    half : between (h, dt) and (r h, r dt), r the first of ``ratios``.
    quarter : between (r h, r dt) and (r' h, r' dt), r' the second ratio; NaN where there is no such run.
    steps : between (r h, r dt) and (r h, dt); NaN where there is none.
    same_way : both refinements change the quantity in the same direction.
    ringing : how much of a peak is numerical oscillation. sampling : error of the sampled loads.
    iteration : error left by the iteration.
    """

    half: float
    quarter: float = math.nan
    steps: float = math.nan
    same_way: bool = True
    ratios: tuple[float, float] = (2.0, 4.0)
    ringing: float = 0.0
    sampling: float = 0.0
    iteration: float = 0.0


@dataclass(frozen=True)
class Judged:
    """Relative error, observed order (NaN where none can be told), and whether the error is only a bound."""

    error: float
    order: float
    bound_only: bool


def judge(kind: Kind, differences: Differences) -> Judged:
    """Estimated relative error of a quantity.

    Where the observed order p is the expected one: safety x half / (r^p - 1) (p at most the expected one). Elsewhere
    the largest of what the coarser runs change, weighted; a run whose quantities agree by chance is thus held
    against those whose time step alone is different.
    """
    d = differences
    r = d.ratios[0]
    order = observed_order(d.half, d.quarter, d.ratios) if d.same_way else math.nan
    regular = abs(order - kind.order) <= ORDER_BAND and d.sampling <= d.half
    p = min(order, kind.order) if kind is not FORCE_HISTORY else kind.order
    if regular:
        error = kind.safety * d.half / (r**p - 1.0)
    else:
        parts = (d.half, d.steps, d.quarter, d.ringing)
        error = max(w * part for w, part in zip(_BOUND, parts, strict=True) if not math.isnan(part))
        if math.isnan(d.quarter):  # no third run: take half the expected order
            error = max(error, kind.safety * d.half / (r ** (0.5 * kind.order) - 1.0))
    return Judged(max(error, d.sampling) + d.iteration, order, not regular)


def observed_order(half: float, quarter: float, ratios: tuple[float, float]) -> float:
    """p such that error ~ h^p explains both differences: quarter / half = (r'^p - r^p) / (r^p - 1).

    NaN where a difference is zero or missing.

    >>> round(observed_order(1.0, 2.0, (2.0, 4.0)), 6)
    1.0
    """
    if not (half > 0.0 and quarter > 0.0) or not 1.0 < ratios[0] < ratios[1]:
        return math.nan
    wanted = quarter / half

    def found(p: float) -> float:
        a, b = math.log(ratios[0]), math.log(ratios[1])
        if abs(p) < 1e-9:
            return (b - a) / a
        return (math.exp(p * b) - math.exp(p * a)) / math.expm1(p * a)

    low, high = _ORDERS
    if not found(low) < wanted < found(high):
        return low if wanted <= found(low) else high
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if found(middle) < wanted else (low, middle)
    return 0.5 * (low + high)


_FEWEST_STEPS = 8


@dataclass(frozen=True)
class Companions:
    """Resolutions relative to the run.

    Attributes
    ----------
    half : mesh and time step about twice as coarse, at one ratio. quarter : about four times; None where the scene
        is too coarse for it. half_mesh : the mesh of ``half`` with the steps of the run; None where no mesh changes.
    remarks : what cannot be told.
    """

    half: Resolution
    quarter: Resolution | None
    half_mesh: Resolution | None
    remarks: tuple[str, ...]

    @property
    def ratios(self) -> tuple[float, float]:
        """How many times coarser in time ``half`` and ``quarter`` are."""
        return 1.0 / self.half.time, 4.0 if self.quarter is None else 1.0 / self.quarter.time


def companions_of(scene: Scene) -> Companions | None:
    """Coarser runs of a scene; None where it is too short to be coarsened at all."""
    if scene.time.n_step < 2 * _FEWEST_STEPS:
        return None
    counts = counts_that_vary(scene)
    if not meshed_by_the_program(scene):
        return _steps_only(scene, ("the mesh comes from a file: its share of the error is not estimated",))
    if not counts:
        return _steps_only(scene, ())
    first, second = reachable(counts, 0.5), reachable(counts, 0.25)
    half, quarter_steps = aligned(scene, first), aligned(scene, second)
    if first == 1.0:
        return _steps_only(scene, ("the mesh cannot be coarsened: its share of the error is not estimated",))
    quarter = None
    remarks: tuple[str, ...] = ()
    if second < 0.8 * first and scene.time.n_step * second >= _FEWEST_STEPS:
        quarter = Resolution(second, quarter_steps)
    else:
        remarks = ("too coarse for a third run: no order is observed",)
    return Companions(Resolution(first, half), quarter, Resolution(first, 1.0), remarks)


def _steps_only(scene: Scene, remarks: tuple[str, ...]) -> Companions:
    long = scene.time.n_step >= 4 * _FEWEST_STEPS
    quarter = Resolution(1.0, aligned(scene, 0.25)) if long else None
    return Companions(Resolution(1.0, aligned(scene, 0.5)), quarter, None, remarks)


def reachable(counts: list[int], factor: float) -> float:
    """The factor nearest to ``factor`` that leaves the largest number of elements whole.

    >>> reachable([6, 6], 0.25), reachable([5], 0.5)
    (0.3333333333333333, 0.6)
    """
    largest = max(counts)
    return max(1, int(largest * factor + 0.5)) / largest


def judged(
    scene: Scene, run: Measured, coarser: Mapping[str, Measured], companions: Companions
) -> tuple[QuantityEstimate, ...]:
    """Estimates from the quantities of a run and of the coarser ones ``half``, ``quarter``, ``half_mesh``."""
    sampling = sampling_error(scene)
    estimates = []
    for quantity, value in run.values.items():
        kind = kind_of(quantity)
        differences = differences_of(scene, quantity, run, coarser, companions, sampling)
        result = judge(kind, differences)
        mesh = relative(quantity, run, run, coarser["half_mesh"]) if "half_mesh" in coarser else math.nan
        time = differences.half if companions.half_mesh is None else differences.steps
        estimates.append(
            QuantityEstimate(
                quantity, value, kind.unit, result.error, result.order, kind.order, result.bound_only, mesh, time
            )
        )
    return tuple(estimates)


def differences_of(
    scene: Scene, quantity: str, run: Measured, coarser: Mapping[str, Measured], companions: Companions, sampling: float
) -> Differences:
    """What the coarser runs say of one quantity."""
    half, quarter, mesh = coarser["half"], coarser.get("quarter"), coarser.get("half_mesh")
    kind = kind_of(quantity)
    return Differences(
        half=relative(quantity, run, run, half),
        quarter=math.nan if quarter is None else relative(quantity, run, half, quarter),
        steps=math.nan if mesh is None else relative(quantity, run, half, mesh),
        same_way=quarter is None or same_way(quantity, run, half, quarter),
        ratios=companions.ratios,
        ringing=run.ringing[quantity.rpartition(".")[0]] if kind is PEAK_FORCE else 0.0,
        sampling=0.0 if kind in (FIRST_CONTACT, SEPARATION) else sampling,
        iteration=kind.iteration * scene.solver.tolerance,
    )


def relative(quantity: str, run: Measured, a: Measured, b: Measured) -> float:
    """Distance of a quantity between two runs over the scale it has in ``run``; 0 where nothing happens."""
    if quantity not in a.values or quantity not in b.values:
        return math.nan
    scale = run.scales[quantity]
    return a.distance(quantity, b) / scale if scale > 0.0 else 0.0


def same_way(quantity: str, run: Measured, half: Measured, quarter: Measured) -> bool:
    """Whether both refinements change the quantity in the same direction (always, for a norm of differences)."""
    owner = quantity.rpartition(".")[0]
    kind = kind_of(quantity)
    if kind is FORCE_HISTORY or quantity not in half.values or quantity not in quarter.values:
        return True
    if kind is DISPLACEMENT:
        fine, coarse = (m.vectors for m in (run, quarter))
        return float((fine[owner] - half.vectors[owner]) @ (half.vectors[owner] - coarse[owner])) > 0.0
    fine_step = run.values[quantity] - half.values[quantity]
    return fine_step * (half.values[quantity] - quarter.values[quantity]) > 0.0


Tell = Callable[[str], None]


def estimate_error(scene: Scene, solution: Solution, tell: Tell | None = None) -> ErrorEstimate:
    """Estimated relative error of every quantity of a finished run of ``scene``.

    Costs three coarser runs: mesh and step halved together (1/16 of the cost of the run in 3-D), quartered together
    (1/256), mesh alone halved (1/8). Sensors need the fields of the run (``output.fields``).

    Parameters
    ----------
    tell : hears what is being run.
    """
    start = clock.process_time()
    companions = companions_of(scene)
    if companions is None:
        return ErrorEstimate((), ("too few time steps for an estimate",), 0.0, FLOOR)
    remarks = list(companions.remarks)
    found = _coarser_runs(scene, companions, remarks, tell)
    run = measure_solution(scene, solution)
    estimates = judged(scene, run, found, companions) if "half" in found else ()
    if not run.values:
        remarks.append("no interface and no sensor whose fields are kept: no quantity to judge")
    if not solution.converged:
        remarks.append("the run did not converge: the estimate does not cover what that leaves")
    return ErrorEstimate(estimates, tuple(remarks), clock.process_time() - start, FLOOR)


def _coarser_runs(scene: Scene, companions: Companions, remarks: list[str], tell: Tell | None) -> dict[str, Measured]:
    """Quantities of the coarser runs that can be made and converge, by name; a remark for each other."""
    lean = in_short_windows(scene)
    found: dict[str, Measured] = {}
    for name, resolution in _wanted(companions).items():
        text = f"mesh x {resolution.mesh:.3g}, steps x {resolution.time:.3g}"
        if tell is not None:
            tell(f"error estimate: {text}")
        try:
            run = run_at(lean, resolution)
        except LatinError as error:
            remarks.append(f"no coarser run ({text}): {told(error)}")
            continue
        if run.converged:
            found[name] = run.measured
        else:
            remarks.append(f"a coarser run ({text}) did not converge")
    return found


def _wanted(companions: Companions) -> dict[str, Resolution]:
    runs = {"half": companions.half, "quarter": companions.quarter, "half_mesh": companions.half_mesh}
    return {name: resolution for name, resolution in runs.items() if resolution is not None}
