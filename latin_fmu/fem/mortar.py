"""Contact of faces whose nodes do not match: integrals over the common part of two faces, dual basis of one of them.

The face that gives the points is the owner. Over the part of it that the other face covers (clipped facet by facet in
the plane of the owner's facet), with its functions phi_p (``facets``: those with positive areas) and their dual psi_p,

    psi_p in span(phi) of each facet:  int psi_p phi_q = delta_pq int phi_p = delta_pq a_p,    A = diag(a),
    T_owner = A^-1 int psi phi^T = 1,      T_other = A^-1 int psi phi_other^T

(Wohlmuth, SIAM J. Numer. Anal. 38 (2000) 989-1012; Popp, Gitterle, Gee, Wall, Int. J. Numer. Meth. Eng. 83 (2010)
1428-1465). Sum psi = 1 and Sum phi = 1 give T 1 = 1 and T^T a = int phi on both sides: a uniform pressure passes
exactly and forces balance. The psi of a sliver oscillate: owner facets that are hardly covered carry constants
instead, and points with little area are merged into their neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from .common_part import Cells, common_cells
from .faces import DEGREE, changes_basis, facet_change, nodal_values, shape, slopes, triangle_quadrature
from .mesh import Array, Index
from .surface import Pieces, Surface

SLIVER = 0.5
"""Points with less than this share of their nodal area are merged into neighbours: nodes beyond the common part, whose
psi extrapolate. With 0.2 a soft block on the partly covered facets of a stiff plate took 44 iterations on average over
forty random places, with 0.5 it took 21."""
_CONDITION = 1e6  # of the integrals of a facet, beyond which constants take the place of its dual functions
_INSIDE = 0.95  # such a share of the area in those facets that are covered at all: at the edge of them, no sliver
_NOTHING = 1e-6  # a covered share, or a share of the median area of points, that counts as none
_AFFINE = 1e-9  # a quadrilateral this close to a parallelogram is one
_CURVED_DEGREE = 12  # of the quadrature where the functions are no polynomials in the plane


@dataclass(frozen=True)
class Mortar:
    """Points of an owner face where another face covers it.

    Attributes
    ----------
    areas : (n_point,), m2, > 0. vector_areas : (n_point, 3) int psi n, m2, n outwards from the owner.
    owner, other : (n_point, n_node) values at the points from those at the nodes of the owner's and the other's mesh.
    shares : (n_point,) covered share of the area that the point has on the whole owner face.
    sags : (n_point,) distance of the flat pieces around a point from the smooth surfaces they stand for, both sides, m.
    covered : covered share of the area of those facets of the owner that are covered at all.
    """

    areas: Array
    vector_areas: Array
    owner: sp.csr_array
    other: sp.csr_array
    shares: Array
    sags: Array
    covered: float

    @property
    def normals(self) -> Array:
        """Unit normals (n_point, 3), outwards from the owner."""
        return np.asarray(self.vector_areas / np.linalg.norm(self.vector_areas, axis=1)[:, None])


class _Points:
    """Sums over the facets of an owner face while its blocks are integrated; row p belongs to the p-th node of it."""

    def __init__(self, owner: Surface, other: Surface) -> None:
        self.owner, self.other = owner, other
        self.nodes = owner.facets.nodes
        n = len(self.nodes)
        self.areas, self.whole, self.near, self.sags, self.covered = np.zeros((5, n))
        self.reached = 0.0  # area of the facets that are covered at all
        self.vector_areas = np.zeros((n, 3))
        self.entries: list[tuple[Index, Index, Array]] = []  # of A T_other: points, nodes, values
        self.own: list[tuple[Index, Index, Array]] = []  # of A T_owner in the values u~
        self.changed = changes_basis(owner.facets)


def mortar(owner: Surface, other: Surface, reach: float | None = None, least: float = SLIVER) -> Mortar | None:
    """Integrals over the common part of two faces; None where they have none.

    Parameters
    ----------
    reach : largest distance along the owner's normal at which the faces count as opposite, m; any where None.
    least : points with less than this share of their area are merged into neighbours.
    """
    points = _Points(owner, other)
    cells = common_cells(owner, other, reach)
    if not any(len(c) for row in cells for c in row):
        return None
    for number, row in enumerate(cells):
        _add_block(points, number, row)
    return _finished(points, least)


def _add_block(points: _Points, number: int, row: list[Cells]) -> None:
    """Sums of the owner's block ``number`` from its cells with each block of the other face."""
    pieces = points.owner.pieces[number]
    change = facet_change(pieces.kind, points.changed)
    n_facet, n = int(pieces.facet.max()) + 1, change.shape[0]
    facets = points.owner.facets.blocks[number].facets
    at = np.searchsorted(points.nodes, facets)
    gram, normal = np.zeros((n_facet, n, n)), np.zeros((n_facet, n, 3))
    covered = np.zeros(n_facet)
    products: list[tuple[Index, Index, Array]] = []
    for cells, theirs, their_sags in zip(row, points.other.pieces, points.other.sags, strict=True):
        for some in np.array_split(np.arange(len(cells)), max(1, len(cells) // 20000)):
            part = cells.picked(some)
            weights, mine, other = _values(part, pieces, theirs)
            mine = mine @ change
            facet = pieces.facet[part.owner]
            weighted = weights[..., None] * mine
            np.add.at(gram, facet, np.einsum("cga,cgb->cab", weighted, mine))
            np.add.at(normal, facet, weighted.sum(axis=1)[:, :, None] * pieces.normals[part.owner, None])
            np.add.at(covered, facet, weights.sum(axis=1))
            products.append((facet, theirs.nodes[part.other], np.einsum("cga,cgb->cab", weighted, other)))
            sag = points.owner.sags[number][part.owner] + their_sags[part.other]
            np.maximum.at(points.sags, at[facet], np.repeat(sag[:, None], n, axis=1))
    dual = _dual(gram, covered)
    np.add.at(points.areas, at, np.einsum("fab->fa", gram))
    np.add.at(points.vector_areas, at, dual @ normal)
    area = np.bincount(pieces.facet, pieces.areas, minlength=n_facet)
    reached = covered > _NOTHING * area
    points.reached += float(area[reached].sum())
    whole = _whole(pieces, change, n_facet)
    np.add.at(points.whole, at, whole)
    np.add.at(points.near, at[reached], whole[reached])
    np.add.at(points.covered, at, np.repeat(covered[:, None] / n, n, axis=1))
    own = dual @ gram
    points.own.append((np.repeat(at, n, axis=1), np.tile(at, (1, n)), own.reshape(n_facet, -1)))
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
    condition = np.linalg.cond(gram[touched] / (root[:, :, None] * root[:, None]))
    regular, constant = touched[condition <= _CONDITION], touched[~(condition <= _CONDITION)]
    dual[regular] = mean[regular][:, :, None] * np.linalg.inv(gram[regular])
    dual[constant] = np.repeat((mean[constant] / covered[constant][:, None])[:, :, None], n, axis=2)
    return dual


def _whole(pieces: Pieces, change: Array, n_facet: int) -> Array:
    """int phi (n_facet, n) over whole facets."""
    points, weights = triangle_quadrature(DEGREE[pieces.kind] + 2)
    total = np.zeros((n_facet, change.shape[0]))
    corners = pieces.corners.shape[1]
    for fan in ((0, 1, 2), (0, 2, 3))[: corners - 2]:
        p = pieces.corners[:, fan]
        area = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
        barycentric = np.stack([1 - points.sum(axis=1), *points.T])
        at = np.einsum("kg,pki->pgi", barycentric, pieces.reference[:, fan])
        np.add.at(total, pieces.facet, area[:, None] * (weights @ shape(pieces.kind, at)) @ change)
    return total


def _values(cells: Cells, mine: Pieces, theirs: Pieces) -> tuple[Array, Array, Array]:
    """Weights (n_cell, n_gauss), functions of the owner's and of the other's facets (n_cell, n_gauss, n_node)."""
    degree = DEGREE[mine.kind] + max(DEGREE[mine.kind], DEGREE[theirs.kind])
    if not (_affine(cells.owner_corners) and _affine(cells.other_corners)):
        degree = max(degree, _CURVED_DEGREE)
    points, weights = triangle_quadrature(degree)
    barycentric = np.stack([1 - points.sum(axis=1), *points.T])
    at = np.einsum("kg,cki->cgi", barycentric, cells.corners)
    scaled = 2 * cells.areas[:, None] * weights
    own = _reference(at, cells.owner_corners, mine.reference[cells.owner])
    far = _reference(at, cells.other_corners, theirs.reference[cells.other])
    return scaled, shape(mine.kind, own), shape(theirs.kind, far)


def _affine(corners: Array) -> bool:
    if corners.shape[1] == 3 or not len(corners):
        return True
    off = corners[:, 0] - corners[:, 1] + corners[:, 2] - corners[:, 3]
    return bool(np.abs(off).max() <= _AFFINE * np.abs(corners).max())


def _reference(at: Array, corners: Array, reference: Array) -> Array:
    """Coordinates in the facet (n_cell, n_gauss, 2) of places in the plane of a piece with these corners."""
    if corners.shape[1] == 3:
        edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
        share = np.linalg.solve(edges[:, None], (at - corners[:, None, 0])[..., None])[..., 0]
        spans = np.stack([reference[:, 1] - reference[:, 0], reference[:, 2] - reference[:, 0]], axis=1)
        return np.asarray(reference[:, None, 0] + share @ spans)
    local = np.zeros_like(at)
    for _ in range(1 if _affine(corners) else 12):  # Newton; one step solves a parallelogram
        slope = slopes("quad", local).swapaxes(-1, -2) @ corners[:, None]  # rows: along both coordinates
        off = at - shape("quad", local) @ corners
        local = local + np.asarray(np.linalg.solve(slope.swapaxes(-1, -2), off[..., None])[..., 0])
    return np.asarray(shape("quad", local) @ reference)


def _finished(points: _Points, least: float) -> Mortar:
    """Traces of the points from the sums; points with less than ``least`` of their area are merged into others.

    A group has one pressure, its rows are the sum of those of its members (A T).
    """
    n, touched = len(points.nodes), np.flatnonzero(points.covered > 0)
    back = nodal_values(points.owner.facets, points.nodes)
    own = sp.csr_array(_collected(points.own, (n, n))[touched])
    other = sp.csr_array(_collected(points.entries, (n, len(points.other.nodes)))[touched])
    places = (back @ points.owner.nodes[points.nodes])[touched]
    shares = points.areas[touched] / points.whole[touched]
    shares[points.areas[touched] > _INSIDE * points.near[touched]] = 1.0
    group = _groups(shares, sp.csr_array(own[:, touched]), places, least)
    joined = sp.csr_array((np.ones(len(group)), (group, np.arange(len(group)))))
    areas = np.asarray(joined @ points.areas[touched])
    joined = sp.csr_array(joined[areas > _NOTHING * np.median(areas)])
    areas = np.asarray(joined @ points.areas[touched])
    mean = sp.csr_array(sp.diags_array(1 / areas) @ joined)
    select = sp.csr_array((np.ones(n), (np.arange(n), points.nodes)), shape=(n, len(points.owner.nodes)))
    sags = np.asarray((joined @ sp.diags_array(points.sags[touched])).max(axis=1).toarray()).ravel()
    return Mortar(
        areas,
        np.asarray(joined @ points.vector_areas[touched]),
        sp.csr_array(_cleaned(sp.csr_array(mean @ own)) @ back @ select),
        _cleaned(sp.csr_array(mean @ other)),
        areas / np.asarray(joined @ points.whole[touched]),
        sags,
        points.covered.sum() / points.reached,
    )


def _groups(shares: Array, near: sp.csr_array, places: Array, least: float) -> Index:
    """Number of the group of each point, (n_point,), from the covered shares of their areas.

    From the largest share to the smallest, the nearest neighbour with area enough takes a sliver, else the group of the
    nearest one with a larger share; where there is none (the other face is smaller than a facet of the owner) the
    sliver stands for its neighbours. ``near`` (n_point, n_point) has entries where two points share a covered facet.
    """
    taker = np.where(shares >= least, np.arange(len(shares)), -1)
    small = np.flatnonzero(taker < 0)
    for p in small[np.argsort(-shares[small], kind="stable")]:
        others = near.indices[near.indptr[p] : near.indptr[p + 1]]
        placed = others[taker[others] >= 0]
        large = placed[taker[placed] == placed]
        choice = large if len(large) else placed
        nearest = choice[np.argmin(np.linalg.norm(places[choice] - places[p], axis=1))] if len(choice) else p
        taker[p] = taker[nearest] if len(choice) else p
    return np.unique(taker, return_inverse=True)[1].astype(np.int64)


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
