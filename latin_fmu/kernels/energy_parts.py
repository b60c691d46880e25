"""Parts of the accounts of energies (``energy``): works, fields and products of dofs and prescribed motions."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from .face import add_face_forces
from .matrices import LOADS, add_spread, add_sum
from .records import STATIC
from .splits import DAMPING, DASHPOTS, GEOMETRIC, LANDING, MASS, STIFFNESS, UNRELAXED, add_product

Array = NDArray[np.float64]

TERMS = (
    "kinetic",
    "elastic",
    "prestress",
    "work_of_loads",
    "interface_work",
    "damping_dissipation",
    "scheme_dissipation",
    "landing_dissipation",
)
"""Terms of the account, in the order of ``totals``."""
N_TERM = len(TERMS)
KINETIC, ELASTIC, PRESTRESS, WORK_OF_LOADS, INTERFACE_WORK, DAMPED, OF_SCHEME, OF_LANDING = range(N_TERM)
STORED, OF_GROUND, OF_DRIFT, PUT_IN, NET, LARGEST, INSTANTS = range(7)
"""Numbers of ``works``: energy stored in the classes here at the start; work of the moving ground here;
work that the drift takes from the interfaces owned here; energy put in so far; work of the drift of all processes, its
largest size at the instants whose forces were measured; instants since the start."""
N_WORK = 7


@kernel
def copied(x: Array, out: Array) -> None:
    """out = x; an assignment of arrays would check whether they overlap, and allocate."""
    for i in range(len(out)):
        out[i] = x[i]


@kernel
def add_border(n: int, count: int, starts: Any, columns: Any, values: Array, m: int, x: Array, out: Array) -> None:
    """out += the rows of ``count`` prescribed motions of a symmetric matrix on dofs and motions times x, and their
    transpose in the dofs' rows."""
    for i in range(count):
        for e in range(starts[i], starts[i + 1]):
            column, value = np.int64(columns[e]), values[e]
            for j in range(m):
                out[(n + i) * m + j] += value * x[column * m + j]
                if column < n:  # among motions the rows are whole: no transpose
                    out[column * m + j] += value * x[(n + i) * m + j]


@kernel
def add_borders(pools: Any, c: int, which: int, x: Array, out: Array) -> None:
    """out += what the rows of prescribed motions add to a product; see ``whole_product``."""
    row = pools.classes[c]
    count = row.n_motion
    if count == 0:
        return
    starts_at = row.border_mass_starts
    columns_at = row.border_mass_columns
    values_at = row.border_mass_values
    if which == STIFFNESS:
        starts_at, columns_at = row.border_stiffness_starts, row.border_stiffness_columns
        values_at = row.border_stiffness_values
    elif which == DAMPING:
        starts_at, columns_at = row.border_damping_starts, row.border_damping_columns
        values_at = row.border_damping_values
    elif which == DASHPOTS:
        starts_at, columns_at = row.border_dashpots_starts, row.border_dashpots_columns
        values_at = row.border_dashpots_values
    elif which == LANDING:
        starts_at, columns_at = row.border_landing_starts, row.border_landing_columns
        values_at = row.border_landing_values
    elif which == UNRELAXED:
        starts_at, columns_at = row.border_unrelaxed_starts, row.border_unrelaxed_columns
        values_at = row.border_unrelaxed_values
    elif which == GEOMETRIC:
        starts_at, columns_at = row.border_geometric_starts, row.border_geometric_columns
        values_at = row.border_geometric_values
    starts = pools.fixed_int[starts_at : starts_at + count + 1]
    columns = pools.fixed_col[columns_at : columns_at + starts[count]]
    add_border(row.n, count, starts, columns, pools.fixed[values_at : values_at + starts[count]], row.m, x, out)


@kernel
def whole_product(pools: Any, c: int, which: int, x: Array, out: Array) -> None:
    """out = M, K, C or a part of these times x on dofs and motions (n + n_motion, m); with the stiffness of a face K u,
    its branches included, and C v_w are those of the last instant alone."""
    row = pools.classes[c]
    size = row.n * row.m
    out[:] = 0.0
    add_product(pools, c, which, 1.0, x[:size], out[:size])
    add_face_forces(pools, c, which == STIFFNESS, which == DAMPING, out)
    add_borders(pools, c, which, x, out)


@kernel
def whole_field(pools: Any, c: int, place: int, order: int, instant: int, scratch: Array) -> Array:
    """Displacements (``order`` 0), velocities (1) or accelerations (2) of dofs and motions, from ``place`` on in the
    state; in ``scratch`` where there are motions."""
    row, run = pools.classes[c], pools.run[0]
    size, count = row.n * row.m, row.n_motion * row.m
    field: Array = pools.moving[place : place + size]
    if count == 0:
        return field
    copied(field, scratch[:size])
    at = row.motions + (order * run.n_time + instant) * count
    copied(pools.moving[at : at + count], scratch[size:])
    return scratch


