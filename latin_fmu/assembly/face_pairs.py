"""Pairs of faces: nodes that match, the common part of others (mortar), a face on a plane; points, normals, distances
and traces.

A node of the owner that is held (a plane of symmetry, a fixed edge) cannot move, but the other side's row of its point
mixes nodes on the held edge with inner ones: the point would hold those a second time. The tractions were not unique
and the iteration slow, so such a point takes no part in the held direction, as it would not with matching nodes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..fem.faces import Face, Surface, face_of, linear_between_corners, nodal_values, quadratic
from ..fem.mesh import Array, FacetBlock, FacetSet, Index, nearest
from ..fem.mortar import Mortar, mortar
from ..interface.geometry import diagonal_blocks
from .body import Body, own_points, selection

MATCHING = 1e-3
"""Lateral distance of paired nodes over the spacing of nodes."""
COVERED = 0.999
"""A face counts as wholly covered where this share of the area of its facets, as far as they meet the other face at
all, is covered."""
Owner = Literal["automatic", "E", "Ep"]
Side = tuple[Body, FacetSet]
Mask = NDArray[np.bool_]
_ON_EDGE = 1e-6  # distance from an edge over the size of the face
_SAME_AREA = 1e-6
_FLAT = 1e-6
_EQUAL = 1e-6  # sides whose sizes differ by less are alike: round-off must not choose between them
_NULL = 1e-9  # an eigenvalue below this share of their sum is none


@dataclass(frozen=True)
class FacePair:
    """Two faces that meet, at the points of one of them.

    Attributes
    ----------
    points : (n_point, 3) on the owner, m. areas : (n_point,), m2. normals : (n_point, 3), from E to E'.
    distance : (n_point,) from E to E' along the normal, m.
    traces, owner, matching : see ``InterfaceGeometry``.
    sags : (n_point,) how far the facets there are from the smooth surfaces they stand for, both sides, m.
    shares : covered share of the area of each side.
    chord : how far flat facets of round faces are from those at most, m; 0 where round faces have curved facets.
    alike : whether the owner is E because the sides differ in nothing else. passed_over : number of points of the
    other side, where it would give them but for directions in which these cannot move; 0 elsewhere.
    linear : see ``InterfaceGeometry``.
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
    chord: float = 0.0
    alike: bool = False
    linear: sp.csr_array | None = None
    passed_over: int = 0


def by_mortar(
    sides: tuple[Side, Side],
    owner: Owner,
    reach: float | None,
    fixed: tuple[Array | None, Array | None],
    corners: bool = False,
) -> FacePair | None:
    """Faces with nodes of their own, over the part that they have in common; None where there is none.

    Parameters
    ----------
    owner : the side that gives the points; "automatic": the one that is wholly covered, else the one with the smaller
        facets (``_preferred``); but not a rigid one, nor one whose points hold the other side where that is free (both
        would be more than the other side can follow).
    reach, corners : see ``fem.mortar``. fixed : projectors (n_node, 3, 3) of both bodies on the directions in which
        their nodes never move, None for rigid ones.
    """
    pair = _MortarPair(sides, reach, fixed, corners)
    if owner != "automatic":
        return pair.from_side(0 if owner == "E" else 1)
    rigid = [body.rigid for body, _ in sides]
    if rigid[0] != rigid[1]:
        return pair.from_side(int(rigid[0]))
    preferred = _preferred(sides, pair.surfaces)
    finer = preferred or 0
    if pair.mortar(finer) is None or pair.mortar(1 - finer) is None:
        return None
    covered = [s for s in (finer, 1 - finer) if pair.covered(s)]
    if covered:
        side = covered[0]
    else:
        side = finer
    alone = [pair.held_alone(s) for s in (0, 1)]
    if alone[side] > alone[1 - side]:
        contact, lost = pair.from_side(1 - side), pair.mortar(side)
        if contact is None or lost is None:
            return contact
        return replace(contact, passed_over=len(lost.areas))
    contact = pair.from_side(side)
    tied = preferred is None and len(covered) != 1 and alone[0] == alone[1]
    if contact is None:
        return contact
    return replace(contact, alike=tied)


