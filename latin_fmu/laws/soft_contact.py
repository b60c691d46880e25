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
from .parts import add_unknown, friction, friction_status, friction_tangent


@kernel
def value(jump: Array, z: Array, reach: Array, rate: float, parameters: Array, traction: Array) -> None:
    """P = k_n max(0, -gap), and friction; parameters mu and k_n, N m-3."""
    pressure = parameters[1] * max(0.0, -(jump[0] + reach[0])) / (rate + parameters[1] * z[0])
    traction[0] = -pressure
    friction(pressure, parameters[0], jump, z[1], traction)


@kernel
def tangent(
    jump: Array,
    z: Array,
    reach: Array,
    rate: float,
    parameters: Array,
    proximal: float,
    columns: Array,
    rows: Array,
    softness: Array,
) -> int:
    """Unknowns of a pressed point: its pressure, softer by the layer, and those of friction."""
    closing, stiffness = -(jump[0] + reach[0]), parameters[1]
    if not (closing > 0.0 and stiffness > 0.0):
        return 0
    # what the layer adds to z
    soft = rate / stiffness
    add_unknown(0, 0, soft, columns, rows, softness)
    pressure = closing / (z[0] + soft)
    return friction_tangent(pressure, parameters[0], jump, z[1], proximal * z[1], columns, rows, softness)


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
