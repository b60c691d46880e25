"""Text meshes that are tables behind words: medit (.mesh), SU2 (.su2) and Netgen (.vol, .vol.gz).

Cells of medit are parts by their reference number, ``ref_3``. SU2 has one part; its markers are faces. Netgen has a
part by material and a face by boundary condition, with their names. Second order of medit are tetrahedra alone.
"""

from __future__ import annotations

import gzip
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from ..errors import MeshError
from .content import CORNERS, FLAT, Array, Index, MeshContent
from .node_orders import EDGES, to_vtk

_MEDIT: Final = {
    "Triangles": ("triangle", 3),
    "Quadrilaterals": ("quad", 4),
    "Tetrahedra": ("tetra", 4),
    "Hexahedra": ("hexahedron", 8),
    "Hexaedra": ("hexahedron", 8),
    "Prisms": ("wedge", 6),
    "Wedges": ("wedge", 6),
    "Pyramids": ("pyramid", 5),
    "TrianglesP2": ("triangle6", 6),
    "TetrahedraP2": ("tetra10", 10),
}
_MEDIT_REFUSED: Final = ("QuadrilateralsQ2", "HexahedraQ2", "PrismsP2", "PyramidsP2")
_SU2: Final = {
    3: ("line", 2),
    5: ("triangle", 3),
    9: ("quad", 4),
    10: ("tetra", 4),
    12: ("hexahedron", 8),
    13: ("wedge", 6),
    14: ("pyramid", 5),
    21: ("line3", 3),
    22: ("triangle6", 6),
    23: ("quad8", 8),
    24: ("tetra10", 10),
    25: ("hexahedron20", 20),
    26: ("wedge15", 15),
    27: ("pyramid13", 13),
    28: ("quad9", 9),
    29: ("hexahedron27", 27),
    32: ("wedge18", 18),
}
"""Numbers of VTK."""

_NETGEN_SOLIDS: Final = {
    4: "tetra",
    5: "pyramid",
    6: "wedge",
    8: "hexahedron",
    10: "tetra10",
    13: "pyramid13",
    15: "wedge15",
    20: "hexahedron20",
}
_NETGEN_FLAT: Final = {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8"}
_NETGEN_COLUMNS: Final = {"tetra10": to_vtk("tetra10", ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)))}
_NETGEN_STRAIGHT: Final = frozenset(kind for kind in _NETGEN_SOLIDS.values() if kind not in EDGES or kind == "tetra10")


class _UnreadableError(ValueError):
    """What is wrong with a file, with a remedy."""

    def __init__(self, what: str, value: str | None = None, allowed: str | None = None, remedy: str | None = None):
        super().__init__(what)
        self.what = what
        self.value = value
        self.allowed = allowed
        self.remedy = remedy


def _guarded(read: Callable[[str], MeshContent], path: Path) -> MeshContent:
    """Content of a text file. Raises MeshError where it is damaged."""
    try:
        if path.suffix.lower() == ".gz":
            data = gzip.decompress(path.read_bytes())
        else:
            data = path.read_bytes()
        return read(data.decode("utf-8-sig", "replace"))
    except _UnreadableError as error:
        raise MeshError.of("unreadable mesh", path.name, error.what, error.value, error.allowed, error.remedy) from None
    except (ValueError, IndexError, OverflowError, KeyError, OSError) as error:
        what = f"not a whole file of the format {path.suffix}: {' '.join(str(error).split())[:200]}"
        raise MeshError.of("unreadable mesh", path.name, what, remedy="save it again") from None


def read_medit(path: Path) -> MeshContent:
    """The mesh of a .mesh file.

    Raises
    ------
    MeshError : what is wrong with it.
    """
    return _guarded(_medit, path)


def read_su2(path: Path) -> MeshContent:
    """The mesh of a .su2 file.

    Raises
    ------
    MeshError : what is wrong with it.
    """
    return _guarded(_su2, path)


def read_netgen(path: Path) -> MeshContent:
    """The mesh of a .vol file, packed or not.

    Raises
    ------
    MeshError : what is wrong with it.
    """
    return _guarded(_netgen, path)


