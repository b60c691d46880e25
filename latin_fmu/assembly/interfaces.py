"""Interfaces of a scene: faces whose nodes match, and others (``face_pairs``); initial gap, frames and traces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from ..errors import Problem, Problems, did_you_mean
from ..fem.faces import Face, cells_between, face_of
from ..fem.mesh import Array, Index, nearest
from ..fem.surface import Surface
from ..interface import BEHAVIOURS, Behaviour, InterfaceGeometry
from ..interface.geometry import local_frames
from ..latin.assembly import InterfaceUnit
from ..remarks import Remark, remarks_of
from ..scene.fields import GROUND, split_face
from ..scene.interfaces import PARAMETERS, TAKES, Interface
from ..scene.units import UnitSystem
from .body import Body, own_points, selection
from .conditions import Conditions
from .face_pairs import MATCHING, FacePair, Side, by_mortar, on_plane

_TOUCHING = 1e-9  # a distance along N below this fraction of the face is no gap
_CLOSABLE = 1.0  # gap = "closed" spans distances up to this share of the spacing of points
_APART = 0.55  # of the distance between facets and curved surfaces; meshes of one radius are seldom farther apart
_CAD_ROUND_OFF = 0.05  # of the search
_SAME_AREA = 1e-6
_FLAT = 1e-6
_STRAIGHT = 1e-6
_SLIVER = 0.01  # a common part below this share of both faces is worth a remark


def build_interface(
    name: str,
    interface: Interface,
    bodies: dict[str, Body],
    conditions: Mapping[str, Conditions],
    problems: Problems,
    remarks: list[Remark],
) -> InterfaceUnit | None:
    """The interface with its geometry; None, with its problems reported, where its faces do not fit."""
    sides = [_side(bodies, side) for side in interface.sides if side != GROUND]
    units = sides[0][0].units
    if interface.against_ground:
        pair = _on_ground(name, interface, sides[0], problems)
    else:
        pair = _face_pair(name, interface, (sides[0], sides[1]), conditions, problems)
        remarks += [] if pair is None else remarks_of("area", _area_remarks(name, interface, pair, units))
    if pair is None:
        return None
    gap = _gap(name, interface, pair, units, problems, remarks)
    if gap is None:
        return None
    behaviour = _behaviour(interface)
    if behaviour.opens and interface.gap != "closed":
        remarks += remarks_of("edge", _edge_remarks(name, sides, pair, gap))
    pressure = interface.initial_pressure(float(pair.areas.sum()))
    if behaviour.elastic and pressure > 0 and interface.normal_stiffness:
        gap = gap - pressure / interface.normal_stiffness
    frames = local_frames(pair.normals)
    trace = pair.traces[pair.owner]
    assert trace is not None
    weights = sp.csr_array(trace[::3, ::3] + trace[1::3, 1::3] + trace[2::3, 2::3])
    cells = cells_between(sides[pair.owner][1], weights)
    geometry = InterfaceGeometry(pair.points, pair.areas, frames, gap, pair.traces, pair.owner, pair.matching, cells)
    if pressure > 0 and gap.max() > 0:
        problems.add(
            f"interface.{name}.preload",
            "a preloaded interface cannot be open",
            f"gap up to {gap.max():g} {units['m']}",
            remedy="close the gap of the meshes, or leave the preload out",
        )
    return InterfaceUnit(name, interface.sides, behaviour, geometry, pressure)


def with_behaviours(
    units: list[InterfaceUnit], behaviours: Mapping[str, Behaviour], problems: Problems
) -> list[InterfaceUnit]:
    """Interfaces with behaviours of the caller's own, by name, in the place of those of the scene."""
    names = [unit.name for unit in units]
    allowed = ", ".join(names) or "none: no interfaces"
    problems.extend(
        Problem(f"behaviours.{name}", "no interface of this name", name, allowed, did_you_mean(name, names))
        for name in sorted(set(behaviours) - set(names))
    )
    return [replace(unit, behaviour=behaviours.get(unit.name, unit.behaviour)) for unit in units]


