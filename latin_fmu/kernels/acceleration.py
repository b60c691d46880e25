"""Fixed-point iteration on q: relaxation and Anderson acceleration.

LATIN with equal search directions up and down is Peaceman-Rachford splitting; relaxation 1/2 makes it Douglas-Rachford,
the safe fall-back. Anderson acceleration of depth m (Walker and Ni 2011, type II) replaces q + r by

    q + r - (DQ + DR) gamma,   gamma = argmin || r - DR gamma ||

with the last m differences DQ, DR of iterates and residuals, in the norm sum area / k q^2 (a power).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import entry, kernel

Array = NDArray[np.float64]

RANK = 1e-12
"""Pivot below which a difference is left out."""


@kernel
def least_squares(gram: Array, depth: int, right: Array, n: int, scratch: Array, x: Array) -> None:
    """x (n,) = solution of gram[:n, :n] x = right by a Cholesky factor of unit diagonal; x is 0 for directions whose
    pivot is below RANK, as they depend on those before. gram (depth, depth), scratch ((depth + 1) depth,)."""
    factor, size = scratch[: depth * depth], scratch[depth * depth : depth * (depth + 1)]
    for a in range(n):
        size[a] = np.sqrt(max(gram[a * depth + a], 1e-300))
        x[a] = 0.0
    for a in range(n):
        for b in range(a + 1):
            total = gram[a * depth + b] / (size[a] * size[b])
            for e in range(b):
                total -= factor[a * depth + e] * factor[b * depth + e]
            if b < a:
                factor[a * depth + b] = total / factor[b * depth + b] if factor[b * depth + b] > 0.0 else 0.0
            else:
                factor[a * depth + a] = np.sqrt(total) if total > RANK else 0.0
    for a in range(n):
        if factor[a * depth + a] > 0.0:
            total = right[a] / size[a]
            for e in range(a):
                total -= factor[a * depth + e] * x[e]
            x[a] = total / factor[a * depth + a]
    for a in range(n - 1, -1, -1):
        if factor[a * depth + a] > 0.0:
            total = x[a]
            for e in range(a + 1, n):
                total -= factor[e * depth + a] * x[e]
            x[a] = total / factor[a * depth + a]
    for a in range(n):
        x[a] /= size[a]


@entry("f8[::1], f8[::1], i8, f8, f8, f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], i8")
def anderson(
    q: Array,
    residual: Array,
    depth: int,
    relaxation: float,
    longest: float,
    metric: Array,
    last_q: Array,
    last_r: Array,
    dq: Array,
    dr: Array,
    gram: Array,
    least: Array,
    count: int,
) -> None:
    """q (n,) := next iterate, with ``count`` steps made since the start; a negative count relaxes.

    metric : (n_flat,) squared weights of the norm, the same at each instant. dq, dr : (depth, n) ring of differences,
    gram : (depth, depth) their weighted products, least : ((depth + 3) depth,) scratch. longest : longest step, in
    lengths of the residual. A body that slides back to where it sticks has the same residual iteration after iteration;
    with differences of residuals close to zero the step would have any length.
    """
    n, n_flat = len(q), len(metric)
    if depth == 0 or count <= 0:
        for j in range(n):
            last_q[j], last_r[j] = q[j], residual[j]
            q[j] += relaxation * residual[j]
        return
    row, kept = (count - 1) % depth, min(count, depth)
    own_q, own_r = dq[row * n : (row + 1) * n], dr[row * n : (row + 1) * n]
    for j in range(n):
        own_q[j] = q[j] - last_q[j]
        own_r[j] = residual[j] - last_r[j]
        last_q[j], last_r[j] = q[j], residual[j]
    right, gamma = least[:depth], least[depth : 2 * depth]
    for a in range(kept):
        product, projection = 0.0, 0.0
        for start in range(0, n, n_flat):
            old, new = dr[a * n + start : a * n + start + n_flat], own_r[start : start + n_flat]
            rest = residual[start : start + n_flat]
            for j in range(n_flat):
                weighted = metric[j] * old[j]
                product += weighted * new[j]
                projection += weighted * rest[j]
        gram[row * depth + a] = product
        gram[a * depth + row] = product
        right[a] = projection
    least_squares(gram, depth, right, kept, least[2 * depth :], gamma)
    for j in range(n):
        q[j] += relaxation * residual[j]
    for a in range(kept):
        if gamma[a] != 0.0:
            past_q, past_r = dq[a * n : (a + 1) * n], dr[a * n : (a + 1) * n]
            for j in range(n):
                q[j] -= gamma[a] * (past_q[j] + relaxation * past_r[j])
    if longest < np.inf:
        _shorten(q, residual, longest, metric, last_q)


@kernel
def _shorten(q: Array, residual: Array, longest: float, metric: Array, last_q: Array) -> None:
    """Shorten the step q - last_q to ``longest`` lengths of the residual."""
    step, allowed = 0.0, 0.0
    for start in range(0, len(q), len(metric)):
        for j in range(len(metric)):
            moved = q[start + j] - last_q[start + j]
            step += metric[j] * moved * moved
            allowed += metric[j] * residual[start + j] * residual[start + j]
    factor = longest * np.sqrt(allowed) / max(np.sqrt(step), 1e-300)
    if factor < 1.0:
        for j in range(len(q)):
            q[j] = last_q[j] + factor * (q[j] - last_q[j])


@kernel
def next_iterate(pools: Any, window: int, count: int) -> None:
    """Next q of the window after ``count`` steps; see ``anderson``."""
    run, work = pools.run[0], pools.moving
    n = window * run.n_flat
    anderson(
        work[run.q : run.q + n],
        work[run.r : run.r + n],
        run.depth,
        run.relaxation,
        run.longest_step,
        pools.fixed[run.metric : run.metric + run.n_flat],
        work[run.last_q : run.last_q + n],
        work[run.last_r : run.last_r + n],
        work[run.dq : run.dq + run.depth * n],
        work[run.dr : run.dr + run.depth * n],
        work[run.gram : run.gram + run.depth * run.depth],
        work[run.least : run.least + (run.depth + 3) * run.depth],
        count,
    )


class Anderson:
    """Anderson acceleration of an iteration outside a run.

    Parameters
    ----------
    metric : (n,) squared weights of the norm. depth : differences kept. relaxation : factor on the residual.
    """

    def __init__(self, metric: Array, depth: int, relaxation: float) -> None:
        n = len(metric)
        self._metric, self._depth, self._relaxation, self._count = metric, depth, relaxation, 0
        self._arrays = [np.zeros(size) for size in (n, n, depth * n, depth * n, depth * depth, (depth + 3) * depth)]

    def next(self, q: Array, residual: Array) -> Array:
        """Next iterate (n,) from q and its residual."""
        out = np.array(q, dtype=float)
        last_q, last_r, dq, dr, gram, least = self._arrays
        anderson(
            out,
            np.ascontiguousarray(residual, dtype=float),
            self._depth,
            self._relaxation,
            np.inf,
            self._metric,
            last_q,
            last_r,
            dq,
            dr,
            gram,
            least,
            self._count,
        )
        self._count += 1
        return out
