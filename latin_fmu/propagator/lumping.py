"""Lumping: row sums, so that rigid translations give the same forces before and after."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

Array = NDArray[np.float64]


def lumped(matrix: sp.csr_array, nodal: bool) -> sp.csr_array:
    """Row sums over the nodes: (3 n_node, 3 n_node) -> the same shape, diagonal, or ``nodal`` 3 x 3 blocks.

    Blocks keep what couples the components of one node (oblique dashpots). Rigid translations give the same forces
    before and after; a stiffness-proportional damping gives none.
    """
    rows = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
    columns, data = matrix.indices, matrix.data
    if not nodal:
        kept = rows % 3 == columns % 3  # mass and stiffness of one component; consistent masses have no other
        sums: Array = np.bincount(rows[kept], data[kept], minlength=matrix.shape[0]).astype(np.float64)
        return diagonal_matrix(_cleared(sums))
    onto = 3 * (rows // 3) + columns % 3
    summed = sp.csr_array(sp.coo_array((data, (rows, onto)), shape=matrix.shape))
    summed.data = _cleared(summed.data)
    summed.eliminate_zeros()
    return summed


def diagonal_matrix(values: Array) -> sp.csr_array:
    """Diagonal matrix (n, n) of values (n,), zeros left out."""
    n, kept = len(values), np.flatnonzero(values)
    starts = np.searchsorted(kept, np.arange(n + 1))
    return sp.csr_array((values[kept], kept, starts), shape=(n, n))


def reduced_diagonal(expansion: sp.csr_array, values: Array) -> Array:
    """Diagonal (n,) of P^T diag(values) P for a selection P (n_full, n), at most one entry per row."""
    rows = np.repeat(np.arange(expansion.shape[0]), np.diff(expansion.indptr))
    weights = expansion.data**2 * values[rows]
    sums: Array = np.bincount(expansion.indices, weights, expansion.shape[1]).astype(np.float64)
    return sums


def _cleared(values: Array) -> Array:
    """Round-off of the largest becomes zero."""
    return np.where(np.abs(values) <= 1e-12 * np.abs(values).max(initial=0.0), 0.0, values)
