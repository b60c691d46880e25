"""Subcommands that solve nothing: ``check``, ``explain``, ``plot``, ``view``, ``reference`` and ``demo``."""

from __future__ import annotations

import json
import os
import re
import shutil
import time
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal

from ..errors import InputError, Problem, ResultsError, did_you_mean, listed
from . import CONVERGED, LIMITED, REMARKED, Json, OfScene, Strict, Waiting, output_file, say, seconds, tell
from .options import Argument, Option, command

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..effects.explanation import Explanation
    from ..scene.schema import Scene


@dataclass(frozen=True, kw_only=True)
class PlotOptions:
    """Options of ``plot``."""

    file: Annotated[Path, Argument("scene (.toml), or file written by run or sweep (.nc)", "FILE")]
    output: Annotated[
        Path | None,
        Option(
            "png, pdf or svg; gif: a film of the bodies, or of maps (default: beside the file, as png)",
            "FIGURE",
            "-o",
            output_file,
        ),
    ] = None
    overrides: Annotated[
        tuple[str, ...], Option("of a scene: change one setting; may be repeated", "a.b.c=value", "--set")
    ] = ()
    bodies: Annotated[
        bool, Option("of a results file: deformed bodies and the pressure on an interface (needs output.fields = true)")
    ] = False
    details: Annotated[bool, Option("of a results file: also the convergence of its iteration")] = False
    quantity: Annotated[
        tuple[str, ...], Option("of a study or a random vibration: draw this quantity; may be repeated", "NAME")
    ] = ()
    tornado: Annotated[
        bool, Option("of a results file: changes of its quantities by parameters (output.sensitivities)")
    ] = False
    bands: Annotated[bool, Option("of results with a table [spread]: histories and spectra with their bands")] = False
    map: Annotated[bool, Option("of a results file: pressure, friction and contact states of an interface")] = False
    interface: Annotated[
        str | None, Option("with --bodies or --map: the interface (default: largest force)", "NAME")
    ] = None
    time: Annotated[float | None, Option("with --bodies or --map: the instant (default: largest force)", "S")] = None
    magnify: Annotated[float | None, Option("with --bodies: factor on the displacements", "X")] = None
    stress: Annotated[
        Literal["von_mises", "principal"] | None,
        Option(
            "with --bodies: colour them by a stress at the nodes, von_mises where none is named (needs "
            "output.nodal_stress = true)",
            const="von_mises",
        ),
    ] = None
    first: Annotated[float | None, Option("of a film: its first instant", "S", "--from")] = None
    last: Annotated[float | None, Option("of a film: its last instant", "S", "--to")] = None
    frames: Annotated[int | None, Option("of a film: number of pictures (default: 40)", "N")] = None


@command()
def check(of: OfScene, strict: Strict = False, json: Json = False) -> int:
    """Read a scene, build its meshes and interfaces, print sizes and warnings."""
    from .. import api

    with Waiting("check"):
        found = api.checked(of.read_scene())
    tell(json, found.text(), found.report)
    if strict and found.remarks:
        return REMARKED
    return CONVERGED


_FMU_MODES: Final = 0  # of --fmu without a number: all of them


