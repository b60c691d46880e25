"""Contact of faces whose nodes do not match: integrals over the common part of two faces, dual basis of one of them.

The common part is made of pairs of opposite flat pieces, cut to triangles in the plane of the owner's piece:
intersections of convex polygons after Sutherland and Hodgman, Comm. ACM 17 (1974), many pairs at a time.

The face that gives the points is the owner. Over the part of it that the other face covers (clipped facet by facet in
the plane of the owner's facet, and by the plane where a face ends inside its facets), with its functions phi_p
(``facets``: those with positive areas) and their dual psi_p,

    psi_p in span(phi) of each facet:  int psi_p phi_q = delta_pq int phi_p = delta_pq a_p,    A = diag(a),
    T_owner = A^-1 int psi phi^T = 1,      T_other = A^-1 int psi phi_other^T

(Wohlmuth, SIAM J. Numer. Anal. 38 (2000) 989-1012; Popp, Gitterle, Gee, Wall, Int. J. Numer. Meth. Eng. 83 (2010)
1428-1465). Sum psi = 1 and Sum phi = 1 give T 1 = 1 and T^T a = int phi on both sides: a uniform pressure passes
exactly and forces balance. The psi of a sliver oscillate: owner facets that are hardly covered carry constants
instead, and points with little area are merged into their neighbours.

On facets of second order the phi_p may be those of the corners alone, linear between them: a quarter of the points,
and T_owner are no values at nodes but means with psi, int psi phi_owner^T. The order of convergence stays, as the
pressure of a contact is no smoother than that (Wohlmuth, Popp, Gee, Wall, Computational Mechanics 49 (2012) 735-747).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain

import numpy as np
import scipy.sparse as sp

from .faces import (
    DEGREE,
    Pieces,
    Surface,
    changes_basis,
    corner_functions,
    facet_change,
    nodal_values,
    shape,
    triangle_quadrature,
    unit_normals,
)
from .mesh import Array, HalfSpace, Index, Mask

_OPPOSED = 0.5  # cosine between one normal and the other turned round, from which on pieces count as opposite
_FACING = 0.25  # the least cosine that a distance is divided by: curved facets are steeper than their pieces
_LEVEL = 1e-20  # squared sine of the angle to a plane below which a piece is parallel to it
_SPECK = 1e-10  # a common part below this share of the owner's piece is left out
_DOUBLE = 1.001  # covered more than once: only the nearest layer counts


@dataclass(frozen=True)
class Cells:
    """Triangles of the common part of pieces of the owner and of another face.

    Attributes
    ----------
    owner, other : (n_cell,) numbers of the pieces. corners : (n_cell, 3, 2) in the plane of the owner's piece, m.
    owner_corners, other_corners : (n_cell, 3 | 4, 2) of the pieces in the same plane, m.
    distance : (n_cell,) of the other piece along the owner's normal, m.
    """

    owner: Index
    other: Index
    corners: Array
    owner_corners: Array
    other_corners: Array
    distance: Array

    @property
    def areas(self) -> Array:
        """Areas of the triangles, (n_cell,), m2."""
        return areas(self.corners)

    def __len__(self) -> int:
        return len(self.owner)

    def picked(self, which: Index | Mask) -> Cells:
        """Some of the cells."""
        return Cells(*(getattr(self, name)[which] for name in self.__dataclass_fields__))


def common_cells(owner: Surface, other: Surface, reach: float | None) -> list[list[Cells]]:
    """Cells for every pair of blocks of the two faces; ``reach`` : largest distance along the owner's normal, m."""
    rows, ends = [], tuple(s.facets.within for s in (owner, other) if s.facets.within is not None)
    for mine in owner.pieces:
        row = [_cells(mine, theirs, owner.is_plane, reach, ends) for theirs in other.pieces]
        rows.append(_nearest_layer(mine, row))
    return rows


