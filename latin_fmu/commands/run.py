"""``latin-fmu run``: solve a scene, show its progress, and write its results."""

from __future__ import annotations

import argparse
import gc
import json
import os
import re
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, Final, NamedTuple

from ..errors import InputError, Problem, SolverError
from . import (
    CONVERGED,
    LIMITED,
    NOT_CONVERGED,
    REMARKED,
    Json,
    OfScene,
    Progress,
    Signals,
    StopSignals,
    Strict,
    Waiting,
    check_netcdf,
    ending_together,
    json_lines,
    output_file,
    say,
    seconds,
    started_together,
)
from .decks import Units, exact_lines, is_deck_file, told_scene, write_printed
from .options import Option, command
from .report import check_report, write_report

if TYPE_CHECKING:
    from ..accuracy.adaptive_resolution import Choice
    from ..decks.importing import ImportedDeck
    from ..latin.processes import Processes
    from ..results.checkpoint import Checkpoint
    from ..results.solution import Solution
    from ..scene.schema import Scene

_EXAMPLES = """\
examples:
  latin-fmu run scene.toml
  latin-fmu run bracket.inp --units mm-t-s --exact
  latin-fmu run scene.toml -o out.nc --set solver.tolerance=1e-4 --set output.fields=true --vtk for_paraview
  latin-fmu run scene.toml --json > run.json
  latin-fmu run scene.toml --report report.html
  latin-fmu run scene.toml -o out.nc --checkpoint 10min --resume
  latin-fmu run scene.toml --accuracy 1% --of crush.first_contact

Named items are addressed by name: --set load.press.pressure=100e6
"""
_SEARCH: Final = 600.0  # CPU seconds of all runs of a search for an accuracy
_UNITS: Final = MappingProxyType({"s": 1.0, "min": 60.0, "h": 3600.0})


class Interval(NamedTuple):
    """Between two checkpoints: a number of instants, or seconds."""

    instants: int | None = None
    seconds: float | None = None


def interval(text: str) -> Interval:
    """Instants, or seconds, between two checkpoints.

    >>> interval("500")
    Interval(instants=500, seconds=None)
    >>> interval("1.5min").seconds
    90.0

    Raises
    ------
    argparse.ArgumentTypeError : neither.
    """
    match = re.fullmatch(r"(\d+|\d*\.\d+) ?(|s|min|h)", text.strip())
    if match is None or float(match[1]) <= 0.0 or (not match[2] and "." in match[1]):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of instants or a time; for example 500, 90s, 10min")
    if match[2]:
        return Interval(seconds=float(match[1]) * _UNITS[match[2]])
    return Interval(int(match[1]))


