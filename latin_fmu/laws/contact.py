"""Unilateral contact with Coulomb friction, Eqs. (18)-(23).

With w = (s' - s).N the opening velocity without traction and g the normalised gap,

    P = max(0, -(w + g)) / z_n                             end-of-instant Signorini law
    G = (s' - s)_t / z_t                                   traction that would stop the sliding
    F_hat_t = G                   if |G| <= mu P   (22) stick
            = mu P G / |G|        otherwise        (23) slip

The opening velocity is then max(w, -g); for equal k on both sides and a closed gap P = -k C_n with the contact
indicator C_n = w / 2 of (20), and G is G_n of (21).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..compiled import kernel
from .base import Array, PointLaw
from .parts import PointState, Unknowns, add_unknown, friction, friction_status, friction_tangent


@kernel
def value(point: PointState, traction: Array) -> None:
    """P = max(0, -((s' - s)_n + reach)) / z_n, and friction; parameter mu."""
    # z = 0: both sides are held, and no pressure is determined
    pressure = max(0.0, -(point.jump[0] + point.reach[0])) / point.z[0] if point.z[0] > 0.0 else 0.0
    traction[0] = -pressure
    friction(pressure, point.parameters[0], point, traction)


@kernel
def tangent(point: PointState, unknowns: Unknowns) -> int:
    """Unknowns of a pressed point: its pressure, and those of friction."""
    closing = -(point.jump[0] + point.reach[0])
    if not (closing > 0.0 and point.z[0] > 0.0):
        return 0
    # regular where several interfaces hold the point (``kernels.newton``)
    add_unknown(0, 0, unknowns.proximal * point.z[0], unknowns)
    return friction_tangent(closing / point.z[0], point.parameters[0], point, unknowns)


@kernel
def point_status(traction: Array, parameters: Array, no_contact: float) -> int:
    """By the friction cone."""
    return friction_status(traction, parameters[0], no_contact)


@dataclass(frozen=True)
class Contact(PointLaw):
    """Unilateral contact; ``friction_coefficient`` is Coulomb's (0: frictionless, normal unknowns only)."""

    friction_coefficient: float = 0.0
    name: ClassVar[str] = "contact"
    opens: ClassVar[bool] = True
    tangential: ClassVar[str] = "friction_coefficient"
    value = staticmethod(value)
    tangent = staticmethod(tangent)
    point_status = staticmethod(point_status)
