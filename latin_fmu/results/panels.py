"""The panels of the summary figure: each draws one thing on given axes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from ..latin.record import Array
from .measures import InterfaceFields, status_shares
from .quantities import prefix_for

if TYPE_CHECKING:  # matplotlib is imported only by those who plot
    from matplotlib.axes import Axes

Colour = str | tuple[float, float, float, float]

# Okabe and Ito: told apart by colour-blind readers and in grey print.
DISTINCT = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#999933")
FEW = 4
"""Up to this many curves a legend fits inside its panel, and as many strips below the forces."""

STATUS_COLOURS = ("#0072B2", "#E69F00", "#EEEEEE")
STATUS_LABELS = ("stick", "slip, or closed without friction", "separation")


def colours(count: int) -> list[Colour]:
    """One colour per curve: distinct ones as far as they reach, else a scale in the order of the curves."""
    if count <= len(DISTINCT):
        return list(DISTINCT[:count])
    from matplotlib import colormaps

    return [colormaps["viridis"](float(share)) for share in np.linspace(0.0, 0.92, count)]


def force_panel(
    axis: Axes, title: str, time: Array, curves: dict[str, Array], scale: tuple[float, str], reference: float
) -> None:
    """One force over time per interface; ``time`` (n_time,) in s, ``curves`` (n_time,) in N.

    Forces below 1e-9 of the force ``reference`` are round-off and not blown up to the height of the panel.
    """
    divisor, unit = scale
    peak = max((float(np.abs(curve).max(initial=0.0)) for curve in curves.values()), default=0.0)
    if peak < 1e-9 * reference:
        peak = reference
        axis.set_ylim(-1.0, 1.0)
    size, label = prefix_for(peak, "N", micro="µ")
    axis.axhline(0.0, color="0.6", linewidth=0.6, zorder=0)
    for (name, curve), colour in zip(curves.items(), colours(len(curves)), strict=True):
        axis.plot(time / divisor, curve / size, color=colour, label=name, linewidth=1.2)
    axis.set(title=title, xlabel=f"time ({unit})", ylabel=f"force ({label})")
    axis.set_xlim(time[0] / divisor, time[-1] / divisor)
    if len(curves) <= FEW:
        axis.legend(fontsize="small")


def status_panel(axis: Axes, name: str, dataset: xr.Dataset, scale: tuple[float, str], first: bool, last: bool) -> None:
    """Shares of the area that stick, slip and are open, stacked; ``first`` and ``last`` strip of a column."""
    divisor, unit = scale
    fields = InterfaceFields.of_dataset(dataset)
    shares = 100.0 * status_shares(fields)
    time = fields.time / divisor
    # Statuses hold over the step that ends at their instant.
    axis.stackplot(
        time,
        shares[:, 1],
        shares[:, 2],
        shares[:, 0],
        colors=STATUS_COLOURS,
        labels=STATUS_LABELS,
        step="pre",
        linewidth=0,
    )
    axis.set(ylim=(0, 100), xlim=(time[0], time[-1]), yticks=(0, 100))
    axis.set_ylabel(name, rotation=0, ha="right", va="center", labelpad=4)
    axis.tick_params(axis="y", labelsize="x-small")
    axis.tick_params(axis="x", labelbottom=last)
    if first:
        axis.set_title("Contact state, % of the area")
    if last:
        axis.set_xlabel(f"time ({unit})")


def curve_panel(axis: Axes, convergence: xr.Dataset, tolerance: float | None) -> None:
    """One window: sqrt(eta) and force mismatch over the iterations."""
    count = max(1, int(convergence["iterations"].values[0]))
    steps = convergence["iteration"].values[:count]
    axis.plot(
        steps,
        convergence["error_indicator"].values[0, :count],
        "o-",
        color=DISTINCT[0],
        markersize=3,
        linewidth=1.2,
        label=r"$\sqrt{\eta}$",
    )
    mismatch = convergence["force_mismatch"].values[0, :count]
    if np.isfinite(mismatch).any():
        axis.plot(steps, mismatch, "s", color=DISTINCT[1], markersize=3, label="force mismatch")
    _tolerance_line(axis, tolerance)
    axis.set(title="Convergence", xlabel="iteration", yscale="log", ylabel="relative error")
    axis.locator_params(axis="x", integer=True)
    axis.legend(fontsize="small")


def count_panel(axis: Axes, convergence: xr.Dataset, scale: tuple[float, str]) -> None:
    """Many windows: iterations of each, at the time of its end; those not converged are marked."""
    divisor, unit = scale
    ends, counts = convergence["end_time"].values / divisor, convergence["iterations"].values
    axis.plot(ends, counts, ".", color=DISTINCT[0], markersize=4)
    failed = convergence["converged"].values == 0
    if failed.any():
        axis.plot(ends[failed], counts[failed], "x", color=DISTINCT[1], label="not converged")
        axis.legend(fontsize="small")
    title = f"Iterations of each of {counts.size} windows"
    axis.set(title=title, xlabel=f"time ({unit})", ylabel="iterations", ylim=(0, 1.1 * max(1, counts.max()) + 0.5))
    axis.set_xlim(0.0, ends[-1])
    axis.locator_params(axis="y", integer=True)


def final_panel(axis: Axes, convergence: xr.Dataset, tolerance: float | None, scale: tuple[float, str]) -> None:
    """Many windows: sqrt(eta) at the last iteration of each, at the time of its end."""
    divisor, unit = scale
    errors = _last_errors(convergence)
    axis.plot(
        convergence["end_time"].values / divisor, errors, ".", color=DISTINCT[0], markersize=3, label=r"$\sqrt{\eta}$"
    )
    _tolerance_line(axis, tolerance)
    axis.set(
        title=r"Final $\sqrt{\eta}$ of each window", xlabel=f"time ({unit})", ylabel=r"$\sqrt{\eta}$", yscale="log"
    )
    axis.set_xlim(0.0, convergence["end_time"].values[-1] / divisor)
    _at_least_two_decades(axis)
    axis.legend(fontsize="small")


def _last_errors(convergence: xr.Dataset) -> Array:
    """sqrt(eta) at the last iteration; NaN without any, and for 0, which a logarithmic axis cannot show."""
    counts = convergence["iterations"].values.astype(int)
    table = convergence["error_indicator"].values
    last = table[np.arange(counts.size), np.maximum(counts - 1, 0)]
    return np.where((counts > 0) & (last > 0.0), last, np.nan)


def _at_least_two_decades(axis: Axes) -> None:
    """Widen a logarithmic axis that spans too little to show two powers of ten."""
    low, high = axis.get_ylim()
    if high < 100.0 * low:
        middle = (low * high) ** 0.5
        axis.set_ylim(middle / 12.0, middle * 12.0)


def _tolerance_line(axis: Axes, tolerance: float | None) -> None:
    if tolerance is not None:
        axis.axhline(tolerance, color="0.3", linestyle="--", linewidth=0.9, label="tolerance")


def energy_panel(axis: Axes, energy: xr.Dataset, scale: tuple[float, str]) -> None:
    """Energy terms of the assembly over time; terms that stay zero are left out."""
    divisor, unit = scale
    terms = {str(name): np.asarray(values.values) for name, values in energy.data_vars.items()}
    largest = max((float(np.abs(term).max(initial=0.0)) for term in terms.values()), default=0.0)
    size, label = prefix_for(largest, "J", micro="µ")
    shown = {name: term for name, term in terms.items() if np.abs(term).max(initial=0.0) > 1e-6 * largest}
    for (name, term), colour in zip(shown.items(), colours(len(shown)), strict=True):
        axis.plot(
            energy["time"].values / divisor, term / size, color=colour, linewidth=1.2, label=name.replace("_", " ")
        )
    axis.set(title="Energy of the assembly", xlabel=f"time ({unit})", ylabel=f"energy ({label})")
    axis.set_xlim(energy["time"].values[0] / divisor, energy["time"].values[-1] / divisor)
    axis.legend(fontsize="x-small", loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
