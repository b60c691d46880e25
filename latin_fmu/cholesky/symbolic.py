"""Symbolic analysis: what the factor looks like, from the pattern of the matrix alone.

Done on the quotient graph, whose vertices are sets of dofs with one pattern (the three dofs of a node).
"""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from ..operator_store import NO_STORE, OperatorStore
from .tree import amalgamate, column_counts, elimination_tree, postorder, supernode_rows, vertex_graph

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
    face_start : (n_super,) first of the columns of each supernode that loads and solutions on the face pass through,
    its width where none do.
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
    face_start: Index

    @property
    def face_entries(self) -> int:
        """Entries of the factor that a substitution for the face alone reads."""
        width, below = np.diff(self.first), np.diff(self.row_start)
        used = width - self.face_start
        return int((used * (used + below)).sum())


class Pattern:
    """What an analysis depends on; equal patterns share theirs (``shared_analysis``), which may be in a ``store``."""

    def __init__(
        self,
        matrix: sp.csr_array,
        last: Index,
        rank: Array | None,
        face: Index | None = None,
        store: OperatorStore = NO_STORE,
    ) -> None:
        # the numbers of the matrix have no part in it: one analysis for all time steps
        digest = hashlib.blake2b(digest_size=16)
        nothing = np.zeros(0)
        for array in (matrix.indptr, matrix.indices, last, *(nothing if x is None else x for x in (rank, face))):
            digest.update(f"{array.dtype}{array.shape}".encode())
            digest.update(np.ascontiguousarray(array).data)
        self._digest = digest.digest()
        self._store = store
        self._given: tuple[sp.csr_array, Index, Array | None, Index | None] | None = (matrix, last, rank, face)

    def analyse(self) -> Symbolic:
        """The analysis; the matrix is let go."""
        arguments = self._given
        assert arguments is not None

        def make() -> dict[str, NDArray[Any]]:
            return {name: np.asarray(value) for name, value in asdict(analyse(*arguments)).items()}

        fields: dict[str, Any] = dict(self._store.remember(self._store.name("analysis", self._digest), make))
        fields |= {name: int(fields[name]) for name in ("n_interior", "stack_size")}
        self._given = None
        return Symbolic(**fields)

    def __hash__(self) -> int:
        return hash(self._digest)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Pattern) and self._digest == other._digest


@lru_cache(maxsize=16)
def shared_analysis(pattern: Pattern) -> Symbolic:
    """``analyse`` for a pattern; blocks of one mesh and steps of one model need it once."""
    return pattern.analyse()


def analyse(matrix: sp.csr_array, last: Index, rank: Array | None = None, face: Index | None = None) -> Symbolic:
    """Pattern of the factor of ``matrix`` (n, n) with the dofs ``last`` kept, ``rank`` (n,) the elimination order;
    ``face`` : dofs of the face, the last columns of their supernodes."""
    quotient = quotient_graph(matrix, last, rank)
    pointers = quotient.pointers
    neighbours = quotient.neighbours
    weight = quotient.weight
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
    on_face = np.zeros(len(quotient.weight), dtype=bool)
    if face is not None and len(face):
        vertex = np.repeat(np.arange(len(on_face)), quotient.weight)
        on_face[vertex[np.isin(quotient.order, face)]] = True
    # stable: by supernode, within one the vertices of the face last, else as before
    quotient = quotient.reordered(np.lexsort((on_face[: len(owner)], owner)))
    return _expand(quotient, np.sort(owner), tree, face)


def _face_start(first: Index, tree: Index, order: Index, face: Index | None) -> Index:
    """``Symbolic.face_start`` of supernodes with these first columns and parents."""
    start = np.diff(first)
    if face is None or not len(face):
        return start
    position = np.flatnonzero(np.isin(order[: first[-1]], face))[::-1]  # the first one of each supernode wins
    owner = np.searchsorted(first, position, side="right") - 1
    start[owner] = position - first[owner]
    width = np.diff(first)
    for s in range(len(tree)):  # what comes from a child passes through all columns
        if start[s] < width[s] and tree[s] >= 0:
            start[tree[s]] = 0
    return start


def _expand(quotient: Quotient, owner: Index, tree: Index, face: Index | None) -> Symbolic:
    """From vertices to dofs; ``owner`` : supernode of each interior vertex, ``tree`` : parent of each supernode."""
    pointers = quotient.pointers
    neighbours = quotient.neighbours
    weight = quotient.weight
    n_vertex, n_super = len(weight), len(tree)
    of_all = np.concatenate([owner, np.full(n_vertex - len(owner), -1, dtype=np.int64)])
    graph = (pointers, neighbours, of_all, tree, quotient.n_interior)
    nothing = np.zeros(0, dtype=np.int64)
    # the first call counts, the second one writes
    start = running_sum(supernode_rows(*graph, nothing, nothing))
    vertices = np.empty(start[-1], dtype=np.int64)
    if len(vertices):
        supernode_rows(*graph, start, vertices)
    at = running_sum(weight)
    # first dof of each supernode: that of its first vertex, as owners ascend
    first = at[np.searchsorted(owner, np.arange(n_super + 1))]
    repeats = weight[vertices]
    ends = running_sum(repeats)
    # dofs of vertex v are at[v] ... at[v] + weight - 1: one run for each vertex in turn
    rows = np.repeat(at[vertices] - ends[:-1], repeats) + np.arange(ends[-1])
    row_start = ends[start]
    width, below = np.diff(first), np.diff(row_start)
    # supernodes without rows below hand nothing to a parent
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
        # a panel: a square, of which the lower triangle counts, and the rows below it
        running_sum(width * (width + below)),
        n_children,
        tree < 0,
        _stack_size(below, tree, n_children),
        _face_start(first, tree, quotient.order, face),
    )