def _cells(mine: Pieces, theirs: Pieces, plane: bool, reach: float | None, ends: tuple[HalfSpace, ...]) -> Cells:
    one, two = _candidates(mine, theirs, plane, reach)
    normal = mine.normals[one]
    arm = theirs.centres[two] - mine.centres[one]
    along = np.einsum("pi,pi->p", arm, normal)
    aside = np.linalg.norm(arm - along[:, None] * normal, axis=1)
    # outward normals of faces in contact point against each other
    near = np.einsum("pi,pi->p", normal, theirs.normals[two]) < -_OPPOSED
    near &= aside < mine.radii[one] + theirs.radii[two]  # circles around the pieces; the clipping decides
    if reach is not None:  # its corners may be nearer than its centre
        near &= np.abs(along) < reach + theirs.radii[two]
    one = one[near]
    two = two[near]
    normal = normal[near]
    first, second = _plane_axes(mine, one)
    axes = np.stack([first, second], axis=2)
    origin = mine.centres[one][:, None]
    mine_there = (mine.corners[one] - origin) @ axes
    theirs_there = (theirs.corners[two] - origin) @ axes
    # counter-clockwise on the other face is clockwise seen from the owner
    polygon, count = clip(theirs_there[:, ::-1], mine_there)
    for end in ends:
        polygon, count = _ended(polygon, count, end, origin[:, 0], axes)
    common = np.where(count > 2, areas(polygon), 0.0)
    pairs = np.flatnonzero(common > _SPECK * mine.areas[one])
    corners, cell = triangles(polygon[pairs], count[pairs])
    cell = pairs[cell]
    slope = theirs.normals[two]
    # height of the other piece's plane over the middle of each triangle
    middle = np.einsum("cij,cj->ci", axes[cell], corners.mean(axis=1))
    offset = theirs.centres[two[cell]] - mine.centres[one[cell]] - middle
    facing = np.einsum("ci,ci->c", slope[cell], normal[cell])
    distance = np.einsum("ci,ci->c", offset, slope[cell]) / facing  # no division by zero: ``_OPPOSED``
    cells = Cells(one[cell], two[cell], corners, mine_there[cell], theirs_there[cell], distance)
    if reach is None:
        return cells
    return cells.picked(np.abs(distance) <= reach)


def _plane_axes(pieces: Pieces, rows: Index) -> tuple[Array, Array]:
    first = pieces.corners[rows, 1] - pieces.corners[rows, 0]
    normal = pieces.normals[rows]
    first = first - np.einsum("pi,pi->p", first, normal)[:, None] * normal
    first /= np.linalg.norm(first, axis=1)[:, None]
    return first, np.cross(normal, first)


def _candidates(mine: Pieces, theirs: Pieces, plane: bool, reach: float | None) -> tuple[Index, Index]:
    """Pairs of pieces near enough to each other, by trees of the other face's centres by size."""
    from scipy.spatial import cKDTree  # a tenth of a second to load, and faces that match do without

    here, there = mine.centres, theirs.centres
    ahead: Array | float
    if plane and reach is None:  # however far away
        n = mine.normals[0]
        # places across the normal: pieces may be opposite at any distance
        here, there = here - np.outer(here @ n, n), there - np.outer(there @ n, n)
        ahead = 0.0
    elif reach is None:
        nearest, _ = cKDTree(there).query(here)
        ahead = 2 * np.asarray(nearest)  # at 60 degrees the way along the normal is twice the distance
    else:
        ahead = reach
    # of a whole surface few pieces are anywhere near the other face
    near = _within_box(here, there, mine.radii + ahead + theirs.radii.max())
    if not len(near):
        return near, near
    ahead = np.broadcast_to(ahead, mine.radii.shape)[near]
    far = _within_box(there, here[near], theirs.radii + float((mine.radii[near] + ahead).max()))
    size = np.floor(np.log2(np.maximum(theirs.radii[far], 1e-300))).astype(int)
    ones, twos = [near[:0]], [near[:0]]
    for level in np.unique(size):
        members = far[size == level]
        # radii of a level are below 2^(level + 1): a few large pieces do not widen the search for the small ones
        radius = (mine.radii[near] + 2.0 ** (level + 1) + ahead) * (1 + 1e-9)
        # sorted: sums over the cells are the same to the last bit in every run
        lists = cKDTree(there[members]).query_ball_point(here[near], radius, return_sorted=True)
        counts = np.fromiter(map(len, lists), np.int64, len(lists))
        ones.append(np.repeat(near, counts))
        twos.append(members[np.fromiter(chain.from_iterable(lists), np.int64, int(counts.sum()))])
    return np.concatenate(ones), np.concatenate(twos)


