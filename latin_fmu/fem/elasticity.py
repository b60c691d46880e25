"""Stiffness, mass and body loads of linear isotropic elasticity, Eqs. (3) and (5).

Incompatible modes of 8-node hexahedra: internal displacements that let an element bend.

    u = N d + sum_m (1 - xi_m^2) a_m,      m = 1, 2, 3

The nine internal unknowns a of an element (Wilson et al. 1973) are eliminated inside it, a = -K_aa^-1 K_ad d, so that
nodes, faces and unknowns of the mesh stay what they are. Their gradients are taken with the Jacobian J_0 of the
element's centre (Taylor, Beresford, Wilson 1976),

    grad_x m = det J_0 / det J  J_0^-T grad_xi m,     hence  int grad_x m dV = 0,

which makes uniform strain exact on distorted elements (patch test). The mass is that of the nodes alone.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy.sparse as sp

from .elements import Elements, Points
from .mesh import Array, Index
from .reference_cells import cell_rule

BENDING_CELLS = ("hexahedron",)
_HRZ = ("tetra10", "hexahedron20")  # row sums of their masses are negative at the corners


def elastic_products(left: Array, right: Array, volumes: Array, first: float, shear: float) -> Array:
    """int eps(v) : C : eps(u) of functions with gradients ``left`` and ``right`` (n_cell, n_point, n, 3).

    Returns
    -------
    (n_cell, n, 3, n', 3) for vector fields made of each function along each axis.
    """
    n_cell, n_point, n, _ = left.shape
    m = right.shape[2]
    rows = (left * volumes[:, :, None, None]).reshape(n_cell, n_point, 3 * n)
    pair = (np.swapaxes(rows, 1, 2) @ right.reshape(n_cell, n_point, 3 * m)).reshape(n_cell, n, 3, m, 3)
    block = first * pair + shear * np.swapaxes(pair, 2, 4)
    trace = shear * np.einsum("eakbk->eab", pair)
    for i in range(3):
        block[:, :, i, :, i] += trace
    return block


def mode_gradients(jacobian: Array) -> Array:
    """Gradients (n_cell, n_point, 3, 3) of the three modes at the points of the hexahedron's rule."""
    xi = cell_rule("hexahedron").points
    slopes = -2.0 * xi[:, :, None] * np.eye(3)  # d m / d xi_m = -2 xi_m
    # the rule is symmetric about the centre and the Jacobian trilinear: its mean over the points is that of the centre
    centre = jacobian.mean(axis=1)
    ratio = np.linalg.det(centre)[:, None] / np.linalg.det(jacobian)
    return np.asarray(ratio[:, :, None, None] * (slopes[None] @ np.linalg.inv(centre)[:, None]))


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
    return np.asarray(plain + softened.reshape(plain.shape))


def lame(young_modulus: float, poisson_ratio: float) -> tuple[float, float]:
    """Lame constants (lambda, mu), Pa."""
    shear = young_modulus / (2 * (1 + poisson_ratio))
    return 2 * shear * poisson_ratio / (1 - 2 * poisson_ratio), shear


def wave_speeds(young_modulus: float, poisson_ratio: float, density: float) -> tuple[float, float]:
    """Pressure and shear wave speeds (c_p, c_s), m s-1."""
    first, shear = lame(young_modulus, poisson_ratio)
    return float(np.sqrt((first + 2 * shear) / density)), float(np.sqrt(shear / density))


def stiffness(
    elements: Elements, young_modulus: float, poisson_ratio: float, bending_modes: bool = False
) -> sp.csr_array:
    """Stiffness K (3 n_node, 3 n_node), N m-1, dofs numbered 3 * node + component.

    K_(ai)(bj) = int lambda d_i phi_a d_j phi_b + mu (d_j phi_a d_i phi_b + delta_ij d_k phi_a d_k phi_b).

    Parameters
    ----------
    bending_modes : 8-node hexahedra get the incompatible modes of the module docstring.
    """
    constants = lame(young_modulus, poisson_ratio)

    def parts() -> Iterator[tuple[Array, Index]]:
        for cell_type, points, of_cell in elements.distinct():
            matrices = element_stiffness(points, *constants, bending_modes and cell_type in BENDING_CELLS)
            yield matrices.transpose(0, 1, 3, 2, 4), of_cell

    return elements.matrix(parts())


def element_stiffness(points: Points, first: float, shear: float, bending_modes: bool) -> Array:
    """Stiffness (n_cell, n, 3, n, 3) of each of some cells, N m-1, from the Lame constants, Pa."""
    if bending_modes:
        return condensed(points, first, shear)
    return elastic_products(points.gradients, points.gradients, points.volumes, first, shear)


def mass(elements: Elements, density: float) -> sp.csr_array:
    """Consistent mass M (3 n_node, 3 n_node), kg."""

    def parts() -> Iterator[tuple[Array, Index]]:
        for _, points, of_cell in elements.distinct(of_products=True):
            products = points.values[:, :, None] * points.values[:, None, :]
            n = points.values.shape[1]
            yield (density * points.volumes @ products.reshape(len(products), -1)).reshape(-1, n, n), of_cell

    return elements.matrix(parts())


def lumped_mass(elements: Elements, density: float) -> Array | None:
    """Positive nodal masses (n_node,), kg; None where the row sums of the consistent mass are as good.

    Row sums of cells that keep the corner functions positive; on tet10 and hex20 the diagonal of the consistent mass of
    each cell, scaled to the mass of the cell (Hinton, Rock, Zienkiewicz 1976).
    """
    if not any(block.cell_type in _HRZ for block in elements.mesh.blocks):
        return None
    total = np.zeros(elements.mesh.n_node)
    for block, points in elements.points(of_products=True):
        if block.cell_type in _HRZ:
            share = points.volumes @ points.values**2
            share *= (points.volumes.sum(axis=1) / share.sum(axis=1))[:, None]
        else:
            share = points.volumes @ points.values
        total += np.bincount(block.cells.ravel(), density * share.ravel(), len(total))
    return total


def body_load(elements: Elements, force: Array) -> Array:
    """Nodal forces (3 n_node,) of a uniform body force (3,) in N m-3."""
    share = np.zeros(elements.mesh.n_node)
    for block, points in elements.points():
        share += np.bincount(block.cells.ravel(), (points.volumes @ points.values).ravel(), len(share))
    return np.outer(share, np.asarray(force)).ravel()