def _preferred(sides: tuple[Side, Side], surfaces: tuple[Surface, ...]) -> int | None:
    """The side with the smaller facets on average, of equal ones that of the softer body, of equally stiff ones that of
    the smaller body; None where all are alike. No name, order, or direction of the axes counts, and no round-off."""
    for values in (
        [s.area / sum(len(b.facets) for b in s.facets.blocks) for s in surfaces],
        [max(body.shape.elasticity.young_moduli) for body, _ in sides],
        [float(body.shape.elements.volume.sum()) for body, _ in sides],
    ):
        if abs(values[0] - values[1]) > _EQUAL * max(values):
            return int(values[1] < values[0])
    return None


class _MortarPair:
    """Two faces; the integrals with either of them as the owner are computed once."""

    def __init__(
        self, sides: tuple[Side, Side], reach: float | None, fixed: tuple[Array | None, Array | None], corners: bool
    ) -> None:
        self.surfaces = tuple(Surface(body.mesh.nodes, facets) for body, facets in sides)
        self._reach, self._fixed, self._corners = reach, fixed, corners
        self._mortars: dict[int, Mortar | None] = {}

    def mortar(self, side: int) -> Mortar | None:
        """Integrals with this side as the owner."""
        if side not in self._mortars:
            self._mortars[side] = mortar(
                self.surfaces[side], self.surfaces[1 - side], self._reach, corners=self._corners
            )
        return self._mortars[side]

    def covered(self, side: int) -> bool:
        """Whether the facets of this side are wholly covered, as far as they meet the other one at all."""
        part = self.mortar(side)
        return part is not None and part.covered >= COVERED

    def held_alone(self, side: int) -> int:
        """Number of directions in which points of this side cannot move while the other side can."""
        still, both = self._directions(side)
        return round(float(np.einsum("pii->", still) - np.einsum("pii->", both)))

    def _directions(self, side: int) -> tuple[Array, Array]:
        """Projectors of ``_held_directions``."""
        part = self.mortar(side)
        fixed = self._fixed[side]
        other = self._fixed[1 - side]
        assert part is not None
        if fixed is None or other is None:
            none = np.zeros((len(part.areas), 3, 3))
            return none, none
        points = part.owner @ self.surfaces[side].nodes
        return _held_directions(points, part.normals, part.owner, fixed, self.surfaces[1 - side], other)

    def from_side(self, side: int) -> FacePair | None:
        """Points of this side."""
        part = self.mortar(side)
        if part is None:
            return None
        mine, theirs = self.surfaces[side].nodes, self.surfaces[1 - side].nodes
        points = part.owner @ mine
        if side == 0:
            normals = part.normals
        else:
            normals = -part.normals
        jump = (part.other @ theirs - points) * (1 if side == 0 else -1)  # from E to E', as N
        _, removed = self._directions(side)
        traces = [_without(_of_vectors(t), removed) for t in (part.owner, part.other)]
        shares = tuple(float(part.areas.sum()) / s.area for s in self.surfaces)
        curved = any(quadratic(p.kind) for s in self.surfaces for p in s.pieces)
        if curved:
            distance = part.distance
        else:
            distance = np.einsum("pi,pi->p", jump, normals)
        return FacePair(
            points,
            part.areas,
            normals,
            distance,
            (traces[side], traces[1 - side]),
            part.sags,
            side,
            False,
            (shares[0], shares[1]),
            max(s.chord_deviation for s in self.surfaces),
            linear=linear_between_corners(self.surfaces[side].facets, len(mine)) if self._corners else None,
        )


def _of_vectors(trace: sp.csr_array) -> sp.csr_array:
    """A trace of each component of a vector."""
    return sp.csr_array(sp.kron(trace, sp.eye_array(3), format="csr"))


class PointsOfFace(NamedTuple):
    """Points (n_point, 3) of a face alone, m, their vector areas (n_point, 3), m2, areas (n_point,), m2, and trace;
    ``linear`` as in ``InterfaceGeometry``."""

    points: Array
    vector_areas: Array
    areas: Array
    trace: sp.csr_array
    linear: sp.csr_array | None = None

    @property
    def normals(self) -> Array:
        """Unit normals (n_point, 3) outwards."""
        return np.asarray(self.vector_areas / np.linalg.norm(self.vector_areas, axis=1)[:, None])


