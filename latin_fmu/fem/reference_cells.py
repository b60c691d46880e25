"""Reference cells: faces and edges, shape functions, integration rules.

Nodes follow the order of VTK and meshio. Middle nodes of quadratic cells follow the corners in the order of the edges
below, then come the centres of the faces and of the cell. Wedges have their nodes 3, 4, 5 above 0, 1, 2
(Jacobian > 0), as every mesh generator writes them.

Shape functions are polynomials that are one at their node and zero at the others.

    N_a(x) = sum_m m(x) c_ma,    c = (m(x_b))^-1        monomials m of the cell, nodes x_b

Reference cells: [-1, 1]^3 for hexahedra, the unit simplex for tetrahedra, the unit triangle times [-1, 1] for wedges.
Monomials: complete degree 1 or 2 on tetrahedra, all products of degree 1 or 2 per axis on hexahedra; with 20 nodes
those in which one axis at most is squared (serendipity); on wedges of 15 nodes those of degree 2 in the triangle times
1 and z, and of degree 1 times z^2.

A pyramid is a hexahedron of which the upper face is one point: its functions are bilinear on the base and linear on the
triangles, so that it joins hexahedra and tetrahedra; its Jacobian is zero at the apex.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from itertools import combinations, product
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Local = tuple[tuple[int, ...], ...]
HEX_EDGES = ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))
TET_EDGES = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))
PYRAMID_EDGES = ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4))
WEDGE_EDGES = ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5))
# Corners of the faces, numbered so that the normal points outwards.
HEX_FACES = ((0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7))
TET_FACES = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))
WEDGE_FACES = ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5))
PYRAMID_FACES = ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4))
CELL_EDGES: Final[dict[str, Local]] = {
    "hexahedron": HEX_EDGES,
    "tetra": TET_EDGES,
    "tetra10": TET_EDGES,
    "hexahedron20": HEX_EDGES,
    "hexahedron27": HEX_EDGES,
    "wedge": WEDGE_EDGES,
    "wedge15": WEDGE_EDGES,
    "wedge18": WEDGE_EDGES,
    "pyramid": PYRAMID_EDGES,
    "pyramid13": PYRAMID_EDGES,
}
N_CORNER: Final = {name: 1 + max(n for edge in edges for n in edge) for name, edges in CELL_EDGES.items()}
# Kinds of facets, by their names in meshio: the number of nodes determines the kind.
FACET_KIND: Final = {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8", 9: "quad9"}
FACET_CORNERS: Final = {"triangle": 3, "quad": 4, "triangle6": 3, "quad8": 4, "quad9": 4}
_HEX = ((-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1), (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1))
_TET = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
_PYRAMID = (*_HEX[:4], (0, 0, 1))
_WEDGE = ((0, 0, -1), (1, 0, -1), (0, 1, -1), (0, 0, 1), (1, 0, 1), (0, 1, 1))


def _with_middle_nodes(faces: Local, edges: Local, corners: int, centres: bool = False) -> Local:
    """Faces of a quadratic cell: corners, middle nodes of the edges in the same turn, centre where there is one."""
    middle = {frozenset(edge): corners + i for i, edge in enumerate(edges)}
    whole_faces = []
    centre = corners + len(edges)
    for face in faces:
        turn = zip(face, (*face[1:], face[0]), strict=True)
        whole = (*face, *(middle[frozenset(edge)] for edge in turn))
        # quadrilaterals alone have a centre
        if centres and len(face) == 4:
            whole, centre = (*whole, centre), centre + 1
        whole_faces.append(whole)
    return tuple(whole_faces)


# The types of cells, by their names in meshio, with the nodes of their faces.
CELL_FACES: Final[dict[str, Local]] = {
    "hexahedron": HEX_FACES,
    "tetra": TET_FACES,
    "tetra10": _with_middle_nodes(TET_FACES, TET_EDGES, 4),
    "hexahedron20": _with_middle_nodes(HEX_FACES, HEX_EDGES, 8),
    "hexahedron27": _with_middle_nodes(HEX_FACES, HEX_EDGES, 8, centres=True),
    "wedge": WEDGE_FACES,
    "wedge15": _with_middle_nodes(WEDGE_FACES, WEDGE_EDGES, 6),
    "wedge18": _with_middle_nodes(WEDGE_FACES, WEDGE_EDGES, 6, centres=True),
    "pyramid": PYRAMID_FACES,
    "pyramid13": _with_middle_nodes(PYRAMID_FACES, PYRAMID_EDGES, 5),
}


N_NODE: Final = {name: 1 + max(n for face in faces for n in face) for name, faces in CELL_FACES.items()} | {
    "hexahedron27": 27  # the last node is on no face
}


def _links(cell_type: str) -> Local:
    """Neighbouring nodes of a cell: half edges and what joins the middle nodes of one face; edges of linear cells."""
    corners, edges = N_CORNER[cell_type], CELL_EDGES[cell_type]
    if N_NODE[cell_type] == corners:
        return edges
    links = [(end, corners + i) for i, edge in enumerate(edges) for end in edge]
    for face in CELL_FACES[cell_type]:
        # 6 nodes: a triangle with middles; all other faces have 4 corners
        n = {6: 3}.get(len(face), 4)
        middles = face[n : 2 * n]
        # middles of a triangle are joined by edges of its four parts, those of an 8-node face are not
        if n == 3:
            links += list(combinations(middles, 2))
        if len(face) == 9:
            links += [(face[8], middle) for middle in middles]
        if cell_type == "hexahedron27":
            links.append((face[8], 26))
    return tuple(links)


CELL_LINKS: Final = {name: _links(name) for name in CELL_FACES}
"""Pairs of neighbouring nodes."""


CELL_OF_N_NODE: Final = {count: name for name, count in N_NODE.items()}


@dataclass(frozen=True)
class ShapeFunctions:
    """Shape functions of one type of cell.

    Attributes
    ----------
    nodes : (n_node, 3) reference coordinates. exponents : (n_node, 3) of the monomials.
    coefficients : (n_monomial, n_node) of the monomials in the functions.
    """

    nodes: Array
    exponents: Array
    coefficients: Array

    def values(self, points: Array) -> Array:
        """Functions at points (n_point, 3): (n_point, n_node)."""
        return np.asarray(_monomials(points, self.exponents) @ self.coefficients)

    def gradients(self, points: Array) -> Array:
        """Derivatives by the reference coordinates at points (n_point, 3): (n_point, n_node, 3)."""
        slopes = []
        for axis in range(3):
            lowered = self.exponents.copy()
            # not below 0: 0 ** -1 at a point with a coordinate 0 is infinite, and times the factor 0 NaN
            lowered[:, axis] = np.maximum(lowered[:, axis] - 1, 0)
            slopes.append((self.exponents[:, axis] * _monomials(points, lowered)) @ self.coefficients)
        return np.stack(slopes, axis=-1)


def _monomials(points: Array, exponents: Array) -> Array:
    """(n_point, n_monomial)."""
    return np.asarray(np.prod(points[:, None, :] ** exponents[None], axis=2))


def _functions(nodes: Array, exponents: Iterable[tuple[int, ...]]) -> ShapeFunctions:
    powers = np.array(list(exponents), dtype=float)
    coefficients = np.asarray(np.linalg.inv(_monomials(nodes, powers)), dtype=float)
    return ShapeFunctions(nodes, powers, coefficients)


def _product(degree: int, axes: int, squared: int = 3) -> list[tuple[int, ...]]:
    """Exponents up to ``degree`` on each axis, two on ``squared`` axes at most."""
    return [e for e in product(range(degree + 1), repeat=axes) if e.count(2) <= squared]


def _complete(degree: int, axes: int) -> list[tuple[int, ...]]:
    """Exponents that sum up to ``degree`` at most."""
    return [e for e in product(range(degree + 1), repeat=axes) if sum(e) <= degree]


@cache
def cell_functions(cell_type: str) -> ShapeFunctions:
    """Shape functions of a type of cell (a key of ``CELL_FACES``)."""
    corners = np.array({8: _HEX, 4: _TET, 6: _WEDGE, 5: _PYRAMID}[N_CORNER[cell_type]], dtype=float)
    middles = [corners[list(edge)].mean(axis=0) for edge in CELL_EDGES[cell_type]]
    whole = np.concatenate([corners, middles])
    if cell_type == "hexahedron27":
        whole = np.concatenate([whole, [corners[list(f)].mean(axis=0) for f in HEX_FACES], np.zeros((1, 3))])
    if cell_type == "wedge18":
        whole = np.concatenate([whole, [corners[list(f)].mean(axis=0) for f in WEDGE_FACES[2:]]])
    if cell_type == "pyramid13":
        # halfway to the apex the coordinates of the hexahedron are those of the corner
        whole[9:] = [(x, y, 0.0) for x, y, _ in _HEX[:4]]
    return {
        "hexahedron": lambda: _functions(corners, _product(1, 3)),
        "hexahedron20": lambda: _functions(whole, _product(2, 3, squared=1)),
        "hexahedron27": lambda: _functions(whole, _product(2, 3)),
        "tetra": lambda: _functions(corners, _complete(1, 3)),
        "tetra10": lambda: _functions(whole, _complete(2, 3)),
        "wedge": lambda: _functions(corners, [(*e, z) for e in _complete(1, 2) for z in (0, 1)]),
        "wedge15": lambda: _functions(
            whole, [*((*e, z) for e in _complete(2, 2) for z in (0, 1)), *((*e, 2) for e in _complete(1, 2))]
        ),
        "wedge18": lambda: _functions(whole, [(*e, z) for e in _complete(2, 2) for z in (0, 1, 2)]),
        "pyramid": lambda: _collapsed(corners),
        "pyramid13": lambda: _collapsed_quadratic(whole),
    }[cell_type]()


def _collapsed(nodes: Array) -> ShapeFunctions:
    """Those of the hexahedron with its four upper ones added up."""
    hexahedron = cell_functions("hexahedron")
    together = np.eye(5)[[0, 1, 2, 3, 4, 4, 4, 4]]
    return ShapeFunctions(nodes, hexahedron.exponents, hexahedron.coefficients @ together)


def _collapsed_quadratic(nodes: Array) -> ShapeFunctions:
    """Those of the pyramid of 13 nodes, by the coordinates r, s, t of the hexahedron with its upper face collapsed.

    With h = (1 - t) / 2, x = r h, y = s h, z = 1 - h they span the polynomials of degree two and x y z / h, x^2 y / h,
    x y^2 / h (Bedrosian, Int. J. Numer. Meth. Engng. 35, 1992): triangles of 6 and quadrilaterals of 8 nodes on the
    faces, and linear fields exactly. In r, s, t all of them are polynomials, so that the apex is no special place.
    """
    hexahedron = cell_functions("hexahedron27")

    def space(points: Array) -> Array:
        r, s, t = points.T
        h = 0.5 * (1.0 - t)
        x = r * h
        y = s * h
        z = 1.0 - h
        rational = (r * s * z * h, r * r * s * h * h, r * s * s * h * h)
        return np.stack([np.ones(len(r)), x, y, z, x * x, y * y, z * z, x * y, y * z, z * x, *rational], axis=1)

    coefficients = hexahedron.coefficients @ space(hexahedron.nodes) @ np.linalg.inv(space(nodes))
    return ShapeFunctions(nodes, hexahedron.exponents, coefficients)


def mirrored(cell_type: str) -> list[int]:
    """Numbering of a cell turned inside out: the first two reference axes exchanged."""
    nodes = cell_functions(cell_type).nodes
    apart = np.abs(nodes[:, None, [1, 0, 2]] - nodes[None]).sum(axis=2)
    return [int(i) for i in apart.argmin(axis=1)]


REDUCED_CELLS: Final = ("hexahedron20", "wedge")
"""Types of cells whose stiffness has fewer points by the reduced rule."""
UNIFORM_CELLS: Final = ("hexahedron",)
"""Types of cells whose strain is uniform by the reduced rule (``elements``)."""


@dataclass(frozen=True)
class Rule:
    """Points (n_point, d) and weights (n_point,) on a reference cell."""

    points: Array
    weights: Array


def _line(n: int) -> Rule:
    """Gauss's rule on [-1, 1], exact to degree 2 n - 1."""
    x, w = np.polynomial.legendre.leggauss(n)
    return Rule(x[:, None], w)


