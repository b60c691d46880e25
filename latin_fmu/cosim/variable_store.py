"""Levels of the messages of a participant, and the guard that lets no exception out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from typing import TYPE_CHECKING, Any, Protocol, TypeVar, cast

import numpy as np

from ..errors import LatinError
from .variable import Variable

if TYPE_CHECKING:
    from ..latin.record import Array, InterfaceHistory
    from .session import Session

OK, WARNING, DISCARD, ERROR = 0, 1, 2, 3
"""Levels of a message, as the FMI counts them."""

Log = Callable[[int, str], None]
Method = TypeVar("Method", bound=Callable[..., Any])


class HasLog(Protocol):
    """Anything with a log."""

    log: Log


def guarded(fallback: object) -> Callable[[Method], Method]:
    """Log what a method raises and return ``fallback``."""

    def wrap(method: Method) -> Method:
        @wraps(method)
        def call(self: HasLog, *args: Any) -> Any:
            try:
                return method(self, *args)
            except LatinError as error:
                self.log(ERROR, str(error))
            except Exception as error:  # the host must survive whatever happens here
                self.log(ERROR, f"unexpected {type(error).__name__} in {method.__name__}: {error}")
            return fallback

        return cast(Method, call)

    return wrap


# -- Values of the variables of a table by reference, the place in the table.
class Values:
    """Numbers, texts and arrays.

    Parameters
    ----------
    table : the variables. log : takes level and message; hears of what could not be set.
    """

    def __init__(self, table: Sequence[Variable], log: Log) -> None:
        self.table, self._log = tuple(table), log
        self._place = {v.name: i for i, v in enumerate(self.table)}
        self._outputs = [i for i, v in enumerate(self.table) if v.causality == "output" and not v.is_array]
        self._arrays = ArrayReader(self.table)
        self.clear()

    def clear(self) -> None:
        """Every variable at its start value."""
        start = [v.start if isinstance(v.start, int | float) and not v.is_array else 0.0 for v in self.table]
        self._numbers: Array = np.array([float(value) for value in start])
        self._texts = {i: str(v.start) for i, v in enumerate(self.table) if v.kind == "string"}
        self._arrays.clear()

    def number(self, name: str) -> float:
        """A number by name."""
        return float(self._numbers[self._place[name]])

    def text(self, name: str) -> str:
        """A string by name."""
        return self._texts[self._place[name]]

    # -- by reference ---------------------------------------------------------------------------------------------
    def get(self, references: Sequence[int], session: Session | None) -> Sequence[float]:
        """Numbers, those of arrays one after the other in row-major order."""
        if not self._arrays.has(references):
            values: list[float] = self._numbers[references].tolist()
            return values
        found: list[float] = []
        for reference in references:
            if self.table[reference].is_array:
                found += self._arrays.read(reference, self._numbers, self._place, session)
            else:
                found.append(float(self._numbers[reference]))
        return found

    def size(self, references: Sequence[int]) -> int:
        """How many numbers ``get`` gives."""
        if not self._arrays.has(references):
            return len(references)
        return sum(
            self._arrays.size(r, self._numbers, self._place) if 0 <= r < len(self.table) else 1 for r in references
        )

    def set(self, references: Sequence[int], values: Sequence[float], ready: bool) -> None:
        """Set numbers; arrays take as many as they hold. ``ready``: initialized, only inputs can be set."""
        if not self._arrays.has(references):
            for reference, value in zip(references, values, strict=True):
                self._set(reference, value, ready)
            return
        at = 0
        for reference in references:
            if self.table[reference].is_array:
                size = self._arrays.size(reference, self._numbers, self._place)
                self._arrays.write(reference, values[at : at + size])
                at += size
            else:
                self._set(reference, values[at], ready)
                at += 1

    def _set(self, reference: int, value: float, ready: bool) -> None:
        variable = self.table[reference]
        if variable.causality in ("output", "independent"):
            self._log(WARNING, f"{variable.name} is calculated and was not set")
        elif ready and variable.causality != "input":
            self._log(WARNING, f"{variable.name} is fixed after initialization and was not set")
        else:
            self._numbers[reference] = value

    def get_texts(self, references: Sequence[int]) -> Sequence[str]:
        """Strings."""
        return [self._texts[reference] for reference in references]

    def set_texts(self, references: Sequence[int], values: Sequence[str], ready: bool) -> None:
        """Set strings."""
        for reference, value in zip(references, values, strict=True):
            if ready:
                name = self.table[reference].name
                self._log(WARNING, f"{name} is fixed after initialization and was not set")
            else:
                self._texts[reference] = value

    # -- to and from a session ------------------------------------------------------------------------------------
    def histories(self) -> dict[str, tuple[Array, Array]]:
        """Load histories given as arrays, by load."""
        return self._arrays.histories(self._numbers, self._place)

    def take(self, session: Session) -> None:
        """The outputs of a session."""
        row = session.row
        self._numbers[self._outputs[: len(row)]] = row
        self._numbers[0] = session.time
        self._arrays.changed()
        count = self._place.get("window.count")
        if count is not None:
            self._numbers[count] = self._arrays.count(session, self._numbers, self._place)

    def changed(self) -> None:
        """The session has been moved: arrays are read anew."""
        self._arrays.changed()

    def tree(self) -> dict[str, Any]:
        """All that was set and calculated."""
        return {
            "numbers": self._numbers.copy(),
            "texts": {str(i): text for i, text in self._texts.items()},
            "arrays": self._arrays.tree(),
        }

    def resume(self, tree: Mapping[str, Any]) -> None:
        """Back to a tree."""
        self._numbers = tree["numbers"]
        self._texts = {int(i): text for i, text in tree["texts"].items()}
        self._arrays.resume(tree["arrays"])


# -- Array variables: instants of a window, fields of points, load histories. They are made when they are read.
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
    from .outputs import InterfaceSeries

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
