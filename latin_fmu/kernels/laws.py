"""Laws of interfaces, one point at a time: traction on side E from the relative free velocity of the sides.

At one instant, with s = W - F / k on each side (the velocity it would take without traction), z = 1/k summed over both
sides and the opening velocity d = (s' - s) - z F_hat, a law is a relation between F_hat and d, N from E to E'. Its
explicit solution, point by point, is the local stage (15)-(17). Components are N, t1, t2 (N alone where h = 1).

    jump         (h,) s' - s, m s-1
    z            (2,) normal and tangential, m3 N-1 s-1; 0 where both sides are held
    reach        (1,) normalised gap max(gap, 0) / dt, m s-1; for elastic laws (h,), jump of displacement x rate
    rate         1/dt; for elastic laws 1 / (displacement per velocity of the instant), s-1
    parameters   of the law
    traction     (h,) F_hat, Pa, written
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..compiled import entry, kernel

Array = NDArray[np.float64]

PERFECT, CONTACT, NO_SLIP, ELASTIC_LAYER, SOFT_CONTACT, VISCOUS_JOINT = range(6)
LAWS: Final = {
    "perfect": PERFECT,
    "contact": CONTACT,
    "no_slip": NO_SLIP,
    "elastic_layer": ELASTIC_LAYER,
    "soft_contact": SOFT_CONTACT,
    "viscous_joint": VISCOUS_JOINT,
}
"""Code of each compiled law, by its name in the registry of behaviours."""


@kernel
def perfect(jump: Array, z: Array, traction: Array) -> None:
    """Perfect connection (7), W = W', F + F' = 0: F_hat = (s' - s) / z; 0 where both sides are held."""
    for i in range(len(jump)):
        both = z[min(i, 1)]
        traction[i] = jump[i] / both if both > 0.0 else 0.0


@kernel
def coulomb(pressure: float, friction: float, jump: Array, z: float, traction: Array) -> None:
    """Friction (21)-(23) under a pressure P: G = (s' - s)_t / z_t sticks where |G| <= mu P, else mu P G / |G|."""
    for i in range(1, len(jump)):
        traction[i] = 0.0
    if len(jump) == 1 or z <= 0.0 or pressure <= 0.0:
        return
    # limit: velocity that the cone can stop
    norm, limit = np.hypot(jump[1], jump[2]), friction * pressure * z
    scale = 1.0 if norm <= limit else limit / norm
    traction[1] = scale * jump[1] / z
    traction[2] = scale * jump[2] / z


@kernel
def contact(jump: Array, z: Array, reach: Array, parameters: Array, traction: Array) -> None:
    """Unilateral contact (20) with friction: P = max(0, -((s' - s)_n + reach)) / z_n, end-of-instant Signorini law."""
    pressure = max(0.0, -(jump[0] + reach[0])) / z[0] if z[0] > 0.0 else 0.0
    traction[0] = -pressure
    coulomb(pressure, parameters[0], jump, z[1], traction)


@kernel
def no_slip(jump: Array, z: Array, reach: Array, rate: float, parameters: Array, traction: Array) -> None:
    """Contact whose points do not slide while the gap at the start of the instant is below ``parameters[0]``, m."""
    closing = -(jump[0] + reach[0])
    traction[0] = -closing / z[0] if closing > 0.0 and z[0] > 0.0 else 0.0
    held = reach[0] <= rate * parameters[0] and z[1] > 0.0
    for i in range(1, len(jump)):
        traction[i] = jump[i] / z[1] if held else 0.0


@kernel
def elastic_layer(jump: Array, z: Array, reach: Array, rate: float, parameters: Array, traction: Array) -> None:
    """Bonded layer F_hat = k_l [u]: F_hat = k_l (s' - s + reach) / (rate + k_l z), parameters k_n and k_t, N m-3."""
    for i in range(len(jump)):
        stiffness = parameters[min(i, 1)]
        traction[i] = stiffness * (jump[i] + reach[i]) / (rate + stiffness * z[min(i, 1)])


@kernel
def soft_contact(jump: Array, z: Array, reach: Array, rate: float, parameters: Array, traction: Array) -> None:
    """Contact through a layer, P = k_n max(0, -gap), with friction; parameters mu and k_n, N m-3."""
    pressure = parameters[1] * max(0.0, -(jump[0] + reach[0])) / (rate + parameters[1] * z[0])
    traction[0] = -pressure
    coulomb(pressure, parameters[0], jump, z[1], traction)


@kernel
def viscous_joint(jump: Array, z: Array, parameters: Array, traction: Array) -> None:
    """Dashpots F_hat = c d: F_hat = c (s' - s) / (1 + c z), parameters c_n and c_t, N s m-3."""
    for i in range(len(jump)):
        viscosity = parameters[min(i, 1)]
        traction[i] = viscosity * jump[i] / (1.0 + viscosity * z[min(i, 1)])


@kernel
def apply(law: int, jump: Array, z: Array, reach: Array, rate: float, parameters: Array, traction: Array) -> None:
    """The law with this code at one point."""
    if law == PERFECT:
        perfect(jump, z, traction)
    elif law == CONTACT:
        contact(jump, z, reach, parameters, traction)
    elif law == NO_SLIP:
        no_slip(jump, z, reach, rate, parameters, traction)
    elif law == ELASTIC_LAYER:
        elastic_layer(jump, z, reach, rate, parameters, traction)
    elif law == SOFT_CONTACT:
        soft_contact(jump, z, reach, rate, parameters, traction)
    else:
        viscous_joint(jump, z, parameters, traction)


@entry("i8, f8[:, ::1], f8[:, ::1], f8[:, ::1], f8, f8[:, ::1], f8[:, ::1]")
def apply_to_points(law: int, jump: Any, z: Any, reach: Any, rate: float, parameters: Any, traction: Any) -> None:
    """The law with this code at all points; arrays (n_point, ...)."""
    for p in range(len(jump)):
        apply(law, jump[p], z[p], reach[p], rate, parameters[p], traction[p])


def apply_law(law: int, jump: Array, z: Array, reach: Array, rate: float, parameters: Array) -> Array:
    """Tractions (n_point, n_component) on side E by the law with this code; arguments as for
    ``interface.behaviour.Behaviour.local``."""
    traction = np.zeros_like(jump, dtype=float)
    reach = reach if reach.ndim == 2 else reach[:, None]
    jump, z, reach, parameters = (np.ascontiguousarray(x, dtype=float) for x in (jump, z, reach, parameters))
    apply_to_points(law, jump, z, reach, float(rate), parameters, traction)
    return traction
