"""Unknowns of a Newton step at the active points of the interfaces, and their matrix (``newton``).

The points are numbered block after block as the interfaces are coupled, those of all processes of a run. A process has
the columns and rows of the points of the interfaces it holds, and adds what its substructures contribute to the matrix;
the others receive the numbers of unknowns of its points (``elsewhere``). Contributions of a point alone are added where
its interface is owned.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from ..laws.dispatch import tangent
from ..laws.parts import Unknowns
from .callouts import TANGENTS, call_out
from .envelope import PANEL, TILE, factorise, place_rows, substitute
from .local_stage import point_state
from .products import entry_of, symmetric_size

Array = NDArray[np.float64]

SINGULAR = 1e-14
"""Smallest over largest pivot below which no step is made."""
SCRATCH = PANEL * (TILE + 1) + 2
"""Numbers of scratch of the elimination."""


@kernel
def channels_of(pools: Any, p: int) -> tuple[int, int]:
    """First channels of the two sides of a point."""
    run = pools.run[0]
    group = pools.groups[pools.fixed_int[run.point_group + p]]
    first = group.start + pools.fixed_int[run.point_number + p] * group.n_component
    return first, first + group.n_point * group.n_component


@kernel
def coupling(pools: Any, p: int, q: int, block: Array) -> bool:
    """block (3, 3) = entries of A between the components of the points p and q; False where they share no body."""
    run, fixed_int = pools.run[0], pools.fixed_int
    if fixed_int[run.point_group + q] < 0:
        return False
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
            if owner[first] < 0 or owner[first] != owner[second]:  # another body, or ground
                continue
            coupled = True
            row = pools.classes[fixed_int[run.owner_class + first]]
            # A acts on the jump: plus from the same sides, minus across
            weight = pools.fixed[run.area + second] if side == other else -pools.fixed[run.area + second]
            n = row.n_live
            plain = row.plain_response
            m = row.m
            table = pools.fixed[row.admittance : row.admittance + symmetric_size(n, plain, m)]
            for a in range(gp.n_component):
                i = place[first + a]
                # the channel cannot move
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
        numbers[run.unknown_of : run.unknown_of + run.n_place + 1],
        work[run.local_f : run.local_f + run.n_flat],
    )
    f, z = work[run.f : run.f + run.n_flat], pools.fixed[run.newton_z : run.newton_z + run.n_flat]
    block_start = numbers[run.unknown_start : run.unknown_start + run.n_block + 1]
    block_points = pools.fixed_int[run.block_points : run.block_points + run.n_block + 1]
    for g in range(len(pools.groups)):
        if pools.groups[g].law < 0:
            call_out(pools, TANGENTS, g, 0, 0)
    count, b = 0, 0
    for p in range(run.n_place):
        while p == block_points[b]:  # blocks without points begin at the same one
            block_start[b] = count
            b += 1
        unknown_of[p] = count
        if pools.fixed_int[run.point_group + p] < 0:  # of an interface between other processes
            for i in range(numbers[run.elsewhere + p]):  # added by their process
                work[run.unknowns + count + i] = 0.0
            count += numbers[run.elsewhere + p]
            continue
        g, at = pools.fixed_int[run.point_group + p], pools.fixed_int[run.point_number + p]
        group = pools.groups[g]
        h = group.n_component
        columns = work[run.columns + 3 * count : run.columns + 3 * (count + 3)]
        rows = work[run.rows + 3 * count : run.rows + 3 * (count + 3)]
        softness = work[run.softness + 3 * count : run.softness + 3 * (count + 3)]
        point = point_state(pools, g, at, group.newton_z_sum)
        derivative = work[group.tangent + at * 9 : group.tangent + at * 9 + 9] if group.law < 0 else softness
        n_unknown = tangent(group.law, point, derivative, Unknowns(columns, rows, softness, run.proximal))
        first, second = channels_of(pools, p)
        for i in range(n_unknown):
            total = 0.0
            for a in range(h):
                # F and F' of the linear stage are not opposite yet: z rho of each side by its own
                rest = z[first + a] * f[first + a] - z[second + a] * f[second + a]
                total -= rows[3 * i + a] * (rest - point.z[min(a, 1)] * f_hat[first + a])
            work[run.unknowns + count + i] = total
        count += n_unknown
    while b <= run.n_block:  # blocks without points behind the last one
        block_start[b] = count
        b += 1
    unknown_of[run.n_place] = count
    return count


@kernel
def add_relative(pools: Any, v: Array) -> None:
    """Add r_i . (v' - v) of the velocities v (N,) to the right-hand side."""
    run, work = pools.run[0], pools.moving
    unknown_of = pools.moving_int[run.unknown_of : run.unknown_of + run.n_place + 1]
    for p in range(run.n_place):
        if pools.fixed_int[run.point_group + p] < 0:
            continue
        first, second = channels_of(pools, p)
        for i in range(unknown_of[p], unknown_of[p + 1]):
            for a in range(pools.groups[pools.fixed_int[run.point_group + p]].n_component):
                work[run.unknowns + i] += work[run.rows + 3 * i + a] * (v[second + a] - v[first + a])


@kernel
def assemble(pools: Any) -> int:
    """Matrix of the active points in its envelope, but for ``soften``, by the substructures here; its size."""
    run = pools.run[0]
    work = pools.moving
    numbers = pools.moving_int
    unknown_of = numbers[run.unknown_of : run.unknown_of + run.n_place + 1]
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
            # nothing to add: it has no unknowns, or no substructure here
            if unknown_of[p] == unknown_of[p + 1] or pools.fixed_int[run.point_group + p] < 0:
                continue
            for q in range(points[low[b]], points[high[b] + 1]):
                if unknown_of[q] == unknown_of[q + 1] or not coupling(pools, p, q, block):
                    continue
                for i in range(unknown_of[p], unknown_of[p + 1]):
                    # r_i . A of one pair of points, then its product with each c_j
                    r0 = rows[3 * i]
                    r1 = rows[3 * i + 1]
                    r2 = rows[3 * i + 2]
                    x = r0 * block[0] + r1 * block[3] + r2 * block[6]
                    y = r0 * block[1] + r1 * block[4] + r2 * block[7]
                    w = r0 * block[2] + r1 * block[5] + r2 * block[8]
                    for j in range(unknown_of[q], unknown_of[q + 1]):
                        # a pair of points once: both sides are in ``block``
                        matrix[row_at[i] + j] = x * columns[3 * j] + y * columns[3 * j + 1] + w * columns[3 * j + 2]
    return size


@kernel
def soften(pools: Any) -> None:
    """Add what the unknowns of the points owned here add to the matrix among themselves."""
    run = pools.run[0]
    work = pools.moving
    numbers = pools.moving_int
    unknown_of = numbers[run.unknown_of : run.unknown_of + run.n_place + 1]
    row_at = numbers[run.row_at : run.row_at + run.n_unknown]
    for p in range(run.n_place):
        if pools.fixed_int[run.point_owned + p] == 0:
            continue
        for i in range(unknown_of[p], unknown_of[p + 1]):
            for j in range(unknown_of[p], unknown_of[p + 1]):
                work[run.matrix + row_at[i] + j] += work[run.softness + 3 * i + j - unknown_of[p]]


@kernel
def sum_of_tangents(pools: Any) -> float:
    """Sum of the columns, rows and softness of the points owned here, a sign that the active points are others."""
    run = pools.run[0]
    work = pools.moving
    numbers = pools.moving_int
    total = 0.0
    for p in range(run.n_place):
        if pools.fixed_int[run.point_owned + p] == 1:
            for i in range(3 * numbers[run.unknown_of + p], 3 * numbers[run.unknown_of + p + 1]):
                total += work[run.columns + i] + work[run.rows + i] + work[run.softness + i]
    return float(total)


@kernel
def is_factored(pools: Any, count: int) -> bool:
    """Whether the factors at hand are those of the matrix of these ``count`` unknowns, which follows from the numbers
    of unknowns of the points and from columns, rows and softness; if not, these are kept to compare with."""
    run = pools.run[0]
    work = pools.moving
    numbers = pools.moving_int
    same, width = work[run.factored] == 1.0 and run.shared == 0, 3 * run.n_unknown + 9
    for p in range(run.n_place + 1):
        same = same and numbers[run.factored_of + p] == numbers[run.unknown_of + p]
    for kind in range(3):
        at = run.columns if kind == 0 else run.rows if kind == 1 else run.softness
        # to the bit: any other matrix has other factors
        for i in range(3 * count if same else 0):
            same = same and work[run.factored_tangents + kind * width + i] == work[at + i]
    if same:
        return True
    work[run.factored] = 0.0
    for p in range(run.n_place + 1):
        numbers[run.factored_of + p] = numbers[run.unknown_of + p]
    for kind in range(3):
        at = run.columns if kind == 0 else run.rows if kind == 1 else run.softness
        for i in range(3 * count):
            work[run.factored_tangents + kind * width + i] = work[at + i]
    return False


@kernel
def solve_active(pools: Any) -> bool:
    """Unknowns from their right-hand side; False where the matrix is singular."""
    run = pools.run[0]
    work = pools.moving
    numbers = pools.moving_int
    start = numbers[run.unknown_start : run.unknown_start + run.n_block + 1]
    low = pools.fixed_int[run.block_low : run.block_low + run.n_block]
    high = pools.fixed_int[run.block_high : run.block_high + run.n_block]
    row_at = numbers[run.row_at : run.row_at + run.n_unknown]
    pivots = numbers[run.pivots : run.pivots + run.n_unknown]
    matrix = work[run.matrix : run.matrix + run.n_matrix]
    scratch = work[run.elimination : run.elimination + SCRATCH]
    if work[run.factored] == 0.0:
        if not factorise(run.n_block, start, low, high, row_at, matrix, pivots, scratch) > SINGULAR:
            return False
        work[run.factored] = 1.0 - run.shared  # what other processes add to the matrix is not compared
    substitute(run.n_block, start, low, high, row_at, matrix, pivots, work[run.unknowns : run.unknowns + run.n_unknown])
    return True
