"""Points of non-matching interfaces at places where both bodies are held.

A node of the owner that is held (a plane of symmetry, a fixed edge) cannot move, but the other side's row of its point
mixes nodes on the held edge with inner ones: the point would hold those a second time. The tractions were not unique
and the iteration slow, so such a point takes no part in the held direction, as it would not with matching nodes.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..fem.faces import N_CORNER
from ..fem.mesh import Array, FacetSet, Index
from ..fem.surface import Surface
from .conditions import Conditions

Mask = NDArray[np.bool_]
_ON_EDGE = 1e-6  # distance from an edge over the size of the face


def held_dofs(conditions: Conditions) -> Mask:
    """(n_full,) dofs of a body that never move."""
    held: Mask = (np.diff(conditions.expansion.indptr) == 0) & ~conditions.pattern.any(axis=1)
    return held


def held_directions(
    points: Array, normals: Array, own: sp.csr_array, held: Mask, other: Surface, other_held: Mask
) -> tuple[Mask, Mask]:
    """Directions (n_point, 3) in which points of the owner cannot move.

    Parameters
    ----------
    points, normals : (n_point, 3). own : trace of the owner. held, other_held : dofs of both bodies that never move.

    Returns
    -------
    Those at places where the other side is held likewise, and the rest: there the point holds the other side alone.
    """
    still = np.asarray(abs(own) @ (~held).astype(float)).reshape(-1, 3) == 0.0
    both = np.zeros_like(still)
    for axis in range(3):
        rows = np.flatnonzero(still[:, axis])
        if len(rows):
            edges = _edges(other.facets, other_held[axis::3])
            both[rows, axis] = _on_edges(points[rows], normals[rows], other.nodes[edges])
    return both, still & ~both


def without(trace: sp.csr_array, gone: Mask) -> sp.csr_array:
    """The trace without the rows of these directions (n_point, 3)."""
    kept = sp.csr_array(sp.diags_array((~gone).astype(float).ravel()) @ trace)
    kept.eliminate_zeros()
    return kept


def _edges(facets: FacetSet, held: Mask) -> Index:
    """Nodes at the ends (n, 2) of edges whose ends are both ``held`` (n_node,)."""
    found = [np.zeros((0, 2), dtype=np.int64)]
    for block in facets.blocks:
        corners = block.facets[:, : N_CORNER[block.kind]]
        ends = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2)
        found.append(ends[held[ends].all(axis=1)])
    return np.unique(np.sort(np.concatenate(found), axis=1), axis=0)


def _on_edges(points: Array, normals: Array, ends: Array) -> Mask:
    """Whether each of ``points`` (n, 3) lies on one of the edges ``ends`` (m, 2, 3), seen along its normal."""
    on = np.zeros(len(points), dtype=bool)
    if not len(ends):
        return on
    size = float(np.ptp(np.concatenate([points, ends.reshape(-1, 3)]), axis=0).max())
    for i, (point, normal) in enumerate(zip(points, normals, strict=True)):
        start, along = ends[:, 0] - point, ends[:, 1] - ends[:, 0]
        start = start - np.outer(start @ normal, normal)
        along = along - np.outer(along @ normal, normal)
        length = np.maximum(np.einsum("ei,ei->e", along, along), 1e-300)
        at = np.clip(-np.einsum("ei,ei->e", start, along) / length, 0.0, 1.0)
        on[i] = np.linalg.norm(start + at[:, None] * along, axis=1).min() < _ON_EDGE * size
    return on
