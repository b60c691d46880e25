"""One communication step of a co-simulation on the image of a run: inputs -> histories -> march -> outputs.

Every sum of patterns and every prescribed motion of the classes, and the motion of the ground, is a column of the
histories. A column at the end of a time step is a linear function of the drives of that step (``records``): the motion
state x before it, the amplitudes s of the sources before it and at its end, and 1; so is the motion state after it.

    z_t = (x_{t-1}, s_{t-1}, s_t, 1),   columns_t = column z_t,   x_t = motion z_t

Amplitudes of the inputs over a communication step: ``inputs``.

A communication step may begin and end between the instants of the time steps: the state is that at the last instant
not beyond its end, and the outputs are held from there.

``progress``: 0 time steps made; 1, 2 iterations and largest indicator of the communication step; 3 length of the last
one, s; 4 kinetic and elastic energy at t = 0, J; 5 energy dissipated by friction, J; 6 time of the start, s, that
instants of contact events are counted with; 7 fraction of a time step since the last instant; 8 the same at the end of
the communication step that is made (``place``).
"""

from __future__ import annotations

from typing import Any, Final

from ..compiled import kernel
from .face import size_of_state
from .inputs import DISPLACEMENT, DRIVEN, HOLD, N_MEMORY, REACHED, drive, keep, placed
from .instants import march_instants, open_accounts, read_start
from .matrices import add_matrix
from .outputs import count_iterations, gather, keep_outputs, move, set_ratios

FREE = 0
BY_VALUE = 1
BY_BOTH = 2
"""Inputs that the initial state is known for: any; with the start value; with that held over the first time step."""
BEYOND_LAWS: Final = -1
"""Result of a step beyond the table of own laws; nothing has changed. -2 - i: the first step, or the outputs at t = 0,
with an amplitude of input i for which the initial state of the image does not hold."""


@kernel
def communicate(pools: Any, n: int, rule: int, before: int, whole: int) -> int:
    """Make n time steps of a communication step of ``whole``, of which ``before`` are made; how many converged, or a
    negative status, after which the caller restores the state. Row i of the outputs is that after i time steps; row 0,
    that before the first. None: the communication step ends after those made, at its own end before the next instant
    where ``whole`` is 0. Where fewer converged than n the state is that after those which did: the caller calls again
    for the rest with another record of the run."""
    run = pools.run[0]
    if n == 0:
        keep_inputs(pools, before, whole, rule)
    if n < 1 or n >= run.n_time or before + n > whole:
        return 0
    status = begin_rows(pools, n, rule, before, whole)
    if status != 0:
        return status
    done = march_instants(pools, 1, n)
    for i in range(1, done + 1):
        count_iterations(pools, i - 1)
        conclude(pools, i, before + i - 1, whole, rule)
    return done


@kernel
def begin_rows(pools: Any, n: int, rule: int, before: int, whole: int) -> int:
    """Row 0 of the state, and the histories of the n time steps behind it (``communicate``); 0, or a negative
    status."""
    run, moving = pools.run[0], pools.moving
    steps = int(moving[run.progress])
    # -1: the last row of the table holds ever after
    if run.law_end >= 0 and not run.law_first <= steps <= run.law_first + run.law_end - n:
        return BEYOND_LAWS
    if before == 0:
        moving[run.progress + 1] = 0.0  # counted over the whole communication step
        moving[run.progress + 2] = 0.0
    if steps == 0:
        status = open_run(pools, rule, whole)
        if status != 0:
            return status
    else:
        # rows of the last call stand in the place of row 0
        put_back(pools)
        set_ratios(pools, 0)
        if run.static == 1 and before == 0:
            set_start_columns(pools, steps, whole, rule)
    for i in range(1, n + 1):
        set_histories(pools, i, before + i, steps + i, whole, rule)
    return 0


@kernel
def conclude(pools: Any, row: int, before: int, whole: int, rule: int) -> None:
    """End the time step of a row, solved and with its iterations counted: one of ``whole``, after ``before``."""
    run, moving = pools.run[0], pools.moving
    steps = int(moving[run.progress]) + 1
    keep_outputs(pools, row, before + 1, steps)
    moving[run.progress] = steps
    move(pools, run.output + row * run.n_output, run.present, run.n_output)
    move(pools, run.drive + row * run.n_drive, run.motion_state, run.n_motion_state)
    if before + 1 == whole:
        keep_inputs(pools, whole, whole, rule)


