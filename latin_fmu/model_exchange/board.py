"""Inputs, parameters and the last outputs of a reduced model, by reference."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite

import numpy as np

from ..cosim.variable import Variable
from .contact_law import Regularisation
from .system import DAMPING, SLIDING, STIFFNESS, Array

WARNING, ERROR = 1, 3
Given = dict[str, tuple[float, float, float]]
"""Value, rate, and the time it was set at, of the loads set from outside."""


class Board:
    """Numbers of the table.

    Parameters
    ----------
    table : variables. loads : those set from outside. log : takes a level and a message.
    """

    def __init__(self, table: Sequence[Variable], loads: Sequence[str], log: Callable[[int, str], None]) -> None:
        self._table, self._log = table, log
        self._place = {v.name: i for i, v in enumerate(table)}
        self.outputs = [i for i, v in enumerate(table) if v.causality == "output"]
        starts = [float(v.start) if isinstance(v.start, int | float) else 0.0 for v in table]
        self.numbers: Array = np.array(starts)
        self.since = dict.fromkeys(loads, 0.0)
        self.fixed = False

    def set(self, reference: int, value: float, time: float) -> None:
        """Set an input, or a parameter while it is not fixed; anything else is logged."""
        if not 0 <= reference < len(self._table):
            self._log(WARNING, f"variable {reference} is calculated and was not set")
            return
        variable = self._table[reference]
        if variable.causality == "input":
            self._set_input(reference, variable.name, value, time)
        elif variable.causality != "parameter":
            self._log(WARNING, f"{variable.name} is calculated and was not set")
        elif self.fixed:
            self._log(WARNING, f"{variable.name} is fixed after initialization and was not set")
        elif not isfinite(value) or value < 0.0 or (value == 0.0 and variable.name != DAMPING):
            kept = self.numbers[reference]
            self._log(ERROR, f"{variable.name} is {value}: allowed are finite values > 0; {kept} is kept")
        else:
            self.numbers[reference] = value

    def _set_input(self, reference: int, name: str, value: float, time: float) -> None:
        if not isfinite(value) and isfinite(self.numbers[reference]):
            self._log(ERROR, f"{name} is {value}: the model cannot go on from here")
        self.numbers[reference] = value
        if name.endswith(".value"):
            self.since[name.split(".")[1]] = time

    def given(self) -> Given:
        """Loads set from outside."""
        return {n: (self._number(f"load.{n}.value"), self._number(f"load.{n}.rate"), t) for n, t in self.since.items()}

    def finite(self) -> bool:
        """Whether all inputs are finite."""
        return all(isfinite(number) for load in self.given().values() for number in load)

    def regularisation(self) -> Regularisation:
        """The parameters."""
        return Regularisation(*(self._number(name) for name in (STIFFNESS, DAMPING, SLIDING)))

    def _number(self, name: str) -> float:
        return float(self.numbers[self._place[name]])
