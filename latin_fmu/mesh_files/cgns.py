"""CGNS files (.cgns) in HDF5: zones of unstructured cells, boundary conditions and families; read with h5py.

A zone is a part unless boundary conditions at cells name volumes (as gmsh writes them). Boundary conditions are faces,
by elements or by vertices, under the name of their family.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from ..errors import MeshError
from .content import CORNERS, FLAT, Index, MeshContent, upper_edges_last
from .library import missing_library
from .node_orders import to_vtk

_TYPES: Final = {
    2: ("vertex", 1),
    3: ("line", 2),
    4: ("line3", 3),
    5: ("triangle", 3),
    6: ("triangle6", 6),
    7: ("quad", 4),
    8: ("quad8", 8),
    9: ("quad9", 9),
    10: ("tetra", 4),
    11: ("tetra10", 10),
    12: ("pyramid", 5),
    13: ("pyramid14", 14),
    14: ("wedge", 6),
    15: ("wedge15", 15),
    16: ("wedge18", 18),
    17: ("hexahedron", 8),
    18: ("hexahedron20", 20),
    19: ("hexahedron27", 27),
    21: ("pyramid13", 13),
}
"""Types of elements (SIDS, element numbering conventions)."""

_MIXED: Final = 20
_HEX27: Final = to_vtk(
    "hexahedron27",
    (*((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 5), (2, 6), (3, 7)), *((4, 5), (5, 6), (6, 7), (7, 4))),
    ((0, 1, 2, 3), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (0, 4, 7, 3), (4, 5, 6, 7)),
)
_WEDGE18: Final = to_vtk(
    "wedge18",
    ((0, 1), (1, 2), (2, 0), (0, 3), (1, 4), (2, 5), (3, 4), (4, 5), (5, 3)),
    ((0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
)
_COLUMNS: Final = {"hexahedron27": _HEX27, "wedge18": _WEDGE18}
Elements = list[tuple[str, Index, Index, Index]]
"""Blocks of one type: its name, numbers of the elements, their nodes, rows in the solids of the file."""


def read_cgns(path: Path) -> MeshContent:
    """The mesh of a file.

    Raises
    ------
    MeshError : what is wrong with it, or that h5py is needed.
    """
    try:
        import h5py
    except ModuleNotFoundError:
        raise missing_library(path, "h5py") from None
    if not h5py.is_hdf5(path):
        what, remedy = "not a CGNS file in HDF5 (in ADF, the elder form?)", "convert it with adf2hdf"
        raise MeshError.of("unreadable mesh", path.name, what, remedy=remedy)
    try:
        with h5py.File(path) as file:
            return _content(file, path)
    except MeshError:
        raise
    except Exception as error:  # h5py raises many kinds on damaged files
        what = f"not a usable CGNS file: {' '.join(str(error).split())[:200]}"
        raise MeshError.of("unreadable mesh", path.name, what, remedy="save it again") from None


def _children(node: Any, label: str) -> Iterator[Any]:
    """Nodes of a kind below a node."""
    for child in node.values():
        if child.attrs.get("label", b"").rstrip(b"\0") == label.encode():
            yield child


def _name(node: Any) -> str:
    return str(node.name.rpartition("/")[2])


def _data(node: Any) -> Any:
    return node[" data"][()]


def _words(node: Any) -> str:
    return bytes(np.asarray(_data(node)).astype(np.uint8).tolist()).split(b"\0")[0].decode("utf-8", "replace").strip()


def _content(file: Any, path: Path) -> MeshContent:
    content = MeshContent(np.zeros((0, 3)))
    for base in _children(file, "CGNSBase_t"):
        families = {
            _name(family): next((_words(n) for n in _children(family, "FamilyName_t")), _name(family))
            for family in _children(base, "Family_t")
        }
        for zone in _children(base, "Zone_t"):
            _add_zone(content, path, zone, families)
    return content


def _add_zone(content: MeshContent, path: Path, zone: Any, families: dict[str, str]) -> None:
    """Points, cells and boundary conditions of a zone."""
    kind = next((_words(n) for n in _children(zone, "ZoneType_t")), "Structured")
    if kind != "Unstructured":
        what = "a structured zone is not read"
        raise MeshError.of("unreadable mesh", path.name, what, _name(zone), "unstructured zones", "export cells")
    first = len(content.points)
    axes = {
        _name(n): np.asarray(_data(n), float)
        for n in _children(next(_children(zone, "GridCoordinates_t")), "DataArray_t")
    }
    columns = [axes[f"Coordinate{x}"] for x in "XYZ" if f"Coordinate{x}" in axes]
    points = np.zeros((len(columns[0]), 3))
    points[:, : len(columns)] = np.stack(columns, axis=1)
    content.points = np.concatenate([content.points, points])
    elements: Elements = []
    for section in _children(zone, "Elements_t"):
        elements += _section(content, path, section, first)
    named = set(content.volumes)
    for condition in (c for group in _children(zone, "ZoneBC_t") for c in _children(group, "BC_t")):
        _add_condition(content, condition, elements, families, first, len(points))
    if set(content.volumes) == named:
        for kind_, _, _, rows in elements:
            if kind_ in CORNERS:
                content.add_volume(_name(zone), kind_, rows)


def _section(content: MeshContent, path: Path, section: Any, first: int) -> Elements:
    """Blocks of a section, its solids added to the content."""
    code = int(_data(section)[0])
    start = int(np.asarray(_data(next(n for n in _children(section, "IndexRange_t") if _name(n) == "ElementRange")))[0])
    arrays = {_name(n): np.asarray(_data(n), dtype=np.int64) for n in _children(section, "DataArray_t")}
    flat = arrays["ElementConnectivity"]
    if code == _MIXED:
        found = _mixed(path, flat, start)
    elif code in _TYPES:
        kind, width = _TYPES[code]
        table = flat.reshape(-1, width)
        found = [(kind, start + np.arange(len(table)), table)]
    else:
        what = "elements of a type that is not read"
        raise MeshError.of("unreadable mesh", path.name, what, f"{_name(section)}: type {code}", "no polyhedra")
    blocks: Elements = []
    for kind, numbers, table in found:
        cells = table - 1 + first
        if len(cells) and not (cells.min() >= first and cells.max() < len(content.points)):
            raise MeshError.of("unreadable mesh", path.name, "cells name nodes that are not there", _name(section))
        if kind in CORNERS:
            if kind in _COLUMNS:
                cells = cells[:, _COLUMNS[kind]]
            else:
                cells = upper_edges_last(cells)
            rows = content.add_solids(kind, cells)
        else:
            rows = np.arange(len(cells))
        blocks.append((kind, numbers, cells, rows))
    return blocks


def _mixed(path: Path, flat: Index, start: int) -> list[tuple[str, Index, Index]]:
    """Type, numbers and nodes of the elements of a mixed section: each has its type before its nodes."""
    numbers: dict[int, list[int]] = {}
    nodes: dict[int, list[Index]] = {}
    at, number = 0, start
    while at < len(flat):
        code = int(flat[at])
        if code not in _TYPES:
            raise MeshError.of("unreadable mesh", path.name, "elements of a type that is not read", f"type {code}")
        width = _TYPES[code][1]
        numbers.setdefault(code, []).append(number)
        nodes.setdefault(code, []).append(flat[at + 1 : at + 1 + width])
        at, number = at + 1 + width, number + 1
    return [(_TYPES[code][0], np.array(numbers[code], dtype=np.int64), np.array(nodes[code])) for code in numbers]


def _add_condition(
    content: MeshContent, condition: Any, elements: Elements, families: dict[str, str], first: int, count: int
) -> None:
    """A boundary condition: a face by its elements or vertices, a volume by its cells."""
    family = next((_words(n) for n in _children(condition, "FamilyName_t")), "")
    name = families.get(family, family) or _name(condition)
    place = next((_words(n) for n in _children(condition, "GridLocation_t")), "Vertex")
    lists = {_name(n): np.asarray(_data(n), dtype=np.int64).ravel() for n in condition.values() if " data" in n}
    if "PointRange" in lists:
        chosen = np.arange(lists["PointRange"][0], lists["PointRange"][1] + 1)
    elif "ElementRange" in lists:
        place, chosen = "FaceCenter", np.arange(lists["ElementRange"][0], lists["ElementRange"][1] + 1)
    elif "ElementList" in lists:
        place, chosen = "FaceCenter", lists["ElementList"]
    else:
        chosen = lists.get("PointList", np.zeros(0, dtype=np.int64))
    if place == "Vertex":
        rows = chosen - 1
        content.add_nodes(name, first + rows[(rows >= 0) & (rows < count)])
        return
    for kind, numbers, cells, rows in elements:
        inside = np.isin(numbers, chosen)
        if inside.any() and kind in CORNERS:
            content.add_volume(name, kind, rows[inside])
        elif inside.any() and kind in FLAT:
            content.add_facets(name, kind, cells[inside])