@kernel
def place(pools: Any) -> int:
    """Time steps of the next communication step (``inputs.placed``); the fraction that follows into ``progress``. The
    record has its end since the start, its length and the round-off of both, in time steps."""
    run, moving = pools.run[0], pools.moving
    at = run.place
    steps, begin = moving[run.progress], moving[run.progress + 7]
    n, moving[run.progress + 8] = placed(steps, begin, moving[at], moving[at + 1], moving[at + 2])
    return n


@kernel
def present(pools: Any, rule: int, whole: int) -> int:
    """Put the outputs of the present state, and its fields at the points, into row 0; before the first time step those
    at t = 0 under the inputs as they are set, where a simulation begins; with ``whole`` under those of a first
    communication step of so many time steps. 0, or a negative status."""
    run, moving = pools.run[0], pools.moving
    if whole > 0:
        return open_run(pools, rule, whole)
    if moving[run.progress] > 0.0:
        put_back(pools)
        return 0
    move(pools, run.input_value, run.inputs + REACHED * run.n_input, run.n_input)
    move(pools, run.input_value, run.inputs + DRIVEN * run.n_input, run.n_input)
    return open_run(pools, HOLD, 1)


# -- inputs -------------------------------------------------------------------------------------------------------
@kernel
def given_of(pools: Any) -> tuple[Any, Any]:
    """Values and rates of the inputs, views."""
    run, n = pools.run[0], pools.run[0].n_input
    return pools.moving[run.input_value : run.input_value + n], pools.moving[run.input_rate : run.input_rate + n]


@kernel
def keep_inputs(pools: Any, done: int, whole: int, rule: int) -> None:
    """End a communication step after ``done`` of its time steps: what the next one goes on from."""
    run = pools.run[0]
    moving = pools.moving
    n = pools.run[0].n_input
    memory, kinds = moving[run.inputs : run.inputs + N_MEMORY * n], pools.fixed_int[run.input_kind : run.input_kind + n]
    at = run.progress
    begin = moving[at + 7]
    rest = moving[at + 8]
    span = moving[at + 3]
    moving[at + 3] = keep(given_of(pools), memory, kinds, span, done, whole, begin, rest, rule, run.dt)
    moving[at + 7], moving[at + 8] = rest if done == whole else 0.0, 0.0


@kernel
def set_sources(pools: Any, to: int, j: int, steps: int, whole: int, rule: int) -> None:
    """Amplitudes of the sources after j of the time steps, ``steps`` since the start, into the moving block."""
    run = pools.run[0]
    moving = pools.moving
    n = pools.run[0].n_input
    memory, kinds = moving[run.inputs : run.inputs + N_MEMORY * n], pools.fixed_int[run.input_kind : run.input_kind + n]
    inputs, at = given_of(pools), run.progress
    span = moving[at + 3]
    begin = moving[at + 7]
    rest = moving[at + 8]
    for e in range(n):
        moving[to + e] = drive(inputs, memory, kinds, e, span, j, whole, begin, rest, rule, run.dt)
    n_law = run.n_source - run.n_input
    row = run.law_table + n_law * min(steps - run.law_first, max(run.law_end, 0))
    for e in range(n_law):
        moving[to + run.n_input + e] = pools.fixed[row + e]  # the last row holds ever after


@kernel
def set_histories(pools: Any, instant: int, j: int, steps: int, whole: int, rule: int) -> None:
    """Columns of an instant of the segment, which ends the time step j of the communication step, and its drives."""
    run, moving = pools.run[0], pools.moving
    z = run.drive + instant * run.n_drive
    wide = run.n_drive
    n_x = run.n_motion_state
    # the motion state after the instant before is x of this one
    move(pools, z - wide, z, n_x)
    set_sources(pools, z + n_x, j - 1, steps - 1, whole, rule)
    set_sources(pools, z + n_x + run.n_source, j, steps, whole, rule)
    moving[z + wide - 1] = 1.0  # the constant part of a column
    drives, columns = moving[z : z + wide], moving[run.column : run.column + run.column_rows]
    if run.static == 1:
        # those of the instant before, for ``continuation``
        move(pools, run.column, run.last_columns, run.column_rows)
    columns[:] = 0.0
    add_matrix(pools, run.column_rows, run.column_starts, run.column_columns, run.column_values, 1, drives, columns)
    spread_columns(pools, instant)
    if run.static == 1:
        moving[run.continuation + instant] = continuation(pools, j)
    state = moving[run.next_state : run.next_state + n_x]
    state[:] = 0.0
    add_matrix(pools, n_x, run.motion_starts, run.motion_columns, run.motion_values, 1, drives, state)
    # from now on the row holds the state at its end: the signals of the instant read it there
    move(pools, run.next_state, z, n_x)


