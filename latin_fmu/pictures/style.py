"""One style for all figures: curves that differ without colour, colour maps of even steps of lightness, axes of time,
and files of figures.

Only matplotlib's object interface is used: no window system; its settings change inside of ``styled`` functions only.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial, wraps
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, ParamSpec, TypeVar

import numpy as np

from ..errors import Problem, ResultsError
from ..results.writing import write_whole

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Colour = str | tuple[float, float, float, float]
P = ParamSpec("P")
R = TypeVar("R")

# Okabe and Ito: distinct for colour-blind readers
DISTINCT: Final = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#999933")
LINES: Final = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (8, 2)), (0, (3, 1, 1, 1)), (0, (1, 3)))
"""Line styles in the order of the colours, so that curves differ in grey print, too."""
MARKERS: Final = ("o", "s", "^", "D", "v", "P", "X", "<")
PARTS: Final = ("#A6BDD7", "#E8C9A0", "#B5D3A8", "#D9B3C7", "#C9C3E6", "#E5DF9B", "#A9D6D2", "#D8CCC0")
"""Colours of bodies, light enough for the strong colours of interfaces to stand out."""
SEQUENTIAL: Final = "viridis"
"""Colour map from 0 up; its lightness rises evenly."""
PRESSURE: Final = "inferno_r"
"""Colour map of pressures: 0 is nearly white, its lightness falls evenly."""
BAD: Final = "#B00000"
"""Colour of what failed or did not converge, which has a mark or a text of its own, too."""

FORMATS: Final = (".png", ".pdf", ".svg")

_SETTINGS: Final[Mapping[str, Any]] = MappingProxyType(
    {
        "font.size": 9.0,
        "axes.titlesize": 10.0,
        "axes.labelsize": 9.0,
        "legend.fontsize": 8.0,
        "legend.framealpha": 0.85,
        "legend.edgecolor": "0.8",
        "lines.linewidth": 1.4,
        "lines.markersize": 4.0,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.axisbelow": True,
        "axes.grid": False,
        "grid.color": "0.9",
        "grid.linewidth": 0.6,
        "image.cmap": SEQUENTIAL,
        "savefig.dpi": 150,
    }
)


def styled(draw: Callable[P, R]) -> Callable[P, R]:
    """A function that makes a figure, with the settings of this module while it runs."""

    @wraps(draw)
    def within(*args: P.args, **kwargs: P.kwargs) -> R:
        from cycler import cycler
        from matplotlib import rc_context

        settings: Any = {**_SETTINGS, "axes.prop_cycle": cycler(color=DISTINCT)}
        with rc_context(settings):
            return draw(*args, **kwargs)

    return within


def colours(count: int) -> list[Colour]:
    """One colour per curve: distinct ones as far as they reach, else a scale in the order of the curves."""
    if count <= len(DISTINCT):
        return list(DISTINCT[:count])
    from matplotlib import colormaps

    return [colormaps[SEQUENTIAL](float(share)) for share in np.linspace(0.0, 0.92, count)]


def curve_styles(count: int, markers: bool = False) -> list[dict[str, Any]]:
    """Colour and line style of every curve, with a marker where wanted; the lines repeat beyond eight curves, of which
    the lightness of the colours differs."""
    looks: list[dict[str, Any]] = []
    for i, colour in enumerate(colours(count)):
        look: dict[str, Any] = {"color": colour, "linestyle": LINES[i % len(LINES)]}
        if markers:
            look["marker"] = MARKERS[i % len(MARKERS)]
        looks.append(look)
    return looks


@dataclass(frozen=True)
class TimeAxis:
    """Horizontal axis of time: seconds of its ``unit``."""

    divisor: float
    unit: str

    def set(self, axis: Axes, first: float, last: float) -> None:
        """Label and limits (s) of the horizontal axis."""
        axis.set_xlabel(f"time ({self.unit})")
        if last > first:
            axis.set_xlim(first / self.divisor, last / self.divisor)


def check_figure_path(path: str | Path, formats: tuple[str, ...] = FORMATS) -> None:
    """Make sure the suffix names a format figures can be saved in.

    Raises
    ------
    ResultsError : another suffix.
    """
    suffix = Path(path).suffix
    if suffix.lower() not in formats:
        what, value = "figures cannot be saved in this format", suffix or "no suffix"
        problem = Problem(str(path), what, value, ", ".join(formats), "change the suffix")
        raise ResultsError([problem], "cannot write the figure")


def save_figure(figure: Figure, path: str | Path) -> None:
    """Write the figure, whole or not at all; the suffix chooses the format (png, pdf or svg).

    Raises
    ------
    ResultsError : the format is not known or the file cannot be written (``UnwrittenError``).
    """
    check_figure_path(path)
    write_whole(path, partial(figure.savefig, dpi=150))
