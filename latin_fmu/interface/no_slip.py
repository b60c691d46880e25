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

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..compiled import carray, compiled, native
from .behaviour import SEPARATION, STICK, Array, Status


@dataclass(frozen=True)
class NoSlip:
    """Contact of surfaces that never slide on each other; ``touch`` : gap that counts as closed, m."""

    touch: float = 0.0
    name: ClassVar[str] = "no_slip"
    native: ClassVar[Callable[[], int]] = staticmethod(lambda: _native())
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
        return _kernel(jump, z, reach, rate, parameters)

    @staticmethod
    def status(traction: Array, parameters: Array) -> Status:
        """Stick where there is any traction."""
        loaded = (traction[..., 0] < 0) | (traction[..., 1:] != 0).any(axis=-1)
        return np.where(loaded, STICK, SEPARATION).astype(np.int8)


def no_slip_numpy(jump: Array, z: Array, reach: Array, rate: float, parameters: Array) -> Array:
    """NumPy twin of the compiled kernel."""
    traction = np.zeros_like(jump)
    closing = np.maximum(0.0, -(jump[:, 0] + reach))
    traction[:, 0] = -np.divide(closing, z[:, 0], out=np.zeros_like(closing), where=z[:, 0] > 0)
    held = (reach <= rate * parameters[:, 0]) & (z[:, 1] > 0)
    traction[held, 1:] = jump[held, 1:] / z[held, 1:]
    return traction


@compiled(no_slip_numpy)
def _kernel(jump: Array, z: Array, reach: Array, rate: float, parameters: Array) -> Array:
    traction = np.zeros_like(jump)
    for p in range(jump.shape[0]):
        closing = -(jump[p, 0] + reach[p])
        if closing > 0.0 and z[p, 0] > 0.0:
            traction[p, 0] = -closing / z[p, 0]
        if reach[p] <= rate * parameters[p, 0] and z[p, 1] > 0.0:
            for c in range(1, jump.shape[1]):
                traction[p, c] = jump[p, c] / z[p, 1]
    return traction


@native(3, 6)
def _native(
    n_point: Any,
    n_component: Any,
    n_parameter: Any,
    rate: Any,
    jump: Any,
    z: Any,
    reach: Any,
    parameters: Any,
    traction: Any,
) -> None:
    n, shape = n_point[0], (n_point[0], n_component[0])
    carray(traction, shape)[...] = _kernel(
        carray(jump, shape),
        carray(z, (n, 2)),
        carray(reach, (n,)),
        rate[0],
        carray(parameters, (n, n_parameter[0])),
    )
