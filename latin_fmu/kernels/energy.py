"""Energies of the members of a class: each term is computed on its own, none as the remainder of the others.

Dofs and prescribed motions together, D the change over a step from instant n to n + 1, ( )_w weighted over the instants
n - 1, n, n + 1 and a_w over n, n + 1 as the time scheme does (``TimeScheme.energy_weights``):

    DIRECT    D T + D V + Du.(C v)_w + Du.[(K u)_w - mean K u] + x a_w.M Da = Du.f_w + Du.lambda_w + reactions
    EXPLICIT  D T + D V - dt^2/8 D[v.K v] + Du.(C v_n + C_d Dv / 2) = Du.mean f + Du.lambda_{n+1} + reactions
    STATIC    D V = Du.(mean f + mean lambda) + reactions

x = ``inertia_dissipation``; f loads, lambda tractions of the interfaces; reactions work where the motion is prescribed
and are counted with the loads. The sums hold up to round-off.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from .matrices import add_damping, add_dashpots, add_mass, add_spread, add_stiffness
from .products import add_terms
from .records import EXPLICIT, STATIC

Array = NDArray[np.float64]

TERMS = ("kinetic", "elastic", "work_of_loads", "interface_work", "damping_dissipation", "scheme_dissipation")
"""Terms of the account, in the order of ``totals``."""
_KINETIC, _ELASTIC, _LOADS, _INTERFACE, _DAMPING, _SCHEME = range(6)
# places of ``past``: displacements (0), fields, then forces of the last instant and of the one before it
_A, _MASS_A, _NOW, _BEFORE = 1, 2, 3, 7
_V, _K_V, _FORCE, _K_U, _MASS_V = 1, 2, 3, 4, 5  # of EXPLICIT classes


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
def _product(pools: Any, c: int, which: int, x: Array, out: Array) -> None:
    """out = M (``which`` 0), K (1), C (2) or the lumped C (3) times x on dofs and motions (n + n_motion, m)."""
    row = pools.classes[c]
    n, m, count = row.n, row.m, row.n_motion
    out[:] = 0.0
    starts_at, columns_at, values_at = row.border_mass_starts, row.border_mass_columns, row.border_mass_values
    if which == 0:
        add_mass(pools, c, 1.0, x[: n * m], out[: n * m])
    elif which == 1:
        add_stiffness(pools, c, 1.0, x[: n * m], out[: n * m])
        starts_at, columns_at = row.border_stiffness_starts, row.border_stiffness_columns
        values_at = row.border_stiffness_values
    elif which == 2:
        add_damping(pools, c, 1.0, x[: n * m], out[: n * m])
        starts_at, columns_at = row.border_damping_starts, row.border_damping_columns
        values_at = row.border_damping_values
    else:
        add_dashpots(pools, c, 1.0, x[: n * m], out[: n * m])
        starts_at, columns_at = row.border_dashpots_starts, row.border_dashpots_columns
        values_at = row.border_dashpots_values
    if count > 0:
        starts = pools.fixed_int[starts_at : starts_at + count + 1]
        _add_border(
            n,
            count,
            starts,
            pools.fixed_col[columns_at : columns_at + starts[count]],
            pools.fixed[values_at : values_at + starts[count]],
            m,
            x,
            out,
        )


@kernel
def _field(pools: Any, c: int, place: int, order: int, instant: int, out: Array) -> None:
    """Displacements (``order`` 0), velocities (1) or accelerations (2) of dofs and motions into ``out``."""
    row, run = pools.classes[c], pools.run[0]
    size, count = row.n * row.m, row.n_motion * row.m
    for i in range(size):
        out[i] = pools.moving[place + i]
    if count > 0:
        at = row.motions + (order * run.n_time + instant) * count
        for i in range(count):
            out[size + i] = pools.moving[at + i]


@kernel
def _loads(pools: Any, c: int, instant: int, out: Array) -> None:
    """Loads of the scene on the dofs (n m,)."""
    row = pools.classes[c]
    for i in range(row.n * row.m):
        out[i] = pools.moving[row.work_loads + i]
    n = row.work_terms
    if n > 0:
        starts = pools.moving_int[row.work_starts : row.work_starts + n + 1]
        at = row.work_amplitudes + n * instant
        add_terms(
            n,
            starts,
            pools.moving_int[row.work_rows : row.work_rows + starts[n]],
            pools.moving[row.work_values : row.work_values + starts[n]],
            pools.moving[at : at + n],
            1.0,
            out,
        )


@kernel
def _tractions(pools: Any, c: int, flat: Array, out: Array) -> None:
    """Nodal forces (n m,) of tractions (N,) on the dofs."""
    row, work = pools.classes[c], pools.moving
    m, n_inner, size = row.m, row.n_inner, row.n_channel * row.m
    channels = pools.fixed_int[row.channels : row.channels + size]
    nodal, inner = work[row.channel : row.channel + size], work[row.inner : row.inner + n_inner * m]
    for i in range(row.n_channel):
        for j in range(m):
            nodal[i * m + j] = pools.fixed[row.area + i] * flat[channels[i * m + j]]
    inner[:] = 0.0
    add_spread(pools, c, nodal, inner)
    out[:] = 0.0
    for i in range(n_inner):
        at = pools.fixed_int[row.dofs + i] * m
        for j in range(m):
            out[at + j] = inner[i * m + j]


@kernel
def _add_dot(m: int, factor: float, x: Array, y: Array, totals: Array) -> None:
    """totals (m,) += factor times the scalar product of each member's column."""
    for i in range(0, len(x), m):
        for j in range(m):
            totals[j] += factor * x[i + j] * y[i + j]


