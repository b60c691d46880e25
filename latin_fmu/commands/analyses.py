"""Subcommands ``srs`` and ``export``, spectra and histories of the sensors of a results file, ``modes``, natural
frequencies of an assembly, ``frf``, its frequency responses, and ``backbone``, frequency and damping of a mode against
the amplitude."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

from ..errors import InputError, Problem, ResultsError, did_you_mean, listed
from . import CONVERGED, Json, OfScene, Waiting, check_netcdf, output_file, tell, tell_written
from .decks import deck_of_scene
from .options import Argument, Option, command, handed

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
(sensor.NAME.spectrum) are used, with their estimated error if the run has one.
"""
_EXPORT_EXAMPLES = """\
examples:
  latin-fmu export out.nc
  latin-fmu export out.nc --sensor tip --g -o tip
  latin-fmu export --deck scene.toml -o scene.inp

Writes STEM.csv, a row for each instant and columns for displacement, velocity and acceleration of every sensor, and
STEM.unv, a universal file (dataset 58) with these and the stored spectra in SI for the software of test laboratories.
With --deck a scene as a deck of CalculiX, and a line for each table: used, or left out with what that changes.
"""
_MODES_EXAMPLES = """\
examples:
  latin-fmu modes scene.toml
  latin-fmu modes scene.toml --joints open --count 20 -o modes.nc --vtk shapes

Joints of interfaces that may open: sticking joins points that are closed at the start (along the face, too, where
there is friction), open joins none, bonded joins all. In a scene with bolts or a static start, sticking joins the
points that these press, and open leaves the shanks free to slide. Perfect interfaces and couplings are always joined,
elastic layers and springs have their stiffness; damping, viscous joints, absorbing boundaries and loads are ignored,
driven faces are fixed.

The table has the effective mass of each mode for a base that moves along x, y or z, in % of the mass of the assembly,
and the damping ratio, in % of critical, that a run of the scene gives each mode: of the time scheme with the
step of the scene, of the viscous layer at faces that may open (landing_damping), and of Rayleigh damping, dampers,
viscous joints, absorbing faces and wave ports if the scene has any. A line states how to reduce the first two if
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
(all supports of the assembly move along an axis: transmissibility), SENSOR.x, SENSOR.y or SENSOR.z (a unit force
there) or a load of the scene, scaled to a resultant of 1. Without --drive the base moves along each axis.

Modes up to 1.5 times the highest frequency are used; the static response to each drive represents the others.
Damping is a common ratio of all modes (--damping 0.02), a ratio of each mode (--damping 0.01,0.02, the last one for the
rest), or that of the scene: Rayleigh damping, dampers, viscous joints, absorbing faces. It does not include friction.

Writes STEM.csv, STEM.nc and STEM.png.
"""
_MOST_MODES, _MOST_POINTS = 1000, 200
Joints = Literal["sticking", "open", "bonded"]
Along = Annotated[Literal["x", "y", "z"] | None, Option("axis in the figure (default: that of the largest)")]
_OF_SPECTRUM = ("lowest", "highest", "per_octave", "quality", "damping")
_OF_RECORD = ("value_unit", "time_unit", "column", "time_column", "gaps")


def targets_of(stem: Path, *suffixes: str) -> list[Path]:
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


def _ratios(text: str) -> list[float]:
    """Damping ratios, separated by commas.

    Raises
    ------
    argparse.ArgumentTypeError : they are no numbers.
    """
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a ratio, or ratios separated by commas") from None


@dataclass(frozen=True, kw_only=True)
class FrfOptions(OfScene):
    """Options of ``frf``."""

    drives: Annotated[
        tuple[str, ...],
        Option("base.x, SENSOR.x or a load, repeatable (default: base along each axis)", "NAME", "--drive"),
    ] = ()
    sensors: Annotated[
        tuple[str, ...], Option("sensor of the response, repeatable (default: all)", "NAME", "--sensor")
    ] = ()
    damping: Annotated[Sequence[float] | None, Option(metavar="R[,R..]", read=_ratios)] = None
    kind: Annotated[Literal["receptance", "mobility", "accelerance"] | None, Option()] = None
    joints: Annotated[Joints | None, Option()] = None
    lowest: Annotated[float | None, Option(metavar="HZ")] = None
    highest: Annotated[float | None, Option(metavar="HZ")] = None
    points: Annotated[int | None, Option(metavar="N")] = None
    along: Along = None
    json: Json = False
    output: Annotated[Path | None, Option("default: SCENE_frf in the current folder", "STEM", "-o")] = None


