"""``latin-fmu run``: solve a scene, show its progress, and write its results."""

from __future__ import annotations

import argparse
import gc
import os
import re
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

from ..errors import InputError, Problem, SolverError
from . import (
    CONVERGED,
    LIMITED,
    NOT_CONVERGED,
    REMARKED,
    AddParser,
    Progress,
    StopSignals,
    Waiting,
    add_json,
    add_max_cpu,
    add_scene,
    add_strict,
    check_netcdf,
    declare,
    ending_together,
    json_lines,
    option,
    output_file,
    read_scene,
    say,
    started_together,
    switch,
)

if TYPE_CHECKING:
    from ..accuracy.adaptive_resolution import Choice
    from ..latin.processes import Processes
    from ..results.checkpoint import Checkpoint
    from ..results.solution import Solution
    from ..scene.schema import Scene

_EXAMPLES = """\
examples:
  latin-fmu run scene.toml
  latin-fmu run scene.toml -o out.nc --set solver.tolerance=1e-4 --set output.fields=true --vtk for_paraview
  latin-fmu run scene.toml --json > report.json
  latin-fmu run scene.toml -o out.nc --checkpoint 10min --resume
  latin-fmu run scene.toml --accuracy 1% --set accuracy.quantity=crush.first_contact

Named items are addressed by name: --set load.press.pressure=100e6
"""
_SEARCH: Final = 600.0  # CPU seconds of all runs of a search for an accuracy
_UNITS: Final = MappingProxyType({"s": 1.0, "min": 60.0, "h": 3600.0})


def register(add: AddParser) -> None:
    """Declare the subcommand."""
    parser = declare(add, "run", "solve a scene and write its results", _run, _EXAMPLES)
    add_scene(parser)
    text = "results file (default: <name of the scene>.nc in the current folder)"
    option(parser, "-o --output", "OUT.nc", text, output_file)
    add_strict(parser)
    add_json(parser)
    switch(parser, "-q --quiet", "no progress and no summary")
    text = "also print iterations, energies, tables of interfaces and sensors, and all estimated errors"
    switch(parser, "--details", text)
    option(parser, "--vtk", "FOLDER", "also write files for ParaView to this folder", Path)
    text = (
        "also draw forces, contact states, sensors, spectra and bolts (png, pdf or svg), as latin-fmu plot OUT.nc does"
    )
    option(parser, "--figure", "FIGURE", text, output_file)
    text = (
        "write a checkpoint every N instants, or every N s, min or h (e.g. 500, 90s, 10min), to OUT.nc.checkpoint "
        "and OUT.nc.checkpoint.histories; signals that end a run leave one in any case (INT, TERM, HUP, QUIT, XCPU, "
        "USR1). The checkpoint of an earlier run is kept under a number"
    )
    option(parser, "--checkpoint", "N", text, interval)
    switch(parser, "--resume", "continue from the checkpoint, where there is one, to the same bits")
    switch(parser, "--no-estimate", "no estimate of the error (accuracy.estimate = false)")
    text = (
        "target relative error: mesh, time step and tolerance are chosen (accuracy.target; the quantity is "
        "accuracy.quantity, impulse by default)"
    )
    option(parser, "--accuracy", "1%", text)
    text = (
        f"CPU seconds that the run may take, with its derivatives, their checks and its error estimate; one that "
        f"reaches them stops (exit code {LIMITED}): results so far are written and marked, and a checkpoint to go on "
        "from; of what follows a whole run, the rest is left out with a warning. Default: no limit. With "
        f"--accuracy: of all runs of the search together, {_SEARCH:g} by default; the chosen one is always finished"
    )
    add_max_cpu(parser, text)


def interval(text: str) -> tuple[int | None, float | None]:
    """Instants, or seconds, between two checkpoints.

    >>> interval("500"), interval("1.5min")
    ((500, None), (None, 90.0))

    Raises
    ------
    argparse.ArgumentTypeError : neither.
    """
    match = re.fullmatch(r"(\d+|\d*\.\d+) ?(|s|min|h)", text.strip())
    if match is None or float(match[1]) <= 0.0 or (not match[2] and "." in match[1]):
        raise argparse.ArgumentTypeError(f"{text!r} is no number of instants and no time; for example 500, 90s, 10min")
    return (None, float(match[1]) * _UNITS[match[2]]) if match[2] else (int(match[1]), None)


