"""Values of the variables of a reduced model by value reference, and the barrier that no exception passes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import wraps
from typing import TYPE_CHECKING, Any, Protocol, TypeVar, cast

import numpy as np

from ..cosim.variable import Variable
from ..errors import InputError, LatinError, Problem

if TYPE_CHECKING:  # not needed by an FMU that is only looked at
    from ..latin.outcome import Array

WARNING = 1
DISCARD = 2
ERROR = 3
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
    """Numbers of the variables of a table, all scalars; the place in the table is the value reference.

    Parameters
    ----------
    table : the variables. log : takes the level and the text of a message.

    Attributes
    ----------
    numbers : (n_variable,) values. place : value reference by name. outputs : references of the outputs. fixed :
    whether initialization has ended: only inputs can be set.
    """

    def __init__(self, table: Sequence[Variable], log: Log) -> None:
        self.table, self.log = tuple(table), log
        self.place = {v.name: i for i, v in enumerate(self.table)}
        self.outputs = [i for i, v in enumerate(self.table) if v.causality == "output"]
        self.numbers: Array = np.array([float(v.start or 0.0) for v in self.table])
        self.fixed = False

    def number(self, name: str) -> float:
        """Value of a variable by name."""
        return float(self.numbers[self.place[name]])

    def set(self, references: Sequence[int], values: Sequence[float]) -> bool:
        """Set numbers. False, and an error is logged, where one of them is refused: then none is set."""
        # all or none: every value is looked at before one is set
        pairs = [(reference, float(value)) for reference, value in zip(references, values, strict=False)]
        if not self._accepts(pairs):
            return False
        for reference, value in pairs:
            self.set_number(reference, value)
        return True

    def _accepts(self, pairs: Iterable[tuple[int, float]]) -> bool:
        for reference, value in pairs:
            if refusal := self.refusal(reference, value):
                self.log(ERROR, refusal)
                return False
        return True

    def refusal(self, reference: int, value: float = 0.0) -> str:
        """Why a variable cannot have a value; empty where it can."""
        del value
        variable = self.table[reference]
        if variable.causality in ("output", "independent", "local"):
            return f"{variable.name} is calculated and was not set"
        if self.fixed and variable.causality != "input":
            return f"{variable.name} is fixed after initialization and was not set"
        return ""

    def set_number(self, reference: int, value: float) -> None:
        """Set a number that is not refused."""
        self.numbers[reference] = value

    # -- states ---------------------------------------------------------------------------------------------------
    def get_state(self) -> dict[str, Any]:
        """Everything that was set and calculated."""
        return {"numbers": self.numbers.copy(), "fixed": int(self.fixed)}

    def check_state(self, state: Mapping[str, Any]) -> None:
        """Check a state that came from outside. Raises InputError naming what does not fit."""
        if state["fixed"] not in (0, 1):
            raise InputError([Problem("state", "cannot be restored: fixed is neither 0 nor 1")], "unusable state")

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore what ``get_state`` returned."""
        self.numbers, self.fixed = state["numbers"], bool(state["fixed"])
