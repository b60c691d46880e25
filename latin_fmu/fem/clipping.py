"""Intersections of convex polygons in the plane, many pairs at a time (Sutherland and Hodgman, Comm. ACM 17 (1974))."""

from __future__ import annotations

import numpy as np

from .mesh import Array, Index


def clip(subject: Array, window: Array) -> tuple[Array, Index]:
    """Intersections of convex polygons, pair by pair.

    Parameters
    ----------
    subject : (n, p, 2) and window : (n, q, 2), corners counter-clockwise.

    Returns
    -------
    Corners (n, p + q, 2), counter-clockwise, the last one repeated to fill the rows, and their number (n,), 0 where
    the two do not meet.
    """
    n, _, _ = subject.shape
    corners, count = subject, np.full(n, subject.shape[1])
    for edge in range(window.shape[1]):
        start = window[:, edge]
        along = window[:, (edge + 1) % window.shape[1]] - start
        corners, count = _cut(corners, count, start, along)
    return corners, count


def _cut(corners: Array, count: Index, start: Array, along: Array) -> tuple[Array, Index]:
    """What is left of each polygon to the left of a line through ``start`` along ``along`` (n, 2)."""
    n, width, _ = corners.shape
    slot = np.arange(width)
    used = slot < count[:, None]
    following = np.take_along_axis(corners, np.where(slot + 1 < count[:, None], slot + 1, 0)[..., None], axis=1)
    left = _height(corners, start, along)
    left_next = _height(following, start, along)
    keeps = used & (left >= 0)
    crosses = used & ((left >= 0) != (left_next >= 0))
    fraction = np.divide(left, left - left_next, out=np.zeros_like(left), where=crosses)
    cut = corners + fraction[..., None] * (following - corners)
    both = np.stack([corners, cut], axis=2).reshape(n, 2 * width, 2)
    taken = np.stack([keeps, crosses], axis=2).reshape(n, 2 * width)
    total = taken.sum(axis=1)
    order = np.argsort(~taken, axis=1, kind="stable")[:, : width + 1]
    order = np.take_along_axis(order, np.minimum(np.arange(width + 1), np.maximum(total - 1, 0)[:, None]), axis=1)
    return np.take_along_axis(both, order[..., None], axis=1), np.minimum(total, width + 1)


def _height(points: Array, start: Array, along: Array) -> Array:
    arm = points - start[:, None]
    height: Array = along[:, None, 0] * arm[..., 1] - along[:, None, 1] * arm[..., 0]
    return height


def areas(corners: Array) -> Array:
    """Signed areas (n,) of polygons (n, p, 2) with repeated last corners."""
    arm = corners[:, 1:] - corners[:, :1]
    total: Array = 0.5 * (arm[:, :-1, 0] * arm[:, 1:, 1] - arm[:, :-1, 1] * arm[:, 1:, 0]).sum(axis=1)
    return total


def triangles(corners: Array, count: Index) -> tuple[Array, Index]:
    """Fans of triangles (m, 3, 2) from the first corners, and the number of the polygon of each, (m,)."""
    width = corners.shape[1]
    first = np.repeat(corners[:, None, 0], width - 2, axis=1)
    fans = np.stack([first, corners[:, 1:-1], corners[:, 2:]], axis=2)
    used = np.arange(width - 2) < count[:, None] - 2
    return fans[used], np.nonzero(used)[0]
