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
from ..scene.readable_numbers import prefix_for, readable, readable_vector
from .body_fields import (
    NOTHING,
    PLAIN_LOOK,
    STRESSES,
    Look,
    at_instants,
    away,
    base_motion,
    largest_stresses,
    nodal_stress,
    stored_bodies,
)
from .frame import Skin, View, axes_with_units, draw, mapped, skin_of, zoom
from .style import PRESSURE, SEQUENTIAL, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_AZIMUTH, _ELEVATION = -60.0, 25.0
_SEEN: Final = 0.05  # of the size of the assembly: largest displacement in the picture where no factor is given
_NEAR: Final = 0.8  # of the spacing of points: nodes this near to a point have its pressure
_AROUND_BODIES: Final = 1.5  # inches for titles and scale above and below the bodies
_AROUND: Final = 0.35  # of the size of the interface, left around it
_PLAIN: Final = np.array([0.80, 0.82, 0.85])
FILM: Final = ".gif"
"""Suffix of a film."""
_MARKS: Final = (("separation", "x", 12.0), ("stick", "s", 10.0), ("slip", "o", 10.0))
"""Contact states by number: name, marker and its size."""
_ALIKE: Final = 0.5  # smallest over largest value
_PER_SECOND: Final = 10  # frames
_FINENESS: Final = 80  # dots per inch of a film


@styled
def result_figure(tree: xr.DataTree, time: float | None = None, look: Look = PLAIN_LOOK) -> Figure:
    """Deformed bodies coloured by displacement; beside them the pressure on an interface, on the body of its points.
    Coloured by a stress, the bodies alone, with an interface where one is named.

    Parameters
    ----------
    time : s, None for the instant of the largest force on the interface, or of the largest stress away from edges of
        contacts. look : what is drawn.

    Raises
    ------
    ResultsError : the file has no displacements of bodies, no stresses where these are drawn, or no interface of this
        name.
    """
    instants = stored_instants(tree)
    if time is not None:
        wanted = time
    elif look.stress is not None:
        wanted = float(instants[largest_stresses(stored_bodies(tree, look.stress), look.stress, instants)[0].argmax()])
    else:
        wanted = _busiest(tree, _interface(tree, look.interface))
    return _still(lambda at: bodies_in_motion(tree, at, look), instants, wanted)


Frame = Callable[[float], None]
"""Draws the picture of an instant, s, in a figure, in the place of the one before."""


def _still(in_motion: Callable[[Array], tuple[Figure, Frame]], instants: Array, wanted: float) -> Figure:
    """The figure of the one of ``instants`` that is nearest to the ``wanted`` one, s."""
    nearest_one = instants[[int(np.abs(instants - wanted).argmin())]]
    figure, drawn = in_motion(nearest_one)
    drawn(float(nearest_one[0]))
    return figure


def bodies_in_motion(tree: xr.DataTree, instants: Array, look: Look) -> tuple[Figure, Frame]:
    """An empty figure of the bodies (``result_figure``), and what draws an instant in it; colours, limits and the
    factor on the displacements are those of all ``instants``.

    Raises
    ------
    ResultsError : as ``result_figure``.
    """
    from matplotlib.figure import Figure

    bodies, chosen = stored_bodies(tree, look.stress), _interface(tree, look.interface)
    if look.stress is not None and look.interface is None:
        chosen = None
    meshes = {name: _mesh(dataset) for name, dataset in bodies.items()}
    scales = _scales(tree, bodies, instants, replace(look, interface=chosen))
    width, ratios = 7.5, [1.0]
    if chosen:
        width, ratios = 11.0, [1.5, 1.0]
    # as high as the bodies with their axes are in a panel of this width, and room for titles and scale
    tall = _tallness(scales) * width * ratios[0] / sum(ratios) + _AROUND_BODIES
    figure = Figure(figsize=(width, float(np.clip(tall, 3.4, 7.5))), layout="constrained")

    def draw_instant(time: float) -> None:
        figure.clear()
        axes = figure.subplots(1, len(ratios), squeeze=False, width_ratios=ratios)[0]
        at = np.array([time])
        base = base_motion(bodies, at)[0]
        moved = {name: at_instants(dataset, "displacement", at)[0] - base for name, dataset in bodies.items()}
        if look.stress is None:
            shown = {name: np.linalg.norm(moves, axis=1) for name, moves in moved.items()}
        else:
            shown = {name: nodal_stress(dataset, look.stress, time) for name, dataset in bodies.items()}
        _draw_deformed(figure, axes[0], meshes, (moved, shown), scales)
        if look.stress is not None:
            axes[0].set_title(f"{scales.title}\n{_largest_in(bodies, shown, scales)}", fontsize=9)
        if chosen:
            _draw_pressure(figure, axes[1], tree, chosen, time, meshes, scales.pressure)
        figure.suptitle(f"{tree.attrs.get('scene_name', 'run')}, {readable(time, 's', figure=True)}")

    return figure, draw_instant


