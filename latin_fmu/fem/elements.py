"""Isoparametric elements of a mesh: integration points, gradients, sums of element matrices, rigid motions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from .mesh import Array, CellBlock, Index, Mesh
from .reference_cells import CELL_EDGES, N_CORNER, Rule, cell_functions, cell_rule

_AT_ONCE = 2**22  # numbers per array of gradients: larger meshes are taken in pieces, for the memory
_STRAIGHT = 1e-9  # of the longest edge: a middle node this close to the middle is there


@dataclass(frozen=True)
class Points:
    """Points in some cells of one type.

    Attributes
    ----------
    cells : (n_cell, n_node). values : (n_point, n_node) shape functions.
    gradients : (n_cell, n_point, n_node, 3) of the shape functions by x, y, z, m-1.
    jacobian : (n_cell, n_point, 3, 3) d x_i / d xi_j. volumes : (n_cell, n_point) weight times det, m3.
    """

    cells: Index
    values: Array
    gradients: Array
    jacobian: Array
    volumes: Array


def jacobians(nodes: Array, block: CellBlock, rule: Rule) -> Array:
    """d x_i / d xi_j (n_cell, n_point, 3, 3) of cells at the points of a rule; ``nodes`` (n_node, 3), m."""
    slopes = cell_functions(block.cell_type).gradients(rule.points)
    corners = nodes[block.cells]
    arms = corners - corners[:, :1]  # a cell far from the origin loses no digits
    return np.asarray(np.einsum("pak,cai->cpik", slopes, arms, optimize=True))


def points_in(nodes: Array, block: CellBlock, rule: Rule) -> Points:
    """Geometry of cells at the points of a rule; ``nodes`` (n_node, 3), m."""
    functions = cell_functions(block.cell_type)
    slopes = functions.gradients(rule.points)
    jacobian = jacobians(nodes, block, rule)
    gradients = slopes @ np.linalg.inv(jacobian)
    volumes = rule.weights * np.linalg.det(jacobian)
    return Points(block.cells, functions.values(rule.points), gradients, jacobian, volumes)


def is_curved(nodes: Array, block: CellBlock) -> bool:
    """Whether a middle node of any cell is out of the middle of its edge."""
    n_corner, edges = N_CORNER[block.cell_type], np.array(CELL_EDGES[block.cell_type])
    if block.cells.shape[1] == n_corner:
        return False
    ends = nodes[block.cells[:, edges]]
    off = nodes[block.cells[:, n_corner : n_corner + len(edges)]] - ends.mean(axis=2)
    return bool(np.abs(off).max() > _STRAIGHT * np.abs(ends[:, :, 1] - ends[:, :, 0]).max())


class Elements:
    """Elements of one mesh; what all sums over them share is made once."""

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh

    def points(self, of_products: bool = False) -> Iterator[tuple[CellBlock, Points]]:
        """Integration points of all cells, block by block in pieces that fit into memory (see ``cell_rule``)."""
        for block in self.mesh.blocks:
            rule = cell_rule(block.cell_type, of_products, is_curved(self.mesh.nodes, block))
            size = max(1, _AT_ONCE // (3 * len(rule.weights) * block.cells.shape[1]))
            for first in range(0, len(block.cells), size):
                piece = CellBlock(block.cell_type, block.cells[first : first + size])
                yield piece, points_in(self.mesh.nodes, piece, rule)

    @cached_property
    def volume(self) -> Array:
        """Volume of every cell, (n_cell,), m3."""
        return np.concatenate([p.volumes.sum(axis=1) for _, p in self.points()])

    @cached_property
    def _pattern(self) -> tuple[Index, Index, Index]:
        """Pairs of nodes that share a cell, as compressed rows; and where the pairs of every cell are among them."""
        n = self.mesh.n_node
        keys = np.concatenate([(b.cells[:, :, None] * n + b.cells[:, None, :]).ravel() for b in self.mesh.blocks])
        pairs, where = np.unique(keys, return_inverse=True)
        starts = np.searchsorted(pairs, n * np.arange(n + 1, dtype=np.int64))
        return starts.astype(np.int64), pairs % n, where.ravel()

    def matrix(self, entries: Array) -> sp.csr_array:
        """Sum of element matrices (3 n_node, 3 n_node), dofs numbered 3 * node + component.

        Parameters
        ----------
        entries : (n_pair, 3, 3), or (n_pair,) for the same entry on all three components; the pairs of nodes (a, b)
            of every cell, row by row, cell by cell.
        """
        starts, columns, where = self._pattern
        data = np.zeros((len(columns), 3, 3))
        if entries.ndim == 1:
            data[:, [0, 1, 2], [0, 1, 2]] = np.bincount(where, entries, len(columns))[:, None]
        else:
            for i in range(3):
                for j in range(3):
                    data[:, i, j] = np.bincount(where, entries[:, i, j], len(columns))
        n = 3 * self.mesh.n_node
        total = sp.csr_array(sp.bsr_array((data, columns, starts), shape=(n, n)).tocsr())
        total.indices, total.indptr = total.indices.astype(np.int64), total.indptr.astype(np.int64)
        return total


@dataclass(frozen=True)
class RigidBody:
    """Six motions of a mesh and their mass.

    Attributes
    ----------
    centre : (3,) mass centre, m. length : size that scales the rotations, m.
    modes : (3 n_node, 6) nodal displacements of three translations along x, y, z and of three rotations of
        1 / length about x, y, z. mass : (6, 6), kg: the consistent mass of the mesh on these motions, exactly.
    """

    centre: Array
    length: float
    modes: Array
    mass: Array

    def coordinates(self, translation: Array, rotation: Array) -> Array:
        """The six unknowns (6,) of a translation (3,) of the centre, m, and a rotation (3,), rad (or their rates)."""
        return np.concatenate([translation, rotation * self.length])

    def with_mass(self, nodes: Array, added: sp.csr_array) -> RigidBody:
        """The motions about the common mass centre with masses at the nodes (3 n_node, 3 n_node), kg, added; ``nodes``
        (n_node, 3) of the mesh, m."""
        mass = self.mass + self.modes.T @ (added @ self.modes)
        shift = np.array([mass[1, 5], -mass[0, 5], mass[0, 4]]) / mass[0, 0]  # over the length
        turn = np.eye(6)
        turn[:3, 3:] = -np.cross(np.eye(3), shift).T
        centre = self.centre + shift * self.length
        mass = turn.T @ mass @ turn
        return RigidBody(centre, self.length, rigid_modes(nodes, centre, self.length), 0.5 * (mass + mass.T))


def rigid_body(mesh: Mesh, density: float) -> RigidBody:
    """Rigid motions of a mesh of uniform density, kg m-3."""
    pieces = list(Elements(mesh).points(of_products=True))
    points = np.concatenate([(p.values @ mesh.nodes[p.cells]).reshape(-1, 3) for _, p in pieces])
    weights = density * np.concatenate([p.volumes.ravel() for _, p in pieces])
    total = float(weights.sum())
    centre = weights @ points / total
    length = mesh.size
    at_points = rigid_modes(points, centre, length).reshape(-1, 3, 6)
    mass = np.einsum("q,qia,qib->ab", weights, at_points, at_points)
    return RigidBody(centre, length, rigid_modes(mesh.nodes, centre, length), 0.5 * (mass + mass.T))


def rigid_modes(points: Array, centre: Array, length: float) -> Array:
    """Displacements (3 n_point, 6) of points (n_point, 3) in the six motions of ``RigidBody``."""
    arm = (points - centre) / length
    modes = np.zeros((len(points), 3, 6))
    modes[:, :, :3] = np.eye(3)
    for axis in range(3):
        modes[:, :, 3 + axis] = np.cross(np.eye(3)[axis], arm)
    return modes.reshape(-1, 6)
