"""Interfaces of a substructure without dense matrices: substitution through the part of the factor above the interface.

The dense form of an interface is that of its Schur complement S, which is full where the interface dofs are eliminated
last. In nested dissection of *all* dofs the factor of the operator A of the march is small, and it serves the interface
exactly: (A^-1) on the interface dofs is S^-1, so that with the trace T and the gain g of the time scheme

    C = g T A^-1 T^T,        Y = g T A_k^-1 T^T,    A_k = A + g T^T diag(a k) T,

where the dashpots a k change blocks of the interface alone. A load on the interface enters, and its solution leaves,
through the columns of the elimination tree that interface nodes are in or below. Interface nodes come last in the
leaves and separators of the dissection, so that a pair of such substitutions reads two thirds to three quarters of the
factor of a thin plate, and a quarter of that of a body with one small face.

Both factors have one pattern. The diagonal of C comes from the entries of A^-1 on it (``cholesky.selected_inverse``).
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from functools import cached_property
from typing import Any, Final, Literal, NamedTuple

import numpy as np
import scipy.sparse as sp

from ..cholesky.factor import CholeskyFactor
from ..cholesky.symbolic import Pattern, Symbolic, shared_analysis
from .interface_matrices import ALONE, STILL
from .model import Array, Index, OperatorPattern, SubstructureModel, operator_matrices, with_data

Form = Literal["automatic", "dense", "exact", "sparse"]
"""How interfaces are solved with: by dense matrices, by substitution (exact too), by tables, or by what costs less."""

NONE = np.zeros(0, dtype=np.int64)
_SMALL: Final = 750
"""Channels of a substructure below which dense matrices are taken without comparison: 250 points with friction."""
_SMALL_LONG: Final = 2100
"""The same where tables would not be sparse, in longer steps, in which Newton steps take dense matrices up to there,
and in windows of several instants."""
SET_UP: Final = 4.0
"""Multiplications of both factors and of the diagonal of C, over those of one factor."""
_SMALL_STATIC: Final = 4000
"""The same without inertia, where Newton steps take a dense matrix in either case."""
_LONG = 100.0  # diagonals of the stiffness over those of the mass in the operator: Courant number of about 7
_NEAR = 5.0  # the same up to which tables are sparse: 2
_INSTANTS, _ITERATIONS = 500.0, 4.0  # of the march that the two forms are compared in
_FLOP = 3.5e-11  # CPU time of a multiplication, s
_ENTRY, _DENSE_ENTRY = 1.7e-10, 6e-10  # of an entry of a factor in single precision, of a matrix beyond the cache, s
_COLUMNS = 128  # solved at a time
_SINGULAR = 1e-12  # cosine between a direction and its image below which a matrix counts as singular
ENOUGH, _MOST = 1e-4, 200  # residual and iterations of the conjugate gradients of a resistance


class Interfaces(NamedTuple):
    """How interfaces are solved with. form : as requested. step : time step of windows of one instant with contact, s;
    None in other runs."""

    form: Form = "automatic"
    step: float | None = None


def in_form(members: Sequence[SubstructureModel], interfaces: Interfaces) -> list[SubstructureModel]:
    """Identical substructures, with sweeps where the form is "exact" or "sparse", or where that costs less than dense
    matrices."""
    if takes_sweeps(members[0], interfaces):
        return [m.with_sweeps() for m in members]
    return list(members)


def long_steps(
    weights: tuple[float, float, float], mass: sp.csr_array, stiffness: sp.csr_array, limit: float = _LONG
) -> bool:
    """Whether an instant is of long range: the stiffness in the operator of the march is ``limit`` times the mass."""
    return stiffness_over_inertia(weights, mass, stiffness) > limit


def stiffness_over_inertia(weights: tuple[float, float, float], mass: sp.csr_array, stiffness: sp.csr_array) -> float:
    """Median over the dofs with mass of the diagonal of K over that of M in the operator of the march, 0 without any;
    weights of M, C and K in it."""
    diagonal, inertia = weights[2] * stiffness.diagonal(), weights[0] * mass.diagonal()
    heavy = inertia > 0.0
    if heavy.any():
        return float(np.median(diagonal[heavy] / inertia[heavy]))
    return 0.0


def _smallest(model: SubstructureModel, step: float | None) -> int:
    """Channels below which dense matrices are taken without comparison."""
    if model.mass is None:
        return _SMALL_STATIC
    if step is None or model.channel_area.size < _SMALL:
        return _SMALL_LONG
    mass, _, stiffness = model.reduced
    # beta dt^2 of the average acceleration
    if long_steps((1.0, 0.0, 0.25 * step**2), mass, stiffness, _NEAR):
        return _SMALL_LONG
    return _SMALL


def takes_sweeps(model: SubstructureModel, interfaces: Interfaces) -> bool:
    """Whether the interfaces of a directly marched model are solved with by substitution.

    Per instant dense matrices are read g^2 + 1.5 c^2 entries (g interface dofs, c channels), and take about 4 c^3
    multiplications to make; the substitutions of the iterations read the part of the factor for the interface twelve
    times. Compared over a march of 500 instants.
    """
    form = interfaces.form
    channels = model.channel_area.size
    if form == "dense" or model.nodal is not None or model.factor == "cg" or not channels:
        return False
    if model.modal is not None:  # modal damping joins all interface dofs: no local tables, no part of a factor
        return False
    if form in ("exact", "sparse"):
        return True
    if channels < _smallest(model, interfaces.step):
        return False
    g, c = float(len(model.at_interface[0])), float(channels)
    dense = _INSTANTS * _DENSE_ENTRY * (g**2 + 1.5 * c**2) + _FLOP * 4.0 * c**3
    shape = swept_shape(model)
    return swept_entries(shape, _ITERATIONS) * _INSTANTS * _ENTRY + _FLOP * flops(shape) * SET_UP < dense


def swept_shape(model: SubstructureModel) -> Symbolic:
    """Pattern of the factor of a model whose interfaces are solved with by substitution."""
    return DashpotPattern(model).symbolic


def swept_entries(shape: Symbolic, iterations: float) -> float:
    """Entries that the substitutions of an instant on the interfaces read: two of the march, two per iteration, and
    those of the force residual, eight vectors at a time."""
    return (4.0 + 2.0 * iterations) * shape.face_entries


def flops(shape: Symbolic) -> float:
    """Multiplications of a factorisation."""
    width, below = np.diff(shape.first).astype(float), np.diff(shape.row_start).astype(float)
    return float((width**3 / 3 + width**2 * below + width * below**2).sum())


class InterfaceCompliance:
    """C of the module docstring: velocities of the channels per nodal force on them, m s-1 N-1.

    Parameters
    ----------
    factor : of A, with the interface dofs as its face. dofs : these. trace : (n_channel, n_gamma) from them to the
    channels. gain : velocities per solution with A. pattern : of A with dashpots on it.
    """

    def __init__(
        self, factor: CholeskyFactor, dofs: Index, trace: sp.csr_array, gain: float, pattern: DashpotPattern
    ) -> None:
        self.factor = factor
        self._trace = trace
        self.gain = gain

        def diagonal() -> dict[str, Array]:
            inverse = factor.face_inverse(pattern.on_interface)[dofs][:, dofs]
            # diag(T X T^T), without the product itself
            return {"of_one": np.asarray((trace @ inverse).multiply(trace).sum(axis=1)).ravel()}

        name = pattern.store.name("diagonal", factor.name, trace, dofs)
        self._diagonal: Array = gain * pattern.store.remember(name, diagonal)["of_one"]

    def diagonal(self) -> Array:
        """Entries (n_channel,) of the diagonal."""
        return self._diagonal

    def __matmul__(self, force: Array) -> Array:
        """Velocities (n_channel,) or (n_channel, m) under nodal forces on the channels."""
        return applied(self.factor, self._trace, self.gain, force)

    def __mul__(self, factor: float) -> InterfaceCompliance:
        """The same for another length of increment without inertia."""
        other = copy(self)
        other.gain, other._diagonal = factor * self.gain, factor * self._diagonal
        return other

    def resistance(self, rows: Index, enough: float = ENOUGH) -> float:
        """1^T C^-1 1 of the rows that can move, by conjugate gradients to the relative residual ``enough``; see
        ``interface_matrices.resistance``."""
        moving = rows[self._diagonal[rows] > STILL * self._diagonal.max(initial=0.0)]
        x, rest = np.zeros(len(moving)), np.ones(len(moving))
        direction = np.zeros(len(moving))
        size = 0.0
        full = np.zeros(len(self._diagonal))
        for _ in range(_MOST):
            # written so that NaN ends it
            if not np.linalg.norm(rest) > enough * np.sqrt(len(moving)):
                break
            scaled = rest / self._diagonal[moving]
            last, size = size, float(rest @ scaled)
            if last:  # 0 in the first iteration
                direction = scaled + size / last * direction
            else:
                direction = scaled
            full[moving] = direction
            image = (self @ full)[moving]
            curvature = float(direction @ image)
            # points that are held to each other: C is singular, and uniform motion need not be in its range
            if curvature <= _SINGULAR * float(np.linalg.norm(direction) * np.linalg.norm(image)):
                return self._least_resistance(moving, enough)
            step = size / curvature
            x += step * direction
            rest -= step * image
        force = float(x.sum())
        # round-off of such points may hide behind a curvature that is not quite zero
        if force <= ALONE * float((1.0 / self._diagonal[moving]).sum()):
            return force
        return self._least_resistance(moving, enough)

    def _least_resistance(self, moving: Index, enough: float) -> float:
        """1^T C^+ 1 by least squares (C. C. Paige and M. A. Saunders, LSQR, ACM Trans. Math. Softw. 8, 1982)."""

        from scipy.sparse.linalg import LinearOperator, lsqr  # few scenes need it

        def product(force: Array) -> Array:
            full = np.zeros(len(self._diagonal))
            full[moving] = force.ravel()
            return np.asarray((self @ full)[moving])

        n = len(moving)
        # symmetric: its own transpose
        matrix = LinearOperator((n, n), matvec=product, rmatvec=product, dtype=np.float64)
        # beyond a condition of 1e10 singular values are round-off
        x = lsqr(matrix, np.ones(n), atol=1e-2 * enough, btol=enough, conlim=1e10, iter_lim=_MOST)[0]
        return float(x.sum())


class MassCompliance:
    """T M^-1 T^T: accelerations of the channels per nodal force on them at t = 0, kg-1.

    Parameters
    ----------
    factor : solver with M. operators : of the class.
    """

    def __init__(self, factor: Any, operators: Any) -> None:
        self._factor, self._operators = factor, operators

    def diagonal(self) -> Array:
        """Estimate (n_channel,) of the diagonal, from that of M."""
        ops = self._operators
        mass = ops.mass.diagonal()[ops.dofs]
        # dofs without mass have no part in it: the solver gives them no acceleration
        inverse = np.divide(1.0, mass, out=np.zeros_like(mass), where=mass > 0.0)
        return np.asarray(ops.trace.multiply(ops.trace) @ inverse)

    def __matmul__(self, force: Array) -> Array:
        """Accelerations (n_channel,) or (n_channel, m) under nodal forces on the channels."""
        ops, columns = self._operators, force.reshape(len(force), -1)
        spread = np.zeros((ops.mass.shape[0], columns.shape[1]))
        spread[ops.dofs] = ops.spread @ columns
        acceleration: Array = ops.trace @ self._factor.solve(spread)[ops.dofs]
        return acceleration.reshape(force.shape)


def applied(factor: CholeskyFactor, trace: sp.csr_array, gain: float, force: Array) -> Array:
    """``gain`` T A^-1 T^T times forces (n_channel,) or (n_channel, m), A of the factor."""
    columns = force.reshape(len(force), -1)
    velocity: Array = gain * (trace @ factor.face_solve(np.asarray(trace.T @ columns)))
    return velocity.reshape(force.shape)


class DashpotPattern:
    """Pattern of A with T^T diag(.) T on it, and the sums of matrices on it, for one model.

    Attributes
    ----------
    rank : (n,) elimination order, interface nodes last in their parts, or None. on_interface : (n, n) pattern of T^T T.
    """

    def __init__(self, model: SubstructureModel) -> None:
        if model.mass is None:
            matrices = [model.reduced_stiffness]
        else:
            matrices = operator_matrices(model)
        self.store = model.store
        self._matrices = matrices
        self._trace = model.reduced_trace
        size = sp.csr_array((np.ones(self._trace.nnz), self._trace.indices, self._trace.indptr), self._trace.shape)
        self.on_interface = sp.csr_array(size.T @ size)  # as entries of T^T T may cancel
        self.on_interface.sort_indices()
        # counted from 1: entries that are 0 would vanish from products
        self._numbers = with_data(self.on_interface, np.arange(1.0, self.on_interface.nnz + 1))
        self._pattern = OperatorPattern([*matrices, self.on_interface])
        self._dofs, _, rank = model.at_interface
        self.rank = None
        if rank is not None:
            self.rank = interface_last(rank, model.reduced_parts, self._dofs)

    @cached_property
    def symbolic(self) -> Symbolic:
        """Pattern of the factor, interface dofs its face."""
        # factors of 1: their pattern alone is read
        some = self.sum([1.0] * len(self._matrices))
        return shared_analysis(Pattern(some, NONE, self.rank, self._dofs, self.store))

    def factor(self, factors: Sequence[float], dashpots: Array, dtype: Any) -> CholeskyFactor:
        """Factor of ``sum``, interface dofs its face."""
        matrix = self.sum(factors, dashpots)
        return CholeskyFactor(matrix, NONE, None, np.dtype(dtype), self.symbolic, self._dofs, self.store)

    def sum(self, factors: Sequence[float], dashpots: Array | None = None) -> sp.csr_array:
        """Sum of factors times M, K and C, where there are (without inertia K alone), plus T^T diag(``dashpots``) T for
        (n_channel,) numbers."""
        values = np.zeros(self.on_interface.nnz)
        if dashpots is not None:
            part = sp.csr_array(self._trace.T @ sp.diags_array(dashpots) @ self._trace)
            part.sort_indices()
            # both sorted: entry e of ``at`` is the place of entry e of ``part``
            at = self._numbers.multiply(with_data(part, np.ones(part.nnz))).tocsr()
            at.sort_indices()
            values[at.data.astype(np.int64) - 1] = part.data
        return self._pattern.sum([*factors, 1.0], [*self._matrices, with_data(self.on_interface, values)])


def interface_last(rank: Array, parts: Array | None, dofs: Index) -> Array:
    """Elimination order (n,) with the nodes of the interface ``dofs`` last among those of equal ``parts``; dofs of a
    node have equal ranks, before and after."""
    if parts is None:
        return rank
    values, first, node = np.unique(rank, return_index=True, return_inverse=True)
    late = np.zeros(len(values), dtype=bool)
    late[node[dofs]] = True
    turned = np.empty(len(values))
    # the last key first: by part, in it the interface last, else as before
    turned[np.lexsort((values, late, parts[first]))] = np.arange(len(values))
    order: Array = turned[node]
    return order
