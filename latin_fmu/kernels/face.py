"""March of interface dofs without mass on a dense stiffness S of their own (``propagator.model.FaceStiffness``).

Their place is counted from r_0, that at the start, in every instant: with the predictors

    r_free = r_0,  r'_free = r' + (velocity_gain / displacement_gain) (r_0 - r - dt r')

the solution is that of the predictors of the scheme, as dofs without mass have no memory of their own, and

    S r_free = S r_0,    b S r'_free = b (S r' + (velocity_gain / displacement_gain) (S r_0 - S r - dt S r'))

need no product with S: what it is at an instant follows from the balance of the forces there,

    (displacement_gain phi + b velocity_gain) S a = load - (the squares) a,    S r = S r_0 + displacement_gain S a.

So r is a fixed linear function of the forces, S^-1 as it is stored; nothing adds up from instant to instant.

Maxwell branches (``maxwell``) act on S, and on the squares R^T R of modes row by row, each with a share of their
strength. The elongations e of a branch enter by S e alone, those of rows by R e: both follow the recursion of e, so
that they need no product either. phi = 1 + share sum_j g_j c_u.

The last rows are inertia, R = N / dt for a mass N^T N of interface dofs that modes leave out: their force is
R^T (R u - 2 R u_n + R u_n-1), which dissipates what is faster than the step, as a mass at a contact that opens and
closes must.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from .records import HALF_RATIO, OF_ELONGATION, OF_MOTION, STRENGTH
from .splits import add_squares

Array = NDArray[np.float64]


@kernel
def rows_at(row: Any) -> int:
    """Place of R u (k,) in the state, R e of the branches (n_relaxing, k) behind it."""
    return int(row.face_state + 4 * row.n_inner)


@kernel
def earlier_at(row: Any) -> int:
    """Place of R u (n_inertial,) one instant before, of the rows of inertia."""
    return forces_at(row) + int(row.n_relaxing * row.n_inner)


@kernel
def size_of_state(row: Any) -> int:
    """Numbers of the state of a class with a stiffness of the face, 0 without one."""
    if row.on_face == 0:
        return 0
    return earlier_at(row) + int(row.n_inertial) - int(row.face_state)


@kernel
def strains_at(row: Any) -> int:
    """Place of e (n_relaxing, g) of the branches of S."""
    return rows_at(row) + int((1 + row.n_relaxing) * row.n_elastic)


@kernel
def forces_at(row: Any) -> int:
    """Place of S e (n_relaxing, g)."""
    return strains_at(row) + int(row.n_relaxing * row.n_inner)


@kernel
def count_from_start(pools: Any, c: int) -> None:
    """Predictors of the interface dofs; nothing for a class without a stiffness of the face."""
    row, run = pools.classes[c], pools.run[0]
    ratio = run.velocity_gain / run.displacement_gain if row.on_face == 1 else 0.0
    for i in range(row.n_inner if row.on_face == 1 else 0):
        at = pools.fixed_int[row.dofs + i]
        start = pools.moving[row.face_state + i]
        pools.moving[row.v_free + at] += ratio * (start - pools.moving[row.u_free + at])
        pools.moving[row.u_free + at] = start


@kernel
def relaxing(pools: Any, c: int, what: int, j: int) -> float:
    """g, c_e, c_u or h of branch j of the face and of the rows."""
    row = pools.classes[c]
    return float(pools.fixed[row.relaxing + what * row.n_relaxing + j])


@kernel
def stiffened(pools: Any, c: int, i: int) -> float:
    """phi of row i of the squares, of S for i = n_elastic."""
    row = pools.classes[c]
    total = 0.0
    for j in range(row.n_relaxing):
        total += relaxing(pools, c, STRENGTH, j) * relaxing(pools, c, OF_MOTION, j)
    return float(1.0 + pools.fixed[row.relaxing_shares + i] * total)


@kernel
def on_rows(pools: Any, c: int, x: Array, out: Array) -> None:
    """out (k,) = R x; four rows at a time, so that x is read once for them."""
    row = pools.classes[c]
    n, k = row.n, row.n_elastic
    table = pools.fixed[row.elastic_rows : row.elastic_rows + k * n]
    for p in range(0, k - k % 4, 4):
        first, second = table[p * n : (p + 1) * n], table[(p + 1) * n : (p + 2) * n]
        third, fourth = table[(p + 2) * n : (p + 3) * n], table[(p + 3) * n : (p + 4) * n]
        t0 = t1 = t2 = t3 = 0.0
        for i in range(n):
            value = x[i]
            t0 += first[i] * value
            t1 += second[i] * value
            t2 += third[i] * value
            t3 += fourth[i] * value
        out[p] = t0
        out[p + 1] = t1
        out[p + 2] = t2
        out[p + 3] = t3
    for p in range(k - k % 4, k):
        line, total = table[p * n : (p + 1) * n], 0.0
        for i in range(n):
            total += line[i] * x[i]
        out[p] = total


@kernel
def add_rows(pools: Any, c: int, factor: float, weights: Array, out: Array) -> None:
    """out += factor R^T weights, likewise."""
    row = pools.classes[c]
    n, k = row.n, row.n_elastic
    table = pools.fixed[row.elastic_rows : row.elastic_rows + k * n]
    for p in range(0, k - k % 4, 4):
        first, second = table[p * n : (p + 1) * n], table[(p + 1) * n : (p + 2) * n]
        third, fourth = table[(p + 2) * n : (p + 3) * n], table[(p + 3) * n : (p + 4) * n]
        t0, t1 = factor * weights[p], factor * weights[p + 1]
        t2, t3 = factor * weights[p + 2], factor * weights[p + 3]
        for i in range(n):
            out[i] += (t0 * first[i] + t1 * second[i]) + (t2 * third[i] + t3 * fourth[i])
    for p in range(k - k % 4, k):
        line, weight = table[p * n : (p + 1) * n], factor * weights[p]
        for i in range(n):
            out[i] += weight * line[i]


@kernel
def subtract_face(pools: Any, c: int) -> None:
    """Forces of the squares, S r_free and b S r'_free of the predictors from the load, their branches included."""
    row = pools.classes[c]
    run = pools.run[0]
    work = pools.moving
    if row.on_face == 0:
        return
    n = row.n_inner
    k = row.n_elastic
    state = work[row.face_state : row.face_state + 4 * row.n_inner]
    rows, strained = work[rows_at(row) : rows_at(row) + k], work[row.row_force : row.row_force + k]
    free = work[row.row_free : row.row_free + k]
    on_rows(pools, c, work[row.u_free : row.u_free + row.n], free)
    for i in range(k):
        strained[i] = free[i]
    for j in range(row.n_relaxing):
        strength, c_e, c_u = branch(pools, c, j)
        at = rows_at(row) + (1 + j) * k
        for i in range(k):
            elongation = c_e * work[at + i] + c_u * (free[i] - rows[i])
            strained[i] += pools.fixed[row.relaxing_shares + i] * strength * elongation
    for i in range(row.n_inertial):
        at = k - row.n_inertial + i
        strained[at] = free[at] - 2.0 * rows[at] + work[earlier_at(row) + i]
    add_rows(pools, c, -1.0, strained, work[row.load : row.load + row.n])
    ratio, viscosity = run.velocity_gain / run.displacement_gain, pools.fixed[row.face_viscosity]
    phi, share = stiffened(pools, c, k), pools.fixed[row.relaxing_shares + k]
    for i in range(n):
        start = state[n + i]
        force = state[2 * n + i]
        rate = state[3 * n + i]
        viscous = viscosity * (rate + ratio * (start - force - run.u_v * rate))
        work[row.load + pools.fixed_int[row.dofs + i]] -= phi * start + viscous
    for j in range(row.n_relaxing):
        strength, c_e, c_u = branch(pools, c, j)
        at = forces_at(row) + j * n
        for i in range(n):
            relaxed = share * strength * (c_e * work[at + i] - c_u * state[2 * n + i])
            work[row.load + pools.fixed_int[row.dofs + i]] -= relaxed


