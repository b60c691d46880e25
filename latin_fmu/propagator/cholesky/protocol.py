"""What the march needs of a factor: half solves and the Schur complement of the interface."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class InterfaceFactor(Protocol):
    """Factor of a symmetric positive definite matrix, interface dofs last."""

    @property
    def interior(self) -> Index:
        """Dofs of the inside in elimination order."""
        ...

    @property
    def last(self) -> Index:
        """Dofs of the interface."""
        ...

    @property
    def schur(self) -> Array:
        """(n_last, n_last) matrix S left on the interface when the inside is eliminated."""
        ...

    @property
    def schur_inverse(self) -> Array:
        """Its inverse."""
        ...

    def forward(self, b: Array) -> tuple[Array, Array]:
        """(y, c) for b (n, m): S x_last = c is what the interface sees; y is for ``backward`` only."""
        ...

    def backward(self, y: Array, x_last: Array) -> Array:
        """Full solution (n, m) from ``forward`` and the interface values (n_last, m)."""
        ...

    def solve(self, b: Array) -> Array:
        """A^-1 b for b (n, m)."""
        ...

    @property
    def nbytes(self) -> int:
        """Memory held, bytes."""
        ...
