"""The error of a run of a ladder, from the runs at a half, a quarter and an eighth of its resolution."""

from __future__ import annotations

import math

from ..errors import LatinError
from .bench import told
from .differences import relative, same_way
from .extrapolation import Differences, Judged, judge, observed_order
from .kinds import FIRST_CONTACT, PEAK_FORCE, SEPARATION, Kind, kind_of
from .ladder import Ladder
from .refinement import Resolution, at_resolution
from .runs import Run
from .sampling import sampling_error

_SAFETY = 1.15
_STEADY, _LEAST_ORDER, _LARGEST_ORDER = 0.35, 0.3, 2.0


def ladder_error(ladder: Ladder, factor: float, quantity: str) -> Judged:
    """Estimated relative error of a quantity at a factor.

    Where the orders of both triples of runs agree and the quantity goes one way through all four: 1.15 x half /
    (r^p - 1), p the smaller order. Elsewhere as for any run, with the companion whose mesh alone is coarser. Infinite
    where there are no two coarser runs.
    """
    chain = _chain(ladder, factor)
    if len(chain) < 3:
        return Judged(math.inf, math.nan, bound_only=True)
    kind = kind_of(quantity)
    scene = at_resolution(ladder.scene, ladder.at(factor))
    sampling = 0.0 if kind in (FIRST_CONTACT, SEPARATION) else sampling_error(scene)
    iteration = kind.iteration * scene.solver.tolerance
    steady = _steady(chain, quantity)
    if steady is not None and kind is not PEAK_FORCE:
        return Judged(max(steady.error, sampling) + iteration, steady.order, steady.bound_only)
    return judge(kind, _differences(ladder, factor, chain, quantity, kind, sampling, iteration))


def _chain(ladder: Ladder, factor: float) -> list[Run]:
    """The run at a factor and the coarser ones, up to the first that cannot be made or does not converge."""
    found: list[Run] = []
    for f in ladder.chain(factor):
        try:
            run = ladder.run(ladder.at(f))
        except LatinError as error:
            ladder.tell(f"no coarser run: {told(error)}")
            break
        if not run.converged:
            break
        found.append(run)
    return found


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


def _differences(
    ladder: Ladder, factor: float, chain: list[Run], quantity: str, kind: Kind, sampling: float, iteration: float
) -> Differences:  # fmt: skip
    fine, half, quarter = (run.measured for run in chain[:3])
    time = chain[0].resolution.time
    steps = math.nan
    if ladder.refines_mesh:
        only = ladder.run(Resolution(chain[1].resolution.mesh, ladder.at(factor).time))
        steps = relative(quantity, fine, half, only.measured)
    return Differences(
        half=relative(quantity, fine, fine, half),
        quarter=relative(quantity, fine, half, quarter),
        steps=steps,
        same_way=same_way(quantity, fine, half, quarter),
        ratios=(time / chain[1].resolution.time, time / chain[2].resolution.time),
        ringing=fine.ringing[quantity.rpartition(".")[0]] if kind is PEAK_FORCE else 0.0,
        sampling=sampling,
        iteration=iteration,
    )
