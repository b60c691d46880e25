"""From differences between runs to an error: observed order, extrapolation, bound."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .kinds import FORCE_HISTORY, Kind

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
