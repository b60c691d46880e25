"""Local stage (15)-(17): each interface point separately, instant after instant.

With s = W - F / k of both sides the law gives F_hat, and the search direction E+ gives W_hat = s + F_hat / k. The time
law of contact is end-of-instant: with G the gap at the start of the instant,

    0 <= max(G, 0) / dt + d_new   perp   P_new >= 0.

Inside a window of several instants the gap follows the displacement recursion of the time scheme, which removes the
half-step bias that G + dt d gives the closing instant of an accelerated body. With max(G, 0) a penetrated point is not
pushed out, so that no energy is added. The penetration left is at most dt/2 times the closing velocity.

The iteration stops at a tolerance, so that the sides do not move quite as the law says. Where a law fixes their place
(pressed points along N, points that stick, bonded points) the errors of the instants would add up: velocities near zero
have no feedback of position. So the drift D is carried along, the jump of the sides over the jump that the velocities
of the law give by the recursion of the scheme, and the law of the next instant is applied to the jump

    d + make_up D,    make_up = theta / dt,    with the gap G - D,    theta = 1:

an error eps in an instant leaves D = dt eps / theta, not n dt eps after n instants. G - D is the gap of the law, with
the penetration that the time step makes at landing in it: that is never pushed out. Making D up does the work F.D that
the drift took away, so that no energy is added but (F_new - F_old).D, of second order. Under average acceleration the
errors obey z^2 - (1 - theta/2) z + theta/2 = 0, |z| = 0.7 for theta = 1, 0.5 for theta = 1/2, under which a bouncing
ball has twice the work of drift.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from ..laws.dispatch import NO_SLIP, add_tangent, apply
from ..laws.parts import PointState
from .callouts import LAW, call_out
from .energy_parts import OF_DRIFT
from .matrices import read_channels
from .sums import exchange

Array = NDArray[np.float64]

POINT = 27
"""Numbers of scratch for the tangent of a law at one point."""


@kernel
def outgoing(pools: Any, g: int, i: int, low: int, high: int) -> None:
    """F = q - k W of the linear stage (12), (13) and s = W - F / k at instant i of the window, on both sides of the
    points from ``low`` to ``high`` of a group."""
    group = pools.groups[g]
    run = pools.run[0]
    work = pools.moving
    direction = pools.fixed
    h = group.n_component
    for side in range(2):
        first, n = group.start + (side * group.n_point + low) * h, (high - low) * h
        at = i * run.n_flat + first
        q, w = work[run.q + at : run.q + at + n], work[run.w + at : run.w + at + n]
        f, s = work[run.f + at : run.f + at + n], work[run.s + at : run.s + at + n]
        # z = 0 where k = 0, on ground: s = W there
        k, z = direction[run.k + first : run.k + first + n], direction[run.z + first : run.z + first + n]
        for j in range(n):
            traction = q[j] - k[j] * w[j]
            f[j] = traction
            s[j] = w[j] - z[j] * traction


@kernel
def prepare(pools: Any, g: int, i: int, low: int, high: int) -> None:
    """Arguments of the law of the points from ``low`` to ``high`` of a group at instant i of the window: ``jump`` and
    ``reach``."""
    group = pools.groups[g]
    run = pools.run[0]
    work = pools.moving
    h = group.n_component
    size, first = (high - low) * h, run.s + i * run.n_flat + group.start + low * h
    second = first + group.n_point * h
    # far is read up to ``size``
    jump = work[group.jump + low * h : group.jump + high * h]
    near = work[first : first + size]
    far = work[second:]
    if i == 0 and run.longest_window > 1:
        _start_window(pools, g, low, high)
    planned, make_up = work[group.planned + low * h : group.planned + high * h], run.make_up
    for j in range(size):
        jump[j] = far[j] - near[j] + make_up * planned[j]
    width = h if group.elastic == 1 else 1
    count = group.n_point * width
    begin = low * width
    end = high * width
    start = work[group.opening + 3 * count + begin : group.opening + 3 * count + end]
    reach = work[group.reach + begin : group.reach + end]
    if group.elastic == 1:
        rate = run.layer_rate
        for j in range(end - begin):
            reach[j] = start[j] * rate
    else:
        rate, deepest = 1.0 / run.dt, run.deepest
        # a penetrated point is not pushed out; without inertia, where ``deepest`` is -inf, it is
        for j in range(end - begin):
            reach[j] = max(start[j], deepest) * rate
    # derivatives (``tangent_march``) are those of the run, whose states they keep
    if group.law == NO_SLIP and run.linear == 0:
        _hold_pressed(pools, g, i, low, high)


@kernel
def _hold_pressed(pools: Any, g: int, i: int, low: int, high: int) -> None:
    """Points without slip that were pressed at the end of the instant before are closed, whatever gap the time scheme
    leaves them: it enters with the free velocity, of which the law along N takes the sum with ``reach`` alone."""
    group = pools.groups[g]
    run = pools.run[0]
    work = pools.moving
    h = group.n_component
    # inside a window the iterate of the instant before
    before = (run.f_hat if i == 0 else run.local_f + (i - 1) * run.n_flat) + group.start
    for p in range(low, high):
        if work[before + p * h] < 0.0 and work[group.reach + p] > 0.0:
            work[group.jump + p * h] += work[group.reach + p]
            work[group.reach + p] = 0.0


@kernel
def _start_window(pools: Any, g: int, low: int, high: int) -> None:
    """Openings and drifts of the points from ``low`` to ``high`` of a group at the start of the window, for the local
    stage of its instants."""
    group, work = pools.groups[g], pools.moving
    h = group.n_component
    width = h if group.elastic == 1 else 1
    for kind in range(4):
        at = kind * group.n_point * width
        for j in range(low * width, high * width):
            work[group.opening + at + j] = work[group.opened + at + j]
    for kind in range(3):
        at = kind * group.n_point * h
        for j in range(low * h, high * h):
            work[group.planned + at + j] = work[group.drift + at + j]


@kernel
def point_state(pools: Any, g: int, p: int, z_sum: int) -> PointState:
    """What the law of a group knows of its point p; ``z_sum`` : place of z of both sides among the fixed numbers."""
    group = pools.groups[g]
    run = pools.run[0]
    work = pools.moving
    h = group.n_component
    width = h if group.elastic == 1 else 1
    return PointState(
        work[group.jump + p * h : group.jump + (p + 1) * h],
        pools.fixed[z_sum + 2 * p : z_sum + 2 * p + 2],
        work[group.reach + p * width : group.reach + (p + 1) * width],
        run.layer_rate if group.elastic == 1 else 1.0 / run.dt,
        parameters_at(pools, g, p),
    )


@kernel
def parameters_at(pools: Any, g: int, p: int) -> Array:
    """Parameters of the law of a group at its point p."""
    group = pools.groups[g]
    n = group.n_parameter
    parameters: Array
    if group.tunable == 1:
        parameters = pools.moving[group.tuned + p * n : group.tuned + (p + 1) * n]
    else:
        parameters = pools.fixed[group.parameters + p * n : group.parameters + (p + 1) * n]
    return parameters


@kernel
def solve_points(pools: Any, g: int, low: int, high: int) -> None:
    """Tractions of the points from ``low`` to ``high`` of a group by its law."""
    if pools.groups[g].law < 0:
        call_out(pools, LAW, g, low, high)
        return
    group = pools.groups[g]
    work = pools.moving
    h = group.n_component
    for p in range(low, high):
        traction = work[group.traction + p * h : group.traction + (p + 1) * h]
        apply(group.law, point_state(pools, g, p, group.z_sum), traction)


@kernel
def add_tangent_at(pools: Any, g: int, p: int, scratch: Array, out: Array) -> None:
    """Add J = dF_hat / djump of a point of a group, at the arguments that its law had last, to ``out`` (h * h,); the
    ``scratch`` has POINT numbers."""
    group = pools.groups[g]
    add_tangent(group.law, point_state(pools, g, p, group.z_sum), scratch, out)


@kernel
def finish(pools: Any, g: int, i: int, window: int, low: int, high: int) -> None:
    """F_hat and W_hat of both sides of the points from ``low`` to ``high`` of a group at instant i; in a window of
    several instants the opening that follows."""
    group = pools.groups[g]
    run = pools.run[0]
    work = pools.moving
    h = group.n_component
    at, n = i * run.n_flat, (high - low) * h
    traction = work[group.traction + low * h : group.traction + high * h]
    for side in range(2):
        first, sign = group.start + (side * group.n_point + low) * h, 1.0 - 2.0 * side  # on E' the opposite
        s, z = work[run.s + at + first : run.s + at + first + n], pools.fixed[run.z + first : run.z + first + n]
        f_hat = work[run.local_f + at + first : run.local_f + at + first + n]
        w_hat = work[run.local_w + at + first : run.local_w + at + first + n]
        for j in range(n):
            f_hat[j] = sign * traction[j]
            w_hat[j] = s[j] + z[j] * f_hat[j]  # E+: F_hat - k W_hat = -k s
    if window > 1:
        _follow(pools, g, work[run.local_w + at : run.local_w + at + run.n_flat], low, high)
        _follow_plan(pools, g, low, high)


@kernel
def points_stage(pools: Any, g: int, window: int, low: int, high: int) -> None:
    """Fields of the local stage over the window at the points from ``low`` to ``high`` of a group."""
    # one instant after the other: the opening of the next one follows from this
    for i in range(window):
        outgoing(pools, g, i, low, high)
        prepare(pools, g, i, low, high)
        solve_points(pools, g, low, high)
        finish(pools, g, i, window, low, high)


@kernel
def _follow(pools: Any, g: int, w_hat: Array, low: int, high: int) -> None:
    """Opening of the next instant of the window from the velocities W_hat of this one."""
    group = pools.groups[g]
    run = pools.run[0]
    work = pools.moving
    if group.opens == 0 and group.elastic == 0:
        return
    h = group.n_component
    size = group.n_point * h
    width = h if group.elastic == 1 else 1
    count = group.n_point * width
    at = group.opening
    gap, velocity = work[at : at + count], work[at + count : at + 2 * count]
    rate, start = work[at + 2 * count : at + 3 * count], work[at + 3 * count : at + 4 * count]
    for p in range(low, high):
        for c in range(width):
            j = p * width + c
            moved = w_hat[group.start + size + p * h + c] - w_hat[group.start + p * h + c]
            moved += run.make_up * work[group.planned + p * h + c]  # as the law says
            # the new rate before the new velocity: both follow from the old ones
            gap[j] += run.opening_v * velocity[j] + run.opening_a * rate[j] + run.opening_new * moved
            rate[j] = run.rate_v * velocity[j] + run.rate_a * rate[j] + run.rate_new * moved
            velocity[j] = moved
            start[j] = gap[j]
            if group.elastic == 1:
                start[j] += run.layer_v * velocity[j] + run.layer_a * rate[j]


@kernel
def _follow_plan(pools: Any, g: int, low: int, high: int) -> None:
    """Drift of a group that is left for the next instant of the window where the sides move as the local stage says:
    ``make_up`` of it is made up."""
    group = pools.groups[g]
    run = pools.run[0]
    work = pools.moving
    if group.keeps_normal == 0 and group.keeps_tangential == 0:
        return
    h = group.n_component
    for p in range(low, high):
        traction = work[group.traction + p * h : (p + 1) * h + group.traction]
        for c in range(h):
            # the sides move as the law says but for what is made up
            error = -run.make_up * work[group.planned + p * h + c]
            _advance_drift(pools, g, group.planned, p * h + c, error, _kept(group, traction, c))


@kernel
def _kept(group: Any, traction: Array, c: int) -> bool:
    """Whether the law fixes the place of a point in the direction c under the traction (h,) on side E: of one that may
    open while it is pressed; without slip a point is held along the face by its shear alone."""
    if (group.keeps_normal if c == 0 else group.keeps_tangential) == 0:
        return False
    if group.opens == 0 or traction[0] < 0.0:
        return True
    return bool(c > 0 and group.law == NO_SLIP and traction[c] != 0.0)


@kernel
def _advance_drift(pools: Any, g: int, to: int, j: int, error: float, in_place: bool) -> None:
    """Drift j of a group in the array ``to`` after an instant in which the velocity of the sides exceeds that of the
    law by ``error``, by the displacement recursion of the scheme; 0 where the law fixes no place."""
    group = pools.groups[g]
    run = pools.run[0]
    work = pools.moving
    size = group.n_point * group.n_component
    velocity, rate = work[to + size + j], work[to + 2 * size + j]
    if not in_place:  # nothing to be made up where the place is free
        work[to + j] = 0.0
        work[to + size + j] = 0.0
        work[to + 2 * size + j] = 0.0
        return
    work[to + j] += run.opening_v * velocity + run.opening_a * rate + run.opening_new * error
    work[to + size + j] = error
    work[to + 2 * size + j] = run.rate_v * velocity + run.rate_a * rate + run.rate_new * error


@kernel
def follow_drift(pools: Any, i: int) -> None:
    """Drift of the groups at the end of instant i of the window, from ``moved`` and the accepted fields; the velocities
    W_hat of these become those of the law, the drift that was to be made up taken out in the ratio of the 1/k of both
    sides."""
    run = pools.run[0]
    work = pools.moving
    at = i * pools.run[0].n_flat
    lost = 0.0
    area = pools.fixed[run.area : run.area + run.n_flat]
    for g in range(len(pools.groups)):
        group = pools.groups[g]
        if group.keeps_normal == 0 and group.keeps_tangential == 0:
            continue
        h, first = group.n_component, group.start
        second = first + group.n_point * h
        if i == 0:
            _start_window(pools, g, 0, group.n_point)
        for p in range(group.n_point):
            owned = pools.fixed_int[run.interface + first + p * h] < run.n_owned  # by one process
            traction = work[run.local_f + at + first + p * h : run.local_f + at + first + (p + 1) * h]
            for c in range(h):
                j = p * h + c
                planned = run.make_up * work[group.planned + j]
                near, far = run.local_w + at + first + j, run.local_w + at + second + j
                # the law was given the jump of the sides and what is made up (``prepare``): W_hat has the former alone
                if planned != 0.0:
                    share = _share(pools, g, p, c)
                    work[near] -= share * planned
                    work[far] += (1.0 - share) * planned
                moved = work[run.moved + second + j] - work[run.moved + first + j]
                # before the drift is advanced
                in_place = _kept(group, traction, c)
                error = moved - (work[far] - work[near])
                before = work[group.drift + j]
                _advance_drift(pools, g, group.drift, j, error, in_place)
                if owned and in_place:
                    lost += area[first + j] * traction[c] * (work[group.drift + j] - before)
                # longer windows: what the next instant makes up
                _advance_drift(pools, g, group.planned, j, -planned, in_place)
    work[run.works + OF_DRIFT] -= lost


@kernel
def _share(pools: Any, g: int, p: int, c: int) -> float:
    """Share of side E in a jump of velocities at a point in the direction c, in the ratio of the 1/k of both sides."""
    group = pools.groups[g]
    both = pools.fixed[group.z_sum + 2 * p + min(c, 1)]  # normal or tangential
    near = pools.fixed[pools.run[0].z + group.start + p * group.n_component + c]
    return float(near / both) if both > 0.0 else 0.0


@kernel
def take_drift(pools: Any, w: Array) -> None:
    """Velocities w (N,) that the laws give, as the sides are to move: ``make_up`` of the drift taken from the jumps."""
    run, work = pools.run[0], pools.moving
    for g in range(len(pools.groups)):
        group = pools.groups[g]
        h, second = group.n_component, group.start + group.n_point * group.n_component
        for p in range(group.n_point if group.keeps_normal + group.keeps_tangential > 0 else 0):
            for c in range(h):
                j = p * h + c
                planned = run.make_up * work[group.drift + j]
                if planned != 0.0:
                    share = _share(pools, g, p, c)
                    # opposite to ``follow_drift``
                    w[group.start + j] += share * planned
                    w[second + j] -= (1.0 - share) * planned


@kernel
def add_made_up(pools: Any, w: Array) -> None:
    """Add the velocities that make up the drift to those of sides E' among w (N,)."""
    run, work = pools.run[0], pools.moving
    for g in range(len(pools.groups)):
        group = pools.groups[g]
        size = group.n_point * group.n_component
        for j in range(size):
            # jumps alone count, so one side takes it all
            w[group.start + size + j] += run.make_up * work[group.drift + j]


