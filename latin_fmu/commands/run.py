"""``latin-fmu run``: solve a scene and write its results."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import CONVERGED, NOT_CONVERGED
from .scene_arguments import AddParser, add_scene, read_scene

if TYPE_CHECKING:
    from ..results.solution import Solution
    from ..scene.schema import Scene

_EXAMPLES = """\
examples:
  latin-fmu run scene.toml
  latin-fmu run scene.toml -o out.nc --set solver.tolerance=1e-4 --set output.fields=true --vtk for_paraview
  latin-fmu run scene.toml --json > report.json

Named items are addressed by name: --set interface.crush.friction_coefficient=0.1
"""


def register(add: AddParser) -> None:
    """Declare the subcommand."""
    parser = add(
        "run",
        help="solve a scene and write its results",
        description="Solve a scene and write its results.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_scene(parser)
    parser.add_argument(
        "-o",
        "--output",
        metavar="OUT.nc",
        type=Path,
        help="results file (default: <name of the scene>.nc in the current folder)",
    )
    parser.add_argument(
        "--json", action="store_true", help="print a JSON report, and nothing else, on stdout"
    )
    parser.add_argument("--quiet", action="store_true", help="no progress and no summary")
    parser.add_argument(
        "--vtk", metavar="FOLDER", type=Path, help="also write files for ParaView to this folder"
    )
    parser.add_argument(
        "--no-estimate", action="store_true", help="no estimate of the error (accuracy.estimate = false)"
    )
    parser.set_defaults(command=_run)


def _run(arguments: argparse.Namespace) -> int:
    from ..results.files import check_target
    from ..results.vtk import check_export_folder, export_vtu

    scene = read_scene(arguments)
    target = arguments.output or Path(f"{scene.name}.nc")
    check_target(target)  # before the long part
    if arguments.vtk is not None:
        check_export_folder(arguments.vtk)
    solution = _estimated(scene, _solve(scene, arguments.quiet), arguments)
    written = []
    try:
        solution.save(target)
        written.append(f"results: {target}")
        if arguments.vtk is not None:
            written.append(f"for ParaView: {export_vtu(solution, arguments.vtk)}")
    finally:  # a full disk must not cost the numbers as well
        _show(solution, arguments, written)
    return CONVERGED if solution.converged else NOT_CONVERGED


def _solve(scene: Scene, quiet: bool) -> Solution:
    from .. import api
    from ..progress import Progress

    if quiet:
        return api.solve(scene)
    progress = Progress(sys.stderr, scene.solver.tolerance)
    try:
        return api.solve(scene, progress=progress)
    finally:
        progress.close()


def _estimated(scene: Scene, solution: Solution, arguments: argparse.Namespace) -> Solution:
    """The solution with its estimated error, where wanted and where there is a run to judge."""
    if arguments.no_estimate or not scene.accuracy.estimate or not solution.converged:
        return solution
    from ..accuracy.estimate import estimate_error

    return replace(solution, estimate=estimate_error(scene, solution))


def _show(solution: Solution, arguments: argparse.Namespace, written: list[str]) -> None:
    """The report or the summary on stdout; with ``--json`` the status goes to stderr for people."""
    if arguments.json:
        print(_json(solution.report()))
    elif not arguments.quiet:
        print("\n".join([solution.summary(), "", *written]))
    if not arguments.quiet and arguments.json:
        print("\n".join([solution.status, *written]), file=sys.stderr)
    elif arguments.quiet and not solution.converged:
        print(solution.status, file=sys.stderr)


def _json(report: dict[str, Any]) -> str:
    """Strict JSON with one key a line: the count of iterations of a thousand windows stays on one."""
    lines = (f"  {json.dumps(key)}: {json.dumps(value, allow_nan=False)}" for key, value in report.items())
    return "{\n" + ",\n".join(lines) + "\n}"
