"""Subcommands ``fmu``, which makes and validates an FMU of a scene, and ``simulate``, which runs one."""

from __future__ import annotations

import csv
import io
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal
from zipfile import ZipFile

from ..errors import InputError, LatinError, NeedsPythonError, Problem, listed
from . import BAD_INPUT, CONVERGED, LIMITED, SOLVER_FAILED, OfScene, Waiting, output_file, say, seconds
from .options import Argument, Option, command

if TYPE_CHECKING:
    from ..scene.schema import Scene

_BUILD_EXAMPLES = """\
examples:
  latin-fmu fmu scene.toml -o crushing.fmu --set "load.press.law={type='input'}"
  latin-fmu fmu scene.toml --fmi 3 --inputs all --reference whole
  latin-fmu fmu scene.toml --inputs press --modes 20
  latin-fmu fmu scene.toml --python --inputs all
  latin-fmu fmu scene.toml --model-exchange --modes 20
  latin-fmu fmu models -o fmus

A load or motion with law = "input" becomes an input of the FMU, also one named by --inputs; others keep their law.
Energies are outputs where the scene says output.energy = true (--set output.energy=true).
Of a folder the FMU of every scene file in it and below is made, in the folder -o, named after folder and file.
The FMU carries a reference run by the layered standard FMI-LS-REF: experiment, inputs and outputs, in the folder
extra/org.fmi-standard.fmi-ls-ref. What --inputs names follows the law it had in the scene.
The FMU is machine code and factors, and needs no Python where it runs; its time step and tolerance are those of the
scene. --python makes one that solves the scene by a Python of its host: time step and tolerance are parameters, and a
results file may have error estimates. It is made, with a remark, where the scene needs Python (an explicit march with
moved faces, say).
--portable makes one for x86-64 processors without AVX2.
--model-exchange makes a reduced model of the scene (a few modes per body, regularised contact) with the states and
events of FMI 3 Model Exchange, for a cross-check by another integrator; co-simulation solves the scene itself.
"""
_RUN_EXAMPLES = """\
examples:
  latin-fmu simulate crushing.fmu --input loads.csv -o out.csv
  latin-fmu simulate crushing.fmu --start load.press.value=0.5 --step 1e-6 --stop 3e-5

loads.csv has a column time and columns named as inputs, e.g. load.press.value; between its rows inputs are
linear, and where only a value is given its rate is taken from them.
"""
_NEEDED: Final = "pip install 'latin-fmu[fmu]' gives what FMUs need"

Reference = Literal["short", "whole", "none"]

_LARGE = 5e7
"""Bytes of the matrices of a compiled FMU from which on their size is printed before they are made."""


@dataclass(frozen=True, kw_only=True)
class FmuOptions(OfScene):
    """Options of ``fmu``."""

    output: Annotated[
        Path | None,
        Option(
            "file to write (default: <name of the scene>.fmu), of a folder of scenes the folder",
            "X.fmu",
            "-o",
            output_file,
        ),
    ] = None
    fmi: Annotated[Literal["2", "3"] | None, Option("version of the FMI (default: 2; of a reduced model 3)")] = None
    inputs: Annotated[
        str,
        Option(
            "loads, driven faces (boundary.NAME) and other drives that become inputs; 'all' for all of them", "NAME,..."
        ),
    ] = ""
    reference: Annotated[
        Reference,
        Option("reference run in the FMU: its beginning where it is long (default), the whole of it, or none", "RUN"),
    ] = "short"
    python: Annotated[bool, Option("an FMU that needs Python at run time; time step and tolerance are parameters")] = (
        False
    )
    portable: Annotated[bool, Option("an FMU for x86-64 processors without AVX2, from 2009 on")] = False
    model_exchange: Annotated[bool, Option("a reduced model as differential equations (FMI 3 only)")] = False
    modes: Annotated[
        int | None,
        Option("reduce the bodies to N elastic modes, and print the error; of a reduced model (default: 12)", "N"),
    ] = None
    patches: Annotated[int | None, Option("reduced model: patches per contact (default: 4)", "P")] = None


