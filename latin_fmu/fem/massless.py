"""Mass moved from contact nodes to their inner neighbours.

    M' = R^T M R,   R: velocity of a contact node := mean of its neighbours that are none

Neighbours along cell edges (half edges of quadratic cells) where there are any, else (edges and corners shared by
contact faces) across the cell. R keeps translations, hence total mass and momentum; kinetic energy changes by the
motion of one layer relative to the next (first order in the element).
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import Final

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .cells import CELL_LINKS, N_NODE, Local
from .mesh import Array, Index, Mesh

_DIAGONALS: Final = {name: tuple(combinations(range(count), 2)) for name, count in N_NODE.items()}


def without_contact_mass(mass: sp.csr_array, mesh: Mesh, nodes: Index) -> sp.csr_array:
    """Mass matrix (3 n_node, 3 n_node) with the mass of ``nodes`` on their inner neighbours.

    Raises
    ------
    ValueError : a node has none (a body one element thick between two contacts).
    """
    bare = np.zeros(mesh.n_node, dtype=bool)
    bare[nodes] = True
    pairs = _inner_neighbours(mesh, bare, CELL_LINKS)
    left = bare.copy()
    left[pairs[:, 0]] = False
    across = _inner_neighbours(mesh, left, _DIAGONALS, bare)
    pairs = np.concatenate([pairs, across])
    count = np.bincount(pairs[:, 0], minlength=mesh.n_node)
    kept = np.flatnonzero(count == 0)
    if bare[kept].any():
        raise ValueError("contact nodes without an inner neighbour")
    rows = np.concatenate([pairs[:, 0], kept])
    columns = np.concatenate([pairs[:, 1], kept])
    weights: Array = np.concatenate([1.0 / count[pairs[:, 0]], np.ones(len(kept))])
    follow = sp.csr_array((weights, (rows, columns)), shape=(mesh.n_node, mesh.n_node))
    spread = sp.csr_array(sp.kron(follow, sp.eye_array(3)))
    moved = sp.csr_array(spread.T @ mass @ spread)
    moved.eliminate_zeros()
    return moved


def _inner_neighbours(
    mesh: Mesh, of: NDArray[np.bool_], links: Mapping[str, Local], bare: NDArray[np.bool_] | None = None
) -> Index:
    """Pairs (n, 2): a node marked in ``of``, a neighbour over one of the ``links`` of its cell that is not ``bare``."""
    pairs = np.concatenate([b.cells[:, np.array(links[b.cell_type])].reshape(-1, 2) for b in mesh.blocks])
    pairs = np.unique(np.concatenate([pairs, pairs[:, ::-1]]), axis=0)
    inner = ~(of if bare is None else bare)
    chosen: Index = pairs[of[pairs[:, 0]] & inner[pairs[:, 1]]]
    return chosen
