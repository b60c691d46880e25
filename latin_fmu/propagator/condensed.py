"""Factorisation with the interface dofs last: half solves for the march, dense Schur complement for the interface.

For A = [[A_II, A_IG], [A_GI, A_GG]] symmetric positive definite,

    forward(b):      y = A_II^-1 b_I,  c = b_G - A_GI y          (all that the interface needs to know)
    interface:       S x_G = c + g,    S = A_GG - A_GI A_II^-1 A_IG
    backward(y, x_G):  x_I = y - A_II^-1 A_IG x_G

so that one forward and one backward sweep make one ordinary solve, whatever happens on the interface in between.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# A_II^-1 A_IG is stored (one dense product instead of a second sparse solve) up to this size.
_STORED_ENTRIES = 8_000_000


class CondensedFactor:
    """Factor of a symmetric positive definite sparse matrix, interface dofs kept for last.

    Parameters
    ----------
    matrix : (n, n). last : sorted dofs of the interface. rank : (n,) elimination order for the others, or None
        for the minimum-degree ordering of the library.
    """

    def __init__(self, matrix: sp.csr_array, last: Index, rank: Array | None = None) -> None:
        n = matrix.shape[0]
        interior = np.setdiff1d(np.arange(n), last)
        if rank is not None:
            interior = interior[np.argsort(rank[interior], kind="stable")]
        self.interior, self.last = interior, last
        rows = sp.csr_array(matrix[interior])
        self._coupling = sp.csr_array(rows[:, last])  # A_IG
        self._coupling_t = sp.csr_array(self._coupling.T)
        self._lu: spla.SuperLU | None = None
        corner = matrix[last][:, last].toarray()
        self._response: Array | None = None  # A_II^-1 A_IG
        if len(interior):
            self._lu = spla.splu(
                sp.csc_matrix(rows[:, interior]),
                permc_spec="MMD_AT_PLUS_A" if rank is None else "NATURAL",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
            corner -= self._condense()
        self.schur: Array = 0.5 * (corner + corner.T)
        inverse = la.cho_solve(la.cho_factor(self.schur), np.eye(len(last))) if len(last) else np.zeros((0, 0))
        self.schur_inverse: Array = 0.5 * (inverse + inverse.T)

    def _condense(self) -> Array:
        """A_GI A_II^-1 A_IG; keeps A_II^-1 A_IG where it is small enough."""
        assert self._lu is not None
        n_last = len(self.last)
        keep = len(self.interior) * n_last <= _STORED_ENTRIES
        response = np.empty((len(self.interior), n_last)) if keep else None
        condensed = np.empty((n_last, n_last))
        for start in range(0, n_last, 64):
            part = slice(start, min(start + 64, n_last))
            solved = self._lu.solve(self._coupling[:, part].toarray())
            condensed[:, part] = self._coupling_t @ solved
            if response is not None:
                response[:, part] = solved
        self._response = response
        return condensed

    def forward(self, b: Array) -> tuple[Array, Array]:
        """(y, c) of the module docstring for b (n, m)."""
        on_interface = b[self.last]
        if self._lu is None:
            return np.zeros((0, b.shape[1])), on_interface
        y = self._lu.solve(np.ascontiguousarray(b[self.interior]))
        return y, on_interface - self._coupling_t @ y

    def backward(self, y: Array, x_last: Array) -> Array:
        """Full solution (n, m) from ``forward`` and the interface values (n_last, m)."""
        x = np.empty((len(self.interior) + len(self.last), x_last.shape[1]))
        x[self.last] = x_last
        if self._lu is not None:
            if self._response is not None:
                x[self.interior] = y - self._response @ x_last
            else:
                x[self.interior] = y - self._lu.solve(self._coupling @ x_last)
        return x

    def solve(self, b: Array) -> Array:
        """A^-1 b for b (n, m)."""
        y, c = self.forward(b)
        return self.backward(y, self.schur_inverse @ c)

    @property
    def nbytes(self) -> int:
        """Memory of the factor, bytes (approximate for the sparse part)."""
        sparse = 12 * (self._lu.L.nnz + self._lu.U.nnz) if self._lu is not None else 0
        response = 0 if self._response is None else self._response.nbytes
        return int(sparse + response + self.schur.nbytes + self.schur_inverse.nbytes)