@kernel
def _forces(pools: Any, c: int, instant: int, flat: Array, out: Array) -> None:
    """Elastic forces, damping, loads and tractions (4, n + n_motion, m) of an instant; zeros where a motion is
    prescribed for the last two, whose share there is part of the reactions."""
    row, work = pools.classes[c], pools.moving
    size, wide = row.n * row.m, (row.n + row.n_motion) * row.m
    field = work[row.extended : row.extended + wide]
    out[:] = 0.0
    _field(pools, c, row.u, 0, instant, field)
    _product(pools, c, 1, field, out[:wide])
    if row.damping_rows > 0:
        _field(pools, c, row.v, 1, instant, field)
        _product(pools, c, 2, field, out[wide : 2 * wide])
    _loads(pools, c, instant, out[2 * wide : 2 * wide + size])
    _tractions(pools, c, flat, out[3 * wide : 3 * wide + size])


@kernel
def _state_energies(pools: Any, c: int, instant: int, elastic: Array) -> None:
    """Kinetic and elastic energy of the present motion; ``elastic``: K u."""
    row, work, state = pools.classes[c], pools.moving, pools.moving
    m, wide = row.m, (row.n + row.n_motion) * row.m
    totals = state[row.totals : row.totals + 6 * m]
    field, image = (work[row.extended : row.extended + wide], work[row.extended + wide : row.extended + 2 * wide])
    totals[: 2 * m] = 0.0
    if row.kind != STATIC:
        _field(pools, c, row.v, 1, instant, field)
        _product(pools, c, 0, field, image)
        _add_dot(m, 0.5, field, image, totals[_KINETIC * m : (_KINETIC + 1) * m])
    _field(pools, c, row.u, 0, instant, field)
    _add_dot(m, 0.5, field, elastic, totals[_ELASTIC * m : (_ELASTIC + 1) * m])


@kernel
def open_account(pools: Any, c: int, instant: int, flat: Array) -> None:
    """Begin the account of a class in its present motion under tractions flat (N,)."""
    row, state = pools.classes[c], pools.moving
    if row.accounted == 0:
        return
    m, size, wide = row.m, row.n * row.m, (row.n + row.n_motion) * row.m
    past = state[row.past : row.past + 11 * wide]
    now = past[_NOW * wide : _BEFORE * wide]
    state[row.totals : row.totals + 6 * m] = 0.0
    _forces(pools, c, instant, flat, now)
    if row.kind == STATIC:
        # loads that do not start from zero are counted as growing over the first increment
        for i in range(size):
            now[2 * wide + i] = now[i] - now[3 * wide + i]
    _state_energies(pools, c, instant, now[:wide])
    _field(pools, c, row.u, 0, instant, past[:wide])
    if row.kind == EXPLICIT:
        _keep_explicit(pools, c, instant, now[2 * wide : 3 * wide], now[:wide], past)
    else:
        _field(pools, c, row.a, 2, instant, past[_A * wide : (_A + 1) * wide])
        if row.kind != STATIC:
            _product(pools, c, 0, past[_A * wide : (_A + 1) * wide], past[_MASS_A * wide : (_MASS_A + 1) * wide])
        past[_BEFORE * wide :] = now
    _write(pools, c, instant)


