"""Matrix products of a march: matrices, terms and vectors by their addresses, vectors flat (rows x members)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from .lanes import LANES, SPARE, TILED, dense_product, sparse_product
from .views import floats, indices, integers, table_of_floats

Array = NDArray[np.float64]


@kernel
def add_symmetric(
    n: int,
    diagonal_at: int,
    starts_at: int,
    columns_at: int,
    values_at: int,
    factor: float,
    m: int,
    x: Array,
    out: Array,
    scratch_at: int,
) -> None:
    """out += factor A x for symmetric A by addresses: its diagonal and its strict lower triangle in compressed rows.

    Two members are taken one after the other, gathered to ``scratch``: half the matrix on numbers that lie together is
    faster than whole rows on both of them. From ``lanes.TILED`` on the rows are whole and taken for eight at a time.
    """
    diagonal, starts = floats(diagonal_at, n), integers(starts_at, n + 1)
    if m >= TILED:
        tile = floats(scratch_at, (n + SPARE) * LANES)
        sparse_product(n, starts, columns_at, values_at, factor, m, x, out, tile)
        return
    columns, values = indices(columns_at, starts[n]), floats(values_at, starts[n])
    if m == 1:
        half_product(n, diagonal, starts, columns, values, factor, x, out)
        return
    own, total = floats(scratch_at, n), floats(scratch_at + 8 * n, n)
    for j in range(m):
        for i in range(n):
            own[i] = x[i * m + j]
            total[i] = 0.0
        half_product(n, diagonal, starts, columns, values, factor, own, total)
        for i in range(n):
            out[i * m + j] += total[i]


@kernel
def half_product(
    n: int, diagonal: Array, starts: Any, columns: Any, values: Array, factor: float, x: Array, out: Array
) -> None:
    """out += factor A x for one vector; see ``add_symmetric``."""
    for i in range(n):
        column, value = columns[starts[i] : starts[i + 1]], values[starts[i] : starts[i + 1]]
        own = factor * x[i]
        total = diagonal[i] * x[i]
        for e in range(len(column)):
            total += value[e] * x[column[e]]
            out[column[e]] += value[e] * own
        out[i] += factor * total


@kernel
def add_matrix(n: int, starts_at: int, columns_at: int, values_at: int, m: int, x: Array, out: Array) -> None:
    """out += A x for A (n, ...) in compressed rows given by addresses; x, out flat, m members."""
    starts = integers(starts_at, n + 1)
    columns, values = indices(columns_at, starts[n]), floats(values_at, starts[n])
    for i in range(n):
        column, value = columns[starts[i] : starts[i + 1]], values[starts[i] : starts[i + 1]]
        line = out[i * m : i * m + m]
        for e in range(len(column)):
            at = np.int64(column[e]) * m
            for j in range(m):
                line[j] += value[e] * x[at + j]


@kernel
def add_terms(
    n: int,
    starts_at: int,
    rows_at: int,
    values_at: int,
    amplitudes_at: int,
    instant: int,
    factor: float,
    out: Array,
) -> None:
    """out += factor x the terms (see ``Terms``) at an instant."""
    if n == 0:
        return
    starts = integers(starts_at, n + 1)
    rows, values = integers(rows_at, starts[n]), floats(values_at, starts[n])
    amplitude = floats(amplitudes_at + 8 * n * instant, n)
    for t in range(n):
        now = factor * amplitude[t]
        if now != 0.0:
            for e in range(starts[t], starts[t + 1]):
                out[rows[e]] += now * values[e]


@kernel
def dense(n: int, matrix_at: int, m: int, x: Array, out: Array, scratch_at: int) -> None:
    """out = A x for symmetric dense A, x and out (n m,): A packed for one member (``packed_product``), else whole."""
    if m == 1:
        packed_product(n, floats(matrix_at, n * (n + 1) // 2), x, out)
    elif m >= TILED:
        dense_product(n, matrix_at, m, x, out, floats(scratch_at, (n + SPARE) * LANES))
    else:
        np.dot(table_of_floats(matrix_at, n, n), x.reshape(n, m), out.reshape(n, m))


@kernel
def packed_product(n: int, a: Array, x: Array, out: Array) -> None:
    """out = A x, A given by the rows of its lower triangle one after the other: half the memory to read, which is
    what a product with a matrix that does not stay in the cache costs. Two rows at a time."""
    at, i = 0, 0
    while i + 2 <= n:
        first, second = a[at : at + i], a[at + i + 1 : at + 2 * i + 1]
        corner, below, last = a[at + i], a[at + 2 * i + 1], a[at + 2 * i + 2]
        x0, x1 = x[i], x[i + 1]
        t0, t1 = corner * x0 + below * x1, below * x0 + last * x1
        known, into = x[:i], out[:i]
        for j in range(i):
            t0 += first[j] * known[j]
            t1 += second[j] * known[j]
            into[j] += first[j] * x0 + second[j] * x1
        out[i], out[i + 1] = t0, t1
        at += 2 * i + 3
        i += 2
    if i < n:
        first, t0 = a[at : at + i], a[at + i] * x[i]
        for j in range(i):
            t0 += first[j] * x[j]
            out[j] += first[j] * x[i]
        out[i] = t0


@kernel
def product(n: int, matrix_at: int, plain: int, m: int, x: Array, out: Array, scratch_at: int) -> None:
    """As ``dense``; ``plain``: A is given by its diagonal."""
    if plain == 0:
        dense(n, matrix_at, m, x, out, scratch_at)
        return
    diagonal = floats(matrix_at, n)
    for i in range(n):
        for j in range(m):
            out[i * m + j] = diagonal[i] * x[i * m + j]


@kernel
def add_trace(row: Any, x: Array, out: Array, normal: bool) -> None:
    """out (n_channel m,) += T x for x (n_inner m,); ``normal``: a dense T is taken at its normal channels alone."""
    if row.dense_trace == 0:
        add_matrix(row.n_channel, row.trace_starts, row.trace_columns, row.trace_values, row.m, x, out)
        return
    n, m = (row.n_normal if normal else row.n_channel), row.m
    table = table_of_floats(row.normal_table if normal else row.trace_table, n, row.n_inner)
    found = np.dot(table, x) if m == 1 else np.dot(table, x.reshape(row.n_inner, m)).reshape(-1)
    if not normal:
        out += found
        return
    at = integers(row.measured, n)
    for i in range(n):
        for j in range(m):
            out[at[i] * m + j] += found[i * m + j]


@kernel
def add_spread(row: Any, x: Array, out: Array) -> None:
    """out (n_inner m,) += T^T x for x (n_channel m,)."""
    if row.dense_trace == 0:
        add_matrix(row.n_inner, row.spread_starts, row.spread_columns, row.spread_values, row.m, x, out)
        return
    m, table = row.m, table_of_floats(row.spread_table, row.n_inner, row.n_channel)
    if m == 1:
        out += np.dot(table, x)
    else:
        out += np.dot(table, x.reshape(row.n_channel, m)).reshape(-1)
