"""Shape functions of the reference cells: polynomials that are one at their node and zero at the others.

    N_a(x) = sum_m m(x) c_ma,    c = (m(x_b))^-1        monomials m of the cell, nodes x_b

Reference cells: [-1, 1]^3 for hexahedra, the unit simplex for tetrahedra, the unit triangle times [-1, 1] for wedges.
Monomials: complete degree 1 or 2 on tetrahedra, all products of degree 1 or 2 per axis on hexahedra; with 20 nodes
those in which one axis at most is squared (serendipity).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from itertools import product

import numpy as np

from .cells import CELL_EDGES, HEX_FACES, N_CORNER
from .mesh import Array

_HEX = ((-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1), (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1))
_TET = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
_WEDGE = ((0, 0, -1), (1, 0, -1), (0, 1, -1), (0, 0, 1), (1, 0, 1), (0, 1, 1))


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
        found: Array = _monomials(points, self.exponents) @ self.coefficients
        return found

    def gradients(self, points: Array) -> Array:
        """Derivatives by the reference coordinates at points (n_point, 3): (n_point, n_node, 3)."""
        slopes = []
        for axis in range(3):
            lowered = self.exponents.copy()
            lowered[:, axis] = np.maximum(lowered[:, axis] - 1, 0)
            slopes.append((self.exponents[:, axis] * _monomials(points, lowered)) @ self.coefficients)
        return np.stack(slopes, axis=-1)


def _monomials(points: Array, exponents: Array) -> Array:
    """(n_point, n_monomial)."""
    found: Array = np.prod(points[:, None, :] ** exponents[None], axis=2)
    return found


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
    """Shape functions of a type of cell (a key of ``cells.CELL_FACES``)."""
    corners = np.array({8: _HEX, 4: _TET, 6: _WEDGE}[N_CORNER[cell_type]], dtype=float)
    middles = [corners[list(edge)].mean(axis=0) for edge in CELL_EDGES[cell_type]]
    whole = np.concatenate([corners, middles])
    if cell_type == "hexahedron27":
        whole = np.concatenate([whole, [corners[list(f)].mean(axis=0) for f in HEX_FACES], np.zeros((1, 3))])
    return {
        "hexahedron": lambda: _functions(corners, _product(1, 3)),
        "hexahedron20": lambda: _functions(whole, _product(2, 3, squared=1)),
        "hexahedron27": lambda: _functions(whole, _product(2, 3)),
        "tetra": lambda: _functions(corners, _complete(1, 3)),
        "tetra10": lambda: _functions(whole, _complete(2, 3)),
        "wedge": lambda: _functions(corners, [(*e, z) for e in _complete(1, 2) for z in (0, 1)]),
    }[cell_type]()


def mirrored(cell_type: str) -> list[int]:
    """Numbering of a cell turned inside out: the first two reference axes exchanged."""
    nodes = cell_functions(cell_type).nodes
    apart = np.abs(nodes[:, None, [1, 0, 2]] - nodes[None]).sum(axis=2)
    return [int(i) for i in apart.argmin(axis=1)]
