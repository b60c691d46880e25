"""Parts that laws of interfaces share: Coulomb's friction under a pressure, and unknowns of tangents.

A tangent J = dF_hat / djump is the sum over unknowns i of c_i r_i^T / (z_i + s_i) (``Unknowns``).
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel

Array = NDArray[np.float64]

SEPARATION = 0
STICK = 1
SLIP = 2
ON_CONE: Final = 1 - 1e-10
"""A stuck point whose traction is this close to the cone counts as slipping."""
AT_EDGE: Final = 1 + 1e-9
"""Up to this times the cone the tangent is that of a stuck point: at the edge both are tangents of the law, and
round-off of a joint at rest does not change this one."""


class PointState(NamedTuple):
    """What a law knows of a point, n components h.

    Attributes
    ----------
    jump : (h,) s' - s, m s-1. z : (2,) normal and tangential, m3 N-1 s-1; 0 where both sides are held.
    reach : (1,) normalised gap max(gap, 0) / dt, m s-1; for elastic laws (h,), jump of displacement x rate.
    rate : 1/dt; for elastic laws 1 / (displacement per velocity of the instant), s-1. parameters : of the law.
    """

    jump: Array
    z: Array
    reach: Array
    rate: float
    parameters: Array


class Unknowns(NamedTuple):
    """Unknowns of the tangent of a law at a point, which it writes; all 0 before.

    Attributes
    ----------
    columns, rows : (9,) c_i and r_i, one after the other. softness : (9,) the numbers s_i on the diagonal of (3, 3).
    proximal : share of z_i added to s_i of normal and sticking components (``kernels.newton``).
    """

    columns: Array
    rows: Array
    softness: Array
    proximal: float


@kernel
def friction(pressure: float, coefficient: float, point: PointState, traction: Array) -> None:
    """Tangential traction (21)-(23) under a pressure P: G = (s' - s)_t / z_t where |G| <= mu P, else mu P G / |G|."""
    jump = point.jump
    z = point.z[1]
    for i in range(1, len(jump)):
        traction[i] = 0.0
    if len(jump) == 1 or z <= 0.0 or pressure <= 0.0:
        return
    # limit: velocity that the cone can stop
    norm, limit = np.hypot(jump[1], jump[2]), coefficient * pressure * z
    scale = 1.0 if norm <= limit else limit / norm
    traction[1] = scale * jump[1] / z
    traction[2] = scale * jump[2] / z


@kernel
def friction_tangent(pressure: float, coefficient: float, point: PointState, unknowns: Unknowns) -> int:
    """Unknowns of a point with friction whose first one is that of its pressure, where there is one (P > 0): two more
    where it sticks; where it slips one more, across the direction of slip, and the shear along it
    follows from the pressure."""
    jump = point.jump
    z = point.z[1]
    columns = unknowns.columns
    rows = unknowns.rows
    if not pressure > 0.0:
        return 0
    if len(jump) == 1 or z <= 0.0:
        return 1
    norm, limit = np.hypot(jump[1], jump[2]), coefficient * pressure * z
    if norm <= AT_EDGE * limit:
        return sticking(1, unknowns.proximal * z, unknowns)
    # of slip: friction on E has the direction of the motion of E' relative to it
    along, across = jump[1] / norm, jump[2] / norm
    # F_t = mu P t and P = -F.N: with the unknown of the pressure changes the shear along the slip
    columns[1], columns[2] = -coefficient * along, -coefficient * across
    if limit <= 0.0:
        return 1
    columns[4] = rows[4] = -across
    columns[5] = rows[5] = along
    # across the slip F_t turns with the jump: mu P / |jump| = 1 / (z + s)
    unknowns.softness[4] = z * (norm / limit - 1.0)
    return 2


@kernel
def sticking(count: int, soft: float, unknowns: Unknowns) -> int:
    """Add the unknowns of both tangential components, which are held; number of unknowns then."""
    for i in range(1, 3):
        count = add_unknown(count, i, soft, unknowns)
    return count


@kernel
def add_unknown(count: int, i: int, soft: float, unknowns: Unknowns) -> int:
    """Add the unknown of component i alone with s_i = ``soft``; number of unknowns then."""
    unknowns.columns[3 * count + i] = unknowns.rows[3 * count + i] = 1.0
    unknowns.softness[4 * count] = soft
    return count + 1


@kernel
def friction_status(traction: Array, coefficient: float, no_contact: float) -> int:
    """Separation up to a pressure ``no_contact``, slip on the friction cone, else stick."""
    pressure = -traction[0]
    if pressure <= no_contact or pressure <= 0.0:
        return SEPARATION
    limit = ON_CONE * coefficient * pressure
    if len(traction) == 1 or limit <= 0.0:
        return SLIP
    return STICK if traction[1] * traction[1] + traction[2] * traction[2] < limit * limit else SLIP


@kernel
def always_stick(traction: Any, parameters: Any, no_contact: float) -> int:
    """Status of sides that stay together."""
    return STICK
