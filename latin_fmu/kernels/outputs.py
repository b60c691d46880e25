"""Outputs of a communication step at its instants, and the fields of the interfaces at their points.

The outputs after a time step are linear in its signals (tractions, velocities, gaps, what sensors and probes read,
drives, energies), of which a part may be the mean over two instants. Others follow from them: integrals over time
(trapezoidal rule), rates over a time step, what leaves a causal filter, and the largest so far. Written here are the
smallest gap and the shares of the contact, which are read point by point, contact events, and the numbers of the
iteration.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from ..laws.dispatch import contact_status
from .energy_parts import ELASTIC, KINETIC, N_TERM, PRESTRESS, TERMS
from .local_stage import parameters_at
from .matrices import add_matrix

Array = NDArray[np.float64]

READ: Final = ("normalForce", "smallestGap", "closed", "sticking", "slipping", "touches")
"""Outputs of an interface whose places begin its row of ``summary``, -1 where it has no such one; the number of its
group and its points follow."""
PRESSING, SMALLEST, CLOSED, STICKING, SLIPPING, TOUCHES, OF_GROUP, BEGIN, END = range(9)
"""Columns of ``summary``."""
N_SUMMARY: Final = 9
WRITTEN: Final = READ[SMALLEST : SLIPPING + 1]
"""Of those, written here as they are no linear functions."""
ENERGIES: Final = (*TERMS, "friction_dissipation", "start")
"""Energies among the signals, J: terms of the account over all members, energy dissipated by friction, kinetic and
elastic energy at t = 0."""


@kernel
def move(pools: Any, start: int, to: int, n: int) -> None:
    """Copy numbers of the moving block."""
    moving = pools.moving
    for i in range(n):
        moving[to + i] = moving[start + i]


@kernel
def count_iterations(pools: Any, call: int) -> None:
    """Add iterations and indicator of an instant of the call to those of the communication step."""
    run, moving = pools.run[0], pools.moving
    used = pools.moving_int[run.iterations + call]
    moving[run.progress + 1] += used
    # that of the last iteration
    reached = moving[run.errors + call * run.max_iterations + used - 1] if used > 0 else 0.0
    moving[run.progress + 2] = max(moving[run.progress + 2], reached)


@kernel
def keep_outputs(pools: Any, row: int, j: int, steps: int) -> None:
    """Outputs after a time step of the call, ``row``, which is j of the communication step and ``steps`` since the
    start."""
    run = pools.run[0]
    moving = pools.moving
    progress = pools.run[0].progress
    gather(pools, row)
    at = run.output + row * run.n_output + run.of_solver
    moving[at], moving[at + 1], moving[at + 2] = moving[progress + 1], moving[progress + 2], 1.0
    moving[at + 3], moving[at + 4] = j, moving[progress + 6] + steps * run.dt
    follow_events(pools, row, steps)


@kernel
def gather(pools: Any, row: int) -> None:
    """Outputs of a row that follow from the fields of that instant and, in rows behind the first, from the row
    before."""
    run, moving = pools.run[0], pools.moving
    set_signals(pools, row)
    # energies are signals where the scene has output.energy
    if run.of_energy >= 0:
        set_energies(pools, row, moving[run.signal + run.of_energy : run.signal + run.n_signal])
    at = run.output + row * run.n_output
    outputs, signals = moving[at : at + run.n_output], moving[run.signal : run.signal + run.n_signal]
    outputs[:] = 0.0
    add_matrix(pools, run.n_output, run.output_starts, run.output_columns, run.output_values, 1, signals, outputs)
    for i in range(run.n_integral):
        of, to = pools.fixed_int[run.integrals + 2 * i], pools.fixed_int[run.integrals + 2 * i + 1]
        if row > 0:
            moving[run.integral + i] += 0.5 * run.dt * (outputs[of] + moving[at - run.n_output + of])
        outputs[to] = moving[run.integral + i]
    set_means(pools, row, signals, outputs)
    for i in range(run.n_interface):
        summary = summary_of(pools, i)
        if summary[SMALLEST] >= 0:
            summarise(pools, row, summary, outputs)
    follow(pools, row, outputs)


@kernel
def follow(pools: Any, row: int, outputs: Array) -> None:
    """Outputs that follow from others of this row and the one before: rates over the time step, which at t = 0 are what
    the matrix gives; what leaves a filter; largest lengths so far."""
    run, moving, numbers = pools.run[0], pools.moving, pools.fixed_int
    before = run.output + (row - 1) * run.n_output
    for i in range(run.n_rate if row > 0 else 0):
        of = numbers[run.rates + 2 * i]
        outputs[numbers[run.rates + 2 * i + 1]] = (outputs[of] - moving[before + of]) / run.dt
    for i in range(run.n_filtered):
        at, passed = run.filtered + 3 * i, run.passed + 2 * i
        section = pools.fixed[run.sections + 5 * numbers[at + 2] :]
        # transposed direct form II, as the filters of results (``scipy.signal.sosfilt``)
        entering = outputs[numbers[at]]
        leaving = section[0] * entering + moving[passed]
        moving[passed] = section[1] * entering - section[3] * leaving + moving[passed + 1]
        moving[passed + 1] = section[2] * entering - section[4] * leaving
        outputs[numbers[at + 1]] = leaving
    for i in range(run.n_largest):
        at, square = run.largest + 3 * i, 0.0
        for k in range(numbers[at + 1]):
            square += outputs[numbers[at] + k] ** 2
        to = numbers[at + 2]
        outputs[to] = max(np.sqrt(square), moving[before + to] if row > 0 else 0.0)


@kernel
def set_means(pools: Any, row: int, signals: Array, outputs: Array) -> None:
    """Let the part of an output that is a mean over the last two instants be that: half of it is the present one, half
    that before; at t = 0 the present one alone."""
    run, moving = pools.run[0], pools.moving
    now = moving[run.lag : run.lag + run.lag_rows]
    now[:] = 0.0
    add_matrix(pools, run.lag_rows, run.lag_starts, run.lag_columns, run.lag_values, 1, signals, now)
    for i in range(run.lag_rows):
        if row > 0:
            outputs[pools.fixed_int[run.lag_place + i]] += moving[run.lagged + i] - now[i]
        moving[run.lagged + i] = now[i]


@kernel
def set_signals(pools: Any, row: int) -> None:
    """Gather the signals of a row."""
    run = pools.run[0]
    at = pools.run[0].signal
    n = pools.run[0].n_flat
    move(pools, run.history_f + row * n, at, n)
    move(pools, run.history_w + row * n, at + n, n)
    move(pools, run.history_gap + row * run.n_point, at + 2 * n, run.n_point)
    at += 2 * n + run.n_point
    for c in range(len(pools.classes)):
        of = pools.classes[c]
        sensed, probed = of.n_sensed * of.n_sensor * of.m, of.n_probe * of.m
        move(pools, of.sensed + row * sensed, at, sensed)
        move(pools, of.probed + row * probed, at + sensed, probed)
        at += sensed + probed
    move(pools, run.drive + row * run.n_drive, at, run.n_drive)


@kernel
def summary_of(pools: Any, i: int) -> Any:
    """Places of the outputs of an interface that are read or written here, its group and its points, a view."""
    at = pools.run[0].summary + N_SUMMARY * i
    return pools.fixed_int[at : at + N_SUMMARY]


@kernel
def summarise(pools: Any, row: int, summary: Any, outputs: Array) -> None:
    """Smallest gap of an interface, and the shares of its area that are closed, stick and slip."""
    run, moving = pools.run[0], pools.moving
    group = pools.groups[summary[OF_GROUP]]
    gaps, smallest = run.history_gap + row * run.n_point + group.first_point, np.inf
    closed = 0.0
    stuck = 0.0
    slipping = 0.0
    for p in range(summary[BEGIN], summary[END]):
        smallest = min(smallest, moving[gaps + p])
        status = status_at(pools, row, summary[OF_GROUP], p)
        share = pools.fixed[run.area_share + group.first_point + p]
        closed += share if status != 0 else 0.0
        stuck += share if status == 1 else 0.0
        slipping += share if status == 2 else 0.0
    outputs[summary[SMALLEST]], outputs[summary[CLOSED]] = smallest, closed
    outputs[summary[STICKING]], outputs[summary[SLIPPING]] = stuck, slipping


@kernel
def set_energies(pools: Any, row: int, energies: Array) -> None:
    """The ``ENERGIES`` of a row, J."""
    run = pools.run[0]
    moving = pools.moving
    progress = pools.run[0].progress
    energies[:] = 0.0
    for c in range(len(pools.classes)):
        of = pools.classes[c]
        for term in range(N_TERM):
            at = of.energies + (row * N_TERM + term) * of.m
            for j in range(of.m):
                energies[term] += moving[at + j]
    if row == 0:
        # the balance counts from t = 0
        moving[progress + 4] = energies[KINETIC] + energies[ELASTIC] + energies[PRESTRESS]
        moving[progress + 5] = 0.0
    else:
        moving[progress + 5] += run.dt * friction_power(pools, row)
    energies[N_TERM], energies[N_TERM + 1] = moving[progress + 5], moving[progress + 4]


@kernel
def friction_power(pools: Any, row: int) -> float:
    """Power dissipated by friction at the instant of a row, W."""
    run = pools.run[0]
    moving = pools.moving
    power = 0.0
    f, w = run.history_f + row * run.n_flat, run.history_w + row * run.n_flat
    for g in range(len(pools.groups)):
        group = pools.groups[g]
        h, second = group.n_component, group.start + group.n_point * group.n_component
        if group.opens == 0 or h == 1:
            continue
        for p in range(group.n_point):
            for k in range(1, h):
                at = p * h + k
                # of E' over E; traction on E along it dissipates
                slip = moving[w + second + at] - moving[w + group.start + at]
                power += moving[f + group.start + at] * slip * pools.fixed[run.area + group.start + at]
    return power


@kernel
def gather_fields(pools: Any, row: int) -> None:
    """Tractions, velocities, gaps and states of the points of the interfaces at the instant of a row."""
    run, moving = pools.run[0], pools.moving
    set_signals(pools, row)
    fields, signals = moving[run.field : run.field + run.field_rows], moving[run.signal : run.signal + run.n_signal]
    fields[:] = 0.0
    add_matrix(pools, run.field_rows, run.field_starts, run.field_columns, run.field_values, 1, signals, fields)
    for i in range(run.n_interface):
        to = pools.fixed_int[run.status_place + i]
        summary = summary_of(pools, i)
        for p in range(summary[BEGIN], summary[END] if to >= 0 else summary[BEGIN]):
            fields[to + p - summary[BEGIN]] = status_at(pools, row, summary[OF_GROUP], p)


@kernel
def status_at(pools: Any, row: int, g: int, p: int) -> int:
    """Contact state of a point of a group at the instant of a row."""
    run, group = pools.run[0], pools.groups[g]
    h = group.n_component
    at = run.history_f + row * run.n_flat + group.start + p * h
    return int(contact_status(group.law, pools.moving[at : at + h], parameters_at(pools, g, p), run.no_contact))


# -- contact events (``cosim.output_table``) ------------------------------------------------------------------------
@kernel
def set_ratios(pools: Any, row: int) -> None:
    """|T| / N of the interfaces at the instant of a row, 0 without pressure."""
    run, moving = pools.run[0], pools.moving
    set_signals(pools, row)
    n = 3 * run.n_interface
    shear, signals = moving[run.shear : run.shear + n], moving[run.signal : run.signal + run.n_signal]
    shear[:] = 0.0
    add_matrix(pools, n, run.shear_starts, run.shear_columns, run.shear_values, 1, signals, shear)
    for i in range(run.n_interface):
        normal = moving[run.output + row * run.n_output + summary_of(pools, i)[PRESSING]]
        x = shear[3 * i]
        y = shear[3 * i + 1]
        z = shear[3 * i + 2]
        ratio = np.sqrt(x * x + y * y + z * z) / normal if normal > 0.0 else 0.0
        moving[run.friction_ratio + row * run.n_interface + i] = ratio


@kernel
def follow_events(pools: Any, row: int, steps: int) -> None:
    """Counts and instants of touches, separations and slips in the time step that ends at a row."""
    run = pools.run[0]
    moving = pools.moving
    dt = pools.run[0].dt
    set_ratios(pools, row)
    new = run.output + row * run.n_output
    # counts and instants go on from the row before
    move(pools, new - run.n_output + run.of_event, new + run.of_event, run.n_output - run.of_event)
    for i in range(run.n_interface):
        summary = summary_of(pools, i)
        if summary[TOUCHES] < 0:
            continue
        old, to = new - run.n_output, new + summary[TOUCHES]
        was, closed = moving[old + summary[CLOSED]] > 0.0, moving[new + summary[CLOSED]] > 0.0
        stuck, sticks = moving[old + summary[STICKING]] > 0.0, moving[new + summary[STICKING]] > 0.0
        pressing, ratio = summary[PRESSING], run.friction_ratio + row * run.n_interface + i
        rates, rate = run.event_rates + 2 * i, (moving[ratio] - moving[ratio - run.n_interface]) / dt
        if closed and not was:
            count_event(pools, to, steps, time_to_touch(pools, row, summary))
        elif was and not closed:
            # the force falls to zero at its last rate
            count_event(pools, to + 2, steps, time_of(moving[old + pressing], -moving[rates]))
        elif was and stuck and not sticks:
            # the ratio reaches that of sliding, its new value, at its last rate
            count_event(pools, to + 4, steps, time_of(rate * dt, moving[rates + 1]))
        moving[rates] = (moving[new + pressing] - moving[old + pressing]) / dt if closed else 0.0
        moving[rates + 1] = rate if closed else 0.0


@kernel
def count_event(pools: Any, at: int, step: int, after: float) -> None:
    """Count an event so long after the start of the time step ``step``, at most at its end."""
    run, moving = pools.run[0], pools.moving
    moving[at] += 1.0
    instant = (step - 1) * run.dt + after if after < run.dt else step * run.dt
    moving[at + 1] = moving[run.progress + 6] + instant


@kernel
def time_of(way: float, speed: float) -> float:
    """Time in which a speed covers a way; infinite where it leads elsewhere."""
    return float(max(way, 0.0) / speed if speed > 0.0 else np.inf)


@kernel
def time_to_touch(pools: Any, row: int, summary: Any) -> float:
    """Time from the instant before a row until the first of the points that touch there has no gap."""
    run = pools.run[0]
    moving = pools.moving
    group = pools.groups[summary[OF_GROUP]]
    gaps = run.history_gap + (row - 1) * run.n_point + group.first_point
    first = run.history_w + (row - 1) * run.n_flat + group.start
    second, least = first + group.n_point * group.n_component, np.inf
    for p in range(summary[BEGIN], summary[END]):
        if status_at(pools, row, summary[OF_GROUP], p) != 0:
            at = p * group.n_component  # approach along N
            least = min(least, time_of(moving[gaps + p], moving[first + at] - moving[second + at]))
    return least
