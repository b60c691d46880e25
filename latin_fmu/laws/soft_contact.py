"""Contact through an elastic layer.

The pressure follows the compression of the layer, which may be there from the start (an interference),

    P = k_n max(0, -gap) = k_n max(0, -(w + g)) / (rate + k_n z_n),   gap of the new instant = (g + w + z_n P) / rate,

with the friction of contact, Eqs. (22), (23). A layer of finite stiffness spreads an impact over time, gives no force
peak that depends on the mesh, and conserves the energy it stores; k_n -> infinity is contact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..compiled import kernel
from .base import Array, PointLaw
from .parts import PointState, Unknowns, add_unknown, friction, friction_status, friction_tangent


@kernel
def value(point: PointState, traction: Array) -> None:
    """P = k_n max(0, -gap), and friction; parameters mu and k_n, N m-3."""
    stiffness = point.parameters[1]
    pressure = stiffness * max(0.0, -(point.jump[0] + point.reach[0])) / (point.rate + stiffness * point.z[0])
    traction[0] = -pressure
    friction(pressure, point.parameters[0], point, traction)


@kernel
def tangent(point: PointState, unknowns: Unknowns) -> int:
    """Unknowns of a pressed point: its pressure, softer by the layer, and those of friction."""
    closing = -(point.jump[0] + point.reach[0])
    stiffness = point.parameters[1]
    if not (closing > 0.0 and stiffness > 0.0):
        return 0
    # what the layer adds to z
    soft = point.rate / stiffness
    add_unknown(0, 0, soft, unknowns)
    pressure = closing / (point.z[0] + soft)
    return friction_tangent(pressure, point.parameters[0], point, unknowns)


@kernel
def point_status(traction: Array, parameters: Array, no_contact: float) -> int:
    """By the friction cone."""
    return friction_status(traction, parameters[0], no_contact)


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
    tangential: ClassVar[str] = "friction_coefficient"
    value = staticmethod(value)
    tangent = staticmethod(tangent)
    point_status = staticmethod(point_status)

    @staticmethod
    def stored_energy(traction: Array, parameters: Array) -> Array:
        """P^2 / (2 k_n) per area, J m-2."""
        energy: Array = 0.5 * traction[..., 0] ** 2 / parameters[:, 1]
        return energy
