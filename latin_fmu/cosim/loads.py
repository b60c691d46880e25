"""Loads and motions set from outside: values and rates over a step, or whole histories.

Causal line: a load whose rate is not set goes on as the straight line through its last two values,

    u(t) = u_k + (u_k - u_(k-1)) / (t_k - t_(k-1)) (t - t_k),    u_k set at the start t_k of step k.

It is held over the first step, which has no value before it, and over a step at whose start it leaves a value that was
held before (u_(k-1) = u_(k-2)): a jump. A load may jump where a step begins. A motion goes on from the amplitude it has
reached: a jump of its value takes the first time step. A displacement enters through its rate.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from inspect import unwrap
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..errors import InputError, Problem
from ..file_digest import is_damaged
from ..kernels import inputs
from ..latin.outcome import Array
from ..latin.state_serialization import check_like, check_numbers, unlike
from ..scene.laws import TableLaw
from ..scene.number_files import MAX_FILE_BYTES
from ..scene.schema import Scene
from .drives import sampler
from .input_table import given_of
from .variable import input_variable, is_wave, variable_of
from .variables import HOLD, LINE

Curve = tuple[tuple[float, ...], tuple[float, ...]]
"""Times, s, strictly increasing, and amplitudes between which a load was linear."""

Histories = dict[str, tuple[Array, Array]]
"""Times, s, and amplitudes by load."""


class GridPart(NamedTuple):
    """Part of the grid that a communication step takes: number of the time steps that end in it, and the fraction of a
    time step between the last instant and its end."""

    n: int
    rest: float


_HEADING = "the load histories cannot be used"
_placed = unwrap(inputs.placed)  # as Python: it takes a tenth of the time of a call of the library


def rule_of(name: str, rule: int, rate: float) -> int:
    """Rule of one input. A wave without a rate is the straight line from its last value, as if it had travelled for the
    step: a wave that is held gains energy, and so does one that is extrapolated."""
    return LINE if is_wave(name) and rule != HOLD and rate == 0.0 else rule


class GivenLoads:
    """Loads as they are set from outside: values and rates, and histories of prescribed mode.

    Attributes
    ----------
    value, rate : amplitude at the start of the next step and its rate (1/s), by load. histories : by load. kinds : of
    the loads (``kernels.inputs``).
    """

    def __init__(self, scene: Scene) -> None:
        given = given_of(scene)
        self._sources = {source.name: source for source in given}
        self._start = {source.name: source.start for source in given}
        self.kinds = np.array([source.drives for source in given], dtype=np.int64)
        self._displacements = {source.name for source in given if source.drives == inputs.DISPLACEMENT}
        self.reset()

    def reset(self) -> None:
        """Set every load to its start value; remove the histories."""
        self.value = dict(self._start)
        self.rate = dict.fromkeys(self._start, 0.0)
        self._initial: dict[str, tuple[float, float]] = {}  # value and rate when the simulation began
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

    def not_finite(self) -> str:
        """The first value or rate that is not finite, as text; empty where all are finite."""
        for name in self._start:
            if not math.isfinite(self.value[name]):
                return f"{input_variable(name, 'value')} = {self.value[name]!r}"
            if not math.isfinite(self.rate[name]):
                return f"{input_variable(name, 'rate')} = {self.rate[name]!r}"
        return ""

    def changed(self) -> str:
        """Name of the first load that was changed since ``begin``; empty where none was."""
        return next((name for name, initial in self._initial.items() if self.get(name) != initial), "")

    def initial_values(self) -> dict[str, float]:
        """Values at ``begin``; before it the present values."""
        return {name: pair[0] for name, pair in self._initial.items()} or dict(self.value)

    def curves(self, end: float) -> dict[str, Curve]:
        """Histories of the loads; a constant from 0 to ``end``, s, for a load without history."""
        curves: dict[str, Curve] = {name: ((0.0, end), (value, value)) for name, value in self.initial_values().items()}
        for name, (times, values) in self.histories.items():
            curves[name] = (tuple(map(float, times)), tuple(map(float, values)))
        return curves

    def starts(self) -> dict[str, float]:
        """Amplitudes of displacements at the start of the simulation."""
        initial = self.initial_values()
        initial |= {name: float(np.interp(0.0, *history)) for name, history in self.histories.items()}
        return {name: initial[name] for name in sorted(self._displacements)}

    def over(self, instants: Array) -> dict[str, Array]:
        """What drives a run at given instants, the last of which ends it: histories as laws of the scene would, else
        the present values; of displacements their rates."""
        end, driving = float(instants[-1]), dict[str, Array]()
        for name, source in self._sources.items():
            times, values = self.histories.get(name, (np.zeros(1), np.array([self.value[name]])))
            if len(times) == 1:
                driving[name] = np.full(len(instants), 0.0 if name in self._displacements else values[0])
                continue
            law = TableLaw(times=tuple(times.tolist()), values=tuple(values.tolist()))
            driving[name] = sampler(source._replace(law=law), end)(instants)
        return driving


class Loads(GivenLoads):
    """Loads set from outside, and what the steps so far have left of them.

    Attributes
    ----------
    memory, span : what the steps so far have left (``kernels.inputs``); ``behind``: the fraction of a time step since
    the last instant.
    """

    def reset(self) -> None:
        """Set every load to its start value; remove the histories, and what steps have left."""
        super().reset()
        self.memory: Array = np.zeros((inputs.N_MEMORY, len(self._start)))
        # amplitudes of the start value: reached, before it, and driven
        self.memory[[inputs.REACHED, inputs.BEFORE, inputs.DRIVEN]] = list(self._start.values())
        self.span = self.behind = 0.0

    # -- over a simulation ----------------------------------------------------------------------------------------
    def begin(self) -> None:
        """Start a simulation with the present values."""
        self.memory[[inputs.REACHED, inputs.DRIVEN]] = self._given()[0]
        self.memory[[inputs.HELD, inputs.RATED, inputs.CARRIED]], self.span, self.behind = 0.0, 0.0, 0.0
        self._initial = {name: self.get(name) for name in self._start}

    def _given(self) -> tuple[Array, Array]:
        """Values and rates that are set, in the order of the loads."""
        return np.array(list(self.value.values()), dtype=float), np.array(list(self.rate.values()), dtype=float)

    def driving(self, part: GridPart, dt: float, rule: int) -> dict[str, Array]:
        """What drives the run over the time steps of dt, s, that a step ends: amplitudes (n + 1,); of displacements
        their rates, 1/s, over the time steps. rule : HOLD, RATE, LINE or CAUSAL."""
        lines = np.zeros((len(self._start), part.n + 1))
        memory = self.memory.reshape(-1)
        inputs.interpolate(*self._given(), memory, self.kinds, self.span, dt, rule, self.behind, part.rest, lines)
        return dict(zip(self._start, lines, strict=True))

    def rates(self, rule: int) -> dict[str, float]:
        """Rates over the next step, 1/s: those set; under the rule CAUSAL of a load that never had one, and is no wave,
        that of the causal line."""
        rates = np.zeros(len(self._start))
        inputs.rates(*self._given(), self.memory.reshape(-1), self.kinds, self.span, rule, rates)
        return dict(zip(self._start, rates.tolist(), strict=True))

    def part(self, made: int, t: float, h: float, t0: float, dt: float) -> GridPart:
        """What of the grid of time steps of dt, s, the step from t to t + h, s, ends; ``made`` : time steps so far,
        since t0."""
        # round-off of both ends, in time steps
        off = 4e-16 * (abs(t) + abs(t + h)) / dt
        return GridPart(*_placed(made, self.behind, (t + h - t0) / dt, h / dt, off))

    def accept(self, part: GridPart, dt: float, rule: int, done: int | None = None) -> None:
        """End a step, at its end, or after ``done`` of its time steps of dt, s."""
        made, begin, memory = part.n if done is None else done, self.behind, self.memory.reshape(-1)
        self.span = inputs.accept(
            *self._given(), memory, self.kinds, self.span, dt, rule, made, part.n, begin, part.rest
        )
        # a step that ended early ends on the grid
        self.behind = part.rest if made == part.n else 0.0

    def copy(self) -> Loads:
        """The same loads, independent of these."""
        twin = Loads.__new__(Loads)
        # histories are not changed in place, and may be shared
        vars(twin).update(vars(self))
        twin.value, twin.rate, twin.memory = dict(self.value), dict(self.rate), self.memory.copy()
        return twin

    # -- state ----------------------------------------------------------------------------------------------------
    def get_state(self) -> dict[str, Any]:
        """Everything that was set."""
        return {
            "value": self.value,
            "rate": self.rate,
            "memory": self.memory,
            "span": self.span,
            "behind": self.behind,
            "initial": {name: list(pair) for name, pair in self._initial.items()},
            "histories": {name: list(pair) for name, pair in self.histories.items()},
        }

    def check_state(self, state: Any) -> None:
        """Compare a state that came from outside with these loads. Raises InputError."""
        own = self.get_state()
        check_like(state, own, "state.loads", free=("initial", "histories"))
        if not (state["span"] >= 0.0 and 0.0 <= state["behind"] < 1.0):
            raise unlike("state.loads", "a step before, or a part of a time step, that there cannot be")
        for name in ("initial", "histories"):
            if not isinstance(state[name], dict) or not set(state[name]) <= set(self._start):
                raise unlike(f"state.loads.{name}", "other loads than here")
            for load, pair in state[name].items():
                if not isinstance(pair, list) or len(pair) != 2:
                    raise unlike(f"state.loads.{name}.{load}", "no pair of numbers")
                check_numbers(pair, f"state.loads.{name}.{load}")
        for name, pair in state["histories"].items():
            check_history(f"state.loads.histories.{name}", *pair)

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore what ``get_state`` returned."""
        self.value, self.rate = state["value"], state["rate"]
        self.memory, self.span, self.behind = np.array(state["memory"]), state["span"], state["behind"]
        self._initial = {name: (a, b) for name, (a, b) in state["initial"].items()}
        self.histories = {name: (t, a) for name, (t, a) in state["histories"].items()}


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
