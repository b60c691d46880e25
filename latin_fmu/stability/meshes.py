"""Boxes of any type of cells as mesh files, turned in space if wanted; faces xmin ... zmax as named groups."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from ..fem.mesh import FacetSet, Mesh, boundary, box_mesh
from ..fem.reference_cells import CELL_EDGES, FACET_KIND, HEX_FACES
from ..latin.outcome import Array

KUHN: Final = ((0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6))
WEDGES: Final = ((0, 1, 3, 4, 5, 7), (1, 2, 3, 5, 6, 7))
LINEAR: Final = {"tetra10": "tetra", "hexahedron20": "hexahedron", "hexahedron27": "hexahedron"}


def typed_box(cell_type: str, origin: Array, size: Array, elements: tuple[int, int, int]) -> Mesh:
    """Box of cells of one type with its six faces."""
    box = box_mesh(np.asarray(origin, float), np.asarray(size, float), elements)
    cells = box.blocks[0].cells
    corner = LINEAR.get(cell_type, cell_type)
    if corner == "tetra":
        cells = cells[:, KUHN].reshape(-1, 4)
    elif corner == "wedge":
        cells = cells[:, WEDGES].reshape(-1, 6)
    nodes = box.nodes
    if cell_type != corner:
        groups = [np.array(CELL_EDGES[corner])]
        if cell_type == "hexahedron27":
            groups += [np.array(HEX_FACES), np.arange(8)[None]]
        parts, places, count = [cells], [nodes], len(nodes)
        for group in groups:
            keys = np.sort(cells[:, group], axis=2).reshape(-1, group.shape[1])
            unique, inverse = np.unique(keys, axis=0, return_inverse=True)
            places.append(nodes[unique].mean(axis=1))
            parts.append(count + inverse.reshape(len(cells), -1))
            count += len(unique)
        nodes, cells = np.concatenate(places), np.concatenate(parts, axis=1)
    mesh = Mesh.uniform(nodes, cell_type, cells)
    return Mesh(nodes, mesh.blocks, _box_faces(mesh))


def _box_faces(mesh: Mesh) -> dict[str, FacetSet]:
    low, high, skin, faces = mesh.nodes.min(axis=0), mesh.nodes.max(axis=0), boundary(mesh), {}
    for axis, letter in enumerate("xyz"):
        for end, value in (("min", low[axis]), ("max", high[axis])):
            near = 1e-9 * np.ptp(mesh.nodes[:, axis])
            on = [b.facets[(np.abs(mesh.nodes[b.facets][..., axis] - value) < near).all(axis=1)] for b in skin.blocks]
            faces[letter + end] = FacetSet.of(*(f for f in on if len(f)))
    return faces


def write_mesh(file: Path, mesh: Mesh, place: Callable[[Array], Array] | None = None) -> None:
    """Volume group "body" and the faces as surface groups; ``place`` moves the nodes."""
    import meshio

    tags = {name: i + 2 for i, name in enumerate(mesh.faces)}
    cells, marks = [], []
    for name, face in mesh.faces.items():
        for block in face.blocks:
            cells.append((FACET_KIND[block.facets.shape[1]], block.facets))
            marks.append(np.full(len(block.facets), tags[name]))
    for volume in mesh.blocks:
        cells.append((volume.cell_type, volume.cells))
        marks.append(np.ones(len(volume.cells), dtype=np.int64))
    made = meshio.Mesh(
        mesh.nodes if place is None else place(mesh.nodes),
        cells,
        cell_data={"gmsh:physical": marks, "gmsh:geometrical": marks},
        field_data={"body": np.array([1, 3]), **{n: np.array([t, 2]) for n, t in tags.items()}},
    )
    meshio.write(file, made, file_format="gmsh22", binary=True)


def turned(axis: Array, degrees: float) -> Array:
    """Rotation matrix (3, 3)."""
    n = np.asarray(axis, float) / np.linalg.norm(axis)
    angle = np.radians(degrees)
    cross = np.array([[0, -n[2], n[1]], [n[2], 0, -n[0]], [-n[1], n[0], 0]])
    rotation: Array = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return rotation


def tube(
    cell_type: str, radii: tuple[float, float], length: float, elements: tuple[int, int, int], start: float = 0.0
) -> Mesh:
    """Closed tube about z with elements along radius, circumference and axis; faces "inner", "outer", "foot", "top"."""
    n_radius, n_round, n_along = elements
    box = typed_box(cell_type, np.zeros(3), np.ones(3), (n_radius, n_round, n_along))
    seam = np.where(box.nodes[:, 1] > 1 - 1e-9, 0.0, box.nodes[:, 1])
    keys = np.round(np.column_stack([box.nodes[:, 0], seam, box.nodes[:, 2]]), 9)
    _, first, number = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    number = number.ravel()
    names = {"xmin": "inner", "xmax": "outer", "zmin": "foot", "zmax": "top"}
    faces = {name: FacetSet.of(*(number[b.facets] for b in box.faces[old].blocks)) for old, name in names.items()}
    across, around, along = box.nodes[first].T
    radius, angle = radii[0] + (radii[1] - radii[0]) * across, 2 * np.pi * around + start
    places = np.stack([radius * np.cos(angle), radius * np.sin(angle), length * along], axis=1)
    blocks = Mesh.uniform(places, cell_type, number[box.blocks[0].cells]).blocks
    return Mesh(places, blocks, faces)
