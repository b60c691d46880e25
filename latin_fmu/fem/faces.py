"""Faces of meshes: shape functions, flat pieces and cells of their facets (for clipping and the search of opposite
faces), nodal integrals, absorbing dashpots.

The reference triangle has the corners (0, 0), (1, 0), (0, 1), the reference quadrilateral is [-1, 1]^2; nodes stand
in the order of VTK: corners, middles of the edges, centre.

int phi_a dA vanishes at the corners of a 6-node triangle and is negative at those of an 8-node quadrilateral, so that
a contact force spread by phi would need no pressure, or tension, there. With

    phi~_corner = phi_corner + alpha sum of phi_middle over its two edges,    phi~_middle = (1 - 2 alpha) phi_middle

and alpha = 1/5 the areas are 2/15 and 1/5 (triangle), 1/20 and 1/5 (quadrilateral) of the facet; the values that
belong to phi~ are u~_corner = u_corner and u~_middle = (u_middle - alpha (u_1 + u_2)) / (1 - 2 alpha)
(Wohlmuth, Popp, Gee, Wall: An abstract framework for a priori estimates for contact problems in 3D with quadratic
finite elements, Computational Mechanics 49 (2012) 735-747).

Dashpots of an absorbing face: rho c_p along the normal, rho c_s across it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import scipy.sparse as sp

from .mesh import Array, FacetSet, Index, Mesh
from .reference_cells import FACET_CORNERS, FACET_KIND, simplex_rule

ALPHA: Final = 0.2
"""Share of a middle node's function that goes to each end of its edge."""
DEGREE: Final = {"triangle": 1, "quad": 2, "triangle6": 2, "quad8": 3, "quad9": 4}
"""Total degree of the shape functions in the reference coordinates."""
_SIGNS = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], dtype=float)
_TRIANGLE = np.array([(0, 0), (1, 0), (0, 1)], dtype=float)
_TRIANGLE_NODES = np.array([(0, 0), (1, 0), (0, 1), (0.5, 0), (0.5, 0.5), (0, 0.5)])
_QUAD_NODES = np.array([*_SIGNS, (0, -1), (1, 0), (0, 1), (-1, 0), (0, 0)])
_TRIANGLE_PIECES = ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5))
_QUAD_PIECES = ((0, 4, 8, 7), (4, 1, 5, 8), (8, 5, 2, 6), (7, 8, 6, 3))
_GAUSS = 1 / np.sqrt(3.0)
_CELLS: Final[dict[str, tuple[tuple[int, ...], ...]]] = {
    "triangle": ((0, 1, 2),),
    "quad": ((0, 1, 2, 3),),
    "triangle6": _TRIANGLE_PIECES,
    "quad8": ((0, 4, 7), (4, 1, 5), (5, 2, 6), (7, 6, 3), (4, 5, 6, 7)),
    "quad9": _QUAD_PIECES,
}
"""Flat cells between the nodes of a facet of each kind."""
_PART = 1e-9  # weight of a node in a point below which it has no part in it


def edges_of(kind: str) -> tuple[tuple[int, int], ...]:
    """Corners at the ends of each edge; the middle of edge i is node n_corner + i."""
    n = FACET_CORNERS[kind]
    return tuple((i, (i + 1) % n) for i in range(n))


def facet_nodes(kind: str) -> Array:
    """Reference coordinates (n_node, 2) of the nodes of a facet."""
    n = next(count for count, name in FACET_KIND.items() if name == kind)
    return (_TRIANGLE_NODES if FACET_CORNERS[kind] == 3 else _QUAD_NODES)[:n]


def quadratic(kind: str) -> bool:
    """Whether the facet has nodes in the middle of its edges."""
    return kind in ("triangle6", "quad8", "quad9")


