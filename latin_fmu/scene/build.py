"""From description to operators: the one place that knows both the scene and the solver."""

from __future__ import annotations

import difflib
import hashlib
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..errors import Problem, SceneError
from ..fem.mesh import Array
from ..latin.assembly import Assembly
from ..latin.layout import Index, InterfaceUnit, Layout
from ..latin.recorder import SubstructureInfo, Wanted
from ..latin.search_direction import SearchDirection, unresolved_sides
from ..latin.settings import Settings
from ..propagator import DirectPropagator, LoadTerm, SubstructureModel
from ..time_scheme import TimeScheme, make_scheme
from .body import Body, build_bodies, locking_remarks
from .boundaries import Boundary, Periodic, PrescribedVelocity
from .conditions import Conditions, build_conditions
from .fields import GROUND, split_face
from .laws import sampled_impulse_error
from .pairing import build_interface
from .schema import Scene
from .solver_settings import WHOLE, Anderson, Uniform

_SAMPLING = 1e-3  # relative error of a sampled impulse that is worth a remark


@dataclass(frozen=True)
class Built:
    """A scene turned into operators, ready to run."""

    assembly: Assembly
    settings: Settings
    wanted: Wanted
    info: dict[str, SubstructureInfo]
    warnings: tuple[str, ...]


def build(scene: Scene) -> Built:
    """Meshes, matrices, interfaces and factors of a scene.

    Raises
    ------
    SceneError : meshes that cannot be read, unknown faces, faces that do not fit; all at once.
    """
    problems: list[Problem] = []
    time = np.linspace(0.0, scene.time.end, scene.time.n_step + 1)
    bodies = build_bodies(scene, problems)
    _check_faces(scene, bodies, problems)
    if problems:
        raise SceneError(problems, "the scene cannot be built")
    conditions = {
        name: build_conditions(body, _boundaries_of(scene, name), time, problems)
        for name, body in bodies.items()
    }
    found = [build_interface(n, i, bodies, time, problems) for n, i in scene.interface.items()]
    if problems:
        raise SceneError(problems, "the scene cannot be built")
    units = [unit for unit in found if unit is not None]
    layout = Layout(units)
    scheme = make_scheme(scene.time.scheme.type, scene.time.scheme.model_dump(exclude={"type"}))
    propagators, channels = _propagators(scene, bodies, conditions, units, layout, scheme, time)
    assembly = Assembly(
        time, propagators, channels, units, layout, _impedance(bodies, units, layout),
        _characteristic_traction(scene, bodies, time), scheme,
    )  # fmt: skip
    remarks = [*locking_remarks(bodies), *_sampling_remarks(scene), *unresolved_sides(assembly)]
    info = {
        n: SubstructureInfo(b.mesh.nodes, b.mesh.cells, b.mesh.cell_type, b.shape.stress)
        for n, b in bodies.items()
    }
    output = scene.output
    wanted = Wanted(output.fields, output.stress, output.energy, output.every)
    return Built(assembly, settings_of(scene), wanted, info, tuple(remarks))


def settings_of(scene: Scene) -> Settings:
    """Settings of the iteration."""
    solver = scene.solver
    direction = solver.search_direction
    uniform = (direction.normal, direction.tangential) if isinstance(direction, Uniform) else (0.0, 0.0)
    return Settings(
        tolerance=solver.tolerance,
        force_tolerance=solver.force_mismatch_tolerance,
        max_iterations=solver.max_iterations,
        search_direction=SearchDirection(direction.type, direction.factor, *uniform),
        anderson_depth=solver.acceleration.depth if isinstance(solver.acceleration, Anderson) else 0,
        relaxation=solver.relaxation,
        window=0 if solver.window == WHOLE else min(int(solver.window), scene.time.n_step),
        sequential_start=solver.window == WHOLE and solver.start == "sequential",
    )


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


def _check_faces(scene: Scene, bodies: dict[str, Body], problems: list[Problem]) -> None:
    for where, side in _faces_named(scene):
        substructure, face = split_face(side)
        if substructure not in bodies:
            continue
        known = sorted(bodies[substructure].mesh.faces)
        if face not in known:
            close = difflib.get_close_matches(face, known, 1)
            problems.append(
                Problem(where, "unknown face", side, ", ".join(known) or "no named surface group touches this volume",
                        f"did you mean {substructure}.{close[0]!s}?" if close else None)
            )  # fmt: skip


