"""A class of identical substructures in time: what all propagators share.

Every substructure model and time scheme reduces, at the new instant, to

    v = v_free + D lambda

on the channels of all interfaces of the substructure together; D is constant for a time step. The march over one
instant is in ``kernels.substructure``; a propagator is a handle on its class in the image of a run. Rules:

1. ``predict`` marches to the next instant under its loads; ``respond`` gives W for an incoming q = F + k W, with the k
   of the last ``bind``; ``commit`` ends the instant with the tractions of the solution.
2. ``operators`` is the same object as long as the time step is.
3. Everything is linear in loads, initial values and tractions; members do not depend on each other.
4. ``snapshot``/``restore`` within a segment, the state of the image and ``motions``/``resume`` between segments hold
   all that the next instant needs: a march that goes on from them is the same to the last bit.
5. ``channel_displacement`` is what gaps are read from (``TimeScheme.gap_offset`` ahead of the instant).
6. The account of energies closes with the scheme's own identity (``kernels.energy``).

Motion: arrays (n_dof, n_member). Arrays over channels are (n_channel, n_member).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
import scipy.sparse as sp

from ..kernels import entries
from ..kernels.energy_parts import TERMS
from ..time_scheme import TimeScheme
from .forcing import Forcing, MotionState
from .image import Image
from .interface_matrices import condensed
from .interface_probing import Table
from .interface_sweeps import MassCompliance
from .model import Array, Histories, SubstructureModel, closest_reduced

_STEPS_KEPT = 4


class MassFactor(Protocol):
    """Solver with the mass matrix, used at the start only."""

    def solve(self, b: Array) -> Array:
        """M^-1 b for b (n_dof, m)."""
        ...


class Motion(NamedTuple):
    """Displacements, velocities, accelerations and residual forces (n_dof, n_member) at an instant; m, m s-1, m s-2,
    N."""

    instant: int
    u: Array
    v: Array
    a: Array
    residual: Array


class Propagator(ABC):
    """A class of identical substructures (module docstring).

    Parameters
    ----------
    members : models with equal matrices and traces; loads and initial values may differ.
    scheme, dt : time scheme and step, s (``begin`` may change the step). energy : whether to account for energies.

    Attributes
    ----------
    instant : of the present state. operators : constant for the step: area (n_channel,), m2; dofs (n_gamma,) of the
        interface; trace (n_channel, n_gamma); compliance (n_channel, n_channel), m s-1 N-1; admittance, per traction.
    condensed : Y per nodal force for the k of the last ``bind``, (n_channel, n_channel), made when first used.
    swept : whether interfaces are solved with by substitution; then ``condensed`` is a factor (``interface_sweeps``).
    tables : compliances of the interfaces of a swept class for the kernels (``interface_probing``), of the present k.
    dashpots : lumped damping (n_full, n_full) of an explicit propagator, else None.
    """

    dashpots: sp.csr_array | None = None
    operators: Any
    dt: float

    def __init__(
        self,
        members: Sequence[SubstructureModel],
        scheme: TimeScheme,
        dt: float,
        energy: bool,
        kept: list[tuple[float, Any]] | None = None,
    ) -> None:
        self.members = list(members)
        self.names = [m.name for m in members]
        self.scheme, self.energy, self.swept = scheme, energy, members[0].swept
        self.loads_only = False  # of the energies the work of the loads alone is followed
        self.forcing = Forcing(members, scheme)
        self._kept: list[tuple[float, Any]] = [] if kept is None else kept
        self._image: Image | None = None
        self._class = 0
        self._resumed: list[MotionState] | None = None
        self._begun = False
        self.instant = 0
        self._use(dt)
        self._own: dict[str, Array] = {
            name: np.zeros((self.n_dof, len(self.members))) for name in ("u", "v", "a", "residual")
        }
        self._account: Array | None = None  # of energies, where a state was set before there is an image
        self.sampled = np.zeros(2)  # data of ``remarks``
        self._opening: Array | None = None  # tractions with which the account of a march alone opens
        self._alone_since: Any = None  # histories of the image that holds this class only
        self._bound_alone: Array | None = None  # its search direction

    # -- operators ----------------------------------------------------------------------------------------------
    @abstractmethod
    def _build(self, dt: float) -> Any:
        """Operators for a step."""

    def _use(self, dt: float) -> None:
        """Operators for the step dt: a few are kept for use again."""
        if hasattr(self, "dt") and self.dt == dt:
            return
        operators = next((kept for step, kept in self._kept if step == dt), None)
        if operators is None:
            operators = self._build(dt)
            del self._kept[: -_STEPS_KEPT + 1]
            self._kept.append((dt, operators))
        self.dt, self.operators = dt, operators
        self._detach()
        self.k: Array = np.zeros((self.n_channel, 1))
        self.single, self.tables = False, dict[str, Table]()
        self._condensed: Any = operators.factor if self.swept else operators.compliance  # for k = 0
        self._response: Array | None = None

    def bind(self, k: Array, single: bool = False) -> None:
        """Search direction k (n_channel,), Pa s m-1: Y = (1 + C a k)^-1 C a, symmetrised through sqrt(a k). ``single``:
        the factor that gives Y of a swept class may be float32."""
        if np.array_equal(k, self.k[:, 0]) and single == self.single:
            return
        self.k, self.single, self.tables, self._condensed, self._response = k[:, None], single, {}, None, None

    @property
    def condensed(self) -> Any:
        """Y per nodal force for the k of the last ``bind``, (n_channel, n_channel), m s-1 N-1."""
        self._condensed = self._condense(self.k[:, 0]) if self._condensed is None else self._condensed
        return self._condensed

    def release(self) -> None:
        """Drop the factor with the dashpots of a swept class, which is in the image now."""
        self._condensed = None

    def _condense(self, k: Array) -> Any:
        """Y per nodal force."""
        ops = self.operators
        return condensed(ops.compliance, ops.area * k)

    def relative_compliance(self, k: Array) -> Array:  # noqa: ARG002, without inertia
        """Velocities of the channels per nodal force for Newton's method, (n_channel, n_channel): D; search direction k
        (n_channel,), Pa s m-1."""
        compliance: Array = self.operators.compliance.dense() if self.swept else self.operators.compliance
        return compliance

    @property
    def response(self) -> Array:
        """Y for the k of the last ``bind``, velocities per traction, (n_channel, n_channel)."""
        if self._response is None:
            self._response = self.condensed * self.operators.area
        return self._response

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
        if self._begun:
            self.forcing.set_motion_state(self.motions())
            self._resumed = None
        self._use(dt)
        self.forcing.begin(histories, dt)
        self.instant = 0
        if not self._begun:
            self._set(*self._initial())
            self._opening = np.zeros((self.n_channel, len(self.members)))
        self._begun = True

    def _initial(self) -> tuple[Array, Array]:
        """Initial displacements and velocities; accelerations come with ``start``."""
        if not any(m.displacement.any() or m.velocity.any() for m in self.members) and not self.forcing.moves:
            return np.zeros((self.n_dof, len(self.members))), np.zeros((self.n_dof, len(self.members)))
        p = self.members[0].expansion
        u = closest_reduced(p, np.stack([m.displacement for m in self.members], axis=1) - self.forcing.imposed_u(0))
        v = closest_reduced(p, np.stack([m.velocity for m in self.members], axis=1) - self.forcing.imposed_v(0))
        return u, v

    @abstractmethod
    def initial_unbalance(self, traction: Array) -> Array:
        """M a of the free dofs at t = 0 under tractions (n_channel, n_member); (n_dof, n_member), N."""

    @abstractmethod
    def mass_factor(self) -> MassFactor:
        """Solver with the mass matrix, for the accelerations at t = 0."""

    def initial_channels(self, factor: Any, unbalance: Array) -> tuple[Array, Any]:
        """Channel accelerations (n_channel, n_member) at t = 0, and what multiplies by T M^-1 T^T."""
        ops = self.operators
        compliance: Any = MassCompliance(factor, ops)
        if not self.swept:
            spread = np.zeros((self.n_dof, self.n_channel))
            spread[ops.dofs] = ops.trace.T if isinstance(ops.trace, np.ndarray) else ops.trace.T.toarray()
            compliance = ops.trace @ factor.solve(spread)[ops.dofs]
        free: Array = ops.trace @ factor.solve(unbalance)[ops.dofs]
        imposed = self.forcing.channel_acceleration(0)
        return free if imposed is None else free + imposed, compliance

    def start(self, traction: Array, factor: MassFactor | None) -> None:
        """Consistent accelerations at t = 0 with tractions, Pa; ``factor`` None for a start at rest in equilibrium."""
        unbalance = self.initial_unbalance(traction)
        inertia = self.forcing.inertia(0)
        residual = unbalance if inertia is None else unbalance + inertia
        u, v = self.state.u, self.state.v
        a = np.zeros_like(unbalance) if factor is None else factor.solve(unbalance)
        mass_old, force_old = self.scheme.old_weights
        if force_old:
            residual = mass_old * (self.operators.mass @ a) - force_old * self.forcing.at(0)
            residual += 0.0 if inertia is None else mass_old * inertia
        self._set(u, v, a, residual)
        self._opening = np.array(traction)

    def _nodal(self, traction: Array) -> Array:
        """Forces on all dofs (n_dof, n_member), N, of channel tractions."""
        ops = self.operators
        force = np.zeros((self.n_dof, traction.shape[1]))
        force[ops.dofs] = ops.spread @ (ops.area[:, None] * traction)
        return force

    # -- the class in the image of a run ------------------------------------------------------------------------
    def attach(self, image: Image, number: int) -> None:
        """Move the motion into an image, as its class ``number``."""
        own, account = dict(zip(("u", "v", "a", "residual"), self.state[1:], strict=True)), self._energy()
        self._image, self._class, self._own = image, number, {}
        self._alone_since = None
        self._set(*own.values())
        if account is not None and account.size == self._energy().size:  # type: ignore[union-attr]
            self._energy()[:] = account  # type: ignore[index]

    def _detach(self) -> None:
        """Keep a copy of the motion: the image belongs to other operators."""
        if self._image is None:
            return
        self._account = None if self._energy() is None else self._energy().copy()  # type: ignore[union-attr]
        self._own = {
            name: field.copy() for name, field in zip(("u", "v", "a", "residual"), self.state[1:], strict=True)
        }
        self._image = None

    def _part(self, first: str, size: int) -> Array:
        assert self._image is not None
        at = self._image.row(self._class)[first]
        return self._image.moving[at : at + size]

    def _field(self, name: str) -> Array:
        """One field (n, m) of the present motion, a view where it stands in an image."""
        if self._image is None:
            return self._own[name]
        return self._part(name, self.n_dof * len(self.members)).reshape(self.n_dof, len(self.members))

    def _energy(self) -> Array | None:
        """The account of energies, in the image or kept for one."""
        if not self.energy:
            return None
        if self._image is None:
            return self._account
        return self._part("energy", self._image.row(self._class)["n_energy"])

    def _opened(self) -> Array | None:
        """The account of energies, begun where it is not yet."""
        if self.energy and self._image is None and self._begun and self._account is None:
            self._alone()
        return self._energy()

    @property
    def state(self) -> Motion:
        """Present motion (views where it stands in an image)."""
        return Motion(self.instant, *(self._field(name) for name in ("u", "v", "a", "residual")))

    def _set(self, u: Array, v: Array, a: Array | None = None, residual: Array | None = None) -> None:
        zero = np.zeros_like(u)
        new = (u, v, zero if a is None else a, zero if residual is None else residual)
        if self._image is None:
            self._own = dict(zip(("u", "v", "a", "residual"), (np.array(x) for x in new), strict=True))
            return
        for into, x in zip(self.state[1:], new, strict=True):
            into[...] = x
        self._part("rest", 1)[0] = float(not any(x.any() for x in new))

    @property
    def totals(self) -> dict[str, Array]:
        """Terms of the account of energies at the present instant, (n_member,) each, J."""
        account = self._opened()
        assert account is not None, "energies are not accounted for"
        m = len(self.members)
        return {term: account[i * m : (i + 1) * m].copy() for i, term in enumerate(TERMS)}

    # -- one instant, alone -------------------------------------------------------------------------------------
    def _alone(self) -> Image:
        """The image of the run, or one of this class only, with the operators of now."""
        if self._image is None:
            m = len(self.members)
            flat = np.arange(self.n_channel * m, dtype=np.int64).reshape(self.n_channel, m)
            run = {"area": np.repeat(self.operators.area, m), "static": int(self.scheme.name == "quasi_static")}
            self._image = Image([self], [flat], np.ones(flat.size, dtype=bool), run=run)
            self._alone_since, self._bound_alone = object(), None
        image = self._image
        if self._alone_since is None:
            return image
        if self._bound_alone is not self.k:
            image.bind(0, afresh=True)
            self._bound_alone = self.k
        if self._alone_since is not self.forcing.token:
            image.begin(self.forcing.n_time, {})
            self._alone_since = self.forcing.token
        if self._opening is not None:
            image.field("f_hat", *self._opening.shape)[:] = self._opening
            image.set({"first_row": self.instant})
            image.call(entries.OPEN_ACCOUNTS)
            self._opening = None
        return image

    def predict(self) -> Array:
        """March to the next instant without interface forces; velocities of the channels."""
        image = self._alone()
        image.set({"first_row": self.instant + 1})
        image.call(entries.PREDICT, self._class, self.instant + 1)
        return (
            self._part("w_free", self.n_channel * len(self.members)).reshape(self.n_channel, len(self.members)).copy()
        )

    def respond(self, q: Array) -> Array:
        """W for q after ``predict``."""
        image = self._alone()
        image.field("q", q.size)[:] = q.reshape(-1)
        image.call(entries.RESPOND, self._class)
        return image.field("w", *q.shape).copy()

    def commit(self, traction: Array) -> None:
        """End the instant with tractions (a quasi-static class: incoming quantities q), Pa."""
        image = self._alone()
        image.field("local_f", *traction.shape)[:] = traction
        if self.scheme.name == "quasi_static":  # tractions are what the springs leave of q
            image.field("f", *traction.shape)[:] = traction - self.k * self.respond(traction)
        image.call(entries.END_CLASS, self._class, self.instant + 1)
        self.instant += 1

    # -- reading the state --------------------------------------------------------------------------------------
    def channel_velocity(self) -> Array:
        """Velocities at the channels, m s-1."""
        return self._at(self.state.v, self.forcing.channel_velocity(self.instant))

    def channel_displacement(self) -> Array:
        """Displacements at the channels that gaps are read from, m."""
        u = self._at(self.state.u, self.forcing.channel_displacement(self.instant))
        lead = self.scheme.gap_offset(self.dt)
        return u + lead * self.channel_velocity() if lead else u

    def channel_acceleration(self) -> Array:
        """Accelerations at the channels, m s-2."""
        return self._at(self.state.a, self.forcing.channel_acceleration(self.instant))

    def _at(self, field: Array, imposed: Array | None) -> Array:
        values: Array = self.operators.trace @ field[self.operators.dofs]
        return values if imposed is None else values + imposed

    def full_displacement(self, member: int) -> Array:
        """Displacements of all nodes of a member, (n_node, 3), m."""
        return self._full(self._field("u"), self.forcing.imposed_u(self.instant), member)

    def full_velocity(self, member: int) -> Array:
        """Velocities of all nodes of a member, (n_node, 3), m s-1."""
        return self._full(self._field("v"), self.forcing.imposed_v(self.instant), member)

    def _full(self, field: Array, imposed: Array, member: int) -> Array:
        model = self.members[member]
        return model.node_values(model.expansion @ field[:, member] + imposed[:, member])

    def sample(self) -> None:  # noqa: B027, most propagators have no remarks
        """Add the present state to ``sampled``, the data of ``remarks``."""

    def remarks(self) -> list[str]:
        """Sentences on the accuracy of the results of this propagator."""
        return []

    # -- windows and segments -----------------------------------------------------------------------------------
    def snapshot(self) -> tuple[int, list[Array], Array | None]:
        """All that determines the next instants of this segment."""
        account = self._opened()
        return self.instant, [x.copy() for x in self.state[1:]], None if account is None else account.copy()

    def restore(self, snapshot: tuple[int, list[Array], Array | None]) -> None:
        """Return to the state and the energies of a ``snapshot``."""
        self.instant, fields, account = snapshot
        self._set(*fields)
        if account is not None:
            if self._image is None:
                self._account = account.copy()
            else:
                self._energy()[:] = account  # type: ignore[index]

    def restart(self) -> None:
        """Back to the initial values; ``begin`` must follow."""
        self._begun, self._resumed = False, None
        self.forcing.set_motion_state([None] * len(self.members))

    def motions(self) -> list[MotionState]:
        """State of the prescribed motions that the next segment starts from."""
        return self.forcing.motion_state(self.instant) if self._resumed is None else self._resumed

    def resume(self, image: Image, number: int, motions: list[MotionState]) -> None:
        """Go on from the state in an image, as its class ``number``, and from ``motions``; ``begin`` must follow."""
        self._image, self._class, self._own = image, number, {}
        self.instant, self._resumed, self._opening = 0, motions, None


def accuracy_remarks(propagators: Sequence[Propagator]) -> list[str]:
    """Sentences on approximations whose error may exceed the tolerance of the iteration."""
    return [remark for p in propagators for remark in p.remarks()]