def shape(kind: str, at: Array) -> Array:
    """Shape functions (..., n_node) at reference coordinates (..., 2)."""
    x, y = at[..., 0], at[..., 1]
    if kind in ("triangle", "triangle6"):
        corner = np.stack([1 - x - y, x, y], axis=-1)
        if kind == "triangle":
            return corner
        middle = 4 * corner * corner[..., [1, 2, 0]]  # of edge i, from corner i to i + 1
        return np.concatenate([corner * (2 * corner - 1), middle], axis=-1)
    sx, sy = x[..., None] * _SIGNS[:, 0], y[..., None] * _SIGNS[:, 1]
    if kind == "quad":
        return np.asarray(0.25 * (1 + sx) * (1 + sy))
    if kind == "quad8":
        corner = 0.25 * (1 + sx) * (1 + sy) * (sx + sy - 1)
        bubble_x, bubble_y = 0.5 * (1 - x * x), 0.5 * (1 - y * y)
        middle = np.stack([bubble_x * (1 - y), bubble_y * (1 + x), bubble_x * (1 + y), bubble_y * (1 - x)], axis=-1)
        return np.concatenate([corner, middle], axis=-1)
    if kind == "quad9":
        line_x = np.stack([0.5 * x * (x - 1), 1 - x * x, 0.5 * x * (x + 1)], axis=-1)
        line_y = np.stack([0.5 * y * (y - 1), 1 - y * y, 0.5 * y * (y + 1)], axis=-1)
        # a coordinate -1, 0 or 1 of a node selects its factor in the line
        places = (_QUAD_NODES + 1).astype(int)
        return line_x[..., places[:, 0]] * line_y[..., places[:, 1]]
    raise ValueError(f"no facet of kind {kind!r}")


def slopes(kind: str, at: Array) -> Array:
    """Derivatives (..., n_node, 2) of the shape functions; exact: the functions are of degree 2 in each coordinate."""
    steps = np.eye(2)
    # points outside of the facet: the polynomials hold there, too
    return np.asarray(np.stack([0.5 * (shape(kind, at + s) - shape(kind, at - s)) for s in steps], axis=-1))


def triangle_quadrature(degree: int) -> tuple[Array, Array]:
    """Points (n, 2) and weights (n,) on the reference triangle (area 1/2), exact to ``degree``."""
    rule = simplex_rule(degree // 2 + 1, 2)  # 2 n - 1 >= degree
    return rule.points, rule.weights


def square_quadrature(n: int) -> tuple[Array, Array]:
    """Points (n^2, 2) and weights of the product of two Gauss rules of n points on the reference quadrilateral."""
    x, w = np.polynomial.legendre.leggauss(n)
    return np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2), np.outer(w, w).ravel()


def flat_pieces(kind: str, straight: bool) -> Array:
    """Reference coordinates (n_piece, 3 | 4, 2) of the corners of flat pieces: the facet itself where it is linear or
    ``straight``, else four between its corners, middles and centre."""
    triangle = FACET_CORNERS[kind] == 3
    if straight or not quadratic(kind):
        return (_TRIANGLE if triangle else _SIGNS)[None]
    if triangle:
        return np.asarray(_TRIANGLE_NODES[np.array(_TRIANGLE_PIECES)])
    return np.asarray(_QUAD_NODES[np.array(_QUAD_PIECES)])


def is_straight(kind: str, places: Array) -> bool:
    """Whether the inner nodes of facets at ``places`` (n_facet, n_node, 3) stand in the middle of their corners."""
    if not quadratic(kind):
        return True
    n = FACET_CORNERS[kind]
    size = np.linalg.norm(np.ptp(places, axis=1), axis=1).max(initial=0.0)
    middle = places[:, n : 2 * n] - 0.5 * (places[:, :n] + places[:, [*range(1, n), 0]])
    off = np.abs(middle).max(initial=0.0)
    if kind == "quad9":
        off = max(off, np.abs(places[:, 8] - places[:, :4].mean(axis=1)).max(initial=0.0))
    if n == 4:  # the corners must be plane, too
        off = max(off, _warp(places))
    return bool(off <= 1e-9 * size)


def _warp(places: Array) -> float:
    # distance between the diagonals, 0 in a plane quadrilateral
    normal = np.cross(places[:, 2] - places[:, 0], places[:, 3] - places[:, 1])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    return float(np.abs(np.einsum("fi,fi->f", places[:, 1] - places[:, 0], normal)).max(initial=0.0))


def changes_basis(face: FacetSet) -> bool:
    """Whether contact on the face needs the functions phi~ of the module docstring."""
    # not quad9: int phi is positive at all of its nodes
    return any(block.kind in ("triangle6", "quad8") for block in face.blocks)


