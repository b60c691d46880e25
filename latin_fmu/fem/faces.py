"""Integrals over a named face: areas, vector-area normals, uniform loads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .mesh import Array, Index, Mesh

_GAUSS = 1 / np.sqrt(3.0)


@dataclass(frozen=True)
class Face:
    """Nodes of a face and their share of it.

    Attributes
    ----------
    nodes : (n_point,) node numbers, ascending.
    areas : (n_point,) int psi_a dA, m2, all > 0 for 4-node quadrilaterals and 3-node triangles.
    vector_areas : (n_point, 3) int psi_a n dA, m2, n outwards.
    """

    nodes: Index
    areas: Array
    vector_areas: Array

    @property
    def normals(self) -> Array:
        """Unit outward normal at each node, (n_point, 3)."""
        normals: Array = self.vector_areas / np.linalg.norm(self.vector_areas, axis=1)[:, None]
        return normals


def face(mesh: Mesh, name: str) -> Face:
    """Nodal integrals of the named face (2 x 2 Gauss points on quadrilaterals, exact on triangles)."""
    blocks = mesh.faces[name].blocks
    nodes = mesh.faces[name].nodes
    areas = np.zeros(len(nodes))
    vector_areas = np.zeros((len(nodes), 3))
    for block in blocks:
        scalar, vector = _facet_integrals(mesh.nodes[block.facets])
        at = np.searchsorted(nodes, block.facets)
        np.add.at(areas, at, scalar)
        np.add.at(vector_areas, at, vector)
    return Face(nodes, areas, vector_areas)


def _facet_integrals(corners: Array) -> tuple[Array, Array]:
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
