"""Perfect connection, Eq. (7): W = W', F + F' = 0.

The traction F_hat = (s' - s) / z closes the velocity jump; where both sides are held (z = 0) it is not determined and
is set to zero.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..compiled import kernel
from .base import Array, PointLaw
from .parts import PointState, Unknowns, add_unknown, always_stick


@kernel
def value(point: PointState, traction: Array) -> None:
    """F_hat = (s' - s) / z."""
    for i in range(len(point.jump)):
        both = point.z[min(i, 1)]
        traction[i] = point.jump[i] / both if both > 0.0 else 0.0


@kernel
def tangent(point: PointState, unknowns: Unknowns) -> int:
    """One unknown for each component that is not held on both sides."""
    count = 0
    for i in range(len(point.jump)):
        both = point.z[min(i, 1)]
        if both > 0.0:
            count = add_unknown(count, i, unknowns.proximal * both, unknowns)
    return count


@dataclass(frozen=True)
class Perfect(PointLaw):
    """Bonded faces: equal velocities, opposite tractions."""

    name: ClassVar[str] = "perfect"
    value = staticmethod(value)
    tangent = staticmethod(tangent)
    point_status = staticmethod(always_stick)


@dataclass(frozen=True)
class Rods(Perfect):
    """Points bonded along N alone, as by rigid rods with hinges at their ends."""

    @property
    def n_component(self) -> int:
        """Unknowns per point, the force of the rod."""
        return 1