@command(_BUILD_EXAMPLES)
def fmu(options: FmuOptions) -> int:
    """Make an FMU of a scene for co-simulation (or of a reduced model for model exchange), and validate it."""
    from importlib import import_module

    from ..results.writing import check_target

    if problems := list(_contradictions(options)):
        raise InputError(problems, "the options contradict each other")
    if options.scene.is_dir():
        return _of_folder(options)
    scene = options.read_scene()
    target = options.output or Path(f"{scene.name}.fmu")
    check_target(target)
    try:
        with Waiting("FMU") as waiting:
            lines = _made(options, scene, target, waiting)
    except ModuleNotFoundError as error:
        say(f"latin-fmu: {error.msg}; {_NEEDED}")
        return BAD_INPUT
    problems, verdict = [], "valid"
    try:
        problems = import_module("fmu_build.checks").validate(target)
    except ModuleNotFoundError as error:  # the file is whole: its check alone needs fmpy
        verdict = f"not checked against the standard ({error.msg}; {_NEEDED})"
    print("".join(f"{line}\n" for line in lines), end="")
    if problems:
        print("\n".join([f"{target} is not valid:", *(f"  {problem}" for problem in problems)]))
        return BAD_INPUT
    with ZipFile(target) as archive:
        platforms = sorted({name.split("/")[1] for name in archive.namelist() if name.startswith("binaries/")})
    print(f"FMU: {target} ({target.stat().st_size / 1e6:.1f} MB, for {', '.join(platforms)}), {verdict}")
    return CONVERGED


def _of_folder(options: FmuOptions) -> int:
    """Make the FMU of every scene file in a folder and below, also after one that cannot be made."""
    files = sorted(options.scene.rglob("*.toml"))
    if not files:
        raise InputError([Problem(str(options.scene), "holds no scene file (*.toml)")])
    target, worst = options.output or Path(), CONVERGED
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError([Problem(str(target), f"no folder for FMUs: {error.strerror}")]) from None
    for file in files:
        # folders belong to the name: scene files of a collection are often all called scene.toml
        name = "_".join([*file.relative_to(options.scene).parent.parts, file.stem]).removesuffix("_scene")
        try:
            code = fmu.function(replace(options, scene=file, output=target / f"{name}.fmu"))
        except LatinError as error:
            say(f"latin-fmu: {file}: {error}")
            code = BAD_INPUT
        worst = max(worst, code)
    return worst


def _made(options: FmuOptions, scene: Scene, target: Path, waiting: Waiting) -> list[str]:
    """Make the FMU; lines on its reference run and on the error of reduced bodies."""
    from importlib import import_module

    names = [name.strip() for name in options.inputs.split(",") if name.strip()]
    checks = import_module("fmu_build.checks")
    inputs = checks.with_inputs(scene, names)
    note = ""
    lines = list[str]()
    acting = _acting(inputs.scene)
    if names == ["all"] and not inputs.laws:
        acting.append("warning: --inputs all gives no inputs: no load or motion of the scene can be an input")
    if options.modes is not None and not options.model_exchange:
        waiting.reached(0.0, "FMU: reduced bodies and their error")
        inputs, note, lines = _reduced(options, inputs, names)
    elif not (options.python or options.model_exchange):
        waiting.reached(0.0, "FMU: size")
        if foreseen := _foreseen(inputs.scene):
            say(f"latin-fmu: {foreseen}")
    waiting.reached(0.0, "FMU")
    build = import_module("fmu_build.build")
    if options.model_exchange:
        sizes = {"n_mode": options.modes, "n_patch": options.patches}
        build.build_model_exchange(inputs.scene, target, **{n: size for n, size in sizes.items() if size is not None})
        return acting
    files = _files(options, inputs.scene, note)
    if options.reference != "none":
        begin = time.process_time()
        whole = options.reference == "whole"
        reference = import_module("fmu_build.reference").reference_of(inputs.scene, inputs.laws, whole)
        files |= reference.files
        if reference.files:
            took = f" ({time.process_time() - begin:.2g} s of CPU time; --reference none omits it)"
        else:
            took = ""
        lines.append(f"{reference.said}{took}")
    build.write_archive(target, files)
    return [*acting, *lines]


def _acting(scene: Scene) -> list[str]:
    """What loads or moves a body in the FMU of a scene, in words."""
    from ..cosim.input_table import acting_of, given_of, settable_of
    from ..cosim.variable import input_variable
    from ..scene.laws import InputLaw

    actions, sources = acting_of(scene), given_of(scene)
    starts = [f"{input_variable(source.name, 'value')} = {source.start:g}" for source in sources]
    if not (actions or starts):
        what, remedy = "nothing loads or moves a body in this FMU: every result is zero", "add a [load] to the scene"
        return [f"warning: {what}; {remedy}"]
    lines = []
    if starts:
        lines = [f"FMU inputs set by the importer, start values: {listed(starts)}"]
    if actions:
        free = [name for name, law in settable_of(scene).items() if not isinstance(law, InputLaw)]
        if free and not starts:
            more = f" (--inputs {free[0]} makes {free[0]} an input)"
        else:
            more = ""
        lines.append(f"acts in the FMU as in the scene: {listed(actions)}{more}")
    else:
        if any(source.start for source in sources):
            rest = ""
        else:
            rest = ": until an input is set the FMU stays at rest"
        lines.append(f"nothing else loads or moves a body{rest}")
    return lines


