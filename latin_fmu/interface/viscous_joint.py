"""Viscous joint: a dashpot per area between two faces that stay together.

    F_hat.N = c_n d.N,   F_hat_t = c_t d_t,   d = W_hat' - W_hat

With d = (s' - s) - z F_hat: F_hat = c (s' - s) / (1 + c z) for each direction. It has no memory; for c -> infinity it
is the perfect connection, and c = rho c_p on a face against the ground lets normal waves out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..compiled import carray, compiled, native
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
    native: ClassVar[Callable[[], int]] = staticmethod(lambda: _native())

    @property
    def n_component(self) -> int:
        """A joint that slides freely has no tangential unknowns."""
        return 3 if self.tangential_viscosity > 0 else 1

    def point_parameters(self, n_point: int) -> Array:
        """Columns: normal and tangential viscosity."""
        return np.tile([self.normal_viscosity, self.tangential_viscosity], (n_point, 1))

    @staticmethod
    def local(jump: Array, z: Array, reach: Array, rate: float, parameters: Array) -> Array:
        """Explicit solution per point (module docstring); compiled when numba is there."""
        return _kernel(jump, z, parameters)

    @staticmethod
    def status(traction: Array, parameters: Array) -> Status:
        """Always stuck."""
        return np.full(traction.shape[:-1], STICK, dtype=np.int8)


def joint_numpy(jump: Array, z: Array, parameters: Array) -> Array:
    """NumPy twin of the compiled kernel, same arguments as ``ViscousJoint.local`` without ``reach`` and ``rate``."""
    columns = [0, *[1] * (jump.shape[1] - 1)]
    viscosity, both = parameters[:, columns], z[:, columns]
    traction: Array = viscosity * jump / (1.0 + viscosity * both)
    return traction


@compiled(joint_numpy)
def _kernel(jump: Array, z: Array, parameters: Array) -> Array:
    traction = np.empty_like(jump)
    for p in range(jump.shape[0]):
        for c in range(jump.shape[1]):
            kind = min(c, 1)
            viscosity = parameters[p, kind]
            traction[p, c] = viscosity * jump[p, c] / (1.0 + viscosity * z[p, kind])
    return traction


@native(3, 6)
def _native(
    n_point: Any, n_component: Any, n_parameter: Any, _rate: Any, jump: Any, z: Any, _reach: Any, parameters: Any,
    traction: Any,
) -> None:  # fmt: skip
    n, shape = n_point[0], (n_point[0], n_component[0])
    carray(traction, shape)[...] = _kernel(
        carray(jump, shape), carray(z, (n, 2)), carray(parameters, (n, n_parameter[0]))
    )
