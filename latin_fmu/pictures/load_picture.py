"""What acts on an assembly over time, with its shock response spectrum; spectra of sensors beside their limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import xarray as xr

from ..latin.outcome import Array
from ..results.spectra import ShockSpectrum
from ..scene.readable_numbers import prefix_for
from ..shock.specification import Specification
from .style import BAD, DISTINCT, TimeAxis, styled
from .summary_picture import history_panel, spectrum_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_ROW: Final = 2.5  # inches


@dataclass(frozen=True)
class ActingHistory:
    """What acts over time.

    Attributes
    ----------
    name : of it in words. what : quantity. unit : of it (UDUNITS). time, values : (n_time,), s and in that unit.
    spectrum : of an acceleration, with its unit. specified : spectrum that the history was made for.
    """

    name: str
    what: str
    unit: str
    time: Array
    values: Array
    spectrum: ShockSpectrum | None = None
    spectrum_unit: str = "m s-2"
    specified: Specification | None = None


@styled
def loads_figure(histories: list[ActingHistory]) -> Figure:
    """A row each: the history, and the maximax of absolute acceleration of what is an acceleration."""
    from matplotlib.figure import Figure

    columns = 2 if any(history.spectrum is not None for history in histories) else 1
    figure = Figure(figsize=(9.0, _ROW * len(histories) + 0.2), layout="constrained")
    rows = figure.subplots(len(histories), columns, squeeze=False)
    for history, panels in zip(histories, rows, strict=True):
        scale = TimeAxis(*prefix_for(float(history.time[-1]), "s", figure=True))
        history_panel(panels[0], history.time, {history.name: history.values}, scale, 0.0, history.unit, history.what)
        panels[0].set_title(history.name)
        if (legend := panels[0].get_legend()) is not None:
            legend.remove()
        if columns == 1:
            continue
        if history.spectrum is None:
            panels[1].set_axis_off()
            continue
        size, label = prefix_for(0.0, history.spectrum_unit, figure=True)
        values = history.spectrum.acceleration[0] / size
        panels[1].plot(history.spectrum.frequency, values, color=DISTINCT[0], label="of the history")
        low, top = float(values.min()), float(values.max())
        if history.specified is not None:
            grid = history.specified.grid()
            wanted = history.specified.at(grid) / size
            panels[1].plot(grid, wanted, "--", color=DISTINCT[1], label="specified")
            low, top = min(low, float(wanted.min())), max(top, float(wanted.max()))
            panels[1].legend(fontsize="small")
        spectrum_axes(panels[1], low, max(top, 1e-300))
        panels[1].set(title=f"maximax, Q = {history.spectrum.quality:g}", ylabel=f"acceleration ({label})")
    return figure


@styled
def limit_figure(node: xr.Dataset, name: str, unit: str) -> Figure:
    """A stored spectrum (group ``limits/NAME``) beside its limit; red where it is above; ``unit`` : of both."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.6, 3.4), layout="constrained")
    panel = figure.add_subplot()
    size, label = prefix_for(0.0, unit, figure=True)
    frequency = node["frequency"].values
    values, allowed = node["spectrum"].values / size, node["allowed"].values / size
    panel.plot(frequency, allowed, "--", color="#000000", label="limit")
    panel.plot(frequency, values, color=DISTINCT[0], label=f"sensor {node.attrs['of']}, Q = {node.attrs['quality']:g}")
    above = values > allowed
    if above.any():
        over = np.where(above, values, np.nan)
        panel.plot(frequency, over, "-", color=BAD, linewidth=2.6, label="above the limit")
        panel.fill_between(frequency, allowed, values, where=above.tolist(), color=BAD, alpha=0.25, linewidth=0)
    both = np.concatenate([values, allowed])
    spectrum_axes(panel, float(both.min()), max(float(both.max()), 1e-300))
    kind = str(node.attrs["kind"]).replace("_", " ")
    panel.set(title=f"{name}: {node.attrs['response']}", ylabel=f"{kind} ({label})")
    panel.legend(fontsize="small")
    return figure
