"""A base history: specification with its band, what is reached, and acceleration, velocity, displacement over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..scene.readable_numbers import prefix_for
from ..shock.base_histories import BaseHistory
from .style import styled
from .summary_picture import spectrum_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_REACHED, _ASKED = "#000000", "#D55E00"


@styled
def base_figure(history: BaseHistory, tolerance: float) -> Figure:
    """Spectrum on the left, histories on the right; ``tolerance`` : of the band, dB."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.6, 4.8), layout="constrained")
    grid = figure.add_gridspec(3, 2, width_ratios=(1.0, 1.15))
    left = figure.add_subplot(grid[:, 0])
    asked = history.specification.at(history.frequency) / 9.80665
    share = 10.0 ** (tolerance / 20.0)
    band = f"specification ± {tolerance:g} dB"
    left.fill_between(history.frequency, asked / share, asked * share, color=_ASKED, alpha=0.3, linewidth=0, label=band)
    left.plot(history.frequency, asked, color=_ASKED, linewidth=1.0)
    left.plot(history.frequency, history.reached / 9.80665, color=_REACHED, linewidth=1.4, label="reached")
    lowest, top = (float(f(history.reached.min(), asked.min() * 9.80665)) / 9.80665 for f in (min, max))
    spectrum_axes(left, lowest, max(top, float(history.reached.max()) / 9.80665, float(asked.max())))
    left.set(ylabel="largest absolute acceleration (g)", title=f"Q = {history.specification.quality:g}")
    left.legend(fontsize="small")
    rows = (
        (history.acceleration / 9.80665, "acceleration", "1", "g"),
        (history.velocity, "velocity", "m s-1", ""),
        (history.displacement, "displacement", "m", ""),
    )
    for i, (values, what, unit, shown) in enumerate(rows):
        panel = figure.add_subplot(grid[i, 1])
        size, label = (1.0, shown) if shown else prefix_for(float(np.abs(values).max()), unit, figure=True)
        panel.plot(1e3 * history.time, values / size, color=_REACHED, linewidth=0.8)
        panel.axhline(0.0, color="0.7", linewidth=0.6, zorder=0)
        panel.set_ylabel(f"{what}\n({label})")
        panel.margins(x=0.0)
        if i == 2:
            panel.set_xlabel("time (ms)")
        else:
            panel.tick_params(labelbottom=False)
    figure.suptitle(f"base history, seed {history.seed}: within {history.error:.2g} dB")
    return figure
