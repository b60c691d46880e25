"""Blocks of the relative operator of Newton's method at one instant (``kernels.newton``).

Its blocks are the interfaces. Two of them are coupled where they share a substructure; they are numbered by the reverse
Cuthill-McKee ordering of that graph, so that the matrix has a small envelope: block tridiagonal for a chain.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import reverse_cuthill_mckee

from .assembly import Assembly, Index

LARGEST: Final = 2100**2
LARGEST_STATIC: Final = 6000**2
"""Numbers of the matrix up to which Newton's method is used where it factorises one: about 700 points at one interface,
more in chains; about 2000 without inertia, where the iteration alone takes hundreds of products. Large interfaces with
inertia take it by products (``kernels.krylov``)."""


def relative_operator(assembly: Assembly) -> dict[str, Any]:
    """Fields of the record of the run (``kernels.records``); ``n_matrix`` : numbers of the matrix where every point is
    active."""
    layout, owner = assembly.layout, assembly.owners()
    order, low, high = ordered_blocks(assembly, owner[0])
    groups, numbers, sizes, unknowns = [], [], [0], []
    for i in order:
        group = layout.group(i)
        points = np.arange(group.members[i].start, group.members[i].stop)
        groups.append(np.full(len(points), next(g for g, other in enumerate(layout.groups) if other is group)))
        numbers.append(points)
        sizes.append(len(points))
        unknowns.append(len(points) * group.n_component)
    starts = np.cumsum([0, *unknowns])
    return {
        "n_block": len(order),
        "n_unknown": int(starts[-1]),
        "n_matrix": sum(n * int(starts[b + 1] - starts[a]) for n, a, b in zip(unknowns, low, high, strict=True)),
        "block_low": low,
        "block_high": high,
        "block_points": np.cumsum(sizes),
        "n_place": sum(sizes),
        "point_group": np.concatenate([np.zeros(0, dtype=np.int64), *groups]),
        "point_number": np.concatenate([np.zeros(0, dtype=np.int64), *numbers]),
        "point_owned": np.ones(sum(sizes), dtype=np.int64),
        "owner": owner[0],
        "owner_class": owner[1],
        "live_row": owner[2],
    }


def ordered_blocks(assembly: Assembly, owner: Index) -> tuple[list[int], Index, Index]:
    """Interfaces in the order of the blocks; first and last block that each is coupled with, neither decreasing."""
    n = len(assembly.interfaces)
    shares = np.zeros((n, assembly.n_substructure))
    for i in range(n):
        for side in (0, 1):
            body = owner[assembly.layout.channels(i, side).ravel()[0]]
            if body >= 0:
                shares[i, body] = 1.0
    graph = sp.csr_array(shares @ shares.T + np.eye(n))
    order = reverse_cuthill_mckee(graph, symmetric_mode=True) if n else np.zeros(0, dtype=np.int64)
    table = graph.toarray()[np.ix_(order, order)] > 0
    low = np.array([int(np.argmax(row)) for row in table], dtype=np.int64)
    low = np.minimum.accumulate(low[::-1])[::-1].copy()  # of this block or a later one: the factors fill no more
    high = np.array([int(np.flatnonzero(low <= b)[-1]) for b in range(n)], dtype=np.int64)
    return [int(i) for i in order], low, high
