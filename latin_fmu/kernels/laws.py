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
ON_CONE: Final = 1 - 1e-10
"""A stuck point whose traction is this close to the cone counts as slipping."""


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


@kernel
def contact_status(law: int, traction: Array, parameters: Array, no_contact: float) -> int:
    """Separation 0, stick 1, slip 2 of a point of a contact from F_hat (h,): separation up to a pressure
    ``no_contact`` (``no_slip``: a traction), slip on the friction cone."""
    pressure, carried = -traction[0], -traction[0]
    if law == NO_SLIP:
        for i in range(len(traction)):
            carried = max(carried, abs(traction[i]))
        return 1 if carried > no_contact else 0
    if carried <= no_contact or pressure <= 0.0:
        return 0
    limit = ON_CONE * parameters[0] * pressure
    if len(traction) == 1 or limit <= 0.0:
        return 2
    return 1 if traction[1] * traction[1] + traction[2] * traction[2] < limit * limit else 2


@kernel
def tangent(
    law: int,
    jump: Array,
    z: Array,
    reach: Array,
    rate: float,
    parameters: Array,
    derivative: Array,
    proximal: float,
    columns: Array,
    rows: Array,
    softness: Array,
) -> int:
    """Tangent J = dF_hat / djump of a law at one point, as a sum over unknowns; their number, 0 ... 3.

    J = sum of c_i r_i^T / (z_i + s_i): columns (3, 3) and rows (3, 3) hold c_i and r_i of the unknowns, softness (3, 3)
    the numbers s_i on its diagonal, with ``proximal`` z_i added for normal and sticking components. A law written in
    Python has its derivative (3, 3) instead: columns J, rows of the identity and softness 1 - z J.
    """
    for e in range(9):
        columns[e] = rows[e] = 0.0
    if law < 0:
        return _given_tangent(derivative, z, len(jump), proximal, columns, rows, softness)
    softness[:] = 0.0
    if law != CONTACT and law != NO_SLIP and law != SOFT_CONTACT:
        made = 0
        for i in range(len(jump)):
            both, own = z[min(i, 1)], parameters[min(i, 1)] if law != PERFECT else 1.0
            if (law == PERFECT and both <= 0.0) or own <= 0.0:
                continue
            soft = proximal * both if law == PERFECT else (rate / own if law == ELASTIC_LAYER else 1.0 / own)
            columns[3 * made + i], rows[3 * made + i], softness[4 * made] = 1.0, 1.0, soft
            made += 1
        return made
    closing, made = -(jump[0] + reach[0]), 0
    stiff = parameters[1] if law == SOFT_CONTACT else np.inf
    if closing > 0.0 and stiff > 0.0 and (z[0] > 0.0 or law == SOFT_CONTACT):
        made = 1
        columns[0] = rows[0] = 1.0
        softness[0] = rate / stiff if law == SOFT_CONTACT else proximal * z[0]
    if len(jump) == 1 or z[1] <= 0.0:
        return made
    if law == NO_SLIP:
        return _sticking(made, reach[0] <= rate * parameters[0], proximal * z[1], columns, rows, softness)
    pressure = closing / (z[0] + (rate / stiff if law == SOFT_CONTACT else 0.0)) if made == 1 else 0.0
    norm, limit = np.hypot(jump[1], jump[2]), parameters[0] * pressure * z[1]
    if norm <= limit or made == 0:
        return _sticking(made, made == 1, proximal * z[1], columns, rows, softness)
    along, across = jump[1] / norm, jump[2] / norm
    columns[1], columns[2] = -parameters[0] * along, -parameters[0] * across
    if limit <= 0.0:
        return made
    columns[4] = rows[4] = -across
    columns[5] = rows[5] = along
    softness[4] = z[1] * (norm / limit - 1.0)
    return 2


@kernel
def _sticking(made: int, held: bool, soft: float, columns: Array, rows: Array, softness: Array) -> int:
    """Add the unknowns of both tangential components where they are held."""
    if not held:
        return made
    for i in range(1, 3):
        columns[3 * made + i] = rows[3 * made + i] = 1.0
        softness[4 * made] = soft
        made += 1
    return made


@kernel
def _given_tangent(
    derivative: Array, z: Array, n: int, proximal: float, columns: Array, rows: Array, softness: Array
) -> int:
    """Unknowns of a given derivative (3, 3): as many as there are components, none where it vanishes."""
    largest = 0.0
    for e in range(9):
        largest = max(largest, abs(derivative[e]))
    if largest == 0.0:
        softness[:] = 0.0
        return 0
    for i in range(3):
        for j in range(3):
            columns[3 * i + j] = derivative[3 * j + i]
            softness[3 * i + j] = -z[min(i, 1)] * derivative[3 * i + j]
        rows[4 * i] = 1.0
        softness[4 * i] += 1.0 + proximal
    return n


@entry("i8, f8[:, ::1], f8[:, ::1], f8[:, ::1], f8, f8[:, ::1], f8[:, ::1]")
def apply_to_points(law: int, jump: Any, z: Any, reach: Any, rate: float, parameters: Any, traction: Any) -> None:
    """The law with this code at all points; arrays (n_point, ...)."""
    for p in range(len(jump)):
        apply(law, jump[p], z[p], reach[p], rate, parameters[p], traction[p])


@entry("i8, f8[:, ::1], f8[:, ::1], f8[:, ::1], f8, f8[:, ::1], f8[:, ::1], f8[:, :, ::1]")
def tangents_of_points(
    law: int, jump: Any, z: Any, reach: Any, rate: float, parameters: Any, scratch: Any, out: Any
) -> None:
    """J = dF_hat / djump (n_point, h, h) of the law at all points; ``scratch`` (3, 9)."""
    columns, rows, softness = scratch[0], scratch[1], scratch[2]
    h = jump.shape[1]
    for p in range(len(jump)):
        made = tangent(law, jump[p], z[p], reach[p], rate, parameters[p], softness, 0.0, columns, rows, softness)
        for i in range(made):
            own = z[p, 0] if rows[3 * i] != 0.0 else z[p, 1]
            for a in range(h):
                for b in range(h):
                    out[p, a, b] += columns[3 * i + a] * rows[3 * i + b] / (own + softness[4 * i])


def law_tangents(law: int, jump: Array, z: Array, reach: Array, rate: float, parameters: Array) -> Array:
    """Derivatives (n_point, h, h) of the tractions of ``apply_law`` by ``jump``; arguments as there."""
    out, scratch = np.zeros((*jump.shape, jump.shape[1])), np.zeros((3, 9))
    reach = reach if reach.ndim == 2 else reach[:, None]
    jump, z, reach, parameters = (np.ascontiguousarray(x, dtype=float) for x in (jump, z, reach, parameters))
    tangents_of_points(law, jump, z, reach, float(rate), parameters, scratch, out)
    return out


def apply_law(law: int, jump: Array, z: Array, reach: Array, rate: float, parameters: Array) -> Array:
    """Tractions (n_point, n_component) on side E by the law with this code; arguments as for
    ``interface.laws.Behaviour.local``."""
    traction = np.zeros_like(jump, dtype=float)
    reach = reach if reach.ndim == 2 else reach[:, None]
    jump, z, reach, parameters = (np.ascontiguousarray(x, dtype=float) for x in (jump, z, reach, parameters))
    apply_to_points(law, jump, z, reach, float(rate), parameters, traction)
    return traction
