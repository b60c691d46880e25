"""Nodes of Nastran decks and the coordinate systems that they are given in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .content import Array, FileLine, FileProblems
from .coordinates import BASIC, CoordinateSystem, from_points
from .nastran_entries import BulkEntry, label_of


@dataclass(frozen=True)
class _Grid:
    """A node: label of its system, None where it names none, and its coordinates there."""

    system: int | None
    values: tuple[float, float, float]
    place: FileLine


@dataclass(frozen=True)
class _System:
    """A CORD entry: kind, label of the system that its points are given in, and these; or the labels of three nodes."""

    name: str
    parent: int
    points: tuple[float, ...]
    nodes: tuple[int, ...]
    place: FileLine


class Grids:
    """GRID, GRDSET and CORD entries.

    Attributes
    ----------
    entries : GRID by label, in the order of the file. systems : CORD entries by label. default : label of the system
    where a GRID names none.
    """

    def __init__(self, problems: FileProblems) -> None:
        self.problems = problems
        self.entries: dict[int, _Grid] = {}
        self.systems: dict[int, _System] = {}
        self.default = 0
        self._placed: dict[int, CoordinateSystem | None] = {0: BASIC}

    def take(self, entry: BulkEntry) -> bool:
        """Add an entry; False where it is none of these. ValueError : a field of it is no number."""
        name = entry.name
        if name == "GRID":
            self._add_grid(entry)
        elif name == "GRDSET":
            self.default = entry.whole(2)
        elif name in ("CORD2R", "CORD2C", "CORD2S"):
            points = tuple(entry.number(i) for i in range(3, 12))
            self._add_system(entry.whole(1), _System(name, entry.whole(2), points, (), entry.place))
        elif name in ("CORD1R", "CORD1C", "CORD1S"):
            # one entry may hold two systems
            for first in (1, 5):
                if entry.text(first):
                    nodes = tuple(entry.whole(first + i) for i in (1, 2, 3))
                    self._add_system(entry.whole(first), _System(name, 0, (), nodes, entry.place))
        else:
            return False
        return True

    def _add_grid(self, entry: BulkEntry) -> None:
        label = label_of(entry.whole(1))
        values = (entry.number(3), entry.number(4), entry.number(5))
        grid = _Grid(entry.whole(2) if entry.text(2) else None, values, entry.place)
        before = self.entries.get(label)
        if before is not None and (before.system, before.values) != (grid.system, grid.values):
            what = f"two nodes have the same label: one is on line {before.place.line} already"
            self.problems.add(what, f"GRID {label}", "one GRID for each label", "renumber one of them", entry.place)
        self.entries[label] = grid

    def _add_system(self, label: int, system: _System) -> None:
        before = self.systems.get(label_of(label))
        if before is not None and (before.parent, before.points, before.nodes) != (
            system.parent,
            system.points,
            system.nodes,
        ):
            what = f"two coordinate systems have the same label: one is on line {before.place.line} already"
            self.problems.add(what, label, line=system.place)
        self.systems[label] = system

    def placed(self, label: int, place: FileLine, path: tuple[int, ...] = ()) -> CoordinateSystem:
        """A coordinate system in the basic one; the basic one, with a problem, where it cannot be had.

        place : of the entry that names it. path : labels of the systems that lead to it.
        """
        if label in path or label not in self._placed:
            self._placed[label] = None
            if label in path or label not in self.systems:
                if label in path:
                    what = "a coordinate system depends on itself"
                else:
                    what = "no coordinate system of this label"
                allowed = ", ".join(map(str, sorted(self.systems))) or "none is in the deck"
                self.problems.add(what, label, allowed, "CORD1 and CORD2 of type R, C and S are read", place)
            else:
                system = self.systems[label]
                points = self._three_points(system, (*path, label))
                self._placed[label] = None
                if points is not None:
                    self._placed[label] = from_points(system.name[-1], *points)
                if self._placed[label] is None and not self.problems.problems:
                    what = "the points of a coordinate system lie on one line"
                    self.problems.add(what, f"{system.name} {label}", line=system.place)
        return self._placed[label] or BASIC

    def _three_points(self, system: _System, path: tuple[int, ...]) -> tuple[Array, Array, Array] | None:
        """Origin, a point of the z axis and one of the plane x z, in the basic system."""
        if system.nodes:
            grids = [self.entries.get(node) for node in system.nodes]
            if any(grid is None for grid in grids):
                self.problems.add("a coordinate system names a node that no GRID has", line=system.place)
                return None
            a, b, c = (self._position(grid, path) for grid in grids if grid is not None)
            return a, b, c
        a, b, c = self.placed(system.parent, system.place, path).basic(np.array(system.points).reshape(3, 3))
        return a, b, c

    def _system_of(self, grid: _Grid) -> int:
        if grid.system is None:
            return self.default
        return grid.system

    def _position(self, grid: _Grid, path: tuple[int, ...] = ()) -> Array:
        system = self.placed(self._system_of(grid), grid.place, path)
        return np.asarray(system.basic(np.array([grid.values]))[0])

    def points(self) -> Array:
        """Coordinates (n, 3) of the nodes in the basic system."""
        grids = list(self.entries.values())
        points = np.array([grid.values for grid in grids], dtype=float).reshape(-1, 3)
        of_system: dict[int, list[int]] = {}
        for row, grid in enumerate(grids):
            if label := self._system_of(grid):
                of_system.setdefault(label, []).append(row)
        for label, rows in of_system.items():
            points[rows] = self.placed(label, grids[rows[0]].place).basic(points[rows])
        return points
