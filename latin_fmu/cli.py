"""Command line ``latin-fmu``: the only module that prints.

A subcommand is one function that runs it and one that registers it; the latter is listed in ``_COMMANDS``.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from .errors import InputError, LatinError

if TYPE_CHECKING:
    from .results.solution import Solution
    from .scene.schema import Scene

CONVERGED, NOT_CONVERGED, BAD_INPUT, SOLVER_FAILED, INTERRUPTED = 0, 1, 2, 3, 130

_EXAMPLES = """\
examples:
  latin-fmu check models/two_specimen_crushing/scene.toml
  latin-fmu run models/beam_in_traction/scene.toml -o beam.nc
  latin-fmu run models/two_specimen_crushing/scene.toml --set interface.crush.friction_coefficient=0.3
  latin-fmu plot beam.nc -o beam.png
  latin-fmu reference

exit codes: 0 converged, 1 not converged (results are written and marked), 2 bad input, 3 the solver cannot
continue, 130 interrupted
"""

_RUN_EXAMPLES = """\
examples:
  latin-fmu run scene.toml
  latin-fmu run scene.toml -o out.nc --set solver.tolerance=1e-4 --set output.fields=true --vtk for_paraview
  latin-fmu run scene.toml --json > report.json

Named items are addressed by name: --set interface.crush.friction_coefficient=0.1
"""

AddParser = Callable[..., argparse.ArgumentParser]
"""``add_parser`` of the subcommands."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line ``argv`` (default: that of the process) and return its exit code."""
    try:
        arguments = _parser().parse_args(argv)
    except SystemExit as stop:  # argparse has printed the help, the version or what is wrong
        return stop.code if isinstance(stop.code, int) else BAD_INPUT
    try:
        code: int = arguments.command(arguments)
        sys.stdout.flush()
        return code
    except LatinError as error:
        _tell(f"latin-fmu: {error}")
        return BAD_INPUT if isinstance(error, InputError) else SOLVER_FAILED
    except KeyboardInterrupt:
        _tell("latin-fmu: interrupted")
        return INTERRUPTED
    except BrokenPipeError:  # the reader of our output has gone, e.g. `latin-fmu reference | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return CONVERGED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="latin-fmu",
        description="Impact of elastic bodies with frictional contact, by the LATIN method.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and stop")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for register in _COMMANDS:
        register(commands.add_parser)
    return parser


class _Version(argparse.Action):
    """Prints the version only when asked for: reading it takes an import."""

    def __call__(self, parser: argparse.ArgumentParser, *unused: object) -> None:
        from .results.provenance import package_version

        print(f"latin-fmu {package_version()}")
        parser.exit()


def _tell(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _add_scene(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scene", metavar="SCENE", type=Path, help="scene file (TOML)")
    parser.add_argument(
        "--set",
        metavar="a.b.c=value",
        action="append",
        default=[],
        dest="overrides",
        help="change one setting of the scene; may be repeated",
    )


def _scene(arguments: argparse.Namespace) -> Scene:
    from .scene.reader import load_scene

    return load_scene(arguments.scene, arguments.overrides)


def _register_run(add: AddParser) -> None:
    parser = add(
        "run",
        help="solve a scene and write its results",
        epilog=_RUN_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    _add_scene(parser)
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
    parser.set_defaults(command=_run)


def _run(arguments: argparse.Namespace) -> int:
    from . import api
    from .progress import Progress
    from .results.files import check_target
    from .results.vtk import check_export_folder, export_vtu

    scene = _scene(arguments)
    target = arguments.output or Path(f"{scene.name}.nc")
    check_target(target)  # before the long part
    if arguments.vtk is not None:
        check_export_folder(arguments.vtk)
    progress = None if arguments.quiet else Progress(sys.stderr, scene.solver.tolerance)
    try:
        solution = api.solve(scene, progress=progress)
    finally:
        if progress is not None:
            progress.close()
    written = []
    try:
        solution.save(target)
        written.append(f"results: {target}")
        if arguments.vtk is not None:
            written.append(f"for ParaView: {export_vtu(solution, arguments.vtk)}")
    finally:  # a full disk must not cost the numbers as well
        _show(solution, arguments, written)
    return CONVERGED if solution.converged else NOT_CONVERGED


def _show(solution: Solution, arguments: argparse.Namespace, written: list[str]) -> None:
    if arguments.json:
        print(json.dumps(solution.report(), indent=2, allow_nan=False))
    elif not arguments.quiet:
        print("\n".join([solution.summary(), *([""] if written else []), *written]))
    if not arguments.quiet and arguments.json:
        _tell("\n".join([solution.status, *written]))
    elif arguments.quiet and not solution.converged:
        _tell(solution.status)


def _register_check(add: AddParser) -> None:
    parser = add("check", help="read a scene, build its meshes and interfaces, tell its sizes")
    _add_scene(parser)
    parser.set_defaults(command=_check)


def _check(arguments: argparse.Namespace) -> int:
    from . import api

    print("\n".join(api.check(_scene(arguments))))
    return CONVERGED


def _register_plot(add: AddParser) -> None:
    parser = add("plot", help="draw forces, contact states and convergence of a results file")
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
    from .results.netcdf import open_results
    from .results.plots import check_figure_path, save_figure, summary_figure

    target = arguments.output or arguments.results.with_suffix(".png")
    check_figure_path(target)
    with open_results(arguments.results) as tree:
        save_figure(summary_figure(tree), target)
    print(f"figure: {target}")
    return CONVERGED


def _register_reference(add: AddParser) -> None:
    parser = add("reference", help="print every key of a scene file, with units and defaults")
    parser.add_argument("--schema", action="store_true", help="print the JSON schema instead")
    parser.set_defaults(command=_reference)


def _reference(arguments: argparse.Namespace) -> int:
    from .scene.reference import reference_schema, reference_text

    print(json.dumps(reference_schema(), indent=2) if arguments.schema else reference_text())
    return CONVERGED


_COMMANDS: tuple[Callable[[AddParser], None], ...] = (
    _register_run,
    _register_check,
    _register_plot,
    _register_reference,
)
