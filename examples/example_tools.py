"""What the examples share: command line, style of the figures, table of the numbers."""

from __future__ import annotations

from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.ticker import LogLocator, NullFormatter
from numpy.typing import NDArray

from latin_fmu.pictures.style import DISTINCT
from latin_fmu.stability.scenes import STEEL, Box, Description, column

Array = NDArray[np.float64]

MODELS = Path(__file__).resolve().parents[1] / "models"
BLUE, VERMILION, GREEN, PURPLE, ORANGE = DISTINCT[:5]
COLOURS = (BLUE, GREEN, ORANGE, VERMILION, PURPLE)
EXACT = {"color": "black", "linewidth": 0.9, "linestyle": (0, (5, 2)), "label": "exact"}


@dataclass(frozen=True)
class Options:
    """Options of the command line of an example."""

    quick: bool
    folder: Path


def options(argv: Sequence[str] | None, description: str | None) -> Options:
    """Read ``[--quick] [-o FOLDER]``; the folder is made when missing."""
    parser = ArgumentParser(description=description, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="coarser and shorter, for a first look")
    parser.add_argument("-o", "--output", type=Path, default=Path("figures"), help="folder of the figures")
    read = parser.parse_args(argv)
    read.output.mkdir(parents=True, exist_ok=True)
    return Options(read.quick, read.output)


def save(figure: Figure, folder: Path, name: str, dpi: int = 150) -> Path:
    """Write a figure as PNG."""
    path = folder / f"{name}.png"
    figure.savefig(path, dpi=dpi)
    return path


def halves(figure: Figure, ratio: float) -> tuple[SubFigure, SubFigure]:
    """Left and right part of a figure, the left one ``ratio`` times as wide."""
    grid = figure.add_gridspec(1, 2, width_ratios=(ratio, 1.0))
    return figure.add_subfigure(grid[0]), figure.add_subfigure(grid[1])


def label_few(axis: Axes) -> None:
    """Label a logarithmic y axis at powers of ten, and at 2 and 5 times them where it has few."""
    low, high = axis.get_ylim()
    axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 100.0 * low else (1.0,)))
    axis.yaxis.set_major_formatter("{x:g}")
    axis.yaxis.set_minor_formatter(NullFormatter())


def tidy(axis: Axes) -> None:
    """No frame on top and at the right."""
    axis.spines[["top", "right"]].set_visible(False)


def table(numbers: Mapping[str, float]) -> str:
    """The checked numbers, one a line."""
    width = max(len(name) for name in numbers)
    return "\n".join(f"{name:{width}}  {value:.6g}" for name, value in numbers.items())


def pressed_plates(count: int, elements: Sequence[int] = (8, 8, 2)) -> Description:
    """Stack of steel plates on a fixed base, slow: pressed by 50 MPa on top, then sheared by 5 MPa along x.

    40 x 40 x 5 mm each, plates b1, b2, ..., interfaces i1, i2, .... No symmetry is used. The shear stays far below
    sliding; its moment opens the edges of high stacks, where the plates also slip. Twenty steps without inertia.
    """
    law, top = {"type": "table", "times": [0.0, 0.5, 1.0]}, {"face": f"b{count}.zmax"}
    return column(
        {f"b{i}": Box(STEEL, (0.04, 0.04, 0.005), elements) for i in range(1, count + 1)},
        {f"i{i}": {"friction_coefficient": 0.3, "gap": 0.0} for i in range(1, count)},
        {"end": 1.0, "instants": 20, "quasi_static": True},
        name="plates",
        boundary={"base": {"type": "fixed", "face": "b1.zmin"}},
        load={
            "press": {**top, "pressure": 50e6, "law": {**law, "values": [0.0, 1.0, 1.0]}},
            "shear": {**top, "traction": [5e6, 0.0, 0.0], "law": {**law, "values": [0.0, 0.0, 1.0]}},
        },
    )
