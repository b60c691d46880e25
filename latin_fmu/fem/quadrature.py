"""Integration rules on the reference cells."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from .mesh import Array


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
    return Rule(points, np.outer(second.weights, first.weights).ravel())


def simplex_rule(n: int, axes: int) -> Rule:
    """Conical product of Gauss-Jacobi rules on the unit simplex, exact to degree 2 n - 1, all weights positive."""
    from scipy.special import roots_jacobi  # slow to load, and needed by few kinds of cells

    points, weights = np.zeros((1, 0)), np.ones(1)
    for axis in range(axes):
        x, w = roots_jacobi(n, axis, 0)
        x, w = 0.5 * (1 + x), w / 2.0 ** (axis + 1)
        # the simplex found so far, shrunk towards the new corner
        points = np.concatenate([np.concatenate([(1 - t) * points, np.full((len(points), 1), t)], axis=1) for t in x])
        weights = np.outer(w, weights).ravel()
    return Rule(points, weights)


def _corner_rule(axes: int) -> Rule:
    """One point towards each corner of the unit simplex, exact to degree 2."""
    a, volume = {2: (1 / 6, 1 / 2), 3: ((5 - np.sqrt(5)) / 20, 1 / 6)}[axes]
    points = np.full((axes + 1, axes), a)
    points[1:][np.eye(axes, dtype=bool)] = 1 - axes * a
    return Rule(points, np.full(axes + 1, volume / (axes + 1)))


@cache
def cell_rule(cell_type: str, of_products: bool = False, curved: bool = False) -> Rule:
    """Rule for the stiffness of a cell, or (``of_products``) for products of its shape functions, as in the mass.

    Hexahedra: 2 x 2 x 2 points, 3 x 3 x 3 on quadratic ones. Tetrahedra: 4 points, which are exact for the stiffness
    of both orders where edges are straight; 8 where they are ``curved`` (degree 3: uniform strain stays exact), 27 for
    the mass of quadratic ones (degree 5). Wedges: 3 x 2 points.
    """
    if cell_type.startswith("hexahedron"):
        line = _line(2 if cell_type == "hexahedron" else 3)
        return _times(_times(line, line), line)
    if cell_type == "wedge":
        return _times(_corner_rule(2), _line(2))
    if cell_type == "tetra10" and (of_products or curved):
        return simplex_rule(3 if of_products else 2, 3)
    return _corner_rule(3)
