"""Initial conditions: tractions and velocities of the interfaces at t = 0, outside the iteration.

A perfect interface gets the traction that makes the accelerations of its sides equal (otherwise a body cut in two and
the whole body would differ), an open contact none, a preloaded one its preload; after a static start each interface has
the traction of the static solution.

A closed contact with a rigid body needs its contact force. An elastic body put on the ground under its weight touches
it without force and is then pressed on it; a rigid body does not deform: its contact force is there at once, and
without it the body would start to fall in the first steps. Where a closed contact with a rigid body does not move along
N the contact law holds for the accelerations,

    0 <= P  perp  a' . N - a . N >= 0,   friction as in (22), (23) with the jump of accelerations, or along the sliding,

with a = a_free + T M^-1 T^T lambda; solved point by point.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse.linalg as spla

from ..interface import Contact
from ..interface.laws import bonds
from ..laws.maxwell_joint import MaxwellJoint
from ..propagator.base import MassFactor, Propagator, balance, channel_velocity, forces_of_motion
from ..propagator.interface_sweeps import MassCompliance
from .assembly import Array, Assembly, Group
from .instant_solve import PointByPoint

# Largest force, over the traction of the loads times the area of the interfaces, that counts as balanced:
_ROUND_OFF = 1e-12  # a preload and its balance cancel to round-off
_STATIC = 1e-7  # residual of a static start
_STILL = 1e-9  # relative velocity without motion, over the largest velocity


def initial_conditions(assembly: Assembly) -> tuple[Array, Array]:
    """Give every propagator its initial state; tractions and velocities (n_flat,) of the channels at t = 0."""
    propagators, channels = assembly.propagators, assembly.channels
    traction = np.zeros(assembly.layout.n_flat)
    _known_tractions(assembly, traction)
    if assembly.quasi_static:  # a preload and its balance only: the loads come with the first increment
        for propagator, rows in zip(propagators, channels, strict=True):
            propagator.start(traction[rows], None)
        return traction, np.zeros(assembly.layout.n_flat)
    forces = [balance(p, traction[c]) for p, c in zip(propagators, channels, strict=True)]
    motion = [forces_of_motion(p) for p in propagators]
    scale = assembly.characteristic_traction * float(assembly.layout.area.sum())
    level = _ROUND_OFF * scale
    if assembly.start_tractions and not assembly.sets_off:
        level = _STATIC * scale
    balanced = all(np.abs(force).max(initial=0.0) <= level for force in forces)
    round_off = [force if balanced else 0.0 for force in forces]
    closed = closed_points(assembly)
    # no forces cancel in a prescribed acceleration: it acts however small it is, so that the state at t = 0 is a linear
    # function of the motion. Damping forces of a rigid motion do cancel
    accelerates = (
        not balanced
        or bool(assembly.ground.initial_acceleration().any())
        # a body whose motion is prescribed as a whole has no inertia of its own, but moves what it touches
        or any(p.forcing.moves and p.forcing.imposed_a(0).any() for p in propagators)
        or any(np.abs(viscous).max(initial=0.0) > _ROUND_OFF * scale for viscous, _ in motion)
        # friction brakes sliding
        or (bool(closed) and any(channel_velocity(p).any() for p in propagators))
    )
    factors = [p.mass_factor() if accelerates else None for p in propagators]
    if accelerates:
        mass_factors = [f for f in factors if f is not None]

        def unbalance() -> list[Array]:
            parts = zip(propagators, channels, motion, round_off, strict=True)
            return [balance(p, traction[c]) - zero - sum(moving) for p, c, moving, zero in parts]

        contact = _contact_tractions(assembly, closed, traction, unbalance(), mass_factors)
        traction += contact
        traction += _perfect_tractions(assembly, unbalance(), mass_factors)
    for propagator, rows, factor, zero in zip(propagators, channels, factors, round_off, strict=True):
        propagator.start(traction[rows], factor, zero)
    return traction, assembly.velocity()


def _known_tractions(assembly: Assembly, traction: Array) -> None:
    """Write preloads, tractions of compliant interfaces in this state, and tractions of a static start."""
    for group in assembly.layout.groups:
        block = group.block(traction)
        block[0, :, 0], block[1, :, 0] = -group.preload, group.preload  # F.N = -P on side E
    groups = [g for g in assembly.layout.groups if g.behaviour.compliant]
    if groups:
        _compliant_tractions(assembly, groups, traction)
    # after preloads: a static start has them in its tractions
    for i, start in assembly.start_tractions.items():
        traction[assembly.layout.channels(i, 0)] = start
        traction[assembly.layout.channels(i, 1)] = -start


def _compliant_tractions(assembly: Assembly, groups: list[Group], traction: Array) -> None:
    """Write the tractions of compliant interfaces in the present state."""
    u, v = assembly.displacement(), assembly.velocity()
    # displacements of explicit schemes are ahead of the instant
    u -= assembly.scheme.gap_offset(assembly.dt) * v
    for group in groups:
        displacement, sliding = (block[1] - block[0] for block in (group.block(u), group.block(v)))
        displacement[:, 0] += group.gap
        if isinstance(group.behaviour, MaxwellJoint):  # its springs are relaxed
            displacement[:] = 0.0
        # both sides held (z = 0): the traction follows from the jumps alone
        z = np.zeros((group.n_point, 2))
        if group.behaviour.elastic:
            jump = np.zeros_like(displacement)
        else:
            jump = sliding
        block = group.block(traction)
        block[0] = group.behaviour.local(jump, z, displacement, 1.0, group.parameters)
        block[1] = -block[0]


def _channel_accelerations(propagator: Propagator, factor: Any, unbalance: Array) -> tuple[Array, Any]:
    """Channel accelerations (n_channel, n_member) at t = 0, and what multiplies by T M^-1 T^T."""
    ops = propagator.operators
    compliance: Any = MassCompliance(factor, ops)
    if not propagator.swept:
        spread = np.zeros((propagator.n_dof, propagator.n_channel))
        if isinstance(ops.trace, np.ndarray):
            spread[ops.dofs] = ops.trace.T
        else:
            spread[ops.dofs] = ops.trace.T.toarray()
        compliance = ops.trace @ factor.solve(spread)[ops.dofs]
    free: Array = ops.trace @ factor.solve(unbalance)[ops.dofs]
    if propagator.forcing.moves:
        free = free + propagator.members[0].trace @ propagator.forcing.imposed_a(0)
    return free, compliance


def _free_accelerations(
    assembly: Assembly, unbalance: Sequence[Array], factors: Sequence[MassFactor]
) -> tuple[Array, list[Any]]:
    """Accelerations (n_flat,) of the channels under the forces ``unbalance``, and per class the accelerations
    (n_channel, n_channel) due to unit forces on its channels."""
    acceleration, compliances = assembly.ground.initial_acceleration(), []
    for propagator, channels, force, factor in zip(
        assembly.propagators, assembly.channels, unbalance, factors, strict=True
    ):
        acceleration[channels], compliance = _channel_accelerations(propagator, factor, force)
        compliances.append(compliance)
    return acceleration, compliances


def _perfect_tractions(assembly: Assembly, unbalance: list[Array], factors: list[MassFactor]) -> Array:
    """Tractions (n_flat,) on perfect interfaces that make accelerations continuous, 0 elsewhere.

    Conjugate gradients on the jump of accelerations: the system is consistent even where bonds are redundant.
    """
    perfect = [i for i, unit in enumerate(assembly.interfaces) if bonds(unit.behaviour)]
    flat = np.zeros(assembly.layout.n_flat)
    if not perfect:
        return flat
    first, second = (np.concatenate([assembly.layout.channels(i, side).ravel() for i in perfect]) for side in (0, 1))
    area = assembly.layout.area[first]
    # accelerations without them, and compliances of the channels under M
    free, compliances = _free_accelerations(assembly, unbalance, factors)
    diagonal = np.zeros_like(flat)
    for channels, compliance in zip(assembly.channels, compliances, strict=True):
        diagonal[channels] = compliance.diagonal()[:, None]

    def jump(x: Array) -> Array:
        """Jump of the accelerations due to tractions x, weighted by areas, which makes it symmetric."""
        force, acceleration = np.zeros_like(flat), np.zeros_like(flat)
        force[first], force[second] = area * x, -area * x
        # C of a class is that of each of its members
        for channels, compliance in zip(assembly.channels, compliances, strict=True):
            acceleration[channels] = compliance @ force[channels]
        weighted: Array = area * (acceleration[first] - acceleration[second])
        return weighted

    scale = area**2 * (diagonal[first] + diagonal[second])
    # both sides held: any number, the residual is zero there
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


def closed_points(assembly: Assembly) -> set[tuple[int, int]]:
    """Group and number of the points of closed contacts with a rigid body whose sides do not move along N."""
    rigid = np.zeros(assembly.layout.n_flat, dtype=bool)
    for propagator, channels in zip(assembly.propagators, assembly.channels, strict=True):
        model = propagator.members[0]
        # unknowns are motions of a whole body, as those of a reduced one, but nothing resists them
        rigid[channels] = model.nodal is not None and not model.stiffness.count_nonzero()
    if not rigid.any():
        return set()
    velocity = assembly.velocity()
    level = _STILL * float(np.abs(velocity).max(initial=0.0))
    points = set()
    for g, (group, gap) in enumerate(zip(assembly.layout.groups, assembly.gaps(), strict=True)):
        if not isinstance(group.behaviour, Contact):
            continue
        normal = group.block(velocity)[..., 0]
        # no relative motion along N: closed and staying closed
        closed = (gap <= 0) & (np.abs(normal[1] - normal[0]) <= level)
        of_rigid = group.block(rigid)[..., 0].any(axis=0)
        points |= {(g, int(p)) for p in np.flatnonzero(closed & of_rigid)}
    return points


def _contact_tractions(
    assembly: Assembly,
    points: set[tuple[int, int]],
    traction: Array,
    unbalance: Sequence[Array],
    factors: Sequence[MassFactor],
) -> Array:
    """Tractions (n_flat,) of the contacts at the closed ``points`` beyond the known ones; zero elsewhere."""
    added = np.zeros_like(traction)
    if not points:
        return added
    free, compliances = _free_accelerations(assembly, unbalance, factors)
    areas = [p.operators.area for p in assembly.propagators]
    # of swept classes too, for this one solution
    dense = [c if isinstance(c, np.ndarray) else c @ np.eye(len(a)) for c, a in zip(compliances, areas, strict=True)]
    admittances = [c * a for c, a in zip(dense, areas, strict=True)]
    solver = PointByPoint(assembly, admittances, points)
    # no gap: the law for velocities, read as accelerations
    laws = [np.zeros((g.n_point, 1)) for g in assembly.layout.groups], (1.0 / assembly.dt, 0.0)
    base = np.zeros_like(traction)
    base[solver.channels] = traction[solver.channels]
    sliding = _sliding(assembly, points)
    # an equilibrium holds them already
    solution = None
    if not any(slip.any() for slip in sliding):
        solution = solver.as_it_stands(free, base, *laws)
    if solution is None:
        # the solver starts from the known tractions, and adds what they do: it must not be in ``free`` as well
        for admittance, channels in zip(admittances, assembly.channels, strict=True):
            free[channels] -= admittance @ base[channels]
        # a sliding point continues to slide: its friction follows the velocity, whatever the accelerations are
        for group, slip in zip(assembly.layout.groups, sliding, strict=True):
            group.block(free)[1, :, 1:] += slip / (_STILL * assembly.dt)
        solution, _ = solver.solve(free, base, *laws)
    added[solver.channels] = solution[solver.channels] - base[solver.channels]
    return added


def _sliding(assembly: Assembly, points: set[tuple[int, int]]) -> list[Array]:
    """Tangential velocities (n_point, n_component - 1) of sides E' over E by group, 0 but at ``points``; what moves as
    one does not slide, but for round-off."""
    velocity = assembly.velocity()
    level = _STILL * float(np.abs(velocity).max(initial=0.0))
    slips = []
    for g, group in enumerate(assembly.layout.groups):
        first, second = group.block(velocity)[..., 1:]
        slip = np.zeros_like(first)
        numbers = [p for of, p in points if of == g]
        slip[numbers] = second[numbers] - first[numbers]
        slips.append(np.where(np.abs(slip) > level, slip, 0.0))
    return slips
