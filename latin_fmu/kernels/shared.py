"""Parts of the iteration between which the processes of a run exchange what they computed (``latin.processes``).

A process computes the linear stage of its substructures and the local stage of the interfaces that touch them, an
interface between two processes on both. What the other side of such an interface needs goes through ``outbox`` and
``inbox``: the values at the channels of one process that the other takes, neighbour after neighbour. Sums over the
assembly go through ``parts``: one row for each interface, by the process that owns it, added in the order of the scene
(``indicator.add_parts``). Norms of the force residual have a row for each class of each process, and one for each
process with a flag: whether any of its tractions acts.
"""

from __future__ import annotations

from typing import Any, Final

from ..compiled import kernel
from .acceleration import difference_parts
from .energy_parts import OF_DRIFT
from .indicator import accept, cross_of_classes, own_put_in, relative_forces, residual_parts, set_error, take_works
from .instants import CORRECTED, WITHIN, decided, end_instant, first_guess
from .iteration import BROKEN, CONVERGED, STALLED, judge, linear_stage
from .local_stage import open_window
from .newton import ACTIVE, MADE, N_COURSE, POWER, RESIDUAL, advance_iterate, steps_made
from .sparse_response import squared_defect
from .substructure import change_of
from .tasks import END, NORMS, PREDICT, SOLUTION, each_class, each_point

NEEDED, NEWTON, LONG = 16, 32, 64
"""Bits of ``verdict`` beside those of ``judge``: the norms of the force residual have to be exchanged first; the next
iterate is that of a Newton step; the step of the acceleration has still to be shortened (``acceleration.shorten``)."""
NOTHING, FREE, GUESS = 0, 1, 2
"""What ``begin_instant`` left to be exchanged before the first iterate: nothing, free velocities, q."""
FUSED: Final = 2
"""Added to the last argument of ``verdict`` where the linear stage may follow at once."""


@kernel
def pack(pools: Any, at: int, stride: int, n: int) -> None:
    """Put n fields, ``stride`` numbers apart from ``at`` on, into the messages to the neighbours."""
    run, moving = pools.run[0], pools.moving
    places, to = run.send_places, run.outbox
    for s in range(run.n_neighbour):
        first, last = pools.fixed_int[run.send_starts + s], pools.fixed_int[run.send_starts + s + 1]
        for i in range(n):
            for e in range(first, last):
                moving[to] = moving[at + i * stride + pools.fixed_int[places + e]]
                to += 1


@kernel
def unpack(pools: Any, at: int, stride: int, n: int) -> None:
    """Take n fields from the messages of the neighbours."""
    run, moving = pools.run[0], pools.moving
    places, start = run.take_places, run.inbox
    for s in range(run.n_neighbour):
        first, last = pools.fixed_int[run.take_starts + s], pools.fixed_int[run.take_starts + s + 1]
        for i in range(n):
            for e in range(first, last):
                moving[at + i * stride + pools.fixed_int[places + e]] = moving[start]
                start += 1


@kernel
def changes(pools: Any, window: int) -> None:
    """Changes of q of the members of divided classes that are held here."""
    for c in range(len(pools.classes)):
        row = pools.classes[c]
        for i in range(window if row.divided == 1 else 0):
            pools.moving[row.changes + i] = change_of(pools, c, i)


@kernel
def send_stage(pools: Any, window: int, first: int, iteration: int) -> None:
    """Linear stage of the substructures here, and the messages with their W."""
    run = pools.run[0]
    linear_stage(pools, window, first, iteration)
    if run.n_coarse == 0:
        pack(pools, run.w, run.n_flat, window)


@kernel
def local_parts(pools: Any, window: int, iteration: int, phase: int) -> None:
    """Local stage with the W of the neighbours; sums over each interface for indicator and acceleration. ``phase``: the
    iteration from which on the acceleration has its differences."""
    run = pools.run[0]
    unpack(pools, run.w, run.n_flat, window)
    each_point(pools, window)
    residual_parts(pools, window)
    difference_parts(pools, window, steps_made(pools, window, iteration, phase))


@kernel
def own_norms(pools: Any, window: int) -> None:
    """Norms of the force residual of the classes here, whether a traction acts at the end of the window, energy put in
    and work of the drift here."""
    run, work = pools.run[0], pools.moving
    each_class(pools, NORMS, window, 0)
    to = run.own_norms
    for c in range(len(pools.classes)):
        for e in range(4 * window):
            work[to] = work[pools.classes[c].class_norms + e]
            to += 1
    f_hat, acts = work[run.local_f + (window - 1) * run.n_flat : run.local_f + window * run.n_flat], 0.0
    for j in range(run.n_flat):
        if f_hat[j] != 0.0:
            acts = 1.0
            break
    work[to], work[to + 1], work[to + 2] = acts, own_put_in(pools), pools.moving[run.works + OF_DRIFT]
    work[to + 3] = cross_of_classes(pools, window)


@kernel
def forces_of_all(pools: Any, window: int) -> None:
    """Force residual from the norms of all processes."""
    run, work = pools.run[0], pools.moving
    for e in range(4 * window):
        total = 0.0
        for r in range(run.n_norm - run.n_process):
            total += work[run.all_norms + pools.fixed_int[run.norm_order + r] * 4 * window + e]
        work[run.norms + e] = total
    acts, put_in, drift, known, cross = 0.0, 0.0, 0.0, True, 0.0
    for r in range(run.n_norm - run.n_process, run.n_norm):
        at = run.all_norms + pools.fixed_int[run.norm_order + r] * 4 * window
        acts, put_in, drift = max(acts, work[at]), put_in + work[at + 1], drift + work[at + 2]
        known, cross = known and work[at + 1] >= 0.0, cross + work[at + 3]
    work[run.norms + 4 * window] = cross
    work[run.acting] = acts
    take_works(pools, put_in if known else -1.0, drift)
    relative_forces(pools, window)


