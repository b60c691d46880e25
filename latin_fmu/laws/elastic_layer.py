"""Elastic layer, a thin bonded joint whose traction follows the jump of displacement [u] = u' - u:

    F_hat.N = k_n [u].N,   F_hat_t = k_t [u]_t   on side E (a layer that is pulled open pulls E along N)

With the jump of the new instant [u] = (g + d) / rate (rule 3 of ``interface.laws``) and the opening velocity
d = (s' - s) - z F_hat,

    F_hat = k (s' - s + g) / (rate + k z)

for each direction: the layer adds the compliance rate / k to those of the sides, and for k -> infinity it is the
perfect connection. Massless, without thickness; a preload enters as an initial jump -p / k_n.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..compiled import kernel
from .base import Array, PointLaw
from .parts import PointState, Unknowns, add_unknown, always_stick


@kernel
def value(point: PointState, traction: Array) -> None:
    """F_hat = k_l (s' - s + reach) / (rate + k_l z), parameters k_n and k_t, N m-3."""
    for i in range(len(point.jump)):
        stiffness = point.parameters[min(i, 1)]
        # no branch for z = 0: the layer has a definite traction where both sides are held
        traction[i] = stiffness * (point.jump[i] + point.reach[i]) / (point.rate + stiffness * point.z[min(i, 1)])


@kernel
def tangent(point: PointState, unknowns: Unknowns) -> int:
    """One unknown for each component in which the layer has a stiffness."""
    count = 0
    for i in range(len(point.jump)):
        stiffness = point.parameters[min(i, 1)]
        if stiffness > 0.0:
            count = add_unknown(count, i, point.rate / stiffness, unknowns)  # what the layer adds to z
    return count


@dataclass(frozen=True)
class ElasticLayer(PointLaw):
    """Bonded elastic layer; stiffness per area in N m-3 (E / thickness, G / thickness of an adhesive)."""

    normal_stiffness: float = 0.0
    tangential_stiffness: float = 0.0
    name: ClassVar[str] = "elastic_layer"
    compliant: ClassVar[bool] = True
    elastic: ClassVar[bool] = True
    keeps: ClassVar[tuple[bool, bool]] = (False, False)
    tangential: ClassVar[str] = "tangential_stiffness"
    value = staticmethod(value)
    tangent = staticmethod(tangent)
    point_status = staticmethod(always_stick)

    @staticmethod
    def stored_energy(traction: Array, parameters: Array) -> Array:
        """F.[u] / 2 per area, J m-2."""
        # one column per component: normal, then tangential ones alike
        stiffness = parameters[:, [0, *[1] * (traction.shape[-1] - 1)]]
        flexibility = np.divide(1.0, stiffness, out=np.zeros_like(stiffness), where=stiffness > 0)
        energy: Array = 0.5 * (flexibility * traction**2).sum(axis=-1)
        return energy
