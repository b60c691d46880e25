"""Elimination tree, column counts and rows of the supernodes of a symmetric graph (Davis, *Direct methods*, ch. 4).

Graphs are (pointers, neighbours) in elimination order: ``n_interior`` vertices to eliminate, then those that stay.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..compiled import entry

Index = NDArray[np.int64]


def vertex_graph(indptr: Index, indices: Index, vertex: Index, order: Index, start: Index) -> tuple[Index, Index]:
    """Graph of the vertices (loops left out) of a matrix by rows; ``order`` lists the dofs of each from ``start``."""
    pointers, neighbours = np.zeros(len(start), dtype=np.int64), np.empty(len(indices), dtype=np.int64)
    filled = _vertex_graph(indptr, indices, vertex, order, start, _unmarked(len(start) - 1), pointers, neighbours)
    return pointers, neighbours[:filled].copy()


def _unmarked(n: int) -> Index:
    return np.full(n, -1, dtype=np.int64)


@entry("i8[::1], i8[::1], i8[::1], i8[::1], i8[::1], i8[::1], i8[::1], i8[::1] -> i8")
def _vertex_graph(
    indptr: Index,
    indices: Index,
    vertex: Index,
    order: Index,
    start: Index,
    mark: Index,
    pointers: Index,
    neighbours: Index,
) -> int:
    """Fill ``pointers`` (n + 1,) and ``neighbours``; the entries filled. ``mark`` (n,) is scratch, -1 on entry."""
    n, filled = len(start) - 1, 0
    for i in range(n):
        # loops are left out
        mark[i] = i
        for k in range(start[i], start[i + 1]):
            for place in range(indptr[order[k]], indptr[order[k] + 1]):
                j = vertex[indices[place]]
                if mark[j] != i:
                    mark[j] = i
                    neighbours[filled] = j
                    filled += 1
        pointers[i + 1] = filled
    return filled


def elimination_tree(pointers: Index, neighbours: Index, n_interior: int) -> Index:
    """Parent of each interior vertex, (n_interior,), -1 at the roots (Liu's algorithm)."""
    parent = _unmarked(n_interior)
    _elimination_tree(pointers, neighbours, _unmarked(n_interior), parent)
    return parent


@entry("i8[::1], i8[::1], i8[::1], i8[::1]")
def _elimination_tree(pointers: Index, neighbours: Index, ancestor: Index, parent: Index) -> None:
    """Fill ``parent`` (n_interior,); it and ``ancestor``, scratch, are -1 on entry."""
    for i in range(len(parent)):
        for place in range(pointers[i], pointers[i + 1]):
            j = neighbours[place]
            while j < i and j != -1:
                above = ancestor[j]
                # paths are shortened on the way: without it the search is quadratic in their length
                ancestor[j] = i
                if above == -1:
                    parent[j] = i
                    break
                j = above


def column_counts(pointers: Index, neighbours: Index, parent: Index, weight: Index) -> Index:
    """Rows below the diagonal in each interior column of the factor, in dofs: (n_interior,)."""
    count = np.zeros(len(parent), dtype=np.int64)
    _column_counts(pointers, neighbours, parent, weight, _unmarked(len(parent)), count)
    return count


@entry("i8[::1], i8[::1], i8[::1], i8[::1], i8[::1], i8[::1]")
def _column_counts(pointers: Index, neighbours: Index, parent: Index, weight: Index, mark: Index, count: Index) -> None:
    """Fill ``count`` (n_interior,), zero on entry; ``mark``, scratch, is -1 on entry."""
    n_interior = len(parent)
    for i in range(len(pointers) - 1):
        for place in range(pointers[i], pointers[i + 1]):
            j = neighbours[place]
            if j >= n_interior or j >= i:
                continue
            # row i has entries in the columns on the way from j to i in the tree (row subtree)
            while j != -1 and j != i and mark[j] != i:
                mark[j] = i
                count[j] += weight[i]
                j = parent[j]


def amalgamate(parent: Index, count: Index, weight: Index, limit: Index, fraction: NDArray[np.float64]) -> Index:
    """Supernode of each interior vertex, named by its last vertex, (n_interior,).

    First the columns with the same pattern, then (relaxed) children joined to their parents: a supernode of at most
    ``limit[i]`` columns may hold the part ``fraction[i]`` of zeros.
    """
    n = len(parent)
    owner, width = np.arange(n), weight[:n].copy()
    entries = width * (width + 1) // 2 + width * count  # a trapezoid: triangle and rows below
    _amalgamate(parent, count, limit, fraction, width, entries, _unmarked(n), _unmarked(n), owner)
    return owner


@entry("i8[::1], i8[::1], i8[::1], f8[::1], i8[::1], i8[::1], i8[::1], i8[::1], i8[::1]")
def _amalgamate(
    parent: Index,
    count: Index,
    limit: Index,
    fraction: NDArray[np.float64],
    width: Index,
    entries: Index,
    head: Index,
    following: Index,
    owner: Index,
) -> None:
    """Fill ``owner`` (n,), every vertex its own on entry, with ``width`` and ``entries`` of each; the lists of children
    (``head``, ``following``) are scratch, -1 on entry."""
    n = len(parent)
    for relaxed in range(2):
        head[:] = -1
        # backwards: the lists of children ascend
        for c in range(n - 1, -1, -1):
            if owner[c] == c and parent[c] != -1:
                p = parent[c]
                # the parent may have been joined to another supernode in the first round
                while owner[p] != p:
                    p = owner[p]
                following[c] = head[p]
                head[p] = c
        for p in range(n):
            if owner[p] != p:
                continue
            c = head[p]
            while c != -1:
                total = width[c] + width[p]
                nonzeros = entries[c] + entries[p]
                size = total * (total + 1) // 2 + total * count[p]
                join = size == nonzeros
                if relaxed == 1:
                    for i in range(len(limit)):
                        join |= total <= limit[i] and size - nonzeros <= fraction[i] * size
                if join:
                    owner[c] = p
                    width[p] = total
                    # not ``size``: zeros of earlier joins go on counting
                    entries[p] = nonzeros
                c = following[c]
    # backwards: the owner of an owner is final, as it has a larger number
    for c in range(n - 1, -1, -1):
        owner[c] = owner[owner[c]]


def postorder(parent: Index) -> Index:
    """Vertices of a forest, children before parents and each subtree in one piece, (n,)."""
    n = len(parent)
    order = np.empty(n, dtype=np.int64)
    _postorder(parent, _unmarked(n), _unmarked(n), np.empty(n, dtype=np.int64), order)
    return order


@entry("i8[::1], i8[::1], i8[::1], i8[::1], i8[::1]")
def _postorder(parent: Index, head: Index, following: Index, stack: Index, order: Index) -> None:
    """Fill ``order`` (n,); the lists of children (-1 on entry) and the stack are scratch."""
    n = len(parent)
    # from the last on, so that each list begins with the lowest child
    for c in range(n - 1, -1, -1):
        if parent[c] != -1:
            following[c] = head[parent[c]]
            head[parent[c]] = c
    done = 0
    for root in range(n):
        if parent[root] != -1:
            continue
        depth = 1
        stack[0] = root
        while depth > 0:
            c = head[stack[depth - 1]]
            if c == -1:
                depth -= 1
                order[done] = stack[depth]
                done += 1
            else:
                # the child is taken off the list of its parent
                head[stack[depth - 1]] = following[c]
                stack[depth] = c
                depth += 1


def supernode_rows(
    pointers: Index, neighbours: Index, owner: Index, parent: Index, n_interior: int, start: Index, rows: Index
) -> Index:
    """Vertices below each supernode: counts them (n_super,) and, where ``rows`` is not empty, writes them.

    ``owner`` : supernode of each vertex (-1 for those that stay), ``parent`` : tree of the supernodes, ``start`` :
    where the rows of each begin in ``rows``.
    """
    count = np.zeros(len(parent), dtype=np.int64)
    _supernode_rows(pointers, neighbours, owner, parent, n_interior, start, rows, _unmarked(len(parent)), count)
    return count


@entry("i8[::1], i8[::1], i8[::1], i8[::1], i8, i8[::1], i8[::1], i8[::1], i8[::1]")
def _supernode_rows(
    pointers: Index,
    neighbours: Index,
    owner: Index,
    parent: Index,
    n_interior: int,
    start: Index,
    rows: Index,
    mark: Index,
    count: Index,
) -> None:
    """As ``supernode_rows``; ``count`` is zero, ``mark``, scratch, -1 on entry."""
    for i in range(len(pointers) - 1):
        for place in range(pointers[i], pointers[i + 1]):
            j = neighbours[place]
            if j >= n_interior or j >= i:
                continue
            # up the tree as far as the supernode of i itself
            s = owner[j]
            while s != -1 and s != owner[i] and mark[s] != i:
                mark[s] = i
                if len(rows) > 0:
                    # i ascends, and so do the rows of each supernode
                    rows[start[s] + count[s]] = i
                count[s] += 1
                s = parent[s]
