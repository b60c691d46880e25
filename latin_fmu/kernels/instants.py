"""From one instant to the next: first guess, solution, end of the instant; many instants in one call; t = 0."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from .callouts import SUM, call_out, has_failed
from .energy import open_account
from .energy_parts import ELASTIC, INSTANTS, KINETIC, N_TERM, N_WORK, OF_DRIFT, OF_GROUND, PRESTRESS, STORED
from .half_solves import refers
from .indicator import cross_of_classes, work_of_error
from .iteration import begin_window, iterate, precise, rewind
from .local_stage import add_made_up, follow_drift, open_window, read_gaps, take_drift
from .matrices import probe, read_channels
from .newton import MADE, POWER, RESIDUAL, keep_course
from .prediction import expect
from .products import add_dense
from .sparse_response import MOST_CORRECTIONS, squared_defect
from .sums import exchange
from .tasks import END, END_OF_WINDOW, PREDICT, SOLUTION, each_class

Array = NDArray[np.float64]

WITHIN = 1
CORRECTED = 0
FAILED = -1
"""Results of ``correct``."""
OPENINGS, GUESS, FREE = range(3)
"""How much ``begin_at`` does."""


@kernel
def march_instants(pools: Any, first: int, n: int) -> int:
    """Solve up to n windows of one instant from the instant ``first`` on; number of those that converged before one
    that did not (which leaves state and output as they were at its start)."""
    for call in range(n):
        instant = first + call
        each_class(pools, PREDICT, instant, 0)
        if has_failed(pools) or not solve_instant(pools, instant, call):
            return call
        while pools.run[0].sparse == 1:
            verdict = correct(pools, instant, call)
            if verdict == WITHIN:
                break
            used = -1
            if verdict == CORRECTED:
                used = again(pools, instant, call)
                pools.moving_int[pools.run[0].iterations + call] = used
            if used <= 0:
                return call
        if pools.run[0].shared == 1:
            # by the tractions of the last iterate, on all processes
            pools.moving[pools.run[0].touched] = pools.moving[pools.run[0].acting]
        end_at(pools, instant, 0, 1)
        if has_failed(pools):
            return call
    return n


@kernel
def begin_at(pools: Any, window: int, first: int, further: int) -> None:
    """Begin a window that starts with instant ``first``: keep the states, read the openings; of one instant the free
    response, and with GUESS its first guess. FREE, in a window that has begun: the velocities without tractions, into
    ``w``."""
    run = pools.run[0]
    if further != FREE:
        begin_window(pools)
        open_window(pools, window, first - 1)
    if window == 1:
        each_class(pools, PREDICT, first, 0)
    if further == GUESS:
        first_guess(pools, first)
    elif further == FREE:
        free_motion(pools, first, pools.moving[run.w : run.w + run.n_flat])
        exchange(pools, run.w, run.n_flat, 1)


@kernel
def leave_window(pools: Any, accepted: int) -> None:
    """End the iterations over a window whose last iterate is accepted for so many instants, 0 where it is not, and
    return to the states at its start; those of one instant have not changed."""
    if accepted > 0:
        accept(pools, accepted)
    # a long window has marched the classes to its end
    if accepted != 1:
        rewind(pools)


@kernel
def end_at(pools: Any, instant: int, i: int, window: int) -> None:
    """End the instant i of a window with the accepted iterate: motion, gaps, energies, probes, fields."""
    if window == 1:
        each_class(pools, END, instant, 0)
        end_instant(pools, instant, 0)
    else:
        end_window_instant(pools, instant, i)


@kernel
def solve_instant(pools: Any, instant: int, call: int) -> bool:
    """Iterate over the instant whose free responses are known; whether it converged."""
    run, work = pools.run[0], pools.moving
    open_window(pools, 1, instant - 1)
    if run.n_part == 0:  # of all processes: each of them takes this way then
        pools.moving[run.errors + call * run.max_iterations] = 0.0
        pools.moving[run.force_residuals + call * run.max_iterations] = 0.0
        pools.moving_int[run.iterations + call] = 1
        pools.moving_int[run.newton_steps + call] = 0
        return True
    first_guess(pools, instant)
    solved = work[run.counts + 1]
    used = iterate(pools, 1, instant, call, 0, 0, 0, run.max_iterations)
    pools.moving_int[run.iterations + call] = used
    pools.moving_int[run.newton_steps + call] = int(work[run.course + MADE])
    if used <= 0:
        work[run.counts + 1] = solved  # the Python driver solves this instant again, and counts
        return False
    pools.moving[run.defects + call] = 0.0
    pools.moving_int[run.corrections + call] = 0
    if run.sparse == 0:  # else it is accepted by ``correct``
        accept(pools, 1)
    return True


@kernel
def accept(pools: Any, window: int) -> None:
    """Take over the scales of the accepted iterate, and bring the largest indicator of each interface up to date."""
    run = pools.run[0]
    work = pools.moving
    state = pools.moving
    n = run.n_flat
    for e in range(3):
        state[run.scales + e] = work[run.measure + 2 + e]
    keep_course(pools)
    share = work[run.shares : run.shares + run.n_interface]
    share[:] = 0.0
    weights, interface = (
        pools.fixed[run.weights : run.weights + n],
        pools.fixed_int[run.interface : run.interface + n],
    )
    for i in range(window):
        r = work[run.r + i * n : run.r + (i + 1) * n]
        for j in range(n):
            share[interface[j]] += weights[j] * r[j] * r[j] / window  # mean over the instants, as in ``set_error``
    worst, scale = state[run.worst : run.worst + run.n_interface], state[run.scales]
    for e in range(run.n_interface):
        worst[e] = max(worst[e], np.sqrt(share[e] / scale))


@kernel
def again(pools: Any, instant: int, call: int) -> int:
    """Iterate on from a new reference (``correct``); as ``iterate``."""
    iterations = int(pools.moving_int[pools.run[0].iterations + call])
    return iterate(pools, 1, instant, call, iterations, iterations, iterations, pools.run[0].max_iterations)


@kernel
def correct(pools: Any, instant: int, call: int) -> int:
    """Solve under the tractions of the instant and compare the defect with the tolerance: WITHIN, and the
    instant is accepted; CORRECTED, these tractions and their exact velocities are the reference and the next iterate;
    or FAILED."""
    run, course = pools.run[0], pools.run[0].course
    each_class(pools, SOLUTION, instant, 0)
    squared, power = squared_defect(pools), cross_of_classes(pools, 1)
    if run.shared == 1:
        pools.moving[course + RESIDUAL], pools.moving[course + POWER] = squared, power
        call_out(pools, SUM, course + RESIDUAL, 2, 0)
        squared, power = pools.moving[course + RESIDUAL], pools.moving[course + POWER]
    size = float(np.sqrt(squared / pools.moving[run.measure + 2]))
    # after the last correction the tolerance alone decides: the work of the error is left as it is
    last = pools.moving_int[run.corrections + call] == MOST_CORRECTIONS
    allowed = run.tolerance if last or work_of_error(pools, 1, power) <= 1.0 else precise(run.tolerance) * run.tolerance
    if size <= allowed:
        pools.moving[run.defects + call] = size
        accept(pools, 1)
        return WITHIN
    if last or not np.isfinite(size):
        return FAILED
    pools.moving_int[run.corrections + call] += 1
    guess_from_reference(pools, pools.moving[run.q : run.q + run.n_flat], True)
    exchange(pools, run.q, run.n_flat, 1)
    # their solution is that under tractions that are not the last ones
    for c in range(len(pools.classes)):
        if pools.classes[c].sparse == 1:
            pools.moving[pools.classes[c].ended] = 0.0
    return CORRECTED


@kernel
def first_guess(pools: Any, instant: int) -> None:
    """q of the first iterate of an instant: that of the last tractions, or of those expected (``prediction``), and of
    the velocities under them; of the last velocities where steps are long and the tolerance is rough. Where no traction
    acted, that of the free motion, which is the solution as long as no gap closes. With ``direct_bonds`` the solution
    itself.

    At rough tolerances nothing is extrapolated: an extrapolation accepted within the tolerance would feed its own error
    and gain energy.
    """
    run = pools.run[0]
    work = pools.moving
    state = pools.moving
    direction = pools.fixed
    n = run.n_flat
    q, k = work[run.q : run.q + n], direction[run.k : run.k + n]
    if run.direct_bonds == 1:
        w = work[run.w : run.w + n]
        free_motion(pools, instant, w)
        add_made_up(pools, w)
        q[:] = 0.0
        add_dense(n, n, direction[run.bonds : run.bonds + n * n], w, q)
        # q is that of the motion of the sides, whose jumps are those of the law less what is made up
        w[:] = 0.0
        add_made_up(pools, w)
        for j in range(n):
            q[j] -= k[j] * w[j]
        return
    touched, carry = run.shared == 1 and state[run.touched] != 0.0, state[run.carry]
    # loads that turn back do not carry the last velocities on
    if run.static == 1:
        carry *= pools.moving[run.continuation + instant]
    f_hat = state[run.f_hat : run.f_hat + n]
    w_hat = state[run.w_hat : run.w_hat + n]
    w = work[run.w : run.w + n]
    for j in range(n):
        w[j] = carry * w_hat[j]
        touched = touched or f_hat[j] != 0.0
    take_drift(pools, w)
    for j in range(n):
        q[j] = f_hat[j] + k[j] * w[j]
    if touched or run.static == 1:
        guess_from_reference(pools, q, False)
        if run.referenced > 0:
            exchange(pools, run.q, n, 1)
        return
    free_motion(pools, instant, w)
    exchange(pools, run.w, n, 1)
    for j in range(n):
        q[j] = k[j] * w[j]


@kernel
def guess_from_reference(pools: Any, q: Array, sparse: bool) -> None:
    """q of the reference tractions and of the velocities that they give at the channels of classes with inertia,
    ``sparse``: of those with a table of Y alone. Not where steps are long and nothing is expected: there the last
    velocities are closer to the new ones."""
    run, work = pools.run[0], pools.moving
    for c in range(len(pools.classes)):
        row = pools.classes[c]
        if not refers(pools, c) or (sparse and row.sparse == 0):
            continue
        for at in range(row.n_channel * row.m):
            j = pools.fixed_int[row.channels + at]
            # W of the linear stage is w_free for this q, without a product (``linear_response``)
            q[j] = work[row.reference + at] + pools.fixed[run.k + j] * work[row.w_free + at]


@kernel
def free_motion(pools: Any, instant: int, w: Array) -> None:
    """Velocities (N,) of the channels without tractions, after ``predict``."""
    run = pools.run[0]
    for c in range(len(pools.classes)):
        row = pools.classes[c]
        size = row.n_channel * row.m
        channels, w_free = (
            pools.fixed_int[row.channels : row.channels + size],
            pools.moving[row.w_free : row.w_free + size],
        )
        for at in range(size):
            w[channels[at]] = w_free[at]
    for e in range(run.n_ground):
        w[pools.fixed_int[run.ground + e]] = pools.moving[run.ground_velocity + instant * run.n_ground + e]


@kernel
def end_instant(pools: Any, instant: int, i: int) -> None:
    """Gaps and drifts at the end of an instant, and its accepted fields among histories and as the start of the next
    one; they are those of instant i of the window."""
    run = pools.run[0]
    moving = pools.moving
    of_ground = 0.0
    # arrays of N numbers one behind the other: displacement, moved, layer
    exchange(pools, run.displacement, run.moved - run.displacement, 2 + run.layers)
    for e in range(run.n_ground):
        at, velocity = pools.fixed_int[run.ground + e], moving[run.ground_velocity + instant * run.n_ground + e]
        moving[run.moved + at] = velocity
        if pools.fixed_int[run.interface + at] < run.n_owned:
            # F_hat acts on the ground: the ground does the opposite work
            of_ground -= pools.fixed[run.area + at] * moving[run.local_f + i * run.n_flat + at] * velocity * run.dt
    moving[run.works + OF_GROUND] += of_ground
    moving[run.works + INSTANTS] += 1.0
    # before the fields are kept: W_hat becomes that of the law here
    follow_drift(pools, i)
    keep_fields(pools, instant, i)
    moving[run.history_works + instant - run.first_row] = moving[run.works + OF_DRIFT]
    read_gaps(pools, instant, True)


@kernel
def keep_fields(pools: Any, instant: int, i: int) -> None:
    """Keep the local-stage fields of instant i of the window."""
    run = pools.run[0]
    work = pools.moving
    state = pools.moving
    output = pools.moving
    n = run.n_flat
    f_hat, w_hat = (
        work[run.local_f + i * n : run.local_f + (i + 1) * n],
        work[run.local_w + i * n : run.local_w + (i + 1) * n],
    )
    row = instant - run.first_row
    to_f, to_w = run.history_f + row * n, run.history_w + row * n
    last_f, last_w = state[run.f_hat : run.f_hat + n], state[run.w_hat : run.w_hat + n]
    kept_f, kept_w = output[to_f : to_f + n], output[to_w : to_w + n]
    if run.expects == 1:
        expect(pools, f_hat)
    for j in range(n):
        last_f[j], last_w[j] = f_hat[j], w_hat[j]
        kept_f[j], kept_w[j] = f_hat[j], w_hat[j]


@kernel
def end_window_instant(pools: Any, instant: int, i: int) -> None:
    """March every class over instant i of a window with the accepted q, and read gaps, energies and probes."""
    each_class(pools, END_OF_WINDOW, instant, i)
    run = pools.run[0]
    work = pools.moving
    work_done = 0.0
    for c in range(len(pools.classes)):  # F acts, not F_hat
        row = pools.classes[c]
        for e in range(row.n_channel * row.m):
            at = pools.fixed_int[row.channels + e]
            excess = work[run.f + i * run.n_flat + at] - work[run.local_f + i * run.n_flat + at]
            work_done += pools.fixed[run.area + at] * excess * work[run.moved + at]
    work[run.works + OF_DRIFT] += work_done * run.dt
    end_instant(pools, instant, i)


@kernel
def read_start(pools: Any) -> None:
    """Gaps, probed velocities and energies at instant 0 of the segment; tractions and velocities are in the state."""
    run = pools.run[0]
    work = pools.moving
    state = pools.moving
    output = pools.moving
    n = run.n_flat
    for c in range(len(pools.classes)):
        probe(pools, c, 0)
        displacement, layer = work[run.displacement : run.displacement + n], work[run.layer : run.layer + n]
        read_channels(pools, c, 0, 1.0, run.gap_offset, 0.0, run.relaxing == 0, displacement)
        if run.layers == 1:
            read_channels(pools, c, 0, 1.0, run.gap_offset + run.layer_v, run.layer_a, False, layer)
        # row 0
        for j in range(N_TERM * pools.classes[c].m * pools.classes[c].accounted):
            output[pools.classes[c].energies + j] = state[pools.classes[c].totals + j]
    for j in range(n):
        output[run.history_f + j], output[run.history_w + j] = state[run.f_hat + j], state[run.w_hat + j]
    output[run.history_works] = state[run.works + OF_DRIFT]
    exchange(pools, run.displacement, run.moved - run.displacement, 2 + run.layers)
    read_gaps(pools, 0, False)


@kernel
def open_accounts(pools: Any) -> None:
    """Begin the account of energies of every class at instant 0, with the tractions of the state."""
    run = pools.run[0]
    tractions = pools.moving[run.f_hat : run.f_hat + run.n_flat]
    works, stored = pools.moving[run.works : run.works + N_WORK], 0.0
    for c in range(len(pools.classes)):
        open_account(pools, c, 0, tractions)
        row = pools.classes[c]
        for j in range(row.m * row.accounted):
            stored += pools.moving[row.totals + KINETIC * row.m + j] + pools.moving[row.totals + ELASTIC * row.m + j]
            stored += pools.moving[row.totals + PRESTRESS * row.m + j]
    works[:] = 0.0
    works[STORED] = stored