def facet_change(kind: str, changed: bool) -> Array:
    """L (n_node, n_node) of one facet: phi~_b = sum over a of L_ab phi_a; the identity where nothing is changed."""
    n_node, n = len(shape(kind, np.zeros(2))), FACET_CORNERS[kind]
    change = np.eye(n_node)
    # of any quadratic kind: a 9-node facet beside an 8-node one shares an edge with it, and its functions there
    if changed and quadratic(kind):
        for i, ends in enumerate(edges_of(kind)):
            change[n + i, n + i] = 1 - 2 * ALPHA
            change[n + i, list(ends)] = ALPHA
    return change


def linear_between_corners(facets: FacetSet, n_node: int) -> sp.csr_array | None:
    """Values (n_node, n_node) at the inner nodes of facets of second order by those at their corners, linear between
    them; rows of all other nodes are empty. None without such facets."""
    matrix = sp.csr_array((n_node, n_node))
    for block in facets.blocks:
        if not quadratic(block.kind):
            continue
        n = FACET_CORNERS[block.kind]
        weights = corner_functions(block.kind)[n:]
        rows = np.repeat(block.facets[:, n:], n, axis=1)
        columns = np.tile(block.corners, (1, len(weights)))
        values = np.tile(weights.ravel(), (len(block.facets), 1))
        # an edge between two facets has the same weights in both
        keys, first = np.unique(rows.ravel() * n_node + columns.ravel(), return_index=True)
        places = keys // n_node, keys % n_node
        one = sp.csr_array(sp.coo_array((values.ravel()[first], places), shape=matrix.shape))
        matrix = sp.csr_array(matrix.maximum(one))
    matrix.eliminate_zeros()
    return matrix if matrix.nnz else None


def corner_functions(kind: str) -> Array:
    """L (n_node, n_corner): the linear functions of the corners, theta_b = sum over a of L_ab phi_a."""
    corner = {3: "triangle", 4: "quad"}[FACET_CORNERS[kind]]
    return shape(corner, facet_nodes(kind))


def nodal_values(face: FacetSet, nodes: Index) -> sp.csr_array:
    """L^-1 (n_point, n_point): the values u~ that belong to phi~ from the values u at the nodes."""
    # the inverse of a matrix with 1 - 2 alpha and alpha in the same places
    return _edge_matrix(face, nodes, 1 / (1 - 2 * ALPHA), -ALPHA / (1 - 2 * ALPHA))


def _edge_matrix(face: FacetSet, nodes: Index, middle_share: float, ends_share: float) -> sp.csr_array:
    """The identity with ``middle_share`` at the middles of edges and ``ends_share`` in the columns of their ends."""
    n = len(nodes)
    rows = [np.arange(n)]
    columns = [np.arange(n)]
    values = [np.ones(n)]
    if changes_basis(face):
        ends, middle = edge_middles(face)
        _, first = np.unique(middle, return_index=True)  # an edge inside the face belongs to two facets
        # ``nodes`` ascend and hold all ends of their middle nodes
        at, (one, two) = np.searchsorted(nodes, middle[first]), np.searchsorted(nodes, ends[first]).T
        values[0][at] = middle_share
        rows += [at, at]
        columns += [one, two]
        values += [np.full(len(at), ends_share)] * 2
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return sp.coo_array(entries, shape=(n, n)).tocsr()


