"""Drawing skins with matplotlib alone: facets that face the viewer, the farthest first.

Sorting by depth is exact only for facets that are small against their distance, so large ones are cut.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from ..fem.mesh import Array
from .skin import Skin, View, edges_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_PIECE: Final = 0.02  # facets and edges are cut into pieces of this share of the picture
_MOST_CUTS: Final = 16
_LIFT: Final = 1.2e-2  # edges are drawn this share of the picture nearer: more than half a piece


def paint(axis: Axes, skins: Sequence[Skin], view: View) -> None:
    """Draw skins on the axes, whose data are the coordinates of ``view.project``."""
    from matplotlib.collections import PolyCollection

    size = max(float(np.ptp(np.concatenate([s.points for s in skins]), axis=0).max()), 1e-300)
    corners, colours, depths, widths = [], [], [], []
    for skin in skins:
        pieces, rows = _cut_facets(skin, view, _PIECE * size)
        lit = view.lit(skin)[rows]
        corners.append(pieces)
        colours.append(lit)
        depths.append(pieces.mean(axis=1) @ view.viewer)
        widths.append(np.full(len(pieces), 0.4))  # in the colour of the facet: no gaps between pieces
        lines, strength = _cut_edges(skin, view, _PIECE * size)
        corners.append(lines)
        colours.append(np.tile((1.0 - 0.85 * strength)[:, None] * 0.45, (1, 3)))
        depths.append(lines.mean(axis=1) @ view.viewer + _LIFT * size)
        widths.append(np.where(strength == 1.0, 0.7, 0.2))
    order = np.argsort(np.concatenate(depths))
    colour = np.concatenate(colours)[order]
    flat = view.project(np.concatenate(corners).reshape(-1, 3)).reshape(-1, 4, 2)[order]
    axis.add_collection(
        PolyCollection(
            list(flat),
            facecolors=colour,
            edgecolors=colour,
            linewidths=np.concatenate(widths)[order],
            rasterized=True,
            closed=True,
        )
    )


def _cut_facets(skin: Skin, view: View, piece: float) -> tuple[Array, Array]:
    """Corners (n, 4, 3) of the pieces of the facets that face the viewer, and the facet of each."""
    front = np.flatnonzero(skin.normals() @ view.viewer > 0)
    corners = skin.points[skin.facets[front]]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1, initial=0.0)
    cuts = np.clip(np.ceil(longest / piece), 1, _MOST_CUTS).astype(int)
    found, rows = [np.zeros((0, 4, 3))], [np.zeros(0, dtype=np.int64)]
    for n in np.unique(cuts):
        chosen = cuts == n
        grid = _bilinear(corners[chosen], int(n))
        found.append(grid.reshape(-1, 4, 3))
        rows.append(np.repeat(front[chosen], n * n))
    return np.concatenate(found), np.concatenate(rows)


def _bilinear(corners: Array, n: int) -> Array:
    """Quadrilaterals (m, 4, 3) cut in n x n: (m, n * n, 4, 3)."""
    t = np.linspace(0.0, 1.0, n + 1)
    r, s = np.meshgrid(t, t, indexing="ij")
    weights = np.stack([(1 - r) * (1 - s), r * (1 - s), r * s, (1 - r) * s], axis=-1)
    grid = np.einsum("rsc,mcx->mrsx", weights, corners)
    turn = [grid[:, :-1, :-1], grid[:, 1:, :-1], grid[:, 1:, 1:], grid[:, :-1, 1:]]
    cells: Array = np.stack(turn, axis=3).reshape(len(corners), n * n, 4, 3)
    return cells


def _cut_edges(skin: Skin, view: View, piece: float) -> tuple[Array, Array]:
    """Pieces of the edges as flat quadrilaterals (n, 4, 3), and how strongly each is drawn."""
    edges, strength = edges_of(skin, view)
    ends = skin.points[edges]
    longest = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    cuts = np.clip(np.ceil(longest / piece), 1, _MOST_CUTS).astype(int)
    found, strengths = [np.zeros((0, 4, 3))], [np.zeros(0)]
    for n in np.unique(cuts):
        chosen = cuts == n
        t = np.linspace(0.0, 1.0, n + 1)[None, :, None]
        points = (1 - t) * ends[chosen, :1] + t * ends[chosen, 1:]
        a, b = points[:, :-1], points[:, 1:]
        found.append(np.stack([a, b, b, a], axis=2).reshape(-1, 4, 3))
        strengths.append(np.repeat(strength[chosen], n))
    return np.concatenate(found), np.concatenate(strengths)