def _behaviour(interface: Interface) -> Behaviour:
    parameters: dict[str, float] = {
        key: getattr(interface, key) or 0.0 for key in PARAMETERS if key in TAKES[interface.behaviour]
    }
    return BEHAVIOURS[interface.behaviour](**parameters)


def _side(bodies: dict[str, Body], side: str) -> Side:
    substructure, face = split_face(side)
    return bodies[substructure], bodies[substructure].facets(face)


def _on_ground(name: str, interface: Interface, side: Side, problems: Problems) -> FacePair | None:
    """A face against the ground: a plane that the scene places, or behind the points of a plane face."""
    if (ground := interface.ground) is not None:
        normal = np.asarray(ground.normal) / np.linalg.norm(ground.normal)
        pair = on_plane(side, np.asarray(ground.point), normal)
        if pair is None:
            problems.add(
                f"interface.{name}.ground",
                "no facet of the face is turned towards the plane",
                interface.sides[0],
                "facets within 60 degrees of it",
                "turn the normal: it points out of the ground",
            )
        return pair
    body, facets = side
    face = face_of(body.mesh.nodes, facets)
    normals = face.normals
    bent = float(np.abs(normals @ normals[0] - 1).max())
    if interface.behaves_open and bent > MATCHING:
        angle = np.degrees(np.arccos(np.clip((normals @ normals[0]).min(), -1, 1)))
        problems.add(
            f"interface.{name}.sides",
            "a curved face against ground without a place",
            interface.sides[0],
            f"a plane face (its normals differ by {angle:.2g} degrees)",
            "specify the plane: ground = {point = [...], normal = [...]}",
        )
        return None
    points, trace = own_points(body, facets, face)
    return FacePair(points, face.positive_areas, normals, np.zeros(len(points)), (trace, None), np.zeros(len(points)))


def _face_pair(
    name: str, interface: Interface, sides: tuple[Side, Side], conditions: Mapping[str, Conditions], problems: Problems
) -> FacePair | None:
    """Two faces of bodies: nodes that match, else the part they have in common."""
    first, second = sides
    if interface.search is None and interface.points_from == "automatic":
        pair = node_by_node(first, second)
        if pair is not None:
            return pair
    held = [None if body.rigid else conditions[body.name].held for body, _ in sides]
    pair = by_mortar(first, second, interface.points_from, interface.search, (held[0], held[1]))
    if pair is None:
        problems.append(_apart(name, interface, first, second))
    return pair


def node_by_node(first: Side, second: Side) -> FacePair | None:
    """Faces whose nodes stand opposite each other, one to one; None where they do not."""
    (body, facets), (other_body, other_facets) = first, second
    face, other = face_of(body.mesh.nodes, facets), face_of(other_body.mesh.nodes, other_facets)
    partner = _partners(face, other, body.mesh.nodes[face.nodes], other_body.mesh.nodes[other.nodes])
    if partner is None:
        return None
    points, trace = own_points(body, facets, face)
    if face.change is None and other.change is None:
        there, other_trace = (other_body.mesh.nodes[other.nodes[partner]], selection(other.nodes[partner], other_body))
    else:
        areas, opposite = face.positive_areas, other.positive_areas[partner]
        if np.abs(opposite - areas).max() > _SAME_AREA * areas.max():
            return None  # the nodes of both match, their facets do not
        there, other_trace = own_points(other_body, other_facets, other)
        there = there[partner]
        other_trace = sp.csr_array(other_trace[(3 * partner[:, None] + np.arange(3)).ravel()])
    normals = face.normals
    distance = np.einsum("pi,pi->p", there - points, normals)
    return FacePair(points, face.positive_areas, normals, distance, (trace, other_trace), np.zeros(len(distance)))


