"""Matrices in the form that ``products`` reads them, made in one pass each."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..compiled import entry

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class LowerPattern(NamedTuple):
    """Strict lower triangle of a symmetric pattern in compressed rows, and where its entries are in the whole one;
    ``on_diagonal``: the same for the diagonal, -1 where it has no entry."""

    starts: Index
    columns: NDArray[np.uint32]
    places: Index
    on_diagonal: Index


def lower_pattern(matrix: sp.csr_array) -> LowerPattern:
    """Lower triangle of the pattern of a symmetric matrix (n, n), no entry twice."""
    n, most = matrix.shape[0], matrix.nnz
    starts, on_diagonal = np.zeros(n + 1, dtype=np.int64), np.full(n, -1, dtype=np.int64)
    columns, places = np.empty(most, dtype=np.uint32), np.empty(most, dtype=np.int64)
    pointers, neighbours = (
        matrix.indptr.astype(np.int64, copy=False),
        matrix.indices.astype(np.int64, copy=False),
    )
    count = _lower(pointers, neighbours, starts, columns, places, on_diagonal)
    return LowerPattern(starts, columns[:count].copy(), places[:count].copy(), on_diagonal)


@entry("i8[::1], i8[::1], i8[::1], u4[::1], i8[::1], i8[::1] -> i8")
def _lower(
    pointers: Index,
    neighbours: Index,
    starts: Index,
    columns: NDArray[np.uint32],
    places: Index,
    on_diagonal: Index,
) -> int:
    """Fill the arrays of a ``LowerPattern``, zero or -1 on entry; the entries below the diagonal."""
    count = 0
    for i in range(len(pointers) - 1):
        for e in range(pointers[i], pointers[i + 1]):
            if neighbours[e] < i:
                columns[count], places[count] = neighbours[e], e
                count += 1
            elif neighbours[e] == i:
                on_diagonal[i] = e
        starts[i + 1] = count
    return count


@entry("i8[::1], i8[::1], f8[::1], f8[::1], f8[::1]")
def lower_values(places: Index, on_diagonal: Index, values: Array, diagonal: Array, below: Array) -> None:
    """Diagonal (n,) and entries below it from the entries of the whole matrix."""
    for i in range(len(on_diagonal)):
        diagonal[i] = values[on_diagonal[i]] if on_diagonal[i] >= 0 else 0.0
    for e in range(len(places)):
        below[e] = values[places[e]]


@entry("f8[:, ::1], i8[::1], f8[::1]")
def pack(matrix: Array, picked: Index, out: Array) -> None:
    """Lower triangle of the picked rows and columns, row by row."""
    at = 0
    for i in range(len(picked)):
        line = matrix[picked[i]]
        for j in range(i + 1):
            out[at + j] = line[picked[j]]
        at += i + 1


@entry("f8[:, ::1] -> b1")
def is_diagonal(matrix: Array) -> bool:
    """Whether a symmetric matrix has nothing beside its diagonal."""
    for i in range(len(matrix)):
        for j in range(i):
            if matrix[i, j] != 0.0:
                return False
    return True


def rows_of(matrix: Array, picked: Index, m: int, diagonal: bool) -> Array:
    """Picked rows and columns of a symmetric matrix as ``products.product`` wants them for m members: the diagonal
    alone, the lower triangle row by row, or whole."""
    if diagonal:
        return np.ascontiguousarray(np.diagonal(matrix)[picked])
    if m > 1:
        whole = len(picked) == len(matrix)
        return np.ascontiguousarray(matrix if whole else matrix[np.ix_(picked, picked)])
    out = np.empty(len(picked) * (len(picked) + 1) // 2)
    pack(matrix, picked, out)
    return out
