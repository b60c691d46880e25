"""Quotient graph of a symmetric matrix: dofs with the same pattern are one vertex."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

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
        pointers = np.concatenate([[0], np.cumsum(length)])
        picked = np.repeat(self.pointers[sequence] - pointers[:-1], length) + np.arange(pointers[-1])
        at = np.concatenate([[0], np.cumsum(self.weight)])
        weight = self.weight[sequence]
        moved = np.concatenate([[0], np.cumsum(weight)])
        dofs = np.repeat(at[sequence] - moved[:-1], weight) + np.arange(moved[-1])
        return Quotient(pointers, turn[self.neighbours[picked]], weight, self.n_interior, self.order[dofs])


def quotient_graph(matrix: sp.csr_array, last: Index, rank: Array | None) -> Quotient:
    """Quotient graph of ``matrix`` (n, n), interior vertices by ``rank`` (n,) or by minimum degree."""
    n = matrix.shape[0]
    vertex, members, n_interior = _vertices(matrix, last)
    n_vertex = len(members)
    order = np.argsort(vertex, kind="stable")
    weight = np.bincount(vertex, minlength=n_vertex)
    length = np.diff(matrix.indptr)[members].astype(np.int64)
    pointers = np.concatenate([[0], np.cumsum(length)])
    picked = np.repeat(matrix.indptr[members] - pointers[:-1], length) + np.arange(pointers[-1])
    graph = sp.csr_array(
        (np.ones(len(picked), dtype=np.int8), vertex[matrix.indices[picked]], pointers),
        shape=(n_vertex, n_vertex),
    )
    graph.sum_duplicates()
    quotient = Quotient(
        graph.indptr.astype(np.int64), graph.indices.astype(np.int64), weight, n_interior, order
    )
    if rank is None:
        return quotient.reordered(_minimum_degree(graph[:n_interior, :n_interior]))
    highest = np.full(n_vertex, -np.inf)
    np.maximum.at(highest, vertex, np.asarray(rank, dtype=np.float64))
    return quotient.reordered(np.argsort(highest[:n_interior], kind="stable")) if n else quotient


def _vertices(matrix: sp.csr_array, last: Index) -> tuple[Index, Index, int]:
    """Vertex of each dof, one dof of each vertex, number of interior vertices.

    Two dofs with the same pattern have the same sum of random numbers over it. On the interface only neighbours in
    ``last`` are joined, so that its dofs keep their order.
    """
    n = matrix.shape[0]
    label = np.random.default_rng(20240229).integers(1, 2**63, size=n, dtype=np.uint64)
    pattern = sp.csr_array(
        (np.ones(matrix.nnz, dtype=np.uint64), matrix.indices, matrix.indptr), shape=(n, n)
    )
    mark = pattern @ label
    inside = np.ones(n, dtype=bool)
    inside[last] = False
    interior = np.flatnonzero(inside)
    _, chosen, within = np.unique(mark[interior], return_index=True, return_inverse=True)
    fresh = np.ones(len(last), dtype=bool)
    fresh[1:] = mark[last[1:]] != mark[last[:-1]]
    vertex = np.empty(n, dtype=np.int64)
    vertex[interior] = within
    vertex[last] = len(chosen) + np.cumsum(fresh) - 1
    return vertex, np.concatenate([interior[chosen], last[fresh]]), len(chosen)


def _minimum_degree(graph: sp.csr_array) -> Index:
    """Multiple minimum degree ordering of the graph, as the sparse solver of SciPy has it."""
    n = graph.shape[0]
    if n < 3:
        return np.arange(n, dtype=np.int64)
    degree = np.diff(graph.indptr)
    dominant = sp.csc_array(graph.astype(np.float64) + sp.diags_array(degree + 1.0))
    # everything is dropped: only the ordering is wanted
    cheap = spla.spilu(
        dominant, drop_tol=1.0, fill_factor=1.0, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0
    )
    order: Index = np.argsort(cheap.perm_c).astype(np.int64)
    return order
