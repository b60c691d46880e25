"""Values of the variables of an FMU by value reference, and the barrier that no exception passes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import wraps
from itertools import accumulate
from typing import TYPE_CHECKING, Any, Protocol, TypeVar, cast

import numpy as np

from ..errors import InputError, LatinError, Problem
from ..latin.state_serialization import check_numbers
from .variable import Variable, input_of

if TYPE_CHECKING:  # imported when arrays are read: hosts instantiate an FMU only to look at it
    from ..latin.assembly import Index
    from ..latin.outcome import Array
    from .session import Session

WARNING, DISCARD, ERROR = 1, 2, 3
"""Levels of a message: the status codes of the FMI."""

Log = Callable[[int, str], None]
Method = TypeVar("Method", bound=Callable[..., Any])


class HasErrorLog(Protocol):
    """An object that logs errors."""

    def log_error(self, message: str) -> None:
        """Log an error message."""
        ...


def exception_barrier(fallback: Callable[..., object], computes: bool = True) -> Callable[[Method], Method]:
    """Log what a method raises and return ``fallback`` of its arguments; no warning is printed for values that overflow
    where the method ``computes``.

    The instance goes on after it, and the host is given a status with the message.
    """

    def wrap(method: Method) -> Method:
        @wraps(method)
        def call(self: HasErrorLog, *args: Any) -> Any:
            try:
                if not computes:
                    return method(self, *args)
                with np.errstate(all="ignore"):
                    return method(self, *args)
            except LatinError as error:
                self.log_error(str(error))
            except Exception as error:  # of any kind: the process of the host must go on
                self.log_error(f"unexpected {type(error).__name__} in {method.__name__}: {error}")
            return fallback(self, *args)

        return cast(Method, call)

    return wrap


class VariableStore:
    """Numbers, texts and arrays of the variables of a table; the place in the table is the value reference.

    Parameters
    ----------
    table : the variables. log : takes the level and the text of a message.

    Attributes
    ----------
    numbers : (n_variable,) values of the scalars. place : value reference by name.
    outputs : references of the scalar outputs. fixed : whether initialization has ended: only inputs can be set.
    """

    def __init__(self, table: Sequence[Variable], log: Log) -> None:
        self.table, self.log = tuple(table), log
        self.place = {v.name: i for i, v in enumerate(self.table)}
        self.outputs = [i for i, v in enumerate(self.table) if v.causality == "output" and not v.is_array]
        self._output_places = np.array(self.outputs, dtype=np.int64)
        self._array_references = frozenset(i for i, v in enumerate(self.table) if v.is_array)
        self._first_array = min(self._array_references, default=len(self.table))
        self.clear()

    def clear(self) -> None:
        """Set every variable to its start value."""
        scalars = [v.start if isinstance(v.start, int | float) and not v.is_array else 0.0 for v in self.table]
        self.numbers: Array = np.array([float(value) for value in scalars])
        self.fixed = False
        self._texts = {i: str(v.start) for i, v in enumerate(self.table) if v.kind == "string"}
        self._array_parameters: dict[int, Array] = {}
        self._array_outputs: dict[int, list[float]] = {}  # read at the present time

    def number(self, name: str) -> float:
        """Value of a scalar by name."""
        return float(self.numbers[self.place[name]])

    def text(self, name: str) -> str:
        """Value of a string by name."""
        return self._texts[self.place[name]]

    # -- by reference ---------------------------------------------------------------------------------------------
    def get(self, references: Sequence[int] | Index, session: Session | None = None) -> Array:
        """Numbers; elements of arrays in row-major order. ``session``: its arrays are read."""
        places = np.asarray(references, dtype=np.int64)
        # most requests are for scalars: one gather
        if not places.size or places.max() < self._first_array:
            return self.numbers[places]
        flat: list[float] = []
        for r in places.tolist():
            flat += self._elements(r, session) if self.table[r].is_array else [float(self.numbers[r])]
        return np.array(flat)

    def size(self, references: Sequence[int]) -> int:
        """How many numbers ``get`` returns."""
        if self._array_references.isdisjoint(references):
            return len(references)
        return sum(int(np.prod(self._shape(r), dtype=np.int64)) for r in references)

    def set(self, references: Sequence[int], values: Sequence[float]) -> bool:
        """Set numbers; an array takes as many values as it has elements. False, and an error is logged, where one of
        them is refused: then none is set."""
        sizes = [self.size([reference]) for reference in references]
        if sum(sizes) > len(values):
            self.log(ERROR, f"the host gives {len(values)} values; the variables have {sum(sizes)} elements")
            return False
        firsts = list(accumulate(sizes, initial=0))
        # all or none: every value is looked at before one is set
        if not self._accepts((r, float(values[at])) for r, at in zip(references, firsts, strict=False)):
            return False
        for reference, at, size in zip(references, firsts, sizes, strict=False):
            if reference in self._array_references:
                self._array_parameters[reference] = np.array(values[at : at + size], dtype=float)
            else:
                self.set_number(reference, float(values[at]))
        return True

    def _accepts(self, given: Iterable[tuple[int, float]]) -> bool:
        for reference, value in given:
            if refusal := self.refusal(reference, value):
                self.log(ERROR, refusal)
                return False
        return True

    def refusal(self, reference: int, value: float = 0.0) -> str:
        """Why a variable cannot have a value; empty where it can."""
        variable = self.table[reference]
        if variable.causality in ("output", "independent", "local"):
            return f"{variable.name} is calculated and was not set"
        if self.fixed and variable.causality != "input":
            return f"{variable.name} is fixed after initialization and was not set"
        if variable.kind in ("integer", "count") and value != np.round(value):  # also NaN
            return f"{variable.name} = {value:g} was not set: give a whole number"
        return ""

    def set_number(self, reference: int, value: float) -> None:
        """Set a scalar that is not refused."""
        self.numbers[reference] = value

    def get_texts(self, references: Sequence[int]) -> Sequence[str]:
        """Values of strings by value reference."""
        return [self._texts[reference] for reference in references]

    def set_texts(self, references: Sequence[int], values: Sequence[str]) -> bool:
        """Set strings; as for ``set``."""
        if not self._accepts((reference, 0.0) for reference in references):
            return False
        self._texts |= dict(zip(references, values, strict=True))
        return True

    # -- arrays ---------------------------------------------------------------------------------------------------
    def _shape(self, reference: int) -> tuple[int, ...]:
        if not 0 <= reference < len(self.table):
            return ()
        sizes = self.table[reference].dimensions
        return tuple(s if isinstance(s, int) else int(self.numbers[self.place[s]]) for s in sizes)

    def _elements(self, reference: int, session: Session | None) -> list[float]:
        """Elements of an array in row-major order; outputs are kept until they change."""
        variable, shape = self.table[reference], self._shape(reference)
        if variable.causality == "parameter":
            start = float(variable.start or 0.0)
            return _fitted(self._array_parameters.get(reference, np.zeros(0)), shape, start)
        if reference not in self._array_outputs:
            values = np.zeros(0)
            if session is not None:
                from .outputs import array_output

                values = array_output(variable.name, *session.window(), session.instant()[0])
            self._array_outputs[reference] = _fitted(values, shape, np.nan)
        return self._array_outputs[reference]

    def histories(self) -> dict[str, tuple[Array, Array]]:
        """Times and amplitudes given as arrays, by load; none where the host set no instants."""
        if "history.time" not in self.place:
            return {}
        from .loads import given_rows

        amplitudes = {
            input_of(self.table[reference].name)[0]: self.get([reference])
            for reference in sorted(self._array_parameters)
            if self.table[reference].name != "history.time"
        }
        return given_rows(self.get([self.place["history.time"]]), amplitudes)

    # -- from a session, states -----------------------------------------------------------------------------------
    def update(self, session: Session) -> None:
        """Take time and outputs from a session."""
        # a session without a step yet has fewer outputs than the table
        self.numbers[self._output_places[: len(session.row)]] = session.row
        self.numbers[0] = session.time
        self.forget_arrays()
        if "window.count" in self.place:
            capacity = self.number("window.size")
            self.numbers[self.place["window.count"]] = min(session.instant()[1], capacity)

    def forget_arrays(self) -> None:
        """Drop the array outputs that were read: the session has changed."""
        self._array_outputs = {}

    def get_state(self) -> dict[str, Any]:
        """Everything that was set and calculated."""
        return {
            "numbers": self.numbers.copy(),
            "texts": {str(i): text for i, text in self._texts.items()},
            "arrays": {str(i): values for i, values in self._array_parameters.items()},
            "fixed": int(self.fixed),
        }

    def check_state(self, state: Mapping[str, Any]) -> None:
        """Compare a state that came from outside with the table. Raises InputError naming what does not fit."""
        wrong, arrays = "", state["arrays"]  # only those that were set, so not the same in two instances
        check_numbers(arrays, "state.variables.arrays")
        if state["fixed"] not in (0, 1):
            wrong = "fixed is neither 0 nor 1"
        elif set(state["texts"]) != {str(i) for i in self._texts}:
            wrong = "other strings than those of the table"
        elif not all(isinstance(text, str) for text in state["texts"].values()):
            wrong = "a string that is none"
        elif not (isinstance(arrays, dict) and {str(i) for i in self._array_references} >= set(arrays)):
            wrong = "arrays that the table does not have"
        else:
            for variable, number in zip(self.table, state["numbers"], strict=True):
                if variable.kind in ("integer", "count") and number != round(number):
                    wrong = f"{variable.name} = {number:g} is no whole number"
        if wrong:
            raise InputError([Problem("state", f"cannot be restored: {wrong}")], "unusable state")

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore what ``get_state`` returned."""
        self.numbers, self.fixed = state["numbers"], bool(state["fixed"])
        self._texts = {int(i): text for i, text in state["texts"].items()}
        self._array_parameters = {int(i): np.ravel(values) for i, values in state["arrays"].items()}
        self.forget_arrays()


def _fitted(values: Array, shape: tuple[int, ...], fill: float) -> list[float]:
    """Elements of an array with this shape; missing rows are ``fill``, of too many rows the last are kept."""
    full = np.full(shape, fill)
    rows = values.reshape(-1, *shape[1:])[-shape[0] :]
    full[: len(rows)] = rows
    flat: list[float] = full.ravel().tolist()
    return flat
