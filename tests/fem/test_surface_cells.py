"""Triangles and quadrilaterals between the points of an interface."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csr_array

from latin_fmu.fem.faces import Surface, cells_between
from latin_fmu.fem.mesh import FacetSet

from .meshes import TYPES, typed_box


def area_of(cells: np.ndarray, points: np.ndarray) -> float:
    """Area of triangles and quadrilaterals (plane ones)."""
    fourth = np.where(cells[:, 3] < 0, cells[:, 0], cells[:, 3])
    a, b, c, d = points[cells[:, 0]], points[cells[:, 1]], points[cells[:, 2]], points[fourth]
    return float(0.5 * np.linalg.norm(np.cross(c - a, d - b), axis=1).sum())


@pytest.mark.parametrize("cell_type", TYPES)
def test_cells_cover_the_face(cell_type: str) -> None:
    mesh = typed_box(cell_type)
    facets = mesh.faces["zmax"]
    nodes = facets.nodes
    weights = np.zeros((len(nodes), mesh.n_node))
    weights[np.arange(len(nodes)), nodes] = 1.0
    cells = cells_between(facets, csr_array(weights))
    assert area_of(cells, mesh.nodes[nodes]) == pytest.approx(Surface(mesh.nodes, facets).area, rel=1e-12)
    assert np.unique(cells[cells >= 0]).tolist() == list(range(len(nodes)))


def test_nodes_of_one_point_leave_smaller_cells() -> None:
    """Two neighbouring corners in one point: the quadrilateral becomes a triangle, the next one stays."""
    mesh = typed_box("hexahedron", (2, 1, 1))
    facets = mesh.faces["zmax"]
    nodes = facets.nodes  # two rows of three
    weights = np.zeros((5, mesh.n_node))
    weights[[0, 0, 1, 2, 3, 4], nodes[[0, 3, 1, 2, 4, 5]]] = [0.5, 0.5, 1.0, 1.0, 1.0, 1.0]
    cells = cells_between(facets, csr_array(weights))
    assert sorted(sorted(c for c in cell if c >= 0) for cell in cells.tolist()) == [[0, 1, 3], [1, 2, 3, 4]]


@pytest.mark.parametrize(("corners", "left"), [((0, 1), 2), ((1, 2), 2), ((0, 2), 2)])
def test_a_triangle_with_two_corners_in_one_point_is_left_out(corners: tuple[int, int], left: int) -> None:
    facets = FacetSet.of(np.array([[0, 1, 2], [3, 4, 5], [2, 4, 3]]))
    weights = np.zeros((5, 6))
    points = {n: i for i, n in enumerate(sorted({0, 1, 2} - {corners[1]}))}
    points |= {corners[1]: points[corners[0]], 3: 2, 4: 3, 5: 4}
    for node, point in points.items():
        weights[point, node] = 0.5
    cells = cells_between(facets, csr_array(weights))
    assert len(cells) == left
    assert points[3] in cells[0]
