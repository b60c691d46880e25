"""Matrices of a substructure condensed onto the channels of its interfaces, with and without dashpots on them.

With X = g S^-1 the velocities of the interface dofs per force on them (S from ``condensed``, g the gain of the time
scheme), T the trace from these dofs to the channels, and dashpots d = a k on the channels (areas a),

    C = T X T^T                               velocities of the channels per force on them,
    T (X^-1 + T^T d T)^-1 T^T = (1 + C d)^-1 C    the same with the dashpots in place (Woodbury).

The right-hand side takes a solution with many right-hand sides, the left-hand side one inverse of the size of S.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.linalg.lapack as lapack
import scipy.sparse as sp
from numpy.typing import NDArray

from ..cholesky.numeric import POTRF, UPPER, fortran, invert, mirror, routines
from ..compiled import entry
from ..errors import SolverError

Array = NDArray[np.float64]
Index = NDArray[np.int64]

ALONE = 1e3  # times what the points resist one by one: no face resists more whose points are independent
_DEPENDENT = 1e-10  # singular values below this share of the largest are round-off, as in ``interface_sweeps``
STILL = 1e-12  # admittances below this share of the largest are round-off of held directions


def _rows(matrix: sp.csr_array) -> tuple[Index, Index]:
    """Pattern of a matrix by rows, in the integers of the kernels."""
    return matrix.indptr.astype(np.int64, copy=False), matrix.indices.astype(np.int64, copy=False)


def projected(trace: sp.csr_array, gain: float, matrix: Array) -> Array:
    """``gain`` T X T^T for symmetric X (n, n) and T (n_channel, n); symmetric to the last bit."""
    out = np.empty((trace.shape[0], trace.shape[0]))
    project(*_rows(trace), trace.data, gain, matrix, out)
    return out


def projected_diagonal(trace: sp.csr_array, gain: float, diagonal: Array) -> Array:
    """The same for X = diag(``diagonal``); diagonal itself where every channel has a dof of its own."""
    weighted = gain * trace.data * diagonal[trace.indices]
    entries = np.diff(trace.indptr)
    # one dof per channel, and no dof in two of them
    if entries.max(initial=0) <= 1 and np.bincount(trace.indices).max(initial=0) <= 1:
        on_channels = np.zeros(trace.shape[0])
        on_channels[entries > 0] = weighted * trace.data
        return np.diag(on_channels)
    product = (sp.csr_array((weighted, trace.indices, trace.indptr), shape=trace.shape) @ trace.T).toarray()
    symmetric: Array = 0.5 * (product + product.T)
    return symmetric


def condensed(compliance: Array, dashpots: Array) -> Array:
    """(1 + C d)^-1 C, symmetric, from the compliance C alone; any d >= 0 (n_channel,), N s m-1.

    Raises
    ------
    SolverError : as ``with_dashpots``.
    """
    diagonal = compliance.diagonal()
    if np.count_nonzero(compliance) == np.count_nonzero(diagonal):
        return np.diag(diagonal / (1.0 + diagonal * dashpots))
    # C - C r (1 + r C r)^-1 r C with r = sqrt(d): symmetric, and regular where d is 0
    root = np.sqrt(dashpots)
    scaled = root[:, None] * compliance
    system = scaled * root
    system.flat[:: len(root) + 1] += 1.0
    _, inner, failed = lapack.dposv(system, scaled, lower=1, overwrite_a=1)
    if failed:  # the identity plus a positive semidefinite matrix: only numbers that are no numbers get here
        raise _not_positive()
    matrix = compliance - scaled.T @ inner
    symmetric: Array = 0.5 * (matrix + matrix.T)
    return symmetric


def with_dashpots(trace: sp.csr_array, gain: float, schur: Array, dashpots: Array) -> Array:
    """Velocities of the channels per force on them (n_channel, n_channel), with dashpots (n_channel,), N s m-1.

    Raises
    ------
    SolverError : a matrix that is not positive definite (numbers that are no numbers).
    """
    springs = gain * dashpots
    inverse = np.empty_like(schur)
    stiffened(*_rows(trace), trace.data, springs, schur, inverse)
    if invert(routines(), inverse) or not np.isfinite(np.diagonal(inverse)).all():
        raise _not_positive()
    return projected(trace, gain, inverse)


def resistance(compliance: Any, rows: Index) -> float:
    """Force for a uniform velocity 1 of these channels, 1^T C^-1 1 over those that can move, N s m-1; by least squares
    where they depend on each other, 1^T C^+ 1."""
    if not isinstance(compliance, np.ndarray):
        return float(compliance.resistance(rows))
    diagonal = compliance.diagonal()
    # round-off of held directions would count as a support that is next to rigid
    moving = rows[diagonal[rows] > STILL * diagonal.max(initial=0.0)]
    if not len(moving):
        return 0.0
    force = float(face_resistance(routines(), compliance, moving))
    # -1: singular, as of points that are held to each other. Points that outnumber the dofs that move them may have a
    # factor all the same, of round-off: where no forces move them alike, they would resist without limit
    if 0.0 <= force <= ALONE * float((1.0 / diagonal[moving]).sum()):
        return force
    block = compliance[moving[:, None], moving]
    return float(la.lstsq(block, np.ones(len(moving)), cond=_DEPENDENT)[0].sum())


def _not_positive() -> SolverError:
    return SolverError("condensation: the admittance of the interfaces is not positive; check the material")


@entry("i8[::1], i8[::1], f8[::1], f8, f8[:, ::1], f8[:, ::1]")
def project(starts: Index, columns: Index, values: Array, factor: float, matrix: Array, out: Array) -> None:
    """out = factor T X T^T for symmetric X (n, n) and T (n_channel, n) by rows."""
    n_channel, n = len(starts) - 1, len(matrix)
    row = np.empty(n)
    for i in range(n_channel):
        row[:] = 0.0
        for e in range(starts[i], starts[i + 1]):
            weight, line = factor * values[e], matrix[columns[e]]
            for j in range(n):
                row[j] += weight * line[j]
        # lower half of row i, the rest by symmetry
        for k in range(i + 1):
            total = 0.0
            for e in range(starts[k], starts[k + 1]):
                total += values[e] * row[columns[e]]
            out[i, k] = total
    mirror(out)


@entry("i8[::1], i8[::1], f8[::1], f8[::1], f8[:, ::1], f8[:, ::1]")
def stiffened(starts: Index, columns: Index, values: Array, springs: Array, matrix: Array, out: Array) -> None:
    """Lower triangle of out = X + T^T diag(springs) T, arguments as for ``project``."""
    n = len(matrix)
    for i in range(n):
        for j in range(i + 1):
            out[i, j] = matrix[i, j]
    for c in range(len(starts) - 1):
        for e in range(starts[c], starts[c + 1]):
            weight = springs[c] * values[e]
            for f in range(starts[c], starts[c + 1]):
                # the lower triangle alone, as ``invert`` reads it
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
    fortran(routines[POTRF], (UPPER, n, root.ctypes.data, n, info.ctypes.data))
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