@kernel
def open_window(pools: Any, window: int, instant: int) -> None:
    """Openings and drifts of the groups at the start of a window; ``instant``: the present one.

    A window of one instant takes the gaps and layer jumps at the end of the instant before. A window of several takes
    opening, its velocity and its acceleration from the present motion of the substructures. Both without drift.
    """
    run, work = pools.run[0], pools.moving
    for g in range(len(pools.groups)):
        group = pools.groups[g]
        h = group.n_component
        width = h if group.elastic == 1 else 1
        count = group.n_point * width
        place = group.layer if group.elastic == 1 else group.gap
        start, state = work[group.opened + 3 * count : group.opened + 4 * count], work[place : place + count]
        for j in range(count):
            start[j] = state[j]
        # the gap of the law is G - D
        if group.elastic == 0 and group.keeps_normal == 1:
            for p in range(group.n_point):
                start[p] -= work[group.drift + p * h]
        _start_window(pools, g, 0, group.n_point)
    # one instant needs no velocities of the openings: its gaps are at their end already
    for kind in range(3 if window > 1 else 0):
        read_motion(pools, instant, kind)
        exchange(pools, run.displacement, run.n_flat, 1)
        read_jumps(pools, kind)


@kernel
def read_motion(pools: Any, instant: int, kind: int) -> None:
    """Displacement (``kind`` 0), velocity (1) or acceleration (2) of the channels, into ``displacement``."""
    run = pools.run[0]
    flat = pools.moving[run.displacement : run.displacement + run.n_flat]
    of_u = 0.0
    of_v = 0.0
    of_a = 0.0
    if kind == 0:
        of_u, of_v = 1.0, run.gap_offset
    elif kind == 1:
        of_v = 1.0
    else:
        of_a = 1.0
    for c in range(len(pools.classes)):
        read_channels(pools, c, instant, of_u, of_v, of_a, False, flat)
    _ground(pools, instant, kind, flat)


