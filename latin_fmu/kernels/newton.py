"""Semi-smooth Newton step on the relative operator of the interfaces at one instant.

Where a step is long the condensed operator of an instant is of long range: the iteration settles points that slip or
open one after the other. With tractions F on sides E and -F on E', the velocities of both sides follow from the
admittances D of their substructures, and with A the sum of these admittances over both sides the opening velocity and
the local stage read

    d = d_0 - A F,    F = T(d + z F),    T: the laws at the points (``laws``), z = 1/k summed over the sides

Newton's method on this equation takes the tangent J of the laws (Alart and Curnier 1991; Christensen, Klarbring, Pang
and Stroemberg 1998), with u the change of d + z F and rho = F - F_hat the residual,

    dF = -rho + J u,    u = z dF - A dF:      J = sum of columns c_i and rows r_i of rank one / (z_i + s_i)
    [r_i . A c_j + s_i delta_ij] y_j = -z_i r_i . rho + r_i . A rho,      dF = -rho + sum of c_i y_i

with three unknowns y at a point that sticks, two at one that slips (the traction along the direction of slip follows
from the pressure, so that the friction law needs no outer fixed point, whatever mu is; cf. the bipotential of De Saxce
and Feng 1998) and none at one that is open. The block of the active points is factorised directly (``envelope``), on
large interfaces solved by products alone (``krylov``).
Points that several interfaces hold make it singular: a share ``proximal`` of z is added to the diagonal of rows of
normal and sticking components. The solution does not change by that, as the right-hand side is the true residual.

The step is made in the incoming quantity q = F + k W and halved at most twice, until the residual of the local stage in
the norm of the iteration falls; both stages are linear between its ends, so that this takes no products. Without
inertia a floating body has no admittance. There D is that on dashpots of WEAK times k: the linear stage, which has the
last word, corrects what this leaves. Only products with D (``admit``) and blocks of its entries (``coupling``) occur.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from .acceleration import next_iterate
from .envelope import PANEL, TILE, factorise, place_rows, substitute
from .krylov import add_columns, admit, solve_by_products, widen
from .laws import tangent
from .local_stage import finish, outgoing, prepare, solve_points
from .products import entry_of, symmetric_size

Array = NDArray[np.float64]

COLD, WARM, LATE = 6, 3, 9
"""Iterations before the first step; the same where the instant before ended with one; iterations after which a step is
made however close the tolerance is."""
FAR = 10.0
"""Distance from the tolerances from which on a step is made after COLD iterations."""
STEPS = 40
"""Steps at one instant at most."""
HALVINGS, DECREASE = 2, 0.1
"""Halvings of a step; share of the linear decrease of the residual that a step has to give."""
SLOW, LITTLE = 6, 0.02
"""Steps in a row that decrease the residual by less than a share LITTLE, after which the method is left."""
GAIN = 0.1
"""Share of the distance from the tolerances at the first step that an iterate has to be below for the acceleration to
go on from it where the method is left: a step may have moved floating bodies far."""
SINGULAR = 1e-14
"""Smallest over largest pivot below which no step is made."""
MADE, ACTIVE, SIZE, WITHOUT, LEFT, PHASE, BEGUN = range(7)
"""Numbers of ``course``: steps made, 1 while the next iterate is a Newton step, residual of the last trial, steps in a
row without decrease, 1 where the method was left, iteration from which on the acceleration has its differences,
distance from the tolerances at the first step; then the residual of a trial of the Python driver."""
SCRATCH = PANEL * (TILE + 1) + 2
"""Numbers of scratch of the elimination."""


@kernel
def coupling(pools: Any, p: int, q: int, block: Array) -> bool:
    """block (3, 3) = entries of A between the components of the points p and q; False where they share no body."""
    run, fixed_int = pools.run[0], pools.fixed_int
    gp, gq = pools.groups[fixed_int[run.point_group + p]], pools.groups[fixed_int[run.point_group + q]]
    at_p = gp.start + fixed_int[run.point_number + p] * gp.n_component
    at_q = gq.start + fixed_int[run.point_number + q] * gq.n_component
    owner, place = fixed_int[run.owner : run.owner + run.n_flat], fixed_int[run.live_row : run.live_row + run.n_flat]
    block[:] = 0.0
    coupled = False
    for side in range(2):
        first = at_p + side * gp.n_point * gp.n_component
        for other in range(2):
            second = at_q + other * gq.n_point * gq.n_component
            if owner[first] < 0 or owner[first] != owner[second]:
                continue
            coupled = True
            row = pools.classes[fixed_int[run.owner_class + first]]
            weight = pools.fixed[run.area + second] if side == other else -pools.fixed[run.area + second]
            n, plain, m = row.n_live, row.plain_response, row.m
            table = pools.fixed[row.admittance : row.admittance + symmetric_size(n, plain, m)]
            for a in range(gp.n_component):
                i = place[first + a]
                if i < 0:
                    continue
                for b in range(gq.n_component):
                    j = place[second + b]
                    if j >= 0:
                        block[3 * a + b] += weight * entry_of(n, table, plain, m, i, j)
    return coupled


@kernel
def activate(pools: Any) -> int:
    """Unknowns at the points by the state of the last local stage: columns, rows, diagonal and right-hand side; their
    number."""
    run, work, numbers = pools.run[0], pools.moving, pools.moving_int
    unknown_of, f_hat = (
        numbers[run.unknown_of : run.unknown_of + run.n_point + 1],
        work[run.local_f : run.local_f + run.n_flat],
    )
    f, z = work[run.f : run.f + run.n_flat], pools.fixed[run.newton_z : run.newton_z + run.n_flat]
    block_start = numbers[run.unknown_start : run.unknown_start + run.n_block + 1]
    block_points = pools.fixed_int[run.block_points : run.block_points + run.n_block + 1]
    count, b = 0, 0
    for p in range(run.n_point):
        while p == block_points[b]:
            block_start[b] = count
            b += 1
        unknown_of[p] = count
        g, at = pools.fixed_int[run.point_group + p], pools.fixed_int[run.point_number + p]
        group = pools.groups[g]
        h, n_parameter = group.n_component, group.n_parameter
        width = h if group.elastic == 1 else 1
        columns, rows = (
            work[run.columns + 3 * count : run.columns + 3 * (count + 3)],
            work[run.rows + 3 * count : run.rows + 3 * (count + 3)],
        )
        softness = work[run.softness + 3 * count : run.softness + 3 * (count + 3)]
        z_sum = pools.fixed[group.newton_z_sum + 2 * at : group.newton_z_sum + 2 * at + 2]
        made = tangent(
            group.law,
            work[group.jump + at * h : group.jump + (at + 1) * h],
            z_sum,
            work[group.reach + at * width : group.reach + (at + 1) * width],
            run.layer_rate if group.elastic == 1 else 1.0 / run.dt,
            pools.fixed[group.parameters + at * n_parameter : group.parameters + (at + 1) * n_parameter],
            work[group.tangent + at * 9 : group.tangent + at * 9 + 9] if group.law < 0 else softness,
            run.proximal,
            columns,
            rows,
            softness,
        )
        first = group.start + at * h
        second = first + group.n_point * h
        for i in range(made):
            total = 0.0
            for a in range(h):
                rest = z[first + a] * f[first + a] - z[second + a] * f[second + a] - z_sum[min(a, 1)] * f_hat[first + a]
                total -= rows[3 * i + a] * rest
            work[run.unknowns + count + i] = total
        count += made
    while b <= run.n_block:
        block_start[b] = count
        b += 1
    unknown_of[run.n_point] = count
    return count


@kernel
def add_relative(pools: Any, v: Array) -> None:
    """Add r_i . (v' - v) of the velocities v (N,) to the right-hand side."""
    run, work = pools.run[0], pools.moving
    unknown_of = pools.moving_int[run.unknown_of : run.unknown_of + run.n_point + 1]
    for p in range(run.n_point):
        group = pools.groups[pools.fixed_int[run.point_group + p]]
        h = group.n_component
        first = group.start + pools.fixed_int[run.point_number + p] * h
        second = first + group.n_point * h
        for i in range(unknown_of[p], unknown_of[p + 1]):
            for a in range(h):
                work[run.unknowns + i] += work[run.rows + 3 * i + a] * (v[second + a] - v[first + a])


@kernel
def assemble(pools: Any) -> int:
    """Matrix of the active points in its envelope, but for ``soften``; its size."""
    run, work, numbers = pools.run[0], pools.moving, pools.moving_int
    unknown_of = numbers[run.unknown_of : run.unknown_of + run.n_point + 1]
    start = numbers[run.unknown_start : run.unknown_start + run.n_block + 1]
    low = pools.fixed_int[run.block_low : run.block_low + run.n_block]
    high = pools.fixed_int[run.block_high : run.block_high + run.n_block]
    points = pools.fixed_int[run.block_points : run.block_points + run.n_block + 1]
    row_at = numbers[run.row_at : run.row_at + run.n_unknown]
    size = place_rows(run.n_block, start, low, high, row_at)
    matrix = work[run.matrix : run.matrix + size]
    columns, rows = work[run.columns : run.columns + 3 * run.n_unknown], work[run.rows : run.rows + 3 * run.n_unknown]
    block = work[run.block : run.block + 9]
    matrix[:] = 0.0
    for b in range(run.n_block):
        for p in range(points[b], points[b + 1]):
            if unknown_of[p] == unknown_of[p + 1]:
                continue
            for q in range(points[low[b]], points[high[b] + 1]):
                if unknown_of[q] == unknown_of[q + 1] or not coupling(pools, p, q, block):
                    continue
                for i in range(unknown_of[p], unknown_of[p + 1]):
                    r0, r1, r2 = rows[3 * i], rows[3 * i + 1], rows[3 * i + 2]
                    x = r0 * block[0] + r1 * block[3] + r2 * block[6]
                    y = r0 * block[1] + r1 * block[4] + r2 * block[7]
                    w = r0 * block[2] + r1 * block[5] + r2 * block[8]
                    for j in range(unknown_of[q], unknown_of[q + 1]):
                        matrix[row_at[i] + j] = x * columns[3 * j] + y * columns[3 * j + 1] + w * columns[3 * j + 2]
    return size


@kernel
def soften(pools: Any) -> None:
    """Add what the unknowns of a point add to the matrix among themselves."""
    run, work, numbers = pools.run[0], pools.moving, pools.moving_int
    unknown_of = numbers[run.unknown_of : run.unknown_of + run.n_point + 1]
    row_at = numbers[run.row_at : run.row_at + run.n_unknown]
    for p in range(run.n_point):
        for i in range(unknown_of[p], unknown_of[p + 1]):
            for j in range(unknown_of[p], unknown_of[p + 1]):
                work[run.matrix + row_at[i] + j] += work[run.softness + 3 * i + j - unknown_of[p]]


@kernel
def solve_active(pools: Any) -> bool:
    """Unknowns from their right-hand side; False where the matrix is singular."""
    run, work, numbers = pools.run[0], pools.moving, pools.moving_int
    start = numbers[run.unknown_start : run.unknown_start + run.n_block + 1]
    low = pools.fixed_int[run.block_low : run.block_low + run.n_block]
    high = pools.fixed_int[run.block_high : run.block_high + run.n_block]
    row_at = numbers[run.row_at : run.row_at + run.n_unknown]
    pivots = numbers[run.pivots : run.pivots + run.n_unknown]
    matrix = work[run.matrix : run.matrix + run.n_matrix]
    scratch = work[run.elimination : run.elimination + SCRATCH]
    if not factorise(run.n_block, start, low, high, row_at, matrix, pivots, scratch) > SINGULAR:
        return False
    substitute(run.n_block, start, low, high, row_at, matrix, pivots, work[run.unknowns : run.unknowns + run.n_unknown])
    return True


@kernel
def propose(pools: Any) -> bool:
    """Ends of a Newton step: q and W of the last iterate are kept, the new q is that of the full step; False where the
    matrix is singular."""
    if pools.run[0].krylov == 1:
        widen(pools)
    admit_residual(pools)
    if not change_tractions(pools, active_matrix(pools)):
        return False
    full_step(pools)
    return True


@kernel
def admit_residual(pools: Any) -> None:
    """Velocities that the residual of the tractions alone gives, into ``step_w``."""
    run, work = pools.run[0], pools.moving
    n = run.n_flat
    x, v = work[run.step_f : run.step_f + n], work[run.step_w : run.step_w + n]
    for j in range(n):
        x[j] = work[run.local_f + j] - work[run.f + j]
    admit(pools, x, v)


@kernel
def active_matrix(pools: Any) -> int:
    """Unknowns of the step, their right-hand side and matrix; size of the matrix (with ``krylov``, which has none, the
    number of unknowns), 0 where there are none."""
    run = pools.run[0]
    count = activate(pools)
    if count == 0:
        return 0
    add_relative(pools, pools.moving[run.step_w : run.step_w + run.n_flat])
    return count if run.krylov == 1 else assemble(pools)


@kernel
def change_tractions(pools: Any, size: int) -> bool:
    """Change of the tractions in the step into ``step_f``, and the velocities that it gives; ``size`` from
    ``active_matrix``. False where the matrix is singular."""
    run, work = pools.run[0], pools.moving
    n = run.n_flat
    x, v = work[run.step_f : run.step_f + n], work[run.step_w : run.step_w + n]
    if size > 0 and run.krylov == 1:
        if not solve_by_products(pools, size):
            return False
        for j in range(n):
            x[j] = work[run.local_f + j] - work[run.f + j]
    elif size > 0:
        soften(pools)
        if not solve_active(pools):
            return False
    count = pools.moving_int[run.unknown_of + run.n_point]
    add_columns(pools, work[run.unknowns : run.unknowns + count], x)
    admit(pools, x, v)
    return True


@kernel
def full_step(pools: Any) -> None:
    """Keep q and W of the last iterate; q of the full step."""
    run, work = pools.run[0], pools.moving
    n = run.n_flat
    x, v = work[run.step_f : run.step_f + n], work[run.step_w : run.step_w + n]
    f, q = work[run.f : run.f + n], work[run.q : run.q + n]
    w, k = work[run.w : run.w + n], pools.fixed[run.k : run.k + n]
    kept_q, kept_w = work[run.old_q : run.old_q + n], work[run.old_w : run.old_w + n]
    size, r, metric = 0.0, work[run.r : run.r + n], pools.fixed[run.metric : run.metric + n]
    for j in range(n):
        size += metric[j] * r[j] * r[j]
        kept_q[j], kept_w[j] = q[j], w[j]
        q[j] = f[j] + x[j] + k[j] * (w[j] + v[j])
    work[run.course + SIZE] = np.sqrt(size)


@kernel
def keep_end(pools: Any) -> None:
    """Keep q and W at the end of the full step."""
    run, work = pools.run[0], pools.moving
    for j in range(run.n_flat):
        work[run.new_q + j], work[run.new_w + j] = work[run.q + j], work[run.w + j]


@kernel
def trial_fields(pools: Any, length: float) -> None:
    """Fields of the linear stage at a share of the step."""
    run, work = pools.run[0], pools.moving
    n = run.n_flat
    q, w = work[run.q : run.q + n], work[run.w : run.w + n]
    old_q, old_w = work[run.old_q : run.old_q + n], work[run.old_w : run.old_w + n]
    new_q, new_w = work[run.new_q : run.new_q + n], work[run.new_w : run.new_w + n]
    for j in range(n):
        q[j] = old_q[j] + length * (new_q[j] - old_q[j])
        w[j] = old_w[j] + length * (new_w[j] - old_w[j])
    for g in range(len(pools.groups)):
        outgoing(pools, g, 0, 0, pools.groups[g].n_point)


@kernel
def trial_size(pools: Any) -> float:
    """Residual of the local stage of a trial in the norm of the iteration."""
    run, work = pools.run[0], pools.moving
    n = run.n_flat
    q, k, metric = work[run.q : run.q + n], pools.fixed[run.k : run.k + n], pools.fixed[run.metric : run.metric + n]
    f_hat, w_hat = work[run.local_f : run.local_f + n], work[run.local_w : run.local_w + n]
    size = 0.0
    for j in range(n):
        rest = f_hat[j] + k[j] * w_hat[j] - q[j]
        size += metric[j] * rest * rest
    return float(np.sqrt(size))


@kernel
def try_length(pools: Any, length: float) -> float:
    """Both stages at a share of the step; its residual."""
    trial_fields(pools, length)
    for g in range(len(pools.groups)):
        n_point = pools.groups[g].n_point
        prepare(pools, g, 0, 0, n_point)
        solve_points(pools, g, 0, n_point)
        finish(pools, g, 0, 1, 0, n_point)
    return trial_size(pools)


@kernel
def search(pools: Any) -> None:
    """Halve the step until the residual falls enough, at most HALVINGS times; the best trial is the iterate."""
    course = pools.moving[pools.run[0].course : pools.run[0].course + 8]
    before, best, best_length, length, last = course[SIZE], np.inf, 1.0, 1.0, 1.0
    for _ in range(HALVINGS + 1):
        last = length
        size = try_length(pools, length)
        if size < best:
            best, best_length = size, length
        if size <= (1.0 - DECREASE * length) * before:
            break
        length *= 0.5
    if last != best_length:
        try_length(pools, best_length)
    count_step(pools, best)


@kernel
def count_step(pools: Any, size: float) -> None:
    """Count a step with this residual at its end."""
    course = pools.moving[pools.run[0].course : pools.run[0].course + 8]
    course[MADE] += 1.0
    course[WITHOUT] = course[WITHOUT] + 1.0 if size > (1.0 - LITTLE) * course[SIZE] else 0.0


@kernel
def leave(pools: Any, iteration: int) -> None:
    """Go back to the iterate before the first step, or to a much better one, and to the acceleration, which begins
    anew with this iteration."""
    run, work = pools.run[0], pools.moving
    course = work[run.course : run.course + 8]
    course[ACTIVE], course[LEFT], course[PHASE] = 0.0, 1.0, float(iteration)
    for j in range(run.n_flat):
        work[run.q + j] = work[run.best_q + j]


@kernel
def continues(pools: Any, iteration: int) -> bool:
    """Whether the next iterate is that of a Newton step, or the best one where the method is left; decided after the
    verdict on this iterate. Acceleration goes on where at its present rate it ends within two iterations."""
    run, work = pools.run[0], pools.moving
    course, merits = work[run.course : run.course + 8], work[run.merits : run.merits + 2 * (iteration + 1)]
    if run.newton == 0 or course[LEFT] == 1.0:
        return False
    if course[ACTIVE] == 1.0:
        if course[MADE] >= STEPS or course[WITHOUT] >= SLOW:
            leave(pools, iteration + 1)
        return True
    count, warm = iteration + 1, work[run.finish] == 1.0
    if count < (WARM if warm else COLD):
        return False
    ratio = work[run.measure + 5]
    now, past = merits[2 * iteration + 1], merits[2 * iteration - 3]
    now = now if np.isfinite(now) else ratio * merits[2 * iteration]
    past = past if np.isfinite(past) else ratio * merits[2 * iteration - 4]
    if not warm and now <= FAR and count < LATE:
        return False
    if now * now <= past:
        return False
    course[ACTIVE], course[BEGUN] = 1.0, now
    return True


@kernel
def advance_iterate(pools: Any, window: int, iteration: int, phase: int) -> None:
    """Next q after an iterate that has not converged: by the acceleration, or left to a Newton step. ``phase``: the
    iteration from which on the acceleration has its differences."""
    if window == 1 and continues(pools, iteration):
        return
    start = max(phase, int(pools.moving[pools.run[0].course + PHASE])) if window == 1 else phase
    next_iterate(pools, window, iteration - start)
