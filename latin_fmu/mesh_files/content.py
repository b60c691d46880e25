"""The content of a mesh file in one form for all formats, and what the readers of formats share."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from ..errors import MeshError, Problem, listed

if TYPE_CHECKING:
    from .deck_model import DeckModel

Array = NDArray[np.float64]
Index = NDArray[np.int64]

CORNERS: Final = {
    "tetra": 4,
    "tetra10": 4,
    "wedge": 6,
    "wedge15": 6,
    "hexahedron": 8,
    "hexahedron20": 8,
    "hexahedron27": 8,
    "pyramid": 5,
    "pyramid13": 5,
    "pyramid14": 5,
    "hexahedron24": 8,
    "hexahedron9": 8,
    "wedge18": 6,
    "hexahedron64": 8,
    "tetra20": 4,
    "tetra14": 4,
    "tetra8": 4,
    "hexahedron125": 8,
    "tetra35": 4,
}
"""Corner nodes of the solid cells that files may hold (not all of them can be computed with)."""

FLAT: Final = {
    "triangle": 3,
    "triangle6": 3,
    "triangle7": 3,
    "triangle10": 3,
    "quad": 4,
    "quad8": 4,
    "quad9": 4,
    "quad5": 4,
    "quad16": 4,
}
"""Corner nodes of the surface cells, which come first in their connectivity."""

SOLIDS: Final = {4: "tetra", 6: "wedge", 8: "hexahedron", 10: "tetra10", 15: "wedge15", 20: "hexahedron20"}
"""Solid cells of decks by number of nodes."""

UPPER_EDGES_LAST: Final = {15: (*range(9), 12, 13, 14, 9, 10, 11), 20: (*range(12), 16, 17, 18, 19, 12, 13, 14, 15)}
"""Order of the nodes, by their number, of files with the middle nodes of vertical edges before those of upper ones."""

DEEPEST: Final = 10
"""Levels of decks that include each other."""

MAX_PROBLEMS: Final = 8
"""So many problems of one file are listed; the rest follow from them more often than not."""


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
    skipped : cells that are neither solids nor surfaces (beams, springs, ...), number by type.
    deck : what an Abaqus deck says beyond its mesh, None for other formats. sections : element sets of the solid
        sections of its volume groups, in capitals.
    """

    points: Array
    solids: dict[str, Index] = field(default_factory=dict)
    volumes: dict[str, dict[str, Index]] = field(default_factory=dict)
    facets: dict[str, list[Index]] = field(default_factory=dict)
    node_sets: dict[str, Index] = field(default_factory=dict)
    parts: tuple[str, ...] | None = None
    skipped: dict[str, int] = field(default_factory=dict)
    deck: DeckModel | None = None
    sections: dict[str, list[str]] = field(default_factory=dict)

    def touching(self, group: str, name: str) -> bool:
        """Whether a surface group or node set has whole facets on the cells of a volume group."""
        cells = {kind: self.solids[kind][rows] for kind, rows in self.volumes[group].items()}
        if name in self.facets:
            nodes = np.unique(np.concatenate([table.ravel() for table in cells.values()]))
            return any(bool(np.isin(table, nodes).all(axis=1).any()) for table in self.facets[name] if len(table))
        some = self.node_sets.get(name, np.zeros(0, dtype=np.int64))
        for kind, table in cells.items():
            corners = CORNERS[kind]
            least = 3 if corners == 4 else 4  # of the corners of a side; a wedge counts by its quadrilaterals
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
        taken = np.zeros(0, dtype=np.int64)
        # smallest first, so that a set of sets comes last; of equal ones the last in the file, which the user named
        # (gmsh writes Volume1 with the elements, and the physical group after them)
        late_first = dict.fromkeys(reversed(members))
        for name in sorted(late_first, key=lambda n: len(members[n])):
            inside = np.isin(members[name], taken)
            if inside.all():
                continue
            if inside.any():
                what = "the volume groups overlap, so they cannot all be parts"
                known = f"parts = a list out of: {listed(members)}"
                problem = Problem(where, what, name, known, "list the groups that are parts")
                raise MeshError([problem], "unusable mesh")
            fine.append(name)
            taken = np.concatenate([taken, members[name]])
        return tuple(name for name in self.volumes if name in fine)


def _cell_keys(cells: dict[str, Index]) -> Index:
    """One number per cell, unique over the cell types."""
    kinds = sorted(CORNERS)
    parts = [rows * len(kinds) + kinds.index(kind) for kind, rows in cells.items()]
    return np.concatenate(parts) if parts else np.zeros(0, dtype=np.int64)


class FileProblems:
    """FileProblems of one file, collected up to ``MAX_PROBLEMS`` and raised together."""

    def __init__(self, where: str) -> None:
        self.where = where
        self.problems: list[Problem] = []

    def add(
        self,
        what: str,
        value: object = None,
        allowed: str | None = None,
        remedy: str | None = None,
        line: int | None = None,
    ) -> None:
        """One more problem; ``line`` counts from 1."""
        place = self.where if line is None else f"{self.where}, line {line}"
        text = None if value is None else str(value)[:80]
        problem = Problem(place, what, text, allowed, remedy)
        if len(self.problems) < MAX_PROBLEMS and problem not in self.problems:
            self.problems.append(problem)

    def stop(self) -> None:
        """Raise the problems, if there are any."""
        if self.problems:
            raise MeshError(self.problems, "unreadable mesh")


def rows_of(labels: Index, some: Index) -> tuple[Index, NDArray[np.bool_]]:
    """Position of each of ``some`` in ``labels`` (unique, any order), and which of them are there."""
    if not len(labels):
        return np.zeros(len(some), dtype=np.int64), np.zeros(len(some), dtype=bool)
    order = np.argsort(labels, kind="stable")
    place = np.minimum(np.searchsorted(labels, some, sorter=order), len(labels) - 1)
    rows = order[place]
    return rows, labels[rows] == some
