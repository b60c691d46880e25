"""Stiffness, mass and body loads of linear isotropic elasticity, Eqs. (3) and (5)."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from .bending_modes import condensed
from .element_matrices import elastic_products
from .elements import Elements
from .mesh import Array

BENDING_CELLS = ("hexahedron",)
_HRZ = ("tetra10", "hexahedron20")  # row sums of their masses are negative at the corners


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
    bending_modes : 8-node hexahedra get the incompatible modes of ``bending_modes.py``.
    """
    constants = lame(young_modulus, poisson_ratio)
    parts = []
    for block, points in elements.points():
        with_modes = bending_modes and block.cell_type in BENDING_CELLS
        matrix = (
            condensed(points, *constants)
            if with_modes
            else elastic_products(points.gradients, points.gradients, points.volumes, *constants)
        )
        parts.append(matrix.transpose(0, 1, 3, 2, 4).reshape(-1, 3, 3))
    return elements.matrix(np.concatenate(parts))


def mass(elements: Elements, density: float) -> sp.csr_array:
    """Consistent mass M (3 n_node, 3 n_node), kg."""
    parts = []
    for _, points in elements.points(of_products=True):
        products = points.values[:, :, None] * points.values[:, None, :]
        parts.append((density * points.volumes @ products.reshape(len(products), -1)).ravel())
    return elements.matrix(np.concatenate(parts))


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