def _files(options: FmuOptions, scene: Scene, note: str) -> dict[str, bytes]:
    """Files of the FMU of a scene: one with Python, and a remark, where it cannot be compiled."""
    from importlib import import_module

    build, fmi = import_module("fmu_build.build"), options.fmi or "2"
    if not options.python:
        try:
            return dict[str, bytes](build.compiled_files(scene, fmi, note, options.portable))
        except NeedsPythonError as error:
            if options.portable or options.modes is not None:
                raise
            why = "; ".join(map(str, error.problems))
            say(f"latin-fmu: warning: this FMU needs Python at run time, as with --python: {why}")
    return dict[str, bytes](build.fmu_files(scene, fmi))


def _foreseen(scene: Scene) -> str:
    """What the matrices of a scene will take in a compiled FMU, in words; empty where that is little."""
    from ..building import discretise
    from ..cosim.output_table import marched_by_modes
    from ..effects.cost import Prediction, amount

    if marched_by_modes(scene):
        return ""
    prediction = Prediction(discretise(scene))
    if prediction.memory < _LARGE:
        return ""
    remedy = "--modes 20 exports a small FMU with reduced bodies and prints its error"
    if prediction.tries_modes:
        remedy = "--set solver.propagator=modal exports a small FMU of the modes of the assembly"
    return (
        f"the matrices of this scene need about {amount(prediction.memory)} in the FMU and in the memory of the "
        f"importer, and {prediction.operators:.2g} s to compute; {remedy}"
    )


def _reduced(options: FmuOptions, inputs: Any, names: Sequence[str]) -> tuple[Any, str, list[str]]:
    """The inputs of the scene with its bodies reduced to ``--modes``, a note on the error for its documentation, and
    the error in words."""
    from importlib import import_module

    from ..reader import load_scene

    checks = import_module("fmu_build.checks")
    setting = checks.SETTING.format(options.modes)
    reduced = checks.with_inputs(load_scene(options.scene, [*options.overrides, setting]), names)
    errors = checks.reduction_errors(inputs, reduced)
    lines = [
        "the error of the reduced bodies is unknown: no load acts (--inputs NAME keeps the law of a load for this)"
    ]
    if errors:
        lines = [f"{options.modes} modes a body, under the laws of the scene:", *(f"  {error}" for error in errors)]
    return reduced, checks.reduction_note(options.modes, errors), lines


def _contradictions(options: FmuOptions) -> Iterator[Problem]:
    if options.model_exchange and options.fmi == "2":
        yield Problem("--fmi", "model exchange needs FMI 3", "2", "3", "leave --fmi out")
    if options.model_exchange and options.reference == "whole":
        yield Problem("--reference", "belongs to co-simulation", remedy="leave --model-exchange out")
    for name in ("python", "portable"):
        if options.model_exchange and getattr(options, name):
            yield Problem(f"--{name}", "belongs to co-simulation", remedy="leave --model-exchange out")
    if options.python and options.portable:
        yield Problem("--portable", "is a kind of compiled FMU", remedy="omit --python")
    if options.python and options.modes is not None:
        remedy = "omit --python, or set solver.propagator={type='reduced',modes=N}"
        yield Problem("--modes", "belongs to the compiled FMU", remedy=remedy)
    if options.patches is not None and not options.model_exchange:
        yield Problem("--patches", "belongs to the reduced model", remedy="add --model-exchange")
    if not options.model_exchange and options.modes is not None and options.modes < 1:
        yield Problem("--modes", "too few modes", str(options.modes), "1 or more")


@dataclass(frozen=True, kw_only=True)
class SimulateOptions:
    """Options of ``simulate``."""

    fmu: Annotated[Path, Argument("FMU for co-simulation, or for model exchange (by CVode)", "X.fmu")]
    input: Annotated[Path | None, Option("inputs over time", "IN.csv")] = None
    output: Annotated[Path, Option("outputs at every step", "OUT.csv", "-o", output_file)] = Path("out.csv")
    step: Annotated[float | None, Option("communication step, s (default: that of the FMU)", "H")] = None
    stop: Annotated[float | None, Option("end, s (default: that of the FMU)", "T")] = None
    start: Annotated[tuple[str, ...], Option("start value of an input or parameter; repeatable", "NAME=VALUE")] = ()
    max_cpu: Annotated[
        float | None,
        Option(
            "limit in CPU seconds of the simulation; it then stops before the next step (exit code "
            f"{LIMITED}): the rows so far are written",
            "SECONDS",
            read=seconds,
        ),
    ] = None
    quiet: Annotated[bool, Option("no progress and no summary", flags="-q")] = False


