"""The state at t = 0: tractions of perfect interfaces, of compliant ones, and of rigid bodies in contact.

start
-----
The instant t = 0: velocity is imposed there, so it stays out of the iteration.

A perfect interface gets the traction that makes the accelerations of its sides equal (else a cut and a merged
model differ), an open contact none, a preloaded one its preload, one that carries a rigid body what it carries;
after a static start each has the traction found there.

standing
--------
Rigid bodies that stand on something at t = 0: the contact forces of that instant.

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
import scipy.sparse.linalg as spla

from ..interface import Contact
from ..interface.behaviour import bonds
from ..propagator.base import MassFactor
from .assembly import Array, Assembly, Group
from .instant_solve import PointByPoint

_ROUND_OFF = 1e-12
_BALANCED = 1e-7  # what a static start leaves unbalanced is no reason to accelerate anything


def initial_conditions(assembly: Assembly) -> tuple[Array, Array]:
    """Start every propagator; tractions and velocities (n_flat,) of the channels at t = 0."""
    propagators = assembly.propagators
    if assembly.quasi_static:
        return _at_rest(assembly)
    traction = np.zeros(assembly.layout.n_flat)
    _known_tractions(assembly, traction)
    unbalance = [p.initial_unbalance(traction[c]) for p, c in zip(propagators, assembly.channels, strict=True)]
    # a preload and its balance cancel to round-off: no reason to factorise the mass
    level = (
        (_BALANCED if assembly.start_tractions else _ROUND_OFF)
        * assembly.characteristic_traction
        * float(assembly.layout.area.sum())
    )
    ground = np.zeros(assembly.layout.n_flat)
    assembly.ground_acceleration(ground, 0)
    moving = ground.any() or any(np.abs(u).max(initial=0.0) > level for u in unbalance)
    standing = standing_points(assembly)
    moving |= bool(standing) and any(p.channel_velocity().any() for p in propagators)  # friction brakes what slides
    factors = [p.mass_factor() if moving else None for p in propagators]
    if moving:
        known = [f for f in factors if f is not None]
        carried = standing_tractions(assembly, standing, traction, unbalance, known)
        if carried.any():
            traction += carried
            unbalance = [p.initial_unbalance(traction[c]) for p, c in zip(propagators, assembly.channels, strict=True)]
        traction += _bonded_tractions(assembly, unbalance, known)
    for propagator, channels, factor in zip(propagators, assembly.channels, factors, strict=True):
        propagator.start(traction[channels], factor)
    velocity = assembly.gather([p.channel_velocity() for p in propagators])
    assembly.ground_velocity(velocity, 0)
    return traction, velocity


def _at_rest(assembly: Assembly) -> tuple[Array, Array]:
    """Without inertia nothing acts at t = 0 but a preload and its balance; the loads come with the first increment."""
    traction = np.zeros(assembly.layout.n_flat)
    _known_tractions(assembly, traction)
    for propagator, channels in zip(assembly.propagators, assembly.channels, strict=True):
        propagator.start(traction[channels], None)
    return traction, np.zeros(assembly.layout.n_flat)


def _known_tractions(assembly: Assembly, traction: Array) -> None:
    """Write what is known beforehand: preloads, and the tractions that compliant interfaces have in this state."""
    for group in assembly.layout.groups:
        block = group.block(traction)
        block[0, :, 0], block[1, :, 0] = -group.preload, group.preload
    groups = [g for g in assembly.layout.groups if g.behaviour.compliant]
    if groups:
        _compliant_tractions(assembly, groups, traction)
    for i, known in assembly.start_tractions.items():
        traction[assembly.layout.channels(i, 0)] = known
        traction[assembly.layout.channels(i, 1)] = -known


def _compliant_tractions(assembly: Assembly, groups: list[Group], traction: Array) -> None:
    """Write what compliant interfaces carry in the present state."""
    u, v = assembly.displacement(), assembly.gather([p.channel_velocity() for p in assembly.propagators])
    assembly.ground_velocity(v, 0)
    u -= assembly.scheme.gap_offset(assembly.dt) * v
    for group in groups:
        moved, sliding = (block[1] - block[0] for block in (group.block(u), group.block(v)))
        moved[:, 0] += group.gap
        held = np.zeros((group.n_point, 2))
        jump = np.zeros_like(moved) if group.behaviour.elastic else sliding
        block = group.block(traction)
        block[0] = group.behaviour.local(jump, held, moved, 1.0, group.parameters)
        block[1] = -block[0]


def _bonded_tractions(assembly: Assembly, unbalance: list[Array], factors: list[MassFactor]) -> Array:
    """Tractions on perfect interfaces that make accelerations continuous, 0 elsewhere; flat.

    Conjugate gradients on the jump of accelerations: consistent even where bonds are redundant.
    """
    bonded = [i for i, unit in enumerate(assembly.interfaces) if bonds(unit.behaviour)]
    flat = np.zeros(assembly.layout.n_flat)
    if not bonded:
        return flat
    first, second = (np.concatenate([assembly.layout.channels(i, side).ravel() for i in bonded]) for side in (0, 1))
    area = assembly.layout.area[first]
    free, diagonal = np.zeros_like(flat), np.zeros_like(flat)
    assembly.ground_acceleration(free, 0)
    compliances = []
    for propagator, channels, force, factor in zip(
        assembly.propagators, assembly.channels, unbalance, factors, strict=True
    ):
        free[channels], compliance = propagator.initial_channels(factor, force)
        diagonal[channels] = np.diag(compliance)[:, None]
        compliances.append(compliance)

    def jump(x: Array) -> Array:
        """Weighted jump of the accelerations that tractions x bring (the weight keeps it symmetric)."""
        force, acceleration = np.zeros_like(flat), np.zeros_like(flat)
        force[first], force[second] = area * x, -area * x
        for channels, compliance in zip(assembly.channels, compliances, strict=True):
            acceleration[channels] = compliance @ force[channels]
        weighted: Array = area * (acceleration[first] - acceleration[second])
        return weighted

    scale = area**2 * (diagonal[first] + diagonal[second])
    inverse = np.divide(1.0, scale, out=np.ones_like(scale), where=scale > 0)
    n = len(first)
    x, _ = spla.cg(
        spla.LinearOperator((n, n), matvec=jump, dtype=float),
        -area * (free[first] - free[second]),
        rtol=1e-14,
        maxiter=10 * n,
        M=spla.LinearOperator((n, n), matvec=lambda v: inverse * v, dtype=float),
    )
    flat[first], flat[second] = x, -x
    return flat


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