def _boundaries_of(scene: Scene, substructure: str) -> dict[str, Boundary]:
    def face(boundary: Boundary) -> str:
        return boundary.faces[0] if isinstance(boundary, Periodic) else boundary.face

    return {n: b for n, b in scene.boundary.items() if split_face(face(b))[0] == substructure}


def _propagators(
    scene: Scene, bodies: dict[str, Body], conditions: dict[str, Conditions], units: list[InterfaceUnit],
    layout: Layout, scheme: TimeScheme, time: Array,
) -> tuple[list[DirectPropagator], list[Index]]:  # fmt: skip
    """One propagator per class of identical substructures, and the flat indices of its channels."""
    classes: dict[bytes, list[tuple[SubstructureModel, Index]]] = {}
    for name, body in bodies.items():
        model, channels = _model(scene, name, body, conditions[name], units, layout, time)
        classes.setdefault(_signature(model, body), []).append((model, channels))
    propagators, flat = [], []
    for members in classes.values():
        models = [m for m, _ in members]
        propagators.append(DirectPropagator(models, scheme, float(time[1]), scene.output.energy))
        flat.append(np.stack([c for _, c in members], axis=1))
    return propagators, flat


def _model(
    scene: Scene,
    name: str,
    body: Body,
    held: Conditions,
    units: list[InterfaceUnit],
    layout: Layout,
    time: Array,
) -> tuple[SubstructureModel, Index]:
    traces, areas, preloads, channels = [], [], [], []
    for i, unit in enumerate(units):
        for side, face in enumerate(unit.sides):
            if face == GROUND or split_face(face)[0] != name:
                continue
            n_component = unit.behaviour.n_component
            trace = unit.geometry.local_trace(side, n_component)
            assert trace is not None
            traces.append(trace)
            areas.append(np.repeat(unit.geometry.areas, n_component))
            pressed = np.zeros((unit.geometry.n_point, n_component))
            pressed[:, 0] = unit.preload * (-1.0 if side == 0 else 1.0)
            preloads.append(pressed.ravel())
            channels.append(layout.channels(i, side).ravel())
    n_full = body.full_size()
    trace = sp.csr_array(sp.vstack(traces)) if traces else sp.csr_array((0, n_full))
    area = np.concatenate(areas) if areas else np.zeros(0)
    loads = _loads(scene, name, body, time)
    if any(p.any() for p in preloads):  # the initial stress is in equilibrium: it holds the preload
        balance = np.asarray(-(trace.T @ (area * np.concatenate(preloads))))
        loads.append(LoadTerm("", balance, np.ones(len(time))))
    mass, stiffness = body.shape.matrices
    description = body.description
    model = SubstructureModel(
        name=name, mass=mass, damping=_damping(body, held), stiffness=stiffness, expansion=held.expansion,
        trace=trace, channel_area=area, loads=loads,
        displacement=np.tile(description.initial_displacement, body.mesh.n_node),
        velocity=np.tile(description.initial_velocity, body.mesh.n_node),
        imposed_pattern=held.pattern, imposed_velocity=held.velocity, imposed_start=held.start,
        ordering=body.shape.rank,
    )  # fmt: skip
    return model, np.concatenate(channels) if channels else np.zeros(0, dtype=np.int64)


def _damping(body: Body, held: Conditions) -> sp.csr_array | None:
    material = body.shape.material
    mass, stiffness = body.shape.matrices
    damping: sp.csr_array | None = None
    if material.rayleigh_mass or material.rayleigh_stiffness:
        damping = sp.csr_array(material.rayleigh_mass * mass + material.rayleigh_stiffness * stiffness)
    if held.dashpots is not None:
        damping = held.dashpots if damping is None else sp.csr_array(damping + held.dashpots)
    return damping


