"""A base history: specification with its band, what is reached, and acceleration, velocity, displacement over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from ..scene.readable_numbers import prefix_for
from ..scene.unit_texts import GRAVITY
from ..shock.base_histories import BaseHistory
from .style import styled
from .summary_picture import spectrum_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_REACHED: Final = "#000000"
_SPECIFIED: Final = "#D55E00"


@styled
def base_figure(history: BaseHistory, tolerance: float) -> Figure:
    """Spectrum on the left, histories on the right; ``tolerance`` : of the band, dB."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.6, 4.8), layout="constrained")
    grid = figure.add_gridspec(3, 2, width_ratios=(1.0, 1.15))
    left = figure.add_subplot(grid[:, 0])
    specified = history.specification.at(history.frequency) / GRAVITY
    reached = history.reached / GRAVITY
    share = 10.0 ** (tolerance / 20.0)
    band = f"specification ± {tolerance:g} dB"
    ends = (specified / share, specified * share)
    left.fill_between(history.frequency, *ends, color=_SPECIFIED, alpha=0.3, linewidth=0, label=band)
    left.plot(history.frequency, specified, color=_SPECIFIED, linewidth=1.0)
    left.plot(history.frequency, reached, color=_REACHED, linewidth=1.4, label="reached")
    both = np.concatenate([specified, reached])
    spectrum_axes(left, float(both.min()), float(both.max()))
    left.set(ylabel="largest absolute acceleration (g)", title=f"Q = {history.specification.quality:g}")
    left.legend(fontsize="small")
    rows = (
        (history.acceleration / GRAVITY, "acceleration", "1", "g"),
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
