"""Meshes from files: 8-node hexahedra and 4-node tetrahedra with named groups, read with meshio."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path
from typing import Final

import meshio
import numpy as np

from ..errors import MeshError, Problem
from .cells import CELL_FACES
from .mesh import Array, Index, Mesh

_VOLUME = ("hexahedron", "tetra")
_SURFACE: Final = {"quad": "hexahedron", "triangle": "tetra"}
_HARMLESS = ("vertex", "line")


def read_mesh(path: Path, group: str | None = None, scale: float = 1.0) -> Mesh:
    """Read the volume ``group`` (all volume cells when None) and the named faces on its surface.

    Parameters
    ----------
    path : file in a format of meshio that keeps named groups (.msh, .inp).
    group : name of a volume group. scale : metres per unit of the file.

    Raises
    ------
    MeshError : unreadable file, other cell types, unknown group, inverted or flat cells, no volume.
    """
    file = load(path)
    where = str(path.name)
    names = _group_cells(file)
    used = _volume_cells(file, names, group, where)
    cell_type = used[0]
    cells = used[1]
    node_ids, inverse = np.unique(cells, return_inverse=True)
    cells = inverse.reshape(cells.shape).astype(np.int64)
    nodes = np.ascontiguousarray(file.points[node_ids][:, :3], dtype=float) * scale
    if not np.all(np.isfinite(nodes)):
        raise MeshError([Problem(where, "node coordinates are not finite")], "unusable mesh")
    cells = _oriented(nodes, cells, cell_type, where)
    renumber = np.full(len(file.points), -1, dtype=np.int64)
    renumber[node_ids] = np.arange(len(node_ids))
    return Mesh.uniform(nodes, cell_type, cells, _named_faces(file, names, renumber, cells, cell_type))


def load(path: Path) -> meshio.Mesh:
    """Read any file meshio knows; its ``sys.exit`` on bad files becomes a MeshError.

    Raises
    ------
    MeshError : missing or unreadable file.
    """
    if not path.is_file():
        raise MeshError(
            [Problem(path.name, "no such mesh file", remedy="the path is relative to the scene file")]
        )
    noise = io.StringIO()
    try:
        with contextlib.redirect_stdout(noise), contextlib.redirect_stderr(noise):
            return meshio.read(path)
    except (Exception, SystemExit) as error:  # meshio raises many kinds and calls sys.exit on bad input
        reason = (noise.getvalue().strip().splitlines() or [str(error)])[-1] or type(error).__name__
        raise MeshError(
            [
                Problem(
                    path.name, f"meshio cannot read this file: {reason}", allowed="a mesh format of meshio"
                )
            ],
            "unreadable mesh",
        ) from None


def _group_cells(file: meshio.Mesh) -> dict[str, list[Index]]:
    """Cells of every named group: for each cell block, the indices that belong to it."""
    groups: dict[str, list[Index]] = {}
    for name, blocks in file.cell_sets.items():
        if name.startswith("gmsh:"):
            continue
        found = [np.asarray([] if b is None else b, dtype=np.int64) for b in blocks]
        # a set written before later blocks names no cell of them
        groups[name] = found + [np.zeros(0, dtype=np.int64)] * (len(file.cells) - len(found))
    physical = file.cell_data.get("gmsh:physical")
    if physical is not None:
        for name, (tag, dim) in file.field_data.items():
            if name in groups:
                continue
            groups[name] = [
                np.flatnonzero(np.asarray(tags) == tag)
                if _dim(block.type) == dim
                else np.zeros(0, dtype=np.int64)
                for block, tags in zip(file.cells, physical, strict=True)
            ]
    return groups


def _dim(cell_type: str) -> int:
    """Topological dimension of a meshio cell type."""
    return int(meshio._mesh.topological_dimension.get(cell_type, -1))


def _volume_cells(
    file: meshio.Mesh, names: dict[str, list[Index]], group: str | None, where: str
) -> tuple[str, Index]:
    """Connectivity of the wanted volume, of one cell type."""
    volumes = [
        n
        for n, sel in names.items()
        if any(len(s) and _dim(b.type) == 3 for b, s in zip(file.cells, sel, strict=True))
    ]
    if group is not None and group not in volumes:
        raise MeshError(
            [Problem(where, "no such volume group", group, allowed=", ".join(sorted(volumes)) or "none")]
        )
    blocks: dict[str, list[Index]] = {}
    for i, block in enumerate(file.cells):
        chosen = block.data if group is None else block.data[names[group][i]]
        if _dim(block.type) == 3 and len(chosen):
            blocks.setdefault(block.type, []).append(np.asarray(chosen, dtype=np.int64))
    if not blocks:
        raise MeshError([Problem(where, "the mesh holds no volume cells", allowed=", ".join(_VOLUME))])
    refused = [t for t in blocks if t not in _VOLUME]
    if refused or len(blocks) > 1:
        raise MeshError(
            [Problem(where, "cell types not supported in one substructure", ", ".join(blocks),
                     "8-node hexahedra or 4-node tetrahedra, one type per substructure",
                     "export linear elements, or split the part by cell type")]
        )  # fmt: skip
    cell_type = next(iter(blocks))
    return cell_type, np.concatenate(blocks[cell_type])


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


def _named_faces(
    file: meshio.Mesh, names: dict[str, list[Index]], renumber: Index, cells: Index, cell_type: str
) -> dict[str, Index]:
    """Named surface groups whose facets belong to this volume, oriented outwards."""
    outward: dict[tuple[int, ...], tuple[int, ...] | None] = {}
    for local in CELL_FACES[cell_type]:
        for facet in map(tuple, cells[:, list(local)].tolist()):
            key = tuple(sorted(facet))
            outward[key] = None if key in outward else facet  # shared by two cells: inside the volume
    faces: dict[str, Index] = {}
    for name, selections in names.items():
        facets: dict[tuple[int, ...], tuple[int, ...]] = {}
        for block, chosen in zip(file.cells, selections, strict=True):
            if _SURFACE.get(block.type) != cell_type or not len(chosen):
                continue
            for key in (tuple(sorted(f)) for f in renumber[block.data[chosen]].tolist()):
                match = outward.get(key)
                if match is not None:
                    facets[key] = match
        if facets:
            faces[name] = np.asarray(list(facets.values()), dtype=np.int64)
    return faces
