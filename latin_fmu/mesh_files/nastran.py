"""Meshes of Nastran decks (.bdf, .nas, .dat, .fem): a part per property of solids, a face per property of shells.

Free, small and large fields, continuation lines, INCLUDE, decks with or without executive and case control; coordinate
systems of nodes. Solids of property 7 are the volume group ``PSOLID_7``, shells of property 8 the surface group
``PSHELL_8``, or what a comment of HyperMesh (``$HMNAME PROP``) or ANSA (``$ANSA_NAME_COMMENT``) calls that property;
solids without a property are a group for each connected piece; nodes of SPC and SPC1 set 3 are the node set ``SPC_3``.
Loads, materials and cases are ignored.
"""

from __future__ import annotations

import re
from collections.abc import Container
from typing import Final

import numpy as np

from .attachments import attached_of
from .content import NO_ROWS, SHELLS, SOLIDS, FileLine, FileProblems, Include, Index, MeshContent, pieces, rows_of
from .middle_nodes import complete, in_vtk_order
from .nastran_entries import BulkEntry, Entries, label_of
from .nastran_grids import Grids
from .unused import Skipped, is_known, nodes_in_cells, note

# corners, and numbers of nodes with middle ones
_SOLIDS: Final = {"CTETRA": (4, 10), "CPYRAM": (5, 13), "CPYRA": (5, 13), "CPENTA": (6, 15, 18), "CHEXA": (8, 20, 27)}
_SHELLS: Final = {
    "CTRIA3": (3, 3),
    "CTRIAR": (3, 3),
    "CTRIA6": (3, 6),
    "CQUAD4": (4, 4),
    "CQUADR": (4, 4),
    "CQUAD8": (4, 8),
    "CQUAD9": (4, 9),
    "CQUAD": (4, 9),
}
_OTHER_SOLIDS: Final = re.compile(
    r"CHEX(8|20|A1|A2|CZ|FD|AL)|CHEXA?(FD|CZ)|CPENT(CZ|FD)|CPENTA(FD|CZ)|CTETRAFD|CTETFD|CIHEX[12]|CIFHEX|CIFPENT|"
    r"CHACAB|CHACBR|CGASK\w*|CWEDGE|CELIPS|CPYRAMFD|CTETRA\w+|CHEXA\w+|CPENTA\w+"
)
"""Entries that fill a volume and are not read: hyperelastic, cohesive, acoustic, gaskets, those of other programs."""
_ELEMENT = re.compile(r"C[A-Z]\w*|RBE[123]|RBAR1?|RROD|RSPLINE|RTRPLT1?|RJOINT|RSSCON|MPC|GENEL")
_NO_ELEMENT: Final = re.compile(
    r"CORD\w*|CONV\w*|CY(AX|JOIN|SYM|SUP)|CSET1?|CREEP|CSSCHD|CSUP\w*|CLOAD|CAMPBLL|CBARAO|CBEAMAO|CONCTL|CONTRLT|CEND"
)
_MADE: Final = ("CGEN", "GRIDG", "GRIDU", "EGRID", "SEBULK", "SECONCT")
"""Entries that make or place more of the mesh."""
_IGNORED: Final = 'ignore = ["{}"] in the table of the mesh leaves them out'


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
    entries = Entries(deck.problems)
    entries.read(text, include)
    deck.names = entries.names
    for entry in entries.items:
        deck.take(entry)
    deck.problems.stop()
    return deck.content()


