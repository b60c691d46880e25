"""Laws of interfaces: the contract of a behaviour, and the behaviours of the package by name.

A behaviour relates, at one instant and one point, the traction of an interface to the motion of its two sides. The
linear stage gives for each side the velocity without traction of the interface,

    s = W - F / k,

and the search direction E+ gives ``W_hat = s + F_hat / k``. With z = 1/k summed over both sides, the behaviour is a
relation between the relative free velocity ``s' - s`` and the traction on side E. Components are those of the local
frame (N, t1, t2), N from E to E'; a frictionless interface has N only.

Rules

1. Pure and vectorised over points: no mesh, no matrix, no time step, inputs unchanged.
2. ``local`` satisfies the relation and E+ to round-off; the solver sets F_hat_E' = -F_hat_E.
3. The state at the start of the instant enters as the normalised gap g, m s-1. For unilateral contact it is the open
   gap over dt, that is the velocity that closes it within the instant; ``rate`` is then 1/dt. For an ``elastic``
   behaviour it is the jump of displacement times ``rate``, shape (n_point, n_component), signed, the initial gap along
   N included: with d = W_hat' - W_hat the time scheme gives the jump of the new instant

       [u] = (g + d) / rate.

4. A layer of stiffness k_l therefore acts as an added compliance ``rate / k_l``.
5. Parameters are arrays per point, (n_point, n_parameter), so that interfaces of one class are solved together.
6. A ``compliant`` behaviour has a definite traction also where both sides are held (z = 0): it follows from the jumps
   alone, at the start of a run too. The others give no traction there.
7. ``local`` may be written in plain NumPy: the Python driver calls it. A behaviour with ``compiled = True`` has its law
   in ``kernels.laws`` under its name, and ``local`` applies it; the compiled driver needs that. ``PointLaw`` has
   defaults for both.
8. ``keeps`` says where the law fixes velocities only and the place of the sides follows from them: along N, where
   points are pressed or bonded, and along the face, where they stick. There the solver carries its own error of place
   along and makes it up (``kernels.local_stage``). A law that reads displacements needs none, one of velocities alone
   fixes none.

Interfaces that may open: contact with Coulomb friction, contact without slip, contact through an elastic layer.

Signs: N from E to E', F_hat on side E, pressure P = -F_hat.N >= 0, z summed over both sides. w = (s' - s).N is the
opening velocity without traction, g the normalised gap (rule 3).

Contact with friction, Eqs. (18)-(23):

    P = max(0, -(w + g)) / z_n                             end-of-instant Signorini law
    G = (s' - s)_t / z_t                                   traction that would stop the sliding
    F_hat_t = G                   if |G| <= mu P   (22) stick
            = mu P G / |G|        otherwise        (23) slip

The opening velocity is then max(w, -g); for equal k on both sides and a closed gap P = -k C_n with the contact
indicator C_n = w / 2 of (20), and G is G_n of (21).

Contact without slip has the same normal law. Tangentially a point whose gap at the start of the instant is at most
``touch`` does not slide within the instant, pressed or not; a point that closes within the instant slides freely until
it has closed:

    F_hat_t = G   where the gap is at most ``touch``,   else 0

``touch`` is a small part of the distance that the loads can close within an instant: with touch = 0 a pressed point
would slide over a gap of the size of a rounding error. It is the limit of Coulomb's law for mu -> infinity that stays
solvable: the closure of Coulomb's cone is the half space P >= 0, shear without pressure belongs to it. Stick then
depends on the past only, the problem of the instant is convex and the iteration converges, where a very large friction
coefficient (stick from the smallest pressure on) may not. The status follows the traction: stick wherever there is
any, separation only where there is none.

Contact through an elastic layer: the pressure follows the compression of the layer, which may be there from the start
(an interference),

    P = k_n max(0, -gap) = k_n max(0, -(w + g)) / (rate + k_n z_n),   gap of the new instant = (g + w + z_n P) / rate,

with the friction of contact, Eqs. (22), (23). A layer of finite stiffness spreads an impact over time, gives no force
peak that depends on the mesh, and conserves the energy it stores; k_n -> infinity is contact.

Interfaces whose sides stay together: perfect connection, elastic layer, viscous joint.

Perfect connection, Eq. (7): W = W', F + F' = 0. The traction F_hat = (s' - s) / z closes the velocity jump; where both
sides are held (z = 0) it is not determined and is set to zero.

Elastic layer, a thin bonded joint whose traction follows the jump of displacement [u] = u' - u:

    F_hat.N = k_n [u].N,   F_hat_t = k_t [u]_t   on side E (a layer that is pulled open pulls E along N)

With the jump of the new instant [u] = (g + d) / rate (rule 3) and the opening velocity
d = (s' - s) - z F_hat,

    F_hat = k (s' - s + g) / (rate + k z)

for each direction: the layer adds the compliance rate / k to those of the sides, and for k -> infinity it is the
perfect connection. Massless, without thickness; a preload enters as an initial jump -p / k_n.

Viscous joint, a dashpot per area:

    F_hat.N = c_n d.N,   F_hat_t = c_t d_t,   d = W_hat' - W_hat,   hence   F_hat = c (s' - s) / (1 + c z)

It has no memory; for c -> infinity it is the perfect connection, and c = rho c_p on a face against the ground lets
normal waves out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar, Final, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from ..kernels.laws import LAWS, ON_CONE, apply_law

Array = NDArray[np.float64]
Status = NDArray[np.int8]

SEPARATION, STICK, SLIP = 0, 1, 2


class Behaviour(Protocol):
    """Relation between traction and motion of the sides of an interface (rules in the module docstring)."""

    name: ClassVar[str]
    opens: ClassVar[bool]  # has a gap and a contact status
    compliant: ClassVar[bool]  # traction known from the jumps of displacement and velocity (rule 6)
    elastic: ClassVar[bool]  # depends on the jump of displacement (rule 3)
    keeps: ClassVar[tuple[bool, bool]]  # fixes the place of held points, along N and in the tangents (rule 8)

    @property
    def n_component(self) -> int:
        """Unknowns per point: 1 (normal only) or 3."""

    def point_parameters(self, n_point: int) -> Array:
        """Parameters per point, (n_point, n_parameter)."""

    def local(self, jump: Array, z: Array, normalised_gap: Array, rate: float, parameters: Array, /) -> Array:
        """Traction on side E that satisfies the behaviour.

        Parameters
        ----------
        jump : (n_point, n_component) relative free velocity s' - s, m s-1.
        z : (n_point, 2) sum of 1/k of both sides, normal and tangential, m3 N-1 s-1.
        normalised_gap : (n_point,), (n_point, n_component) where ``elastic``, m s-1, see rule 3.
        rate : s-1, see rule 3. parameters : (n_point, n_parameter).

        Returns
        -------
        (n_point, n_component) F_hat on side E, Pa.
        """

    def status(self, traction: Array, parameters: Array, /) -> Status:
        """Separation 0, stick 1, slip 2 from F_hat; leading axes free, last one the components."""


class Layer(Behaviour, Protocol):
    """A behaviour that stores energy."""

    def stored_energy(self, traction: Array, parameters: Array, /) -> Array:
        """Elastic energy per area, J m-2, from F_hat; leading axes free, last one the components."""


class PointLaw:
    """Base of behaviours: frozen dataclasses whose fields are the parameters of the law.

    The law is the one of that name in ``kernels.laws``; the sides stay together unless a subclass sets ``opens``. A law
    in NumPy overrides ``local`` and sets ``compiled = False``.
    """

    name: ClassVar[str]
    compiled: ClassVar[bool] = True
    opens: ClassVar[bool] = False
    compliant: ClassVar[bool] = False
    elastic: ClassVar[bool] = False
    keeps: ClassVar[tuple[bool, bool]] = (True, True)
    tangential: ClassVar[str] = ""  # parameter without which the points have no tangential unknowns

    @property
    def n_component(self) -> int:
        """3; 1 where the parameter named by ``tangential`` is zero."""
        return 3 if not self.tangential or getattr(self, self.tangential) > 0 else 1

    def point_parameters(self, n_point: int) -> Array:
        """Fields of the dataclass in their order, (n_point, n_parameter)."""
        return np.tile(np.array([*vars(self).values()], dtype=float), (n_point, 1))

    @classmethod
    def local(cls, jump: Array, z: Array, normalised_gap: Array, rate: float, parameters: Array) -> Array:
        """F_hat on side E, the explicit solution per point (``Behaviour.local``)."""
        return apply_law(LAWS[cls.name], jump, z, normalised_gap, rate, parameters)

    @staticmethod
    def status(traction: Array, parameters: Array) -> Status:
        """Stick at every point."""
        return np.full(traction.shape[:-1], STICK, dtype=np.int8)


def bonds(behaviour: Behaviour) -> bool:
    """Whether the behaviour keeps the velocities of both sides equal."""
    return not (behaviour.opens or behaviour.compliant)


def as_layer(behaviour: Behaviour) -> Layer | None:
    """The behaviour as one that stores energy, None where it does not."""
    return cast(Layer, behaviour) if behaviour.elastic else None


FRICTION: Final = "friction_coefficient"
"""Key of Coulomb's mu."""


