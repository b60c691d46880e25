"""Supernodal Cholesky factor with the interface dofs last, its half solves and dense Schur complement."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import SolverError
from ..operator_store import NO_STORE, OperatorStore
from .many_columns import MANY, solve_on_face
from .numeric import OUTSIDE_PATTERN, MatrixRows, Supernodes, factorise, invert, mirror, routines
from .selected_inverse import selected_inverse
from .substitution import LANES, SPARE, TILED, backward_one, backward_tile, forward_one, forward_tile
from .symbolic import Array, Index, Pattern, Symbolic, shared_analysis

# Panels beyond this many bytes do not stay in the cache from one sweep to the next (see ``substitution``).
_CACHE = 16_000_000


class InterfaceFactor(Protocol):
    """Factor of a symmetric positive definite matrix, interface dofs last."""

    @property
    def interior(self) -> Index:
        """Dofs of the inside in elimination order."""
        ...

    @property
    def last(self) -> Index:
        """Sorted dofs of the interface, (n_last,)."""
        ...

    @property
    def schur(self) -> Array:
        """(n_last, n_last) matrix S left on the interface when the inside is eliminated."""
        ...

    @property
    def schur_inverse(self) -> Array:
        """Inverse of ``schur``, (n_last, n_last)."""
        ...

    def forward(self, b: Array) -> tuple[Array, Array]:
        """(y, c) for b (n, m): S x_last = c is the system of the interface; y is for ``backward`` only."""
        ...

    def backward(self, y: Array, x_last: Array) -> Array:
        """Full solution (n, m) from ``forward`` and the interface values (n_last, m)."""
        ...

    def solve(self, b: Array) -> Array:
        """A^-1 b for b (n, m)."""
        ...


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
    face : sorted dofs that ``face_solve`` and ``face_inverse`` are for; none of them in ``last``.
    store : where the numbers are looked for, and kept.

    Attributes
    ----------
    panels : the numbers of L, L11^-1 in place of the diagonal blocks L11. grouped : whether
    ``substitution`` takes four rows at a time. name : of the numbers in the store.

    Raises
    ------
    SolverError : the matrix is not symmetric positive definite.
    """

    _definite = True  # whether S is (``InsideFactor``)
    _among: Array | None = None  # dense part among the last dofs (``StiffenedFactor``)

    def __init__(
        self,
        matrix: sp.csr_array,
        last: Index,
        rank: Array | None = None,
        dtype: Any = np.float64,
        symbolic: Symbolic | None = None,
        face: Index | None = None,
        store: OperatorStore = NO_STORE,
    ) -> None:
        shape = shared_analysis(Pattern(matrix, last, rank, face, store)) if symbolic is None else symbolic
        self.symbolic = shape
        self.face = np.zeros(0, dtype=np.int64) if face is None else face
        self.dtype: np.dtype[Any] = np.dtype(dtype)
        if self.dtype not in (np.float64, np.float32):
            raise ValueError(f"dtype of the factor: {self.dtype}; allowed: float64, float32")
        self.last = np.asarray(last, dtype=np.int64)
        self.interior = shape.order[: shape.n_interior]
        self._pattern = (shape.first, shape.row_start, shape.rows, shape.panel_start)
        _check_finite(matrix)
        # rows and places of panels follow from the matrix and its order: they need no part in the name
        key = (matrix, self.last, shape.order, shape.first, shape.row_start, str(self.dtype))
        self.name = store.name("factor", *key)
        arrays = store.remember(self.name, lambda: self._factorised(matrix), ("panels",))
        self.panels: NDArray[Any] = arrays["panels"]
        self.schur: Array = arrays["schur"]
        self.schur_inverse: Array = arrays["schur_inverse"]
        self.grouped = self.panels.nbytes <= _CACHE

    def _factorised(self, matrix: sp.csr_array) -> dict[str, NDArray[Any]]:
        """Panels, Schur complement and its inverse, which is empty where it may have none."""
        shape = self.symbolic
        # the kernel adds to the Schur complement, and writes every number of the panels
        panels, schur = np.empty(shape.panel_start[-1], dtype=self.dtype), np.zeros((len(self.last), len(self.last)))
        failed = factorise(
            routines(),
            MatrixRows(
                matrix.indptr.astype(np.int64, copy=False), matrix.indices.astype(np.int64, copy=False), matrix.data
            ),
            shape.order,
            shape.position,
            Supernodes(*self._pattern),
            shape.n_children,
            shape.is_root,
            shape.stack_size,
            panels,
            schur,
        )
        if failed == OUTSIDE_PATTERN:
            raise SolverError("factorisation: the matrix has entries outside the pattern analysed; analyse it afresh")
        if failed >= 0:
            raise _not_definite(int(shape.order[failed]))
        mirror(schur)  # the kernels fill the lower triangle
        if self._among is not None:
            schur += self._among
            self._among = None  # it is in the Schur complement now
        inverse = schur.copy() if self._definite else np.zeros((0, 0))
        if failed := invert(routines(), inverse):
            raise _not_definite(int(self.last[failed - 1]))
        return {"panels": panels, "schur": schur, "schur_inverse": inverse}

    def keep_in(self, memory: NDArray[Any]) -> None:
        """Copy the panels to ``memory``, an array of their size and type, and read them there from now on: the array
        in which they were is freed."""
        memory[:] = self.panels
        self.panels = memory

    def forward(self, b: Array) -> tuple[Array, Array]:
        """(y, c) of the class docstring for b (n, m); y is in elimination order and of use to ``backward`` only."""
        n, _ = b.shape
        n_interior = self.symbolic.n_interior
        self._check_rows("b", n, n_interior + len(self.last))
        x = self._swept(b[self.symbolic.order], forward_one, forward_tile, True)
        return x[:n_interior], x[n_interior:]

    def backward(self, y: Array, x_last: Array) -> Array:
        """Full solution (n, m) from ``forward`` and the interface values (n_last, m)."""
        self._check_rows("y", len(y), self.symbolic.n_interior)
        self._check_rows("x_last", len(x_last), len(self.last))
        x = self._swept(np.concatenate([y, x_last]), backward_one, backward_tile, True)
        out = np.empty_like(x)
        out[self.symbolic.order] = x
        return out

    def face_solve(self, b: Array) -> Array:
        """Rows of A^-1 b of the face (n_face, m) for b (n_face, m) on the face, zero elsewhere."""
        place = self.symbolic.position[self.face]
        x = np.zeros((len(self.symbolic.order), b.shape[1]))
        x[place] = b
        if b.shape[1] < MANY:
            x = self._swept(x, forward_one, forward_tile, False)
            return self._swept(x, backward_one, backward_tile, False)[place]
        self._multiplied(x, self.symbolic.face_start)
        return x[place]

    def _multiplied(self, x: Array, starts: Index) -> None:
        """Both substitutions of x (n, m) in elimination order, in place, by matrix products; ``starts`` : of the part
        of each supernode that is not zero."""
        below = np.diff(self.symbolic.row_start).max(initial=0)
        # a panel, and the products of all columns with the rows below one
        scratch = np.empty(np.diff(self.symbolic.panel_start).max(initial=0)), np.empty(x.shape[1] * below)
        solve_on_face(routines(), *self._pattern, starts, self.panels, x.shape[1], x.reshape(-1), *scratch)

    def face_inverse(self, pattern: sp.csr_array) -> sp.csr_array:
        """Entries of A^-1 on a symmetric pattern (n, n) that is part of the matrix's, rows and columns of the face."""
        position = self.symbolic.position
        rows = position[np.repeat(np.arange(pattern.shape[0]), np.diff(pattern.indptr))]
        columns = position[pattern.indices]
        # the inverse is symmetric: one of each two entries is computed
        lower = np.flatnonzero(rows >= columns)
        # by column, then row: the pairs of one position are one run
        lower = lower[np.lexsort((rows[lower], columns[lower]))]
        starts = np.searchsorted(columns[lower], np.arange(len(position) + 1)).astype(np.int64)
        entries = selected_inverse(self.symbolic, self.panels, starts, np.ascontiguousarray(rows[lower]))
        i, j = self.symbolic.order[rows[lower]], self.symbolic.order[columns[lower]]
        # the diagonal is there once
        apart = i != j
        both = (np.concatenate([i, j[apart]]), np.concatenate([j, i[apart]]))
        return sp.csr_array(sp.coo_array((np.concatenate([entries, entries[apart]]), both), shape=pattern.shape))

    def _swept(self, x: Array, one: Callable[..., None], tile: Callable[..., None], whole: bool) -> Array:
        """One substitution for x (n, m) in elimination order: members one by one, or eight at a time."""
        pattern = (*self._pattern, self.symbolic.face_start)
        n, m = x.shape
        if m < TILED:
            columns = np.ascontiguousarray(x.T, dtype=float)
            for column in columns:
                one(self.grouped, whole, *pattern, self.panels, column)
            return np.ascontiguousarray(columns.T)
        out, tail = np.empty((n, m)), np.empty(SPARE * LANES)
        for first in range(0, m, LANES):
            lanes = min(m - first, LANES)
            part = np.zeros((n, LANES))  # lanes without a member
            part[:, :lanes] = x[:, first : first + lanes]
            tile(whole, *pattern, self.panels, part.reshape(-1), tail)
            out[:, first : first + lanes] = part[:, :lanes]
        return out

    @staticmethod
    def _check_rows(name: str, count: int, expected: int) -> None:
        """The compiled substitutions do not check sizes."""
        if count != expected:
            raise ValueError(f"{name} has {count} rows; allowed: {expected}")

    def solve(self, b: Array) -> Array:
        """A^-1 b for b (n, m)."""
        if b.shape[1] >= MANY and not len(self.last):
            return self.held_solve(b)
        y, c = self.forward(b)
        return self.backward(y, self.schur_inverse @ c)

    def held_solve(self, b: Array) -> Array:
        """A_II^-1 b_I for b (n, m), with zeros (n, m) at the interface: it is held."""
        if b.shape[1] < MANY:
            y, c = self.forward(b)
            return self.backward(y, np.zeros_like(c))
        order, n_interior = self.symbolic.order, self.symbolic.n_interior
        self._check_rows("b", len(b), len(order))
        x = np.ascontiguousarray(b[order], dtype=float)
        self._multiplied(x, np.zeros_like(self.symbolic.face_start))
        out = np.zeros_like(x)
        out[order[:n_interior]] = x[:n_interior]
        return out


