"""Perfect connection, Eq. (7): W = W', F + F' = 0."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..kernels.laws import PERFECT, apply_law
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
