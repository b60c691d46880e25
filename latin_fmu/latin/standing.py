"""Rigid bodies that stand on something at t = 0: the contact forces of that instant.

An elastic body put on the ground under its weight touches it without force and is then pressed on it. A rigid body has
nothing to yield with: its contact force is there at once, and without it the first steps would stop a fall that never
was, one after the other. Where a closed contact with a rigid body does not move along N the contact law holds for the
accelerations,

    0 <= P  perp  a' . N - a . N >= 0,   friction as in (22), (23) with the jump of accelerations, or along the sliding,

with a = a_free + T M^-1 T^T lambda; solved point by point.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..interface import Contact
from ..propagator.base import MassFactor
from .assembly import Assembly
from .layout import Array
from .point_by_point import PointByPoint

_STILL = 1e-9  # of the largest velocity, or of the size of the interface


def standing_tractions(
    assembly: Assembly,
    points: set[tuple[int, int]],
    traction: Array,
    unbalance: Sequence[Array],
    factors: Sequence[MassFactor],
) -> Array:
    """What contacts at the standing ``points`` add to the known tractions (n_flat,) at t = 0; zero elsewhere."""
    added = np.zeros_like(traction)
    if not points:
        return added
    velocity = assembly.gather([p.channel_velocity() for p in assembly.propagators])
    assembly.ground_velocity(velocity, 0)
    acceleration = np.zeros_like(traction)
    assembly.ground_acceleration(acceleration, 0)
    admittances = []
    for propagator, channels, force, factor in zip(
        assembly.propagators, assembly.channels, unbalance, factors, strict=True
    ):
        acceleration[channels], compliance = propagator.initial_channels(factor, force)
        admittances.append(compliance * propagator.operators.area)
    solver = PointByPoint(assembly, admittances, points)
    known = np.zeros_like(traction)
    known[solver.channels] = traction[solver.channels]
    free = acceleration
    for admittance, channels in zip(admittances, assembly.channels, strict=True):
        free[channels] -= admittance @ known[channels]
    # what slides keeps sliding: its friction follows the velocity, whatever the accelerations are
    for group in assembly.layout.groups:
        if group.n_component > 1:
            sliding = group.block(velocity)[1, :, 1:] - group.block(velocity)[0, :, 1:]
            group.block(free)[1, :, 1:] += sliding / (_STILL * assembly.dt)
    closed = [np.zeros((g.n_point, 1)) for g in assembly.layout.groups]
    found, _ = solver.solve(free, known, closed, (1.0 / assembly.dt, 0.0))
    added[solver.channels] = found[solver.channels] - known[solver.channels]
    return added


def standing_points(assembly: Assembly) -> set[tuple[int, int]]:
    """Group and number of the points of closed contacts with a rigid body whose sides do not move along N."""
    rigid = np.zeros(assembly.layout.n_flat, dtype=bool)
    for propagator, channels in zip(assembly.propagators, assembly.channels, strict=True):
        rigid[channels] = propagator.members[0].nodal is not None
    if not rigid.any():
        return set()
    velocity = assembly.gather([p.channel_velocity() for p in assembly.propagators])
    assembly.ground_velocity(velocity, 0)
    level = _STILL * float(np.abs(velocity).max(initial=0.0))
    found = set()
    for g, (group, gap) in enumerate(zip(assembly.layout.groups, assembly.gaps(), strict=True)):
        if not isinstance(group.behaviour, Contact):
            continue
        moving = group.block(velocity)[..., 0]
        closed = (gap <= 0) & (np.abs(moving[1] - moving[0]) <= level)
        concerned = group.block(rigid)[..., 0].any(axis=0)
        found |= {(g, int(p)) for p in np.flatnonzero(closed & concerned)}
    return found
