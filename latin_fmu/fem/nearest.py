"""Nearest points."""

from __future__ import annotations

from typing import Final

import numpy as np

from .mesh import Array, Index

_FEW: Final = 300_000  # pairs of points up to which all distances cost less than to load SciPy's tree


def nearest(points: Array, candidates: Array) -> tuple[Array, Index]:
    """Distance (n_point,) to, and number of, the nearest of ``candidates`` (n, 3) for each of ``points``."""
    if 0 < points.shape[0] * candidates.shape[0] <= _FEW:
        square = np.sum((points[:, None] - candidates) ** 2, axis=2)
        number = np.argmin(square, axis=1)
        return np.sqrt(square[np.arange(len(number)), number]), number.astype(np.int64)
    from scipy.spatial import cKDTree

    distance, number = cKDTree(candidates).query(points)
    return np.atleast_1d(np.asarray(distance, dtype=float)), np.atleast_1d(np.asarray(number, dtype=np.int64))