@kernel
def set_start_columns(pools: Any, steps: int, whole: int, rule: int) -> None:
    """Columns at the start of a communication step, for ``continuation``."""
    run, moving = pools.run[0], pools.moving
    z = run.drive
    wide = run.n_drive
    n_x = run.n_motion_state
    set_sources(pools, z + n_x, 0, steps, whole, rule)
    set_sources(pools, z + n_x + run.n_source, 1, steps + 1, whole, rule)
    moving[z + wide - 1] = 1.0
    columns = moving[run.column : run.column + run.column_rows]
    columns[:] = 0.0
    starts = run.start_column_starts
    numbers = run.start_column_columns
    values = run.start_column_values
    add_matrix(pools, run.column_rows, starts, numbers, values, 1, moving[z : z + wide], columns)


@kernel
def continuation(pools: Any, j: int) -> float:
    """How far the loads go on as they did (``latin.run_image.continuation``) at the end of the time step j."""
    run, moving = pools.run[0], pools.moving
    along = 0.0
    size = 0.0
    change = 0.0
    at = run.column
    product = run.force_products
    new = run.column
    old = run.last_columns
    last = run.last_columns + run.column_rows
    for c in range(len(pools.classes)):
        row = pools.classes[c]
        n, first = row.force_terms, at - run.column
        # change of the loads on that of the step before, in the products of their patterns
        for p in range(n):
            for q in range(n):
                weight = pools.fixed[product + p * n + q]
                of_p = moving[new + first + p] - moving[old + first + p]
                of_q = moving[new + first + q] - moving[old + first + q]
                along += weight * of_p * moving[last + first + q]
                size += weight * moving[last + first + p] * moving[last + first + q]
                change += weight * of_p * of_q
        product += n * n
        at += row.force_terms + row.inertia_terms + row.velocity_terms + row.displacement_terms
        at += row.acceleration_terms + row.work_terms + (3 + row.n_branch) * row.n_motion * row.m
    same = False
    for e in range(run.n_ground):
        # the ground moves on as it did
        same = same or moving[at + e] * moving[at + e - run.column + old] > 0.0
    for i in range(run.column_rows):
        moving[last + i] = moving[new + i] - moving[old + i]
    if j < 2:  # two increments make a direction
        return 1.0
    share = along / size if size > 0.0 and change > 0.0 else (1.0 if same else 0.0)
    return min(max(share, 0.0), 1.0)


@kernel
def spread_columns(pools: Any, instant: int) -> None:
    """Write the columns of an instant to their places in the histories."""
    # in the order of ``cosim.drives.Drives.columns``
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
        for kind in range(3 + row.n_branch):
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
    n_x = run.n_motion_state
    n_s = run.n_source
    wide = run.n_drive
    z = run.drive
    # the motion state stays 0: there is none before t = 0
    moving[z : z + wide] = 0.0
    set_sources(pools, z + n_x, 0, 0, whole, rule)
    set_sources(pools, z + n_x + n_s, 1, 1, whole, rule)
    moving[z + wide - 1] = 1.0
    # before anything of the state is written
    for e in range(run.n_input):
        if departs(pools, e):
            return -2 - e
    drives, columns = moving[z : z + wide], moving[run.column : run.column + run.column_rows]
    columns[:] = 0.0
    starts = run.first_column_starts
    numbers = run.first_column_columns
    values = run.first_column_values
    add_matrix(pools, run.column_rows, starts, numbers, values, 1, drives, columns)
    spread_columns(pools, 0)
    initial = moving[run.opening : run.opening + run.opening_rows]
    initial[:] = 0.0
    add_matrix(pools, run.opening_rows, run.opening_starts, run.opening_columns, run.opening_values, 1, drives, initial)
    set_opening(pools)
    state = moving[run.next_state : run.next_state + n_x]
    state[:] = 0.0
    starts = run.first_motion_starts
    numbers = run.first_motion_columns
    values = run.first_motion_values
    add_matrix(pools, n_x, starts, numbers, values, 1, drives, state)
    move(pools, run.next_state, z, n_x)
    move(pools, run.next_state, run.motion_state, n_x)
    # row 0 is t = 0: both amplitudes of its drives are those at the start
    move(pools, z + n_x, z + n_x + n_s, n_s)
    open_accounts(pools)
    read_start(pools)
    open_outputs(pools)
    return 0


