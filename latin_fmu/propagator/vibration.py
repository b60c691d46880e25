"""Vibration modes and static responses of free dofs by one factor, that of K + shift M."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from ..cholesky.factor import CholeskyFactor

Array = NDArray[np.float64]

DENSE = 1500
"""Dofs up to which every mode is computed."""
_SHIFT = 1e-7  # of trace(K) / trace(M): far below the first elastic eigenvalue, far above round-off
_RIGID = 1e-3  # of the shift: eigenvalues below are rigid motions
_REFINEMENTS, _EXACT = 60, 1e-13  # of static responses: each takes off the shift over the first eigenvalue
_BALANCED = 1e-12  # what the inertia of the rigid motions leaves of a force, against the force
_MASSLESS = 1e-13  # inverse of an eigenvalue over the largest: below it is round-off of dofs without mass
_FIRST = 20  # modes computed at first


class Vibration:
    """Stiffness and mass of the free dofs, (n, n), and one factor for modes and static responses: that of K + shift M.

    rank : (n,) elimination order of the dofs, or None. shift : s-2; a share of trace(K) / trace(M) where None.
    """

    def __init__(
        self, stiffness: sp.csr_array, mass: sp.csr_array, rank: Array | None = None, shift: float | None = None
    ) -> None:
        self.stiffness = stiffness
        self.mass = mass
        if shift is None:
            self.shift = _SHIFT * stiffness.trace() / mass.trace()
        else:
            self.shift = shift
        self._rank = rank

    def shifted_by(self, shift: float) -> Vibration:
        """The same with another shift, s-2."""
        return Vibration(self.stiffness, self.mass, self._rank, shift)

    @cached_property
    def shifted(self) -> sp.csr_array:
        """K + shift M, (n, n)."""
        return sp.csr_array(self.stiffness + self.shift * self.mass)

    @cached_property
    def _factor(self) -> CholeskyFactor:
        return CholeskyFactor(self.shifted, np.zeros(0, dtype=np.int64), self._rank)

    @property
    def n(self) -> int:
        """Number of dofs."""
        return int(self.stiffness.shape[0])

    def modes(self, requested: int) -> tuple[Array, Array, Array]:
        """Rigid motions, eigenvalues and elastic modes: at least ``requested`` in all, or all there are."""
        if self.n <= max(DENSE, 2 * requested):
            values, vectors = self._every()
        else:
            inverse = spla.LinearOperator((self.n, self.n), matvec=self.solve, dtype=np.float64)
            start = np.cos(np.arange(self.n))  # the same modes every time
            values, vectors = spla.eigsh(
                self.stiffness, requested, self.mass, sigma=-self.shift, v0=start, OPinv=inverse
            )
            order = np.argsort(values)
            values, vectors = values[order], vectors[:, order]
        free = values < _RIGID * self.shift
        return vectors[:, free], values[~free], vectors[:, ~free]

    def _every(self) -> tuple[Array, Array]:
        """All eigenvalues and modes; where some dofs have no mass, those that move a mass."""
        mass = self.mass.toarray()
        if (self.mass.diagonal() > 0.0).all():
            values, vectors = la.eigh(self.stiffness.toarray(), mass)
            return values, vectors
        inverse, vectors = la.eigh(mass, self.stiffness.toarray() + self.shift * mass)
        # ascending eigenvalues are descending inverses
        moves = np.flatnonzero(inverse > _MASSLESS * inverse[-1])[::-1]
        return 1.0 / inverse[moves] - self.shift, vectors[:, moves] / np.sqrt(inverse[moves])

    def below(self, limit: float, most: int) -> tuple[Array, Array] | None:
        """Elastic eigenvalues (k,) up to ``limit``, s-2, and modes (n, k); None for more than about ``most``."""
        requested = _FIRST
        while True:
            rigid, values, vectors = self.modes(min(requested, self.n))
            band, found = values <= limit, rigid.shape[1] + len(values)
            # other than requested: all that there are
            if not band.all() or found != requested or requested >= self.n:
                if band.sum() <= most:
                    return (values[band], vectors[:, band])
                return None
            if requested > most + rigid.shape[1]:
                return None
            requested *= 2

    def solve(self, b: Array) -> Array:
        """(K + shift M)^-1 b for b (n,)."""
        solved: Array = self._factor.solve(b.reshape(self.n, 1))[:, 0]
        return solved

    def static(self, rigid: Array, forces: Array) -> Array:
        """Static responses to forces (n, n_force), orthogonal to the rigid motions in the mass.

        K x = b - M R R^T b, R^T M x = 0: a free body is accelerated by what is not in balance (inertia relief).
        """
        pulled = self.mass @ rigid
        balanced = forces - pulled @ (rigid.T @ forces)
        # the weight of a free body leaves round-off only, which is no response
        balanced[
            :, np.abs(balanced).max(axis=0, initial=0.0) <= _BALANCED * np.abs(forces).max(axis=0, initial=0.0)
        ] = 0.0
        largest = np.abs(balanced).max(initial=0.0)
        x: Array = np.zeros_like(forces)
        for _ in range(_REFINEMENTS):
            # the factor is that of K + shift M: what the shift takes off is put back round by round
            residual = balanced - self.stiffness @ x
            if np.abs(residual).max(initial=0.0) <= _EXACT * largest:
                break
            x = x + self._factor.solve(residual)
            # rigid motions are soft with the shift: round-off along them grows by 1 / shift
            x = x - rigid @ (pulled.T @ x)
        return x
