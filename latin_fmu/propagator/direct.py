"""Direct implicit propagator: one forward and one backward substitution per instant, contact in between.

The operator A = M + (1 + alpha)(gamma dt C + beta dt^2 K) is factorised once per class and step, interface dofs last;
identical substructures are members of one class and are solved together.

Where the factor does not fit in memory: conjugate gradients with the interface dofs last.

The half solves of ``condensed`` with A_II^-1 replaced by conjugate gradients, preconditioned by the diagonal. For the
operator of a march, M + c dt^2 K, the number of iterations grows with the step over the time a wave needs for an
element, not with the mesh. What is kept is the matrix and the dense Schur complement of the interface.

Two solutions per instant, each from zero: nothing depends on the instants before, a restart is bit for bit the same.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from ..cholesky.factor import CholeskyFactor, LowRankFactor, StiffenedFactor
from ..errors import SolverError
from ..time_scheme import TimeScheme
from .base import MassFactor, Propagator
from .interface_matrices import projected, with_dashpots
from .interface_sweeps import DashpotPattern, InterfaceCompliance
from .model import (
    Array,
    FaceStiffness,
    Index,
    Operators,
    SubstructureModel,
    operator_factors,
    operator_matrices,
    operator_weights,
)

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
        # squared; each column has a limit of its own
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
            # columns that have converged stand still while others go on
            alpha = np.divide(rz, curvature, out=np.zeros_like(rz), where=active & (curvature > 0))
            x += alpha * p
            r -= alpha * ap
            z = self._inverse * r
            new = np.einsum("nm,nm->m", r, z)
            p = z + np.divide(new, rz, out=np.zeros_like(rz), where=active & (rz > 0)) * p
            rz = new
        raise SolverError(
            f"conjugate gradients: not converged to {self.tolerance:g} in {_MOST} iterations; use smaller steps, or "
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
            if len(last):
                inverse = la.cho_solve(la.cho_factor(self.schur), np.eye(len(last)))
            else:
                inverse = schur
        except la.LinAlgError:
            raise SolverError(
                "conjugate gradients: the matrix of a step is singular to rounding errors (its inertia is lost beside "
                "the stiffness); use smaller steps, or the direct propagator"
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


@dataclass(frozen=True)
class ImplicitOperators(Operators):
    """Operators of one class at one time step; ``factor`` : of A.

    gain : velocities of the interface dofs per S^-1 times force, of the time scheme. modal : R (k, n) of modal damping
        R^T R, beside ``damping``. face : stiffness and damping of the interface dofs beside the matrices.
    with_dashpots : of a swept class its factor for dashpots (n_channel,), N s m-1, in the numbers of a type.
    """

    gain: float
    modal: Array | None = None
    face: FaceStiffness | None = None
    with_dashpots: Callable[[Array, Any], CholeskyFactor] | None = None


def build_operators(model: SubstructureModel, scheme: TimeScheme, dt: float) -> ImplicitOperators:
    """Factorise and condense (once per class and time step)."""
    mass, damping, stiffness = model.reduced
    dofs, trace, rank = model.at_interface
    modal = None
    if model.modal_rows is not None:
        modal = np.ascontiguousarray(model.modal_rows @ model.expansion)
    c_mass, c_damping, c_stiffness = operator_weights(model, scheme, dt)
    factors = operator_factors(model, scheme, dt)
    # accelerations of interface dofs are w_t S^-1 times the forces, W follows by dW/da
    gain = scheme.interface_gain(dt) * scheme.traction_weight
    on_dashpots: Callable[[Array, Any], CholeskyFactor] | None = None
    factor: Any
    compliance: Any
    if model.face is not None:
        weights = c_mass, c_damping, c_stiffness
        factor = _with_face(model, model.face, weights, modal, model.face.stiffening(scheme, dt))
        compliance = projected(trace, gain, factor.schur_inverse)
    elif model.swept:
        pattern = DashpotPattern(model)
        # with zeros where the dashpots come: one analysis serves both factors
        factor = pattern.factor(factors, np.zeros(len(model.channel_area)), model.factor)
        compliance = InterfaceCompliance(factor, dofs, trace, gain, pattern)

        def on_dashpots(dashpots: Array, dtype: Any) -> CholeskyFactor:
            return pattern.factor(factors, gain * dashpots, dtype)

    else:
        matrix = model.operator_pattern.sum(factors, operator_matrices(model))
        if model.factor == "cg":
            factor = IterativeFactor(matrix, dofs)
        else:
            factor = CholeskyFactor(matrix, dofs, rank, np.dtype(model.factor), store=model.store)
        if modal is not None:
            factor = LowRankFactor(factor, np.sqrt(c_damping) * modal)
        compliance = projected(trace, gain, factor.schur_inverse)
    area, massless = model.channel_area, model.massless
    if modal is not None and damping is None:
        # kernels take products with the damping where it has rows
        damping = sp.csr_array(mass.shape)
    same = (mass, damping, stiffness, factor, dofs, trace, model.spread, area, compliance, massless)
    return ImplicitOperators(*same, gain, modal, model.face, on_dashpots)


def _with_face(
    model: SubstructureModel,
    face: FaceStiffness,
    weights: tuple[float, float, float],
    modal: Array | None,
    stiffening: tuple[Array, float],
) -> CholeskyFactor:
    """Factor of the operator of a model with a stiffness of its interface dofs beside its matrices; ``stiffening`` : as
    by ``FaceStiffness.stiffening``."""
    (mass, damping, stiffness), dofs = model.reduced, model.at_interface[0]
    c_mass, c_damping, c_stiffness = weights
    matrix = c_mass * mass + c_stiffness * stiffness
    if damping is not None:
        matrix = matrix + c_damping * damping
    squares = np.sqrt(c_stiffness * stiffening[0])[:, None] * face.rows
    if modal is not None:
        squares = np.vstack([squares, np.sqrt(c_damping) * modal])
    # rows of the inside alone: what is left among interface dofs goes to the Schur complement
    rows = squares.copy()
    rows[:, dofs] = 0.0
    coupling = rows.T @ squares
    coupling[dofs] = coupling[:, dofs].T
    among = (c_stiffness * stiffening[1] + c_damping * face.viscosity) * face.matrix + squares[:, dofs].T @ squares[
        :, dofs
    ]
    return StiffenedFactor(sp.csr_array(matrix + coupling), dofs, among)


_HEAVY = 1e30


class DirectPropagator(Propagator):
    """March of a class of identical substructures (``base``).

    Parameters
    ----------
    twin : propagator of other substructures with the same operators and scheme, to share them; the others as for
        ``Propagator``.
    """

    operators: ImplicitOperators

    def __init__(
        self,
        members: Sequence[SubstructureModel],
        scheme: TimeScheme,
        dt: float,
        energy: bool,
        twin: DirectPropagator | None = None,
    ) -> None:
        operators = None
        if twin is not None:
            operators = twin._operators_by_step
        super().__init__(members, scheme, dt, energy, operators)

    def _build(self, dt: float) -> ImplicitOperators:
        return build_operators(self.members[0], self.scheme, dt)

    def internal_forces(self) -> tuple[Array, Array]:
        """K u and C v of the free dofs, (n_dof, n_member), N."""
        ops, state = self.operators, self.state
        elastic, viscous = np.zeros_like(state.u), np.zeros_like(state.u)
        if state.u.any():
            elastic = ops.stiffness @ state.u
        if ops.damping is not None and state.v.any():
            viscous = ops.damping @ state.v
        if ops.modal is not None and state.v.any():
            viscous = viscous + ops.modal.T @ (ops.modal @ state.v)
        if ops.face is not None:
            elastic = elastic + ops.face.stiffness(state.u, ops.dofs)
            viscous = viscous + ops.face.damping(state.v, ops.dofs)
        return elastic, viscous

    def mass_factor(self) -> MassFactor:
        """Factor of M: needed once, where the start is not balanced."""
        mass = self.operators.mass
        if self.operators.massless.size:  # they start without acceleration
            heavy = np.zeros(self.n_dof)
            heavy[self.operators.massless] = _HEAVY * mass.diagonal().max()
            mass = mass + sp.diags_array(heavy)
        return spla.splu(sp.csc_matrix(mass), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})

    def _condense(self, k: Array) -> Array | CholeskyFactor:
        ops = self.operators
        if ops.with_dashpots is not None:
            return ops.with_dashpots(ops.area * k, "float32" if self.single else self.members[0].factor)
        store = self.members[0].store
        factor = ops.factor
        dashpots = ops.area * k
        name = store.name("dashpots", ops.trace, ops.gain, factor.schur, dashpots)
        arrays = store.remember(name, lambda: {"y": with_dashpots(ops.trace, ops.gain, factor.schur, dashpots)})
        return arrays["y"]


class CgPropagator(DirectPropagator):
    """March of a class of identical substructures; every solution by conjugate gradients."""

    def __init__(self, members: Sequence[SubstructureModel], scheme: TimeScheme, dt: float, energy: bool) -> None:
        super().__init__([m.with_factor("cg") for m in members], scheme, dt, energy)

    def mass_factor(self) -> ConjugateGradients:
        """Solver with the mass matrix, by conjugate gradients."""
        mass = self.operators.mass
        if self.operators.massless.size:  # they start without acceleration
            # M alone is singular there; so heavy a dof stays without acceleration
            heavy = mass.diagonal().max() * 1e30
            mass = sp.csr_array(mass + sp.diags_array(heavy * (mass.diagonal() <= 0.0)))
        return ConjugateGradients(mass)
