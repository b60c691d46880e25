"""Common part of two faces: pairs of opposite flat pieces, cut to triangles in the plane of the owner's piece.

Intersections of convex polygons after Sutherland and Hodgman, Comm. ACM 17 (1974), many pairs at a time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .mesh import Array, Index
from .surface import Pieces, Surface

Mask = NDArray[np.bool_]
_OPPOSED = 0.5  # cosine between one normal and the other turned round, from which on pieces count as opposite
_SPECK = 1e-10  # a common part below this share of the owner's piece is left out
_DOUBLE = 1.001  # covered more than once: only the nearest layer counts


@dataclass(frozen=True)
class Cells:
    """Triangles of the common part of pieces of the owner and of another face.

    Attributes
    ----------
    owner, other : (n_cell,) numbers of the pieces. corners : (n_cell, 3, 2) in the plane of the owner's piece, m.
    owner_corners, other_corners : (n_cell, 3 | 4, 2) of the pieces in the same plane, m.
    distance : (n_cell,) of the other piece along the owner's normal, m.
    """

    owner: Index
    other: Index
    corners: Array
    owner_corners: Array
    other_corners: Array
    distance: Array

    @property
    def areas(self) -> Array:
        """Areas of the triangles, (n_cell,), m2."""
        return areas(self.corners)

    def __len__(self) -> int:
        return len(self.owner)

    def picked(self, which: Index | Mask) -> Cells:
        """Some of the cells."""
        return Cells(*(getattr(self, name)[which] for name in self.__dataclass_fields__))


def common_cells(owner: Surface, other: Surface, reach: float | None) -> list[list[Cells]]:
    """Cells for every pair of blocks of the two faces; ``reach`` : largest distance along the owner's normal, m."""
    rows = []
    for mine in owner.pieces:
        row = [_cells(mine, theirs, owner.is_plane, reach) for theirs in other.pieces]
        rows.append(_nearest_layer(mine, row))
    return rows


def _cells(mine: Pieces, theirs: Pieces, plane: bool, reach: float | None) -> Cells:
    one, two = _candidates(mine, theirs, plane, reach)
    normal = mine.normals[one]
    arm = theirs.centres[two] - mine.centres[one]
    along = np.einsum("pi,pi->p", arm, normal)
    aside = np.linalg.norm(arm - along[:, None] * normal, axis=1)
    near = np.einsum("pi,pi->p", normal, theirs.normals[two]) < -_OPPOSED
    near &= aside < mine.radii[one] + theirs.radii[two]
    if reach is not None:  # its corners may be nearer than its centre
        near &= np.abs(along) < reach + theirs.radii[two]
    one, two, normal = one[near], two[near], normal[near]
    first, second = _plane_axes(mine, one)
    axes = np.stack([first, second], axis=2)
    origin = mine.centres[one][:, None]
    mine_there = (mine.corners[one] - origin) @ axes
    theirs_there = (theirs.corners[two] - origin) @ axes
    polygon, count = clip(theirs_there[:, ::-1], mine_there)
    common = np.where(count > 2, areas(polygon), 0.0)
    kept = np.flatnonzero(common > _SPECK * mine.areas[one])
    corners, cell = triangles(polygon[kept], count[kept])
    cell = kept[cell]
    slope = theirs.normals[two]
    # height of the other piece's plane over the middle of each triangle
    middle = np.einsum("cij,cj->ci", axes[cell], corners.mean(axis=1))
    offset = theirs.centres[two[cell]] - mine.centres[one[cell]] - middle
    facing = np.einsum("ci,ci->c", slope[cell], normal[cell])
    distance = np.einsum("ci,ci->c", offset, slope[cell]) / facing
    cells = Cells(one[cell], two[cell], corners, mine_there[cell], theirs_there[cell], distance)
    return cells if reach is None else cells.picked(np.abs(distance) <= reach)


def _plane_axes(pieces: Pieces, rows: Index) -> tuple[Array, Array]:
    first = pieces.corners[rows, 1] - pieces.corners[rows, 0]
    normal = pieces.normals[rows]
    first = first - np.einsum("pi,pi->p", first, normal)[:, None] * normal
    first /= np.linalg.norm(first, axis=1)[:, None]
    return first, np.cross(normal, first)


def _candidates(mine: Pieces, theirs: Pieces, plane: bool, reach: float | None) -> tuple[Index, Index]:
    """Pairs of pieces near enough to each other, by trees of the other face's centres by size."""
    from scipy.spatial import cKDTree  # a tenth of a second to load, and faces that match do without

    here, there = mine.centres, theirs.centres
    ahead: Array | float
    if plane and reach is None:  # however far away
        n = mine.normals[0]
        here, there = here - np.outer(here @ n, n), there - np.outer(there @ n, n)
        ahead = 0.0
    elif reach is None:
        nearest, _ = cKDTree(there).query(here)
        ahead = 2 * np.asarray(nearest)  # at 60 degrees the way along the normal is twice the distance
    else:
        ahead = reach
    size = np.floor(np.log2(np.maximum(theirs.radii, 1e-300))).astype(int)
    ones, twos = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for level in np.unique(size):
        members = np.flatnonzero(size == level)
        radius = (mine.radii + 2.0 ** (level + 1) + ahead) * (1 + 1e-9)
        lists = cKDTree(there[members]).query_ball_point(here, radius, return_sorted=True)
        counts = np.array([len(numbers) for numbers in lists])
        ones.append(np.repeat(np.arange(len(here)), counts))
        if counts.any():
            twos.append(members[np.concatenate([np.asarray(f, dtype=np.int64) for f in lists])])
    return np.concatenate(ones), np.concatenate(twos)


def _nearest_layer(mine: Pieces, row: list[Cells]) -> list[Cells]:
    """The cells without those of a farther layer of the other face, where an owner's piece is covered twice."""
    covered, least = np.zeros(mine.n_piece), np.full(mine.n_piece, np.inf)
    for cells in row:
        np.add.at(covered, cells.owner, cells.areas)
        np.minimum.at(least, cells.owner, np.abs(cells.distance))
    twice = covered > _DOUBLE * mine.areas
    if not twice.any():
        return row
    limit = np.where(twice, least + 2 * mine.radii, np.inf)
    return [cells.picked(np.abs(cells.distance) <= limit[cells.owner]) for cells in row]


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
    """Part of each polygon to the left of a line through ``start`` along ``along`` (n, 2)."""
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
    return np.asarray(along[:, None, 0] * arm[..., 1] - along[:, None, 1] * arm[..., 0])


def areas(corners: Array) -> Array:
    """Signed areas (n,) of polygons (n, p, 2) with repeated last corners."""
    arm = corners[:, 1:] - corners[:, :1]
    return np.asarray(0.5 * (arm[:, :-1, 0] * arm[:, 1:, 1] - arm[:, :-1, 1] * arm[:, 1:, 0]).sum(axis=1))


def triangles(corners: Array, count: Index) -> tuple[Array, Index]:
    """Fans of triangles (m, 3, 2) from the first corners, and the number of the polygon of each, (m,)."""
    width = corners.shape[1]
    first = np.repeat(corners[:, None, 0], width - 2, axis=1)
    fans = np.stack([first, corners[:, 1:-1], corners[:, 2:]], axis=2)
    used = np.arange(width - 2) < count[:, None] - 2
    return fans[used], np.nonzero(used)[0]
