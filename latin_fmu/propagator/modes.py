"""Vibration modes of a substructure, and which of them matter."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from ..cholesky.factor import interface_factor
from .model import Array

SILENT = 1e-9  # cosine between a mode and what excites it: below, the mode stays at rest
_DENSE = 1500  # dofs up to which every mode is computed
_SHIFT = 1e-7  # of trace(K) / trace(M): far below the first elastic eigenvalue, far above round-off
_RIGID = 1e-3  # of the shift: eigenvalues below are rigid motions
_CHOICE = 4  # low modes among which the strongest are looked for, times the wanted number
_REFINEMENTS, _EXACT = 60, 1e-13  # of static answers: each takes off the shift over the first eigenvalue


class Vibration:
    """Stiffness and mass of the free dofs, (n, n), and one factor for modes and static answers: that of K + shift M.

    rank : (n,) elimination order of the dofs, or None.
    """

    def __init__(self, stiffness: sp.csr_array, mass: sp.csr_array, rank: Array | None = None) -> None:
        self.stiffness, self.mass = stiffness, mass
        self.shift = _SHIFT * stiffness.trace() / mass.trace()
        nothing = np.zeros(0, dtype=np.int64)
        self._factor = interface_factor(sp.csr_array(stiffness + self.shift * mass), nothing, rank)

    @property
    def n(self) -> int:
        """Number of dofs."""
        return int(self.stiffness.shape[0])

    def modes(self, wanted: int) -> tuple[Array, Array, Array]:
        """Rigid motions, eigenvalues and elastic modes: at least ``wanted`` in all, or all there are."""
        if self.n <= max(_DENSE, 2 * wanted):
            values, vectors = la.eigh(self.stiffness.toarray(), self.mass.toarray())
        else:
            inverse = spla.LinearOperator((self.n, self.n), matvec=self._inverse, dtype=np.float64)
            start = np.cos(np.arange(self.n))  # the same modes every time
            values, vectors = spla.eigsh(self.stiffness, wanted, self.mass, sigma=-self.shift, v0=start, OPinv=inverse)
            order = np.argsort(values)
            values, vectors = values[order], vectors[:, order]
        free = values < _RIGID * self.shift
        return vectors[:, free], values[~free], vectors[:, ~free]

    def _inverse(self, b: Array) -> Array:
        solved: Array = self._factor.solve(b.reshape(self.n, 1))[:, 0]
        return solved

    def static(self, rigid: Array, forces: Array) -> Array:
        """Static answers to forces (n, n_force), orthogonal to the rigid motions in the mass.

        K x = b - M R R^T b, R^T M x = 0: a free body is accelerated by what is not in balance (inertia relief).
        """
        pulled = self.mass @ rigid
        balanced = forces - pulled @ (rigid.T @ forces)
        largest = np.abs(balanced).max(initial=0.0)
        found: Array = np.zeros_like(forces)
        for _ in range(_REFINEMENTS):
            left = balanced - self.stiffness @ found
            if np.abs(left).max(initial=0.0) <= _EXACT * largest:
                break
            found = found + self._factor.solve(left)
            found = found - rigid @ (pulled.T @ found)
        return found


def lowest_modes(body: Vibration, n_mode: int, excited: Array) -> tuple[Array, Array]:
    """Rigid motions and the lowest elastic modes that can be excited, mass-orthonormal.

    excited : (n, n_force) columns of length 1.
    """
    wanted = n_mode + 6
    while True:
        rigid, _, elastic = body.modes(wanted)
        share = np.abs(elastic.T @ excited) / np.linalg.norm(elastic, axis=0)[:, None]
        heard = share.max(axis=1, initial=0.0) > SILENT
        if heard.sum() >= n_mode or rigid.shape[1] + len(heard) == body.n:
            return rigid, elastic[:, heard][:, :n_mode]
        wanted *= 2


def strongest_modes(body: Vibration, n_mode: int, forces: Array) -> tuple[Array, Array]:
    """Rigid motions and the low elastic modes with the largest share in the static answer to any of the forces.

    forces : (n, n_force). The share of mode phi is (phi . b)^2 / lambda, against the sum of these over all low modes.
    """
    rigid, values, elastic = body.modes(_CHOICE * (n_mode + 6))
    shares = (elastic.T @ forces) ** 2 / values[:, None]
    total = shares.sum(axis=0)
    strength = (shares[:, total > 0.0] / total[total > 0.0]).max(axis=1, initial=0.0)
    best = np.sort(np.argsort(-strength, kind="stable")[:n_mode])
    return rigid, elastic[:, best[strength[best] > SILENT**2]]