def face_points(side: Side, corners: bool) -> PointsOfFace:
    """Points of a face alone: its nodes, or the corners of its facets with means that belong to linear pressures."""
    body, facets = side
    places = body.mesh.nodes
    if corners and any(quadratic(block.kind) for block in facets.blocks):
        # covered by itself: the integrals of a pair of faces
        part = mortar(Surface(places, facets), Surface(places, facets.turned), corners=True)
        assert part is not None
        linear = linear_between_corners(facets, len(places))
        return PointsOfFace(part.owner @ places, part.vector_areas, part.areas, _of_vectors(part.owner), linear)
    face = face_of(places, facets)
    points, trace = own_points(body, facets, face)
    if face.change is None:
        vector = face.vector_areas
    else:
        vector = face.change.T @ face.vector_areas
    return PointsOfFace(points, vector, face.positive_areas, trace)


def on_plane(side: Side, point: Array, normal: Array, corners: bool = False) -> FacePair | None:
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
    facing_points = face_points((body, FacetSet(tuple(blocks))), corners)
    return FacePair(
        facing_points.points,
        # area in projection on the plane, as the ground has its normal everywhere
        -facing_points.vector_areas @ normal,
        # from E to E': the plane has its normal out of the ground
        np.tile(-normal, (len(facing_points.points), 1)),
        (facing_points.points - point) @ normal,
        (facing_points.trace, None),
        np.zeros(len(facing_points.points)),
        matching=False,
        linear=facing_points.linear,
    )


def _held_directions(
    points: Array, normals: Array, weights: sp.csr_array, fixed: Array, other: Surface, other_fixed: Array
) -> tuple[Array, Array]:
    """Directions in which points of the owner cannot move.

    Parameters
    ----------
    points, normals : (n_point, 3). weights : (n_point, n_node) of the owner's nodes. fixed, other_fixed : projectors
        (n_node, 3, 3) of both bodies on the directions in which their nodes never move.

    Returns
    -------
    Projectors (n_point, 3, 3) on them, and on those of them at places where the other side is held likewise: at the
    rest the point holds the other side alone.
    """
    free = np.asarray(abs(weights) @ (np.eye(3) - fixed).reshape(-1, 9)).reshape(-1, 3, 3)
    # no node of the point can move there
    still = _null_projectors(free)
    both = np.zeros_like(still)
    rows = np.flatnonzero(still.any(axis=(1, 2)))
    if len(rows):
        edges = _edges(other.facets, np.asarray(other_fixed.any(axis=(1, 2))))
    else:
        edges = np.zeros((0, 2), dtype=np.int64)
    if not len(edges):
        return still, both
    on = _on_edges(points[rows], normals[rows], other.nodes[edges])
    free_edges = np.eye(3) - other_fixed[edges]
    for row, which in zip(rows, on, strict=True):
        # what both ends of an edge and the point are held along, over the edges that the point lies on
        common = _null_projectors(free_edges[which].sum(axis=1) + (np.eye(3) - still[row]))
        both[row] = 0.0
        if which.any():
            both[row] = np.eye(3) - _null_projectors(common.sum(axis=0)[None])[0]
    return still, both


def _null_projectors(matrices: Array) -> Array:
    """Projectors (n, 3, 3) on the null spaces of symmetric matrices (n, 3, 3) without negative eigenvalues; exact where
    these are diagonal, as those of conditions along axes are."""
    scale = np.maximum(np.einsum("pii->p", matrices), 1e-300)[:, None]
    diagonal = np.einsum("pii->pi", matrices)
    projectors: Array = (diagonal <= _NULL * scale)[:, :, None] * np.eye(3)
    mixed = np.flatnonzero((matrices - diagonal[:, :, None] * np.eye(3)).any(axis=(1, 2)))
    if len(mixed):
        values, vectors = np.linalg.eigh(matrices[mixed])
        null = vectors * (values <= _NULL * scale[mixed])[:, None, :]
        projectors[mixed] = np.einsum("pij,pkj->pik", null, null)
    return projectors


