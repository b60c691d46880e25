"""Interfaces that may open: contact with Coulomb friction, contact without slip, contact through an elastic layer.

contact
-------
Unilateral contact with gap and Coulomb friction, Eqs. (18)-(23).

Signs: N from E to E', F_hat on side E, pressure P = -F_hat.N >= 0. With the free opening velocity
w = (s' - s).N and reach = gap / dt,

    P = max(0, -(w + reach)) / (z_n + z_n')                    end-of-instant Signorini law
    G = (s' - s)_t / (z_t + z_t')                              traction that would stop the sliding
    F_hat_t = G                   if |G| <= mu P   (22) stick
            = mu P G / |G|        otherwise        (23) slip

The opening velocity is then max(w, -reach); for equal k on both sides and a closed gap P = -k C_n with the
contact indicator C_n = w / 2 of (20), and G is G_n of (21).


no_slip
-------
Unilateral contact without slip: the limit of Coulomb's law for mu -> infinity that stays solvable.

Normal law as in ``contact``: P = max(0, -(w + reach)) / (z_n + z_n'). Tangentially a point that is in touch at the
start of the instant does not slide in it, pressed or not; one that arrives within the instant slides freely until it
has arrived:

    F_hat_t = (s' - s)_t / (z_t + z_t')   where the gap is at most ``touch``,   else 0

``touch`` is a small part of the distance that the loads can close within an instant: were it zero, a pressed point
would lose hold over a gap of the size of a rounding error.

The closure of Coulomb's cone for mu -> infinity is the half space P >= 0: shear without pressure belongs to it, so
that touch alone may hold a point. Stick then depends on the past only, the instant is a convex problem and the
iteration converges, where a huge friction coefficient (stick from the first trace of pressure) may not.


soft_contact
------------
Contact through an elastic layer: Signorini's law made smooth by a stiffness, with Coulomb friction.

The pressure follows the compression of the layer, which may be there from the start (an interference):

    P = k_n max(0, -gap),   gap of the new instant = (reach + d) / rate,   d = w + z P

    P = k_n max(0, -(w + reach)) / (rate + k_n z_n)

with the free opening velocity w = (s' - s).N. Friction is that of ``contact`` with this pressure, Eqs. (22), (23). A
layer of finite stiffness spreads an impact over time, gives no force peak that depends on the mesh, and conserves the
energy it stores; k_n -> infinity is ``contact``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..kernels.laws import CONTACT, NO_SLIP, SOFT_CONTACT, apply_law
from .behaviour import SEPARATION, SLIP, STICK, Array, Status

# A stuck point whose traction is this close to the cone counts as slipping.
_ON_CONE = 1 - 1e-10


@dataclass(frozen=True)
class Contact:
    """Unilateral contact; ``friction_coefficient`` is Coulomb's (0: frictionless, normal unknowns only)."""

    friction_coefficient: float = 0.0
    name: ClassVar[str] = "contact"
    compiled: ClassVar[bool] = True
    opens: ClassVar[bool] = True
    compliant: ClassVar[bool] = False
    elastic: ClassVar[bool] = False

    @property
    def n_component(self) -> int:
        """Frictionless contact has no tangential unknowns."""
        return 3 if self.friction_coefficient > 0 else 1

    def point_parameters(self, n_point: int) -> Array:
        """Column 0: friction coefficient."""
        return np.full((n_point, 1), self.friction_coefficient)

    @staticmethod
    def local(jump: Array, z: Array, reach: Array, rate: float, parameters: Array) -> Array:
        """Explicit solution per point (module docstring)."""
        return apply_law(CONTACT, jump, z, reach, rate, parameters)

    @staticmethod
    def status(traction: Array, parameters: Array) -> Status:
        """From the traction alone: open where P = 0; on the cone is slip."""
        pressure = -traction[..., 0]
        status = np.full(pressure.shape, SLIP, dtype=np.int8)
        if traction.shape[-1] > 1:
            shear2 = traction[..., 1] ** 2 + traction[..., 2] ** 2
            limit = _ON_CONE * parameters[:, 0] * pressure
            status[(shear2 < limit * limit) & (limit > 0)] = STICK
        status[pressure <= 0] = SEPARATION
        return status


@dataclass(frozen=True)
class NoSlip:
    """Contact of surfaces that never slide on each other; ``touch`` : gap that counts as closed, m."""

    touch: float = 0.0
    name: ClassVar[str] = "no_slip"
    compiled: ClassVar[bool] = True
    opens: ClassVar[bool] = True
    compliant: ClassVar[bool] = False
    elastic: ClassVar[bool] = False

    @property
    def n_component(self) -> int:
        """Normal and tangential."""
        return 3

    def point_parameters(self, n_point: int) -> Array:
        """Column 0: gap that counts as closed."""
        return np.full((n_point, 1), self.touch)

    @staticmethod
    def local(jump: Array, z: Array, reach: Array, rate: float, parameters: Array) -> Array:
        """Explicit solution per point (module docstring)."""
        return apply_law(NO_SLIP, jump, z, reach, rate, parameters)

    @staticmethod
    def status(traction: Array, parameters: Array) -> Status:
        """Stick where there is any traction."""
        loaded = (traction[..., 0] < 0) | (traction[..., 1:] != 0).any(axis=-1)
        return np.where(loaded, STICK, SEPARATION).astype(np.int8)


@dataclass(frozen=True)
class SoftContact:
    """Unilateral elastic layer of stiffness per area N m-3, with Coulomb friction."""

    normal_stiffness: float = 1.0
    friction_coefficient: float = 0.0
    name: ClassVar[str] = "soft_contact"
    opens: ClassVar[bool] = True
    compliant: ClassVar[bool] = True
    elastic: ClassVar[bool] = True
    compiled: ClassVar[bool] = True

    @property
    def n_component(self) -> int:
        """Without friction no tangential unknowns."""
        return 3 if self.friction_coefficient > 0 else 1

    def point_parameters(self, n_point: int) -> Array:
        """Columns: friction coefficient (where ``contact`` has it), normal stiffness."""
        return np.tile([self.friction_coefficient, self.normal_stiffness], (n_point, 1))

    @staticmethod
    def local(jump: Array, z: Array, reach: Array, rate: float, parameters: Array) -> Array:
        """Explicit solution per point (module docstring)."""
        return apply_law(SOFT_CONTACT, jump, z, reach, rate, parameters)

    @staticmethod
    def status(traction: Array, parameters: Array) -> Status:
        """As for ``contact``."""
        return Contact.status(traction, parameters)

    @staticmethod
    def stored_energy(traction: Array, parameters: Array) -> Array:
        """P^2 / (2 k_n) per area, J m-2."""
        energy: Array = 0.5 * traction[..., 0] ** 2 / parameters[:, 1]
        return energy
