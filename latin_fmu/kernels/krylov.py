"""Newton step on large interfaces by products alone: GMRES on the unknowns of the active points (``newton``).

The matrix of the active points would be dense: 200 MB at 1,700 points, and its factors minutes of work. Its product

    M y = r_i . A (sum of c_j y_j) + s_ij y_j

takes one product with the admittances D, which a swept class has by two substitutions on its face. The generalised
minimal residual method (Saad and Schultz 1986) is preconditioned from the left by the tied assembly (``tied``). Its
residual is a traction then, close to the error of the solution; that of M y alone is a velocity, of which a motion of a
whole face takes thousands of times as much as a point. With the diagonal r_i . z c_i + s_ii, z being that of A, where
the tied assembly is too large, it is between both, and the tolerance smaller.

The laws are taken with a larger z here: the solution is the same for every z (Alart and Curnier 1991), but with a small
one points that slide back change the direction of slip step after step and never stick.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from ..laws.dispatch import apply
from .active_points import channels_of
from .half_solves import face_response, gain_of
from .local_stage import point_state
from .products import product, symmetric_size
from .splits import tile_of
from .tied import invert_diagonal, precondition

Array = NDArray[np.float64]

VECTORS, CYCLES = 100, 3
"""Products until the method begins anew, and how often it does."""
TOLERANCE, BY_DIAGONAL = 1e-4, 1e-6
"""Residual over the right-hand side, both preconditioned: by the tied assembly the least, and by the diagonal."""
SMALL = (VECTORS + 1) * (VECTORS + 3)
"""Numbers of the Hessenberg matrix, its rotations and its right-hand side."""


@kernel
def admit(pools: Any, x: Array, out: Array) -> None:
    """out (N,) = velocities D a x of the channels under tractions x (N,) alone; 0 on ground."""
    run, work = pools.run[0], pools.moving
    out[:] = 0.0
    for c in range(len(pools.classes)):
        row = pools.classes[c]
        m = row.m
        n_live = row.n_live
        size = row.n_channel * row.m
        channels, live = (
            pools.fixed_int[row.channels : row.channels + size],
            pools.fixed_int[row.live : row.live + n_live],
        )
        area = pools.fixed[row.area : row.area + row.n_channel]
        if row.swept == 1:
            force, velocity = work[row.channel : row.channel + size], work[row.answer : row.answer + size]
            gain = gain_of(row, run)
            velocity[:] = 0.0
            for i in range(row.n_channel):
                for j in range(m):
                    force[i * m + j] = gain * area[i] * x[channels[i * m + j]]
            face_response(pools, c, False, force, velocity)
            for at in range(size):
                out[channels[at]] = velocity[at]
            continue
        incoming, answer = (work[row.channel : row.channel + n_live * m], work[row.answer : row.answer + n_live * m])
        for i in range(n_live):
            for j in range(m):
                incoming[i * m + j] = area[live[i]] * x[channels[live[i] * m + j]]
        plain = row.plain_response
        table = pools.fixed[row.admittance : row.admittance + symmetric_size(n_live, plain, m)]
        product(n_live, table, plain, m, incoming, answer, tile_of(row, work))
        for i in range(n_live):
            for j in range(m):
                out[channels[live[i] * m + j]] = answer[i * m + j]


@kernel
def widen(pools: Any) -> None:
    """Free velocities and tractions of the laws with ``newton_z``, for the fields of the last linear stage."""
    run, work = pools.run[0], pools.moving
    f, f_hat = work[run.f : run.f + run.n_flat], work[run.local_f : run.local_f + run.n_flat]
    z, wide = pools.fixed[run.z : run.z + run.n_flat], pools.fixed[run.newton_z : run.newton_z + run.n_flat]
    for g in range(len(pools.groups)):
        group = pools.groups[g]
        if group.law < 0:  # its points keep their z
            continue
        h = group.n_component
        size = group.n_point * group.n_component
        jump, traction = work[group.jump : group.jump + size], work[group.traction : group.traction + size]
        first, second = group.start, group.start + size
        # s = W - z F of both sides with another z
        for j in range(size):
            a, b = first + j, second + j
            jump[j] += (wide[a] - z[a]) * f[a] - (wide[b] - z[b]) * f[b]
        for p in range(group.n_point):
            apply(group.law, point_state(pools, g, p, group.newton_z_sum), traction[p * h : (p + 1) * h])
        for j in range(size):
            f_hat[first + j], f_hat[second + j] = traction[j], -traction[j]


@kernel
def add_columns(pools: Any, y: Array, x: Array) -> None:
    """Add the tractions sum of c_i y_i to x (N,), opposite on both sides."""
    run, work = pools.run[0], pools.moving
    unknown_of = pools.moving_int[run.unknown_of : run.unknown_of + run.n_place + 1]
    for p in range(run.n_place):
        if pools.fixed_int[run.point_group + p] < 0:  # of an interface between other processes
            continue
        first, second = channels_of(pools, p)
        for i in range(unknown_of[p], unknown_of[p + 1]):
            for a in range(pools.groups[pools.fixed_int[run.point_group + p]].n_component):
                change = work[run.columns + 3 * i + a] * y[i]
                x[first + a] += change
                x[second + a] -= change


@kernel
def multiply(pools: Any, y: Array, out: Array) -> None:
    """out = M y; ``step_f`` and ``step_w`` are scratch."""
    run, work = pools.run[0], pools.moving
    x, v = work[run.step_f : run.step_f + run.n_flat], work[run.step_w : run.step_w + run.n_flat]
    x[:] = 0.0
    add_columns(pools, y, x)
    admit(pools, x, v)
    unknown_of = pools.moving_int[run.unknown_of : run.unknown_of + run.n_place + 1]
    for p in range(run.n_place):
        group = pools.groups[pools.fixed_int[run.point_group + p]]
        first, second = channels_of(pools, p)
        for i in range(unknown_of[p], unknown_of[p + 1]):
            total = 0.0
            for a in range(group.n_component):
                total += work[run.rows + 3 * i + a] * (v[first + a] - v[second + a])
            for j in range(unknown_of[p], unknown_of[p + 1]):
                total += work[run.softness + 3 * i + j - unknown_of[p]] * y[j]
            out[i] = total


@kernel
def length_of(x: Array) -> float:
    """Euclidean norm of a vector."""
    total = 0.0
    for i in range(len(x)):
        total += x[i] * x[i]
    return float(np.sqrt(total))


@kernel
def orthogonalise(basis: Array, small: Array, n: int, k: int, most: int) -> float:
    """Orthonormalise the vector k + 1 of ``basis`` (n each) to those before it, and ``turn`` its coefficients; the
    residual of the least-squares problem."""
    new, column = basis[(k + 1) * n : (k + 2) * n], small[k * (most + 1) : (k + 1) * (most + 1)]
    # modified Gram-Schmidt
    for e in range(k + 1):
        other, total = basis[e * n : (e + 1) * n], 0.0
        for i in range(n):
            total += other[i] * new[i]
        column[e] = total
        for i in range(n):
            new[i] -= total * other[i]
    below = length_of(new)
    for i in range(n):
        new[i] /= max(below, 1e-300)  # 0: the solution lies in the vectors so far
    return turn(small, k, below, most)


@kernel
def turn(small: Array, k: int, below: float, most: int) -> float:
    """Turn column k of the Hessenberg matrix, with ``below`` under its diagonal, into one of a triangle; the residual
    of the least-squares problem. ``small`` : columns of the triangle (most, most + 1), cosines and sines of the
    rotations, the right-hand side, whose first number is the residual at the start."""
    width = most + 1
    cosine = small[most * width :]
    sine = small[(most + 1) * width :]
    right = small[(most + 2) * width :]
    column = small[k * width : (k + 1) * width]
    # rotations of the columns before, then one that takes the number below the diagonal
    for e in range(k):
        upper, lower = column[e], column[e + 1]
        column[e] = cosine[e] * upper + sine[e] * lower
        column[e + 1] = cosine[e] * lower - sine[e] * upper
    size = max(np.hypot(column[k], below), 1e-300)
    cosine[k], sine[k] = column[k] / size, below / size
    column[k] = size
    right[k + 1] = -sine[k] * right[k]  # before right[k] changes
    right[k] = cosine[k] * right[k]
    return float(abs(right[k + 1]))


@kernel
def combine(small: Array, used: int, most: int) -> None:
    """Solve the triangle of the first ``used`` vectors: their coefficients, in the place of the right-hand side."""
    width, right = most + 1, small[(most + 2) * (most + 1) :]
    for k in range(used - 1, -1, -1):
        total = right[k]
        for e in range(k + 1, used):
            # columns one after the other
            total -= small[e * width + k] * right[e]
        right[k] = total / small[k * width + k]


@kernel
def expand(pools: Any, n: int, rest: float, enough: float) -> int:
    """Arnoldi vectors from the first one of ``basis`` on, until the residual ``rest`` is at most ``enough``; their
    number. The coefficients are the columns of the triangle, rotations, and the rotated right-hand side."""
    run, work = pools.run[0], pools.moving
    width = VECTORS + 1
    inverse = work[run.krylov_work + SMALL :][:n]
    scaled = work[run.krylov_work + SMALL + n :][:n]
    small = work[run.krylov_work : run.krylov_work + SMALL]
    small[(VECTORS + 2) * width] = rest
    for k in range(VECTORS):
        vector, new = work[run.basis + k * n : run.basis + (k + 1) * n], work[run.basis + (k + 1) * n :][:n]
        multiply(pools, vector, scaled)
        precondition(pools, scaled, inverse, new)
        if not orthogonalise(work[run.basis :], small, n, k, VECTORS) > enough:  # ends for NaN, too
            return k + 1
    return VECTORS


@kernel
def add_combination(pools: Any, n: int, used: int, solution: Array) -> float:
    """Add the combination of the first ``used`` vectors to the solution; residual left."""
    run, work = pools.run[0], pools.moving
    small = work[run.krylov_work : run.krylov_work + SMALL]
    right = small[(VECTORS + 2) * (VECTORS + 1) :]
    rest = abs(right[used])
    combine(small, used, VECTORS)
    for k in range(used):
        vector = work[run.basis + k * n : run.basis + (k + 1) * n]
        for i in range(n):
            solution[i] += right[k] * vector[i]
    return float(rest)


@kernel
def solve_by_products(pools: Any, n: int, share: float) -> int:
    """Solution of the n unknowns from their right-hand side, in its place, to a ``share`` of the residual; the products
    that it took, 0 where it is not a number."""
    run, work = pools.run[0], pools.moving
    scratch = work[run.krylov_work + SMALL : run.krylov_work + SMALL + 3 * n]
    inverse = scratch[:n]
    product = scratch[n : 2 * n]
    solution = scratch[2 * n :]
    right, residual = work[run.unknowns : run.unknowns + n], work[run.basis : run.basis + n]
    invert_diagonal(pools, inverse)
    precondition(pools, right, inverse, residual)
    solution[:] = 0.0
    rest, products = length_of(residual), 1
    enough = (max(share, TOLERANCE) if run.tied_super > 0 else BY_DIAGONAL) * rest
    for _ in range(CYCLES):
        if not rest > enough:  # NaN: nothing to be gained
            break
        for i in range(n):
            residual[i] /= rest
        used = expand(pools, n, rest, enough)
        products += used
        if add_combination(pools, n, used, solution) <= enough:
            break
        # the true residual, as that of the recursion has lost its digits
        multiply(pools, solution, product)
        for i in range(n):
            product[i] = right[i] - product[i]
        precondition(pools, product, inverse, residual)
        rest = length_of(residual)
    for i in range(n):
        right[i] = solution[i]
    return products if np.isfinite(length_of(solution)) else 0