def _without(trace: sp.csr_array, removed: Array) -> sp.csr_array:
    """The trace without its parts along the directions of projectors (n_point, 3, 3)."""
    some = np.flatnonzero(removed.any(axis=(1, 2)))
    if not len(some):
        return trace
    complement = np.eye(3) - removed
    trimmed = sp.csr_array(diagonal_blocks(complement) @ trace)
    # round-off of inclined directions; rows of none would still name the nodes
    trimmed.data[np.abs(trimmed.data) < _NULL * np.abs(trace.data).max(initial=0.0)] = 0.0
    trimmed.eliminate_zeros()
    return trimmed


def _edges(facets: FacetSet, fixed: Mask) -> Index:
    """Nodes at the ends (n, 2) of edges whose ends are both ``fixed`` (n_node,)."""
    fixed_edges = [np.zeros((0, 2), dtype=np.int64)]
    for block in facets.blocks:
        ends = np.stack([block.corners, np.roll(block.corners, -1, axis=1)], axis=2).reshape(-1, 2)
        fixed_edges.append(ends[fixed[ends].all(axis=1)])
    return np.unique(np.sort(np.concatenate(fixed_edges), axis=1), axis=0)


def _on_edges(points: Array, normals: Array, ends: Array) -> Mask:
    """Whether each of ``points`` (n, 3) lies on each of the edges ``ends`` (m, 2, 3), in projection along its normal;
    (n, m)."""
    on = np.zeros((len(points), len(ends)), dtype=bool)
    size = float(np.linalg.norm(np.ptp(np.concatenate([points, ends.reshape(-1, 3)]), axis=0)))
    for i, (point, normal) in enumerate(zip(points, normals, strict=True)):
        start, along = ends[:, 0] - point, ends[:, 1] - ends[:, 0]
        # as seen along the normal
        start = start - np.outer(start @ normal, normal)
        along = along - np.outer(along @ normal, normal)
        length = np.maximum(np.einsum("ei,ei->e", along, along), 1e-300)
        at = np.clip(-np.einsum("ei,ei->e", start, along) / length, 0.0, 1.0)
        on[i] = np.linalg.norm(start + at[:, None] * along, axis=1) < _ON_EDGE * size
    return on


def node_by_node(first: Side, second: Side) -> FacePair | None:
    """Faces whose nodes stand opposite each other, one to one; None where they do not."""
    (body, facets), (other_body, other_facets) = first, second
    face, other = face_of(body.mesh.nodes, facets), face_of(other_body.mesh.nodes, other_facets)
    partner = _partners(face, other, body.mesh.nodes[face.nodes], other_body.mesh.nodes[other.nodes])
    if partner is None:
        return None
    points, trace = own_points(body, facets, face)
    nodes, opposite_nodes = body.mesh.nodes[face.nodes], other_body.mesh.nodes[other.nodes[partner]]
    normals = face.normals
    distance = np.einsum("pi,pi->p", opposite_nodes - nodes, normals)
    areas, opposite = face.positive_areas, other.positive_areas[partner]
    straight = face.change is None and other.change is None
    unlike = np.abs(opposite - areas).max() > _SAME_AREA * areas.max()
    # the nodes of both match, their facets do not: nothing but the order of the sides would tell whose areas count
    if unlike and not (straight and _same_facets(facets, other_facets, face, other, partner)):
        return None
    if straight:
        other_trace = selection(other.nodes[partner], other_body)
    else:
        _, other_trace = own_points(other_body, other_facets, other)
        other_trace = sp.csr_array(other_trace[(3 * partner[:, None] + np.arange(3)).ravel()])
        # points in the middle of edges are no nodes: their values from those of the nodes
        if face.change is not None:
            distance = nodal_values(facets, face.nodes) @ distance
    return FacePair(points, areas, normals, distance, (trace, other_trace), np.zeros(len(distance)))


def _same_facets(facets: FacetSet, others: FacetSet, face: Face, other: Face, partner: Index) -> bool:
    """Whether the facets of both faces have the same corners; ``partner`` : rows of the nodes opposite those of the
    face."""
    opposite = dict(zip(face.nodes.tolist(), other.nodes[partner].tolist(), strict=True))
    carried = {frozenset(opposite.get(n, -1) for n in row) for b in facets.blocks for row in b.facets.tolist()}
    return carried == {frozenset(row) for b in others.blocks for row in b.facets.tolist()}


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
    if opposed.all():
        return partner
    return None
