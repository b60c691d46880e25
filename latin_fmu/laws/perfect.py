"""Perfect connection, Eq. (7): W = W', F + F' = 0.

The traction F_hat = (s' - s) / z closes the velocity jump; where both sides are held (z = 0) it is not determined and
is set to zero.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..compiled import kernel
from .base import Array, PointLaw
from .parts import add_unknown, always_stick


@kernel
def value(jump: Array, z: Array, reach: Array, rate: float, parameters: Array, traction: Array) -> None:
    """F_hat = (s' - s) / z."""
    for i in range(len(jump)):
        both = z[min(i, 1)]
        traction[i] = jump[i] / both if both > 0.0 else 0.0


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
    """One unknown for each component that is not held on both sides."""
    made = 0
    for i in range(len(jump)):
        both = z[min(i, 1)]
        if both > 0.0:
            made = add_unknown(made, i, proximal * both, columns, rows, softness)
    return made


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
