"""Nodes of Nastran decks and the coordinate systems that they are given in."""

from __future__ import annotations

import numpy as np

from .content import FileProblems
from .coordinates import BASIC, CoordinateSystem, from_points
from .nastran_entries import BulkEntry, label_of


class Grids:
    """GRID, GRDSET and CORD entries.

    Attributes
    ----------
    entries : GRID by label, in the order of the file. systems : entry by label, and the first of the fields of that
    system in it (CORD1 holds two). default : label of the system where a GRID names none.
    """

    def __init__(self, problems: FileProblems) -> None:
        self.problems = problems
        self.entries: dict[int, BulkEntry] = {}
        self.systems: dict[int, tuple[BulkEntry, int]] = {}
        self.default = 0
        self._placed: dict[int, CoordinateSystem | None] = {0: BASIC}

    def take(self, entry: BulkEntry) -> bool:
        """Add an entry; False where it is none of these."""
        name = entry.name
        if name == "GRID":
            self._add_grid(entry)
        elif name == "GRDSET":
            self.default = entry.whole(2)
        elif name in ("CORD2R", "CORD2C", "CORD2S"):
            self._add_system(label_of(entry.whole(1)), entry, 1)
        elif name in ("CORD1R", "CORD1C", "CORD1S"):
            for first in (1, 5):
                if entry.text(first):
                    self._add_system(label_of(entry.whole(first)), entry, first)
        else:
            return False
        return True

    def _add_grid(self, entry: BulkEntry) -> None:
        label = label_of(entry.whole(1))
        # checked here, so that a wrong number has its line
        values = [entry.number(i) for i in (3, 4, 5)]
        before = self.entries.get(label)
        if before is not None and (before.text(2) != entry.text(2) or [before.number(i) for i in (3, 4, 5)] != values):
            what = f"two nodes have the same label: one is on line {before.place.line} already"
            self.problems.add(what, f"GRID {label}", "one GRID for each label", "renumber one of them", entry.place)
        self.entries[label] = entry

    def _add_system(self, label: int, entry: BulkEntry, first: int) -> None:
        if label in self.systems and self.systems[label][0].fields != entry.fields:
            self.problems.add("two coordinate systems have the same label", label, line=entry.place)
        self.systems[label] = (entry, first)

    def placed(self, label: int, entry: BulkEntry, path: tuple[int, ...] = ()) -> CoordinateSystem:
        """A coordinate system in the basic one; the basic one, with a problem, where it cannot be had."""
        if label in path or label not in self._placed:
            self._placed[label] = None
            if label in path or label not in self.systems:
                what = (
                    "a coordinate system depends on itself" if label in path else "no coordinate system of this label"
                )
                allowed = ", ".join(map(str, sorted(self.systems))) or "none is in the deck"
                self.problems.add(what, label, allowed, "CORD1 and CORD2 of type R, C and S are read", entry.place)
            else:
                system, first = self.systems[label]
                points = self._three_points(system, first, (*path, label))
                self._placed[label] = None if points is None else from_points(system.name[-1], *points)
                if self._placed[label] is None and not self.problems.problems:
                    what = "the points of a coordinate system lie on one line"
                    self.problems.add(what, f"{system.name} {label}", line=system.place)
        return self._placed[label] or BASIC

    def _three_points(
        self, system: BulkEntry, first: int, path: tuple[int, ...]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """Origin, a point of the z axis and one of the plane x z, in the basic system."""
        if system.name.startswith("CORD1"):
            grids = [self.entries.get(system.whole(first + i)) for i in (1, 2, 3)]
            if any(grid is None for grid in grids):
                self.problems.add("a coordinate system names a node that no GRID has", line=system.place)
                return None
            a, b, c = (self._position(grid, path) for grid in grids if grid is not None)
            return a, b, c
        parent = self.placed(system.whole(2), system, path)
        values = np.array([system.number(i) for i in range(3, 12)]).reshape(3, 3)
        a, b, c = parent.basic(values)
        return a, b, c

    def _position(self, grid: BulkEntry, path: tuple[int, ...] = ()) -> np.ndarray:
        label = int(grid.text(2)) if grid.text(2) else self.default
        values = np.array([[grid.number(i) for i in (3, 4, 5)]])
        return np.asarray(self.placed(label, grid, path).basic(values)[0])

    def points(self) -> np.ndarray:
        """Coordinates (n, 3) of the nodes in the basic system."""
        grids = list(self.entries.values())
        points = np.array([[g.number(3), g.number(4), g.number(5)] for g in grids], dtype=float).reshape(-1, 3)
        try:
            systems = np.array([int(g.text(2)) if g.text(2) else self.default for g in grids], dtype=np.int64)
        except (ValueError, OverflowError):
            self.problems.add("a GRID names a coordinate system that is no number")
            return points
        for label in np.unique(systems[systems != 0]).tolist():
            rows = np.flatnonzero(systems == label)
            points[rows] = self.placed(label, grids[rows[0]]).basic(points[rows])
        return points
