"""Measured data: tables with named columns, checked against the scene.

The first column is the abscissa of the others, and gives the kind of data:

====================  ==========  ======================================================================
first column          kind        further columns
====================  ==========  ======================================================================
``time``              history     ``SENSOR.displacement.x``, ``.velocity.``, ``.acceleration.``, each also
                                  ``_filtered``; ``INTERFACE.force.x``, ``INTERFACE.normal_force``;
                                  ``BOLT.tension``
``frequency``         spectrum    ``SENSOR.srs.x``: shock response spectrum, maximax acceleration
``mode``              modes       ``frequency`` of the elastic mode of this number, from 1
``amplitude``, or     backbone    ``frequency`` and ``damping`` (ratio to critical) of a mode, of the sensor or
``SENSOR.amplitude``              of the point that moves most
====================  ==========  ======================================================================

``NAME.sd`` is the standard deviation of the column ``NAME``. Numbers are in the units of the scene, or in the unit that
follows a name in brackets, ``tip.acceleration.x [g]``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal

import numpy as np
from pydantic_core import PydanticCustomError

from ..building import discretise
from ..errors import InputError, Problem, Problems, did_you_mean, listed
from ..latin.outcome import Array
from ..results.quantities import AXES, FILTERED, SENSOR
from ..scene.number_files import table_cells
from ..scene.quantity_table import (
    ACCELERATION_PEAK,
    ACCELERATION_UNFILTERED,
    DISPLACEMENT,
    DISPLACEMENT_PEAK,
    DISPLACEMENT_RMS,
    FORCE_RMS,
    IMPULSE,
    LARGEST_BOLT_FORCE,
    PEAK_FORCE,
    SPECTRUM,
    VELOCITY_RMS,
    VELOCITY_UNFILTERED,
    QuantityOfInterest,
)
from ..scene.schema import Scene
from ..scene.sensors import highest_frequency
from ..scene.unit_texts import names_for, unit_size

HEADING: Final = "the calibration cannot be made"
Kind = Literal["history", "spectrum", "modes", "backbone"]
_KINDS: Final[dict[str, Kind]] = {"time": "history", "frequency": "spectrum", "mode": "modes", "amplitude": "backbone"}
_ALONG_UNIT: Final = {"history": "s", "spectrum": "Hz", "modes": "1", "backbone": "m"}
_SCALARS: Final = ("normal_force", "tension")
_HEADER: Final = re.compile(r"(.+?)\s*(?:\[([^\]]*)\])?")
_SD: Final = ".sd"
_MOST_SAID: Final = 20  # problems of one file
_MOST_MODES: Final = 1000
_SMALL: Final = 0.1  # of the largest value of a column: smaller values have the standard deviation of this one


@dataclass(frozen=True)
class Measurable:
    """Result that a column of measured data is compared with.

    Attributes
    ----------
    owner : kind of table of the scene that has it, empty of modes and backbones. unit : UDUNITS, SI.
    motion : field of the history of a sensor, else empty. filtered : whether it is behind the filter of the sensor.
    flags : keys of the scalars of ``results.sensitivities`` whose flags are those of its derivatives.
    error : quantity whose estimated error is that of the run, None where there is none.
    """

    owner: str
    unit: str
    flags: tuple[str, ...] = ()
    error: QuantityOfInterest | None = None
    motion: str = ""
    filtered: bool = False

    @property
    def table(self) -> str:
        """Field of a solution, and of its derivatives, that has the histories of the owners by name."""
        return f"{self.owner}s"


def _motions(name: str, flags: tuple[str, ...], error: QuantityOfInterest) -> dict[str, Measurable]:
    """A motion of a sensor by its name, and behind the filter."""
    own = Measurable("sensor", str(SENSOR[name].unit), flags, error, name)
    return {name: own, FILTERED[name].name: replace(own, filtered=True)}


_ACCELERATION: Final = _motions("acceleration", (ACCELERATION_UNFILTERED.key,), ACCELERATION_PEAK)
_RESULTANT: Final = Measurable("interface", "N", (PEAK_FORCE.key, IMPULSE.key), FORCE_RMS)
MEASURABLE: Final = {
    **_motions("displacement", (DISPLACEMENT.key, DISPLACEMENT_PEAK.key), DISPLACEMENT_RMS),
    **_motions("velocity", (VELOCITY_UNFILTERED.key,), VELOCITY_RMS),
    **_ACCELERATION,
    "srs": replace(_ACCELERATION["acceleration"], error=SPECTRUM),
    "force": _RESULTANT,
    "normal_force": _RESULTANT,
    "tension": Measurable("bolt", "N", (LARGEST_BOLT_FORCE.key,), LARGEST_BOLT_FORCE),
    "frequency": Measurable("", "Hz"),
    "damping": Measurable("", "1"),
}
"""Results by the quantity in the name of a column."""


@dataclass(frozen=True)
class Column:
    """Measured values of one quantity.

    Attributes
    ----------
    name : as in the header. owner, quantity, axis : its parts; axis 0, 1, 2, None of a scalar.
    values : (n,) in the units of the scene. sd : (n,) standard deviations, None where they are not given.
    """

    name: str
    owner: str
    quantity: str
    axis: int | None
    values: Array
    sd: Array | None

    @property
    def of(self) -> Measurable:
        """Result that the column is compared with."""
        return MEASURABLE[self.quantity]

    @property
    def unit(self) -> str:
        """UDUNITS unit, in SI."""
        return self.of.unit

    def scatter(self, level: bool) -> Array:
        """Standard deviations (n,), up to a common factor where none are given: then of a ``level`` (a frequency, a
        damping, a spectrum) in proportion to its values, of a history alike at all instants, its root mean square."""
        if self.sd is not None:
            return self.sd
        size = np.abs(self.values)
        if level:
            return np.asarray(np.maximum(size, _SMALL * size.max()))
        return np.full(len(size), math.sqrt(float(np.mean(size**2))) or 1.0)


@dataclass(frozen=True)
class MeasuredTable:
    """A table of measured data.

    Attributes
    ----------
    path : its file. kind : of data. along : (n,) first column, increasing. sensor : whose amplitude a backbone has.
    """

    path: str
    kind: Kind
    along: Array
    columns: tuple[Column, ...]
    sensor: str | None = None

    @property
    def along_name(self) -> str:
        """Name of the first column."""
        return next(name for name, kind in _KINDS.items() if kind == self.kind)

    @property
    def along_unit(self) -> str:
        """Its unit, UDUNITS, SI."""
        return _ALONG_UNIT[self.kind]

    def scatter(self) -> list[Array]:
        """Standard deviations of each column, see ``Column.scatter``."""
        return [column.scatter(self.kind != "history") for column in self.columns]


def read_measured(paths: Sequence[str | Path], scene: Scene) -> list[MeasuredTable]:
    """Tables of measured data of a scene.

    Raises
    ------
    InputError : with all problems of all files, each with its line.
    """
    owners = {"sensor": list(scene.sensor), "bolt": list(scene.bolt), "interface": list(scene.joints)}
    problems, made = Problems(), []
    files = [Path(path).resolve() for path in paths]
    for path in dict.fromkeys(path for path, file in zip(paths, files, strict=True) if files.count(file) > 1):
        problems.add(str(path), "the file is given twice: its data would count twice")
    for path in paths:
        reader = _Reader(str(path), scene, owners)
        table = reader.read()
        problems += [*reader.problems[:_MOST_SAID]]
        if (more := len(reader.problems) - _MOST_SAID) > 0:
            problems.add(str(path), f"and {more} more problems")
        if table is not None:
            made += [table]
    if not paths:
        problems.add("DATA", "no data", remedy="name a file of measured data")
    if problems:
        raise InputError(problems, HEADING)
    return made


class _Reader:
    """Reads one file; what is wrong is in ``problems``."""

    def __init__(self, path: str, scene: Scene, owners: dict[str, list[str]]) -> None:
        self._path, self._scene, self._owners, self.problems = path, scene, owners, Problems()
        self._header_line = 1

    def _say(self, what: str, line: int | None = None, **more: str | None) -> None:
        self.problems.append(Problem(self._path, what, line=line, **more))

    def read(self) -> MeasuredTable | None:
        """The table, None where its header or its rows cannot be used."""
        try:
            lines = list(table_cells(Path(), self._path))
        except PydanticCustomError as error:
            said = {key: str(value) for key, value in (error.context or {}).items() if value}
            what, value = said.get("what", str(error)), said.get("value")
            self._say(what, value=value, allowed=said.get("allowed"), remedy=said.get("remedy"))
            return None
        if len(lines) < 2:
            self._say(
                "no rows of numbers below a header", remedy="the first line names the columns: time,tip.velocity.x"
            )
            return None
        (self._header_line, header), rows = lines[0], lines[1:]
        names, factors = self._names(header)
        first = names[0].rpartition(".")
        # SENSOR.amplitude alone may have an owner
        kind = _KINDS.get(first[2]) if not first[0] or first[2] == "amplitude" else None
        if kind is None:
            allowed, remedy = ", ".join((*_KINDS, "SENSOR.amplitude")), did_you_mean(names[0], _KINDS)
            self._say("unknown first column", self._header_line, value=names[0], allowed=allowed, remedy=remedy)
            return None
        sensor = first[0] or None
        if sensor is not None and sensor not in self._owners["sensor"]:
            self._unknown(names[0], "sensor", sensor)
        parts = {name: part for name in names[1:] if not name.endswith(_SD) and (part := self._column(kind, name))}
        self._pairs(names)
        units = [
            _ALONG_UNIT[kind],
            *(MEASURABLE[parts[base][1]].unit if (base := n.removesuffix(_SD)) in parts else "" for n in names[1:]),
        ]
        scales = self._scales(names, factors, units)
        table = self._numbers(names, rows) * scales
        if self.problems:
            return None
        self._limits(kind, names, table, [number for number, _ in rows])
        for i, name in enumerate(names[1:], 1):
            if name in parts and name + _SD not in names and not table[:, i].any():
                remedy = f"add {name}{_SD}, or remove the column"
                self._say(
                    "every value is 0, and no standard deviation is given", self._header_line, value=name, remedy=remedy
                )
        # rows of one abscissa keep their order
        order = np.argsort(table[:, 0], kind="stable")
        by_name: Mapping[str, Array] = {name: table[order, i] for i, name in enumerate(names)}
        columns = tuple(Column(n, *part, by_name[n], by_name.get(n + _SD)) for n, part in parts.items())
        return MeasuredTable(self._path, kind, table[order, 0], columns, sensor)

    def _names(self, header: Sequence[str]) -> tuple[list[str], list[str]]:
        """Names of the columns, and the units in brackets behind them, "" where there are none."""
        found = [_HEADER.fullmatch(cell.strip()) for cell in header]
        # "tip velocity x [m s-1]", as ``latin-fmu export`` writes it, is tip.velocity.x [m/s]
        names = ["" if match is None else ".".join(match[1].split()) for match in found]
        for name in dict.fromkeys(n for n in names if names.count(n) > 1):
            self._say("the column is there twice", self._header_line, value=name or "without a name")
        units = ["" if match is None else match[2] or "" for match in found]
        return names, units

    def _pairs(self, names: Sequence[str]) -> None:
        for name in names:
            if name.endswith(_SD) and name.removesuffix(_SD) not in names[1:]:
                what = "a standard deviation without its column"
                self._say(what, self._header_line, value=name, remedy=f"add {name.removesuffix(_SD)}, or remove it")
        if len([n for n in names[1:] if not n.endswith(_SD)]) == 0:
            self._say("no column of measured values", self._header_line)

    def _column(self, kind: Kind, name: str) -> tuple[str, str, int | None] | None:
        """Owner, quantity and axis of a column, None where it is wrong."""
        if kind in ("modes", "backbone"):
            known = ("frequency", "damping") if kind == "backbone" else ("frequency",)
            if name not in known:
                allowed, remedy = ", ".join(known), did_you_mean(name, known)
                self._say("no such column", self._header_line, value=name, allowed=allowed, remedy=remedy)
                return None
            return "", name, None
        parts = name.split(".")
        if len(parts) in (2, 3):
            quantity = parts[1]
        else:
            quantity = ""
        quantities = [q for q, of in MEASURABLE.items() if of.owner and (q == "srs") == (kind == "spectrum")]
        axes = [] if quantity in _SCALARS else list(AXES)
        if quantity not in quantities or len(parts) != 2 + bool(axes) or (axes and parts[2] not in axes):
            if kind == "spectrum":
                form = "SENSOR.srs.x"
            else:
                form = "SENSOR.acceleration.x, INTERFACE.force.z, BOLT.tension"
            allowed = f"{form}; quantities: {', '.join(quantities)}"
            self._say("no such column", self._header_line, value=name, allowed=allowed)
            return None
        of = MEASURABLE[quantity]
        where = of.owner
        # builds the scene, which takes seconds: only where the name is not one of the scene
        if where == "interface" and self._scene.contact and parts[0] not in self._owners[where]:
            self._owners[where] = [u.name for u in discretise(self._scene).units]  # with those found by searches
        if parts[0] not in self._owners[where]:
            self._unknown(name, where, parts[0])
            return None
        if of.filtered and self._scene.sensor[parts[0]].filter is None:
            remedy = f"add sensor.{parts[0]}.filter, or compare {of.motion}"
            self._say("the sensor has no filter", self._header_line, value=name, remedy=remedy)
        if self._scene.time.quasi_static and of.motion not in ("", "displacement"):
            self._say("a quasi-static run has displacements alone", self._header_line, value=name)
        return parts[0], quantity, axes.index(parts[2]) if axes else None

    def _unknown(self, name: str, where: str, owner: str) -> None:
        known = self._owners[where]
        remedy = did_you_mean(owner, known) or (None if known else f"add a [{where}.{owner}] table to the scene")
        self._say(f"no {where} of this name", self._header_line, value=name, allowed=listed(known), remedy=remedy)

    def _scales(self, names: Sequence[str], factors: Sequence[str], units: Sequence[str]) -> Array:
        """Factors to the units of the scene, by column."""
        scales = np.ones(len(names))
        for i, (name, given, unit) in enumerate(zip(names, factors, units, strict=True)):
            if not given or not unit:
                continue
            if (size := unit_size(given, unit)) is None:
                value, allowed = f"{name} [{given}]", names_for(unit)
                self._say("not a unit of this column", self._header_line, value=value, allowed=allowed)
            else:
                scales[i] = size / self._scene.unit_system.exact_size(unit)
        return scales

    def _numbers(self, names: Sequence[str], rows: Sequence[tuple[int, list[str]]]) -> Array:
        """The table (n, n_column); NaN where something is wrong."""
        table = np.full((len(rows), len(names)), np.nan)
        for row, (number, cells) in enumerate(rows):
            if len(cells) != len(names):
                self._say(f"{len(cells)} cells in a table of {len(names)} columns", number)
                continue
            for i, cell in enumerate(cells):
                with suppress(ValueError):
                    table[row, i] = float(cell)
                if not math.isfinite(table[row, i]):
                    remedy = "remove the row, or put the columns into files of their own"
                    self._say(f"no finite number for {names[i]}", number, value=cell[:40] or "nothing", remedy=remedy)
        return table

    def _limits(self, kind: Kind, names: Sequence[str], table: Array, numbers: Sequence[int]) -> None:
        """Values out of the range of the run, or that no measurement gives."""
        time, along = self._scene.time, table[:, 0]
        if kind == "history":
            wrong, allowed = (along < 0.0) | (along > time.end * (1 + 1e-9)), f"0 to {time.end:g}, the end of the run"
            what, remedy = "an instant outside the run", "set time.end, or shift the times of the data"
        elif kind == "spectrum":
            limit = highest_frequency(time.end / time.n_step)
            wrong = (along <= 0.0) | (along > limit * (1 + 1e-9))
            allowed = f"above 0, up to {limit:.4g} Hz (0.4 of the sampling rate)"
            what, remedy = "a frequency that the run does not have", "take a shorter time.step, or remove the row"
        elif kind == "modes":
            wrong = (along < 1) | (along != np.round(along)) | (along > _MOST_MODES)
            allowed, remedy = f"1 to {_MOST_MODES}", "elastic modes count from 1, as latin-fmu modes lists them"
            what = "not a number of a mode"
        else:
            wrong = along <= 0.0
            allowed = "> 0"
            what = "not an amplitude"
            remedy = "remove the row"
        for i in np.flatnonzero(wrong).tolist():
            self._say(what, numbers[i], value=f"{along[i]:g}", allowed=allowed, remedy=remedy)
        for i, name in enumerate(names):
            positive = i > 0 and (name.endswith(_SD) or name == "frequency")
            for row in np.flatnonzero(table[:, i] <= 0.0).tolist() if positive else ():
                self._say(f"{name} must be above 0", numbers[row], value=f"{table[row, i]:g}")


def size_of(tables: Sequence[MeasuredTable]) -> int:
    """Number of data in all tables."""
    return sum(len(table.along) * len(table.columns) for table in tables)


def columns_of(tables: Sequence[MeasuredTable]) -> Iterator[tuple[MeasuredTable, Column, slice]]:
    """Every column with its table, and its place among all data."""
    first = 0
    for table in tables:
        for column in table.columns:
            yield table, column, slice(first, first + len(table.along))
            first += len(table.along)