def _medit(text: str) -> MeshContent:
    sections: list[tuple[str, list[str]]] = []
    for token in re.sub("#.*", "", text).split():
        if token[0].isalpha() and token.lower() not in ("nan", "inf", "infinity"):
            sections.append((token, []))
        elif sections:
            sections[-1][1].append(token)
    tables = dict(sections)
    if "Vertices" not in tables:
        raise _UnreadableError("not a whole file of the format .mesh: it has no Vertices", remedy="save it again")
    for name in _MEDIT_REFUSED:
        if tables.get(name):
            what, remedy = "cells of second order that are not read", "save it as .msh or .vtu"
            raise _UnreadableError(what, name, "TetrahedraP2", remedy)
    dimension = int(tables["Dimension"][0])
    points = _table(tables["Vertices"], dimension + 1, float)[:, :dimension]
    content = MeshContent(np.ascontiguousarray(np.hstack([points, np.zeros((len(points), 3 - dimension))])))
    of_surfaces, of_solids = np.zeros((2, len(points)), dtype=bool)
    for name, numbers in sections:  # a type may have several sections
        if name not in _MEDIT:
            continue
        kind, width = _MEDIT[name]
        rows = _table(numbers, width + 1, int).astype(np.int64)
        cells = rows[:, :width] - 1
        _check(cells, len(points))
        (of_solids if kind in CORNERS else of_surfaces)[cells] = True
        _grouped(content, kind, cells, rows[:, width], lambda number: f"ref_{number}" if number else "")
    if content.solids and (alone := int((of_surfaces & ~of_solids).sum())):
        what = f"{alone} vertices of surface cells belong to no solid cell: the file has lost cells"
        remedy = "gmsh writes neither wedges nor pyramids to .mesh: save it as .msh"
        raise _UnreadableError(what, None, "surfaces of the solid cells", remedy)
    return content


def _table(tokens: Sequence[str], width: int, kind: Callable[[str], float]) -> Array:
    """Rows of numbers behind their count."""
    count = int(tokens[0])
    if count < 0 or len(tokens) - 1 != count * width:
        what = f"{len(tokens) - 1} numbers where {count} rows of {width} are announced"
        remedy = "gmsh writes hexahedra of second order as Hexahedra: save them as .msh"
        raise _UnreadableError(f"not a whole file of the format .mesh: {what}", remedy=remedy)
    return np.array(list(map(kind, tokens[1 : 1 + count * width]))).reshape(count, width)


def _check(cells: Index, count: int) -> None:
    if cells.size and not (cells.min() >= 0 and cells.max() < count):
        raise _UnreadableError("cells name nodes that are not there", None, f"{count} nodes")


def _grouped(content: MeshContent, kind: str, cells: Index, numbers: Index, name_of: Callable[[int], str]) -> None:
    """Cells with the number of their group each; an empty name is no group."""
    if kind in CORNERS:
        rows = content.add_solids(kind, cells)
    else:
        rows = np.arange(len(cells))
    for number in np.unique(numbers).tolist():
        if name := name_of(number):
            chosen = np.flatnonzero(numbers == number)
            if kind in CORNERS:
                content.add_volume(name, kind, rows[chosen])
            elif kind in FLAT:
                content.add_facets(name, kind, cells[chosen])


def _su2(text: str) -> MeshContent:
    lines = iter([line for raw in text.splitlines() if (line := raw.partition("%")[0].strip())])
    points, dimension = np.zeros((0, 3)), 0
    solids: dict[str, list[list[int]]] = {}
    markers: list[tuple[str, str, list[int]]] = []
    name = ""
    for line in lines:
        key, _, value = (part.strip() for part in line.partition("="))
        if key == "NDIME":
            dimension = int(value)
        elif key == "NPOIN":
            rows = _next_rows(lines, int(value.split()[0]), dimension)
            table = np.array([list(map(float, row)) for row in rows]).reshape(len(rows), dimension)
            points = np.hstack([table, np.zeros((len(rows), 3 - dimension))])
        elif key == "NELEM":
            for kind, nodes in _su2_cells(lines, int(value)):
                solids.setdefault(kind, []).append(nodes)
        elif key == "MARKER_TAG":
            name = value
        elif key == "MARKER_ELEMS":
            markers += [(name, kind, nodes) for kind, nodes in _su2_cells(lines, int(value))]
        elif key == "NZONE" and int(value) > 1:
            raise _UnreadableError("several zones", value, "one zone", "save each zone as a file")
    content = MeshContent(np.ascontiguousarray(points))
    for kind, cells in solids.items():
        _check(np.array(cells, dtype=np.int64), len(points))
        if kind in CORNERS:
            content.add_solids(kind, np.array(cells, dtype=np.int64))
    for name, kind, nodes in markers:
        _check(np.array(nodes, dtype=np.int64), len(points))
        if kind in FLAT:
            content.add_facets(name, kind, np.array([nodes], dtype=np.int64))
    return content