@command(_FRF_EXAMPLES, feeds=("frf",))
def frf(options: FrfOptions) -> int:
    """Make frequency responses of the clamped assembly to its base or to forces: table, dataset and figure."""
    from ..modal.frequency_response import frf
    from ..pictures.response_picture import response_figure
    from ..pictures.style import save_figure
    from ..results.writing import write_bytes

    scene = options.read_scene()
    targets = targets_of(options.output or Path(f"{scene.name}_frf"), "csv", "nc", "png")
    with Waiting("modes"):
        response = frf(scene, **handed(options, frf))
    tell(options.json, response.lines(), response.report)
    write_bytes(targets[0], response.as_csv().encode())
    response.save(targets[1])
    save_figure(response_figure(response, options.along), targets[2])
    tell_written(options.json, f"frequency responses: {', '.join(map(str, targets))}")
    return CONVERGED


@dataclass(frozen=True, kw_only=True)
class BackboneOptions(OfScene):
    """Options of ``backbone``."""

    mode: Annotated[int, Option(metavar="N")] = 1
    amplitude: Annotated[str, Option("smallest and largest amplitude, as 1um:0.1mm", "A[:B]")]
    points: Annotated[int, Option("amplitudes from A to B, by equal factors", "N")] = 10
    sensor: Annotated[str | None, Option(metavar="NAME")] = None
    loop: Annotated[Literal["half", "full", "masing"] | None, Option()] = None
    increments: Annotated[int | None, Option(metavar="N")] = None
    tolerance: Annotated[float | None, Option(metavar="T")] = None
    json: Json = False
    measured: Annotated[Path | None, Option("points to draw beside: amplitude, frequency, damping ratio", "FILE")] = (
        None
    )
    measured_units: Annotated[
        tuple[str, str],
        Option("units of amplitude and damping in that file (default: those of the scene, 1)", ("LENGTH", "RATIO")),
    ] = ("", "1")
    output: Annotated[Path | None, Option("default: SCENE_backbone in the current folder", "STEM", "-o")] = None


@command(_BACKBONE_EXAMPLES, feeds=("backbone",))
def backbone(options: BackboneOptions) -> int:
    """Make frequency and damping of a mode against its amplitude: table, dataset and figure."""
    import numpy as np

    from ..modal.backbone import backbone
    from ..pictures.backbone_picture import backbone_figure
    from ..pictures.style import save_figure
    from ..results.writing import write_bytes

    scene = options.read_scene()
    lowest, highest = _amplitudes(options.amplitude, scene.unit_system)
    if not 1 <= options.points <= _MOST_POINTS:
        problem = Problem("--points", "out of range", str(options.points), f"1 to {_MOST_POINTS}")
        raise InputError([problem], "bad argument")
    if highest > lowest:
        levels = np.geomspace(lowest, highest, options.points)
    else:
        levels = np.array([highest])
    measured = _measured(options, scene.unit_system)
    targets = targets_of(options.output or Path(f"{scene.name}_backbone"), "csv", "nc", "png")
    with Waiting("tightening") as waiting:
        curve = backbone(
            scene,
            options.mode,
            levels,
            **handed(options, backbone),
            progress=lambda done, total, *_: waiting.reached((done + 1) / total, "loops"),
        )
    tell(options.json, curve.lines(), curve.groups()["/backbone"].report)
    write_bytes(targets[0], curve.as_csv().encode())
    curve.save(targets[1])
    save_figure(backbone_figure(curve, measured), targets[2])
    tell_written(options.json, f"backbone: {', '.join(map(str, targets))}")
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
        if unit:
            size = unit_size(unit, "m")
        else:
            size = units.exact_size("m")
        with suppress(OverflowError):
            if size is not None:
                sizes += [float(number * size / units.exact_size("m"))]
    if len(sizes) != len(text.split(":")) or len(sizes) > 2 or not 0.0 < sizes[0] <= sizes[-1] < float("inf"):
        allowed = f"A or A:B, 0 < A <= B, numbers with one of {names_for('m')} or in the units of the scene"
        raise InputError([Problem("--amplitude", "no range of amplitudes", text, allowed)], "bad argument")
    return sizes[0], sizes[-1]


