"""Contact through an elastic layer: Signorini's law made smooth by a stiffness, with Coulomb friction.

The pressure follows the compression of the layer, which may be there from the start (an interference):

    P = k_n max(0, -gap),   gap of the new instant = (reach + d) / rate,   d = w + z P

    P = k_n max(0, -(w + reach)) / (rate + k_n z_n)

with the free opening velocity w = (s' - s).N. Friction is that of ``contact`` with this pressure, Eqs. (22), (23). A
layer of finite stiffness spreads an impact over time, gives no force peak that depends on the mesh, and conserves the
energy it stores; k_n -> infinity is ``contact``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..compiled import carray, compiled, native
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
    native: ClassVar[Callable[[], int]] = staticmethod(lambda: _native())

    @property
    def n_component(self) -> int:
        """Without friction no tangential unknowns."""
        return 3 if self.friction_coefficient > 0 else 1

    def point_parameters(self, n_point: int) -> Array:
        """Columns: friction coefficient (where ``contact`` has it), normal stiffness."""
        return np.tile([self.friction_coefficient, self.normal_stiffness], (n_point, 1))

    @staticmethod
    def local(jump: Array, z: Array, reach: Array, rate: float, parameters: Array) -> Array:
        """Explicit solution per point (module docstring); compiled when numba is there."""
        return _kernel(jump, z, reach, rate, parameters)

    @staticmethod
    def status(traction: Array, parameters: Array) -> Status:
        """As for ``contact``."""
        return Contact.status(traction, parameters)

    @staticmethod
    def stored_energy(traction: Array, parameters: Array) -> Array:
        """P^2 / (2 k_n) per area, J m-2."""
        energy: Array = 0.5 * traction[..., 0] ** 2 / parameters[:, 1]
        return energy


def soft_numpy(jump: Array, z: Array, reach: Array, rate: float, parameters: Array) -> Array:
    """NumPy twin of the compiled kernel, same arguments as ``SoftContact.local``."""
    traction = np.zeros_like(jump)
    stiffness = parameters[:, 1]
    pressure = stiffness * np.maximum(0.0, -(jump[:, 0] + reach[:, 0])) / (rate + stiffness * z[:, 0])
    traction[:, 0] = -pressure
    if jump.shape[1] > 1:
        shear = jump[:, 1:]
        norm = np.hypot(shear[:, 0], shear[:, 1])
        limit = parameters[:, 0] * pressure * z[:, 1]  # velocity that the cone can stop
        scale = np.divide(limit, norm, out=np.ones_like(norm), where=norm > limit)
        free = z[:, 1] > 0
        traction[free, 1:] = (scale[:, None] * shear)[free] / z[free, 1:]
    return traction


@compiled(soft_numpy)
def _kernel(jump: Array, z: Array, reach: Array, rate: float, parameters: Array) -> Array:
    traction = np.zeros_like(jump)
    for p in range(jump.shape[0]):
        closing = -(jump[p, 0] + reach[p, 0])
        if closing <= 0.0:
            continue
        pressure = parameters[p, 1] * closing / (rate + parameters[p, 1] * z[p, 0])
        traction[p, 0] = -pressure
        if jump.shape[1] > 1 and z[p, 1] > 0.0:
            norm = np.hypot(jump[p, 1], jump[p, 2])
            limit = parameters[p, 0] * pressure * z[p, 1]
            scale = 1.0 if norm <= limit else limit / norm
            traction[p, 1] = scale * jump[p, 1] / z[p, 1]
            traction[p, 2] = scale * jump[p, 2] / z[p, 1]
    return traction


@native(3, 6)
def _native(
    n_point: Any, n_component: Any, n_parameter: Any, rate: Any, jump: Any, z: Any, reach: Any, parameters: Any,
    traction: Any,
) -> None:  # fmt: skip
    n, shape = n_point[0], (n_point[0], n_component[0])
    carray(traction, shape)[...] = _kernel(
        carray(jump, shape),
        carray(z, (n, 2)),
        carray(reach, shape),
        rate[0],
        carray(parameters, (n, n_parameter[0])),
    )
