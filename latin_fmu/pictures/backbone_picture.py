"""Frequency and damping of a mode against the amplitude, beside measured points."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..latin.assembly import Array
from ..modal.backbone import Backbone
from ..scene.readable_numbers import prefix_for
from .style import DISTINCT, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@styled
def backbone_figure(curve: Backbone, measured: Array | None = None) -> Figure:
    """Two panels over the amplitude: frequency, and damping in % of critical.

    measured : (n, 3) amplitude, frequency and damping ratio, in the units of the scene.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.6, 3.6), layout="constrained")
    figure.suptitle(f"{curve.name}: mode {curve.mode} after tightening", fontweight="bold")
    divisor, unit = prefix_for(float(curve.amplitude.max()), curve.units.label("m"), figure=True)
    frequency, damping = figure.subplots(1, 2, sharex=True)
    slips = curve.damping > 0.0
    frequency.plot(curve.amplitude / divisor, curve.frequency, "o-", label="computed")
    frequency.axhline(curve.linear_frequency, color="0.5", linestyle=":", label="all pressed points sticking")
    damping.plot(curve.amplitude[slips] / divisor, 100 * curve.damping[slips], "o-", label="computed (friction)")
    if measured is not None:
        look = {"color": DISTINCT[1], "marker": "s", "linestyle": "none", "label": "measured"}
        frequency.plot(measured[:, 0] / divisor, measured[:, 1], **look)
        damping.plot(measured[:, 0] / divisor, 100 * measured[:, 2], **look)
    frequency.set(xscale="log", xlabel=f"amplitude ({unit})", ylabel="frequency (Hz)")
    damping.set(xlabel=f"amplitude ({unit})", ylabel="damping ratio (%)")
    if slips.any() or (measured is not None and np.any(measured[:, 2] > 0)):
        damping.set_yscale("log")
    for axis in (frequency, damping):
        axis.legend()
    return figure