@kernel
def account(pools: Any, c: int, instant: int, flat: Array, marched: bool) -> None:
    """Add the step that ends at an instant with tractions flat (N,) to the account of a class; one that rests has
    nothing to add."""
    row = pools.classes[c]
    if row.accounted == 0:
        return
    if not marched:
        _write(pools, c, instant)
        return
    if row.kind == EXPLICIT:
        _account_explicit(pools, c, instant, flat)
    else:
        _account_weighted(pools, c, instant, flat)
    _write(pools, c, instant)


@kernel
def _account_weighted(pools: Any, c: int, instant: int, flat: Array) -> None:
    """The step of a DIRECT or STATIC class."""
    row, run, work, state = pools.classes[c], pools.run[0], pools.moving, pools.moving
    n, m, wide = row.n, row.m, (row.n + row.n_motion) * row.m
    past, scratch = state[row.past : row.past + 11 * wide], work[row.extended : row.extended + 8 * wide]
    field, mass_a, new = scratch[:wide], scratch[wide : 2 * wide], scratch[4 * wide : 8 * wide]
    _forces(pools, c, instant, flat, new)
    totals = state[row.totals : row.totals + 6 * m]
    _state_energies(pools, c, instant, new[:wide])
    a = scratch[2 * wide : 3 * wide]
    mass_a[:] = 0.0
    _field(pools, c, row.a, 2, instant, a)
    if row.kind != STATIC:
        if row.n_motion == 0:
            mass_a[:] = work[row.mass_a : row.mass_a + wide]
        else:
            _product(pools, c, 0, a, mass_a)
    _field(pools, c, row.u, 0, instant, field)
    before, old, now = run.energy_before, run.energy_old, run.energy_new
    of_old, of_new, loss = run.energy_a_old, run.energy_a_new, run.inertia_dissipation
    u_old, a_old, mass_a_old = past[:wide], past[wide : 2 * wide], past[2 * wide : 3 * wide]
    then, earlier = past[_NOW * wide : _BEFORE * wide], past[_BEFORE * wide : (_BEFORE + 4) * wide]
    for j in range(m):  # sums in variables of their own: stored in every step they would not be vectorised
        of_scheme = of_damping = of_interface = of_loads = 0.0
        for at in range(j, wide, m):
            step = field[at] - u_old[at]
            elastic = before * earlier[at] + old * then[at] + now * new[at]
            of_scheme += step * (elastic - 0.5 * (then[at] + new[at]))
            of_scheme += loss * (of_old * a_old[at] + of_new * a[at]) * (mass_a[at] - mass_a_old[at])
            of_damping += step * (before * earlier[wide + at] + old * then[wide + at] + now * new[wide + at])
            second, third = 2 * wide + at, 3 * wide + at
            of_loads += step * (before * earlier[second] + old * then[second] + now * new[second])
            of_interface += step * (before * earlier[third] + old * then[third] + now * new[third])
        for at in range(n * m + j, wide, m):  # reactions of prescribed motions, which carry no loads
            force = of_old * mass_a_old[at] + of_new * mass_a[at]
            force += before * earlier[at] + old * then[at] + now * new[at]
            force += before * earlier[wide + at] + old * then[wide + at] + now * new[wide + at]
            of_loads += (field[at] - u_old[at]) * force
        totals[_SCHEME * m + j] += of_scheme
        totals[_DAMPING * m + j] += of_damping
        totals[_INTERFACE * m + j] += of_interface
        totals[_LOADS * m + j] += of_loads
    past[_BEFORE * wide :] = past[_NOW * wide : _BEFORE * wide]
    past[_NOW * wide : _BEFORE * wide] = new
    past[:wide] = field
    past[_A * wide : (_A + 1) * wide] = a
    past[_MASS_A * wide : (_MASS_A + 1) * wide] = mass_a