@kernel
def branch(pools: Any, c: int, j: int) -> tuple[float, float, float]:
    """g, c_e and c_u of branch j."""
    strength, c_e = relaxing(pools, c, STRENGTH, j), relaxing(pools, c, OF_ELONGATION, j)
    return strength, c_e, relaxing(pools, c, OF_MOTION, j)


@kernel
def keep_load(pools: Any, c: int) -> None:
    """Loads on the interface dofs, the reference tractions among them, for ``keep_face_forces``."""
    row = pools.classes[c]
    for i in range(row.n_inner if row.on_face == 1 else 0):
        pools.moving[row.face_load + i] = pools.moving[row.load + pools.fixed_int[row.dofs + i]]


@kernel
def keep_face_forces(pools: Any, c: int) -> None:
    """S r and S r' at the end of an instant, R u, and elongations of the branches, for the damping and the account of
    energies, which alone need them; the solution in ``load``, forces beyond the reference tractions in ``inner``."""
    row = pools.classes[c]
    run = pools.run[0]
    work = pools.moving
    viscosity = pools.fixed[row.face_viscosity] if row.on_face == 1 else 0.0
    remembers = row.n_relaxing > 0 or row.n_inertial > 0 or row.accounted == 1
    if row.on_face == 0 or (viscosity == 0.0 and not remembers):
        return
    n = row.n_inner
    k = row.n_elastic
    size = row.n
    ratio = run.velocity_gain / run.displacement_gain
    solved, squares = work[row.load : row.load + size], work[row.mass_a : row.mass_a + size]
    state, change = work[row.face_state : row.face_state + 4 * n], work[row.row_force : row.row_force + k]
    on_rows(pools, c, solved, change)
    for i in range(k):
        change[i] *= run.displacement_gain
    work[row.relaxed_loss] = 0.0
    _relax_rows(pools, c, change)
    for i in range(k):
        change[i] *= stiffened(pools, c, i)
    squares[:] = 0.0
    add_rows(pools, c, 1.0, change, squares)
    add_squares(pools, c, row.viscous_rows, row.n_viscous, run.velocity_gain, solved, squares)
    share = run.displacement_gain / (run.displacement_gain * stiffened(pools, c, k) + viscosity * run.velocity_gain)
    for i in range(n):
        rest = work[row.face_load + i] + work[row.inner + i] - squares[pools.fixed_int[row.dofs + i]]
        force = state[n + i] + share * rest
        old = state[2 * n + i]
        rate = state[3 * n + i]
        work[row.face_rate + i] = rate + ratio * (force - old - run.u_v * rate)
        state[2 * n + i], state[3 * n + i] = force, (force - old) / run.dt
    _relax_face(pools, c, solved)