@dataclass(frozen=True, kw_only=True)
class SolveOptions(OfScene):
    """Options of ``run``."""

    output: Annotated[
        Path | None,
        Option("results file (default: <name of the scene>.nc in the current folder)", "OUT.nc", "-o", output_file),
    ] = None
    units: Units = None
    exact: Annotated[
        bool,
        Option("run a deck once more without its penalty, with exact contact, and print how far the results are apart"),
    ] = False
    strict: Strict = False
    json: Json = False
    quiet: Annotated[bool, Option("no progress and no summary", flags="-q")] = False
    details: Annotated[
        bool, Option("also print iterations, energies, tables of interfaces and sensors, and all estimated errors")
    ] = False
    vtk: Annotated[Path | None, Option("also write files for ParaView to this folder", "FOLDER")] = None
    figure: Annotated[
        Path | None,
        Option(
            "also draw forces, contact states, sensors, spectra and bolts (png, pdf or svg), as latin-fmu plot OUT.nc "
            "does",
            "FIGURE",
            read=output_file,
        ),
    ] = None
    report: Annotated[
        Path | None,
        Option("also write a report as one HTML page, as latin-fmu report OUT.nc does", "FILE.html", read=output_file),
    ] = None
    checkpoint: Annotated[
        Interval | None,
        Option(
            "write a checkpoint every N instants, or every N s, min or h (e.g. 500, 90s, 10min), to OUT.nc.checkpoint "
            "and OUT.nc.checkpoint.histories; signals that end a run leave one in any case (INT, TERM, HUP, QUIT, "
            "XCPU, USR1). The checkpoint of an earlier run is kept under a number",
            "N",
            read=interval,
        ),
    ] = None
    resume: Annotated[bool, Option("continue from an existing checkpoint; bit-identical results")] = False
    estimate: Annotated[bool, Option("no estimate of the error (accuracy.estimate = false)")] = True
    accuracy: Annotated[
        str | None,
        Option(
            "target relative error: mesh, time step and tolerance are chosen (accuracy.target; of the quantity --of, "
            "impulse by default)",
            "1%",
        ),
    ] = None
    of: Annotated[
        str | None,
        Option(
            "with --accuracy: its quantity, as the table of prices names it (accuracy.quantity), for example "
            "m6.largest_bolt_force",
            "QUANTITY",
        ),
    ] = None
    max_cpu: Annotated[
        float | None,
        Option(
            f"limit in CPU seconds of the run, its derivatives, their checks and its error estimate; a run that "
            f"reaches it stops (exit code {LIMITED}): results so far are written and marked, with a checkpoint for "
            "--resume; if the run itself is complete, remaining derivatives, checks and estimates are omitted with a "
            "warning. Default: no limit. With "
            f"--accuracy: of all runs of the search together, {_SEARCH:g} by default; the chosen one is always "
            "finished",
            "SECONDS",
            read=seconds,
        ),
    ] = None


@command(_EXAMPLES)
def run(options: SolveOptions, signals: Signals) -> int:
    """Solve a scene, or a deck of Abaqus or CalculiX, and write its results."""
    if options.output is not None:
        check_netcdf(options.output)
    processes = started_together()
    if is_deck_file(options.scene):
        if processes is not None:
            remedy = f"latin-fmu import {options.scene}, and run the scene"
            raise InputError.of("bad argument", str(options.scene), "a deck is run by one process", remedy=remedy)
        target, deck = told_scene(options.scene, options.units, options.quiet)
        return _run_alone(replace(options, scene=target), signals, deck)
    if options.units is not None and options.scene.exists():
        raise InputError.of("bad argument", "--units", "a scene has units of its own", remedy="omit it")
    if options.exact:
        raise InputError.of("bad argument", "--exact", "a scene has no penalty of a deck", remedy="omit it")
    if processes is None:
        return _run_alone(options, signals)
    with ending_together(processes, signals):
        return _distributed(options, signals, processes)


def _distributed(options: SolveOptions, signals: StopSignals, processes: Processes) -> int:
    """The same on several processes: process 0 shows how far the run is, and writes the results."""
    first = processes.rank == 0
    options = replace(options, quiet=options.quiet or not first)
    with processes.agreed():
        scene = _read(options)
        refused: dict[str, object] = {"--checkpoint": options.checkpoint, "--resume": options.resume or None}
        refused["--accuracy"] = _target(scene, options)
        if wanted := [name for name, value in refused.items() if value is not None]:
            problems = [Problem(name, "requires a single process", remedy="run it without mpiexec") for name in wanted]
            raise InputError(problems, "the run cannot be distributed over processes")
        if first:
            target = _checked_outputs(scene, options)
        else:
            target = Path()
    # all processes take part in the estimate
    solution = _estimated(scene, _solve(scene, options, signals, processes=processes), options, processes)
    with processes.agreed():
        if first:
            written: list[str] = []
            lost = _write(solution, target, options, written, scene.base_dir)
            _show(solution, options, written, None, lost)
    return _code(solution, solution.trustworthy, options)