def edge_middles(face: FacetSet) -> tuple[Index, Index]:
    """Edges of the quadratic facets of a face: nodes at their ends (n, 2), in their middle (n,); inner edges twice."""
    ends, middle = [np.zeros((0, 2), dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for block in face.blocks:
        if quadratic(block.kind):
            n = FACET_CORNERS[block.kind]
            ends.append(block.facets[:, np.array(edges_of(block.kind))].reshape(-1, 2))
            middle.append(block.facets[:, n : 2 * n].ravel())
    return np.concatenate(ends), np.concatenate(middle)


@dataclass(frozen=True)
class Face:
    """Nodes of a face and their share of it.

    Attributes
    ----------
    nodes : (n_point,) node numbers, ascending.
    areas : (n_point,) int psi_a dA, m2, all > 0 for 4-node quadrilaterals and 3-node triangles; 0 at the corners of
        6-node triangles, negative at those of 8-node quadrilaterals.
    vector_areas : (n_point, 3) int psi_a n dA, m2, n outwards.
    change : L (n_point, n_point) of ``facets`` for faces with such facets, else None.
    """

    nodes: Index
    areas: Array
    vector_areas: Array
    change: sp.csr_array | None = None

    @property
    def positive_areas(self) -> Array:
        """Areas of the points in contact, L^T areas, all > 0, (n_point,), m2."""
        if self.change is None:
            return self.areas
        return self.change.T @ self.areas

    @property
    def normals(self) -> Array:
        """Unit outward normal at each node, (n_point, 3)."""
        if self.change is None:
            vector = self.vector_areas
        else:
            vector = self.change.T @ self.vector_areas
        return np.asarray(vector / np.linalg.norm(vector, axis=1)[:, None])


def face(mesh: Mesh, name: str) -> Face:
    """Nodal integrals of the named face (2 x 2 Gauss points on quadrilaterals, exact on triangles)."""
    return face_of(mesh.nodes, mesh.faces[name])


def face_of(places: Array, facets: FacetSet) -> Face:
    """Nodal integrals of facets; ``places`` (n_node, 3) are the nodes of the mesh."""
    nodes = facets.nodes
    areas = np.zeros(len(nodes))
    vector_areas = np.zeros((len(nodes), 3))
    for block in facets.blocks:
        if quadratic(block.kind):
            scalar, vector = _curved_integrals(block.kind, places[block.facets])
        else:
            scalar, vector = _facet_integrals(block.kind, places[block.facets])
        # not by an index alone: facets share nodes, and ``a[at] += b`` would keep one share of each
        at = np.searchsorted(nodes, block.facets)
        np.add.at(areas, at, scalar)
        np.add.at(vector_areas, at, vector)
    # u = L u~, and int phi~ = L^T int phi
    change = None
    if changes_basis(facets):
        change = _edge_matrix(facets, nodes, 1 - 2 * ALPHA, ALPHA)
    return Face(nodes, areas, vector_areas, change)


def _at_gauss_points(kind: str, places: Array) -> tuple[Array, Array, Array]:
    """Shape functions (n_gauss, n_node), weights (n_gauss,), normals times area ratios (n_gauss, n_facet, 3)."""
    # exact for int psi_a psi_b n; the length of n of a curved facet is no polynomial
    if FACET_CORNERS[kind] == 3:
        at, weights = triangle_quadrature(6)
    else:
        at, weights = square_quadrature(4)
    along = np.einsum("gak,fai->gkfi", slopes(kind, at), places)
    return shape(kind, at), weights, np.cross(along[:, 0], along[:, 1])


def _curved_integrals(kind: str, places: Array) -> tuple[Array, Array]:
    """int psi_a dA and int psi_a n dA, as in ``_facet_integrals``, of curved facets with nodes at ``places``."""
    values, weights, normal = _at_gauss_points(kind, places)
    weighted = weights[:, None] * values
    return np.einsum("ga,gf->fa", weighted, np.linalg.norm(normal, axis=2)), np.einsum("ga,gfi->fai", weighted, normal)


def _facet_integrals(_: str, corners: Array) -> tuple[Array, Array]:
    """int psi_a dA (n_facet, n_corner) and int psi_a n dA (n_facet, n_corner, 3) of facets with these corners."""
    if corners.shape[1] == 3:
        normal = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        vector = np.repeat(normal[:, None] / 3, 3, axis=1)  # int psi_a dA = area / 3
        scalar = np.repeat(np.linalg.norm(normal, axis=1)[:, None] / 3, 3, axis=1)
    else:
        vector = np.zeros(corners.shape)
        scalar = np.zeros(corners.shape[:2])
        signs = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], dtype=float)
        for xi, eta in signs * _GAUSS:
            psi = 0.25 * (1 + signs[:, 0] * xi) * (1 + signs[:, 1] * eta)
            d_xi = 0.25 * signs[:, 0] * (1 + signs[:, 1] * eta)
            d_eta = 0.25 * signs[:, 1] * (1 + signs[:, 0] * xi)
            normal = np.cross(np.einsum("a,fai->fi", d_xi, corners), np.einsum("a,fai->fi", d_eta, corners))
            vector += normal[:, None] * psi[None, :, None]
            scalar += np.linalg.norm(normal, axis=1)[:, None] * psi
    return scalar, vector