def _within_box(points: Array, others: Array, margin: Array) -> Index:
    """Numbers of the points (n, 3) within their margins (n,), m, of the box around the others (m, 3)."""
    low, high = others.min(axis=0), others.max(axis=0)
    inside = (points >= low - margin[:, None]) & (points <= high + margin[:, None])
    return np.flatnonzero(inside.all(axis=1))


def _nearest_layer(mine: Pieces, row: list[Cells]) -> list[Cells]:
    """The cells without those of a farther layer of the other face, where an owner's piece is covered twice."""
    covered, least = np.zeros(mine.n_piece), np.full(mine.n_piece, np.inf)
    for cells in row:
        np.add.at(covered, cells.owner, cells.areas)
        np.minimum.at(least, cells.owner, np.abs(cells.distance))
    twice = covered > _DOUBLE * mine.areas
    if not twice.any():
        return row
    # infinite where a piece is covered once: its cells stay, whatever their distance
    limit = np.where(twice, least + 2 * mine.radii, np.inf)  # the distances of one layer differ by its inclination
    return [cells.picked(np.abs(cells.distance) <= limit[cells.owner]) for cells in row]


def clip(subject: Array, window: Array) -> tuple[Array, Index]:
    """Intersections of convex polygons, pair by pair.

    Parameters
    ----------
    subject : (n, p, 2) and window : (n, q, 2), corners counter-clockwise.

    Returns
    -------
    Corners (n, p + q, 2), counter-clockwise, the last one repeated to fill the rows, and their number (n,), 0 where
    the two do not meet.
    """
    n, _, _ = subject.shape
    corners, count = subject, np.full(n, subject.shape[1])
    for edge in range(window.shape[1]):
        start = window[:, edge]
        along = window[:, (edge + 1) % window.shape[1]] - start
        corners, count = _cut(corners, count, start, along)
    return corners, count


def _cut(corners: Array, count: Index, start: Array, along: Array) -> tuple[Array, Index]:
    """Part of each polygon to the left of a line through ``start`` along ``along`` (n, 2)."""
    n, width, _ = corners.shape
    slot = np.arange(width)
    used = slot < count[:, None]
    # behind the last corner comes the first
    following = np.take_along_axis(corners, np.where(slot + 1 < count[:, None], slot + 1, 0)[..., None], axis=1)
    height = _height(corners, start, along)
    next_height = _height(following, start, along)
    keeps = used & (height >= 0)  # a corner on the line stays; what has no area is left out later
    crosses = used & ((height >= 0) != (next_height >= 0))
    # left and left - left_next have the same sign where the edge crosses
    fraction = np.divide(height, height - next_height, out=np.zeros_like(height), where=crosses)
    cut = corners + fraction[..., None] * (following - corners)
    both = np.stack([corners, cut], axis=2).reshape(n, 2 * width, 2)
    taken = np.stack([keeps, crosses], axis=2).reshape(n, 2 * width)
    total = taken.sum(axis=1)
    # a line cuts a convex polygon twice: one corner more at most
    # taken corners come first, and keep their turn
    order = np.argsort(~taken, axis=1, kind="stable")[:, : width + 1]
    order = np.take_along_axis(order, np.minimum(np.arange(width + 1), np.maximum(total - 1, 0)[:, None]), axis=1)
    return np.take_along_axis(both, order[..., None], axis=1), np.minimum(total, width + 1)


def _ended(corners: Array, count: Index, end: HalfSpace, origin: Array, axes: Array) -> tuple[Array, Index]:
    """Part of each polygon (n, p, 2) in a half space; origins (n, 3) and axes (n, 3, 2) of the planes they are in."""
    slope = np.einsum("nik,i->nk", axes, end.normal)
    steepness = np.einsum("nk,nk->n", slope, slope)
    rise = end.height - origin @ end.normal
    # a polygon parallel to the plane, whose slope is round-off, has no line on it: it stays whole or goes
    level = steepness <= _LEVEL
    start = slope * (rise / np.where(level, 1.0, steepness))[:, None]
    along = np.stack([-slope[:, 1], slope[:, 0]], axis=1)
    cut, number = _cut(corners, np.where(level & (rise < 0.0), 0, count), start, np.where(level[:, None], 0.0, along))
    return cut, number


