"""Perfect connection, Eq. (7): W = W', F + F' = 0."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..compiled import carray, compiled, native
from .behaviour import STICK, Array, Status


@dataclass(frozen=True)
class Perfect:
    """Bonded faces: equal velocities, opposite tractions."""

    name: ClassVar[str] = "perfect"
    native: ClassVar[Callable[[], int]] = staticmethod(lambda: _native())
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
        return _kernel(jump, z)

    @staticmethod
    def status(traction: Array, parameters: Array) -> Status:
        """Always stuck."""
        return np.full(traction.shape[:-1], STICK, dtype=np.int8)


def perfect_numpy(jump: Array, z: Array) -> Array:
    """NumPy twin of the compiled kernel."""
    traction = np.zeros_like(jump)
    np.divide(jump[:, :1], z[:, :1], out=traction[:, :1], where=z[:, :1] > 0)
    np.divide(jump[:, 1:], z[:, 1:], out=traction[:, 1:], where=z[:, 1:] > 0)
    return traction


@compiled(perfect_numpy)
def _kernel(jump: Array, z: Array) -> Array:
    traction = np.zeros_like(jump)
    for p in range(jump.shape[0]):
        for c in range(jump.shape[1]):
            stiff = z[p, min(c, 1)]
            if stiff > 0.0:
                traction[p, c] = jump[p, c] / stiff
    return traction


@native(3, 6)
def _native(
    n_point: Any,
    n_component: Any,
    _n_parameter: Any,
    _rate: Any,
    jump: Any,
    z: Any,
    _reach: Any,
    _parameters: Any,
    traction: Any,
) -> None:
    shape = (n_point[0], n_component[0])
    carray(traction, shape)[...] = _kernel(carray(jump, shape), carray(z, (n_point[0], 2)))