@command()
def explain(
    of: OfScene,
    strict: Strict = False,
    json: Json = False,
    run: Annotated[
        bool,
        Option(
            "also solve the scene coarsely and print what matters in it, then with one effect changed at a time: what "
            "each costs and changes (the time of 40 runs and 20 s at most)"
        ),
    ] = False,
    max_cpu: Annotated[
        float | None,
        Option(
            "with --run: limit in CPU seconds of all runs; if it is reached the command stops (exit code "
            f"{LIMITED}), what is found until then is printed and marked",
            "SECONDS",
            read=seconds,
        ),
    ] = None,
    figure: Annotated[
        Path | None,
        Option("with --run: also draw what effects cost and change (png, pdf or svg)", "FIGURE", read=output_file),
    ] = None,
    fmu: Annotated[
        int | None,
        Option(
            "also print the size of a compiled FMU of the scene; with N: of one whose bodies are reduced to N modes",
            "N",
            const=_FMU_MODES,
        ),
    ] = None,
) -> int:
    """Print which effects a scene has, why, what each costs and which key switches it."""
    from ..effects.explanation import explain

    if max_cpu is not None and not run:
        raise InputError.of("bad argument", "--max-cpu", "has no effect without --run", remedy="add --run")
    if figure is not None:
        _check_effects_figure(figure, run)
    scene = of.read_scene()
    with Waiting("prediction of the cost"):
        explanation = explain(scene, of.scene.read_text(encoding="utf-8-sig"))
    report = explanation.report()
    text = explanation.text()
    limited = False
    if run:
        added, lines, limited = _effects_in_runs(scene, explanation, max_cpu, figure)
        report, text = report | added, f"{text}\n\n{lines}"
    if fmu is not None:
        with Waiting("size of the compiled FMU"):
            size = _compiled_size(of, fmu)
        report, text = report | {"compiled_fmu_bytes": size}, f"{text}\n\nCompiled FMU: {size / 1e6:.2g} MB"
    tell(json, [text], lambda: report)
    if limited:
        return LIMITED
    if strict and explanation.warnings:
        return REMARKED
    return CONVERGED


def _check_effects_figure(figure: Path, run: bool) -> None:
    """Make sure that a figure of effects is asked for with what it shows, and can be written."""
    from ..pictures.style import check_figure_path
    from ..results.writing import check_target

    if not run:
        raise InputError.of("bad argument", "--figure", "has nothing to draw without --run", remedy="add --run")
    check_figure_path(figure)
    check_target(figure)


def _effects_in_runs(
    scene: Scene, explanation: Explanation, max_cpu: float | None, figure: Path | None
) -> tuple[dict[str, object], str, bool]:
    """What a coarse run finds, and what effects cost and change, as plain data and as text; whether the limit of CPU
    time (s) ended it. ``figure`` : of that."""
    from ..accuracy.coarse_effects import coarse_run
    from ..accuracy.measured_effects import measured_effects

    begin = time.process_time()
    with Waiting("coarse run"):
        coarse = coarse_run(scene, max_cpu)
    report: dict[str, object] = {"coarse_run": coarse.report()}
    if not coarse.converged:
        return report, coarse.text(), bool(coarse.interrupted)
    settings = [suggestion.settings for suggestion in explanation.suggestions if suggestion.settings]
    seconds = explanation.prediction["cpu_seconds_set_up"] + explanation.prediction["cpu_seconds_instants"]
    budget = None
    if max_cpu is not None:
        budget = max(max_cpu - (time.process_time() - begin), 0.0)
    with Waiting("runs with one effect changed at a time") as waiting:
        measured = measured_effects(scene, settings, seconds, budget, waiting.reached)
    text = f"{coarse.text()}\n\n{measured.text()}"
    if figure is not None:
        from ..accuracy.effects_figure import effects_figure
        from ..pictures.style import save_figure

        try:
            save_figure(effects_figure(measured, scene.name), figure)
            text += f"\nfigure: {figure}"
        except ValueError as error:
            text += f"\nno figure: {error}"
    return report | {"measured_effects": measured.report()}, text, measured.limited


def _compiled_size(of: OfScene, modes: int) -> int:
    """Bytes of the compiled FMU of a scene; ``modes`` of its bodies, 0: all of them."""
    from importlib import import_module

    from ..reader import load_scene

    if modes < 0:
        raise InputError([Problem("--fmu", "too few modes", str(modes), "1 or more; nothing for all dofs")])
    checks = import_module("fmu_build.checks")
    settings = []
    if modes:
        settings = [checks.SETTING.format(modes)]
    size: int = checks.compiled_size(load_scene(of.scene, [*of.overrides, *settings]))
    return size