def _height(points: Array, start: Array, along: Array) -> Array:
    arm = points - start[:, None]
    return np.asarray(along[:, None, 0] * arm[..., 1] - along[:, None, 1] * arm[..., 0])


def areas(corners: Array) -> Array:
    """Signed areas (n,) of polygons (n, p, 2) with repeated last corners."""
    # from the first corner: repeated last ones add nothing
    arm = corners[:, 1:] - corners[:, :1]
    return np.asarray(0.5 * (arm[:, :-1, 0] * arm[:, 1:, 1] - arm[:, :-1, 1] * arm[:, 1:, 0]).sum(axis=1))


def triangles(corners: Array, count: Index) -> tuple[Array, Index]:
    """Fans of triangles (m, 3, 2) from the first corners, and the number of the polygon of each, (m,)."""
    width = corners.shape[1]
    first = np.repeat(corners[:, None, 0], width - 2, axis=1)
    fans = np.stack([first, corners[:, 1:-1], corners[:, 2:]], axis=2)
    used = np.arange(width - 2) < count[:, None] - 2
    return fans[used], np.nonzero(used)[0]


SLIVER = 0.5
"""Points with less than this share of their nodal area are merged into neighbours: nodes beyond the common part, whose
psi extrapolate. With 0.2 a soft block on the partly covered facets of a stiff plate took 44 iterations on average over
forty random places, with 0.5 it took 21."""
_CONDITION = 1e6  # of the integrals of a facet, beyond which constants take the place of its dual functions
_INSIDE = 0.95  # such a share of the area in those facets that are covered at all: at the edge of them, no sliver
_EQUAL = 1e-6  # shares, and relative distances, that differ by less are equal: round-off must not choose between them
_NOTHING = 1e-6  # a covered share, or a share of the median area of points, that counts as none
_AFFINE = 1e-9  # a quadrilateral this close to a parallelogram is one
_BILINEAR = 0.25 * np.array([(1, 1, 1, 1), (-1, 1, 1, -1), (-1, -1, 1, 1), (1, -1, 1, -1)])
"""Middle, slopes and twist of a quadrilateral from its corners."""
_NEWTON_STEPS, _NEWTON_CLOSE = 12, 1e-14  # most steps, and the last change of a coordinate between -1 and 1
_CURVED_DEGREE = 12  # of the quadrature where the functions are no polynomials in the plane


@dataclass(frozen=True)
class Mortar:
    """Points of an owner face where another face covers it.

    Attributes
    ----------
    areas : (n_point,), m2, > 0. vector_areas : (n_point, 3) int psi n, m2, n outwards from the owner.
    owner, other : (n_point, n_node) values at the points from those at the nodes of the owner's and the other's mesh.
    shares : (n_point,) covered share of the area that the point has on the whole owner face.
    distance : (n_point,) of the other face along the owner's normal, its mean with psi, on the curved geometry of both
        faces, m.
    sags : (n_point,) distance of the facets around a point from the smooth surfaces they stand for, both sides, m.
    covered : covered share of the area of those facets of the owner that are covered at all.
    """

    areas: Array
    vector_areas: Array
    owner: sp.csr_array
    other: sp.csr_array
    shares: Array
    distance: Array
    sags: Array
    covered: float

    @property
    def normals(self) -> Array:
        """Unit normals (n_point, 3), outwards from the owner."""
        return np.asarray(self.vector_areas / np.linalg.norm(self.vector_areas, axis=1)[:, None])


