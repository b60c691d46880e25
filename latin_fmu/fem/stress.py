"""Strains and stresses from nodal displacements: means over the elements, and values at the nodes.

Tensors are six numbers in the order xx yy zz yz xz xy; strains are components of the tensor (half the engineering
shear). At the nodes, each element carries the values at the points of a low rule, where they are most accurate
(Barlow 1976), to its nodes by its linear functions; elements that share a node are averaged by volume.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
import scipy.sparse as sp

from .elements import BENDING_CELLS, Elements, Points, lame, mode_amplitudes, mode_gradients, points_in
from .mesh import Array, CellBlock
from .reference_cells import Rule, cell_functions, cell_rule

_ROWS, _COLUMNS = (0, 1, 2, 1, 0, 0), (0, 1, 2, 2, 2, 1)
# Type of the cell of degree one with the same corners: its rule and functions carry values to the nodes.
_LINEAR: Final = {"hexahedron20": "hexahedron", "hexahedron27": "hexahedron", "tetra10": "tetra"}
_AT_ONCE = 2**22  # numbers per array: many instants and cells are taken in pieces, for the memory


class MeanStress:
    """Mean stress of each element for one mesh and material; the mean gradients are computed once.

    Parameters
    ----------
    elements : of the mesh. young_modulus : Pa. poisson_ratio : 1.
    """

    def __init__(self, elements: Elements, young_modulus: float, poisson_ratio: float) -> None:
        self._means = [(b.cells, _mean_gradients(p)) for b, p in elements.points()]
        self._lame = lame(young_modulus, poisson_ratio)

    def __call__(self, displacement: Array) -> Array:
        """Mean stress (n_cell, 6), Pa, of displacements (n_node, 3), m."""
        slopes = [np.swapaxes(mean, 1, 2) @ displacement[cells] for cells, mean in self._means]
        return hooke(_symmetric(np.concatenate(slopes)), *self._lame)


class Recovery:
    """Strains of the elements and stresses at the nodes for one mesh and material.

    Parameters
    ----------
    elements, young_modulus, poisson_ratio : as in ``MeanStress``. bending_modes : as in ``elements.stiffness``.
    """

    def __init__(
        self, elements: Elements, young_modulus: float, poisson_ratio: float, bending_modes: bool = False
    ) -> None:
        self._elements, self._bending = elements, bending_modes
        self._lame = lame(young_modulus, poisson_ratio)

    def strain(self, displacement: Array) -> Array:
        """Mean strain (n_time, n_cell, 6) of displacements (n_time, n_node, 3), m."""
        parts = [
            _symmetric(np.swapaxes(_mean_gradients(points), 1, 2) @ displacement[:, points.cells])
            for _, points in self._elements.points()
        ]
        return np.concatenate(parts, axis=1)

    def nodal_stress(self, displacement: Array) -> Array:
        """Stress at the nodes (n_time, n_node, 6), Pa, of displacements (n_time, n_node, 3), m."""
        n_time, n_node, _ = displacement.shape
        total, weight = np.zeros((n_node, n_time * 6)), np.zeros(n_node)
        for block, rule, to_nodes in self._pieces(n_time):
            points = points_in(self._elements.mesh.nodes, block, rule)
            slopes = np.einsum("cpaj,tcai->tcpij", points.gradients, displacement[:, block.cells], optimize=True)
            if self._bending and block.cell_type in BENDING_CELLS:
                slopes += self._mode_slopes(points, displacement)
            stress = hooke(_symmetric(slopes), *self._lame)
            at_nodes = np.einsum("ap,tcpk->catk", to_nodes, stress, optimize=True)
            volumes = np.repeat(points.volumes.sum(axis=1), block.cells.shape[1])
            where = (volumes, (block.cells.ravel(), np.arange(block.cells.size)))
            share = sp.csr_array(sp.coo_array(where, shape=(n_node, block.cells.size)))
            total += share @ at_nodes.reshape(block.cells.size, -1)
            weight += share @ np.ones(block.cells.size)
        return np.swapaxes((total / weight[:, None]).reshape(n_node, n_time, 6), 0, 1)

    def _pieces(self, n_time: int) -> Iterator[tuple[CellBlock, Rule, Array]]:
        """Blocks in pieces, with the rule of the points and the matrix (n_node, n_point) from there to the nodes."""
        for block in self._elements.mesh.blocks:
            linear = _LINEAR.get(block.cell_type, block.cell_type)
            rule, functions = cell_rule(linear), cell_functions(linear)
            at_nodes = functions.values(cell_functions(block.cell_type).nodes)
            to_nodes = at_nodes @ np.linalg.pinv(functions.values(rule.points))
            size = max(1, _AT_ONCE // (9 * max(n_time, 3) * block.cells.shape[1]))
            for first in range(0, len(block.cells), size):
                yield CellBlock(block.cell_type, block.cells[first : first + size]), rule, to_nodes

    def _mode_slopes(self, points: Points, displacement: Array) -> Array:
        """Gradients (n_time, n_cell, n_point, 3, 3) of the bending modes."""
        nodal = displacement[:, points.cells].reshape(len(displacement), len(points.cells), -1)
        amplitudes = np.einsum("cmd,tcd->tcm", mode_amplitudes(points, *self._lame)[0], nodal, optimize=True)
        of_modes = amplitudes.reshape(*amplitudes.shape[:2], 3, 3)
        return np.asarray(np.einsum("cpmj,tcmi->tcpij", mode_gradients(points.jacobian), of_modes, optimize=True))


def _mean_gradients(points: Points) -> Array:
    """Mean gradients of the shape functions over each cell, (n_cell, n_node, 3)."""
    volumes = points.volumes / points.volumes.sum(axis=1, keepdims=True)
    return np.asarray(np.einsum("cpaj,cp->caj", points.gradients, volumes))


def _symmetric(slope: Array) -> Array:
    """Six components (..., 6) of the symmetric part of gradients (..., 3, 3)."""
    return np.asarray(0.5 * (slope + np.swapaxes(slope, -1, -2))[..., _ROWS, _COLUMNS])


def hooke(strain: Array, first: float, shear: float) -> Array:
    """Stress (..., 6), Pa, of strains (..., 6): lambda tr(eps) I + 2 mu eps."""
    stress: Array = 2.0 * shear * strain
    stress[..., :3] += first * strain[..., :3].sum(axis=-1, keepdims=True)
    return stress


def principal(tensor: Array) -> Array:
    """Principal values (..., 3) of symmetric tensors (..., 6), largest first."""
    full = np.empty((*tensor.shape[:-1], 3, 3))
    full[..., _ROWS, _COLUMNS] = tensor
    full[..., _COLUMNS, _ROWS] = tensor
    return np.asarray(np.linalg.eigvalsh(full)[..., ::-1])
