"""Viscous joint: a dashpot per area between two faces that stay together.

    F_hat.N = c_n d.N,   F_hat_t = c_t d_t,   d = W_hat' - W_hat

With d = (s' - s) - z F_hat: F_hat = c (s' - s) / (1 + c z) for each direction. It has no memory; for c -> infinity it
is the perfect connection, and c = rho c_p on a face against the ground lets normal waves out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..kernels.laws import VISCOUS_JOINT, apply_law
from .behaviour import STICK, Array, Status


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
