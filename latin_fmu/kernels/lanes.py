"""Products on eight members at a time, laid out side by side: rows of eight numbers, missing members are zeros.

Eight sums are kept in eight local variables. With sums kept in order the compiler puts them into one vector register;
where it may reorder the sum over a row it does not. The results equal those of one member after the other up to
round-off.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel, ordered_kernel

Array = NDArray[np.float64]

LANES: Final = 8
TILED: Final = 3
"""Number of members from which on eight at a time cost less than one after the other."""
SPARE: Final = 4
"""Rows of eight that scratch has beyond those of the dofs."""


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
def one_row(a: Array, n: int, x: Array, out: Array) -> None:
    """out (8,) = the row a (n,) times x (n, 8)."""
    s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = 0.0
    for k in range(n):
        v, at = a[k], LANES * k
        s0 += v * x[at]
        s1 += v * x[at + 1]
        s2 += v * x[at + 2]
        s3 += v * x[at + 3]
        s4 += v * x[at + 4]
        s5 += v * x[at + 5]
        s6 += v * x[at + 6]
        s7 += v * x[at + 7]
    out[0], out[1], out[2], out[3] = s0, s1, s2, s3
    out[4], out[5], out[6], out[7] = s4, s5, s6, s7


@ordered_kernel
def four_rows(a: Array, n: int, x: Array, out: Array) -> None:
    """out (4, 8) = four rows, ``n`` apart in a, times x (n, 8)."""
    s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = 0.0
    t0 = t1 = t2 = t3 = t4 = t5 = t6 = t7 = 0.0
    p0 = p1 = p2 = p3 = p4 = p5 = p6 = p7 = 0.0
    q0 = q1 = q2 = q3 = q4 = q5 = q6 = q7 = 0.0
    b, c, d = a[n:], a[2 * n :], a[3 * n :]
    for k in range(n):
        at = LANES * k
        x0, x1, x2, x3 = x[at], x[at + 1], x[at + 2], x[at + 3]
        x4, x5, x6, x7 = x[at + 4], x[at + 5], x[at + 6], x[at + 7]
        v = a[k]
        s0 += v * x0
        s1 += v * x1
        s2 += v * x2
        s3 += v * x3
        s4 += v * x4
        s5 += v * x5
        s6 += v * x6
        s7 += v * x7
        v = b[k]
        t0 += v * x0
        t1 += v * x1
        t2 += v * x2
        t3 += v * x3
        t4 += v * x4
        t5 += v * x5
        t6 += v * x6
        t7 += v * x7
        v = c[k]
        p0 += v * x0
        p1 += v * x1
        p2 += v * x2
        p3 += v * x3
        p4 += v * x4
        p5 += v * x5
        p6 += v * x6
        p7 += v * x7
        v = d[k]
        q0 += v * x0
        q1 += v * x1
        q2 += v * x2
        q3 += v * x3
        q4 += v * x4
        q5 += v * x5
        q6 += v * x6
        q7 += v * x7
    out[0], out[1], out[2], out[3] = s0, s1, s2, s3
    out[4], out[5], out[6], out[7] = s4, s5, s6, s7
    out[8], out[9], out[10], out[11] = t0, t1, t2, t3
    out[12], out[13], out[14], out[15] = t4, t5, t6, t7
    out[16], out[17], out[18], out[19] = p0, p1, p2, p3
    out[20], out[21], out[22], out[23] = p4, p5, p6, p7
    out[24], out[25], out[26], out[27] = q0, q1, q2, q3
    out[28], out[29], out[30], out[31] = q4, q5, q6, q7


@ordered_kernel
def subtract_four(a: Array, n: int, t: Array, x: Array) -> None:
    """x (n, 8) -= A^T t for four rows of A, ``n`` apart in a, and t (4, 8)."""
    a0, a1, a2, a3 = t[0], t[1], t[2], t[3]
    a4, a5, a6, a7 = t[4], t[5], t[6], t[7]
    b0, b1, b2, b3 = t[8], t[9], t[10], t[11]
    b4, b5, b6, b7 = t[12], t[13], t[14], t[15]
    c0, c1, c2, c3 = t[16], t[17], t[18], t[19]
    c4, c5, c6, c7 = t[20], t[21], t[22], t[23]
    d0, d1, d2, d3 = t[24], t[25], t[26], t[27]
    d4, d5, d6, d7 = t[28], t[29], t[30], t[31]
    b, c, d = a[n:], a[2 * n :], a[3 * n :]
    for k in range(n):
        v0, v1, v2, v3 = a[k], b[k], c[k], d[k]
        row = x[LANES * k : LANES * (k + 1)]
        row[0] -= v0 * a0 + v1 * b0 + v2 * c0 + v3 * d0
        row[1] -= v0 * a1 + v1 * b1 + v2 * c1 + v3 * d1
        row[2] -= v0 * a2 + v1 * b2 + v2 * c2 + v3 * d2
        row[3] -= v0 * a3 + v1 * b3 + v2 * c3 + v3 * d3
        row[4] -= v0 * a4 + v1 * b4 + v2 * c4 + v3 * d4
        row[5] -= v0 * a5 + v1 * b5 + v2 * c5 + v3 * d5
        row[6] -= v0 * a6 + v1 * b6 + v2 * c6 + v3 * d6
        row[7] -= v0 * a7 + v1 * b7 + v2 * c7 + v3 * d7


@ordered_kernel
def subtract_one(a: Array, n: int, t: Array, x: Array) -> None:
    """x (n, 8) -= a (n,) times t (8,)."""
    a0, a1, a2, a3 = t[0], t[1], t[2], t[3]
    a4, a5, a6, a7 = t[4], t[5], t[6], t[7]
    for k in range(n):
        v = a[k]
        row = x[LANES * k : LANES * (k + 1)]
        row[0] -= v * a0
        row[1] -= v * a1
        row[2] -= v * a2
        row[3] -= v * a3
        row[4] -= v * a4
        row[5] -= v * a5
        row[6] -= v * a6
        row[7] -= v * a7


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
