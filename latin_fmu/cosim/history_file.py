"""Load histories from a CSV or netCDF file."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..errors import InputError, Problem
from ..latin.record import Array

Histories = dict[str, tuple[Array, Array]]


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
        raise InputError(problems, "the load histories cannot be used")
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
        raise InputError([Problem(where, what)], "the load histories cannot be used")
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
    return InputError([Problem(str(file), what, None, None, remedy)], "the load histories cannot be used")
