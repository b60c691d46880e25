"""Subcommands ``srs`` and ``export``, spectra and histories of the sensors of a results file, ``modes``, natural
frequencies of an assembly, ``frf``, its frequency responses, and ``backbone``, frequency and damping of a mode against
the amplitude."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ..errors import InputError, Problem, ResultsError, did_you_mean, listed
from . import (
    CONVERGED,
    AddParser,
    Waiting,
    add_json,
    add_scene,
    check_netcdf,
    declare,
    option,
    output_file,
    read_scene,
    switch,
    tell,
    tell_written,
)

if TYPE_CHECKING:
    import xarray as xr

    from ..latin.outcome import Array
    from ..results.spectra import ShockSpectrum
    from ..scene.sensors import Spectrum
    from ..scene.units import UnitSystem

_EXAMPLES = """\
examples:
  latin-fmu srs out.nc
  latin-fmu srs out.nc --sensor tip --quality 25 --lowest 100 --highest 20000 --per-octave 24 -o tip
  latin-fmu srs pulse.csv --value-unit g --column "Z (g)"

A file of a recorder (text, universal file) is read as the law of a load is, and interpolated in its band; accelerations
are in m/s2. Histories of a run are straight lines between their instants.

Writes STEM.csv, STEM.nc and, of results, STEM.png. Without options the spectra that the scene requests
(sensor.NAME.spectrum) are taken, with their estimated error where the run has one.
"""
_EXPORT_EXAMPLES = """\
examples:
  latin-fmu export out.nc
  latin-fmu export out.nc --sensor tip --g -o tip

Writes STEM.csv, a row for each instant and columns for displacement, velocity and acceleration of every sensor, and
STEM.unv, a universal file (dataset 58) with these and the stored spectra in SI for the software of test laboratories.
"""
_MODES_EXAMPLES = """\
examples:
  latin-fmu modes scene.toml
  latin-fmu modes scene.toml --joints open --count 20 -o modes.nc --vtk shapes

Joints of interfaces that may open: sticking joins points that are closed at the start (along the face, too, where
there is friction), open joins none, bonded joins all. In a scene with bolts or a static start, sticking joins the
points that these press, and open leaves the shanks free to slide. Perfect interfaces and couplings are always joined,
elastic layers and springs have their stiffness; damping, viscous joints, absorbing boundaries and loads are left out,
driven faces are held.

The table has the effective mass of each mode for a base that moves along x, y or z, in % of the mass of the assembly,
and the damping ratio, in % of critical, that a run of the scene gives each mode: of the time scheme with the
step of the scene, of the viscous layer at faces that may open (landing_damping), and of Rayleigh damping, dampers,
viscous joints, absorbing faces and wave ports where the scene has some. A line says what lowers the first two where
they exceed 0.005 %.
"""
_BACKBONE_EXAMPLES = """\
examples:
  latin-fmu backbone scene.toml --mode 1 --amplitude 1um:1mm
  latin-fmu backbone scene.toml --amplitude 5um:0.1mm --points 12 --sensor tip --measured test.csv --measured-units um %

Bolts are tightened, then the assembly is loaded without inertia along a mode, to and fro, from the largest amplitude
down; modes count from the first elastic one. Frequency is that of the secant of a loop, damping that of the work of
friction. Loops: half (+ to -, twice the loss: joints that are alike for both signs), full (any joint), masing (one way
from 0, four times the loss: joints where nothing slid before and no point opens or closes).

Writes STEM.csv, STEM.nc and STEM.png. Measured points are the first three columns of a file: amplitude of the sensor,
frequency in Hz, damping ratio.
"""
_FRF_EXAMPLES = """\
examples:
  latin-fmu frf scene.toml --damping 0.02
  latin-fmu frf scene.toml --drive tip.z --drive shock --kind receptance --highest 5000 -o tip

