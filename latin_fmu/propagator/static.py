"""Propagator without inertia: one equilibrium per increment of load, on the springs of the search direction.

With W = T (u_{n+1} - u_n) / dt and the linear stage F = q - k W, (12)-(14) without mass read

    (K + T^T a k/dt T) (u_{n+1} - u_n) = f_{n+1} - K u_n + T^T a q

whose operator is regular for a floating body too. The whole load f_{n+1} is balanced at every increment, so that what
one increment leaves unbalanced is not carried on. The contract is that of ``direct``, except that an instant ends with
the incoming quantity q (``settle``): tractions alone do not tell where a floating body stands.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NoReturn

import numpy as np
import scipy.sparse as sp

from ..time_scheme.quasi_static import QuasiStatic
from .forcing import Forcing
from .model import Array, Histories, SubstructureModel
from .static_energy import StaticEnergyMeter
from .static_operators import StaticOperators, build_static_operators


@dataclass
class StaticState:
    """Reduced displacements and velocities (n_dof, n_member) at one instant; states are never changed in place."""

    instant: int
    u: Array
    v: Array


class StaticPropagator:
    """Equilibria of a class of identical substructures (module docstring).

    Parameters
    ----------
    members : models with equal matrices and traces. dt : length of the increments, s (``begin`` may change it).
    energy : whether to account for energies. springs : (n_channel,) stiffness per area of the body's own size, Pa m-1.
    """

    state: StaticState
    operators: StaticOperators

    def __init__(self, members: Sequence[SubstructureModel], dt: float, energy: bool, springs: Array) -> None:
        self.members = list(members)
        self.names = [m.name for m in members]
        self.scheme = QuasiStatic()
        self.forcing = Forcing(members, self.scheme)
        self.meter = StaticEnergyMeter(members, self.forcing) if energy else None
        self.dt = dt
        self.operators = build_static_operators(self.members[0], springs, dt)
        self._area = self.operators.area[:, None]
        self._trace = self.operators.trace
        self._trace_t = sp.csr_array(self._trace.T)
        self._begun = False
        self._resumed: list[tuple[Array, Array]] | None = None
        self._free: tuple[Array, Array] | None = None
        self._unbind()

    def _unbind(self) -> None:
        self.k: Array = np.zeros((self.n_channel, 1))
        self.response: Array = np.zeros((self.n_channel, self.n_channel))
        self._inverse = self.operators.factor.schur_inverse  # on the springs k_0, until ``bind``

    @property
    def n_channel(self) -> int:
        """Interface channels of one member."""
        return int(self.operators.area.size)

    @property
    def n_dof(self) -> int:
        """Reduced dofs of one member."""
        return int(self.operators.stiffness.shape[0])

    # -- start ------------------------------------------------------------------------------------------------
    def begin(self, histories: Sequence[Histories], dt: float) -> None:
        """Set the histories of a run, or of the segment that goes on from the present state."""
        if self._begun:
            motions = self.forcing.end(self.state.instant) if self._resumed is None else self._resumed
            self.forcing.resume(motions)
            self._resumed = None
        if dt != self.dt:
            self.operators = replace(self.operators, compliance=self.operators.compliance * (self.dt / dt))
            self.dt = dt
            self._unbind()
        self.forcing.begin(histories, dt)
        self._free = None
        self.state = replace(self.state, instant=0) if self._begun else self._initial_state()
        self._begun = True

    def _initial_state(self) -> StaticState:
        p = self.members[0].expansion
        pick = sp.csr_array(p.T.multiply(1 / np.maximum(p.sum(axis=0), 1)[:, None]))
        u = pick @ (np.stack([m.displacement for m in self.members], axis=1) - self.forcing.imposed_u(0))
        return StaticState(0, u, np.zeros_like(u))

    def start(self, traction: Array, factor: object = None) -> None:  # noqa: ARG002, as other propagators
        """Open the account at t = 0 with the tractions there (n_channel, n_member), Pa."""
        if self.meter is not None:
            self.meter.start(self.state.u, self._nodal(traction))

    def initial_unbalance(self, traction: Array) -> Array:  # noqa: ARG002, as other propagators
        """None: nothing acts at t = 0 but what is in equilibrium."""
        return np.zeros_like(self.state.u)

    def mass_factor(self) -> NoReturn:
        """There is none."""
        raise TypeError("no inertia: a quasi-static substructure has no mass")

    def initial_channels(self, factor: object, unbalance: Array) -> NoReturn:  # noqa: ARG002
        """There are no accelerations."""
        raise TypeError("no inertia: a quasi-static substructure has no accelerations")

    # -- search direction -------------------------------------------------------------------------------------
    def bind(self, k: Array) -> None:
        """Search direction k (n_channel,), Pa s m-1: builds Y = T (S + T^T a k/dt T)^-1 T^T a / dt once."""
        self.k = k[:, None]
        self._inverse = self.operators.on_springs(k / self.dt)
        condensed = self._trace @ (self._trace @ self._inverse).T / self.dt
        self.response = 0.5 * (condensed + condensed.T) * self.operators.area

    # -- one increment ----------------------------------------------------------------------------------------
    def predict(self) -> Array:
        """Answer W_0 (n_channel, n_member) of the next increment to q = 0, m s-1."""
        ops, state = self.operators, self.state
        y, c = ops.factor.forward(self.forcing.at(state.instant + 1) - ops.stiffness @ state.u)
        self._free = (y, c)
        velocity: Array = self._trace @ (self._inverse @ c) / self.dt
        imposed = self.forcing.channel_velocity(state.instant + 1)
        return velocity if imposed is None else velocity + imposed - self.response @ (self.k * imposed)

    def respond(self, w_0: Array, q: Array) -> Array:
        """W = W_0 + Y q, (n_channel, n_member)."""
        answer: Array = w_0 + self.response @ q
        return answer

    def commit(self, traction: Array, account: bool = True) -> None:
        """As ``settle``, for a substructure without interfaces."""
        assert not self.n_channel, "tractions do not tell where a floating body stands: use settle"
        self.settle(traction, account)

    def settle(self, q: Array, account: bool = True) -> None:
        """End the increment with incoming quantities q (n_channel, n_member), Pa."""
        assert self._free is not None, "settle without predict"
        y, c = self._free
        state, instant = self.state, self.state.instant + 1
        imposed = self.forcing.channel_velocity(instant)
        outer = q if imposed is None else q - self.k * imposed
        on_interface = self._inverse @ (c + self._trace_t @ (self._area * outer))
        step = self.operators.factor.backward(y, on_interface)
        self.state = StaticState(instant, state.u + step, step / self.dt)
        self._free = None
        if self.meter is not None and account:
            traction = q - self.k * self.channel_velocity()
            self.meter.advance(self.state.u, instant, self._nodal(traction))

    def _nodal(self, traction: Array) -> Array:
        """Reduced nodal forces (n_dof, n_member) of channel tractions."""
        force = np.zeros((self.n_dof, traction.shape[1]))
        force[self.operators.dofs] = self._trace_t @ (self._area * traction)
        return force

    # -- reading the state --------------------------------------------------------------------------------------
    def channel_velocity(self) -> Array:
        """Velocities at the channels, (n_channel, n_member)."""
        return self._at_channels(self.state.v, self.forcing.channel_velocity(self.state.instant))

    def channel_displacement(self) -> Array:
        """Displacements at the channels."""
        return self._at_channels(self.state.u, self.forcing.channel_displacement(self.state.instant))

    def channel_acceleration(self) -> Array:
        """None."""
        return np.zeros_like(self.channel_displacement())

    def _at_channels(self, field: Array, imposed: Array | None) -> Array:
        values: Array = self._trace @ field[self.operators.dofs]
        return values if imposed is None else values + imposed

    def full_displacement(self, member: int) -> Array:
        """Displacements of all nodes, (n_node, 3), m."""
        return self._full(self.state.u, self.forcing.imposed_u(self.state.instant), member)

    def full_velocity(self, member: int) -> Array:
        """Velocities of all nodes, (n_node, 3), m s-1."""
        return self._full(self.state.v, self.forcing.imposed_v(self.state.instant), member)

    def _full(self, field: Array, imposed: Array, member: int) -> Array:
        model = self.members[member]
        return model.node_values(model.expansion @ field[:, member] + imposed[:, member])

    # -- windows ------------------------------------------------------------------------------------------------
    def snapshot(self) -> tuple[StaticState, object]:
        """All that determines the next increments."""
        return self.state, None if self.meter is None else self.meter.snapshot()

    def restore(self, snapshot: tuple[StaticState, object]) -> None:
        """Back to a snapshot."""
        self.state = snapshot[0]
        if self.meter is not None:
            self.meter.restore(snapshot[1])
        self._free = None

    def restart(self) -> None:
        """Back to the initial values; ``begin`` must follow."""
        self._begun, self._resumed = False, None
        self.forcing.resume([None] * len(self.members))

    def tree(self) -> dict[str, object]:
        """The present state as plain arrays: all that the next segment needs."""
        motions = [[u, a] for u, a in self.forcing.end(self.state.instant)]
        meter = None if self.meter is None else self.meter.tree()
        return {"u": self.state.u, "v": self.state.v, "motions": motions, "meter": meter}

    def resume(self, tree: dict[str, Any]) -> None:
        """Take up a state given by ``tree``; ``begin`` must follow."""
        self.state = StaticState(0, tree["u"], tree["v"])
        self._resumed = [(u, a) for u, a in tree["motions"]]
        if self.meter is not None:
            self.meter.resume(tree["meter"])
        self._free = None
