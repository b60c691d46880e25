"""``latin-fmu plot``: the summary figure of a results file."""

from __future__ import annotations

import argparse
from contextlib import closing
from pathlib import Path

from . import CONVERGED
from .scene_arguments import AddParser


def register(add: AddParser) -> None:
    """Declare the subcommand."""
    text = "draw forces, contact states and convergence of a results file"
    parser = add("plot", help=text, description=text.capitalize() + ".")
    parser.add_argument("results", metavar="OUT.nc", type=Path, help="results file written by run")
    parser.add_argument(
        "-o",
        "--output",
        metavar="FIGURE",
        type=Path,
        help="png, pdf or svg (default: beside the results, as png)",
    )
    parser.set_defaults(command=_plot)


def _plot(arguments: argparse.Namespace) -> int:
    from ..results.netcdf import open_results
    from ..results.plots import check_figure_path, save_figure, summary_figure

    target = arguments.output or arguments.results.with_suffix(".png")
    check_figure_path(target)
    with closing(open_results(arguments.results)) as tree:
        save_figure(summary_figure(tree), target)
    print(f"figure: {target}")
    return CONVERGED