@kernel
def read_jumps(pools: Any, kind: int) -> None:
    """Jumps of the groups at the start of a window from what ``read_motion`` left; with the last kind what layers start
    from."""
    run, work = pools.run[0], pools.moving
    flat = work[run.displacement : run.displacement + run.n_flat]
    for g in range(len(pools.groups)):
        _jumps(pools, g, kind, flat)
    for g in range(len(pools.groups)):
        group = pools.groups[g]
        # with the last kind all three jumps are there
        if kind == 2 and group.elastic == 1:
            count = group.n_point * group.n_component
            at = group.opened
            for j in range(count):
                work[at + 3 * count + j] = (
                    work[at + j] + run.layer_v * work[at + count + j] + run.layer_a * work[at + 2 * count + j]
                )


@kernel
def _ground(pools: Any, instant: int, kind: int, flat: Array) -> None:
    """Displacement (``kind`` 0), velocity (1) or acceleration (2) of the ground into a flat vector."""
    run = pools.run[0]
    at = run.ground_displacement
    if kind == 1:
        at = run.ground_velocity
    elif kind == 2:
        at = run.ground_acceleration
    for e in range(run.n_ground):
        flat[pools.fixed_int[run.ground + e]] = pools.moving[at + instant * run.n_ground + e]


@kernel
def _jumps(pools: Any, g: int, kind: int, flat: Array) -> None:
    """Jumps of the sides of a group into ``opened[kind]``: along N, or all components of elastic groups."""
    group = pools.groups[g]
    h = group.n_component
    size = group.n_point * h
    width = h if group.elastic == 1 else 1
    out = pools.moving[group.opened + kind * group.n_point * width : group.opened + (kind + 1) * group.n_point * width]
    for p in range(group.n_point):
        for c in range(width):
            out[p * width + c] = flat[group.start + size + p * h + c] - flat[group.start + p * h + c]
        # the initial gap adds to the displacement, not to its rates
        if kind == 0:
            out[p * width] += pools.fixed[group.initial_gap + p]
        # drift, its velocity, its acceleration in turn: the jump of the law
        if group.elastic == 0 and group.keeps_normal == 1:
            out[p] -= pools.moving[group.drift + (kind * group.n_point + p) * h]


