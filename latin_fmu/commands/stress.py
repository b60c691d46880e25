"""``latin-fmu stress``: run the hard cases and report what was measured."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from . import CONVERGED, NOT_CONVERGED
from .scene_arguments import AddParser

if TYPE_CHECKING:
    from ..stability.case import Row

_EXAMPLES = """\
examples:
  latin-fmu stress --quick
  latin-fmu stress -o stability.md          writes stability.md and stability.png
  latin-fmu stress --quick --json > stability.json

exit codes: 0 all cases hold, 1 some do not
"""


def register(add: AddParser) -> None:
    """Declare the subcommand."""
    text = "run the hard cases (contrasts, friction, grazing, long runs ...) and report what was measured"
    parser = add(
        "stress",
        help=text,
        description=text.capitalize() + ".",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--quick", action="store_true", help="the cases that take less than a minute together")
    parser.add_argument("--json", action="store_true", help="print one JSON list, and nothing else, on stdout")
    parser.add_argument(
        "-o",
        "--output",
        metavar="REPORT.md",
        type=Path,
        help="write the report (Markdown) here, and its figure beside it as png",
    )
    parser.set_defaults(command=_stress)


def _stress(arguments: argparse.Namespace) -> int:
    from ..results.files import check_target
    from ..stability.report import as_json, verdict
    from ..stability.runner import run_suite
    from ..stability.suite import cases

    if arguments.output is not None:
        check_target(arguments.output)  # before the long part
        check_target(arguments.output.with_suffix(".png"))
    rows = run_suite(cases(arguments.quick), _tell)
    if arguments.output is not None:
        _write(rows, arguments.output, arguments.quick)
    print(as_json(rows) if arguments.json else verdict(rows))
    return CONVERGED if all(row.passed for row in rows) else NOT_CONVERGED


def _tell(row: Row) -> None:
    print(f"{'holds ' if row.passed else 'FAILS '} {row.case}: {row.measured}", file=sys.stderr, flush=True)


def _write(rows: list[Row], target: Path, quick: bool) -> None:
    """Report and figure, each complete or not at all."""
    from ..results.files import written_whole
    from ..stability.figure import stability_figure
    from ..stability.report import as_markdown
    from ..stability.schemes import compare_schemes

    picture = target.with_suffix(".png")
    with written_whole(picture) as draft:
        stability_figure(rows).savefig(draft, dpi=150)
    schemes = compare_schemes(elements=20 if quick else 50, bounces=3 if quick else 20)
    with written_whole(target) as draft:
        draft.write_text(as_markdown(rows, schemes, picture.name), encoding="utf-8")
    print(f"report: {target}, figure: {picture}", file=sys.stderr)
