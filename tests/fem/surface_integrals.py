"""Integrals over the facets of a surface by the shape functions and rules of scikit-fem: of every type of cells, also
those that scikit-fem does not have, by the theorem of Gauss: V = 1/3 int x.n dA, and the first moment along x_i is
1/2 int x_i^2 n_i dA."""

from __future__ import annotations

import numpy as np
import skfem
from skfem.quadrature import get_quadrature
from skfem.refdom import RefQuad, RefTri

from latin_fmu.fem.mesh import FacetSet

FACETS = {
    "triangle": (skfem.ElementTriP1(), RefTri),
    "triangle6": (skfem.ElementTriP2(), RefTri),
    "quad": (skfem.ElementQuad1(), RefQuad),
    "quad8": (skfem.ElementQuadS2(), RefQuad),
    "quad9": (skfem.ElementQuad2(), RefQuad),
}


def integrals(nodes: np.ndarray, surface: FacetSet) -> np.ndarray:
    """Volume and first moments behind a closed surface, and its vector area: 7 numbers."""
    total = np.zeros(7)
    for block in surface.blocks:
        element, domain = FACETS[block.kind]
        points, weights = get_quadrature(domain, 10)
        basis = [element.lbasis(points, i) for i in range(block.facets.shape[1])]
        values = np.array([np.broadcast_to(phi, weights.shape) for phi, _ in basis])
        slopes = np.array([[np.broadcast_to(d, weights.shape) for d in dphi] for _, dphi in basis])
        corners = nodes[block.facets]
        x = np.einsum("fni,nq->fqi", corners, values)
        along = np.einsum("fni,ndq->dfqi", corners, slopes)
        normal = np.cross(along[0], along[1]) * weights[:, None]
        total[0] += (x * normal).sum() / 3.0
        total[1:4] += 0.5 * (x**2 * normal).sum(axis=(0, 1))
        total[4:] += normal.sum(axis=(0, 1))
    return total
