"""Maps of an interface in its mean plane at an instant, and films of maps and of bodies over a window of time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import xarray as xr

from ..errors import Problem, ResultsError, did_you_mean, listed
from ..fem.mesh import Array
from ..results.groups import unit_of
from ..results.quantities_of_interest import InterfaceFields, normal_resultant
from ..results.summary import prefix_for, readable
from ..results.writing import write_whole
from .result_picture import Frame, bodies_in_motion, stored_instants
from .style import PRESSURE, SEQUENTIAL, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FILM: Final = ".gif"
"""Suffix of a film."""
_HEADING: Final = "nothing to draw"
_MARKS: Final = (("separation", "x", 12.0), ("stick", "s", 10.0), ("slip", "o", 10.0))
"""Contact states by number: name, marker and its size."""
_ALIKE: Final = 0.5  # smallest over largest value
_PER_SECOND: Final = 10  # frames
_FINENESS: Final = 80  # dots per inch of a film


@dataclass(frozen=True)
class Window:
    """Time window of a film.

    Attributes
    ----------
    first, last : s, None for the start and the end of the stored instants. frames : at most so many instants.
    """

    first: float | None = None
    last: float | None = None
    frames: int = 40

    def instants(self, stored: Array) -> Array:
        """Instants of the film, evenly taken from those ``stored`` (n,).

        Raises
        ------
        ResultsError : fewer than two are in the window.
        """
        first = stored[0] if self.first is None else self.first
        last = stored[-1] if self.last is None else self.last
        inside = stored[(stored >= first * (1 - 1e-9)) & (stored <= last * (1 + 1e-9))]
        if len(inside) < 2:
            what, value = "fewer than two stored instants are in this window", f"{first:g} to {last:g} s"
            allowed = f"a part of {stored[0]:g} to {stored[-1]:g} s"
            raise ResultsError([Problem("--from, --to", what, value, allowed)], _HEADING)
        chosen = np.linspace(0, len(inside) - 1, min(self.frames, len(inside)))
        return np.asarray(inside[np.unique(np.rint(chosen).astype(int))])


@styled
def map_figure(tree: xr.DataTree, interface: str | None = None, time: float | None = None) -> Figure:
    """Pressure on an interface in its mean plane, with the state of every point, and friction where it has any.

    Parameters
    ----------
    interface : its name, None for the one with the largest force. time : s, None for the instant of that force.

    Raises
    ------
    ResultsError : no interface of this name, or its points carry no cells.
    """
    dataset = _surface(tree, interface)
    instants = dataset["time"].values
    wanted = instants[normal_resultant(InterfaceFields.of_dataset(dataset)).argmax()] if time is None else time
    at = int(np.abs(instants - wanted).argmin())
    figure, drawn = map_in_motion(tree, interface, instants[at : at + 1])
    drawn(float(instants[at]))
    return figure


def map_in_motion(tree: xr.DataTree, interface: str | None, instants: Array) -> tuple[Figure, Frame]:
    """An empty figure of maps, and what draws an instant in it; colours reach to the largest of all ``instants``."""
    from matplotlib.figure import Figure

    dataset = _surface(tree, interface)
    chosen = dataset.sel(time=instants, method="nearest")
    ranges = [_range(field) for field in _tractions(chosen)]
    rubs = float(dataset.attrs.get("friction_coefficient", 0.0)) > 0.0
    width, height = (float(np.ptp(dataset[name].values)) for name in ("surface_x", "surface_y"))
    tall = float(np.clip(4.2 * height / max(width, 1e-300), 2.0, 5.5)) + 1.6
    figure = Figure(figsize=(10.0 if rubs else 5.4, tall), layout="constrained")

    def draw_instant(time: float) -> None:
        figure.clear()
        axes = figure.subplots(1, 2 if rubs else 1, squeeze=False, sharex=True, sharey=True)[0]
        now = dataset.sel(time=[time], method="nearest")
        pressure, friction = (field[0] for field in _tractions(now))
        _draw_field(figure, axes[0], dataset, pressure, ranges[0], PRESSURE, "pressure")
        if rubs:
            _draw_field(figure, axes[1], dataset, friction, ranges[1], SEQUENTIAL, "friction")
        if "contact_status" in dataset:
            _draw_states(figure, axes[0], dataset, now["contact_status"].values[0])
        name = f"{tree.attrs.get('scene_name', 'run')}: interface {dataset.attrs['name']}"
        figure.suptitle(f"{name}, {readable(time, 's', figure=True)}")

    return figure, draw_instant


def _surface(tree: xr.DataTree, interface: str | None) -> xr.Dataset:
    """Group of an interface whose points carry cells, with its name as an attribute.

    Raises
    ------
    ResultsError : there is none.
    """
    nodes = tree["interfaces"].children if "interfaces" in tree.children else {}
    groups = {name: node.to_dataset() for name, node in nodes.items()}
    meshed = {name: dataset for name, dataset in groups.items() if "cells" in dataset}
    if interface is None and meshed:
        interface = max(meshed, key=lambda name: float(np.abs(meshed[name]["force"].values).max(initial=0.0)))
    if interface in meshed:
        return meshed[str(interface)].assign_attrs(name=interface)
    what = "its points carry no cells" if interface in groups else "no interface of this name"
    if interface is None:
        what = "no interface has points that carry cells"
    remedy = did_you_mean(interface, meshed)
    raise ResultsError([Problem("--interface", what, interface, listed(meshed), remedy)], _HEADING)


def _tractions(dataset: xr.Dataset) -> tuple[Array, Array]:
    """Pressure and magnitude of friction, (n_time, n_point), Pa."""
    traction, normal = np.nan_to_num(dataset["traction"].values), dataset["normal"].values
    along = np.einsum("tpc,pc->tp", traction, normal)
    return -along, np.linalg.norm(traction - along[:, :, None] * normal, axis=2)


def _range(values: Array) -> tuple[float, float]:
    """Ends of a scale of colours: from 0, or from the smallest value where all are alike."""
    low, high = float(values.min()), float(values.max())
    return (low, high) if low > _ALIKE * high else (0.0, high)


def _draw_field(
    figure: Figure, axis: Axes, dataset: xr.Dataset, values: Array, ends: tuple[float, float], colours: str, name: str
) -> None:
    """Values at the points, linear in between."""
    from matplotlib.tri import Triangulation

    cells = np.nan_to_num(dataset["cells"].values, nan=-1).astype(int)
    quads = cells[cells[:, 3] >= 0]
    corners = np.concatenate([cells[:, :3], quads[:, [0, 2, 3]]])
    length, metre = prefix_for(
        max(float(np.abs(dataset[f"surface_{a}"].values).max()) for a in "xy"),
        unit_of(dataset["surface_x"], "m"),
        figure=True,
    )
    scale, pascal = prefix_for(ends[1], unit_of(dataset["traction"], "Pa"), figure=True)
    x, y = (dataset[f"surface_{a}"].values / length for a in "xy")
    low, top = ends[0] / scale, max(ends[1] / scale, 1e-300)
    triangles = Triangulation(x, y, corners)
    image = axis.tripcolor(triangles, values / scale, shading="gouraud", cmap=colours, vmin=low, vmax=top)
    figure.colorbar(image, ax=axis, label=f"{name} ({pascal})", shrink=0.75)
    axis.set(aspect="equal", title=name, xlabel=f"along the interface ({metre})", ylabel=f"across ({metre})")


def _draw_states(figure: Figure, axis: Axes, dataset: xr.Dataset, states: Array) -> None:
    """A mark on every point: states differ by shape, so that they do in grey, too."""
    length, _ = prefix_for(
        max(float(np.abs(dataset[f"surface_{a}"].values).max()) for a in "xy"), unit_of(dataset["surface_x"], "m")
    )
    x, y = (dataset[f"surface_{a}"].values / length for a in "xy")
    for number, (name, mark, size) in enumerate(_MARKS):
        at = states == number
        colour: dict[str, Any] = {"color": "0.35"} if mark == "x" else {"facecolors": "white", "edgecolors": "black"}
        axis.scatter(x[at], y[at], s=size, marker=mark, linewidths=0.7, label=name, zorder=3, clip_on=False, **colour)
    figure.legend(*axis.get_legend_handles_labels(), loc="outside lower center", ncols=3)


@styled
def save_film(
    tree: xr.DataTree,
    path: str | Path,
    window: Window,
    interface: str | None = None,
    magnify: float | None = None,
    maps: bool = False,
    report: Callable[[float], None] | None = None,
) -> None:
    """Write a film (gif) of the bodies, or of the maps of an interface, whole or not at all.

    ``report`` is called with the share that is done.

    Raises
    ------
    ResultsError : as ``result_figure`` and ``map_figure``; fewer than two instants; the file cannot be written.
    """
    if maps:
        instants = window.instants(_surface(tree, interface)["time"].values)
        figure, drawn = map_in_motion(tree, interface, instants)
    else:
        instants = window.instants(stored_instants(tree))
        figure, drawn = bodies_in_motion(tree, interface, instants, magnify)
    write_whole(path, partial(_write_film, figure, drawn, instants, report))


def _write_film(
    figure: Figure, drawn: Frame, instants: Array, report: Callable[[float], None] | None, path: Path
) -> None:
    from matplotlib.animation import PillowWriter

    writer = PillowWriter(fps=_PER_SECOND)
    with writer.saving(figure, path, _FINENESS):
        for i, time in enumerate(instants):
            drawn(float(time))
            writer.grab_frame()
            if report is not None:
                report((i + 1) / len(instants))