def _largest_in(bodies: Mapping[str, xr.Dataset], shown: Mapping[str, Array], scales: _Scales) -> str:
    """Where the largest stress (n_node,) away from edges of contacts is, which may be inside."""
    sizes = {name: np.where(away(dataset), shown[name], -np.inf) for name, dataset in bodies.items()}
    name = max(sizes, key=lambda body: float(np.nan_to_num(sizes[body], nan=-np.inf).max()))
    node = int(np.nan_to_num(sizes[name], nan=-np.inf).argmax())
    if not np.isfinite(sizes[name][node]):
        return "every cell touches the edge of a contact"
    place = [float(bodies[name][f"node_{axis}"].values[node]) for axis in "xyz"]
    size = readable(float(sizes[name][node]), scales.unit, 3, figure=True)
    return f"away from edges of contacts up to {size}, in {name} at {readable_vector(place, scales.length, 3)}"


@dataclass(frozen=True)
class _Scales:
    """What all instants of a figure of bodies have in common.

    Attributes
    ----------
    reach : largest displacement, m. pressure : largest one, Pa. factor : on the displacements in the picture. rest :
        nodes at rest (n, 3), m. length : unit of it. top, unit : largest value of the field that colours the bodies,
        and its unit. beyond : largest one at edges of contacts where that is another. colours, what, title : of the
        field.
    """

    reach: float
    pressure: float
    factor: float
    rest: Array
    length: str
    top: float
    unit: str
    beyond: float
    colours: str
    what: str
    title: str

    def around(self, view: View) -> Array:
        """Points (n, 3) that are in view, m: the bodies at rest, half of the largest motion around them."""
        reach = 0.5 * self.factor * self.reach * np.array([view.right, -view.right, view.up, -view.up])
        return np.asarray((self.rest + reach[:, None]).reshape(-1, 3))


def _tallness(scales: _Scales) -> float:
    """Height over width of the picture of bodies with their axes."""
    from matplotlib.figure import Figure

    axis, view = Figure().add_subplot(), View.at(_AZIMUTH, _ELEVATION)
    zoom(axis, view.project(scales.around(view)), 0.04)
    axes_with_units(axis, scales.rest, view, scales.length)
    return float(np.ptp(axis.get_ylim()) / np.ptp(axis.get_xlim()))


def _scales(tree: xr.DataTree, bodies: Mapping[str, xr.Dataset], instants: Array, look: Look) -> _Scales:
    rest = np.concatenate([_mesh(dataset).nodes for dataset in bodies.values()])
    units, base = units_of(tree.attrs), base_motion(bodies, instants)
    reach = max(
        float(np.linalg.norm(at_instants(d, "displacement", instants) - base[:, None], axis=2).max(initial=0.0))
        for d in bodies.values()
    )
    factor = look.magnify
    if factor is None:
        factor = magnification(float(np.ptp(rest, axis=0).max()), reach)
    pressure = 0.0
    if look.interface is not None:
        pressure = _largest_pressure(tree, look.interface, instants)
    drawn = f"displacement drawn {factor:g} times as large"
    if base.any():
        drawn = f"displacement relative to the base, drawn {factor:g} times as large"
    if look.stress is None:
        field = (reach, units.label("m"), reach, SEQUENTIAL, "displacement", drawn)
    else:
        far, anywhere = largest_stresses(bodies, look.stress, instants)
        field = (float(far.max()), units.label("Pa"), float(anywhere.max()), PRESSURE, STRESSES[look.stress], drawn)
    return _Scales(reach, pressure, factor, rest, units.label("m"), *field)


def stored_instants(tree: xr.DataTree) -> Array:
    """Instants at which the displacements of the bodies are stored, s.

    Raises
    ------
    ResultsError : the file has no displacements of bodies.
    """
    return np.asarray(next(iter(stored_bodies(tree).values()))["time"].values, dtype=float)


def _largest_pressure(tree: xr.DataTree, interface: str, instants: Array) -> float:
    dataset = tree[f"interfaces/{interface}"].to_dataset()
    chosen = dataset["traction"].sel(time=instants, method="nearest").values
    return float(np.abs(np.einsum("tpi,pi->tp", np.nan_to_num(chosen), dataset["normal"].values)).max(initial=0.0))


