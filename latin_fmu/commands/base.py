"""Subcommands ``base``, a base history from a shock specification or a pulse, and ``envelope``, a specification from
records."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

from ..errors import InputError, Problem, listed
from . import CONVERGED, NOT_CONVERGED, Json, Waiting, tell, tell_written
from .analyses import number_or_text, record_spectrum, targets_of
from .options import Argument, Option, command

if TYPE_CHECKING:
    from ..shock.base_histories import BaseHistory

_EXAMPLES = """\
examples:
  latin-fmu base spec.csv
  latin-fmu base spec.csv --waves damped_sines --unit g --peak 800 --displacement 20e-3 -o test
  latin-fmu base --pulse half_sine --size 50 --unit g --duration 11e-3 -o pulse

SPEC has two columns, frequency in Hz and acceleration, with the unit in the header or by --unit; lines between the
breakpoints are straight in logarithms. The history is held to it at every twelfth of an octave, and ends at rest. Of
several seeds the smallest peak is taken. STEM.csv has times in s and accelerations in m/s2, for a law of a scene
({type = "csv", file = "STEM.csv", value_unit = "m/s2"}); STEM.png shows band, spectrum and history.

Exit code 1: no seed meets the specification and the limits; the history that comes closest is written.
"""
_ENVELOPE_EXAMPLES = """\
examples:
  latin-fmu envelope shot1.csv shot2.csv shot3.csv --value-unit g -o spec.csv
  latin-fmu envelope shot*.csv --rule P95/50 -o spec.csv