class _Points:
    """Sums over the facets of an owner face while its blocks are integrated; row p belongs to the p-th node of it."""

    def __init__(self, owner: Surface, other: Surface, corners: bool) -> None:
        self.owner, self.other, self.corners = owner, other, corners
        self.nodes = owner.facets.nodes
        n = len(self.nodes)
        self.areas, self.whole, self.near, self.sags, self.covered, self.opening = np.zeros((6, n))
        self.reached = 0.0  # area of the facets that are covered at all
        # opening: int psi times the distance, m3
        self.vector_areas = np.zeros((n, 3))
        self.entries: list[tuple[Index, Index, Array]] = []  # of A T_other: points, nodes, values
        # of A T_owner, in the values u~; in those of the nodes where the corners alone are points
        self.owner_entries: list[tuple[Index, Index, Array]] = []
        self.changed = changes_basis(owner.facets)

    def functions(self, kind: str) -> Array:
        """Those of the points of a facet of the owner, (n_node, n) of the shape functions; its first n nodes."""
        return corner_functions(kind) if self.corners else facet_change(kind, self.changed)


def mortar(
    owner: Surface, other: Surface, reach: float | None = None, least: float = SLIVER, corners: bool = False
) -> Mortar | None:
    """Integrals over the common part of two faces; None where they have none.

    Parameters
    ----------
    corners : whether the corners of facets alone are points, with pressures linear between them.
    reach : largest distance along the owner's normal at which the faces count as opposite, m; any where None.
    least : points with less than this share of their area are merged into neighbours.
    """
    points = _Points(owner, other, corners)
    cells = common_cells(owner, other, reach)
    if not any(len(c) for row in cells for c in row):
        return None
    for number, row in enumerate(cells):
        _add_block(points, number, row)
    return _finished(points, least)


