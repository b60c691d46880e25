"""Dashpots of an absorbing face: rho c_p along the normal, rho c_s across it."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from .faces import face_of
from .facets import N_CORNER, shape, slopes, square_quadrature, triangle_quadrature
from .mesh import Array, FacetSet, Index


def lumped_dashpots(nodes: Array, facets: FacetSet, normal: float, tangential: float) -> sp.csr_array:
    """Dashpots (3 n_node, 3 n_node), N s m-1, at the points of a face alone, on areas that are positive on every kind
    of facet; ``normal`` and ``tangential`` in Pa s m-1."""
    surface = face_of(nodes, facets)
    blocks = surface.positive_areas[:, None, None] * _tensor(surface.normals, normal, tangential)
    return _assembled(len(nodes), [(surface.nodes[:, None], blocks[:, None, :, None, :])])


def consistent_dashpots(nodes: Array, facets: FacetSet, normal: float, tangential: float) -> sp.csr_array:
    """int phi_a phi_b (z_s I + (z_p - z_s) n n) dA (3 n_node, 3 n_node): on quadratic facets, a uniform velocity gives
    the forces of a uniform traction with these only."""
    parts = []
    for block in facets.blocks:
        at, weights = triangle_quadrature(6) if N_CORNER[block.kind] == 3 else square_quadrature(4)
        along = np.einsum("gak,fai->gkfi", slopes(block.kind, at), nodes[block.facets])
        outwards = np.cross(along[:, 0], along[:, 1])
        area = np.linalg.norm(outwards, axis=2)
        tensor = _tensor(outwards / area[..., None], normal, tangential)
        values = shape(block.kind, at)
        share = (weights[:, None] * area)[..., None, None] * tensor
        parts.append((block.facets, np.einsum("ga,gb,gfij->faibj", values, values, share, optimize=True)))
    return _assembled(len(nodes), parts)


def _tensor(n: Array, normal: float, tangential: float) -> Array:
    found: Array = tangential * np.eye(3) + (normal - tangential) * n[..., :, None] * n[..., None, :]
    return found


def _assembled(n_node: int, parts: list[tuple[Index, Array]]) -> sp.csr_array:
    """Sum of blocks (n, n_own, 3, n_own, 3) at nodes (n, n_own)."""
    rows, columns, values = [], [], []
    for nodes, blocks in parts:
        dofs = (3 * nodes[:, :, None] + np.arange(3)).reshape(len(nodes), -1)
        rows.append(np.repeat(dofs, dofs.shape[1], axis=1).ravel())
        columns.append(np.tile(dofs, (1, dofs.shape[1])).ravel())
        values.append(blocks.ravel())
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return sp.coo_array(entries, shape=(3 * n_node, 3 * n_node)).tocsr()
