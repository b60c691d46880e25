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

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..compiled import carray, compiled, native
from .behaviour import SEPARATION, SLIP, STICK, Array, Status

# A stuck point whose traction is this close to the cone counts as slipping.
_ON_CONE = 1 - 1e-10


@dataclass(frozen=True)
class Contact:
    """Unilateral contact; ``friction_coefficient`` is Coulomb's (0: frictionless, normal unknowns only)."""

    friction_coefficient: float = 0.0
    name: ClassVar[str] = "contact"
    native: ClassVar[Callable[[], int]] = staticmethod(lambda: _native())
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
        """Explicit solution per point (module docstring); compiled when numba is there."""
        return _kernel(jump, z, reach, parameters)

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


def contact_numpy(jump: Array, z: Array, reach: Array, parameters: Array) -> Array:
    """NumPy twin of the compiled kernel, same arguments as ``Contact.local`` without ``rate``."""
    traction = np.zeros_like(jump)
    closing = np.maximum(0.0, -(jump[:, 0] + reach))
    pressure = np.divide(closing, z[:, 0], out=np.zeros_like(closing), where=z[:, 0] > 0)
    traction[:, 0] = -pressure
    if jump.shape[1] > 1:
        shear = jump[:, 1:]
        norm = np.hypot(shear[:, 0], shear[:, 1])
        limit = parameters[:, 0] * pressure * z[:, 1]  # velocity that the cone can stop
        scale = np.divide(limit, norm, out=np.ones_like(norm), where=norm > limit)
        free = z[:, 1] > 0
        traction[free, 1:] = (scale[:, None] * shear)[free] / z[free, 1:]
    return traction


@compiled(contact_numpy)
def _kernel(jump: Array, z: Array, reach: Array, parameters: Array) -> Array:
    traction = np.zeros_like(jump)
    n_component = jump.shape[1]
    for p in range(jump.shape[0]):
        closing = -(jump[p, 0] + reach[p])
        if closing <= 0.0 or z[p, 0] <= 0.0:
            continue
        pressure = closing / z[p, 0]
        traction[p, 0] = -pressure
        if n_component > 1 and z[p, 1] > 0.0:
            norm = np.hypot(jump[p, 1], jump[p, 2])
            limit = parameters[p, 0] * pressure * z[p, 1]
            scale = 1.0 if norm <= limit else limit / norm
            traction[p, 1] = scale * jump[p, 1] / z[p, 1]
            traction[p, 2] = scale * jump[p, 2] / z[p, 1]
    return traction


@native(3, 6)
def _native(
    n_point: Any,
    n_component: Any,
    n_parameter: Any,
    _rate: Any,
    jump: Any,
    z: Any,
    reach: Any,
    parameters: Any,
    traction: Any,
) -> None:
    n, shape = n_point[0], (n_point[0], n_component[0])
    carray(traction, shape)[...] = _kernel(
        carray(jump, shape), carray(z, (n, 2)), carray(reach, (n,)), carray(parameters, (n, n_parameter[0]))
    )
