"""Nested dissection of the nodes of a mesh: halves first, the nodes between them last, recursively.

A part is cut in the middle of its longest side. That is the best cut of a box. Around holes, in rings, heads and shanks
of meshes from files others have fewer nodes: cuts across the axes of coordinates and of inertia, and cuts around the
middle, along cylinders and spheres. Each candidate is a number for every node; the nodes between are counted at every
cut of all nodes in its order at once, and the best cut of all is taken where it is clearly better. Its separator is the
smallest set of nodes on its two sides that every element across it has one of (the cover of a bipartite graph, by
Konig's theorem).

George, *Nested dissection of a regular finite element mesh*, SIAM J. Numer. Anal. 10 (1973); Ashcraft and Liu,
*Applications of the Dulmage-Mendelsohn decomposition and network flow to graph bisection improvement*, SIAM J. Matrix
Anal. Appl. 19 (1998).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import maximum_bipartite_matching

from .mesh import Array, Index, Mask, Mesh

_LEAF: Final = 24  # nodes of a part that is not cut
_NARROW: Final = 0.3  # of the longest side: no cuts across shorter ones
_HALF: Final = 0.2  # of the nodes, the smaller half of a cut at least
_UNEQUAL: Final = 2.0  # factor on the square of the difference of the halves, over the nodes of the part
_BETTER: Final = 0.95  # times the number of nodes between in the middle of the longest side


def nested_dissection(mesh: Mesh) -> Array:
    """Elimination rank of each node, (n_node,): halves first, the nodes between them last, recursively."""
    return dissection(mesh)[0]


def dissection(mesh: Mesh) -> tuple[Array, Array]:
    """The rank of ``nested_dissection``, and for each node the rank behind the leaf or separator that it belongs to,
    (n_node,) each: nodes of one part may be eliminated in any order among themselves."""
    return dissected(mesh.nodes, _graph(mesh))


def dissected(positions: Array, graph: sp.csr_array) -> tuple[Array, Array]:
    """``dissection`` of points at ``positions`` (n, 3), m, coupled by a symmetric graph (n, n), each with itself."""
    n = len(positions)
    order = np.empty(n, dtype=np.int64)
    behind = np.empty(n)
    number = np.full(n, -1, dtype=np.int64)  # of the nodes of the part at hand
    stack: list[tuple[Index, int]] = [(np.arange(n, dtype=np.int64), n)]
    while stack:  # each entry fills order[end - len : end]
        part, end = stack.pop()
        if len(part) <= _LEAF:
            order[end - len(part) : end] = part
            behind[part] = end
            continue
        subgraph = _part_of(graph, part, number)
        side = _middle(positions[part], subgraph)
        if (better := _better(positions[part], subgraph, side)) is not None:
            side = better
        low, between, high = (part[side == value] for value in (0, 1, 2))
        # the end of the range: a separator is eliminated after both of its halves
        order[end - len(between) : end] = between
        behind[between] = end
        end -= len(between)
        stack.append((high, end))
        stack.append((low, end - len(high)))
    rank = np.empty(n)
    rank[order] = np.arange(n)
    return rank, behind


def _graph(mesh: Mesh) -> sp.csr_array:
    """Nodes that share an element, each with itself."""
    rows = np.concatenate([np.repeat(b.cells, b.cells.shape[1], axis=1).ravel() for b in mesh.blocks])
    columns = np.concatenate([np.tile(b.cells, (1, b.cells.shape[1])).ravel() for b in mesh.blocks])
    rows, columns = (np.concatenate([a, np.arange(mesh.n_node)]) for a in (rows, columns))  # nodes without an element
    # sums of repeated entries may wrap around to 0 in 8 bits: the pattern alone is read
    ones = np.ones(len(rows), dtype=np.int8)
    return sp.coo_array((ones, (rows, columns)), shape=(mesh.n_node, mesh.n_node)).tocsr()


def _part_of(graph: sp.csr_array, part: Index, number: Index) -> tuple[Index, Index]:
    """Row starts and neighbours of the graph of some nodes, numbered by their places in ``part``."""
    number[part] = np.arange(len(part))
    rows = graph[part]
    neighbours = number[rows.indices]
    # one array for all parts, so that each costs its own nodes and not those of the mesh
    number[part] = -1
    inside = neighbours >= 0
    # kept entries in front of each old row start: the row starts without neighbours outside the part
    starts = np.concatenate([[0], np.cumsum(inside)])[rows.indptr]
    return starts.astype(np.int64), neighbours[inside]


def _middle(x: Array, graph: tuple[Index, Index]) -> Index:
    """Side of each node, 0 or 2, 1 between, of the cut in the middle of the longest side."""
    along = x[:, int(np.argmax(np.ptp(x, axis=0)))]
    upper = along > np.median(along)
    if not upper.any():  # half of the nodes, or more, at the largest coordinate
        upper = np.arange(len(x)) >= len(x) // 2
    # no row is empty, for which reduceat would take the next: a node is its own neighbour
    touches = np.logical_or.reduceat(upper[graph[1]], graph[0][:-1])
    return np.where(upper, 2, np.where(touches, 1, 0))  # of the lower half


def _better(x: Array, graph: tuple[Index, Index], side: Index) -> Index | None:
    """A clearly better cut than ``side``; None where there is none."""
    now = _score(*(int(np.count_nonzero(side == value)) for value in (1, 0, 2)))
    best, lower = min((_best_cut(graph, values) for values in _candidates(x)), key=lambda found: found[0])
    if best > now:
        return None
    side = np.where(lower, 0, 2)
    # at most as many nodes as counted in ``_best_cut``: the score is taken anew
    side[_cover(graph, lower)] = 1
    low, between, high = np.bincount(side, minlength=3)[:3].tolist()
    if low and high and _score(between, low, high) < _BETTER * now:
        return side
    return None


def _score(between: float, low: float, high: float) -> float:
    """Nodes of a separator, more for unequal halves."""
    return float(between * (1.0 + _UNEQUAL * ((high - low) / (low + between + high)) ** 2))


def _candidates(x: Array) -> Iterator[Array]:
    """Numbers of the nodes in whose order they may be cut."""
    extent, centred = np.ptp(x, axis=0), x - x.mean(axis=0)
    for axis in np.argsort(-extent, kind="stable"):
        if extent[axis] > _NARROW * extent.max():
            yield x[:, axis]
    # eigenvalues ascend: the two axes of the largest spread
    _, axes = np.linalg.eigh(centred.T @ centred)
    yield centred @ axes[:, 2]
    yield centred @ axes[:, 1]
    # shells around the longest axis
    yield np.linalg.norm(np.delete(centred, int(np.argmax(extent)), axis=1), axis=1)
    yield np.linalg.norm(centred, axis=1)  # shells around the middle


def _best_cut(graph: tuple[Index, Index], values: Array) -> tuple[float, Mask]:
    """Score of the best cut of the nodes in the order of ``values``, and the nodes below it.

    A node at place i whose farthest neighbour has place j is between at the cuts behind i ... j - 1.
    """
    starts, neighbours = graph
    n = len(values)
    place = np.empty(n, dtype=np.int64)
    place[np.argsort(values, kind="stable")] = np.arange(n)
    far = np.maximum.reduceat(place[neighbours], starts[:-1])
    near = np.minimum.reduceat(place[neighbours], starts[:-1])
    below = np.cumsum(1 - np.bincount(far, minlength=n))  # nodes up to each cut that have a neighbour beyond
    above = np.cumsum(np.bincount(near, minlength=n) - 1)  # nodes beyond that have one up to it
    cut = np.arange(int(_HALF * n), int((1.0 - _HALF) * n))
    between = np.minimum(below[cut], above[cut])  # each of the two sets separates
    # cut + 1 nodes are up to a cut, n - cut - 1 beyond
    score = between * (1.0 + _UNEQUAL * ((2 * cut + 2 - n) / n) ** 2)
    best = int(np.argmin(score))
    return float(score[best]), place <= cut[best]


def _cover(graph: tuple[Index, Index], lower: Mask) -> Index:
    """Smallest set of nodes with one of every two neighbours on both sides of a cut."""
    starts, neighbours = graph
    rows = np.repeat(np.arange(len(lower)), np.diff(starts))
    across = lower[rows] & ~lower[neighbours]
    low, i = np.unique(rows[across], return_inverse=True)
    high, j = np.unique(neighbours[across], return_inverse=True)
    edges = sp.csr_array((np.ones(len(i)), (i, j)), shape=(len(low), len(high)))
    partner = maximum_bipartite_matching(sp.csr_matrix(edges), perm_type="column")  # of the low ones, -1 for none
    matched = partner >= 0
    low_of = np.full(len(high), -1, dtype=np.int64)
    low_of[partner[matched]] = np.flatnonzero(matched)
    # low nodes without partner, from which the paths start
    reached, from_low = ~matched, ~matched
    across_to = np.zeros(len(high), dtype=bool)
    while from_low.any():  # along paths that alternate between edges and pairs
        new = (edges.T @ from_low.astype(float) > 0) & ~across_to
        across_to |= new
        back = low_of[new]
        from_low = np.zeros(len(low), dtype=bool)
        # a high node has a partner here: without one the path would make the matching larger
        from_low[back[back >= 0]] = True
        from_low &= ~reached
        reached |= from_low
    # Konig: the low nodes not reached and the high ones reached cover every edge
    return np.concatenate([low[~reached], high[across_to]])
