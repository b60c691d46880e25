"""Viscous joint, a dashpot per area:

    F_hat.N = c_n d.N,   F_hat_t = c_t d_t,   d = W_hat' - W_hat,   hence   F_hat = c (s' - s) / (1 + c z)

It has no memory; for c -> infinity it is the perfect connection, and c = rho c_p on a face against the ground lets
normal waves out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..compiled import kernel
from .base import Array, PointLaw
from .parts import PointState, Unknowns, add_unknown, always_stick


@kernel
def value(point: PointState, traction: Array) -> None:
    """F_hat = c (s' - s) / (1 + c z), parameters c_n and c_t, N s m-3."""
    for i in range(len(point.jump)):
        viscosity = point.parameters[min(i, 1)]
        traction[i] = viscosity * point.jump[i] / (1.0 + viscosity * point.z[min(i, 1)])


@kernel
def tangent(point: PointState, unknowns: Unknowns) -> int:
    """One unknown for each component in which the joint has a viscosity."""
    count = 0
    for i in range(len(point.jump)):
        viscosity = point.parameters[min(i, 1)]
        if viscosity > 0.0:
            # 1 / c: what the joint adds to z, the traction being c times the jump left
            count = add_unknown(count, i, 1.0 / viscosity, unknowns)
    return count


@dataclass(frozen=True)
class ViscousJoint(PointLaw):
    """Dashpots between the sides; viscosity per area in N s m-3."""

    normal_viscosity: float = 0.0
    tangential_viscosity: float = 0.0
    name: ClassVar[str] = "viscous_joint"
    compliant: ClassVar[bool] = True
    keeps: ClassVar[tuple[bool, bool]] = (False, False)
    tangential: ClassVar[str] = "tangential_viscosity"
    value = staticmethod(value)
    tangent = staticmethod(tangent)
    point_status = staticmethod(always_stick)
