"""Unilateral contact with gap and Coulomb friction, Eqs. (18)-(23).

Signs: N from E to E', F_hat on side E, pressure P = -F_hat.N >= 0. With the free opening velocity
w = (s' - s).N and reach = gap / dt,

    P = max(0, -(w + reach)) / (z_n + z_n')                    end-of-instant Signorini law
    G = (s' - s)_t / (z_t + z_t')                              traction that would stop the sliding
    F_hat_t = G                   if |G| <= mu P   (22) stick
            = mu P G / |G|        otherwise        (23) slip

The opening velocity is then max(w, -reach); for equal k on both sides and a closed gap P = -k C_n with the
contact indicator C_n = w / 2 of (20), and G is G_n of (21).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..kernels.laws import CONTACT, apply_law
from .behaviour import SEPARATION, SLIP, STICK, Array, Status

# A stuck point whose traction is this close to the cone counts as slipping.
_ON_CONE = 1 - 1e-10


@dataclass(frozen=True)
class Contact:
    """Unilateral contact; ``friction_coefficient`` is Coulomb's (0: frictionless, normal unknowns only)."""

    friction_coefficient: float = 0.0
    name: ClassVar[str] = "contact"
    compiled: ClassVar[bool] = True
    opens: ClassVar[bool] = True
    compliant: ClassVar[bool] = False
    elastic: ClassVar[bool] = False

    @property
    def n_component(self) -> int:
        """Frictionless contact has no tangential unknowns."""
        return 3 if self.friction_coefficient > 0 else 1

    def point_parameters(self, n_point: int) -> Array:
        """Column 0: friction coefficient."""
        return np.full((n_point, 1), self.friction_coefficient)

    @staticmethod
    def local(jump: Array, z: Array, reach: Array, rate: float, parameters: Array) -> Array:
        """Explicit solution per point (module docstring)."""
        return apply_law(CONTACT, jump, z, reach, rate, parameters)

    @staticmethod
    def status(traction: Array, parameters: Array) -> Status:
        """From the traction alone: open where P = 0; on the cone is slip."""
        pressure = -traction[..., 0]
        status = np.full(pressure.shape, SLIP, dtype=np.int8)
        if traction.shape[-1] > 1:
            shear2 = traction[..., 1] ** 2 + traction[..., 2] ** 2
            limit = _ON_CONE * parameters[:, 0] * pressure
            status[(shear2 < limit * limit) & (limit > 0)] = STICK
        status[pressure <= 0] = SEPARATION
        return status
