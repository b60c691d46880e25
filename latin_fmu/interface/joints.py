"""Interfaces whose sides stay together: perfect connection, elastic layer, viscous joint.

Perfect connection, Eq. (7): W = W', F + F' = 0. The traction F_hat = (s' - s) / z closes the velocity jump; where both
sides are held (z = 0) it is not determined and is set to zero.

Elastic layer, a thin bonded joint whose traction follows the jump of displacement [u] = u' - u:

    F_hat.N = k_n [u].N,   F_hat_t = k_t [u]_t   on side E (a layer that is pulled open pulls E along N)

With the jump of the new instant [u] = (g + d) / rate (``interface.behaviour``, rule 3) and the opening velocity
d = (s' - s) - z F_hat,

    F_hat = k (s' - s + g) / (rate + k z)

for each direction: the layer adds the compliance rate / k to those of the sides, and for k -> infinity it is the
perfect connection. Massless, without thickness; a preload enters as an initial jump -p / k_n.

Viscous joint, a dashpot per area:

    F_hat.N = c_n d.N,   F_hat_t = c_t d_t,   d = W_hat' - W_hat,   hence   F_hat = c (s' - s) / (1 + c z)

It has no memory; for c -> infinity it is the perfect connection, and c = rho c_p on a face against the ground lets
normal waves out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from .behaviour import Array, PointLaw


@dataclass(frozen=True)
class Perfect(PointLaw):
    """Bonded faces: equal velocities, opposite tractions."""

    name: ClassVar[str] = "perfect"


@dataclass(frozen=True)
class Rods(Perfect):
    """Points bonded along N alone, as by rigid rods with hinges at their ends."""

    @property
    def n_component(self) -> int:
        """Unknowns per point, the force of the rod."""
        return 1


@dataclass(frozen=True)
class ElasticLayer(PointLaw):
    """Bonded elastic layer; stiffness per area in N m-3 (E / thickness, G / thickness of an adhesive)."""

    normal_stiffness: float = 0.0
    tangential_stiffness: float = 0.0
    name: ClassVar[str] = "elastic_layer"
    compliant: ClassVar[bool] = True
    elastic: ClassVar[bool] = True
    tangential: ClassVar[str] = "tangential_stiffness"

    @staticmethod
    def stored_energy(traction: Array, parameters: Array) -> Array:
        """F.[u] / 2 per area, J m-2."""
        stiffness = parameters[:, [0, *[1] * (traction.shape[-1] - 1)]]
        flexibility = np.divide(1.0, stiffness, out=np.zeros_like(stiffness), where=stiffness > 0)
        energy: Array = 0.5 * (flexibility * traction**2).sum(axis=-1)
        return energy


@dataclass(frozen=True)
class ViscousJoint(PointLaw):
    """Dashpots between the sides; viscosity per area in N s m-3."""

    normal_viscosity: float = 0.0
    tangential_viscosity: float = 0.0
    name: ClassVar[str] = "viscous_joint"
    compliant: ClassVar[bool] = True
    tangential: ClassVar[str] = "tangential_viscosity"
