"""Subcommands that run many scenes: ``cost``, ``stress``, ``sweep`` and ``calibrate``.

``cost`` is the work-precision study, ``stress`` runs the hard cases, ``sweep`` solves one scene for many parameters,
``calibrate`` fits parameters to measured data.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

from ..errors import InputError, Problem
from . import (
    CONVERGED,
    LIMITED,
    NOT_CONVERGED,
    Jobs,
    Json,
    OfScene,
    Quiet,
    Scheduler,
    Signals,
    Waiting,
    json_lines,
    output_file,
    say,
    seconds,
    tell,
    tell_written,
)
from .options import Argument, Option, command, handed

if TYPE_CHECKING:
    from ..accuracy.study import Study
    from ..scene.schema import Scene
    from ..stability import CaseResult

_COST_EXAMPLES = """\
examples:
  latin-fmu cost models/impact_bar/scene.toml --quick
  latin-fmu cost models/lap_joint/shock.toml --of bolt.m6 --of impulse -o study
  latin-fmu cost models/beam_in_traction/scene.toml models/two_specimen_crushing/scene.toml --methods -o study

Mesh and time step are refined in turn and together; errors are measured against the exact solution declared with the
model (reference.json beside the scene) or against a refined run with an estimated error.
"""
_STRESS_EXAMPLES = """\
examples:
  latin-fmu stress --quick
  latin-fmu stress -o stability.md          writes stability.md, stability.png and stability.json (all cases)
  latin-fmu stress --quick --json > stability.json

exit codes: 0 all cases hold, 1 some do not
"""
_SWEEP_EXAMPLES = """\
examples:
  latin-fmu sweep scene.toml --vary interface.crush.friction_coefficient=0:0.6:13 -o study.nc
  latin-fmu sweep scene.toml --vary interface.crush.friction_coefficient=0:0.6:13 --vary load.press.pressure=1e5,2e5
  latin-fmu sweep scene.toml --vary solver.propagator=direct,explicit --scheduler tcp://127.0.0.1:8786
  latin-fmu sweep scene.toml --samples 200 -o samples.nc    of the table [spread], beside the bands to first order
  latin-fmu plot study.nc

from:to:count gives equally spaced values, a list its own values. All combinations are solved. Completed points are
stored in OUTPUT.points until the study is written: after an interruption the same command continues. A failed point
is marked in the study, with its message.

exit codes: 0 all points converged, 1 some did not (the study is written), 2 bad input, 130 interrupted
"""
_CALIBRATE_EXAMPLES = """\
examples:
  latin-fmu calibrate scene.toml shock.csv --fit interface.lap.friction_coefficient --fit bolt.m6.force=5e3:1e3:2e4
  latin-fmu calibrate scene.toml modes.csv ring_down.csv --fit bolt.left.force,bolt.right.force=12e3 --mode 1

The first line of DATA.csv names its columns; the first column gives the kind of data:
  time,tip.acceleration.x,m6.tension,lap.force.x           motions of sensors, forces of interfaces, tensions of bolts
  frequency,tip.srs.x                                      shock response spectrum of a sensor (maximax)
  mode,frequency                                           natural frequencies, elastic modes from 1
  tip.amplitude,frequency,damping                          a mode against the amplitude of a sensor
NAME.sd is the standard deviation of the column NAME, NAME [unit] its unit (default: units of the scene).

A parameter is a number of the scene as in --set; names joined by commas have a common value. Defaults: START is the
value in the scene, LOW and HIGH are a tenth of START and ten times START.

Writes the scene with the fitted values, OUT.toml, and OUT.png: data, before, after, residuals.

