"""Solutions without a factor: conjugate gradients with the interface dofs last, for what does not fit in memory.

The half solves of ``condensed`` with A_II^-1 replaced by conjugate gradients, preconditioned by the diagonal. For the
operator of a march, M + c dt^2 K, the number of iterations grows with the step over the time a wave needs for an
element, not with the mesh. What is kept is the matrix and the dense Schur complement of the interface.

Two solutions per instant, each from zero: nothing depends on the instants before, a restart is bit for bit the same.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from ..errors import SolverError
from .model import Array, Index

TOLERANCE = 1e-11
_BLOCK = 32  # columns solved together
_MOST = 5000  # iterations


class ConjugateGradients:
    """Solver with a symmetric positive definite sparse matrix.

    Parameters
    ----------
    matrix : (n, n). tolerance : on the residual, relative to the right-hand side.

    Raises
    ------
    SolverError : the diagonal is not positive.
    """

    def __init__(self, matrix: sp.csr_array, tolerance: float = TOLERANCE) -> None:
        self.matrix, self.tolerance = matrix, tolerance
        diagonal = matrix.diagonal()
        if not (diagonal > 0).all():
            raise SolverError(
                "conjugate gradients: the matrix has a diagonal entry that is not positive; allowed: symmetric "
                "positive definite matrices; check the density, the time step and whether the part is held"
            )
        self._inverse = (1.0 / diagonal)[:, None]

    def solve(self, b: Array) -> Array:
        """A^-1 b for b (n, m), each column to the tolerance.

        Raises
        ------
        SolverError : no convergence.
        """
        out = np.empty_like(b)
        for start in range(0, b.shape[1], _BLOCK):
            part = slice(start, start + _BLOCK)
            out[:, part] = self._columns(b[:, part])
        return out

    def _columns(self, b: Array) -> Array:
        x, r = np.zeros_like(b), b.copy()
        limit = self.tolerance**2 * np.einsum("nm,nm->m", b, b)
        z = self._inverse * r
        p = z.copy()
        rz = np.einsum("nm,nm->m", r, z)
        for _ in range(_MOST):
            active = np.einsum("nm,nm->m", r, r) > limit
            if not active.any():
                return x
            ap = self.matrix @ p
            curvature = np.einsum("nm,nm->m", p, ap)
            alpha = np.divide(rz, curvature, out=np.zeros_like(rz), where=active & (curvature > 0))
            x += alpha * p
            r -= alpha * ap
            z = self._inverse * r
            new = np.einsum("nm,nm->m", r, z)
            p = z + np.divide(new, rz, out=np.zeros_like(rz), where=active & (rz > 0)) * p
            rz = new
        raise SolverError(
            f"conjugate gradients: not converged to {self.tolerance:g} in {_MOST} iterations; take smaller steps, or "
            "the direct propagator"
        )


class IterativeFactor:
    """``cholesky.factor.InterfaceFactor`` without a factorisation (module docstring).

    Parameters
    ----------
    matrix : (n, n), symmetric positive definite. last : sorted dofs of the interface. tolerance : of every solution.
    """

    def __init__(self, matrix: sp.csr_array, last: Index, tolerance: float = TOLERANCE) -> None:
        self.interior, self.last = np.setdiff1d(np.arange(matrix.shape[0]), last), last
        rows = sp.csr_array(matrix[self.interior])
        self._coupling = sp.csr_array(rows[:, last])  # A_IG
        self._coupling_t = sp.csr_array(self._coupling.T)
        self._inner = ConjugateGradients(sp.csr_array(rows[:, self.interior]), tolerance)
        schur = matrix[last][:, last].toarray()
        for start in range(0, len(last), _BLOCK):
            part = slice(start, start + _BLOCK)
            schur[:, part] -= self._coupling_t @ self._inner.solve(self._coupling[:, part].toarray())
        self.schur: Array = 0.5 * (schur + schur.T)
        try:
            inverse = la.cho_solve(la.cho_factor(self.schur), np.eye(len(last))) if len(last) else schur
        except la.LinAlgError:
            raise SolverError(
                "conjugate gradients: the matrix of a step is singular to rounding errors (its inertia is lost beside "
                "the stiffness); take smaller steps, or the direct propagator"
            ) from None
        self.schur_inverse: Array = 0.5 * (inverse + inverse.T)

    def forward(self, b: Array) -> tuple[Array, Array]:
        """(y, c): y = A_II^-1 b_I, c = b_G - A_GI y, for b (n, m)."""
        y = self._inner.solve(b[self.interior])
        return y, b[self.last] - self._coupling_t @ y

    def backward(self, y: Array, x_last: Array) -> Array:
        """Full solution (n, m) from ``forward`` and the interface values (n_last, m)."""
        x = np.empty((len(self.interior) + len(self.last), x_last.shape[1]))
        x[self.last] = x_last
        x[self.interior] = y - self._inner.solve(self._coupling @ x_last)
        return x

    def solve(self, b: Array) -> Array:
        """A^-1 b for b (n, m)."""
        y, c = self.forward(b)
        return self.backward(y, self.schur_inverse @ c)
