"""Tractions expected at the end of the next instant, from those of the last instants: its first guess.

The change of the tractions in an instant is fitted by the ORDER changes before it, in the norm of the acceleration, and
the next change d_1 is expected to follow from them as this one, d_0, did (linear prediction):

    x = argmin | d_0 - sum of x_a d_-a |,    d_1 = sum of x_a d_1-a,    a = 1 ... ORDER

What the fit leaves of d_0 is the ``misfit``. Points without traction stay so. The tractions enter the loads of the
instant (``half_solves.add_reference``), so that the velocities of the first guess are exact.

This is for tolerances far below the change of an instant, and after instants that took, or would have taken, more than
UNCERTAIN iterations: many follow then, which take away what the expectation carries over from the error of the last
instants. At rough tolerances that error would be fed on. Where residuals alone end an instant it is always made.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from .acceleration import least_squares
from .newton import LAST, UNCERTAIN
from .sums import add_parts, exchange_parts

Array = NDArray[np.float64]

ORDER, KEPT = 6, 7
"""Changes that fit the last one; changes kept, with that."""
WORST = 0.3
EXACT = 1e-10
GROWTH = 2.0
"""Misfit above which the tractions are expected to stay as they are; square of the least one, below it is round-off;
length of the expected change over that of the last one above which they are, too: after changes of round-off the first
large one is fitted by these with any coefficients."""


@kernel
def counted(pools: Any, iteration: int) -> float:
    """Iterations of an instant up to this one, and those that its expected tractions saved at the rate of these."""
    run, work = pools.run[0], pools.moving
    count = float(iteration + 1)
    if run.expects == 1 and iteration > 0 and 0.0 < work[run.misfit] < 1.0:
        first, now = work[run.merits], max(work[run.measure] / run.tolerance, 1e-300)
        if first > now:
            count *= 1.0 - np.log10(work[run.misfit]) / np.log10(first / now)
    return float(count)


@kernel
def expect(pools: Any, ended: Array) -> None:
    """Keep the change to the tractions ``ended`` (N,) of the instant that ends, those of the last one being in
    ``f_hat``, and find the change that is expected in the next."""
    run, work = pools.run[0], pools.moving
    n, f_hat = run.n_flat, work[run.f_hat : run.f_hat + run.n_flat]
    changes, ahead = work[run.changes : run.changes + KEPT * n], work[run.ahead : run.ahead + n]
    for j in range((KEPT - 1) * n):
        # from the end on: each is read before it is written
        to = KEPT * n - 1 - j
        changes[to] = changes[to - n]
    for j in range(n):
        changes[j] = ended[j] - f_hat[j]
    _take_products(pools)
    x = work[run.fit : run.fit + ORDER]
    slow = run.residual_alone == 1 or counted(pools, int(work[run.course + LAST])) > UNCERTAIN
    misfit = _fitted(pools, x) if slow else np.inf
    work[run.misfit] = misfit if misfit <= WORST else 1.0
    for j in range(n):
        ahead[j] = 0.0
    for a in range(ORDER if misfit <= WORST else 0):
        change = changes[a * n : (a + 1) * n]
        for j in range(n):
            if ended[j] != 0.0:
                ahead[j] += x[a] * change[j]


@kernel
def _take_products(pools: Any) -> None:
    """Products of the newest change with all, in the place of those of the oldest."""
    run, work = pools.run[0], pools.moving
    n, products = run.n_flat, work[run.change_products : run.change_products + KEPT * KEPT]
    for i in range(KEPT * KEPT - KEPT - 1):
        to = KEPT * KEPT - 1 - i
        products[to] = products[to - KEPT - 1]
    for e in range(run.n_interface):
        part, size = run.own_parts + e * run.part_width, pools.fixed_int[run.segments + 3 * e + 2]
        for a in range(KEPT):
            total = 0.0
            for side in range(2):
                at = pools.fixed_int[run.segments + 3 * e + side]
                metric = pools.fixed[run.metric + at : run.metric + at + size]
                new = work[run.changes + at : run.changes + at + size]
                old = work[run.changes + a * n + at : run.changes + a * n + at + size]
                for j in range(size):
                    total += metric[j] * new[j] * old[j]
            work[part + a] = total
    exchange_parts(pools)
    add_parts(pools, 0, KEPT)
    for a in range(KEPT):
        products[a], products[a * KEPT] = work[run.totals + a], work[run.totals + a]


@kernel
def _fitted(pools: Any, x: Array) -> float:
    """Coefficients x (ORDER,) of the fit, and its misfit; infinite where nothing changes, or where the expected change
    is too long."""
    run, work = pools.run[0], pools.moving
    products, scratch = work[run.change_products :], work[run.fit + ORDER :]
    gram, right = scratch[: ORDER * ORDER], scratch[ORDER * ORDER : ORDER * (ORDER + 1)]
    for a in range(ORDER):
        right[a] = products[a + 1]
        for b in range(ORDER):
            gram[a * ORDER + b] = products[(a + 1) * KEPT + b + 1]
    least_squares(gram, ORDER, right, ORDER, scratch[ORDER * (ORDER + 1) :], x)
    whole = products[0]
    misfit = products[0]
    length = 0.0
    for a in range(ORDER):
        misfit -= 2.0 * x[a] * right[a]
        for b in range(ORDER):
            misfit += x[a] * x[b] * gram[a * ORDER + b]
            length += x[a] * x[b] * products[a * KEPT + b]
    if not (whole > 0.0 and length <= GROWTH * GROWTH * whole):
        return np.inf
    return float(np.sqrt(max(misfit, EXACT * whole) / whole))