def _interface(tree: xr.DataTree, name: str | None) -> str | None:
    """The interface of this name, or the one with the largest force where None."""
    children = children_of(tree, "interfaces")
    if name is not None and name not in children:
        problem = Problem("--interface", "no interface of this name", name, ", ".join(children) or "none")
        raise ResultsError([problem], NOTHING)
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
    figure: Figure,
    axis: Axes,
    meshes: Mapping[str, Mesh],
    fields: tuple[Mapping[str, Array], Mapping[str, Array]],
    scales: _Scales,
) -> None:
    """Bodies with their displacements (n_node, 3), coloured by a field (n_node,)."""
    moved, shown = fields
    skins = [
        replace(skin_of(mesh, _PLAIN), field=(shown[name] / max(scales.top, 1e-300), scales.colours)).moved(
            scales.factor * moved[name]
        )
        for name, mesh in meshes.items()
    ]
    view = View.at(_AZIMUTH, _ELEVATION)
    draw(axis, skins, view, np.concatenate([scales.around(view), *(skin.points for skin in skins)]))
    axes_with_units(axis, scales.rest, view, scales.length)
    axis.set_title(scales.title, fontsize=9)
    divisor, unit = prefix_for(scales.top, scales.unit, figure=True)
    label = f"{scales.what} ({unit})"
    if scales.beyond > scales.top:
        label += f", up to {readable(scales.beyond, scales.unit, 3, figure=True)} at edges of contacts"
    _colour_bar(figure, axis, scales.colours, scales.top / divisor, label, scales.beyond > scales.top)


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
    colours = np.where(np.isfinite(share)[:, None], mapped(PRESSURE, np.nan_to_num(share)), skin.colours)
    view = _towards(outward.mean(axis=0))
    draw(axis, [replace(skin, colours=colours)], view)
    # facets have the mean of their corners: the values themselves are those of the points
    place = view.project(points)
    dots = mapped(PRESSURE, pressure / largest)
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


def _colour_bar(figure: Figure, axis: Axes, name: str, largest: float, label: str, beyond: bool = False) -> None:
    """Scale of colours from 0 to the largest value; ``beyond`` : there are larger ones, in the last colour."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    scale = ScalarMappable(Normalize(0.0, largest), name)
    extend = "neither"
    if beyond:
        extend = "max"
    figure.colorbar(scale, ax=axis, label=label, shrink=0.6, orientation="horizontal", pad=0.02, extend=extend)


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
            raise ResultsError([Problem("--from, --to", what, value, allowed)], NOTHING)
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
    tall = float(np.clip(3.7 * height / max(width, 1e-300), 1.6, 5.0)) + 0.7
    figure = Figure(figsize=(10.0 if rubs else 5.4, rows * tall + 0.8), layout="constrained")

    def draw_instant(time: float) -> None:
        figure.clear()
        axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
        now = dataset.sel(time=[time], method="nearest")
        for axis, (name, values, unit, colours), ends in zip(axes, _maps(now, rubs), ranges, strict=True):
            _draw_field(figure, axis, dataset, (name, values[0], unit, colours), ends)
        if "contact_status" in dataset:
            _draw_states(figure, axes[0], dataset, now["contact_status"].values[0])
        head = f"{tree.attrs.get('scene_name', 'run')}: interface {dataset.attrs['name']}{_level(dataset)}"
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
    raise ResultsError([Problem("--interface", what, interface, listed(meshed), remedy)], NOTHING)


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
    if high <= 0.0:  # nothing anywhere: a scale all the same
        return (0.0, 1.0)
    if low > _ALIKE * high:
        return (low, high)
    return (0.0, high)


def _places(dataset: xr.Dataset) -> tuple[Array, str]:
    """Points in the mean plane, (2, n), in a unit that suits them, and this unit."""
    places = np.stack([dataset["surface_x"].values, dataset["surface_y"].values])
    length, metre = prefix_for(float(np.abs(places).max()), unit_of(dataset["surface_x"], "m"), figure=True)
    return places / length, metre


def _direction(coordinate: xr.DataArray) -> str:
    """Name of the axis of a coordinate in the plane: that of a global axis, or its direction."""
    if "direction" not in coordinate.attrs:
        return {"surface_x": "along the interface", "surface_y": "across"}[str(coordinate.name)]
    direction = np.asarray(coordinate.attrs["direction"], dtype=float)
    axis = int(np.abs(direction).argmax())
    if direction[axis] > 1.0 - 1e-6:
        return "xyz"[axis]
    return f"along ({', '.join(f'{part:.2g}' for part in np.round(direction, 3) + 0.0)})"


def _level(dataset: xr.Dataset) -> str:
    """Where a plane across a global axis lies, empty for others."""
    points = np.stack([dataset[axis].values for axis in "xyz"])
    flat = int(np.ptp(points, axis=1).argmin())
    if np.ptp(points[flat]) > 1e-6 * np.ptp(points):
        return ""
    unit = unit_of(dataset["xyz"[flat]], "m")
    return f" at {'xyz'[flat]} = {readable(float(points[flat].mean()), unit, 4, figure=True)}"


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
    along, across = (_direction(dataset[which]) for which in ("surface_x", "surface_y"))
    axis.set(aspect="equal", title=name, xlabel=f"{along} ({metre})", ylabel=f"{across} ({metre})")
    # of panels that share their axes the outer ones have labels
    axis.label_outer()


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
    look: Look = PLAIN_LOOK,
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
        instants = window.instants(_surface(tree, look.interface)["time"].values)
        figure, drawn = map_in_motion(tree, look.interface, instants)
    else:
        instants = window.instants(stored_instants(tree))
        figure, drawn = bodies_in_motion(tree, instants, look)
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