def coulomb_coefficient(behaviour: Behaviour) -> float | None:
    """Coulomb's mu of a behaviour, of the caller's own too; 0 without friction, None where the law has no mu."""
    coefficient: float | None = getattr(behaviour, FRICTION, None)
    return coefficient


@dataclass(frozen=True)
class Contact(PointLaw):
    """Unilateral contact; ``friction_coefficient`` is Coulomb's (0: frictionless, normal unknowns only)."""

    friction_coefficient: float = 0.0
    name: ClassVar[str] = "contact"
    opens: ClassVar[bool] = True
    tangential: ClassVar[str] = FRICTION

    @staticmethod
    def status(traction: Array, parameters: Array) -> Status:
        """Separation where P = 0, slip on the friction cone, else stick."""
        pressure = -traction[..., 0]
        status = np.full(pressure.shape, SLIP, dtype=np.int8)
        if traction.shape[-1] > 1:
            shear2 = traction[..., 1] ** 2 + traction[..., 2] ** 2
            limit = ON_CONE * parameters[:, 0] * pressure
            status[(shear2 < limit * limit) & (limit > 0)] = STICK
        status[pressure <= 0] = SEPARATION
        return status


@dataclass(frozen=True)
class NoSlip(PointLaw):
    """Contact of surfaces that never slide on each other; ``touch`` : gap that counts as closed, m."""

    touch: float = 0.0
    name: ClassVar[str] = "no_slip"
    opens: ClassVar[bool] = True

    @staticmethod
    def status(traction: Array, parameters: Array) -> Status:
        """Stick where there is any traction, else separation."""
        loaded = (traction[..., 0] < 0) | (traction[..., 1:] != 0).any(axis=-1)
        return np.where(loaded, STICK, SEPARATION).astype(np.int8)


