"""Energies of the members of a class: each term is computed on its own, none as the remainder of the others.

Dofs and prescribed motions together, D the change over a step from instant n to n + 1, ( )_w weighted over the instants
n - 1, n, n + 1 and a_w over n, n + 1 as the time scheme does (``TimeScheme.energy_weights``):

    DIRECT    D T + D V + Du.(C v)_w + Du.[(K y)_w - mean K y] + x a_w.M Da = Du.f_w + Du.lambda_w + reactions
    one step  D T + D V + Du.C v_w + Du.[(K y)_w - mean K y] + x Da.M a_w + d v_m.M Da
              = Du.f_w + Du.lambda + reactions
    EXPLICIT  D T + D V - dt^2/8 D[v.K v] + Du.(C v_n + C_d Dv / 2) = Du.mean f + Du.lambda_{n+1} + reactions
    STATIC    D V = Du.(mean f + mean lambda) + reactions

"one step" is a DIRECT class whose scheme says so (``TimeScheme.one_step_energy``): v_w with the velocities of massless
nodes as marched, v_m the mean velocity of the step, d = ``inertia_drift``, lambda with own weights. K has the
geometric stiffness K_sigma of the stress of t = 0 in it, and V its energy u.K_sigma u / 2, a term of its own. K y is
K u and the forces of Maxwell branches, whose energies and losses are among V and those of C (``maxwell``). The part of
C that is the viscosity of the contact layer has a term of its own. x = ``inertia_dissipation``; f loads, lambda
tractions of the interfaces; reactions work where the motion is prescribed and are counted with the loads. That of
inertia works on the step that the recursion of the scheme makes of v and a: a displacement law departs from it at a
corner. The sums hold up to round-off. Each step costs one product, K u (EXPLICIT classes: K v too, with K_sigma
K_sigma u): M a comes from the march, and M v follows the recursion that the scheme has for v.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from .energy_parts import (
    DAMPED,
    ELASTIC,
    INTERFACE_WORK,
    KINETIC,
    N_TERM,
    OF_LANDING,
    OF_SCHEME,
    WORK_OF_LOADS,
    add_borders,
    add_dot,
    add_work,
    copied,
    part_prestress,
    state_energies,
    step_forces,
    step_of,
    whole_field,
    whole_product,
)
from .face import inertial_energy, relaxed_energy
from .matrices import LOADS, add_sum
from .maxwell import account_branches, account_explicit_branches, open_branches
from .records import EXPLICIT, STATIC
from .splits import DAMPING, DASHPOTS, LANDING, MASS, STIFFNESS, add_product

Array = NDArray[np.float64]

FIELDS = 16
"""Fields of ``past``."""
# their places, displacements first: accelerations, M a and M v of the dofs alone, then the forces (K u, C v, loads,
# tractions) of the last three instants in turn
_A = 1
_MASS_A = 2
_MASS_V = 3
_RING = 4
# of EXPLICIT classes: velocities, K v, loads, K u, M v
_V = 1
_K_V = 2
_LOAD = 3
_K_U = 4
_OLD_MASS_V = 5


@kernel
def open_account(pools: Any, c: int, instant: int, flat: Array) -> None:
    """Begin the account of a class in its present motion under tractions flat (N,)."""
    row = pools.classes[c]
    work = pools.moving
    state = pools.moving
    if row.accounted == 0:
        return
    m = row.m
    size = row.n * row.m
    wide = (row.n + row.n_motion) * row.m
    past, scratch = state[row.past : row.past + FIELDS * wide], work[row.extended : row.extended + 4 * wide]
    now = past[_RING * wide : (_RING + 4) * wide]
    mass_v = scratch[2 * wide : 2 * wide + size]
    image = scratch[3 * wide :]
    state[row.totals : row.totals + N_TERM * m] = 0.0
    past[:] = 0.0
    mass_v[:] = 0.0
    u, v = (
        whole_field(pools, c, row.u, 0, instant, scratch[:wide]),
        whole_field(pools, c, row.v, 1, instant, scratch[wide : 2 * wide]),
    )
    step_forces(pools, c, instant, flat, u, now)
    if row.kind != STATIC:
        add_product(pools, c, MASS, 1.0, v[:size], mass_v)
    state_energies(pools, c, u, v, mass_v, now[:wide], image)
    if row.n_inertial > 0:
        state[row.totals + KINETIC * m] += inertial_energy(pools, c)
    if row.n_branch > 0:
        # what an EXPLICIT class keeps is K u itself
        open_branches(pools, c, instant, image if row.kind == EXPLICIT else now[:wide], image)
    if row.kind == EXPLICIT and row.loads_only == 0:
        _open_explicit(pools, c, u, v)
        _write(pools, c, instant)
        return
    if row.kind == STATIC:
        # loads that do not start from zero are counted as growing over the first increment
        dofs = pools.fixed_int[row.dofs : row.dofs + row.n_inner]
        copied(now[:size], now[2 * wide : 2 * wide + size])
        for i in range(len(dofs)):
            for j in range(m):
                now[2 * wide + dofs[i] * m + j] -= now[3 * wide + i * m + j]
    else:
        add_product(pools, c, MASS, 1.0, state[row.a : row.a + size], past[_MASS_A * wide : _MASS_A * wide + size])
        copied(mass_v, past[_MASS_V * wide : _MASS_V * wide + size])
        copied(whole_field(pools, c, row.a, 2, instant, image), past[_A * wide : (_A + 1) * wide])
    if row.damping_rows > 0:
        whole_product(pools, c, DAMPING, v, now[wide : 2 * wide])
    copied(u, past[:wide])
    # instant -1 has the forces of instant 0: places 0 and 1 of the ring
    copied(now, past[(_RING + 4) * wide : (_RING + 8) * wide])
    state[row.turn] = 2.0  # place of the next instant in the ring
    _write(pools, c, instant)


@kernel
def account(pools: Any, c: int, instant: int, flat: Array, marched: bool) -> None:
    """Add the step that ends at an instant with tractions flat (N,) to the account of a class; a class at
    rest adds nothing."""
    row = pools.classes[c]
    if row.accounted == 0:
        return
    if marched and row.loads_only == 1:
        _account_loads(pools, c, instant)
    elif marched and row.kind == EXPLICIT:
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
    # now, two instants before, one before; the next instant takes the place of the oldest
    new, earlier, then = (
        ring[4 * turn * wide :],
        ring[4 * ((turn + 1) % 3) * wide :],
        ring[4 * ((turn + 2) % 3) * wide :],
    )
    state[row.turn] = (turn + 1) % 3
    u, v = (
        whole_field(pools, c, row.u, 0, instant, scratch[:wide]),
        whole_field(pools, c, row.v, 1, instant, scratch[wide : 2 * wide]),
    )
    step_forces(pools, c, instant, flat, u, new)
    one_step = run.one_step == 1.0
    if row.damping_rows > 0 and not one_step:
        whole_product(pools, c, DAMPING, v, new[wide : 2 * wide])
    totals, inner = state[row.totals : row.totals + N_TERM * m], work[row.inner : row.inner + inner_size]
    of_loads, of_interface = (
        totals[WORK_OF_LOADS * m : (WORK_OF_LOADS + 1) * m],
        totals[INTERFACE_WORK * m : (INTERFACE_WORK + 1) * m],
    )
    of_damping, of_scheme = totals[DAMPED * m : (DAMPED + 1) * m], totals[OF_SCHEME * m : (OF_SCHEME + 1) * m]
    step_of(pools, c, u, past[:wide], step, inner)
    copied(u, past[:wide])
    if row.kind != STATIC:
        _account_inertia(pools, c, of_scheme)
    state_energies(pools, c, u, v, past[_MASS_V * wide : _MASS_V * wide + size], new[:wide], image)
    account_relaxed(pools, c, totals)
    if row.n_branch > 0:
        # u and v, which stand in the first half of the scratch, have been read
        account_branches(pools, c, instant, step, new[:wide], then[:wide], scratch[: 2 * wide])
    if row.kind != STATIC and row.n_motion > 0:
        _account_moved_inertia(pools, c, instant, of_loads, of_scheme)
    before, old, now = run.energy_before, run.energy_old, run.energy_new
    # (K y)_w - mean K y
    add_work(m, (before, old - 0.5, now - 0.5), step, earlier[:wide], then[:wide], new[:wide], of_scheme)
    at, end = 2 * wide, 2 * wide + size
    add_work(m, (before, old, now), step[:size], earlier[at:end], then[at:end], new[at:end], of_loads)
    at, end = 3 * wide, 3 * wide + inner_size
    weights = run.traction_before, run.traction_old, run.traction_new
    add_work(m, weights, inner, earlier[at:end], then[at:end], new[at:end], of_interface)
    if row.damping_rows > 0 and one_step:
        _account_viscosity(pools, c, instant, step, new[wide : 2 * wide], totals)
        copied(new[wide : 2 * wide], then[wide : 2 * wide])  # the weights of both sum up to one
    elif row.damping_rows > 0:
        at, end = wide, 2 * wide
        add_work(m, (before, old, now), step, earlier[at:end], then[at:end], new[at:end], of_damping)
    if row.n_motion == 0:
        return
    for at in range(size, 2 * wide, wide):  # reactions of K u, of C v
        end = at + wide - size
        add_work(m, (before, old, now), step[size:], earlier[at:end], then[at:end], new[at:end], of_loads)


@kernel
def account_relaxed(pools: Any, c: int, totals: Array) -> None:
    """Losses over the step and energies of the branches of a face and its rows, and of the rows of inertia (``face``);
    of one member."""
    row = pools.classes[c]
    if row.n_relaxing > 0:
        totals[DAMPED] += pools.moving[row.relaxed_loss]
        totals[ELASTIC] += relaxed_energy(pools, c)
    if row.n_inertial > 0:
        totals[KINETIC] += inertial_energy(pools, c)
        totals[OF_SCHEME] += pools.moving[row.inertia_loss]


@kernel
def _account_viscosity(pools: Any, c: int, instant: int, step: Array, force: Array, totals: Array) -> None:
    """Du.C v_w of a one-step identity, the viscosity of the contact layer apart; ``force`` (n + n_motion, m): C v_w."""
    row = pools.classes[c]
    run = pools.run[0]
    work = pools.moving
    m = row.m
    size = row.n * row.m
    wide = (row.n + row.n_motion) * row.m
    scratch = work[row.extended : row.extended + 4 * wide]
    weighted, image = scratch[:wide], scratch[3 * wide :]
    copied(work[row.weighted_v : row.weighted_v + size], weighted[:size])
    count = row.n_motion * m
    now = row.motions + (run.n_time + instant) * count
    for i in range(count):
        weighted[size + i] = run.force_old * work[now - count + i] + run.force_weight * work[now + i]
    whole_product(pools, c, DAMPING, weighted, force)
    landing = totals[OF_LANDING * m : (OF_LANDING + 1) * m]
    if row.landing_rows == 0:
        add_dot(m, 1.0, step, force, totals[DAMPED * m : (DAMPED + 1) * m])
        return
    whole_product(pools, c, LANDING, weighted, image)
    add_dot(m, 1.0, step, image, landing)
    if row.damped == 1:
        # the rest of C, where there is any
        for i in range(wide):
            image[i] = force[i] - image[i]
        add_dot(m, 1.0, step, image, totals[DAMPED * m : (DAMPED + 1) * m])


@kernel
def _account_inertia(pools: Any, c: int, of_scheme: Array) -> None:
    """x a_w.M Da of the dofs; M v from M a by the recursion of v, a product less. Keeps M a."""
    row, run = pools.classes[c], pools.run[0]
    m = row.m
    size = row.n * row.m
    wide = (row.n + row.n_motion) * row.m
    past = pools.moving[row.past : row.past + _RING * wide]
    a, mass_a = pools.moving[row.a : row.a + size], pools.moving[row.mass_a : row.mass_a + size]
    a_old, mass_a_old = past[_A * wide : _A * wide + size], past[_MASS_A * wide : _MASS_A * wide + size]
    mass_v = past[_MASS_V * wide : _MASS_V * wide + size]
    of_old = run.energy_a_old
    of_new = run.energy_a_new
    loss = run.inertia_dissipation
    if loss != 0.0:
        for j in range(m):
            total = 0.0
            for at in range(j, size, m):
                total += (of_old * a_old[at] + of_new * a[at]) * (mass_a[at] - mass_a_old[at])
            of_scheme[j] += loss * total
    of_old = run.v_a
    of_new = run.velocity_gain
    drift = run.inertia_drift
    for j in range(m if drift != 0.0 else 0):
        total = 0.0
        for at in range(j, size, m):
            mean = mass_v[at] + 0.5 * (of_old * mass_a_old[at] + of_new * mass_a[at])
            total += mean * (a[at] - a_old[at])
        of_scheme[j] += drift * total
    for i in range(size):
        mass_v[i] += of_old * mass_a_old[i] + of_new * mass_a[i]
    copied(mass_a, mass_a_old)  # M a of the next step's old instant
    # with motions ``_account_moved_inertia`` keeps a, as it needs the old one
    if row.n_motion == 0:
        copied(a, a_old)


@kernel
def _account_moved_inertia(pools: Any, c: int, instant: int, of_loads: Array, of_scheme: Array) -> None:
    """What prescribed motions add to x a_w.M Da, and their reactions M a_w."""
    row, run = pools.classes[c], pools.run[0]
    m = row.m
    size = row.n * row.m
    wide = (row.n + row.n_motion) * row.m
    past = pools.moving[row.past + _A * wide : row.past + (_A + 1) * wide]
    scratch = pools.moving[row.extended : row.extended + 4 * wide]
    mean, image = scratch[wide : 2 * wide], scratch[3 * wide :]
    a = whole_field(pools, c, row.a, 2, instant, scratch[:wide])
    of_old = run.energy_a_old
    of_new = run.energy_a_new
    for i in range(wide):
        # a_w, and Da in the place of the old accelerations, which are put back below
        mean[i], past[i] = of_old * past[i] + of_new * a[i], a[i] - past[i]
    image[:] = 0.0
    add_borders(pools, c, MASS, past, image)
    add_dot(m, run.inertia_dissipation, mean, image, of_scheme)
    if run.inertia_drift != 0.0:
        _add_drift(pools, c, instant, a, past, image, of_scheme)
    image[:] = 0.0
    add_borders(pools, c, MASS, mean, image)
    # M a_w works on the step of the recursion, with which the kinetic energy of the whole motion closes
    followed, before = mean[size:], row.motions + (run.n_time + instant - 1) * (wide - size)
    for i in range(wide - size):
        a_new = a[size + i]
        a_old = a_new - past[size + i]
        followed[i] = run.u_v * pools.moving[before + i] + run.u_a * a_old + run.displacement_gain * a_new
    add_dot(m, 1.0, followed, image[size:], of_loads)
    copied(a, past)


@kernel
def _add_drift(pools: Any, c: int, instant: int, a: Array, change: Array, image: Array, of_scheme: Array) -> None:
    """What prescribed motions add to d v_m.M Da; ``change`` Da and ``image`` its product (n + n_motion, m)."""
    row, run = pools.classes[c], pools.run[0]
    m = row.m
    size = row.n * row.m
    count = row.n_motion * row.m
    moved = row.motions + (run.n_time + instant) * count
    half_old, half_new = 0.5 * run.v_a, 0.5 * run.velocity_gain
    for j in range(m):
        total = 0.0
        for at in range(j, size + count, m):
            v = pools.moving[row.v + at] if at < size else pools.moving[moved + at - size]
            total += (v - half_old * (a[at] - change[at]) - half_new * a[at]) * image[at]
        of_scheme[j] += run.inertia_drift * total


@kernel
def _open_explicit(pools: Any, c: int, u: Array, v: Array) -> None:
    """Fields of an EXPLICIT class at the start, from the forces in the place of the ring."""
    row = pools.classes[c]
    wide = len(u)
    past = pools.moving[row.past : row.past + FIELDS * wide]
    copied(past[(_RING + 2) * wide : (_RING + 3) * wide], past[_LOAD * wide : (_LOAD + 1) * wide])
    copied(u, past[:wide])
    copied(v, past[_V * wide : (_V + 1) * wide])
    whole_product(pools, c, STIFFNESS, v, past[_K_V * wide : (_K_V + 1) * wide])
    whole_product(pools, c, MASS, v, past[_OLD_MASS_V * wide : (_OLD_MASS_V + 1) * wide])


@kernel
def _account_loads(pools: Any, c: int, instant: int) -> None:
    """Du.f_w of the step alone, of a class without prescribed motions; u and loads in their places of ``past``."""
    row = pools.classes[c]
    run = pools.run[0]
    state = pools.moving
    m = row.m
    size = row.n * row.m
    turn = int(state[row.turn])
    past, step = state[row.past : row.past + FIELDS * size], state[row.extended : row.extended + size]
    new = past[(_RING + 4 * turn + 2) * size :][:size]
    earlier = past[(_RING + 4 * ((turn + 1) % 3) + 2) * size :][:size]
    then = past[(_RING + 4 * ((turn + 2) % 3) + 2) * size :][:size]
    state[row.turn] = (turn + 1) % 3
    # constant loads, then those that vary
    copied(state[row.work_loads : row.work_loads + size], new)
    add_sum(pools, c, LOADS, instant, 1.0, new)
    u = state[row.u : row.u + size]
    for i in range(size):
        step[i] = u[i] - past[i]
    weights = run.energy_before, run.energy_old, run.energy_new
    if row.kind == EXPLICIT:  # mean of both instants
        weights = 0.0, 0.5, 0.5
    add_work(m, weights, step, earlier, then, new, state[row.totals + WORK_OF_LOADS * m :][:m])
    copied(u, past[:size])


@kernel
def _account_explicit(pools: Any, c: int, instant: int, flat: Array) -> None:
    """The step of an EXPLICIT class; the elastic force of its middle is K u + dt/2 K v of the old instant."""
    row = pools.classes[c]
    work = pools.moving
    state = pools.moving
    dt = pools.run[0].dt
    m = row.m
    size = row.n * row.m
    wide = (row.n + row.n_motion) * row.m
    inner_size = row.n_inner * row.m
    past, scratch = state[row.past : row.past + FIELDS * wide], work[row.extended : row.extended + 4 * wide]
    step = past[:wide]
    damping = past[6 * wide : 7 * wide]
    k_v = past[7 * wide : 8 * wide]
    mass_v = past[8 * wide : 9 * wide]
    new, v_old = past[12 * wide :], past[_V * wide : (_V + 1) * wide]
    u, v = (
        whole_field(pools, c, row.u, 0, instant, scratch[:wide]),
        whole_field(pools, c, row.v, 1, instant, scratch[wide : 2 * wide]),
    )
    step_forces(pools, c, instant, flat, u, new)
    damping[:] = 0.0
    if row.damping_rows > 0:
        whole_product(pools, c, DAMPING, v_old, damping)
    if row.dashpots_rows > 0:
        for i in range(wide):
            k_v[i] = 0.5 * (v[i] - v_old[i])
        whole_product(pools, c, DASHPOTS, k_v, mass_v)
        for i in range(wide):
            damping[i] += mass_v[i]
    whole_product(pools, c, MASS, v, mass_v)
    whole_product(pools, c, STIFFNESS, v, k_v)
    totals, inner = state[row.totals : row.totals + N_TERM * m], work[row.inner : row.inner + inner_size]
    of_loads, of_scheme = (
        totals[WORK_OF_LOADS * m : (WORK_OF_LOADS + 1) * m],
        totals[OF_SCHEME * m : (OF_SCHEME + 1) * m],
    )
    totals[: 3 * m] = 0.0  # stored energies are those of now
    add_dot(m, 0.5, v, mass_v, totals[KINETIC * m : (KINETIC + 1) * m])
    add_dot(m, 0.5, u, new[:wide], totals[ELASTIC * m : (ELASTIC + 1) * m])
    part_prestress(pools, c, u, totals, scratch[3 * wide :])
    # -dt^2/8 D[v.K v]
    add_dot(m, -dt * dt / 8, v, k_v, of_scheme)
    add_dot(m, dt * dt / 8, v_old, past[_K_V * wide : (_K_V + 1) * wide], of_scheme)
    step_of(pools, c, u, past[:wide], step, inner)  # in place of the old displacements
    add_dot(m, 1.0, step, damping, totals[DAMPED * m : (DAMPED + 1) * m])
    add_dot(m, 1.0, inner, new[3 * wide : 3 * wide + inner_size], totals[INTERFACE_WORK * m : (INTERFACE_WORK + 1) * m])
    load_old, load = past[_LOAD * wide : _LOAD * wide + size], new[2 * wide : 2 * wide + size]
    add_work(m, (0.0, 0.5, 0.5), step[:size], load_old, load_old, load, of_loads)
    if row.n_motion > 0:
        _account_explicit_reactions(pools, c, v, new[:wide], damping, of_loads)
    if row.n_branch > 0:
        _account_strains(pools, c, instant, past, new[:wide])
    copied(u, past[:wide])
    copied(v, past[_V * wide : (_V + 1) * wide])
    copied(k_v, past[_K_V * wide : (_K_V + 1) * wide])
    copied(new[2 * wide : 3 * wide], past[_LOAD * wide : (_LOAD + 1) * wide])
    copied(new[:wide], past[_K_U * wide : (_K_U + 1) * wide])
    copied(mass_v, past[_OLD_MASS_V * wide : (_OLD_MASS_V + 1) * wide])


@kernel
def _account_explicit_reactions(pools: Any, c: int, v: Array, k_u: Array, damping: Array, of_loads: Array) -> None:
    """Work of the reactions of an EXPLICIT class; ``k_u`` K u and ``damping`` C v of the step (n + n_motion, m)."""
    row, dt = pools.classes[c], pools.run[0].dt
    size, wide = row.n * row.m, len(v)
    past = pools.moving[row.past : row.past + FIELDS * wide]
    # behind u and v
    scratch = pools.moving[row.extended + 2 * wide : row.extended + 4 * wide]
    # Du stands in the place of the old displacements
    moved, v_old = past[size:wide], past[_V * wide + size : (_V + 1) * wide]
    k_v_old, k_v = past[_K_V * wide + size : (_K_V + 1) * wide], past[7 * wide + size : 8 * wide]
    mass_v_old, mass_v = past[_OLD_MASS_V * wide + size : (_OLD_MASS_V + 1) * wide], past[8 * wide + size : 9 * wide]
    k_u_old = past[_K_U * wide + size : (_K_U + 1) * wide]
    # of C v and K u + dt/2 K v
    add_work(row.m, (1.0, 1.0, 0.5 * dt), moved, damping[size:], k_u_old, k_v_old, of_loads)
    # of M Dv / dt, which works on dt v_m; the rest e = Du - dt v_m of the step adds e.(K Du / 2 + dt/4 K Dv)
    followed, rest = scratch[: wide - size], scratch[wide : 2 * wide - size]
    for i in range(wide - size):
        followed[i] = 0.5 * dt * (v_old[i] + v[size + i])
        rest[i] = moved[i] - followed[i]
    add_work(row.m, (-1 / dt, 1 / dt, 0.0), followed, mass_v_old, mass_v, mass_v_old, of_loads)
    add_work(row.m, (-0.5, 0.5, 0.0), rest, k_u_old, k_u[size:], k_u_old, of_loads)
    add_work(row.m, (-0.25 * dt, 0.25 * dt, 0.0), rest, k_v_old, k_v, k_v_old, of_loads)


@kernel
def _account_strains(pools: Any, c: int, instant: int, past: Array, force: Array) -> None:
    """Energies of the Maxwell branches of an EXPLICIT class over a step, whose Du stands at the head of ``past``;
    ``force`` : K u."""
    wide, half = len(force), 0.5 * pools.run[0].dt
    middle = past[9 * wide : 10 * wide]
    of_middle = past[10 * wide : 11 * wide]
    of_step = past[11 * wide : 12 * wide]
    for i in range(wide):
        middle[i], of_middle[i] = half * past[_V * wide + i], half * past[_K_V * wide + i]
        of_step[i] = force[i] - past[_K_U * wide + i]
    account_explicit_branches(pools, c, instant, middle, of_middle, past[:wide], of_step)


@kernel
def _write(pools: Any, c: int, instant: int) -> None:
    """Keep the totals among the histories."""
    row = pools.classes[c]
    size = N_TERM * row.m
    at = row.energies + size * (instant - pools.run[0].first_row)
    pools.moving[at : at + size] = pools.moving[row.totals : row.totals + size]
