"""Products with dense symmetric matrices in patches (``propagator.patches``)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from .products import packed_product, two_norms

Array = NDArray[np.float64]


@kernel
def project(size: int, rank: int, basis: Any, x: Array, out: Array) -> None:
    """out (rank,) = U x for U (rank, size)."""
    for k in range(rank):
        line, total = basis[k * size : (k + 1) * size], 0.0
        for j in range(size):
            total += line[j] * x[j]
        out[k] = total


@kernel
def patched_product(header: Any, numbers: Any, x: Array, out: Array, scratch: Array) -> None:
    """out (n,) = A x; ``header`` and ``numbers`` as ``Patches`` has them, scratch (4 n,)."""
    count, n, rank = header[0], header[1], header[2]
    first, ranks = header[3 : 4 + count], header[4 + count : 4 + 2 * count]
    order = header[4 + 2 * count : 4 + 2 * count + n]
    placed, answer = scratch[:n], scratch[n : 2 * n]
    shares, between = scratch[2 * n : 2 * n + rank], scratch[3 * n : 3 * n + rank]
    for i in range(n):
        placed[i] = x[order[i]]
    at, r = 0, 0
    for p in range(count):
        size, own = first[p + 1] - first[p], placed[first[p] : first[p + 1]]
        packed_product(size, numbers[at:], own, answer[first[p] : first[p + 1]])
        at += size * (size + 1) // 2
        project(size, ranks[p], numbers[at:], own, shares[r:])
        at += ranks[p] * size
        r += ranks[p]
    packed_product(rank, numbers[at:], shares, between)
    at, r = 0, 0
    for p in range(count):
        size, into = first[p + 1] - first[p], answer[first[p] : first[p + 1]]
        at += size * (size + 1) // 2
        for k in range(ranks[p]):
            line, share = numbers[at + k * size : at + (k + 1) * size], between[r + k]
            for j in range(size):
                into[j] += share * line[j]
        at += ranks[p] * size
        r += ranks[p]
    for i in range(n):
        out[order[i]] = answer[i]


@kernel
def patched_norms(header: Any, numbers: Any, x: Array, scratch: Array) -> tuple[float, float, float]:
    """x A x of the two rows x_0, x_1 of x (2, n), and x_1 A x_0; scratch (4 n,)."""
    count, n, rank = header[0], header[1], header[2]
    first, ranks = header[3 : 4 + count], header[4 + count : 4 + 2 * count]
    order = header[4 + 2 * count : 4 + 2 * count + n]
    placed, shares = scratch[: 2 * n], scratch[2 * n : 2 * n + 2 * rank]
    one, two, both, at, r = 0.0, 0.0, 0.0, 0, 0
    for p in range(count):
        low, size = first[p], first[p + 1] - first[p]
        pair = placed[2 * low : 2 * low + 2 * size]
        for i in range(size):
            pair[i], pair[size + i] = x[order[low + i]], x[n + order[low + i]]
        within = two_norms(size, numbers[at:], pair)
        one, two, both = one + within[0], two + within[1], both + within[2]
        at += size * (size + 1) // 2
        for side in range(2):
            project(size, ranks[p], numbers[at:], pair[side * size : (side + 1) * size], shares[side * rank + r :])
        at += ranks[p] * size
        r += ranks[p]
    across = two_norms(rank, numbers[at:], shares)
    return one + across[0], two + across[1], both + across[2]
