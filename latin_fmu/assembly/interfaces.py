"""Interfaces of a scene: faces whose nodes match; faces without, by mortar or on a plane, and the search for them
([contact.NAME]); frames and traces.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from ..errors import Problem, Problems, SceneError, did_you_mean
from ..fem.faces import Surface, cells_between, face_of
from ..fem.location import inside, nearest_surface_point
from ..fem.mesh import Array, Index, nearest
from ..fem.mortar import common_cells
from ..interface import BEHAVIOURS, Behaviour, InterfaceGeometry
from ..interface.geometry import local_frames
from ..interface.laws import NoSlip
from ..latin.assembly import InterfaceUnit
from ..remarks import Remark, remarks_of
from ..scene.face_form import FaceForm
from ..scene.fields import ALL_OF_IT, GROUND, split_face
from ..scene.interfaces import PARAMETERS, TAKES, Interface
from ..scene.schema import Scene
from ..scene.units import UnitSystem
from .body import Body, build_bodies
from .clearances import TOUCHING, initial_opening
from .conditions import Conditions
from .face_pairs import MATCHING, FacePair, Side, by_mortar, face_points, node_by_node, on_plane
from .models import KeptOperators, Made
from .threads import with_threads

_LEAST = 1e-3  # a common area below this share of a facet is a touch of edges, no interface
_MOST_MIDDLES = 30  # at which bodies without a common face are searched for an overlap
_NAMED = 3  # pairs that are named before "and so many more"


def completed(scene: Scene) -> Scene:
    """The scene with the interfaces that its contact tables find, as if they had been written by hand.

    Raises
    ------
    SceneError : meshes that cannot be read; bodies that overlap.
    """
    if not scene.contact and not scene.bolt:
        return scene
    problems = Problems()
    bodies = build_bodies(scene, problems)
    whole = scene
    if not problems:
        whole, bodies, _ = with_threads(scene, bodies, problems)
    if not problems:
        whole = with_found(whole, bodies, problems)
    if problems:
        raise SceneError(problems, "the scene cannot be built")
    return whole


def with_found(
    scene: Scene,
    bodies: dict[str, Body],
    problems: Problems,
    remarks: list[Remark] | None = None,
    known: KeptOperators | None = None,
) -> Scene:
    """As ``completed``, for bodies that have been built; overlaps deeper than a search are added to ``problems``, pairs
    that touch at an edge or a point only, or on faces beside those of their own interfaces, to ``remarks``; ``known`` :
    of the scene solved last, whose distances are taken where its meshes are the same."""
    if not scene.contact:
        return scene
    if known is None:
        known = KeptOperators()
    edges: list[str] = []
    # pairs joined by hand are left alone
    by_hand = {frozenset(split_face(side)[0] for side in i.sides) for i in scene.interface.values()}
    surfaces = {name: body.surface(body.touching) for name, body in bodies.items()}
    interfaces: dict[str, Interface] = {}
    taken = set(by_hand)
    for name, table in scene.contact.items():
        names = [n for n in bodies if table.parts is None or n in table.parts]
        for first, second in _near_pairs(names, surfaces, table.search):
            pair = frozenset((first, second))
            one, other = surfaces[first], surfaces[second]
            if remarks is not None and pair in by_hand and pair not in table.exceptions:
                remarks += _left_open(scene, name, bodies, (first, second), table.search)
            if pair in taken or pair in table.exceptions:
                continue
            # twice the search: an overlap beyond it is told apart from faces far away
            near = _NearPair((bodies[first], one), (bodies[second], other), table.search, known)
            area, depth = near.common()
            if area <= _LEAST * min(one.facet_area, other.facet_area) and depth == 0.0:
                # a free shank that fills its hole: it touches, on faces that take no part
                if any(bodies[n].touching != ALL_OF_IT for n in pair) and _touch(bodies, pair, table.search):
                    continue
                depth = near.sunk()
            if area > _LEAST * min(one.facet_area, other.facet_area):
                taken.add(pair)
                # names of interfaces found before count, too
                free = _free_name(f"{first}_{second}", {*scene.joints, *interfaces})
                sides = (f"{n}.{bodies[n].touching}" for n in (first, second))
                interfaces[free] = table.interface(*sides)
            elif depth > 0.0:
                problems.add(
                    f"contact.{name}.search",
                    f"{first} and {second} overlap at the start by more than this",
                    f"{depth:.4g} {scene.unit_system['m']}",
                    f"at most {table.search:g} {scene.unit_system['m']}",
                    "move the meshes apart, or leave the pair out by except",
                )
            elif remarks is not None and near.meet():
                edges.append(f"{first} and {second}")
    if remarks is not None and edges:
        if len(edges) > _NAMED:
            more = f", {len(edges) - _NAMED} more pairs"
        else:
            more = ""
        text = "within search at an edge or a point only: no interface is made, so that they can move into each other"
        remedy = "give them faces that are opposite each other, or except them"
        remarks.append(Remark("edge", f"{', '.join(edges[:_NAMED])}{more} meet {text}; {remedy}"))
    return scene.model_copy(update={"interface": {**scene.interface, **interfaces}, "contact": {}})


class _NearPair(NamedTuple):
    """Two bodies with their surfaces, within a search, m; distances of the scene solved last are taken from ``known``
    where meshes and surfaces are the same."""

    first: tuple[Body, Surface]
    second: tuple[Body, Surface]
    search: float
    known: KeptOperators

    def _again(self, what: str, measure: Callable[[], Made]) -> Made:
        one, other = self.first[0], self.second[0]
        data = one.mesh, one.touching, other.mesh, other.touching, self.search
        return self.known.again(f"{what} of {one.name} and {other.name}", data, measure)

    def common(self) -> tuple[float, float]:
        """``_common`` area and overlap."""
        return self._again("faces", lambda: _common(self.first[1], self.second[1], self.search))

    def sunk(self) -> float:
        """How deep one body lies in the other, m."""
        return self._again("depth", lambda: _sunk(self.first, self.second, self.search))

    def meet(self) -> bool:
        """Whether the surfaces ``_meet`` anywhere."""
        return self._again("edges", lambda: _meet(self.first[1], self.second[1], self.search))


def _left_open(
    scene: Scene, name: str, bodies: dict[str, Body], pair: tuple[str, str], search: float
) -> Iterator[Remark]:
    """A remark on faces of a pair with interfaces of its own that are within ``search`` and in none of them. A pair
    that is bonded somewhere has none: a screw touches the wall of its hole beside the thread."""
    existing = {n: i for n, i in scene.interface.items() if {split_face(side)[0] for side in i.sides} == set(pair)}
    if any(i.behaviour == "perfect" for i in existing.values()):
        return
    first, second = (bodies[n].surface(ALL_OF_IT) for n in pair)
    area = _common(first, second, search)[0]
    for interface in existing.values():
        one, other = (Surface(body.mesh.nodes, facets) for body, facets in (_side(bodies, s) for s in interface.sides))
        area -= _common(one, other, search)[0]
    if area > _LEAST * min(first.facet_area, second.facet_area):
        text = (
            f"{pair[0]} and {pair[1]} are within search on {area:.3g} {scene.unit_system['m2']} that no interface has"
        )
        why = f"a search leaves a pair that has interfaces in the scene ({', '.join(existing)}) as it is"
        remedy = "add an [interface.NAME] for these faces, or except the pair"
        yield Remark("unjoined", f"contact {name}: {text}, and can move into each other there: {why}; {remedy}")


def _near_pairs(names: list[str], surfaces: dict[str, Surface], search: float) -> list[tuple[str, str]]:
    """Pairs whose bounding boxes are nearer than ``search``."""
    boxes = {n: _box(surfaces[n]) for n in names}
    return [
        (a, b)
        for a, b in combinations(names, 2)
        if bool(((boxes[a][0] - search <= boxes[b][1]) & (boxes[b][0] - search <= boxes[a][1])).all())
    ]


def _box(surface: Surface) -> tuple[Array, Array]:
    places = surface.nodes[surface.facets.nodes]
    return places.min(axis=0), places.max(axis=0)


def _common(first: Surface, second: Surface, search: float) -> tuple[float, float]:
    """Area within ``search`` of each other, m2, and how far the faces overlap where that is up to twice as much, m."""
    cells = [c for row in common_cells(first, second, 2 * search) for c in row]
    area = sum(float(c.areas[np.abs(c.distance) <= search].sum()) for c in cells)
    deepest = max((-float(c.distance.min()) for c in cells if len(c)), default=0.0)
    return area, deepest if deepest > search else 0.0


def _touch(bodies: Mapping[str, Body], pair: frozenset[str], search: float) -> bool:
    """Whether bodies are within ``search`` of each other anywhere on their surfaces."""
    one, other = (bodies[name].surface(ALL_OF_IT) for name in sorted(pair))
    return _common(one, other, search)[0] > _LEAST * min(one.facet_area, other.facet_area)


def _sunk(first: tuple[Body, Surface], second: tuple[Body, Surface], search: float) -> float:
    """How deep a body lies in another, m, at the middles of facets (``_MOST_MIDDLES`` of each); 0 up to ``search``."""
    deepest = 0.0
    for (_, surface), (body, other) in ((first, second), (second, first)):
        low, high = _box(other)
        middles = np.concatenate([pieces.centres for pieces in surface.pieces])
        # points in the bounding box alone: the search for the cells of points costs more
        middles = middles[((low < middles) & (middles < high)).all(axis=1)]
        middles = middles[:: max(1, -(-len(middles) // _MOST_MIDDLES))]
        for middle in middles[inside(body.mesh, middles)]:
            deepest = max(deepest, nearest_surface_point(other, middle)[0])
    if deepest > search:
        return deepest
    return 0.0


def _meet(first: Surface, second: Surface, search: float) -> bool:
    """Whether nodes of one surface (``_MOST_MIDDLES`` of each) are within ``search`` of the other."""
    for surface, other in ((first, second), (second, first)):
        low, high = _box(other)
        nodes = surface.nodes[surface.facets.nodes]
        nodes = nodes[((low - search <= nodes) & (nodes <= high + search)).all(axis=1)]
        for node in nodes[:: max(1, -(-len(nodes) // _MOST_MIDDLES))]:
            if nearest_surface_point(other, node, search)[0] <= search:
                return True
    return False


def _free_name(stem: str, taken: set[str]) -> str:
    # names have 100 characters: four are left for the number
    number, name = 1, stem[:96]
    while name in taken:
        number += 1
        name = f"{stem[:96]}_{number}"
    return name


def unconnected_remarks(scene: Scene, bodies: dict[str, Body]) -> list[str]:
    """Substructures without an interface, beside others that have some."""
    joined = {split_face(side)[0] for i in scene.joints.values() for side in i.sides if side != GROUND}
    if not joined:
        return []
    remarks = []
    for name in bodies:
        if name in joined:
            continue
        # nodes alone, which is enough for a message
        distance = {n: between(bodies[name], b) for n, b in bodies.items() if n != name}
        closest = min(distance, key=lambda n: distance[n])
        remarks.append(
            f"substructure {name} touches nothing: it has no interface; {closest} is the nearest, "
            f"{distance[closest]:.4g} {scene.unit_system['m']} between nodes"
        )
    return remarks


def between(one: Body, other: Body) -> float:
    """Smallest distance between nodes of the surfaces of two bodies, m."""
    places = [body.mesh.nodes[body.outside.nodes] for body in (one, other)]
    return float(np.min(nearest(*places)[0]))


_OUT_OF_FACE = 0.1  # component of an axis of a form along the normal: its cosine is within 0.5 % of 1
_STRAIGHT = 1e-6
_TOUCH = 1e-12  # gap that counts as closed without slip, over the size of the faces: round-off of displacements
_SLIVER = 0.01  # a common part below this share of both faces is worth a remark
_FEWER = 2  # times as many points on the side that was passed over: the choice is named


def build_interface(
    name: str,
    interface: Interface,
    bodies: dict[str, Body],
    conditions: Mapping[str, Conditions],
    problems: Problems,
    remarks: list[Remark],
    store: KeptOperators,
) -> InterfaceUnit | None:
    """The interface with its geometry; None, with its problems reported, where its faces do not fit. ``store`` : of the
    scene solved last, whose points and traces serve where the faces are the same."""
    sides = [_side(bodies, side) for side in interface.sides if side != GROUND]
    units = sides[0][0].units
    place = (
        interface.sides,
        interface.points_from,
        interface.points_at,
        interface.search,
        interface.ground,
        interface.behaves_open,
    )
    owners = [thing for body, _ in sides for thing in (body, conditions[body.name])]
    placed = store.again(
        f"interface {name}", (*place, *owners), lambda: _placed(name, interface, sides, conditions, problems)
    )
    if placed is None:
        return None
    pair, frames, cells = placed
    if not interface.against_ground:
        remarks += remarks_of("area", _area_remarks(name, interface, pair, units))
        remarks += remarks_of("points", _owner_remarks(name, sides, pair))
    opening = initial_opening(name, interface, pair, sides, problems, remarks)
    if opening is None:
        return None
    gap = opening.gap
    if interface.form is not None:
        formed = _formed(name, interface.form, pair, gap, units["m"], problems)
        if formed is None:
            return None
        gap = formed
    behaviour = _behaviour(interface, float(pair.areas.sum()))
    # a crown is smooth: where it touches first is no edge
    if behaviour.opens and interface.gap != "closed" and interface.form is None:
        remarks += remarks_of("edge", _edge_remarks(name, sides, pair, gap))
    pressure = interface.initial_pressure(float(pair.areas.sum()))
    if behaviour.elastic and pressure > 0 and interface.normal_stiffness:
        # [u] = -p / k_n: with this gap the layer has the pressure of the preload
        gap = gap - pressure / interface.normal_stiffness  # the preload has compressed the layer before the motion
    geometry = InterfaceGeometry(
        pair.points, pair.areas, frames, gap, pair.traces, pair.owner, pair.matching, cells, pair.linear
    )
    if pressure > 0 and opening.gap.min() < 0:
        problems.add(
            f"interface.{name}.preload",
            "a preload beside a press fit, which presses the faces by itself",
            f"an overlap of up to {-opening.gap.min():.4g} {units['m']}",
            "one of them",
            'remove the preload, or set overlap = "ignore"',
        )
    elif pressure > 0 and gap.max() > 0:
        problems.add(
            f"interface.{name}.preload",
            "a preloaded interface cannot be open",
            f"gap up to {gap.max():g} {units['m']}",
            remedy="close the gap of the meshes, or omit the preload",
        )
    return InterfaceUnit(name, interface.sides, behaviour, geometry, pressure, note=opening.note)


def _placed(
    name: str, interface: Interface, sides: Sequence[Side], conditions: Mapping[str, Conditions], problems: Problems
) -> tuple[FacePair, Array, Index] | None:
    """The faces of an interface with the frames (n_point, 3, 3) and the cells (n_cell, 4) of its points; None, with its
    problems reported, where they do not fit."""
    if interface.against_ground:
        pair = _on_ground(name, interface, sides[0], problems)
    else:
        pair = _face_pair(name, interface, (sides[0], sides[1]), conditions, problems)
    if pair is None:
        return None
    trace = pair.traces[pair.owner]
    assert trace is not None
    # a direction that is held has no row: the nodes of its point are in the others
    weights = sp.csr_array(trace[::3, ::3] + trace[1::3, 1::3] + trace[2::3, 2::3])
    facets = sides[pair.owner][1]
    if interface.at_corners:
        facets = facets.straight
    return pair, local_frames(pair.normals), cells_between(facets, weights)


def with_behaviours(
    units: list[InterfaceUnit], behaviours: Mapping[str, Behaviour], problems: Problems
) -> list[InterfaceUnit]:
    """Interfaces with user-defined behaviours, by name, instead of those of the scene."""
    names = [unit.name for unit in units]
    allowed = ", ".join(names) or "none: no interfaces"
    problems.extend(
        Problem(f"behaviours.{name}", "no interface of this name", name, allowed, did_you_mean(name, names))
        for name in sorted(set(behaviours) - set(names))
    )
    return [replace(unit, behaviour=behaviours.get(unit.name, unit.behaviour)) for unit in units]


def _behaviour(interface: Interface, area: float) -> Behaviour:
    """The behaviour of an interface with faces of this ``area``, m2."""
    if interface.behaviour == NoSlip.name:
        return NoSlip(touch=_TOUCH * float(np.sqrt(area)))
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
        pair = on_plane(side, np.asarray(ground.point), normal, interface.at_corners)
        if pair is None:
            problems.add(
                f"interface.{name}.ground",
                "no facet of the face is turned towards the plane",
                interface.sides[0],
                "facets within 60 degrees of it",
                "turn the normal: it points out of the ground",
            )
        return pair
    face = face_points(side, interface.at_corners)
    normals = face.normals
    # of faces that stay bonded the shape does not matter
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
    # gap 0: the ground lies behind each point
    nothing = np.zeros(len(face.points))
    return FacePair(face.points, face.areas, normals, nothing, (face.trace, None), nothing, linear=face.linear)


def _face_pair(
    name: str, interface: Interface, sides: tuple[Side, Side], conditions: Mapping[str, Conditions], problems: Problems
) -> FacePair | None:
    """Two faces of bodies: nodes that match, else the part they have in common."""
    first, second = sides
    whole = first[1].within is None and second[1].within is None
    corners = interface.at_corners
    if interface.search is None and interface.points_from == "automatic" and whole and not corners:
        pair = node_by_node(first, second)
        if pair is not None:
            return pair
    # the six unknowns of a rigid body are those of no node
    projectors = [None if body.rigid else conditions[body.name].held_directions for body, _ in sides]
    pair = by_mortar(sides, interface.points_from, interface.search, (projectors[0], projectors[1]), corners)
    if pair is None:
        problems.append(_apart(name, interface, first, second))
    return pair


def _owner_remarks(name: str, sides: Sequence[Side], pair: FacePair) -> list[str]:
    """A remark on points that come from side E because the sides differ in their order alone, or from a
    side that has few of them because supports hold nodes of the other one."""
    if _FEWER * len(pair.points) < pair.passed_over:
        here, there = (sides[i][0].name for i in (pair.owner, 1 - pair.owner))
        return [
            f"interface {name}: it has {len(pair.points)} points, those of {here}, as supports hold some of the "
            f"{pair.passed_over} of {there}: parts may tilt on so few; points_from chooses the other side"
        ]
    if not pair.alike:
        return []
    faces = " and ".join(f"{body.name}" for body, _ in sides)
    return [
        f"interface {name}: its points are those of side E: facets, stiffness and volume of {faces} are alike, and "
        "with the sides exchanged the results differ by the error of the mesh; points_from chooses"
    ]


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
    # both outward normals point the same way
    alike = np.einsum("pi,pi->p", normals[0], normals[1][partner]) > 0.5
    where, sides = f"interface.{name}.sides", ", ".join(interface.sides)
    if alike.mean() > 0.5:
        return Problem(where, "the two faces are not turned towards each other", sides)
    length = first[0].units["m"]
    if interface.search is None:
        within = ""
    else:
        within = f" within {interface.search:g} {length}"
    return Problem(
        where,
        f"the two faces have no part in common{within}",
        f"{sides}: common area 0, nearest nodes {distance.min():.4g} {length} apart",
        remedy="place the meshes opposite each other (is the scale right?), or choose other faces",
    )


def _formed(name: str, form: FaceForm, pair: FacePair, gap: Array, length: str, problems: Problems) -> Array | None:
    """The gap (n_point,) with the form of the faces added; None where a table does not reach all points."""
    if form.centre is None:
        centre = pair.areas @ pair.points / pair.areas.sum()
    else:
        centre = np.asarray(form.centre)
    # not of length 1 on a curved face: divided by below
    mean = pair.areas @ pair.normals
    out = max((abs(float(d @ mean)) for d in form.directions), default=0.0) / float(np.linalg.norm(mean))
    if out > _OUT_OF_FACE:
        problems.add(
            f"interface.{name}.form",
            "an axis of the form does not lie in the face",
            f"it has {out:.2g} of its length along the normal",
            f"{_OUT_OF_FACE:g} at most",
            "give axes along the face",
        )
        return None
    rise = form.sample(pair.points, pair.normals, centre)
    outside = np.flatnonzero(np.isnan(rise))
    if not len(outside):
        # round-off at the middle of a crown would leave it open
        return gap + np.where(rise <= TOUCHING * rise.max(), 0.0, rise)
    place = ", ".join(f"{x:.4g}" for x in pair.points[outside[0]] - centre)
    problems.add(
        f"interface.{name}.form",
        f"the grid does not reach {len(outside)} of {len(gap)} points of the interface",
        f"one at [{place}] {length} from the centre",
        remedy="extend the grid over the face, or move centre",
    )
    return None


def _edge_remarks(name: str, sides: Sequence[Side], pair: FacePair, gap: Array) -> list[str]:
    """A remark on faces, none of them curved, that meet at one point or along an edge only."""
    size = float(np.ptp(pair.points, axis=0).max())
    nearest_ones = gap <= gap.min() + TOUCHING * size
    if nearest_ones.all() or not _on_a_line(pair.points[nearest_ones], size):
        return []
    if any(sag.any() for body, facets in sides for sag in Surface(body.mesh.nodes, facets).sags):
        return []
    many = int(nearest_ones.sum())
    if many == 1:
        where = "at one point"
    else:
        where = f"along an edge ({many} points)"
    return [
        f"interface {name}: its faces touch only {where}, of {len(gap)} points: the pressure there has no limit under "
        "refinement of the mesh, forces and impulses have; round the edge, or turn a face if they should be parallel"
    ]


def _on_a_line(points: Array, size: float) -> bool:
    """Whether points (n, 3) lie on one line."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    # second singular value: how far they leave a line
    return len(points) < 3 or float(spread[1]) <= _STRAIGHT * size
