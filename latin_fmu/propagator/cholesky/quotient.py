"""Quotient graph of a symmetric matrix: the dofs of a node, or dofs with one pattern, are one vertex."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from .tree import vertex_graph

Array = NDArray[np.float64]
Index = NDArray[np.int64]


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
    dominant = sp.csc_array(sp.diags_array(2.0 * degree + 1.0) + graph.astype(np.float64))
    # nearly everything is dropped: only the ordering is wanted
    cheap = spla.spilu(dominant, drop_tol=1.0, fill_factor=1.0, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0)
    order: Index = np.argsort(cheap.perm_c).astype(np.int64)
    return order
