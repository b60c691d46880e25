"""Dense symmetric matrices of the interface in compiled kernels: inverse, and what channels see of it.

Row-major lower triangles are what LAPACK sees as upper ones.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...compiled import entry
from .kernels import UPPER, fortran

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_TILE = 32


@entry("f8[:, ::1]")
def mirror(matrix: Array) -> None:
    """Copy the lower triangle of a square matrix over the upper one."""
    n = len(matrix)
    for first in range(0, n, _TILE):
        for left in range(0, first + 1, _TILE):  # tile by tile: a whole column does not stay in the cache
            for i in range(first, min(first + _TILE, n)):
                for j in range(left, min(left + _TILE, i)):
                    matrix[j, i] = matrix[i, j]


@entry("i8[::1], f8[:, ::1] -> i8")
def invert(routines: Index, matrix: Array) -> int:
    """Inverse of a positive definite matrix from its lower triangle, in its place; 0, or 1 + the row where a pivot
    is not positive."""
    n = len(matrix)
    if n == 0:
        return 0
    info = np.zeros(1, dtype=np.int32)
    fortran(routines[0], (UPPER, n, matrix.ctypes.data, n, info.ctypes.data))
    if info[0] != 0:
        return int(info[0])
    fortran(routines[6], (UPPER, n, matrix.ctypes.data, n, info.ctypes.data))
    mirror(matrix)
    return int(info[0])


@entry("i8[::1], i8[::1], f8[::1], f8, f8[:, ::1], f8[:, ::1]")
def seen(starts: Index, columns: Index, values: Array, factor: float, matrix: Array, out: Array) -> None:
    """out = factor T X T^T for symmetric X (n, n) and T (n_channel, n) by rows."""
    n_channel, n = len(starts) - 1, len(matrix)
    row = np.empty(n)
    for i in range(n_channel):
        row[:] = 0.0
        for e in range(starts[i], starts[i + 1]):
            weight, line = factor * values[e], matrix[columns[e]]
            for j in range(n):
                row[j] += weight * line[j]
        for k in range(i + 1):
            total = 0.0
            for e in range(starts[k], starts[k + 1]):
                total += values[e] * row[columns[e]]
            out[i, k] = total
    mirror(out)


@entry("i8[::1], i8[::1], f8[::1], f8[::1], f8[:, ::1], f8[:, ::1]")
def stiffened(starts: Index, columns: Index, values: Array, springs: Array, matrix: Array, out: Array) -> None:
    """Lower triangle of out = X + T^T diag(springs) T, arguments as for ``seen``."""
    n = len(matrix)
    for i in range(n):
        for j in range(i + 1):
            out[i, j] = matrix[i, j]
    for c in range(len(starts) - 1):
        for e in range(starts[c], starts[c + 1]):
            weight = springs[c] * values[e]
            for f in range(starts[c], starts[c + 1]):
                if columns[f] <= columns[e]:
                    out[columns[e], columns[f]] += weight * values[f]


@entry("i8[::1], f8[:, ::1], i8[::1] -> f8")
def face_resistance(routines: Index, matrix: Array, picked: Index) -> float:
    """1^T C^-1 1 of the picked rows and columns of a positive semidefinite matrix, -1 where they are singular."""
    n = len(picked)
    root, info = np.empty((n, n)), np.zeros(1, dtype=np.int32)
    for i in range(n):
        line = matrix[picked[i]]
        for j in range(i + 1):
            root[i, j] = line[picked[j]]
    fortran(routines[0], (UPPER, n, root.ctypes.data, n, info.ctypes.data))
    if info[0] != 0:
        return -1.0
    solved, total = np.empty(n), 0.0  # |L^-1 1|^2
    for i in range(n):
        rest = 1.0
        for j in range(i):
            rest -= root[i, j] * solved[j]
        solved[i] = rest / root[i, i]
        total += solved[i] * solved[i]
    return total
