"""Meshes of substructures from mesh files: one volume group, its named faces, cells turned right side out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..errors import MeshError, Problem, listed
from ..mesh_files.content import CORNERS, MeshContent
from .elements import jacobians
from .mesh import Array, CellBlock, FacetSet, Index, Mesh, boundary, unjoined
from .reference_cells import CELL_FACES, Rule, cell_functions, cell_rule, mirrored

_FAR = 1e60  # m; products of three such lengths are still numbers
_VOLUME = tuple(CELL_FACES)
_FLAT = 1e-12  # det J over the lengths of its columns


def mesh_of(content: MeshContent, where: str, group: str | None = None, scale: float = 1.0) -> Mesh:
    """The volume ``group`` of a mesh file (all volume cells when None) and the named faces on its surface.

    Parameters
    ----------
    content : of the file. where : its name. group : name of a volume group. scale : metres per unit of the file.

    Raises
    ------
    MeshError : other cell types, unknown group, inverted or flat cells, no volume.
    """
    chosen = _volume_cells(content, group, where)
    node_ids, inverse = np.unique(np.concatenate([c.ravel() for c in chosen.values()]), return_inverse=True)
    nodes = np.ascontiguousarray(content.points[node_ids], dtype=float) * scale
    if not np.all(np.abs(nodes) < _FAR):
        raise MeshError.of("unusable mesh", where, "node coordinates are not finite")
    blocks, start = [], 0
    for cell_type, cells in chosen.items():
        own = inverse[start : start + cells.size].reshape(cells.shape).astype(np.int64)
        start += cells.size
        blocks.append(_right_side_out(nodes, CellBlock(cell_type, own), where))
    renumber = np.full(len(content.points), -1, dtype=np.int64)
    renumber[node_ids] = np.arange(len(node_ids))
    bare = Mesh(nodes, tuple(blocks), {})
    _check_cells(bare, where)
    surface = boundary(bare)
    if not surface.blocks:
        raise MeshError.of("unusable mesh", where, "the volume has no surface: every facet belongs to two cells")
    if len(blocks) > 1 and (apart := unjoined(surface)):
        raise MeshError(
            [
                Problem(
                    where,
                    f"cells of the types {', '.join(bare.cell_types)} share nodes but not facets",
                    f"{apart} facets",
                    "cells that meet in facets of one kind, corner by corner",
                    "mesh them with one type of cells, or make them two parts with a perfect interface",
                )
            ]
        )
    return Mesh(nodes, bare.blocks, _named_faces(content, renumber, surface))


def _volume_cells(content: MeshContent, group: str | None, where: str) -> dict[str, Index]:
    """Connectivity of the volume by cell type."""
    if group is not None and group not in content.volumes:
        raise MeshError(
            [Problem(where, "no such volume group", group, allowed=listed(content.volumes), remedy=_no_group(content))]
        )
    blocks = dict(content.solids)
    if group is not None:
        blocks = {kind: content.solids[kind][rows] for kind, rows in content.volumes[group].items()}
    blocks = {kind: cells for kind, cells in blocks.items() if len(cells)}
    if not blocks:
        skipped = ", ".join(f"{count} {kind}" for kind, count in content.skipped.items())
        raise MeshError([Problem(where, "the mesh holds no volume cells", skipped or None, allowed=", ".join(_VOLUME))])
    unknown = {kind: len(cells) for kind, cells in blocks.items() if kind not in _VOLUME}
    if unknown:
        counts = ", ".join(f"{count} {kind}" for kind, count in unknown.items())
        raise MeshError(
            [
                Problem(
                    where,
                    "cell types that cannot be computed with",
                    counts,
                    ", ".join(_VOLUME),
                    "mesh the part with cells of these types",
                )
            ]
        )
    return blocks


def _no_group(content: MeshContent) -> str | None:
    """Remedy where a file names no volume."""
    if content.volumes:
        return None
    return "leave group out to take the whole file" if content.solids else "the file holds no solid cells"


def _right_side_out(nodes: Array, block: CellBlock, where: str) -> CellBlock:
    """Cells numbered inside out are turned; flat or tangled ones are refused."""
    cells, bad = oriented(nodes, block)
    if bad.any():
        raise MeshError(
            [
                Problem(
                    where,
                    f"{int(bad.sum())} {block.cell_type} cells have no volume or are tangled",
                    f"first cell {int(bad.argmax())}",
                    "a positive Jacobian at every node and integration point",
                    "repair the mesh where it is distorted",
                )
            ]
        )
    return CellBlock(block.cell_type, cells)


def _check_cells(mesh: Mesh, where: str) -> None:
    """Refuse cells that are there twice: their stiffness would count twice, their facets would be no surface."""
    twice = 0
    for block in mesh.blocks:
        corners = np.sort(block.cells[:, : CORNERS[block.cell_type]], axis=1)
        twice += len(corners) - len(np.unique(corners, axis=0))
    if twice:
        problem = Problem(where, "cells with the same corners as others", f"{twice} cells", remedy="leave copies out")
        raise MeshError([problem], "unusable mesh")


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
        matches: dict[tuple[str, int], None] = {}  # in the order of the file, each facet once
        for table in tables:
            for corners in renumber[table].tolist():
                match = outward.get(tuple(sorted(corners)))
                if match is not None:
                    matches[match] = None
        _add_face(faces, name, list(matches), by_kind)
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


def _add_face(faces: dict[str, FacetSet], name: str, rows: list[tuple[str, int]], by_kind: dict[str, Index]) -> None:
    """The face made of boundary facets given by kind and row, if there are any."""
    kinds = dict.fromkeys(kind for kind, _ in rows)
    if kinds:
        faces[name] = FacetSet.of(*(by_kind[kind][[row for k, row in rows if k == kind]] for kind in kinds))


def oriented(nodes: Array, block: CellBlock) -> tuple[Index, NDArray[np.bool_]]:
    """Cells numbered inside out are turned.

    Returns
    -------
    cells (n_cell, n_node), and which of them (n_cell,) have no volume somewhere or change sign, judged by the
    Jacobians at all nodes but those in the middle of faces and cells, and at the integration points.
    """
    places = cell_functions(block.cell_type).nodes[:20]
    points = np.concatenate([places, cell_rule(block.cell_type).points])
    rule = Rule(points, np.ones(len(points)))
    low, high = np.zeros((2, len(block.cells)))
    size = max(1, 2**20 // (len(points) * block.cells.shape[1]))
    for first in range(0, len(block.cells), size):
        piece = slice(first, first + size)
        with np.errstate(all="ignore"):  # cells of absurd size have no ratio, which is as bad as a small one
            jacobian = jacobians(nodes, CellBlock(block.cell_type, block.cells[piece]), rule)
            lengths = np.prod(np.linalg.norm(jacobian, axis=2), axis=2)
            ratio = np.linalg.det(jacobian) / np.where(lengths > 0, lengths, 1.0)
        low[piece], high[piece] = ratio.min(axis=1), ratio.max(axis=1)
    bad = ~((low > _FLAT) | (high < -_FLAT))
    cells = block.cells.copy()
    turned = high < 0
    cells[turned] = cells[turned][:, mirrored(block.cell_type)]
    return cells, bad
