"""End of a window of several instants, and t = 0."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from .energy import open_account
from .instants import after_class, keep_fields
from .local_stage import read_gaps
from .matrices import probe, read_channels
from .substructure import commit, linear_response, predict

Array = NDArray[np.float64]


@kernel
def end_window_instant(pools: Any, instant: int, i: int) -> None:
    """March every class over instant i of a window with the accepted q, and read gaps, energies and probes. The
    tractions of the linear stage act: their dashpots k keep the two sides of an interface together."""
    run, work = pools.run[0], pools.moving
    n = run.n_flat
    q, w = work[run.q + i * n : run.q + (i + 1) * n], work[run.w + i * n : run.w + (i + 1) * n]
    f = work[run.f + i * n : run.f + (i + 1) * n]
    for c in range(len(pools.classes)):
        row = pools.classes[c]
        predict(pools, c, instant)
        linear_response(pools, c, q, w)
        for e in range(row.n_channel * row.m):
            at = pools.fixed_int[row.channels + e]
            f[at] = q[at] - pools.fixed[run.k + at] * w[at]
        marched = commit(pools, c, instant, f)
        work[row.marched] += marched
        after_class(pools, c, instant, f, marched > 0)
    keep_fields(pools, instant, i)
    read_gaps(pools, instant)


@kernel
def read_start(pools: Any) -> None:
    """Gaps, probed velocities and energies at instant 0 of the segment; tractions and velocities are in the state."""
    run, work, state, output = pools.run[0], pools.moving, pools.moving, pools.moving
    n = run.n_flat
    for c in range(len(pools.classes)):
        probe(pools, c, 0)
        displacement, layer = work[run.displacement : run.displacement + n], work[run.layer : run.layer + n]
        read_channels(pools, c, 0, 1.0, run.gap_lead, 0.0, True, displacement)
        if run.layers == 1:
            read_channels(pools, c, 0, 1.0, run.gap_lead + run.layer_v, run.layer_a, False, layer)
        for j in range(6 * pools.classes[c].m * pools.classes[c].accounted):
            output[pools.classes[c].energies + j] = state[pools.classes[c].totals + j]
    for j in range(n):
        output[run.history_f + j], output[run.history_w + j] = state[run.f_hat + j], state[run.w_hat + j]
    read_gaps(pools, 0)


@kernel
def open_accounts(pools: Any) -> None:
    """Begin the account of energies of every class at instant 0, with the tractions of the state."""
    run = pools.run[0]
    tractions = pools.moving[run.f_hat : run.f_hat + run.n_flat]
    for c in range(len(pools.classes)):
        open_account(pools, c, 0, tractions)
