"""Matrix products of a march, vectors flat (rows x members); see ``records`` for the forms of the matrices.

From TILED members on eight members are taken at a time, side by side in a tile: rows of eight numbers, zeros for
missing members. Eight sums are kept in eight local variables, which the compiler puts into one vector register as long
as it keeps their order; where it may reorder the sum over a row it does not. The results equal those of one member
after the other up to round-off.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cholesky.substitution import LANES, SPARE, TILED, four_rows, one_row
from ..compiled import entry, kernel, ordered_kernel

Array = NDArray[np.float64]
LONG = 32
"""Entries of a row, side by side, from which on it is taken for several vectors at once."""


@ordered_kernel
def half_product(
    low: int,
    high: int,
    diagonal: Array,
    together: Any,
    starts: Any,
    columns: Any,
    values: Array,
    factor: float,
    x: Array,
    out: Array,
) -> None:
    """out (n,) += factor A x for one vector and the rows of a symmetric A from ``low`` to ``high``, each with its
    reflection: its diagonal and strict lower triangle in compressed rows. Up to three rows with the same columns are
    taken ``together``, as those of a node are: what they share is read and written once, in the order of the rows."""
    # indices counted from 0 need no test for negative ones
    begin = starts[low : high + 1]
    middle = diagonal[low:high]
    own_x = x[low:high]
    own_out = out[low:high]
    i, rows = 0, high - low
    while i < rows:
        # a node may be cut by the end of the part
        count = min(int(together[low + i]), rows - i)
        column, first = columns[begin[i] : begin[i + 1]], values[begin[i] : begin[i + 1]]
        n = len(column)
        x0 = own_x[i]
        own0 = factor * own_x[i]
        t0 = middle[i] * own_x[i]
        if count == 1:
            for e in range(n):
                t0 += first[e] * x[column[e]]
                out[column[e]] += first[e] * own0
            own_out[i] += factor * t0
            i += 1
            continue
        second, x1 = values[begin[i + 1] : begin[i + 2]], own_x[i + 1]
        own1, t1 = factor * x1, middle[i + 1] * x1
        if count == 2:
            for e in range(n):
                at, value = column[e], x[column[e]]
                t0 += first[e] * value
                t1 += second[e] * value
                # the sums in the order of the rows, as if one had followed the other
                out[at] = (out[at] + first[e] * own0) + second[e] * own1
            # behind the n columns in common stands the entry with the first row
            own_out[i] = (own_out[i] + factor * t0) + second[n] * own1
            own_out[i + 1] += factor * (t1 + second[n] * x0)
            i += 2
            continue
        third, x2 = values[begin[i + 2] : begin[i + 3]], own_x[i + 2]
        own2, t2 = factor * x2, middle[i + 2] * x2
        for e in range(n):
            at, value = column[e], x[column[e]]
            t0 += first[e] * value
            t1 += second[e] * value
            t2 += third[e] * value
            out[at] = ((out[at] + first[e] * own0) + second[e] * own1) + third[e] * own2
        own_out[i] = ((own_out[i] + factor * t0) + second[n] * own1) + third[n] * own2
        own_out[i + 1] = (own_out[i + 1] + factor * (t1 + second[n] * x0)) + third[n + 1] * own2
        own_out[i + 2] += factor * ((t2 + third[n] * x0) + third[n + 1] * x1)
        i += 3


@ordered_kernel
def add_rows(n: int, starts: Any, columns: Any, values: Array, factor: float, m: int, x: Array, out: Array) -> None:
    """out (n m,) += factor A x for A in compressed rows."""
    for i in range(n if m == 1 else 0):  # most rows of a trace have one entry: a loop over members costs more than that
        total = out[i]
        for e in range(starts[i], starts[i + 1]):
            total += (factor * values[e]) * x[columns[e]]
        out[i] = total
    for i in range(n if m > 1 else 0):
        column, value = columns[starts[i] : starts[i + 1]], values[starts[i] : starts[i + 1]]
        line = out[i * m : i * m + m]
        for e in range(len(column)):
            now, at = factor * value[e], np.int64(column[e]) * m
            for j in range(m):
                line[j] += now * x[at + j]


@kernel
def four_products(n: int, line: Array, x0: Array, x1: Array, x2: Array, x3: Array) -> tuple[float, float, float, float]:
    """Products of a row (n,) with four vectors (n,)."""
    t0 = t1 = t2 = t3 = 0.0
    for k in range(n):
        value = line[k]
        t0 += value * x0[k]
        t1 += value * x1[k]
        t2 += value * x2[k]
        t3 += value * x3[k]
    return t0, t1, t2, t3


@kernel
def read_long_rows(
    n: int,
    kinds: int,
    starts: Any,
    columns: Any,
    values: Array,
    u: Array,
    v: Array,
    a: Array,
    strained: Array,
    out: Array,
) -> None:
    """out (kinds, n) = A x of up to four vectors for A in compressed rows; rows whose columns follow one another are
    taken for all vectors at once."""
    for i in range(n):
        begin, length = starts[i], starts[i + 1] - starts[i]
        line = values[begin : begin + length]
        at = np.int64(columns[begin]) if length > 0 else 0
        if length >= LONG and np.int64(columns[begin + length - 1]) - at == length - 1:
            end = at + length
            sums = four_products(length, line, u[at:end], v[at:end], a[at:end], strained[at:end])
        else:
            t0 = t1 = t2 = t3 = 0.0
            for e in range(length):
                k = columns[begin + e]
                t0 += line[e] * u[k]
                t1 += line[e] * v[k]
                t2 += line[e] * a[k]
                t3 += line[e] * strained[k]
            sums = (t0, t1, t2, t3)
        for kind in range(kinds):
            out[kind * n + i] = sums[kind]


@kernel
def add_dense(rows: int, columns: int, table: Array, x: Array, out: Array) -> None:
    """out (rows,) += A x for a dense A (rows, columns)."""
    for i in range(rows):
        line, total = table[i * columns : (i + 1) * columns], 0.0
        for k in range(columns):
            total += line[k] * x[k]
        out[i] += total


@kernel
def add_dense_members(rows: int, columns: int, table: Array, m: int, x: Array, out: Array, scratch: Array) -> None:
    """out (rows m,) += A x for a dense A (rows, columns); scratch ((max(rows, columns) + 4) 8,)."""
    if m >= TILED:
        for first in range(0, m, LANES):
            add_dense_tile(rows, columns, table, m, first, x, out, scratch)
        return
    # one member at a time, side by side in memory
    member, total = scratch[:columns], scratch[columns : columns + rows]
    for j in range(m):
        for i in range(columns):
            member[i] = x[i * m + j]
        total[:] = 0.0
        add_dense(rows, columns, table, member, total)
        for i in range(rows):
            out[i * m + j] += total[i]


@kernel
def packed_product(n: int, a: Any, x: Array, out: Array) -> None:
    """out = A x, A given by the rows of its lower triangle one after the other, float64 or float32. Half of the memory
    is read, and reading is the cost of a product with a matrix larger than the cache. Two rows at a time."""
    at, i = 0, 0
    while i + 2 <= n:
        first, second = a[at : at + i], a[at + i + 1 : at + 2 * i + 1]  # rows i and i + 1
        corner = a[at + i]
        below = a[at + 2 * i + 1]
        last = a[at + 2 * i + 2]
        x0, x1 = x[i], x[i + 1]
        t0, t1 = corner * x0 + below * x1, below * x0 + last * x1
        head, into = x[:i], out[:i]
        for j in range(i):
            t0 += first[j] * head[j]
            t1 += second[j] * head[j]
            into[j] += first[j] * x0 + second[j] * x1
        out[i], out[i + 1] = t0, t1
        at += 2 * i + 3  # to row i + 2
        i += 2
    if i < n:
        first, t0 = a[at : at + i], a[at + i] * x[i]
        for j in range(i):
            t0 += first[j] * x[j]
            out[j] += first[j] * x[i]
        out[i] = t0


def numbers_of(n: int, plain: int, m: int) -> int:
    """Numbers that a symmetric dense matrix (n, n) takes for m members: those of its diagonal, of its lower triangle or
    all."""
    if plain == 1:
        return n
    return n * n if m >= TILED else n * (n + 1) // 2


symmetric_size = kernel(numbers_of)  # the same from other kernels


@kernel
def entry_of(n: int, matrix: Array, plain: int, m: int, i: int, j: int) -> float:
    """Entry (i, j) of a symmetric dense matrix, kept as ``symmetric_size`` says."""
    if plain == 1:
        return float(matrix[i]) if i == j else 0.0
    if m >= TILED:
        return float(matrix[i * n + j])
    return float(matrix[i * (i + 1) // 2 + j] if i >= j else matrix[j * (j + 1) // 2 + i])


@kernel
def product(n: int, matrix: Array, plain: int, m: int, x: Array, out: Array, scratch: Array) -> None:
    """out (n m,) = A x for a symmetric dense A, kept as ``symmetric_size`` says."""
    if plain == 1:
        for i in range(n):
            for j in range(m):
                out[i * m + j] = matrix[i] * x[i * m + j]
    elif m == 1:
        packed_product(n, matrix, x, out)
    elif m >= TILED:
        dense_product(n, matrix, m, x, out, scratch)
    else:
        member, total = scratch[:n], scratch[n : 2 * n]
        for j in range(m):
            for i in range(n):
                member[i] = x[i * m + j]
            packed_product(n, matrix, member, total)
            for i in range(n):
                out[i * m + j] = total[i]


@kernel
def two_norms(n: int, a: Any, x: Array) -> tuple[float, float, float]:
    """x A x of the two rows x_0, x_1 of x (2, n), and x_1 A x_0, A packed (``packed_product``)."""
    x0, x1 = x[:n], x[n : 2 * n]
    first = 0.0
    second = 0.0
    cross = 0.0
    at = 0
    for i in range(n):
        line = a[at : at + i]
        t0 = t1 = 0.0
        for j in range(i):
            t0 += line[j] * x0[j]
            t1 += line[j] * x1[j]
        corner = a[at + i]
        first += x0[i] * (2.0 * t0 + corner * x0[i])  # both triangles
        second += x1[i] * (2.0 * t1 + corner * x1[i])
        cross += x1[i] * (t0 + corner * x0[i]) + x0[i] * t1
        at += i + 1
    return first, second, cross


@kernel
def add_terms(n: int, starts: Any, rows: Any, values: Array, amplitudes: Array, factor: float, out: Array) -> None:
    """out += factor x sum of patterns (starts, rows, values) times their amplitudes (n,) at an instant."""
    for t in range(n):
        now = factor * amplitudes[t]
        if now != 0.0:  # loads that have ended, or not begun
            for e in range(starts[t], starts[t + 1]):
                out[rows[e]] += now * values[e]


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
    out[0] = s0
    out[1] = s1
    out[2] = s2
    out[3] = s3
    out[4] = s4
    out[5] = s5
    out[6] = s6
    out[7] = s7


@kernel
def sparse_product(
    n: int, starts: Any, columns: Any, values: Array, factor: float, m: int, x: Array, out: Array, tile: Array
) -> None:
    """out (n m,) += factor A x for A (n, n) in compressed rows; tile ((n + 1) 8,) is scratch."""
    for first in range(0, m, LANES):
        gather(n, m, first, x, tile)
        sparse_rows(0, n, starts, columns, values, factor, m, first, tile, out, tile[n * LANES : (n + 1) * LANES])


@kernel
def sparse_rows(
    low: int,
    high: int,
    starts: Any,
    columns: Any,
    values: Array,
    factor: float,
    m: int,
    first: int,
    tile: Array,
    out: Array,
    row: Array,
) -> None:
    """Rows from ``low`` to ``high`` of ``sparse_product`` for the tile that begins with the member ``first``; row (8,)
    is scratch."""
    lanes = min(m - first, LANES)
    begin = starts[low : high + 1]
    into = out[low * m + first :]
    for i in range(high - low):
        _sparse_row(columns[begin[i] : begin[i + 1]], values[begin[i] : begin[i + 1]], tile, row)
        for j in range(lanes):
            into[i * m + j] += factor * row[j]


@kernel
def dense_product(n: int, matrix: Array, m: int, x: Array, out: Array, tile: Array) -> None:
    """out (n m,) = A x for A (n, n); tile ((n + 4) 8,) is scratch."""
    for first in range(0, m, LANES):
        dense_tile(n, matrix, m, first, x, out, tile)


@kernel
def dense_tile(n: int, matrix: Array, m: int, first: int, x: Array, out: Array, tile: Array) -> None:
    """``dense_product`` for the tile that begins with the member ``first``."""
    for i in range(n):
        for j in range(first, min(m, first + LANES)):
            out[i * m + j] = 0.0
    add_dense_tile(n, n, matrix, m, first, x, out, tile)


@kernel
def add_dense_tile(
    rows: int, columns: int, matrix: Array, m: int, first: int, x: Array, out: Array, tile: Array
) -> None:
    """out (rows m,) += A x for A (rows, columns) and the tile that begins with the member ``first``; tile
    ((columns + 4) 8,) is scratch."""
    answer, lanes = tile[columns * LANES : (columns + SPARE) * LANES], min(m - first, LANES)
    gather(columns, m, first, x, tile)
    i = 0
    while i < rows:
        together = 4 if i + 4 <= rows else 1
        if together == 4:
            four_rows(matrix[i * columns :], columns, columns, tile, answer)
        else:
            one_row(matrix[i * columns :], columns, tile, answer)
        for r in range(together):
            for j in range(lanes):
                out[(i + r) * m + first + j] += answer[r * LANES + j]
        i += together


# -- from matrices of SciPy and NumPy to the forms above ----------------------------------------------------------
@entry("f8[:, ::1], i8[::1], f8[::1]", "f8[:, ::1], i8[::1], f4[::1]")
def pack_triangle(matrix: Array, picked: Any, out: Any) -> None:
    """out = lower triangle, row by row, of the picked rows and columns of a symmetric matrix."""
    at = 0
    for i in range(len(picked)):
        line = matrix[picked[i]]
        for j in range(i + 1):
            out[at] = line[picked[j]]
            at += 1


@entry("i8[::1], i8[::1] -> i8", "i4[::1], i4[::1] -> i8")
def lower_count(pointers: Any, columns: Any) -> int:
    """Number of entries below the diagonal of a matrix in compressed rows."""
    count = 0
    for i in range(len(pointers) - 1):
        for e in range(pointers[i], pointers[i + 1]):
            if columns[e] < i:
                count += 1
    return count


@entry("i8[::1], i8[::1], i8[::1], u4[::1], u4[::1]", "i4[::1], i4[::1], i8[::1], u4[::1], u4[::1]")
def lower_pattern(pointers: Any, columns: Any, starts: Any, lower: Any, together: Any) -> None:
    """Pattern below the diagonal of a matrix in compressed rows: ``starts`` (n + 1,), column indices ``lower``, and for
    each row how many from it on, three at most, have the same columns but for each other, ``together`` (n,)."""
    filled, n = 0, len(pointers) - 1
    starts[0] = 0
    for i in range(len(pointers) - 1):
        for e in range(pointers[i], pointers[i + 1]):
            if columns[e] < i:
                lower[filled] = columns[e]
                filled += 1
        starts[i + 1] = filled
    for k in range(n):
        i = n - 1 - k
        together[i] = 1
        # the next row has the same columns and this one
        if k == 0 or starts[i + 2] - starts[i + 1] != starts[i + 1] - starts[i] + 1:
            continue
        # how far an entry of the next row lies behind
        same, ahead = lower[starts[i + 2] - 1] == i, starts[i + 1] - starts[i]
        for e in range(starts[i], starts[i + 1]):
            same = same and lower[e] == lower[e + ahead]
        if same:
            together[i] = min(3, together[i + 1] + 1)


@entry("i8[::1], i8[::1], f8[::1], f8[::1], f8[::1]", "i4[::1], i4[::1], f8[::1], f8[::1], f8[::1]")
def lower_values(pointers: Any, columns: Any, values: Array, lower: Array, diagonal: Array) -> None:
    """Values below the diagonal in the order of ``lower_pattern``, and the diagonal, 0 where it has no entry."""
    filled = 0
    for i in range(len(diagonal)):
        diagonal[i] = 0.0  # the stiffness of a rigid body has no entry there
        for e in range(pointers[i], pointers[i + 1]):
            if columns[e] < i:
                lower[filled] = values[e]
                filled += 1
            elif columns[e] == i:
                diagonal[i] = values[e]
