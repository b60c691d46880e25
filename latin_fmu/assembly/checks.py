"""Checks of a scene against its meshes, and what can be said of its loads beforehand."""

from __future__ import annotations

import difflib
from collections.abc import Iterator

import numpy as np

from ..errors import Problem
from ..fem.mesh import Array
from ..latin.layout import InterfaceUnit
from ..scene.boundaries import Boundary, Periodic, PrescribedDisplacement, PrescribedVelocity
from ..scene.fields import ALL_OF_IT, GROUND, split_face
from ..scene.laws import InputLaw, TimeLaw, sampled_impulse_error
from ..scene.schema import Scene
from .body import Body
from .conditions import Motion

_SAMPLING = 1e-3  # relative error of a sampled impulse that is worth a remark


def _faces_named(scene: Scene) -> Iterator[tuple[str, str]]:
    for name, interface in scene.interface.items():
        for i, side in enumerate(interface.sides):
            if side != GROUND:
                yield f"interface.{name}.sides[{i}]", side
    for name, boundary in scene.boundary.items():
        if isinstance(boundary, Periodic):
            for i, face in enumerate(boundary.faces):
                yield f"boundary.{name}.faces[{i}]", face
        else:
            yield f"boundary.{name}.face", boundary.face
    for name, load in scene.load.items():
        yield f"load.{name}.face", load.face


def check_faces(scene: Scene, bodies: dict[str, Body], problems: list[Problem]) -> None:
    """Every face named in the scene must exist on its mesh."""
    for where, side in _faces_named(scene):
        substructure, face = split_face(side)
        if substructure not in bodies:
            continue
        known = sorted(bodies[substructure].mesh.faces)
        if face not in known and face != ALL_OF_IT:
            close = difflib.get_close_matches(face, known, 1)
            problems.append(
                Problem(
                    where,
                    "unknown face",
                    side,
                    ", ".join(known) or "no named surface group touches this volume",
                    f"did you mean {substructure}.{close[0]!s}?" if close else None,
                )
            )


def boundaries_of(scene: Scene, substructure: str) -> dict[str, Boundary]:
    """Boundary conditions on the faces of a substructure."""

    def face(boundary: Boundary) -> str:
        return boundary.faces[0] if isinstance(boundary, Periodic) else boundary.face

    return {n: b for n, b in scene.boundary.items() if split_face(face(b))[0] == substructure}


def characteristic_traction(scene: Scene, bodies: dict[str, Body], time: Array) -> float:
    """Largest traction that loads, initial values and prescribed motions can bring, Pa."""
    sizes = [0.0]
    for load in scene.load.values():
        amplitude = largest_amplitude(load.law, time)
        size = abs(load.pressure) if load.pressure is not None else float(np.linalg.norm(load.traction or 0.0))
        sizes.append(size * amplitude)
    impedances = _impact_impedances(bodies, float(time[1] - time[0]))
    for name, body in bodies.items():
        z_p = impedances[name]
        spin = float(np.linalg.norm(body.description.initial_spin)) * float(body.mesh.extent().max())
        sizes.append(z_p * (float(np.linalg.norm(body.description.initial_velocity)) + spin))
        sizes.append(float(np.linalg.norm(body.description.body_force)) * float(body.mesh.extent().max()))
        for boundary in boundaries_of(scene, name).values():
            if isinstance(boundary, PrescribedVelocity | PrescribedDisplacement):
                moving = isinstance(boundary, PrescribedDisplacement)
                for value in boundary.value:
                    speed = np.abs(Motion(boundary.law, value, moving).velocity(time)).max()
                    sizes.append(z_p * float(speed))
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
    found = {}
    for name, body in bodies.items():
        stop = body.shape.material.density * float(body.mesh.extent().max()) / dt
        found[name] = min(stop, max(elastic, default=stop)) if body.rigid else body.shape.impedances[0]
    return found


