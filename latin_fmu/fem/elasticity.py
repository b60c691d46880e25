"""Stiffness and consistent mass of linear isotropic elasticity, Eqs. (3) and (5)."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import skfem

from .mesh import Array, Mesh

# scikit-fem numbers the corners of its reference hexahedron in its own order: VTK corner of each.
_HEX_TO_SKFEM = (0, 4, 3, 1, 7, 5, 2, 6)


def element_basis(mesh: Mesh, order: int = 3) -> skfem.Basis:
    """Scalar linear basis of the mesh; ``order`` 3 is 2 x 2 x 2 Gauss points on hexahedra."""
    (block,) = mesh.blocks
    if block.cell_type == "hexahedron":
        shape = skfem.MeshHex(
            np.ascontiguousarray(mesh.nodes.T), np.ascontiguousarray(block.cells[:, list(_HEX_TO_SKFEM)].T)
        )
        return skfem.Basis(shape, skfem.ElementHex1(), intorder=order)
    tets = skfem.MeshTet(np.ascontiguousarray(mesh.nodes.T), np.ascontiguousarray(block.cells.T))
    return skfem.Basis(tets, skfem.ElementTetP1(), intorder=2)


def lame(young_modulus: float, poisson_ratio: float) -> tuple[float, float]:
    """Lame constants (lambda, mu), Pa."""
    shear = young_modulus / (2 * (1 + poisson_ratio))
    return 2 * shear * poisson_ratio / (1 - 2 * poisson_ratio), shear


def wave_speeds(young_modulus: float, poisson_ratio: float, density: float) -> tuple[float, float]:
    """Pressure and shear wave speeds (c_p, c_s), m s-1."""
    first, shear = lame(young_modulus, poisson_ratio)
    return float(np.sqrt((first + 2 * shear) / density)), float(np.sqrt(shear / density))


def stiffness(basis: skfem.Basis, young_modulus: float, poisson_ratio: float) -> sp.csr_array:
    """Stiffness K (3 n_node, 3 n_node), N m-1, dofs numbered 3 * node + component.

    K_(ai)(bj) = int lambda d_i phi_a d_j phi_b + mu (d_j phi_a d_i phi_b + delta_ij d_k phi_a d_k phi_b).
    """
    first, shear = lame(young_modulus, poisson_ratio)
    gradient = np.stack([phi[0].grad for phi in basis.basis])  # (corner, 3, cell, point)
    pair = np.einsum("aieq,bjeq,eq->eabij", gradient, gradient, basis.dx, optimize=True)
    block = first * pair + shear * np.swapaxes(pair, 3, 4)
    block += shear * np.einsum("eabkk,ij->eabij", pair, np.eye(3))
    return _assemble(block, basis)


def mass(basis: skfem.Basis, density: float) -> sp.csr_array:
    """Consistent mass M (3 n_node, 3 n_node), kg."""
    value = np.stack([np.asarray(phi[0]) for phi in basis.basis])
    pair = density * np.einsum("aeq,beq,eq->eab", *(np.broadcast_to(value, (len(value), *basis.dx.shape)),) * 2,
                               basis.dx, optimize=True)  # fmt: skip
    return _assemble(np.einsum("eab,ij->eabij", pair, np.eye(3)), basis)


def body_load(basis: skfem.Basis, force: Array) -> Array:
    """Nodal forces (3 n_node,) of a uniform body force (3,) in N m-3."""
    value = np.stack([np.asarray(phi[0]) for phi in basis.basis])
    share = np.einsum("aeq,eq->ea", np.broadcast_to(value, (len(value), *basis.dx.shape)), basis.dx)
    nodes = basis.element_dofs.T
    load = np.zeros((basis.N, 3))
    np.add.at(load, nodes.ravel(), share.ravel()[:, None] * np.asarray(force))
    return load.ravel()


def _assemble(block: Array, basis: skfem.Basis) -> sp.csr_array:
    """Sum element blocks (cell, a, b, i, j) into a sparse matrix."""
    n_corner = block.shape[1]
    dofs = 3 * basis.element_dofs.T[:, :, None] + np.arange(3)  # (cell, corner, 3)
    flat = dofs.reshape(len(dofs), 3 * n_corner)
    rows = np.repeat(flat, 3 * n_corner, axis=1).ravel()
    columns = np.tile(flat, (1, 3 * n_corner)).ravel()
    values = block.transpose(0, 1, 3, 2, 4).ravel()
    n = 3 * basis.N
    return sp.coo_array((values, (rows, columns)), shape=(n, n)).tocsr()