def _measured(options: BackboneOptions, units: UnitSystem) -> Array | None:
    """Measured points (n, 3) in the units of the scene, None where none are given.

    Raises
    ------
    InputError : a file that is no table of numbers, or units that are not known.
    """
    import numpy as np
    from pydantic_core import PydanticCustomError

    from ..scene.number_files import factor, read_columns, unit_problem
    from ..scene.unit_texts import names_for

    if options.measured is None:
        return None
    length, ratio = options.measured_units
    for name, unit in ((length, "m"), (ratio, "1")):
        if name and (what := unit_problem(name, unit)):
            raise InputError([Problem("--measured-units", what, name, names_for(unit))], "bad argument")
    try:
        table = np.array(read_columns(Path(), str(options.measured), [1, 2, 3]), dtype=float).reshape(-1, 3)
    except PydanticCustomError as error:
        said = error.context or {}
        value = None
        if said.get("value") is not None:
            value = str(said["value"])
        problem = Problem("--measured", str(said.get("what", error)), value, said.get("allowed"), said.get("remedy"))
        raise InputError([problem], "bad argument") from None
    return table * [factor(length, units) if length else 1.0, 1.0, factor(ratio)]


@dataclass(frozen=True, kw_only=True)
class ModesOptions(OfScene):
    """Options of ``modes``."""

    joints: Annotated[Joints | None, Option()] = None
    count: Annotated[int | None, Option(metavar="N")] = None
    json: Json = False
    output: Annotated[Path | None, Option("also write frequencies and shapes", "MODES.nc", "-o", output_file)] = None
    vtk: Annotated[Path | None, Option("also write files for ParaView to this folder", "FOLDER")] = None


@command(_MODES_EXAMPLES, feeds=("vibration_modes",))
def modes(options: ModesOptions) -> int:
    """Print natural frequencies of the assembly of a scene and their damping in a run, and write its shapes."""
    from ..modal.modes import vibration_modes
    from ..results.vtk import check_export_folder
    from ..results.writing import check_target

    if options.count is not None and not 1 <= options.count <= _MOST_MODES:
        problem = Problem("--count", "out of range", str(options.count), f"1 to {_MOST_MODES}")
        raise InputError([problem], "bad argument")
    if options.output is not None:
        check_netcdf(options.output)
        check_target(options.output)
    if options.vtk is not None:
        check_export_folder(options.vtk)
    with Waiting("natural frequencies"):
        found = vibration_modes(options.read_scene(), **handed(options, vibration_modes))
    tell(options.json, found.lines(), found.groups()["/modes"].report)
    if options.output is not None:
        found.save(options.output)
        tell_written(options.json, f"modes: {options.output}")
    if options.vtk is not None:
        tell_written(options.json, f"for ParaView: {found.export(options.vtk)}")
    return CONVERGED


@dataclass(frozen=True, kw_only=True)
class OfSensors:
    """Options of a command that takes the sensors of a results file."""

    results: Annotated[Path, Argument("results file written by run", "RESULT.nc")]
    sensor: Annotated[tuple[str, ...], Option("sensor, repeatable (default: every one)", "NAME")] = ()
    g: Annotated[bool, Option("accelerations of texts, tables and figures in g, 9.80665 m/s2")] = False


@dataclass(frozen=True, kw_only=True)
class OfExport(OfSensors):
    """Options of ``export``."""

    deck: Annotated[bool, Option("the file is a scene, which is written as a deck of CalculiX (.inp)")] = False


@dataclass(frozen=True, kw_only=True)
class SrsOptions(OfSensors):
    """Options of ``srs``."""

    value_unit: Annotated[
        str | None, Option("of a record: unit of its values (g, m/s2), or the factor to m/s2", "UNIT")
    ] = None
    time_unit: Annotated[
        str | None, Option("of a record: unit of its times (default: that of the header, else s)", "UNIT")
    ] = None
    column: Annotated[str | None, Option("of a record: name or number of the column of its values", "NAME")] = None
    time_column: Annotated[str | None, Option("of a record: name or number of the column of its times", "NAME")] = None
    gaps: Annotated[Literal["refused", "linear"] | None, Option("of a record: treatment of missing samples")] = None
    lowest: Annotated[float | None, Option("first frequency (default: 1 / duration)", "HZ")] = None
    highest: Annotated[float | None, Option("last frequency (default: sampling rate / 10)", "HZ")] = None
    per_octave: Annotated[int | None, Option("frequencies per octave (default: 12)", "N")] = None
    quality: Annotated[float | None, Option("amplification of the oscillators (default: 10)", "Q")] = None
    damping: Annotated[float | None, Option("damping ratio of the oscillators, instead of --quality", "RATIO")] = None
    along: Along = None
    json: Json = False
    output: Annotated[Path | None, Option("default: RESULT_srs beside the results", "STEM", "-o")] = None