class InsideFactor(CholeskyFactor):
    """``CholeskyFactor`` whose S may be singular, as that of parts which nothing but the interface holds: S has no
    inverse, and of the solutions there is ``held_solve`` alone."""

    _definite = False


class StiffenedFactor(CholeskyFactor):
    """``CholeskyFactor`` of a matrix with a dense part among the last dofs beside its sparse one.

    Parameters
    ----------
    matrix : (n, n), sparse. last : as for ``CholeskyFactor``. among : (n_last, n_last), symmetric.
    """

    def __init__(self, matrix: sp.csr_array, last: Index, among: Array) -> None:
        self._among = among
        super().__init__(matrix, last)


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


class LowRankFactor:
    """``InterfaceFactor`` of A' = A + R^T R from one of A, by Woodbury's identity.

    With H = A_II^-1 R_I^T, the Cholesky factor L of 1 + R_I H, W = H L^-T and V = (R_G^T - A_GI H) L^-T,

        A'_II^-1 = A_II^-1 - W W^T,    S' = S + V V^T,    A'_GI A'_II^-1 = A_GI A_II^-1 + V W^T

    so that half solutions take dot products more with the k rows of W^T and V^T:

        c' = c - V r,  r = W^T b_I,        x_I' = x_I - W (r + V^T x_G)

    Parameters
    ----------
    base : factor of A. rows : R (k, n).

    Attributes
    ----------
    inside : W^T (k, n), zeros at the interface. edge : V^T (k, n_last).
    """

    def __init__(self, base: InterfaceFactor, rows: Array) -> None:
        self.base = base
        self.interior = base.interior
        self.last = base.last
        y, coupling = base.forward(np.ascontiguousarray(rows.T))
        inner = base.backward(y, np.zeros_like(coupling))
        triangle = la.cholesky(np.eye(len(rows)) + rows @ inner, lower=True)
        self.inside: Array = la.solve_triangular(triangle, inner.T, lower=True)
        self.edge: Array = la.solve_triangular(triangle, coupling.T, lower=True)
        self.schur: Array = base.schur + self.edge.T @ self.edge
        answer = self.edge @ base.schur_inverse
        small = np.eye(len(rows)) + answer @ self.edge.T
        inverse = base.schur_inverse - answer.T @ la.solve(small, answer, assume_a="pos")
        self.schur_inverse: Array = 0.5 * (inverse + inverse.T)

    def forward(self, b: Array) -> tuple[Array, Array]:
        """(y, c) for b (n, m); r stands behind the y of the base."""
        y, c = self.base.forward(b)
        r = self.inside @ b
        return np.concatenate([y, r]), c - self.edge.T @ r

    def backward(self, y: Array, x_last: Array) -> Array:
        """Full solution (n, m) from ``forward``, or the y = 0 of the base, and the interface values (n_last, m)."""
        inner, r = y[: len(self.interior)], y[len(self.interior) :]
        weights = self.edge @ x_last + (r if len(r) else 0.0)
        return self.base.backward(inner, x_last) - self.inside.T @ weights

    def solve(self, b: Array) -> Array:
        """A'^-1 b for b (n, m)."""
        y, c = self.forward(b)
        return self.backward(y, self.schur_inverse @ c)


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
        """Inverse of the matrix, (n, n)."""
        return np.diag(self.inverse)

    def forward(self, b: Array) -> tuple[Array, Array]:
        """(y, c) of ``InterfaceFactor``: nothing, as there is no inside, and b (n, m)."""
        return np.zeros((0, b.shape[1])), b.copy()

    def backward(self, y: Array, x_last: Array) -> Array:  # noqa: ARG002, as the other factors
        """x_last (n, m)."""
        return x_last.copy()

    def solve(self, b: Array) -> Array:
        """A^-1 b for b (n, m)."""
        x: Array = self.inverse[:, None] * b
        return x
