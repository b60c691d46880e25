"""Meshes of substructures from mesh files: one volume group, its named faces, cells turned right side out; refined."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..errors import MeshError, Problem, listed
from ..mesh_files.content import CORNERS, MeshContent
from .elements import jacobians
from .faces import facet_nodes, flat_pieces, shape
from .mesh import Array, CellBlock, FacetBlock, FacetSet, Index, Mesh, boundary, unjoined
from .reference_cells import CELL_FACES, FACET_CORNERS, N_CORNER, TET_EDGES, Rule, cell_functions, cell_rule, mirrored

_FEWEST_CORNERS = 3  # of a facet
_FAR = 1e60  # m; products of three such lengths are still numbers
_VOLUME = tuple(CELL_FACES)
_CURVED = (
    "their middle nodes lie too far out: mesh finer where the surface is curved; in gmsh set "
    "Mesh.HighOrderOptimize = 2, or Mesh.SecondOrderLinear = 1 for straight edges"
)
_FLAT = 1e-12  # det J over the lengths of its columns


def mesh_of(
    content: MeshContent, where: str, group: str | None = None, scale: float = 1.0, points: Collection[str] = ()
) -> Mesh:
    """The volume ``group`` of a mesh file (all volume cells when None) and the named faces on its surface.

    Parameters
    ----------
    content : of the file. where : its name. group : name of a volume group. scale : metres per unit of the file.
    points : node sets that are no faces.

    Raises
    ------
    MeshError : other cell types, unknown group, inverted or flat cells, no volume.
    """
    chosen = _volume_cells(content, group, where)
    # nodes of other volumes of the file are left out
    node_ids, inverse = np.unique(np.concatenate([c.ravel() for c in chosen.values()]), return_inverse=True)
    nodes = np.ascontiguousarray(content.points[node_ids], dtype=float) * scale
    if not np.all(np.abs(nodes) < _FAR):  # NaN, too
        raise MeshError.of("unusable mesh", where, f"node coordinates are not finite, or beyond {_FAR:g} m")
    blocks, start = [], 0
    for cell_type, cells in chosen.items():
        numbers = inverse[start : start + cells.size].reshape(cells.shape).astype(np.int64)
        start += cells.size
        blocks.append(_right_side_out(nodes, CellBlock(cell_type, numbers), where))
    # -1: a point of the file that this volume does not have
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
    faces = _named_faces(content, renumber, surface, points)
    return Mesh(nodes, bare.blocks, faces, _named_points(content, renumber, faces))


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
        complete = any(kind in ("wedge18", "pyramid14") for kind in unknown)
        remedy = None
        if complete:
            remedy = "second order without nodes inside faces: in gmsh Mesh.SecondOrderIncomplete = 1"
        raise MeshError(
            [
                Problem(
                    where,
                    "cell types that cannot be computed with",
                    counts,
                    ", ".join(_VOLUME),
                    remedy or "mesh the part with cells of these types",
                )
            ]
        )
    return blocks


def _no_group(content: MeshContent) -> str | None:
    """Remedy where a file names no volume."""
    if content.volumes:
        return None
    if content.solids:
        return "omit group to use the whole file"
    return "the file holds no solid cells"


def _right_side_out(nodes: Array, block: CellBlock, where: str) -> CellBlock:
    """Cells numbered inside out are turned; flat or tangled ones are refused."""
    cells, bad = oriented(nodes, block)
    if bad.any():
        first = int(bad.argmax())
        place = ", ".join(f"{x:.4g}" for x in nodes[block.cells[first]].mean(axis=0))
        # quadratic cells may be sound at their corners and tangled by their middle nodes
        corners = block.cells.shape[1] == CORNERS[block.cell_type]
        remedy = _CURVED
        if corners:
            remedy = "repair the mesh where it is distorted"
        raise MeshError(
            [
                Problem(
                    where,
                    f"{int(bad.sum())} {block.cell_type} cells have no volume or are tangled",
                    f"the first is number {first + 1} of them, around [{place}] m",
                    "a positive Jacobian at every node and integration point",
                    remedy,
                )
            ]
        )
    return replace(block, cells=cells)


def _check_cells(mesh: Mesh, where: str) -> None:
    """Refuse cells that are there twice: their stiffness would count twice, their facets would be no surface."""
    twice = 0
    for block in mesh.blocks:
        corners = np.sort(block.cells[:, : CORNERS[block.cell_type]], axis=1)
        twice += len(corners) - len(np.unique(corners, axis=0))
    if twice:
        problem = Problem(where, "cells with the same corners as others", f"{twice} cells", remedy="leave copies out")
        raise MeshError([problem], "unusable mesh")


def _named_faces(
    content: MeshContent, renumber: Index, surface: FacetSet, points: Collection[str] = ()
) -> dict[str, FacetSet]:
    """Named surface groups whose facets are on the boundary of this volume, oriented outwards.

    A node set names the facets that have all their corners in it, where no surface group has its name and
    it is not one of ``points``.
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
        # fewer nodes than a facet has corners: single nodes, of which a deck may hold one set each
        if len(rows) < _FEWEST_CORNERS or name in faces or name in content.facets or name in points:
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


