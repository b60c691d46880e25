"""Thin walls of a mesh: how thick the body is behind each part of its surface, and how coarse the cells are there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .mesh import Array, FacetSet, Mesh

_MOST = 400  # facets looked at: every so many of a larger surface
_OPPOSED = -0.5  # cosine between the normals of two sides of a wall
_REACH = 0.6  # of both facets' longest edges: how far apart, across the wall, two opposite facets may stand


@dataclass(frozen=True)
class Walls:
    """Facets of a surface and the wall behind each.

    Attributes
    ----------
    area : (n,), m2. thickness : (n,) distance to the opposite side, m, infinite where there is none.
    length : (n,) edge of the facet that counts in bending, m: the longest of quadrilaterals, the mean of triangles.
    kind : (n,) of the facet, as in ``FacetBlock``.
    """

    area: Array
    thickness: Array
    length: Array
    kind: NDArray[np.str_]


@dataclass(frozen=True)
class _Facets:
    centre: Array
    normal: Array
    area: Array
    longest: Array
    mean: Array
    kind: NDArray[np.str_]

    def picked(self, rows: NDArray[np.intp]) -> _Facets:
        return _Facets(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))


def walls(mesh: Mesh, surface: FacetSet, mirrors: list[tuple[FacetSet, NDArray[np.bool_]]]) -> Walls:
    """Walls behind a surface of the mesh.

    Parameters
    ----------
    surface : all boundary facets. mirrors : faces that cannot move along some axes (flags (3,)): facets that face
        along these are no side of a wall, because the wall cannot bend towards them.
    """
    facets = _facets(mesh, surface)
    keep = np.ones(len(facets.area), dtype=bool)
    for face, axes in mirrors:
        nodes = face.nodes
        held = np.concatenate([np.isin(b.corners, nodes).all(axis=1) for b in surface.blocks])
        keep &= ~held | ((facets.normal[:, axes] ** 2).sum(axis=1) < 0.9)
    free = facets.picked(np.flatnonzero(keep))
    n = len(free.area)
    some = free.picked(np.arange(0, n, max(1, -(-n // _MOST))))
    thickness = np.full(len(some.area), np.inf)
    for i in range(len(thickness)):
        apart = some.centre[i] - free.centre
        depth = apart @ some.normal[i]
        aside = np.sqrt(np.maximum((apart**2).sum(axis=1) - depth**2, 0.0))
        behind = (free.normal @ some.normal[i] < _OPPOSED) & (depth > 0)
        behind &= aside <= _REACH * (some.longest[i] + free.longest)
        thickness[i] = depth[behind].min(initial=np.inf)
    length = np.where(np.char.startswith(some.kind, "tri"), some.mean, some.longest)
    return Walls(some.area, thickness, length, some.kind)


def _facets(mesh: Mesh, surface: FacetSet) -> _Facets:
    parts = []
    for block in surface.blocks:
        x = mesh.nodes[block.corners]
        n = x.shape[1]
        edges = np.linalg.norm(x[:, [*range(1, n), 0]] - x, axis=2)
        vector = 0.5 * np.cross(x[:, 2] - x[:, 0], x[:, n - 1] - x[:, 1])
        area = np.linalg.norm(vector, axis=1)
        normal = vector / np.where(area > 0, area, 1.0)[:, None]
        kinds = np.full(len(x), block.kind)
        parts.append((x.mean(axis=1), normal, area, edges.max(axis=1), edges.mean(axis=1), kinds))
    return _Facets(*(np.concatenate(column) for column in zip(*parts, strict=True)))