@command()
def plot(options: PlotOptions) -> int:
    """Draw the assembly of a scene; forces, sensors and bolts of a results file, or its bodies; a study."""
    from ..pictures.result_picture import FILM
    from ..pictures.style import FORMATS, check_figure_path, save_figure
    from ..results.writing import check_target

    target = options.output or options.file.with_suffix(".png")
    if _is_scene(options.file):
        check_figure_path(target, FORMATS)
    else:
        check_figure_path(target, (*FORMATS, FILM))
    check_target(target)
    _check_options(options, target.suffix.lower() == FILM)
    with Waiting("figure") as waiting:
        if target.suffix.lower() == FILM:
            _film(options, target, waiting)
        elif _is_scene(options.file):
            save_figure(_scene_figure(options), target)
        else:
            save_figure(_results_figure(options), target)
    print(f"figure: {target}")
    return CONVERGED


def _film(options: PlotOptions, target: Path, waiting: Waiting) -> None:
    from ..pictures.body_fields import Look
    from ..pictures.result_picture import Window, save_film
    from ..results.files import open_results, readable

    window = Window(options.first, options.last, options.frames or Window.frames)
    waiting.reached(0.0, "film")
    with closing(open_results(options.file)) as tree, readable(options.file):
        look = Look(options.interface, options.magnify, options.stress)
        save_film(tree, target, window, look, options.map, waiting.reached)


_VIEW_EXAMPLES = """\
examples:
  latin-fmu run scene.toml -o out.nc --set output.fields=true --set output.surfaces=true
  latin-fmu view out.nc
"""
_PAGES: Final = (".html", ".htm")


@command(_VIEW_EXAMPLES)
def view(
    file: Annotated[Path, Argument("results file of a run with output.fields = true", "OUT.nc")],
    output: Annotated[Path | None, Option("default: beside the file, as html", "PAGE.html", "-o", output_file)] = None,
    first: Annotated[float | None, Option("first instant (default: the first one stored)", "S", "--from")] = None,
    last: Annotated[float | None, Option("last instant (default: the last one stored)", "S", "--to")] = None,
    frames: Annotated[
        int | None, Option("number of instants (default: up to 400, as many as fit into 20 MB)", "N")
    ] = None,
) -> int:
    """Write a results file as one HTML page: bodies that deform, fields of the interfaces, curves over time."""
    from ..pictures.viewer import page
    from ..results.files import open_results, readable
    from ..results.writing import check_target, write_bytes

    target = output or file.with_suffix(".html")
    if target.suffix.lower() not in _PAGES:
        raise InputError.of("bad argument", "--output", "a page is written as HTML", str(target), ", ".join(_PAGES))
    check_target(target)
    if problems := _window_problems(first, last, frames):
        raise ResultsError(problems, "the page cannot be made")
    with Waiting("page"), closing(open_results(file)) as tree, readable(file):
        html = page(tree, first, last, frames)
    print(f"page: {write_bytes(target, html.encode())}")
    return CONVERGED


def _window_problems(first: float | None, last: float | None, frames: int | None) -> list[Problem]:
    """Numbers of a window of time that are out of range."""
    problems = []
    if frames is not None and not 2 <= frames <= 1000:
        problems.append(Problem("--frames", "out of range", str(frames), "2 to 1000"))
    problems += [
        Problem(f"--{key}", "out of range", str(value), "a number >= 0 [s]")
        for key, value in (("from", first), ("to", last))
        if value is not None and not value >= 0.0
    ]
    return problems


def _is_scene(file: Path) -> bool:
    return file.suffix.lower() == ".toml"


def _scene_figure(options: PlotOptions) -> Figure:
    from ..pictures.assembly_picture import assembly_figure
    from ..reader import load_scene

    warnings: list[str] = []
    figure = assembly_figure(load_scene(options.file, options.overrides), warnings)
    for warning in warnings:
        say(f"warning: {warning}")
    return figure


