"""Nearest points."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from .mesh import Array, Index


def nearest(points: Array, candidates: Array) -> tuple[Array, Index]:
    """Distance (n_point,) to, and number of, the nearest of ``candidates`` (n, 3) for each of ``points``."""
    distance, number = cKDTree(candidates).query(points)
    return np.atleast_1d(np.asarray(distance, dtype=float)), np.atleast_1d(np.asarray(number, dtype=np.int64))
