"""Loads set from outside: values and rates over a step, or whole histories."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError, Problem
from ..latin.record import Array
from ..latin.state_serialization import check_like, check_numbers, unlike
from ..scene.laws import InputLaw
from ..scene.schema import Scene
from .variables import HOLD, LINE, input_loads

Curve = tuple[tuple[float, ...], tuple[float, ...]]
"""Times, s, strictly increasing, and amplitudes between which a load was linear."""

Histories = dict[str, tuple[Array, Array]]
"""Times, s, and amplitudes by load."""

_HEADING = "the load histories cannot be used"


class Loads:
    """Loads set from outside, for the next step and over a simulation.

    Attributes
    ----------
    value, rate : amplitude at the start of the next step and its rate (1/s), by load. histories : of prescribed mode.
    """

    def __init__(self, scene: Scene) -> None:
        self._start = {name: _start_value(scene, name) for name in input_loads(scene)}
        self.reset()

    def reset(self) -> None:
        """Set every load to its start value; remove the histories."""
        self.value = dict(self._start)
        self.rate = dict.fromkeys(self._start, 0.0)
        self._reached = dict(self._start)  # at the end of the last step
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
            allowed = ", ".join(self._start) or 'none: give a load law = "input"'
            raise InputError([Problem(f"load {name}", "not set from outside", None, allowed)])

    def not_finite(self) -> str:
        """The first value or rate that is not finite, as text; empty where all are finite."""
        for name in self._start:
            for what, number in (("value", self.value[name]), ("rate", self.rate[name])):
                if not math.isfinite(number):
                    return f"load.{name}.{what} = {number!r}"
        return ""

    # -- over a simulation ----------------------------------------------------------------------------------------
    def begin(self) -> None:
        """Start a simulation with the present values."""
        self._reached = dict(self.value)
        self._initial = {name: self.get(name) for name in self._start}

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

    def amplitudes(self, h: float, n: int, rule: int) -> dict[str, Array]:
        """Amplitudes (n + 1,) over a step of h, s, in n parts. rule : HOLD, RATE or LINE."""
        return {name: self._amplitude(name, h, n, rule) for name in self._start}

    def _amplitude(self, name: str, h: float, n: int, rule: int) -> Array:
        value = self.value[name]
        if rule == HOLD:
            return np.full(n + 1, value)
        if rule == LINE:
            return np.linspace(self._reached[name], value, n + 1)
        line: Array = value + self.rate[name] * np.linspace(0.0, h, n + 1)
        return line

    def accept(self, amplitudes: Mapping[str, Array]) -> None:
        """Keep the amplitudes at the end of an accepted step."""
        self._reached = {name: float(a[-1]) for name, a in amplitudes.items()}

    # -- state ----------------------------------------------------------------------------------------------------
    def get_state(self) -> dict[str, Any]:
        """Everything that was set."""
        return {
            "value": self.value,
            "rate": self.rate,
            "reached": self._reached,
            "initial": {name: list(pair) for name, pair in self._initial.items()},
            "histories": {name: list(pair) for name, pair in self.histories.items()},
        }

    def check_state(self, state: Any) -> None:
        """Compare a state that came from outside with these loads. Raises InputError."""
        own = self.get_state()
        check_like(state, own, "state.loads", free=("initial", "histories"))
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
        self.value, self.rate, self._reached = state["value"], state["rate"], state["reached"]
        self._initial = {name: (a, b) for name, (a, b) in state["initial"].items()}
        self.histories = {name: (t, a) for name, (t, a) in state["histories"].items()}


def _start_value(scene: Scene, name: str) -> float:
    law = scene.load[name].law
    assert isinstance(law, InputLaw)
    return law.start_value


# -- histories from a file ----------------------------------------------------------------------------------------
def read_histories(path: str | Path, loads: Sequence[str]) -> Histories:
    """Times and amplitudes of loads, by name.

    path : CSV with a header ``time,NAME,...``, or netCDF (.nc) with variables NAME(time).
    loads : names a column may have; a load without a column keeps its start value.

    Raises
    ------
    InputError : the file cannot be read, a column belongs to no load, numbers are missing or not finite, times do
        not increase.
    """
    file = Path(path)
    if not file.is_file():
        raise _bad(file, "no such file", "give the path of a CSV or netCDF file")
    columns = _netcdf(file) if file.suffix in (".nc", ".nc4", ".cdf") else _csv(file)
    if "time" not in columns:
        raise _bad(file, "no time column", "call the column of times 'time'")
    times = columns.pop("time")
    problems = [
        Problem(f"{file}: {name}", "no load of this name is set from outside", None, ", ".join(loads) or "none")
        for name in columns
        if name not in loads
    ]
    if problems:
        raise InputError(problems, _HEADING)
    return {name: check_history(f"{file}: {name}", times, values) for name, values in columns.items()}


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


def _csv(file: Path) -> dict[str, Array]:
    try:
        with file.open(newline="", encoding="utf-8-sig") as stream:
            rows = [row for row in csv.reader(stream) if row]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise _bad(file, f"cannot be read ({error})") from None
    if len(rows) < 2:
        raise _bad(file, "no rows of numbers", "a header line, then one line per instant")
    names = [name.strip() for name in rows[0]]
    try:
        table = np.array([[float(cell) for cell in row] for row in rows[1:]])
    except ValueError as error:
        raise _bad(file, f"not a table of numbers ({error})") from None
    if table.ndim != 2 or table.shape[1] != len(names):
        raise _bad(file, "the rows are not as long as the header")
    return {name: table[:, i] for i, name in enumerate(names)}


def _netcdf(file: Path) -> dict[str, Array]:
    import xarray as xr

    try:
        with xr.open_dataset(file, engine="netcdf4", decode_times=False, decode_timedelta=False) as dataset:
            columns = {str(name): np.asarray(v.values, dtype=float) for name, v in dataset.data_vars.items()}
            if "time" in dataset.coords:
                columns["time"] = np.asarray(dataset["time"].values, dtype=float)
    except (OSError, ValueError, RuntimeError) as error:
        raise _bad(file, f"cannot be read ({error})") from None
    return columns


def _bad(file: Path, what: str, remedy: str | None = None) -> InputError:
    return InputError([Problem(str(file), what, None, None, remedy)], _HEADING)