def cells_between(facets: FacetSet, weights: sp.csr_array) -> Index:
    """Triangles and quadrilaterals (n_cell, 4) between points of a face, -1 behind the three of a triangle.

    weights : (n_point, n_node) of the nodes of the mesh in the points. A node stands for the point that it has most
    part in; cells with a node that has part in none (facets that another face covers in part), or between fewer than
    three points, are left out.
    """
    columns = sp.csc_array(weights)
    point = np.full(weights.shape[1], -1, dtype=np.int64)
    for node in facets.nodes:
        entries = slice(columns.indptr[node], columns.indptr[node + 1])
        if columns.data[entries].max(initial=0.0) > _PART:
            point[node] = columns.indices[entries][np.argmax(columns.data[entries])]
    rows = [np.zeros((0, 4), dtype=np.int64)]
    for block in facets.blocks:
        for local in _CELLS[block.kind]:
            cells = point[block.facets[:, list(local)]]
            cells = cells[(cells >= 0).all(axis=1)]
            rows.append(np.pad(cells, ((0, 0), (0, 4 - cells.shape[1])), constant_values=-1))
    return _without_repetitions(np.concatenate(rows))


def _without_repetitions(cells: Index) -> Index:
    """Cells (n, 4) whose corners differ; a quadrilateral with two equal neighbours becomes a triangle."""
    corners = np.ones(cells.shape, dtype=bool)
    for i in range(4):
        # column -1 for i = 0: the last corner stands before the first
        corners[:, i] = (cells[:, i] != cells[:, i - 1]) & (cells[:, i] >= 0)
    cells = np.where(corners, cells, -1)
    # dropped corners to the end, the turn of the others stays
    order = np.argsort(~corners, axis=1, kind="stable")
    cells = np.take_along_axis(cells, order, axis=1)
    # opposite corners that are one point leave a quadrilateral without area
    distinct = (cells[:, 0] != cells[:, 2]) & ((cells[:, 1] != cells[:, 3]) | (cells[:, 3] < 0))
    whole: Index = cells[(corners.sum(axis=1) >= 3) & distinct]
    return whole


Impedance = Callable[[Array], Array]
"""Unit normals (..., 3) to traction over velocity (..., 3, 3), Pa s m-1."""


def lumped_dashpots(nodes: Array, facets: FacetSet, impedance: Impedance) -> sp.csr_array:
    """Dashpots (3 n_node, 3 n_node), N s m-1, at the points of a face alone, on areas that are positive on every kind
    of facet."""
    surface = face_of(nodes, facets)
    blocks = surface.positive_areas[:, None, None] * impedance(surface.normals)
    return _assembled(len(nodes), [(surface.nodes[:, None], blocks[:, None, :, None, :])])


def consistent_dashpots(nodes: Array, facets: FacetSet, impedance: Impedance) -> sp.csr_array:
    """int phi_a phi_b Z(n) dA (3 n_node, 3 n_node), N s m-1: on quadratic facets, a uniform velocity gives
    the forces of a uniform traction with these only."""
    parts = []
    for block in facets.blocks:
        values, weights, outwards = _at_gauss_points(block.kind, nodes[block.facets])
        area = np.linalg.norm(outwards, axis=2)
        tensor = impedance(outwards / area[..., None])
        share = (weights[:, None] * area)[..., None, None] * tensor
        parts.append((block.facets, np.einsum("ga,gb,gfij->faibj", values, values, share, optimize=True)))
    return _assembled(len(nodes), parts)


def _assembled(n_node: int, parts: list[tuple[Index, Array]]) -> sp.csr_array:
    """Sum of blocks (n, n_own, 3, n_own, 3) at nodes (n, n_own)."""
    rows = []
    columns = []
    values = []
    for nodes, blocks in parts:
        dofs = (3 * nodes[:, :, None] + np.arange(3)).reshape(len(nodes), -1)
        rows.append(np.repeat(dofs, dofs.shape[1], axis=1).ravel())
        columns.append(np.tile(dofs, (1, dofs.shape[1])).ravel())
        values.append(blocks.ravel())
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return sp.coo_array(entries, shape=(3 * n_node, 3 * n_node)).tocsr()


CREASE: Final = 0.7
"""Angle, rad; pieces that meet at a larger one form an edge of the body, not a curved face."""


