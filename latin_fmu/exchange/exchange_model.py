"""A reduced model behind numbered variables: everything an adapter to Model Exchange needs.

No exception leaves it: what goes wrong is logged with a level. A right-hand side that cannot be computed is NaN, which
stops the integrator of the importer with its own message.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps
from math import isfinite, nan
from typing import Any, TypeVar, cast

import numpy as np

from ..errors import LatinError
from ..latin.blob import decode, encode
from .equations import Equations, Evaluation, Modes, Regularisation
from .names import Names
from .readings import Readings
from .system import DAMPING, SLIDING, STIFFNESS, Array, ReducedSystem

WARNING, ERROR = 1, 3
_KIND = "model exchange"
Method = TypeVar("Method", bound=Callable[..., Any])


@dataclass(frozen=True)
class Update:
    """Answer to an event."""

    terminate: bool = False
    values_changed: bool = False
    next_event: float | None = None


def guarded(method: Method) -> Method:
    """Log what a method raises and return None."""

    @wraps(method)
    def call(self: ExchangeModel, *args: Any) -> Any:
        try:
            with np.errstate(all="ignore"):  # an integrator may try states without sense
                return method(self, *args)
        except LatinError as error:
            self.log(ERROR, str(error))
        except Exception as error:  # the host must survive whatever happens here
            self.log(ERROR, f"unexpected {type(error).__name__} in {method.__name__}: {error}")
        return None

    return cast(Method, call)


class ExchangeModel:
    """Variables by reference, time, states, events.

    Parameters
    ----------
    system, names : see there. log : takes a level and a message.
    """

    def __init__(self, system: ReducedSystem, names: Names, log: Callable[[int, str], None]) -> None:
        self.log, self._names = log, names
        table = names.table
        energy = any(v.name.startswith("energy.") for v in table)
        self.equations = Equations(system, energy)
        self._readings = Readings(self.equations)
        self._place = {v.name: i for i, v in enumerate(table)}
        self._outputs = [i for i, v in enumerate(table) if v.causality == "output"]
        self._state_of = {reference: i for i, reference in enumerate(names.states)}
        self._inputs = {n: self._place[f"load.{n}.value"] for n in self.equations.amplitudes.inputs}
        self.numbers: Array = np.array(
            [float(v.start) if isinstance(v.start, int | float) else 0.0 for v in table]
        )
        self.time, self._ready, self.events = 0.0, False, 0
        self._since = dict.fromkeys(self._inputs, 0.0)
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
        return len(self._names.table) + len(self._names.locals) - self._names.indicators

    # -- variables ------------------------------------------------------------------------------------------------
    def get(self, references: Sequence[int]) -> list[float]:
        """Numbers; NaN where one cannot be computed (logged)."""
        found: list[float] | None = self._get(references)
        return [nan] * len(references) if found is None else found

    @guarded
    def _get(self, references: Sequence[int]) -> list[float]:
        names = self._names
        if not self._read and any(r < len(names.table) for r in references):
            self.numbers[self._outputs] = self._readings.row(
                self.y, self.modes, self._evaluation(), self.events
            )
            self.numbers[0], self._read = self.time, True
        return [self._number(reference) for reference in references]

    def _number(self, reference: int) -> float:
        names = self._names
        if reference in self._state_of:
            return float(self.y[self._state_of[reference]])
        if 0 <= reference < len(names.table):
            return float(self.numbers[reference])
        if names.indicators <= reference < len(names.table) + len(names.locals):
            return float(self.indicators()[reference - names.indicators])
        return float(self._evaluation().derivative[reference - names.derivatives])

    @guarded
    def set(self, references: Sequence[int], values: Sequence[float]) -> None:
        """Set inputs, states, and parameters before initialization ends."""
        for reference, value in zip(references, values, strict=True):
            if reference in self._state_of:
                self.y[self._state_of[reference]] = value
            else:
                self._set(reference, float(value))
        self._changed()

    def _set(self, reference: int, value: float) -> None:
        if not 0 <= reference < len(self._names.table):
            self.log(WARNING, f"variable {reference} is calculated and was not set")
            return
        variable = self._names.table[reference]
        if variable.causality == "input":
            if not isfinite(value) and isfinite(self.numbers[reference]):
                self.log(ERROR, f"{variable.name} is {value}: the model cannot go on from here")
            self.numbers[reference] = value
            load = variable.name.split(".")[1]
            if variable.name.endswith(".value"):
                self._since[load] = self.time
        elif variable.causality != "parameter":
            self.log(WARNING, f"{variable.name} is calculated and was not set")
        elif self._ready:
            self.log(WARNING, f"{variable.name} is fixed after initialization and was not set")
        elif not isfinite(value) or value < 0.0 or (value == 0.0 and variable.name != DAMPING):
            self.log(
                ERROR,
                f"{variable.name} is {value}: allowed are finite values > 0; {self.numbers[reference]} is kept",
            )
        else:
            self.numbers[reference] = value

    def _changed(self) -> None:
        self._now, self._read = None, False

    def _given(self) -> dict[str, tuple[float, float, float]]:
        return {n: (self.numbers[i], self.numbers[i + 1], self._since[n]) for n, i in self._inputs.items()}

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

    def _evaluation(self) -> Evaluation:
        if self._now is None:
            self._now = self.equations.evaluate(self.time, self.y, self.modes, self._given())
        return self._now

    def derivatives(self) -> list[float]:
        """Of the states; NaN where they cannot be computed (logged)."""
        found: list[float] | None = self._derivatives()
        return [nan] * self.n_state if found is None else found

    @guarded
    def _derivatives(self) -> list[float]:
        values: list[float] = self._evaluation().derivative.tolist()
        return values

    def indicators(self) -> list[float]:
        """Event indicators; NaN where they cannot be computed (logged)."""
        found: list[float] | None = self._indicators()
        return [nan] * self.n_indicator if found is None else found

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
        stiffness, damping, sliding = (
            float(self.numbers[self._place[n]]) for n in (STIFFNESS, DAMPING, SLIDING)
        )
        self.equations.use(Regularisation(stiffness, damping, sliding))
        self.modes = self.equations.modes_at(self.time, self.y)
        self._ready = True
        self._changed()

    def update(self) -> Update:
        """Answer to an event: contact states and segment of the time laws."""
        found: Update | None = self._update()
        return Update(terminate=True) if found is None else found

    @guarded
    def _update(self) -> Update:
        if not np.isfinite([self.numbers[i + j] for i in self._inputs.values() for j in (0, 1)]).all():
            self.log(ERROR, "an input is not finite: the simulation ends")
            return Update(terminate=True)
        self.modes, changed = self.equations.switch(self.time, self.y, self.modes)
        self.events += changed
        self._changed()
        # values have not changed, but a host that looks at this flag restarts its integrator only then
        return Update(values_changed=True, next_event=self.equations.amplitudes.next_knot(self.modes.segment))

    # -- states of the FMU ------------------------------------------------------------------------------------------
    @guarded
    def save(self) -> bytes:
        """All of it, bit-exact."""
        modes = self.modes
        tree = {
            "numbers": self.numbers, "time": self.time, "since": self._since, "y": self.y, "ready": int(self._ready),
            "events": self.events, "closed": modes.closed, "sticking": modes.sticking, "segment": modes.segment,
        }  # fmt: skip
        return encode(tree, f"{_KIND} {self._names.table[-1].name} {self.n_state}")

    @guarded
    def load(self, blob: bytes) -> None:
        """Back to a saved state; nothing changes where it cannot be used (logged)."""
        tree = decode(blob, f"{_KIND} {self._names.table[-1].name} {self.n_state}")
        self.numbers, self.time, self._since, self.y = (
            tree[key] for key in ("numbers", "time", "since", "y")
        )
        self._ready, self.events = bool(tree["ready"]), tree["events"]
        self.modes = Modes(tree["closed"], tree["sticking"], tree["segment"])
        parameters = [float(self.numbers[self._place[n]]) for n in (STIFFNESS, DAMPING, SLIDING)]
        self.equations.use(Regularisation(*parameters))
        self._changed()
