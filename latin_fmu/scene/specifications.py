"""Specifications of shocks and random vibrations in files and scenes, and what laws have from them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np

from ..shock.base_histories import WAVES as _WAVES
from ..shock.base_histories import BaseHistory, TestStand, Waves, base_history, sampling_problems
from ..shock.specification import Specification, breakpoint_problems
from .fields import refusal
from .number_files import factor, number_table
from .records import column_unit, named_unit
from .unit_texts import DENSITY, names_for, si_unit, words_for
from .units import UnitSystem

_FREQUENCY: Final = "Hz"
_EXAMPLE_UNITS: Final = {"m s-1": "m/s", "m": "mm", DENSITY: "g^2/Hz"}  # of messages
_NAMED = 6  # frequencies outside a specification in a message


def read_breakpoints(
    base_dir: Path, name: str, unit: Any, system: UnitSystem, of: str = "m s-2"
) -> tuple[list[float], list[float]]:
    """Frequencies, Hz, and values, in units of the scene, of the breakpoints of a file; ``of`` : their unit in SI
    (UDUNITS), that of an acceleration unless said.

    Raises the refusal of the law: lines that are no breakpoint, a unit that is missing or one of something else.
    """
    table = number_table(base_dir, name)
    along, head = (column_unit(table, i) for i in (0, 1))
    what_of = words_for(of).removeprefix("an ").removeprefix("a ") + "s"
    if along and along.casefold() != _FREQUENCY.casefold():
        raise refusal(f"the header gives the frequencies in {along[:20]}", allowed=f"two columns, Hz and {what_of}")
    if unit is None and system.measurable:
        unit, what = named_unit(head, False), "the header names no unit"
        if head:
            what = f"the header gives the {what_of} in {head[:20]}"
        if not head or unit is None or si_unit(unit) != of:
            what = f"the unit of the {what_of} is unknown: {what}"
            example = _EXAMPLE_UNITS.get(of, "g")
            remedy = f'write unit = "{example}", or the header "frequency [Hz], {what_of[:-1]} [{example}]"'
            raise refusal(what, allowed=names_for(of), remedy=remedy)
    frequency, values = (list(column) for column in zip(*table.rows, strict=True))
    for row, what, value, allowed in breakpoint_problems(frequency, values):
        raise refusal(f"line {table.lines[min(row, len(table.lines)) - 1]}: {what}", value=value, allowed=allowed)
    size = factor(unit, system)
    return frequency, [size * v for v in values]


@dataclass(frozen=True)
class Request:
    """A base history that is asked for (``shock.base_histories.base_history``), in the units of a scene."""

    specification: Specification
    waves: Waves
    tolerance: float
    seeds: int
    stand: TestStand

    @staticmethod
    def of(data: Mapping[str, Any], base_dir: Path, system: UnitSystem) -> Request:
        """That of the keys of a law.

        Raises the refusal of the law: no breakpoints, breakpoints that are none, a rate too low for them.
        """
        frequency, acceleration = _breakpoints(data, base_dir, system)
        peak, velocity, displacement = (data.get(key) or np.inf for key in _LIMITED)
        specification = Specification(np.array(frequency), np.array(acceleration), float(data.get("quality", 10.0)))
        stand = TestStand(peak, velocity, displacement, data.get("duration"), data.get("rate"))
        for problem in sampling_problems(specification, stand):
            raise refusal(problem.what, value=problem.value, allowed=problem.allowed)
        return Request(
            specification,
            data.get("waves", "wavelets"),
            float(data.get("tolerance", 1.0)),
            int(data.get("seeds", 5)),
            stand,
        )

    def history(self, progress: Callable[[str], None] | None = None) -> BaseHistory:
        """The history; ``progress`` : called with a line a seed."""
        return base_history(
            self.specification,
            self.waves,
            tolerance=self.tolerance,
            seeds=range(self.seeds),
            stand=self.stand,
            progress=progress,
        )


def with_history(data: Mapping[str, Any], base_dir: Path, system: UnitSystem) -> dict[str, Any]:
    """The keys of a law of a specification with its times and values, and in words how well it is met.

    Raises the refusal of the law: as ``Request.of``, and a specification that is not met.
    """
    numbers = [data[key] for key in _NUMBERS if data.get(key) is not None]
    # keys that are wrong by themselves are reported as such
    if not all(_is_number(value) and value > 0 for value in numbers) or data.get("waves", _WAVES[0]) not in _WAVES:
        return dict(data)
    request = Request.of(data, base_dir, system)
    history = _history(_Compared(repr(request), request))
    if not history.meets(request.tolerance):
        remedy = (
            "see latin-fmu base, which writes the best history there is; more seeds, a longer duration, a larger "
            "tolerance or other limits may do"
        )
        words = "; ".join(missed(history, request.tolerance, system))
        raise refusal(f"no history meets the specification: {words}", remedy=remedy)
    points = {"times": tuple(history.time.tolist()), "values": tuple(history.acceleration.tolist())}
    words = (
        f"specification of {len(request.specification.frequency)} breakpoints, Q {history.specification.quality:g}, "
        f"met within {history.error:.2g} dB by seed {history.seed}"
    )
    return {**data, **points, "read_as": words}


@dataclass(frozen=True)
class _Compared:
    """A request that is compared by its text."""

    text: str
    request: Request = field(compare=False)


@lru_cache(maxsize=16)
def _history(of: _Compared) -> BaseHistory:
    """The history of a request, which a scene that is read several times needs once."""
    return of.request.history()


def missed(history: BaseHistory, tolerance: float, units: UnitSystem) -> list[str]:
    """What a history misses of its specification and its limits, in words; ``units`` : of its values."""
    outside, words = history.outside(tolerance), []
    if len(outside):
        some = ", ".join(f"{f:.4g}" for f in outside[:_NAMED])
        more = f" and {len(outside) - _NAMED} more" if len(outside) > _NAMED else ""
        words.append(f"off by up to {history.error:.3g} dB (allowed: {tolerance:g} dB) at {some}{more} Hz")
    for name, (value, limit) in history.excess.items():
        unit = units[_LIMITED[name]]
        words.append(f"{name} {value:.4g} {unit} above its limit {limit:.4g} {unit}")
    return words


_NUMBERS: Final = ("quality", "tolerance", "seeds", "duration", "rate", "peak", "velocity", "displacement")
_LIMITED: Final = {"peak": "m s-2", "velocity": "m s-1", "displacement": "m"}


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def with_density(data: Mapping[str, Any], base_dir: Path, system: UnitSystem) -> dict[str, Any]:
    """The keys of a law of a random vibration with its breakpoints in the units of the scene, and without file and
    unit.

    Raises the refusal of the law: no breakpoints, breakpoints that are none, a unit of something else.
    """
    unit = data.get("unit")
    if isinstance(unit, str) and si_unit(unit) != DENSITY:
        return dict(data)  # keys that are wrong by themselves are reported as such
    frequency, density = _breakpoints(data, base_dir, system, "density", DENSITY)
    rest = {key: value for key, value in data.items() if key not in ("file", "unit")}
    if data.get("file"):
        rest["read_as"] = f"{data['file']}, {len(frequency)} breakpoints"
    return {**rest, "frequency": frequency, "density": density}


def _breakpoints(
    data: Mapping[str, Any], base_dir: Path, system: UnitSystem, values_of: str = "acceleration", of: str = "m s-2"
) -> tuple[list[float], list[float]]:
    """Breakpoints of the file, or of the scene; ``values_of`` : key of their values, whose unit is ``of``."""
    listed = [data.get(key) or () for key in ("frequency", values_of)]
    file = data.get("file")
    if bool(file) == any(map(len, listed)):
        raise refusal("a specification is a file, or breakpoints", allowed=f"file, or frequency and {values_of}")
    if file:
        return read_breakpoints(base_dir, str(file), data.get("unit"), system, of)
    frequency, acceleration = (list(values) for values in listed)
    for row, what, value, allowed in breakpoint_problems(frequency, acceleration):
        raise refusal(f"breakpoint {row}: {what}", value=value, allowed=allowed)
    return frequency, acceleration
