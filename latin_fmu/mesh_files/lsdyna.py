"""Solids of LS-DYNA keyword files (.k, .key, .dyn): a part per *PART, sets of nodes and segments, shells as faces.

Read here, as lsdyna-mesh-reader 0.2 does not return on some files that are right. Fields of the default and of the long
format, or separated by commas. Hexahedra whose nodes repeat are tetrahedra, pyramids or wedges.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from .content import CORNERS, NO_ROWS, FileProblems, Include, Index, MeshContent, rows_of

_MOVES: Final = ("INCLUDE_TRANSFORM", "NODE_TRANSFORM", "INCLUDE_STAMPED_PART", "INCLUDE_AUTO_OFFSET", "NODE_SCALAR")
"""Keywords that change the mesh and are not read."""

_SOLID: Final = ("ELEMENT_SOLID", "ELEMENT_SOLID_TET4TOTET10")
_OTHER_SOLIDS: Final = ("ELEMENT_SOLID_", "ELEMENT_TSHELL")
_CREATED_BY_GMSH: Final = "created by Gmsh"
_HEX_FORMS: Final[Mapping[tuple[int, ...], tuple[str, list[int]]]] = {
    (0, 1, 2, 3, 4, 5, 6, 7): ("hexahedron", [0, 1, 2, 3, 4, 5, 6, 7]),
    (0, 1, 2, 3, 3, 3, 3, 3): ("tetra", [0, 1, 2, 3]),
    (0, 1, 2, 2, 3, 3, 3, 3): ("tetra", [0, 1, 2, 4]),
    (0, 1, 2, 3, 4, 4, 4, 4): ("pyramid", [0, 1, 2, 3, 4]),
    (0, 1, 2, 3, 4, 4, 5, 5): ("wedge", [0, 1, 4, 3, 2, 6]),
    (0, 1, 2, 2, 3, 4, 5, 5): ("wedge", [0, 1, 2, 4, 5, 6]),
}
"""Which nodes of a hexahedron are equal, by the first appearance of each; the cell, and the columns that it has."""


@dataclass
class _Keyword:
    """A keyword and its data lines with their numbers in the file."""

    name: str
    line: int
    rows: list[tuple[int, str]] = field(default_factory=list)


def read_lsdyna(text: str, where: str, include: Include) -> MeshContent:
    """The mesh of a keyword file.

    Parameters
    ----------
    text : of the file. where : name for messages. include : text of a file that it includes.

    Raises
    ------
    MeshError : what is wrong, with line numbers.
    """
    mesh = _KeywordMesh(FileProblems(where), _CREATED_BY_GMSH in text[:200])
    for keyword in _keywords(text, include, mesh.problems):
        mesh.take(keyword)
    mesh.problems.stop()
    return mesh.content()


def _keywords(text: str, include: Include, problems: FileProblems, depth: int = 0) -> Iterator[_Keyword]:
    """Keywords in order, those of included files in their place."""
    current: _Keyword | None = None
    for number, line in enumerate([*text.splitlines(), "*END"], 1):
        titled = current is not None and current.name == "PART"  # a title may be blank
        if line.startswith("$") or not (line.strip() or titled):
            continue
        if not line.startswith("*"):
            if current is not None:
                current.rows.append((number, line.rstrip()))
            continue
        if current is not None and current.name == "INCLUDE":
            for at, name in current.rows:
                with problems.included(name.strip(), include, depth, at) as inner:
                    yield from _keywords(inner, include, problems, depth + 1)
        elif current is not None:
            yield current
        current = _Keyword(line[1:].strip().upper(), number)
        if current.name == "END":
            return


def _fields(line: str, widths: tuple[int, ...]) -> list[str]:
    """Fields of a line: between commas, or in columns of these widths, or between blanks where columns cut a number."""
    if "," in line:
        return [item.strip() for item in line.rstrip().rstrip(",").split(",")]
    fields, at = [], 0
    for width in widths:
        fields.append(line[at : at + width].strip())
        at += width
    while fields and not fields[-1]:
        fields.pop()
    if any(" " in item for item in fields):
        return line.split()
    return fields


class _KeywordMesh:
    """Nodes, elements and sets as they are read."""

    def __init__(self, problems: FileProblems, by_gmsh: bool) -> None:
        self.problems, self.by_gmsh = problems, by_gmsh
        self.nodes: dict[int, tuple[float, float, float]] = {}
        # part -> nodes of its solids by type of cell, facets of its shells
        self.solids: dict[int, dict[str, list[list[int]]]] = {}
        self.shells: dict[int, list[list[int]]] = {}
        self.names: dict[int, str] = {}
        self.node_sets: dict[str, list[int]] = {}
        self.segments: dict[str, list[list[int]]] = {}
        self.skipped: dict[str, int] = {}
        self.labels: set[int] = set()

    def take(self, keyword: _Keyword) -> None:
        """Add what a keyword says; those that are no mesh are left out."""
        name, long = keyword.name, False
        if name.endswith(("%", "+")):
            name, long = name[:-1].strip(), True
        readers = {"NODE": self._node, "PART": self._part, "ELEMENT_SHELL": self._shell}
        try:
            if name in _MOVES:
                what, remedy = "a keyword that changes the mesh is not read", "write the mesh as it is used"
                self.problems.add(what, f"*{name}", None, remedy, keyword.line)
            elif name in _SOLID:
                self._solid(keyword, long)
            elif name.startswith(_OTHER_SOLIDS):
                allowed = "*ELEMENT_SOLID with 4, 5, 6, 8 or 10 nodes"
                self.problems.add("solid elements that are not read", f"*{name}", allowed, line=keyword.line)
            elif name in readers:
                readers[name](keyword, long)
            elif name.startswith("SET_NODE") and "GENERATE" not in name and "GENERAL" not in name:
                self._set(keyword, long, "node_set")
            elif name.startswith("SET_SEGMENT") and "GENERAL" not in name:
                self._set(keyword, long, "segment_set")
            elif name.startswith("ELEMENT"):
                self.skipped[f"*{name}"] = self.skipped.get(f"*{name}", 0) + len(keyword.rows)
        except (ValueError, IndexError, OverflowError) as error:
            self.problems.add(f"not a usable *{name}: {error}", line=keyword.line)

    def _node(self, keyword: _Keyword, long: bool) -> None:
        if long:
            widths = (20, 20, 20, 20)
        else:
            widths = (8, 16, 16, 16)
        for line, row in keyword.rows:
            fields = [*_fields(row, widths), "", "", ""]
            label = _label(fields[0])
            if label in self.nodes:
                self.problems.add("two nodes with one label", label, line=line)
            x, y, z = (float(item or "0") for item in fields[1:4])
            self.nodes[label] = (x, y, z)

    def _part(self, keyword: _Keyword, long: bool) -> None:
        if long:
            widths = (20,) * 8
        else:
            widths = (10,) * 8
        for (_, title), (_, row) in zip(keyword.rows[::2], keyword.rows[1::2], strict=False):
            label = _label(_fields(row, widths)[0])
            self.names[label] = title.strip() or f"part_{label}"

    def _solid(self, keyword: _Keyword, long: bool) -> None:
        if long:
            widths = (20,) * 10
        else:
            widths = (8,) * 10
        rows = iter(keyword.rows)
        for line, text in rows:
            numbers = [_label(item) for item in _fields(text, widths)]
            # eid and pid alone: the nodes follow; a comma at the end: the line goes on
            while len(numbers) == 2 or text.rstrip().endswith(","):
                _, text = next(rows, (line, ""))
                numbers += [int(item) for item in _fields(text, widths)]
            label, part, *nodes = numbers
            while nodes and not nodes[-1]:
                nodes.pop()
            if label in self.labels:
                self.problems.add("two elements with one label", label, line=line)
            self.labels.add(label)
            form = _form(nodes)
            if form is None or (self.by_gmsh and form[0] == "wedge"):
                self._refuse(label, nodes, form is not None, line)
                continue
            self.solids.setdefault(part, {}).setdefault(form[0], []).append(form[1])

    def _refuse(self, label: int, nodes: list[int], wedge: bool, line: int) -> None:
        """A solid that is not read; ``wedge``: as gmsh writes it."""
        if wedge:
            what = "gmsh 4.15 writes wedges in an order that LS-DYNA does not have"
            self.problems.add(what, allowed="tetrahedra and hexahedra of gmsh", remedy="save it from gmsh as .msh")
            return
        value, allowed = f"element {label}: {', '.join(map(str, nodes))}", "4, 5, 6, 8 or 10 different nodes"
        self.problems.add("nodes of a solid that are not read", value, allowed, line=line)

    def _shell(self, keyword: _Keyword, long: bool) -> None:
        if long:
            widths = (20,) * 6
        else:
            widths = (8,) * 6
        for _, row in keyword.rows:
            _, part, *nodes = (_label(item) for item in _fields(row, widths)[:6])
            self.shells.setdefault(part, []).append(list(dict.fromkeys(nodes)))

    def _set(self, keyword: _Keyword, long: bool, kind: str) -> None:
        if long:
            widths = (20,) * 8
        else:
            widths = (10,) * 8
        rows = [row for _, row in keyword.rows]
        if keyword.name.endswith("_TITLE"):
            title = rows.pop(0).strip()
        else:
            title = ""
        name = title or f"{kind}_{_label(_fields(rows.pop(0), widths)[0])}"
        if title:
            rows.pop(0)
        most = 8
        if kind == "segment_set":
            most = 4
        most = 8
        if kind == "segment_set":
            most = 4
        for row in rows:
            labels = [label for item in _fields(row, widths)[:most] if (label := int(item))]
            if kind == "segment_set":
                self.segments.setdefault(name, []).append(list(dict.fromkeys(labels)))
            else:
                self.node_sets.setdefault(name, []).extend(labels)

    def content(self) -> MeshContent:
        """Everything by rows and names."""
        labels = np.array(list(self.nodes), dtype=np.int64)
        content = MeshContent(np.array(list(self.nodes.values()), dtype=float).reshape(-1, 3), skipped=self.skipped)
        for part, kinds in self.solids.items():
            for kind, cells in kinds.items():
                rows = content.add_solids(kind, self._rows(labels, cells))
                content.add_volume(self._name(part), kind, rows)
        for name, facets in [*((self._name(p), f) for p, f in self.shells.items()), *self.segments.items()]:
            for count in (3, 4):
                if some := [facet for facet in facets if len(facet) == count]:
                    content.facets.setdefault(name, []).append(self._rows(labels, some))
        for name, nodes in self.node_sets.items():
            rows, there = rows_of(labels, np.array(nodes, dtype=np.int64))
            content.add_nodes(name, rows[there])
        if self.by_gmsh and _lost(content):
            what = "shells whose nodes belong to no solid: gmsh 4.15 leaves pyramids out of this format"
            self.problems.add(what, remedy="save it from gmsh as .msh")
        self.problems.stop()
        content.parts = tuple(dict.fromkeys(self._name(part) for part in self.solids))
        return content

    def _name(self, part: int) -> str:
        name = self.names.get(part, f"part_{part}")
        # two parts of one title stay two
        if list(self.names.values()).count(name) < 2:
            return name
        return f"{name}_{part}"

    def _rows(self, labels: Index, cells: list[list[int]]) -> Index:
        nodes = np.array(cells, dtype=np.int64)
        rows, there = rows_of(labels, nodes.ravel())
        if not there.all():
            self.problems.add("an element names a node that is not there", int(nodes.ravel()[there.argmin()]))
            return NO_ROWS.reshape(0, nodes.shape[1])
        return rows.reshape(nodes.shape)


def _lost(content: MeshContent) -> bool:
    """Whether shells have nodes that no solid has."""
    some = [rows.ravel() for tables in content.facets.values() for rows in tables]
    solid = [cells.ravel() for cells in content.solids.values()]
    return bool(some) and not np.isin(np.concatenate(some), np.concatenate([NO_ROWS, *solid])).all()


def _label(text: str) -> int:
    """A label. Raises ValueError for what is none, such as a parameter &NAME."""
    number = int(text)
    if not 0 <= number < 2**62:
        raise ValueError(f"{text} is no label")
    return number


def _form(nodes: list[int]) -> tuple[str, list[int]] | None:
    """Type and nodes of a solid; None for one that is none of them."""
    if len(nodes) == 10 and len(set(nodes[8:])) == 2:
        if len(set(nodes)) == 10:
            return ("tetra10", nodes)
        return None
    if len(nodes) in (4, 5):
        if len(set(nodes)) == len(nodes):
            return ({4: "tetra", 5: "pyramid"}[len(nodes)], nodes)
        return None
    if len(nodes) == 6:
        nodes = [*nodes[:4], nodes[4], nodes[4], nodes[5], nodes[5]]
    if len(nodes) != 8:
        return None
    order = {node: i for i, node in enumerate(dict.fromkeys(nodes))}
    form = _HEX_FORMS.get(tuple(order[node] for node in nodes))
    if form is None:
        return None
    kind, columns = form
    assert kind in CORNERS
    return kind, [nodes[i] for i in columns]
