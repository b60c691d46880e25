"""The longest stable step of central differences, from the largest eigenvalues of the lumped system.

Leapfrog with the part R of the damping taken at the old instant is stable while (energy argument, symmetric matrices)

    4 M - 2 dt R - dt^2 K >= 0,    hence for dt^2 w^2 + 2 dt c <= 4,    w^2 = max eig M^-1 K,  c = max eig M^-1 R,

    dt <= (sqrt(c^2 + 4 w^2) - c) / w^2         (2 / w without damping).

Bonded substructures are no stiffer than the stiffest of them (Rayleigh quotient), contact adds nothing.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from .model import Array

_DENSE = 60  # dofs up to which all eigenvalues are computed
_PRECISION = 1e-4  # relative, of the eigenvalue


def stable_step(mass: Array, stiffness: sp.csr_array, lagged: sp.csr_array | None = None) -> float:
    """Longest stable step, s (infinite where nothing is stiff).

    Parameters
    ----------
    mass : (n,) lumped masses > 0, kg. stiffness : (n, n), N m-1. lagged : (n, n) damping taken at the old instant.
    """
    w2 = largest_eigenvalue(stiffness, mass)
    c = 0.0 if lagged is None else max(0.0, largest_eigenvalue(lagged, mass))
    if w2 <= 0.0:
        return float("inf") if c == 0.0 else 2.0 / c
    return float((np.sqrt(c * c + 4.0 * w2) - c) / w2)


def largest_eigenvalue(matrix: sp.csr_array, mass: Array) -> float:
    """Upper estimate of the largest eigenvalue of M^-1 A, A symmetric: Ritz value + residual (Lanczos), or the bound
    of Gershgorin where that does not converge."""
    n = len(mass)
    if n == 0:
        return 0.0
    root = sp.diags_array(1.0 / np.sqrt(mass))
    scaled = sp.csr_array(root @ matrix @ root)
    if n <= _DENSE:
        return float(la.eigvalsh(scaled.toarray())[-1])
    bound = float(abs(scaled).sum(axis=1).max())
    if bound == 0.0:
        return 0.0
    # shifted, it is far from zero whatever the sign; a start that is the same in every run and close to no mode
    start = np.cos(1.0 + np.arange(n) * np.sqrt(2.0))
    shifted = sp.csr_array(scaled + bound * sp.eye_array(n))
    try:
        values, vectors = spla.eigsh(shifted, 1, which="LA", v0=start, tol=_PRECISION)
    except spla.ArpackError:
        return bound
    x = vectors[:, 0]
    return float(min(values[0] - bound + np.linalg.norm(shifted @ x - values[0] * x), bound))