@kernel
def error_of_all(pools: Any, window: int) -> bool:
    """sqrt(eta) from the ``parts`` of all; whether it is within tolerance: then the norms are to be exchanged."""
    if not set_error(pools, window) <= pools.run[0].tolerance:
        return False
    own_norms(pools, window)
    return True


@kernel
def verdict(pools: Any, instant: int, call: int, iteration: int, how: int) -> int:
    """Verdict on an iterate of a window of one instant; bits of ``judge`` and those of this file. Where it has not
    converged the next one is begun, where it has the instant is ended; with tables of Y its squared defect here goes to
    ``course``, and ``decide`` follows. ``how``: 1 once the norms are exchanged, plus FUSED."""
    run, work = pools.run[0], pools.moving
    if how % FUSED == 1:
        forces_of_all(pools, 1)
    elif error_of_all(pools, 1):
        return NEEDED
    at = call * run.max_iterations + iteration
    work[run.errors + at], work[run.force_residuals + at] = work[run.measure], work[run.measure + 1]
    begin = pools.moving_int[run.iterations + call]
    bits = judge(pools, 1, begin, iteration, run.depth > 0)
    if bits & CONVERGED:
        pools.moving_int[run.iterations + call] = iteration + 1
        pools.moving_int[run.newton_steps + call] = int(work[run.course + MADE])
        if run.sparse == 1:
            each_class(pools, SOLUTION, instant, 0)
            work[run.course + RESIDUAL] = squared_defect(pools)
            work[run.course + POWER] = cross_of_classes(pools, 1)
            return bits
        work[run.defects + call] = 0.0
        accept(pools, 1)
        _end(pools, instant)
    elif bits & (STALLED | BROKEN) == 0 and iteration + 1 < run.max_iterations:
        if advance_iterate(pools, 1, iteration, begin):
            bits |= LONG
        if work[run.course + ACTIVE] == 1.0:
            bits |= NEWTON
        elif how >= FUSED:
            send_stage(pools, 1, instant, iteration + 1 - begin)
    return bits


@kernel
def _end(pools: Any, instant: int) -> None:
    """End an instant that is accepted, and the messages with its displacements and velocities."""
    run, work = pools.run[0], pools.moving
    work[run.touched] = work[run.acting]
    each_class(pools, END, instant, 0)
    pack(pools, run.displacement, run.moved - run.displacement, 2 + run.layers)


@kernel
def decide(pools: Any, instant: int, call: int) -> int:
    """``instants.correct`` with the squared defects of all processes added in ``course``: what it returns. The
    messages hold displacements where the instant is ended, q where it goes on."""
    run, work = pools.run[0], pools.moving
    result = decided(pools, call, work[run.course + RESIDUAL], work[run.course + POWER])
    work[run.course : run.course + N_COURSE] = 0.0
    if result == WITHIN:
        _end(pools, instant)
    elif result == CORRECTED:
        pack(pools, run.q, run.n_flat, 1)
    return result


@kernel
def begin_instant(pools: Any, instant: int, ended: bool, fused: bool) -> int:
    """End the instant before (``ended``), with the displacements of the neighbours; free responses and first guess of
    this one. Returns what has to be exchanged before ``guessed``; where there is nothing, and ``fused``, the linear
    stage follows."""
    if ended:
        take_end(pools, instant - 1, 0)
    each_class(pools, PREDICT, instant, 0)
    open_window(pools, 1, instant - 1)
    needed = first_of(pools, instant)
    if needed == NOTHING and fused:
        send_stage(pools, 1, instant, 0)
    return needed


@kernel
def first_of(pools: Any, instant: int) -> int:
    """First q of an instant, as far as it follows from what is held here; returns what has to be exchanged for it."""
    run, work = pools.run[0], pools.moving
    work[run.course : run.course + N_COURSE] = 0.0
    first_guess(pools, instant)
    if run.static == 1:
        return NOTHING
    if work[run.touched] == 0.0:  # W is that of the free motion
        pack(pools, run.w, run.n_flat, 1)
        return FREE
    if run.from_last == 1:
        pack(pools, run.q, run.n_flat, 1)
        return GUESS
    return NOTHING


@kernel
def guessed(pools: Any, exchanged: int, instant: int, fused: bool) -> None:
    """First q of an instant with what the neighbours sent; ``fused``: and the linear stage."""
    run, work = pools.run[0], pools.moving
    if exchanged == GUESS:
        unpack(pools, run.q, run.n_flat, 1)
    else:
        unpack(pools, run.w, run.n_flat, 1)
        for j in range(run.n_flat):
            work[run.q + j] = pools.fixed[run.k + j] * work[run.w + j]
    if fused:
        send_stage(pools, 1, instant, 0)


@kernel
def take_end(pools: Any, instant: int, i: int) -> None:
    """``end_instant`` with the displacements of the neighbours."""
    run = pools.run[0]
    unpack(pools, run.displacement, run.moved - run.displacement, 2 + run.layers)
    end_instant(pools, instant, i)
