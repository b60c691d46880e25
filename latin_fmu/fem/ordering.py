"""Fill-reducing elimination order: nested dissection of the mesh by its coordinates."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from .mesh import Array, Index, Mesh

_LEAF = 24


def nested_dissection(mesh: Mesh) -> Array:
    """Elimination rank of each node, (n_node,): halves first, the nodes between them last, recursively."""
    n = mesh.n_node
    rows = np.concatenate([np.repeat(b.cells, b.cells.shape[1], axis=1).ravel() for b in mesh.blocks])
    columns = np.concatenate([np.tile(b.cells, (1, b.cells.shape[1])).ravel() for b in mesh.blocks])
    graph = sp.coo_array((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(n, n)).tocsr()
    order = np.empty(n, dtype=np.int64)
    side = np.zeros(n, dtype=np.int8)  # 1 and 2: the halves at hand
    stack: list[tuple[Index, int]] = [(np.arange(n, dtype=np.int64), n)]
    while stack:  # each entry fills order[end - len : end]
        part, end = stack.pop()
        if len(part) <= _LEAF:
            order[end - len(part) : end] = part
            continue
        x = mesh.nodes[part]
        axis = int(np.argmax(np.ptp(x, axis=0)))
        upper = x[:, axis] > np.median(x[:, axis])
        if not upper.any():
            upper = np.arange(len(part)) >= len(part) // 2
        high, low = part[upper], part[~upper]
        side[high] = 1
        touches = (graph[low] @ side.astype(np.float64)) > 0
        side[high] = 0
        between, low = low[touches], low[~touches]
        order[end - len(between) : end] = between
        end -= len(between)
        stack.append((high, end))
        stack.append((low, end - len(high)))
    rank = np.empty(n)
    rank[order] = np.arange(n)
    return rank
