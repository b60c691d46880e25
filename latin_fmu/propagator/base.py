"""A class of identical substructures in time: what all propagators share.

Every substructure model and time scheme reduces, at the new instant, to

    v = v_free + D lambda

on the channels of all interfaces of the substructure together; D is constant for a time step. The march over one
instant is in ``kernels.substructure``; a propagator is a handle on its class in the image of a run. Rules:

1. ``bind`` sets the search direction k with which W follows from an incoming q = F + k W; ``alone`` marches the class
   by itself, instant by instant.
2. ``operators`` is the same object as long as the time step is.
3. Everything is linear in loads, initial values and tractions; members do not depend on each other.
4. The state of the image within a segment, this and ``motions``/``resume`` between segments hold all that the next
   instant needs: a march that goes on from them is the same to the last bit.
5. ``channel_displacement`` is what gaps are read from (``TimeScheme.gap_offset`` ahead of the instant).
6. The account of energies closes with the scheme's own identity (``kernels.energy``).

Motion: arrays (n_dof, n_member). Arrays over channels are (n_channel, n_member).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp

from ..time_scheme import MaxwellBranches, TimeScheme
from .forcing import STRAIN, Forcing, MotionState
from .image import Image
from .interface_matrices import condensed
from .interface_probing import Table
from .model import Array, Histories, SubstructureModel, closest_reduced, node_values

_STEPS_KEPT = 4


class MassFactor(Protocol):
    """Solver with the mass matrix, used at the start only."""

    def solve(self, b: Array) -> Array:
        """M^-1 b for b (n_dof, m)."""
        ...


_FIELDS = ("u", "v", "a", "residual")


def _copy_of(field: Array | None) -> Array | None:
    """A copy, None of what is not there."""
    if field is None:
        return None
    return field.copy()


class ClassState:
    """Motion of a class, (n_dof, n_member) each: displacements, velocities, accelerations, residual forces; m, m s-1,
    m s-2, N.

    Parameters
    ----------
    n_dof, n_member : shape of the fields. energy : whether energies are accounted for.

    Attributes
    ----------
    image : that the fields stand in; None: they are kept here. number : of the class in the image.
    """

    def __init__(self, n_dof: int, n_member: int, energy: bool) -> None:
        self._shape, self._energy = (n_dof, n_member), energy
        self.image: Image | None = None
        self.number = 0
        self._arrays: dict[str, Array] = {name: np.zeros(self._shape) for name in _FIELDS}
        self._elongation: Array | None = None  # of Maxwell branches, likewise
        self._face: Array | None = None  # of a stiffness of the face, likewise
        self._account: Array | None = None  # of energies, where a state was set before there is an image

    @property
    def u(self) -> Array:
        """Displacements, a view where they stand in an image; likewise the others."""
        return self._field("u")

    @property
    def v(self) -> Array:
        """Velocities at the present instant."""
        return self._field("v")

    @property
    def a(self) -> Array:
        """Accelerations at the present instant."""
        return self._field("a")

    @property
    def residual(self) -> Array:
        """Residual forces at the present instant."""
        return self._field("residual")

    @property
    def fields(self) -> list[Array]:
        """All four, in the order of the arguments of ``set``."""
        return [self._field(name) for name in _FIELDS]

    def set(self, u: Array, v: Array, a: Array | None = None, residual: Array | None = None) -> None:
        """Set the motion; zeros for what is not given."""
        if a is None:
            a = np.zeros_like(u)
        if residual is None:
            residual = np.zeros_like(u)
        new = (u, v, a, residual)
        if self.image is None:
            self._arrays = dict(zip(_FIELDS, (np.array(x) for x in new), strict=True))
            return
        for into, x in zip(self.fields, new, strict=True):
            into[...] = x
        # a motion set from outside ends the rest for which the kernels pass over a class
        self.part("rest", 1)[0] = float(not any(x.any() for x in new))

    @property
    def elongation(self) -> Array | None:
        """Elongations (n_branch n m,) of the Maxwell branches, m, in the image or kept for one; None: all relaxed."""
        if self.image is None:
            return self._elongation
        return self.part("elongation", self.image.row(self.number)["n_branch"] * self._shape[0] * self._shape[1])

    @property
    def face(self) -> Array | None:
        """State of the march on a stiffness of the face, as ``kernels.face`` has it, in the image or kept for one; None
        where there is none."""
        if self.image is None:
            return self._face
        row = self.image.row(self.number)
        if not row.get("on_face"):
            return None
        g = row["n_inner"]
        k = row["n_elastic"]
        count = row["n_relaxing"]
        return self.part("face_state", 4 * g + (1 + count) * k + 2 * count * g + row["n_inertial"])

    def put_on_face(self, forces: Array) -> None:
        """Set what ``face`` is."""
        if self.image is None:
            self._face = forces.reshape(-1).copy()
        else:
            self.part("face_state", forces.size)[:] = forces.reshape(-1)

    @property
    def account(self) -> Array | None:
        """The account of energies, in the image or kept for one; None where there is none, or none yet."""
        if not self._energy or self.image is None:
            return self._account
        return self.part("energy", self.image.row(self.number)["n_energy"])

    def part(self, first: str, size: int) -> Array:
        """View of numbers of the class in the image, from the field ``first`` of its record on."""
        assert self.image is not None
        at = self.image.row(self.number)[first]
        return self.image.moving[at : at + size]

    def _field(self, name: str) -> Array:
        if self.image is None:
            return self._arrays[name]
        return self.part(name, self._shape[0] * self._shape[1]).reshape(self._shape)

    def relax(self) -> None:
        """Let the Maxwell branches relax, as they are at the start."""
        if (elongation := self.elongation) is not None:
            elongation[:] = 0.0

    # -- from image to image ------------------------------------------------------------------------------------
    def attach(self, image: Image, number: int) -> None:
        """Move the motion into an image, as its class ``number``."""
        # before ``stand_in``, which lets go of the place where they are
        fields = self.fields
        account = self.account
        elongation, face = _copy_of(self.elongation), _copy_of(self.face)
        self.stand_in(image, number)
        self.set(*fields)
        if face is not None:
            self.put_on_face(face)
        there = self.elongation
        if there is not None:
            there[:] = 0.0
            if elongation is not None:
                there[:] = elongation
        there = self.account
        if account is not None and there is not None and account.size == there.size:
            there[:] = account

    def stand_in(self, image: Image, number: int) -> None:
        """Take the motion that stands in an image, as its class ``number``."""
        self.image = image
        self.number = number
        self._arrays = {}

    def detach(self) -> None:
        """Keep a copy of the motion: the image belongs to other operators."""
        if self.image is None:
            return
        fields = {name: field.copy() for name, field in zip(_FIELDS, self.fields, strict=True)}
        self._account = _copy_of(self.account)
        self._elongation, self._face = _copy_of(self.elongation), _copy_of(self.face)
        self._arrays, self.image = fields, None


class Propagator(ABC):
    """A class of identical substructures (module docstring).

    Parameters
    ----------
    members : models with equal matrices and traces; loads and initial values may differ.
    scheme, dt : time scheme and step, s (``begin`` may change the step). energy : whether to account for energies.

    Attributes
    ----------
    instant, state : number of the present instant, and the motion there. begun : whether there are histories.
    operators : constant for the step: area (n_channel,), m2; dofs (n_gamma,) of the
        interface; trace (n_channel, n_gamma); compliance (n_channel, n_channel), m s-1 N-1; admittance, per traction.
    condensed : Y per nodal force for the k of the last ``bind``, (n_channel, n_channel), made when first used.
    swept : whether interfaces are solved with by substitution; then ``condensed`` is a factor (``interface_sweeps``).
    tables : compliances of the interfaces of a swept class for the kernels (``interface_probing``), of the present k.
    dashpots : lumped damping (n_full, n_full) of an explicit propagator, else None.
    """

    dashpots: sp.csr_array | None = None
    joined = False
    """Whether it is a whole assembly without inertia, whose linear stage reaches all bodies."""
    operators: Any
    dt: float

    def __init__(
        self,
        members: Sequence[SubstructureModel],
        scheme: TimeScheme,
        dt: float,
        energy: bool,
        operators: list[tuple[float, Any]] | None = None,
    ) -> None:
        self.members = list(members)
        self.names = [m.name for m in members]
        self.scheme = scheme
        self.energy = energy
        self.swept = members[0].swept
        self.loads_only = False  # of the energies the work of the loads alone is followed
        self.forcing = Forcing(members, scheme)
        self._operators_by_step: list[tuple[float, Any]] = [] if operators is None else operators
        self._resumed: list[MotionState] | None = None
        self.begun = False
        self.instant = 0
        self.state = ClassState(self.n_dof, len(self.members), energy)
        self._use(dt)
        self.sampled = np.zeros(2)  # data of ``remarks``

    # -- operators ----------------------------------------------------------------------------------------------
    @abstractmethod
    def _build(self, dt: float) -> Any:
        """Operators for a step."""

    def _use(self, dt: float) -> None:
        """Operators for the step dt: a few are kept for use again."""
        if hasattr(self, "dt") and self.dt == dt:
            return
        operators = next((entry for step, entry in self._operators_by_step if step == dt), None)
        if operators is None:
            operators = self._build(dt)
            # in place: twins hold the same list
            del self._operators_by_step[: -_STEPS_KEPT + 1]
            self._operators_by_step.append((dt, operators))
        self.dt, self.operators = dt, operators
        # the image belongs to the operators of the former step
        self.state.detach()
        self.k: Array = np.zeros((self.n_channel, 1))
        self.single, self.tables = False, dict[str, Table]()
        # for k = 0
        if self.swept:
            self._condensed: Any = operators.factor
        else:
            self._condensed = operators.compliance

    def bind(self, k: Array, single: bool = False) -> None:
        """Search direction k (n_channel,), Pa s m-1: Y = (1 + C a k)^-1 C a, symmetrised through sqrt(a k). ``single``:
        what gives Y may be float32, the factor of a swept class or a large table."""
        if np.array_equal(k, self.k[:, 0]) and single == self.single:
            return
        self.k = k[:, None]
        self.single = single
        self.tables = {}
        self._condensed = None

    @property
    def condensed(self) -> Any:
        """Y per nodal force for the k of the last ``bind``, (n_channel, n_channel), m s-1 N-1."""
        if self._condensed is None:
            self._condensed = self._condense(self.k[:, 0])
        return self._condensed

    def release(self) -> None:
        """Drop the factor with the dashpots of a swept class, which is in the image now."""
        self._condensed = None

    def _condense(self, k: Array) -> Any:
        """Y per nodal force."""
        ops = self.operators
        return condensed(ops.compliance, ops.area * k)

    @property
    def branches(self) -> MaxwellBranches:
        """Maxwell branches of the class; without inertia they are relaxed."""
        return self.members[0].branches.marched(self.scheme)

    @property
    def n_sensed(self) -> int:
        """Fields that are kept at its sensors: displacement, velocity, acceleration and, with branches, what these add
        to the displacement in the internal forces."""
        return STRAIN + (len(self.branches) > 0)

    @property
    def n_channel(self) -> int:
        """Interface channels of one member."""
        return int(self.operators.area.size)

    @property
    def n_dof(self) -> int:
        """Unknowns of one member."""
        return int(self.members[0].expansion.shape[1])

    # -- time ---------------------------------------------------------------------------------------------------
    def begin(self, histories: Sequence[Histories], dt: float) -> None:
        """Set the histories of a run, or of the segment that goes on from the present state; one per member."""
        # first of all: they are read from the histories of the segment that ends
        if self.begun:
            self.forcing.set_motion_state(self.motions())
            self._resumed = None
        self._use(dt)
        self.forcing.begin(histories, dt)
        self.instant = 0
        if not self.begun:
            self.state.set(*_initial_motion(self))
            _start_on_face(self)
        self.begun = True

    @abstractmethod
    def internal_forces(self) -> tuple[Array, Array]:
        """K u and C v of the present state, (n_dof, n_member), N."""

    @abstractmethod
    def mass_factor(self) -> MassFactor:
        """Solver with the mass matrix, for the accelerations at t = 0."""

    def start(self, traction: Array, factor: MassFactor | None, round_off: Array | float = 0.0) -> None:
        """Consistent accelerations at t = 0 with tractions, Pa; ``factor`` None for a start at rest in equilibrium.

        round_off : part of the balance that accelerates nothing (``balance`` of an equilibrium), N.
        """
        unbalance = balance(self, traction) - sum(forces_of_motion(self))
        # f - C v - K u: the inertia of prescribed motions is no force, and is taken out of M a again
        inertia = self.forcing.inertia(0)
        if inertia is None:
            residual = unbalance
        else:
            residual = unbalance + inertia
        u, v = self.state.u, self.state.v
        if factor is None:
            a = np.zeros_like(unbalance)
        else:
            a = factor.solve(unbalance - round_off)
        mass_old, force_old = self.scheme.old_weights
        # as ``substructure.keep_memory`` leaves it
        if force_old:
            residual = mass_old * (self.operators.mass @ a) - force_old * self.forcing.at(0)
            if inertia is not None:
                residual += mass_old * inertia
        self.state.set(u, v, a, residual)

    def sample(self) -> None:  # noqa: B027, most propagators have no remarks
        """Add the present state to ``sampled``, the data of ``remarks``."""

    def remarks(self) -> list[str]:
        """Sentences on the accuracy of the results of this propagator."""
        return []

    # -- segments ----------------------------------------------------------------------------------------------
    def restart(self) -> None:
        """Back to the initial values; ``begin`` must follow."""
        self.begun, self._resumed = False, None
        self.state.relax()
        self.forcing.set_motion_state([None] * len(self.members))

    def motions(self) -> list[MotionState]:
        """State of the prescribed motions that the next segment starts from."""
        if self._resumed is None:
            return self.forcing.motion_state(self.instant)
        return self._resumed

    def resume(self, image: Image, number: int, motions: list[MotionState]) -> None:
        """Go on from the state in an image, as its class ``number``, and from ``motions``; ``begin`` must follow."""
        self.state.stand_in(image, number)
        self.instant, self._resumed = 0, motions


def _initial_motion(propagator: Propagator) -> tuple[Array, Array]:
    """Initial displacements and velocities; accelerations come with ``start``."""
    members = propagator.members
    forcing = propagator.forcing
    shape = (propagator.n_dof, len(propagator.members))
    if not any(m.displacement.any() or m.velocity.any() for m in members) and not forcing.moves:
        return np.zeros(shape), np.zeros(shape)
    p = members[0].expansion
    # u_full = P u + imposed
    u = closest_reduced(p, np.stack([m.displacement for m in members], axis=1) - forcing.imposed_u(0))
    v = closest_reduced(p, np.stack([m.velocity for m in members], axis=1) - forcing.imposed_v(0))
    return u, v


def _start_on_face(propagator: Propagator) -> None:
    """State of the march on a stiffness of the face, from the motion at the start."""
    face = propagator.members[0].face
    dofs = propagator.operators.dofs
    state = propagator.state
    if face is not None:
        place, speed = state.u[dofs, 0], state.v[dofs, 0]
        force = face.matrix @ place
        count = len(face.branches)  # relaxed
        relaxed = np.zeros(count * (len(face.rows) + 2 * len(dofs)))
        on_rows = face.rows @ state.u[:, 0]
        inertial = slice(len(face.rows) - face.n_inertial, None)
        earlier = on_rows[inertial] - propagator.dt * (face.rows[inertial] @ state.v[:, 0])
        state.put_on_face(np.concatenate([place, force, force, face.matrix @ speed, on_rows, relaxed, earlier]))


def nodal_forces(propagator: Propagator, traction: Array) -> Array:
    """Forces on all dofs (n_dof, n_member), N, of channel tractions (n_channel, n_member), Pa."""
    ops = propagator.operators
    force = np.zeros((propagator.n_dof, traction.shape[1]))
    force[ops.dofs] = ops.spread @ (ops.area[:, None] * traction)
    return force


# -- the start --------------------------------------------------------------------------------------------------------
def balance(propagator: Propagator, traction: Array) -> Array:
    """M a of the free dofs at t = 0 under loads and tractions (n_channel, n_member), as if nothing moved: zero but for
    round-off in an equilibrium; (n_dof, n_member), N."""
    force = propagator.forcing.parts(0)[0] - propagator.internal_forces()[0]
    if traction.any():
        return force + nodal_forces(propagator, traction)
    return force


def forces_of_motion(propagator: Propagator) -> tuple[Array, Array]:
    """Forces of damping, and of the inertia of prescribed motions, which M a lacks at t = 0; (n_dof, n_member), N."""
    viscous, inertia = propagator.internal_forces()[1] + propagator.forcing.parts(0)[1], None
    # a lumped mass of driven dofs does not couple with others
    if not propagator.scheme.explicit:
        inertia = propagator.forcing.inertia(0)
    if inertia is None:
        inertia = np.zeros_like(viscous)
    return viscous, inertia


# -- reading the state ----------------------------------------------------------------------------------------------
def channel_velocity(propagator: Propagator) -> Array:
    """Velocities at the channels, (n_channel, n_member), m s-1."""
    return _at_channels(propagator, propagator.state.v, propagator.forcing.channel_velocity(propagator.instant))


def channel_displacement(propagator: Propagator) -> Array:
    """Displacements at the channels that gaps are read from, (n_channel, n_member), m."""
    u = _at_channels(propagator, propagator.state.u, propagator.forcing.channel_displacement(propagator.instant))
    lead = propagator.scheme.gap_offset(propagator.dt)
    if lead:
        return u + lead * channel_velocity(propagator)
    return u


def _at_channels(propagator: Propagator, field: Array, imposed: Array | None) -> Array:
    values: Array = propagator.operators.trace @ field[propagator.operators.dofs]
    if imposed is None:
        return values
    return values + imposed


def full_displacement(propagator: Propagator, member: int) -> Array:
    """Displacements of all nodes of a member, (n_node, 3), m."""
    return _at_nodes(propagator, propagator.state.u, propagator.forcing.imposed_u(propagator.instant), member)


def full_velocity(propagator: Propagator, member: int) -> Array:
    """Velocities of all nodes of a member, (n_node, 3), m s-1."""
    return _at_nodes(propagator, propagator.state.v, propagator.forcing.imposed_v(propagator.instant), member)


def _at_nodes(propagator: Propagator, field: Array, imposed: Array, member: int) -> Array:
    model = propagator.members[member]
    return node_values(model, model.expansion @ field[:, member] + imposed[:, member])


def accuracy_remarks(propagators: Sequence[Propagator]) -> list[str]:
    """Sentences on approximations whose error may exceed the tolerance of the iteration."""
    return [remark for p in propagators for remark in p.remarks()]