@dataclass(frozen=True)
class Pieces:
    """Flat pieces with 3 or 4 corners of the facets of one block.

    Attributes
    ----------
    kind : of the facets. facet : (n_piece,) row of the facet in its block. nodes : (n_piece, n_node) of that facet.
    corners : (n_piece, 3 | 4, 3), m. reference : (n_piece, 3 | 4, 2) their coordinates in the facet.
    """

    kind: str
    facet: Index
    nodes: Index
    corners: Array
    reference: Array

    @property
    def n_piece(self) -> int:
        """Number of pieces."""
        return len(self.facet)

    @property
    def curved(self) -> bool:
        """Whether the pieces are those of curved facets."""
        # a straight facet is one piece, its corners those of the reference facet
        return quadratic(self.kind) and self.n_piece > len(np.unique(self.facet))

    @cached_property
    def vector_areas(self) -> Array:
        """Areas times unit normals, (n_piece, 3), m2."""
        c = self.corners
        # diagonals of a quadrilateral, two edges of a triangle: half the cross product is the vector area
        if c.shape[1] == 4:
            second = c[:, 3] - c[:, 1]
        else:
            second = c[:, 2] - c[:, 1]
        if c.shape[1] == 4:
            first = c[:, 2] - c[:, 0]
        else:
            first = c[:, 1] - c[:, 0]
        return np.asarray(0.5 * np.cross(first, second))

    @cached_property
    def areas(self) -> Array:
        """Areas of the pieces, (n_piece,), m2."""
        return np.asarray(np.linalg.norm(self.vector_areas, axis=1))

    @cached_property
    def normals(self) -> Array:
        """Unit normals (n_piece, 3), outwards."""
        return np.asarray(self.vector_areas / self.areas[:, None])

    @cached_property
    def centres(self) -> Array:
        """Means of the corners, (n_piece, 3), m."""
        return np.asarray(self.corners.mean(axis=1))

    @cached_property
    def radii(self) -> Array:
        """Largest distance of a corner from the centre, (n_piece,), m."""
        return np.asarray(np.linalg.norm(self.corners - self.centres[:, None], axis=2).max(axis=1))


