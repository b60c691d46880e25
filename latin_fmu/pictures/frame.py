"""Bodies drawn with matplotlib alone, and what surrounds them: axes with units, arrows with labels.

The visible surface of a body (``Skin``) is a set of coloured facets with edges, in an orthographic view. Facets that
face the viewer are drawn, the farthest first. Sorting by depth is exact only for facets that are small against their
distance, so large ones are cut.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from ..fem.mesh import Array, Index, Mesh, boundary
from ..scene.readable_numbers import prefix_for

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_PIECE: Final = 0.02  # facets and edges are cut into pieces of this share of the picture
_MOST_CUTS: Final = 16
_LIFT: Final = 1.2e-2  # edges are drawn this share of the picture nearer: more than half a piece
_SHARP: Final = np.cos(np.radians(55.0))  # facets that meet at a larger angle make an edge: not seven around a circle
_LIGHT: Final = (-0.35, 0.55, 0.76)  # from the left and above, or below where the viewer is below (right, up, viewer)
_AMBIENT: Final = 0.55
_AMBIENT_OF_FIELD: Final = 0.8  # a colour that is read as a number stays near that of its scale


def paint(axis: Axes, skins: Sequence[Skin], view: View) -> None:
    """Draw skins on the axes, whose data are the coordinates of ``view.project``."""
    from matplotlib.collections import PolyCollection

    size = max(float(np.ptp(np.concatenate([s.points for s in skins]), axis=0).max()), 1e-300)
    corners = []
    colours = []
    depths = []
    widths = []
    for skin in skins:
        # facets that are turned away are hidden by others of the same closed skin
        front = np.flatnonzero(skin.normals() @ view.viewer > 0)
        pieces, rows, middles = _cut(skin.points[skin.facets[front]], _PIECE * size)
        corners.append(pieces)
        colours.append(view.lit(skin, front[rows], middles))
        depths.append(pieces.mean(axis=1) @ view.viewer)
        widths.append(np.full(len(pieces), 0.4))  # in the colour of the facet: no gaps between pieces
        edges, strength = edges_of(skin, view)
        # a quadrilateral without width: there along the edge and back
        lines, rows, _ = _cut(skin.points[edges[:, [0, 1, 1, 0]]], _PIECE * size, across=False)
        corners.append(lines)
        colours.append(np.tile((1.0 - 0.85 * strength[rows])[:, None] * 0.45, (1, 3)))
        depths.append(lines.mean(axis=1) @ view.viewer + _LIFT * size)
        widths.append(np.where(strength[rows] == 1.0, 0.7, 0.2))
    order = np.argsort(np.concatenate(depths))  # back to front: what is nearer is drawn over it
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


def _cut(corners: Array, piece: float, across: bool = True) -> tuple[Array, Index, Array]:
    """Quadrilaterals (m, 4, 3) in pieces (n, 4, 3) whose edges are not longer than ``piece``, the row of each, and the
    weights (n, 4) of the corners in its middle; not ``across``: an edge there and back, which is cut along itself
    only."""
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1, initial=0.0)
    cuts = np.clip(np.ceil(longest / piece), 1, _MOST_CUTS).astype(int)
    pieces, rows, middles = [np.zeros((0, 4, 3))], [np.zeros(0, dtype=np.int64)], [np.zeros((0, 4))]
    for n in np.unique(cuts):
        chosen = np.flatnonzero(cuts == n)
        r, s = np.meshgrid(np.linspace(0.0, 1.0, n + 1), np.linspace(0.0, 1.0, n + 1 if across else 2), indexing="ij")
        weights = np.stack([(1 - r) * (1 - s), r * (1 - s), r * s, (1 - r) * s], axis=-1)  # bilinear
        grid = np.einsum("rsc,mcx->mrsx", weights, corners[chosen])
        turn = [grid[:, :-1, :-1], grid[:, 1:, :-1], grid[:, 1:, 1:], grid[:, :-1, 1:]]
        pieces.append(np.stack(turn, axis=3).reshape(-1, 4, 3))
        middle = 0.25 * (weights[:-1, :-1] + weights[1:, :-1] + weights[1:, 1:] + weights[:-1, 1:]).reshape(-1, 4)
        rows.append(np.repeat(chosen, len(middle)))
        middles.append(np.tile(middle, (len(chosen), 1)))
    return np.concatenate(pieces), np.concatenate(rows), np.concatenate(middles)


_MARGIN: Final = 0.06  # of the largest size, between bodies and axes
_TICK: Final = 0.02
_LABEL: Final = 0.17  # of the width of the picture, for the label of an arrow


def draw(axis: Axes, skins: Sequence[Skin], view: View, around: Array | None = None) -> None:
    """Draw bodies, without axes, as large as the axes allow; with the points ``around`` (n, 3) in view, where given."""
    paint(axis, skins, view)
    axis.set_aspect("equal")
    axis.set_axis_off()
    if around is None:
        around = np.concatenate([s.points for s in skins])
    zoom(axis, view.project(around), 0.04)


def zoom(axis: Axes, flat: Array, around: float) -> None:
    """Limits of the axes: the points (n, 2), and ``around`` them this share of their size."""
    low, high = flat.min(axis=0), flat.max(axis=0)
    room = around * float(np.max(high - low))
    axis.set_xlim(low[0] - room, high[0] + room)
    axis.set_ylim(low[1] - room, high[1] + room)


def axes_with_units(axis: Axes, points: Array, view: View, metre: str) -> None:
    """Axes x, y, z along the edges of the box around ``points`` that are nearest to the viewer and below, in
    a unit of ``metre`` (UDUNITS)."""
    from matplotlib.ticker import MaxNLocator

    low, high = points.min(axis=0), points.max(axis=0)
    size = float(np.max(high - low))
    divisor, unit = prefix_for(float(np.max(np.abs([low, high]))), metre, figure=True)
    near = np.where(view.viewer > 0, high + _MARGIN * size, low - _MARGIN * size)
    far = np.where(view.viewer > 0, low - _MARGIN * size, high + _MARGIN * size)
    # the horizontal axes lie on the side of the box that the viewer looks along, below it or above
    near[2] = high[2] + _MARGIN * size
    if view.viewer[2] > 0:
        near[2] = low[2] - _MARGIN * size
    right = view.project(np.array([[near[0], far[1], 0.0], [far[0], near[1], 0.0]]))[:, 0]
    for k in range(3):
        start = near.copy()
        if k == 2:  # the vertical one at the left end of the picture
            start[int(right[0] < right[1])] = far[int(right[0] < right[1])]
        start[k] = low[k]
        end = start.copy()
        end[k] = high[k]
        inside = np.where(np.arange(3) == k, 0.0, 0.5 * (low + high) - start)
        if k == 2:
            # labels of the vertical axis stand beside it, not above
            inside = inside * (np.arange(3) < 2)
        outward = -view.project(inside[None])[0]
        outward /= max(float(np.linalg.norm(outward)), 1e-300)
        length = float(np.linalg.norm(view.project((end - start)[None])))
        if length < 0.03 * size:
            continue
        # on a short axis the labels of three ticks would touch
        if length > 0.3 * size:
            count = 5
        else:
            if length > 0.12 * size:
                count = 2
            else:
                count = 1
        ticks = list(MaxNLocator(count).tick_values(low[k] / divisor, high[k] / divisor))
        if k == 2:  # left of everything drawn so far
            room = view.project(start[None])[0, 0] - axis.get_xlim()[0]
            start, end = start - max(room, 0.0) * view.right, end - max(room, 0.0) * view.right
        _axis_line(axis, view, np.stack([start, end]), k, [t * divisor for t in ticks], outward, size)
        for tick in ticks:
            if not low[k] - 1e-9 * size <= tick * divisor <= high[k] + 1e-9 * size:
                continue
            place = start.copy()
            place[k] = tick * divisor
            at = view.project(place[None])[0] + 1.6 * _TICK * size * outward
            axis.text(at[0], at[1], f"{tick:.6g}", fontsize=7, color="0.25", clip_on=False, **_alignment(outward))
        at = view.project(0.5 * (start + end)[None])[0] + 5.0 * _TICK * size * outward
        axis.text(at[0], at[1], f"{'xyz'[k]} ({unit})", fontsize=8, clip_on=False, **_alignment(outward))
        _widen(axis, at + 2.5 * _TICK * size * outward)


def _axis_line(
    axis: Axes, view: View, ends: Array, k: int, ticks: Sequence[float], outward: Array, size: float
) -> None:
    """The line between two ``ends`` (2, 3) along axis ``k``, and the ticks that lie on it."""
    axis.plot(*view.project(ends).T, color="0.4", linewidth=0.8, zorder=0, clip_on=False)
    for tick in ticks:
        if ends[0, k] - 1e-9 * size <= tick <= ends[1, k] + 1e-9 * size:
            place = ends[0].copy()
            place[k] = tick
            at = view.project(place[None])[0]
            axis.plot(*np.stack([at, at + _TICK * size * outward]).T, color="0.4", linewidth=0.8, clip_on=False)


def _alignment(outward: Array) -> dict[str, Any]:
    """Text stands clear of the axis in the direction ``outward``."""
    if outward[0] > 0.3:
        horizontal = "left"
    else:
        if outward[0] < -0.3:
            horizontal = "right"
        else:
            horizontal = "center"
    if outward[1] > 0.5:
        vertical = "bottom"
    else:
        if outward[1] < -0.5:
            vertical = "top"
        else:
            vertical = "center"
    return {"ha": horizontal, "va": vertical}


def _widen(axis: Axes, point: Array) -> None:
    (x0, x1), (y0, y1) = axis.get_xlim(), axis.get_ylim()
    axis.set_xlim(min(x0, point[0]), max(x1, point[0]))
    axis.set_ylim(min(y0, point[1]), max(y1, point[1]))


def arrow(
    axis: Axes, view: View, tip: Array, direction: Array, colour: str, label: str, tail_first: bool = False
) -> None:
    """An arrow along ``direction`` (3,), m, that ends at ``tip`` (or starts there), with a label at its tail."""
    start, end = tip - direction, tip
    if tail_first:
        start, end = tip, tip + direction
    tail, head = view.project(np.stack([start, end]))
    style = {
        "arrowstyle": "-|>,head_width=0.35,head_length=0.7",
        "color": colour,
        "linewidth": 2.2,
        "shrinkA": 0,
        "shrinkB": 0,
    }
    axis.annotate("", head, tail, arrowprops=style, zorder=5, annotation_clip=False)
    if not tail_first:
        away = tail - head
    else:
        away = head - tail
    if not tail_first:
        far = tail
    else:
        far = head
    size = max(float(np.linalg.norm(away)), 1e-300)
    axis.annotate(
        label,
        far,
        xytext=tuple(6.0 * away / size),
        textcoords="offset points",
        fontsize=8,
        color=colour,
        zorder=6,
        annotation_clip=False,
        **_alignment(away / size),
    )
    beside = np.sign(away[0]) * (abs(away[0]) > 0.3 * size)  # the label stands beside the arrow, not above it
    _widen(axis, far + 0.35 * away + [beside * _LABEL * float(np.ptp(axis.get_xlim())), 0.0])


@dataclass(frozen=True)
class Skin:
    """Facets of a body.

    Attributes
    ----------
    points : (n_point, 3), m. facets : (n_facet, 4) corners, the last one twice for triangles.
    colours : (n_facet, 3) red, green, blue between 0 and 1, without light. field : (n_point,) between 0 and 1,
        NaN where there is none, and the map of its colours, which stand in the place of ``colours``.
    """

    points: Array
    facets: Index
    colours: Array
    field: tuple[Array, str] | None = None

    def moved(self, shift: Array) -> Skin:
        """The body translated or deformed; ``shift`` is (3,) or (n_point, 3), m."""
        return replace(self, points=self.points + shift)

    def painted(self, nodes: Index, colour: Array) -> Skin:
        """The body with facets in ``colour`` (3,) whose corners are all among ``nodes``."""
        chosen = np.zeros(len(self.points), dtype=bool)
        chosen[nodes] = True
        inside = np.all(chosen[self.facets], axis=1, keepdims=True)
        return replace(self, colours=np.where(inside, colour, self.colours))

    def faded(self, nodes: Index, share: Array) -> Skin:
        """The same facets mixed with white by the mean ``share`` (n_node,) of their corners, 1 for white."""
        at_nodes = np.full(len(self.points), np.nan)
        at_nodes[nodes] = share
        white = at_nodes[self.facets].mean(axis=1, keepdims=True)
        mixed = self.colours + white * (1.0 - self.colours)
        return replace(self, colours=np.where(np.isnan(white), self.colours, mixed))

    def normals(self) -> Array:
        """Outward unit normals (n_facet, 3)."""
        a, b, c, d = (self.points[self.facets[:, i]] for i in range(4))
        # the diagonals: the mean plane of four corners, and of a triangle whose last corner is there twice
        normal = np.cross(c - a, d - b)
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        unit: Array = normal / np.where(length > 0, length, 1.0)
        return unit


def skin_of(mesh: Mesh, colour: Array) -> Skin:
    """Boundary of a mesh in one colour (curved facets are drawn by their corners)."""
    tables = [block.corners for block in boundary(mesh).blocks]
    facets = np.concatenate([t if t.shape[1] == 4 else np.column_stack([t, t[:, 2]]) for t in tables])
    return Skin(mesh.nodes, facets, np.tile(np.asarray(colour, dtype=float), (len(facets), 1)))


def mapped(name: str, share: Array) -> Array:
    """Colours (n, 3) of a map at shares (n,) of its range."""
    from matplotlib import colormaps

    rgb: Array = np.asarray(colormaps[name](np.clip(share, 0.0, 1.0)))[:, :3]
    return rgb


@dataclass(frozen=True)
class View:
    """Orthographic view: unit vectors to the right, up, and towards the viewer, (3,) each."""

    right: Array
    up: Array
    viewer: Array

    @staticmethod
    def at(azimuth: float, elevation: float) -> View:
        """The viewer in a direction given by angles in degrees: azimuth from x about z, elevation above the plane."""
        a, e = np.radians(azimuth), np.radians(elevation)
        viewer = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
        right = np.array([-np.sin(a), np.cos(a), 0.0])
        return View(right, np.cross(viewer, right), viewer)

    def project(self, points: Array) -> Array:
        """Coordinates (n, 2) to the right and up."""
        flat: Array = points @ np.stack([self.right, self.up], axis=1)
        return flat

    def lit(self, skin: Skin, facets: Index, places: Array) -> Array:
        """Colours (n, 3) at places on some ``facets`` (n,), by the weights (n, 4) of their corners, with light from the
        left."""
        # seen from below the light comes from below, else all faces in view would be dark
        if self.viewer[2] >= 0:
            side = 1.0
        else:
            side = -1.0
        light = np.array([1.0, side, 1.0]) * _LIGHT @ np.stack([self.right, self.up, self.viewer])
        if skin.field is None:
            ambient = _AMBIENT
        else:
            ambient = _AMBIENT_OF_FIELD
        shade = ambient + (1.0 - ambient) * np.clip(skin.normals() @ light / np.linalg.norm(_LIGHT), 0.0, 1.0)
        colours = skin.colours[facets]
        if skin.field is not None:
            share, name = skin.field
            at = (share[skin.facets[facets]] * places).sum(axis=1)
            colours = np.where(np.isnan(at)[:, None], colours, mapped(name, np.nan_to_num(at)))
        return np.clip(colours * shade[facets, None], 0.0, 1.0)


def edges_of(skin: Skin, view: View) -> tuple[Index, Array]:
    """Edges of the facets that face the viewer, (n_edge, 2), and the weight of their lines.

    1: sharp edges and outlines of the body; 0.25: edges of the mesh.
    """
    pairs, one, other = edges(skin)
    normals = skin.normals()
    front = normals @ view.viewer > 0
    outline = front[one] != front[other]
    seen = front[one] | front[other]
    return pairs[seen], np.where((_sharp(normals, one, other) | outline)[seen], 1.0, 0.25)


def edges(skin: Skin) -> tuple[Index, Index, Index]:
    """Edges of all facets, (n_edge, 2), and the two facets that share each, which are one at a free edge."""
    facets = skin.facets
    pairs = np.concatenate([facets[:, [i, (i + 1) % 4]] for i in range(4)])
    owner = np.tile(np.arange(len(facets)), 4)
    # the last corner of a triangle is there twice: no edge
    real = pairs[:, 0] != pairs[:, 1]
    pairs, owner = np.sort(pairs[real], axis=1), owner[real]
    found, first, inverse = np.unique(pairs, axis=0, return_index=True, return_inverse=True)
    last = np.zeros(len(found), dtype=np.int64)
    # of several writes the last one stays: with ``first`` both facets of an edge are known
    last[inverse.ravel()] = owner
    return found, owner[first], last


def _sharp(normals: Array, one: Index, other: Index) -> NDArray[np.bool_]:
    """Whether two facets make an edge of the body, or one has a free edge."""
    sharp: NDArray[np.bool_] = (np.einsum("ei,ei->e", normals[one], normals[other]) < _SHARP) | (one == other)
    return sharp


def sharp_edges(skin: Skin) -> Index:
    """Edges of the body, (n_edge, 2): facets meet at them at an angle, or there is one facet only."""
    found, one, other = edges(skin)
    return found[_sharp(skin.normals(), one, other)]


def shifts_apart(bodies: Sequence[str], joints: Iterable[tuple[str, str, Array]], distance: float) -> dict[str, Array]:
    """Shift of every body (3,) of an exploded view: along the normals of the interfaces, least squares over all.

    joints : two bodies and the normal from the first one to the second.
    """
    rows, wanted = [np.ones(len(bodies))], [np.zeros(3)]  # the bodies together stay where they are
    for first, second, normal in joints:
        row = np.zeros(len(bodies))
        row[bodies.index(first)], row[bodies.index(second)] = -1.0, 1.0
        rows.append(row)
        wanted.append(distance * normal)
    shifts = np.linalg.lstsq(np.array(rows), np.array(wanted), rcond=None)[0]
    return dict(zip(bodies, shifts, strict=True))