def _named_points(content: MeshContent, renumber: Index, faces: dict[str, FacetSet]) -> dict[str, Index]:
    """Nodes of node sets that are on no facet of the face of that name: edges and points."""
    points = {}
    for name, rows in content.node_sets.items():
        if name in content.facets:
            continue
        nodes = renumber[rows]
        nodes = nodes[nodes >= 0]
        if name in faces:
            nodes = np.setdiff1d(nodes, faces[name].nodes)
        if len(nodes):
            points[name] = nodes
    return points


def _add_face(faces: dict[str, FacetSet], name: str, rows: list[tuple[str, int]], by_kind: dict[str, Index]) -> None:
    """The face made of boundary facets given by kind and row, if there are any."""
    kinds = dict.fromkeys(kind for kind, _ in rows)
    if kinds:
        faces[name] = FacetSet.of(*(by_kind[kind][[row for k, row in rows if k == kind]] for kind in kinds))


def oriented(nodes: Array, block: CellBlock) -> tuple[Index, NDArray[np.bool_]]:
    """Cells numbered inside out are turned.

    Returns
    -------
    cells (n_cell, n_node), and which of them (n_cell,) have no volume somewhere or change sign, by the
    Jacobians at all nodes but those in the middle of faces and cells and the apex of pyramids, and at the integration
    points.
    """
    places = cell_functions(block.cell_type).nodes
    # without the apex of a pyramid, where the Jacobian is 0
    if N_CORNER[block.cell_type] == 5:
        places = np.delete(places, 4, axis=0)
    else:
        places = places[:20]
    points = np.concatenate([places, cell_rule(block.cell_type).points])
    rule = Rule(points, np.ones(len(points)))
    low, high = np.zeros((2, len(block.cells)))
    size = max(1, 2**20 // (len(points) * block.cells.shape[1]))
    for first in range(0, len(block.cells), size):
        piece = slice(first, first + size)
        with np.errstate(all="ignore"):  # cells of absurd size have no ratio, which is as bad as a small one
            jacobian = jacobians(nodes, CellBlock(block.cell_type, block.cells[piece]), rule)
            # lengths of the columns d x / d xi_j: the ratio to their product has no unit, and is 1 at right angles
            lengths = np.prod(np.linalg.norm(jacobian, axis=2), axis=2)
            ratio = np.linalg.det(jacobian) / np.where(lengths > 0, lengths, 1.0)
        low[piece], high[piece] = ratio.min(axis=1), ratio.max(axis=1)
    # NaN is bad, too
    bad = ~((low > _FLAT) | (high < -_FLAT))
    cells = block.cells.copy()
    turned = high < 0
    cells[turned] = cells[turned][:, mirrored(block.cell_type)]
    return cells, bad


_PARTS = 1024  # shape functions at the new nodes are whole multiples of 1 / 512
_TET_CORNERS = ((0, 4, 6, 7), (4, 1, 5, 8), (6, 5, 2, 9), (7, 8, 9, 3))  # the parts at the corners
_TET_INSIDE = ((4, 9, 5, 8), (4, 9, 8, 7), (4, 9, 7, 6), (4, 9, 6, 5))  # the octahedron between them


def refined(mesh: Mesh) -> Mesh:
    """Every cell split into eight cells of its type, every facet of a named face into four, edges halved.

    New nodes lie where the shape functions of the cell put them: the surface stays the one of the given mesh, and does
    not come closer to the shape that was meshed. The octahedron inside a tetrahedron is split along one fixed diagonal.
    A node that several cells share has the same shape functions in all of them, of the nodes that they share: sums of
    random whole numbers of these nodes, weighted with the functions, identify it without rounding.

    Raises
    ------
    MeshError : pyramids, whose parts are no pyramids.
    """
    if any(N_CORNER[kind] == 5 for kind in mesh.cell_types):
        what = "pyramids cannot be split into eight of their kind"
        raise MeshError([Problem("refine", what, remedy="omit refine, or mesh the part finer")], "unusable mesh")
    random = np.random.default_rng(0).integers(1, 2**62, mesh.n_node, dtype=np.int64)
    pieces = [(block.cell_type, block.cells) for block in mesh.blocks]
    pieces += [(block.kind, block.facets) for face in mesh.faces.values() for block in face.blocks]
    tables = []
    codes = []
    places = []
    for kind, cells in pieces:
        functions, children = _children(kind)
        sums = random[cells] @ np.rint(_PARTS * functions).astype(np.int64).T  # wraps around, in all cells alike
        tables.append(sums[:, children].reshape(-1, children.shape[1]))
        codes.append(sums.ravel())
        places.append(np.einsum("pn,cni->cpi", functions, mesh.nodes[cells]).reshape(-1, 3))
    keys, first = np.unique(np.concatenate(codes), return_index=True)
    number = np.argsort(np.argsort(first))  # nodes are counted in the order of the cells
    split = iter([number[np.searchsorted(keys, table)] for table in tables])
    # in the order of ``pieces``: all blocks, then the faces
    blocks = tuple(replace(block, cells=next(split)) for block in mesh.blocks)
    faces = {
        name: FacetSet(tuple(FacetBlock(block.kind, next(split)) for block in face.blocks))
        for name, face in mesh.faces.items()
    }
    points = {name: number[np.searchsorted(keys, _within(mesh, nodes, random))] for name, nodes in mesh.points.items()}
    return Mesh(np.concatenate(places)[np.sort(first)], blocks, faces, points)


def _within(mesh: Mesh, nodes: Index, random: Index) -> Index:
    """Codes of the nodes of a refined mesh that lie on these nodes, or between them on an edge or face of a cell."""
    codes = []
    for block in mesh.blocks:
        functions = np.rint(_PARTS * _children(block.cell_type)[0]).astype(np.int64)
        outside = ~np.isin(block.cells, nodes)
        # places whose shape functions are 0 at all other nodes of the cell
        inside = ~((functions != 0)[None] & outside[:, None, :]).any(axis=2)
        codes.append((random[block.cells] @ functions.T)[inside])
    return np.unique(np.concatenate(codes))


def _children(kind: str) -> tuple[Array, Index]:
    """Shape functions (n_place, n_node) of a cell or facet at the nodes of its parts, and these nodes of each part."""
    if kind in FACET_CORNERS:
        if FACET_CORNERS[kind] == 3:
            linear, whole = "triangle", "triangle6"
        else:
            linear, whole = "quad", "quad9"
        inside = np.einsum("na,pai->pni", shape(linear, facet_nodes(kind)), flat_pieces(whole, False))
    else:
        linear = {8: "hexahedron", 4: "tetra", 6: "wedge"}[N_CORNER[kind]]
        at = cell_functions(linear).values(cell_functions(kind).nodes)
        inside = np.einsum("na,pai->pni", at, _corners_of_parts(linear))
    # rounded: a place that two parts share is one node
    places, children = np.unique(inside.reshape(-1, inside.shape[2]).round(9), axis=0, return_inverse=True)
    if kind in FACET_CORNERS:
        functions = shape(kind, places)
    else:
        functions = cell_functions(kind).values(places)
    return functions, children.reshape(inside.shape[:2])


def _corners_of_parts(linear: str) -> Array:
    """Reference coordinates (8, n_corner, 3) of the corners of the parts of a cell."""
    corners = cell_functions(linear).nodes
    if linear == "hexahedron":
        # part i is the cell shrunk by half towards its corner i
        return np.asarray(0.5 * (corners[None] + corners[:, None]))
    if linear == "wedge":
        # four triangles below, four above; each twice, as bottom and top of its wedge
        flat = np.concatenate([np.concatenate([flat_pieces("triangle6", False)] * 2, axis=1)] * 2)
        height = 0.5 * (corners[:, 2] + np.repeat([-1.0, 1.0], 4)[:, None])
        return np.concatenate([flat, height[..., None]], axis=2)
    parts = np.concatenate([corners, [corners[list(edge)].mean(axis=0) for edge in TET_EDGES]])[
        np.array(_TET_CORNERS + _TET_INSIDE)
    ]
    # the first two corners exchanged: volumes of parts are positive as that of the cell
    inverted = np.linalg.det(parts[:, 1:] - parts[:, :1]) < 0
    parts[inverted] = parts[inverted][:, [1, 0, 2, 3]]
    return np.asarray(parts)
