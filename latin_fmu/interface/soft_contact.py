"""Contact through an elastic layer: Signorini's law made smooth by a stiffness, with Coulomb friction.

The pressure follows the compression of the layer, which may be there from the start (an interference):

    P = k_n max(0, -gap),   gap of the new instant = (reach + d) / rate,   d = w + z P

    P = k_n max(0, -(w + reach)) / (rate + k_n z_n)

with the free opening velocity w = (s' - s).N. Friction is that of ``contact`` with this pressure, Eqs. (22), (23). A
layer of finite stiffness spreads an impact over time, gives no force peak that depends on the mesh, and conserves the
energy it stores; k_n -> infinity is ``contact``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..kernels.laws import SOFT_CONTACT, apply_law
from .behaviour import Array, Status
from .contact import Contact


@dataclass(frozen=True)
class SoftContact:
    """Unilateral elastic layer of stiffness per area N m-3, with Coulomb friction."""

    normal_stiffness: float = 1.0
    friction_coefficient: float = 0.0
    name: ClassVar[str] = "soft_contact"
    opens: ClassVar[bool] = True
    compliant: ClassVar[bool] = True
    elastic: ClassVar[bool] = True
    compiled: ClassVar[bool] = True

    @property
    def n_component(self) -> int:
        """Without friction no tangential unknowns."""
        return 3 if self.friction_coefficient > 0 else 1

    def point_parameters(self, n_point: int) -> Array:
        """Columns: friction coefficient (where ``contact`` has it), normal stiffness."""
        return np.tile([self.friction_coefficient, self.normal_stiffness], (n_point, 1))

    @staticmethod
    def local(jump: Array, z: Array, reach: Array, rate: float, parameters: Array) -> Array:
        """Explicit solution per point (module docstring)."""
        return apply_law(SOFT_CONTACT, jump, z, reach, rate, parameters)

    @staticmethod
    def status(traction: Array, parameters: Array) -> Status:
        """As for ``contact``."""
        return Contact.status(traction, parameters)

    @staticmethod
    def stored_energy(traction: Array, parameters: Array) -> Array:
        """P^2 / (2 k_n) per area, J m-2."""
        energy: Array = 0.5 * traction[..., 0] ** 2 / parameters[:, 1]
        return energy
