"""Conditions and time laws of a scene as cards of CalculiX."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from calculix_cards import amplitude, surface

from latin_fmu.assembly.problem import DiscretisedProblem
from latin_fmu.scene.boundaries import AXES, Fixed, PrescribedDisplacement, PrescribedVelocity, Symmetry
from latin_fmu.scene.fields import split_face


def laws(ready: DiscretisedProblem) -> Iterator[str]:
    """Amplitudes at the instants of the scene; linear between them, as in the scene."""
    scene, time = ready.scene, ready.time
    for name, load in scene.load.items():
        yield from amplitude(f"A_{name}", time, load.law.sample(time))
    for name, boundary in scene.boundary.items():
        if isinstance(boundary, PrescribedDisplacement):
            yield from amplitude(f"B_{name}", time, boundary.law.sample(time))
        elif isinstance(boundary, PrescribedVelocity):
            speed = boundary.law.sample(time)
            moved = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(time) * (speed[1:] + speed[:-1]))])
            yield from amplitude(f"B_{name}", time, moved)


def held(ready: DiscretisedProblem) -> Iterator[str]:
    """What does not move."""
    yield "*BOUNDARY"
    for boundary in ready.scene.boundary.values():
        if isinstance(boundary, Fixed):
            axes = [AXES.index(c) for c in boundary.components]
        elif isinstance(boundary, Symmetry):
            name, side = split_face(boundary.face)
            mesh = ready.bodies[name].mesh
            axes = [int(np.argmin(np.ptp(mesh.nodes[mesh.faces[side].nodes], axis=0)))]
        elif isinstance(boundary, PrescribedDisplacement | PrescribedVelocity):
            continue
        else:
            raise ValueError(f"no counterpart in the deck: boundary of type {boundary.type}")
        for axis in axes:
            yield f"N_{surface(boundary.face)}, {axis + 1}, {axis + 1}"


def moved(ready: DiscretisedProblem) -> Iterator[str]:
    """What moves as prescribed."""
    for name, boundary in ready.scene.boundary.items():
        if isinstance(boundary, PrescribedDisplacement | PrescribedVelocity):
            yield f"*BOUNDARY, AMPLITUDE=B_{name.upper()}"
            for component, value in zip(boundary.components, boundary.value, strict=True):
                axis = AXES.index(component) + 1
                yield f"N_{surface(boundary.face)}, {axis}, {axis}, {value:.9e}"