def _times(first: Rule, second: Rule) -> Rule:
    """Product of two rules, the first one's points fastest."""
    points = np.concatenate(
        [np.tile(first.points, (len(second.points), 1)), np.repeat(second.points, len(first.points), axis=0)], axis=1
    )
    # the order of the points above
    return Rule(points, np.outer(second.weights, first.weights).ravel())


def simplex_rule(n: int, axes: int) -> Rule:
    """Conical product of Gauss-Jacobi rules on the unit simplex, exact to degree 2 n - 1, all weights positive."""
    from scipy.special import roots_jacobi  # slow to load, and needed by few kinds of cells

    points, weights = np.zeros((1, 0)), np.ones(1)
    for axis in range(axes):
        # weight (1 - x)^axis: the cross-section of the cone at t = (1 + x) / 2
        x, w = roots_jacobi(n, axis, 0)
        x, w = 0.5 * (1 + x), w / 2.0 ** (axis + 1)
        # the rule of the axes so far, shrunk towards the new corner
        points = np.concatenate([np.concatenate([(1 - t) * points, np.full((len(points), 1), t)], axis=1) for t in x])
        weights = np.outer(w, weights).ravel()
    return Rule(points, weights)


def _corner_rule(axes: int) -> Rule:
    """One point towards each corner of the unit simplex, exact to degree 2."""
    a, volume = {2: (1 / 6, 1 / 2), 3: ((5 - np.sqrt(5)) / 20, 1 / 6)}[axes]
    points = np.full((axes + 1, axes), a)
    # row i + 1 has its large coordinate on axis i; row 0 points to the corner at the origin
    points[1:][np.eye(axes, dtype=bool)] = 1 - axes * a
    return Rule(points, np.full(axes + 1, volume / (axes + 1)))


