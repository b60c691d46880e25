"""The error of a run of a ladder, from the coarser runs the search has made anyway."""

from __future__ import annotations

import math

from ..errors import LatinError
from .bench import told
from .differences import relative, same_way
from .extrapolation import ORDER_BAND, Judged, observed_order
from .kinds import FIRST_CONTACT, PEAK_FORCE, SEPARATION, Kind, kind_of
from .ladder import Ladder
from .refinement import at_resolution
from .runs import Run
from .sampling import sampling_error

_SAFETY = 1.15
_STEADY, _LEAST_ORDER, _LARGEST_ORDER = 0.35, 0.3, 2.0
_RINGING = 2.0  # weight of the ringing of a peak


def ladder_error(ladder: Ladder, factor: float, quantity: str, needed: int = 2) -> Judged:
    """Estimated relative error of a quantity at a factor.

    Two runs: ``Kind.change`` x what the last refinement changed. Three: the larger of ``Kind.changes`` x the last two
    changes. Four that go one way and agree on the order p: 1.15 x change / (r^p - 1), p the smaller order. It is an
    estimate where the order observed is the expected one or steady, else a bound. Infinite where there is no coarser
    run.

    Parameters
    ----------
    needed : runs made where there are none yet, the one at ``factor`` and those with a half and a quarter of its
        resolution; coarser ones count where they have been made.
    """
    chain = _chain(ladder, factor, needed)
    if len(chain) < 2:
        return Judged(math.inf, math.nan, bound_only=True)
    kind = kind_of(quantity)
    scene = at_resolution(ladder.scene, ladder.at(factor))
    sampling = 0.0 if kind in (FIRST_CONTACT, SEPARATION) else sampling_error(scene)
    iteration = kind.iteration * scene.solver.tolerance
    found = _steady(chain, quantity) if kind is not PEAK_FORCE else None
    if found is None:
        found = _by_change(chain, quantity, kind)
    return Judged(max(found.error, sampling) + iteration, found.order, found.bound_only)


def _chain(ladder: Ladder, factor: float, needed: int) -> list[Run]:
    """The run at a factor and the coarser ones, those needed and those already made, up to the first without answer."""
    found: list[Run] = []
    for f in ladder.chain(factor):
        at = ladder.at(f)
        if len(found) >= needed and not ladder.made(at):
            break
        try:
            run = ladder.run(at)
        except LatinError as error:
            ladder.tell(f"no coarser run: {told(error)}")
            break
        if not run.converged:
            break
        found.append(run)
    return found


def _by_change(chain: list[Run], quantity: str, kind: Kind) -> Judged:
    """The error from what the last refinement changed, and the one before where it is known."""
    fine, last, order = chain[0].measured, _change(chain[0], chain[:2], quantity, kind), math.nan
    error = kind.change * last
    if len(chain) > 2:
        before = _change(chain[0], chain[1:3], quantity, kind)
        error = max(kind.changes[0] * last, kind.changes[1] * before)
        if same_way(quantity, *(run.measured for run in chain[:3])):
            order = _order(chain[:3], chain, quantity)[0]
    if kind is PEAK_FORCE:
        error = max(error, _RINGING * fine.ringing[quantity.rpartition(".")[0]])
    return Judged(error, order, not abs(order - kind.order) <= ORDER_BAND)


def _change(scale: Run, pair: list[Run], quantity: str, kind: Kind) -> float:
    """Relative change between two runs, brought to a refinement by two at the expected order."""
    fine, coarse = pair
    ratio = fine.resolution.time / coarse.resolution.time
    change = relative(quantity, scale.measured, fine.measured, coarse.measured)
    return float(change * (2.0**kind.order - 1.0) / (ratio**kind.order - 1.0))


def _steady(chain: list[Run], quantity: str) -> Judged | None:
    """The extrapolated error, where four runs agree on the order."""
    if len(chain) < 4:
        return None
    one_way = all(same_way(quantity, *(run.measured for run in chain[i : i + 3])) for i in (0, 1))
    (first, half), (second, _) = _order(chain[:3], chain, quantity), _order(chain[1:], chain, quantity)
    order = min(first, second, _LARGEST_ORDER)
    if not (one_way and abs(first - second) <= _STEADY and order >= _LEAST_ORDER):
        return None
    ratio = chain[0].resolution.time / chain[1].resolution.time
    return Judged(_SAFETY * half / (ratio**order - 1.0), order, bound_only=False)


def _order(triple: list[Run], chain: list[Run], quantity: str) -> tuple[float, float]:
    """Observed order of three runs, and the difference of the first two."""
    fine, half, quarter = triple
    scale = chain[0].measured
    first = relative(quantity, scale, fine.measured, half.measured)
    second = relative(quantity, scale, half.measured, quarter.measured)
    time = fine.resolution.time
    return observed_order(first, second, (time / half.resolution.time, time / quarter.resolution.time)), first
