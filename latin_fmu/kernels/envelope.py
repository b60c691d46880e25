"""LU factors of a matrix of dense blocks within an envelope.

Rows and columns are cut into blocks; the blocks that block row b is coupled with lie from ``low[b]`` to ``high[b]``
(in a chain of interfaces the neighbours: block tridiagonal). low and high do not decrease, so that the factors fit into
the same envelope. Rows are exchanged within a block only. A row holds all its columns of the envelope one after the
other; entry (i, j) is ``a[row_at[i] + j]``.

Columns are eliminated eight at a time: their part of the rows that follow is one sum of eight products per entry,
taken over tiles of the eight pivot rows that stay in the cache.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel

Array = NDArray[np.float64]

PANEL, TILE = 8, 64
"""Columns eliminated together, and columns of a tile; a tile has PANEL x TILE numbers."""


@kernel
def place_rows(n_block: int, start: Any, low: Any, high: Any, row_at: Any) -> int:
    """Fill ``row_at`` for blocks of rows that begin at ``start`` (n_block + 1,); numbers of the matrix."""
    at = 0
    for b in range(n_block):
        first, width = start[low[b]], start[high[b] + 1] - start[low[b]]
        for i in range(start[b], start[b + 1]):
            row_at[i] = at - first  # so that a column of the whole matrix is an index
            at += width
    return at


@kernel
def _eliminate_panel(
    b: int, k0: int, k1: int, start: Any, low: Any, high: Any, row_at: Any, a: Array, pivots: Any, pivot_range: Array
) -> bool:
    """Factors of the columns k0 ... k1 of block b, in all rows below; False where a pivot is zero."""
    last = start[b + 1]
    begin = start[low[b]]
    end = start[high[b] + 1]
    for k in range(k0, k1):
        picked, largest = k, abs(a[row_at[k] + k])
        for i in range(k + 1, last):
            now = abs(a[row_at[i] + k])
            if now > largest:
                picked, largest = i, now
        pivots[k] = picked
        if not largest > 0.0:  # NaN, too
            return False
        pivot_range[0], pivot_range[1] = min(pivot_range[0], largest), max(pivot_range[1], largest)
        # from ``begin`` on: factors of the columns before are exchanged with the row
        line = a[row_at[k] + begin : row_at[k] + end]
        if picked != k:
            other = a[row_at[picked] + begin : row_at[picked] + end]
            for j in range(end - begin):
                entry = line[j]
                line[j] = other[j]
                other[j] = entry
        inverse = 1.0 / a[row_at[k] + k]
        for c in range(b, high[b] + 1):
            if low[c] > b:  # its rows begin behind this block
                continue
            for i in range(max(k + 1, start[c]), start[c + 1]):
                factor = a[row_at[i] + k] * inverse
                a[row_at[i] + k] = factor
                for j in range(k + 1, k1):
                    a[row_at[i] + j] -= factor * a[row_at[k] + j]
    # the rows of the panel itself: their rest by the unit triangle of its columns
    for k in range(k0 + 1, k1):
        row = a[row_at[k] + k1 : row_at[k] + end]
        for e in range(k0, k):
            factor, above = a[row_at[k] + e], a[row_at[e] + k1 : row_at[e] + end]
            for j in range(end - k1):
                row[j] -= factor * above[j]
    return True


@kernel
def _subtract(factors: Array, tile: Array, row: Array) -> None:
    """row (at most TILE,) -= factors (PANEL,) times tile (PANEL, TILE)."""
    f0 = factors[0]
    f1 = factors[1]
    f2 = factors[2]
    f3 = factors[3]
    f4 = factors[4]
    f5 = factors[5]
    f6 = factors[6]
    f7 = factors[7]
    for j in range(len(row)):
        row[j] -= (
            f0 * tile[j]
            + f1 * tile[TILE + j]
            + f2 * tile[2 * TILE + j]
            + f3 * tile[3 * TILE + j]
            + f4 * tile[4 * TILE + j]
            + f5 * tile[5 * TILE + j]
            + f6 * tile[6 * TILE + j]
            + f7 * tile[7 * TILE + j]
        )


@kernel
def _update_rest(
    b: int, k0: int, k1: int, start: Any, low: Any, high: Any, row_at: Any, a: Array, scratch: Array
) -> None:
    """Subtract what the columns k0 ... k1 contribute to the columns behind them."""
    right = start[high[b] + 1]
    tile = scratch[: PANEL * TILE]
    factors = scratch[PANEL * TILE : PANEL * (TILE + 1)]
    for first in range(k1, right, TILE):
        width = min(TILE, right - first)
        tile[:] = 0.0  # columns that are not there add nothing
        for k in range(k0, k1):
            for j in range(width):
                tile[(k - k0) * TILE + j] = a[row_at[k] + first + j]
        factors[:] = 0.0
        for c in range(b, high[b] + 1):
            if low[c] > b:
                continue
            for i in range(max(k1, start[c]), start[c + 1]):
                for e in range(k1 - k0):
                    factors[e] = a[row_at[i] + k0 + e]
                _subtract(factors, tile, a[row_at[i] + first : row_at[i] + first + width])


@kernel
def factorise(
    n_block: int, start: Any, low: Any, high: Any, row_at: Any, a: Array, pivots: Any, scratch: Array
) -> float:
    """Factors L U in the place of the matrix; smallest over largest pivot, 0 where one is zero.

    start, low, high, row_at : see the module. pivots : (n,) written. scratch : (PANEL (TILE + 1) + 2,).
    """
    pivot_range = scratch[PANEL * (TILE + 1) : PANEL * (TILE + 1) + 2]
    pivot_range[0], pivot_range[1] = np.inf, 0.0
    for b in range(n_block):
        for k0 in range(start[b], start[b + 1], PANEL):
            k1 = min(k0 + PANEL, start[b + 1])
            if not _eliminate_panel(b, k0, k1, start, low, high, row_at, a, pivots, pivot_range):
                return 0.0
            _update_rest(b, k0, k1, start, low, high, row_at, a, scratch)
    return float(pivot_range[0] / pivot_range[1]) if pivot_range[1] > 0.0 else 1.0  # no unknowns


@kernel
def substitute(n_block: int, start: Any, low: Any, high: Any, row_at: Any, a: Array, pivots: Any, x: Array) -> None:
    """Solution in the place of the right-hand side x (n,), by the factors of ``factorise``."""
    for b in range(n_block):
        begin = start[low[b]]
        # all exchanges of the block first: its factors were exchanged with the rows
        for i in range(start[b], start[b + 1]):
            entry = x[i]
            x[i] = x[pivots[i]]
            x[pivots[i]] = entry
        for i in range(start[b], start[b + 1]):
            row = a[row_at[i] + begin : row_at[i] + i]
            solution = x[begin:i]
            total = 0.0
            for j in range(len(row)):
                total += row[j] * solution[j]
            x[i] -= total
    for b in range(n_block - 1, -1, -1):
        end = start[high[b] + 1]
        for i in range(start[b + 1] - 1, start[b] - 1, -1):
            row = a[row_at[i] + i + 1 : row_at[i] + end]
            solution = x[i + 1 : end]
            total = 0.0
            for j in range(len(row)):
                total += row[j] * solution[j]
            x[i] = (x[i] - total) / a[row_at[i] + i]
