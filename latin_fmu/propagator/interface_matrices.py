"""What the channels of the interfaces see of the dense matrices of a substructure, and of dashpots on them.

With X = g S^-1 the velocities of the interface dofs per force on them (S from ``condensed``, g the gain of the time
scheme), T the trace from these dofs to the channels, and dashpots d = a k on the channels (areas a),

    C = T X T^T                               velocities of the channels per force on them,
    T (X^-1 + T^T d T)^-1 T^T = (1 + C d)^-1 C    the same with the dashpots in place (Woodbury).

The right-hand side takes a solution with many right-hand sides, the left-hand side one inverse of the size of S.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.linalg.lapack as lapack
import scipy.sparse as sp

from ..compiled import COMPILES
from ..errors import SolverError
from .condensed import Array, Index

_STILL = 1e-12  # admittances below this share of the largest are round-off of held directions


def seen_by_channels(trace: sp.csr_array, gain: float, matrix: Array) -> Array:
    """``gain`` T X T^T for symmetric X (n, n) and T (n_channel, n); symmetric to the last bit."""
    if COMPILES:
        from .cholesky.dense import seen

        found = np.empty((trace.shape[0], trace.shape[0]))
        seen(trace.indptr, trace.indices, trace.data, gain, matrix, found)
        return found
    product = gain * (trace @ (trace @ matrix).T)
    symmetric: Array = 0.5 * (product + product.T)
    return symmetric


def with_dashpots(trace: sp.csr_array, gain: float, schur: Array, dashpots: Array) -> Array:
    """Velocities of the channels per force on them (n_channel, n_channel), with dashpots (n_channel,), N s m-1.

    Raises
    ------
    SolverError : a matrix that is not positive definite (numbers that are no numbers).
    """
    springs = gain * dashpots
    if COMPILES:
        from .cholesky.dense import invert, stiffened
        from .cholesky.kernels import routines

        inverse = np.empty_like(schur)
        stiffened(trace.indptr, trace.indices, trace.data, springs, schur, inverse)
        failed = invert(routines(np.dtype(np.float64)), inverse)
    else:
        system = schur + (trace.T @ (springs[:, None] * trace.toarray()))
        root, failed = lapack.dpotrf(system, lower=1)
        inverse = lapack.dpotri(root, lower=1)[0]
        inverse = np.tril(inverse) + np.tril(inverse, -1).T
    if failed or not np.isfinite(np.diagonal(inverse)).all():
        raise SolverError(
            "condensation: the admittance of the interfaces is not positive; check the material"
        )
    return seen_by_channels(trace, gain, inverse)


def resistance(compliance: Array, rows: Index) -> float:
    """Force for a uniform velocity 1 of these channels, 1^T C^-1 1 over those that can move, N s m-1."""
    diagonal = compliance.diagonal()
    moving = rows[diagonal[rows] > _STILL * diagonal.max(initial=0.0)]
    if not len(moving):
        return 0.0
    if COMPILES:
        from .cholesky.dense import face_resistance
        from .cholesky.kernels import routines

        found = float(face_resistance(routines(np.dtype(np.float64)), compliance, moving))
        if found >= 0.0:
            return found
    block = compliance[moving[:, None], moving]
    return float(la.lstsq(block, np.ones(len(moving)))[0].sum())