def _add_block(points: _Points, number: int, row: list[Cells]) -> None:
    """Sums of the owner's block ``number`` from its cells with each block of the other face."""
    pieces = points.owner.pieces[number]
    change = points.functions(pieces.kind)
    n_facet, n = int(pieces.facet.max()) + 1, change.shape[1]
    nodes_at = np.searchsorted(points.nodes, points.owner.facets.blocks[number].facets)
    at = nodes_at[:, :n]
    gram, normal = np.zeros((n_facet, n, n)), np.zeros((n_facet, n, 3))
    traced = np.zeros((n_facet, n, len(change))) if points.corners else gram
    opening, covered = np.zeros((n_facet, n)), np.zeros(n_facet)
    products: list[tuple[Index, Index, Array]] = []
    for cells, theirs, their_sags in zip(row, points.other.pieces, points.other.sags, strict=True):
        # in parts, for the memory
        for some in np.array_split(np.arange(len(cells)), max(1, len(cells) // 20000)):
            part = cells.picked(some)
            weights, near, far = _gauss_points(part, pieces, theirs)
            mine, other = shape(pieces.kind, near), shape(theirs.kind, far)
            places = points.owner.nodes[pieces.nodes[part.owner]], points.other.nodes[theirs.nodes[part.other]]
            apart = _distances((pieces.kind, theirs.kind), places, (near, far), (mine, other))
            facet = pieces.facet[part.owner]
            # from phi to those of the points, whose integrals are positive
            nodal, mine = mine, mine @ change
            weighted = weights[..., None] * mine
            np.add.at(gram, facet, np.einsum("cga,cgb->cab", weighted, mine))
            if points.corners:
                np.add.at(traced, facet, np.einsum("cga,cgb->cab", weighted, nodal))
            np.add.at(normal, facet, weighted.sum(axis=1)[:, :, None] * pieces.normals[part.owner, None])
            np.add.at(opening, facet, np.einsum("cg,cga->ca", apart, weighted))
            np.add.at(covered, facet, weights.sum(axis=1))
            products.append((facet, theirs.nodes[part.other], np.einsum("cga,cgb->cab", weighted, other)))
            sag = points.owner.sags[number][part.owner] + their_sags[part.other]
            np.maximum.at(points.sags, at[facet], np.repeat(sag[:, None], n, axis=1))
    dual = _dual(gram, covered)
    np.add.at(points.areas, at, np.einsum("fab->fa", gram))  # the phi add up to one
    # dual @ normal: int psi n
    np.add.at(points.vector_areas, at, dual @ normal)
    np.add.at(points.opening, at, np.einsum("fab,fb->fa", dual, opening))
    area = np.bincount(pieces.facet, pieces.areas, minlength=n_facet)
    reached = covered > _NOTHING * area
    points.reached += float(area[reached].sum())
    whole = _whole(pieces, change, n_facet)
    np.add.at(points.whole, at, whole)
    np.add.at(points.near, at[reached], whole[reached])
    # in equal parts: read as a mark of touched points and in the sum over all alone
    np.add.at(points.covered, at, np.repeat(covered[:, None] / n, n, axis=1))
    # diag(int phi) where the dual functions are regular, so that T_owner = 1
    masses = dual @ traced
    columns = nodes_at[:, : masses.shape[2]]
    points.owner_entries.append(
        (np.repeat(at, masses.shape[2], axis=1), np.tile(columns, (1, n)), masses.reshape(n_facet, -1))
    )
    for facet, nodes, product in products:
        value = dual[facet] @ product
        width = nodes.shape[1]
        rows = np.repeat(at[facet], width, axis=1)
        points.entries.append((rows, np.tile(nodes, (1, n)), value.reshape(len(facet), n * width)))


def _dual(gram: Array, covered: Array) -> Array:
    """Coefficients C (n_facet, n, n) of psi = C phi, from int phi phi^T: C = diag(int phi) gram^-1; constants where a
    facet is hardly covered (its phi are alike there), so that psi_p is the share of int phi_p in the covered area."""
    n = gram.shape[1]
    mean = gram.sum(axis=2)
    dual = np.zeros_like(gram)
    touched = np.flatnonzero(covered > 0)
    root = np.sqrt(np.einsum("faa->fa", gram[touched]))
    # with a unit diagonal: of the place of the covered part, not of its size
    condition = np.linalg.cond(gram[touched] / (root[:, :, None] * root[:, None]))
    # NaN is no regular one
    regular, constant = touched[condition <= _CONDITION], touched[~(condition <= _CONDITION)]
    dual[regular] = mean[regular][:, :, None] * np.linalg.inv(gram[regular])
    dual[constant] = np.repeat((mean[constant] / covered[constant][:, None])[:, :, None], n, axis=2)
    return dual


def _whole(pieces: Pieces, change: Array, n_facet: int) -> Array:
    """int phi (n_facet, n) over whole facets."""
    points, weights = triangle_quadrature(DEGREE[pieces.kind] + 2)
    total = np.zeros((n_facet, change.shape[1]))
    corners = pieces.corners.shape[1]
    # a quadrilateral piece is two triangles
    for fan in ((0, 1, 2), (0, 2, 3))[: corners - 2]:
        p = pieces.corners[:, fan]
        # twice the area, as the weights add up to 1/2
        area = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
        barycentric = np.stack([1 - points.sum(axis=1), *points.T])
        at = np.einsum("kg,pki->pgi", barycentric, pieces.reference[:, fan])
        np.add.at(total, pieces.facet, area[:, None] * (weights @ shape(pieces.kind, at)) @ change)
    return total


def _gauss_points(cells: Cells, mine: Pieces, theirs: Pieces) -> tuple[Array, Array, Array]:
    """Weights (n_cell, n_gauss), coordinates in the owner's and in the other's facets (n_cell, n_gauss, 2)."""
    # of int phi phi^T and of int psi phi_other^T
    degree = DEGREE[mine.kind] + max(DEGREE[mine.kind], DEGREE[theirs.kind])
    if not (_affine(cells.owner_corners) and _affine(cells.other_corners)):
        degree = max(degree, _CURVED_DEGREE)
    # not polynomials in the plane, since the map from the facet is bilinear: the rule is not exact then
    points, weights = triangle_quadrature(degree)
    barycentric = np.stack([1 - points.sum(axis=1), *points.T])
    at = np.einsum("kg,cki->cgi", barycentric, cells.corners)
    scaled = 2 * cells.areas[:, None] * weights  # the weights of the rule add up to 1/2
    near = _reference(at, cells.owner_corners, mine.reference[cells.owner])
    far = _reference(at, cells.other_corners, theirs.reference[cells.other])
    return scaled, near, far


def _distances(
    kinds: tuple[str, str], places: tuple[Array, Array], at: tuple[Array, Array], values: tuple[Array, Array]
) -> Array:
    """Distance (n_cell, n_gauss) of the other facets from the owner's along the owner's normal, m.

    Each point of the owner, x with the normal n, has one on the other facet opposite, y with the normal m. Along n the
    plane through y across m is (y - x).m / n.m away, and the curved facet differs from it by the square of the distance
    of y from the line only.

    places : (n_cell, n_node, 3) nodes of both facets. at : (n_cell, n_gauss, 2) coordinates in them. values : shape
    functions there.
    """
    (n, m), (x, y) = (
        [unit_normals(kind, node, where) for kind, node, where in zip(kinds, places, at, strict=True)],
        [value @ node for value, node in zip(values, places, strict=True)],
    )
    facing = np.minimum(np.einsum("cgi,cgi->cg", n, m), -_FACING)
    return np.asarray(np.einsum("cgi,cgi->cg", y - x, m) / facing)


def _affine(corners: Array) -> bool:
    if corners.shape[1] == 3 or not len(corners):
        return True
    off = corners[:, 0] - corners[:, 1] + corners[:, 2] - corners[:, 3]
    return bool(np.abs(off).max() <= _AFFINE * np.abs(corners).max())


def _reference(at: Array, corners: Array, reference: Array) -> Array:
    """Coordinates in the facet (n_cell, n_gauss, 2) of places in the plane of a piece with these corners."""
    if corners.shape[1] == 3:
        edges = [corners[:, None, i] - corners[:, None, 0] for i in (1, 2)]
        share = _components(edges[0], edges[1], at - corners[:, None, 0])
        spans = np.stack([reference[:, 1] - reference[:, 0], reference[:, 2] - reference[:, 0]], axis=1)
        return np.asarray(reference[:, None, 0] + share @ spans)
    # the map of the quadrilateral is middle + x along + y across + x y twist
    middle, along, across, twist = np.einsum("sk,cki->sci", _BILINEAR, corners)[:, :, None]
    local = np.zeros_like(at)
    for _ in range(_NEWTON_STEPS):  # one step solves a parallelogram
        x, y = local[..., :1], local[..., 1:]
        step = _components(along + y * twist, across + x * twist, at - middle - x * along - y * across - x * y * twist)
        local = local + step
        if np.abs(step).max(initial=0.0) < _NEWTON_CLOSE:
            break
    return np.asarray(shape("quad", local) @ reference)


def _components(first: Array, second: Array, vectors: Array) -> Array:
    """Components (..., 2) of plane vectors along two others, (..., 2) each."""
    area = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    along = vectors[..., 0] * second[..., 1] - vectors[..., 1] * second[..., 0]
    across = first[..., 0] * vectors[..., 1] - first[..., 1] * vectors[..., 0]
    return np.stack([along / area, across / area], axis=-1)


def _finished(points: _Points, least: float) -> Mortar:
    """Traces of the points from the sums; points with less than ``least`` of their area are merged into others.

    A group has one pressure, its rows are the sum of those of its members (A T).
    """
    n, touched = len(points.nodes), np.flatnonzero(points.covered > 0)
    if points.corners:
        back = sp.csr_array(sp.eye_array(n))
    else:
        # rows of the owner act on u~, which belong to phi~
        back = nodal_values(points.owner.facets, points.nodes)
    owner = sp.csr_array(_collected(points.owner_entries, (n, n))[touched])
    other = sp.csr_array(_collected(points.entries, (n, len(points.other.nodes)))[touched])
    places = np.asarray(back @ points.owner.nodes[points.nodes])[touched]
    shares = points.areas[touched] / points.whole[touched]
    # near the edge of the owner face a point has less area than the whole: its covered facets count
    shares[points.areas[touched] > _INSIDE * points.near[touched]] = 1.0
    joined = _groups(shares, sp.csr_array(owner[:, touched]), places, least)
    areas = np.asarray(joined @ points.areas[touched])
    # points whose group has next to no area are dropped
    joined = sp.csr_array(joined[areas > _NOTHING * np.median(areas)])
    areas = np.asarray(joined @ points.areas[touched])
    mean = sp.csr_array(sp.diags_array(1 / areas) @ joined)
    select = sp.csr_array((np.ones(n), (np.arange(n), points.nodes)), shape=(n, len(points.owner.nodes)))
    # a group stands as far off as the worst of its points
    sags = np.asarray(((joined > 0) @ sp.diags_array(points.sags[touched])).max(axis=1).toarray()).ravel()
    return Mortar(
        areas,
        np.asarray(joined @ points.vector_areas[touched]),
        # values u~ of the face from u of its nodes, then from those of the mesh
        sp.csr_array(_cleaned(sp.csr_array(mean @ owner)) @ back @ select),
        _cleaned(sp.csr_array(mean @ other)),
        areas / np.asarray(joined @ points.whole[touched]),
        np.asarray(joined @ points.opening[touched]) / areas,
        sags,
        points.covered.sum() / points.reached,
    )


def _groups(shares: Array, near: sp.csr_array, places: Array, least: float) -> sp.csr_array:
    """Part (n_group, n_point) of each point in each group, from the covered shares of their areas.

    From the largest share to the smallest, the nearest neighbour with area enough takes a sliver, else the groups of
    the nearest one with a larger share; where there is none (the other face is smaller than a facet of the owner)
    slivers of one share that are neighbours stand together for theirs. Neighbours that are equally near take equal
    parts, and equal shares are served together: the order of the nodes does not count. ``near`` (n_point, n_point) has
    entries where two points share a covered facet.
    """
    parts: dict[int, dict[int, float]] = {int(p): {int(p): 1.0} for p in np.flatnonzero(shares >= least)}
    small = np.flatnonzero(shares < least)
    small = small[np.argsort(-shares[small], kind="stable")]
    # shares that differ by round-off are one
    for level in np.split(small, np.flatnonzero(np.diff(-shares[small]) > _EQUAL) + 1):
        served: dict[int, dict[int, float]] = {}
        for p in level.tolist():
            served[p] = _takers(p, near.indices[near.indptr[p] : near.indptr[p + 1]].tolist(), places, parts)
        alone = [p for p in served if not served[p]]
        for p in alone:
            # the first of those that hang together
            served[p] = {_first(p, alone, near): 1.0}
        parts |= served
    points = sorted(parts)
    entries = [(group, p, part) for p in points for group, part in parts[p].items()]
    groups, rows = np.unique([group for group, _, _ in entries], return_inverse=True)
    columns, values = np.array([p for _, p, _ in entries]), np.array([part for _, _, part in entries])
    return sp.csr_array((values, (rows, columns)), shape=(len(groups), len(shares)))


def _takers(p: int, others: list[int], places: Array, parts: dict[int, dict[int, float]]) -> dict[int, float]:
    """Parts of a sliver in the groups of its nearest neighbours that have one; none where it has no such neighbour."""
    placed = [q for q in others if q in parts]
    # neighbours that are points of their own, before slivers that were merged already
    choice = np.array([q for q in placed if parts[q].get(q) == 1.0] or placed, dtype=np.int64)
    if not len(choice):
        return {}
    distance = np.linalg.norm(places[choice] - places[p], axis=1)
    takers = choice[distance <= distance.min() * (1.0 + _EQUAL)].tolist()
    shares: dict[int, float] = {}
    for q in takers:
        for group, part in parts[q].items():
            shares[group] = shares.get(group, 0.0) + part / len(takers)
    return shares


def _first(p: int, alone: list[int], near: sp.csr_array) -> int:
    """The first of the points ``alone`` that hang together with p as neighbours."""
    group, look = {p}, [p]
    while look:
        q = look.pop()
        more = set(near.indices[near.indptr[q] : near.indptr[q + 1]].tolist()) & set(alone) - group
        group |= more
        look += sorted(more)
    return min(group)


def _collected(entries: list[tuple[Index, Index, Array]], shape_: tuple[int, int]) -> sp.csr_array:
    rows, columns, values = (np.concatenate([e[i].ravel() for e in entries]) for i in range(3))
    return sp.coo_array((values, (rows, columns)), shape=shape_).tocsr()


def _cleaned(trace: sp.csr_array) -> sp.csr_array:
    """Without round-off: entries below 1e-13 are none, and 1 is 1 where only one is left."""
    trace.data[np.abs(trace.data) < 1e-13] = 0.0
    trace.eliminate_zeros()
    single = np.flatnonzero(np.diff(trace.indptr) == 1)
    trace.data[trace.indptr[single]] = 1.0
    return trace
