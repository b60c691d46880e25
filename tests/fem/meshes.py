"""Small meshes of every type of cell, made from a box of 8-node hexahedra."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from latin_fmu.fem.mesh import Array, CellBlock, FacetSet, Mesh, boundary, box_mesh
from latin_fmu.fem.mesh_file import mesh_of
from latin_fmu.fem.reference_cells import CELL_EDGES, CELL_FACES, HEX_FACES, WEDGE_FACES
from latin_fmu.mesh_files.reading import read_content

ORIGIN, SIZE = np.array([0.3, -0.2, 0.1]), np.array([1.0, 0.8, 1.5])
# Six tetrahedra of a hexahedron around the diagonal 0-6; neighbours cut their common face alike.
KUHN = ((0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6))
WEDGES = ((0, 1, 3, 4, 5, 7), (1, 2, 3, 5, 6, 7))
TYPES = (
    "hexahedron",
    "tetra",
    "tetra10",
    "hexahedron20",
    "hexahedron27",
    "wedge",
    "wedge15",
    "wedge18",
    "pyramid",
    "pyramid13",
    "mixed",
)
IN_MSH = tuple(kind for kind in TYPES if kind not in ("wedge18", "pyramid13"))
"""Types that meshio reads from a .msh file in the order of their nodes."""
QUADRATIC = ("tetra10", "hexahedron20", "hexahedron27", "wedge15", "wedge18", "pyramid13")


def cut(mesh: Mesh, cell_type: str) -> Mesh:
    """The same box of another type of cells, faces cut with them; "mixed": hexahedra and wedges side by side."""
    (block,) = mesh.blocks
    if cell_type in ("tetra", "tetra10"):
        converted = Mesh.uniform(mesh.nodes, "tetra", block.cells[:, KUHN].reshape(-1, 4))
    elif cell_type.startswith("wedge"):
        converted = Mesh.uniform(mesh.nodes, "wedge", block.cells[:, WEDGES].reshape(-1, 6))
    elif cell_type.startswith("pyramid"):
        apex = mesh.n_node + np.arange(len(block.cells))
        sides = block.cells[:, np.array(HEX_FACES)[:, ::-1]]
        cells = np.concatenate([sides, np.repeat(apex, 6).reshape(-1, 6, 1)], axis=2).reshape(-1, 5)
        converted = Mesh.uniform(np.concatenate([mesh.nodes, mesh.nodes[block.cells].mean(axis=1)]), "pyramid", cells)
    elif cell_type == "mixed":
        middle = mesh.nodes[block.cells].mean(axis=1)
        upper = middle[:, 0] > mesh.nodes[:, 0].min() + 0.5 * np.ptp(mesh.nodes[:, 0])
        wedges = CellBlock("wedge", block.cells[upper][:, WEDGES].reshape(-1, 6))
        converted = Mesh(mesh.nodes, (CellBlock("hexahedron", block.cells[~upper]), wedges), {})
    else:
        converted = mesh
    if cell_type in QUADRATIC:
        converted = with_middle_nodes(converted, cell_type)
    return replace(converted, faces=box_faces(converted))


def with_middle_nodes(mesh: Mesh, cell_type: str) -> Mesh:
    """Quadratic cells with straight edges and plane faces as the corners have them."""
    (block,) = mesh.blocks
    groups = [np.array(CELL_EDGES[block.cell_type])]
    if cell_type == "hexahedron27":
        groups += [np.array(HEX_FACES), np.arange(8)[None]]
    if cell_type == "wedge18":
        groups.append(np.array(WEDGE_FACES[2:]))
    nodes, cells = [mesh.nodes], [block.cells]
    count = mesh.n_node
    for group in groups:
        keys = np.sort(block.cells[:, group], axis=2)
        unique, inverse = np.unique(keys.reshape(-1, group.shape[1]), axis=0, return_inverse=True)
        nodes.append(mesh.nodes[unique].mean(axis=1))
        cells.append(count + inverse.reshape(len(block.cells), -1))
        count += len(unique)
    return Mesh.uniform(np.concatenate(nodes), cell_type, np.concatenate(cells, axis=1))


def box_faces(mesh: Mesh) -> dict[str, FacetSet]:
    """The six faces of a box whose boundary nodes stand in its planes."""
    faces = {}
    low, high = mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)
    skin = boundary(mesh)
    for axis, letter in enumerate("xyz"):
        for end, value in (("min", low[axis]), ("max", high[axis])):
            on = [b.facets[np.all(np.abs(mesh.nodes[b.facets][..., axis] - value) < 1e-9, axis=1)] for b in skin.blocks]
            faces[letter + end] = FacetSet.of(*(f for f in on if len(f)))
    return faces


def inner_nodes(mesh: Mesh) -> np.ndarray:
    """Nodes that are on no boundary facet."""
    return np.setdiff1d(np.arange(mesh.n_node), boundary(mesh).nodes)


def skewed(nodes: Array, amplitude: float) -> Array:
    """A smooth map that bends edges and faces; the boundary moves with it."""
    x, y, z = ((nodes - ORIGIN) / SIZE).T
    shift = np.stack([np.sin(2 * y) * z, x * x - z, np.cos(2 * x) * y], axis=1)
    return nodes + amplitude * SIZE * shift


def typed_box(cell_type: str, elements: tuple[int, int, int] = (3, 3, 3), shift: float = 0.0) -> Mesh:
    """Box of a type of cells; corners inside are moved at random by a fraction of the element size."""
    box = box_mesh(ORIGIN, SIZE, elements)
    inside = np.all((box.nodes > ORIGIN + 1e-9) & (box.nodes < ORIGIN + SIZE - 1e-9), axis=1)
    move = np.random.default_rng(11).uniform(-1.0, 1.0, box.nodes.shape) * SIZE / np.array(elements) * shift
    return cut(replace(box, nodes=box.nodes + inside[:, None] * move), cell_type)


def places_of(cell_type: str) -> Array:
    """Nodes of the reference cell, as places in space: of a pyramid not by the coordinates of its hexahedron."""
    from latin_fmu.fem.reference_cells import cell_functions

    nodes = cell_functions(cell_type).nodes.copy()
    if cell_type == "pyramid13":
        nodes[5:] = [nodes[list(edge)].mean(axis=0) for edge in CELL_EDGES[cell_type]]
    return nodes


def reference_cell(cell_type: str) -> Mesh:
    """One cell of the type, every face a face of the mesh."""
    nodes = places_of(cell_type)
    faces = {str(i): FacetSet.of(np.array([local])) for i, local in enumerate(CELL_FACES[cell_type])}
    return Mesh(nodes, (CellBlock(cell_type, np.arange(len(nodes))[None]),), faces)


def read_mesh(path: Path, group: str | None = None, scale: float = 1.0) -> Mesh:
    """Mesh of one volume group of a mesh file."""
    return mesh_of(read_content(path), path.name, group, scale)
