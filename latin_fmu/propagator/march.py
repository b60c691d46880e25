"""What explicit and reduced propagators share: members, forcing, search direction, snapshots, reading of the state.

A propagator made from it keeps its motion in arrays (n_dof, n_member) that are never changed in place, and says how
its operators are built, how an instant is predicted and how it is ended.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
import scipy.sparse as sp

from ..time_scheme import TimeScheme
from .condensed import Index
from .forcing import Forcing
from .interface_matrices import condensed
from .model import Array, Histories, SubstructureModel
from .protocol import InterfaceOperators, MassFactor
from .resumable import Meter, Motion, Resumable

_STEPS_KEPT = 4


class MarchOperators(InterfaceOperators, Protocol):
    """Operators with the trace from interface dofs to channels."""

    @property
    def trace(self) -> Any:
        """(n_channel, n_gamma), sparse or dense."""
        ...


Ops = TypeVar("Ops", bound=MarchOperators)


class March(Resumable, ABC, Generic[Ops]):
    """March of a class of identical substructures (module docstring; rules in ``protocol``).

    Parameters
    ----------
    members : models with equal matrices and traces. scheme, dt : time scheme and step, s. meter : account of energies.
    """

    dt: float
    operators: Ops

    def __init__(
        self, members: Sequence[SubstructureModel], scheme: TimeScheme, dt: float, meter: Meter | None
    ) -> None:
        self.members = list(members)
        self.names = [m.name for m in members]
        self.scheme, self.meter = scheme, meter
        self.forcing = Forcing(members, scheme)
        self._kept: list[tuple[float, Ops]] = []
        self._use(dt)

    @abstractmethod
    def _build(self, dt: float) -> Ops:
        """Operators for a step."""

    @abstractmethod
    def initial_unbalance(self, traction: Array) -> Array:
        """M a of the free dofs at t = 0 under tractions (n_channel, n_member); (n_dof, n_member), N."""

    @abstractmethod
    def mass_factor(self) -> MassFactor:
        """Solver with M."""

    @abstractmethod
    def predict(self) -> Array:
        """Free response of the next instant; W_0 (n_channel, n_member), m s-1."""

    @abstractmethod
    def commit(self, traction: Array, account: bool = True) -> None:
        """End the instant with channel tractions (n_channel, n_member), Pa; ``account``: count its energy."""

    # -- time -------------------------------------------------------------------------------------------------
    def _use(self, dt: float) -> None:
        """Operators for the step dt: a few are kept for use again."""
        if self._kept and self.dt == dt:
            return
        found = next((operators for known, operators in self._kept if known == dt), None)
        if found is None:
            found = self._build(dt)
            self._kept = [*self._kept[-_STEPS_KEPT + 1 :], (dt, found)]
        self.dt, self.operators = dt, found
        self.k: Array = np.zeros((self.n_channel, 1))
        # Y per force instead of traction: symmetric; for k = 0 until ``bind``
        self.condensed: Array = found.compliance
        self._response: Array | None = None

    def begin(self, histories: Sequence[Histories], dt: float) -> None:
        """Set the histories of a run, or of the segment that goes on from the present state."""
        if self._begun:
            motions = self.forcing.end(self.state.instant) if self._resumed is None else self._resumed
            self.forcing.resume(motions)
            self._resumed = None
        self._use(dt)
        self.forcing.begin(histories, dt)
        if self.meter is not None:
            self.meter.dt = dt
        self.state = replace(self.state, instant=0) if self._begun else self._initial()
        self._begun = True

    def _initial(self) -> Motion:
        """Initial values; accelerations come with ``start``."""
        if not any(m.displacement.any() or m.velocity.any() for m in self.members) and not self.forcing.moves:
            return Motion(0, *np.zeros((4, self.n_dof, len(self.members))))
        p = self.members[0].expansion
        share = sp.csr_array(p.T.multiply(1 / np.maximum(p.sum(axis=0), 1)[:, None]))
        u = share @ (np.stack([m.displacement for m in self.members], axis=1) - self.forcing.imposed_u(0))
        v = share @ (np.stack([m.velocity for m in self.members], axis=1) - self.forcing.imposed_v(0))
        return Motion(0, u, v, np.zeros_like(u), np.zeros_like(u))

    def start(self, traction: Array, factor: MassFactor | None) -> None:
        """Consistent accelerations at t = 0 with tractions, Pa; ``factor`` None for a start at rest in equilibrium."""
        unbalance = self.initial_unbalance(traction)
        inertia = self.forcing.inertia(0)
        residual = unbalance if inertia is None else unbalance + inertia
        a = np.zeros_like(unbalance) if factor is None else factor.solve(unbalance)
        self.state = replace(self.state, a=a, residual=residual)
        if self.meter is not None:
            self.meter.start(self.state, self._nodal(traction))

    @property
    def compiles(self) -> bool:
        """Whether the compiled march knows this propagator: operators like ``Operators``, steps like the direct one."""
        return False

    # -- sizes and search direction ---------------------------------------------------------------------------
    @property
    def n_channel(self) -> int:
        """Interface channels of one member."""
        return int(self.operators.area.size)

    @property
    def n_dof(self) -> int:
        """Unknowns of one member."""
        return int(self.members[0].expansion.shape[1])

    def bind(self, k: Array) -> None:
        """Search direction k (n_channel,), Pa s m-1: Y = (1 + C a k)^-1 C a, symmetrised through sqrt(a k)."""
        if np.array_equal(k, self.k[:, 0]):
            return
        ops = self.operators
        self.k, self._response = k[:, None], None
        self.condensed = condensed(ops.compliance, ops.area * k)

    @property
    def response(self) -> Array:
        """Y for the k of the last ``bind`` (0 before)."""
        if self._response is None:
            self._response = self.condensed * self.operators.area
        return self._response

    def respond(self, w_0: Array, q: Array) -> Array:
        """W = W_0 + Y q, (n_channel, n_member)."""
        answer: Array = w_0 + self.response @ q
        return answer

    def _with_dashpots(self, velocity: Array) -> Array:
        """W_0 from the free velocity of the channels: v - Y k v."""
        w_0: Array = velocity - self.response @ (self.k * velocity)
        return w_0

    def _interface_force(self, traction: Array) -> Array:
        """Forces on the interface dofs (n_gamma, n_member), N."""
        ops = self.operators
        force: Array = ops.trace.T @ (ops.area[:, None] * traction)
        return force

    def _nodal(self, traction: Array) -> Array:
        """Forces on all dofs (n_dof, n_member), N."""
        force = np.zeros((self.n_dof, traction.shape[1]))
        force[self.operators.dofs] = self._interface_force(traction)
        return force

    def take(self, state: Any, traction: Array | None) -> None:
        """Take up the state of a later instant, marched elsewhere; its energy is accounted for where ``traction``
        (n_channel, n_member), Pa, of that one step is given."""
        self.state = Motion(state.instant, state.u, state.v, state.a, state.residual)
        if self.meter is not None and traction is not None:
            self.meter.advance(self.state, self._nodal(traction))

    # -- reading the state --------------------------------------------------------------------------------------
    def channel_velocity(self) -> Array:
        """Velocities at the channels, (n_channel, n_member)."""
        return self._at(self.operators.dofs, self.state.v, self.forcing.channel_velocity(self.state.instant))

    def channel_displacement(self) -> Array:
        """Displacements at the channels that gaps are read from."""
        dofs, state, i = self.operators.dofs, self.state, self.state.instant
        u = self._at(dofs, state.u, self.forcing.channel_displacement(i))
        lead = self.scheme.gap_lead(self.dt)
        return u + lead * self.channel_velocity() if lead else u

    def channel_acceleration(self) -> Array:
        """Accelerations at the channels."""
        imposed = self.forcing.channel_acceleration(self.state.instant)
        return self._at(self.operators.dofs, self.state.a, imposed)

    def _at(self, dofs: Index, field: Array, imposed: Array | None) -> Array:
        values: Array = self.operators.trace @ field[dofs]
        return values if imposed is None else values + imposed

    def remarks(self) -> list[str]:
        """What a reader of the results should know of this propagator's accuracy."""
        return []
