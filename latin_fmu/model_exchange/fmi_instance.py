"""No exception may reach the exporter of an FMU: it would free the instance the host still holds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps
from math import isfinite, nan
from typing import Any, NamedTuple, Protocol, TypeVar, cast

import numpy as np

from ..cosim.variable import Variable
from ..errors import LatinError
from ..latin.state_serialization import decode, encode
from .contact_law import Modes, Regularisation
from .equations import Equations, Evaluation, Readings
from .system import DAMPING, SLIDING, STIFFNESS, Array, Names, ReducedSystem

Method = TypeVar("Method", bound=Callable[..., Any])


class Speaker(Protocol):
    """Has a log, and knows what it has told."""

    log: Callable[[int, str], None]
    told: set[str]


def guarded(method: Method) -> Method:
    """Log what a method raises, each complaint once, and return None."""

    @wraps(method)
    def call(self: Speaker, *args: Any) -> Any:
        try:
            with np.errstate(all="ignore"):  # an integrator may try states without sense
                return method(self, *args)
        except LatinError as error:
            complaint = str(error)
        except Exception as error:  # the host must survive whatever happens here
            complaint = f"unexpected {type(error).__name__} in {method.__name__}: {error}"
        if complaint not in self.told:  # an integrator asks again and again
            self.told.add(complaint)
            self.log(ERROR, complaint)
        return None

    return cast(Method, call)


# -- Inputs, parameters and the last outputs of a reduced model, by reference.
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


# -- A reduced model behind numbered variables: everything an adapter to Model Exchange needs. No exception leaves it:
# what goes wrong is logged with a level. A right-hand side that cannot be computed is NaN, which stops the integrator
# of the importer with its own message.
class Update(NamedTuple):
    """Answer to an event: whether to end, and the time of the next jump of a law."""

    terminate: bool = False
    next_event: float | None = None


class ExchangeModel:
    """Variables by reference, time, states, events.

    Parameters
    ----------
    system, names : see there. log : takes a level and a message.
    """

    def __init__(self, system: ReducedSystem, names: Names, log: Callable[[int, str], None]) -> None:
        self.log, self._names = log, names
        self.told: set[str] = set()
        energy = any(v.name.startswith("energy.") for v in names.table)
        self.equations = Equations(system, energy)
        self._readings = Readings(self.equations)
        self.board = Board(names.table, self.equations.amplitudes.inputs, log)
        self._state_of = {reference: i for i, reference in enumerate(names.states)}
        self.time, self.events = 0.0, 0
        self.y = self.equations.start()
        self.modes = self.equations.modes_at(0.0, self.y)
        self._now: Evaluation | None = None
        self._read = False

    @property
    def n_state(self) -> int:
        """Number of continuous states."""
        return len(self._names.states)

    @property
    def n_indicator(self) -> int:
        """Number of event indicators."""
        return self._names.count - self._names.indicators

    def _changed(self) -> None:
        self._now, self._read = None, False

    def _evaluation(self) -> Evaluation:
        if self._now is None:
            self._now = self.equations.evaluate(self.time, self.y, self.modes, self.board.given())
        return self._now

    # -- variables ------------------------------------------------------------------------------------------------
    def get(self, references: Sequence[int]) -> list[float]:
        """Numbers; NaN where they cannot be computed (logged)."""
        return self._get(references) or [nan] * len(references)

    @guarded
    def _get(self, references: Sequence[int]) -> list[float]:
        if not self._read and any(r < len(self._names.table) for r in references):
            row = self._readings.row(self.y, self.modes, self._evaluation(), self.events)
            self.board.numbers[self.board.outputs] = row
            self.board.numbers[0], self._read = self.time, True
        return [self._number(reference) for reference in references]

    def _number(self, reference: int) -> float:
        names = self._names
        if reference in self._state_of:
            return float(self.y[self._state_of[reference]])
        if reference < len(names.table):
            return float(self.board.numbers[reference])
        if reference < names.indicators:
            return float(self._evaluation().derivative[reference - names.derivatives])
        return self.indicators()[reference - names.indicators]

    @guarded
    def set(self, references: Sequence[int], values: Sequence[float]) -> None:
        """Set inputs, states, and parameters before initialization ends."""
        for reference, value in zip(references, values, strict=True):
            if reference in self._state_of:
                self.y[self._state_of[reference]] = value
            else:
                self.board.set(reference, float(value), self.time)
        self._changed()

    # -- time, states, right-hand side ----------------------------------------------------------------------------
    def set_time(self, time: float) -> None:
        """Time of the next evaluations, s."""
        self.time = time
        self._changed()

    @guarded
    def set_states(self, values: Sequence[float]) -> None:
        """Continuous states."""
        self.y[:] = values
        self._changed()

    def derivatives(self) -> list[float]:
        """Of the states; NaN where they cannot be computed (logged)."""
        return self._derivatives() or [nan] * self.n_state

    @guarded
    def _derivatives(self) -> list[float]:
        values: list[float] = self._evaluation().derivative.tolist()
        return values

    def indicators(self) -> list[float]:
        """Event indicators; NaN where they cannot be computed (logged)."""
        return self._indicators() or [nan] * self.n_indicator

    @guarded
    def _indicators(self) -> list[float]:
        values: list[float] = self.equations.indicators(self.time, self.y, self.modes).tolist()
        return values

    def nominals(self) -> list[float]:
        """Expected sizes of the states."""
        values: list[float] = self.equations.nominals().tolist()
        return values

    # -- life cycle, events -----------------------------------------------------------------------------------------
    @guarded
    def initialize(self) -> None:
        """Parameters are fixed now, contact states are those the start calls for."""
        self.equations.use(self.board.regularisation())
        self.modes = self.equations.modes_at(self.time, self.y)
        self.board.fixed = True
        self._changed()

    def update(self) -> Update:
        """Answer to an event: contact states and segment of the time laws."""
        return self._update() or Update(terminate=True)

    @guarded
    def _update(self) -> Update:
        if not self.board.finite():
            self.log(ERROR, "an input is not finite: the simulation ends")
            return Update(terminate=True)
        self.modes, changed = self.equations.switch(self.time, self.y, self.modes)
        self.events += changed
        self._changed()
        return Update(next_event=self.equations.amplitudes.next_knot(self.modes.segment))

    # -- states of the FMU ------------------------------------------------------------------------------------------
    @property
    def _kind(self) -> str:
        return f"model exchange {self._names.table[-1].name} {self.n_state}"

    @guarded
    def save(self) -> bytes:
        """All of it, bit-exact."""
        board, modes = self.board, self.modes
        tree = {
            "numbers": board.numbers,
            "since": board.since,
            "fixed": int(board.fixed),
            "time": self.time,
            "y": self.y,
            "events": self.events,
            "closed": modes.closed,
            "sticking": modes.sticking,
            "segment": modes.segment,
        }
        return encode(tree, self._kind)

    @guarded
    def load(self, blob: bytes) -> None:
        """Back to a saved state; nothing changes where it cannot be used (logged)."""
        tree = decode(blob, self._kind)
        board = self.board
        board.numbers, board.since, board.fixed = tree["numbers"], tree["since"], bool(tree["fixed"])
        self.time, self.y, self.events = tree["time"], tree["y"], tree["events"]
        self.modes = Modes(tree["closed"], tree["sticking"], tree["segment"])
        self.equations.use(board.regularisation())
        self._changed()