@command(_EXAMPLES)
def srs(options: SrsOptions) -> int:
    """Make shock response spectra of the sensors of a results file, or of a measured record."""
    from ..pictures.style import save_figure
    from ..pictures.summary_picture import spectra_figure
    from ..results.export import acceleration_unit
    from ..results.files import open_results, readable, write_netcdf
    from ..results.groups import in_units, units_of
    from ..results.sensors import spectrum_rows
    from ..results.spectra import as_csv, shock_axis, spectrum_group
    from ..results.writing import write_bytes
    from ..scene.readable_numbers import aligned

    stem = options.output or options.results.with_name(f"{options.results.stem}_srs")
    file = options.results
    if _is_record(file):
        return _srs_of_record(options, targets_of(stem, "csv", "nc"))
    targets = targets_of(stem, "csv", "nc", "png")
    with closing(open_results(file)) as tree, readable(file), Waiting("spectra") as waiting:
        spectra = dict(_spectra(tree, options, waiting))
        units, shock = units_of(tree.attrs), shock_axis(tree)
        in_g = acceleration_unit(units, options.g)
        if options.g:
            units = units.with_g
        groups = in_units({name: spectrum_group(*pair) for name, pair in spectra.items()}, units)
        dataset = _tree(tree, {name: group.dataset() for name, group in groups.items()})
    rows = spectrum_rows({name: spectrum for name, (spectrum, _) in spectra.items()}, units)
    tell(options.json, aligned(rows) if rows else [], lambda: {name: group.report() for name, group in groups.items()})
    write_bytes(targets[0], as_csv([(name, spectrum) for name, (spectrum, _) in spectra.items()], units, in_g).encode())
    write_netcdf(dataset, targets[1])
    save_figure(spectra_figure(spectra, options.along, units, shock), targets[2])
    tell_written(options.json, f"spectra: {', '.join(map(str, targets))}")
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


def _srs_of_record(options: SrsOptions, targets: Sequence[Path]) -> int:
    """Spectrum of a file of a recorder."""
    from ..results.export import acceleration_unit
    from ..results.files import write_netcdf
    from ..results.groups import StoredGroup
    from ..results.spectra import record_csv, record_dataset, record_lines
    from ..results.writing import write_bytes
    from ..scene.units import SI

    law = {"file": str(options.results), "start": "record"}
    law |= {key: number_or_text(value) for key, value in _said(options, _OF_RECORD).items()}
    spectrum, read_as = record_spectrum(law, _said(options, _OF_SPECTRUM))
    if options.g:
        units = SI.with_g
    else:
        units = SI
    lines = record_lines(spectrum, f"{options.results}, {read_as}", units)
    tell(options.json, lines, lambda: StoredGroup.of_dataset(record_dataset(spectrum)).report())
    write_bytes(targets[0], record_csv(spectrum, acceleration_unit(units, options.g)).encode())
    write_netcdf(_record_tree(spectrum, str(options.results), read_as), targets[1])
    tell_written(options.json, f"spectrum: {', '.join(map(str, targets))}")
    return CONVERGED


def number_or_text(text: str) -> Any:
    """A whole number (of a column), a number, or the text."""
    for kind in (int, float):
        with suppress(ValueError):
            return kind(text)
    return text


def _record_tree(spectrum: ShockSpectrum, file: str, read_as: str) -> xr.DataTree:
    """The spectrum with where it comes from."""
    import xarray as xr

    from ..results.groups import root_attributes
    from ..results.spectra import record_dataset

    attributes = root_attributes("shock response spectrum of a record", "record", "")
    data = record_dataset(spectrum).assign_attrs({**attributes, "source_file": file, "read_as": read_as})
    return xr.DataTree(data)