@kernel
def _relax_rows(pools: Any, c: int, change: Array) -> None:
    """R u of the new instant from its part ``change`` (k,) beside that of the predictor, and elongations likewise."""
    row, work = pools.classes[c], pools.moving
    k = row.n_elastic
    rows, free = work[rows_at(row) : rows_at(row) + k], work[row.row_free : row.row_free + k]
    for j in range(row.n_relaxing):
        strength, c_e, c_u = branch(pools, c, j)
        at, lost = rows_at(row) + (1 + j) * k, 0.0
        for i in range(k):
            old = work[at + i]
            new = c_e * old + c_u * (free[i] + change[i] - rows[i])
            lost += pools.fixed[row.relaxing_shares + i] * (old + new) ** 2
            work[at + i] = new
        work[row.relaxed_loss] += 0.5 * strength * relaxing(pools, c, HALF_RATIO, j) * lost
    work[row.inertia_loss] = 0.0
    for i in range(row.n_inertial):
        at, earlier = k - row.n_inertial + i, work[earlier_at(row) + i]
        work[row.inertia_loss] += 0.5 * (free[at] + change[at] - 2.0 * rows[at] + earlier) ** 2
        work[earlier_at(row) + i] = rows[at]
    for i in range(k):
        rows[i] = free[i] + change[i]


