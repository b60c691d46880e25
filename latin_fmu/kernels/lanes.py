"""Products on eight members at a time, laid out side by side: rows of eight numbers, missing members are zeros.

Eight sums are kept in eight local variables. With sums kept in order the compiler puts them into one vector register;
where it may reorder the sum over a row it does not. The results equal those of one member after the other up to
round-off.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cholesky.substitution import LANES, SPARE, TILED, four_rows, one_row
from ..compiled import kernel, ordered_kernel

Array = NDArray[np.float64]


def padded(m: int) -> int:
    """Numbers per row of a vector of m members in tiles, m where it is not kept in tiles."""
    return m if m < TILED else (m + LANES - 1) // LANES * LANES


tile_width = kernel(padded)  # the same from other kernels


@kernel
def gather(n: int, m: int, first: int, x: Array, tile: Array) -> None:
    """Members from ``first`` on of x (n m,) into a tile (n, 8)."""
    lanes = min(m - first, LANES)
    for i in range(n):
        for j in range(lanes):
            tile[i * LANES + j] = x[i * m + first + j]
        for j in range(lanes, LANES):
            tile[i * LANES + j] = 0.0


@ordered_kernel
def _sparse_row(columns: Any, values: Array, x: Array, out: Array) -> None:
    """out (8,) = a row in compressed form times x (n, 8)."""
    s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = 0.0
    for e in range(len(values)):
        v, at = values[e], LANES * np.int64(columns[e])
        row = x[at : at + LANES]
        s0 += v * row[0]
        s1 += v * row[1]
        s2 += v * row[2]
        s3 += v * row[3]
        s4 += v * row[4]
        s5 += v * row[5]
        s6 += v * row[6]
        s7 += v * row[7]
    out[0], out[1], out[2], out[3] = s0, s1, s2, s3
    out[4], out[5], out[6], out[7] = s4, s5, s6, s7


@kernel
def sparse_product(
    n: int, starts: Any, columns: Any, values: Array, factor: float, m: int, x: Array, out: Array, tile: Array
) -> None:
    """out (n m,) += factor A x for A (n, n) in compressed rows; tile ((n + 1) 8,) is scratch."""
    row = tile[n * LANES : (n + 1) * LANES]
    for first in range(0, m, LANES):
        lanes = min(m - first, LANES)
        gather(n, m, first, x, tile)
        for i in range(n):
            _sparse_row(columns[starts[i] : starts[i + 1]], values[starts[i] : starts[i + 1]], tile, row)
            for j in range(lanes):
                out[i * m + first + j] += factor * row[j]


@kernel
def dense_product(n: int, matrix: Array, m: int, x: Array, out: Array, tile: Array) -> None:
    """out (n m,) = A x for A (n, n); tile ((n + 4) 8,) is scratch."""
    answer = tile[n * LANES : (n + SPARE) * LANES]
    for first in range(0, m, LANES):
        lanes = min(m - first, LANES)
        gather(n, m, first, x, tile)
        i = 0
        while i < n:
            together = 4 if i + 4 <= n else 1
            if together == 4:
                four_rows(matrix[i * n :], n, tile, answer)
            else:
                one_row(matrix[i * n :], n, tile, answer)
            for r in range(together):
                for j in range(lanes):
                    out[(i + r) * m + first + j] = answer[r * LANES + j]
            i += together