@dataclass(frozen=True)
class Surface:
    """One face of a mesh: ``nodes`` (n_node, 3) of the whole mesh, ``facets`` of the face."""

    nodes: Array
    facets: FacetSet

    @cached_property
    def pieces(self) -> tuple[Pieces, ...]:
        """Flat pieces of each block of facets."""
        return tuple(self._cut(block.kind, block.facets) for block in self.facets.blocks)

    def _cut(self, kind: str, facets: Index) -> Pieces:
        places = self.nodes[facets]
        reference = flat_pieces(kind, is_straight(kind, places))
        n_facet, n_piece = len(facets), len(reference)
        # straight quadratic facets: their corners alone, middles are on the lines between
        if n_piece == 1:
            corners = places[:, : FACET_CORNERS[kind]]
        else:
            corners = np.einsum("pca,fai->fpci", shape(kind, reference), places).reshape(-1, reference.shape[1], 3)
        facet = np.repeat(np.arange(n_facet), n_piece)
        return Pieces(kind, facet, facets[facet], corners, np.tile(reference, (n_facet, 1, 1)))

    @cached_property
    def triangles(self) -> tuple[Array, Array, Array]:
        """Triangles (n, 3, 3) of the pieces, m, and the lowest and highest corner (n, 3) of the box of each."""
        parts = []
        for p in self.pieces:
            parts.append(p.corners[:, :3])
            if p.corners.shape[1] == 4:
                parts.append(p.corners[:, [0, 2, 3]])
        every = np.concatenate(parts)
        return every, every.min(axis=1), every.max(axis=1)

    @cached_property
    def area(self) -> float:
        """Area of the pieces, m2."""
        return float(sum(p.areas.sum() for p in self.pieces))

    @cached_property
    def facet_area(self) -> float:
        """Median area of its facets, m2."""
        return float(np.median(np.concatenate([np.bincount(p.facet, p.areas) for p in self.pieces])))

    @cached_property
    def size(self) -> float:
        """Longest side of the bounding box of the face, m."""
        return float(np.ptp(self.nodes[self.facets.nodes], axis=0).max())

    @cached_property
    def is_plane(self) -> bool:
        """Whether all pieces have one normal (to 1e-6)."""
        first = self.pieces[0].normals[0]
        return all(bool(np.abs(p.normals @ first - 1).max() < 1e-6) for p in self.pieces)

    @cached_property
    def sags(self) -> tuple[Array, ...]:
        """Distance of the facets from the smooth surface that they stand for, per block and piece (n_piece,), m.

        A chord h of a circle is h^2 / (8 R) away, and neighbours stand at the angle theta = h / R: h theta / 8, with
        h the height of the facet over the edge they share. A parabola through the ends and the middle of an arc of
        that length is h^4 / (512 R^3) away, and neighbours meet at the angle theta = (h / R)^3 / 16: h theta / 32.
        Where the curvature changes from facet to facet by dk, it is h^2 dk / 125 away, and where its middle stands off
        by d along the chord, 0.19 d h / R. 0 on plane faces and across the edges of a body.
        """
        sags = []
        for p, (height, bend, change) in zip(self.pieces, self._bends, strict=True):
            sag = height * bend / 8
            if p.curved:
                sags.append(self._curved_sag(p, sag, height**2 * change / 125)[p.facet])
            else:
                sags.append(sag.reshape(p.n_piece, -1).max(axis=1))
        return tuple(sags)

    @cached_property
    def _bends(self) -> list[tuple[Array, Array, Array]]:
        """Height of the facets of each block over their edges (n,), m, the angle (n,) at which the next facet stands
        there, and the difference of their curvatures across the edge (n,), m-1; 0 across the edges of a body."""
        edges = [self._edges_of(p) for p in self.pieces]
        ends, normals, across = (np.concatenate([edge[i] for edge in edges]) for i in (0, 1, 3))
        one, two = _shared(ends, 1e-9 * self.size)
        bend, change = np.zeros((2, len(ends)))
        bend[one] = bend[two] = _angle(normals[one], normals[two])
        change[one] = change[two] = np.abs(across[one] - across[two])
        # beyond the crease the surface has an edge there and stands for nothing smoother
        bend, change = np.where(bend < CREASE, [bend, change], 0.0)
        at = np.cumsum([len(height) for _, _, height, _ in edges])[:-1]
        parts = zip(edges, np.split(bend, at), np.split(change, at), strict=True)
        return [(height, angle, changed) for (_, _, height, _), angle, changed in parts]

    @cached_property
    def curvature(self) -> float:
        """Largest curvature of a facet, its median over the facets, m-1; 0 on plane faces."""
        each = []
        for p, (height, bend, _) in zip(self.pieces, self._bends, strict=True):
            if p.curved:
                length, turn, _, _ = self._turns(p)
                each.append((turn / length).max(axis=1))
            else:
                each.append((bend / height).reshape(p.n_piece, -1).max(axis=1))
        return float(np.median(np.concatenate(each)))

    @cached_property
    def chord_deviation(self) -> float:
        """Largest distance of flat facets from the smooth surface that they stand for, m; 0 where all round facets are
        curved."""
        flat = [sags for p, sags in zip(self.pieces, self.sags, strict=True) if not p.curved]
        return max((float(sag.max(initial=0.0)) for sag in flat), default=0.0)

    def _edges_of(self, pieces: Pieces) -> tuple[Array, Array, Array, Array]:
        """Edges of the facets of a block, one after the other: ends (n, 2, 3), m, normals of the facet at their middles
        (n, 3), height of the facet over them (n,), m, and its curvature across them, from its middle (n,), m-1."""
        n = FACET_CORNERS[pieces.kind]
        places = self.nodes[pieces.nodes[np.unique(pieces.facet, return_index=True)[1]]]
        ends = np.stack([places[:, :n], np.roll(places[:, :n], -1, axis=1)], axis=2).reshape(-1, 2, 3)
        along = ends[:, 1] - ends[:, 0]
        length = np.linalg.norm(along, axis=1)
        # height over an edge: twice the area of a triangle, the area of a quadrilateral, over the edge
        height = (2 if n == 3 else 1) * np.repeat(np.bincount(pieces.facet, pieces.areas), n) / length
        if not pieces.curved:
            return ends, np.repeat(pieces.normals, n, axis=0), height, np.zeros(len(height))
        at = facet_nodes(pieces.kind)
        at = np.concatenate([at[n : 2 * n], at[:n].mean(axis=0)[None]])
        normals = unit_normals(pieces.kind, places, np.tile(at, (len(places), 1, 1)))
        middles = shape(pieces.kind, at) @ places
        there, arm = ((x[:, :n] - x[:, n:]).reshape(-1, 3) for x in (normals, middles))
        normals = normals[:, :n].reshape(-1, 3)
        across = np.cross(along, normals)
        way = np.einsum("ni,ni->n", arm, across)
        curvature = np.einsum("ni,ni->n", there, across) / np.where(way == 0.0, np.inf, way)
        return ends, normals, height, curvature

    def _curved_sag(self, pieces: Pieces, sag: Array, changing: Array) -> Array:
        """Distance of each quadratic facet of a block from its smooth surface (n_facet,), m; (n,) at its edges ``sag``
        that of flat ones and ``changing`` that of a curvature that changes."""
        n = FACET_CORNERS[pieces.kind]
        flat, changed = (x.reshape(-1, n).max(axis=1) for x in (sag, changing))
        length, turn, rise, off = self._turns(pieces)
        # no neighbour: what its own turn tells
        bow = (length * turn**3).max(axis=1) / 512
        # middles on the chords: the facet is flat, whatever its kind
        kinked = np.maximum(np.where(rise > flat, flat / 4, flat), bow)
        return np.asarray(kinked + changed + (0.19 * off * turn).max(axis=1))

    def _turns(self, pieces: Pieces) -> tuple[Array, Array, Array, Array]:
        """Edges of the facets of a quadratic block: their lengths (n_facet, n_edge), m, the angle between the normals
        at their ends (n_facet, n_edge), how far the middle of one is from that of its chord at most (n_facet,), m, and
        how far along the chord (n_facet, n_edge), m."""
        first = np.unique(pieces.facet, return_index=True)[1]
        places, n = self.nodes[pieces.nodes[first]], FACET_CORNERS[pieces.kind]
        ends = np.stack([places[:, :n], np.roll(places[:, :n], -1, axis=1)], axis=2)
        away, chord = places[:, n : 2 * n] - ends.mean(axis=2), ends[:, :, 1] - ends[:, :, 0]
        length = np.linalg.norm(chord, axis=2)
        off = np.abs(np.einsum("fei,fei->fe", away, chord)) / length
        rise = np.linalg.norm(away, axis=2).max(axis=1)
        at_corners = unit_normals(pieces.kind, places, np.tile(facet_nodes(pieces.kind)[:n], (len(places), 1, 1)))
        # chords of the unit sphere: the angles, to a part in a thousand at ten degrees
        turn = np.linalg.norm(at_corners - np.roll(at_corners, -1, axis=1), axis=2)
        return length, turn, rise, off