def _results_figure(options: PlotOptions) -> Figure:
    from ..pictures.body_fields import Look
    from ..pictures.result_picture import map_figure, result_figure
    from ..pictures.sensitivity_picture import bands_figure, tornado_figure
    from ..pictures.summary_picture import spectra_figure, summary_figure
    from ..results.files import open_results, readable
    from ..results.groups import units_of
    from ..results.spectra import shock_axis, stored_spectra

    with closing(open_results(options.file)) as tree, readable(options.file):
        if "signals" in tree.children:
            from ..parametric.random_figure import random_figure

            return random_figure(tree, options.quantity)
        if "kind" in tree.attrs and "spread" not in tree.children:  # a parametric study
            from ..parametric.figure import study_figure

            return study_figure(tree.to_dataset(), list(options.quantity) or None)
        if options.map:
            return map_figure(tree, options.interface, options.time)
        if options.tornado:
            return tornado_figure(tree)
        if options.bands or "kind" in tree.attrs:
            return bands_figure(tree)
        if options.bodies:
            return result_figure(tree, options.time, Look(options.interface, options.magnify, options.stress))
        if "interfaces" not in tree.children and (spectra := stored_spectra(tree)):
            return spectra_figure(spectra, units=units_of(tree.attrs), shock=shock_axis(tree))
        return summary_figure(tree, options.details)


def _check_options(options: PlotOptions, film: bool) -> None:
    """Options that the file cannot have are refused, all at once.

    Raises
    ------
    ResultsError : options of a scene with results, of one kind of figure with another, numbers out of range.
    """
    problems: list[Problem] = []
    scene, bodies = _is_scene(options.file), options.bodies or (film and not options.map)
    problems += [
        Problem(f"--{key}", "this figure is one of results, and no film")
        for key in ("tornado", "bands")
        if getattr(options, key) and (scene or film)
    ]
    if options.overrides and not scene:
        problems.append(Problem("--set", "the settings of results cannot be changed", allowed="a scene (.toml)"))
    of_bodies = {
        "interface": bodies or options.map,
        "time": options.bodies or options.map,
        "magnify": bodies,
        "stress": bodies,
    }
    problems += [
        Problem(f"--{key}", "this option is for the figure of bodies or of a map", remedy="add --bodies or --map")
        for key, fits in of_bodies.items()
        if getattr(options, key) is not None and not fits
    ]
    problems += [
        Problem(f"--{key}", "this option is for a film", remedy="name a file that ends in .gif")
        for key, value in (("from", options.first), ("to", options.last), ("frames", options.frames))
        if value is not None and not film
    ]
    problems += [
        Problem(f"--{key}", "a scene has no results", remedy="omit it, or name a results file")
        for key in ("bodies", "map", "details")
        if getattr(options, key) and scene
    ]
    if options.bodies and options.map:
        problems.append(Problem("--map", "one figure at a time", remedy="omit --bodies or --map"))
    if options.details and (options.bodies or options.map):
        problems.append(Problem("--details", "this option is for the figure of the run", remedy="omit it"))
    if film and options.time is not None:
        problems.append(Problem("--time", "a film has a window of time", remedy="give --from and --to"))
    if options.magnify is not None and not 0.0 <= options.magnify < float("inf"):
        problems.append(Problem("--magnify", "out of range", str(options.magnify), "a number >= 0"))
    if options.time is not None and not options.time >= 0.0:
        problems.append(Problem("--time", "out of range", str(options.time), "a number >= 0 [s]"))
    problems += _window_problems(options.first, options.last, options.frames)
    if problems:
        raise ResultsError(problems, "the figure cannot be drawn")


@command()
def reference(schema: Annotated[bool, Option("print the JSON schema instead")] = False) -> int:
    """Print every key of a scene file, with units and defaults."""
    from ..scene.reference import reference_schema, reference_text

    if schema:
        print(json.dumps(reference_schema(), indent=2))
    else:
        print(reference_text())
    return CONVERGED


_DEMO_EXAMPLES = """\
examples:
  latin-fmu demo                    the models, one a line
  latin-fmu demo hammer_on_plate    copies the folder, and prints the commands that solve and draw it
"""
_ROW: Final = re.compile(r"\| \[`(\w+)`\]\(\w+/README\.md\) \| (.+?) \| (.+?) \| (.+?) \|")
_UNAVAILABLE: Final = "../../"  # links of a README to files that are not copied
_HEADING: Final = "the model cannot be copied"


