"""How results of a run change with parameters of its scene: bars of relative changes, the longest first; histories and
spectra with the bands that they have where parameters scatter."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import xarray as xr

from ..errors import Problem, ResultsError
from ..latin.outcome import Array
from ..results.groups import datasets_of, unit_of
from ..results.sensitivities import CHECKED, MANY, PART, in_words
from ..results.spread import SAMPLED
from ..scene.quantity_table import in_words as quantity_in_words
from ..scene.readable_numbers import prefix_for
from .style import BAD, DISTINCT, TimeAxis, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# inches
_WIDTH = 4.2
_ROW = 0.24
_COLUMNS = 2
_LEAST: Final = 1e-4  # relative change below which a quantity has no panel
_MOST: Final = 4  # interfaces, sensors and bolts that are drawn, those with the largest values


@styled
def tornado_figure(tree: xr.DataTree) -> Figure:
    """A panel a quantity with a bar a parameter: change in % for parameters larger by PART; flagged ones are hatched,
    those that a run with a larger parameter gave are grey.

    Raises
    ------
    ResultsError : the results have no derivatives.
    """
    from matplotlib.figure import Figure

    if "sensitivities" not in tree.children:
        remedy = "name parameters in output.sensitivities and run the scene"
        raise ResultsError([Problem("--tornado", "the results have no derivatives by parameters", remedy=remedy)])
    data = tree["sensitivities"].to_dataset()
    value = np.abs(np.asarray(data["value"].values, dtype=float))
    # a value of 0 has no relative change: over infinity none is drawn
    changes = PART * np.asarray(data["change"].values, dtype=float) / np.where(value > 0.0, value, np.inf)[:, None]
    flagged, secant = (np.asarray(data[key].values) == 1 for key in ("flagged", "secant"))
    names = [in_words(str(p)) for p in data["parameter"].values]
    shown = np.flatnonzero(np.abs(changes).max(axis=1, initial=0.0) > _LEAST)
    rows = -(-max(len(shown), 1) // _COLUMNS)
    height = rows * (_ROW * len(names) + 0.6) + 0.6
    figure = Figure(figsize=(_WIDTH * _COLUMNS, height), layout="constrained")
    figure.suptitle(
        f"{tree.attrs.get('scene_name', 'run')}: change in % for parameters {100 * PART:g} % larger", fontweight="bold"
    )
    for place, q in enumerate(shown):
        axis = figure.add_subplot(rows, _COLUMNS, place + 1)
        order = np.argsort(np.abs(changes[q]))
        bars = axis.barh([names[i] for i in order], 100 * changes[q, order], color=DISTINCT[0])
        for bar, i in zip(bars, order, strict=True):
            if flagged[q, i]:
                bar.set(facecolor="white", edgecolor=BAD, hatch="////")
            elif secant[q, i]:
                bar.set(facecolor="0.6")
        axis.axvline(0.0, color="0.4", linewidth=0.8)
        axis.set_title(quantity_in_words(str(data["quantity"].values[q])))
    notes = ["hatched: uncertain, as contact states or instants of peaks change"] * bool(flagged[shown].any())
    notes += [f"grey: by a run with {100 * CHECKED:g} % more"] * bool(secant[shown].any())
    if notes:
        figure.supxlabel("; ".join(notes), fontsize="medium", color=BAD)
    return figure


@styled
def bands_figure(tree: xr.DataTree) -> Figure:
    """Normal forces of interfaces, motions of sensors, tensions of bolts and spectra with their bands at 95 %, those of
    samples beside them where there are some. Instants at which states change are marked: bands to first order may
    not hold there.

    Raises
    ------
    ResultsError : the results have no bands.
    """
    from matplotlib.figure import Figure

    if "spread" not in tree.children:
        remedy = "name parameters in the table [spread] and run the scene"
        raise ResultsError([Problem("--bands", "the results have no bands", remedy=remedy)], "nothing to draw")
    spread = tree.children["spread"]
    events = {name: _events(data) for name, data in datasets_of(tree.children["sensitivities"], "interfaces").items()}
    every = [instants for instants in events.values() if instants.size]
    if every:
        anywhere = np.unique(np.concatenate(every))
    else:
        anywhere = np.zeros(0)
    panels = [(name, data["normal_force"], events[name], data) for name, data in _shown(spread, "interfaces")]
    for name, data in _shown(spread, "sensors"):
        choices = ("acceleration_filtered", "acceleration", "displacement")
        motion = _largest_component(data[next(key for key in choices if key in data)])
        panels.append((f"{name}, along {motion['component'].item()}", motion, anywhere, data))
        if "spectrum" in (node := spread.children["sensors"].children[name]).children:
            of = node["spectrum"].to_dataset()
            response = _largest_component(of["acceleration"].sel(response="maximax"))
            title = f"spectrum of {name}, along {response['component'].item()}"
            panels.append((title, response, np.zeros(0), of))
    panels += [(f"tension of {name}", data["force"], anywhere, data) for name, data in _shown(spread, "bolts")]
    rows = -(-len(panels) // _COLUMNS)
    figure = Figure(figsize=(5.2 * _COLUMNS, 2.6 * max(rows, 1) + 0.8), layout="constrained")
    figure.suptitle(f"{tree.attrs.get('scene_name', 'run')}: bands at 95 %", fontweight="bold")
    for place, (title, curve, marks, data) in enumerate(panels):
        axis = figure.add_subplot(rows, _COLUMNS, place + 1)
        axis.set_title(title)
        _draw_band(axis, curve, data, marks)
    if panels:
        figure.axes[0].legend(fontsize="small")
    if any(marks.size for _, _, marks, _ in panels):
        figure.supxlabel("marks below: contact points change their state", fontsize="medium", color=BAD)
    return figure


def _shown(spread: xr.DataTree, kind: str) -> list[tuple[str, xr.Dataset]]:
    """Names and datasets of a kind with the largest values."""
    found = [(name, data) for name, data in datasets_of(spread, kind).items() if data.data_vars]

    def size(pair: tuple[str, xr.Dataset]) -> float:
        return -float(np.abs(next(iter(pair[1].data_vars.values())).values).max(initial=0.0))

    largest = sorted(found, key=size)[:_MOST]
    return [pair for pair in found if any(pair is other for other in largest)]


def _events(data: xr.Dataset) -> Array:
    """Instants at which many points of an interface change their state within a little of a parameter, s."""
    many = (data["changing"].values > MANY).any(axis=0)
    return np.asarray(data["time"].values[many], dtype=float)


def _largest_component(values: xr.DataArray) -> xr.DataArray:
    """Values along the axis of the largest one."""
    first = values.transpose("component", ...).values
    return values.isel(component=int(np.argmax(np.abs(first).reshape(len(first), -1).max(axis=1))))


def _draw_band(axis: Axes, curve: xr.DataArray, data: xr.Dataset, marks: Array) -> None:
    """A curve over time, or a spectrum over the frequency, with its bands."""
    labels = {name: curve[name].item() for name in ("component", "response") if name in curve.coords}
    along = str(curve.dims[0])
    ends = {key: data[f"{curve.name}_{key}"].sel(labels).values for key in ("low", "high")}
    x, values = np.asarray(curve[along].values, dtype=float), np.asarray(curve.values, dtype=float)
    largest = max(float(np.abs(ends[key]).max(initial=0.0)) for key in ends)
    size, unit = prefix_for(largest, unit_of(curve, "1"), figure=True)
    if along == "time":
        scale = TimeAxis(*prefix_for(float(x[-1]), "s", figure=True))
        scale.set(axis, float(x[0]), float(x[-1]))
        x = x / scale.divisor
        axis.plot(
            marks / scale.divisor, np.full(len(marks), 0.02), "|", color=BAD, transform=axis.get_xaxis_transform()
        )
    else:
        # a logarithmic axis has no 0, and bands may reach it
        low = max(0.5 * float(values.min()), 1e-3 * largest) / size
        axis.set(xscale="log", yscale="log", xlabel="natural frequency (Hz)", ylim=(low, 2.0 * largest / size))
    axis.fill_between(
        x, ends["low"] / size, ends["high"] / size, color="0.80", linewidth=0, label="band to first order"
    )
    axis.plot(x, values / size, color=DISTINCT[0], label="run")
    for key, label in (("low", "band of samples"), ("high", None)):
        if (name := f"{curve.name}_{SAMPLED}_{key}") in data:
            axis.plot(x, data[name].sel(labels).values / size, "--", color=DISTINCT[1], linewidth=0.9, label=label)
    axis.set_ylabel(f"{str(curve.name).replace('_', ' ')} ({unit})")