def _run(arguments: argparse.Namespace) -> int:
    if arguments.output is not None:
        check_netcdf(arguments.output)
    processes = started_together()
    if processes is None:
        return _run_alone(arguments)
    with ending_together(processes, arguments.signals):
        return _distributed(arguments, processes)


def _distributed(arguments: argparse.Namespace, processes: Processes) -> int:
    """The same on several processes: process 0 shows how far the run is, and writes the results."""
    first = processes.rank == 0
    arguments.quiet |= not first
    with processes.agreed():
        scene = read_scene(arguments)
        refused = {"--checkpoint": arguments.checkpoint, "--resume": arguments.resume or None}
        refused["--accuracy"] = _target(scene, arguments)
        if given := [name for name, value in refused.items() if value is not None]:
            problems = [Problem(name, "takes one process", remedy="run it without mpiexec") for name in given]
            raise InputError(problems, "the run cannot be distributed over processes")
        target = _checked_outputs(scene, arguments) if first else Path()
    # all processes take part in the estimate
    solution = _estimated(scene, _solve(scene, arguments, processes=processes), arguments, processes)
    with processes.agreed():
        if first:
            written: list[str] = []
            lost = _write(solution, target, arguments, written)
            _show(solution, arguments, written, None, lost)
    return _code(solution, solution.trustworthy, arguments)


def _checked_outputs(scene: Scene, arguments: argparse.Namespace) -> Path:
    """The results file, after a note on inputs; made sure before the long part that all outputs can be written."""
    from ..results.writing import check_target

    _note_inputs(scene, arguments.quiet)
    target = arguments.output or Path(f"{scene.name}.nc")
    check_target(target)
    if arguments.vtk is not None:
        from ..results.vtk import check_export_folder

        check_export_folder(arguments.vtk)
    if arguments.figure is not None:
        from ..pictures.style import check_figure_path

        check_figure_path(arguments.figure)
        check_target(arguments.figure)
    return target


def _code(solution: Solution, good: bool, arguments: argparse.Namespace) -> int:
    """Exit code of a run that has been written."""
    if solution.interrupted:
        return LIMITED
    return NOT_CONVERGED if not good else REMARKED if arguments.strict and solution.warnings else CONVERGED


def _run_alone(arguments: argparse.Namespace) -> int:
    with arguments.signals.deferred(), _lean_imports():
        from ..accuracy import estimate  # noqa: F401, loads the solver, too
        from ..results.writing import remove_dead_drafts

        scene = read_scene(arguments)
    target = _checked_outputs(scene, arguments)
    remove_dead_drafts(target.parent)
    wanted = _target(scene, arguments)
    # before the search: it refuses options that contradict each other
    checkpoint = _checkpoint(Path(f"{target}.checkpoint"), arguments, wanted is not None)
    choice = None if wanted is None else _chosen(scene, wanted, arguments)
    if choice is None:
        solution = _solve(scene, arguments, checkpoint=checkpoint, stream=_folder(checkpoint.path))
        solution = _estimated(scene, solution, arguments, stream=_folder(target))
    elif choice.solution is None:
        raise SolverError(choice.sentence)
    else:
        solution = choice.solution
    written = [] if choice is None else [choice.sentence]
    # a signal does not interrupt the writing: it ends the process with its code below
    arguments.signals.noted = True
    with Waiting("writing the results", quiet=arguments.quiet):
        lost = _write(solution, target, arguments, written)
    # after the results are written: they are read from it
    if solution.outcome.stream is not None:
        solution.outcome.stream.close()
    if solution.complete and not lost:
        checkpoint.remove()
    elif checkpoint.found:
        written.append(f"checkpoint: {checkpoint.path} (continue with --resume)")
    _show(solution, arguments, written, choice, lost)
    if arguments.signals.received:
        return int(arguments.signals.exit_code)
    good = solution.trustworthy and (choice is None or choice.reached)
    return _code(solution, good, arguments)


def _folder(path: Path) -> Path:
    """Folder of a file, links followed."""
    return Path(os.path.realpath(path)).parent


def _note_inputs(scene: Scene, quiet: bool) -> None:
    """Print the values that inputs keep: nothing sets them in a run by the command line."""
    from ..cosim.input_table import inputs_of
    from ..cosim.variable import variable_of

    stay = [f"{variable_of(name)} = {law.start_value:g}" for name, law in inputs_of(scene).items()]
    if stay and not quiet:
        say(f"inputs keep their start value in this run (only an FMU or a session sets them): {', '.join(stay)}")


