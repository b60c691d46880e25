"""Interfaces whose sides stay together: perfect connection, elastic layer, viscous joint.

perfect
-------
Perfect connection, Eq. (7): W = W', F + F' = 0.


elastic_layer
-------------
Elastic layer: a thin bonded joint whose traction follows the jump of displacement.

    F_hat.N = k_n [u].N,   F_hat_t = k_t [u]_t,   [u] = u' - u, on side E (a layer that is pulled open pulls E along N)

With the jump of the new instant [u] = (reach + d) / rate and the opening velocity d = (s' - s) - z F_hat,

    F_hat = k (s' - s + reach) / (rate + k z)

for each direction: the layer adds the compliance rate / k to those of the sides, and for k -> infinity it is the
perfect connection. Massless, without thickness; a preload enters as an initial jump -p / k_n.


viscous_joint
-------------
Viscous joint: a dashpot per area between two faces that stay together.

    F_hat.N = c_n d.N,   F_hat_t = c_t d_t,   d = W_hat' - W_hat

With d = (s' - s) - z F_hat: F_hat = c (s' - s) / (1 + c z) for each direction. It has no memory; for c -> infinity it
is the perfect connection, and c = rho c_p on a face against the ground lets normal waves out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..kernels.laws import ELASTIC_LAYER, PERFECT, VISCOUS_JOINT, apply_law
from .behaviour import STICK, Array, Status


@dataclass(frozen=True)
class Perfect:
    """Bonded faces: equal velocities, opposite tractions."""

    name: ClassVar[str] = "perfect"
    compiled: ClassVar[bool] = True
    opens: ClassVar[bool] = False
    compliant: ClassVar[bool] = False
    elastic: ClassVar[bool] = False

    @property
    def n_component(self) -> int:
        """All three components are tied."""
        return 3

    def point_parameters(self, n_point: int) -> Array:
        """None."""
        return np.zeros((n_point, 0))

    @staticmethod
    def local(jump: Array, z: Array, reach: Array, rate: float, parameters: Array) -> Array:
        """F_hat = (s' - s) / (z + z'): the traction that closes the velocity jump. Where both sides are held
        (z + z' = 0) the traction is not determined and is set to zero."""
        return apply_law(PERFECT, jump, z, reach, rate, parameters)

    @staticmethod
    def status(traction: Array, parameters: Array) -> Status:
        """Always stuck."""
        return np.full(traction.shape[:-1], STICK, dtype=np.int8)


@dataclass(frozen=True)
class ElasticLayer:
    """Bonded elastic layer; stiffness per area in N m-3 (E / thickness, G / thickness of an adhesive)."""

    normal_stiffness: float = 0.0
    tangential_stiffness: float = 0.0
    name: ClassVar[str] = "elastic_layer"
    opens: ClassVar[bool] = False
    compliant: ClassVar[bool] = True
    elastic: ClassVar[bool] = True
    compiled: ClassVar[bool] = True

    @property
    def n_component(self) -> int:
        """A layer that shears freely has no tangential unknowns."""
        return 3 if self.tangential_stiffness > 0 else 1

    def point_parameters(self, n_point: int) -> Array:
        """Columns: normal and tangential stiffness."""
        return np.tile([self.normal_stiffness, self.tangential_stiffness], (n_point, 1))

    @staticmethod
    def local(jump: Array, z: Array, reach: Array, rate: float, parameters: Array) -> Array:
        """Explicit solution per point (module docstring)."""
        return apply_law(ELASTIC_LAYER, jump, z, reach, rate, parameters)

    @staticmethod
    def status(traction: Array, parameters: Array) -> Status:
        """Always stuck."""
        return np.full(traction.shape[:-1], STICK, dtype=np.int8)

    @staticmethod
    def stored_energy(traction: Array, parameters: Array) -> Array:
        """F.[u] / 2 per area, J m-2."""
        stiffness = parameters[:, [0, *[1] * (traction.shape[-1] - 1)]]
        flexibility = np.divide(1.0, stiffness, out=np.zeros_like(stiffness), where=stiffness > 0)
        energy: Array = 0.5 * (flexibility * traction**2).sum(axis=-1)
        return energy


@dataclass(frozen=True)
class ViscousJoint:
    """Dashpots; viscosity per area in N s m-3."""

    normal_viscosity: float = 0.0
    tangential_viscosity: float = 0.0
    name: ClassVar[str] = "viscous_joint"
    opens: ClassVar[bool] = False
    compliant: ClassVar[bool] = True
    elastic: ClassVar[bool] = False
    compiled: ClassVar[bool] = True

    @property
    def n_component(self) -> int:
        """A joint that slides freely has no tangential unknowns."""
        return 3 if self.tangential_viscosity > 0 else 1

    def point_parameters(self, n_point: int) -> Array:
        """Columns: normal and tangential viscosity."""
        return np.tile([self.normal_viscosity, self.tangential_viscosity], (n_point, 1))

    @staticmethod
    def local(jump: Array, z: Array, reach: Array, rate: float, parameters: Array) -> Array:
        """Explicit solution per point (module docstring)."""
        return apply_law(VISCOUS_JOINT, jump, z, reach, rate, parameters)

    @staticmethod
    def status(traction: Array, parameters: Array) -> Status:
        """Always stuck."""
        return np.full(traction.shape[:-1], STICK, dtype=np.int8)