Spectra of the records at equal frequencies, and their largest value or the normal tolerance limit of their logarithms
(NASA-HDBK-7005): P95/50 covers 95 % of all records with 50 % confidence.
"""
_RULES: Final = MappingProxyType({"P95/50": (0.95, 0.5), "P95/90": (0.95, 0.9), "P99/90": (0.99, 0.9)})
"""Share of all records and confidence of a tolerance limit."""


@dataclass(frozen=True, kw_only=True)
class BaseOptions:
    """Options of ``base``."""

    specification: Annotated[Path | None, Argument("file of the specification", "SPEC")] = None
    pulse: Annotated[
        Literal["half_sine", "haversine", "sawtooth", "trapezoid"] | None, Option("a pulse instead of a specification")
    ] = None
    size: Annotated[float | None, Option("of a pulse: its peak", "A")] = None
    share: Annotated[float, Option("of a pulse: size of pre- and post-load over its own; 0: none", "S")] = 0.1
    unit: Annotated[str | None, Option("of accelerations of SPEC without a unit, and of --size", "UNIT")] = None
    quality: Annotated[float, Option("amplification of the oscillators", "Q")] = 10.0
    waves: Annotated[
        Literal["wavelets", "damped_sines"], Option("what the history is a sum of; damped_sines begin suddenly")
    ] = "wavelets"
    tolerance: Annotated[float, Option("largest deviation at any twelfth of an octave", "DB")] = 1.0
    seeds: Annotated[int, Option("histories to choose from", "N")] = 5
    duration: Annotated[float | None, Option("of history (default: six longest periods) or pulse", "S")] = None
    rate: Annotated[float | None, Option("samples a second (default: 16 a period of the highest frequency)", "HZ")] = (
        None
    )
    peak: Annotated[float | None, Option("largest acceleration of the test stand, m/s2", "A")] = None
    velocity: Annotated[float | None, Option("largest velocity of the test stand, m/s", "V")] = None
    displacement: Annotated[float | None, Option("largest displacement of the test stand, m", "D")] = None
    json: Json = False
    output: Annotated[Path | None, Option("default: SPEC_base, or the pulse", "STEM", "-o")] = None


@command(_EXAMPLES)
def base(options: BaseOptions) -> int:
    """Make a base history from a specified shock response spectrum, or a pulse that leaves its base at rest."""
    if (options.specification is None) == (options.pulse is None):
        problem = Problem("SPEC", "a history is that of a specification or of a pulse", allowed="SPEC, or --pulse KIND")
        raise InputError([problem], "no base history")
    if options.specification is None:
        return _pulse(options)
    from ..pictures.base_picture import base_figure
    from ..pictures.style import save_figure
    from ..results.writing import write_bytes
    from ..scene.specifications import missed
    from ..scene.units import SI

    targets = targets_of(options.output or Path(f"{options.specification.stem}_base"), "csv", "png")
    with Waiting("base histories") as waiting:
        history = _history(options, waiting)
    faults = missed(history, options.tolerance, SI)
    tell(options.json, _lines(history, faults), lambda: _report(history, faults))
    write_bytes(targets[0], history_csv(history.time, history.acceleration).encode())
    save_figure(base_figure(history, options.tolerance), targets[1])
    tell_written(options.json, f"base history: {', '.join(map(str, targets))}")
    if faults:
        return NOT_CONVERGED
    return CONVERGED


def _history(options: BaseOptions, waiting: Waiting) -> BaseHistory:
    """The history of a specification.

    Raises
    ------
    InputError : options or a file that are none.
    """
    from pydantic import ValidationError
    from pydantic_core import PydanticCustomError

    from ..scene.describe import validation_problems
    from ..scene.laws import SrsLaw
    from ..scene.specifications import Request
    from ..scene.units import SI

    keys = ("quality", "waves", "tolerance", "seeds", "duration", "rate", "peak", "velocity", "displacement")
    data: dict[str, Any] = {"file": str(options.specification)}
    data |= {key: value for key in keys if (value := getattr(options, key)) is not None}
    if options.unit is not None:
        data["unit"] = number_or_text(options.unit)
    heading, filled = "no base history", {"type": "srs", "times": [0.0, 1.0], "values": [0.0, 0.0]}
    try:
        SrsLaw.model_validate(filled | data)
    except ValidationError as error:
        named = [replace(p, where=f"--{p.where}") for p in validation_problems(SrsLaw, error, data)]
        raise InputError(named, heading) from None
    try:
        request = Request.of(data, Path(), SI)
    except PydanticCustomError as error:
        said = error.context or {}
        problem = Problem(str(options.specification), said["what"], said["value"], said["allowed"], said["remedy"])
        raise InputError([problem], heading) from None
    done: list[str] = []

    def told(line: str) -> None:
        done.append(line)
        waiting.reached(len(done) / options.seeds, f"base histories, {line}")

    return request.history(told)


def _pulse(options: BaseOptions) -> int:
    """Write a pulse."""
    from ..results.writing import write_bytes
    from ..scene.number_files import factor
    from ..scene.unit_texts import names_for, si_unit
    from ..shock.pulses import pulse_history

    assert options.pulse is not None
    problems = [
        Problem(f"--{name}", "a pulse needs it", str(value or ""), "a number > 0")
        for name, value in (("size", options.size), ("duration", options.duration))
        if value is None or not 0.0 < value < float("inf")
    ]
    if not 0.0 <= options.share <= 1.0:
        problems.append(Problem("--share", "no share of a size", f"{options.share:g}", "0 to 1"))
    unit = "m/s2" if options.unit is None else number_or_text(options.unit)
    if isinstance(unit, str) and si_unit(unit) != "m s-2":
        problems.append(Problem("--unit", "no unit of accelerations", unit, f"{names_for('m s-2')}, or the factor"))
    if problems:
        raise InputError(problems, "no base history")
    (target,) = targets_of(options.output or Path(options.pulse), "csv")
    assert options.size is not None
    assert options.duration is not None
    time, acceleration = pulse_history(options.pulse, factor(unit) * options.size, options.duration, options.share)
    write_bytes(target, history_csv(time, acceleration).encode())
    print(f"pulse of {options.duration:g} s in a history of {time[-1]:.4g} s: {target}")
    return CONVERGED


def history_csv(time: Any, acceleration: Any) -> str:
    """A base history as comma-separated values, in SI."""
    rows = [f"{t:.9g},{a:.9g}" for t, a in zip(time, acceleration, strict=True)]
    return "\n".join(["time [s],acceleration [m/s2]", *rows]) + "\n"


def _lines(history: BaseHistory, faults: list[str]) -> list[str]:
    """What a history is, in words."""
    from ..scene.unit_texts import GRAVITY

    found = _report(history, faults)
    lines = [
        f"base history of {found['duration']:.4g} s, {len(history.time)} samples, seed {history.seed}",
        f"peak {found['peak']:.4g} m/s2 ({found['peak'] / GRAVITY:.4g} g), velocity {found['velocity']:.4g} m/s, "
        f"displacement {found['displacement']:.4g} m; at the end {found['last_velocity']:.1e} and "
        f"{found['last_displacement']:.1e} of these",
        f"spectrum within {history.error:.2g} dB of the specification at {len(history.frequency)} frequencies, "
        f"{history.frequency[0]:.4g} to {history.frequency[-1]:.4g} Hz, Q {history.specification.quality:g}",
    ]
    return lines + [f"not met: {fault}" for fault in faults]


def _report(history: BaseHistory, faults: list[str]) -> dict[str, Any]:
    """Plain data of a history, in SI."""
    velocity, displacement = (float(abs(x).max()) for x in (history.velocity, history.displacement))
    return {
        "duration": float(history.time[-1]),
        "samples": len(history.time),
        "seed": history.seed,
        "peak": float(abs(history.acceleration).max()),
        "velocity": velocity,
        "displacement": displacement,
        "last_velocity": abs(float(history.velocity[-1])) / velocity,
        "last_displacement": abs(float(history.displacement[-1])) / displacement,
        "error_decibels": history.error,
        "frequency": history.frequency.tolist(),
        "specified": history.specification.at(history.frequency).tolist(),
        "reached": history.reached.tolist(),
        "not_met": faults,
    }


@dataclass(frozen=True, kw_only=True)
class EnvelopeOptions:
    """Options of ``envelope``."""

    records: Annotated[tuple[str, ...], Argument("files of a recorder", "RECORD")]
    rule: Annotated[
        Literal["max", "P95/50", "P95/90", "P99/90"], Option("largest, or tolerance limit (share / confidence)")
    ] = "max"
    value_unit: Annotated[str | None, Option("unit of the values (g, m/s2), or the factor to m/s2", "UNIT")] = None
    column: Annotated[str | None, Option("name or number of the column of the values", "NAME")] = None
    lowest: Annotated[float | None, Option("first frequency (default: 1 / shortest duration)", "HZ")] = None
    highest: Annotated[float | None, Option("last frequency (default: lowest sampling rate / 10)", "HZ")] = None
    per_octave: Annotated[int, Option("frequencies per octave", "N")] = 6
    quality: Annotated[float, Option("amplification of the oscillators", "Q")] = 10.0
    output: Annotated[Path | None, Option("default: envelope.csv", "SPEC.csv", "-o")] = None


@command(_ENVELOPE_EXAMPLES)
def envelope(options: EnvelopeOptions) -> int:
    """Make a shock specification from the spectra of several records."""
    import numpy as np

    from ..results.writing import write_bytes
    from ..shock.envelopes import largest_of, tolerance_factor, tolerance_limit

    (target,) = targets_of(options.output or Path("envelope"), "csv")
    count = len(options.records)
    if options.rule != "max" and count < 3:
        problem = Problem("RECORD", "a tolerance limit needs a spread", str(count), "3 records or more")
        raise InputError([problem], "no envelope")
    ends = [_span(options, file) for file in options.records]
    lowest = options.lowest or max(first for first, _ in ends)
    highest = options.highest or min(last for _, last in ends)
    if not lowest < highest:
        problem = Problem("--lowest", "no frequencies that all records have", f"{lowest:.4g} to {highest:.4g} Hz")
        raise InputError([problem], "no envelope")
    requested = {"lowest": lowest, "highest": highest, "per_octave": options.per_octave, "quality": options.quality}
    spectra = [record_spectrum(_law(options, file), requested)[0] for file in options.records]
    table = np.stack([spectrum.acceleration[0] for spectrum in spectra])
    if options.rule == "max":
        words, limit = "largest", largest_of(table)
    else:
        covered, confidence = _RULES[options.rule]
        factor = tolerance_factor(count, covered, confidence)
        words, limit = f"{options.rule}, factor {factor:.4g}", tolerance_limit(table, covered, confidence)
    rows = [f"{f:.9g},{a:.9g}" for f, a in zip(spectra[0].frequency, limit, strict=True)]
    head = f"# {words} of {listed(list(options.records))}; Q {options.quality:g}"
    write_bytes(target, "\n".join([head, "frequency [Hz],acceleration [m/s2]", *rows, ""]).encode())
    print(f"{words} of {count} records, {lowest:.4g} to {highest:.4g} Hz, Q {options.quality:g}: {target}")
    return CONVERGED


def _law(options: EnvelopeOptions, file: str) -> dict[str, Any]:
    """Keys of the law of a record."""
    said = {"value_unit": options.value_unit, "column": options.column}
    return {"file": file, "start": "record"} | {k: number_or_text(v) for k, v in said.items() if v is not None}


def _span(options: EnvelopeOptions, file: str) -> tuple[float, float]:
    """First and last frequency that a record has by itself, Hz."""
    spectrum = record_spectrum(_law(options, file), {"quality": options.quality, "per_octave": 1})[0]
    return float(spectrum.frequency[0]), float(spectrum.frequency[-1])
