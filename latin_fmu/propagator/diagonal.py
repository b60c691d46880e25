"""The factor of a diagonal matrix, all dofs kept for last: nothing to substitute, nothing dense to store."""

from __future__ import annotations

import numpy as np

from .condensed import Array, Index


class DiagonalFactor:
    """``cholesky.InterfaceFactor`` of a diagonal matrix.

    Parameters
    ----------
    diagonal : (n,), > 0.

    Attributes
    ----------
    inverse : (n,) of the inverse.
    """

    def __init__(self, diagonal: Array) -> None:
        self._diagonal, self.inverse = diagonal, 1.0 / diagonal
        self.interior: Index = np.zeros(0, dtype=np.int64)
        self.last: Index = np.arange(len(diagonal))

    @property
    def schur(self) -> Array:
        """The matrix itself, (n, n)."""
        return np.diag(self._diagonal)

    @property
    def schur_inverse(self) -> Array:
        """Its inverse, (n, n)."""
        return np.diag(self.inverse)

    def forward(self, b: Array) -> tuple[Array, Array]:
        """(y, c) of ``condensed``: nothing, and b (n, m)."""
        return np.zeros((0, b.shape[1])), b.copy()

    def backward(self, y: Array, x_last: Array) -> Array:  # noqa: ARG002, as the other factors
        """x_last (n, m)."""
        return x_last.copy()

    def solve(self, b: Array) -> Array:
        """A^-1 b for b (n, m)."""
        x: Array = self.inverse[:, None] * b
        return x

    @property
    def nbytes(self) -> int:
        """Memory held, bytes."""
        return self._diagonal.nbytes + self.inverse.nbytes
