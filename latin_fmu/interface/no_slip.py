"""Unilateral contact without slip: the limit of Coulomb's law for mu -> infinity that stays solvable.

Normal law as in ``contact``: P = max(0, -(w + reach)) / (z_n + z_n'). Tangentially a point that is in touch at the
start of the instant does not slide in it, pressed or not; one that arrives within the instant slides freely until it
has arrived:

    F_hat_t = (s' - s)_t / (z_t + z_t')   where the gap is at most ``touch``,   else 0

``touch`` is a small part of the distance that the loads can close within an instant: were it zero, a pressed point
would lose hold over a gap of the size of a rounding error.

The closure of Coulomb's cone for mu -> infinity is the half space P >= 0: shear without pressure belongs to it, so
that touch alone may hold a point. Stick then depends on the past only, the instant is a convex problem and the
iteration converges, where a huge friction coefficient (stick from the first trace of pressure) may not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..kernels.laws import NO_SLIP, apply_law
from .behaviour import SEPARATION, STICK, Array, Status


@dataclass(frozen=True)
class NoSlip:
    """Contact of surfaces that never slide on each other; ``touch`` : gap that counts as closed, m."""

    touch: float = 0.0
    name: ClassVar[str] = "no_slip"
    compiled: ClassVar[bool] = True
    opens: ClassVar[bool] = True
    compliant: ClassVar[bool] = False
    elastic: ClassVar[bool] = False

    @property
    def n_component(self) -> int:
        """Normal and tangential."""
        return 3

    def point_parameters(self, n_point: int) -> Array:
        """Column 0: gap that counts as closed."""
        return np.full((n_point, 1), self.touch)

    @staticmethod
    def local(jump: Array, z: Array, reach: Array, rate: float, parameters: Array) -> Array:
        """Explicit solution per point (module docstring)."""
        return apply_law(NO_SLIP, jump, z, reach, rate, parameters)

    @staticmethod
    def status(traction: Array, parameters: Array) -> Status:
        """Stick where there is any traction."""
        loaded = (traction[..., 0] < 0) | (traction[..., 1:] != 0).any(axis=-1)
        return np.where(loaded, STICK, SEPARATION).astype(np.int8)
