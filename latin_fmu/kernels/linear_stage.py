"""Linear stage (8)-(14) over a window: W of the substructures for given q, and the balance of the coarse problem.

One instant is condensed on the interfaces: W = W_0 + Y q. Several instants are marched in every iteration.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from .callouts import CHANGES, COARSE, call_out
from .local_stage import outgoing
from .matrices import add_matrix
from .substructure import change_of
from .sums import exchange
from .tasks import CHANGE, RESPONSE, WINDOW, each_class

Array = NDArray[np.float64]


@kernel
def linear_stage(pools: Any, window: int, first: int, iteration: int) -> None:
    """W of the linear stage over the window that starts with instant ``first``, for the q of ``work``."""
    run, work = pools.run[0], pools.moving
    # every process has to decide alike whether a divided class is solved again: by the change at all its members
    if run.shared == 1 and run.reuse >= 0.0 and iteration > 0:
        changes(pools, window)
    if window == 1:
        # not in the first iteration: the last solution is that of another instant then
        each_class(pools, RESPONSE, 1 if iteration > 0 and run.reuse >= 0.0 else 0, 0)
    else:
        each_class(pools, WINDOW, window, first)
    for c in range(len(pools.classes)):
        # substructure-instants marched, or solved through Y
        work[run.counts + (1 if window == 1 else 0)] += work[pools.classes[c].solved]
    for i in range(window):
        # channels of ground belong to no class
        w = work[run.w + i * run.n_flat : run.w + (i + 1) * run.n_flat]
        at = run.ground_velocity + (first + i) * run.n_ground
        for e in range(run.n_ground):
            w[pools.fixed_int[run.ground + e]] = pools.moving[at + e]
    complete(pools, window)


@kernel
def respond_to_change(pools: Any, x: Array) -> None:
    """Change of the fields of the linear stage of one instant for a change x (N,) of q, in the place of these fields:
    W = Y area x, balanced and exchanged as they are, and F and s from it."""
    run, work = pools.run[0], pools.moving
    q, w = work[run.q : run.q + run.n_flat], work[run.w : run.w + run.n_flat]
    for j in range(run.n_flat):
        # channels of ground keep 0: their motion does not change
        q[j], w[j] = x[j], 0.0
    each_class(pools, CHANGE, 0, 0)
    for c in range(len(pools.classes)):
        work[run.counts + 1] += pools.classes[c].m  # solved through Y
    complete(pools, 1)
    for g in range(len(pools.groups)):
        outgoing(pools, g, 0, 0, pools.groups[g].n_point)


@kernel
def complete(pools: Any, window: int) -> None:
    """Balance W by the coarse problem, and take it over at the channels of other processes."""
    run = pools.run[0]
    if run.n_coarse > 0:
        coarse_parts(pools)
        if run.shared == 1:
            call_out(pools, COARSE, 0, 0, 0)
        balance(pools)
    exchange(pools, run.w, run.n_flat, window)


@kernel
def changes(pools: Any, window: int) -> None:
    """Changes of q of the divided classes, of which every process holds some members."""
    for c in range(len(pools.classes)):
        row = pools.classes[c]
        for i in range(window if row.divided == 1 else 0):
            pools.moving[row.changes + i] = change_of(pools, c, i)
    call_out(pools, CHANGES, window, 0, 0)


@kernel
def coarse_parts(pools: Any) -> None:
    """Sums of the forces of the linear stage on the sides of the interfaces, into ``coarse_own``: those of the
    substructures here."""
    run, work = pools.run[0], pools.moving
    n, size = run.n_flat, run.n_coarse_own
    q = work[run.q : run.q + n]
    w = work[run.w : run.w + n]
    k = pools.fixed[run.k : run.k + n]
    rest = work[run.s : run.s + n]  # written by ``outgoing`` after this
    for j in range(n):
        rest[j] = q[j] - k[j] * w[j]
    parts = work[run.coarse_own : run.coarse_own + size]
    parts[:] = 0.0
    add_matrix(
        pools, size, run.coarse_balance_starts, run.coarse_balance_columns, run.coarse_balance_values, 1, rest, parts
    )


@kernel
def balance(pools: Any) -> None:
    """Bring q and the W of the substructures to balance in the mean of every interface, from the ``coarse_parts`` of
    both sides of all of them."""
    run = pools.run[0]
    work = pools.moving
    direction = pools.fixed
    n = run.n_flat
    size = run.n_coarse
    n_here = run.n_coarse_here
    q, w = work[run.q : run.q + n], work[run.w : run.w + n]
    total, motion = work[run.coarse : run.coarse + size], work[run.coarse + size : run.coarse + size + n_here]
    # F + F' over each interface, which is 0 in balance
    for i in range(size):
        first, second = pools.fixed_int[run.coarse_order + i], pools.fixed_int[run.coarse_order + size + i]
        total[i] = work[run.coarse_parts + first] + work[run.coarse_parts + second]
    for i in range(n_here):
        line = direction[run.coarse_inverse + i * size : run.coarse_inverse + (i + 1) * size]
        now = 0.0
        for j in range(size):
            now -= line[j] * total[j]  # against what is out of balance
        motion[i] = now
    add_matrix(
        pools, n, run.coarse_incoming_starts, run.coarse_incoming_columns, run.coarse_incoming_values, 1, motion, q
    )
    add_matrix(pools, n, run.coarse_answer_starts, run.coarse_answer_columns, run.coarse_answer_values, 1, motion, w)
