"""The figure of a calibration: data, what the scene predicts of them before and after the fit, residuals below."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from ..pictures.style import DISTINCT, styled
from ..scene.readable_numbers import prefix_for, readable
from .report import Calibration, ColumnFit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ACROSS: Final = 3  # columns of data in a row of the figure


@styled
def calibration_figure(made: Calibration) -> Figure:
    """Two panels a column of data: values before and after beside the data, and residuals before and after."""
    from matplotlib.figure import Figure

    shown = made.columns
    across = min(_ACROSS, len(shown))
    rows = -(-len(shown) // across)
    figure = Figure(figsize=(4.6 * across, 4.2 * rows + 0.4), layout="constrained")
    units = made.scene.unit_system
    values = ", ".join(f"{p.of.words} {readable(p.value, units.shown(p.of.unit()))}" for p in made.parameters)
    figure.suptitle(f"{made.scene.name}: {values}", fontweight="bold")
    axes = figure.subplots(2 * rows, across, squeeze=False, height_ratios=[2.2, 1] * rows)
    for i, column in enumerate(shown):
        above, below = axes[2 * (i // across) : 2 * (i // across) + 2, i % across]
        _draw(column, made, above, below)
        below.sharex(above)
        if i == 0:
            above.legend()
    for i in range(len(shown), rows * across):
        for axis in axes[2 * (i // across) : 2 * (i // across) + 2, i % across]:
            axis.set_axis_off()
    return figure


def _draw(fit: ColumnFit, made: Calibration, above: Axes, below: Axes) -> None:
    """One column of data."""
    units = made.scene.unit_system
    table = fit.table
    data = fit.column.values
    x, x_unit = prefix_for(float(table.along.max()), units.label(table.along_unit), figure=True)
    y, y_unit = prefix_for(float(np.abs(data).max()), units.shown(fit.column.unit), figure=True)
    along = table.along / x
    bars = None if fit.column.sd is None else fit.column.sd / y
    above.errorbar(along, data / y, bars, fmt=".", color="0.3", label="data")
    for predicted, colour, label in ((fit.before, DISTINCT[1], "before"), (fit.after, DISTINCT[0], "after")):
        if label == "before":
            style = "--"
        else:
            style = "-"
        above.plot(along, predicted / y, style, color=colour, label=label, marker="." if len(along) < 15 else None)
        below.plot(along, (data - predicted) / y, ".", color=colour)
    below.axhline(0.0, color="0.4", linewidth=0.8)
    above.set_title(f"{fit.column.name}" + (f" of {table.sensor}" if table.sensor else ""))
    y_label, x_label = (f" ({unit})" if unit != "1" else "" for unit in (y_unit, x_unit))
    above.set_ylabel(y_label.strip())
    below.set(xlabel=table.along_name + x_label, ylabel="residual" + y_label)
    if table.kind in ("spectrum", "backbone"):
        above.set_xscale("log")
        below.set_xscale("log")
