"""Scales of the iteration: impedance or stiffness of the sides of interfaces, characteristic traction."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..fem.elasticity import lame
from ..latin.assembly import Array, InterfaceUnit, Layout
from ..scene.boundaries import PrescribedDisplacement, PrescribedVelocity
from ..scene.fields import split_face
from ..scene.laws import InputLaw
from ..scene.schema import Scene
from .body import Body, body_sides
from .checks import boundaries_of
from .conditions import Motion


def characteristic_traction(scene: Scene, bodies: dict[str, Body], time: Array) -> float:
    """Largest traction that loads, initial values and prescribed motions can bring, Pa."""
    sizes = [0.0, *_load_tractions(scene, time)]
    impedances = _impact_impedances(bodies, float(time[1] - time[0]))
    for name, body in bodies.items():
        z_p, description = impedances[name], body.description
        spin = float(np.linalg.norm(description.initial_spin)) * body.mesh.size
        sizes.append(z_p * (float(np.linalg.norm(description.initial_velocity)) + spin))
        sizes.append(float(np.linalg.norm(description.body_force)) * body.mesh.size)
        sizes += [z_p * float(np.abs(motion.velocity(time)).max()) for motion in _motions(scene, name)]
    stiffest = max(impedances.values())
    for interface in scene.interface.values():
        substructure, face = split_face(interface.sides[0])
        sizes.append(interface.initial_pressure(float(bodies[substructure].face(face).areas.sum())))
        if interface.ground_velocity is not None:
            ground = interface.ground_velocity
            speed = float(np.linalg.norm(ground.vector) * np.abs(ground.law.sample(time)).max())
            sizes.append(stiffest * speed)
    return max(sizes)


def _impact_impedances(bodies: dict[str, Body], dt: float) -> dict[str, float]:
    """Traction per velocity that a body can bring, Pa s m-1: rho c_p; of a rigid body, its momentum lost in one step,
    or what the stiffest elastic body can take where there is one."""
    elastic = [body.shape.impedances[0] for body in bodies.values() if not body.rigid]
    impedances = {}
    for name, body in bodies.items():
        stop = body.shape.material.density * body.mesh.size / dt
        impedances[name] = min(stop, max(elastic, default=stop)) if body.rigid else body.shape.impedances[0]
    return impedances


def _load_tractions(scene: Scene, time: Array) -> Iterator[float]:
    """Largest traction of each load, Pa; the amplitude of an input, known only later, counts as 1 at least."""
    for load in scene.load.values():
        size = abs(load.pressure) if load.pressure is not None else float(np.linalg.norm(load.traction or 0.0))
        largest = float(np.abs(load.law.sample(time)).max())
        yield size * (max(largest, 1.0) if isinstance(load.law, InputLaw) else largest)


def _motions(scene: Scene, substructure: str) -> Iterator[Motion]:
    """Prescribed motions of a substructure, component by component."""
    for boundary in boundaries_of(scene, substructure).values():
        if isinstance(boundary, PrescribedVelocity | PrescribedDisplacement):
            for value in boundary.value:
                yield Motion(boundary.law, value, isinstance(boundary, PrescribedDisplacement))


def side_impedance(bodies: dict[str, Body], units: list[InterfaceUnit], layout: Layout) -> Array:
    """Material impedance of every channel, (n_flat,), Pa s m-1; 0 on the ground and on rigid bodies."""
    impedance = np.zeros(layout.n_flat)
    for i, side, name in body_sides(units):
        if not bodies[name].rigid:
            channels = layout.channels(i, side)
            impedance[channels[:, 0]], impedance[channels[:, 1:]] = bodies[name].shape.impedances
    return impedance


def side_stiffness(bodies: dict[str, Body], units: list[InterfaceUnit], layout: Layout) -> Array:
    """Stiffness per area of the body behind every channel (n_flat,), Pa m-1, 0 on the ground: modulus over length, E
    along the normal (lambda + 2 mu would make nearly incompressible bodies too stiff), mu along the face."""
    stiffness = np.zeros(layout.n_flat)
    for i, side, name in body_sides(units):
        material, length = bodies[name].shape.material, _length(bodies[name], units[i])
        channels = layout.channels(i, side)
        stiffness[channels[:, 0]] = material.young_modulus / length
        stiffness[channels[:, 1:]] = lame(material.young_modulus, material.poisson_ratio)[1] / length
    return stiffness


def _length(body: Body, unit: InterfaceUnit) -> float:
    """Size of a body behind an interface, m: along the normal; where the face is wider, the geometric mean with its
    width, for the bending and the shear lag of thin bodies."""
    normal = unit.geometry.frames[:, 0].mean(axis=0)
    along = float(np.ptp(body.mesh.nodes @ normal))
    along = max(along, 1e-3 * body.mesh.size)
    return float(np.sqrt(along * max(along, np.sqrt(unit.geometry.areas.sum()))))


def static_traction(scene: Scene, bodies: dict[str, Body], time: Array) -> float:
    """Largest traction that loads and prescribed motions can bring, Pa: a motion counts as if it strained the softest
    body along its whole length."""
    sizes = [*(i.preload for i in scene.interface.values()), *_load_tractions(scene, time)]
    softest = min(body.shape.material.young_modulus / body.mesh.size for body in bodies.values())
    travels = [0.0]
    for name, body in bodies.items():
        sizes.append(float(np.linalg.norm(body.description.body_force)) * body.mesh.size)
        for motion in _motions(scene, name):
            steps = motion.step_velocity(time)[1:] * np.diff(time)
            travels.append(float(np.abs(np.cumsum(steps)).max()))
    for interface in scene.interface.values():
        if interface.ground_velocity is not None:
            ground = interface.ground_velocity
            speed = ground.law.sample(time)
            travels.append(float(np.linalg.norm(ground.vector)) * float(np.abs(np.cumsum(speed)).max() * time[1]))
    return max(*sizes, softest * max(travels), 0.0)