def redundancy_remarks(scene: Scene) -> list[str]:
    """Interfaces that join the same two faces: their total force is unique, its share is not."""
    seen: dict[frozenset[str], str] = {}
    remarks = []
    for name, interface in scene.interface.items():
        first = seen.setdefault(frozenset(interface.sides), name)
        if first != name:
            remarks.append(
                f"interfaces {first} and {name} join the same faces: their total force is unique, "
                "how it is shared between them is not"
            )
    return remarks


def largest_amplitude(law: TimeLaw, time: Array) -> float:
    """Largest amplitude of a law; an input, known only later, counts as 1 at least."""
    largest = float(np.abs(law.sample(time)).max())
    return max(largest, 1.0) if isinstance(law, InputLaw) else largest


def lumping_remarks(bodies: dict[str, Body]) -> list[str]:
    """Cells whose lumped masses do not suit the loads on their faces, in an explicit march.

    A smooth pulse that has run into an absorbing end leaves 7 % of its energy with 20 nodes, about 1 % with 8-node
    hexahedra and tetrahedra of 4 and 10 nodes, 0.01 % with 27.
    """
    return [
        f"substructure {name}: 20-node hexahedra in an explicit march: their lumped masses answer forces on a face "
        "with noise; take 8 or 27 nodes, or an implicit scheme"
        for name, body in bodies.items()
        if "hexahedron20" in body.mesh.cell_types and not body.rigid
    ]


def sampling_remarks(scene: Scene, time: Array) -> list[str]:
    """Laws whose impulse, sampled at the instants, differs from the exact one."""
    laws: list[tuple[str, TimeLaw]] = [(f"load {n}", load.law) for n, load in scene.load.items()]
    for name, boundary in scene.boundary.items():
        if isinstance(boundary, PrescribedVelocity):
            laws.append((f"boundary {name}", boundary.law))
    for name, interface in scene.interface.items():
        if interface.ground_velocity is not None:
            laws.append((f"ground of interface {name}", interface.ground_velocity.law))
    remarks = []
    for where, law in laws:
        error = abs(sampled_impulse_error(law, time))
        if error > _SAMPLING:
            remarks.append(
                f"{where}: sampled at the instants its time integral is off by {100 * error:.2g} % "
                "(jumps between instants): let jumps fall on instants, or take smaller steps"
            )
    return remarks


def initial_problems(scene: Scene, units: list[InterfaceUnit], problems: list[Problem], remarks: list[str]) -> None:
    """Overlaps, open preloads and torn bonds that initial displacements make; velocity jumps of bonds are remarks."""
    for unit in units:
        first, second = (None if side == GROUND else scene.substructure[split_face(side)[0]] for side in unit.sides)
        assert first is not None
        zero = (0.0, 0.0, 0.0)
        jump = np.subtract(zero if second is None else second.initial_displacement, first.initial_displacement)
        where = f"interface.{unit.name}"
        if unit.behaviour.compliant:
            continue
        if not unit.behaviour.opens:
            if jump.any():
                problems.append(
                    Problem(
                        where,
                        "initial displacements tear a bonded interface",
                        str(jump.tolist()),
                        remedy="give both sides the same initial displacement",
                    )
                )
            if second is not None and first.initial_velocity != second.initial_velocity:
                remarks.append(
                    f"interface {unit.name}: bonded sides start with different velocities; the jump is lost in the "
                    "first step, with its energy"
                )
            continue
        gap = unit.geometry.gap + unit.geometry.frames[:, 0] @ jump
        size = float(np.ptp(unit.geometry.points, axis=0).max())
        if gap.min() < -1e-9 * max(size, float(np.abs(jump).max())):
            problems.append(
                Problem(
                    where,
                    "the sides overlap at the start",
                    f"by {-gap.min():.6g} m in all",
                    remedy="change initial_displacement, or move the meshes apart",
                )
            )
        elif unit.preload > 0 and gap.max() > 1e-9 * size and not unit.geometry.gap.any():
            problems.append(
                Problem(
                    f"{where}.preload",
                    "a preloaded interface cannot be open",
                    f"{gap.max():.6g} m",
                    remedy="leave out the initial displacement that opens it, or the preload",
                )
            )
