"""Supernodal Cholesky factor with the interface dofs last, its half solves and dense Schur complement."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...errors import SolverError
from ...kernels.lanes import LANES, SPARE, TILED
from ...kernels.sweeps import backward_one, backward_tile, forward_one, forward_tile
from ..operator_pattern import Analyses
from .dense import invert, mirror
from .kernels import routines
from .numeric import OUTSIDE_PATTERN, factorise
from .symbolic import Array, Index, Pattern, Symbolic, shared_analysis

# Panels beyond this many bytes do not stay in the cache from one sweep to the next (see ``sweeps``).
_CACHE = 16_000_000


class CholeskyFactor:
    """Factor of a symmetric positive definite sparse matrix, interface dofs kept for last.

    With P A P^T = [[L, 0], [G, 1]] [[1, 0], [0, S]] [[L, 0], [G, 1]]^T, S = A_GG - A_GI A_II^-1 A_IG,

        forward(b):      y = L^-1 b_I,  c = b_G - G y
        interface:       S x_G = c + g
        backward(y, x_G):  L^T x_I = y - G^T x_G

    Parameters
    ----------
    matrix : (n, n). last : sorted dofs of the interface. rank : (n,) elimination order for the others, or None for
        minimum degree. dtype : float64, or float32 to store the factor in half the memory (S stays in float64).
    symbolic : analysis of another matrix with the same pattern and interface, to be used again.
    analyses : those made so far for matrices with this pattern.

    Attributes
    ----------
    panels : the numbers of L. tallest : most rows below one supernode. grouped : how ``sweeps`` walks the panels.

    Raises
    ------
    SolverError : the matrix is not symmetric positive definite.
    """

    def __init__(
        self,
        matrix: sp.csr_array,
        last: Index,
        rank: Array | None = None,
        dtype: Any = np.float64,
        symbolic: Symbolic | None = None,
        analyses: Analyses | None = None,
    ) -> None:
        if symbolic is None and analyses is not None:
            symbolic = analyses.find(last, rank)
        if symbolic is None:
            symbolic = shared_analysis(Pattern(matrix, last, rank))
            if analyses is not None:
                analyses.add(last, rank, symbolic)
        self.symbolic = shape = symbolic
        self.dtype: np.dtype[Any] = np.dtype(dtype)
        if self.dtype not in (np.float64, np.float32):
            raise ValueError(f"dtype of the factor: {self.dtype}; allowed: float64, float32")
        self.last = np.asarray(last, dtype=np.int64)
        self.interior = shape.order[: shape.n_interior]
        self.panels: NDArray[Any] = np.empty(shape.panel_start[-1], dtype=self.dtype)
        self.grouped = self.panels.nbytes <= _CACHE
        self.tallest = shape.tallest
        pattern = (shape.first, shape.row_start, shape.rows, shape.panel_start)
        self._sweep = (*pattern, self.panels)
        _check_finite(matrix)
        self.schur: Array = np.zeros((len(self.last), len(self.last)))
        failed = factorise(
            routines(np.dtype(np.float64)),
            matrix.indptr.astype(np.int64, copy=False),
            matrix.indices.astype(np.int64, copy=False),
            matrix.data,
            shape.order,
            shape.position,
            *pattern,
            shape.n_children,
            shape.is_root,
            shape.stack_size,
            self.panels,
            self.schur,
        )
        if failed == OUTSIDE_PATTERN:
            raise SolverError("factorisation: the matrix has entries outside the pattern analysed; analyse it afresh")
        if failed >= 0:
            raise _not_definite(int(shape.order[failed]))
        mirror(self.schur)
        self.schur_inverse: Array = self.schur.copy()
        if failed := invert(routines(np.dtype(np.float64)), self.schur_inverse):
            raise _not_definite(int(self.last[failed - 1]))

    def forward(self, b: Array) -> tuple[Array, Array]:
        """(y, c) of the class docstring for b (n, m); y is in elimination order and of use to ``backward`` only."""
        n, _ = b.shape
        n_interior = self.symbolic.n_interior
        self._check_rows("b", n, n_interior + len(self.last))
        x = self._swept(b[self.symbolic.order], forward_one, forward_tile)
        return x[:n_interior], x[n_interior:]

    def backward(self, y: Array, x_last: Array) -> Array:
        """Full solution (n, m) from ``forward`` and the interface values (n_last, m)."""
        self._check_rows("y", len(y), self.symbolic.n_interior)
        self._check_rows("x_last", len(x_last), len(self.last))
        x = self._swept(np.concatenate([y, x_last]), backward_one, backward_tile)
        out = np.empty_like(x)
        out[self.symbolic.order] = x
        return out

    def _swept(self, x: Array, one: Callable[..., None], tile: Callable[..., None]) -> Array:
        """One substitution for x (n, m) in elimination order: members one by one, or eight at a time."""
        n, m = x.shape
        if m < TILED:
            columns = np.ascontiguousarray(x.T, dtype=float)
            for column in columns:
                one(self.grouped, *self._sweep, column)
            return np.ascontiguousarray(columns.T)
        out, tail = np.empty((n, m)), np.empty(SPARE * LANES)
        for first in range(0, m, LANES):
            lanes = min(m - first, LANES)
            part = np.zeros((n, LANES))
            part[:, :lanes] = x[:, first : first + lanes]
            tile(*self._sweep, part.reshape(-1), tail)
            out[:, first : first + lanes] = part[:, :lanes]
        return out

    @staticmethod
    def _check_rows(name: str, given: int, expected: int) -> None:
        """The compiled sweeps do not look at sizes."""
        if given != expected:
            raise ValueError(f"{name} has {given} rows; allowed: {expected}")

    def solve(self, b: Array) -> Array:
        """A^-1 b for b (n, m)."""
        y, c = self.forward(b)
        return self.backward(y, self.schur_inverse @ c)

    @property
    def nbytes(self) -> int:
        """Memory of the factor and of the dense interface matrices, bytes."""
        return int(self.panels.nbytes + self.symbolic.rows.nbytes + self.schur.nbytes + self.schur_inverse.nbytes)


def _check_finite(matrix: sp.csr_array) -> None:
    finite = np.isfinite(matrix.data)
    if not finite.all():
        entry = int(np.argmin(finite))
        dof = int(np.searchsorted(matrix.indptr, entry, side="right")) - 1
        raise SolverError(
            f"factorisation: the matrix has the entry {matrix.data[entry]} in the row of dof {dof}; "
            "allowed: finite numbers; check the material, the mesh and the time step"
        )


def _not_definite(dof: int) -> SolverError:
    return SolverError(
        f"factorisation: the pivot of dof {dof} is not positive; allowed: symmetric positive definite matrices; "
        "check the density, the time step and whether the part is held"
    )
