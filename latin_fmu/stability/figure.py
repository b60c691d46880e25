"""The figure of the stability report: margin and iterations of every case."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from .case import Row

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SMALLEST = 1e-8  # margins below it are drawn there
_GOOD, _BAD, _QUIET = "#2a6f97", "#c1121f", "#adb5bd"


def stability_figure(rows: Sequence[Row]) -> Figure:
    """Left: measured over allowed (1 is the limit); right: LATIN iterations per window, mean and largest."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 1.6 + 0.155 * len(rows)), layout="constrained")
    margins, counts = figure.subplots(1, 2, sharey=True, width_ratios=[1.25, 1])
    place = np.arange(len(rows))
    _margins(margins, rows, place)
    _counts(counts, rows, place)
    margins.set_yticks(place, [row.case for row in rows], fontsize=6.5)
    margins.set_ylim(len(rows) - 0.4, -0.6)
    starts = [i for i, row in enumerate(rows) if i == 0 or rows[i - 1].family != row.family]
    for axes in (margins, counts):
        for start in starts[1:]:
            axes.axhline(start - 0.5, color="0.75", linewidth=0.8)
        axes.grid(axis="x", color="0.92")
        axes.set_axisbelow(True)
    for start in starts:
        counts.text(1.01, start, rows[start].family, transform=counts.get_yaxis_transform(), fontsize=8, va="center")
    failed = sum(not row.passed for row in rows)
    figure.suptitle(f"Stability suite: {len(rows) - failed} of {len(rows)} hard cases hold", fontsize=11)
    return figure


def _margins(axes: Axes, rows: Sequence[Row], place: np.ndarray) -> None:
    values = np.clip([row.margin for row in rows], _SMALLEST, 1e3)
    colours = [_GOOD if row.passed else _BAD for row in rows]
    axes.hlines(place, _SMALLEST, values, color="0.85", linewidth=1)
    axes.scatter(values, place, c=colours, s=14, zorder=3)
    axes.axvline(1.0, color=_BAD, linewidth=1.2)
    axes.set_xscale("log")
    axes.set_xlim(_SMALLEST / 2, max(4.0, 2 * float(values.max())))
    axes.set_xlabel("worst measured value over its limit (limit: red line)", fontsize=8)
    axes.tick_params(axis="x", labelsize=7)


def _counts(axes: Axes, rows: Sequence[Row], place: np.ndarray) -> None:
    largest = np.array([max(row.iterations, 0.8) for row in rows], dtype=float)
    mean = np.array([max(row.mean_iterations, 0.8) for row in rows])
    axes.hlines(place, mean, largest, color=_QUIET, linewidth=1.5)
    axes.scatter(largest, place, marker="|", color="0.3", s=22, label="largest", zorder=3)
    axes.scatter(mean, place, color=_GOOD, s=10, label="mean", zorder=3)
    helped = [i for i, row in enumerate(rows) if row.fallbacks]
    axes.scatter(
        largest[helped],
        place[helped],
        marker="D",
        facecolors="none",
        edgecolors=_BAD,
        s=26,
        label="fall-back used",
        zorder=4,
    )
    axes.set_xscale("log")
    axes.set_xlim(0.7, max(300.0, 1.3 * float(largest.max())))
    axes.set_xticks([1, 3, 10, 30, 100, 300], ["1", "3", "10", "30", "100", "300"], fontsize=7)
    axes.minorticks_off()
    axes.set_xlabel("LATIN iterations per window", fontsize=8)
    axes.legend(loc="lower right", fontsize=7)