@kernel
def read_gaps(pools: Any, instant: int, ended: bool) -> None:
    """Gaps at the end of an instant from the displacements of the substructures (so they do not drift), kept; layer
    jumps of elastic groups for the next instant. ``ended`` : whether a step has ended there."""
    run, work = pools.run[0], pools.moving
    displacement = work[run.displacement : run.displacement + run.n_flat]
    layer = work[run.layer : run.layer + run.n_flat]
    for e in range(run.n_ground):
        at = pools.fixed_int[run.ground + e]
        displacement[at] = pools.moving[run.ground_displacement + instant * run.n_ground + e]
        if run.layers == 1:
            layer[at] = pools.moving[run.ground_layer + instant * run.n_ground + e]
    for g in range(len(pools.groups)):
        group = pools.groups[g]
        n_point, h = group.n_point, group.n_component
        gap, second = pools.moving[group.gap : group.gap + n_point], group.start + n_point * h
        initial = pools.fixed[group.initial_gap : group.initial_gap + n_point]
        at = run.history_gap + (instant - run.first_row) * run.n_point + group.first_point
        first, history = group.start, pools.moving[at : at + n_point]
        for p in range(n_point):
            gap[p] = initial[p] + displacement[second + p * h] - displacement[first + p * h]
            history[p] = gap[p]
        if group.elastic == 1:
            start = pools.moving[group.layer : group.layer + n_point * h]
            for j in range(n_point * h):
                start[j] = layer[second + j] - layer[first + j]
            for p in range(n_point):  # along N
                start[p * h] += initial[p]
            if group.relaxes == 1:
                _relax(pools, g, displacement, ended)


@kernel
def _relax(pools: Any, g: int, displacement: Array, ended: bool) -> None:
    """Elongations of the relaxing springs of a group over the step that has ``ended``, and where the next one starts
    from: the jump of the layer less the present one, with what is left of the elongation (``laws.maxwell_joint``)."""
    group, state = pools.groups[g], pools.moving
    h, size = group.n_component, group.n_point * group.n_component
    stretch, apart = state[group.stretch : group.stretch + size], state[group.apart : group.apart + size]
    start, second = state[group.layer : group.layer + size], group.start + size
    for p in range(group.n_point):
        at = group.relaxation + 3 * p
        c_e = pools.fixed[at]
        c_u = pools.fixed[at + 1]
        ratio = pools.fixed[at + 2]
        for c in range(h):
            j = p * h + c
            jump = displacement[second + j] - displacement[group.start + j]
            if c == 0:
                jump += pools.fixed[group.initial_gap + p]
            if ended:
                stretch[j] = c_e * stretch[j] + c_u * (jump - apart[j])
            apart[j] = jump
            start[j] += ratio * stretch[j] - jump
