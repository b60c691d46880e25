"""Incompatible modes of 8-node hexahedra: internal displacements that let an element bend.

    u = N d + sum_m (1 - xi_m^2) a_m,      m = 1, 2, 3

The nine internal unknowns a of an element (Wilson et al. 1973) are eliminated inside it, a = -K_aa^-1 K_ad d, so that
nodes, faces and unknowns of the mesh stay what they are. Their gradients are taken with the Jacobian J_0 of the
element's centre (Taylor, Beresford, Wilson 1976),

    grad_x m = det J_0 / det J  J_0^-T grad_xi m,     hence  int grad_x m dV = 0,

which makes uniform strain exact on distorted elements (patch test). The mass is that of the nodes alone.
"""

from __future__ import annotations

import numpy as np

from .element_matrices import elastic_products
from .elements import Points
from .mesh import Array
from .quadrature import cell_rule


def mode_gradients(jacobian: Array) -> Array:
    """Gradients (n_cell, n_point, 3, 3) of the three modes at the points of the hexahedron's rule."""
    xi = cell_rule("hexahedron").points
    slopes = -2.0 * xi[:, :, None] * np.eye(3)  # d m / d xi_m = -2 xi_m
    # the rule is symmetric about the centre and the Jacobian trilinear: its mean over the points is that of the centre
    centre = jacobian.mean(axis=1)
    ratio = np.linalg.det(centre)[:, None] / np.linalg.det(jacobian)
    found: Array = ratio[:, :, None, None] * (slopes[None] @ np.linalg.inv(centre)[:, None])
    return found


def mode_amplitudes(points: Points, first: float, shear: float) -> tuple[Array, Array]:
    """The internal unknowns of each element for unit nodal displacements, and what couples the two.

    Returns
    -------
    -K_aa^-1 K_ad (n_cell, 9, 24) and K_ad (n_cell, 9, 24), both 3 * mode (or node) + component.
    """
    modes = mode_gradients(points.jacobian)
    n = len(modes)
    own = elastic_products(modes, modes, points.volumes, first, shear).reshape(n, 9, 9)
    coupled = elastic_products(modes, points.gradients, points.volumes, first, shear).reshape(n, 9, 24)
    amplitudes = np.asarray(-np.linalg.solve(own, coupled), dtype=float)
    return amplitudes, coupled


def condensed(points: Points, first: float, shear: float) -> Array:
    """Stiffness (n_cell, 8, 3, 8, 3) of hexahedra with bending modes: K_dd - K_da K_aa^-1 K_ad."""
    plain = elastic_products(points.gradients, points.gradients, points.volumes, first, shear)
    amplitudes, coupled = mode_amplitudes(points, first, shear)
    softened = np.swapaxes(coupled, 1, 2) @ amplitudes
    softened = 0.5 * (softened + np.swapaxes(softened, 1, 2))
    matrix: Array = plain + softened.reshape(plain.shape)
    return matrix
