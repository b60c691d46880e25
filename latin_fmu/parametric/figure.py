"""The figure of a study: quantities against one parameter as curves, against two as curves or maps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import xarray as xr

from ..errors import Problem, ResultsError, did_you_mean, listed
from ..pictures.style import BAD, SEQUENTIAL, curve_styles, styled
from ..results.groups import key_of, unit_of
from ..scene.readable_numbers import prefix_for
from ..scene.units import unit_text
from .point import CONVERGED, FAILED, QUANTITIES, Quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SHOWN: Final = ("peak_force", "impulse", "first_contact", "largest_slip", "friction_work", "iterations", "cpu")
"""Quantities that are drawn where none is named."""
_MOST_CURVES: Final = 6  # values of a second parameter that are drawn as curves; more as a map
_MOST_PARTS: Final = 6  # interfaces, sensors ... of one quantity that are drawn


@styled
def study_figure(study: xr.Dataset, names: list[str] | None = None) -> Figure:
    """Panels of the quantities ``names`` (some of all where None) against the first two parameters; of further
    parameters the first value is taken, which is in the title. Points that failed or did not converge are marked.

    Raises
    ------
    ResultsError : the study has no quantity of such a name.
    """
    from matplotlib.figure import Figure

    parameters = [str(dim) for dim in study["state"].dims]
    study, rest = _first_values(study, parameters[2:])
    panels = [panel for quantity in _chosen(study, names) for panel in _panels(study, quantity)]
    columns = min(3, max(1, len(panels)))
    rows = -(-max(1, len(panels)) // columns)  # rounded up
    figure = Figure(figsize=(4.6 * columns, 3.5 * rows + 0.6), layout="constrained")
    axes = list(figure.subplots(rows, columns, squeeze=False).flat)
    for axis, (title, unit, values) in zip(axes, panels, strict=False):
        _draw(axis, study, parameters[:2], title, unit, values)
    for axis in axes[len(panels) :]:
        axis.set_axis_off()
    states = study["state"].values
    counts = [f"{int((states == FAILED).sum())} failed", f"{int((states == 1).sum())} not converged"]
    bad = (states != CONVERGED).any()
    title = f"{study.attrs.get('scene_name', 'study')}: {states.size} points{rest}"
    figure.suptitle(title + (f" ({', '.join(counts)})" if bad else ""), color=BAD if bad else "black")
    return figure


def _first_values(study: xr.Dataset, parameters: list[str]) -> tuple[xr.Dataset, str]:
    """The study at the first values of parameters, and these in words."""
    text = "".join(f", {key_of(study[name])} = {study[name].values[0]}" for name in parameters)
    return study.isel(dict.fromkeys(parameters, 0)), text


def _chosen(study: xr.Dataset, names: list[str] | None) -> list[Quantity]:
    """Quantities to draw.

    Raises
    ------
    ResultsError : there is none of such a name.
    """
    known = {q.name: q for q in QUANTITIES if q.name in study}
    if names is None:
        return [known[name] for name in _SHOWN if name in known and np.isfinite(study[name].values).any()]
    problems = [
        Problem("--quantity", "the study has no quantity of this name", name, listed(known), did_you_mean(name, known))
        for name in names
        if name not in known
    ]
    if problems:
        raise ResultsError(problems, "the figure cannot be drawn")
    return [known[name] for name in names]


def _panels(study: xr.Dataset, quantity: Quantity) -> list[tuple[str, str, xr.DataArray]]:
    """Title, unit and values of the panels of a quantity: one for each of its parts."""
    values = study[quantity.name]
    title = quantity.name.replace("_", " ").replace("cpu", "CPU")
    if not quantity.of:
        return [(title, unit_of(values, quantity.unit), values)]
    parts = [str(part) for part in study[quantity.of].values][:_MOST_PARTS]
    return [(f"{part}: {title}", unit_of(values, quantity.unit), values.sel({quantity.of: part})) for part in parts]


def _draw(axis: Axes, study: xr.Dataset, parameters: list[str], title: str, unit: str, values: xr.DataArray) -> None:
    """One panel: curves over one parameter, one for each value of a second one; a map where these are many."""
    if np.isfinite(values.values).any():
        largest = float(np.nanmax(np.abs(values.values)))
    else:
        largest = 0.0
    divisor, label = prefix_for(largest, unit, figure=True)
    axis.set_title(f"{title} ({label})" if label else title, fontsize="medium")
    axis.set_xlabel(_label(study[parameters[0]]), fontsize="small")
    numbers = values.transpose(*parameters).values / divisor
    states = study["state"].transpose(*parameters).values
    if len(parameters) == 1:
        _curve(axis, study[parameters[0]].values, numbers, states, curve_styles(1, True)[0], None)
    elif len(study[parameters[1]]) <= _MOST_CURVES:
        others = study[parameters[1]].values
        for i, (other, look) in enumerate(zip(others, curve_styles(len(others), True), strict=True)):
            _curve(
                axis,
                study[parameters[0]].values,
                numbers[:, i],
                states[:, i],
                look,
                f"{other:g}" if others.dtype.kind in "fiu" else str(other),
            )
        axis.legend(title=_label(study[parameters[1]]), fontsize="x-small", title_fontsize="x-small")
    else:
        _map(axis, [study[name].values for name in parameters], numbers, states)
        axis.set_ylabel(_label(study[parameters[1]]), fontsize="small")


def _label(parameter: xr.DataArray) -> str:
    """Key of a parameter, with its unit."""
    unit = unit_text(parameter.attrs.get("units", "1"), figure=True)
    if unit:
        return f"{key_of(parameter)} ({unit})"
    return key_of(parameter)


def _places(axis: Any, values: np.ndarray) -> np.ndarray:
    """Places along a matplotlib axis; texts are equally spaced."""
    if values.dtype.kind in "fiu":
        return values
    axis.set_ticks(range(len(values)), [str(v) for v in values], fontsize="x-small")
    return np.arange(len(values))


def _curve(
    axis: Axes, x: np.ndarray, y: np.ndarray, states: np.ndarray, look: Mapping[str, Any], label: str | None
) -> None:
    """One curve; points that did not converge are crosses, failed ones crosses at the bottom."""
    places = _places(axis.xaxis, x)
    axis.ticklabel_format(axis="y", useOffset=False)
    order = np.argsort(places)
    axis.plot(places[order], y[order], label=label, **look)
    bad, lost = (states != CONVERGED) & np.isfinite(y), states == FAILED
    axis.plot(places[bad], y[bad], "x", color=BAD, markersize=7)
    # x in the units of the data, y as a share of the panel
    axis.plot(places[lost], np.full(int(lost.sum()), 0.02), "x", color=BAD, transform=axis.get_xaxis_transform())


def _map(axis: Axes, values: list[np.ndarray], numbers: np.ndarray, states: np.ndarray) -> None:
    """One map over two parameters; points that failed or did not converge are crosses."""
    x, y = _places(axis.xaxis, values[0]), _places(axis.yaxis, values[1])
    along, across = np.argsort(x), np.argsort(y)
    x = x[along]
    y = y[across]
    numbers = numbers[along][:, across]
    states = states[along][:, across]
    # rows of ``numbers`` are those of the first parameter, which is drawn along x
    mesh = axis.pcolormesh(x, y, np.ma.masked_invalid(numbers.T), shading="nearest", cmap=SEQUENTIAL)
    axis.figure.colorbar(mesh, ax=axis)
    i, j = np.nonzero(states != CONVERGED)
    axis.plot(x[i], y[j], "x", color=BAD, markersize=7)