@kernel
def _account_explicit(pools: Any, c: int, instant: int, flat: Array) -> None:
    """The step of an EXPLICIT class; the elastic force of its middle is K u + dt/2 K v of the old instant."""
    row, work, state = pools.classes[c], pools.moving, pools.moving
    n, m, wide, dt = row.n, row.m, (row.n + row.n_motion) * row.m, pools.run[0].dt
    past, scratch = state[row.past : row.past + 11 * wide], work[row.extended : row.extended + 8 * wide]
    new = scratch[4 * wide : 8 * wide]
    damping, field, moved = scratch[:wide], scratch[wide : 2 * wide], scratch[2 * wide : 3 * wide]
    dashpots = scratch[3 * wide : 4 * wide]
    _field(pools, c, row.v, 1, instant, field)
    for i in range(wide):
        moved[i] = 0.5 * (field[i] - past[_V * wide + i])
    damping[:] = 0.0
    dashpots[:] = 0.0
    if row.damping_rows > 0:
        _product(pools, c, 2, past[_V * wide : (_V + 1) * wide], damping)
        if row.dashpots_rows > 0:
            _product(pools, c, 3, moved, dashpots)
        for i in range(wide):
            damping[i] += dashpots[i]
    _forces_without_damping(pools, c, instant, flat, moved, new)
    totals = state[row.totals : row.totals + 6 * m]
    mass_v, k_v = new[wide : 2 * wide], dashpots
    _product(pools, c, 0, field, mass_v)
    _product(pools, c, 1, field, k_v)
    totals[: 2 * m] = 0.0
    _add_dot(m, 0.5, field, mass_v, totals[_KINETIC * m : (_KINETIC + 1) * m])
    _add_dot(m, -dt * dt / 8, field, k_v, totals[_SCHEME * m : (_SCHEME + 1) * m])
    _add_dot(
        m,
        dt * dt / 8,
        past[_V * wide : (_V + 1) * wide],
        past[_K_V * wide : (_K_V + 1) * wide],
        totals[_SCHEME * m : (_SCHEME + 1) * m],
    )
    _field(pools, c, row.u, 0, instant, moved)
    _add_dot(m, 0.5, moved, new[:wide], totals[_ELASTIC * m : (_ELASTIC + 1) * m])
    for i in range(n + row.n_motion):
        for j in range(m):
            at = i * m + j
            step = moved[at] - past[at]
            loads = 0.5 * (past[_FORCE * wide + at] + new[2 * wide + at])
            if i >= n:
                internal = past[_K_U * wide + at] + 0.5 * dt * past[_K_V * wide + at]
                loads = (mass_v[at] - past[_MASS_V * wide + at]) / dt + internal + damping[at]
            totals[_DAMPING * m + j] += step * damping[at]
            totals[_INTERFACE * m + j] += step * new[3 * wide + at]
            totals[_LOADS * m + j] += step * loads
    past[:wide] = moved
    _keep_explicit(pools, c, instant, new[2 * wide : 3 * wide], new[:wide], past)


@kernel
def _forces_without_damping(pools: Any, c: int, instant: int, flat: Array, field: Array, out: Array) -> None:
    """Elastic forces, nothing, loads and tractions (4, n + n_motion, m); ``field`` is scratch and keeps u."""
    row = pools.classes[c]
    size, wide = row.n * row.m, (row.n + row.n_motion) * row.m
    out[:] = 0.0
    _field(pools, c, row.u, 0, instant, field)
    _product(pools, c, 1, field, out[:wide])
    _loads(pools, c, instant, out[2 * wide : 2 * wide + size])
    _tractions(pools, c, flat, out[3 * wide : 3 * wide + size])


@kernel
def _keep_explicit(pools: Any, c: int, instant: int, loads: Array, elastic: Array, past: Array) -> None:
    """Keep velocities, K v, loads, K u and M v for the next step."""
    wide = len(elastic)
    kept_loads, kept_elastic = (past[_FORCE * wide : (_FORCE + 1) * wide], past[_K_U * wide : (_K_U + 1) * wide])
    for i in range(wide):  # element by element: ``elastic`` and ``loads`` may lie in ``past``
        now_loads, now_elastic = loads[i], elastic[i]
        kept_loads[i], kept_elastic[i] = now_loads, now_elastic
    velocity = past[_V * wide : (_V + 1) * wide]
    _field(pools, c, pools.classes[c].v, 1, instant, velocity)
    _product(pools, c, 1, velocity, past[_K_V * wide : (_K_V + 1) * wide])
    _product(pools, c, 0, velocity, past[_MASS_V * wide : (_MASS_V + 1) * wide])


@kernel
def _write(pools: Any, c: int, instant: int) -> None:
    """Keep the totals among the histories."""
    row = pools.classes[c]
    size = 6 * row.m
    at = row.energies + size * (instant - pools.run[0].first_row)
    for i in range(size):
        pools.moving[at + i] = pools.moving[row.totals + i]