def _partners(face: Face, other: Face, points: Array, there: Array) -> Index | None:
    """Row of the opposite node for each node of a face, None where nodes do not match or normals are not opposed."""
    if len(other.nodes) != len(face.nodes):
        return None
    normals = face.normals
    along = normals[0]
    if np.abs(normals @ along - 1).max() < _FLAT:  # far faces pair by their lateral position
        _, partner = nearest(points - np.outer(points @ along, along), there - np.outer(there @ along, along))
    else:
        _, partner = nearest(points, there)
    jump = there[partner] - points
    normal = np.einsum("pi,pi->p", jump, normals)
    lateral = np.linalg.norm(jump - normal[:, None] * normals, axis=1)
    if len(np.unique(partner)) < len(partner) or (lateral > MATCHING * np.sqrt(face.positive_areas)).any():
        return None
    opposed = np.einsum("pi,pi->p", normals, other.normals[partner]) < 0
    return partner if opposed.all() else None


def _area_remarks(name: str, interface: Interface, pair: FacePair, units: UnitSystem) -> list[str]:
    """A remark on faces that have little area in common."""
    if interface.search is not None or max(pair.shares) >= _SLIVER:
        return []
    return [
        f"interface {name}: the faces have {100 * max(pair.shares):.2g} % of their areas in common "
        f"({pair.areas.sum():.4g} {units['m2']}): are they opposite each other?"
    ]


def _apart(name: str, interface: Interface, first: Side, second: Side) -> Problem:
    """Two faces without a common part."""
    places = [body.mesh.nodes[facets.nodes] for body, facets in (first, second)]
    distance, partner = nearest(*places)
    normals = [face_of(body.mesh.nodes, facets).normals for body, facets in (first, second)]
    alike = np.einsum("pi,pi->p", normals[0], normals[1][partner]) > 0.5
    where, sides = f"interface.{name}.sides", ", ".join(interface.sides)
    if alike.mean() > 0.5:
        return Problem(where, "the two faces are not turned towards each other", sides)
    length = first[0].units["m"]
    within = "" if interface.search is None else f" within {interface.search:g} {length}"
    return Problem(
        where,
        f"the two faces have no part in common{within}",
        f"{sides}: common area 0, nearest nodes {distance.min():.4g} {length} apart",
        remedy="place the meshes opposite each other (is the scale right?), or choose other faces",
    )


def _gap(
    name: str, interface: Interface, pair: FacePair, units: UnitSystem, problems: Problems, remarks: list[Remark]
) -> Array | None:
    """Initial gap (n_point,): the distance of the faces, 0, or the number given where they touch.

    Flat facets stand for smooth surfaces: overlap below twice their distance from those (``FacePair.sags``) counts as
    touching, and so does any distance where it is that small everywhere. So does overlap of a small share of
    ``search``: the round-off of CAD files, which a remark names.
    """
    if interface.against_ground and interface.ground is None:
        return np.full(len(pair.points), interface.number_gap or 0.0)
    length = units["m"]
    size = float(np.ptp(pair.points, axis=0).max())
    size = max(size, float(np.sqrt(pair.areas.sum())))
    distance, negligible = pair.distance, _TOUCHING * size
    chordal = np.abs(distance) <= 2 * pair.sags + negligible
    if chordal.all():
        if (
            interface.behaves_open
            and interface.number_gap is None
            and interface.gap != "closed"
            and distance.min() > max(negligible, _APART * float(pair.sags.max()))
        ):
            text = f"its faces are {distance.min():.3g} to {distance.max():.3g} {length} apart, less than their flat "
            text += (
                f"facets are from the curved surfaces (up to {pair.sags.max():.3g} {length}): the gap is taken as 0; "
            )
            remarks.append(Remark("gap", f"interface {name}: {text}mesh the faces finer if it is a clearance"))
        distance = np.where(np.abs(distance) > negligible, 0.0, distance)
    distance = np.where(chordal & (distance < 0), 0.0, distance)
    if interface.behaviour == "perfect":
        return _bonded(name, distance, size, length, problems)
    if interface.gap == "closed":
        return _closed(name, pair, length, problems)
    depth = -float(distance.min())
    if negligible < depth <= _CAD_ROUND_OFF * (interface.search or 0.0):
        text = f"its faces overlap by {depth:.3g} {length}, closed as round-off of the geometry (below search / 20)"
        remarks.append(Remark("overlap", f"interface {name}: {text}"))
        distance = np.maximum(distance, 0.0)
    if distance.min() < -negligible:
        problems.append(_overlap(name, interface, f"by {-float(distance.min()):.6g} {length}"))
        return None
    if "gap" not in TAKES[interface.behaviour]:  # a layer fills the distance of its faces
        return np.zeros(len(distance))
    distance = np.where(distance < negligible, 0.0, distance)
    given = interface.number_gap
    if given is None:
        return distance
    if distance.any() and np.abs(distance - given).max() > 1e-6 * max(given, float(distance.max())):
        problems.add(
            f"interface.{name}.gap",
            "differs from the distance of the two meshes",
            f"{given:g} {length}",
            f"{distance.min():g} to {distance.max():g} {length}",
            "leave gap out to use the distance, or let the meshes touch to use the number",
        )
        return None
    return np.full(len(distance), given)


