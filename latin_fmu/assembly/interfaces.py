"""Interfaces of a scene: faces whose nodes match; faces without, by mortar or on a plane, and the search for them
([contact.NAME]); initial gap, frames and traces.

A node of the owner that is held (a plane of symmetry, a fixed edge) cannot move, but the other side's row of its point
mixes nodes on the held edge with inner ones: the point would hold those a second time. The tractions were not unique
and the iteration slow, so such a point takes no part in the held direction, as it would not with matching nodes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import Problem, Problems, SceneError, did_you_mean
from ..fem.faces import Face, Surface, cells_between, face_of
from ..fem.location import locate, nearest_surface_point
from ..fem.mesh import Array, FacetBlock, FacetSet, Index, nearest
from ..fem.mortar import Mortar, common_cells, mortar
from ..interface import BEHAVIOURS, Behaviour, InterfaceGeometry
from ..interface.geometry import local_frames
from ..latin.assembly import InterfaceUnit
from ..remarks import Remark, remarks_of
from ..scene.face_form import FaceForm
from ..scene.fields import ALL_OF_IT, GROUND, split_face
from ..scene.interfaces import PARAMETERS, TAKES, Interface
from ..scene.schema import Scene
from ..scene.units import UnitSystem
from .body import Body, build_bodies, own_points, selection
from .conditions import Conditions
from .models import KeptOperators

MATCHING = 1e-3
"""Lateral distance of paired nodes over the spacing of nodes."""
COVERED = 0.999
"""A face counts as wholly covered where this share of the area of its facets, as far as they meet the other face at
all, is covered."""
Owner = Literal["automatic", "E", "Ep"]
Side = tuple[Body, FacetSet]
Mask = NDArray[np.bool_]
_LEAST = 1e-3  # a common area below this share of a facet is a touch of edges, no interface
_MOST_MIDDLES = 30  # at which bodies without a common face are searched for an overlap
_NAMED = 3  # pairs that are named before "and so many more"
_ON_EDGE = 1e-6  # distance from an edge over the size of the face


@dataclass(frozen=True)
class FacePair:
    """Two faces that meet, at the points of one of them.

    Attributes
    ----------
    points : (n_point, 3) on the owner, m. areas : (n_point,), m2. normals : (n_point, 3), from E to E'.
    distance : (n_point,) from E to E' along the normal, m.
    traces, owner, matching : see ``InterfaceGeometry``.
    sags : (n_point,) how far the flat facets there are from the smooth surfaces they stand for, m.
    shares : covered share of the area of each side.
    """

    points: Array
    areas: Array
    normals: Array
    distance: Array
    traces: tuple[sp.csr_array, sp.csr_array | None]
    sags: Array
    owner: int = 0
    matching: bool = True
    shares: tuple[float, float] = (1.0, 1.0)


def by_mortar(
    first: Side, second: Side, owner: Owner, reach: float | None, held: tuple[Mask | None, Mask | None]
) -> FacePair | None:
    """Faces with nodes of their own, over the part that they have in common; None where there is none.

    Parameters
    ----------
    owner : the side that gives the points; "automatic": the one that is wholly covered, else the one with the smaller
        facets; but not a rigid one, nor one whose points hold the other side where that is free (both would be more
        than the other side can follow).
    reach : see ``fem.mortar``. held : dofs of the two bodies that never move, None for rigid ones.
    """
    pair = _MortarPair((first, second), reach, held)
    if owner != "automatic":
        return pair.from_side(0 if owner == "E" else 1)
    rigid = [body.rigid for body, _ in (first, second)]
    if rigid[0] != rigid[1]:
        return pair.from_side(int(rigid[0]))
    # a little smaller counts as equal: round-off must not choose the side
    finer = int(pair.surfaces[1].facet_area < (1 - 1e-6) * pair.surfaces[0].facet_area)
    if pair.mortar(finer) is None or pair.mortar(1 - finer) is None:
        return None
    side = next((s for s in (finer, 1 - finer) if pair.covered(s)), finer)
    return pair.from_side(1 - side if pair.held_alone(side) > pair.held_alone(1 - side) else side)


class _MortarPair:
    """Two faces; the integrals with either of them as the owner are computed once."""

    def __init__(self, sides: tuple[Side, Side], reach: float | None, held: tuple[Mask | None, Mask | None]) -> None:
        self.surfaces = tuple(Surface(body.mesh.nodes, facets) for body, facets in sides)
        self._reach, self._held = reach, held
        self._mortars: dict[int, Mortar | None] = {}

    def mortar(self, side: int) -> Mortar | None:
        """Integrals with this side as the owner."""
        if side not in self._mortars:
            self._mortars[side] = mortar(self.surfaces[side], self.surfaces[1 - side], self._reach)
        return self._mortars[side]

    def covered(self, side: int) -> bool:
        """Whether the facets of this side are wholly covered, as far as they meet the other one at all."""
        part = self.mortar(side)
        return part is not None and part.covered >= COVERED

    def held_alone(self, side: int) -> int:
        """Number of directions in which points of this side cannot move while the other side can."""
        return int(self._directions(side)[1].sum())

    def _directions(self, side: int) -> tuple[Mask, Mask]:
        part, held, other = self.mortar(side), self._held[side], self._held[1 - side]
        assert part is not None
        if held is None or other is None:
            none = np.zeros((len(part.areas), 3), dtype=bool)
            return none, none
        points, own = part.owner @ self.surfaces[side].nodes, _of_vectors(part.owner)
        return _held_directions(points, part.normals, own, held, self.surfaces[1 - side], other)

    def from_side(self, side: int) -> FacePair | None:
        """Points of this side."""
        part = self.mortar(side)
        if part is None:
            return None
        mine, theirs = self.surfaces[side].nodes, self.surfaces[1 - side].nodes
        points = part.owner @ mine
        normals = part.normals if side == 0 else -part.normals
        jump = (part.other @ theirs - points) * (1 if side == 0 else -1)  # from E to E', as N
        removed, _ = self._directions(side)
        traces = [_without(_of_vectors(t), removed) for t in (part.owner, part.other)]
        shares = tuple(float(part.areas.sum()) / s.area for s in self.surfaces)
        return FacePair(
            points,
            part.areas,
            normals,
            np.einsum("pi,pi->p", jump, normals),
            (traces[side], traces[1 - side]),
            part.sags,
            side,
            False,
            (shares[0], shares[1]),
        )


def _of_vectors(trace: sp.csr_array) -> sp.csr_array:
    """A trace of each component of a vector."""
    return sp.csr_array(sp.kron(trace, sp.eye_array(3), format="csr"))


def on_plane(side: Side, point: Array, normal: Array) -> FacePair | None:
    """A face against rigid ground behind the plane through ``point`` with the unit ``normal`` out of the ground; the
    facets turned away from it by more than 60 degrees are left out. None where all are."""
    body, facets = side
    blocks = []
    for block, pieces in zip(facets.blocks, Surface(body.mesh.nodes, facets).pieces, strict=True):
        facing = np.ones(len(block.facets), dtype=bool)
        # a facet faces the ground where all its pieces do
        np.logical_and.at(facing, pieces.facet, pieces.normals @ normal < -0.5)
        blocks.append(FacetBlock(block.kind, block.facets[facing]))
    blocks = [b for b in blocks if len(b.facets)]
    if not blocks:
        return None
    facing_set = FacetSet(tuple(blocks))
    face = face_of(body.mesh.nodes, facing_set)
    points, trace = own_points(body, facing_set, face)
    vector = face.vector_areas if face.change is None else face.change.T @ face.vector_areas
    # from E to E': the plane has its normal out of the ground
    normals = np.tile(-normal, (len(points), 1))
    return FacePair(
        points,
        # area in projection on the plane, as the ground has its normal everywhere
        -vector @ normal,
        normals,
        (points - point) @ normal,
        (trace, None),
        np.zeros(len(points)),
        matching=False,
    )


def _held_directions(
    points: Array, normals: Array, own: sp.csr_array, held: Mask, other: Surface, other_held: Mask
) -> tuple[Mask, Mask]:
    """Directions (n_point, 3) in which points of the owner cannot move.

    Parameters
    ----------
    points, normals : (n_point, 3). own : trace of the owner. held, other_held : dofs of both bodies that never move.

    Returns
    -------
    Those at places where the other side is held likewise, and the rest: there the point holds the other side alone.
    """
    # no node of the point can move
    still = np.asarray(abs(own) @ (~held).astype(float)).reshape(-1, 3) == 0.0
    both = np.zeros_like(still)
    for axis in range(3):
        rows = np.flatnonzero(still[:, axis])
        if len(rows):
            edges = _edges(other.facets, other_held[axis::3])
            both[rows, axis] = _on_edges(points[rows], normals[rows], other.nodes[edges])
    return both, still & ~both


def _without(trace: sp.csr_array, removed: Mask) -> sp.csr_array:
    """The trace without the rows of these directions (n_point, 3)."""
    kept = sp.csr_array(sp.diags_array((~removed).astype(float).ravel()) @ trace)
    # else the rows would still name the nodes
    kept.eliminate_zeros()
    return kept


def _edges(facets: FacetSet, held: Mask) -> Index:
    """Nodes at the ends (n, 2) of edges whose ends are both ``held`` (n_node,)."""
    held_edges = [np.zeros((0, 2), dtype=np.int64)]
    for block in facets.blocks:
        ends = np.stack([block.corners, np.roll(block.corners, -1, axis=1)], axis=2).reshape(-1, 2)
        held_edges.append(ends[held[ends].all(axis=1)])
    return np.unique(np.sort(np.concatenate(held_edges), axis=1), axis=0)


def _on_edges(points: Array, normals: Array, ends: Array) -> Mask:
    """Whether each of ``points`` (n, 3) lies on one of the edges ``ends`` (m, 2, 3), in projection along its normal."""
    on = np.zeros(len(points), dtype=bool)
    if not len(ends):
        return on
    size = float(np.ptp(np.concatenate([points, ends.reshape(-1, 3)]), axis=0).max())
    for i, (point, normal) in enumerate(zip(points, normals, strict=True)):
        start, along = ends[:, 0] - point, ends[:, 1] - ends[:, 0]
        # as seen along the normal
        start = start - np.outer(start @ normal, normal)
        along = along - np.outer(along @ normal, normal)
        length = np.maximum(np.einsum("ei,ei->e", along, along), 1e-300)
        at = np.clip(-np.einsum("ei,ei->e", start, along) / length, 0.0, 1.0)
        on[i] = np.linalg.norm(start + at[:, None] * along, axis=1).min() < _ON_EDGE * size
    return on


def completed(scene: Scene) -> Scene:
    """The scene with the interfaces that its contact tables find, as if they had been written by hand.

    Raises
    ------
    SceneError : meshes that cannot be read; bodies that overlap.
    """
    if not scene.contact:
        return scene
    problems = Problems()
    bodies = build_bodies(scene, problems)
    whole = scene if problems else with_found(scene, bodies, problems)
    if problems:
        raise SceneError(problems, "the scene cannot be built")
    return whole


def with_found(scene: Scene, bodies: dict[str, Body], problems: Problems, remarks: list[Remark] | None = None) -> Scene:
    """As ``completed``, for bodies that have been built; overlaps deeper than a search are added to ``problems``, pairs
    that touch at an edge or a point only, or on faces beside those of their own interfaces, to ``remarks``."""
    if not scene.contact:
        return scene
    edges: list[str] = []
    # pairs joined by hand are left alone
    by_hand = {frozenset(split_face(side)[0] for side in i.sides) for i in scene.interface.values()}
    surfaces = {name: body.surface(ALL_OF_IT) for name, body in bodies.items()}
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
            area, depth = _common(one, other, table.search)
            if area <= _LEAST * min(one.facet_area, other.facet_area) and depth == 0.0:
                depth = _sunk((bodies[first], one), (bodies[second], other), table.search)
            if area > _LEAST * min(one.facet_area, other.facet_area):
                taken.add(pair)
                # names of interfaces found before count, too
                free = _free_name(f"{first}_{second}", {*scene.joints, *interfaces})
                interfaces[free] = table.interface(first, second)
            elif depth > 0.0:
                problems.add(
                    f"contact.{name}.search",
                    f"{first} and {second} overlap at the start by more than this",
                    f"{depth:.4g} {scene.unit_system['m']}",
                    f"at most {table.search:g} {scene.unit_system['m']}",
                    "move the meshes apart, or leave the pair out by except",
                )
            elif remarks is not None and _meet(one, other, table.search):
                edges.append(f"{first} and {second}")
    if remarks is not None and edges:
        more = f", {len(edges) - _NAMED} more pairs" if len(edges) > _NAMED else ""
        text = "within search at an edge or a point only: no interface is made, so that they can move into each other"
        remedy = "give them faces that are opposite each other, or except them"
        remarks.append(Remark("edge", f"{', '.join(edges[:_NAMED])}{more} meet {text}; {remedy}"))
    return scene.model_copy(update={"interface": {**scene.interface, **interfaces}, "contact": {}})


def _left_open(
    scene: Scene, name: str, bodies: dict[str, Body], pair: tuple[str, str], search: float
) -> Iterator[Remark]:
    """A remark on faces of a pair with interfaces of its own that are within ``search`` and in none of them. A pair
    that is bonded somewhere has none: a screw touches the wall of its hole beside the thread."""
    own = {n: i for n, i in scene.interface.items() if {split_face(side)[0] for side in i.sides} == set(pair)}
    if any(i.behaviour == "perfect" for i in own.values()):
        return
    first, second = (bodies[n].surface(ALL_OF_IT) for n in pair)
    area = _common(first, second, search)[0]
    for interface in own.values():
        one, other = (Surface(body.mesh.nodes, facets) for body, facets in (_side(bodies, s) for s in interface.sides))
        area -= _common(one, other, search)[0]
    if area > _LEAST * min(first.facet_area, second.facet_area):
        text = (
            f"{pair[0]} and {pair[1]} are within search on {area:.3g} {scene.unit_system['m2']} that no interface has"
        )
        why = f"a search leaves a pair that has interfaces in the scene ({', '.join(own)}) as it is"
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


def _sunk(first: tuple[Body, Surface], second: tuple[Body, Surface], search: float) -> float:
    """How deep a body lies in another, m, at the middles of facets (``_MOST_MIDDLES`` of each); 0 up to ``search``."""
    deepest = 0.0
    for (_, surface), (body, other) in ((first, second), (second, first)):
        low, high = _box(other)
        middles = np.concatenate([pieces.centres for pieces in surface.pieces])
        # points in the bounding box alone: the search for the cell of a point costs more
        middles = middles[((low < middles) & (middles < high)).all(axis=1)]
        for middle in middles[:: max(1, -(-len(middles) // _MOST_MIDDLES))]:
            if locate(body.mesh, middle) is not None:
                deepest = max(deepest, nearest_surface_point(other, middle)[0])
    return deepest if deepest > search else 0.0


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
    known: KeptOperators,
) -> InterfaceUnit | None:
    """The interface with its geometry; None, with its problems reported, where its faces do not fit. ``known`` : of the
    scene solved last, whose points and traces serve where the faces are the same."""
    sides = [_side(bodies, side) for side in interface.sides if side != GROUND]
    units = sides[0][0].units
    place = interface.sides, interface.points_from, interface.search, interface.ground, interface.behaves_open
    owners = [thing for body, _ in sides for thing in (body, conditions[body.name])]
    placed = known.again(
        f"interface {name}", (*place, *owners), lambda: _placed(name, interface, sides, conditions, problems)
    )
    if placed is None:
        return None
    pair, frames, cells = placed
    if not interface.against_ground:
        remarks += remarks_of("area", _area_remarks(name, interface, pair, units))
    gap = _gap(name, interface, pair, units, problems, remarks)
    if gap is not None and interface.form is not None:
        gap = _formed(name, interface.form, pair, gap, units["m"], problems)
    if gap is None:
        return None
    behaviour = _behaviour(interface)
    # a crown is smooth: where it touches first is no edge
    if behaviour.opens and interface.gap != "closed" and interface.form is None:
        remarks += remarks_of("edge", _edge_remarks(name, sides, pair, gap))
    pressure = interface.initial_pressure(float(pair.areas.sum()))
    if behaviour.elastic and pressure > 0 and interface.normal_stiffness:
        # [u] = -p / k_n: with this gap the layer has the pressure of the preload
        gap = gap - pressure / interface.normal_stiffness  # the preload has compressed the layer before the motion
    geometry = InterfaceGeometry(pair.points, pair.areas, frames, gap, pair.traces, pair.owner, pair.matching, cells)
    if pressure > 0 and gap.max() > 0:
        problems.add(
            f"interface.{name}.preload",
            "a preloaded interface cannot be open",
            f"gap up to {gap.max():g} {units['m']}",
            remedy="close the gap of the meshes, or leave the preload out",
        )
    return InterfaceUnit(name, interface.sides, behaviour, geometry, pressure)


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
    return pair, local_frames(pair.normals), cells_between(sides[pair.owner][1], weights)


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
    points, trace = own_points(body, facets, face)
    # gap 0: the ground lies behind each point
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
    # the six unknowns of a rigid body are those of no node
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
    # no node twice; apart along the face by less than the spacing allows
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
    # both outward normals point the same way
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
    # one point has no extent
    size = max(size, float(np.sqrt(pair.areas.sum())))
    distance, negligible = pair.distance, _TOUCHING * size
    chordal = np.abs(distance) <= 2 * pair.sags + negligible
    # all of it within the deviation of flat facets: touching faces
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
    # an overlap of chords, as of two meshes of one cylinder, is none
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


def _formed(name: str, form: FaceForm, pair: FacePair, gap: Array, length: str, problems: Problems) -> Array | None:
    """The gap (n_point,) with the form of the faces added; None where a table does not reach all points."""
    centre = pair.areas @ pair.points / pair.areas.sum() if form.centre is None else np.asarray(form.centre)
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
        return gap + np.where(rise <= _TOUCHING * rise.max(), 0.0, rise)
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
    # second singular value: how far they leave a line
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
