"""The laws of the interfaces in NumPy, all points at once, written from the relations alone.

Each has the name of its behaviour and the arguments of ``Behaviour.local``.

With d = (s' - s) - z F the opening velocity of the instant and [u] = (g + d) / rate its jump of displacement.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def wide(z: Array, n_component: int) -> Array:
    """z of each component: normal, then tangential twice."""
    return z[:, [0, 1, 1]][:, :n_component]


def divided(a: Array, b: Array) -> Array:
    """a / b, 0 where b is."""
    return np.divide(a, b, out=np.zeros(np.broadcast(a, b).shape), where=b > 0)


def perfect(jump: Array, z: Array, normalised_gap: Array, rate: float, parameters: Array) -> Array:  # noqa: ARG001
    """d = 0."""
    return divided(jump, wide(z, jump.shape[1]))


def with_friction(pressure: Array, friction: Array, jump: Array, z: Array) -> Array:
    """Coulomb's law for given pressures: the traction that stops the sliding, no longer than mu P."""
    if jump.shape[1] == 1:
        return -pressure[:, None]
    stop = divided(jump[:, 1:], z[:, 1:])
    sliding = np.hypot(jump[:, 1], jump[:, 2]) > friction * pressure * z[:, 1]
    unit = divided(jump[:, 1:], np.hypot(jump[:, 1], jump[:, 2])[:, None])
    shear = np.where(sliding[:, None], (friction * pressure)[:, None] * unit, stop)
    shear[(pressure <= 0) | (z[:, 1] <= 0)] = 0.0
    return np.column_stack([-pressure, shear])


def contact(jump: Array, z: Array, normalised_gap: Array, rate: float, parameters: Array) -> Array:  # noqa: ARG001
    """0 <= g + d_n perp P >= 0."""
    pressure = divided(np.maximum(0.0, -(jump[:, 0] + normalised_gap)), z[:, 0])
    return with_friction(pressure, parameters[:, 0], jump, z)


def no_slip(jump: Array, z: Array, normalised_gap: Array, rate: float, parameters: Array) -> Array:
    """The same along N; points that touch do not slide."""
    pressure = divided(np.maximum(0.0, -(jump[:, 0] + normalised_gap)), z[:, 0])
    if jump.shape[1] == 1:
        return -pressure[:, None]
    touching = normalised_gap <= rate * parameters[:, 0]
    return np.column_stack([-pressure, np.where(touching[:, None], divided(jump[:, 1:], z[:, 1:]), 0.0)])


def elastic_layer(jump: Array, z: Array, normalised_gap: Array, rate: float, parameters: Array) -> Array:
    """F = k [u]."""
    k = wide(parameters, jump.shape[1])
    return k * (jump + normalised_gap) / (rate + k * wide(z, jump.shape[1]))


def soft_contact(jump: Array, z: Array, normalised_gap: Array, rate: float, parameters: Array) -> Array:
    """P = k max(0, -[u].N)."""
    stiffness = parameters[:, 1]
    closing = np.maximum(0.0, -(jump[:, 0] + normalised_gap.reshape(jump.shape)[:, 0]))
    return with_friction(stiffness * closing / (rate + stiffness * z[:, 0]), parameters[:, 0], jump, z)


def viscous_joint(jump: Array, z: Array, normalised_gap: Array, rate: float, parameters: Array) -> Array:  # noqa: ARG001
    """F = c d."""
    c = wide(parameters, jump.shape[1])
    return c * jump / (1.0 + c * wide(z, jump.shape[1]))


def maxwell_joint(jump: Array, z: Array, normalised_gap: Array, rate: float, parameters: Array) -> Array:
    """F = c_u k [u]."""
    return elastic_layer(jump, z, normalised_gap, rate, parameters[:, 3:] * parameters[:, :2])
