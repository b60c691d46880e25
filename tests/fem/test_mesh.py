"""Tables of reference cells, boundary of a mesh, connectivity of mixed meshes in one table."""

from __future__ import annotations

import numpy as np
import pytest

from latin_fmu.fem.mesh import CellBlock, Mesh, boundary, box_mesh, cell_blocks, padded_cells
from latin_fmu.fem.reference_cells import CELL_EDGES, CELL_FACES, N_CORNER, N_NODE, cell_functions

COUNTS = {
    "hexahedron": (8, 8),
    "tetra": (4, 4),
    "tetra10": (10, 4),
    "hexahedron20": (20, 8),
    "hexahedron27": (27, 8),
    "wedge": (6, 6),
    "wedge15": (15, 6),
    "wedge18": (18, 6),
    "pyramid": (5, 5),
    "pyramid13": (13, 5),
}


@pytest.mark.parametrize("cell_type", COUNTS)
def test_tables_of_a_cell_fit_together(cell_type: str) -> None:
    """Euler's V - E + F = 2; every edge in two faces, in opposite turns; its middle node between its ends."""
    assert (N_NODE[cell_type], N_CORNER[cell_type]) == COUNTS[cell_type]
    faces, edges = CELL_FACES[cell_type], CELL_EDGES[cell_type]
    assert N_CORNER[cell_type] - len(edges) + len(faces) == 2
    turns = []
    for face in faces:
        n = {3: 3, 6: 3, 4: 4, 8: 4, 9: 4}[len(face)]
        turns += list(zip(face[:n], (*face[1:n], face[0]), strict=True))
        for i, middle in enumerate(face[n : 2 * n]):
            assert set(edges[middle - N_CORNER[cell_type]]) == {face[i], face[(i + 1) % n]}
    assert len(set(turns)) == len(turns)
    assert {(b, a) for a, b in turns} == set(turns)
    assert {frozenset(t) for t in turns} == {frozenset(e) for e in edges}


def hexahedron_beside_wedges() -> Mesh:
    """A cube and, on its face x = 1, another one cut in two wedges."""
    box = box_mesh(np.zeros(3), np.array([2.0, 1.0, 1.0]), (2, 1, 1))
    first, second = box.blocks[0].cells
    wedges = second[[[0, 1, 3, 4, 5, 7], [1, 2, 3, 5, 6, 7]]]
    return Mesh(box.nodes, (CellBlock("hexahedron", first[None]), CellBlock("wedge", wedges)), {})


def test_boundary_of_a_mixed_mesh_is_closed() -> None:
    mesh = hexahedron_beside_wedges()
    skin = boundary(mesh)
    assert {b.kind: len(b.facets) for b in skin.blocks} == {"quad": 8, "triangle": 4}
    assert skin.n_facet == 12
    total, volume = np.zeros(3), 0.0
    for block in skin.blocks:
        x = mesh.nodes[block.facets]
        for i in range(1, x.shape[1] - 1):
            normal = 0.5 * np.cross(x[:, i] - x[:, 0], x[:, i + 1] - x[:, 0])
            total += normal.sum(axis=0)
            volume += float(np.sum(normal * (x[:, 0] + x[:, i] + x[:, i + 1]))) / 9
    np.testing.assert_allclose(total, 0.0, atol=1e-15)
    assert volume == pytest.approx(2.0, rel=1e-14)


def test_boundary_of_a_box_is_its_six_faces() -> None:
    mesh = box_mesh(np.zeros(3), np.ones(3), (2, 3, 2))
    named = {tuple(sorted(f)) for s in mesh.faces.values() for f in s.blocks[0].facets.tolist()}
    (skin,) = boundary(mesh).blocks
    assert {tuple(sorted(f)) for f in skin.facets.tolist()} == named
    assert len(skin.facets) == len(named)


def test_one_table_holds_cells_of_all_types() -> None:
    blocks = hexahedron_beside_wedges().blocks
    table = padded_cells(blocks)
    assert table.shape == (3, 8)
    read_back = cell_blocks(table)
    assert [b.cell_type for b in read_back] == ["hexahedron", "wedge"]
    for block, back in zip(blocks, read_back, strict=True):
        np.testing.assert_array_equal(block.cells, back.cells)
    assert padded_cells(blocks[:1]) is blocks[0].cells


# Nodes beyond the corners, as the documentation of VTK draws them: ends of their edge, corners of their face.
VTK_EDGES = {
    "tetra10": "01 12 02 03 13 23",
    "hexahedron20": "01 12 23 30 45 56 67 74 04 15 26 37",
    "hexahedron27": "01 12 23 30 45 56 67 74 04 15 26 37 0473 1265 0154 3762 0321 4567 01234567",
}


@pytest.mark.parametrize("cell_type", VTK_EDGES)
def test_nodes_stand_where_vtk_has_them(cell_type: str) -> None:
    nodes = cell_functions(cell_type).nodes
    for node, corners in zip(nodes[N_CORNER[cell_type] :], VTK_EDGES[cell_type].split(), strict=True):
        np.testing.assert_allclose(node, nodes[[int(c) for c in corners]].mean(axis=0), atol=1e-15)
