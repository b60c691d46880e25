"""Vibration modes of a substructure, and which of them matter."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from .model import Array

SILENT = 1e-9  # cosine between a mode and what excites it: below, the mode stays at rest
_DENSE = 1500  # dofs up to which every mode is computed
_SHIFT = 1e-7  # of trace(K) / trace(M): far below the first elastic eigenvalue, far above round-off
_RIGID = 1e-3  # of the shift: eigenvalues below are rigid motions
_CHOICE = 4  # low modes among which the strongest are looked for, times the wanted number


def lowest_modes(
    stiffness: sp.csr_array, mass: sp.csr_array, n_mode: int, excited: Array
) -> tuple[Array, Array]:
    """Rigid motions and the lowest elastic modes that can be excited, mass-orthonormal.

    excited : (n, n_force) columns of length 1.
    """
    n, wanted = stiffness.shape[0], n_mode + 6
    while True:
        rigid, _, elastic = _modes(stiffness, mass, wanted)
        share = np.abs(elastic.T @ excited) / np.linalg.norm(elastic, axis=0)[:, None]
        heard = share.max(axis=1, initial=0.0) > SILENT
        if heard.sum() >= n_mode or rigid.shape[1] + len(heard) == n:
            return rigid, elastic[:, heard][:, :n_mode]
        wanted *= 2


def strongest_modes(
    stiffness: sp.csr_array, mass: sp.csr_array, n_mode: int, forces: Array
) -> tuple[Array, Array]:
    """Rigid motions and the low elastic modes with the largest share in the static answer to any of the forces.

    forces : (n, n_force). The share of mode phi is (phi . b)^2 / lambda, against the sum of these over all low modes.
    """
    rigid, values, elastic = _modes(stiffness, mass, _CHOICE * (n_mode + 6))
    shares = (elastic.T @ forces) ** 2 / values[:, None]
    total = shares.sum(axis=0)
    strength = (shares[:, total > 0.0] / total[total > 0.0]).max(axis=1, initial=0.0)
    best = np.sort(np.argsort(-strength, kind="stable")[:n_mode])
    return rigid, elastic[:, best[strength[best] > SILENT**2]]


def _modes(stiffness: sp.csr_array, mass: sp.csr_array, wanted: int) -> tuple[Array, Array, Array]:
    """Rigid motions, eigenvalues and elastic modes: ``wanted`` of them in all at least, all where there are few."""
    n = stiffness.shape[0]
    shift = _SHIFT * stiffness.trace() / mass.trace()
    if n <= max(_DENSE, 2 * wanted):
        values, vectors = la.eigh(stiffness.toarray(), mass.toarray())
    else:
        start = np.cos(np.arange(n))  # the same modes every time
        values, vectors = spla.eigsh(stiffness, wanted, mass, sigma=-shift, v0=start)
        order = np.argsort(values)
        values, vectors = values[order], vectors[:, order]
    free = values < _RIGID * shift
    return vectors[:, free], values[~free], vectors[:, ~free]