def _checked_outputs(scene: Scene, options: SolveOptions) -> Path:
    """The results file, after a note on inputs; made sure before the long part that all outputs can be written."""
    from ..results.writing import check_target

    _note_inputs(scene, options.quiet)
    target = options.output or Path(f"{scene.name}.nc")
    check_target(target)
    if options.vtk is not None:
        from ..results.vtk import check_export_folder

        check_export_folder(options.vtk)
    if options.figure is not None:
        from ..pictures.style import check_figure_path

        check_figure_path(options.figure)
        check_target(options.figure)
    if options.report is not None:
        check_report(options.report, "--report")
    return target


def _code(solution: Solution, good: bool, options: SolveOptions) -> int:
    """Exit code of a run that has been written."""
    if solution.interrupted:
        return LIMITED
    if not good:
        return NOT_CONVERGED
    if options.strict and solution.warnings:
        return REMARKED
    return CONVERGED


def _run_alone(options: SolveOptions, signals: StopSignals, deck: ImportedDeck | None = None) -> int:
    """A run of one process; ``deck`` : that the scene was made from."""
    with signals.deferred(), _lean_imports():
        from ..accuracy import estimate  # noqa: F401, loads the solver, too
        from ..results.writing import remove_dead_drafts

        scene = _read(options)
    target = _checked_outputs(scene, options)
    remove_dead_drafts(target.parent)
    wanted = _target(scene, options)
    # before the search: it refuses options that contradict each other
    checkpoint = _checkpoint(Path(f"{target}.checkpoint"), options, signals, wanted is not None)
    choice = None
    if wanted is not None:
        choice = _chosen(scene, wanted, options)
    if choice is None:
        solution = _solve(scene, options, signals, checkpoint=checkpoint, stream=_folder(checkpoint.path))
        solution = _estimated(scene, solution, options, stream=_folder(target))
    elif choice.solution is None:
        raise SolverError(choice.sentence)
    else:
        solution = choice.solution
    written = []
    if choice is not None:
        written = [choice.sentence]
    # a signal does not interrupt the writing: it ends the process with its code below
    signals.noted = True
    with Waiting("writing the results", quiet=options.quiet):
        lost = _write(solution, target, options, written, scene.base_dir, deck)
    if deck is not None and options.exact:
        written += exact_lines(deck, solution, options.scene.parent)
    # after the results are written: they are read from it
    if solution.outcome.stream is not None:
        solution.outcome.stream.close()
    if solution.complete and not lost:
        checkpoint.remove()
    elif checkpoint.found:
        written.append(f"checkpoint: {checkpoint.path} (continue with --resume)")
    _show(solution, options, written, choice, lost)
    if signals.received:
        return int(signals.exit_code)
    good = solution.trustworthy and (choice is None or choice.reached)
    return _code(solution, good, options)


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


def _write(
    solution: Solution,
    target: Path,
    options: SolveOptions,
    written: list[str],
    folder: Path,
    deck: ImportedDeck | None = None,
) -> list[Problem]:
    """Write the outputs, and a line on each to ``written``; problems of those that could not be. ``folder`` : of the
    scene."""
    from ..results.writing import UnwrittenError

    lost: list[Problem] = []
    vtk, figure = options.vtk, options.figure
    try:
        solution.save(target)
        written.append(f"results: {target}")
    except UnwrittenError as error:
        lost += error.problems
    if deck is not None:
        try:
            written += [f"as CalculiX writes it: {file}" for file in write_printed(deck, solution, target)]
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
    if options.report is not None and not lost:
        try:
            written.append(f"report: {write_report(target, options.report, folder)}")
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


def _read(options: SolveOptions) -> Scene:
    """The scene, with the quantity of the accuracy that the options name."""
    if options.of is None:
        return options.read_scene()
    settings = *options.overrides, f"accuracy.quantity={json.dumps(options.of)}"
    scene = replace(options, overrides=settings).read_scene()
    if _target(scene, options) is None:
        raise InputError.of("bad argument", "--of", "there is no accuracy to reach", remedy="add --accuracy 2%")
    return scene