@dataclass(frozen=True)
class SoftContact(PointLaw):
    """Unilateral elastic layer of stiffness per area N m-3, with Coulomb friction."""

    friction_coefficient: float = 0.0
    normal_stiffness: float = 1.0
    name: ClassVar[str] = "soft_contact"
    opens: ClassVar[bool] = True
    compliant: ClassVar[bool] = True
    elastic: ClassVar[bool] = True
    keeps: ClassVar[tuple[bool, bool]] = (False, True)
    tangential: ClassVar[str] = FRICTION
    status = staticmethod(Contact.status)

    @staticmethod
    def stored_energy(traction: Array, parameters: Array) -> Array:
        """P^2 / (2 k_n) per area, J m-2."""
        energy: Array = 0.5 * traction[..., 0] ** 2 / parameters[:, 1]
        return energy


@dataclass(frozen=True)
class Perfect(PointLaw):
    """Bonded faces: equal velocities, opposite tractions."""

    name: ClassVar[str] = "perfect"


@dataclass(frozen=True)
class Rods(Perfect):
    """Points bonded along N alone, as by rigid rods with hinges at their ends."""

    @property
    def n_component(self) -> int:
        """Unknowns per point, the force of the rod."""
        return 1


@dataclass(frozen=True)
class ElasticLayer(PointLaw):
    """Bonded elastic layer; stiffness per area in N m-3 (E / thickness, G / thickness of an adhesive)."""

    normal_stiffness: float = 0.0
    tangential_stiffness: float = 0.0
    name: ClassVar[str] = "elastic_layer"
    compliant: ClassVar[bool] = True
    elastic: ClassVar[bool] = True
    keeps: ClassVar[tuple[bool, bool]] = (False, False)
    tangential: ClassVar[str] = "tangential_stiffness"

    @staticmethod
    def stored_energy(traction: Array, parameters: Array) -> Array:
        """F.[u] / 2 per area, J m-2."""
        stiffness = parameters[:, [0, *[1] * (traction.shape[-1] - 1)]]
        flexibility = np.divide(1.0, stiffness, out=np.zeros_like(stiffness), where=stiffness > 0)
        energy: Array = 0.5 * (flexibility * traction**2).sum(axis=-1)
        return energy


@dataclass(frozen=True)
class ViscousJoint(PointLaw):
    """Dashpots between the sides; viscosity per area in N s m-3."""

    normal_viscosity: float = 0.0
    tangential_viscosity: float = 0.0
    name: ClassVar[str] = "viscous_joint"
    compliant: ClassVar[bool] = True
    keeps: ClassVar[tuple[bool, bool]] = (False, False)
    tangential: ClassVar[str] = "tangential_viscosity"


BEHAVIOURS: Mapping[str, Callable[..., Behaviour]] = MappingProxyType(
    {law.name: law for law in (Perfect, Contact, NoSlip, ElasticLayer, SoftContact, ViscousJoint)}
)
