"""The quasi-static mode: stiffness of the sides of interfaces, and substructures that nothing holds."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la

from ..errors import Problem
from ..fem.elasticity import lame
from ..fem.mesh import Array
from ..latin.layout import InterfaceUnit, Layout
from ..scene.boundaries import PrescribedDisplacement, PrescribedVelocity
from ..scene.fields import GROUND, split_face
from ..scene.schema import Scene
from .body import Body
from .checks import boundaries_of, largest_amplitude
from .conditions import Conditions, Motion
from .rigid import RigidConditions

_HELD = 1e-10  # a rigid motion with less relative motion at interfaces than this (squared) is free


def side_stiffness(bodies: dict[str, Body], units: list[InterfaceUnit], layout: Layout) -> Array:
    """Stiffness per area of the body behind every channel (n_flat,), Pa m-1, 0 on the ground: modulus over length, E
    along the normal (lambda + 2 mu would make nearly incompressible bodies too stiff), mu along the face."""
    stiffness = np.zeros(layout.n_flat)
    for i, unit in enumerate(units):
        for side, face in enumerate(unit.sides):
            if face == GROUND:
                continue
            body = bodies[split_face(face)[0]]
            material, length = body.shape.material, _length(body, unit)
            channels = layout.channels(i, side)
            stiffness[channels[:, 0]] = material.young_modulus / length
            stiffness[channels[:, 1:]] = lame(material.young_modulus, material.poisson_ratio)[1] / length
    return stiffness


def _length(body: Body, unit: InterfaceUnit) -> float:
    """Size of a body behind an interface, m: along the normal; where the face is wider, the geometric mean with its
    width, for the bending and the shear lag of thin bodies."""
    normal = unit.geometry.frames[:, 0].mean(axis=0)
    along = float(np.ptp(body.mesh.nodes @ normal))
    along = max(along, 1e-3 * float(body.mesh.extent().max()))
    return float(np.sqrt(along * max(along, np.sqrt(unit.geometry.areas.sum()))))


def static_traction(scene: Scene, bodies: dict[str, Body], time: Array) -> float:
    """Largest traction that loads and prescribed motions can bring, Pa: a motion counts as if it strained the softest
    body along its whole length."""
    sizes = [i.preload for i in scene.interface.values()]
    for load in scene.load.values():
        size = abs(load.pressure) if load.pressure is not None else float(np.linalg.norm(load.traction or 0.0))
        sizes.append(size * largest_amplitude(load.law, time))
    softest = np.inf
    travels = [0.0]
    for name, body in bodies.items():
        extent = float(body.mesh.extent().max())
        softest = min(softest, body.shape.material.young_modulus / extent)
        sizes.append(float(np.linalg.norm(body.description.body_force)) * extent)
        for boundary in boundaries_of(scene, name).values():
            if isinstance(boundary, PrescribedVelocity | PrescribedDisplacement):
                moving = isinstance(boundary, PrescribedDisplacement)
                for value in boundary.value:
                    steps = Motion(boundary.law, value, moving).step_velocity(time)[1:] * np.diff(time)
                    travels.append(float(np.abs(np.cumsum(steps)).max()))
    for interface in scene.interface.values():
        if interface.ground_velocity is not None:
            ground = interface.ground_velocity
            speed = ground.law.sample(time)
            travels.append(float(np.linalg.norm(ground.vector)) * float(np.abs(np.cumsum(speed)).max() * time[1]))
    return max(*sizes, softest * max(travels), 0.0)


def unheld(
    bodies: dict[str, Body], conditions: dict[str, Conditions], units: list[InterfaceUnit], because: str
) -> list[Problem]:
    """A problem for every group of substructures that could move as rigid bodies without any interface, pressed
    together as it may be, feeling it: statics cannot say where they are.

    The six motions of each body that its conditions allow, q, are free where all relative motions at the interfaces
    (normal ones; tangential ones with friction) vanish: the null space of their sum of squares. ``because`` : the key
    that asks for statics.
    """
    motions = {name: _allowed(body, conditions[name]) for name, body in bodies.items()}
    ends = np.cumsum([m.shape[1] for m in motions.values()])
    where = {n: slice(int(e) - m.shape[1], int(e)) for (n, m), e in zip(motions.items(), ends, strict=True)}
    total = int(ends[-1])
    if not total:
        return []
    squares = np.zeros((total, total))
    for unit in units:
        relative = np.zeros((unit.geometry.n_point * unit.behaviour.n_component, total))
        for side, face in enumerate(unit.sides):
            trace = unit.geometry.local_trace(side, unit.behaviour.n_component)
            if trace is not None:
                name = split_face(face)[0]
                relative[:, where[name]] += (1 - 2 * side) * (trace @ motions[name])
        squares += relative.T @ relative / unit.geometry.n_point
    values, vectors = la.eigh(squares)
    free = vectors[:, values < _HELD * max(float(values[-1]), 1e-300)] if values[-1] > 0 else vectors
    return _told(free, where, motions, because)


def _allowed(body: Body, held: Conditions) -> Array:
    """Rigid motions of the nodes that the conditions allow, prescribed ones at rest, (3 n_node, 0 ... 6)."""
    if isinstance(held, RigidConditions):
        return held.nodal[:, : held.expansion.shape[1]]
    nodes = body.mesh.nodes
    arm = (nodes - nodes.mean(axis=0)) / float(body.mesh.extent().max())
    motions = np.zeros((len(nodes), 3, 6))
    motions[:, :, :3] = np.eye(3)
    for axis in range(3):
        motions[:, :, 3 + axis] = np.cross(np.eye(3)[axis], arm)
    full = motions.reshape(-1, 6)
    p = held.expansion
    reduced = (p.T @ full) / np.maximum(p.sum(axis=0), 1)[:, None]
    against = full - p @ reduced  # what held and tied nodes do not allow
    values, vectors = la.eigh(against.T @ against / len(nodes))
    allowed: Array = full @ vectors[:, values < _HELD]
    return allowed


def _told(free: Array, where: dict[str, slice], motions: dict[str, Array], because: str) -> list[Problem]:
    """Problems from the free motions (columns)."""
    problems = []
    for name, rows in where.items():
        own = motions[name] @ free[rows] if free.size else np.zeros((0, 0))
        if not own.size or np.abs(own).max() < 1e-6:
            continue
        ways = [f"along {axis}" for i, axis in enumerate("xyz") if _contains(own, i)]
        problems.append(
            Problem(
                f"substructure.{name}",
                "nothing holds it, so that a static position does not exist",
                f"it can move {', '.join(ways)}" if ways else "it can turn",
                remedy="hold it with a boundary (fixed or symmetry with one component is enough), give it an interface "
                f"with friction or a perfect one, or leave {because} out",
            )
        )
    return problems


def _contains(motions: Array, axis: int) -> bool:
    """Whether a translation along an axis is a combination of the motions (3 n_node, n)."""
    wanted = np.zeros((len(motions) // 3, 3))
    wanted[:, axis] = 1.0
    target = wanted.ravel()
    rest = target - motions @ la.lstsq(motions, target)[0]
    return bool(np.linalg.norm(rest) < 1e-6 * np.linalg.norm(target))
