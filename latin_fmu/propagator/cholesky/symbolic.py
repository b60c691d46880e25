"""Symbolic analysis: what the factor looks like, from the pattern of the matrix alone.

Done on the quotient graph, whose vertices are sets of dofs with one pattern (the three dofs of a node).
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .quotient import Quotient, quotient_graph, running_sum
from .tree import amalgamate, column_counts, elimination_tree, postorder, supernode_rows

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# Supernodes of at most so many columns may hold this part of zeros: fewer and larger blocks are faster.
_LIMIT = np.array([12, 48, 150, 1 << 40])
_FRACTION = np.array([0.8, 0.25, 0.12, 0.05])


@dataclass(frozen=True)
class Symbolic:
    """Pattern of the factor; one serves every matrix with the same pattern and interface.

    Attributes
    ----------
    order : (n,) position -> dof, interface last and sorted. position : its inverse. n_interior : eliminated dofs.
    first : (n_super + 1,) first column of each supernode. row_start, rows : positions below each supernode.
    panel_start : (n_super + 1,) where the panel of each begins. n_children : children with rows below them.
    is_root : whether a supernode has no parent but the interface. stack_size : updates held at one time.
    """

    order: Index
    position: Index
    n_interior: int
    first: Index
    row_start: Index
    rows: Index
    panel_start: Index
    n_children: Index
    is_root: NDArray[np.bool_]
    stack_size: int

    @cached_property
    def tallest(self) -> int:
        """Most rows below one supernode."""
        return int(np.diff(self.row_start).max(initial=0))


class Pattern:
    """What an analysis depends on; equal patterns share theirs (``shared_analysis``)."""

    def __init__(self, matrix: sp.csr_array, last: Index, rank: Array | None) -> None:
        digest = hashlib.blake2b(digest_size=16)
        for array in (matrix.indptr, matrix.indices, last, np.zeros(0) if rank is None else rank):
            digest.update(f"{array.dtype}{array.shape}".encode())
            digest.update(np.ascontiguousarray(array).data)
        self._digest = digest.digest()
        self._given: tuple[sp.csr_array, Index, Array | None] | None = (matrix, last, rank)

    def analyse(self) -> Symbolic:
        """The analysis; the matrix is let go."""
        assert self._given is not None
        found, self._given = analyse(*self._given), None
        return found

    def __hash__(self) -> int:
        return hash(self._digest)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Pattern) and self._digest == other._digest


@lru_cache(maxsize=8)
def shared_analysis(pattern: Pattern) -> Symbolic:
    """``analyse`` for a pattern; blocks of one mesh and steps of one model need it once."""
    return pattern.analyse()


def analyse(matrix: sp.csr_array, last: Index, rank: Array | None = None) -> Symbolic:
    """Pattern of the factor of ``matrix`` (n, n) with the dofs ``last`` kept, ``rank`` (n,) the elimination order."""
    quotient = quotient_graph(matrix, last, rank)
    pointers, neighbours, weight = quotient.pointers, quotient.neighbours, quotient.weight
    parent = elimination_tree(pointers, neighbours, quotient.n_interior)
    count = column_counts(pointers, neighbours, parent, weight)
    owner = amalgamate(parent, count, weight, _LIMIT, _FRACTION)
    tops, owner = np.unique(owner, return_inverse=True)
    above = parent[tops]
    tree = np.where(above >= 0, owner[above], -1)
    sequence = postorder(tree)
    turn = np.empty(len(sequence), dtype=np.int64)
    turn[sequence] = np.arange(len(sequence))
    tree = np.where(tree[sequence] >= 0, turn[tree[sequence]], -1)
    owner = turn[owner]
    quotient = quotient.reordered(np.argsort(owner, kind="stable"))
    return _expand(quotient, np.sort(owner), tree)


def _expand(quotient: Quotient, owner: Index, tree: Index) -> Symbolic:
    """From vertices to dofs; ``owner`` : supernode of each interior vertex, ``tree`` : parent of each supernode."""
    pointers, neighbours, weight = quotient.pointers, quotient.neighbours, quotient.weight
    n_vertex, n_super = len(weight), len(tree)
    of_all = np.concatenate([owner, np.full(n_vertex - len(owner), -1, dtype=np.int64)])
    graph = (pointers, neighbours, of_all, tree, quotient.n_interior)
    nothing = np.zeros(0, dtype=np.int64)
    start = running_sum(supernode_rows(*graph, nothing, nothing))
    vertices = np.empty(start[-1], dtype=np.int64)
    if len(vertices):
        supernode_rows(*graph, start, vertices)
    at = running_sum(weight)
    first = at[np.searchsorted(owner, np.arange(n_super + 1))]
    repeats = weight[vertices]
    ends = running_sum(repeats)
    rows = np.repeat(at[vertices] - ends[:-1], repeats) + np.arange(ends[-1])
    row_start = ends[start]
    width, below = np.diff(first), np.diff(row_start)
    handed = (tree >= 0) & (below > 0)
    n_children = np.bincount(tree[handed], minlength=n_super).astype(np.int64)
    position = np.empty(len(quotient.order), dtype=np.int64)
    position[quotient.order] = np.arange(len(position))
    return Symbolic(
        quotient.order,
        position,
        int(first[-1]),
        first,
        row_start,
        rows,
        running_sum(width * (width + below)),
        n_children,
        tree < 0,
        _stack_size(below, tree, n_children),
    )


def _stack_size(below: Index, tree: Index, n_children: Index) -> int:
    """Largest number of entries of the updates on the stack, that of the front at hand included."""
    sizes: list[int] = []
    held = largest = 0
    for own, parent, children in zip((below**2).tolist(), tree.tolist(), n_children.tolist(), strict=True):
        largest = max(largest, held + own)
        for _ in range(children):
            held -= sizes.pop()
        if parent >= 0 and own > 0:
            sizes.append(own)
            held += own
    return largest
