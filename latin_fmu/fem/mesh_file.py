"""Meshes of substructures from mesh files: one volume group, its named faces, cells turned right side out."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from ..errors import MeshError, Problem
from ..mesh_files.content import MeshContent, listed
from ..mesh_files.reading import read_content
from .mesh import Array, CellBlock, FacetSet, Index, Mesh, boundary

_FAR = 1e60  # m; products of three such lengths are still numbers
_VOLUME = ("hexahedron", "tetra")


def read_mesh(path: Path, group: str | None = None, scale: float = 1.0) -> Mesh:
    """Read the volume ``group`` (all volume cells when None) and the named faces on its surface.

    Parameters
    ----------
    path : mesh file. group : name of a volume group. scale : metres per unit of the file.

    Raises
    ------
    MeshError : unreadable file, other cell types, unknown group, inverted or flat cells, no volume.
    """
    return mesh_of(read_content(path), path.name, group, scale)


def mesh_of(content: MeshContent, where: str, group: str | None = None, scale: float = 1.0) -> Mesh:
    """Mesh of one volume group of a file that has been read (parameters and errors: ``read_mesh``)."""
    chosen = _volume_cells(content, group, where)
    node_ids, inverse = np.unique(np.concatenate([c.ravel() for c in chosen.values()]), return_inverse=True)
    nodes = np.ascontiguousarray(content.points[node_ids], dtype=float) * scale
    if not np.all(np.abs(nodes) < _FAR):
        raise MeshError([Problem(where, "node coordinates are not finite")], "unusable mesh")
    blocks, start = [], 0
    for cell_type, cells in chosen.items():
        own = inverse[start : start + cells.size].reshape(cells.shape).astype(np.int64)
        start += cells.size
        blocks.append(CellBlock(cell_type, _oriented(nodes, own, cell_type, where)))
    renumber = np.full(len(content.points), -1, dtype=np.int64)
    renumber[node_ids] = np.arange(len(node_ids))
    bare = Mesh(nodes, tuple(blocks), {})
    return Mesh(nodes, bare.blocks, _named_faces(content, renumber, boundary(bare)))


def _volume_cells(content: MeshContent, group: str | None, where: str) -> dict[str, Index]:
    """Connectivity of the wanted volume by cell type."""
    if group is not None and group not in content.volumes:
        raise MeshError(
            [
                Problem(
                    where,
                    "no such volume group",
                    group,
                    allowed=listed(content.volumes),
                    remedy=_no_group(content),
                )
            ]
        )
    blocks = dict(content.solids)
    if group is not None:
        blocks = {kind: content.solids[kind][rows] for kind, rows in content.volumes[group].items()}
    blocks = {kind: cells for kind, cells in blocks.items() if len(cells)}
    if not blocks:
        skipped = ", ".join(f"{count} {kind}" for kind, count in content.skipped.items())
        raise MeshError(
            [Problem(where, "the mesh holds no volume cells", skipped or None, allowed=", ".join(_VOLUME))]
        )
    if [t for t in blocks if t not in _VOLUME] or len(blocks) > 1:
        raise MeshError(
            [Problem(where, "cell types not supported in one substructure", ", ".join(blocks),
                     "8-node hexahedra or 4-node tetrahedra, one type per substructure",
                     "export linear elements, or split the part by cell type")]
        )  # fmt: skip
    return blocks


def _no_group(content: MeshContent) -> str | None:
    """What to do where a file names no volume."""
    if content.volumes:
        return None
    return "leave group out to take the whole file" if content.solids else "the file holds no solid cells"


# At each corner, the neighbours along three edges, in right-handed order.
_CORNERS: Final = {
    "hexahedron": (
        (0, 1, 3, 4), (1, 2, 0, 5), (2, 3, 1, 6), (3, 0, 2, 7),
        (4, 7, 5, 0), (5, 4, 6, 1), (6, 5, 7, 2), (7, 6, 4, 3),
    ),
    "tetra": ((0, 1, 2, 3),),
}  # fmt: skip


def _oriented(nodes: Array, cells: Index, cell_type: str, where: str) -> Index:
    """Cells numbered inside out are turned; flat or tangled ones are refused (Jacobian at the corners)."""
    ratios = []
    for corner, *neighbours in _CORNERS[cell_type]:
        a, b, c = (nodes[cells[:, i]] - nodes[cells[:, corner]] for i in neighbours)
        volume = np.einsum("ij,ij->i", np.cross(a, b), c)
        size = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1) * np.linalg.norm(c, axis=1)
        ratios.append(volume / np.where(size > 0, size, 1.0))
    low, high = np.min(ratios, axis=0), np.max(ratios, axis=0)
    bad = ~((low > 1e-12) | (high < -1e-12))
    if bad.any():
        raise MeshError(
            [Problem(where, f"{int(bad.sum())} cells have no volume or are tangled", f"first cell {int(bad.argmax())}",
                     "a positive Jacobian at every corner", "repair the mesh where it is distorted")]
        )  # fmt: skip
    cells = cells.copy()
    turned = high < 0
    swap = [0, 3, 2, 1, 4, 7, 6, 5] if cell_type == "hexahedron" else [0, 2, 1, 3]
    cells[turned] = cells[turned][:, swap]
    return cells


def _named_faces(content: MeshContent, renumber: Index, surface: FacetSet) -> dict[str, FacetSet]:
    """Named surface groups whose facets are on the boundary of this volume, oriented outwards.

    A node set names the facets that have all their corners in it, where no surface group has its name.
    """
    outward = {
        tuple(sorted(corners)): (block.kind, row)
        for block in surface.blocks
        for row, corners in enumerate(block.corners.tolist())
    }
    by_kind = {block.kind: block.facets for block in surface.blocks}
    faces: dict[str, FacetSet] = {}
    for name, tables in content.facets.items():
        found: dict[tuple[str, int], None] = {}  # in the order of the file, each facet once
        for table in tables:
            for corners in renumber[table].tolist():
                match = outward.get(tuple(sorted(corners)))
                if match is not None:
                    found[match] = None
        _add_face(faces, name, list(found), by_kind)
    for name, rows in content.node_sets.items():
        if name in faces or name in content.facets:
            continue
        inside = np.zeros(len(renumber) + 1, dtype=bool)
        inside[renumber[rows]] = True
        inside[-1] = False  # nodes of other bodies
        whole = [
            (block.kind, int(row))
            for block in surface.blocks
            for row in np.flatnonzero(inside[block.corners].all(axis=1))
        ]
        _add_face(faces, name, whole, by_kind)
    return faces


def _add_face(
    faces: dict[str, FacetSet], name: str, found: list[tuple[str, int]], by_kind: dict[str, Index]
) -> None:
    """The face made of boundary facets given by kind and row, if there are any."""
    kinds = dict.fromkeys(kind for kind, _ in found)
    if kinds:
        faces[name] = FacetSet.of(*(by_kind[kind][[row for k, row in found if k == kind]] for kind in kinds))
