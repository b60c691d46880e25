"""Sign of the Jacobian of cells: right side out, inside out, or tangled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .elements import jacobians
from .mesh import Array, CellBlock, Index
from .quadrature import Rule, cell_rule
from .shape_functions import cell_functions, mirrored

_FLAT = 1e-12  # det J over the lengths of its columns


def oriented(nodes: Array, block: CellBlock) -> tuple[Index, NDArray[np.bool_]]:
    """Cells numbered inside out are turned.

    Returns
    -------
    cells (n_cell, n_node), and which of them (n_cell,) have no volume somewhere or change sign: looked at are the
    Jacobians at all nodes but those in the middle of faces and cells, and at the integration points.
    """
    places = cell_functions(block.cell_type).nodes[:20]
    points = np.concatenate([places, cell_rule(block.cell_type).points])
    rule = Rule(points, np.ones(len(points)))
    low, high = np.zeros((2, len(block.cells)))
    size = max(1, 2**20 // (len(points) * block.cells.shape[1]))
    for first in range(0, len(block.cells), size):
        piece = slice(first, first + size)
        jacobian = jacobians(nodes, CellBlock(block.cell_type, block.cells[piece]), rule)
        lengths = np.prod(np.linalg.norm(jacobian, axis=2), axis=2)
        ratio = np.linalg.det(jacobian) / np.where(lengths > 0, lengths, 1.0)
        low[piece], high[piece] = ratio.min(axis=1), ratio.max(axis=1)
    bad = ~((low > _FLAT) | (high < -_FLAT))
    cells = block.cells.copy()
    turned = high < 0
    cells[turned] = cells[turned][:, mirrored(block.cell_type)]
    return cells, bad