@kernel
def open_outputs(pools: Any) -> None:
    """Outputs of row 0, in which a simulation begins."""
    run, moving = pools.run[0], pools.moving
    moving[run.integral : run.integral + run.n_integral] = 0.0
    moving[run.passed : run.passed + 2 * run.n_filtered] = 0.0
    gather(pools, 0)
    at = run.output + run.of_solver
    moving[at] = 0.0
    moving[at + 1] = 0.0
    moving[at + 2] = 1.0
    moving[at + 3] = 0.0
    moving[at + 4] = moving[run.progress + 6]
    moving[run.event_rates : run.event_rates + 2 * run.n_interface] = 0.0
    set_ratios(pools, 0)
    move(pools, run.output, run.present, run.n_output)


@kernel
def departs(pools: Any, e: int) -> bool:
    """Whether the initial state is not known for the amplitudes of an input in the first time step."""
    run, moving = pools.run[0], pools.moving
    constraint, kind = pools.fixed_int[run.input_held + e], pools.fixed_int[run.input_kind + e]
    if constraint == FREE:
        return False
    first, start = run.drive + run.n_motion_state + e, pools.fixed[run.input_start + e]
    # driven by its rate: the amplitude itself is compared
    if kind == DISPLACEMENT:
        moves = moving[first] != 0.0 or moving[first + run.n_source] != 0.0
        return bool(moving[run.inputs + DRIVEN * run.n_input + e] != start or (constraint == BY_BOTH and moves))
    return bool(moving[first] != start or (constraint == BY_BOTH and moving[first + run.n_source] != start))


@kernel
def set_opening(pools: Any) -> None:
    """Write the part of the initial state that depends on inputs to its places; a class that rests has no motion."""
    run, moving = pools.run[0], pools.moving
    e = 0
    passed = 0
    n = run.opening_rows
    for c in range(len(pools.classes)):
        row = pools.classes[c]
        size = row.n * row.m
        for kind in range(4):
            to = row.u if kind == 0 else row.v if kind == 1 else row.a if kind == 2 else row.residual
            e = _write_opening(pools, e, passed, size, to)
            passed += size
        e = _write_opening(pools, e, passed, size_of_state(row), row.face_state)
        passed += size_of_state(row)
        still = 1.0
        for i in range(size):
            if moving[row.u + i] != 0.0 or moving[row.v + i] != 0.0:
                still = 0.0
            if moving[row.a + i] != 0.0 or moving[row.residual + i] != 0.0:
                still = 0.0
        # else it is as the image was made
        if n > 0:
            moving[row.rest] = still
    e = _write_opening(pools, e, passed, run.n_flat, run.f_hat)
    _write_opening(pools, e, passed + run.n_flat, run.n_flat, run.w_hat)


@kernel
def _write_opening(pools: Any, e: int, passed: int, size: int, to: int) -> int:
    """Write the numbers whose places lie in an array; the number of the next one."""
    run = pools.run[0]
    # places ascend: one pass serves all arrays
    while e < run.opening_rows and pools.fixed_int[run.opening_place + e] < passed + size:
        pools.moving[to + pools.fixed_int[run.opening_place + e] - passed] = pools.moving[run.opening + e]
        e += 1
    return e


@kernel
def put_back(pools: Any) -> None:
    """Row 0 of outputs, fields, drives and prescribed motions from the state."""
    run = pools.run[0]
    row_of_state(pools)
    at = run.motion_state
    for c in range(len(pools.classes)):
        row = pools.classes[c]
        size = row.n_motion * row.m
        for kind in range(3 + row.n_branch):
            move(pools, at, row.motions + kind * run.n_time * size, size)
            at += size


@kernel
def row_of_state(pools: Any) -> None:
    """Row 0 of outputs, fields and drives from the state."""
    run = pools.run[0]
    move(pools, run.present, run.output, run.n_output)
    move(pools, run.f_hat, run.history_f, run.n_flat)
    move(pools, run.w_hat, run.history_w, run.n_flat)
    for g in range(len(pools.groups)):
        group = pools.groups[g]
        move(pools, group.gap, run.history_gap + group.first_point, group.n_point)
    move(pools, run.motion_state, run.drive, run.n_motion_state)
