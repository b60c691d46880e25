"""``latin-fmu simulate``: drive an FMU with fmpy, without writing code."""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from ..errors import InputError, Problem
from . import BAD_INPUT, CONVERGED, SOLVER_FAILED
from .scene_arguments import AddParser

_EXAMPLES = """\
examples:
  latin-fmu simulate crushing.fmu --input loads.csv -o out.csv
  latin-fmu simulate crushing.fmu --start load.press.value=0.5 --step 1e-6 --stop 3e-5

loads.csv has a column time and columns named as inputs, e.g. load.press.value; between its rows inputs are
linear, and where only a value is given its rate is taken from them.
"""


def register(add: AddParser) -> None:
    """Declare the subcommand."""
    text = "run an FMU with fmpy"
    parser = add(
        "simulate",
        help=text,
        description=text.capitalize() + ".",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "fmu", metavar="X.fmu", type=Path, help="FMU for co-simulation, or for model exchange (by CVode)"
    )
    parser.add_argument("--input", metavar="IN.csv", type=Path, help="inputs over time")
    parser.add_argument("-o", "--output", metavar="OUT.csv", type=Path, help="outputs at every step (default: out.csv)")
    parser.add_argument("--step", metavar="H", type=float, help="communication step, s (default: that of the FMU)")
    parser.add_argument("--stop", metavar="T", type=float, help="end, s (default: that of the FMU)")
    parser.add_argument(
        "--start",
        metavar="NAME=VALUE",
        action="append",
        default=[],
        help="start value of an input or parameter; repeatable",
    )
    parser.add_argument("--quiet", action="store_true", help="no progress and no summary")
    parser.set_defaults(command=_simulate)


def _simulate(arguments: argparse.Namespace) -> int:
    try:
        from fmu_build.integrate import opened
    except ModuleNotFoundError as error:
        print(f"latin-fmu: {error.msg}; pip install 'latin-fmu[fmu]' gives what FMUs need", file=sys.stderr)
        return BAD_INPUT
    from ..results.files import check_target, written_whole

    target = arguments.output or Path("out.csv")
    check_target(target)
    inputs = None if arguments.input is None else read_columns(arguments.input)
    drive = opened(arguments.fmu, dict(_pair(text) for text in arguments.start), inputs)
    step, stop = arguments.step or drive.step_size, arguments.stop or drive.stop_time
    rows: list[Sequence[float]] = []
    try:
        for row in drive.run(step, stop):
            rows.append(row)
            if not arguments.quiet:
                print(f"\r{100 * row[0] / stop:5.1f} %", end="", file=sys.stderr, flush=True)
    finally:
        drive.close()
        if not arguments.quiet:
            print(file=sys.stderr)
    with written_whole(target) as draft, draft.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(["time", *drive.outputs])
        table.writerows([[repr(float(value)) for value in row] for row in rows])
    if not arguments.quiet:
        print(f"{len(rows)} rows: {target}")
    if drive.complaint:
        reached = rows[-1][0] if rows else 0.0
        print(f"latin-fmu: stopped at {reached:g} s: {drive.complaint}", file=sys.stderr)
        return SOLVER_FAILED
    return CONVERGED


def _pair(text: str) -> tuple[str, Any]:
    name, equals, value = text.partition("=")
    if not equals:
        raise InputError([Problem("--start", "not NAME=VALUE", text)])
    try:
        return name.strip(), float(value)
    except ValueError:
        return name.strip(), value


def read_columns(path: Path) -> dict[str, list[float]]:
    """Columns of a CSV file by name; ``time`` among them.

    Raises InputError where it cannot be read, holds no numbers, or has no increasing times.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = [row for row in csv.reader(file) if row]
        names = [name.strip() for name in rows[0]]
        columns = {name: [float(row[i]) for row in rows[1:]] for i, name in enumerate(names)}
    except (OSError, UnicodeDecodeError, ValueError, IndexError, csv.Error) as error:
        problem = Problem(str(path), f"not a table of numbers ({error})", None, "a header, then one row per time")
        raise InputError([problem], "the inputs cannot be read") from None
    times = columns.get("time", [])
    if len(times) < 1 or any(b <= a for a, b in pairwise(times)):
        problem = Problem(str(path), "needs a column 'time' that increases strictly")
        raise InputError([problem], "the inputs cannot be read")
    return columns
