"""Facets between the elements of a body, and its sections across an axis along them.

A facet between two elements is cut by the planes between their centres. A section is a connected set of facets that one
plane cuts.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ..fem.elements import Elements
from ..fem.faces import face_of
from ..fem.mesh import Array, FacetSet, Index, Mesh
from ..fem.reference_cells import CELL_FACES, FACET_CORNERS, FACET_KIND, N_CORNER
from .body import Body

_WIDEST: Final = 9  # nodes of a facet
SAME: Final = 1e-9
"""Of the length of a body: levels that are equal."""


class ShankFacets:
    """Sections of a body across an axis.

    Attributes
    ----------
    body : cut. axis : (3,) unit vector. heights : (n_node,) of its nodes along the axis, m. bottom, length : of these,
        m. cells : corners of the elements, by block. levels : (n_cell,) of the centres of the elements. below, above :
        elements at each inner facet, by their levels. facets : (n, 9) its nodes, oriented out of the lower element,
        filled with -1. low, high : (n,) levels of these elements.
    """

    def __init__(self, body: Body, axis: Array) -> None:
        self.body, self.axis = body, axis
        mesh = body.mesh
        self.heights = mesh.nodes @ axis
        self.bottom, self.length = float(self.heights.min()), float(np.ptp(self.heights))
        self.cells = [block.cells[:, : N_CORNER[block.cell_type]] for block in mesh.blocks]
        self.levels = self.level(np.concatenate([self.heights[c].mean(axis=1) for c in self.cells]))
        self.below, self.above, self.facets = self._inner_facets(mesh)
        self.low, self.high = self.levels[self.below], self.levels[self.above]

    def level(self, height: Array) -> Array:
        """Heights as shares of the length of the body, equal where they differ by round-off."""
        return np.asarray(np.round((height - self.bottom) / (self.length * SAME)) * SAME)

    def _inner_facets(self, mesh: Mesh) -> tuple[Index, Index, Index]:
        """Elements below and above each facet between two elements, and its nodes (n, 9), oriented out of the lower
        element, filled with -1."""
        tables, owners, first = [], [], 0
        for block in mesh.blocks:
            for local in CELL_FACES[block.cell_type]:
                nodes = np.full((len(block.cells), _WIDEST), -1, dtype=np.int64)
                nodes[:, : len(local)] = block.cells[:, list(local)]
                tables.append(nodes)
                # the number of an element counts through all blocks
                owners.append(first + np.arange(len(block.cells)))
            first += len(block.cells)
        facets, owner = np.concatenate(tables), np.concatenate(owners)
        width = (facets >= 0).sum(axis=1)
        corners = np.array([FACET_CORNERS[FACET_KIND[n]] if n in FACET_KIND else 0 for n in range(_WIDEST + 1)])[width]
        # the corners, sorted: both elements have them, in different order
        keys = np.sort(np.where(np.arange(4) < corners[:, None], facets[:, :4], -1), axis=1)
        order = np.lexsort(keys.T)
        same = np.flatnonzero((keys[order[1:]] == keys[order[:-1]]).all(axis=1))
        one, two = order[same], order[same + 1]
        upside = self.levels[owner[one]] > self.levels[owner[two]]
        one, two = np.where(upside, two, one), np.where(upside, one, two)
        return owner[one], owner[two], facets[one]

    def projected_areas(self) -> Array:
        """Area of each inner facet across the axis, positive out of the lower element, m2."""
        areas = np.zeros(len(self.facets))
        width = (self.facets >= 0).sum(axis=1)
        for n in np.unique(width):
            same_width = np.flatnonzero(width == n)
            places = self.body.mesh.nodes[self.facets[same_width][:, : FACET_CORNERS[FACET_KIND[int(n)]]]]
            arms = places - places[:, :1]
            # a fan of triangles from the first corner
            areas[same_width] = 0.5 * np.cross(arms[:, 1:-1], arms[:, 2:]).sum(axis=1) @ self.axis
        return areas

    def at(self, level: float) -> Index:
        """Facets that the plane at a level cuts."""
        # half open: a plane through the centre of an element is behind it
        return np.flatnonzero((self.low <= level) & (level < self.high))

    def labels(self, chosen: Index) -> Index:
        """Number of the connected section that each of these facets belongs to."""
        nodes = self.facets[chosen]
        # facets of all kinds in one table, -1 where one has fewer nodes
        rows, columns = np.nonzero(nodes >= 0)
        n_node = self.body.mesh.n_node
        # connected where facets share nodes: facets and nodes are the two kinds of vertices of the graph
        links = sp.coo_array(
            (np.ones(len(rows)), (rows, len(chosen) + nodes[rows, columns])), shape=2 * (len(chosen) + n_node,)
        )
        # labels of the facets come first
        return np.asarray(connected_components(links, directed=False)[1][: len(chosen)])

    def centres(self, chosen: Index) -> Array:
        """Means (n, 3) of the nodes of facets, m."""
        return np.stack([self.body.mesh.nodes[row[row >= 0]].mean(axis=0) for row in self.facets[chosen]])

    def nearest(self, chosen: Index, point: Array) -> tuple[Index, float, float, Array]:
        """Of some facets those of the connected section nearest to a point, its distance across the axis, its width,
        m, and the centre (3,) of its nearest facet."""
        label, centres = self.labels(chosen), self.centres(chosen)
        # across the axis alone: the plane fixes the place along it
        distances = np.linalg.norm(across(centres - point, self.axis), axis=1)
        nearest = int(np.argmin(distances))
        mine = label == label[nearest]
        return chosen[mine], float(distances[nearest]), width_of(centres[mine], self.axis), centres[nearest]

    def nodes_of(self, facets: Index) -> Index:
        """Nodes of facets."""
        nodes = np.unique(self.facets[facets])
        return np.asarray(nodes[nodes >= 0])

    def area(self, facets: Index) -> float:
        """Area of facets across the axis, m2."""
        rows = self.facets[facets]
        width = (rows >= 0).sum(axis=1)
        section = FacetSet.of(*(rows[width == n][:, :n] for n in np.unique(width)))
        # facets of a stepped cut: their projections on the plane add up to the section
        return float(abs((face_of(self.body.mesh.nodes, section).vector_areas @ self.axis).sum()))

    def touching(self, nodes: Index) -> np.ndarray:
        """(n_cell,) elements that have some of these nodes."""
        among = np.zeros(self.body.mesh.n_node, dtype=bool)
        among[nodes] = True
        return np.concatenate([among[block.cells].any(axis=1) for block in self.body.mesh.blocks])


def chosen_elements(mesh: Mesh, moduli: Array | None, cells: np.ndarray) -> Elements:
    """Some of the elements (n_cell,) of a mesh, with their relative ``moduli`` (n_cell,)."""
    ends = np.cumsum([len(block.cells) for block in mesh.blocks])[:-1]
    parts = zip(mesh.blocks, np.split(cells, ends), strict=True)
    blocks = tuple(replace(block, cells=block.cells[members]) for block, members in parts if members.any())
    return Elements(Mesh(mesh.nodes, blocks, {}), None if moduli is None else moduli[cells])


def across(vectors: Array, axis: Array) -> Array:
    """Parts (n, 3) of vectors across the axis."""
    return np.asarray(vectors - np.outer(vectors @ axis, axis))


def width_of(places: Array, axis: Array) -> float:
    """Twice the largest distance of points from their middle, across the axis, m."""
    flat = across(places, axis)
    middle = 0.5 * (flat.min(axis=0) + flat.max(axis=0))
    return float(2.0 * np.linalg.norm(flat - middle, axis=1).max())
