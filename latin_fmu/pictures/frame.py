"""What stands around a picture of bodies: axes with units, arrows with labels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ..fem.mesh import Array
from ..results.quantities import prefix_for
from .painter import paint
from .skin import Skin, View

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MARGIN: Final = 0.06  # of the largest size, between bodies and axes
_TICK: Final = 0.02
_LABEL: Final = 0.17  # of the width of the picture, for the label of an arrow


def draw(axis: Axes, skins: Sequence[Skin], view: View) -> None:
    """Draw bodies, without axes, as large as the axes allow."""
    paint(axis, skins, view)
    axis.set_aspect("equal")
    axis.set_axis_off()
    flat = np.concatenate([view.project(s.points) for s in skins])
    low, high = flat.min(axis=0), flat.max(axis=0)
    room = 0.04 * float(np.max(high - low))
    axis.set_xlim(low[0] - room, high[0] + room)
    axis.set_ylim(low[1] - room, high[1] + room)


def axes_with_units(axis: Axes, points: Array, view: View) -> None:
    """Axes x, y, z along the edges of the box around ``points`` that are nearest to the viewer and below."""
    from matplotlib.ticker import MaxNLocator

    low, high = points.min(axis=0), points.max(axis=0)
    size = float(np.max(high - low))
    divisor, unit = prefix_for(float(np.max(np.abs([low, high]))), "m", micro="µ")
    near = np.where(view.viewer > 0, high + _MARGIN * size, low - _MARGIN * size)
    far = np.where(view.viewer > 0, low - _MARGIN * size, high + _MARGIN * size)
    near[2] = low[2] - _MARGIN * size if view.viewer[2] > 0 else high[2] + _MARGIN * size
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
            inside = inside * (np.arange(3) < 2)
        outward = -view.project(inside[None])[0]
        outward /= max(float(np.linalg.norm(outward)), 1e-300)
        length = float(np.linalg.norm(view.project((end - start)[None])))
        if length < 0.03 * size:
            continue
        count = 5 if length > 0.3 * size else 2
        ticks = list(MaxNLocator(count).tick_values(low[k] / divisor, high[k] / divisor))
        if k == 2:  # left of everything drawn so far
            room = view.project(start[None])[0, 0] - axis.get_xlim()[0]
            start, end = start - max(room, 0.0) * view.right, end - max(room, 0.0) * view.right
        _axis_line(axis, view, start, end, k, [t * divisor for t in ticks], outward, size)
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
    axis: Axes, view: View, start: Array, end: Array, k: int, ticks: list[float], outward: Array, size: float
) -> None:
    line = view.project(np.stack([start, end]))
    axis.plot(*line.T, color="0.4", linewidth=0.8, zorder=0, clip_on=False)
    for tick in ticks:
        if start[k] - 1e-9 * size <= tick <= end[k] + 1e-9 * size:
            place = start.copy()
            place[k] = tick
            at = view.project(place[None])[0]
            axis.plot(*np.stack([at, at + _TICK * size * outward]).T, color="0.4", linewidth=0.8, clip_on=False)


def _alignment(outward: Array) -> dict[str, Any]:
    """Text stands clear of the axis in the direction ``outward``."""
    horizontal = "left" if outward[0] > 0.3 else "right" if outward[0] < -0.3 else "center"
    vertical = "bottom" if outward[1] > 0.5 else "top" if outward[1] < -0.5 else "center"
    return {"ha": horizontal, "va": vertical}


def _widen(axis: Axes, point: Array) -> None:
    (x0, x1), (y0, y1) = axis.get_xlim(), axis.get_ylim()
    axis.set_xlim(min(x0, point[0]), max(x1, point[0]))
    axis.set_ylim(min(y0, point[1]), max(y1, point[1]))


def arrow(
    axis: Axes, view: View, tip: Array, direction: Array, colour: str, label: str, tail_first: bool = False
) -> None:
    """An arrow along ``direction`` (3,), m, that ends at ``tip`` (or starts there), with a label at its tail."""
    start, end = (tip, tip + direction) if tail_first else (tip - direction, tip)
    tail, head = view.project(np.stack([start, end]))
    style = {
        "arrowstyle": "-|>,head_width=0.35,head_length=0.7",
        "color": colour,
        "linewidth": 2.2,
        "shrinkA": 0,
        "shrinkB": 0,
    }
    axis.annotate("", head, tail, arrowprops=style, zorder=5, annotation_clip=False)
    away = tail - head if not tail_first else head - tail
    far = tail if not tail_first else head
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
