"""Universal files (.unv, .uff) of I-deas, Salome, Simcenter and gmsh: nodes (datasets 2411 and 781), elements (2412),
groups (2467 and its elders), units (164).

Groups of solids are volumes, of surface elements and of nodes faces. Without groups of solids the parts are the
physical properties of the elements, ``property_3``.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from .content import CORNERS, FLAT, NO_ROWS, FileProblems, Index, MeshContent, rows_of

_TYPES: Final = {
    **dict.fromkeys((41, 51, 61, 74, 91), "triangle"),
    **dict.fromkeys((42, 52, 62, 72, 92), "triangle6"),
    **dict.fromkeys((44, 54, 64, 71, 94), "quad"),
    **dict.fromkeys((45, 55, 65, 75, 95), "quad8"),
    111: "tetra",
    112: "wedge",
    113: "wedge15",
    115: "hexahedron",
    116: "hexahedron20",
    118: "tetra10",
}
"""Types of elements by their descriptor (universal dataset 2412)."""

_BEAMS: Final = (11, 21, 22, 23, 24)  # three records each
_ROUND: Final = {
    "triangle6": [0, 2, 4, 1, 3, 5],
    "quad8": [0, 2, 4, 6, 1, 3, 5, 7],
    "tetra10": [0, 2, 4, 9, 1, 3, 5, 6, 7, 8],
    "wedge15": [0, 2, 4, 9, 11, 13, 1, 3, 5, 10, 12, 14, 6, 7, 8],
    "hexahedron20": [0, 2, 4, 6, 12, 14, 16, 18, 1, 3, 5, 7, 13, 15, 17, 19, 8, 9, 10, 11],
}
"""Columns in the order of VTK: a file goes around, corner and middle of an edge in turn, below, between, above."""

_COUNT: Final = {
    "triangle": 3,
    "quad": 4,
    "tetra": 4,
    "wedge": 6,
    "hexahedron": 8,
    **{k: len(v) for k, v in _ROUND.items()},
}
_SOLID: Final = range(111, 119)
_GROUPS: Final = ("2435", "2452", "2467", "2477")
"""Datasets of groups: four numbers of each member, its type (7: node, 8: element), its label and two more."""

_NODE, _ELEMENT = 7, 8
_UNITS: Final = {1: "m", 2: "ft", 3: "m", 4: "ft", 5: "mm", 6: "cm", 7: "in", 8: "mm", 10: "mm"}
"""Unit of length by the code of dataset 164."""


def read_unv(path: Path) -> MeshContent:
    """The mesh of a file.

    Raises
    ------
    MeshError : what is wrong with it, with line numbers.
    """
    mesh = _Universal(path.name)
    text = path.read_text(encoding="utf-8", errors="replace")
    for number, first, lines in _datasets(text):
        try:
            mesh.take(number, first, lines)
        except (ValueError, IndexError, OverflowError) as error:
            mesh.problems.add(f"not a usable dataset {number}: {error}", line=first)
    if not mesh.labels:
        mesh.problems.add("the file has no nodes", allowed="dataset 2411", remedy="export the mesh with its nodes")
    mesh.problems.stop()
    return mesh.content()


def _datasets(text: str) -> Iterator[tuple[str, int, list[str]]]:
    """Number of each dataset, line (from 1) of its first record, and its records."""
    lines = text.splitlines()
    at = 0
    while at < len(lines):
        if lines[at].strip() != "-1":
            at += 1
            continue
        end = at + 2
        while end < len(lines) and lines[end].strip() != "-1":
            end += 1
        if at + 1 < len(lines):
            number, *_ = [*lines[at + 1].split(), ""]
            yield number, at + 3, lines[at + 2 : end]
        at = end + 1


class _Universal:
    """Nodes, elements and groups as they are read."""

    def __init__(self, where: str) -> None:
        self.problems = FileProblems(where)
        self.labels: list[int] = []
        self.points: list[list[float]] = []
        self.systems: set[int] = set()  # of nodes, and those that are not the global one
        self.turned: set[int] = set()
        # type -> label, property and nodes of each element
        self.elements: dict[str, list[tuple[int, int, list[int]]]] = {}
        self.groups: list[tuple[str, list[tuple[int, int]]]] = []
        self.skipped: dict[str, int] = {}
        self.unit = ""

    def take(self, number: str, first: int, lines: list[str]) -> None:
        """Add a dataset; those that are no mesh are left out."""
        if number in ("2411", "781"):
            for head, place in zip(lines[::2], lines[1::2], strict=True):
                fields = head.split()
                self.labels.append(int(fields[0]))
                self.systems.add(int(fields[1]))
                self.points.append([float(word) for word in place.upper().replace("D", "E").split()])
                if len(self.points[-1]) != 3:
                    raise ValueError(f"a node of {len(self.points[-1])} coordinates")
        elif number == "2412":
            self._elements(first, lines)
        elif number in _GROUPS:
            self._groups(lines)
        elif number == "164":
            self.unit = _UNITS.get(int(lines[0][:10]), "")
        elif number == "2420":
            self._systems(lines)

    def _elements(self, first: int, lines: list[str]) -> None:
        at = 0
        while at < len(lines):
            label, code, owner, _, _, count = (int(word) for word in lines[at].split()[:6])
            line, at = first + at, at + (2 if code in _BEAMS else 1)
            nodes: list[int] = []
            while len(nodes) < count:
                nodes += [int(word) for word in lines[at].split()]
                at += 1
            kind = _TYPES.get(code)
            if kind is None:
                if code in _SOLID:
                    allowed = "111 to 116, 118"
                    self.problems.add("a solid element that is not read", f"type {code}", allowed, line=line)
                if code in _BEAMS:
                    name = "beam or rod"
                else:
                    name = f"type {code}"
                self.skipped[name] = self.skipped.get(name, 0) + 1
            elif count != _COUNT[kind] or len(nodes) != count:
                self._wrong_count(code, count, _COUNT[kind], line)
            else:
                self.elements.setdefault(kind, []).append((label, owner, nodes))

    def _wrong_count(self, code: int, count: int, allowed: int, line: int) -> None:
        """Tell it once for each type."""
        what = f"wrong number of nodes of elements of type {code}"
        if not any(problem.what == what for problem in self.problems.problems):
            remedy = "gmsh: save with Mesh.SecondOrderIncomplete = 1"
            self.problems.add(what, count, str(allowed), remedy, line)

    def _groups(self, lines: list[str]) -> None:
        at = 0
        while at < len(lines):
            head = lines[at].split()
            number, count = int(head[0]), int(head[7] if len(head) > 7 else head[-1])
            name = lines[at + 1].strip() or f"group_{number}"
            at += 2
            numbers: list[int] = []
            while len(numbers) < 4 * count:
                numbers += [int(word) for word in lines[at].split()]
                at += 1
            members = list(zip(numbers[: 4 * count : 4], numbers[1 : 4 * count : 4], strict=True))
            self.groups.append((name, members))

    def _systems(self, lines: list[str]) -> None:
        """Note coordinate systems other than the global one."""
        for at in range(2, len(lines) - 5, 7):
            label, kind = (int(word) for word in lines[at].split()[:2])
            rows = [[float(word) for word in line.upper().replace("D", "E").split()] for line in lines[at + 2 : at + 6]]
            same = kind == 0 and np.array_equal(np.array(rows), np.vstack([np.eye(3), np.zeros((1, 3))]))
            if not same:
                self.turned.add(label)

    def content(self) -> MeshContent:
        """Everything by rows and names."""
        for label in sorted(self.systems & self.turned):
            # writers differ in whether the numbers of a node are in its system
            what = "nodes in a coordinate system of their own are not read"
            self.problems.add(what, f"system {label}", "global", "export the nodes in the global system")
        labels, last = np.unique(np.array(self.labels[::-1], dtype=np.int64), return_index=True)
        if len(labels) < len(self.labels):
            self.problems.add("two nodes with one label", f"{len(self.labels) - len(labels)} times")
        points = np.array(self.points[::-1], dtype=float)[last]
        content = MeshContent(np.ascontiguousarray(points), skipped=self.skipped, unit=self.unit)
        names = np.array([n for rows in self.elements.values() for n, _, _ in rows], dtype=np.int64)
        place: dict[str, tuple[Index, Index, Index]] = {}  # labels, rows and nodes of the elements of a type
        for kind, rows in self.elements.items():
            cells, there = rows_of(labels, np.array([nodes for _, _, nodes in rows], dtype=np.int64).ravel())
            if not there.all():
                self.problems.add("an element names a node that is not there")
                continue
            table = cells.reshape(len(rows), -1)[:, _ROUND.get(kind, list(range(_COUNT[kind])))]
            if kind in CORNERS:
                at = content.add_solids(kind, table)
            else:
                at = NO_ROWS
            place[kind] = (np.array([n for n, _, _ in rows], dtype=np.int64), at, table)
        if len(np.unique(names)) < len(names):
            self.problems.add("two elements with one label")
        self.problems.stop()
        for name, members in self.groups:
            self._add_group(content, name, members, labels, place)
        if not content.volumes:
            self._by_property(content, place)
        return content

    def _add_group(
        self,
        content: MeshContent,
        name: str,
        members: list[tuple[int, int]],
        labels: Index,
        place: dict[str, tuple[Index, Index, Index]],
    ) -> None:
        """A group of nodes, of elements, or of both."""
        nodes = np.array([label for kind, label in members if kind == _NODE], dtype=np.int64)
        if len(nodes):
            rows, there = rows_of(labels, nodes)
            content.add_nodes(name, rows[there])
        wanted = np.array([label for kind, label in members if kind == _ELEMENT], dtype=np.int64)
        for kind, (numbers, rows, table) in place.items():
            chosen = np.flatnonzero(np.isin(numbers, wanted))
            if len(chosen) and kind in CORNERS:
                content.add_volume(name, kind, rows[chosen])
            elif len(chosen) and kind in FLAT:
                content.add_facets(name, kind, table[chosen])

    def _by_property(self, content: MeshContent, place: dict[str, tuple[Index, Index, Index]]) -> None:
        """Solids by physical property, where no group has any."""
        for kind, (_, rows, _) in place.items():
            owners = np.array([owner for _, owner, _ in self.elements[kind]], dtype=np.int64)
            if kind in CORNERS:
                for owner in np.unique(owners).tolist():
                    content.add_volume(f"property_{owner}", kind, rows[owners == owner])