def _stack_size(below: Index, tree: Index, n_children: Index) -> int:
    """Largest number of entries of the updates on the stack, that of the front at hand included."""
    # as ``factorise`` does: the update at hand lies behind those of its children, and is moved down then
    sizes: list[int] = []
    total = largest = 0
    for size, parent, children in zip((below**2).tolist(), tree.tolist(), n_children.tolist(), strict=True):
        largest = max(largest, total + size)
        for _ in range(children):
            total -= sizes.pop()
        if parent >= 0 and size > 0:
            sizes.append(size)
            total += size
    return largest


@dataclass(frozen=True)
class Quotient:
    """Vertices in elimination order, the interface last.

    Attributes
    ----------
    pointers, neighbours : the graph, vertices by row. weight : dofs of each vertex. n_interior : vertices to
    eliminate. order : (n,) dofs, vertex by vertex.
    """

    pointers: Index
    neighbours: Index
    weight: Index
    n_interior: int
    order: Index

    def reordered(self, interior: Index) -> Quotient:
        """The interior vertices in another order, (n_interior,)."""
        n = len(self.weight)
        sequence = np.concatenate([interior, np.arange(self.n_interior, n)])
        turn = np.empty(n, dtype=np.int64)
        turn[sequence] = np.arange(n)
        length = np.diff(self.pointers)[sequence]
        pointers = running_sum(length)
        # entry e of the new rows is entry e + (old start - new start) of the old ones
        picked = np.repeat(self.pointers[sequence] - pointers[:-1], length) + np.arange(pointers[-1])
        at, weight = running_sum(self.weight), self.weight[sequence]
        moved = running_sum(weight)
        dofs = np.repeat(at[sequence] - moved[:-1], weight) + np.arange(moved[-1])
        return Quotient(pointers, turn[self.neighbours[picked]], weight, self.n_interior, self.order[dofs])


def running_sum(counts: Index) -> Index:
    """Running sum that begins with zero."""
    total = np.zeros(len(counts) + 1, dtype=np.int64)
    np.cumsum(counts, out=total[1:])
    return total


def quotient_graph(matrix: sp.csr_array, last: Index, rank: Array | None) -> Quotient:
    """Quotient graph of ``matrix`` (n, n), interior vertices by ``rank`` (n,) or by minimum degree.

    The pattern may lack entries that happen to be zero: that of the graph is symmetric all the same. Dofs of equal
    rank are one vertex; without a rank, dofs with equal patterns are.
    """
    n = matrix.shape[0]
    mark = _pattern_sums(matrix) if rank is None else np.asarray(rank)
    inside = np.ones(n, dtype=bool)
    inside[last] = False
    interior = np.flatnonzero(inside)
    values, within = np.unique(mark[interior], return_inverse=True)
    n_interior = len(values)
    # on the interface only neighbours in ``last`` are joined, so that its dofs keep their order
    fresh = np.ones(len(last), dtype=bool)
    fresh[1:] = mark[last[1:]] != mark[last[:-1]]
    vertex = np.empty(n, dtype=np.int64)
    vertex[interior] = within
    vertex[last] = n_interior + np.cumsum(fresh) - 1
    order = np.argsort(vertex, kind="stable")
    weight = np.bincount(vertex, minlength=n_interior + int(fresh.sum()))
    pointers, neighbours = vertex_graph(
        matrix.indptr.astype(np.int64), matrix.indices.astype(np.int64), vertex, order, running_sum(weight)
    )
    shape = (len(weight), len(weight))
    graph = sp.csr_array((np.ones(len(neighbours), dtype=np.int8), neighbours, pointers), shape=shape)
    # both triangles, also where one of two entries is zero and not stored
    graph = sp.csr_array(graph + graph.T)
    quotient = Quotient(graph.indptr.astype(np.int64), graph.indices.astype(np.int64), weight, n_interior, order)
    return quotient if rank is not None else quotient.reordered(_minimum_degree(graph[:n_interior, :n_interior]))


def _pattern_sums(matrix: sp.csr_array) -> NDArray[np.uint64]:
    """Sum of random numbers over the pattern of each row, (n,): equal for equal patterns."""
    n = matrix.shape[0]
    label = np.random.default_rng(20240229).integers(1, 2**63, size=n, dtype=np.uint64)
    ones = np.ones(matrix.nnz, dtype=np.uint64)
    pattern = sp.csr_array((ones, matrix.indices, matrix.indptr), shape=(n, n))
    return np.asarray(pattern @ label, dtype=np.uint64)


def _minimum_degree(graph: sp.csr_array) -> Index:
    """Multiple minimum degree ordering of the graph, as the sparse solver of SciPy has it."""
    n = graph.shape[0]
    if n < 3:
        return np.arange(n, dtype=np.int64)
    degree = np.diff(graph.indptr)
    # dominant: no pivot is zero, whatever the pattern
    dominant = sp.csc_array(sp.diags_array(2.0 * degree + 1.0) + graph.astype(np.float64))
    # nearly everything is dropped: only the ordering is wanted
    cheap = spla.spilu(dominant, drop_tol=1.0, fill_factor=1.0, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0)
    order: Index = np.argsort(cheap.perm_c).astype(np.int64)  # perm_c is the place of each vertex
    return order
