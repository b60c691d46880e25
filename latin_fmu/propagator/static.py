"""Propagator without inertia: one equilibrium per increment of load, on the springs of the search direction.

With W = T (u_{n+1} - u_n) / dt and the linear stage F = q - k W, (12)-(14) without mass read

    (K + T^T a k/dt T) (u_{n+1} - u_n) = f_{n+1} - K u_n + T^T a q

whose operator is regular for a floating body too. The whole load f_{n+1} is balanced at every increment, so that the
residual of one increment is not carried on. An instant ends with the incoming quantity q: tractions alone do not
determine the place of a floating body. The steps stand in ``kernels.substructure``.

K alone is singular where a body floats. The factor is that of K with springs k_0 on the interface,

    A = K + T^T a k_0 T

(T from dofs to channels, a their areas, k_0 a stiffness of the body's own size): T reaches the interface dofs only, so
that the inside is eliminated as in K and springs of any other size follow from the dense matrix left on the interface,

    S(k) = S(k_0) + T^T a (k - k_0) T.

Neither depends on the time step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NoReturn

import numpy as np
import scipy.linalg as la
import scipy.linalg.lapack as lapack
import scipy.sparse as sp
from numpy.typing import NDArray

from ..cholesky.factor import CholeskyFactor, InterfaceFactor
from ..operator_store import NO_STORE, OperatorStore
from ..time_scheme import QuasiStatic
from .base import Propagator
from .interface_matrices import STILL
from .interface_sweeps import DashpotPattern, InterfaceCompliance
from .model import Array, Index, SubstructureModel

_POINTS = 1.5  # factor on the geometric mean of the stiffness of a body as a whole and at one point


def without_round_off(values: Array) -> Array:
    """Entries that are round-off of the largest of their substructure (held directions) become 0."""
    return np.where(values > 1e-12 * values.max(initial=0.0), values, 0.0)


@dataclass(frozen=True)
class StaticOperators:
    """Reduced stiffness, its factor and the compliance at the interfaces, for one length of increment.

    Attributes
    ----------
    stiffness : reduced (n, n), N m-1. factor : of K with springs, interface dofs last. dofs : (n_gamma,) interface
        dofs. trace : (n_channel, n_gamma) from interface dofs to channels. spread : its transpose.
    area : (n_channel,), m2.
    springs : (n_channel,) k_0, Pa m-1. direction : (n_channel,) stiffness per area of the search direction, Pa m-1.
    compliance : (n_channel, n_channel) velocities of the channels per unit of nodal force, m s-1 N-1, of the body on
        its springs: D of one instant does not exist for a floating body, (D^-1 + k_0)^-1 always does.
    factor_on : of a swept class, its factor on other springs (n_channel,), Pa m-1. store : of dense inverses.
    """

    stiffness: sp.csr_array
    factor: InterfaceFactor
    dofs: Index
    trace: sp.csr_array
    spread: sp.csr_array
    area: Array
    springs: Array
    direction: Array
    compliance: Any
    factor_on: Callable[[Array], CholeskyFactor] | None = None
    store: OperatorStore = NO_STORE

    @property
    def massless(self) -> Index:
        """Dofs without mass: none is marked."""
        return np.zeros(0, dtype=np.int64)

    @property
    def admittance(self) -> Array:
        """Velocities of the channels per unit of traction, on the springs, m3 N-1 s-1."""
        admittance: Array = self.compliance * self.area
        return admittance

    def on_springs(self, k: Array) -> Array:
        """(S + T^T a k T)^-1 for springs k (n_channel,), Pa m-1: displacements of the interface dofs, m N-1.

        Raises
        ------
        numpy.linalg.LinAlgError : springs that leave the body free to move.
        """
        if not len(self.dofs):
            return np.zeros((0, 0))
        # S holds springs k_0 already
        shift = sp.csr_array(self.trace.T @ sp.diags_array(self.area * (k - self.springs)) @ self.trace)
        name = self.store.name("springs", self.factor.schur, shift)
        return self.store.remember(name, lambda: {"inverse": self._inverse(shift)})["inverse"]

    def _inverse(self, shift: sp.csr_array) -> Array:
        """(S + shift)^-1."""
        # a symmetric matrix transposed is in the order of LAPACK, without a copy
        root, info = lapack.dpotrf((self.factor.schur + shift.toarray()).T, lower=0, overwrite_a=1)
        if info:
            raise la.LinAlgError("springs that leave the body free to move")
        half, _ = lapack.dpotri(root, lower=0, overwrite_c=1)  # one triangle, zeros in the other
        inverse: Array = half + half.T
        # the diagonal is in both
        inverse[np.diag_indices_from(inverse)] *= 0.5
        return inverse


class _Moving:
    """Which channels (n_channel,) can move, in the place of their compliance, which nothing reads."""

    def __init__(self, moves: NDArray[np.bool_], gain: float) -> None:
        self._moves, self.gain = moves, gain

    def diagonal(self) -> Array:
        """1 where a channel can move, else 0."""
        return self._moves.astype(float)

    def __mul__(self, factor: float) -> _Moving:
        """The same for another length of increment."""
        return _Moving(self._moves, factor * self.gain)


def build_joined_operators(model: SubstructureModel, springs: Array, dt: float) -> StaticOperators:
    """Operators of an assembly that is one model: its factor on the ``springs`` (n_channel,), Pa m-1, of the search
    direction itself, which are those of single points, and of a swept model nothing more."""
    area = model.channel_area
    dofs, trace, _ = model.at_interface
    moves = np.diff(trace.indptr) > 0
    direction, factor_on = np.where(moves, springs, 0.0), None
    factor: Any
    compliance: Any
    if model.swept:
        factor_on = _factors(model, DashpotPattern(model))
        factor, compliance = factor_on(springs), _Moving(moves, 1.0 / dt)
    else:
        factor, compliance = _dense(model, springs, dt)
    same = (model.reduced_stiffness, factor, dofs, trace, model.spread, area, springs, direction, compliance)
    return StaticOperators(*same, factor_on, model.store)


def _factors(model: SubstructureModel, pattern: DashpotPattern) -> Callable[[Array], CholeskyFactor]:
    """Factors of a swept model on springs (n_channel,), Pa m-1, of one ``pattern``."""
    return lambda springs: pattern.factor([1.0], model.channel_area * springs, np.float64)


def _dense(model: SubstructureModel, springs: Array, dt: float) -> tuple[CholeskyFactor, Array]:
    """Factor on springs (n_channel,), Pa m-1, interface dofs last, and the compliance of the channels on them."""
    _, trace, rank = model.at_interface
    dofs, whole = model.at_interface[0], sp.csc_array(model.reduced_trace)
    support = sp.csr_array(whole.T @ sp.diags_array(model.channel_area * springs) @ whole)
    factor = CholeskyFactor(sp.csr_array(model.reduced_stiffness + support), dofs, rank, store=model.store)
    dense = trace @ (trace @ factor.schur_inverse).T / dt
    return factor, 0.5 * (dense + dense.T)


def build_static_operators(model: SubstructureModel, springs: Array, dt: float) -> StaticOperators:
    """Reduce, factorise and condense (once per class); ``springs`` (n_channel,), Pa m-1.

    The search direction is 1.5 sqrt(k_0 S_ii): k_0 the stiffness of the body as a whole (soft, for loads that cross
    it), S_ii that of one point (stiff, for what stays near the face), with the others held, or of a swept class with
    the others on the springs, which is at hand and takes as many iterations.
    """
    stiffness, area = model.reduced_stiffness, model.channel_area
    dofs, trace, _ = model.at_interface
    factor_on: Callable[[Array], CholeskyFactor] | None = None
    factor: Any
    if model.swept:
        pattern = DashpotPattern(model)
        factor_on = _factors(model, pattern)
        factor = factor_on(springs)
        compliance: Any = InterfaceCompliance(factor, dofs, trace, 1.0 / dt, pattern)
        alone = dt * area * compliance.diagonal()
        local = np.divide(1.0, alone, out=np.zeros_like(alone), where=alone > STILL * alone.max(initial=0.0))
    else:
        factor, compliance = _dense(model, springs, dt)
        # rows of T S T^T on themselves, without the springs k_0 in S
        local = np.einsum("ij,ij->i", trace @ factor.schur, trace.toarray()) / area - springs
    moves = np.diff(trace.indptr) > 0
    local = without_round_off(np.where(moves, np.maximum(local, springs), 0.0))  # a rigid body has none of its own
    direction = _POINTS * np.sqrt(springs * local)
    same = (stiffness, factor, dofs, trace, model.spread, area, springs, direction, compliance)
    return StaticOperators(*same, factor_on, model.store)


class StaticPropagator(Propagator):
    """Equilibria of a class of identical substructures (module docstring).

    Parameters
    ----------
    members : models with equal matrices and traces. dt : length of the increments, s (``begin`` may change it).
    energy : whether to account for energies. springs : (n_channel,) stiffness per area of the body's own size, Pa m-1.
    operators : of equal models, used again and added to. joined : whether this is a whole assembly
    (``build_joined_operators``).

    Attributes
    ----------
    spring_inverse : (S + T^T a k/dt T)^-1 for the k of the last ``bind``, (n_gamma, n_gamma), m N-1.
    """

    operators: StaticOperators

    def __init__(
        self,
        members: Sequence[SubstructureModel],
        dt: float,
        energy: bool,
        springs: Array,
        operators: list[tuple[float, Any]] | None = None,
        joined: bool = False,
    ) -> None:
        self._springs, self.joined = springs, joined
        super().__init__(members, QuasiStatic(), dt, energy, operators)
        self._spring_inverse = self.operators.factor.schur_inverse  # on the springs, until ``bind``

    @property
    def spring_inverse(self) -> Array:
        """(S + T^T a k/dt T)^-1 for the k of the last ``bind``, (n_gamma, n_gamma), m N-1."""
        _ = self.condensed  # leaves it behind
        return self._spring_inverse

    def shared(self, springs: Array) -> list[tuple[float, Any]] | None:
        """Operators of this propagator for others of equal models, None where their springs (n_channel,) differ."""
        if np.array_equal(self._springs, springs):
            return self._operators_by_step
        return None

    def _build(self, dt: float) -> StaticOperators:
        """One factor serves every length of increment."""
        if not self._operators_by_step:
            if self.joined:
                build = build_joined_operators
            else:
                build = build_static_operators
            return build(self.members[0], self._springs, dt)
        step, operators = self._operators_by_step[-1]
        assert isinstance(operators, StaticOperators)
        # velocities per force are as 1 / dt
        return replace(operators, compliance=operators.compliance * (step / dt))

    def internal_forces(self) -> NoReturn:
        """Refused: at t = 0 nothing acts but what is in equilibrium."""
        raise TypeError("no inertia: a quasi-static substructure starts in equilibrium")

    def start(self, traction: Array, factor: object, round_off: Array | float = 0.0) -> None:
        """Equilibrium at t = 0: displacements as they are, no velocity."""

    def mass_factor(self) -> NoReturn:
        """Refused: a model without inertia has no mass."""
        raise TypeError("no inertia: a quasi-static substructure has no mass")

    def _condense(self, k: Array) -> Array | CholeskyFactor:
        """Y = T (S + T^T a k/dt T)^-1 T^T / dt."""
        ops = self.operators
        if self.joined and np.allclose(k / self.dt, ops.direction, rtol=1e-12, atol=0.0):
            # made on these springs
            assert isinstance(ops.factor, CholeskyFactor)
            if ops.factor_on is not None:
                return ops.factor
            self._spring_inverse = ops.factor.schur_inverse
            compliance: Array = ops.compliance
            return compliance
        if ops.factor_on is not None:
            return ops.factor_on(k / self.dt)
        trace = self.operators.trace
        self._spring_inverse = self.operators.on_springs(k / self.dt)
        condensed: Array = trace @ (trace @ self._spring_inverse).T / self.dt
        return 0.5 * (condensed + condensed.T)
