"""Interfaces that may open: contact with Coulomb friction, contact without slip, contact through an elastic layer.

Signs: N from E to E', F_hat on side E, pressure P = -F_hat.N >= 0, z summed over both sides. w = (s' - s).N is the
opening velocity without traction, g the normalised gap (``interface.behaviour``, rule 3).

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
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..kernels.laws import ON_CONE
from .behaviour import SEPARATION, SLIP, STICK, Array, Behaviour, PointLaw, Status


def coulomb_coefficient(behaviour: Behaviour) -> float | None:
    """Coulomb's mu of a behaviour, of the caller's own too; 0 without friction, None where the law has no mu."""
    coefficient: float | None = getattr(behaviour, "friction_coefficient", None)
    return coefficient


@dataclass(frozen=True)
class Contact(PointLaw):
    """Unilateral contact; ``friction_coefficient`` is Coulomb's (0: frictionless, normal unknowns only)."""

    friction_coefficient: float = 0.0
    name: ClassVar[str] = "contact"
    opens: ClassVar[bool] = True
    tangential: ClassVar[str] = "friction_coefficient"

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
    tangential: ClassVar[str] = "friction_coefficient"
    status = staticmethod(Contact.status)

    @staticmethod
    def stored_energy(traction: Array, parameters: Array) -> Array:
        """P^2 / (2 k_n) per area, J m-2."""
        energy: Array = 0.5 * traction[..., 0] ** 2 / parameters[:, 1]
        return energy
