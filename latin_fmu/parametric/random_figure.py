"""The figure of a random vibration: spectra and level crossings of a few signals with their bands, beside the linear
answer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
import xarray as xr

from ..errors import Problem, ResultsError, did_you_mean, listed
from ..pictures.style import styled
from ..results.groups import children_of, unit_of
from ..scene.readable_numbers import prefix_for, readable
from ..scene.units import unit_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MOST: Final = 4  # signals where none is named
_MEASURED: Final = "#0072B2"
_LINEAR: Final = "#D55E00"
_GAUSSIAN: Final = "0.45"
_RANGE: Final = 1e-6  # of the largest density: what is below is not drawn


@styled
def random_figure(tree: xr.DataTree, names: Sequence[str] = ()) -> Figure:
    """A row for each signal: its spectral density, and how often levels are crossed.

    names : of signals, ``tip.acceleration.z``; the largest of each kind where none is given.

    Raises
    ------
    ResultsError : no signal of this name.
    """
    from matplotlib.figure import Figure

    signals = _signals(tree)
    for name in names:
        if name not in signals:
            known = list(signals)
            problem = Problem("--quantity", "no signal of this name", name, listed(known), did_you_mean(name, known))
            raise ResultsError([problem], "the figure cannot be drawn")
    chosen = list(names) or _largest(signals)
    figure = Figure(figsize=(9.6, 0.7 + 2.6 * len(chosen)), layout="constrained")
    panels = figure.subplots(len(chosen), 2, squeeze=False, width_ratios=(1.5, 1.0))
    for name, (left, right) in zip(chosen, panels, strict=True):
        _density(left, name, signals[name])
        _crossings(right, signals[name])
    for panel in panels[-1:, 0]:
        panel.set_xlabel("frequency (Hz)")
    panels[-1, 1].set_xlabel("level above the mean (standard deviations)")
    panels[0, 0].legend(fontsize="small")
    panels[0, 1].legend(fontsize="small")
    count, duration = int(tree.attrs["windows"]), float(tree.attrs["duration"])
    figure.suptitle(f"{tree.attrs['scene_name']}: {count} windows of {readable(duration, 's', 3)}", fontweight="bold")
    return figure


def _signals(tree: xr.DataTree) -> dict[str, xr.Dataset]:
    """Signals of a file by name."""
    found = {}
    for owner in children_of(tree, "signals").values():
        for node in owner.children.values():
            dataset = node.to_dataset()
            found[str(dataset.attrs["signal"])] = dataset
    return found


def _largest(signals: dict[str, xr.Dataset]) -> list[str]:
    """Of each kind, the signal with the largest rms, contacts last; the bases are left out where there are others."""
    kinds: dict[str, str] = {}
    for name, of in signals.items():
        kind = name.split(".")[1]
        if kind == "acceleration" and name.count(".") == 1:
            kind = "base"
        if kind not in kinds or float(of["rms"]) > float(signals[kinds[kind]]["rms"]):
            kinds[kind] = name
    order = ("acceleration", "displacement", "tension", "normal_force", "gap", "base")
    return [kinds[kind] for kind in order if kind in kinds and float(signals[kinds[kind]]["rms"]) > 0.0][:_MOST]


def _density(axis: Axes, name: str, of: xr.Dataset) -> None:
    """Spectral density with its band, and that of the linear answer."""
    frequency = of["frequency"].values
    inside = frequency > 0.0
    low, value, high = (of[key].values[inside] for key in ("spectrum_low", "spectrum", "spectrum_high"))
    axis.fill_between(frequency[inside], low, high, color=_MEASURED, alpha=0.3, linewidth=0, label="band at 95 %")
    axis.plot(frequency[inside], value, color=_MEASURED, linewidth=1.2, label="windows")
    largest, last = float(value.max()), float(frequency[-1])
    first = float(frequency[inside][0])
    if "linear_spectrum" in of:
        linear, grid = of["linear_spectrum"].values, of["linear_frequency"].values
        axis.plot(grid, linear, color=_LINEAR, linewidth=1.0, linestyle="--", label="linear: joints stay as they are")
        largest, first = max(largest, float(linear.max())), min(float(grid[0]), first)
    least = max(_RANGE * largest, 0.5 * float(value[value > 0.0].min(initial=largest)))
    axis.set(xscale="log", yscale="log", xlim=(first, last), ylim=(least, 2.0 * largest))
    unit = unit_text(str(of["spectrum"].attrs["units"]), figure=True)
    axis.set_ylabel(f"{name}\n({unit})")
    axis.grid(which="major")


def _crossings(axis: Axes, of: xr.Dataset) -> None:
    """Rate of upward crossings over the level, with its band, and that of a Gaussian signal of the same rms."""
    mean, rms = float(of["mean"]), float(of["rms"])
    sigmas = (of["level"].values - mean) / rms
    low, value, high = (of[key].values for key in ("crossing_rate_low", "crossing_rate", "crossing_rate_high"))
    seen = value > 0.0
    axis.fill_between(sigmas[seen], low[seen], high[seen], color=_MEASURED, alpha=0.3, linewidth=0)
    axis.plot(sigmas[seen], value[seen], color=_MEASURED, linewidth=1.2, label="windows")
    rice = float(np.interp(0.0, sigmas, value)) * np.exp(-0.5 * sigmas**2)
    axis.plot(sigmas, rice, color=_GAUSSIAN, linewidth=1.0, linestyle=":", label="Gaussian")
    least = float(low[seen][low[seen] > 0.0].min(initial=float(value.max())))
    axis.set(yscale="log", ylim=(0.5 * least, 3.0 * float(high.max())), xlim=(float(sigmas[0]), float(sigmas[-1])))
    axis.set_ylabel("upward crossings (1/s)")
    axis.set_title(_words(of), fontsize="small")
    axis.grid(which="major")


def _words(of: xr.Dataset) -> str:
    """rms and peak with their bands."""

    def banded(key: str) -> str:
        value, low, high = (float(of[name]) for name in (key, f"{key}_low", f"{key}_high"))
        size, unit = prefix_for(abs(value), unit_of(of[key], "1"), figure=True)
        text = _plain(value / size)
        if np.isfinite(low):
            text += f" [{_plain(low / size)}, {_plain(high / size)}]"
        return f"{text} {unit}"

    return f"rms {banded('rms')}\npeak of a window {banded('peak')}"


def _plain(value: float) -> str:
    """A number with three digits and without exponent."""
    return np.format_float_positional(value, precision=3, unique=False, fractional=False, trim="-")