def _next_rows(lines: Iterator[str], count: int, width: int) -> list[list[str]]:
    """The first numbers of the next lines."""
    rows: list[list[str]] = []
    for _ in range(count):
        fields = next(lines, "").split()[:width]
        if len(fields) < width:
            raise ValueError("the points end early")
        rows.append(fields)
    return rows


def _su2_cells(lines: Iterator[str], count: int) -> Iterator[tuple[str, list[int]]]:
    """Type and nodes of the next cells, each with its type before its nodes."""
    for _ in range(count):
        numbers = [int(word) for word in next(lines, "").split()]
        if not numbers or numbers[0] not in _SU2:
            raise _UnreadableError("a cell of an unknown type", str(numbers[:1]), "numbers of VTK")
        kind, width = _SU2[numbers[0]]
        if len(numbers) not in (1 + width, 2 + width):  # with its own number behind the nodes, or without
            what, remedy = "a cell with too many or too few nodes", "save it in another format"
            raise _UnreadableError(what, f"{kind}: {len(numbers) - 1} numbers", f"{width} nodes", remedy)
        yield kind, numbers[1 : 1 + width]


_WORD = re.compile("[a-z][a-z0-9_]*")


def _netgen(text: str) -> MeshContent:
    tables: dict[str, list[list[str]]] = {}
    word = ""
    for line in text.splitlines():
        fields = line.partition("#")[0].split()
        if len(fields) == 1 and _WORD.fullmatch(fields[0]):
            word = fields[0]
        elif fields and word:
            tables.setdefault(word, []).append(fields)
    if "points" not in tables:
        raise _UnreadableError("not a whole file of the format .vol: it has no points", remedy="save it again")
    points = np.array([list(map(float, row[:3])) for row in _rows(tables["points"])], dtype=float).reshape(-1, 3)
    content = MeshContent(points)
    materials = {int(row[0]): " ".join(row[1:]) for row in _rows(tables.get("materials", []))}
    conditions = {int(row[0]): " ".join(row[1:]) for row in _rows(tables.get("bcnames", []))}
    groups: dict[tuple[str, str], list[list[int]]] = {}
    for row in _rows(tables.get("volumeelements", [])):
        number, width, *nodes = (int(field) for field in row[: 2 + int(row[1])])
        if (kind := _NETGEN_SOLIDS.get(width, "")) not in _NETGEN_STRAIGHT:
            value, allowed = f"{width} nodes", "4, 5, 6, 8 or 10 nodes"
            raise _UnreadableError(
                "a volume element that is not read", value, allowed, "save it in another format of Netgen"
            )
        groups.setdefault((kind, materials.get(number) or f"material_{number}"), []).append(nodes)
    for name in ("surfaceelements", "surfaceelementsuv", "surfaceelementsgi"):
        for row in _rows(tables.get(name, [])):
            number, width = int(row[1]), int(row[4])
            kind = _NETGEN_FLAT.get(width, "")
            nodes = [int(field) for field in row[5 : 5 + width]]
            groups.setdefault((kind, conditions.get(number) or f"boundary_{number}"), []).append(nodes)
    for (kind, name), rows in groups.items():
        cells = np.array(rows, dtype=np.int64) - 1
        _check(cells, len(points))
        cells = cells[:, _NETGEN_COLUMNS.get(kind, list(range(cells.shape[1])))]
        if kind in CORNERS:
            content.add_volume(name, kind, content.add_solids(kind, cells))
        elif kind in FLAT:
            content.add_facets(name, kind, cells)
    return content


def _rows(table: list[list[str]]) -> list[list[str]]:
    """Rows of a table behind their count."""
    if not table:
        return []
    count = int(table[0][0])
    if count < 0 or len(table) - 1 < count:
        raise ValueError(f"{len(table) - 1} rows where {count} are announced")
    return table[1 : 1 + count]
