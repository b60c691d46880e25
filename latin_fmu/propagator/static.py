"""Propagator without inertia: one equilibrium per increment of load, on the springs of the search direction.

With W = T (u_{n+1} - u_n) / dt and the linear stage F = q - k W, (12)-(14) without mass read

    (K + T^T a k/dt T) (u_{n+1} - u_n) = f_{n+1} - K u_n + T^T a q

whose operator is regular for a floating body too. The whole load f_{n+1} is balanced at every increment, so that what
one increment leaves unbalanced is not carried on. The contract is that of ``direct``, except that an instant ends with
the incoming quantity q (``settle``): tractions alone do not tell where a floating body stands.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NoReturn

import numpy as np

from ..time_scheme.quasi_static import QuasiStatic
from .march import March
from .model import Array, SubstructureModel
from .resumable import Motion
from .static_energy import StaticEnergyMeter
from .static_operators import StaticOperators, build_static_operators


class StaticPropagator(March[StaticOperators]):
    """Equilibria of a class of identical substructures (module docstring).

    Parameters
    ----------
    members : models with equal matrices and traces. dt : length of the increments, s (``begin`` may change it).
    energy : whether to account for energies. springs : (n_channel,) stiffness per area of the body's own size, Pa m-1.
    """

    def __init__(self, members: Sequence[SubstructureModel], dt: float, energy: bool, springs: Array) -> None:
        self._springs = springs
        super().__init__(members, QuasiStatic(), dt, None)
        self.meter = StaticEnergyMeter(members, self.forcing) if energy else None
        self._inverse = self.operators.factor.schur_inverse  # on the springs, until ``bind``
        self._free: tuple[Array, Array] | None = None

    def _build(self, dt: float) -> StaticOperators:
        """One factor serves every length of increment."""
        if not self._kept:
            return build_static_operators(self.members[0], self._springs, dt)
        known, operators = self._kept[-1]
        return replace(operators, compliance=operators.compliance * (known / dt))

    # -- start ------------------------------------------------------------------------------------------------
    def initial_unbalance(self, traction: Array) -> Array:  # noqa: ARG002, as other propagators
        """None: nothing acts at t = 0 but what is in equilibrium."""
        return np.zeros_like(self.state.u)

    def start(self, traction: Array, factor: object) -> None:  # noqa: ARG002, as other propagators
        """Open the account at t = 0 with the tractions there (n_channel, n_member), Pa."""
        if self.meter is not None:
            self.meter.start(self.state, self._nodal(traction))

    def mass_factor(self) -> NoReturn:
        """There is none."""
        raise TypeError("no inertia: a quasi-static substructure has no mass")

    def initial_channels(self, factor: object, unbalance: Array) -> NoReturn:  # noqa: ARG002
        """There are no accelerations."""
        raise TypeError("no inertia: a quasi-static substructure has no accelerations")

    # -- search direction -------------------------------------------------------------------------------------
    def bind(self, k: Array) -> None:
        """Search direction k (n_channel,), Pa s m-1: builds Y = T (S + T^T a k/dt T)^-1 T^T a / dt once."""
        self.k, trace = k[:, None], self.operators.trace
        self._inverse = self.operators.on_springs(k / self.dt)
        condensed = trace @ (trace @ self._inverse).T / self.dt
        self.condensed, self._response = 0.5 * (condensed + condensed.T), None

    # -- one increment ----------------------------------------------------------------------------------------
    def predict(self) -> Array:
        """Answer W_0 (n_channel, n_member) of the next increment to q = 0, m s-1."""
        ops, state = self.operators, self.state
        y, c = ops.factor.forward(self.forcing.at(state.instant + 1) - ops.stiffness @ state.u)
        self._free = (y, c)
        velocity: Array = ops.trace @ (self._inverse @ c) / self.dt
        imposed = self.forcing.channel_velocity(state.instant + 1)
        return velocity if imposed is None else velocity + self._with_dashpots(imposed)

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
        on_interface = self._inverse @ (c + self._interface_force(outer))
        step = self.operators.factor.backward(y, on_interface)
        rest = np.zeros_like(step)
        self.state = Motion(instant, state.u + step, step / self.dt, rest, rest)
        self._free = None
        if self.meter is not None and account:
            traction = q - self.k * self.channel_velocity()
            self.meter.advance(self.state, self._nodal(traction))
