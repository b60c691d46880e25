"""Loads and motions set from outside: values and rates over a step, or whole histories.

Causal line: a load whose rate is not set goes on as the straight line through its last two values,

    u(t) = u_k + (u_k - u_(k-1)) / (t_k - t_(k-1)) (t - t_k),    u_k set at the start t_k of step k.

It is held over the first step, which has no value before it, and over a step at whose start it leaves a value that was
held before (u_(k-1) = u_(k-2)): a jump. A load may jump where a step begins. A motion goes on from the amplitude it has
reached: a jump of its value takes the first time step. A displacement enters through its rate.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ..errors import InputError, Problem
from ..file_digest import is_damaged
from ..latin.outcome import Array
from ..scene.number_files import MAX_FILE_BYTES
from ..scene.schema import Scene
from .input_table import given_of
from .variable import input_variable, is_wave, variable_of
from .variables import HOLD, LINE

Curve = tuple[tuple[float, ...], tuple[float, ...]]
"""Times, s, strictly increasing, and amplitudes between which a load was linear."""

Histories = dict[str, tuple[Array, Array]]
"""Times, s, and amplitudes by load."""


_HEADING = "the load histories cannot be used"


def rule_of(name: str, rule: int, rate: float) -> int:
    """Rule of one input. A wave without a rate is the straight line from its last value, as if it had travelled for the
    step: a wave that is held gains energy, and so does one that is extrapolated."""
    return LINE if is_wave(name) and rule != HOLD and rate == 0.0 else rule


class GivenLoads:
    """Loads as they are set from outside: values and rates, and histories of prescribed mode.

    Attributes
    ----------
    value, rate : amplitude at the start of the next step and its rate (1/s), by load. histories : by load.
    """

    def __init__(self, scene: Scene) -> None:
        self._start = {source.name: source.start for source in given_of(scene)}
        self.reset()

    def reset(self) -> None:
        """Set every load to its start value; remove the histories."""
        self.value = dict(self._start)
        self.rate = dict.fromkeys(self._start, 0.0)
        self._initial = dict(self._start)  # values when the simulation began
        self.histories: Histories = {}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the loads set from outside."""
        return tuple(self._start)

    def set(self, name: str, value: float, rate: float) -> None:
        """Set value and rate. Raises InputError for a load that is not set from outside."""
        self._check(name)
        self.value[name], self.rate[name] = float(value), float(rate)

    def get(self, name: str) -> tuple[float, float]:
        """Value and rate that were set. Raises InputError for a load that is not set from outside."""
        self._check(name)
        return self.value[name], self.rate[name]

    def set_history(self, name: str, times: Sequence[float] | Array, values: Sequence[float] | Array) -> None:
        """Set the history of a load; see ``Session.set_history``."""
        self._check(name)
        checked = check_history(f"history of load {name}", np.asarray(times), np.asarray(values))
        self.histories[name] = checked

    def _check(self, name: str) -> None:
        if name not in self._start:
            allowed = ", ".join(self._start) or 'none: give a load, a driven face or the ground law = "input"'
            raise InputError([Problem(variable_of(name), "not set from outside", None, allowed)])

    def given(self) -> Array:
        """Values and rates that are set, (n, 2), in the order of the loads."""
        return np.array([[*self.value.values()], [*self.rate.values()]]).T.copy()

    def begin(self) -> None:
        """Start a simulation with the present values."""
        self._initial = dict(self.value)

    def starts(self) -> dict[str, float]:
        """Amplitudes at the start of a simulation that begins now."""
        return self.value | {name: float(np.interp(0.0, *history)) for name, history in self.histories.items()}

    def curves(self, end: float) -> dict[str, Curve]:
        """Histories of the loads; a constant from 0 to ``end``, s, for a load without history."""
        curves: dict[str, Curve] = {name: ((0.0, end), (value, value)) for name, value in self._initial.items()}
        for name, (times, values) in self.histories.items():
            curves[name] = (tuple(map(float, times)), tuple(map(float, values)))
        return curves

    def take(self, given: Array, first: Array, histories: Mapping[int, tuple[Array, Array]]) -> None:
        """Take the inputs of a restored state: values and rates as they are and at the start, (n, 2), histories by
        number."""
        names = self.names
        self.value, self.rate = (dict(zip(names, column.tolist(), strict=True)) for column in given.T)
        self._initial = dict(zip(names, first[:, 0].tolist(), strict=True))
        self.histories = {names[i]: history for i, history in histories.items()}


# -- histories from a table ---------------------------------------------------------------------------------------
def read_histories(source: str | Path, loads: Sequence[str]) -> Histories:
    """Times and amplitudes of loads, by name.

    source : path of a CSV file with a header ``time,NAME,...`` or of a netCDF file (.nc) with variables NAME(time); or
        the CSV table itself, a text whose rows end in line breaks or semicolons.
    loads : names a column may have; a load without a column keeps its start value.

    Raises
    ------
    InputError : the file or table cannot be read, a column belongs to no load, numbers are missing or not finite,
        times do not increase.
    """
    where, columns = _columns(source)
    if "time" not in columns:
        raise _bad(where, "no time column", "call the column of times 'time'")
    times = columns.pop("time")
    problems = [
        Problem(
            f"{where}: column {name[:40]!r}" if name.isidentifier() else f"{where}: a column",
            "no load of this name is set from outside",
            None,
            ", ".join(loads) or "none",
        )
        for name in columns
        if name not in loads
    ]
    if problems:
        raise InputError(problems, _HEADING)
    return {name: check_history(f"{where}: {name}", times, values) for name, values in columns.items()}


