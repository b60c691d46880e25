"""A large factor in pieces that several threads can take: sets of supernodes cut from the elimination tree; a matrix
in parts of its rows.

The tree is cut twice. Its upper supernodes make the trunk, as few of them as leave two halves of about the same size
below; each half is cut in the same way. Pieces of one level are coupled by supernodes above them alone. The cuts depend
on the factor, not on the number of threads.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

import numpy as np
import scipy.sparse as sp

from .substitution import STRIDE
from .symbolic import Index, Symbolic, running_sum

SMALLEST: Final = 200_000
"""Numbers of the panels from which on a factor is cut; those of each piece are at least a tenth of it."""
DEPTH: Final = 2
_BALANCE = 0.56  # of the rest, the larger half at most
_TRUNK = 0.5  # of all, the trunk at most


@dataclass
class Piece:
    """Supernodes that one thread takes.

    Attributes
    ----------
    supernodes : numbers, ascending. children : pieces below. slot : vector that it sums in, 0 for that of the
    substitution; it is that of the first child.
    """

    supernodes: list[int]
    children: list[Piece]
    slot: int = 0
    rows: Index = field(default_factory=lambda: np.zeros(0, dtype=np.int64))  # that sums in its vector reach
    number: int = 0

    def all(self, depth: int) -> list[Piece]:
        """Pieces so far below it."""
        if depth == 0:
            return [self]
        return [p for child in self.children for p in child.all(depth - 1)]


class _Tree:
    """Elimination tree of the supernodes, in postorder."""

    def __init__(self, shape: Symbolic) -> None:
        self.shape, n = shape, len(shape.first) - 1
        width, below = np.diff(shape.first), np.diff(shape.row_start)
        self.cost = width * (width + below)
        nearest = np.full(n, shape.n_interior, dtype=np.int64)
        has = np.flatnonzero(below)
        # supernodes without rows left out: reduceat would give them a row of the next one
        nearest[has] = np.minimum.reduceat(shape.rows, shape.row_start[has]) if len(has) else nearest[has]
        # the first row below a supernode is a column of its parent (n for those below the interface alone)
        parent = np.searchsorted(shape.first, nearest, side="right") - 1
        self.children: list[list[int]] = [[] for _ in range(n)]
        self.total, self.low, self.roots = self.cost.copy(), np.arange(n), list[int]()
        # postorder: the sum of a supernode is complete before it is added to its parent's
        for s in range(n):
            if nearest[s] >= shape.n_interior:
                self.roots.append(s)
            else:
                above = int(parent[s])
                self.children[above].append(s)
                self.total[above] += self.total[s]
                self.low[above] = min(self.low[above], self.low[s])

    def halves(self, forest: list[int]) -> tuple[list[int], list[int], list[int]] | None:
        """Trunk and two sets of subtrees of about the same size; None where there are none."""
        trunk, whole = list[int](), float(self.total[forest].sum())
        forest = sorted(forest, key=lambda s: int(self.total[s]))
        while forest:
            halves: tuple[list[int], list[int]] = ([], [])
            loads = [0.0, 0.0]
            # largest first, each to the lighter half
            for s in reversed(forest):
                lighter = int(loads[1] < loads[0])
                halves[lighter].append(s)
                loads[lighter] += float(self.total[s])
            if halves[1] and max(loads) <= _BALANCE * sum(loads):
                return trunk, sorted(halves[0]), sorted(halves[1])
            # no balance yet: the largest subtree gives its root to the trunk and its children to the forest
            top = forest.pop()
            trunk.append(top)
            forest = sorted([*forest, *self.children[top]], key=lambda s: int(self.total[s]))
            if float(self.cost[trunk].sum()) > _TRUNK * whole:
                return None
        return None

    def piece(self, forest: list[int], depth: int, smallest: float) -> Piece:
        """The piece of a forest, with those below it."""
        cut = self.halves(forest) if depth and float(self.total[forest].sum()) >= 2.0 * smallest else None
        if cut is None:
            # postorder: a subtree is one run of supernodes, from its lowest to its top
            return Piece([s for top in forest for s in range(int(self.low[top]), top + 1)], [])
        trunk, *halves = cut
        return Piece(sorted(trunk), [self.piece(half, depth - 1, smallest) for half in halves])

    def rows_of(self, piece: Piece) -> Index:
        """Rows below the supernodes of a piece."""
        starts, rows = self.shape.row_start, self.shape.rows
        return np.unique(np.concatenate([rows[:0], *(rows[starts[s] : starts[s + 1]] for s in piece.supernodes)]))

    def columns_of(self, piece: Piece) -> Index:
        """Columns of the supernodes of a piece."""
        first, none = self.shape.first, np.zeros(0, dtype=np.int64)
        return np.concatenate([none, *(np.arange(first[s], first[s + 1]) for s in piece.supernodes)])


def pieces(shape: Symbolic) -> tuple[int, int, Index]:
    """Pieces, levels and table of a factor: the first piece of each level, the deepest first, and the end; then the
    pieces; then their lists, at places counted from the start of the table. No pieces for a small factor.

    A piece: its vector; ranges of supernodes; entries of the vector that are set to zero before; pieces below it; rows
    that it hands to the piece above.
    """
    none = 0, 0, np.zeros(1, dtype=np.int64)
    if shape.panel_start[-1] < SMALLEST:
        return none
    tree = _Tree(shape)
    # pieces below a tenth of the factor are not cut
    top = tree.piece(tree.roots, DEPTH, 0.1 * float(shape.panel_start[-1]))
    if not top.children:
        return none
    _take_vectors(tree, top, 0, 1)  # slot 0 is the vector itself
    levels = [top.all(depth) for depth in range(DEPTH, -1, -1)]
    levels = [level for level in levels if level]
    every = [piece for level in levels for piece in level]
    for number, piece in enumerate(every):
        piece.number = number
    # places of the lists count from the start of the table: levels and pieces come before them
    lists = list[Index]()
    table = list[list[int]]()
    at = len(levels) + 1 + STRIDE * len(every)
    for piece in every:
        line = [piece.slot]
        for values in (_ranges(piece), _cleared(tree, top, piece), _numbers(piece), piece.rows):
            line += [at, len(values)]
            lists.append(values)
            at += len(values)
        table.append(line)
    starts = running_sum(np.array([len(level) for level in levels]))
    whole = np.concatenate([starts, np.array(table).ravel(), *lists]).astype(np.int64)
    return len(every), len(levels), whole


def _take_vectors(tree: _Tree, piece: Piece, slot: int, free: int) -> int:
    """Give a piece and those below it their vectors, and the rows that sums in those reach; the next free vector."""
    piece.slot, rows = slot, [tree.rows_of(piece)]
    for i, child in enumerate(piece.children):
        # the first child sums in the vector of the piece, so that its sums need not be added to it
        vector = slot if i == 0 else free
        free = _take_vectors(tree, child, vector, max(free, vector + 1))
        rows.append(child.rows)
    piece.rows = np.setdiff1d(np.unique(np.concatenate(rows)), tree.columns_of(piece))
    return free


def _ranges(piece: Piece) -> Index:
    """Supernodes of a piece as ranges, first and last + 1."""
    if not piece.supernodes:
        return np.zeros(0, dtype=np.int64)
    numbers = np.array(piece.supernodes)
    cuts = np.flatnonzero(np.diff(numbers) > 1)
    ends = np.stack(
        [numbers[np.concatenate([[0], cuts + 1])], numbers[np.concatenate([cuts, [len(numbers) - 1]])] + 1], axis=1
    )
    return ends.ravel()


def _cleared(tree: _Tree, top: Piece, piece: Piece) -> Index:
    """Entries that the lowest piece of a vector sets to zero: those that sums reach, and the columns of the pieces
    above it with the same vector."""
    # vector 0 is that of the substitution itself, with its right-hand side
    if piece.slot == 0 or piece.children:
        return np.zeros(0, dtype=np.int64)
    above, reached = piece, [piece.rows]
    while (parent := _parent(top, above)) is not None and parent.slot == piece.slot:
        reached += [parent.rows, tree.columns_of(parent)]
        above = parent
    return np.unique(np.concatenate(reached))


def _parent(top: Piece, piece: Piece) -> Piece | None:
    """Piece above another one."""
    every = [p for depth in range(DEPTH + 1) for p in top.all(depth)]
    return next((p for p in every if any(child is piece for child in p.children)), None)


def _numbers(piece: Piece) -> Index:
    return np.array([child.number for child in piece.children], dtype=np.int64)


def row_parts(matrix: sp.csr_array, count: int) -> Index:
    """Rows of a symmetric matrix in parts with equal numbers of entries (count, 3): first row, last row + 1, least
    column."""
    n, starts = matrix.shape[0], matrix.indptr
    cuts = np.searchsorted(starts, np.linspace(0, starts[-1], count + 1)[1:-1])
    table = []
    for low, high in pairwise([0, *cuts.tolist(), n]):
        columns = matrix.indices[starts[low] : starts[high]]
        # a product with half of the matrix also adds to the columns of its rows, left of the part
        table.append([low, high, min(int(columns.min(initial=n)), low)])
    return np.array(table, dtype=np.int64)
