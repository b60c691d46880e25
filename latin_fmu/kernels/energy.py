"""Energies of the members of a class: each term is computed on its own, none as the remainder of the others.

Dofs and prescribed motions together, D the change over a step from instant n to n + 1, ( )_w weighted over the instants
n - 1, n, n + 1 and a_w over n, n + 1 as the time scheme does (``TimeScheme.energy_weights``):

    DIRECT    D T + D V + Du.(C v)_w + Du.[(K u)_w - mean K u] + x a_w.M Da = Du.f_w + Du.lambda_w + reactions
    EXPLICIT  D T + D V - dt^2/8 D[v.K v] + Du.(C v_n + C_d Dv / 2) = Du.mean f + Du.lambda_{n+1} + reactions
    STATIC    D V = Du.(mean f + mean lambda) + reactions

x = ``inertia_dissipation``; f loads, lambda tractions of the interfaces; reactions work where the motion is prescribed
and are counted with the loads. The sums hold up to round-off. Each step costs one product, K u (EXPLICIT classes: K v
too): M a comes from the march, and M v follows the recursion that the scheme has for v.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from .matrices import DAMPING, DASHPOTS, LOADS, MASS, STIFFNESS, add_product, add_spread, add_sum
from .records import EXPLICIT, STATIC

Array = NDArray[np.float64]

TERMS = ("kinetic", "elastic", "work_of_loads", "interface_work", "damping_dissipation", "scheme_dissipation")
"""Terms of the account, in the order of ``totals``."""
_KINETIC, _ELASTIC, _LOADS, _INTERFACE, _DAMPING, _SCHEME = range(6)
FIELDS = 16
"""Fields of ``past``."""
# their places, displacements first: accelerations, M a and M v of the dofs alone, then the forces (``_forces``, C v) of
# the last three instants in turn
_A, _MASS_A, _MASS_V, _RING = 1, 2, 3, 4
# of EXPLICIT classes: velocities, K v, loads, K u, M v
_V, _K_V, _LOAD, _K_U, _OLD_MASS_V = 1, 2, 3, 4, 5


@kernel
def _copy(x: Array, out: Array) -> None:
    """out = x; an assignment of arrays would check whether they overlap, and allocate."""
    for i in range(len(out)):
        out[i] = x[i]


@kernel
def _add_border(n: int, count: int, starts: Any, columns: Any, values: Array, m: int, x: Array, out: Array) -> None:
    """out += the rows of ``count`` prescribed motions of a symmetric matrix on dofs and motions times x, and their
    transpose in the dofs' rows."""
    for i in range(count):
        for e in range(starts[i], starts[i + 1]):
            column, value = np.int64(columns[e]), values[e]
            for j in range(m):
                out[(n + i) * m + j] += value * x[column * m + j]
                if column < n:
                    out[column * m + j] += value * x[(n + i) * m + j]


@kernel
def _add_borders(pools: Any, c: int, which: int, x: Array, out: Array) -> None:
    """out += what the rows of prescribed motions add to a product; see ``_product``."""
    row = pools.classes[c]
    count = row.n_motion
    if count == 0:
        return
    starts_at, columns_at, values_at = row.border_mass_starts, row.border_mass_columns, row.border_mass_values
    if which == STIFFNESS:
        starts_at, columns_at = row.border_stiffness_starts, row.border_stiffness_columns
        values_at = row.border_stiffness_values
    elif which == DAMPING:
        starts_at, columns_at = row.border_damping_starts, row.border_damping_columns
        values_at = row.border_damping_values
    elif which == DASHPOTS:
        starts_at, columns_at = row.border_dashpots_starts, row.border_dashpots_columns
        values_at = row.border_dashpots_values
    starts = pools.fixed_int[starts_at : starts_at + count + 1]
    columns = pools.fixed_col[columns_at : columns_at + starts[count]]
    _add_border(row.n, count, starts, columns, pools.fixed[values_at : values_at + starts[count]], row.m, x, out)


@kernel
def _product(pools: Any, c: int, which: int, x: Array, out: Array) -> None:
    """out = M, K, C or the lumped C times x on dofs and motions (n + n_motion, m)."""
    row = pools.classes[c]
    size = row.n * row.m
    out[:] = 0.0
    add_product(pools, c, which, 1.0, x[:size], out[:size])
    _add_borders(pools, c, which, x, out)