exit codes: 0 converged, 1 not within --max-runs (the best run is written), 2 bad input
"""
_BUDGET = 120.0
_TOGETHER: Final = "cost_of_accuracy"  # figure of several scenes
_QUICK = 20.0


@dataclass(frozen=True, kw_only=True)
class SweepOptions(OfScene):
    """Options of ``sweep``."""

    vary: Annotated[
        tuple[str, ...],
        Option("a key and its values, from:to:count or value,value,...; may be repeated", "a.b.c=VALUES"),
    ] = ()
    samples: Annotated[
        int | None,
        Option(
            "instead of --vary: number of samples (8 or more) of the table [spread]; bands beside those to first order",
            "N",
        ),
    ] = None
    seed: Annotated[int | None, Option("with --samples: number of their sequence", "N")] = None
    output: Annotated[
        Path | None,
        Option(
            "file of the study (default: <name of the scene file>_study.nc in the current folder)", "STUDY.nc", "-o"
        ),
    ] = None
    jobs: Jobs = None
    scheduler: Scheduler = None
    max_cpu: Annotated[
        float | None,
        Option("limit in CPU seconds of a point; a point that reaches it has not converged", "SECONDS", read=seconds),
    ] = None
    histories: Annotated[bool, Option()] = False
    guesses: Annotated[
        bool, Option("no first guesses from neighbouring points (windows of several instants)", flags="--cold")
    ] = True
    json: Json = False
    quiet: Quiet = False


@dataclass(frozen=True, kw_only=True)
class CalibrateOptions(OfScene):
    """Options of ``calibrate``."""

    data: Annotated[tuple[Path, ...], Argument("measured data; several may be given", "DATA.csv")]
    fit: Annotated[tuple[str, ...], Option("a number of the scene to fit; may be repeated", "NAME[=START][:LOW:HIGH]")]
    max_runs: Annotated[int | None, Option(metavar="N")] = None
    estimate: Annotated[
        bool, Option("no estimate of the error of the last run, which is otherwise a floor of the standard deviation")
    ] = True
    secants: Annotated[bool, Option()] = False
    mode: Annotated[int | None, Option(metavar="N")] = None
    increments: Annotated[int | None, Option(metavar="N")] = None
    quiet: Quiet = False
    json: Json = False
    output: Annotated[
        Path | None,
        Option(
            "the scene with the fitted values (default: SCENE_calibrated.toml beside SCENE); the figure is OUT.png",
            "OUT.toml",
            "-o",
            output_file,
        ),
    ] = None


@dataclass(frozen=True, kw_only=True)
class CostOptions:
    """Options of ``cost``."""

    scenes: Annotated[tuple[Path, ...], Argument("scene file (TOML)", "SCENE")]
    overrides: Annotated[
        tuple[str, ...], Option("change one setting of every scene; may be repeated", "a.b.c=value", "--set")
    ] = ()
    output: Annotated[
        Path | None,
        Option("write NAME_cost.md, .png and .nc per scene, and cost_of_accuracy.png for several", "FOLDER", "-o"),
    ] = None
    of: Annotated[
        tuple[str, ...], Option("quantity of the figure, as accuracy.quantity; up to four, may be repeated", "QUANTITY")
    ] = ()
    methods: Annotated[
        bool,
        Option(
            "also every other time scheme and propagator, tolerances, windows, search directions, and searches for an "
            "accuracy; methods that fail are listed"
        ),
    ] = False
    budget: Annotated[
        float | None,
        Option(
            f"CPU seconds per scene, about, which no run exceeds (default {_BUDGET:g}, {_QUICK:g} with --quick)",
            "SECONDS",
        ),
    ] = None
    quick: Annotated[bool, Option("a small budget")] = False
    json: Json = False
    quiet: Quiet = False


@command(_COST_EXAMPLES)
def cost(options: CostOptions) -> int:
    """Measure what accuracy costs: error against CPU time as mesh and time step are refined."""
    from ..accuracy.study import study
    from ..accuracy.study_files import as_data
    from ..accuracy.study_text import as_text
    from ..reader import load_scene

    loaded = [load_scene(path, options.overrides) for path in options.scenes]  # all before the long part
    budget = options.budget
    if budget is None:
        if options.quick:
            budget = _QUICK
        else:
            budget = _BUDGET
    if not 0.0 < budget < 1e6:
        raise InputError([Problem("--budget", "not a length of time", f"{budget:g}", "seconds > 0")], "bad argument")
    _check_quantities(options.of)
    if options.output is not None:
        _check_studies(loaded, options.output)
    studies = []
    for scene in loaded:
        # the budget is one of CPU time, so is what is left
        with Waiting(f"study of {scene.name}", budget, options.quiet, clock=time.process_time) as waiting:
            studies.append(study(scene, budget, waiting.log, options.methods))
        if not options.json:
            print(as_text(studies[-1]), flush=True)
    if options.output is not None:
        _write_studies(studies, options.output, options.of)
    if options.json:
        print("[\n" + ",\n".join(json_lines(as_data(item)) for item in studies) + "\n]")
    return CONVERGED


def _check_quantities(wanted: tuple[str, ...]) -> None:
    """Refuse names of quantities that no scene has, before the long part."""
    from ..scene.quantity_table import QUANTITIES_OF_INTEREST

    keys = [row.key for row in QUANTITIES_OF_INTEREST]
    problems = [
        Problem("--of", "unknown quantity", name, f"one of {', '.join(keys)}, after the name of one owner or not")
        for name in wanted
        if name.rpartition(".")[2] not in keys
    ]
    if problems:
        raise InputError(problems, "bad argument")


def _check_studies(scenes: Sequence[Scene], folder: Path) -> None:
    """Make the folder where it is missing (its parent must exist), and make sure that the files can be written."""
    from ..results.writing import check_folder, check_target

    if not folder.exists():
        check_folder(folder.parent)
        folder.mkdir()
    for name in (*(f"{scene.name}_cost" for scene in scenes), _TOGETHER):
        for suffix in (".md", ".png", ".nc"):
            check_target(folder / f"{name}{suffix}")


def _write_studies(studies: list[Study], folder: Path, quantities: Sequence[str]) -> None:
    """Page, figure and netCDF of each study, each complete or not at all."""
    from ..accuracy.price_figure import price_figure
    from ..accuracy.study_files import datatree
    from ..accuracy.study_text import as_markdown
    from ..pictures.style import save_figure
    from ..results.files import write_netcdf
    from ..results.writing import write_bytes

    for study in studies:
        stem = folder / f"{study.scene.name}_cost"
        picture = stem.with_suffix(".png")
        save_figure(price_figure([study], quantities), picture)
        write_bytes(stem.with_suffix(".md"), as_markdown(study, picture.name).encode())
        write_netcdf(datatree(study), stem.with_suffix(".nc"))
        say(f"study: {stem}.md, .png, .nc")
    if len(studies) > 1:
        save_figure(price_figure(studies, quantities), folder / f"{_TOGETHER}.png")


@command(_STRESS_EXAMPLES)
def stress(
    quick: Annotated[bool, Option("the cases that take less than a minute together")] = False,
    max_cpu: Annotated[
        float | None,
        Option(
            "limit in CPU seconds of all cases together; the number of omitted cases is reported (exit code "
            f"{LIMITED}), the rows of the others are reported",
            "SECONDS",
            read=seconds,
        ),
    ] = None,
    json: Json = False,
    output: Annotated[
        Path | None,
        Option("write the report (Markdown) here, and its figure beside it as png", "REPORT.md", "-o", output_file),
    ] = None,
) -> int:
    """Run the hard cases (contrasts, friction, grazing, long runs ...) and report what was measured."""
    from ..results.writing import check_target
    from ..stability import cases, run_suite
    from ..stability.report import as_json, verdict

    if output is not None:
        check_target(output)  # before the long part
        check_target(output.with_suffix(".png"))
        check_target(output.with_suffix(".json"))
    every = list(cases(quick))
    done: list[CaseResult] = []
    with Waiting("hard cases") as waiting:

        def report(row: CaseResult) -> None:
            done.append(row)
            outcome = "holds "
            if not row.passed:
                outcome = "FAILS "
            waiting.log(f"{outcome} {row.case}: {row.measured}")
            waiting.reached(len(done) / len(every), f"hard cases, {len(done)} of {len(every)}")

        rows = run_suite(every, report, max_cpu)
    left_out = len(every) - len(rows)
    if output is not None:
        _write_rows(rows, output, quick, left_out)
    print(as_json(rows) if json else verdict(rows, left_out))
    if left_out:
        if json:
            say(verdict(rows, left_out))
        return LIMITED
    if all(row.passed or row.known_fault for row in rows):
        return CONVERGED
    return NOT_CONVERGED


@command(_SWEEP_EXAMPLES, feeds=("sweep", "sample"))
def sweep(options: SweepOptions, signals: Signals) -> int:
    """Solve a scene for all combinations of parameters, over processes or a dask cluster."""
    with signals.deferred():
        from ..machine import usable_cores
        from ..parametric.point import STATES
        from ..parametric.samples import sample
        from ..parametric.study import sweep
        from ..results.groups import StoredGroup, units_of
    if bool(options.vary) == (options.samples is not None):
        what, remedy = "either values or samples", "give --vary, or --samples with a table [spread]"
        raise InputError.of("the study cannot be made", "--vary, --samples", what, remedy=remedy)
    output = options.output or Path(f"{options.scene.stem}_study.nc")
    jobs = options.jobs
    if jobs is None:
        # workers of a cluster have their own cores
        if options.scheduler is None:
            jobs = usable_cores()
        else:
            jobs = 1
    more: dict[str, Any] = {"settings": options.overrides, "jobs": jobs, "log": None if options.quiet else say}
    more["output"] = output
    lines = list[str]()
    try:
        if options.samples is None:
            study = sweep(options.scene, options.vary, **handed(options, sweep) | more)
        else:
            compared, tree = sample(options.scene, options.samples, **handed(options, sample) | more)
            study, lines = tree.to_dataset(), compared.lines(units_of(tree.attrs))
    except KeyboardInterrupt:
        say(f"the points done so far are in {output}.points: the same command continues")
        raise
    states = study["state"].values
    counts = {name.replace("_", " "): int((states == i).sum()) for i, name in enumerate(STATES)}
    if options.json:
        report = StoredGroup.of_dataset(study).report()
        if options.samples is not None:
            report = report | {"bands": compared.report()}
        print(json_lines(report))
    elif lines:
        print("\n".join(lines))
    written = f"study: {output} ({', '.join(f'{n} {name}' for name, n in counts.items() if n)})"
    if not options.quiet:
        tell_written(options.json, written)
    elif states.any():
        say(written)
    if not states.any():
        return CONVERGED
    return NOT_CONVERGED


@command(_CALIBRATE_EXAMPLES, feeds=("calibrate",))
def calibrate(options: CalibrateOptions) -> int:
    """Fit parameters of a scene to measured data, with intervals and the combinations that the data do not
    determine."""
    from ..calibration.figure import calibration_figure
    from ..calibration.study import calibrate
    from ..pictures.style import save_figure
    from ..reader import scene_from_dict
    from ..results.writing import check_target, write_bytes

    scene = options.read_scene()
    target = options.output or options.scene.with_name(f"{options.scene.stem}_calibrated.toml")
    picture = target.with_suffix(".png")
    for path in (target, picture):
        check_target(path)
    if target.parent.resolve() != scene.base_dir.resolve():
        scene_from_dict(scene.tables(), target.parent)  # files that it names must be found from there, too
    with Waiting("runs", quiet=options.quiet) as waiting:
        calibration = calibrate(scene, options.data, options.fit, **handed(options, calibrate), log=waiting.log)
    tell(options.json, calibration.lines(), calibration.report)
    # comments stay where the file has all the numbers
    source = None
    if not options.overrides:
        source = options.scene.read_text(encoding="utf-8-sig")
    write_bytes(target, calibration.text(source).encode())
    save_figure(calibration_figure(calibration), picture)
    tell_written(options.json, f"calibrated scene: {target}, figure: {picture}")
    if calibration.converged:
        return CONVERGED
    return NOT_CONVERGED


def _write_rows(rows: list[CaseResult], target: Path, quick: bool, left_out: int) -> None:
    """Report, figure and the cases as data, each complete or not at all."""
    from ..pictures.style import save_figure
    from ..results.writing import write_bytes
    from ..stability.report import as_json, as_markdown, compare_schemes, stability_figure

    picture, data = target.with_suffix(".png"), target.with_suffix(".json")
    if rows:
        save_figure(stability_figure(rows), picture)
    # the comparison has no limit of its own: not after one was reached
    if left_out:
        schemes = ""
    else:
        schemes = compare_schemes(elements=20 if quick else 50, bounces=3 if quick else 20)
    write_bytes(data, (as_json(rows) + "\n").encode())
    write_bytes(target, as_markdown(rows, schemes, picture.name if rows else None, left_out, data.name).encode())
    say(f"report: {target}, cases: {data}" + f", figure: {picture}" * bool(rows))
