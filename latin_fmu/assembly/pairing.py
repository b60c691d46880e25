"""Interfaces of a scene: pairing of the points of two faces, gap, frames and traces."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ..errors import Problem
from ..fem.faces import Face
from ..fem.mesh import Array, Index
from ..fem.nearest import nearest
from ..interface import Behaviour, InterfaceGeometry, make_behaviour
from ..interface.geometry import local_frames
from ..latin.layout import InterfaceUnit
from ..scene.fields import split_face
from ..scene.interface_keys import PARAMETERS, TAKES
from ..scene.interfaces import Interface
from .body import Body

_MATCHING = 1e-3  # lateral distance of paired points over the spacing of points
_TOUCHING = 1e-9  # a distance along N below this fraction of the face is no gap


def build_interface(
    name: str, interface: Interface, bodies: dict[str, Body], problems: list[Problem]
) -> InterfaceUnit | None:
    """The interface ready to be solved, or None (with its problems told) when its faces do not fit."""
    body, face_name = _side(bodies, interface.sides[0])
    face = body.face(face_name)
    points = body.mesh.nodes[face.nodes]
    frames = local_frames(face.normals)
    trace = _selection(face.nodes, body)
    if interface.against_ground:
        other: sp.csr_array | None = None
        gap = np.full(len(points), interface.gap or 0.0)
    else:
        paired = _pair(name, interface, bodies, face, points, problems)
        if paired is None:
            return None
        partner, gap = paired
        other = _selection(partner, _side(bodies, interface.sides[1])[0])
    behaviour = _behaviour(interface)
    pressure = interface.initial_pressure(float(face.areas.sum()))
    if behaviour.elastic and pressure > 0 and interface.normal_stiffness:
        gap = gap - pressure / interface.normal_stiffness
    geometry = InterfaceGeometry(points, face.areas, frames, gap, (trace, other))
    if pressure > 0 and gap.max() > 0:
        problems.append(
            Problem(f"interface.{name}.preload", "a preloaded interface cannot be open", f"gap up to {gap.max():g} m",
                    remedy="close the gap of the meshes, or leave the preload out")
        )  # fmt: skip
    return InterfaceUnit(name, interface.sides, behaviour, geometry, pressure)


def _behaviour(interface: Interface) -> Behaviour:
    parameters: dict[str, float] = {
        key: getattr(interface, key) or 0.0 for key in PARAMETERS if key in TAKES[interface.behaviour]
    }
    return make_behaviour(interface.behaviour, parameters)


def _side(bodies: dict[str, Body], side: str) -> tuple[Body, str]:
    substructure, face = split_face(side)
    return bodies[substructure], face


def _selection(nodes: Index, body: Body) -> sp.csr_array:
    """(3 n_point, 3 n_node) picks the values at the nodes."""
    columns = (3 * nodes[:, None] + np.arange(3)).ravel()
    n = len(columns)
    return sp.csr_array((np.ones(n), (np.arange(n), columns)), shape=(n, body.full_size()))


def _pair(
    name: str,
    interface: Interface,
    bodies: dict[str, Body],
    face: Face,
    points: Array,
    problems: list[Problem],
) -> tuple[Index, Array] | None:
    """Node of side E' for each point of side E, and the gap along N."""
    where = f"interface.{name}.sides"
    body, face_name = _side(bodies, interface.sides[1])
    other = body.face(face_name)
    if len(other.nodes) != len(face.nodes):
        problems.append(
            Problem(where, "the nodes of the two faces do not match one to one",
                    f"{len(face.nodes)} and {len(other.nodes)} nodes", remedy="mesh both faces alike")
        )  # fmt: skip
        return None
    if float(face.vector_areas.sum(axis=0) @ other.vector_areas.sum(axis=0)) >= 0:
        problems.append(Problem(where, "the two faces do not face each other", ", ".join(interface.sides)))
        return None
    there = body.mesh.nodes[other.nodes]
    flat = np.abs(face.normals @ face.normals[0] - 1).max() < 1e-6
    along = face.normals[0]
    if flat:  # far faces pair by their lateral position
        _, partner = nearest(points - np.outer(points @ along, along), there - np.outer(there @ along, along))
    else:
        _, partner = nearest(points, there)
    jump = there[partner] - points
    normal = np.einsum("pi,pi->p", jump, face.normals)
    lateral = np.linalg.norm(jump - normal[:, None] * face.normals, axis=1)
    spacing = np.sqrt(face.areas)
    if len(np.unique(partner)) < len(partner) or (lateral > _MATCHING * spacing).any():
        worst = float((lateral / spacing).max())
        problems.append(
            Problem(where, "the nodes of the two faces do not match",
                    f"worst lateral distance {worst:.2g} of the node spacing", f"at most {_MATCHING:g}",
                    "mesh both faces alike and place them opposite each other")
        )  # fmt: skip
        return None
    gap = _gap(name, interface, normal, float(np.ptp(points, axis=0).max()), problems)
    return (other.nodes[partner], gap) if gap is not None else None


def _gap(
    name: str, interface: Interface, distance: Array, size: float, problems: list[Problem]
) -> Array | None:
    """Initial gap (n_point,): the distance of the meshes, or the number given where they touch."""
    negligible = _TOUCHING * size
    if interface.behaviour == "perfect":
        if np.abs(distance).max() > _MATCHING * size:
            problems.append(
                Problem(f"interface.{name}.sides", "bonded faces must touch", f"{np.abs(distance).max():.6g} m apart",
                        remedy='move the meshes together, or use behaviour = "contact"')
            )  # fmt: skip
            return None
        return np.zeros(len(distance))
    if distance.min() < -negligible:
        problems.append(
            Problem(f"interface.{name}.sides", "the two faces overlap at the start", f"by {-distance.min():.6g} m",
                    remedy="move one of the meshes apart")
        )  # fmt: skip
        return None
    if "gap" not in TAKES[interface.behaviour]:  # a layer fills the distance of its faces
        return np.zeros(len(distance))
    distance = np.where(distance < negligible, 0.0, distance)
    if interface.gap is None:
        return distance
    given = interface.gap
    if distance.any() and np.abs(distance - given).max() > 1e-6 * max(given, float(distance.max())):
        problems.append(
            Problem(f"interface.{name}.gap", "differs from the distance of the two meshes", f"{given:g} m",
                    f"{distance.min():g} to {distance.max():g} m",
                    "leave gap out to use the distance, or let the meshes touch to use the number")
        )  # fmt: skip
        return None
    return np.full(len(distance), given)