def _loads(scene: Scene, name: str, body: Body, time: Array) -> list[LoadTerm]:
    terms = []
    if any(body.description.body_force):
        pattern = body.shape.body_load(np.asarray(body.description.body_force))
        terms.append(LoadTerm("", pattern, np.ones(len(time))))
    for load_name, load in scene.load.items():
        substructure, face_name = split_face(load.face)
        if substructure != name:
            continue
        face = body.face(face_name)
        if load.pressure is not None:
            nodal = -load.pressure * face.vector_areas
        else:
            nodal = face.areas[:, None] * np.asarray(load.traction)
        pattern = np.zeros((body.mesh.n_node, 3))
        pattern[face.nodes] = nodal
        terms.append(LoadTerm(load_name, pattern.ravel(), load.law.sample(time)))
    return terms


def _signature(model: SubstructureModel, body: Body) -> bytes:
    """Equal for substructures whose operators are equal (loads, initial values and place do not count)."""
    digest = hashlib.sha256()
    size = float(body.mesh.extent().max())
    digest.update(repr((body.shape.material, body.mesh.cell_type)).encode())
    digest.update(np.round((body.mesh.nodes - body.mesh.nodes[0]) / size, 9).astype("f8").tobytes())
    digest.update(body.mesh.cells.tobytes())
    for matrix in (model.expansion, model.trace):
        matrix.sort_indices()
        for part in (matrix.indptr, matrix.indices, np.round(matrix.data, 9) + 0.0):
            digest.update(np.ascontiguousarray(part).tobytes())
    digest.update((np.round(model.channel_area / size**2, 12) + 0.0).tobytes())
    if model.damping is not None:
        digest.update(
            repr((model.damping.nnz, float(model.damping.trace()), float(abs(model.damping).sum()))).encode()
        )
        digest.update(model.damping.indices.tobytes())
    digest.update(model.imposed_pattern.tobytes())
    return digest.digest()


def _impedance(bodies: dict[str, Body], units: list[InterfaceUnit], layout: Layout) -> Array:
    impedance = np.zeros(layout.n_flat)
    for i, unit in enumerate(units):
        for side, face in enumerate(unit.sides):
            if face == GROUND:
                continue
            z_p, z_s = bodies[split_face(face)[0]].shape.impedances
            channels = layout.channels(i, side)
            impedance[channels[:, 0]] = z_p
            impedance[channels[:, 1:]] = z_s
    return impedance


def _characteristic_traction(scene: Scene, bodies: dict[str, Body], time: Array) -> float:
    """Largest traction that loads, initial values and prescribed motions can bring, Pa."""
    sizes = [0.0]
    for load in scene.load.values():
        amplitude = float(np.abs(load.law.sample(time)).max())
        size = (
            abs(load.pressure) if load.pressure is not None else float(np.linalg.norm(load.traction or 0.0))
        )
        sizes.append(size * amplitude)
    for name, body in bodies.items():
        z_p = body.shape.impedances[0]
        sizes.append(z_p * float(np.linalg.norm(body.description.initial_velocity)))
        sizes.append(float(np.linalg.norm(body.description.body_force)) * float(body.mesh.extent().max()))
        for boundary in _boundaries_of(scene, name).values():
            if isinstance(boundary, PrescribedVelocity):
                speed = max(abs(v) for v in boundary.value) * float(np.abs(boundary.law.sample(time)).max())
                sizes.append(z_p * speed)
    stiffest = max(body.shape.impedances[0] for body in bodies.values())
    for interface in scene.interface.values():
        sizes.append(interface.preload)
        if interface.ground_velocity is not None:
            ground = interface.ground_velocity
            speed = float(np.linalg.norm(ground.vector) * np.abs(ground.law.sample(time)).max())
            sizes.append(stiffest * speed)
    return max(sizes)


def _sampling_remarks(scene: Scene) -> list[str]:
    """Loads whose sampled impulse differs from the exact one."""
    time = np.linspace(0.0, scene.time.end, scene.time.n_step + 1)
    remarks = []
    for name, load in scene.load.items():
        error = sampled_impulse_error(load.law, time)
        if abs(error) > _SAMPLING:
            remarks.append(
                f"load {name}: sampled at the instants its impulse is off by {100 * error:+.2g} % "
                "(jumps between instants): let jumps fall on instants, or take smaller steps"
            )
    return remarks