The assembly is linear: its joints sticking, open or bonded, as for modes. A drive is base.x, base.y or base.z
(everything that holds the assembly moves along an axis: transmissibility), SENSOR.x, SENSOR.y or SENSOR.z (a unit force
there) or a load of the scene, scaled to a resultant of 1. Without --drive the base moves along each axis.

Modes up to 1.5 times the highest frequency are taken, and the static response to each drive stands for the others.
Damping is a ratio of critical of all modes (--damping 0.02), one of each (--damping 0.01,0.02, the last one for the
rest), or what the scene has: Rayleigh damping, dampers, viscous joints, absorbing faces. Friction is not in it.

Writes STEM.csv, STEM.nc and STEM.png.
"""
_MOST_MODES, _MOST_POINTS = 1000, 200
_OPTIONS = ("lowest", "highest", "per_octave", "quality")


def register(add: AddParser) -> None:
    """Declare the five subcommands."""
    _register_modes(add)
    _register_frf(add)
    _register_backbone(add)
    text = "write the motions of the sensors of a results file as a table and as a universal file (UNV 58)"
    parser = declare(add, "export", text, _export, _EXPORT_EXAMPLES)
    _add_sensors(parser)
    option(parser, "-o --output", "STEM", "default: RESULT_sensors beside the results", Path)
    text = "make shock response spectra of the sensors of a results file, or of a measured record"
    parser = declare(add, "srs", text, _srs, _EXAMPLES)
    _add_sensors(parser)
    option(parser, "--value-unit", "UNIT", "of a record: unit of its values (g, m/s2), or the factor to m/s2")
    option(parser, "--time-unit", "UNIT", "of a record: unit of its times (default: that of the header, else s)")
    option(parser, "--column", "NAME", "of a record: name or number of the column of its values")
    option(parser, "--time-column", "NAME", "of a record: name or number of the column of its times")
    parser.add_argument("--gaps", choices=("refused", "linear"), help="of a record: where samples are missing")
    option(parser, "--lowest", "HZ", "first frequency (default: 1 / duration)", float)
    option(parser, "--highest", "HZ", "last frequency (default: sampling rate / 10)", float)
    option(parser, "--per-octave", "N", "frequencies per octave (default: 12)", int)
    option(parser, "--quality", "Q", "amplification of the oscillators (default: 10)", float)
    parser.add_argument("--along", choices=("x", "y", "z"), help="axis in the figure (default: that of the largest)")
    add_json(parser)
    option(parser, "-o --output", "STEM", "default: RESULT_srs beside the results", Path)


def _targets(stem: Path, *suffixes: str) -> list[Path]:
    """Files of a stem with these suffixes, which can be written; the stem may have one of them itself."""
    from ..results.writing import check_target

    # not ``with_suffix``: a stem may have dots
    name = next(
        (stem.name.removesuffix(end) for end in (f".{s}" for s in suffixes) if stem.name.endswith(end)), stem.name
    )
    targets = [stem.with_name(f"{name}.{suffix}") for suffix in suffixes]
    for target in targets:
        check_target(target)
    return targets


def _add_sensors(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("results", metavar="RESULT.nc", type=Path, help="results file written by run")
    option(parser, "--sensor", "NAME", "sensor, repeatable (default: every one)", action="append", default=[])
    switch(parser, "--g", "accelerations of texts, tables and figures in g, 9.80665 m/s2")


def _register_modes(add: AddParser) -> None:
    text = "print natural frequencies of the assembly of a scene and their damping in a run, and write its shapes"
    add_scene(parser := declare(add, "modes", text, _modes, _MODES_EXAMPLES))
    joints = ("sticking", "open", "bonded")
    parser.add_argument("--joints", choices=joints, default=joints[0], help="default: sticking")
    option(parser, "--count", "N", "elastic modes (default: 10)", int, default=10)
    add_json(parser)
    option(parser, "-o --output", "MODES.nc", "also write frequencies and shapes", output_file)
    option(parser, "--vtk", "FOLDER", "also write files for ParaView to this folder", Path)


def _register_frf(add: AddParser) -> None:
    text = "make frequency responses of the clamped assembly to its base or to forces: table, dataset and figure"
    add_scene(parser := declare(add, "frf", text, _frf, _FRF_EXAMPLES))
    text = "base.x, SENSOR.x or a load, repeatable (default: base along each axis)"
    option(parser, "--drive", "NAME", text, action="append", default=[])
    option(
        parser, "--sensor", "NAME", "where the motion is taken, repeatable (default: all)", action="append", default=[]
    )
    option(parser, "--damping", "R[,R..]", "ratio to critical of the modes (default: damping of the scene)", _ratios)
    kinds = ("receptance", "mobility", "accelerance")
    parser.add_argument("--kind", choices=kinds, default="accelerance", help="per force (default: accelerance)")
    parser.add_argument(
        "--joints", choices=("sticking", "open", "bonded"), default="sticking", help="default: sticking"
    )
    option(parser, "--lowest", "HZ", "first frequency (default: a tenth of the first natural one)", float)
    option(parser, "--highest", "HZ", "last frequency (default: that of the tenth mode)", float)
    option(parser, "--points", "N", "frequencies, by equal factors; more at peaks (default: 400)", int, default=400)
    parser.add_argument("--along", choices=("x", "y", "z"), help="axis in the figure (default: that of the largest)")
    add_json(parser)
    option(parser, "-o --output", "STEM", "default: SCENE_frf in the current folder", Path)


def _ratios(text: str) -> list[float]:
    """Damping ratios, separated by commas.

    Raises
    ------
    argparse.ArgumentTypeError : they are no numbers.
    """
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no ratio, or ratios separated by commas") from None


def _frf(arguments: argparse.Namespace) -> int:
    from ..modal.frequency_response import frf
    from ..pictures.response_picture import response_figure
    from ..pictures.style import save_figure
    from ..results.writing import write_bytes

    scene = read_scene(arguments)
    targets = _targets(arguments.output or Path(f"{scene.name}_frf"), "csv", "nc", "png")
    given = {key: getattr(arguments, key) for key in ("damping", "kind", "joints", "lowest", "highest", "points")}
    with Waiting("modes"):
        made = frf(scene, arguments.drive, sensors=arguments.sensor, **given)
    tell(arguments, made.lines(), made.report)
    write_bytes(targets[0], made.as_csv().encode())
    made.save(targets[1])
    save_figure(response_figure(made, arguments.along), targets[2])
    tell_written(arguments, f"frequency responses: {', '.join(map(str, targets))}")
    return CONVERGED


def _register_backbone(add: AddParser) -> None:
    text = "make frequency and damping of a mode against its amplitude: table, dataset and figure"
    add_scene(parser := declare(add, "backbone", text, _backbone, _BACKBONE_EXAMPLES))
    option(parser, "--mode", "N", "number of the elastic mode, from 1 (default: 1)", int, default=1)
    option(parser, "--amplitude", "A[:B]", "smallest and largest amplitude, as 1um:0.1mm", required=True)
    option(parser, "--points", "N", "amplitudes from A to B, by equal factors (default: 10)", int, default=10)
    option(parser, "--sensor", "NAME", "whose amplitude is meant (default: of the point that moves most)")
    parser.add_argument("--loop", choices=("half", "full", "masing"), default="half", help="default: half")
    option(parser, "--increments", "N", "increments of load up to an amplitude (default: 2)", int, default=2)
    option(parser, "--tolerance", "T", "of the static iteration (default: 1e-9)", float, default=1e-9)
    add_json(parser)
    option(parser, "--measured", "FILE", "points to draw beside: amplitude, frequency, damping ratio", Path)
    text = "units of amplitude and damping in that file (default: those of the scene, 1)"
    parser.add_argument("--measured-units", nargs=2, metavar=("LENGTH", "RATIO"), help=text)
    option(parser, "-o --output", "STEM", "default: SCENE_backbone in the current folder", Path)


def _backbone(arguments: argparse.Namespace) -> int:
    import numpy as np

    from ..modal.backbone import backbone
    from ..pictures.backbone_picture import backbone_figure
    from ..pictures.style import save_figure
    from ..results.writing import write_bytes

    scene = read_scene(arguments)
    lowest, highest = _amplitudes(arguments.amplitude, scene.unit_system)
    if not 1 <= arguments.points <= _MOST_POINTS:
        problem = Problem("--points", "out of range", str(arguments.points), f"1 to {_MOST_POINTS}")
        raise InputError([problem], "bad argument")
    levels = np.geomspace(lowest, highest, arguments.points) if highest > lowest else np.array([highest])
    measured = _measured(arguments, scene.unit_system)
    targets = _targets(arguments.output or Path(f"{scene.name}_backbone"), "csv", "nc", "png")
    with Waiting("tightening") as waiting:
        made = backbone(
            scene,
            arguments.mode,
            levels,
            arguments.sensor,
            loop=arguments.loop,
            increments=arguments.increments,
            tolerance=arguments.tolerance,
            progress=lambda done, total, *_: waiting.reached((done + 1) / total, "loops"),
        )
    tell(arguments, made.lines(), made.groups()["/backbone"].report)
    write_bytes(targets[0], made.as_csv().encode())
    made.save(targets[1])
    save_figure(backbone_figure(made, measured), targets[2])
    tell_written(arguments, f"backbone: {', '.join(map(str, targets))}")
    return CONVERGED


def _amplitudes(text: str, units: UnitSystem) -> tuple[float, float]:
    """Smallest and largest amplitude in the units of the scene.

    Raises
    ------
    InputError : no lengths > 0, in the order of their size.
    """
    from ..scene.unit_texts import names_for, unit_size, value_and_unit

    sizes = []
    for part in text.split(":"):
        number, unit = value_and_unit(part) or (0, "")
        size = unit_size(unit, "m") if unit else units.exact_size("m")
        with suppress(OverflowError):
            sizes += [] if size is None else [float(number * size / units.exact_size("m"))]
    if len(sizes) != len(text.split(":")) or len(sizes) > 2 or not 0.0 < sizes[0] <= sizes[-1] < float("inf"):
        allowed = f"A or A:B, 0 < A <= B, numbers with one of {names_for('m')} or in the units of the scene"
        raise InputError([Problem("--amplitude", "no range of amplitudes", text, allowed)], "bad argument")
    return sizes[0], sizes[-1]


def _measured(arguments: argparse.Namespace, units: UnitSystem) -> Array | None:
    """Measured points (n, 3) in the units of the scene, None where none are given.

    Raises
    ------
    InputError : a file that is no table of numbers, or units that are not known.
    """
    import numpy as np
    from pydantic_core import PydanticCustomError

    from ..scene.number_files import factor, read_columns, unit_problem
    from ..scene.unit_texts import names_for

    if arguments.measured is None:
        return None
    length, ratio = arguments.measured_units or ("", "1")
    for name, unit in ((length, "m"), (ratio, "1")):
        if name and (what := unit_problem(name, unit)):
            raise InputError([Problem("--measured-units", what, name, names_for(unit))], "bad argument")
    try:
        table = np.array(read_columns(Path(), str(arguments.measured), [1, 2, 3]), dtype=float).reshape(-1, 3)
    except PydanticCustomError as error:
        said = error.context or {}
        value = None if said.get("value") is None else str(said["value"])
        problem = Problem("--measured", str(said.get("what", error)), value, said.get("allowed"), said.get("remedy"))
        raise InputError([problem], "bad argument") from None
    return table * [factor(length, units) if length else 1.0, 1.0, factor(ratio)]


def _modes(arguments: argparse.Namespace) -> int:
    from ..modal.modes import vibration_modes
    from ..results.vtk import check_export_folder
    from ..results.writing import check_target

    if not 1 <= arguments.count <= _MOST_MODES:
        problem = Problem("--count", "out of range", str(arguments.count), f"1 to {_MOST_MODES}")
        raise InputError([problem], "bad argument")
    if arguments.output is not None:
        check_netcdf(arguments.output)
        check_target(arguments.output)
    if arguments.vtk is not None:
        check_export_folder(arguments.vtk)
    with Waiting("natural frequencies"):
        modes = vibration_modes(read_scene(arguments), arguments.joints, arguments.count)
    tell(arguments, modes.lines(), modes.groups()["/modes"].report)
    if arguments.output is not None:
        modes.save(arguments.output)
        tell_written(arguments, f"modes: {arguments.output}")
    if arguments.vtk is not None:
        tell_written(arguments, f"for ParaView: {modes.export(arguments.vtk)}")
    return CONVERGED


def _srs(arguments: argparse.Namespace) -> int:
    from ..pictures.style import save_figure
    from ..pictures.summary_picture import spectra_figure
    from ..results.export import acceleration_unit
    from ..results.files import open_results, readable, write_netcdf
    from ..results.groups import in_units, units_of
    from ..results.sensors import spectrum_lines
    from ..results.spectra import as_csv, spectrum_group
    from ..results.writing import write_bytes

    stem = arguments.output or arguments.results.with_name(f"{arguments.results.stem}_srs")
    file = arguments.results
    if _is_record(file):
        return _srs_of_record(arguments, _targets(stem, "csv", "nc"))
    targets = _targets(stem, "csv", "nc", "png")
    with closing(open_results(file)) as tree, readable(file), Waiting("spectra") as waiting:
        spectra = dict(_spectra(tree, arguments, waiting))
        units = units_of(tree.attrs)
        in_g = acceleration_unit(units, arguments.g)
        units = units.with_g if arguments.g else units
        groups = in_units({name: spectrum_group(*pair) for name, pair in spectra.items()}, units)
        made = _tree(tree, {name: group.dataset() for name, group in groups.items()})
    lines = spectrum_lines({name: spectrum for name, (spectrum, _) in spectra.items()}, units)
    tell(arguments, lines, lambda: {name: group.report() for name, group in groups.items()})
    write_bytes(targets[0], as_csv([(name, spectrum) for name, (spectrum, _) in spectra.items()], units, in_g).encode())
    write_netcdf(made, targets[1])
    save_figure(spectra_figure(spectra, arguments.along, units), targets[2])
    tell_written(arguments, f"spectra: {', '.join(map(str, targets))}")
    return CONVERGED


_UNEVEN: Final = 0.05  # of an interval: round-off of times in a text
_RESULTS: Final = (b"CDF", b"\x89HDF")  # first bytes of netCDF files


def _is_record(file: Path) -> bool:
    """Whether a file holds something else than results."""
    try:
        with file.open("rb") as content:
            return not content.read(4).startswith(_RESULTS) and file.suffix.lower() != ".nc"
    except OSError:
        return False


def _srs_of_record(arguments: argparse.Namespace, targets: Sequence[Path]) -> int:
    """Spectrum of a file of a recorder."""
    from ..results.export import acceleration_unit
    from ..results.files import write_netcdf
    from ..results.groups import StoredGroup
    from ..results.spectra import record_csv, record_dataset, record_lines
    from ..results.writing import write_bytes
    from ..scene.units import SI

    given = {key: getattr(arguments, key) for key in ("value_unit", "time_unit", "column", "time_column", "gaps")}
    law = {"file": str(arguments.results), "start": "record"}
    law |= {key: _number_or_text(value) for key, value in given.items() if value is not None}
    made, read_as = _record_spectrum(law, arguments)
    units = SI.with_g if arguments.g else SI
    lines = record_lines(made, f"{arguments.results}, {read_as}", units)
    tell(arguments, lines, lambda: StoredGroup.of_dataset(record_dataset(made)).report())
    write_bytes(targets[0], record_csv(made, acceleration_unit(units, arguments.g)).encode())
    write_netcdf(_record_tree(made, str(arguments.results), read_as), targets[1])
    tell_written(arguments, f"spectrum: {', '.join(map(str, targets))}")
    return CONVERGED


def _number_or_text(text: str) -> Any:
    """A whole number (of a column), a number, or the text."""
    for kind in (int, float):
        with suppress(ValueError):
            return kind(text)
    return text


def _record_tree(made: ShockSpectrum, file: str, read_as: str) -> xr.DataTree:
    """The spectrum with where it comes from."""
    import xarray as xr

    from ..results.groups import root_attributes
    from ..results.spectra import record_dataset

    attributes = root_attributes("shock response spectrum of a record", "record", "")
    data = record_dataset(made).assign_attrs({**attributes, "source_file": file, "read_as": read_as})
    return xr.DataTree(data)


def _record_spectrum(law: dict[str, Any], arguments: argparse.Namespace) -> tuple[ShockSpectrum, str]:
    """Spectrum of a record with the keys of a law, and what was read, in words.

    Raises
    ------
    InputError : a file, unit or option that does not fit.
    """
    import numpy as np
    from pydantic import ValidationError

    from ..results.spectra import BAND, shock_response_spectrum
    from ..scene.describe import validation_problems
    from ..scene.laws import CsvLaw
    from ..scene.unit_texts import names_for, si_unit

    heading = "no shock response spectrum"
    try:
        record = CsvLaw.model_validate({"type": "csv", **law})
    except ValidationError as error:
        problems = [replace(p, where=law["file"]) for p in validation_problems(CsvLaw, error, law)]
        raise InputError(problems, heading) from None
    unit = record.units[1]
    if unit in (None, "1") or (isinstance(unit, str) and si_unit(unit) != "m s-2"):
        what = "the values are no acceleration" if unit else "the unit of the values is not known"
        raise InputError.of(heading, "--value-unit", what, str(unit or ""), f"{names_for('m s-2')}, or the factor")
    times, values = np.array(record.times), np.array(record.values)
    step = float(times[-1] - times[0]) / (len(times) - 1)
    off = float(np.abs(times - times[0] - step * np.arange(len(times))).max())
    if off > _UNEVEN * step:
        what, allowed = "the samples are not evenly spaced", f"up to {_UNEVEN:g} of the interval of {step:.4g} s"
        raise InputError.of(heading, law["file"], what, f"{off / step:.3g} intervals off", allowed)
    given = {key: value for key in _OPTIONS if (value := getattr(arguments, key)) is not None}
    request = _request(given)
    frequencies = request.frequencies(step, float(times[-1] - times[0])) or given.get("highest", 0.0)
    made = shock_response_spectrum(values, step, frequencies, request.quality, interpolation=BAND)
    return made, record.read_as


def _export(arguments: argparse.Namespace) -> int:
    from ..results.export import sensors_as_csv, universal_file
    from ..results.files import open_results, readable
    from ..results.writing import write_bytes

    stem = arguments.output or arguments.results.with_name(f"{arguments.results.stem}_sensors")
    targets = _targets(stem, "csv", "unv")
    with closing(open_results(arguments.results)) as tree, readable(arguments.results):
        known = _sensors(tree, arguments, "nothing to export")
        names = arguments.sensor or known
        made = sensors_as_csv(tree, names, arguments.g), universal_file(tree, names)
    for target, text in zip(targets, made, strict=True):
        write_bytes(target, text.encode())
    print(f"sensors: {', '.join(map(str, targets))}")
    return CONVERGED


def _sensors(tree: xr.DataTree, arguments: argparse.Namespace, heading: str) -> list[str]:
    """Names of the sensors of a file.

    Raises
    ------
    LatinError : it has none, or not one that the options name.
    """
    known = list(tree["sensors"].children) if "sensors" in tree.children else []
    if not known:
        what = "the results have no sensors"
        problem = Problem(str(arguments.results), what, None, None, "add [sensor.NAME] tables to the scene and run it")
        raise ResultsError([problem], heading)
    unknown = [
        Problem("--sensor", "no sensor of this name", name, listed(known), did_you_mean(name, known))
        for name in arguments.sensor
        if name not in known
    ]
    if unknown:
        raise InputError(unknown, heading)
    return known


def _tree(results: xr.DataTree, spectra: Mapping[str, xr.Dataset]) -> xr.DataTree:
    """Spectra by sensor, with the provenance of the results."""
    import xarray as xr

    tree = xr.DataTree.from_dict({f"/sensors/{name}/spectrum": dataset for name, dataset in spectra.items()})
    tree.attrs = dict(results.attrs)
    return tree


def _spectra(
    tree: xr.DataTree, arguments: argparse.Namespace, waiting: Waiting
) -> Iterator[tuple[str, tuple[ShockSpectrum, Array | None]]]:
    """Spectra and their estimated errors by sensor."""
    from ..results.spectra import stored_spectrum

    known = _sensors(tree, arguments, "no shock response spectrum")
    given = {key: value for key in _OPTIONS if (value := getattr(arguments, key)) is not None}
    stored = [name for name in known if "spectrum" in tree[f"sensors/{name}"].children]
    request = _request(given)
    # options ask for other spectra than the stored ones
    chosen = arguments.sensor or (stored if stored and not given else known)
    for number, name in enumerate(chosen):
        waiting.reached(number / len(chosen), f"spectrum of {name}")
        node = tree[f"sensors/{name}"]
        made = name in stored and not given
        yield name, stored_spectrum(node["spectrum"]) if made else (_computed(name, node, request), None)


def _request(given: Mapping[str, Any]) -> Spectrum:
    """The options as a spectrum of a scene.

    Raises
    ------
    InputError : values out of range.
    """
    from pydantic import ValidationError

    from ..scene.describe import validation_problems
    from ..scene.sensors import Spectrum

    try:
        return Spectrum.model_validate(given)
    except ValidationError as error:
        problems = validation_problems(Spectrum, error, given)
        named = [Problem(f"--{p.where.replace('_', '-')}", p.what, p.value, p.allowed, p.remedy) for p in problems]
        raise InputError(named, "bad argument") from None


def _computed(name: str, node: Any, request: Spectrum) -> ShockSpectrum:
    """The spectrum of a stored acceleration.

    Raises
    ------
    InputError : no acceleration, steps of unequal length, frequencies beyond Nyquist's.
    """
    from ..results.sensors import uniform_step
    from ..results.spectra import LINES, shock_response_spectrum
    from ..scene.sensors import spectrum_problems

    heading = "no shock response spectrum"
    if "acceleration" not in node:
        reason = str(node.attrs.get("acceleration", "none")).removeprefix("none: ")
        raise InputError([Problem(f"sensor {name}", f"it has no acceleration ({reason})")], heading)
    time = node["time"].values
    step = uniform_step(time)
    if not step:
        raise InputError([Problem(f"sensor {name}", "the steps of the run are of unequal length")], heading)
    requested = [f for f in (request.lowest, request.highest) if f is not None]
    if problems := list(spectrum_problems("--highest", requested, step)):
        raise InputError(problems, heading)
    frequencies = request.frequencies(step, float(time[-1] - time[0]))
    if not frequencies:
        what = f"no frequency between {request.lowest or 1 / (time[-1] - time[0]):.4g} Hz and {0.1 / step:.4g} Hz"
        raise InputError([Problem(f"sensor {name}", what, remedy="give --lowest and --highest")], heading)
    return shock_response_spectrum(node["acceleration"].values, step, frequencies, request.quality, interpolation=LINES)
