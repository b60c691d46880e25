"""Linear stage over a window of several instants: the march of one class, repeated for every iterate.

Where q of a class has changed negligibly up to some instant (criterion of ``substructure.respond``), its solution up
to there is kept: the march starts from the last kept state before. States are kept every isqrt(window) + 1 instants.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from .substructure import commit, linear_response, predict

Array = NDArray[np.float64]


@kernel
def begin_window(pools: Any) -> None:
    """Keep the present states as those at the start of a window; no solution is known in it."""
    for c in range(len(pools.classes)):
        row = pools.classes[c]
        pools.moving[row.known] = 0.0
        for e in range(row.n_state):
            pools.moving[row.kept_states + e] = pools.moving[row.state + e]


@kernel
def rewind(pools: Any) -> None:
    """Bring every class back to the start of the window."""
    for c in range(len(pools.classes)):
        row = pools.classes[c]
        for e in range(row.n_state):
            pools.moving[row.state + e] = pools.moving[row.kept_states + e]


@kernel
def stride_of(window: int) -> int:
    """Instants between kept states."""
    stride = 1
    while stride * stride <= window:
        stride += 1
    return stride


@kernel
def first_changed(pools: Any, c: int, window: int) -> int:
    """First instant of the window whose q requires a new solution of the class; ``window`` where none does."""
    row, run, work = pools.classes[c], pools.run[0], pools.moving
    if work[row.known] == 0.0 or run.reuse < 0.0:
        return 0
    size, change = row.n_channel * row.m, 0.0
    channels = pools.fixed_int[row.channels : row.channels + size]
    weights = pools.fixed[run.weights : run.weights + run.n_flat]
    level = run.reuse * max(pools.moving[run.scales], work[run.measure + 6]) * window / len(pools.classes)
    for i in range(window):
        q, seen = work[run.q + i * run.n_flat : run.q + (i + 1) * run.n_flat], row.seen + i * size
        for at in range(size):
            moved = q[channels[at]] - work[seen + at]
            change += weights[channels[at]] * moved * moved
        if change > level:
            return i
    return window


@kernel
def sweep(pools: Any, c: int, window: int, first: int) -> int:
    """W of the class for the q of the window, from the first instant on whose q has changed; substructure-instants
    marched."""
    row, run, work = pools.classes[c], pools.run[0], pools.moving
    n, size, stride = run.n_flat, row.n_channel * row.m, stride_of(window)
    channels = pools.fixed_int[row.channels : row.channels + size]
    changed, marched = first_changed(pools, c, window), 0
    for i in range(changed):
        for at in range(size):
            work[run.w + i * n + channels[at]] = work[row.answered + i * size + at]
    if changed == window:
        return 0
    begin = changed // stride
    for e in range(row.n_state):
        pools.moving[row.state + e] = work[row.kept_states + begin * row.n_state + e]
    for i in range(begin * stride, window):
        if i % stride == 0 and i > 0:
            kept = row.kept_states + (i // stride) * row.n_state
            for e in range(row.n_state):
                work[kept + e] = pools.moving[row.state + e]
        q, f = work[run.q + i * n : run.q + (i + 1) * n], work[run.f + i * n : run.f + (i + 1) * n]
        w = work[run.w + i * n : run.w + (i + 1) * n]
        predict(pools, c, first + i)
        linear_response(pools, c, q, w)
        for at in range(size):
            f[channels[at]] = q[channels[at]] - pools.fixed[run.k + channels[at]] * w[channels[at]]
        marched += commit(pools, c, first + i, f)
        for at in range(size):
            if i < changed:
                w[channels[at]] = work[row.answered + i * size + at]
            else:
                work[row.seen + i * size + at] = q[channels[at]]
                work[row.answered + i * size + at] = w[channels[at]]
    work[row.known] = 1.0
    return marched
