"""One class of substructures over one instant, Eqs. (9)-(14); arrays of a class are flat (rows x members).

With the predictors u_free, v_free of the scheme and A the operator of the march, one instant of a DIRECT or EXPLICIT
class is

    A a = w (f - K y_free - C v_free) - w_memory R_old - w_m M a_imposed + w_t T^T area F
    W = w_free + Y area (q - q_0), q_0 = F_0 + k w_free    the linear stage F = q - k W on the dashpots k
    v = v_free + velocity_gain a,  u = u_free + u_late v_free + displacement_gain a

y_free is u_free, with Maxwell branches the displacements that K takes then (``maxwell``). With the velocities w_free of
the channels under the loads and under tractions F_0, those of the last instant (``reference``) where steps are short:
q_0 is the first guess then, and its linear stage W = w_free takes no product.
w, w_memory, w_m, w_t = ``force_weight``, ``memory_weight``, ``mass_weight``, ``traction_weight``. Where
``force_old`` is not zero, forces and M a of the old instant enter each with a weight of their own,

    A a = f_w - K u_w - C v_w - mass_old (M a)_old - w_m M a_imposed + w_t T^T area F
    ( )_w = w ( )_new + force_old ( )_old,   u_free and v_free for the new u and v

K u_w being one product; ``residual`` keeps mass_old (M a)_old - force_old f_old.

A STATIC class is supported by the springs k/dt of the search direction,

    (K + T^T area k/dt T) (u_new - u) = f_new - K u + T^T area q,   W = T (u_new - u) / dt,

whose operator is regular for a floating body too. For factors that the kernels do not hold (``factored`` 0) the
caller solves (``callouts``).
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from .callouts import BACKWARD, FORWARD, call_out
from .face import count_from_start, keep_face_forces, keep_load, subtract_face
from .half_solves import add_on_face, add_reference, backward, forward, from_face, on_springs, swept_response
from .matrices import FORCES, INERTIA, VELOCITIES, add_spread, add_sum, add_trace, springs
from .maxwell import leave_instant, reach_instant, subtract_strained
from .patched import memory_for, patched_product
from .products import packed_product, symmetric_size, tile_width
from .records import STATIC
from .splits import DAMPING, MASS, STIFFNESS, add_product, dense, substitute, tile_of

Array = NDArray[np.float64]

ROUND_OFF: Final = 1e-14
"""Change of q, over its largest value, that counts as none."""


@kernel
def predict(pools: Any, c: int, instant: int) -> None:
    """Free response of the new ``instant``; leaves w_free, free_a and the half solution of the load."""
    free_load(pools, c, instant)
    add_reference(pools, c)
    keep_load(pools, c)
    if pools.moving[pools.classes[c].passed] == 0.0:
        if pools.classes[c].factored == 1:
            forward(pools, c)
        else:
            call_out(pools, FORWARD, c, 0, 0)
        free_velocity(pools, c, instant)


@kernel
def resting(pools: Any, c: int, instant: int) -> bool:
    """Whether the class has not moved, and nothing but its interfaces drives it at this instant."""
    row = pools.classes[c]
    if row.driven == 1 or pools.run[0].rest_traction < 0.0 or pools.moving[row.rest] == 0.0:
        return False
    if row.divided == 1:  # the members that other processes hold may move
        return False
    at = row.force_amplitudes + row.force_terms * instant
    for t in range(row.force_terms):  # noqa: SIM110, kernels have no generators
        if pools.moving[at + t] != 0.0:
            return False
    return True


@kernel
def free_load(pools: Any, c: int, instant: int) -> None:
    """Predictors of the scheme and the load on the right of A; ``passed`` is set where the class rests."""
    row, run, state, work = pools.classes[c], pools.run[0], pools.moving, pools.moving
    m, size = row.m, row.n * row.m
    u, v, a = state[row.u : row.u + size], state[row.v : row.v + size], state[row.a : row.a + size]
    u_free, v_free = work[row.u_free : row.u_free + size], work[row.v_free : row.v_free + size]
    load = work[row.load : row.load + size]
    work[row.passed] = 1.0 if resting(pools, c, instant) else 0.0
    if work[row.passed] == 1.0:
        u_free[:] = 0.0
        v_free[:] = 0.0
        load[:] = 0.0
        # nothing has moved and nothing drives it: no product
        work[row.free_a : row.free_a + row.n_inner * m] = 0.0
        work[row.w_free : row.w_free + row.n_channel * m] = 0.0
        return
    constant = pools.moving[row.constant : row.constant + size]
    for i in range(size):
        load[i] = constant[i]
    add_sum(pools, c, FORCES, instant, 1.0, load)
    # increments: K u of the old displacements stands on the right-hand side
    if row.kind == STATIC:
        for i in range(size):
            u_free[i] = u[i]
        add_product(pools, c, STIFFNESS, -1.0, u, load)
        return
    # locals: numbers of a record are loaded anew after every store of a loop
    u_v, u_a, v_a = run.u_v, run.u_a, run.v_a
    for i in range(size):
        u_free[i] = u[i] + u_v * v[i] + u_a * a[i]
        v_free[i] = v[i] + v_a * a[i]
    count_from_start(pools, c)
    residual = state[row.residual : row.residual + size]
    weight, memory, old = run.force_weight, run.memory_weight, run.force_old
    if old != 0.0:
        mean = work[row.mass_a : row.mass_a + size]
        # old and new parts before the products: one product with K, one with C
        for i in range(size):
            load[i] = weight * load[i] - residual[i]
            mean[i] = weight * u_free[i] + old * u[i]
        if row.n_branch > 0:
            subtract_strained(pools, c, weight, old, mean, load)
        else:
            add_product(pools, c, STIFFNESS, -1.0, mean, load)
        if row.damping_rows > 0:
            for i in range(size):
                mean[i] = weight * v_free[i] + old * v[i]
            add_product(pools, c, DAMPING, -1.0, mean, load)
    else:
        if row.n_branch > 0:
            strained = work[row.mass_a : row.mass_a + size]
            for i in range(size):
                strained[i] = u_free[i]
            subtract_strained(pools, c, 1.0, 0.0, strained, load)
        else:
            add_product(pools, c, STIFFNESS, -1.0, u_free, load)
        add_product(pools, c, DAMPING, -1.0, v_free, load)
        subtract_face(pools, c)
        for i in range(size):
            load[i] = weight * load[i] - memory * residual[i]
    add_sum(pools, c, INERTIA, instant, -run.mass_weight, load)


@kernel
def free_velocity(pools: Any, c: int, instant: int) -> None:
    """Velocities of the channels under the reference tractions, from the interface part of the half solution in
    ``inner``."""
    row = pools.classes[c]
    run = pools.run[0]
    work = pools.moving
    m = row.m
    n_inner = row.n_inner
    size = row.n_channel * row.m
    inner, reached = (
        work[row.inner : row.inner + n_inner * m],
        work[row.inner_answer : row.inner_answer + n_inner * m],
    )
    free_a, w_free = work[row.free_a : row.free_a + n_inner * m], work[row.w_free : row.w_free + size]
    if row.swept == 1:
        half = work[row.half_solution : row.half_solution + row.n * tile_width(m)]
        vector = work[row.face_vector : row.face_vector + row.n * tile_width(m)]
        # a copy: the end of the instant needs the half solution
        for i in range(len(half)):
            vector[i] = half[i]
        substitute(pools, c, row.face_vector, on_springs(pools, c), True, False)
        from_face(pools, c, reached if row.kind == STATIC else free_a)
    if row.kind == STATIC:
        if row.swept == 0:
            for i in range(n_inner * m):
                free_a[i] = inner[i]  # the load condensed on the interface
            springs(pools, c, inner, reached)
        dt = run.dt
        for i in range(n_inner * m):  # displacements of the increment -> velocities
            reached[i] /= dt
        w_free[:] = 0.0
        add_trace(pools, c, reached, w_free, False)
        damped = work[row.w_damped : row.w_damped + size]
        damped[:] = 0.0
        add_sum(pools, c, VELOCITIES, instant, 1.0, damped)
        for i in range(size):
            w_free[i] += damped[i]
        return
    if row.swept == 0:
        on_inverse(pools, c, inner, free_a)
    channel_velocity(pools, c, instant)


@kernel
def on_inverse(pools: Any, c: int, forces: Array, out: Array) -> None:
    """out (g, m) = S^-1 forces: accelerations of the interface dofs of a class whose interface dofs are last."""
    row = pools.classes[c]
    m = row.m
    n_inner = row.n_inner
    at = row.schur_inverse
    if row.patched == 1:
        header = pools.fixed_int[row.inverse_header :]
        patched_product(header, pools.fixed_single[at:], forces, out, tile_of(row, pools.moving))
        return
    inverse = pools.fixed[at : at + symmetric_size(n_inner, row.plain_inverse, m)]
    dense(pools, c, n_inner, inverse, row.plain_inverse, m, forces, out)


@kernel
def channel_velocity(pools: Any, c: int, instant: int) -> None:
    """Velocities of the channels in ``w_free`` from the accelerations of the interface dofs in ``free_a``; not without
    inertia."""
    row = pools.classes[c]
    run = pools.run[0]
    work = pools.moving
    state = pools.moving
    m, n_inner = row.m, row.n_inner
    reached, free_a = (
        work[row.inner_answer : row.inner_answer + n_inner * m],
        work[row.free_a : row.free_a + n_inner * m],
    )
    w_free = work[row.w_free : row.w_free + row.n_channel * m]
    dofs = pools.fixed_int[row.dofs : row.dofs + n_inner]
    u, u_free = state[row.u : row.u + row.n * m], work[row.u_free : row.u_free + row.n * m]
    v_free = work[row.v_free : row.v_free + row.n * m]
    of_old = run.w_u_old
    of_u = run.w_u
    of_v = run.w_v
    gain = run.interface_gain
    for i in range(n_inner):
        for j in range(m):
            at, place = dofs[i] * m + j, i * m + j
            # u is that of the old instant still; the acceleration enters by ``gain`` alone
            reached[place] = of_old * u[at] + of_u * u_free[at] + of_v * v_free[at] + gain * free_a[place]
    w_free[:] = 0.0
    add_trace(pools, c, reached, w_free, False)
    add_sum(pools, c, VELOCITIES, instant, 1.0, w_free)


@kernel
def interface_response(pools: Any, c: int, row_of_window: int, reuse: bool) -> int:
    """W at the channels of the class for q of one instant of the window (``linear_response``); number of substructures
    solved for.

    W of a class at rest is zero as long as q stays below ``rest_traction``. With ``reuse`` the last solution of a class
    is taken again where its q has changed by no more than a hundredth of the tolerance since then, in the norm of the
    error indicator divided by the number of classes.
    """
    row = pools.classes[c]
    run = pools.run[0]
    work = pools.moving
    m, size = row.m, row.n_channel * row.m
    channels = pools.fixed_int[row.channels : row.channels + size]
    q = work[run.q + row_of_window * run.n_flat : run.q + (row_of_window + 1) * run.n_flat]
    w = work[run.w + row_of_window * run.n_flat : run.w + (row_of_window + 1) * run.n_flat]
    solved_q = work[row.solved_q + row_of_window * size : row.solved_q + (row_of_window + 1) * size]
    solved_w = work[row.solved_w + row_of_window * size : row.solved_w + (row_of_window + 1) * size]
    if work[row.passed] == 1.0:
        largest = 0.0
        for at in range(size):
            largest = max(largest, abs(q[channels[at]]))
        # small tractions do not wake a class
        if largest <= run.rest_traction:
            for at in range(size):
                solved_q[at], solved_w[at] = q[channels[at]], 0.0
                w[channels[at]] = 0.0
            return 0
    if reuse:
        change = work[row.changes] if row.divided == 1 else change_of(pools, c, row_of_window)
        # of each class its share, so that all together stay below
        if change <= run.reuse * pools.moving[run.scales] / run.n_class:
            for at in range(size):
                w[channels[at]] = solved_w[at]
            return 0
    linear_response(pools, c, q, w)
    for at in range(size):
        solved_q[at], solved_w[at] = q[channels[at]], w[channels[at]]
    return int(m)


@kernel
def change_of(pools: Any, c: int, i: int) -> float:
    """Change of q of a class at instant i of the window since its last solution there, in the squared norm of the error
    indicator."""
    row = pools.classes[c]
    run = pools.run[0]
    work = pools.moving
    size, change = row.n_channel * row.m, 0.0
    channels = pools.fixed_int[row.channels : row.channels + size]
    weights = pools.fixed[run.weights : run.weights + run.n_flat]
    q = work[run.q + i * run.n_flat : run.q + (i + 1) * run.n_flat]
    solved_q = work[row.solved_q + i * size : row.solved_q + (i + 1) * size]
    for at in range(size):
        moved = q[channels[at]] - solved_q[at]
        change += weights[channels[at]] * moved * moved
    return change


@kernel
def linear_response(pools: Any, c: int, q: Array, w: Array) -> None:
    """W = w_free + Y area (q - q_0), q_0 = F_0 + k w_damped, at the channels of the class, both (N,); w_free alone for
    q_0 itself, the first guess of an instant."""
    row, work = pools.classes[c], pools.moving
    m, size = row.m, row.n_channel * row.m
    channels, w_free = pools.fixed_int[row.channels : row.channels + size], work[row.w_free : row.w_free + size]
    area, k = pools.fixed[row.area : row.area + row.n_channel], pools.fixed[row.k : row.k + row.n_channel]
    damped, reference = work[row.w_damped : row.w_damped + size], work[row.reference : row.reference + size]
    incoming = work[row.channel : row.channel + size]
    largest, apart = 0.0, 0.0
    for i in range(row.n_channel):
        for j in range(m):
            at = i * m + j
            now = q[channels[at]]
            change = now - reference[at] - k[i] * damped[at]
            largest, apart = max(largest, abs(now)), max(apart, abs(change))
            incoming[at] = area[i] * change
            w[channels[at]] = w_free[at]
    # the first guess of an instant is q_0 but for round-off
    if apart > ROUND_OFF * largest:
        add_condensed(pools, c, incoming, w)


@kernel
def add_condensed(pools: Any, c: int, incoming: Array, w: Array) -> None:
    """Add Y times the nodal forces ``incoming`` (c, m) on the channels of the class, which are overwritten, to W
    (N,)."""
    row, work = pools.classes[c], pools.moving
    if row.swept == 1:
        swept_response(pools, c, incoming, w)
        return
    m = row.m
    n_live = row.n_live
    plain = row.plain_response
    channels = pools.fixed_int[row.channels : row.channels + row.n_channel * m]
    live, answer = pools.fixed_int[row.live : row.live + n_live], work[row.answer : row.answer + n_live * m]
    for i in range(n_live):  # in ascending order
        for j in range(m):
            incoming[i * m + j] = incoming[live[i] * m + j]
    if row.patched == 1:
        header, scratch = pools.fixed_int[row.response_header :], tile_of(row, work)
        if row.halved == 1:
            table = pools.fixed_single[row.response :]
            patched_product(header, table, incoming[:n_live], answer, memory_for(scratch, table))
        else:
            patched_product(header, pools.fixed[row.response :], incoming[:n_live], answer, scratch)
    elif row.halved == 1:  # of one member
        half = pools.fixed_single[row.response : row.response + symmetric_size(n_live, plain, m)]
        packed_product(n_live, half, incoming[:n_live], answer)
    else:
        table = pools.fixed[row.response : row.response + symmetric_size(n_live, plain, m)]
        dense(pools, c, n_live, table, plain, m, incoming[: n_live * m], answer)
    for i in range(n_live):
        for j in range(m):
            w[channels[live[i] * m + j]] += answer[i * m + j]


@kernel
def add_change(pools: Any, c: int) -> None:
    """Add Y area q to W of one instant at the channels of the class."""
    row = pools.classes[c]
    run = pools.run[0]
    work = pools.moving
    incoming = work[row.channel : row.channel + row.n_channel * row.m]
    for i in range(row.n_channel):
        for j in range(row.m):
            at = i * row.m + j
            incoming[at] = pools.fixed[row.area + i] * work[run.q + pools.fixed_int[row.channels + at]]
    add_condensed(pools, c, incoming, work[run.w : run.w + run.n_flat])


@kernel
def commit(pools: Any, c: int, instant: int, flat: Array) -> int:
    """End the instant with tractions (STATIC: incoming quantities q) flat (N,) over the assembly; number of
    substructures marched."""
    work, row = pools.moving, pools.classes[c]
    rested = work[row.passed] != 0.0  # before the class is woken
    if row.sparse == 1 and work[row.ended] == 1.0:  # solved by ``solve_under_tractions``, for these tractions
        work[row.ended] = 0.0
    elif interface_load(pools, c, flat):
        if row.factored == 1:
            backward(pools, c)
        else:
            call_out(pools, BACKWARD, c, int(rested), 0)
    else:
        return 0
    advance(pools, c, instant)
    return int(row.m)


@kernel
def solve_under_tractions(pools: Any, c: int, instant: int) -> None:
    """Solution at the end of the instant under the tractions of the local stage, in ``load``, of a class with a table
    of Y. These tractions become the reference, with their exact velocities in ``w_free``."""
    row = pools.classes[c]
    run = pools.run[0]
    work = pools.moving
    m = row.m
    f_hat = work[run.local_f : run.local_f + run.n_flat]
    work[row.ended] = 1.0 if interface_load(pools, c, f_hat) else 0.0
    if work[row.ended] == 0.0:
        return
    backward(pools, c)
    end_velocity(pools, c, instant)
    # velocities under these tractions are exact from now on: the table of Y acts on changes alone
    for at in range(row.n_channel * m):
        work[row.reference + at] = f_hat[pools.fixed_int[row.channels + at]]


@kernel
def end_velocity(pools: Any, c: int, instant: int) -> None:
    """Velocities of the channels at the end of the instant, into ``w_free``, from the solution in ``load``; before
    ``advance``, as W may depend on the old displacements."""
    row = pools.classes[c]
    run = pools.run[0]
    work = pools.moving
    m, n_inner = row.m, row.n_inner
    # ``load`` holds the solution here
    for i in range(n_inner):
        for j in range(m):
            work[row.free_a + i * m + j] = work[row.load + pools.fixed_int[row.dofs + i] * m + j]
    if row.kind != STATIC:
        channel_velocity(pools, c, instant)
        return
    moved, w = work[row.free_a : row.free_a + n_inner * m], work[row.w_free : row.w_free + row.n_channel * m]
    for at in range(n_inner * m):
        moved[at] /= run.dt
    w[:] = 0.0
    add_trace(pools, c, moved, w, False)
    add_sum(pools, c, VELOCITIES, instant, 1.0, w)


@kernel
def interface_load(pools: Any, c: int, flat: Array) -> bool:
    """Interface values of the solution in ``inner_answer``, or, where the interface dofs are not kept for last, the
    forward substitution of the forces on them added to ``half_solution``; False where the class stays at rest."""
    row = pools.classes[c]
    run = pools.run[0]
    work = pools.moving
    m = row.m
    n_inner = row.n_inner
    size = row.n_channel * row.m
    channels, area = (
        pools.fixed_int[row.channels : row.channels + size],
        pools.fixed[row.area : row.area + row.n_channel],
    )
    nodal = work[row.channel : row.channel + size]
    largest = 0.0
    n_channel = row.n_channel
    for i in range(n_channel):
        for j in range(m):
            now = flat[channels[i * m + j]]
            nodal[i * m + j] = area[i] * now
            largest = max(largest, abs(now))
    reference = work[row.reference : row.reference + size]
    # the reference is among the loads already
    for i in range(n_channel):
        for j in range(m):
            nodal[i * m + j] -= area[i] * reference[i * m + j]
    if work[row.passed] == 1.0:
        if largest <= run.rest_traction:
            return False
        # half a solution of no load: nothing was substituted while it rested
        work[row.half_solution : row.half_solution + row.n * tile_width(m)] = 0.0
        work[row.modal : row.modal + row.n_modal * m] = 0.0
        work[row.passed] = 0.0
    inner, last = (work[row.inner : row.inner + n_inner * m], work[row.inner_answer : row.inner_answer + n_inner * m])
    free_a = work[row.free_a : row.free_a + n_inner * m]
    inner[:] = 0.0
    if row.kind == STATIC:
        moved = work[row.w_damped : row.w_damped + size]  # the prescribed part of the channel velocities
        k = pools.fixed[row.k : row.k + n_channel]
        for i in range(n_channel):
            for j in range(m):
                nodal[i * m + j] -= area[i] * k[i] * moved[i * m + j]
        add_spread(pools, c, nodal, inner)
        if row.swept == 1:
            add_on_face(pools, c, inner)
            return True
        # the load condensed on the interface
        for i in range(n_inner * m):
            inner[i] += free_a[i]
        springs(pools, c, inner, last)
        return True
    weight = run.traction_weight
    for i in range(size):
        nodal[i] *= weight
    add_spread(pools, c, nodal, inner)
    if row.swept == 1:
        add_on_face(pools, c, inner)
        return True
    on_inverse(pools, c, inner, last)
    for i in range(n_inner * m):
        last[i] += free_a[i]
    return True


@kernel
def advance(pools: Any, c: int, instant: int) -> None:
    """Motion at the end of the instant from the solution in ``load``: accelerations (STATIC: displacements of the
    increment). ``w_free`` holds the velocities of the channels then."""
    row = pools.classes[c]
    run = pools.run[0]
    work = pools.moving
    state = pools.moving
    m, size = row.m, row.n * row.m
    dt = run.dt
    late = run.u_late
    gain_u = run.displacement_gain
    gain_v = run.velocity_gain
    u = state[row.u : row.u + size]
    v = state[row.v : row.v + size]
    a = state[row.a : row.a + size]
    u_free, v_free = work[row.u_free : row.u_free + size], work[row.v_free : row.v_free + size]
    solved = work[row.load : row.load + size]
    state[row.rest] = 0.0
    end_velocity(pools, c, instant)
    if row.kind == STATIC:
        for i in range(size):
            u[i] = u_free[i] + solved[i]
            v[i] = solved[i] / dt
        return
    if run.one_step == 1.0 and row.accounted == 1 and row.loads_only == 0:
        weighted = work[row.weighted_v : row.weighted_v + size]
        old = run.force_old
        new = run.force_weight
        for i in range(size):
            weighted[i] = old * v[i] + new * (v_free[i] + gain_v * solved[i])
    leave_instant(pools, c)
    massless = pools.fixed_int[row.massless : row.massless + row.n_massless]
    # old displacements, in v until the new ones are known
    for e in range(row.n_massless):
        for j in range(m):
            v[massless[e] * m + j] = u[massless[e] * m + j]
    keep_face_forces(pools, c)
    # before ``solved`` is used for the velocities of massless dofs
    for i in range(size):
        a[i] = solved[i]
    # statics alone moves them: their velocity is the difference quotient, and their acceleration is zero
    for e in range(row.n_massless):
        for j in range(m):
            at = massless[e] * m + j
            u_new = u_free[at] + late * v_free[at] + gain_u * a[at]
            solved[at] = (u_new - v[at]) / dt
    for i in range(size):
        u[i] = u_free[i] + late * v_free[i] + gain_u * a[i]
        v[i] = v_free[i] + gain_v * a[i]
    for e in range(row.n_massless):
        for j in range(m):
            at = massless[e] * m + j
            v[at] = solved[at]
            a[at] = 0.0
    reach_instant(pools, c)
    # neither the scheme nor the account needs forces of this instant
    if run.memory_weight == 0.0 and run.force_old == 0.0 and (row.accounted == 0 or row.loads_only == 1):
        return
    keep_memory(pools, c, instant)


@kernel
def keep_memory(pools: Any, c: int, instant: int) -> None:
    """``residual`` for the next instant, and M a."""
    row = pools.classes[c]
    run = pools.run[0]
    work = pools.moving
    state = pools.moving
    size = row.n * row.m
    a, residual = state[row.a : row.a + size], state[row.residual : row.residual + size]
    mass_a = work[row.mass_a : row.mass_a + size]
    mass_a[:] = 0.0
    add_product(pools, c, MASS, 1.0, a, mass_a)
    memory = run.memory_weight
    weight = run.force_weight
    old = run.force_old
    if old != 0.0:
        constant, mass_old = work[row.constant : row.constant + size], run.mass_old
        # what the next instant takes of this one, each with its weight
        for i in range(size):
            residual[i] = mass_old * mass_a[i] - old * constant[i]
        add_sum(pools, c, INERTIA, instant, mass_old, residual)
        add_sum(pools, c, FORCES, instant, -old, residual)
        return
    for i in range(size):
        # the equation of motion solved for the forces of this instant
        residual[i] = memory * residual[i] + mass_a[i]
    add_sum(pools, c, INERTIA, instant, 1.0, residual)
    for i in range(size):
        residual[i] /= weight