def _target(scene: Scene, options: SolveOptions) -> float | None:
    """The accuracy wanted, by the option or by the scene."""
    text = options.accuracy
    if text is None:
        return scene.accuracy.target
    try:
        value = float(text.removesuffix("%"))
        if text.endswith("%"):
            value = value / 100.0
    except ValueError:
        value = -1.0
    if not 0.0 < value < 1.0:
        problem = Problem("--accuracy", "not a relative error", text, "for example 1% or 0.01")
        raise InputError([problem], "bad argument")
    return value


def _chosen(scene: Scene, wanted: float, options: SolveOptions) -> Choice:
    """The search for the settings; what it does goes to stderr."""
    from ..accuracy.adaptive_resolution import choose

    def log(text: str) -> None:
        if not options.quiet:
            say(text)

    return choose(scene, wanted, options.max_cpu or _SEARCH, log)


def _checkpoint(path: Path, options: SolveOptions, signals: StopSignals, searched: bool) -> Checkpoint:
    """The checkpoint of the run; ``searched``: the settings are, by many runs, of which none can be continued."""
    from ..results.checkpoint import Checkpoint

    every = options.checkpoint or Interval()
    if searched and (options.checkpoint is not None or options.resume):
        what, remedy = "the search for an accuracy has no checkpoints", "run with the settings that it chose"
        raise InputError([Problem("--checkpoint", what, remedy=remedy)], "the options contradict each other")

    class Interruptible(Checkpoint):
        """From the start of the march on, signals stop the run between two windows."""

        def begin(self, run: Any, digest: str) -> None:
            super().begin(run, digest)
            signals.noted = True

    return Interruptible(path, *every, options.resume, lambda: signals.received != 0, say)


def _solve(scene: Scene, options: SolveOptions, signals: StopSignals, **keywords: Any) -> Solution:
    """The solution of the scene, with its progress on stderr; options as for ``api.solve``."""
    from .. import api

    try:
        with Progress(scene.solver.tolerance, options.quiet) as progress:
            return api.solve(scene, progress=progress, max_cpu=options.max_cpu, **keywords)
    finally:
        # the run is over: what follows may be interrupted
        signals.noted = False


def _estimated(
    scene: Scene,
    solution: Solution,
    options: SolveOptions,
    processes: Processes | None = None,
    stream: Path | None = None,
) -> Solution:
    """The solution with its estimated error, where that is requested and can be estimated."""
    if not options.estimate or not scene.accuracy.estimate or not solution.trustworthy:
        return solution
    from ..accuracy.estimate import estimate_error

    budget = _left(solution, options)
    try:
        with Waiting("error estimate", quiet=options.quiet) as waiting:
            estimate = estimate_error(scene, solution, None, processes, waiting.reached, stream, budget)
    except KeyboardInterrupt:
        # all processes must end together: the others wait in an exchange
        if processes is not None:
            raise
        return solution  # the results are written without it
    return replace(solution, estimate=estimate)


def _left(solution: Solution, options: SolveOptions) -> float | None:
    """CPU seconds that a run has left of its limit for the estimate; None without a limit."""
    if options.max_cpu is None:
        return None
    return max(options.max_cpu - solution.timings.total, 0.0)


def _show(
    solution: Solution, options: SolveOptions, written: list[str], choice: Choice | None, lost: list[Problem]
) -> None:
    """The report or the summary on stdout; with ``--json`` the status goes to stderr for people.

    Raises
    ------
    UnwrittenError : outputs are ``lost``; after the numbers, which a full disk must not cost as well.
    """
    if options.json:
        report = solution.report()
        if choice is not None:
            report = report | {"accuracy_target": choice.report()}
        print(json_lines(report))
    elif not options.quiet:
        print("\n".join([solution.summary(options.details), "", *written]))
    if not options.quiet and options.json:
        say("\n".join([solution.status, *written]))
    elif options.quiet and not solution.trustworthy:
        say(solution.status)
    elif options.quiet and choice is not None and not choice.reached:
        say(choice.sentence)
    if lost:
        from ..results.writing import UnwrittenError

        raise UnwrittenError(lost, "cannot write the results")