def unit_normals(kind: str, places: Array, at: Array) -> Array:
    """Unit normals (n_facet, n, 3) of facets with nodes at ``places`` (n_facet, n_node, 3) at reference coordinates
    (n_facet, n, 2)."""
    along = np.einsum("fgak,fai->fgki", slopes(kind, at), places)
    normal = np.cross(along[:, :, 0], along[:, :, 1])
    # none at the corner where the edges of a facet are on one line
    return np.asarray(normal / np.maximum(np.linalg.norm(normal, axis=2), 1e-300)[..., None])


def _shared(ends: Array, tolerance: float) -> tuple[Index, Index]:
    """Rows of edges (n, 2, 3) that two pieces share, of the one and of the other."""
    # one millionth of the face: middles of one edge, computed in two facets, differ by round-off
    scale = max(tolerance, 1e-300)
    middle = np.rint(ends.mean(axis=1) / (1e3 * scale)).astype(np.int64)
    _, label, count = np.unique(middle, axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(label.ravel(), kind="stable")
    starts = np.cumsum(count) - count
    # more than two pieces at an edge are no smooth surface
    pairs = starts[count == 2]
    return order[pairs], order[pairs + 1]


def _angle(one: Array, other: Array) -> Array:
    """Angles (n,) between unit vectors (n, 3); 0 below the round-off of the normals of a plane face."""
    sine = np.linalg.norm(np.cross(one, other), axis=1)
    angle = np.arctan2(sine, np.einsum("pi,pi->p", one, other))
    return np.where(angle < 1e-7, 0.0, angle)
