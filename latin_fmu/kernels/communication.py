"""One communication step of a co-simulation on the image of a run: inputs -> histories -> march -> outputs.

Every sum of patterns and every prescribed motion of the classes, and the motion of the ground, is a column of the
histories. A column at the end of a time step is a linear function of the drives of that step (``records``): the motion
state x before it, the amplitudes s of the sources before it and at its end, and 1; so is the motion state after it.

    z_t = (x_{t-1}, s_{t-1}, s_t, 1),   columns_t = column z_t,   x_t = motion z_t

The outputs after a time step are linear in its signals (tractions, velocities, gaps, what sensors and probes read,
drives), but for the smallest gap and the shares of the contact, which are read point by point, the running impulses,
and the numbers of the iteration. Amplitudes over a communication step of n time steps from value V, rate r and the
amplitude p reached before: HOLD V; RATE V + r t; LINE from p to V. A motion starts at p by every rule, a displacement
drives by its rate over the time step.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from .instants import march_instants, open_accounts, read_start
from .laws import contact_status
from .matrices import add_matrix

Array = NDArray[np.float64]

HOLD, RATE, LINE = 0, 1, 2
"""Rules of interpolation."""
LOAD, MOTION, DISPLACEMENT = 0, 1, 2
"""Kinds of inputs."""
BEYOND_LAWS: Final = -1
"""Result of a step beyond the table of own laws; nothing has changed. -2 - i: the first step, or the outputs at t = 0,
with an amplitude of input i for which the initial state of the image does not hold."""


@kernel
def communicate(pools: Any, n: int, rule: int, before: int, whole: int) -> int:
    """Make n time steps of a communication step of ``whole``, of which ``before`` are made; how many converged, or a
    negative status. Row i of the outputs is that after i time steps; row 0, that before the first."""
    run, moving = pools.run[0], pools.moving
    made = int(moving[run.progress])
    if run.law_end >= 0 and made + n > run.law_end:
        return BEYOND_LAWS
    if before == 0:
        moving[run.progress + 1] = 0.0
        moving[run.progress + 2] = 0.0
    if made == 0:
        status = open_run(pools, rule, whole)
        if status != 0:
            return status
    else:
        put_back(pools)
    for i in range(1, n + 1):
        set_histories(pools, i, before + i, made + i, whole, rule)
    done = march_instants(pools, 1, n)
    for i in range(1, done + 1):
        keep_outputs(pools, i, before + i)
    moving[run.progress] = made + done
    if done > 0:
        move(pools, run.output + done * run.n_output, run.present, run.n_output)
        move(pools, run.drive + done * run.n_drive, run.motion_state, run.n_motion_state)
    if before + done == whole:
        for e in range(run.n_input):
            last, old = amplitude(pools, e, whole, whole, rule), amplitude(pools, e, whole - 1, whole, rule)
            moving[run.slope + e] = (last - old) / run.dt
            moving[run.work_input + e] = last
        move(pools, run.work_input, run.reached, run.n_input)
    return done


@kernel
def present(pools: Any) -> int:
    """Put the outputs of the present state, and its fields at the points, into row 0; before the first time step those
    at t = 0 under the inputs as they are set, where a simulation begins. 0, or a negative status."""
    run, moving = pools.run[0], pools.moving
    if moving[run.progress] > 0.0:
        put_back(pools)
        return 0
    move(pools, run.input_value, run.reached, run.n_input)
    move(pools, run.input_rate, run.slope, run.n_input)
    return open_run(pools, HOLD, 1)


@kernel
def move(pools: Any, start: int, to: int, n: int) -> None:
    """Copy numbers of the moving block."""
    moving = pools.moving
    for i in range(n):
        moving[to + i] = moving[start + i]


# -- inputs -------------------------------------------------------------------------------------------------------
@kernel
def amplitude(pools: Any, e: int, j: int, whole: int, rule: int) -> float:
    """Amplitude of an input after j of the time steps of the communication step."""
    run, moving = pools.run[0], pools.moving
    value, reached = moving[run.input_value + e], moving[run.reached + e]
    if j == 0 and (rule == LINE or pools.fixed_int[run.input_kind + e] != LOAD):
        return float(reached)
    if rule == HOLD:
        return float(value)
    if rule == LINE:
        return float(value if j == whole else j * ((value - reached) / whole) + reached)
    return float(value + moving[run.input_rate + e] * (j * run.dt))


@kernel
def set_sources(pools: Any, to: int, j: int, made: int, whole: int, rule: int) -> None:
    """Amplitudes of the sources after j of the time steps, ``made`` since the start, into the moving block."""
    run, moving = pools.run[0], pools.moving
    for e in range(run.n_input):
        now = amplitude(pools, e, j, whole, rule)
        if pools.fixed_int[run.input_kind + e] == DISPLACEMENT:
            old = amplitude(pools, e, max(j - 1, 0), whole, rule)
            now = moving[run.slope + e] if j == 0 else (now - old) / run.dt
        moving[to + e] = now
    own = run.n_source - run.n_input
    row = run.law_table + own * min(made, run.n_law - 1)
    for e in range(own):
        moving[to + run.n_input + e] = pools.fixed[row + e]


@kernel
def set_histories(pools: Any, instant: int, j: int, made: int, whole: int, rule: int) -> None:
    """Columns of an instant of the segment, which ends the time step j of the communication step, and its drives."""
    run, moving = pools.run[0], pools.moving
    z, wide, n_x = run.drive + instant * run.n_drive, run.n_drive, run.n_motion_state
    move(pools, z - wide, z, n_x)
    set_sources(pools, z + n_x, j - 1, made - 1, whole, rule)
    set_sources(pools, z + n_x + run.n_source, j, made, whole, rule)
    moving[z + wide - 1] = 1.0
    drives, columns = moving[z : z + wide], moving[run.column : run.column + run.n_column]
    columns[:] = 0.0
    add_matrix(pools, run.n_column, run.column_starts, run.column_columns, run.column_values, 1, drives, columns)
    spread_columns(pools, instant)
    state = moving[run.next_state : run.next_state + n_x]
    state[:] = 0.0
    add_matrix(pools, n_x, run.motion_starts, run.motion_columns, run.motion_values, 1, drives, state)
    move(pools, run.next_state, z, n_x)


@kernel
def spread_columns(pools: Any, instant: int) -> None:
    """Write the columns of an instant to their places in the histories."""
    run, at = pools.run[0], pools.run[0].column
    for c in range(len(pools.classes)):
        row = pools.classes[c]
        at = spread(pools, at, row.force_amplitudes + instant * row.force_terms, row.force_terms)
        at = spread(pools, at, row.inertia_amplitudes + instant * row.inertia_terms, row.inertia_terms)
        at = spread(pools, at, row.velocity_amplitudes + instant * row.velocity_terms, row.velocity_terms)
        at = spread(pools, at, row.displacement_amplitudes + instant * row.displacement_terms, row.displacement_terms)
        at = spread(pools, at, row.acceleration_amplitudes + instant * row.acceleration_terms, row.acceleration_terms)
        at = spread(pools, at, row.work_amplitudes + instant * row.work_terms, row.work_terms)
        size = row.n_motion * row.m
        for kind in range(3):
            at = spread(pools, at, row.motions + (kind * run.n_time + instant) * size, size)
    n = run.n_ground
    at = spread(pools, at, run.ground_velocity + instant * n, n)
    at = spread(pools, at, run.ground_displacement + instant * n, n)
    at = spread(pools, at, run.ground_acceleration + instant * n, n)
    at = spread(pools, at, run.ground_layer + instant * n, n)


@kernel
def spread(pools: Any, at: int, to: int, n: int) -> int:
    """Write n columns; the place of the next one."""
    move(pools, at, to, n)
    return at + n


# -- the start of a call ------------------------------------------------------------------------------------------
@kernel
def open_run(pools: Any, rule: int, whole: int) -> int:
    """The state at t = 0 under the inputs of the first time step, and its outputs; -2 - i where the amplitude of input
    i must be the one that the image was made for."""
    run, moving = pools.run[0], pools.moving
    n_x, n_s, wide = run.n_motion_state, run.n_source, run.n_drive
    z = run.drive
    moving[z : z + wide] = 0.0
    set_sources(pools, z + n_x, 0, 0, whole, rule)
    set_sources(pools, z + n_x + n_s, 1, 1, whole, rule)
    moving[z + wide - 1] = 1.0
    for e in range(run.n_input):
        if pools.fixed_int[run.input_held + e] == 1 and moving[run.reached + e] != pools.fixed[run.input_start + e]:
            return -2 - e
    drives, columns = moving[z : z + wide], moving[run.column : run.column + run.n_column]
    columns[:] = 0.0
    starts, numbers, values = run.first_column_starts, run.first_column_columns, run.first_column_values
    add_matrix(pools, run.n_column, starts, numbers, values, 1, drives, columns)
    spread_columns(pools, 0)
    initial = moving[run.opening : run.opening + run.n_opening]
    initial[:] = 0.0
    add_matrix(pools, run.n_opening, run.opening_starts, run.opening_columns, run.opening_values, 1, drives, initial)
    set_opening(pools)
    state = moving[run.next_state : run.next_state + n_x]
    state[:] = 0.0
    starts, numbers, values = run.first_motion_starts, run.first_motion_columns, run.first_motion_values
    add_matrix(pools, n_x, starts, numbers, values, 1, drives, state)
    move(pools, run.next_state, z, n_x)
    move(pools, run.next_state, run.motion_state, n_x)
    move(pools, z + n_x, z + n_x + n_s, n_s)
    open_accounts(pools)
    read_start(pools)
    moving[run.impulse : run.impulse + 3 * run.n_interface] = 0.0
    gather(pools, 0)
    at = run.output + run.of_solver
    moving[at], moving[at + 1], moving[at + 2], moving[at + 3] = 0.0, 0.0, 1.0, 0.0
    move(pools, run.output, run.present, run.n_output)
    return 0


@kernel
def set_opening(pools: Any) -> None:
    """Write the part of the initial state that depends on inputs to its places; a class that rests has no motion."""
    run, moving = pools.run[0], pools.moving
    e, passed, n = 0, 0, run.n_opening
    for c in range(len(pools.classes)):
        row = pools.classes[c]
        size = row.n * row.m
        for kind in range(4):
            to = row.u if kind == 0 else row.v if kind == 1 else row.a if kind == 2 else row.residual
            e = _write_opening(pools, e, passed, size, to)
            passed += size
        still = 1.0
        for i in range(size):
            if moving[row.u + i] != 0.0 or moving[row.v + i] != 0.0:
                still = 0.0
            if moving[row.a + i] != 0.0 or moving[row.residual + i] != 0.0:
                still = 0.0
        if n > 0:
            moving[row.rest] = still
    e = _write_opening(pools, e, passed, run.n_flat, run.f_hat)
    _write_opening(pools, e, passed + run.n_flat, run.n_flat, run.w_hat)


@kernel
def _write_opening(pools: Any, e: int, passed: int, size: int, to: int) -> int:
    """Write the numbers whose places lie in an array; the number of the next one."""
    run = pools.run[0]
    while e < run.n_opening and pools.fixed_int[run.opening_place + e] < passed + size:
        pools.moving[to + pools.fixed_int[run.opening_place + e] - passed] = pools.moving[run.opening + e]
        e += 1
    return e


@kernel
def put_back(pools: Any) -> None:
    """Row 0 of outputs, fields, drives and prescribed motions from the state."""
    run = pools.run[0]
    move(pools, run.present, run.output, run.n_output)
    move(pools, run.f_hat, run.history_f, run.n_flat)
    move(pools, run.w_hat, run.history_w, run.n_flat)
    for g in range(len(pools.groups)):
        group = pools.groups[g]
        move(pools, group.gap, run.history_gap + group.first_point, group.n_point)
    move(pools, run.motion_state, run.drive, run.n_motion_state)
    at = run.motion_state
    for c in range(len(pools.classes)):
        row = pools.classes[c]
        size = row.n_motion * row.m
        for kind in range(3):
            move(pools, at, row.motions + kind * run.n_time * size, size)
            at += size


# -- outputs ------------------------------------------------------------------------------------------------------
@kernel
def keep_outputs(pools: Any, row: int, j: int) -> None:
    """Outputs after a time step of the call, ``row``, which is j of the communication step."""
    run, moving = pools.run[0], pools.moving
    progress, call = run.progress, row - 1
    used = pools.moving_int[run.iterations + call]
    moving[progress + 1] += used
    reached = moving[run.errors + call * run.max_iterations + used - 1] if used > 0 else 0.0
    moving[progress + 2] = max(moving[progress + 2], reached)
    gather(pools, row)
    at = run.output + row * run.n_output + run.of_solver
    moving[at], moving[at + 1], moving[at + 2] = moving[progress + 1], moving[progress + 2], 1.0
    moving[at + 3] = j


@kernel
def gather(pools: Any, row: int) -> None:
    """Outputs of a row that follow from the fields of that instant and, in rows behind the first, from the row
    before."""
    run, moving = pools.run[0], pools.moving
    set_signals(pools, row)
    at = run.output + row * run.n_output
    outputs, signals = moving[at : at + run.n_output], moving[run.signal : run.signal + run.n_signal]
    outputs[:] = 0.0
    add_matrix(pools, run.n_output, run.output_starts, run.output_columns, run.output_values, 1, signals, outputs)
    for i in range(run.n_interface):
        summary = pools.fixed_int[run.summary + 6 * i : run.summary + 6 * (i + 1)]
        for k in range(3):
            total = run.impulse + 3 * i + k
            if row > 0:
                old = moving[at - run.n_output + summary[0] + k]
                moving[total] += 0.5 * run.dt * (outputs[summary[0] + k] + old)
            outputs[summary[1] + k] = moving[total]
        if summary[2] >= 0:
            summarise(pools, row, summary, outputs)


@kernel
def set_signals(pools: Any, row: int) -> None:
    """Gather the signals of a row."""
    run, at, n = pools.run[0], pools.run[0].signal, pools.run[0].n_flat
    move(pools, run.history_f + row * n, at, n)
    move(pools, run.history_w + row * n, at + n, n)
    move(pools, run.history_gap + row * run.n_point, at + 2 * n, run.n_point)
    at += 2 * n + run.n_point
    for c in range(len(pools.classes)):
        of = pools.classes[c]
        sensed, probed = 3 * of.n_sensor * of.m, of.n_probe * of.m
        move(pools, of.sensed + row * sensed, at, sensed)
        move(pools, of.probed + row * probed, at + sensed, probed)
        at += sensed + probed
    move(pools, run.drive + row * run.n_drive, at, run.n_drive)


@kernel
def summarise(pools: Any, row: int, summary: Any, outputs: Array) -> None:
    """Smallest gap of an interface, and the shares of its area that are closed, stick and slip."""
    run, moving = pools.run[0], pools.moving
    group, first, last, to = pools.groups[summary[3]], summary[4], summary[5], summary[2]
    h, n_parameter = group.n_component, group.n_parameter
    gaps, smallest = run.history_gap + row * run.n_point + group.first_point, np.inf
    shares, tractions = run.area_share + group.first_point, run.history_f + row * run.n_flat + group.start
    closed, stuck, slipping = 0.0, 0.0, 0.0
    for p in range(first, last):
        smallest = min(smallest, moving[gaps + p])
        traction = moving[tractions + p * h : tractions + (p + 1) * h]
        at = group.parameters + p * n_parameter
        status = contact_status(group.law, traction, pools.fixed[at : at + n_parameter], run.no_contact)
        share = pools.fixed[shares + p]
        closed += share if status != 0 else 0.0
        stuck += share if status == 1 else 0.0
        slipping += share if status == 2 else 0.0
    outputs[to], outputs[to + 1], outputs[to + 2], outputs[to + 3] = smallest, closed, stuck, slipping
