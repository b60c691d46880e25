"""Bodies of a results file: deformed shapes at an instant, and the pressure on an interface; maps of an interface in
its mean plane; films of bodies and of maps over a window of time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import xarray as xr

from ..errors import Problem, ResultsError, did_you_mean, listed
from ..fem.mesh import Array, Mesh, cell_blocks, nearest
from ..results.groups import children_of, datasets_of, unit_of, units_of
from ..results.interface_fields import InterfaceFields, normal_resultant
from ..results.writing import write_whole
from ..scene.readable_numbers import prefix_for, readable
from .frame import Skin, View, axes_with_units, draw, skin_of, zoom
from .style import PRESSURE, SEQUENTIAL, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_AZIMUTH, _ELEVATION = -60.0, 25.0
_SEEN: Final = 0.05  # of the size of the assembly: largest displacement in the picture where no factor is given
_NEAR: Final = 0.8  # of the spacing of points: nodes this near to a point have its pressure
_AROUND: Final = 0.35  # of the size of the interface, left around it
_PLAIN: Final = np.array([0.80, 0.82, 0.85])
FILM: Final = ".gif"
"""Suffix of a film."""
_NOTHING: Final = "nothing to draw"
_MARKS: Final = (("separation", "x", 12.0), ("stick", "s", 10.0), ("slip", "o", 10.0))
"""Contact states by number: name, marker and its size."""
_ALIKE: Final = 0.5  # smallest over largest value
_PER_SECOND: Final = 10  # frames
_FINENESS: Final = 80  # dots per inch of a film


@styled
def result_figure(
    tree: xr.DataTree, interface: str | None = None, time: float | None = None, magnify: float | None = None
) -> Figure:
    """Deformed bodies coloured by displacement; beside them the pressure on an interface, on the body of its points.

    Parameters
    ----------
    interface : its name, None for the one with the largest force. time : s, None for the instant of that force.
    magnify : factor on the displacements, None for a largest displacement of 5 % of the size.

    Raises
    ------
    ResultsError : the file has no displacements of bodies, or no interface of this name.
    """
    chosen = _interface(tree, interface)
    instants = stored_instants(tree)
    if time is None:
        wanted = _busiest(tree, chosen)
    else:
        wanted = time
    return _still(lambda at: bodies_in_motion(tree, chosen, at, magnify), instants, wanted)


Frame = Callable[[float], None]
"""Draws the picture of an instant, s, in a figure, in the place of the one before."""


def _still(in_motion: Callable[[Array], tuple[Figure, Frame]], instants: Array, wanted: float) -> Figure:
    """The figure of the one of ``instants`` that is nearest to the ``wanted`` one, s."""
    nearest_one = instants[[int(np.abs(instants - wanted).argmin())]]
    figure, drawn = in_motion(nearest_one)
    drawn(float(nearest_one[0]))
    return figure


def bodies_in_motion(
    tree: xr.DataTree, interface: str | None, instants: Array, magnify: float | None
) -> tuple[Figure, Frame]:
    """An empty figure of the bodies (``result_figure``), and what draws an instant in it; colours, limits and the
    factor on the displacements are those of all ``instants``.

    Raises
    ------
    ResultsError : as ``result_figure``.
    """
    from matplotlib.figure import Figure

    bodies, chosen = stored_bodies(tree), _interface(tree, interface)
    meshes = {name: _mesh(dataset) for name, dataset in bodies.items()}
    length = units_of(tree.attrs).label("m")
    rest = np.concatenate([mesh.nodes for mesh in meshes.values()])
    size, largest = float(np.ptp(rest, axis=0).max()), _largest_displacement(bodies, instants)
    if magnify is None:
        magnify = magnification(size, largest)
    pressure = 0.0
    if chosen is not None:
        pressure = _largest_pressure(tree, chosen, instants)
    scales = _Scales(largest, pressure, magnify, rest)
    flat = np.ptp(View.at(_AZIMUTH, _ELEVATION).project(rest), axis=0)
    height = float(np.clip(6.6 * flat[1] / max(float(flat[0]), 1e-300) + 2.2, 3.6, 6.4))
    width, ratios = 7.5, [1.0]
    if chosen:
        width, ratios = 11.0, [1.5, 1.0]
    figure = Figure(figsize=(width, height), layout="constrained")

    def draw_instant(time: float) -> None:
        figure.clear()
        axes = figure.subplots(1, len(ratios), squeeze=False, width_ratios=ratios)[0]
        at = {name: dataset.sel(time=time, method="nearest") for name, dataset in bodies.items()}
        # NaN where a node has no value
        moved = {name: np.nan_to_num(dataset["displacement"].values) for name, dataset in at.items()}
        _draw_deformed(figure, axes[0], meshes, moved, scales, length)
        if chosen:
            _draw_pressure(figure, axes[1], tree, chosen, time, meshes, scales.pressure)
        figure.suptitle(f"{tree.attrs.get('scene_name', 'run')}, {readable(time, 's', figure=True)}")

    return figure, draw_instant


@dataclass(frozen=True)
class _Scales:
    """Largest displacement, m, and pressure, Pa, that the colours reach to; factor on the displacements in the picture;
    nodes at rest (n, 3)."""

    displacement: float
    pressure: float
    factor: float
    rest: Array


def stored_instants(tree: xr.DataTree) -> Array:
    """Instants at which the displacements of the bodies are stored, s.

    Raises
    ------
    ResultsError : the file has no displacements of bodies.
    """
    return np.asarray(next(iter(stored_bodies(tree).values()))["time"].values, dtype=float)


def _largest_displacement(bodies: Mapping[str, xr.Dataset], instants: Array) -> float:
    fields = (dataset["displacement"].sel(time=t, method="nearest") for dataset in bodies.values() for t in instants)
    return max(float(np.linalg.norm(np.nan_to_num(field.values), axis=1).max()) for field in fields)


def _largest_pressure(tree: xr.DataTree, interface: str, instants: Array) -> float:
    dataset = tree[f"interfaces/{interface}"].to_dataset()
    chosen = dataset["traction"].sel(time=instants, method="nearest").values
    return float(np.abs(np.einsum("tpi,pi->tp", np.nan_to_num(chosen), dataset["normal"].values)).max(initial=0.0))


def stored_bodies(tree: xr.DataTree) -> dict[str, xr.Dataset]:
    """Substructures with displacements and meshes.

    Raises
    ------
    ResultsError : the file has none.
    """
    bodies = datasets_of(tree, "substructures")
    bodies = {name: d for name, d in bodies.items() if "displacement" in d and "cell_nodes" in d}
    if not bodies:
        problem = Problem(
            "substructures", "the results hold no displacements of bodies", remedy="run with --set output.fields=true"
        )
        raise ResultsError([problem], _NOTHING)
    return bodies


def _interface(tree: xr.DataTree, name: str | None) -> str | None:
    """The interface of this name, or the one with the largest force where None."""
    children = children_of(tree, "interfaces")
    if name is not None and name not in children:
        problem = Problem("--interface", "no interface of this name", name, ", ".join(children) or "none")
        raise ResultsError([problem], _NOTHING)
    if name is not None or not children:
        return name
    forces = {key: node.to_dataset()["force"].values for key, node in children.items()}
    return max(forces, key=lambda key: float(np.abs(forces[key]).max(initial=0.0)))


def _busiest(tree: xr.DataTree, interface: str | None) -> float:
    """Instant of the largest force on an interface, s; the last one stored where there is no interface."""
    if interface is None:
        return float(stored_instants(tree)[-1])
    force = tree[f"interfaces/{interface}"].to_dataset()["force"]
    return float(force["time"].values[np.linalg.norm(force.values, axis=1).argmax()])


def _mesh(dataset: xr.Dataset) -> Mesh:
    nodes = np.stack([dataset[f"node_{axis}"].values for axis in "xyz"], axis=1)
    return Mesh(nodes, cell_blocks(dataset["cell_nodes"].values.astype(np.int64)), {})


def _draw_deformed(
    figure: Figure, axis: Axes, meshes: Mapping[str, Mesh], moved: Mapping[str, Array], scales: _Scales, length: str
) -> None:
    divisor, unit = prefix_for(scales.displacement, length, figure=True)
    skins = []
    for name, mesh in meshes.items():
        skin = skin_of(mesh, _PLAIN)
        moves = np.linalg.norm(moved[name], axis=1)
        shade = _map(SEQUENTIAL, moves[skin.facets].mean(axis=1) / max(scales.displacement, 1e-300))
        skins.append(replace(skin, colours=shade).moved(scales.factor * moved[name]))
    view, reach = View.at(_AZIMUTH, _ELEVATION), scales.factor * scales.displacement
    # room for any direction of motion: half of it on each side of the bodies at rest
    box = np.array([scales.rest.min(axis=0) - 0.5 * reach, scales.rest.max(axis=0) + 0.5 * reach])
    corners = box[np.array(list(np.ndindex(2, 2, 2))), np.arange(3)]
    draw(axis, skins, view, np.concatenate([corners, *(skin.points for skin in skins)]))
    axes_with_units(axis, scales.rest, view, length)
    axis.set_title(f"displacement, drawn {scales.factor:g} times as large", fontsize=9)
    _colour_bar(figure, axis, SEQUENTIAL, scales.displacement / divisor, f"displacement ({unit})")


def magnification(size: float, largest: float) -> float:
    """Factor by which the ``largest`` displacement is about 5 % of the size of the assembly, both in m."""
    if largest > 0:
        return _round(_SEEN * size / largest)
    return 1.0


def _round(factor: float) -> float:
    """The next lower of 1, 2, 5, 10, 20, ...; nothing is drawn smaller than it is."""
    power = 10.0 ** np.floor(np.log10(max(factor, 1.0)))
    return float(max(p for p in (1.0, 2.0, 5.0) if p * power <= max(factor, 1.0)) * power)


def _draw_pressure(
    figure: Figure, axis: Axes, tree: xr.DataTree, name: str, time: float, meshes: Mapping[str, Mesh], most: float
) -> None:
    dataset = tree[f"interfaces/{name}"].to_dataset().sel(time=time, method="nearest")
    points = np.stack([dataset[axis_name].values for axis_name in "xyz"], axis=1)
    normal = dataset["normal"].values
    pressure = -np.einsum("pi,pi->p", np.nan_to_num(dataset["traction"].values), normal)
    sides = [str(dataset.attrs[key]).split(".")[0] for key in ("face_E", "face_Ep")]
    owner = _owner(points, [side for side in sides if side in meshes], meshes)
    if owner is None:
        axis.set_axis_off()
        axis.set_title(f"{name}: its bodies have no displacements in the file", fontsize=9)
        return
    # normals are those of side E
    if owner == sides[0]:
        outward = normal
    else:
        outward = -normal
    largest = max(most, 1e-300)
    skin = skin_of(meshes[owner], _PLAIN)
    share = _on_facets(skin, points, outward, pressure / largest, np.sqrt(dataset["area"].values))
    colours = np.where(np.isfinite(share)[:, None], _map(PRESSURE, np.nan_to_num(share)), skin.colours)
    view = _towards(outward.mean(axis=0))
    draw(axis, [replace(skin, colours=colours)], view)
    # facets have the mean of their corners: the values themselves are those of the points
    place = view.project(points)
    dots = _map(PRESSURE, pressure / largest)
    axis.scatter(place[:, 0], place[:, 1], s=22, c=dots, edgecolors="0.35", linewidths=0.4, zorder=4)
    zoom(axis, place, _AROUND)
    divisor, unit = prefix_for(largest, unit_of(dataset["traction"], "Pa"), figure=True)
    axis.set_title(f"{name}: pressure on {owner}", fontsize=9)
    _colour_bar(figure, axis, PRESSURE, largest / divisor, f"pressure ({unit})")


def _owner(points: Array, sides: list[str], meshes: Mapping[str, Mesh]) -> str | None:
    """The body whose nodes are nearest to the points; most points are nodes of one of the two bodies."""

    def distance(side: str) -> float:
        return float(np.mean(nearest(points, meshes[side].nodes)[0]))

    return min(sides, key=distance, default=None)


def _on_facets(skin: Skin, points: Array, outward: Array, values: Array, spacing: Array) -> Array:
    """Mean of the values (n_point,) at the corners of each facet (n_facet,), NaN where it is not on the interface.

    A corner takes the value of the nearest point, which stands for it where the face is covered in part.
    """
    distance, point = nearest(skin.points, points)
    reached = distance <= _NEAR * spacing[point]
    at_nodes = np.where(reached, values[point], np.nan)
    # facets around an edge of the face have nodes on it, too: their normals are more than 60 degrees away
    alike = np.einsum("fi,fci->fc", skin.normals(), outward[point[skin.facets]]).min(axis=1) > 0.5
    mean: Array = np.where(alike, at_nodes[skin.facets].mean(axis=1), np.nan)
    return mean


def _towards(normal: Array) -> View:
    """Of four views the one whose direction is nearest to the normal of a face."""
    views = [View.at(azimuth, elevation) for elevation in (35.0, -35.0) for azimuth in (_AZIMUTH, _AZIMUTH + 180.0)]
    return max(views, key=lambda view: float(view.viewer @ normal))


def _map(name: str, share: Array) -> Array:
    from matplotlib import colormaps

    rgb: Array = np.asarray(colormaps[name](np.clip(share, 0.0, 1.0)))[:, :3]
    return rgb


def _colour_bar(figure: Figure, axis: Axes, name: str, largest: float, label: str) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    scale = ScalarMappable(Normalize(0.0, largest), name)
    figure.colorbar(scale, ax=axis, label=label, shrink=0.6, orientation="horizontal", pad=0.02)


# -- maps of an interface, and films ---------------------------------------------------------------------------------
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
        if self.first is None:
            first = stored[0]
        else:
            first = self.first
        if self.last is None:
            last = stored[-1]
        else:
            last = self.last
        # ends that are round-off away count
        inside = stored[(stored >= first * (1 - 1e-9)) & (stored <= last * (1 + 1e-9))]
        if len(inside) < 2:
            what, value = "fewer than two stored instants are in this window", f"{first:g} to {last:g} s"
            allowed = f"a part of {stored[0]:g} to {stored[-1]:g} s"
            raise ResultsError([Problem("--from, --to", what, value, allowed)], _NOTHING)
        chosen = np.linspace(0, len(inside) - 1, min(self.frames, len(inside)))
        # where frames are as many as instants, rounding must not take one twice
        return np.asarray(inside[np.unique(np.rint(chosen).astype(int))])


_Map = tuple[str, Array, str, str]
"""Name, values, their unit (UDUNITS) and the colour map of a map."""


@styled
def map_figure(tree: xr.DataTree, interface: str | None = None, time: float | None = None) -> Figure:
    """Pressure on an interface in its mean plane, with the state of every point, and where it has any, friction, the
    accumulated slip and the energy dissipated by friction (``output.surfaces``).

    Parameters
    ----------
    interface : its name, None for the one with the largest force. time : s, None for the instant of that force.

    Raises
    ------
    ResultsError : no interface of this name, or its points carry no cells.
    """
    dataset = _surface(tree, interface)
    instants = dataset["time"].values
    if time is None:
        wanted = instants[normal_resultant(InterfaceFields.of_dataset(dataset)).argmax()]
    else:
        wanted = time
    return _still(lambda at: map_in_motion(tree, interface, at), instants, wanted)


def map_in_motion(tree: xr.DataTree, interface: str | None, instants: Array) -> tuple[Figure, Frame]:
    """An empty figure of maps, and what draws an instant in it; colours reach to the largest of all ``instants``."""
    from matplotlib.figure import Figure

    dataset = _surface(tree, interface)
    chosen = dataset.sel(time=instants, method="nearest")
    # over all instants, so that colours mean the same in each of them
    rubs = float(dataset.attrs.get("friction_coefficient", 0.0)) > 0.0
    maps = _maps(chosen, rubs)
    ranges = [_range(values) for _, values, _, _ in maps]
    if len(maps) > 2:
        rows, columns = 2, 2
    else:
        rows, columns = 1, len(maps)
    width, height = (float(np.ptp(dataset[name].values)) for name in ("surface_x", "surface_y"))
    tall = float(np.clip(4.2 * height / max(width, 1e-300), 2.0, 5.5)) + 1.6
    figure = Figure(figsize=(10.0 if rubs else 5.4, rows * tall), layout="constrained")

    def draw_instant(time: float) -> None:
        figure.clear()
        axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
        now = dataset.sel(time=[time], method="nearest")
        for axis, (name, values, unit, colours), ends in zip(axes, _maps(now, rubs), ranges, strict=True):
            _draw_field(figure, axis, dataset, (name, values[0], unit, colours), ends)
        if "contact_status" in dataset:
            _draw_states(figure, axes[0], dataset, now["contact_status"].values[0])
        head = f"{tree.attrs.get('scene_name', 'run')}: interface {dataset.attrs['name']}"
        figure.suptitle(f"{head}, {readable(time, 's', figure=True)}")

    return figure, draw_instant


def _surface(tree: xr.DataTree, interface: str | None) -> xr.Dataset:
    """Group of an interface whose points carry cells, with its name as an attribute.

    Raises
    ------
    ResultsError : there is none.
    """
    groups = datasets_of(tree, "interfaces")
    meshed = {name: dataset for name, dataset in groups.items() if "cells" in dataset}
    if interface is None and meshed:
        interface = max(meshed, key=lambda name: float(np.abs(meshed[name]["force"].values).max(initial=0.0)))
    if interface in meshed:
        return meshed[str(interface)].assign_attrs(name=interface)
    if interface in groups:
        what = "its points carry no cells"
    else:
        what = "no interface of this name"
    if interface is None:
        what = "no interface has points that carry cells"
    remedy = did_you_mean(interface, meshed)
    raise ResultsError([Problem("--interface", what, interface, listed(meshed), remedy)], _NOTHING)


def _maps(dataset: xr.Dataset, rubs: bool) -> list[_Map]:
    """Pressure, and of an interface that ``rubs`` magnitude of friction, accumulated slip and dissipated energy."""
    traction, normal = np.nan_to_num(dataset["traction"].values), dataset["normal"].values
    along, pascal = np.einsum("tpc,pc->tp", traction, normal), unit_of(dataset["traction"], "Pa")
    maps: list[_Map] = [("pressure", -along, pascal, PRESSURE)]
    if rubs:
        maps.append(("friction", np.linalg.norm(traction - along[:, :, None] * normal, axis=2), pascal, SEQUENTIAL))
        for name, unit in (("accumulated_slip", "m"), ("friction_energy", "J m-2")):
            if name in dataset:
                values = np.nan_to_num(dataset[name].values)
                maps.append((name.replace("_", " "), values, unit_of(dataset[name], unit), SEQUENTIAL))
    return maps


def _range(values: Array) -> tuple[float, float]:
    """Ends of a scale of colours: from 0, or from the smallest value where all are alike."""
    low, high = float(values.min()), float(values.max())
    if low > _ALIKE * high:
        return (low, high)
    return (0.0, high)


def _places(dataset: xr.Dataset) -> tuple[Array, str]:
    """Points in the mean plane, (2, n), in a unit that suits them, and this unit."""
    places = np.stack([dataset["surface_x"].values, dataset["surface_y"].values])
    length, metre = prefix_for(float(np.abs(places).max()), unit_of(dataset["surface_x"], "m"), figure=True)
    return places / length, metre


def _draw_field(figure: Figure, axis: Axes, dataset: xr.Dataset, drawn: _Map, ends: tuple[float, float]) -> None:
    """Values (n_point,) at the points, linear in between."""
    from matplotlib.tri import Triangulation

    # a triangle has no fourth corner
    cells = np.nan_to_num(dataset["cells"].values, nan=-1).astype(int)
    quads = cells[cells[:, 3] >= 0]
    corners = np.concatenate([cells[:, :3], quads[:, [0, 2, 3]]])  # the other half
    (x, y), metre = _places(dataset)
    name, values, stored, colours = drawn
    scale, unit = prefix_for(ends[1], stored, figure=True)
    low, top = ends[0] / scale, max(ends[1] / scale, 1e-300)
    triangles = Triangulation(x, y, corners)
    image = axis.tripcolor(triangles, values / scale, shading="gouraud", cmap=colours, vmin=low, vmax=top)
    figure.colorbar(image, ax=axis, label=f"{name} ({unit})", shrink=0.75)
    axis.set(aspect="equal", title=name, xlabel=f"along the interface ({metre})", ylabel=f"across ({metre})")


def _draw_states(figure: Figure, axis: Axes, dataset: xr.Dataset, states: Array) -> None:
    """A mark on every point: states differ by shape, so that they do in grey, too."""
    (x, y), _ = _places(dataset)
    for number, (name, mark, size) in enumerate(_MARKS):
        at = states == number
        colour: dict[str, Any] = {"facecolors": "white", "edgecolors": "black"}
        if mark == "x":
            colour = {"color": "0.35"}
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
