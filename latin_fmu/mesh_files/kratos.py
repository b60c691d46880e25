"""Files of Kratos (.mdpa): elements, conditions and geometries, whose sub model parts are the bodies and faces.

A sub model part of solids is a body, one of conditions or shells a face, one of nodes alone a set of nodes. Where none
has solids, the bodies are the properties of the elements, ``property_3``. Middle nodes of vertical edges come before
those of upper ones; of hexahedra of 27 nodes those of the faces follow, below, in front, right, behind, left, above
(hexahedra_3d_27.h).
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import numpy as np

from ..errors import MeshError
from .content import CORNERS, NO_ROWS, SHELLS, SOLIDS, FileProblems, Index, MeshContent, rows_of, upper_edges_last
from .node_orders import EDGES, to_vtk

_WORD: Final = re.compile(r"(Begin|End)\s+(\w+)\s*(.*)")
_CELLS: Final = ("Elements", "Conditions", "Geometries")
_FLAT: Final = re.compile("shell|membrane|surface|plate|face|triangle|quadrilateral", re.IGNORECASE)
_NO_CELLS: Final = re.compile("line|point|beam|truss|cable|spring|mass|nodal|rigid|edge", re.IGNORECASE)
"""Words in the names of elements and conditions: surfaces, and what is neither surface nor solid."""

_VERTICAL_FIRST: Final = (*EDGES["hexahedron27"][:4], *EDGES["hexahedron27"][8:], *EDGES["hexahedron27"][4:8])
_AROUND: Final = ((0, 1, 2, 3), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7), (4, 5, 6, 7))
_HEXAHEDRON27: Final = to_vtk("hexahedron27", _VERTICAL_FIRST, _AROUND)


def read_mdpa(path: Path) -> MeshContent:
    """The mesh of a file.

    Raises
    ------
    MeshError : every line that is not understood, with its number.
    """
    reader = _Mdpa(path.name)
    try:
        reader.read(path.read_text(encoding="utf-8", errors="replace"))
        return reader.content()
    except (ValueError, OverflowError, OSError) as error:  # rows of several lengths, numbers of any size
        what = f"not a whole file of the format .mdpa: {' '.join(str(error).split())[:200]}"
        raise MeshError.of("unreadable mesh", path.name, what, remedy="write it again") from None


class _Mdpa:
    """What the blocks of a file hold, by the numbers of the file."""

    def __init__(self, where: str) -> None:
        self.problems = FileProblems(where)
        self.nodes: dict[int, list[float]] = {}
        # block -> (cell type, empty for what is no cell) -> number, property and nodes
        self.cells: dict[str, dict[str, list[tuple[int, int, list[int]]]]] = {word: {} for word in _CELLS}
        self.skipped: dict[str, int] = {}
        # sub model part -> block -> numbers
        self.parts: dict[str, dict[str, list[int]]] = {}

    def read(self, text: str) -> None:
        """Go through the lines; blocks are in each other."""
        blocks: list[tuple[str, str]] = []
        for number, raw in enumerate(text.splitlines(), 1):
            line = raw.partition("//")[0].strip()
            match = _WORD.match(line)
            if match is None:
                if line and blocks:
                    self._row(blocks, line, number)
            elif match[1] == "Begin":
                blocks.append((match[2], match[3].strip()))
                if match[2] == "SubModelPart":
                    self.parts.setdefault(self._part(blocks), {})
            elif not blocks or blocks.pop()[0] != match[2]:
                self.problems.add("a block ends that did not begin", line, line=number)
                break
        if blocks:
            self.problems.add("a block does not end", " ".join(blocks[-1]), f"End {blocks[-1][0]}")
        self.problems.stop()

    @staticmethod
    def _part(blocks: list[tuple[str, str]]) -> str:
        """Name of the sub model part that is read; of one in another with the name of that."""
        return ".".join(name for word, name in blocks if word == "SubModelPart")

    def _row(self, blocks: list[tuple[str, str]], line: str, number: int) -> None:
        """A line of numbers."""
        word, name = blocks[-1]
        try:
            if word == "Nodes":
                node, *place = line.split()
                x, y, z = map(float, place[:3])
                if int(node) in self.nodes:
                    self.problems.add("two nodes with one number", node, line=number)
                self.nodes[int(node)] = [x, y, z]
            elif word in _CELLS:
                label, *fields = (int(field) for field in line.split())
                if word != "Geometries":
                    owner = fields.pop(0)
                else:
                    owner = 0
                kind = self._kind(word, name, fields, number)
                self.cells[word].setdefault(kind, []).append((label, owner, fields))
                if not kind:
                    self.skipped[name] = self.skipped.get(name, 0) + 1
            elif word.startswith("SubModelPart") and word[len("SubModelPart") :] in (*_CELLS, "Nodes"):
                members = self.parts[self._part(blocks)].setdefault(word[len("SubModelPart") :], [])
                members += [int(field) for field in line.split()]
        except (ValueError, LookupError):  # also members of no sub model part
            self.problems.add(f"not a line of {word}", line, line=number)

    def _kind(self, word: str, name: str, nodes: list[int], number: int) -> str:
        """Type of a cell, empty for what is neither solid nor surface."""
        if _NO_CELLS.search(name):
            return ""
        flat = word == "Conditions" or _FLAT.search(name) is not None
        kind = (SHELLS if flat else SOLIDS).get(len(nodes), "")
        if not kind and not flat:
            allowed = ", ".join(map(str, SOLIDS))
            self.problems.add("cells that are not read", f"{name} with {len(nodes)} nodes", allowed, line=number)
        return kind

    def content(self) -> MeshContent:
        """Everything by rows and names."""
        labels = np.array(list(self.nodes), dtype=np.int64)
        content = MeshContent(np.array(list(self.nodes.values()), dtype=float).reshape(-1, 3), skipped=self.skipped)
        tables: dict[tuple[str, str], tuple[Index, Index, Index]] = {}  # numbers, rows in solids, nodes
        for word, kinds in self.cells.items():
            for kind, rows in kinds.items():
                if not kind:
                    continue
                found, there = rows_of(labels, np.array([nodes for _, _, nodes in rows], dtype=np.int64).ravel())
                if not there.all():
                    self.problems.add(f"{word.lower()} name a node that is not there", allowed=f"{len(labels)} nodes")
                    continue
                nodes = found.reshape(len(rows), -1)
                if kind == "hexahedron27":
                    nodes = nodes[:, _HEXAHEDRON27]
                else:
                    nodes = upper_edges_last(nodes)
                if kind in CORNERS:
                    places = content.add_solids(kind, nodes)
                else:
                    places = NO_ROWS
                tables[word, kind] = np.array([n for n, _, _ in rows], dtype=np.int64), places, nodes
        self.problems.stop()
        for name, members in self.parts.items():
            self._add_part(content, name, members, labels, tables)
        if not content.volumes:
            for (word, kind), (_, places, _) in tables.items():
                owners = np.array([owner for _, owner, _ in self.cells[word][kind]], dtype=np.int64)
                if kind in CORNERS:
                    for owner in np.unique(owners).tolist():
                        content.add_volume(f"property_{owner}", kind, places[owners == owner])
        return content

    @staticmethod
    def _add_part(
        content: MeshContent,
        name: str,
        members: dict[str, list[int]],
        labels: Index,
        tables: dict[tuple[str, str], tuple[Index, Index, Index]],
    ) -> None:
        """A sub model part as a body, a face, or a set of nodes."""
        for (word, kind), (numbers, places, nodes) in tables.items():
            chosen = np.flatnonzero(np.isin(numbers, np.array(members.get(word, []), dtype=np.int64)))
            if len(chosen) and kind in CORNERS:
                content.add_volume(name, kind, places[chosen])
            elif len(chosen):
                content.add_facets(name, kind, nodes[chosen])
        if members.get("Nodes") and not any(members.get(word) for word in _CELLS):
            rows, there = rows_of(labels, np.array(members["Nodes"], dtype=np.int64))
            content.add_nodes(name, rows[there])