@kernel
def nodal_forces(pools: Any, c: int, flat: Array, out: Array) -> None:
    """Forces (g m,) of tractions (N,) on the interface dofs."""
    row = pools.classes[c]
    m, size = row.m, row.n_channel * row.m
    channels, nodal = (
        pools.fixed_int[row.channels : row.channels + size],
        pools.moving[row.channel : row.channel + size],
    )
    area = pools.fixed[row.area : row.area + row.n_channel]
    for i in range(len(area)):
        for j in range(m):
            nodal[i * m + j] = area[i] * flat[channels[i * m + j]]
    out[:] = 0.0
    add_spread(pools, c, nodal, out)


@kernel
def add_dot(m: int, factor: float, x: Array, y: Array, totals: Array) -> None:
    """totals (m,) += factor times the scalar product of each member's column."""
    for j in range(m):  # a sum stored in every step would not be vectorised
        total = 0.0
        for at in range(j, len(x), m):
            total += x[at] * y[at]
        totals[j] += factor * total


@kernel
def add_work(
    m: int, weights: tuple[float, float, float], step: Array, earlier: Array, then: Array, now: Array, totals: Array
) -> None:
    """totals (m,) += step . weighted forces of the instants n - 1, n, n + 1, for each member's column."""
    of_earlier, of_then, of_now = weights
    for j in range(m):
        total = 0.0
        for at in range(j, len(step), m):
            total += step[at] * (of_earlier * earlier[at] + of_then * then[at] + of_now * now[at])
        totals[j] += total


@kernel
def step_of(pools: Any, c: int, u: Array, u_old: Array, step: Array, inner: Array) -> None:
    """Du of dofs and motions, and of the interface dofs (g m,)."""
    row = pools.classes[c]
    m = row.m
    for i in range(len(step)):
        step[i] = u[i] - u_old[i]
    dofs = pools.fixed_int[row.dofs : row.dofs + row.n_inner]
    for i in range(len(dofs)):
        for j in range(m):
            inner[i * m + j] = step[dofs[i] * m + j]


@kernel
def step_forces(pools: Any, c: int, instant: int, flat: Array, u: Array, out: Array) -> None:
    """K u into the first of four fields of n + n_motion rows, loads (n m,) into the third, forces of tractions flat
    (N,) on the interface dofs (g m,) into the fourth. Loads and tractions where a motion is prescribed are part of the
    reactions."""
    row = pools.classes[c]
    m, wide = row.m, (row.n + row.n_motion) * row.m
    whole_product(pools, c, STIFFNESS, u, out[:wide])
    loads = out[2 * wide : 2 * wide + row.n * m]
    copied(pools.moving[row.work_loads : row.work_loads + row.n * m], loads)
    add_sum(pools, c, LOADS, instant, 1.0, loads)
    nodal_forces(pools, c, flat, out[3 * wide : 3 * wide + row.n_inner * m])


@kernel
def state_energies(pools: Any, c: int, u: Array, v: Array, mass_v: Array, elastic: Array, image: Array) -> None:
    """Kinetic and elastic energy of the present motion, and that of the stress of t = 0; mass_v: M v without prescribed
    motions (n m,), elastic: K u with the geometric stiffness, image: scratch."""
    row = pools.classes[c]
    m, size = row.m, row.n * row.m
    totals = pools.moving[row.totals : row.totals + 3 * m]
    totals[:] = 0.0
    kinetic = totals[KINETIC * m : (KINETIC + 1) * m]
    if row.kind != STATIC:
        add_dot(m, 0.5, v[:size], mass_v, kinetic)
    if row.kind != STATIC and row.n_motion > 0:
        # M between motions and dofs, and of the motions, which ``mass_v`` leaves out
        image[:] = 0.0
        add_borders(pools, c, MASS, v, image)
        add_dot(m, 0.5, v, image, kinetic)
    add_dot(m, 0.5, u, elastic, totals[ELASTIC * m : (ELASTIC + 1) * m])
    part_prestress(pools, c, u, totals, image)


@kernel
def part_prestress(pools: Any, c: int, u: Array, totals: Array, image: Array) -> None:
    """Take u.K_sigma u / 2 out of the elastic energy, as a term of its own; ``image`` : scratch."""
    row = pools.classes[c]
    m = row.m
    if row.geometric_rows == 0:
        return
    whole_product(pools, c, GEOMETRIC, u, image)
    add_dot(m, 0.5, u, image, totals[PRESTRESS * m : (PRESTRESS + 1) * m])
    add_dot(m, -0.5, u, image, totals[ELASTIC * m : (ELASTIC + 1) * m])