@kernel
def _relax_face(pools: Any, c: int, solved: Array) -> None:
    """Elongations e of the branches of S and S e of the new instant; accelerations ``solved`` (n,)."""
    row = pools.classes[c]
    run = pools.run[0]
    work = pools.moving
    n, dofs = row.n_inner, pools.fixed_int[row.dofs : row.dofs + row.n_inner]
    share = pools.fixed[row.relaxing_shares + row.n_elastic]
    rate = row.face_state + 3 * n
    for j in range(row.n_relaxing):
        strength, c_e, c_u = branch(pools, c, j)
        lost = 0.0
        for i in range(n):
            at = dofs[i]
            moves = work[row.u_free + at] + run.displacement_gain * solved[at] - work[row.u + at]
            old, old_force = work[strains_at(row) + j * n + i], work[forces_at(row) + j * n + i]
            new, new_force = c_e * old + c_u * moves, c_e * old_force + c_u * run.dt * work[rate + i]
            lost += (old + new) * (old_force + new_force)
            work[strains_at(row) + j * n + i], work[forces_at(row) + j * n + i] = new, new_force
        work[row.relaxed_loss] += 0.5 * share * strength * relaxing(pools, c, HALF_RATIO, j) * lost


@kernel
def add_face_forces(pools: Any, c: int, elastic: bool, viscous: bool, out: Array) -> None:
    """Add the forces of the squares and of S with their branches, or b S r' with the velocities that C acts on over the
    step, of the last instant to forces (n,)."""
    row, work = pools.classes[c], pools.moving
    n, k = (row.n_inner, row.n_elastic) if row.on_face == 1 else (0, 0)
    if elastic and k > 0:
        strained = work[row.row_force : row.row_force + k]
        for i in range(k):
            total = work[rows_at(row) + i]
            for j in range(row.n_relaxing):
                strength = pools.fixed[row.relaxing_shares + i] * relaxing(pools, c, STRENGTH, j)
                total += strength * work[rows_at(row) + (1 + j) * k + i]
            strained[i] = total
        for i in range(k - row.n_inertial, k):
            strained[i] = 0.0
        add_rows(pools, c, 1.0, strained, out)
    for i in range(n if elastic else 0):
        out[pools.fixed_int[row.dofs + i]] += work[row.face_state + 2 * n + i]
    for j in range(row.n_relaxing if elastic and n > 0 else 0):
        strength = pools.fixed[row.relaxing_shares + k] * relaxing(pools, c, STRENGTH, j)
        for i in range(n):
            out[pools.fixed_int[row.dofs + i]] += strength * work[forces_at(row) + j * n + i]
    for i in range(n if viscous else 0):
        rate = work[row.face_rate + i]
        out[pools.fixed_int[row.dofs + i]] += pools.fixed[row.face_viscosity] * rate


@kernel
def inertial_energy(pools: Any, c: int) -> float:
    """Kinetic energy of the rows of inertia, by their mean velocity over the step, J."""
    row = pools.classes[c]
    work = pools.moving
    total = 0.0
    first = rows_at(row) + row.n_elastic - row.n_inertial
    for i in range(row.n_inertial):
        total += 0.5 * (work[first + i] - work[earlier_at(row) + i]) ** 2
    return float(total)


@kernel
def relaxed_energy(pools: Any, c: int) -> float:
    """Elastic energy of the springs of the branches, less half the work of their forces on the displacements, which
    ``add_face_forces`` puts among those of K, J."""
    row, work = pools.classes[c], pools.moving
    n = row.n_inner
    k = row.n_elastic
    total = 0.0
    for j in range(row.n_relaxing):
        strength = 0.5 * relaxing(pools, c, STRENGTH, j)
        at = rows_at(row) + (1 + j) * k
        of_rows = 0.0
        of_face = 0.0
        for i in range(k):
            elongation = work[at + i]
            of_rows += pools.fixed[row.relaxing_shares + i] * elongation * (elongation - work[rows_at(row) + i])
        for i in range(n):
            elongation = work[strains_at(row) + j * n + i] - work[row.u + pools.fixed_int[row.dofs + i]]
            of_face += elongation * work[forces_at(row) + j * n + i]
        total += strength * (of_rows + pools.fixed[row.relaxing_shares + k] * of_face)
    return total