class _BulkData:
    """Nodes and elements as they are read."""

    def __init__(self, where: str) -> None:
        self.problems = FileProblems(where)
        self.names: dict[int, str] = {}
        self.grids = Grids(self.problems)
        # type -> label, property (0: blank) and nodes of each element, 0 for middle nodes that are not there
        self.solids: dict[str, list[tuple[int, int, list[int]]]] = {}
        self.shells: dict[str, list[tuple[int, int, list[int]]]] = {}
        self.lines: dict[int, FileLine] = {}  # of the elements
        # nodes of each set of constraints, each range of them by its ends
        self.fixed: dict[int, list[tuple[int, int]]] = {}
        self.skipped: dict[str, list[BulkEntry]] = {}
        self.attached: list[BulkEntry] = []
        self.refused: dict[str, tuple[str, BulkEntry]] = {}

    def take(self, entry: BulkEntry) -> None:
        """Add a node, element or constraint; entries that define no mesh are ignored."""
        name = entry.name
        try:
            if self.grids.take(entry):
                return
            if name in _SOLIDS:
                self._element(entry, self.solids, _SOLIDS[name])
            elif name in _SHELLS:
                self._element(entry, self.shells, _SHELLS[name])
            elif name in ("SPC", "SPC1"):
                self._constraint(entry)
            else:
                self._other(entry)
        except (ValueError, IndexError):
            self.problems.add(f"not a usable {name} entry", ", ".join(entry.fields), line=entry.place)

    def _element(
        self, entry: BulkEntry, table: dict[str, list[tuple[int, int, list[int]]]], counts: tuple[int, ...]
    ) -> None:
        name, corners = entry.name, counts[0]
        label, owner = label_of(entry.whole(1)), entry.whole(2)
        nodes = [int(f or "0") for f in entry.fields[3 : 3 + counts[-1]]]
        extra = []
        if table is self.solids:
            # blanks and continuation marks follow; numbers there are nodes of a cell with more of them
            extra = [f for f in entry.fields[3 + counts[-1] :] if f.isdigit()]
        while nodes and not nodes[-1]:
            nodes.pop()
        if any(not 0 <= n < 2**62 for n in (*nodes, owner)):
            raise ValueError("not a label")
        if label in self.lines:
            what = f"two elements have the same label: one is on line {self.lines[label].line} already"
            self.problems.add(
                what, f"{name} {label}", "one element for each label", "renumber one of them", entry.place
            )
        self.lines[label] = entry.place
        if table is self.shells:
            # faces have their corners alone
            nodes, counts = nodes[:corners], (corners,)
        # some of the middle nodes may be left out, the last ones without a trace
        count = next((n for n in counts if len(nodes) <= n), 0)
        # nodes in the middle of faces are all there, or none
        edges = {18: 15, 27: 20}.get(count, count)
        whole_centres = edges == count or (len(nodes) == count and all(nodes[edges:]))
        if len(nodes) < corners or not all(nodes[:corners]) or extra or not whole_centres:
            allowed = " or ".join(map(str, counts))
            found = len([n for n in nodes if n]) + len(extra)
            self.problems.add(f"wrong number of nodes of a {name}", found, allowed, line=entry.place)
            return
        if table is self.solids:
            kind = SOLIDS[count]
        else:
            kind = SHELLS[corners]
        table.setdefault(kind, []).append((label, owner, nodes + [0] * (count - len(nodes))))

    def _constraint(self, entry: BulkEntry) -> None:
        fields = entry.fields
        fixed = self.fixed.setdefault(int(fields[1]), [])
        if entry.name == "SPC":
            nodes = [int(f) for f in fields[2::3] if f][:2]  # G1 C1 D1 G2 C2 D2
            ranges = [(n, n) for n in nodes]
        elif len(fields) > 4 and fields[4].upper() == "THRU":  # G1 THRU G2
            ranges = [(int(fields[3]), int(fields[5]))]
        else:
            ranges = [(int(f), int(f)) for f in fields[3:] if f]
        if any(not 0 < n < 2**62 for ends in ranges for n in ends):
            raise ValueError("not a label")
        # nodes are looked up at the end of the file: entries of bulk data may have any order
        fixed += ranges

    def _other(self, entry: BulkEntry) -> None:
        """Elements that are not read, and entries that make more of the mesh."""
        name = entry.name
        if _OTHER_SOLIDS.fullmatch(name):
            self.refused.setdefault(name, ("solids of this kind are not read", entry))
            self.skipped.setdefault(name, []).append(entry)
        elif name in _MADE:
            self.refused.setdefault(name, ("it makes more of the mesh and is not read", entry))
        elif name.startswith("BOLT"):
            what = "bolts of a deck are not read: mesh them with solids and write [bolt.NAME] with the force"
            self.refused.setdefault(name, (what, entry))
        elif _ELEMENT.fullmatch(name) and not _NO_ELEMENT.fullmatch(name):
            self.skipped.setdefault(name, []).append(entry)
            if name in ("CONM2", "RBE2", "RBE3"):
                self.attached.append(entry)

    def content(self) -> MeshContent:
        """Everything by rows and names."""
        labels = np.array(list(self.grids.entries), dtype=np.int64)
        content = MeshContent(self.grids.points())
        for kind, elements in self.solids.items():
            cells = self._rows(labels, elements)
            self.problems.stop()
            ordered, order = in_vtk_order(content.points, kind, cells, "Nastran")
            if order != "Nastran":
                content.said.append(f"the middle nodes of {len(cells)} {kind} cells are in the order of {order}")
            content.add_solids(kind, ordered)
        for kind, elements in self.shells.items():
            cells = self._rows(labels, elements)
            for owner, rows in _by_owner(elements):
                content.add_facets(self._name("PSHELL", owner or elements[rows[0]][0]), kind, cells[rows])
        self.problems.stop()
        complete(content)
        self._add_volumes(content)
        order_of_labels = np.argsort(labels)
        for number, ranges in self.fixed.items():
            first, last = np.array(ranges, dtype=np.int64).reshape(-1, 2).T
            starts = np.searchsorted(labels, first, sorter=order_of_labels)
            # right: a range includes its last node
            stops = np.searchsorted(labels, last, side="right", sorter=order_of_labels)
            rows_of_ranges = [order_of_labels[a:b] for a, b in zip(starts, stops, strict=True)]
            content.add_nodes(f"SPC_{number}", np.concatenate([NO_ROWS, *rows_of_ranges]))
        self._note_others(content, labels)
        self.problems.stop()
        return content

    def _name(self, word: str, owner: int) -> str:
        return self.names.get(owner, f"{word}_{owner}")

    def _add_volumes(self, content: MeshContent) -> None:
        """A group for each property; solids without one are a group for each connected piece."""
        blank: dict[str, Index] = {}
        for kind, elements in self.solids.items():
            for owner, rows in _by_owner(elements):
                if owner:
                    content.add_volume(self._name("PSOLID", owner), kind, rows)
                else:
                    blank[kind] = rows
        if not blank:
            return
        piece_of = pieces({kind: content.solids[kind][rows] for kind, rows in blank.items()})
        names: dict[int, int] = {}  # lowest label of each piece
        for kind, rows in blank.items():
            for row, piece in zip(rows.tolist(), piece_of[kind].tolist(), strict=True):
                names[piece] = min(names.get(piece, 2**62), self.solids[kind][row][0])
        for kind, rows in blank.items():
            for piece, label in names.items():
                if (piece_of[kind] == piece).any():
                    content.add_volume(f"PSOLID_{label}", kind, rows[piece_of[kind] == piece])
        count = sum(len(rows) for rows in blank.values())
        text = f"{count} solids without a property are"
        if len(names) > 1:
            content.said.append(f"{text} {len(names)} bodies, one for each connected piece")
        else:
            content.said.append(f"{text} one body, as they are connected")

    def _note_others(self, content: MeshContent, labels: Index) -> None:
        for name, entries in self.skipped.items():
            properties: dict[str, None] = {}
            nodes: list[int] = []
            for entry in entries:
                if name.startswith(("CBAR", "CBEAM", "CROD", "CTUBE", "CBUSH", "CELAS", "CGAP", "CDAMP", "CBEND")):
                    properties[entry.text(2) or entry.text(1)] = None
                if not is_known(name):
                    nodes += _leading_nodes(entry, self.grids.entries)
            found, there = rows_of(labels, np.array(nodes, dtype=np.int64))
            count = len(entries)
            if not is_known(name) and not _OTHER_SOLIDS.fullmatch(name) and there.sum() < 2 * count:
                continue  # an entry that names no nodes is no element
            skipped = Skipped(name, count, np.array(nodes, dtype=np.int64)[there], entries[0].place, tuple(properties))
            if _OTHER_SOLIDS.fullmatch(name):
                skipped = Skipped(name, count, NO_ROWS, entries[0].place)
            note(content, skipped, nodes_in_cells(content, found[there]), self.problems)
        for name, (what, entry) in self.refused.items():
            count = len(self.skipped.get(name, ())) or 1
            problem = self.problems.problem(what, f"{count} {name}", None, _IGNORED.format(name), entry.place)
            content.refused.setdefault(name, problem)
        for entry in self.attached:
            item = attached_of(entry, labels, self.grids.placed)
            content.attached.append(item)
            if len(item.legs):
                # the middle of a rigid spider may be a node of the face, too
                if item.word == "RBE2":
                    rows = np.append(item.legs, item.node)
                else:
                    rows = item.legs
                content.add_nodes(item.name, rows)

    def _rows(self, labels: Index, elements: list[tuple[int, int, list[int]]]) -> Index:
        """Rows of the nodes of elements, -1 for the label 0."""
        nodes = np.array([nodes for _, _, nodes in elements], dtype=np.int64)
        rows, there = rows_of(labels, nodes.ravel())
        absent = nodes.ravel() == 0
        if not (there | absent).all():
            at = int((there | absent).argmin())
            label, what = elements[at // nodes.shape[1]][0], "an element names a node that no GRID has"
            self.problems.add(what, f"node {nodes.ravel()[at]} of element {label}", line=self.lines[label])
        return np.where(absent, -1, rows).reshape(nodes.shape)


def _leading_nodes(entry: BulkEntry, grids: Container[int]) -> list[int]:
    """Labels of nodes with which an entry goes on after its own label and property; none where a field is no node."""
    nodes = []
    for text in entry.fields[3:]:
        if not (text.isascii() and text.isdigit() and len(text) < 19 and int(text) in grids):
            break
        nodes.append(int(text))
    return nodes


def _by_owner(elements: list[tuple[int, int, list[int]]]) -> list[tuple[int, Index]]:
    """Rows of the elements of each property, in the order of the file."""
    owners = np.array([owner for _, owner, _ in elements], dtype=np.int64)
    return [(owner, np.flatnonzero(owners == owner)) for owner in dict.fromkeys(owners.tolist())]
