"""Newton step without inertia, on the iteration itself: GMRES with products of the linear stage (``newton``).

Without inertia a floating body has no admittance D, and a matrix of the active points would be one of all bodies. One
iteration maps q to q' = F_hat + k W_hat. With the tangents J of the laws at the iterate and Y of the linear stage, the
coarse problem included, a change x of q changes q' by G x:

    w = Y area x,    f = x - k w,    s = w - z f,        both sides of every point
    f_hat = J (s' - s),    G x = f_hat + k (s + z f_hat)

and Newton's method on q' = q takes the change x with (I - G) x = q' - q. The linear stage is a reflection of q in the
norm sum area / k q^2 and the tangents of the laws do not expand in it, so that the spectrum of I - G is on the right of
the origin: the generalised minimal residual method (Saad and Schultz 1986) in that norm needs no preconditioner. A
product costs an iteration without its local stage. A share of the residual is left to the next step: AT_FIRST, then the
square of the share that the last step left, within limits (inexact Newton method, Eisenstat and Walker 1996).

Sums are taken over each interface first, so that they are the same on any number of processes (``sums``).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from .callouts import TANGENTS, call_out
from .krylov import SMALL, VECTORS, combine, turn
from .linear_stage import respond_to_change
from .local_stage import POINT, add_tangent_at
from .sums import add_parts, exchange_parts

Array = NDArray[np.float64]

AT_FIRST = 0.03
LEAST = 0.01
LARGEST = 0.1
"""Residual over that at the start of a step which ends it: at the first one, least and largest."""


@kernel
def inner(pools: Any, x: Array, y: Array) -> float:
    """Sum of metric x y over the channels of all interfaces."""
    run, work = pools.run[0], pools.moving
    for e in range(run.n_interface):
        total, size = 0.0, pools.fixed_int[run.segments + 3 * e + 2]
        for side in range(2):
            at = pools.fixed_int[run.segments + 3 * e + side]
            metric = pools.fixed[run.metric + at : run.metric + at + size]
            own_x, own_y = x[at : at + size], y[at : at + size]
            for j in range(size):
                total += metric[j] * own_x[j] * own_y[j]
        work[run.own_parts + e * run.part_width] = total
    exchange_parts(pools)
    add_parts(pools, 0, 1)
    return float(work[run.totals])


@kernel
def take_tangents(pools: Any) -> None:
    """Derivatives of F_hat by the jump at all points, for the jumps of the last local stage."""
    run, work = pools.run[0], pools.moving
    scratch = work[run.krylov_work + SMALL : run.krylov_work + SMALL + POINT]
    for g in range(len(pools.groups)):
        group = pools.groups[g]
        if group.law < 0:
            call_out(pools, TANGENTS, g, 0, 0)
            continue
        work[group.tangent : group.tangent + 9 * group.n_point] = 0.0
        for p in range(group.n_point):
            add_tangent_at(pools, g, p, scratch, work[group.tangent + 9 * p : group.tangent + 9 * p + 9])


@kernel
def multiply(pools: Any, x: Array, out: Array) -> None:
    """out = (I - G) x, both (N,); the fields of the linear stage are those of the change then."""
    respond_to_change(pools, x)
    run, work = pools.run[0], pools.moving
    for g in range(len(pools.groups)):
        group = pools.groups[g]
        h, first = group.n_component, group.start
        second, line = first + group.n_point * h, 3 if group.law < 0 else h  # a law in Python writes (3, 3)
        for p in range(group.n_point):
            at = p * h
            for a in range(h):
                change = 0.0
                for b in range(h):
                    jump = work[run.s + second + at + b] - work[run.s + first + at + b]
                    change += work[group.tangent + 9 * p + line * a + b] * jump
                for side in range(2):
                    j = first + at + a if side == 0 else second + at + a
                    k, z = pools.fixed[run.k + j], pools.fixed[run.z + j]
                    traction = change if side == 0 else -change
                    out[j] = x[j] - traction - k * (work[run.s + j] + z * traction)


@kernel
def expand(pools: Any, rest: float, enough: float) -> int:
    """Arnoldi vectors from the first one of ``basis`` on, until the residual ``rest`` is at most ``enough``; their
    number. Their coefficients are in the first numbers of ``krylov_work`` (``krylov.turn``)."""
    run, work = pools.run[0], pools.moving
    n, width = run.n_flat, VECTORS + 1
    small = work[run.krylov_work : run.krylov_work + SMALL]
    small[(VECTORS + 2) * width] = rest
    for k in range(VECTORS):
        new = work[run.basis + (k + 1) * n : run.basis + (k + 2) * n]
        multiply(pools, work[run.basis + k * n : run.basis + (k + 1) * n], new)
        for e in range(k + 1):
            other = work[run.basis + e * n : run.basis + (e + 1) * n]
            total = inner(pools, other, new)
            small[k * width + e] = total
            for i in range(n):
                new[i] -= total * other[i]
        below = np.sqrt(inner(pools, new, new))
        for i in range(n):
            new[i] /= max(below, 1e-300)  # 0: the solution lies in the vectors so far
        if not turn(small, k, below, VECTORS) > enough:  # ends for NaN, too
            return k + 1
    return VECTORS


@kernel
def step_on_iteration(pools: Any, size: float, before: float) -> bool:
    """q of the full step from that at its start in ``old_q`` and the residual ``r`` there, of this ``size``; ``before``
    the last step it was that, 0 at the first one. False where q is not a number."""
    run, work = pools.run[0], pools.moving
    n = run.n_flat
    if not size > 0.0:
        return False
    take_tangents(pools)
    for j in range(n):
        work[run.basis + j] = work[run.r + j] / size
    share = AT_FIRST if before == 0.0 else min(max((size / before) ** 2, LEAST), LARGEST)
    used = expand(pools, size, share * size)
    small, q = work[run.krylov_work : run.krylov_work + SMALL], work[run.q : run.q + n]
    combine(small, used, VECTORS)
    for j in range(n):
        q[j] = work[run.old_q + j]
    for k in range(used):
        vector, factor = work[run.basis + k * n : run.basis + (k + 1) * n], small[(VECTORS + 2) * (VECTORS + 1) + k]
        for j in range(n):
            q[j] += factor * vector[j]
    return bool(np.isfinite(inner(pools, q, q)))
