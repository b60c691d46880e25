"""Exodus II files (.e, .exo): blocks by name, side sets, node sets; read with netCDF4."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from ..errors import MeshError
from .content import CORNERS, FLAT, NO_ROWS, FileProblems, Index, MeshContent, upper_edges_last

_SOLIDS: Final = {
    ("TET", 4): "tetra",
    ("TET", 10): "tetra10",
    ("HEX", 8): "hexahedron",
    ("HEX", 20): "hexahedron20",
    ("HEX", 27): "hexahedron27",
    ("WED", 6): "wedge",
    ("WED", 15): "wedge15",
    ("WED", 18): "wedge18",
    ("PYR", 5): "pyramid",
    ("PYR", 13): "pyramid13",
}
_FLAT: Final = {
    ("TRI", 3): "triangle",
    ("TRI", 6): "triangle6",
    ("SHE", 4): "quad",
    ("QUA", 4): "quad",
    ("SHE", 8): "quad8",
    ("QUA", 8): "quad8",
    ("SHE", 9): "quad9",
    ("QUA", 9): "quad9",
    ("SHE", 3): "triangle",
    ("TRI", 4): "triangle",
}
# Places of the nodes of HEX27 in the order of VTK; its centre comes before those of the faces below, above, left,
# right, in front and behind (Exodus II manual, HEX27)
_HEX27: Final = [*range(12), 16, 17, 18, 19, 12, 13, 14, 15, 23, 24, 25, 26, 21, 22, 20]
# WEDGE18 is WEDGE15 with the middles of its sides 1 to 3
_COLUMNS: Final = {"hexahedron27": _HEX27, "wedge18": [*range(9), 12, 13, 14, 9, 10, 11, 15, 16, 17]}
# Sides of a cell by number of corners (Exodus II manual, table of element sides)
_SIDES: Final = {
    4: ((0, 1, 3), (1, 2, 3), (0, 3, 2), (0, 2, 1)),
    5: ((0, 1, 4), (1, 2, 4), (2, 3, 4), (0, 4, 3), (0, 3, 2, 1)),
    6: ((0, 1, 4, 3), (1, 2, 5, 4), (0, 3, 5, 2), (0, 2, 1), (3, 4, 5)),
    8: ((0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (0, 4, 7, 3), (0, 3, 2, 1), (4, 5, 6, 7)),
}


def read_exodus(path: Path) -> MeshContent:
    """The mesh of a file; element blocks and sets without a name are ``block_1``, ``sideset_1``, ``nodeset_1``.

    Raises
    ------
    MeshError : cell types that are not known, a file that is none.
    """
    try:
        return _read(path)
    except MeshError:
        raise
    except Exception as error:  # netCDF4 raises many kinds on damaged files
        if isinstance(error, OSError) and error.strerror:
            reason = error.strerror
        else:
            reason = str(error)
        raise MeshError.of("unreadable mesh", path.name, f"not a usable Exodus file: {reason}") from None


def _read(path: Path) -> MeshContent:
    import netCDF4

    problems = FileProblems(path.name)
    with netCDF4.Dataset(path) as data:
        # a number equal to the fill value is data
        data.set_auto_mask(False)
        content = MeshContent(_points(data))
        blocks: list[tuple[str, Index]] = []  # type and connectivity; side sets count elements through all of them
        for number, name in _named(data, "eb", "block", "num_el_blk"):
            variable = data.variables.get(f"connect{number}")
            if variable is None:  # an empty block
                blocks.append(("", NO_ROWS.reshape(0, 1)))
                continue
            cells = np.asarray(variable[:], dtype=np.int64) - 1  # from 1 in the file
            if cells.size and not (cells.min() >= 0 and cells.max() < len(content.points)):
                problems.add(f"block {name} names a node that is not there", allowed=f"1 to {len(content.points)}")
                continue
            blocks.append((_add_block(content, problems, name, str(variable.elem_type), cells), cells))
        problems.stop()
        for number, name in _named(data, "ss", "sideset", "num_side_sets"):
            if f"elem_ss{number}" in data.variables:
                # from 1 in the file
                elements, sides = (_numbers(data, f"{word}_ss{number}") - 1 for word in ("elem", "side"))
                content.facets[name] = _facets(blocks, elements, sides, problems, name)
        for number, name in _named(data, "ns", "nodeset", "num_node_sets"):
            if f"node_ns{number}" in data.variables:
                rows = _numbers(data, f"node_ns{number}") - 1
                content.node_sets[name] = rows[(rows >= 0) & (rows < len(content.points))]
    problems.stop()
    return content


def _numbers(data: Any, name: str) -> Index:
    return np.asarray(data.variables[name][:], dtype=np.int64)


def _points(data: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    if "coord" in data.variables:
        table = np.asarray(data.variables["coord"][:], dtype=float).T
    else:
        axes = [x for x in "xyz" if f"coord{x}" in data.variables]
        table = np.stack([np.asarray(data.variables[f"coord{x}"][:], dtype=float) for x in axes], axis=1)
    # a plane mesh: z = 0
    return np.ascontiguousarray(np.hstack([table, np.zeros((len(table), 3 - table.shape[1]))]))


def _named(data: Any, short: str, long: str, dimension: str) -> list[tuple[int, str]]:
    """Number (from 1) and name of the blocks or sets of one kind."""
    if dimension not in data.dimensions:
        return []
    count = len(data.dimensions[dimension])
    names = [""] * count
    if f"{short}_names" in data.variables:
        # fixed-width rows of single characters, ended by a null
        table = np.asarray(data.variables[f"{short}_names"][:])
        names = [b"".join(row.tolist()).split(b"\0")[0].decode("utf-8", "replace").strip() for row in table]
    ids = np.arange(1, count + 1)
    if f"{short}_prop1" in data.variables:
        ids = np.asarray(data.variables[f"{short}_prop1"][:])
    return [(i + 1, name or f"{long}_{int(ids[i])}") for i, name in enumerate(names[:count])]


def _add_block(content: MeshContent, problems: FileProblems, name: str, element: str, cells: Index) -> str:
    """Put a block where it belongs; its type, empty where cells of that type are left out."""
    key = (element.upper()[:3], cells.shape[1])
    # HEX20 and WEDGE15 of Exodus have vertical edges before upper ones
    if kind := _SOLIDS.get(key):
        if kind in _COLUMNS:
            ordered = cells[:, _COLUMNS[kind]]
        else:
            ordered = upper_edges_last(cells)
        content.add_volume(name, kind, content.add_solids(kind, ordered))
        return kind
    if kind := _FLAT.get(key):
        content.add_facets(name, kind, cells)
        return kind
    if key[0] in ("HEX", "TET", "WED", "PYR"):
        types = "HEX8, HEX20, HEX27, TET4, TET10, WEDGE6, WEDGE15, WEDGE18, PYRAMID5, PYRAMID13"
        problems.add("element type not known", f"{element}, {cells.shape[1]} nodes", types)
    content.skipped[element] = content.skipped.get(element, 0) + len(cells)
    return ""


def _facets(
    blocks: list[tuple[str, Index]], elements: Index, sides: Index, problems: FileProblems, name: str
) -> list[Index]:
    """Corners of the facets of a side set; elements are counted through all blocks."""
    facets: list[Index] = []
    first = 0
    for kind, cells in blocks:
        inside = (elements >= first) & (elements < first + len(cells))
        local, side = elements[inside] - first, sides[inside]
        # counts through blocks that are left out, too: the numbers of the file include them
        first += len(cells)
        # sides 1 and 2 of a shell are its faces, the others its edges (Exodus II manual, same table)
        if kind in FLAT and (side < 2).any():
            facets.append(cells[local[side < 2]][:, : FLAT[kind]])
        faces = _SIDES.get(CORNERS.get(kind, 0), ())
        for number, face in enumerate(faces):
            if (side == number).any():
                facets.append(cells[local[side == number]][:, list(face)])
        if faces and len(side) and not (side.min() >= 0 and side.max() < len(faces)):
            problems.add(f"side set {name} names a side that no {kind} has", int(side.max()) + 1, f"1 to {len(faces)}")
    return facets
