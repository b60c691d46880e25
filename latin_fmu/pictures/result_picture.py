"""Bodies of a results file: deformed shapes at an instant, and the pressure on an interface."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np
import xarray as xr

from ..errors import Problem, ResultsError
from ..fem.mesh import Array, Mesh, cell_blocks, nearest
from ..results.groups import unit_of, units_of
from ..results.summary import prefix_for, readable
from .frame import Skin, View, axes_with_units, draw, skin_of
from .style import PRESSURE, SEQUENTIAL, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_AZIMUTH, _ELEVATION = -60.0, 25.0
_SEEN: Final = 0.05  # of the size of the assembly: largest displacement in the picture where no factor is given
_NEAR: Final = 0.8  # of the spacing of points: nodes this near to a point have its pressure
_AROUND: Final = 0.35  # of the size of the interface, left around it
_PLAIN: Final = np.array([0.80, 0.82, 0.85])


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
    wanted = _busiest(tree, chosen) if time is None else time
    at = int(np.abs(instants - wanted).argmin())
    figure, drawn = bodies_in_motion(tree, chosen, instants[at : at + 1], magnify)
    drawn(float(instants[at]))
    return figure


Frame = Callable[[float], None]
"""Draws the picture of an instant, s, in a figure, in the place of the one before."""


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

    bodies, chosen = _bodies(tree), _interface(tree, interface)
    meshes = {name: _mesh(dataset) for name, dataset in bodies.items()}
    length = units_of(tree.attrs).label("m")
    rest = np.concatenate([mesh.nodes for mesh in meshes.values()])
    size, largest = float(np.ptp(rest, axis=0).max()), _largest_displacement(bodies, instants)
    if magnify is None:
        magnify = _round(_SEEN * size / largest) if largest > 0 else 1.0
    scales = _Scales(largest, 0.0 if chosen is None else _largest_pressure(tree, chosen, instants), magnify, rest)
    flat = np.ptp(View.at(_AZIMUTH, _ELEVATION).project(rest), axis=0)
    height = float(np.clip(6.6 * flat[1] / max(float(flat[0]), 1e-300) + 2.2, 3.6, 6.4))
    figure = Figure(figsize=(11.0 if chosen else 7.5, height), layout="constrained")

    def draw_instant(time: float) -> None:
        figure.clear()
        axes = figure.subplots(1, 2 if chosen else 1, squeeze=False, width_ratios=(1.5, 1.0) if chosen else (1.0,))[0]
        at = {name: dataset.sel(time=time, method="nearest") for name, dataset in bodies.items()}
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
    return np.asarray(next(iter(_bodies(tree).values()))["time"].values, dtype=float)


def _largest_displacement(bodies: Mapping[str, xr.Dataset], instants: Array) -> float:
    fields = (dataset["displacement"].sel(time=t, method="nearest") for dataset in bodies.values() for t in instants)
    return max(float(np.linalg.norm(np.nan_to_num(field.values), axis=1).max()) for field in fields)


def _largest_pressure(tree: xr.DataTree, interface: str, instants: Array) -> float:
    dataset = tree[f"interfaces/{interface}"].to_dataset()
    chosen = dataset["traction"].sel(time=instants, method="nearest").values
    return float(np.abs(np.einsum("tpi,pi->tp", np.nan_to_num(chosen), dataset["normal"].values)).max(initial=0.0))


def _bodies(tree: xr.DataTree) -> dict[str, xr.Dataset]:
    """Substructures with displacements and meshes."""
    children = tree["substructures"].children if "substructures" in tree.children else {}
    bodies = {name: node.to_dataset() for name, node in children.items()}
    bodies = {name: d for name, d in bodies.items() if "displacement" in d and "cell_nodes" in d}
    if not bodies:
        problem = Problem(
            "substructures", "the results hold no displacements of bodies", remedy="run with --set output.fields=true"
        )
        raise ResultsError([problem], "nothing to draw")
    return bodies


def _interface(tree: xr.DataTree, name: str | None) -> str | None:
    """The interface of this name, or the one with the largest force where None."""
    children = tree["interfaces"].children if "interfaces" in tree.children else {}
    if name is not None and name not in children:
        problem = Problem("--interface", "no interface of this name", name, ", ".join(children) or "none")
        raise ResultsError([problem], "nothing to draw")
    if name is not None or not children:
        return name
    forces = {key: node.to_dataset()["force"].values for key, node in children.items()}
    return max(forces, key=lambda key: float(np.abs(forces[key]).max(initial=0.0)))


def _busiest(tree: xr.DataTree, interface: str | None) -> float:
    """Instant of the largest force on an interface; the last one where there is none."""
    if interface is None:
        return np.inf
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
    box = np.array([scales.rest.min(axis=0) - 0.5 * reach, scales.rest.max(axis=0) + 0.5 * reach])
    corners = box[np.array(list(np.ndindex(2, 2, 2))), np.arange(3)]
    draw(axis, skins, view, np.concatenate([corners, *(skin.points for skin in skins)]))
    axes_with_units(axis, scales.rest, view, length)
    axis.set_title(f"displacement, drawn {scales.factor:g} times as large", fontsize=9)
    _colour_bar(figure, axis, SEQUENTIAL, scales.displacement / divisor, f"displacement ({unit})")


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
    outward = normal if owner == sides[0] else -normal
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
    _zoom(axis, place)
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
    alike = np.einsum("fi,fci->fc", skin.normals(), outward[point[skin.facets]]).min(axis=1) > 0.5
    mean: Array = np.where(alike, at_nodes[skin.facets].mean(axis=1), np.nan)
    return mean


def _towards(normal: Array) -> View:
    """Of four views the one whose direction is nearest to the normal of a face."""
    views = [View.at(azimuth, elevation) for elevation in (35.0, -35.0) for azimuth in (_AZIMUTH, _AZIMUTH + 180.0)]
    return max(views, key=lambda view: float(view.viewer @ normal))


def _zoom(axis: Axes, flat: Array) -> None:
    low, high = flat.min(axis=0), flat.max(axis=0)
    room = _AROUND * float(np.max(high - low))
    axis.set_xlim(low[0] - room, high[0] + room)
    axis.set_ylim(low[1] - room, high[1] + room)


def _map(name: str, share: Array) -> Array:
    from matplotlib import colormaps

    rgb: Array = np.asarray(colormaps[name](np.clip(share, 0.0, 1.0)))[:, :3]
    return rgb


def _colour_bar(figure: Figure, axis: Axes, name: str, largest: float, label: str) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    scale = ScalarMappable(Normalize(0.0, largest), name)
    figure.colorbar(scale, ax=axis, label=label, shrink=0.6, orientation="horizontal", pad=0.02)
