"""Frequency responses of an assembly: magnitude and phase over the frequency, a column for each drive."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..modal.frequency_response import FrequencyResponse
from ..results.quantities import AXES
from ..scene.units import unit_text
from .style import curve_styles, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@styled
def response_figure(response: FrequencyResponse, along: str | None = None) -> Figure:
    """Magnitude and phase of all sensors, each along an axis: ``along``, or that of its largest response."""
    from matplotlib.figure import Figure

    drives = response.response
    figure = Figure(figsize=(1.2 + 4.2 * len(drives), 5.0), layout="constrained")
    figure.suptitle(f"{response.name}: joints {response.joints}, damping: {response.damping}", fontweight="bold")
    panels = figure.subplots(2, len(drives), sharex=True, squeeze=False, height_ratios=(2, 1))
    for (drive, by_sensor), (upper, lower) in zip(drives.items(), panels.T, strict=True):
        for (sensor, values), look in zip(by_sensor.items(), curve_styles(len(by_sensor)), strict=True):
            if along is None:
                axis = int(np.abs(values).max(axis=0).argmax())
            else:
                axis = AXES.index(along)
            upper.plot(response.frequency, np.abs(values[:, axis]), label=f"{sensor}, {AXES[axis]}", **look)
            lower.plot(response.frequency, np.degrees(np.angle(values[:, axis])), **look)
        unit = unit_text(response.unit_of(drive), figure=True)
        label = response.kind_of(drive)
        if unit:
            label += f" ({unit})"
        upper.set(title=f"driven by {drive}", xscale="log", yscale="log", ylabel=label)
        lower.set(xlabel="frequency (Hz)", ylabel="phase (degrees)", ylim=(-190, 190), yticks=range(-180, 181, 90))
        for panel in (upper, lower):
            panel.grid(which="major")
        upper.legend()
    return figure
