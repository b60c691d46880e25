"""The instant t = 0: velocity is imposed there, so it stays out of the iteration.

A perfect interface gets the traction that makes the accelerations of its sides equal (else a cut and a merged
model differ), an open contact none, a preloaded one its preload.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse.linalg as spla

from .assembly import Assembly
from .layout import Array

_ROUND_OFF = 1e-12


def start(assembly: Assembly) -> tuple[Array, Array]:
    """Start every propagator; tractions and velocities (n_flat,) of the channels at t = 0."""
    propagators = assembly.propagators
    traction = np.zeros(assembly.layout.n_flat)
    for group in assembly.layout.groups:
        normal = group.block(traction)[..., 0]
        normal[0], normal[1] = -group.preload, group.preload
    unbalance = [
        p.initial_unbalance(traction[c]) for p, c in zip(propagators, assembly.channels, strict=True)
    ]
    # a preload and its balance cancel to round-off: no reason to factorise the mass
    level = _ROUND_OFF * assembly.characteristic_traction * float(assembly.layout.area.sum())
    ground = np.zeros(assembly.layout.n_flat)
    assembly.ground_acceleration(ground, 0)
    moving = ground.any() or any(np.abs(u).max(initial=0.0) > level for u in unbalance)
    factors = [p.mass_factor() if moving else None for p in propagators]
    if moving:
        traction += _bonded_tractions(assembly, unbalance, [f for f in factors if f is not None])
    for propagator, channels, factor in zip(propagators, assembly.channels, factors, strict=True):
        propagator.start(traction[channels], factor)
    velocity = assembly.gather([p.channel_velocity() for p in propagators])
    assembly.ground_velocity(velocity, 0)
    return traction, velocity


def _bonded_tractions(assembly: Assembly, unbalance: list[Array], factors: list[spla.SuperLU]) -> Array:
    """Tractions on perfect interfaces that make accelerations continuous, 0 elsewhere; flat."""
    bonded = [i for i, unit in enumerate(assembly.interfaces) if not unit.behaviour.opens]
    flat = np.zeros(assembly.layout.n_flat)
    if not bonded:
        return flat
    sides = [np.concatenate([assembly.layout.channels(i, side).ravel() for i in bonded]) for side in (0, 1)]
    n = len(sides[0])
    unknown = np.full(assembly.layout.n_flat, -1)
    sign = np.zeros(assembly.layout.n_flat)
    for side, channels in enumerate(sides):
        unknown[channels] = np.arange(n)
        sign[channels] = 1.0 - 2.0 * side
    system, right = np.zeros((n, n)), np.zeros(n)
    ground = np.zeros(assembly.layout.n_flat)
    assembly.ground_acceleration(ground, 0)
    for propagator, all_channels, force, factor in zip(
        assembly.propagators, assembly.channels, unbalance, factors, strict=True
    ):
        free, compliance = propagator.initial_channels(factor, force)
        for member in range(all_channels.shape[1]):
            channels = all_channels[:, member]
            rows = np.flatnonzero(unknown[channels] >= 0)
            where, s = unknown[channels[rows]], sign[channels[rows]]
            # nodal force = area * traction, and the same weight on the equations keeps the system symmetric
            weight = s * propagator.operators.area[rows]
            system[np.ix_(where, where)] += weight[:, None] * compliance[np.ix_(rows, rows)] * weight
            np.subtract.at(right, where, weight * free[rows, member])
    grounded = ground != 0
    np.subtract.at(
        right, unknown[grounded], sign[grounded] * assembly.layout.area[grounded] * ground[grounded]
    )
    x = la.lstsq(system, right)[0]
    flat[sides[0]], flat[sides[1]] = x, -x
    return flat
