"""Screws as they were found in a CAD assembly: edges of its parts, screws by thread, those that are possible."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from ..cad.facts import Array, CadAssembly, CadPart, Screw
from ..cad.geometry import ALONG
from .style import BAD, DISTINCT, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_AZIMUTH, _ELEVATION = -60.0, 25.0
_REST: Final = "0.78"
_WIDTH: Final = 11.0  # inches
_WHOLE_NAMES: Final = 9  # more screws have numbers, which the legend explains
_ABOVE: Final = 2.0  # points, from a screw to its name
_LONGEST: Final = 46  # characters of a line of the legend


@styled
def screw_figure(assembly: CadAssembly) -> Figure:
    """Two views of the edges of all parts, one along the axis of most screws: screws in the colour of their thread, in
    dashes what might be one and is not tightened.

    Examples
    --------
    >>> from latin_fmu.cad.facts import CadAssembly
    >>> len(screw_figure(CadAssembly("a.step", "mm", 1e-3)).axes)
    2
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(_WIDTH, 5.2), layout="constrained")
    panels = figure.subplots(1, 2)
    kinds = _kinds(assembly.screws)
    screws = {screw.part: screw for screw in assembly.screws}
    along = _common_axis(assembly.screws)
    for axes, axis, title in ((panels[0], None, "oblique"), (panels[1], along, "along " + _direction(along))):
        projection = _projection(axis)
        for part in sorted(assembly.parts, key=lambda part: part.name in screws):
            _edges(axes, part, projection, screws.get(part.name), kinds)
        _names(axes, assembly, projection)
        axes.set_aspect("equal")
        axes.set_axis_off()
        axes.set_title(title)
    for kind, (colour, style, members) in kinds.items():
        panels[1].plot([], [], color=colour, linestyle=style, label=_legend(kind, members))
    if kinds:
        figure.legend(loc="outside lower center", ncols=min(3, len(kinds)))
    used = sum(screw.used for screw in assembly.screws)
    possible = len(assembly.screws) - used
    figure.suptitle(f"{assembly.file}: {used} screw{'s' * (used != 1)}, and {possible} possible")
    return figure


def _kinds(screws: Sequence[Screw]) -> dict[str, tuple[str, str, list[Screw]]]:
    """Colour, line style and members of each thread, and of what is possible."""
    found: dict[str, tuple[str, str, list[Screw]]] = {}
    for screw in sorted(screws, key=lambda s: (not s.used, -s.diameter)):
        if screw.used:
            name = screw.size or f"{screw.diameter:.4g} mm"
            style = DISTINCT[len(found) % len(DISTINCT)], "-"
        else:
            name, style = f"not used: {screw.kind}", (BAD, "--")
        found.setdefault(name, (*style, []))[2].append(screw)
    return found


def _legend(kind: str, members: Sequence[Screw]) -> str:
    stems: dict[str, list[str]] = {}
    for part in sorted({part for screw in members for part in screw.threads}):
        stems.setdefault(re.sub(r"_\d+$", "", part), []).append(part)
    threads = [f"{stem}_*" if len(parts) > 1 else parts[0] for stem, parts in stems.items()]
    text = f"{len(members)} x {kind}" + (f" in {', '.join(threads)}" if threads else "")
    if len(text) > _LONGEST:
        return text[: _LONGEST - 4] + " ..."
    return text


def _common_axis(screws: Sequence[Screw]) -> Array:
    """The axis that most of the screws have; z without screws."""
    axes = [np.array(screw.axis) for screw in screws if screw.used] or [np.array([0.0, 0.0, 1.0])]
    return max(axes, key=lambda a: sum(abs(float(a @ b)) > np.cos(np.radians(5.0)) for b in axes))


def _direction(axis: Array) -> str:
    main = int(np.abs(axis).argmax())
    if abs(axis[main]) > np.cos(np.radians(1.0)):
        return "xyz"[main]
    return "[" + ", ".join(f"{x:.3g}" for x in axis) + "]"


def _projection(axis: Array | None) -> Array:
    """Directions (2, 3) to the right and up of a view along an axis, or of the oblique one."""
    if axis is None:
        turn, tilt = np.radians([_AZIMUTH, _ELEVATION])
        towards = np.array([np.cos(turn) * np.cos(tilt), np.sin(turn) * np.cos(tilt), np.sin(tilt)])
    else:
        towards = axis
    # z is up, y where one looks along z
    up = np.array([0.0, 0.0, 1.0])
    if abs(towards[2]) > np.cos(np.radians(5.0)):
        up = np.array([0.0, 1.0, 0.0])
    right = np.cross(up, towards)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(towards, right)])


def _edges(
    axes: Axes, part: CadPart, projection: Array, screw: Screw | None, kinds: dict[str, tuple[str, str, list[Screw]]]
) -> None:
    """The edges of a part, in the colour of its screw."""
    from matplotlib.collections import LineCollection

    colour, style, width = _REST, "-", 0.5
    for kind_colour, kind_style, members in kinds.values():
        if screw in members:
            colour, style, width = kind_colour, kind_style, 1.0
    lines = (part.outline.reshape(-1, ALONG, 3) @ projection.T).tolist() if len(part.outline) else []
    axes.add_collection(LineCollection(lines, colors=colour, linestyles=style, linewidths=width))
    axes.autoscale_view()


def _names(axes: Axes, assembly: CadAssembly, projection: Array) -> None:
    """Names of the screws at their places; of many screws their numbers among those of one stem."""
    short = len(assembly.screws) > _WHOLE_NAMES
    for screw in assembly.screws:
        part = assembly.by_name.get(screw.part)
        if part is None or not len(part.outline):
            continue
        flat = part.outline @ projection.T
        place = 0.5 * (flat[:, 0].min() + flat[:, 0].max()), flat[:, 1].max()
        name = screw.part
        if short and name.rpartition("_")[2].isdigit():
            name = name.rpartition("_")[2]
        box = {"fc": "w", "ec": "none", "pad": 0.3, "alpha": 0.8}
        above = (0.0, _ABOVE)
        axes.annotate(name, place, above, textcoords="offset points", fontsize=7, ha="center", va="bottom", bbox=box)
