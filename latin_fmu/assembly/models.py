"""Models of the substructures of a scene, grouped into classes of identical ones."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from ..errors import SceneError
from ..fem.elasticity import without_contact_mass
from ..latin.assembly import Index, InterfaceUnit, Layout
from ..propagator import LoadTerm, SubstructureModel
from ..propagator.model import diagonal_matrix, share_patterns
from ..scene.fields import split_face
from ..scene.schema import Scene
from ..time_scheme import QuasiStatic, TimeScheme
from .body import Body, body_sides
from .conditions import Conditions, RigidConditions, rigid_model, total


@dataclass(frozen=True)
class ModelClass:
    """Substructures that share their operators.

    Attributes
    ----------
    members : models with equal matrices and traces. channels : flat indices of theirs (n_channel, n_member).
    twin : number of an earlier class with the same operators, where there is one.
    """

    members: list[SubstructureModel]
    channels: Index
    twin: int | None = None


def model_classes(
    scene: Scene,
    bodies: dict[str, Body],
    conditions: dict[str, Conditions],
    units: list[InterfaceUnit],
    layout: Layout,
    scheme: TimeScheme,
) -> list[ModelClass]:
    """Matrices of every substructure, grouped into classes of identical ones (of one each where the scene asks)."""
    classes: dict[bytes, list[tuple[SubstructureModel, Index]]] = {}
    for name, body in bodies.items():
        model, channels = _model(scene, name, body, conditions[name], units, layout, scheme)
        key = _signature(model, body) if scene.solver.share_identical else name.encode()
        classes.setdefault(key, []).append((model, channels))
    groups = []
    for members in classes.values():
        models = [m for m, _ in members]
        # with the matrices: no part of the factorisation
        _ = models[0].reduced_stiffness if models[0].mass is None else models[0].reduced
        groups.append(ModelClass(models, np.stack([c for _, c in members], axis=1)))
    share_patterns([c.members[0] for c in groups if c.members[0].mass is not None])
    return groups


def _model(
    scene: Scene,
    name: str,
    body: Body,
    held: Conditions,
    units: list[InterfaceUnit],
    layout: Layout,
    scheme: TimeScheme,
) -> tuple[SubstructureModel, Index]:
    traces, areas, preloads, channels = [], [], [], []
    for i, side in [(i, side) for i, side, owner in body_sides(units) if owner == name]:
        unit, n_component = units[i], units[i].behaviour.n_component
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
    loads = _loads(scene, name, body)
    if any(p.any() for p in preloads):  # the initial stress is in equilibrium: it holds the preload
        balance = np.asarray(-(trace.T @ (area * np.concatenate(preloads))))
        loads.append(LoadTerm("", balance))
    flat = np.concatenate(channels) if channels else np.zeros(0, dtype=np.int64)
    if isinstance(held, RigidConditions):
        rigid = rigid_model(body, held, trace, area, loads)
        return (replace(rigid, mass=None) if isinstance(scheme, QuasiStatic) else rigid), flat
    model = SubstructureModel(
        name=name,
        mass=_mass(name, body, units, scheme),
        damping=_damping(body, held),
        stiffness=body.shape.stiffness,
        expansion=held.expansion,
        trace=trace,
        channel_area=area,
        loads=loads,
        displacement=np.tile(body.description.initial_displacement, body.mesh.n_node),
        velocity=body.initial_velocity(),
        imposed_pattern=held.pattern,
        imposed_start=held.start(),
        ordering=body.shape.rank,
        lumped_mass=body.shape.lumped_mass if scheme.explicit else None,
        lumped_damping=_lumped_damping(body, held) if scheme.explicit else None,
    )
    return model, flat


def _mass(name: str, body: Body, units: list[InterfaceUnit], scheme: TimeScheme) -> sp.csr_array | None:
    """Mass of an elastic body: None in statics, without that of contact nodes where the scheme asks for it."""
    if isinstance(scheme, QuasiStatic):
        return None
    if not scheme.massless_contact:
        return body.shape.mass
    try:
        return without_contact_mass(body.shape.mass, body.mesh, _contact_nodes(name, units))
    except ValueError as error:
        raise SceneError.of(
            "the scene cannot be built",
            "time.scheme",
            f"massless_contact, substructure {name}: {error}",
            remedy="give it two elements between its contacts, or choose another scheme",
        ) from error


def _contact_nodes(name: str, units: list[InterfaceUnit]) -> Index:
    """Nodes of a substructure that take part in interfaces which may open."""
    opening = [u for u in units if u.behaviour.opens and not u.behaviour.compliant]
    traces = [opening[i].geometry.traces[side] for i, side, owner in body_sides(opening) if owner == name]
    nodes = [np.asarray(trace.indices, dtype=np.int64) // 3 for trace in traces if trace is not None]
    return np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *nodes]))


def _damping(body: Body, held: Conditions) -> sp.csr_array | None:
    material = body.shape.material
    if not (material.rayleigh_mass or material.rayleigh_stiffness):
        return held.dashpots
    rayleigh = material.rayleigh_mass * body.shape.mass + material.rayleigh_stiffness * body.shape.stiffness
    return total(sp.csr_array(rayleigh), held.dashpots)


def _lumped_damping(body: Body, held: Conditions) -> sp.csr_array | None:
    """Damping lumped with the masses of the shape, where it has its own; stiffness-proportional damping has no part."""
    mass = body.shape.lumped_mass
    if mass is None:
        return None
    return total(diagonal_matrix(body.shape.material.rayleigh_mass * mass), held.lumped_dashpots)


def _loads(scene: Scene, name: str, body: Body) -> list[LoadTerm]:
    terms = []
    if any(body.description.body_force):
        pattern = body.shape.body_load(np.asarray(body.description.body_force))
        terms.append(LoadTerm("", pattern))
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
        terms.append(LoadTerm(load_name, pattern.ravel()))
    return terms


def _signature(model: SubstructureModel, body: Body) -> bytes:
    """Equal for substructures whose operators are equal (loads, initial values and place do not count)."""
    digest = hashlib.sha256()
    size = body.mesh.size
    digest.update(repr((body.shape.material, body.shape.bending_modes, body.mesh.cell_types, f"{size:.9e}")).encode())
    digest.update(np.round((body.mesh.nodes - body.mesh.nodes[0]) / size, 9).astype("f8").tobytes())
    for block in body.mesh.blocks:
        digest.update(block.cells.tobytes())
    for matrix in (model.expansion, model.trace):
        matrix.sort_indices()
        index = (matrix.indptr.astype(np.int64), matrix.indices.astype(np.int64))
        for part in (*index, np.round(matrix.data, 9) + 0.0):
            digest.update(np.ascontiguousarray(part).tobytes())
    digest.update((np.round(model.channel_area / size**2, 12) + 0.0).tobytes())
    if model.damping is not None:
        digest.update(repr((model.damping.nnz, float(model.damping.trace()), float(abs(model.damping).sum()))).encode())
        digest.update(model.damping.indices.astype(np.int64).tobytes())
    digest.update(model.imposed_pattern.tobytes())
    if model.nodal is not None:
        digest.update((np.round(model.nodal, 9) + 0.0).tobytes())
    return digest.digest()
