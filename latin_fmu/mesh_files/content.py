"""The content of a mesh file in one form for all formats, and what the readers of formats share."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from ..errors import MeshError, Problem, listed
from .deck_card import FileLine as FileLine

if TYPE_CHECKING:
    from .deck_model import DeckModel

Array = NDArray[np.float64]
Index = NDArray[np.int64]

CORNERS: Final = {
    kind: n_corner
    for n_corner, kinds in (
        (4, "tetra tetra8 tetra10 tetra14 tetra20 tetra35"),
        (5, "pyramid pyramid13 pyramid14"),
        (6, "wedge wedge15 wedge18"),
        (8, "hexahedron hexahedron9 hexahedron20 hexahedron24 hexahedron27 hexahedron64 hexahedron125"),
    )
    for kind in kinds.split()
}
"""Corner nodes of the solid cells that files may hold (not all of them can be computed with)."""

FLAT: Final = {
    kind: n_corner
    for n_corner, kinds in ((3, "triangle triangle6 triangle7 triangle10"), (4, "quad quad5 quad8 quad9 quad16"))
    for kind in kinds.split()
}
"""Corner nodes of the surface cells, which come first in their connectivity."""

SOLIDS: Final = {
    4: "tetra",
    5: "pyramid",
    6: "wedge",
    8: "hexahedron",
    10: "tetra10",
    13: "pyramid13",
    15: "wedge15",
    18: "wedge18",
    20: "hexahedron20",
    27: "hexahedron27",
}
"""Solid cells of decks by number of nodes."""

SHELLS: Final = {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8", 9: "quad9"}
"""Shell, membrane, plane and surface cells of decks by number of nodes."""

_UPPER_EDGES_LAST: Final = {15: (*range(9), 12, 13, 14, 9, 10, 11), 20: (*range(12), 16, 17, 18, 19, 12, 13, 14, 15)}
"""Order of the nodes, by their number, of files with the middle nodes of vertical edges before those of upper ones."""

NO_ROWS: Final = np.zeros(0, dtype=np.int64)
_DEEPEST: Final = 10  # levels of decks that include each other: a file that includes itself ends with a message

Include = Callable[[str], str]
"""Text of a file that a deck includes (MeshError where there is none)."""

MAX_PROBLEMS: Final = 8
"""So many problems of one file are listed; the rest follow from them more often than not."""


@dataclass(frozen=True)
class Attached:
    """A point mass, or a spider: a node that is joined to others.

    Attributes
    ----------
    word, label : entry and its number. node : row of the node of the mass, or of the middle of the spider. legs : rows
    of the nodes at the ends of the legs. components : of displacement, at the legs, as digits. mass : in the units of
    the file. offset : (3,) of the mass from its node. inertia : I11, I21, I22, I31, I32, I33 about the mass. problem :
    why it cannot be used, else empty.
    """

    word: str
    label: int
    node: int
    legs: Index
    components: str = "123"
    mass: float = 0.0
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    inertia: tuple[float, ...] = (0.0,) * 6
    problem: str = ""

    @property
    def name(self) -> str:
        """Name of the table and of the node set of the legs."""
        return f"{self.word}_{self.label}"


@dataclass
class MeshContent:
    """Content of a mesh file.

    Attributes
    ----------
    points : (n_point, 3) coordinates, units of the file.
    solids : cell type -> (n_cell, n_node) connectivity, rows of ``points``, VTK order of nodes.
    volumes : name of a volume group -> cell type -> rows of its cells in ``solids``.
    facets : name of a surface group -> arrays (n_facet, 3 | 4) of corner nodes, any orientation.
    node_sets : name -> rows of ``points``.
    parts : the volume groups that are the parts of the model where the format defines them, else None.
    skipped : cells that are neither solids nor surfaces (beams, springs, ...), number by type. properties : those of
        the skipped cells, by type, where the format has any.
    refused : what the reader leaves out and a scene may not miss without saying so, by the word with which ``ignore``
        of the mesh table allows it. said : sentences on how the file was read. attached : point masses and spiders.
        unit : of length, as the file names it; empty where it does not.
    deck : what an Abaqus deck says beyond its mesh, None for other formats. sections : element sets of the solid
        sections of its volume groups, in capitals. types : rows of its cells in ``solids`` by type of element, as the
        deck writes it in capitals, and type of cell. labels : (n,) numbers in the deck of the first n points, those
        that are not made. cell_labels : numbers in the deck of the cells by type of cell, as in ``solids``.
    """

    points: Array
    solids: dict[str, Index] = field(default_factory=dict)
    volumes: dict[str, dict[str, Index]] = field(default_factory=dict)
    facets: dict[str, list[Index]] = field(default_factory=dict)
    node_sets: dict[str, Index] = field(default_factory=dict)
    parts: tuple[str, ...] | None = None
    skipped: dict[str, int] = field(default_factory=dict)
    unit: str = ""
    properties: dict[str, dict[str, None]] = field(default_factory=dict)
    refused: dict[str, Problem] = field(default_factory=dict)
    said: list[str] = field(default_factory=list)
    attached: list[Attached] = field(default_factory=list)
    deck: DeckModel | None = None
    sections: dict[str, list[str]] = field(default_factory=dict)
    types: dict[str, dict[str, Index]] = field(default_factory=dict)
    labels: Index = field(default_factory=lambda: NO_ROWS)
    cell_labels: dict[str, Index] = field(default_factory=dict)

    def add_solids(self, kind: str, cells: Index) -> Index:
        """Append cells of a type to ``solids``; their rows there, (n_cell,)."""
        before = self.solids.get(kind)
        if before is None:
            start = 0
        else:
            start = len(before)
        if before is None:
            self.solids[kind] = cells
        else:
            self.solids[kind] = np.concatenate([before, cells])
        return start + np.arange(len(cells), dtype=np.int64)

    def add_volume(self, name: str, kind: str, rows: Index) -> None:
        """Add rows of ``solids`` to a volume group; a cell given twice is in it once."""
        group = self.volumes.setdefault(name, {})
        group[kind] = np.union1d(group.get(kind, NO_ROWS), rows)

    def add_type(self, name: str, kind: str, rows: Index) -> None:
        """Note rows of ``solids`` as elements of a type of the deck."""
        of_type = self.types.setdefault(name, {})
        of_type[kind] = np.union1d(of_type.get(kind, NO_ROWS), rows)

    def add_cells(self, kind: str, cells: Index) -> Index:
        """Append cells where their type is one of solids; their rows in ``solids``, none for other types."""
        if kind in CORNERS:
            return self.add_solids(kind, cells)
        return NO_ROWS

    def add_facets(self, name: str, kind: str, cells: Index) -> None:
        """Add surface cells (n_facet, n_node) of a type to a surface group: their corners, which come first."""
        self.facets.setdefault(name, []).append(cells[:, : FLAT[kind]])

    def add_nodes(self, name: str, rows: Index) -> None:
        """Add rows of ``points`` to a node set."""
        self.node_sets[name] = np.union1d(self.node_sets.get(name, NO_ROWS), rows)

    def nodes_of(self, group: str) -> Index:
        """Rows of ``points`` that the cells of a volume group have, ascending."""
        tables = [self.solids[kind][rows].ravel() for kind, rows in self.volumes[group].items()]
        if tables:
            return np.unique(np.concatenate(tables))
        return NO_ROWS

    def refuse(self, ignore: Collection[str] = ()) -> None:
        """Raise what may not be left out without a word, but for the words of ``ignore``.

        Raises
        ------
        MeshError : every such problem.
        """
        allowed = {word.lstrip("*").upper() for word in ignore}
        if problems := [problem for word, problem in self.refused.items() if word.upper() not in allowed]:
            raise MeshError(problems, "unreadable mesh")

    def without_solids(self) -> str:
        """What a file without solid cells holds, for a message."""
        plane = len(self.points) > 0 and bool((np.ptp(self.points, axis=0) == 0.0).any())
        faces = sum(len(table) for tables in self.facets.values() for table in tables)
        words = []
        if plane:
            words.append("a plane mesh")
        if faces:
            words.append(f"{faces} surface cells in named groups")
        words += [f"{count} {kind}" for kind, count in self.skipped.items()]
        return "; ".join(words)

    def touching(self, group: str, name: str) -> bool:
        """Whether a surface group or node set has whole facets on the cells of a volume group."""
        cells = {kind: self.solids[kind][rows] for kind, rows in self.volumes[group].items()}
        if name in self.facets:
            nodes = self.nodes_of(group)
            return any(bool(np.isin(table, nodes).all(axis=1).any()) for table in self.facets[name] if len(table))
        some = self.node_sets.get(name, NO_ROWS)
        for kind, table in cells.items():
            corners = CORNERS[kind]
            # of the corners of a side; a wedge counts by its quadrilaterals
            if corners == 4:
                least = 3
            else:
                least = 4
            if (np.isin(table[:, :corners], some).sum(axis=1) >= least).any():
                return True
        return False

    def part_names(self, where: str) -> tuple[str, ...]:
        """The volume groups that share the cells out among them: the parts of an assembly, in file order.

        Groups that only unite others (a set of all elements) are no parts. An empty tuple: the file has no group.

        Raises
        ------
        MeshError : the groups overlap, so that which of them are parts is the user's choice.
        """
        if self.parts is not None:
            return self.parts
        members = {name: _cell_keys(cells) for name, cells in self.volumes.items()}
        members = {name: keys for name, keys in members.items() if len(keys)}
        fine: list[str] = []
        taken = NO_ROWS
        # smallest first, so that a set of sets comes last; of equal ones the last in the file, which the user named
        # (gmsh writes Volume1 with the elements, and the physical group after them)
        late_first = dict.fromkeys(reversed(members))
        for name in sorted(late_first, key=lambda n: len(members[n])):
            inside = np.isin(members[name], taken)
            # a set of whole groups only unites them; one that cuts across is another choice of parts
            united = [other for other in fine if np.isin(members[other], members[name]).all()]
            if inside.all() and sum(len(members[other]) for other in united) == len(members[name]):
                continue
            if inside.any():
                what = "the volume groups overlap, so they cannot all be parts"
                allowed = f"parts = a list out of: {listed(members)}"
                problem = Problem(where, what, name, allowed, "list the groups that are parts")
                raise MeshError([problem], "unusable mesh")
            fine.append(name)
            taken = np.concatenate([taken, members[name]])
        return tuple(name for name in self.volumes if name in fine)


def _cell_keys(cells: dict[str, Index]) -> Index:
    """One number per cell, unique over the cell types."""
    kinds = sorted(CORNERS)
    parts = [rows * len(kinds) + kinds.index(kind) for kind, rows in cells.items()]  # (row, type) as one number
    if parts:
        return np.concatenate(parts)
    return NO_ROWS


def upper_edges_last(cells: Index) -> Index:
    """Cells (n_cell, n_node) in the VTK order, from files that number middle nodes of vertical edges before those of
    upper edges."""
    n_node = cells.shape[1]
    return cells[:, list(_UPPER_EDGES_LAST.get(n_node, range(n_node)))]


class FileProblems:
    """Problems of one file, collected up to ``MAX_PROBLEMS`` and raised together."""

    def __init__(self, where: str) -> None:
        self.where = where
        self.problems: list[Problem] = []

    def add(
        self,
        what: str,
        value: object = None,
        allowed: str | None = None,
        remedy: str | None = None,
        line: int | FileLine | None = None,
    ) -> None:
        """One more problem; ``line`` counts from 1, in the file that is being read where it is a number."""
        problem = self.problem(what, value, allowed, remedy, line)
        # the same problem of many lines is reported once
        if len(self.problems) < MAX_PROBLEMS and problem not in self.problems:
            self.problems.append(problem)

    def problem(
        self,
        what: str,
        value: object = None,
        allowed: str | None = None,
        remedy: str | None = None,
        line: int | FileLine | None = None,
    ) -> Problem:
        """A problem of this file that is not added to the others."""
        if isinstance(line, int):
            line = FileLine(self.where, line)
        if line is None:
            where = self.where
        else:
            where = f"{line.where}, line {line.line}"
        return Problem(where, what, None if value is None else str(value)[:80], allowed, remedy)

    @contextmanager
    def included(self, name: str, include: Include, depth: int, line: int) -> Iterator[str]:
        """Text of a file that a deck includes in this line, empty where decks are nested too deeply; lines of problems
        are counted in that file meanwhile. ``depth`` : of the deck, 0 for the outermost."""
        if depth >= _DEEPEST:
            self.add("files include each other too deeply", name, f"{_DEEPEST} levels", line=line)
            yield ""
            return
        text, outer = include(name), self.where
        self.where = f"{outer}, in {name}"
        yield text
        self.where = outer

    def stop(self) -> None:
        """Raise the problems, if there are any."""
        if self.problems:
            raise MeshError(self.problems, "unreadable mesh")


def rows_of(labels: Index, some: Index) -> tuple[Index, NDArray[np.bool_]]:
    """Position of each of ``some`` in ``labels`` (unique, any order), and which of them are there."""
    if not len(labels):  # there is no last place to clip to
        return np.zeros(len(some), dtype=np.int64), np.zeros(len(some), dtype=bool)
    order = np.argsort(labels, kind="stable")
    # a label above all others has no place: clipped, and found to differ
    place = np.minimum(np.searchsorted(labels, some, sorter=order), len(labels) - 1)
    rows = order[place]
    return rows, labels[rows] == some


def pieces(cells: Mapping[str, Index]) -> dict[str, Index]:
    """Number, from 0, of the connected piece that each cell is in, by type: pieces share no node.

    cells : type -> (n_cell, n_node) rows of points. Pieces are counted in the order of their first cells.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components  # few files need it

    tables = [table for table in cells.values() if len(table)]
    if not tables:
        return dict.fromkeys(cells, NO_ROWS)
    corners = {kind: table[:, : CORNERS[kind]] for kind, table in cells.items()}
    nodes, inverse = np.unique(np.concatenate([c.ravel() for c in corners.values()]), return_inverse=True)
    start = 0
    firsts: list[Index] = []
    others: list[Index] = []
    for table in corners.values():
        rows = inverse[start : start + table.size].reshape(-1, table.shape[1])
        start += table.size
        # each cell as a star about its first node
        firsts.append(np.repeat(rows[:, 0], table.shape[1]))
        others.append(rows.ravel())
    first, other = np.concatenate(firsts), np.concatenate(others)
    graph = coo_array((np.ones(len(first), dtype=np.int8), (first, other)), shape=(len(nodes), len(nodes)))
    label = connected_components(graph, directed=False)[1]
    of_cells = {kind: label[np.searchsorted(nodes, table[:, 0])] for kind, table in corners.items()}
    order = np.concatenate(list(of_cells.values()))
    rank = {int(piece): i for i, piece in enumerate(order[np.sort(np.unique(order, return_index=True)[1])])}
    return {kind: np.array([rank[int(p)] for p in piece], dtype=np.int64) for kind, piece in of_cells.items()}
