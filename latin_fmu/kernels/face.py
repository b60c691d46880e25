"""March of interface dofs without mass on a dense stiffness S of their own (``propagator.model.FaceStiffness``).

Their place is counted from r_0, that at the start, in every instant: with the predictors

    r_free = r_0,  r'_free = r' + (velocity_gain / displacement_gain) (r_0 - r - dt r')

the solution is that of the predictors of the scheme, as dofs without mass have no memory of their own, and

    S r_free = S r_0,    b S r'_free = b (S r' + (velocity_gain / displacement_gain) (S r_0 - S r - dt S r'))

need no product with S: what it is at an instant follows from the balance of the forces there,

    (displacement_gain + b velocity_gain) S a = load - (the squares) a,    S r = S r_0 + displacement_gain S a.

So r is a fixed linear function of the forces, S^-1 as it is stored; nothing adds up from instant to instant.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from .splits import add_squares

Array = NDArray[np.float64]


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
def subtract_face(pools: Any, c: int) -> None:
    """S r_free and b S r'_free of the predictors from the load."""
    row, run = pools.classes[c], pools.run[0]
    if row.on_face == 0:
        return
    n, state = row.n_inner, pools.moving[row.face_state : row.face_state + 4 * row.n_inner]
    ratio, viscosity = run.velocity_gain / run.displacement_gain, pools.fixed[row.face_viscosity]
    for i in range(n):
        start, force, rate = state[n + i], state[2 * n + i], state[3 * n + i]
        viscous = viscosity * (rate + ratio * (start - force - run.u_v * rate))
        pools.moving[row.load + pools.fixed_int[row.dofs + i]] -= start + viscous


@kernel
def keep_load(pools: Any, c: int) -> None:
    """Loads on the interface dofs, the reference tractions among them, for ``keep_face_forces``."""
    row = pools.classes[c]
    for i in range(row.n_inner if row.on_face == 1 else 0):
        pools.moving[row.face_load + i] = pools.moving[row.load + pools.fixed_int[row.dofs + i]]


@kernel
def keep_face_forces(pools: Any, c: int) -> None:
    """S r and S r' at the end of an instant, for the damping and the account of energies, which alone need them; the
    solution in ``load``, forces beyond the reference tractions in ``inner``."""
    row, run, work = pools.classes[c], pools.run[0], pools.moving
    viscosity = pools.fixed[row.face_viscosity] if row.on_face == 1 else 0.0
    if row.on_face == 0 or (viscosity == 0.0 and row.accounted == 0):
        return
    n, size, ratio = row.n_inner, row.n, run.velocity_gain / run.displacement_gain
    solved, squares = work[row.load : row.load + size], work[row.mass_a : row.mass_a + size]
    state = work[row.face_state : row.face_state + 4 * n]
    squares[:] = 0.0
    add_squares(pools, c, row.elastic_rows, row.n_elastic, run.displacement_gain, solved, squares)
    add_squares(pools, c, row.viscous_rows, row.n_viscous, run.velocity_gain, solved, squares)
    share = run.displacement_gain / (run.displacement_gain + viscosity * run.velocity_gain)
    for i in range(n):
        left = work[row.face_load + i] + work[row.inner + i] - squares[pools.fixed_int[row.dofs + i]]
        force, old, rate = state[n + i] + share * left, state[2 * n + i], state[3 * n + i]
        work[row.face_rate + i] = rate + ratio * (force - old - run.u_v * rate)
        state[2 * n + i], state[3 * n + i] = force, (force - old) / run.dt


@kernel
def add_face_forces(pools: Any, c: int, elastic: bool, viscous: bool, out: Array) -> None:
    """Add S r, or b S r' with the velocities that C acts on over the step, of the last instant to forces (n,)."""
    row = pools.classes[c]
    n = row.n_inner if row.on_face == 1 else 0
    for i in range(n if elastic else 0):
        out[pools.fixed_int[row.dofs + i]] += pools.moving[row.face_state + 2 * n + i]
    for i in range(n if viscous else 0):
        rate = pools.moving[row.face_rate + i]
        out[pools.fixed_int[row.dofs + i]] += pools.fixed[row.face_viscosity] * rate