def record_spectrum(law: dict[str, Any], requested: Mapping[str, Any]) -> tuple[ShockSpectrum, str]:
    """Spectrum of a record with the keys of a law, and those of a spectrum, and what was read, in words.

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
        if unit:
            what = "the values are not an acceleration"
        else:
            what = "the unit of the values is unknown"
        raise InputError.of(heading, "--value-unit", what, str(unit or ""), f"{names_for('m s-2')}, or the factor")
    times, values = np.array(record.times), np.array(record.values)
    step = float(times[-1] - times[0]) / (len(times) - 1)
    off = float(np.abs(times - times[0] - step * np.arange(len(times))).max())
    if off > _UNEVEN * step:
        what, allowed = "the samples are not evenly spaced", f"up to {_UNEVEN:g} of the interval of {step:.4g} s"
        raise InputError.of(heading, law["file"], what, f"{off / step:.3g} intervals off", allowed)
    request = _request(requested)
    frequencies = request.frequencies(step, float(times[-1] - times[0])) or requested.get("highest", 0.0)
    spectrum = shock_response_spectrum(values, step, frequencies, request.quality, interpolation=BAND)
    return spectrum, record.read_as


@command(_EXPORT_EXAMPLES)
def export(
    of: OfExport,
    output: Annotated[
        Path | None,
        Option("default: RESULT_sensors beside the results; of a deck SCENE.inp in the current folder", "STEM", "-o"),
    ] = None,
) -> int:
    """Write the motions of the sensors of a results file as a table and as a universal file (UNV 58), or a scene as a
    deck of CalculiX."""
    from ..results.export import sensors_as_csv, universal_file
    from ..results.files import open_results, readable
    from ..results.writing import write_bytes

    if of.deck:
        return deck_of_scene(of.results, output)
    stem = output or of.results.with_name(f"{of.results.stem}_sensors")
    targets = targets_of(stem, "csv", "unv")
    with closing(open_results(of.results)) as tree, readable(of.results):
        sensors = _sensors(tree, of, "nothing to export")
        names = of.sensor or sensors
        texts = sensors_as_csv(tree, names, of.g), universal_file(tree, names)
    for target, text in zip(targets, texts, strict=True):
        write_bytes(target, text.encode())
    print(f"sensors: {', '.join(map(str, targets))}")
    return CONVERGED


def _sensors(tree: xr.DataTree, of: OfSensors, heading: str) -> list[str]:
    """Names of the sensors of a file.

    Raises
    ------
    LatinError : it has none, or not one that the options name.
    """
    from ..results.groups import children_of

    sensors = list(children_of(tree, "sensors"))
    if not sensors:
        what = "the results have no sensors"
        problem = Problem(str(of.results), what, None, None, "add [sensor.NAME] tables to the scene and run it")
        raise ResultsError([problem], heading)
    unknown = [
        Problem("--sensor", "no sensor of this name", name, listed(sensors), did_you_mean(name, sensors))
        for name in of.sensor
        if name not in sensors
    ]
    if unknown:
        raise InputError(unknown, heading)
    return sensors


def _tree(results: xr.DataTree, spectra: Mapping[str, xr.Dataset]) -> xr.DataTree:
    """Spectra by sensor, with the provenance of the results."""
    import xarray as xr

    tree = xr.DataTree.from_dict({f"/sensors/{name}/spectrum": dataset for name, dataset in spectra.items()})
    tree.attrs = dict(results.attrs)
    return tree


def _spectra(
    tree: xr.DataTree, options: SrsOptions, waiting: Waiting
) -> Iterator[tuple[str, tuple[ShockSpectrum, Array | None]]]:
    """Spectra and their estimated errors by sensor."""
    from ..results.spectra import stored_spectrum

    sensors = _sensors(tree, options, "no shock response spectrum")
    requested = _said(options, _OF_SPECTRUM)
    stored = [name for name in sensors if "spectrum" in tree[f"sensors/{name}"].children]
    request = _request(requested)
    # options ask for other spectra than the stored ones
    chosen = options.sensor or (stored if stored and not requested else sensors)
    for number, name in enumerate(chosen):
        waiting.reached(number / len(chosen), f"spectrum of {name}")
        node = tree[f"sensors/{name}"]
        if name in stored and not requested:
            yield name, stored_spectrum(node["spectrum"])
        else:
            yield name, (_computed(name, node, request), None)


def _said(options: SrsOptions, keys: Sequence[str]) -> dict[str, Any]:
    """Options that were given."""
    return {key: value for key in keys if (value := getattr(options, key)) is not None}


def _request(options: Mapping[str, Any]) -> Spectrum:
    """The options as a spectrum of a scene.

    Raises
    ------
    InputError : values out of range.
    """
    from pydantic import ValidationError

    from ..scene.describe import validation_problems
    from ..scene.sensors import Spectrum

    try:
        return Spectrum.model_validate(options)
    except ValidationError as error:
        problems = validation_problems(Spectrum, error, options)
        named = [Problem(f"--{p.where.replace('_', '-')}", p.what, p.value, p.allowed, p.remedy) for p in problems]
        raise InputError(named, "bad argument") from None


def _computed(name: str, node: Any, request: Spectrum) -> ShockSpectrum:
    """The spectrum of a stored acceleration.

    Raises
    ------
    InputError : no acceleration, steps of unequal length, frequencies beyond Nyquist's.
    """
    from ..results.filters import uniform_step
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
