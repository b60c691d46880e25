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
        self._last: tuple[Array, Array] | None = None
        self._dq: list[Array] = []
        self._dr: list[Array] = []

    def next(self, q: Array, residual: Array) -> Array:
        """Next iterate (shape of q)."""
        scaled = (self._weight * residual).ravel()
        if self._last is not None:
            last_q, last_r = self._last
            self._dq.append(q - last_q)
            self._dr.append(scaled - last_r)
            if len(self._dq) > self._depth:
                del self._dq[0], self._dr[0]
        self._last = (q, scaled)
        step = self._relaxation * residual
        if not self._dq:
            return q + step
        matrix = np.stack(self._dr)
        gram = matrix @ matrix.T
        size = np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
        values, vectors = np.linalg.eigh(gram / np.outer(size, size))
        kept = values > _RANK * values[-1]
        right = vectors[:, kept].T @ ((matrix @ scaled) / size)
        gamma = (vectors[:, kept] @ (right / values[kept])) / size
        unweighted = np.divide(gamma @ matrix, np.tile(self._weight, len(q)),
                               out=np.zeros(matrix.shape[1]), where=np.tile(self._weight, len(q)) > 0)  # fmt: skip
        correction = sum(g * d for g, d in zip(gamma, self._dq, strict=True))
        accelerated: Array = q + step - correction - self._relaxation * unweighted.reshape(q.shape)
        return accelerated
