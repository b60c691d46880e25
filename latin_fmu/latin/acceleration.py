"""Fixed-point iteration on q: relaxation and Anderson acceleration.

LATIN with k+ = k- is Peaceman-Rachford splitting; relaxation 1/2 makes it Douglas-Rachford, the safe fall-back.
Anderson acceleration of depth m (Walker and Ni 2011, type II) replaces q + r by

    q + r - (DQ + DR) gamma,   gamma = argmin || r - DR gamma ||

with the last m differences DQ, DR of iterates and residuals, in the norm sum area / k q^2 (a power).
"""

from __future__ import annotations

import numpy as np

from .layout import Array

# Relative size below which directions of the least-squares problem are dropped.
_RANK = 1e-12


class Relaxation:
    """q + relaxation * r."""

    def __init__(self, relaxation: float) -> None:
        self.relaxation = relaxation

    def next(self, q: Array, residual: Array) -> Array:
        """Next iterate (shape of q)."""
        return q + self.relaxation * residual


class Anderson:
    """Anderson acceleration.

    Parameters
    ----------
    weight : (n_flat,) square root of area / k. depth : differences kept. relaxation : factor on the residual.
    """

    def __init__(self, weight: Array, depth: int, relaxation: float) -> None:
        self._weight, self._depth, self._relaxation = weight, depth, relaxation
        self._count = 0  # differences seen so far; they are kept in a ring of ``depth`` rows
        self._gram = np.zeros((depth, depth))

    def _allocate(self, shape: tuple[int, ...]) -> None:
        self._dq = np.empty((self._depth, *shape))
        self._dr = np.empty((self._depth, *shape))
        self._scaled = np.empty((self._depth, int(np.prod(shape))))

    def next(self, q: Array, residual: Array) -> Array:
        """Next iterate (shape of q)."""
        scaled = (self._weight * residual).ravel()
        if not hasattr(self, "_last"):
            self._allocate(q.shape)
            self._last = (q, residual, scaled)
            return q + self._relaxation * residual
        self._remember(q, residual, scaled)
        kept = min(self._count, self._depth)
        gamma = self._coefficients(self._scaled[:kept] @ scaled, self._gram[:kept, :kept])
        step = self._relaxation * residual
        for g, dq, dr in zip(gamma, self._dq, self._dr, strict=False):
            step -= g * (dq + self._relaxation * dr)
        return q + step

    def _remember(self, q: Array, residual: Array, scaled: Array) -> None:
        row = self._count % self._depth
        last_q, last_r, last_scaled = self._last
        np.subtract(q, last_q, out=self._dq[row])
        np.subtract(residual, last_r, out=self._dr[row])
        np.subtract(scaled, last_scaled, out=self._scaled[row])
        self._count += 1
        kept = min(self._count, self._depth)
        products = self._scaled[:kept] @ self._scaled[row]
        self._gram[row, :kept] = self._gram[:kept, row] = products
        self._last = (q, residual, scaled)

    @staticmethod
    def _coefficients(right: Array, gram: Array) -> Array:
        """Least-squares coefficients; directions that round-off makes meaningless are dropped."""
        size = np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
        values, vectors = np.linalg.eigh(gram / np.outer(size, size))
        used = values > _RANK * values[-1]
        basis = vectors[:, used]
        gamma: Array = (basis @ ((basis.T @ (right / size)) / values[used])) / size
        return gamma
