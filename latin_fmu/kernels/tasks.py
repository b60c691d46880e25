"""Tasks of a march that threads share (``team``): the classes, and the points of the interfaces.

Classes of substructures are independent of each other between two local stages. A class that is large against the
others is not one task: the first thread takes its steps, and the threads share its pieces (``splits``).

Over several instants the march of a class is repeated for every iterate (``march_window``). Where q of the class has
changed negligibly up to some instant (criterion of ``interface_response``), its solution up to there is kept, and the
march starts from the last kept state before. States are kept every isqrt(window) + 1 instants.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from .energy import account
from .indicator import class_norms
from .local_stage import points_stage
from .matrices import probe, read_channels
from .splits import leaf
from .substructure import (
    add_change,
    change_of,
    commit,
    interface_response,
    linear_response,
    predict,
    solve_under_tractions,
)
from .team import ARGUMENTS, LINE, claimed, close_region, end_task, next_ticket, open_region

Array = NDArray[np.float64]

PREDICT, RESPONSE, CHANGE, WINDOW, NORMS, SOLUTION, END, END_OF_WINDOW, POINTS = range(9)
"""Actions of ``task``."""
CHUNK = 64
"""Points of an interface in a task."""


@kernel
def task(pools: Any, action: int, t: int, a: int, b: int) -> None:
    """Task t of an action: of the class t, or of the t-th chunk of points."""
    if action == PREDICT:
        predict(pools, t, a)
    elif action == RESPONSE:
        pools.moving[pools.classes[t].solved] = interface_response(pools, t, 0, a == 1)
    elif action == CHANGE:
        add_change(pools, t)
    elif action == WINDOW:
        pools.moving[pools.classes[t].solved] = march_window(pools, t, a, b)
    elif action == NORMS:
        class_norms(pools, t, a)
    elif action == SOLUTION:
        if pools.classes[t].sparse == 1:
            solve_under_tractions(pools, t, a)
    elif action == END:
        end_class(pools, t, a)
    elif action == END_OF_WINDOW:
        end_class_of_window(pools, t, a, b)
    elif action == POINTS:
        _chunk_stage(pools, t, a)


@kernel
def each_class(pools: Any, action: int, a: int, b: int) -> None:
    """Do the tasks of an action on all classes."""
    run, n = pools.run[0], len(pools.classes)
    if run.threads <= 1 or run.n_alone == 0:
        for c in range(n):
            task(pools, action, c, a, b)
        return
    # the threads share the pieces of a large class: one after the other, before the classes that have a thread each
    for c in range(n):
        if pools.classes[c].split == 1:
            task(pools, action, c, a, b)
    ticket = open_region(pools, run.n_alone, action, 0, a, b, 0, 0.0)
    _work(pools, ticket, 0)
    close_region(pools)


@kernel
def each_point(pools: Any, window: int) -> None:
    """Local stage over the window at all points."""
    count, alone = 0, pools.run[0].threads <= 1
    for g in range(len(pools.groups)):
        count += chunks(pools.groups[g].n_point)
        alone = alone or pools.groups[g].law < 0  # laws in Python take all points of a group, on one thread
    if alone or count <= 1:
        for g in range(len(pools.groups)):
            points_stage(pools, g, window, 0, pools.groups[g].n_point)
        return
    ticket = open_region(pools, count, POINTS, 0, window, 0, 0, 0.0)
    _work(pools, ticket, 0)
    close_region(pools)


@kernel
def chunks(n_point: int) -> int:
    """Chunks of so many points."""
    return (n_point + CHUNK - 1) // CHUNK


@kernel
def _chunk_stage(pools: Any, t: int, window: int) -> None:
    """Local stage of the t-th chunk of points."""
    first = 0
    for g in range(len(pools.groups)):
        n_point = pools.groups[g].n_point
        count = chunks(n_point)
        if first <= t < first + count:
            low = (t - first) * CHUNK
            points_stage(pools, g, window, low, min(low + CHUNK, n_point))
        first += count


@kernel
def _work(pools: Any, ticket: int, thread: int) -> None:
    """Do tasks of a region until none is left."""
    numbers = pools.moving_int
    at = pools.run[0].team + ARGUMENTS + LINE * (ticket % 2)
    n = numbers[at]
    action = numbers[at + 1]
    c = numbers[at + 2]
    a = numbers[at + 3]
    b = numbers[at + 4]
    d = numbers[at + 5]
    factor = pools.moving[at + 6]
    # each thread begins at its own part of the tasks, the same in every region
    home = n * thread // pools.run[0].threads
    order = pools.run[0].order
    k = claimed(pools, ticket, n, home, 0)
    while k < n:
        t = (home + k) % n
        if action < POINTS:
            task(pools, action, numbers[order + t], a, b)
        elif action == POINTS:
            task(pools, action, t, a, b)
        else:
            leaf(pools, action, t, c, a, b, d, factor)
        end_task(pools)
        k = claimed(pools, ticket, n, home, k + 1)


@kernel
def serve(pools: Any, thread: int) -> None:
    """Do tasks with the number ``thread`` of the run until the threads are dismissed."""
    ticket = next_ticket(pools, 0)
    while ticket > 0:
        _work(pools, ticket, thread)
        ticket = next_ticket(pools, ticket)


@kernel
def end_class(pools: Any, c: int, instant: int) -> None:
    """End an instant solved as a window of its own for one class: motion, energies, probed velocities, displacements of
    its channels. The tractions of the local stage act, so that action equals reaction to round-off; a class without
    inertia takes the incoming quantity q, which determines the position of a floating body."""
    run = pools.run[0]
    work = pools.moving
    row = pools.classes[c]
    flat = work[run.local_f : run.local_f + run.n_flat]
    incoming = work[run.q : run.q + run.n_flat] if run.static == 1 else flat  # position of a floating body
    marched = commit(pools, c, instant, incoming)
    work[row.marched] += marched
    acting = work[run.f : run.f + run.n_flat] if run.static == 1 else flat  # work of the tractions, not of k W
    after_class(pools, c, instant, acting, marched > 0)


@kernel
def after_class(pools: Any, c: int, instant: int, tractions: Array, marched: bool) -> None:
    """Energies, probed velocities, and displacements and velocities of the channels of a class at the end of an instant
    with tractions (N,)."""
    run, work = pools.run[0], pools.moving
    account(pools, c, instant, tractions, marched)
    probe(pools, c, instant)
    displacement, row = work[run.displacement : run.displacement + run.n_flat], pools.classes[c]
    # springs that relax follow all components
    read_channels(pools, c, instant, 1.0, run.gap_offset, 0.0, run.relaxing == 0, displacement)
    # ``w_free`` holds the velocities at the end of the instant now (``advance``)
    for at in range(row.n_channel * row.m):
        work[run.moved + pools.fixed_int[row.channels + at]] = work[row.w_free + at]
    if run.layers == 1:
        layer = work[run.layer : run.layer + run.n_flat]
        read_channels(pools, c, instant, 1.0, run.gap_offset + run.layer_v, run.layer_a, False, layer)


@kernel
def end_class_of_window(pools: Any, c: int, instant: int, i: int) -> None:
    """March a class over instant i of a window with the accepted q; energies and probes. The tractions of the linear
    stage act: their dashpots k keep the two sides of an interface together."""
    run = pools.run[0]
    work = pools.moving
    row = pools.classes[c]
    n = run.n_flat
    q, w = work[run.q + i * n : run.q + (i + 1) * n], work[run.w + i * n : run.w + (i + 1) * n]
    f = work[run.f + i * n : run.f + (i + 1) * n]
    predict(pools, c, instant)
    linear_response(pools, c, q, w)
    for e in range(row.n_channel * row.m):
        at = pools.fixed_int[row.channels + e]
        f[at] = q[at] - pools.fixed[run.k + at] * w[at]
    marched = commit(pools, c, instant, f)
    work[row.marched] += marched
    after_class(pools, c, instant, f, marched > 0)


@kernel
def stride_of(window: int) -> int:
    """Instants between kept states, isqrt(window) + 1."""
    stride = 1
    while stride * stride <= window:
        stride += 1
    return stride


@kernel
def first_changed(pools: Any, c: int, window: int) -> int:
    """First instant of the window whose q requires a new solution of the class; ``window`` where none does."""
    row = pools.classes[c]
    run = pools.run[0]
    work = pools.moving
    if work[row.known] == 0.0 or run.reuse < 0.0:
        return 0
    change = 0.0
    # the best iterate counts, too: in the first window no scale has been accepted yet
    level = run.reuse * max(pools.moving[run.scales], work[run.measure + 6]) * window / run.n_class
    for i in range(window):
        change += work[row.changes + i] if row.divided == 1 else change_of(pools, c, i)
        if change > level:
            return i
    return window


@kernel
def march_window(pools: Any, c: int, window: int, first: int) -> int:
    """W of the class for the q of the window, from the first instant on whose q has changed; substructure-instants
    marched."""
    row = pools.classes[c]
    run = pools.run[0]
    work = pools.moving
    n = run.n_flat
    size = row.n_channel * row.m
    stride = stride_of(window)
    channels = pools.fixed_int[row.channels : row.channels + size]
    changed, marched = first_changed(pools, c, window), 0
    # not marched: W of the last iterate holds
    for i in range(changed):
        for at in range(size):
            work[run.w + i * n + channels[at]] = work[row.solved_w + i * size + at]
    if changed == window:
        return 0
    # back to the last state kept before the change
    begin = changed // stride
    for e in range(row.n_state):
        pools.moving[row.state + e] = work[row.kept_states + begin * row.n_state + e]
    for i in range(begin * stride, window):
        if i % stride == 0 and i > 0:
            store = row.kept_states + (i // stride) * row.n_state
            for e in range(row.n_state):
                work[store + e] = pools.moving[row.state + e]
        q, f = work[run.q + i * n : run.q + (i + 1) * n], work[run.f + i * n : run.f + (i + 1) * n]
        w = work[run.w + i * n : run.w + (i + 1) * n]
        predict(pools, c, first + i)
        linear_response(pools, c, q, w)
        for at in range(size):
            f[channels[at]] = q[channels[at]] - pools.fixed[run.k + channels[at]] * w[channels[at]]
        marched += commit(pools, c, first + i, f)
        for at in range(size):
            # instants before the change are passed through for the state alone: their W stays, to the bit
            if i < changed:
                w[channels[at]] = work[row.solved_w + i * size + at]
            else:
                work[row.solved_q + i * size + at] = q[channels[at]]
                work[row.solved_w + i * size + at] = w[channels[at]]
    work[row.known] = 1.0
    return marched
