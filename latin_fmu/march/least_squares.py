"""The small least-squares problem of Anderson acceleration, by the Cholesky factor of its Gram matrix."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..compiled import compiled

Array = NDArray[np.float64]


def least_squares_numpy(gram: Array, right: Array, n: int, rank: float) -> Array:
    """Solution (n,) of gram[:n, :n] x = right by Cholesky with unit diagonal; dependent directions get 0."""
    size = np.sqrt(np.maximum(np.diag(gram)[:n], 1e-300))
    scaled, used = gram[:n, :n] / np.outer(size, size), np.zeros(0, dtype=np.int64)
    factor = np.zeros((0, 0))
    for a in range(n):
        line = np.linalg.solve(factor, scaled[used, a])
        pivot = scaled[a, a] - line @ line
        if pivot > rank:
            factor = np.block(
                [[factor, np.zeros((len(used), 1))], [line[None], np.array([[np.sqrt(pivot)]])]]
            )
            used = np.append(used, a)
    x = np.zeros(n)
    x[used] = np.linalg.solve(factor.T, np.linalg.solve(factor, right[used] / size[used])) / size[used]
    return x


@compiled(least_squares_numpy)
def least_squares(gram: Array, right: Array, n: int, rank: float) -> Array:
    """See ``least_squares_numpy``."""
    size, factor, x = np.empty(n), np.zeros((n, n)), np.zeros(n)
    for a in range(n):
        size[a] = np.sqrt(max(gram[a, a], 1e-300))
    for a in range(n):
        for b in range(a + 1):
            total = gram[a, b] / (size[a] * size[b])
            for e in range(b):
                total -= factor[a, e] * factor[b, e]
            if b < a:
                factor[a, b] = total / factor[b, b] if factor[b, b] > 0.0 else 0.0
            elif total > rank:
                factor[a, a] = np.sqrt(total)
    for a in range(n):
        if factor[a, a] > 0.0:
            total = right[a] / size[a]
            for e in range(a):
                total -= factor[a, e] * x[e]
            x[a] = total / factor[a, a]
    for a in range(n - 1, -1, -1):
        if factor[a, a] > 0.0:
            total = x[a]
            for e in range(a + 1, n):
                total -= factor[e, a] * x[e]
            x[a] = total / factor[a, a]
    for a in range(n):
        x[a] /= size[a]
    return x