@cache
def cell_rule(cell_type: str, of_products: bool = False, curved: bool = False, reduced: bool = False) -> Rule:
    """Rule for the stiffness of a cell, or (``of_products``) for products of its shape functions, as in the mass.

    Hexahedra: 2 x 2 x 2 points, 3 x 3 x 3 on quadratic ones. Tetrahedra: 4 points, which are exact for the stiffness
    of both orders where edges are straight; 8 where they are ``curved`` (degree 3: uniform strain stays exact), 27 for
    the mass of quadratic ones (degree 5). Wedges: 3 x 2 points, 3 x 3 on quadratic ones, 9 x 3 (degree 5 in the
    triangle) for their mass and where they are curved. Pyramids: 2 x 2 x 2 points of the hexahedron, 3 x 3 x 3 for the
    mass; quadratic ones 3 x 3 x 3, and 4 x 4 x 4 for the mass. ``reduced`` : 2 x 2 x 2 points for the stiffness of
    20-node hexahedra, 1 x 2 for that of 6-node wedges, as C3D20R and C3D6 of CalculiX.
    """
    if reduced and not of_products and cell_type in REDUCED_CELLS:
        if cell_type == "wedge":
            return _times(simplex_rule(1, 2), _line(2))
        return volume_rule(cell_type, 2)
    if cell_type.startswith(("hexahedron", "pyramid")):
        number = 3
        if cell_type == "hexahedron" or (cell_type == "pyramid" and not of_products):
            number = 2
        elif cell_type == "pyramid13" and of_products:
            number = 4
        line = _line(number)
        return _times(_times(line, line), line)
    if cell_type == "wedge":
        return _times(_corner_rule(2), _line(2))
    if cell_type in ("wedge15", "wedge18"):
        if of_products or curved:
            return _times(simplex_rule(3, 2), _line(3))
        return _times(_corner_rule(2), _line(3))
    if cell_type == "tetra10" and (of_products or curved):
        return simplex_rule(3 if of_products else 2, 3)
    return _corner_rule(3)


@cache
def volume_rule(cell_type: str, n: int) -> Rule:
    """Rule with n points per axis, for what is not smooth in a cell."""
    line = _line(n)
    if cell_type.startswith(("hexahedron", "pyramid")):
        return _times(_times(line, line), line)
    if cell_type.startswith("wedge"):
        return _times(simplex_rule(n, 2), line)
    return simplex_rule(n, 3)
