"""Direct implicit propagator: one forward and one backward substitution per instant, contact in between.

One instant, in terms of the incoming quantity q = F_hat + k W_hat of the linear stage (12)-(14):

    predict(i)   free response; W_0, the answer at the channels to q = 0
    respond(q)   W = W_0 + Y q,  Y = (D^-1 + k)^-1 condensed on the channels, k the search direction
    commit(F)    ends the instant with the tractions F on the channels

Motion: plain arrays (n_dof, n_member); identical substructures are members of one class and are solved together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from ..time_scheme import TimeScheme
from .energy import EnergyMeter
from .forcing import Forcing
from .interface_matrices import with_dashpots
from .model import Array, Histories, SubstructureModel
from .operators import Operators, build_operators
from .resumable import Motion, Resumable

_STEPS_KEPT = 4


_HEAVY = 1e30


class DirectPropagator(Resumable):
    """March of a class of identical substructures (module docstring).

    Parameters
    ----------
    members : models with equal matrices and traces; loads and initial values may differ.
    scheme, dt : time scheme and step, s (``begin`` may change the step). energy : whether to account for energies.
    twin : propagator of other substructures with the same operators and scheme, to share them.
    """

    operators: Operators
    dt: float

    def __init__(
        self,
        members: Sequence[SubstructureModel],
        scheme: TimeScheme,
        dt: float,
        energy: bool,
        twin: DirectPropagator | None = None,
    ) -> None:
        self.members = list(members)
        self.names = [m.name for m in members]
        self.scheme = scheme
        self.forcing = Forcing(members, scheme)
        self.meter = EnergyMeter(members, self.forcing, scheme) if energy else None
        self._kept: list[tuple[float, Operators]] = [] if twin is None else twin._kept
        self._use(dt)
        self._area = self.operators.area[:, None]
        self._trace = self.operators.trace
        self._trace_t = self.operators.spread
        self._free: tuple[Array, Array, Array, Array] | None = None

    def _use(self, dt: float) -> None:
        """Operators for the step dt: a few are kept for use again."""
        if hasattr(self, "dt") and self.dt == dt:
            return
        for known, operators in self._kept:
            if known == dt:
                self.dt, self.operators = known, operators
                break
        else:
            self.dt, self.operators = dt, build_operators(self.members[0], self.scheme, dt)
            del self._kept[: -_STEPS_KEPT + 1]
            self._kept.append((dt, self.operators))
        self.k: Array = np.zeros((self.n_channel, 1))
        # Y per force instead of traction: symmetric; for k = 0 until ``bind``
        self.condensed: Array = self.operators.compliance
        self._response: Array | None = None

    def begin(self, histories: Sequence[Histories], dt: float) -> None:
        """Set the histories of a run, or of the segment that goes on from the present state.

        Parameters
        ----------
        histories : one per member. dt : their step, s.
        """
        if self._begun:
            motions = self.forcing.end(self.state.instant) if self._resumed is None else self._resumed
            self.forcing.resume(motions)
            self._resumed = None
        self._use(dt)
        self.forcing.begin(histories, self.dt)
        if self.meter is not None:
            self.meter.dt = self.dt
        self._free = None
        self.state = replace(self.state, instant=0) if self._begun else self._initial_state()
        self._begun = True

    @property
    def n_channel(self) -> int:
        """Interface channels of one member."""
        return int(self.operators.area.size)

    @property
    def n_dof(self) -> int:
        """Reduced dofs of one member."""
        return int(self.operators.mass.shape[0])

    def _initial_state(self) -> Motion:
        """Initial values; accelerations come with ``start``."""
        if not any(m.displacement.any() or m.velocity.any() for m in self.members) and not self.forcing.moves:
            rest = [np.zeros((self.n_dof, len(self.members))) for _ in range(4)]
            return Motion(0, *rest)
        p = self.members[0].expansion
        pick = sp.csr_array(p.T.multiply(1 / np.maximum(p.sum(axis=0), 1)[:, None]))
        imposed_u, imposed_v = self.forcing.imposed_u(0), self.forcing.imposed_v(0)
        u = pick @ (np.stack([m.displacement for m in self.members], axis=1) - imposed_u)
        v = pick @ (np.stack([m.velocity for m in self.members], axis=1) - imposed_v)
        return Motion(0, u, v, np.zeros_like(u), np.zeros_like(u))

    # -- start -----------------------------------------------------------------------------------------------
    def initial_unbalance(self, traction: Array) -> Array:
        """M a of the free dofs at t = 0 under tractions (n_channel, n_member); (n_dof, n_member), N."""
        ops, state = self.operators, self.state
        unbalance: Array = self.forcing.at(0)
        if state.u.any():
            unbalance -= ops.stiffness @ state.u
        if traction.any():
            unbalance += self._nodal(traction)
        if ops.damping is not None and state.v.any():
            unbalance -= ops.damping @ state.v
        inertia = self.forcing.inertia(0)
        return unbalance if inertia is None else unbalance - inertia

    def mass_factor(self) -> spla.SuperLU:
        """Factor of M: needed once, where the start is not balanced."""
        mass = self.operators.mass
        if self.operators.massless.size:  # they start without acceleration
            heavy = np.zeros(self.n_dof)
            heavy[self.operators.massless] = _HEAVY * mass.diagonal().max()
            mass = mass + sp.diags_array(heavy)
        return spla.splu(sp.csc_matrix(mass), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})

    def initial_channels(self, factor: spla.SuperLU, unbalance: Array) -> tuple[Array, Array]:
        """Channel accelerations (n_channel, n_member) at t = 0, and T M^-1 T^T (n_channel, n_channel)."""
        ops = self.operators
        spread = np.zeros((self.n_dof, self.n_channel))
        spread[ops.dofs] = self._trace.T.toarray()
        compliance: Array = self._trace @ factor.solve(spread)[ops.dofs]
        free: Array = self._trace @ factor.solve(unbalance)[ops.dofs]
        imposed = self.forcing.channel_acceleration(0)
        return free if imposed is None else free + imposed, compliance

    def start(self, traction: Array, factor: spla.SuperLU | None) -> None:
        """Consistent accelerations at t = 0 with tractions (n_channel, n_member), Pa; ``factor`` of M, None for
        a start at rest in equilibrium."""
        unbalance = self.initial_unbalance(traction)
        inertia = self.forcing.inertia(0)
        self.state = replace(
            self.state,
            a=np.zeros_like(unbalance) if factor is None else factor.solve(unbalance),
            residual=unbalance if inertia is None else unbalance + inertia,
        )
        if self.meter is not None:
            self.meter.start(self.state, self._nodal(traction))

    # -- search direction -------------------------------------------------------------------------------------
    def bind(self, k: Array) -> None:
        """Search direction k (n_channel,), Pa s m-1: builds Y once."""
        if np.array_equal(k, self.k[:, 0]):
            return
        self.k, self._response = k[:, None], None
        ops = self.operators
        self.condensed = with_dashpots(ops.trace, ops.gain, ops.factor.schur, ops.area * k)

    @property
    def response(self) -> Array:
        """Y = (D^-1 + k)^-1 for the k of the last ``bind`` (0 before), velocities per traction."""
        if self._response is None:
            self._response = self.condensed * self.operators.area
        return self._response

    # -- one instant --------------------------------------------------------------------------------------------
    def predict(self) -> Array:
        """Free response of the next instant; W_0 (n_channel, n_member), m s-1."""
        ops, scheme, dt, state = self.operators, self.scheme, self.dt, self.state
        u, v = scheme.predict(state.u, state.v, state.a, dt)
        force = self.forcing.at(state.instant + 1)
        force -= ops.stiffness @ u
        if ops.damping is not None:
            force -= ops.damping @ v
        force *= scheme.force_weight
        if scheme.memory_weight:
            force -= scheme.memory_weight * state.residual
        inertia = self.forcing.inertia(state.instant + 1)
        if inertia is not None:
            force -= inertia
        y, c = ops.factor.forward(force)
        free_a = ops.factor.schur_inverse @ c
        self._free = (u, v, y, free_a)
        at = ops.dofs
        reached = scheme.interface_velocity(state.u[at], u[at], v[at], dt)
        velocity: Array = self._trace @ (reached + scheme.interface_gain(dt) * free_a)
        imposed = self.forcing.channel_velocity(state.instant + 1)
        if imposed is not None:
            velocity = velocity + imposed
        w_0: Array = velocity - self.response @ (self.k * velocity)
        return w_0

    def rests(self) -> bool:
        """Whether nothing has moved so far and nothing but interfaces drives the next instant."""
        state = self.state
        if any(field.any() for field in (state.u, state.v, state.a, state.residual)):
            return False
        return not self.forcing.drives(state.instant + 1)

    def pass_instant(self) -> None:
        """Let an instant pass at rest."""
        self.state, self._free = replace(self.state, instant=self.state.instant + 1), None

    def respond(self, w_0: Array, q: Array) -> Array:
        """W = W_0 + Y q, (n_channel, n_member)."""
        answer: Array = w_0 + self.response @ q
        return answer

    def commit(self, traction: Array, account: bool = True) -> None:
        """End the instant with channel tractions (n_channel, n_member), Pa; ``account``: count its energy."""
        assert self._free is not None, "commit without predict"
        ops, scheme, dt, state = self.operators, self.scheme, self.dt, self.state
        u, v, y, free_a = self._free
        nodal = self._trace_t @ (self._area * traction)
        a = ops.factor.backward(y, free_a + ops.factor.schur_inverse @ (scheme.force_weight * nodal))
        v = v + scheme.velocity_gain(dt) * a
        u = u + scheme.displacement_gain(dt) * a
        if ops.massless.size:  # statics alone moves them: a velocity that means something, and no memory
            v[ops.massless] = (u - state.u)[ops.massless] / dt
            a[ops.massless] = 0.0
        residual = ops.mass @ a
        inertia = self.forcing.inertia(state.instant + 1)
        if inertia is not None:
            residual += inertia
        if scheme.memory_weight:
            residual += scheme.memory_weight * state.residual
        residual /= scheme.force_weight
        self.state = Motion(state.instant + 1, u, v, a, residual)
        self._free = None
        if self.meter is not None and account:
            self.meter.advance(self.state, self._nodal(traction))

    def take(self, state: Motion, traction: Array | None) -> None:
        """Take up the state of a later instant, marched elsewhere; its energy is accounted for where ``traction``
        (n_channel, n_member), Pa, of that one step is given."""
        self.state, self._free = state, None
        if self.meter is not None and traction is not None:
            self.meter.advance(state, self._nodal(traction))

    def _nodal(self, traction: Array) -> Array:
        """Reduced nodal forces (n_dof, n_member) of channel tractions."""
        force = np.zeros((self.n_dof, traction.shape[1]))
        force[self.operators.dofs] = self._trace_t @ (self._area * traction)
        return force

    # -- reading the state ----------------------------------------------------------------------------------------
    def channel_velocity(self) -> Array:
        """Velocities at the channels, (n_channel, n_member)."""
        return self._at_channels(self.state.v, self.forcing.channel_velocity(self.state.instant))

    def channel_displacement(self) -> Array:
        """Displacements at the channels."""
        return self._at_channels(self.state.u, self.forcing.channel_displacement(self.state.instant))

    def channel_acceleration(self) -> Array:
        """Accelerations at the channels."""
        return self._at_channels(self.state.a, self.forcing.channel_acceleration(self.state.instant))

    def _at_channels(self, field: Array, imposed: Array | None) -> Array:
        values: Array = self._trace @ field[self.operators.dofs]
        return values if imposed is None else values + imposed
