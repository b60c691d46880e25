"""Mass moved from contact nodes to their inner neighbours.

    M' = R^T M R,   R: velocity of a contact node := mean of its neighbours that are none

Neighbours along cell edges where there are any, else (edges and corners shared by contact faces) across the cell.
R keeps translations, hence total mass and momentum; kinetic energy changes by the motion of one layer relative to
the next (first order in the element).
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .mesh import Array, Index, Mesh

_HEXAHEDRON = ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))
_TETRA = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))


def without_contact_mass(mass: sp.csr_array, mesh: Mesh, nodes: Index) -> sp.csr_array:
    """Mass matrix (3 n_node, 3 n_node) with the mass of ``nodes`` on their inner neighbours.

    Raises
    ------
    ValueError : a node has none (a body one element thick between two contacts).
    """
    edges = _HEXAHEDRON if mesh.cell_type == "hexahedron" else _TETRA
    bare = np.zeros(mesh.n_node, dtype=bool)
    bare[nodes] = True
    pairs = _inner_neighbours(mesh, bare, edges)
    left = bare.copy()
    left[pairs[:, 0]] = False
    across = _inner_neighbours(mesh, left, tuple(combinations(range(mesh.cells.shape[1]), 2)), bare)
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
    mesh: Mesh,
    of: NDArray[np.bool_],
    links: tuple[tuple[int, ...], ...],
    bare: NDArray[np.bool_] | None = None,
) -> Index:
    """Pairs (n, 2): a node marked in ``of`` and a neighbour over one of the ``links`` that is not ``bare``."""
    pairs = mesh.cells[:, np.array(links)].reshape(-1, 2)
    pairs = np.unique(np.concatenate([pairs, pairs[:, ::-1]]), axis=0)
    inner = ~(of if bare is None else bare)
    chosen: Index = pairs[of[pairs[:, 0]] & inner[pairs[:, 1]]]
    return chosen
