"""Boxes of 8-node hexahedra assembled plainly (2 x 2 x 2 Gauss points, consistent mass) and merged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# Corners of the reference cube [-1, 1]^3, bottom face then top face, counter-clockwise seen from above.
_CORNERS = np.array(
    [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]], float
)


@dataclass(frozen=True)
class Solid:
    """Nodes (n, 3), cells (m, 8), mass and stiffness (3 n, 3 n); dof = 3 x node + direction."""

    nodes: Array
    cells: Index
    mass: sparse.csr_matrix
    stiffness: sparse.csr_matrix

    @property
    def n_dof(self) -> int:
        return 3 * len(self.nodes)

    def on_plane(self, axis: int, value: float) -> Index:
        """Nodes of the plane x_axis = value."""
        size = float(np.ptp(self.nodes))
        return np.nonzero(np.abs(self.nodes[:, axis] - value) < 1e-9 * size)[0]

    def face_areas(self, nodes: Index) -> Array:
        """Area of a flat face carried by each of its nodes: integral of its shape function."""
        inside = np.isin(self.cells, nodes)
        areas = np.zeros(len(self.nodes))
        for cell, mask in zip(self.cells[inside.sum(axis=1) == 4], inside[inside.sum(axis=1) == 4], strict=True):
            areas[cell[mask]] += _quadrilateral_shares(self.nodes[cell[mask]])
        return areas[nodes]


def _quadrilateral_shares(corners: Array) -> Array:
    """A rectangle shares its area equally between its corners; only rectangles are needed here."""
    sides = np.sort(np.linalg.norm(corners[1:] - corners[0], axis=1))
    if abs(sides[0] ** 2 + sides[1] ** 2 - sides[2] ** 2) > 1e-9 * sides[2] ** 2:
        raise ValueError("face is not made of rectangles")
    return np.full(4, 0.25 * sides[0] * sides[1])


def box_mesh(origin: Sequence[float], size: Sequence[float], elements: Sequence[int]) -> tuple[Array, Index]:
    """Regular mesh of a box: nodes with x running fastest, and cells."""
    nx, ny, nz = elements
    axes = [o + s * np.linspace(0.0, 1.0, n + 1) for o, s, n in zip(origin, size, elements, strict=True)]
    z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
    nodes = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    number = np.arange(len(nodes)).reshape(nz + 1, ny + 1, nx + 1)
    corners = [
        number[k : nz + k, j : ny + j, i : nx + i].ravel()
        for k, j, i in [(0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0), (1, 0, 0), (1, 0, 1), (1, 1, 1), (1, 1, 0)]
    ]
    return nodes, np.column_stack(corners).astype(np.int64)


def elasticity(young_modulus: float, poisson_ratio: float) -> Array:
    """6 x 6 isotropic law, engineering shears, order xx yy zz yz xz xy."""
    lame = young_modulus * poisson_ratio / ((1 + poisson_ratio) * (1 - 2 * poisson_ratio))
    shear = young_modulus / (2 * (1 + poisson_ratio))
    law = np.diag([2 * shear] * 3 + [shear] * 3)
    law[:3, :3] += lame
    return law


def _strain_matrix(gradients: Array) -> Array:
    """(6, 24) from the (8, 3) gradients of the shape functions."""
    b = np.zeros((6, 24))
    x, y, z = gradients.T
    b[0, 0::3], b[1, 1::3], b[2, 2::3] = x, y, z
    b[3, 1::3], b[3, 2::3] = z, y
    b[4, 0::3], b[4, 2::3] = z, x
    b[5, 0::3], b[5, 1::3] = y, x
    return b


def _element(corners: Array, law: Array, density: float) -> tuple[Array, Array]:
    stiffness, mass = np.zeros((24, 24)), np.zeros((24, 24))
    for place in _CORNERS / np.sqrt(3.0):
        factors = 1.0 + _CORNERS * place
        shape = factors.prod(axis=1) / 8.0
        slopes = np.column_stack([_CORNERS[:, d] * np.delete(factors, d, axis=1).prod(axis=1) / 8.0 for d in range(3)])
        jacobian = slopes.T @ corners
        volume = float(np.linalg.det(jacobian))
        b = _strain_matrix(slopes @ np.linalg.inv(jacobian).T)
        stiffness += volume * b.T @ law @ b
        mass += volume * density * np.kron(np.outer(shape, shape), np.eye(3))
    return stiffness, mass


def assemble(nodes: Array, cells: Index, young: Array, poisson: Array, density: Array) -> Solid:
    """Assemble a mesh whose cells carry their own material."""
    dofs = (3 * cells[:, :, None] + np.arange(3)).reshape(len(cells), 24)
    pairs = [
        _element(nodes[c], elasticity(e, nu), r) for c, e, nu, r in zip(cells, young, poisson, density, strict=True)
    ]
    rows, cols = np.repeat(dofs, 24, axis=1).ravel(), np.tile(dofs, (1, 24)).ravel()
    shape = (3 * len(nodes), 3 * len(nodes))
    stiffness, mass = (
        sparse.csr_matrix((np.concatenate([p[i].ravel() for p in pairs]), (rows, cols)), shape=shape) for i in (0, 1)
    )
    return Solid(nodes, cells, mass, stiffness)


@dataclass(frozen=True)
class Block:
    """A box and its material."""

    origin: tuple[float, float, float]
    size: tuple[float, float, float]
    elements: tuple[int, int, int]
    young_modulus: float
    poisson_ratio: float
    density: float


def merged(blocks: Sequence[Block]) -> Solid:
    """One mesh for several boxes, coincident nodes made one (matching meshes)."""
    meshes = [box_mesh(b.origin, b.size, b.elements) for b in blocks]
    nodes = np.concatenate([m[0] for m in meshes])
    shifts = np.cumsum([0] + [len(m[0]) for m in meshes[:-1]])
    cells = np.concatenate([m[1] + s for m, s in zip(meshes, shifts, strict=True)])
    rounded = np.round(nodes / (1e-9 * float(np.ptp(nodes)))).astype(np.int64)
    _, first, inverse = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
    counts = [len(m[1]) for m in meshes]
    young, poisson, density = (
        np.repeat([getattr(b, name) for b in blocks], counts) for name in ("young_modulus", "poisson_ratio", "density")
    )
    return assemble(nodes[first], inverse.reshape(-1)[cells].astype(np.int64), young, poisson, density)


def matching_nodes(wanted: Array, nodes: Array) -> Index:
    """Index in ``nodes`` of each of the ``wanted`` coordinates; raises ValueError where there is none."""
    distance = np.linalg.norm(wanted[:, None, :] - nodes[None, :, :], axis=2)
    if distance.min(axis=1).max() > 1e-8 * float(np.ptp(nodes)):
        raise ValueError("a node has no counterpart")
    return np.asarray(distance.argmin(axis=1), np.int64)