def _edge_remarks(name: str, sides: Sequence[Side], pair: FacePair, gap: Array) -> list[str]:
    """A remark on faces, none of them curved, that meet at one point or along an edge only."""
    size = float(np.ptp(pair.points, axis=0).max())
    nearest_ones = gap <= gap.min() + _TOUCHING * size
    if nearest_ones.all() or not _on_a_line(pair.points[nearest_ones], size):
        return []
    if any(sag.any() for body, facets in sides for sag in Surface(body.mesh.nodes, facets).sags):
        return []
    many = int(nearest_ones.sum())
    where = "at one point" if many == 1 else f"along an edge ({many} points)"
    return [
        f"interface {name}: its faces meet {where} only, of {len(gap)} points: the pressure there has no limit under "
        "refinement of the mesh, forces and impulses have; round the edge, or turn a face if they should be parallel"
    ]


def _on_a_line(points: Array, size: float) -> bool:
    """Whether points (n, 3) lie on one line."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return len(points) < 3 or float(spread[1]) <= _STRAIGHT * size


def _overlap(name: str, interface: Interface, depth: str) -> Problem:
    if interface.against_ground:
        return Problem(
            f"interface.{name}.ground",
            "the face and the ground overlap at the start",
            depth,
            remedy="move the plane, or turn the normal (it points out of the ground)",
        )
    remedy = "move the meshes apart"
    if "gap" in TAKES[interface.behaviour]:
        remedy += ', or set gap = "closed"'
    return Problem(f"interface.{name}.sides", "the two faces overlap at the start", depth, remedy=remedy)


def _bonded(name: str, distance: Array, size: float, length: str, problems: Problems) -> Array | None:
    if np.abs(distance).max() <= MATCHING * size:
        return np.zeros(len(distance))
    problems.add(
        f"interface.{name}.sides",
        "bonded faces must touch",
        f"{np.abs(distance).max():.6g} {length} apart",
        remedy='move the meshes together, or use behaviour = "contact"',
    )
    return None


def _closed(name: str, pair: FacePair, length: str, problems: Problems) -> Array | None:
    """Gap 0 where the distance is below the spacing of the nodes; else None and a problem."""
    far, spacing = float(np.abs(pair.distance).max()), float(np.sqrt(np.median(pair.areas)))
    if far <= _CLOSABLE * spacing:
        return np.zeros(len(pair.distance))
    problems.add(
        f"interface.{name}.gap",
        "the faces are too far apart, or overlap too much, to count as closed",
        f"{pair.distance.min():.4g} to {pair.distance.max():.4g} {length}",
        f"up to the node spacing, {spacing:.4g} {length}",
        'move the meshes together, or use gap = "measured"',
    )
    return None
