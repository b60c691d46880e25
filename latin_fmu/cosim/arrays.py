"""Array variables: instants of a window, fields of points, load histories. They are made when they are read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .variable import Variable

if TYPE_CHECKING:  # see ``participant``
    from ..latin.record import Array, InterfaceHistory
    from .session import Session

_SHARES = ("closed", "sticking", "slipping")


class ArrayReader:
    """Arrays of a table by reference."""

    def __init__(self, table: Sequence[Variable]) -> None:
        self._table = table
        self._arrays = frozenset(i for i, v in enumerate(table) if v.is_array)
        self._given: dict[int, Array] = {}
        self._read: dict[int, list[float]] = {}

    def clear(self) -> None:
        """Forget what was given and read."""
        self._given, self._read = {}, {}

    def changed(self) -> None:
        """The outputs have changed."""
        self._read = {}

    def has(self, references: Sequence[int]) -> bool:
        """Whether any of the references is an array."""
        return bool(self._arrays) and not self._arrays.isdisjoint(references)

    def size(self, reference: int, numbers: Array, place: Mapping[str, int]) -> int:
        """Number of elements."""
        sizes = (s if isinstance(s, int) else int(numbers[place[s]]) for s in self._table[reference].dimensions)
        return int(np.prod(list(sizes), dtype=np.int64))

    def write(self, reference: int, values: Sequence[float]) -> None:
        """Keep the values of an array parameter."""
        self._given[reference] = np.array(values, dtype=float)

    def read(self, reference: int, numbers: Array, place: Mapping[str, int], session: Session | None) -> list[float]:
        """Elements in row-major order."""
        size = self.size(reference, numbers, place)
        variable = self._table[reference]
        if variable.causality == "parameter":
            given = self._given.get(reference, np.zeros(0))
            return _fitted(given, (size,), 0.0)
        if reference not in self._read:
            shape = tuple(s if isinstance(s, int) else int(numbers[place[s]]) for s in variable.dimensions)
            values = np.zeros(0) if session is None else _values(variable.name, session, shape[0])
            self._read[reference] = _fitted(values, shape, np.nan)
        return self._read[reference]

    def count(self, session: Session, numbers: Array, place: Mapping[str, int]) -> int:
        """Number of instants in the arrays of the window."""
        return min(len(session.window()[0]), int(numbers[place["window.size"]]))

    def histories(self, numbers: Array, place: Mapping[str, int]) -> dict[str, tuple[Array, Array]]:
        """Load histories given as arrays, by load; none where ``history.size`` is 1."""
        if "history.time" not in place or int(numbers[place["history.size"]]) < 2:
            return {}
        times = np.array(self.read(place["history.time"], numbers, place, None))
        found = {}
        for name, reference in place.items():
            if name.endswith(".history") and reference in self._given:
                found[name.split(".")[1]] = (times, np.array(self.read(reference, numbers, place, None)))
        return found

    def tree(self) -> dict[str, Any]:
        """What was given."""
        return {str(i): values for i, values in self._given.items()}

    def resume(self, tree: Mapping[str, Any]) -> None:
        """Back to a tree."""
        self._given = {int(i): np.atleast_1d(values) for i, values in tree.items()}
        self._read = {}


def _fitted(values: Array, shape: tuple[int, ...], fill: float) -> list[float]:
    """Rows of an array, padded with ``fill``; where there are too many, the last ones."""
    full = np.full(shape, fill)
    rows = values.reshape(-1, *shape[1:])[-shape[0] :]
    full[: len(rows)] = rows
    flat: list[float] = full.ravel().tolist()
    return flat


def _values(name: str, session: Session, size: int) -> Array:
    time, interfaces = session.window()
    if name == "window.time":
        return time[-size:]
    _, interface, group, what = name.split(".")
    if interface not in interfaces:
        return np.zeros(0)
    history = interfaces[interface]
    return _over_window(history, what) if group == "window" else _at_points(history, what, session.instant())


def _over_window(history: InterfaceHistory, what: str) -> Array:
    from .series import InterfaceSeries

    series = InterfaceSeries.of(history)
    if what == "force":
        return series.force
    if what in ("velocityE", "velocityEp"):
        return series.velocity[:, 0 if what == "velocityE" else 1]
    if what == "gap":
        return np.zeros(0) if series.gap is None else series.gap
    return np.zeros(0) if series.shares is None else series.shares[:, _SHARES.index(what)]


def _at_points(history: InterfaceHistory, what: str, instant: int) -> Array:
    source = {
        "traction": history.traction,
        "velocity": history.velocity,
        "gap": history.gap,
        "status": history.contact_status,
    }[what]
    return np.zeros(0) if source is None else np.asarray(source[instant], dtype=float)
