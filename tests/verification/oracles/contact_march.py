"""Transient of elastic bodies in frictional contact, one coupled contact problem per instant.

The discrete equations of the package (same matrices, same time scheme, same end-of-step law) solved by other
means: no interface impedance, no iteration between bodies. What the package converges to must be this.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .contact import ContactProblem, solve
from .monolithic import LinearSystem

Array = NDArray[np.float64]
Index = NDArray[np.int64]
State = tuple[Array, Array, Array]  # displacement, velocity, acceleration of every dof


@dataclass(frozen=True)
class Body:
    """One elastic body: its factorised system, loads (n_time, n_dof), initial state."""

    system: LinearSystem
    loads: Array
    displacement: Array
    velocity: Array


@dataclass(frozen=True)
class ContactFace:
    """Facing nodes of two bodies (second None: ground at rest), normals from the first to the second."""

    bodies: tuple[int, int | None]
    nodes: tuple[Index, Index]
    normals: Array
    gap: Array
    friction: float


@dataclass(frozen=True)
class ContactMarch:
    """Nodal forces on the first body and opening velocity per face, (n_time, m, 3), global axes; gaps of
    the law (n_time, m); displacement of each body (n_time, n_dof)."""

    force: list[Array]
    opening_velocity: list[Array]
    gap: list[Array]
    displacement: list[Array]


def local_axes(normals: Array) -> Array:
    """(m, 3, 3): rows N, t1, t2 at each point."""
    helper = np.where(np.abs(normals[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    first = np.cross(normals, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([normals, first, np.cross(normals, first)], axis=1)


def _opening_rows(face: ContactFace, body: int, n_dof: int) -> Array:
    """(3 m, n_dof): local opening velocity of a face from the velocities of one body."""
    axes, m = local_axes(face.normals), len(face.normals)
    rows = np.zeros((3 * m, n_dof))
    for side, sign in ((0, -1.0), (1, 1.0)):
        if face.bodies[side] == body:
            for p, node in enumerate(face.nodes[side]):
                rows[3 * p : 3 * p + 3, 3 * node : 3 * node + 3] += sign * axes[p]
    return rows


def march_contact(bodies: Sequence[Body], faces: Sequence[ContactFace], tolerance: float = 1e-12) -> ContactMarch:
    """March all bodies. ``ContactFace.gap`` is the gap at t0; contact forces are zero there.

    The gap of the law is the opening of the displacements, negative values (penetration) counted as closed.
    """
    rows = [np.concatenate([_opening_rows(f, b, s.system.n_dof) for f in faces]) for b, s in enumerate(bodies)]
    operator = np.sum([_delassus(s.system, r) for s, r in zip(bodies, rows, strict=True)], axis=0)
    # Directions held on both sides (symmetry planes) carry no force: give them a compliance and no motion.
    moving = np.diag(operator) > 1e-12 * np.diag(operator).max()
    operator = np.where(np.outer(moving, moving), operator, 0.0) + np.diag(np.where(moving, 0.0, operator.max()))
    counts = np.cumsum([len(f.normals) for f in faces])[:-1]
    friction = np.concatenate([np.full(len(f.normals), f.friction) for f in faces])
    n_time, m = len(bodies[0].loads), len(friction)
    step = bodies[0].system.step
    states = [_start(s) for s in bodies]
    gap, force = np.zeros((n_time, m)), np.zeros((n_time, m, 3))
    opening = np.zeros((n_time, m, 3))
    gap[0] = np.concatenate([f.gap for f in faces])
    opening[0], at_start = _opening(rows, states, 1), _opening(rows, states, 0)
    moved = [[s[0]] for s in states]
    for i in range(1, n_time):
        last = [r.T @ force[i - 1].ravel() for r in rows]
        trial = [_advance(b, s, i, f, 0.0 * f) for b, s, f in zip(bodies, states, last, strict=True)]
        free = np.where(moving.reshape(-1, 3), _opening(rows, trial, 1), 0.0)
        bias = np.maximum(gap[i - 1], 0.0) / step
        force[i] = solve(ContactProblem(operator, free, bias, friction), force[i - 1], tolerance)
        for b, body in enumerate(bodies):
            states[b] = _advance(body, states[b], i, last[b], rows[b].T @ force[i].ravel())
            moved[b].append(states[b][0])
        opening[i] = _opening(rows, states, 1)
        gap[i] = gap[0] + (_opening(rows, states, 0) - at_start)[:, 0]
    axes = np.concatenate([local_axes(f.normals) for f in faces])
    return ContactMarch(
        np.split(-np.einsum("tpa,pac->tpc", force, axes), counts, axis=1),
        np.split(np.einsum("tpa,pac->tpc", opening, axes), counts, axis=1),
        np.split(gap, counts, axis=1),
        [np.array(u) for u in moved],
    )


def _opening(rows: Sequence[Array], states: Sequence[State], order: int) -> Array:
    """Local opening of every point, (m, 3): of the displacements (order 0) or velocities (order 1)."""
    total = np.zeros(len(rows[0]))
    for r, s in zip(rows, states, strict=True):
        total += r @ s[order]
    return total.reshape(-1, 3)


def _delassus(system: LinearSystem, rows: Array) -> Array:
    """Opening velocity at the end of a step per unit contact force there."""
    s = system.scheme
    cut = rows[:, system.free]
    return (1.0 + s.alpha) * s.gamma * system.step * cut @ system.factor.solve(np.ascontiguousarray(cut.T))


def _start(body: Body) -> State:
    free = body.system.free
    u, v, a = body.displacement.copy(), body.velocity.copy(), np.zeros(body.system.n_dof)
    a[free] = body.system.start_acceleration(u[free], v[free], body.loads[0, free])
    return u, v, a


def _advance(body: Body, state: State, i: int, old: Array, new: Array) -> State:
    """One step of one body under its loads and the contact forces at both ends of the step."""
    free = body.system.free
    u, v, a = (np.zeros_like(x) for x in state)
    u[free], v[free], a[free] = body.system.advance(
        state[0][free], state[1][free], state[2][free], (body.loads[i - 1] + old)[free], (body.loads[i] + new)[free]
    )
    return u, v, a