def _columns(source: str | Path) -> tuple[str, dict[str, Array]]:
    """What messages call a table, and its columns by name."""
    if isinstance(source, str) and any(mark in source for mark in "\n\r;"):
        where = "historyFile, the table itself"
        if len(source) > MAX_FILE_BYTES:
            raise _bad(where, f"longer than {MAX_FILE_BYTES} characters")
        return where, _csv(source.lstrip("\ufeff").replace(";", "\n").splitlines(), where)
    file = Path(source)
    try:
        what = "" if file.is_file() else "not a regular file" if file.exists() else "no such file"
    except (OSError, ValueError) as error:  # a text that can be no path
        raise _bad(f"historyFile {str(source)[:40]!r}...", f"no path of a file ({error.args[-1]})") from None
    if what:
        remedy = "give the path of a CSV or netCDF file, or the table itself: 'time,NAME;0,0;1e-6,1'"
        raise _bad(str(file), what, remedy)
    if file.stat().st_size > MAX_FILE_BYTES:
        raise _bad(str(file), f"larger than {MAX_FILE_BYTES} bytes")
    if file.suffix in (".nc", ".nc4", ".cdf"):
        return str(file), _netcdf(file)
    try:
        lines = file.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise _bad(str(file), f"cannot be read ({' '.join(str(error).split())[:200]})") from None
    return str(file), _csv(lines, str(file))


def check_history(where: str, times: Array, values: Array) -> tuple[Array, Array]:
    """A history as double precision arrays.

    Raises InputError unless both are finite, of one length >= 1, and the times increase strictly.
    """
    t, a = np.atleast_1d(np.asarray(times, dtype=float)), np.atleast_1d(np.asarray(values, dtype=float))
    what = None
    if t.ndim != 1 or t.shape != a.shape or not len(t):
        what = f"{t.shape} times and {a.shape} values: both must be lists of one length"
    elif not (np.isfinite(t).all() and np.isfinite(a).all()):
        what = "a time or value is not a finite number"
    elif (np.diff(t) <= 0.0).any():
        what = "the times do not increase strictly"
    if what is not None:
        raise InputError([Problem(where, what)], _HEADING)
    return t, a


def given_rows(times: Array, amplitudes: Mapping[str, Array]) -> Histories:
    """Histories by load from arrays of a fixed size, without the rows at the end that repeat the last one.

    amplitudes : of one size with ``times``. All times equal and no amplitude that varies: no history is given.

    Raises
    ------
    InputError : the times do not increase, or rows after the last instant have another amplitude than there.
    """
    # products of True from the end: how many rows repeat the last instant
    repeated = int(np.cumprod(times[::-1] == times[-1]).sum())
    # one of the rows that repeat the last instant is that instant
    n = len(times) - max(repeated - 1, 0)
    if n == 1 and not any((values != values[0]).any() for values in amplitudes.values()):
        return {}
    if n == 1:
        allowed = "instants that increase, the last row repeated up to the size of the array"
        raise InputError([Problem("history.time", "all instants are equal", f"{times[0]:g}", allowed)], _HEADING)
    for name, values in amplitudes.items():
        if (values[n:] != values[n - 1]).any():
            where, what = input_variable(name, "history"), f"element {n} and those after it belong to one instant"
            raise InputError([Problem(where, what, None, "one amplitude", "repeat the last one")], _HEADING)
    return {
        name: check_history(input_variable(name, "history"), times[:n], values[:n])
        for name, values in amplitudes.items()
    }


def _csv(lines: Sequence[str], where: str) -> dict[str, Array]:
    try:
        rows = [row for row in csv.reader(lines) if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise _bad(where, f"cannot be read ({error})") from None
    if len(rows) < 2:
        raise _bad(where, "no rows of numbers", "a header line, then one line per instant")
    names = [name.strip() for name in rows[0]]
    if len(set(names)) < len(names):
        raise _bad(where, "two columns have the same name")
    # as editors count: the header is line 1
    for number, row in enumerate(rows[1:], 2):
        if len(row) != len(names):
            raise _bad(where, f"row {number} has {len(row)} columns, the header {len(names)}")
        if not all(is_number(cell) for cell in row):  # of the text nothing is quoted
            raise _bad(where, f"row {number} is not a row of numbers")
    table = np.array([[float(cell) for cell in row] for row in rows[1:]])
    return {name: table[:, i] for i, name in enumerate(names)}


def is_number(text: str) -> bool:
    """Whether a cell of a table is a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def _netcdf(file: Path) -> dict[str, Array]:
    import xarray as xr

    try:
        if is_damaged(file):
            raise _bad(str(file), "the file is damaged: its digest does not fit")
        # times as numbers, whatever unit the file names
        with xr.open_dataset(file, engine="netcdf4", decode_times=False, decode_timedelta=False) as dataset:
            columns = {str(name): np.asarray(v.values, dtype=float) for name, v in dataset.data_vars.items()}
            if "time" in dataset.coords:
                columns["time"] = np.asarray(dataset["time"].values, dtype=float)
    except InputError:
        raise
    except Exception as error:  # the library of a damaged file raises many kinds
        raise _bad(str(file), f"cannot be read ({' '.join(str(error).split())[:200]})") from None
    return columns


def _bad(where: str, what: str, remedy: str | None = None) -> InputError:
    return InputError([Problem(where, what, None, None, remedy)], _HEADING)
