"""Ansys archives (.cdb), read with mapdl-archive: components of elements and nodes, parts by element type.

Workbench gives every body an element type of its own: the parts are ``type_3``, or components of elements where these
have the same cells. Hexahedra whose nodes repeat are tetrahedra, pyramids or wedges; a middle node that is 0 lies in
the middle of its edge. Surface elements (SURF154, TARGE170, CONTA174, MESH200, shells) are faces.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from ..errors import MeshError
from .content import CORNERS, FLAT, Array, Index, MeshContent, rows_of
from .library import missing_library
from .node_orders import EDGES

_LINEAR: Final = frozenset({5, 45, 62, 64, 65, 69, 70, 96, 97, 164, 185, 190, 278})
_QUADRATIC: Final = frozenset({89, 90, 95, 117, 122, 186, 226, 231, 236, 279})
_TETRA: Final = frozenset({87, 92, 98, 119, 123, 148, 168, 187, 227, 232, 237, 291})
_TETRA4: Final = frozenset({72, 285})
_SURFACES: Final = frozenset({28, 41, 43, 63, 93, 131, 132, 152, 154, 170, 173, 174, 181, 200, 281})
"""Element types by their number: solids with 8, 20, 10 and 4 nodes, and surfaces."""

_FORMS: Final[Mapping[str, tuple[list[int], list[int]]]] = {
    "tetra": ([0, 1, 2, 4], [8, 9, 11, 16, 17, 18]),
    "pyramid": ([0, 1, 2, 3, 4], [8, 9, 10, 11, 16, 17, 18, 19]),
    "wedge": ([0, 1, 2, 4, 5, 6], [8, 9, 11, 12, 13, 15, 16, 17, 18]),
    "hexahedron": ([*range(8)], [*range(8, 20)]),
}
"""Columns of a brick that a cell has: corners, and middle nodes in the order of VTK."""

_HEADER: Final = 10  # numbers before the nodes of an element: material, type, real constant, ..., element number
_MATERIAL = 0
_TYPE = 1
_NUMBER = 8


def is_archive(start: bytes) -> bool:
    """Whether the first bytes of a file are those of an archive of Ansys."""
    head = start.lstrip().upper()
    return head.startswith((b"/PREP7", b"/COM,ANSYS", b"/COM, ANSYS", b"/BATCH", b"/TITLE")) or b"\nNBLOCK" in head


def read_ansys(path: Path) -> MeshContent:
    """The mesh of an archive.

    Raises
    ------
    MeshError : what is wrong with it, or that mapdl-archive is needed.
    """
    try:
        library = importlib.import_module("mapdl_archive")
    except ModuleNotFoundError:
        raise missing_library(path, "mapdl-archive") from None
    try:
        labels, points = _nodes(path)
        archive = library.Archive(str(path), parse_vtk=False)
        content = _Archive(path, archive, labels, points).content()
        content.skipped |= _other_blocks(_lines(path))
        return content
    except MeshError:
        raise
    except Exception as error:  # of its compiled part, on damaged files
        what = f"not a usable archive: {type(error).__name__}: {' '.join(str(error).split())[:200]}"
        raise MeshError.of("unreadable mesh", path.name, what, remedy="write it again with CDWRITE,DB") from None


_NODE_FORMAT: Final = re.compile(r"\((\d+)i(\d+),\s*(\d+)e(\d+)\.")  # (3i9,6e21.13e3)


def _nodes(path: Path) -> tuple[Index, Array]:
    """Labels and coordinates of all NBLOCK. Read here: mapdl-archive 0.4 makes z = 0 of blocks with one whole number in
    a row, as Workbench writes them.

    Raises
    ------
    MeshError : no nodes or elements. ValueError : what is no number.
    """
    labels: list[int] = []
    points: list[list[float]] = []
    lines = _lines(path)
    if not any(line[:6].upper() == "EBLOCK" for line in lines):
        what, allowed = "the file holds no elements", "EBLOCK in blocked form"
        raise MeshError.of("unreadable mesh", path.name, what, None, allowed, "write it with CDWRITE,DB")
    at = 0
    while at < len(lines):
        at += 1
        if lines[at - 1][:6].upper() != "NBLOCK":
            continue
        match = None
        if at < len(lines):
            match = _NODE_FORMAT.match(lines[at].replace(" ", "").lower())
        if match is None:
            raise ValueError(f"line {at + 1} is no format of nodes")
        wholes, width, _, wide = (int(number) for number in match.groups())
        at += 1
        while at < len(lines) and (label := lines[at][:width].strip()).isdigit():
            start = wholes * width
            fields = [lines[at][start + i * wide : start + (i + 1) * wide].strip() for i in range(3)]
            labels.append(int(label))
            points.append([float(item or "0") for item in fields])
            at += 1
    unique, last = np.unique(np.array(labels[::-1], dtype=np.int64), return_index=True)
    return unique, np.array(points[::-1], dtype=float).reshape(-1, 3)[last]


def _lines(path: Path) -> list[str]:
    return path.read_text(encoding="latin-1").splitlines()


def _other_blocks(lines: list[str]) -> dict[str, int]:
    """Elements in blocks that are not of the form SOLID, by the count in their first line: surfaces and contacts."""
    fields = [line.upper().split(",") for line in lines if line[:6].upper() == "EBLOCK"]
    counts = [int(f[4]) for f in fields if len(f) > 4 and f[2].strip() != "SOLID" and f[4].strip().isdigit()]
    if sum(counts):
        return {"elements of blocks without SOLID": sum(counts)}
    return {}


class _Archive:
    """Elements of an archive sorted by what they are."""

    def __init__(self, path: Path, archive: Any, labels: Index, points: Array) -> None:
        self.path = path
        self.archive = archive
        self.labels = labels
        self.points: list[Array] = [points]
        self.n_point = len(self.labels)
        self.types = {int(key): int(number) for key, number in np.asarray(archive.ekey).reshape(-1, 2).tolist()}
        self.middles: dict[tuple[int, int], int] = {}

    def content(self) -> MeshContent:
        """Everything by rows and names."""
        # (cell type, group) -> number and nodes of its elements
        cells: dict[tuple[str, str], list[tuple[int, list[int]]]] = {}
        groups = self._groups()
        skipped: dict[str, int] = {}
        for row in self.archive.elem:
            numbers = [int(n) for n in row]
            owner, nodes = numbers[_TYPE], numbers[_HEADER:]
            number = self.types.get(owner, 0)
            kind, some = self._cell(number, nodes, numbers[_NUMBER])
            if kind:
                group = groups[owner, numbers[_MATERIAL] if kind in CORNERS else 0]
                cells.setdefault((kind, group), []).append((numbers[_NUMBER], some))
            else:
                skipped[f"element type {number}"] = skipped.get(f"element type {number}", 0) + 1
        tables = {
            key: (np.array([n for n, _ in rows], dtype=np.int64), self._rows(key[0], [some for _, some in rows]))
            for key, rows in cells.items()
        }
        content = MeshContent(np.concatenate(self.points), skipped=skipped)
        places = {key: content.add_solids(key[0], t) for key, (_, t) in tables.items() if key[0] in CORNERS}
        for (kind, group), (_, table) in tables.items():
            if kind in CORNERS:
                content.add_volume(group, kind, places[kind, group])
            else:
                content.add_facets(group, kind, table)
        self._components(content, tables, places)
        return content

    def _groups(self) -> dict[tuple[int, int], str]:
        """Names of groups by element type and material, 0 for surfaces: elements of one type and several materials are
        several bodies, unless components of elements say which these are."""
        owners: dict[int, dict[int, None]] = {}
        for row in self.archive.elem:
            owners.setdefault(int(row[_TYPE]), {})[int(row[_MATERIAL])] = None
        alone = bool(self.archive.element_components)
        names = {(owner, 0): f"type_{owner}" for owner in owners}
        for owner, materials in owners.items():
            for material in materials:
                names[owner, material] = f"type_{owner}"
                if len(materials) > 1 and not alone:
                    names[owner, material] = f"type_{owner}_material_{material}"
        return names

    def _components(
        self,
        content: MeshContent,
        tables: dict[tuple[str, str], tuple[Index, Index]],
        places: dict[tuple[str, str], Index],
    ) -> None:
        """Named sets of elements and nodes."""
        for name, members in (self.archive.element_components or {}).items():
            for key, (numbers, table) in tables.items():
                chosen = np.flatnonzero(np.isin(numbers, np.asarray(members, dtype=np.int64)))
                if len(chosen) and key[0] in CORNERS:
                    content.add_volume(name.strip(), key[0], places[key][chosen])
                elif len(chosen):
                    content.add_facets(name.strip(), key[0], table[chosen])
        for name, members in (self.archive.node_components or {}).items():
            rows, there = rows_of(self.labels, np.asarray(members, dtype=np.int64))
            content.add_nodes(name.strip(), rows[there])

    def _cell(self, number: int, nodes: list[int], label: int) -> tuple[str, list[int]]:
        """Type of cell and its nodes, 0 for middle nodes that are left out; an empty type for what is no cell."""
        if number in _TETRA4 or number in _TETRA:
            if number in _TETRA4:
                count = 4
            else:
                count = 10
            # the solver writes four-node tetrahedra of these types with the middle nodes left out
            some = (nodes + [0] * count)[:count]
            if any(some[4:]):
                return "tetra10", some
            return "tetra", some[:4]
        if number in _LINEAR:
            return self._brick(nodes[:8], label)
        if number in _QUADRATIC:
            return self._brick((nodes + [0] * 20)[:20], label)
        if number in _SURFACES:
            corners = list(dict.fromkeys(n for n in nodes[:4] if n))
            return {3: "triangle", 4: "quad"}.get(len(corners), ""), corners
        return "", []

    def _brick(self, nodes: list[int], label: int) -> tuple[str, list[int]]:
        """What a brick with equal nodes is: K = L, O = P a wedge; M = N = O = P a pyramid; both a tetrahedron."""
        if len(nodes) < 8 or not all(nodes[:8]):
            what = "a brick without all of its corners"
            raise MeshError.of("unreadable mesh", self.path.name, what, f"element {label}")
        _, _, k, l, m, n, o, p = nodes[:8]  # noqa: E741, the letters of Ansys
        apex = m == n == o == p
        if apex and k == l:
            form = "tetra"
        elif apex:
            form = "pyramid"
        elif k == l and o == p:
            form = "wedge"
        else:
            form = "hexahedron"
        corners, middles = _FORMS[form]
        some = [nodes[i] for i in corners]
        if len(set(some)) < len(some):
            what = "a brick with equal nodes that is no tetrahedron, pyramid or wedge"
            raise MeshError.of("unreadable mesh", self.path.name, what, f"element {label}")
        between = []
        if len(nodes) == 20:
            between = [nodes[i] for i in middles]
        if not any(between):
            return form, some
        name = {"tetra": "tetra10", "pyramid": "pyramid13", "wedge": "wedge15", "hexahedron": "hexahedron20"}[form]
        return name, some + between

    def _rows(self, kind: str, cells: list[list[int]]) -> Index:
        """Rows of the nodes of cells; a middle node that is 0 becomes one in the middle of its edge."""
        nodes = np.array(cells, dtype=np.int64)
        rows, there = rows_of(self.labels, nodes.ravel())
        rows = rows.reshape(nodes.shape)
        if not (there | (nodes.ravel() == 0)).all():
            wrong = int(nodes.ravel()[(~there & (nodes.ravel() != 0)).argmax()])
            what = "an element names a node that is not there"
            raise MeshError.of("unreadable mesh", self.path.name, what, str(wrong))
        corners = CORNERS.get(kind) or FLAT[kind]
        for cell, column in np.argwhere(nodes == 0).tolist():
            a, b = sorted(int(rows[cell, end]) for end in EDGES[kind][column - corners])
            if (a, b) not in self.middles:
                self.middles[a, b] = self.n_point
                self.points.append(0.5 * (self.points[0][a] + self.points[0][b])[None])
                self.n_point += 1
            rows[cell, column] = self.middles[a, b]
        return rows