def _write(solution: Solution, target: Path, arguments: argparse.Namespace, written: list[str]) -> list[Problem]:
    """Write the outputs, and a line on each to ``written``; problems of those that could not be."""
    from ..results.writing import UnwrittenError

    lost: list[Problem] = []
    vtk, figure = arguments.vtk, arguments.figure
    try:
        solution.save(target)
        written.append(f"results: {target}")
    except UnwrittenError as error:
        lost += error.problems
    if vtk is not None:
        from ..results.vtk import export_vtu

        try:
            written.append(f"for ParaView: {export_vtu(solution, vtk)}")
        except UnwrittenError as error:
            lost += error.problems
    if figure is not None and not lost:
        from ..pictures.style import save_figure
        from ..pictures.summary_picture import summary_figure
        from ..results.files import open_results

        try:
            # from the file: histories of a long run are not in memory
            with closing(open_results(target)) as tree:
                save_figure(summary_figure(tree), figure)
            written.append(f"figure: {figure}")
        except UnwrittenError as error:
            lost += error.problems
    return lost


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
            # a real module where an import has put one in the meantime
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

    log = (lambda _: None) if arguments.quiet else say
    return choose(scene, wanted, arguments.max_cpu or _SEARCH, log)


def _checkpoint(path: Path, arguments: argparse.Namespace, searched: bool) -> Checkpoint:
    """The checkpoint of the run; ``searched``: the settings are, by many runs, of which none can be continued."""
    from ..results.checkpoint import Checkpoint

    signals: StopSignals = arguments.signals
    every, seconds = arguments.checkpoint or (None, None)
    if searched and (arguments.checkpoint is not None or arguments.resume):
        what, remedy = "the search for an accuracy has no checkpoints", "run with the settings that it chose"
        raise InputError([Problem("--checkpoint", what, remedy=remedy)], "the options contradict each other")

    class Interruptible(Checkpoint):
        """From the start of the march on, signals stop the run between two windows."""

        def begin(self, run: Any, digest: str) -> None:
            super().begin(run, digest)
            signals.noted = True

    return Interruptible(path, every, seconds, arguments.resume, lambda: signals.received != 0, say)


def _solve(scene: Scene, arguments: argparse.Namespace, **options: Any) -> Solution:
    """The solution of the scene, with its progress on stderr; options as for ``api.solve``."""
    from .. import api

    try:
        with Progress(scene.solver.tolerance, arguments.quiet) as progress:
            return api.solve(scene, progress=progress, max_cpu=arguments.max_cpu, **options)
    finally:
        # the run is over: what follows may be interrupted
        arguments.signals.noted = False


def _estimated(
    scene: Scene,
    solution: Solution,
    arguments: argparse.Namespace,
    processes: Processes | None = None,
    stream: Path | None = None,
) -> Solution:
    """The solution with its estimated error, where that is requested and can be estimated."""
    if arguments.no_estimate or not scene.accuracy.estimate or not solution.trustworthy:
        return solution
    from ..accuracy.estimate import estimate_error

    left = _left(solution, arguments)
    try:
        with Waiting("error estimate", quiet=arguments.quiet) as waiting:
            estimate = estimate_error(scene, solution, None, processes, waiting.reached, stream, left)
    except KeyboardInterrupt:
        # all processes must end together: the others wait in an exchange
        if processes is not None:
            raise
        return solution  # the results are written without it
    return replace(solution, estimate=estimate)


def _left(solution: Solution, arguments: argparse.Namespace) -> float | None:
    """CPU seconds that a run has left of its limit for the estimate; None without a limit."""
    return None if arguments.max_cpu is None else max(arguments.max_cpu - solution.timings.total, 0.0)


def _show(
    solution: Solution, arguments: argparse.Namespace, written: list[str], choice: Choice | None, lost: list[Problem]
) -> None:
    """The report or the summary on stdout; with ``--json`` the status goes to stderr for people.

    Raises
    ------
    UnwrittenError : outputs are ``lost``; after the numbers, which a full disk must not cost as well.
    """
    if arguments.json:
        print(json_lines(solution.report() | ({} if choice is None else {"accuracy_target": choice.report()})))
    elif not arguments.quiet:
        print("\n".join([solution.summary(arguments.details), "", *written]))
    if not arguments.quiet and arguments.json:
        say("\n".join([solution.status, *written]))
    elif arguments.quiet and not solution.trustworthy:
        say(solution.status)
    elif arguments.quiet and choice is not None and not choice.reached:
        say(choice.sentence)
    if lost:
        from ..results.writing import UnwrittenError

        raise UnwrittenError(lost, "cannot write the results")
