"""Meshes of Nastran decks (.bdf, .nas, .dat): a part per property of solids, a face per property of shells.

Free, small and large fields, continuation lines, INCLUDE, decks with or without executive and case control. Solids of
property 7 are the volume group ``PSOLID_7``, shells of property 8 the surface group ``PSHELL_8``, or what a comment of
HyperMesh (``$HMNAME PROP``) or ANSA (``$ANSA_NAME_COMMENT``) calls that property; nodes of SPC and SPC1 set 3 are
the node set ``SPC_3``. Loads, materials and cases are ignored.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

import numpy as np

from .content import NO_ROWS, SHELLS, SOLIDS, FileProblems, Include, Index, MeshContent, rows_of, upper_edges_last

_SOLIDS: Final = {"CTETRA": (4, 10), "CPYRAM": (5,), "CPENTA": (6, 15), "CHEXA": (8, 20)}
_SHELLS: Final = {"CTRIA3": 3, "CTRIAR": 3, "CTRIA6": 6, "CQUAD4": 4, "CQUADR": 4, "CQUAD8": 8}
_EXPONENT = re.compile(r"(?<=[0-9.])([+-])")
_HM_NAME = re.compile(r'\$HMNAME\s+PROP\s+(\d+)\s*"([^"]+)"')
_ANSA_NAME = re.compile(r"\$ANSA_NAME_COMMENT;(\d+);P(?:SOLID|SHELL);([^;]+);?")

Entry = tuple[int, list[str]]
"""Line number and fields of one entry, its name first."""


def read_nastran(text: str, where: str, include: Include) -> MeshContent:
    """The mesh of a deck.

    Parameters
    ----------
    text : the deck. where : name for messages. include : text of a file that the deck includes.

    Raises
    ------
    MeshError : what is wrong, with line numbers.
    """
    deck = _BulkData(where)
    for line, fields in _entries(text, include, deck.problems, deck.names):
        deck.take(line, fields)
    deck.problems.stop()
    return deck.content()


def _bulk_lines(text: str) -> list[tuple[int, str]]:
    """Numbered lines of the bulk data: all of them where the deck has no BEGIN BULK."""
    lines = list(enumerate(text.splitlines(), 1))
    for index, (_, line) in enumerate(lines):
        if " ".join(line.upper().split()).startswith("BEGIN BULK") or line.upper().startswith("BEGIN,BULK"):
            return lines[index + 1 :]
    return lines


def _entries(
    text: str, include: Include, problems: FileProblems, names: dict[int, str], depth: int = 0
) -> Iterator[Entry]:
    """Entries of the bulk data, continuation lines joined."""
    entry: Entry | None = None
    for number, raw in _bulk_lines(text):
        for pattern in (_HM_NAME, _ANSA_NAME):
            if match := pattern.match(raw):
                # within 64 bits
                names[int(match[1][:18])] = match[2].strip()
        # columns count after tabs
        line = raw.split("$")[0].rstrip().expandtabs(8)
        if not line:
            continue
        if line.upper().startswith("ENDDATA"):
            break
        # a continuation begins with a mark, a blank or, in free form, an empty field
        if line[0] in "+* ," and entry is not None:
            entry[1].extend(_fields(line)[1:])
            continue
        if entry is not None:
            yield entry
        entry = None
        if line.upper().startswith("INCLUDE"):
            name = line[7:].strip().strip("'\"")
            with problems.included(name, include, depth, number) as inner:
                yield from _entries(inner, include, problems, names, depth + 1)
            continue
        fields = _fields(line)
        entry = (number, [fields[0].upper().rstrip("*"), *fields[1:]])
    if entry is not None:
        yield entry


def _fields(line: str) -> list[str]:
    """The fields of a line, name first; without the continuation marks at the end of full lines."""
    if "," in line:
        fields = [f.strip() for f in line.split(",")]
        return fields[: 5 if fields[0].endswith("*") else 9]
    first = line[:8].strip()
    # large fields are marked by a star, on continuations in the first column
    width = 16 if first.endswith("*") or line[:1] == "*" else 8
    count = 4 if width == 16 else 8
    return [first, *(line[8 + i * width : 8 + (i + 1) * width].strip() for i in range(count))]


def _number(text: str) -> float:
    """A number as Nastran writes it: ``1.5-3`` is 1.5e-3, ``1.D0`` is 1."""
    if not text:
        return 0.0
    try:
        return float(text)
    except ValueError:
        # an exponent without E: a sign after a digit or point; with one, the sign alone first, so that it is found
        # alike
        return float(_EXPONENT.sub(r"e\1", text.upper().replace("D", "E").replace("E+", "+").replace("E-", "-")))


class _BulkData:
    """Nodes and elements as they are read."""

    def __init__(self, where: str) -> None:
        self.problems = FileProblems(where)
        self.names: dict[int, str] = {}
        self.nodes: dict[int, tuple[float, float, float]] = {}
        # (number of nodes, solid) -> property and nodes of each element
        self.elements: dict[tuple[int, bool], list[tuple[int, list[int]]]] = {}
        # nodes of each set of constraints, each range of them by its ends
        self.held: dict[int, list[tuple[int, int]]] = {}
        self.skipped: dict[str, int] = {}

    def take(self, line: int, fields: list[str]) -> None:
        """Add a node, element or constraint; entries that define no mesh are ignored."""
        name = fields[0]
        try:
            if name == "GRID":
                self._grid(line, fields)
            elif name in _SOLIDS:
                # middle nodes may be left out
                nodes = [int(f) for f in fields[3 : 3 + _SOLIDS[name][-1]] if f]
                self._element(line, name, int(fields[2] or fields[1]), nodes, _SOLIDS[name], solid=True)
            elif name in _SHELLS:
                nodes = [int(f) for f in fields[3 : 3 + _SHELLS[name]] if f]
                self._element(line, name, int(fields[2] or fields[1]), nodes, (_SHELLS[name],), solid=False)
            elif name in ("SPC", "SPC1"):
                self._constraint(name, fields)
            elif name in ("CBAR", "CBEAM", "CROD", "CELAS1", "CBUSH", "RBE2", "RBE3"):
                self.skipped[name] = self.skipped.get(name, 0) + 1
        except (ValueError, IndexError):
            self.problems.add(f"not a usable {name} entry", ", ".join(fields), line=line)

    def _grid(self, line: int, fields: list[str]) -> None:
        fields = fields + [""] * 6
        if fields[2] not in ("", "0"):
            self.problems.add(
                "nodes in a coordinate system of their own are not read",
                f"GRID {fields[1]}, CP = {fields[2]}",
                "CP = 0 or blank",
                "export the nodes in the basic coordinate system",
                line,
            )
        label = int(fields[1])
        if not 0 < label < 2**62:
            raise ValueError("not a label")
        self.nodes[label] = (_number(fields[3]), _number(fields[4]), _number(fields[5]))

    def _element(
        self, line: int, name: str, owner: int, nodes: list[int], counts: tuple[int, ...], solid: bool
    ) -> None:
        if not all(0 < n < 2**62 for n in (*nodes, owner)):
            raise ValueError("not a label")
        if len(nodes) not in counts:
            allowed = " or ".join(map(str, counts))
            self.problems.add(f"wrong number of nodes of a {name}", len(nodes), allowed, line=line)
            return
        self.elements.setdefault((len(nodes), solid), []).append((owner, nodes))

    def _constraint(self, name: str, fields: list[str]) -> None:
        held = self.held.setdefault(int(fields[1]), [])
        if name == "SPC":
            nodes = [int(f) for f in fields[2::3] if f][:2]  # G1 C1 D1 G2 C2 D2
            ranges = [(n, n) for n in nodes]
        elif len(fields) > 4 and fields[4].upper() == "THRU":  # G1 THRU G2
            ranges = [(int(fields[3]), int(fields[5]))]
        else:
            ranges = [(int(f), int(f)) for f in fields[3:] if f]
        if any(not 0 < n < 2**62 for ends in ranges for n in ends):
            raise ValueError("not a label")
        # nodes are looked up at the end of the file: entries of bulk data may have any order
        held += ranges

    def content(self) -> MeshContent:
        """Everything by rows and names."""
        labels = np.array(list(self.nodes), dtype=np.int64)
        content = MeshContent(np.array(list(self.nodes.values()), dtype=float).reshape(-1, 3))
        content.skipped = self.skipped
        for (count, solid), elements in self.elements.items():
            owners = np.array([owner for owner, _ in elements], dtype=np.int64)
            cells = self._rows(labels, np.array([nodes for _, nodes in elements], dtype=np.int64))
            if solid:
                # one table for all elements of a type: its rows are those of ``solids``
                content.add_solids(SOLIDS[count], upper_edges_last(cells))
            for owner in dict.fromkeys(owners.tolist()):
                rows = np.flatnonzero(owners == owner)
                name = self.names.get(owner, f"{'PSOLID' if solid else 'PSHELL'}_{owner}")
                if solid:
                    content.add_volume(name, SOLIDS[count], rows)
                else:
                    content.add_facets(name, SHELLS[count], cells[rows])
        order = np.argsort(labels)
        for number, ranges in self.held.items():
            first, last = np.array(ranges, dtype=np.int64).reshape(-1, 2).T
            starts = np.searchsorted(labels, first, sorter=order)
            # right: a range includes its last node
            stops = np.searchsorted(labels, last, side="right", sorter=order)
            held = [order[a:b] for a, b in zip(starts, stops, strict=True)]
            content.add_nodes(f"SPC_{number}", np.concatenate([NO_ROWS, *held]))
        self.problems.stop()
        return content

    def _rows(self, labels: Index, nodes: Index) -> Index:
        rows, there = rows_of(labels, nodes.ravel())
        if not there.all():
            self.problems.add("an element names a node that no GRID has", int(nodes.ravel()[there.argmin()]))
        return rows.reshape(nodes.shape)