@kernel
def _field(pools: Any, c: int, place: int, order: int, instant: int, scratch: Array) -> Array:
    """Displacements (``order`` 0), velocities (1) or accelerations (2) of dofs and motions, from ``place`` on in the
    state; in ``scratch`` where there are motions."""
    row, run = pools.classes[c], pools.run[0]
    size, count = row.n * row.m, row.n_motion * row.m
    own: Array = pools.moving[place : place + size]
    if count == 0:
        return own
    _copy(own, scratch[:size])
    at = row.motions + (order * run.n_time + instant) * count
    _copy(pools.moving[at : at + count], scratch[size:])
    return scratch


@kernel
def _tractions(pools: Any, c: int, flat: Array, out: Array) -> None:
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
def _add_dot(m: int, factor: float, x: Array, y: Array, totals: Array) -> None:
    """totals (m,) += factor times the scalar product of each member's column."""
    for j in range(m):  # a sum stored in every step would not be vectorised
        total = 0.0
        for at in range(j, len(x), m):
            total += x[at] * y[at]
        totals[j] += factor * total


@kernel
def _add_work(
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
def _steps(pools: Any, c: int, u: Array, u_old: Array, step: Array, inner: Array) -> None:
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
def _forces(pools: Any, c: int, instant: int, flat: Array, u: Array, out: Array) -> None:
    """K u into the first of four fields of n + n_motion rows, loads (n m,) into the third, forces of tractions flat
    (N,) on the interface dofs (g m,) into the fourth. Loads and tractions where a motion is prescribed are part of the
    reactions."""
    row = pools.classes[c]
    m, wide = row.m, (row.n + row.n_motion) * row.m
    _product(pools, c, STIFFNESS, u, out[:wide])
    loads = out[2 * wide : 2 * wide + row.n * m]
    _copy(pools.moving[row.work_loads : row.work_loads + row.n * m], loads)
    add_sum(pools, c, LOADS, instant, 1.0, loads)
    _tractions(pools, c, flat, out[3 * wide : 3 * wide + row.n_inner * m])


@kernel
def _state_energies(pools: Any, c: int, u: Array, v: Array, mass_v: Array, elastic: Array, image: Array) -> None:
    """Kinetic and elastic energy of the present motion; mass_v: M v without prescribed motions (n m,), elastic: K u,
    image: scratch."""
    row = pools.classes[c]
    m, size = row.m, row.n * row.m
    totals = pools.moving[row.totals : row.totals + 2 * m]
    totals[:] = 0.0
    kinetic = totals[_KINETIC * m : (_KINETIC + 1) * m]
    if row.kind != STATIC:
        _add_dot(m, 0.5, v[:size], mass_v, kinetic)
    if row.kind != STATIC and row.n_motion > 0:
        image[:] = 0.0
        _add_borders(pools, c, MASS, v, image)
        _add_dot(m, 0.5, v, image, kinetic)
    _add_dot(m, 0.5, u, elastic, totals[_ELASTIC * m : (_ELASTIC + 1) * m])


@kernel
def open_account(pools: Any, c: int, instant: int, flat: Array) -> None:
    """Begin the account of a class in its present motion under tractions flat (N,)."""
    row, work, state = pools.classes[c], pools.moving, pools.moving
    if row.accounted == 0:
        return
    m, size, wide = row.m, row.n * row.m, (row.n + row.n_motion) * row.m
    past, scratch = state[row.past : row.past + FIELDS * wide], work[row.extended : row.extended + 4 * wide]
    now, mass_v, image = (
        past[_RING * wide : (_RING + 4) * wide],
        scratch[2 * wide : 2 * wide + size],
        scratch[3 * wide :],
    )
    state[row.totals : row.totals + 6 * m] = 0.0
    past[:] = 0.0
    mass_v[:] = 0.0
    u, v = (
        _field(pools, c, row.u, 0, instant, scratch[:wide]),
        _field(pools, c, row.v, 1, instant, scratch[wide : 2 * wide]),
    )
    _forces(pools, c, instant, flat, u, now)
    if row.kind != STATIC:
        add_product(pools, c, MASS, 1.0, v[:size], mass_v)
    _state_energies(pools, c, u, v, mass_v, now[:wide], image)
    if row.kind == EXPLICIT:
        _open_explicit(pools, c, u, v)
        _write(pools, c, instant)
        return
    if row.kind == STATIC:
        # loads that do not start from zero are counted as growing over the first increment
        dofs = pools.fixed_int[row.dofs : row.dofs + row.n_inner]
        _copy(now[:size], now[2 * wide : 2 * wide + size])
        for i in range(len(dofs)):
            for j in range(m):
                now[2 * wide + dofs[i] * m + j] -= now[3 * wide + i * m + j]
    else:
        add_product(pools, c, MASS, 1.0, state[row.a : row.a + size], past[_MASS_A * wide : _MASS_A * wide + size])
        _copy(mass_v, past[_MASS_V * wide : _MASS_V * wide + size])
        _copy(_field(pools, c, row.a, 2, instant, image), past[_A * wide : (_A + 1) * wide])
    if row.damping_rows > 0:
        _product(pools, c, DAMPING, v, now[wide : 2 * wide])
    _copy(u, past[:wide])
    _copy(now, past[(_RING + 4) * wide : (_RING + 8) * wide])
    state[row.turn] = 2.0
    _write(pools, c, instant)


@kernel
def account(pools: Any, c: int, instant: int, flat: Array, marched: bool) -> None:
    """Add the step that ends at an instant with tractions flat (N,) to the account of a class; a class at
    rest adds nothing."""
    row = pools.classes[c]
    if row.accounted == 0:
        return
    if marched and row.kind == EXPLICIT:
        _account_explicit(pools, c, instant, flat)
    elif marched:
        _account_weighted(pools, c, instant, flat)
    _write(pools, c, instant)


@kernel
def _account_weighted(pools: Any, c: int, instant: int, flat: Array) -> None:
    """The step of a DIRECT or STATIC class."""
    row, run, work, state = pools.classes[c], pools.run[0], pools.moving, pools.moving
    m, size, wide, inner_size = row.m, row.n * row.m, (row.n + row.n_motion) * row.m, row.n_inner * row.m
    past, scratch = state[row.past : row.past + FIELDS * wide], work[row.extended : row.extended + 4 * wide]
    ring, turn, step, image = (
        past[_RING * wide :],
        int(state[row.turn]),
        scratch[2 * wide : 3 * wide],
        scratch[3 * wide :],
    )
    new, earlier, then = (
        ring[4 * turn * wide :],
        ring[4 * ((turn + 1) % 3) * wide :],
        ring[4 * ((turn + 2) % 3) * wide :],
    )
    state[row.turn] = (turn + 1) % 3
    u, v = (
        _field(pools, c, row.u, 0, instant, scratch[:wide]),
        _field(pools, c, row.v, 1, instant, scratch[wide : 2 * wide]),
    )
    _forces(pools, c, instant, flat, u, new)
    if row.damping_rows > 0:
        _product(pools, c, DAMPING, v, new[wide : 2 * wide])
    totals, inner = state[row.totals : row.totals + 6 * m], work[row.inner : row.inner + inner_size]
    of_loads, of_interface = totals[_LOADS * m : (_LOADS + 1) * m], totals[_INTERFACE * m : (_INTERFACE + 1) * m]
    of_damping, of_scheme = totals[_DAMPING * m : (_DAMPING + 1) * m], totals[_SCHEME * m :]
    _steps(pools, c, u, past[:wide], step, inner)
    _copy(u, past[:wide])
    if row.kind != STATIC:
        _account_inertia(pools, c, of_scheme)
    _state_energies(pools, c, u, v, past[_MASS_V * wide : _MASS_V * wide + size], new[:wide], image)
    if row.kind != STATIC and row.n_motion > 0:
        _account_moved_inertia(pools, c, instant, step, of_loads, of_scheme)
    before, old, now = run.energy_before, run.energy_old, run.energy_new
    _add_work(m, (before, old - 0.5, now - 0.5), step, earlier[:wide], then[:wide], new[:wide], of_scheme)
    at, end = 2 * wide, 2 * wide + size
    _add_work(m, (before, old, now), step[:size], earlier[at:end], then[at:end], new[at:end], of_loads)
    at, end = 3 * wide, 3 * wide + inner_size
    _add_work(m, (before, old, now), inner, earlier[at:end], then[at:end], new[at:end], of_interface)
    if row.damping_rows > 0:
        at, end = wide, 2 * wide
        _add_work(m, (before, old, now), step, earlier[at:end], then[at:end], new[at:end], of_damping)
    if row.n_motion == 0:
        return
    for at in range(size, 2 * wide, wide):  # reactions of K u, of C v
        end = at + wide - size
        _add_work(m, (before, old, now), step[size:], earlier[at:end], then[at:end], new[at:end], of_loads)


@kernel
def _account_inertia(pools: Any, c: int, of_scheme: Array) -> None:
    """x a_w.M Da of the dofs; M v from M a by the recursion of v, a product less. Keeps M a."""
    row, run = pools.classes[c], pools.run[0]
    m, size, wide = row.m, row.n * row.m, (row.n + row.n_motion) * row.m
    past = pools.moving[row.past : row.past + _RING * wide]
    a, mass_a = pools.moving[row.a : row.a + size], pools.moving[row.mass_a : row.mass_a + size]
    a_old, mass_a_old = past[_A * wide : _A * wide + size], past[_MASS_A * wide : _MASS_A * wide + size]
    mass_v = past[_MASS_V * wide : _MASS_V * wide + size]
    of_old, of_new, loss = run.energy_a_old, run.energy_a_new, run.inertia_dissipation
    if loss != 0.0:
        for j in range(m):
            total = 0.0
            for at in range(j, size, m):
                total += (of_old * a_old[at] + of_new * a[at]) * (mass_a[at] - mass_a_old[at])
            of_scheme[j] += loss * total
    of_old, of_new = run.v_a, run.velocity_gain
    for i in range(size):
        mass_v[i] += of_old * mass_a_old[i] + of_new * mass_a[i]
    _copy(mass_a, mass_a_old)
    if row.n_motion == 0:
        _copy(a, a_old)


@kernel
def _account_moved_inertia(pools: Any, c: int, instant: int, step: Array, of_loads: Array, of_scheme: Array) -> None:
    """What prescribed motions add to x a_w.M Da, and their reactions M a_w."""
    row, run = pools.classes[c], pools.run[0]
    m, size, wide = row.m, row.n * row.m, (row.n + row.n_motion) * row.m
    kept = pools.moving[row.past + _A * wide : row.past + (_A + 1) * wide]
    scratch = pools.moving[row.extended : row.extended + 4 * wide]
    mean, image = scratch[wide : 2 * wide], scratch[3 * wide :]
    a, of_old, of_new = _field(pools, c, row.a, 2, instant, scratch[:wide]), run.energy_a_old, run.energy_a_new
    for i in range(wide):
        mean[i], kept[i] = of_old * kept[i] + of_new * a[i], a[i] - kept[i]
    image[:] = 0.0
    _add_borders(pools, c, MASS, kept, image)
    _add_dot(m, run.inertia_dissipation, mean, image, of_scheme)
    image[:] = 0.0
    _add_borders(pools, c, MASS, mean, image)
    _add_dot(m, 1.0, step[size:], image[size:], of_loads)
    _copy(a, kept)


@kernel
def _open_explicit(pools: Any, c: int, u: Array, v: Array) -> None:
    """Fields of an EXPLICIT class at the start, from the forces in the place of the ring."""
    row = pools.classes[c]
    wide = len(u)
    past = pools.moving[row.past : row.past + FIELDS * wide]
    _copy(past[(_RING + 2) * wide : (_RING + 3) * wide], past[_LOAD * wide : (_LOAD + 1) * wide])
    _copy(u, past[:wide])
    _copy(v, past[_V * wide : (_V + 1) * wide])
    _product(pools, c, STIFFNESS, v, past[_K_V * wide : (_K_V + 1) * wide])
    _product(pools, c, MASS, v, past[_OLD_MASS_V * wide : (_OLD_MASS_V + 1) * wide])


@kernel
def _account_explicit(pools: Any, c: int, instant: int, flat: Array) -> None:
    """The step of an EXPLICIT class; the elastic force of its middle is K u + dt/2 K v of the old instant."""
    row, work, state, dt = pools.classes[c], pools.moving, pools.moving, pools.run[0].dt
    m, size, wide, inner_size = row.m, row.n * row.m, (row.n + row.n_motion) * row.m, row.n_inner * row.m
    past, scratch = state[row.past : row.past + FIELDS * wide], work[row.extended : row.extended + 4 * wide]
    step, damping, k_v, mass_v = (
        past[:wide],
        past[6 * wide : 7 * wide],
        past[7 * wide : 8 * wide],
        past[8 * wide : 9 * wide],
    )
    new, v_old = past[12 * wide :], past[_V * wide : (_V + 1) * wide]
    u, v = (
        _field(pools, c, row.u, 0, instant, scratch[:wide]),
        _field(pools, c, row.v, 1, instant, scratch[wide : 2 * wide]),
    )
    _forces(pools, c, instant, flat, u, new)
    damping[:] = 0.0
    if row.damping_rows > 0:
        _product(pools, c, DAMPING, v_old, damping)
    if row.dashpots_rows > 0:
        for i in range(wide):
            k_v[i] = 0.5 * (v[i] - v_old[i])
        _product(pools, c, DASHPOTS, k_v, mass_v)
        for i in range(wide):
            damping[i] += mass_v[i]
    _product(pools, c, MASS, v, mass_v)
    _product(pools, c, STIFFNESS, v, k_v)
    totals, inner = state[row.totals : row.totals + 6 * m], work[row.inner : row.inner + inner_size]
    of_loads, of_scheme = totals[_LOADS * m : (_LOADS + 1) * m], totals[_SCHEME * m :]
    totals[: 2 * m] = 0.0
    _add_dot(m, 0.5, v, mass_v, totals[_KINETIC * m : (_KINETIC + 1) * m])
    _add_dot(m, 0.5, u, new[:wide], totals[_ELASTIC * m : (_ELASTIC + 1) * m])
    _add_dot(m, -dt * dt / 8, v, k_v, of_scheme)
    _add_dot(m, dt * dt / 8, v_old, past[_K_V * wide : (_K_V + 1) * wide], of_scheme)
    _steps(pools, c, u, past[:wide], step, inner)  # in place of the old displacements
    _add_dot(m, 1.0, step, damping, totals[_DAMPING * m : (_DAMPING + 1) * m])
    _add_dot(m, 1.0, inner, new[3 * wide : 3 * wide + inner_size], totals[_INTERFACE * m : (_INTERFACE + 1) * m])
    load_old, load = past[_LOAD * wide : _LOAD * wide + size], new[2 * wide : 2 * wide + size]
    _add_work(m, (0.0, 0.5, 0.5), step[:size], load_old, load_old, load, of_loads)
    if row.n_motion > 0:  # reactions
        moved, k_v_old = step[size:], past[_K_V * wide + size : (_K_V + 1) * wide]
        mass_v_old = past[_OLD_MASS_V * wide + size : (_OLD_MASS_V + 1) * wide]
        k_u_old = past[_K_U * wide + size : (_K_U + 1) * wide]
        _add_work(m, (-1 / dt, 1 / dt, 1.0), moved, mass_v_old, mass_v[size:], damping[size:], of_loads)
        _add_work(m, (0.0, 1.0, 0.5 * dt), moved, k_u_old, k_u_old, k_v_old, of_loads)
    _copy(u, past[:wide])
    _copy(v, past[_V * wide : (_V + 1) * wide])
    _copy(k_v, past[_K_V * wide : (_K_V + 1) * wide])
    _copy(new[2 * wide : 3 * wide], past[_LOAD * wide : (_LOAD + 1) * wide])
    _copy(new[:wide], past[_K_U * wide : (_K_U + 1) * wide])
    _copy(mass_v, past[_OLD_MASS_V * wide : (_OLD_MASS_V + 1) * wide])


@kernel
def _write(pools: Any, c: int, instant: int) -> None:
    """Keep the totals among the histories."""
    row = pools.classes[c]
    size = 6 * row.m
    at = row.energies + size * (instant - pools.run[0].first_row)
    pools.moving[at : at + size] = pools.moving[row.totals : row.totals + size]
