"""Explicit propagator: central differences with a lumped mass; no factor, D diagonal but for damping and ties.

One instant is one product with K. The interface velocity is v_{n+1}, D = dt T (M + dt/2 C_d)^-1 T^T with C_d the
lumped part of the damping, so that with k = 1 / D_ii the iteration needs one pass (``time_scheme.central_difference``
has the equations, ``stable_step`` the longest step).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from ..errors import SolverError
from ..time_scheme import TimeScheme
from .cholesky import InterfaceFactor, interface_factor
from .condensed import Index
from .diagonal import DiagonalFactor
from .explicit_energy import ExplicitMeter
from .interface_matrices import seen_by_channels, seen_of_diagonal
from .lumping import lumped
from .march import March
from .model import Array, Histories, SubstructureModel
from .protocol import MassFactor
from .resumable import Motion
from .stable_step import StableStep

_NONE = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True)
class ExplicitOperators:
    """Operators of one class at one time step; the mass is lumped.

    Attributes
    ----------
    inverse : (M + dt/2 C_d)^-1, (n, n), None where it is diagonal. diagonal : its diagonal (n,), None where there is
        more to it. dofs : all where it is diagonal, else those of the interface. The others : see ``Operators``.
    """

    inverse: sp.csr_array | None
    diagonal: Array | None
    mass: sp.csr_array
    damping: sp.csr_array | None
    stiffness: sp.csr_array
    factor: InterfaceFactor
    dofs: Index
    trace: sp.csr_array
    spread: sp.csr_array
    area: Array
    compliance: Array
    massless: Index

    @property
    def admittance(self) -> Array:
        """T D T^T diag(area)."""
        return self.compliance * self.area

    def accelerate(self, force: Array) -> Array:
        """(M + dt/2 C_d)^-1 f for f (n, m)."""
        if self.diagonal is not None:
            return self.diagonal[:, None] * force
        solved: Array = self.inverse @ force  # type: ignore[operator]  # there is one or the other
        return solved


def _lumped_damping(model: SubstructureModel, damping: sp.csr_array) -> sp.csr_array:
    """Row sums of the damping over the nodes, unless the model has better ones."""
    return lumped(damping, nodal=True) if model.lumped_damping is None else model.lumped_damping


class ExplicitPropagator(March[ExplicitOperators]):
    """March of a class of identical substructures by central differences (module docstring).

    Parameters
    ----------
    members : models with equal matrices and traces. scheme : central differences. dt : step, s. energy : whether to
        account for energies.

    Attributes
    ----------
    stability : which steps are stable.
    """

    def __init__(
        self, members: Sequence[SubstructureModel], scheme: TimeScheme, dt: float, energy: bool
    ) -> None:
        rigid = members[0].nodal is not None  # a few unknowns, no stiffness: taken as they are
        if not rigid:
            first = members[0].with_lumped_mass
            members = [first, *(m.with_mass(first.inertia) for m in members[1:])]
        model, p = members[0], members[0].expansion
        self._mass, self._damping, self._stiffness = model.reduced
        self._dashpots: sp.csr_array | None = None
        lagged: sp.csr_array | None = None
        if model.damping is not None and self._damping is not None:
            self._dashpots = model.damping if rigid else _lumped_damping(model, model.damping)
            lagged = sp.csr_array(self._damping - p.T @ self._dashpots @ p)
        nothing = np.zeros(0)  # a rigid body has no stiffness
        self.stability = StableStep(
            nothing if rigid else self._mass.diagonal(), self._stiffness, None if rigid else lagged
        )
        super().__init__(members, scheme, dt, None)
        if energy:
            self.meter = ExplicitMeter(self.members, self.forcing, self._dashpots)
        self._free: tuple[Array, Array] | None = None

    def begin(self, histories: Sequence[Histories], dt: float) -> None:
        """See ``Propagator``.

        Raises
        ------
        SolverError : the step is not stable.
        """
        if not self.stability.allows(dt):
            raise SolverError(
                f"explicit propagator, {', '.join(self.names)}: step {dt:.6g} s; allowed: at most "
                f"{self.stability.longest:.6g} s, the stable one; take smaller steps, or an implicit propagator"
            )
        super().begin(histories, dt)
        self._free = None

    def _build(self, dt: float) -> ExplicitOperators:
        model, held = self.members[0], self._mass
        if self._dashpots is not None:
            p = model.expansion
            held = sp.csr_array(held + 0.5 * dt * (p.T @ self._dashpots @ p))
            held.eliminate_zeros()
        same = (self._mass, self._damping, self._stiffness)
        if held.nnz == held.shape[0]:
            factor = DiagonalFactor(held.diagonal())
            trace, spread, inverse = model.reduced_trace, model.reduced_spread, factor.inverse
            compliance = seen_of_diagonal(trace, dt, inverse)
            return ExplicitOperators(
                None,
                inverse,
                *same,
                factor,
                factor.last,
                trace,
                spread,
                model.channel_area,
                compliance,
                _NONE,
            )
        dofs, trace, _ = model.at_interface
        full = sp.csr_array(spla.inv(sp.csc_matrix(held)))
        compliance = seen_by_channels(trace, dt, full[dofs][:, dofs].toarray())
        return ExplicitOperators(
            full, None, *same, interface_factor(held, dofs), dofs, trace, model.spread, model.channel_area,
            compliance, _NONE,
        )  # fmt: skip

    @property
    def compiles(self) -> bool:
        """Where nothing is driven."""
        return not self.forcing.moves

    # -- start ------------------------------------------------------------------------------------------------
    def initial_unbalance(self, traction: Array) -> Array:
        """M a of the free dofs at t = 0 (the masses of driven dofs are their own)."""
        unbalance: Array = self.forcing.at(0)
        if self.state.u.any():
            unbalance -= self._stiffness @ self.state.u
        if traction.any():
            unbalance += self._nodal(traction)
        if self._damping is not None and self.state.v.any():
            unbalance -= self._damping @ self.state.v
        return unbalance

    def mass_factor(self) -> MassFactor:
        """Solver with M."""
        return spla.splu(sp.csc_matrix(self._mass))

    def initial_channels(self, factor: MassFactor, unbalance: Array) -> tuple[Array, Array]:
        """Channel accelerations at t = 0, and T M^-1 T^T."""
        ops = self.operators
        spread = np.zeros((self.n_dof, self.n_channel))
        spread[ops.dofs] = ops.trace.T.toarray()
        compliance: Array = ops.trace @ factor.solve(spread)[ops.dofs]
        free = self._at(ops.dofs, factor.solve(unbalance), self.forcing.channel_acceleration(0))
        return free, compliance

    # -- one instant ------------------------------------------------------------------------------------------
    def predict(self) -> Array:
        """Free response of the next instant; W_0 (n_channel, n_member), m s-1."""
        ops, state, forcing = self.operators, self.state, self.forcing
        x = state.u + 0.5 * self.dt * state.v
        force = 0.5 * (forcing.loads(state.instant) + forcing.loads(state.instant + 1))
        force -= self._internal_driven(x) if forcing.moves else self._internal(x)
        v = state.v + self.dt * ops.accelerate(force)
        self._free = (x, v)
        return self._with_dashpots(self._at(ops.dofs, v, forcing.channel_velocity(state.instant + 1)))

    def _internal(self, x: Array) -> Array:
        """K x + C v of the free dofs."""
        force: Array = self._stiffness @ x
        if self._damping is not None:
            force += self._damping @ self.state.v
        return force

    def _internal_driven(self, x: Array) -> Array:
        """The same where some dofs are driven: from the full fields."""
        model, forcing, i = self.members[0], self.forcing, self.state.instant
        p, v_old = model.expansion, forcing.imposed_v(i)
        force: Array = model.stiffness @ (p @ x + forcing.imposed_u(i) + 0.5 * self.dt * v_old)
        if model.damping is not None:
            force += model.damping @ (p @ self.state.v + v_old)
        if self._dashpots is not None:
            force += self._dashpots @ (0.5 * (forcing.imposed_v(i + 1) - v_old))
        reduced: Array = p.T @ force
        return reduced

    def commit(self, traction: Array, account: bool = True) -> None:
        """End the instant with channel tractions (n_channel, n_member), Pa; ``account``: count its energy."""
        assert self._free is not None, "commit without predict"
        ops, state = self.operators, self.state
        x, v = self._free
        if ops.diagonal is not None:
            v = v.copy()
            v[ops.dofs] += (self.dt * ops.diagonal[ops.dofs])[:, None] * self._interface_force(traction)
        else:
            v = v + self.dt * ops.accelerate(self._nodal(traction))
        self.state = Motion(
            state.instant + 1, x + 0.5 * self.dt * v, v, (v - state.v) / self.dt, state.residual
        )
        self._free = None
        if self.meter is not None and account:
            self.meter.advance(self.state, self._nodal(traction))