@dataclass(frozen=True)
class _ModelRow:
    """A row of the table of models.

    Attributes
    ----------
    name : of the folder. shows : what it is for. size : nodes and time steps of its first scene. cpu : time of a run.
    """

    name: str
    shows: str
    size: str
    cpu: str


@command(_DEMO_EXAMPLES)
def demo(name: Annotated[str | None, Argument("model to copy into the current folder", "NAME")] = None) -> int:
    """List the models that come with the package, or copy one."""
    folder = models_folder()
    if name is None:
        lines = _list(_models(folder))
    else:
        lines = _copy(folder, name)
    print("\n".join(lines))
    return CONVERGED


def models_folder() -> Path:
    """Folder of the models: inside the installed package, beside the package in a source tree.

    Raises
    ------
    InputError : the installation has none.
    """
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "models", package.parent / "models"):
        if (folder / "README.md").is_file():
            return folder
    what, remedy = "this installation of latin-fmu has no models", "install it from a wheel or from its repository"
    raise InputError.of(_HEADING, str(package / "models"), what, remedy=remedy)


def _models(folder: Path) -> list[_ModelRow]:
    """Rows of the table in the README of the models."""
    rows = map(_ROW.fullmatch, (folder / "README.md").read_text(encoding="utf-8").splitlines())
    return [_ModelRow(*row.groups()) for row in rows if row is not None]


def _list(models: list[_ModelRow]) -> list[str]:
    """Table of the models, and how to copy one."""
    from ..scene.readable_numbers import aligned

    rows = [("model", "nodes, steps", "CPU"), *((m.name, m.size, m.cpu) for m in models)]
    texts = ("shows", *(m.shows for m in models))
    table = [f"{line}  {text}" for line, text in zip(aligned(rows), texts, strict=True)]
    return [*table, "", "copy one into the current folder: latin-fmu demo NAME"]


def _copy(folder: Path, name: str) -> list[str]:
    """Copy a model into the current folder, whole or not at all; the text on what to do next.

    Raises
    ------
    InputError : there is no such model, or its place is taken. ResultsError : the place cannot be written to.
    """
    from ..results.writing import check_folder, write_whole

    names = [model.name for model in _models(folder)]
    if name not in names:
        raise InputError.of(_HEADING, "NAME", "no model of this name", name, listed(names), did_you_mean(name, names))

    def check(path: str | Path) -> Path:
        target = Path(path)
        if os.path.lexists(target):
            what, remedy = "this file or folder already exists", "remove or rename it, or change to another folder"
            raise InputError.of(_HEADING, str(target), what, remedy=remedy)
        check_folder(target.absolute().parent)
        return target

    target = check(name)
    write_whole(target, lambda draft: _fill(draft, folder / name), check, rescue=False)
    scenes = sorted(target.glob("*.toml"), key=lambda path: (path.stem != "scene", path.stem))
    others = []
    if scenes[1:]:
        others = [f"other scenes: {', '.join(map(str, scenes[1:]))}"]
    return [
        f"copied to {target}{os.sep}: {', '.join(sorted(path.name for path in target.iterdir()))}",
        *others,
        "next:",
        f"  latin-fmu run {scenes[0]} -o {name}.nc",
        f"  latin-fmu plot {name}.nc -o {name}.png",
    ]


def _fill(draft: Path, source: Path) -> None:
    """Copy the files of a model; its README names the paths of the copy."""
    draft.mkdir()
    for file in sorted(path for path in source.iterdir() if path.is_file()):
        if file.suffix == ".md":
            lines = file.read_text(encoding="utf-8").replace(f"models/{source.name}/", f"{source.name}/").splitlines()
            rest = (line for line in lines if _UNAVAILABLE not in line)
            (draft / file.name).write_text("\n".join(rest) + "\n", encoding="utf-8")
        else:
            shutil.copyfile(file, draft / file.name)
