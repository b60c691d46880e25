"""Fixed-point iteration on q: relaxation and Anderson acceleration.

LATIN with k+ = k- is Peaceman-Rachford splitting; relaxation 1/2 makes it Douglas-Rachford, the safe fall-back.
Anderson acceleration of depth m (Walker and Ni 2011, type II) replaces q + r by

    q + r - (DQ + DR) gamma,   gamma = argmin || r - DR gamma ||

with the last m differences DQ, DR of iterates and residuals, in the norm sum area / k q^2 (a power).
"""

from __future__ import annotations

import numpy as np

from .kernels import anderson
from .layout import Array
from .stopping import RANK


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
        self._weight, self._depth, self._relaxation = weight * weight, depth, relaxation
        self._count = 0  # differences seen so far; they are kept in a ring of ``depth`` rows
        self._last: tuple[Array, Array] | None = None

    def next(self, q: Array, residual: Array) -> Array:
        """Next iterate (shape of q)."""
        if self._last is None:
            self._dq = np.empty((self._depth, *q.shape))
            self._dr = np.empty((self._depth, *q.shape))
            self._gram = np.zeros((self._depth, self._depth))
            self._last = (q, residual)
            return q + self._relaxation * residual
        out = np.empty_like(q)
        anderson(
            self._weight, q, residual, *self._last, self._dq, self._dr, self._gram, self._count, self._relaxation,
            RANK, out,
        )  # fmt: skip
        self._count += 1
        self._last = (q, residual)
        return out
