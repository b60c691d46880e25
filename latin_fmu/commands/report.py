"""``latin-fmu report``: a results file as one page for those who decide."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Annotated, Final

from ..errors import InputError
from . import CONVERGED, Waiting, output_file
from .options import Argument, Option, command

_EXAMPLES = """\
examples:
  latin-fmu run scene.toml -o out.nc
  latin-fmu report out.nc -o report.html
  latin-fmu run scene.toml --report report.html
"""
_PAGES: Final = (".html", ".htm")


@command(_EXAMPLES)
def report(
    file: Annotated[Path, Argument("results file of a run", "OUT.nc")],
    output: Annotated[Path | None, Option("default: beside the file, as html", "FILE.html", "-o", output_file)] = None,
    folder: Annotated[
        Path | None,
        Option("folder that the mesh files of the scene are relative to (default: that of OUT.nc)", "FOLDER"),
    ] = None,
) -> int:
    """Write the report of a run as one HTML page: verdict, model, loads, bolts, sensors, interfaces, accuracy."""
    target = output or file.with_suffix(".html")
    check_report(target, "--output")
    with Waiting("report"):
        place = write_report(file, target, folder or file.parent)
    print(f"report: {place}")
    return CONVERGED


def check_report(target: Path, option: str) -> None:
    """Make sure that a report can be written to a place; ``option`` : that names it.

    Raises
    ------
    InputError : another suffix than that of a page. ResultsError : nothing can be written there.
    """
    from ..results.writing import check_target

    if target.suffix.lower() not in _PAGES:
        what = "a report is written as HTML, which a browser prints to PDF"
        raise InputError.of("bad argument", option, what, str(target), ", ".join(_PAGES))
    check_target(target)


def write_report(file: Path, target: Path, folder: Path) -> Path:
    """Write the report of a results file, whole or not at all; the place it was written to.

    Raises
    ------
    ResultsError : no results of a run, or nothing can be written.
    """
    from ..report.document import report_page
    from ..results.files import open_results, readable
    from ..results.writing import write_bytes

    with closing(open_results(file)) as tree, readable(file):
        page = report_page(tree, folder)
    return write_bytes(target, page.encode())
