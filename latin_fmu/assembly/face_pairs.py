"""Faces that meet without matching nodes, by mortar or on a plane, and the search for them ([contact.NAME]).

A node of the owner that is held (a plane of symmetry, a fixed edge) cannot move, but the other side's row of its point
mixes nodes on the held edge with inner ones: the point would hold those a second time. The tractions were not unique
and the iteration slow, so such a point takes no part in the held direction, as it would not with matching nodes.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import Problems, SceneError
from ..fem.common_part import common_cells
from ..fem.faces import face_of
from ..fem.location import locate, nearest_surface_point
from ..fem.mesh import Array, FacetBlock, FacetSet, Index, nearest
from ..fem.mortar import Mortar, mortar
from ..fem.surface import Surface
from ..remarks import Remark
from ..scene.fields import ALL_OF_IT, GROUND, split_face
from ..scene.interfaces import Interface
from ..scene.schema import Scene
from .body import Body, build_bodies, own_points

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
        jump = (part.other @ theirs - points) * (1 if side == 0 else -1)
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
        np.logical_and.at(facing, pieces.facet, pieces.normals @ normal < -0.5)
        blocks.append(FacetBlock(block.kind, block.facets[facing]))
    blocks = [b for b in blocks if len(b.facets)]
    if not blocks:
        return None
    facing_set = FacetSet(tuple(blocks))
    face = face_of(body.mesh.nodes, facing_set)
    points, trace = own_points(body, facing_set, face)
    vector = face.vector_areas if face.change is None else face.change.T @ face.vector_areas
    normals = np.tile(-normal, (len(points), 1))
    return FacePair(
        points,
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
    that touch at an edge or a point only to ``remarks``."""
    if not scene.contact:
        return scene
    edges: list[str] = []
    by_hand = {frozenset(split_face(side)[0] for side in i.sides) for i in scene.interface.values()}
    surfaces = {name: body.surface(ALL_OF_IT) for name, body in bodies.items()}
    interfaces: dict[str, Interface] = {}
    taken = set(by_hand)
    for name, table in scene.contact.items():
        names = [n for n in bodies if table.parts is None or n in table.parts]
        for first, second in _near_pairs(names, surfaces, table.search):
            pair = frozenset((first, second))
            if pair in taken or pair in table.exceptions:
                continue
            one, other = surfaces[first], surfaces[second]
            area, depth = _common(one, other, table.search)
            if area <= _LEAST * min(one.facet_area, other.facet_area) and depth == 0.0:
                depth = _sunk((bodies[first], one), (bodies[second], other), table.search)
            if area > _LEAST * min(one.facet_area, other.facet_area):
                taken.add(pair)
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
            elif remarks is not None and _meet((bodies[first], one), (bodies[second], other), table.search):
                edges.append(f"{first} and {second}")
    if remarks is not None and edges:
        more = f", {len(edges) - _NAMED} more pairs" if len(edges) > _NAMED else ""
        text = "within search at an edge or a point only: no interface is made, so that they can move into each other"
        remedy = "give them faces that are opposite each other, or except them"
        remarks.append(Remark("edge", f"{', '.join(edges[:_NAMED])}{more} meet {text}; {remedy}"))
    return scene.model_copy(update={"interface": {**scene.interface, **interfaces}, "contact": {}})


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
        middles = middles[((low < middles) & (middles < high)).all(axis=1)]
        for middle in middles[:: max(1, -(-len(middles) // _MOST_MIDDLES))]:
            if locate(body.mesh, middle) is not None:
                deepest = max(deepest, nearest_surface_point(body.mesh, middle)[0])
    return deepest if deepest > search else 0.0


def _meet(first: tuple[Body, Surface], second: tuple[Body, Surface], search: float) -> bool:
    """Whether nodes of one surface (``_MOST_MIDDLES`` of each) are within ``search`` of the other."""
    for (_, surface), (body, other) in ((first, second), (second, first)):
        low, high = _box(other)
        nodes = surface.nodes[surface.facets.nodes]
        nodes = nodes[((low - search <= nodes) & (nodes <= high + search)).all(axis=1)]
        for node in nodes[:: max(1, -(-len(nodes) // _MOST_MIDDLES))]:
            if nearest_surface_point(body.mesh, node)[0] <= search:
                return True
    return False


def _free_name(stem: str, taken: set[str]) -> str:
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
