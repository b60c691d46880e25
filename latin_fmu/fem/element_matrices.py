"""Integrals over single elements."""

from __future__ import annotations

import numpy as np

from .mesh import Array


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
