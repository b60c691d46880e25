"""The LATIN loop over one window: linear stage, local stage, indicator, next iterate.

``next_stage`` is one iteration up to its measures, or a Newton step; ``judge`` compares these with the tolerances;
``iterate`` repeats both until the window has converged or stalled, or the iterations are used up. There is no other
loop: what comes after a stall is decided outside (``latin.solver``), and ``iterate`` goes on from there.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from .acceleration import difference_parts
from .callouts import NORMS_OF_ALL, OBSERVE, call_out, has_failed
from .indicator import add_all_norms, add_class_norms, own_norms, relative_forces, residual_parts, set_error
from .linear_stage import linear_stage
from .newton import (
    ACTIVE,
    BEGUN,
    DUE,
    GAIN,
    LAST,
    LEFT,
    MADE,
    N_COURSE,
    PHASE,
    advance_iterate,
    keep_end,
    leave,
    propose,
    search,
    share_to_meet,
    steps_made,
)
from .prediction import counted
from .sums import exchange_parts
from .tasks import NORMS, each_class, each_point

Array = NDArray[np.float64]

PATIENCE, RECENT = 12, 6
"""Iterations before the first check for a stall, and number of the last ones in which the merit has to fall."""
STALL_ACCELERATED, STALL_PLAIN = 0.7, 0.99
"""Fraction of the best merit before that the recent ones have to fall below, with acceleration and without."""
AT_REST = 1e-2
"""Fraction of the tolerances up to which the first iterate of an instant is accepted."""
EXACT = 1e-9
"""Tolerance from which on the CLOSER one of many iterations is round-off."""
PRECISE, IDLE = 0.03, 1e-7
"""Share of the tolerances within which the work of the error does not count: it changes its sign from iterate to
iterate. Tolerance up to which it never does: of bodies at rest it is round-off there."""
AHEAD = 0.5
"""Share of the tolerances that ends an instant whose tractions were extrapolated: in a series of them what is left of
the velocities is up to twice as large at the same residual."""
MOST = 6
"""Newton steps of an instant after which the work of the error does not count. Where steps are long none are made for
it: they gain a factor of two each there, and the scheme takes most of the energy of an instant anyway."""
CONVERGED = 1
BEST = 2
STALLED = 4
BROKEN = 8
"""Bits of the result of ``judge``: both tolerances met; best iterate so far; no progress; numbers out of range."""


@kernel
def measure(pools: Any, window: int, iteration: int, steps: int) -> None:
    """sqrt(eta) into ``measure[0]`` and, where that may end the window or is below tolerance for the first time, the
    force residual into ``measure[1]``. The processes of a run exchange the sums of the next step of the acceleration
    with them, after so many ``steps``."""
    residual_parts(pools, window)
    if pools.run[0].shared == 1:
        difference_parts(pools, window, steps)
        exchange_parts(pools)
    run, work = pools.run[0], pools.moving
    error = set_error(pools, window)
    # its products with C decide nothing where the indicator is larger; the first ones give the ratio of both merits
    if error <= run.tolerance and (
        error <= share_of(pools, window, iteration) * run.tolerance or (iteration > 0 and work[run.measure + 5] == 1.0)
    ):
        force_residual(pools, window)


@kernel
def share_of(pools: Any, window: int, iteration: int) -> float:
    """Share of the tolerances that the measures of this iterate have to meet. Where the tractions were extrapolated
    (``prediction``) the iterations that this saved count, at the rate of those made, and the share is AHEAD of that."""
    run, work = pools.run[0], pools.moving
    if window > 1 or work[run.course + MADE] != 0.0 or not run.tolerance > EXACT or run.residual_alone == 1:
        return 1.0
    share = AHEAD if run.expects == 1 and iteration > 0 and 0.0 < work[run.misfit] < 1.0 else 1.0
    return float(share * share_to_meet(counted(pools, iteration)))


@kernel
def force_residual(pools: Any, window: int) -> float:
    """Largest relative force residual over the instants of the window."""
    force_norms(pools, window)
    return relative_forces(pools, window)


@kernel
def force_norms(pools: Any, window: int) -> None:
    """Squared norms of the forces and of their half residuals at the instants of the window, into ``norms``."""
    each_class(pools, NORMS, window, 0)
    if pools.run[0].shared == 0:
        add_class_norms(pools, window)
        return
    own_norms(pools, window)
    call_out(pools, NORMS_OF_ALL, window, 0, 0)
    add_all_norms(pools, window)


@kernel
def stage(pools: Any, window: int, first: int, number: int, begin: int, steps: int) -> None:
    """One iteration from the q of ``work``: fields of both stages, residual, measures; its ``number`` in the window,
    ``begin`` of them under another reference."""
    linear_stage(pools, window, first, number - begin)
    each_point(pools, window)
    measure(pools, window, number, steps)


@kernel
def newton_step(pools: Any, first: int, iteration: int) -> bool:
    """An iterate by a Newton step from the last one (``newton``), with its measures; False where there is none."""
    if not propose(pools):
        return False
    linear_stage(pools, 1, first, 1)
    keep_end(pools)
    search(pools)
    measure(pools, 1, iteration, 0)  # no differences for the acceleration
    return True


@kernel
def next_stage(pools: Any, window: int, first: int, iteration: int, begin: int, phase: int) -> None:
    """One iteration from the q of ``work``, or one Newton step where it is time for one, with ``begin`` iterations made
    before under another reference; ``phase``: the iteration from which on the acceleration has its differences."""
    run = pools.run[0]
    course = pools.moving[run.course : run.course + N_COURSE]
    if iteration == begin:
        course[:] = 0.0
    if window == 1 and course[ACTIVE] == 1.0:
        if newton_step(pools, first, iteration):
            return
        leave(pools, iteration)
    # 0 after a new reference too: what was solved under the old one is not taken again
    stage(pools, window, first, iteration, begin, steps_made(pools, window, iteration, phase))


@kernel
def judge(pools: Any, window: int, phase: int, iteration: int, accelerated: bool) -> int:
    """State of the iteration by its measures, as bits of CONVERGED, BEST, STALLED and BROKEN.

    The merit of an iterate is its distance from both tolerances (1: met). Where the force residual is not computed, the
    merit is that of the indicator times the ratio of the last iterate for which both were computed. The iteration has
    stalled where the best of the last RECENT merits is above STALL_ACCELERATED or STALL_PLAIN times the best before
    those, counted from the iteration ``phase`` on.
    """
    run, work = pools.run[0], pools.moving
    numbers = work[run.measure : run.measure + 9]
    merits = work[run.merits : run.merits + 2 * (iteration + 1)]
    error, forces = numbers[0], numbers[1]
    if iteration == 0:
        # their ratio where both are known; scale of the best iterate
        numbers[5], numbers[6] = 1.0, pools.moving[run.scales]
    merit, both = error / run.tolerance, np.nan
    if np.isfinite(forces) and np.isfinite(merit):
        both = max(merit, forces / run.force_tolerance)
        if merit > 0.0:
            numbers[5] = both / merit
    merits[2 * iteration], merits[2 * iteration + 1] = merit, both
    allowed = share_of(pools, window, iteration)
    met = error <= allowed * run.tolerance and forces <= allowed * run.force_tolerance
    steps = work[run.course + MADE]
    # the work of the error
    if numbers[8] > 1.0 and steps <= (MOST if run.from_last == 1 else 0) and run.residual_alone == 0:
        share = min(precise(run.tolerance), allowed)
        met = error <= share * run.tolerance and forces <= share * run.force_tolerance
    work[run.course + LAST] = float(iteration)
    # a first guess just within tolerance is not accepted: its error would grow from instant to instant
    still = error <= AT_REST * run.tolerance and forces <= AT_REST * run.force_tolerance
    if met and (window > 1 or iteration > 0 or still):
        return CONVERGED | BEST
    if not np.isfinite(error):
        return BROKEN
    since = int(work[run.course + PHASE])
    # the acceleration may have begun anew where Newton's method was left
    phase = max(phase, since)
    best = np.inf
    before = np.inf
    recent = np.inf
    for i in range(since, iteration + 1):
        now = merits[2 * i + 1] if np.isfinite(merits[2 * i + 1]) else numbers[5] * merits[2 * i]  # NaN: not measured
        if i < iteration:
            best = min(best, now)
        elif now <= best:
            best = -1.0  # the last one is the best
        if phase <= i <= iteration - RECENT:
            before = min(before, now)
        elif i > iteration - RECENT:
            recent = min(recent, now)
    bits = 0
    if best == -1.0:
        bits, numbers[6] = BEST, numbers[2]
        merit = both if np.isfinite(both) else numbers[5] * merit
        # where Newton's method is left, it goes back to there (``leave``)
        if run.newton == 1 and (work[run.course + ACTIVE] == 0.0 or merit < GAIN * work[run.course + BEGUN]):
            for j in range(run.n_flat):
                work[run.best_q + j] = work[run.q + j]
    if work[run.course + ACTIVE] == 1.0:  # its progress is judged by ``continues``
        return bits
    if iteration + 1 - phase >= PATIENCE and recent > (STALL_ACCELERATED if accelerated else STALL_PLAIN) * before:
        if window == 1 and run.newton == 1 and work[run.course + LEFT] == 0.0:
            work[run.course + DUE] = 1.0
        else:
            bits |= STALLED
    return bits


@kernel
def precise(tolerance: float) -> float:
    """Share of this tolerance within which the work of the error does not count."""
    return max(PRECISE, min(1.0, IDLE / tolerance))


@kernel
def iterate(pools: Any, window: int, first: int, call: int, begin: int, start: int, phase: int, limit: int) -> int:
    """Iterate from the q of ``work`` until the window has converged, and has made ``limit`` iterations at most; the
    iterations made where it converged, else minus that number.

    ``start`` iterations were made before, ``begin`` of them under another reference; ``phase``: the iteration from
    which on the acceleration has its differences, and stalls are looked for.
    """
    run = pools.run[0]
    for iteration in range(start, limit):
        next_stage(pools, window, first, iteration, begin, phase)
        # the call has a row for each of its instants
        pools.moving[run.errors + call * run.max_iterations + iteration] = pools.moving[run.measure]
        pools.moving[run.force_residuals + call * run.max_iterations + iteration] = pools.moving[run.measure + 1]
        bits = judge(pools, window, phase, iteration, run.depth > 0)
        if run.observed == 1:
            call_out(pools, OBSERVE, iteration, bits, 0)
        if has_failed(pools):
            return -(iteration + 1)
        if bits & CONVERGED:
            return iteration + 1
        # without inertia a body may take many equal steps back to where it sticks
        stalled = bits & STALLED != 0 and not (run.static == 1 and run.depth == 0)
        if stalled or bits & BROKEN:
            return -(iteration + 1)
        # after the last iteration q stays that of the fields
        if iteration + 1 < limit:
            advance_iterate(pools, window, iteration, phase)
    return -limit


@kernel
def begin_window(pools: Any) -> None:
    """Keep the present states as those at the start of a window; no solution is known in it."""
    for c in range(len(pools.classes)):
        row = pools.classes[c]
        pools.moving[row.known] = 0.0
        # there is room for them with longer windows alone: one instant changes no state before it is accepted
        for e in range(row.n_state if pools.run[0].longest_window > 1 else 0):
            pools.moving[row.kept_states + e] = pools.moving[row.state + e]


@kernel
def rewind(pools: Any) -> None:
    """Set the state of every class to that at the start of the window."""
    for c in range(len(pools.classes)):
        row = pools.classes[c]
        for e in range(row.n_state if pools.run[0].longest_window > 1 else 0):
            pools.moving[row.state + e] = pools.moving[row.kept_states + e]
