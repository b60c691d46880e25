"""Integrals over a named face: areas, vector-area normals, uniform loads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from .facets import basis_change, changes_basis, quadratic, shape, slopes, square_quadrature, triangle_quadrature
from .mesh import Array, FacetSet, Index, Mesh

_GAUSS = 1 / np.sqrt(3.0)


@dataclass(frozen=True)
class Face:
    """Nodes of a face and their share of it.

    Attributes
    ----------
    nodes : (n_point,) node numbers, ascending.
    areas : (n_point,) int psi_a dA, m2, all > 0 for 4-node quadrilaterals and 3-node triangles; 0 at the corners of
        6-node triangles, negative at those of 8-node quadrilaterals.
    vector_areas : (n_point, 3) int psi_a n dA, m2, n outwards.
    change : L (n_point, n_point) of ``facets`` for faces with such facets, else None.
    """

    nodes: Index
    areas: Array
    vector_areas: Array
    change: sp.csr_array | None = None

    @property
    def positive_areas(self) -> Array:
        """Areas of the points in contact, L^T areas, all > 0, (n_point,), m2."""
        return self.areas if self.change is None else self.change.T @ self.areas

    @property
    def normals(self) -> Array:
        """Unit outward normal at each node, (n_point, 3)."""
        vector = self.vector_areas if self.change is None else self.change.T @ self.vector_areas
        normals: Array = vector / np.linalg.norm(vector, axis=1)[:, None]
        return normals


def face(mesh: Mesh, name: str) -> Face:
    """Nodal integrals of the named face (2 x 2 Gauss points on quadrilaterals, exact on triangles)."""
    return face_of(mesh.nodes, mesh.faces[name])


def face_of(places: Array, facets: FacetSet) -> Face:
    """The same of any facets; ``places`` (n_node, 3) are the nodes of the mesh."""
    nodes = facets.nodes
    areas = np.zeros(len(nodes))
    vector_areas = np.zeros((len(nodes), 3))
    for block in facets.blocks:
        integrals = _curved_integrals if quadratic(block.kind) else _facet_integrals
        scalar, vector = integrals(block.kind, places[block.facets])
        at = np.searchsorted(nodes, block.facets)
        np.add.at(areas, at, scalar)
        np.add.at(vector_areas, at, vector)
    return Face(nodes, areas, vector_areas, basis_change(facets, nodes) if changes_basis(facets) else None)


def _curved_integrals(kind: str, places: Array) -> tuple[Array, Array]:
    """The same for facets with inner nodes at ``places`` (n_facet, n_node, 3)."""
    at, weights = triangle_quadrature(6) if kind == "triangle6" else square_quadrature(4)
    along = np.einsum("gak,fai->gkfi", slopes(kind, at), places)
    normal = np.cross(along[:, 0], along[:, 1])
    weighted = weights[:, None] * shape(kind, at)
    return np.einsum("ga,gf->fa", weighted, np.linalg.norm(normal, axis=2)), np.einsum("ga,gfi->fai", weighted, normal)


def _facet_integrals(_: str, corners: Array) -> tuple[Array, Array]:
    """int psi_a dA (n_facet, n_corner) and int psi_a n dA (n_facet, n_corner, 3) of facets with these corners."""
    if corners.shape[1] == 3:
        normal = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        vector = np.repeat(normal[:, None] / 3, 3, axis=1)
        scalar = np.repeat(np.linalg.norm(normal, axis=1)[:, None] / 3, 3, axis=1)
    else:
        vector = np.zeros(corners.shape)
        scalar = np.zeros(corners.shape[:2])
        signs = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], dtype=float)
        for xi, eta in signs * _GAUSS:
            psi = 0.25 * (1 + signs[:, 0] * xi) * (1 + signs[:, 1] * eta)
            d_xi = 0.25 * signs[:, 0] * (1 + signs[:, 1] * eta)
            d_eta = 0.25 * signs[:, 1] * (1 + signs[:, 0] * xi)
            normal = np.cross(np.einsum("a,fai->fi", d_xi, corners), np.einsum("a,fai->fi", d_eta, corners))
            vector += normal[:, None] * psi[None, :, None]
            scalar += np.linalg.norm(normal, axis=1)[:, None] * psi
    return scalar, vector