@command(_RUN_EXAMPLES)
def simulate(options: SimulateOptions) -> int:
    """Run an FMU with fmpy."""
    begin = time.process_time()
    try:
        from fmu_build.drive import opened
    except ModuleNotFoundError as error:
        say(f"latin-fmu: {error.msg}; {_NEEDED}")
        return BAD_INPUT
    from ..results.writing import check_target

    target = options.output
    check_target(target)
    inputs = None
    if options.input is not None:
        inputs = read_columns(options.input)
    drive = opened(options.fmu, dict(_pair(text) for text in options.start), inputs)
    # 0 and none: that of the FMU
    step, stop = options.step or drive.step_size, options.stop or drive.stop_time
    if inputs is not None and not (inputs["time"][0] < stop and inputs["time"][-1] >= 0.0):
        if inputs["time"][0] >= stop:
            which, ends = "first", "begins after"
        else:
            which, ends = "last", "ends before"
        what = f"the table of inputs {ends} the simulation, from 0 to {stop:g} s: its {which} values are kept constant"
        say(f"latin-fmu: warning: {what}; check that its times are in s")
    rows: list[Sequence[float]] = []
    limited = False

    def over() -> bool:
        nonlocal limited
        # from the start of the command, its imports included
        limited |= options.max_cpu is not None and time.process_time() >= options.max_cpu + begin
        return limited

    try:
        with Waiting("simulation", quiet=options.quiet) as waiting:
            for row in drive.run(step, stop, over):
                rows.append(row)
                waiting.reached(min(row[0] / stop, 1.0), f"simulation, {100 * row[0] / stop:.0f} %")
    finally:
        drive.close()
    write_csv(target, ["time", *drive.outputs], rows)
    if not options.quiet:
        for text in dict.fromkeys(drive.warnings):
            say(f"latin-fmu: warning of the FMU: {text}")
        print(f"{len(rows)} rows: {target}")
    if rows:
        reached = rows[-1][0]
    else:
        reached = 0.0
    if drive.complaint:
        say(f"latin-fmu: stopped at {reached:g} s: {drive.complaint}")
        return SOLVER_FAILED
    if limited and reached < stop:
        what = f"stopped by its limit of {options.max_cpu:g} s of CPU time at t = {reached:g} s of {stop:g} s"
        say(f"latin-fmu: {what}; the rows so far are written")
        return LIMITED
    return CONVERGED


def write_csv(path: Path, names: Sequence[str], rows: Sequence[Sequence[float]]) -> None:
    """Write a table of numbers, to the last bit."""
    from ..results.writing import write_bytes

    text = io.StringIO()
    table = csv.writer(text)
    table.writerow(names)
    # shortest text that is read back as the same number
    table.writerows([[repr(float(value)) for value in row] for row in rows])
    write_bytes(path, text.getvalue().encode())


def _pair(text: str) -> tuple[str, Any]:
    name, equals, value = text.partition("=")
    if not equals:
        raise InputError([Problem("--start", "not NAME=VALUE", text, "for example load.press.value=0.5")])
    try:
        return name.strip(), float(value)
    except ValueError:
        return name.strip(), value


def read_columns(path: Path) -> dict[str, list[float]]:
    """Columns of a CSV file by name; ``time`` among them.

    Raises InputError where it cannot be read, holds no finite numbers, or has no increasing times.
    """
    problem = Problem(str(path), "not a table of numbers", None, "a header, then one row per time")
    try:
        if not path.is_file():
            what = "not a regular file"
            if not path.exists():
                what = "no such file"
            problem = Problem(str(path), what)
            raise ValueError
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = [row for row in csv.reader(file) if row]
        names = [name.strip() for name in rows[0]]
        columns = {name: [float(row[i]) for row in rows[1:]] for i, name in enumerate(names)}
    except (OSError, ValueError, IndexError, csv.Error):  # of the text nothing is quoted
        raise InputError([problem], "the inputs cannot be read") from None
    for name, column in columns.items():
        for value in column:
            if not math.isfinite(value):
                problem = Problem(
                    str(path), f"no finite number in column {name}", f"{value:g}", remedy="remove the row"
                )
                raise InputError([problem], "the inputs cannot be read")
    times = columns.get("time", [])
    if len(times) < 1 or any(b <= a for a, b in pairwise(times)):
        problem = Problem(str(path), "needs a column 'time' that increases strictly")
        raise InputError([problem], "the inputs cannot be read")
    return columns
