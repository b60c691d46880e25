"""``latin-fmu run``: solve a scene and write its results."""

from __future__ import annotations

import argparse
import gc
import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError, Problem, SolverError
from . import CONVERGED, NOT_CONVERGED, AddParser, add_scene, declare, read_scene

if TYPE_CHECKING:
    from ..accuracy.adaptive_resolution import Choice
    from ..results.solution import Solution
    from ..scene.schema import Scene

_EXAMPLES = """\
examples:
  latin-fmu run scene.toml
  latin-fmu run scene.toml -o out.nc --set solver.tolerance=1e-4 --set output.fields=true --vtk for_paraview
  latin-fmu run scene.toml --json > report.json
  latin-fmu run scene.toml --accuracy 1% --set accuracy.quantity=crush.first_contact

Named items are addressed by name: --set load.press.pressure=100e6
"""


def register(add: AddParser) -> None:
    """Declare the subcommand."""
    parser = declare(add, "run", "solve a scene and write its results", _run, _EXAMPLES)
    add_scene(parser)
    parser.add_argument(
        "-o",
        "--output",
        metavar="OUT.nc",
        type=Path,
        help="results file (default: <name of the scene>.nc in the current folder)",
    )
    parser.add_argument("--json", action="store_true", help="print a JSON report, and nothing else, on stdout")
    parser.add_argument("--quiet", action="store_true", help="no progress and no summary")
    parser.add_argument("--vtk", metavar="FOLDER", type=Path, help="also write files for ParaView to this folder")
    parser.add_argument(
        "--no-estimate", action="store_true", help="no estimate of the error (accuracy.estimate = false)"
    )
    parser.add_argument(
        "--accuracy",
        metavar="1%",
        help="relative error wanted: mesh, time step and tolerance are chosen (accuracy.target; the quantity is "
        "accuracy.quantity, impulse by default)",
    )
    parser.add_argument(
        "--max-cpu",
        metavar="SECONDS",
        type=float,
        default=600.0,
        help="with --accuracy: CPU seconds one run may take (default 600)",
    )


def _run(arguments: argparse.Namespace) -> int:
    with _lean_imports():
        from ..accuracy import estimate  # noqa: F401, loads the solver, too
        from ..results.files import check_target

        scene = read_scene(arguments)
    target = arguments.output or Path(f"{scene.name}.nc")
    check_target(target)  # before the long part
    if arguments.vtk is not None:
        from ..results.vtk import check_export_folder

        check_export_folder(arguments.vtk)
    wanted = _target(scene, arguments)
    choice = None if wanted is None else _chosen(scene, wanted, arguments)
    if choice is None:
        solution = _estimated(scene, _solve(scene, arguments.quiet), arguments)
    elif choice.solution is None:
        raise SolverError(choice.sentence)
    else:
        solution = choice.solution
    written = [] if choice is None else [choice.sentence]
    try:
        solution.save(target)
        written.append(f"results: {target}")
        if arguments.vtk is not None:
            from ..results.vtk import export_vtu

            written.append(f"for ParaView: {export_vtu(solution, arguments.vtk)}")
    finally:  # a full disk must not cost the numbers as well
        _show(solution, arguments, written, choice)
    good = solution.converged and (choice is None or choice.reached)
    return CONVERGED if good else NOT_CONVERGED


@contextmanager
def _lean_imports() -> Iterator[None]:
    """Imports that cost less: what they make is not searched for garbage, and SciPy loads no tools of developers.

    SciPy copies all names of ``numpy``, which loads ``numpy.f2py`` and ``numpy.testing`` where they have no value yet.
    """
    import numpy

    tools = [name for name in ("f2py", "testing") if name not in vars(numpy)]
    vars(numpy).update(dict.fromkeys(tools))
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
        for name in tools:
            if vars(numpy)[name] is None:
                delattr(numpy, name)


def _target(scene: Scene, arguments: argparse.Namespace) -> float | None:
    """The accuracy wanted, by the option or by the scene."""
    text = arguments.accuracy
    if text is None:
        return scene.accuracy.target
    try:
        value = float(text.removesuffix("%")) / (100.0 if text.endswith("%") else 1.0)
    except ValueError:
        value = -1.0
    if not 0.0 < value < 1.0:
        problem = Problem("--accuracy", "not a relative error", text, "for example 1% or 0.01")
        raise InputError([problem], "bad argument")
    return value


def _chosen(scene: Scene, wanted: float, arguments: argparse.Namespace) -> Choice:
    """The search for the settings; what it does goes to stderr."""
    from ..accuracy.adaptive_resolution import choose

    def log(text: str) -> None:
        if not arguments.quiet:
            print(text, file=sys.stderr, flush=True)

    return choose(scene, wanted, arguments.max_cpu, log)


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


def _show(solution: Solution, arguments: argparse.Namespace, written: list[str], choice: Choice | None) -> None:
    """The report or the summary on stdout; with ``--json`` the status goes to stderr for people."""
    if arguments.json:
        print(_json(solution.report() | ({} if choice is None else {"accuracy_target": choice.report()})))
    elif not arguments.quiet:
        print("\n".join([solution.summary(), "", *written]))
    if not arguments.quiet and arguments.json:
        print("\n".join([solution.status, *written]), file=sys.stderr)
    elif arguments.quiet and not solution.converged:
        print(solution.status, file=sys.stderr)
    elif arguments.quiet and choice is not None and not choice.reached:
        print(choice.sentence, file=sys.stderr)


def _json(report: dict[str, Any]) -> str:
    """Strict JSON with one key a line: the count of iterations of a thousand windows stays on one."""
    lines = (f"  {json.dumps(key)}: {json.dumps(value, allow_nan=False)}" for key, value in report.items())
    return "{\n" + ",\n".join(lines) + "\n}"
