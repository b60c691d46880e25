"""A reduced model through numbered variables: what the adapter to Model Exchange hands its calls to.

No exception leaves an instance: an error is logged. A right-hand side that cannot be computed is NaN, which stops the
integrator of the importer.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from math import isfinite, nan
from typing import NamedTuple

from ..cosim.variable import Variable, input_of, variable_of
from ..latin.state_serialization import check_like, decode, encode, opened, sealed, unlike
from .equations import (
    DAMPING,
    SLIDING,
    STIFFNESS,
    ContactModes,
    Equations,
    Evaluation,
    GivenLoads,
    Names,
    Outputs,
    ReducedSystem,
    Regularisation,
)
from .variable_store import ERROR, Log, VariableStore, exception_barrier

_STATE = "state of a reduced model"


class ReducedVariableStore(VariableStore):
    """Inputs, parameters and outputs of a reduced model by value reference.

    Parameters
    ----------
    table, log : see ``VariableStore``. loads : those set from outside.

    Attributes
    ----------
    time : of the next evaluation, s. since : time each load was set at, s.
    """

    def __init__(self, table: Sequence[Variable], loads: Sequence[str], log: Log) -> None:
        super().__init__(table, log)
        self.time, self.since = 0.0, dict.fromkeys(loads, 0.0)

    def refusal(self, reference: int, value: float = 0.0) -> str:
        """Why a variable cannot have a value; empty where it can."""
        # states, derivatives and indicators follow the table in the references
        if not 0 <= reference < len(self.table):
            return f"variable {reference} is calculated and was not set"
        variable, previous = self.table[reference], self.numbers[reference]
        if variable.causality == "parameter" and not self.fixed and not _allowed(variable.name, value):
            return f"{variable.name} is {value}: allowed are finite values > 0; {previous} is kept"
        return super().refusal(reference, value)

    def set_number(self, reference: int, value: float) -> None:
        """Set an input, or before initialization a parameter, that is not refused."""
        variable, previous = self.table[reference], self.numbers[reference]
        super().set_number(reference, value)
        if variable.causality == "input":
            if not isfinite(value) and isfinite(previous):
                self.log(ERROR, f"{variable.name} is {value}: the model cannot go on from here")
            # ``rate`` alone keeps the instant: its line goes through the value, wherever the rate is set
            if variable.name.endswith(".value"):
                self.since[input_of(variable.name)[0]] = self.time

    def loads(self) -> GivenLoads:
        """Value, rate, and the time they were set at, of the loads set from outside."""
        stems = {n: variable_of(n) for n in self.since}
        return {n: (self.number(f"{s}.value"), self.number(f"{s}.rate"), self.since[n]) for n, s in stems.items()}

    def finite(self) -> bool:
        """Whether all inputs are finite."""
        return all(isfinite(number) for load in self.loads().values() for number in load)

    def regularisation(self) -> Regularisation:
        """The parameters of the contact law."""
        return Regularisation(*(self.number(name) for name in (STIFFNESS, DAMPING, SLIDING)))


def _allowed(name: str, value: float) -> bool:
    return isfinite(value) and (value > 0.0 or (value == 0.0 and name == DAMPING))  # contact without damping is allowed


class Update(NamedTuple):
    """Result of an event: whether to end the simulation, and the time of the next jump of a law, s."""

    terminate: bool = False
    next_event: float | None = None


class ReducedModelInstance:
    """Variables by reference, time, states, events.

    Parameters
    ----------
    system, names : data of the reduced model. log : takes the level and the text of a message.

    Attributes
    ----------
    names : of all variables. phase : state of the state machine of the FMI, as in cosim/runtime/instance.h.
    """

    def __init__(self, system: ReducedSystem, names: Names, log: Log) -> None:
        self.log, self.names = log, names
        self._digest = hashlib.sha256(system.to_bytes()).hexdigest()
        self._logged: set[str] = set()
        energy = any(v.name.startswith("energy.") for v in names.table)
        self.equations = Equations(system, energy)
        self._outputs = Outputs(self.equations)
        self.variables = ReducedVariableStore(names.table, self.equations.amplitudes.inputs, log)
        self._state_of = {reference: i for i, reference in enumerate(names.states)}
        self.events = self.phase = 0
        self.y = self.equations.start()
        self.modes = self.equations.modes_at(0.0, self.y)
        self._evaluated: Evaluation | None = None  # at the present time and states
        self._outputs_are_set = False

    def log_error(self, message: str) -> None:
        """Log an error once: an integrator repeats its evaluations."""
        if message not in self._logged:
            self._logged.add(message)
            self.log(ERROR, message)

    def _changed(self) -> None:
        self._evaluated, self._outputs_are_set = None, False

    def _evaluation(self) -> Evaluation:
        if self._evaluated is None:
            self._evaluated = self.equations.evaluate(self.variables.time, self.y, self.modes, self.variables.loads())
        return self._evaluated

    # -- variables ------------------------------------------------------------------------------------------------
    @exception_barrier(lambda _, references: [nan] * len(references))
    def get(self, references: Sequence[int]) -> list[float]:
        """Numbers by value reference; NaN, and an error is logged, where they cannot be computed."""
        # an evaluation is not made for states, derivatives or indicators
        if not self._outputs_are_set and any(r < len(self.names.table) for r in references):
            row = self._outputs.row(self.y, self.modes, self._evaluation(), self.events)
            self.variables.numbers[self.variables.outputs] = row
            self.variables.numbers[0], self._outputs_are_set = self.variables.time, True
        return [self._number(int(reference)) for reference in references]

    def _number(self, reference: int) -> float:
        names = self.names
        if reference in self._state_of:
            return float(self.y[self._state_of[reference]])
        if reference < len(names.table):
            return float(self.variables.numbers[reference])
        if reference < names.indicators:
            return float(self._evaluation().derivative[reference - names.derivatives])
        return self.indicators()[reference - names.indicators]

    @exception_barrier(lambda *_: False)
    def set(self, references: Sequence[int], values: Sequence[float]) -> bool:
        """Set inputs, states, and before initialization parameters; False, and an error is logged, where one of them is
        refused: then none is set."""
        pairs = list(zip(references, values, strict=True))
        # the table first, as it alone can refuse; states take any value
        others = [(r, value) for r, value in pairs if r not in self._state_of]
        if others and not self.variables.set(*zip(*others, strict=True)):
            return False
        for reference, value in pairs:
            if reference in self._state_of:
                self.y[self._state_of[reference]] = value
        self._changed()
        return True

    # -- time, states, right-hand side ----------------------------------------------------------------------------
    def set_time(self, time: float) -> None:
        """Set the time of the next evaluations, s."""
        self.variables.time = time
        self._changed()

    @exception_barrier(lambda *_: None)
    def set_states(self, values: Sequence[float]) -> None:
        """Set all continuous states."""
        self.y[:] = values
        self._changed()

    @exception_barrier(lambda self: [nan] * self.names.n_state)
    def derivatives(self) -> list[float]:
        """Time derivatives of the states; NaN, and an error is logged, where they cannot be computed."""
        values: list[float] = self._evaluation().derivative.tolist()
        return values

    @exception_barrier(lambda self: [nan] * self.names.n_indicator)
    def indicators(self) -> list[float]:
        """Event indicators; NaN, and an error is logged, where they cannot be computed."""
        values: list[float] = self.equations.indicators(self.variables.time, self.y, self.modes).tolist()
        return values

    def close(self) -> None:
        """Free the instance; its parts hold no cycles."""

    # -- life cycle, events -----------------------------------------------------------------------------------------
    @exception_barrier(lambda *_: None)
    def initialize(self) -> None:
        """Fix the parameters; contact states follow from the motion at the start."""
        self.equations.use(self.variables.regularisation())
        # stiffness and sliding velocity are fixed now: they decide which patches are closed and which of them stick
        self.modes = self.equations.modes_at(self.variables.time, self.y)
        self.variables.fixed = True
        self._changed()

    @exception_barrier(lambda _: Update(terminate=True))
    def update(self) -> Update:
        """Update contact states and the segment of the time laws at an event."""
        if not self.variables.finite():
            self.log(ERROR, "an input is not finite: the simulation ends")
            return Update(terminate=True)
        self.modes, changed = self.equations.switch(self.variables.time, self.y, self.modes)
        self.events += changed
        self._changed()
        return Update(next_event=self.equations.amplitudes.next_knot(self.modes.segment))

    # -- states of the FMU ------------------------------------------------------------------------------------------
    @property
    def _kind(self) -> str:
        return f"model exchange {self.names.table[-1].name} {self.names.n_state}"

    @exception_barrier(lambda *_: None)
    def get_state(self) -> bytes:
        """Everything that determines the next evaluations, bit for bit."""
        return self._encoded()

    def _encoded(self) -> bytes:
        variables, modes = self.variables, self.modes
        state = {
            "variables": variables.get_state(),
            "since": variables.since,
            "time": self.variables.time,
            "y": self.y,
            "events": self.events,
            "closed": modes.closed,
            "sticking": modes.sticking,
            "segment": modes.segment,
            "phase": self.phase,
        }
        return encode(state, self._kind)

    @exception_barrier(lambda *_: None)
    def set_state(self, saved: bytes) -> None:
        """Restore a state; where it cannot be used an error is logged and nothing changes."""
        self._logged.clear()  # the call fails each time, and its message is logged each time
        state = decode(saved, self._kind)
        reference = decode(bytes(self._encoded()), self._kind)
        check_like(state, reference, "state", optional=("segment",))
        self.variables.check_state(state["variables"])
        if state["closed"].min(initial=0) < 0 or state["events"] < 0:
            raise unlike("state", "a contact that is neither open nor closed, or a negative count")
        variables = self.variables
        variables.set_state(state["variables"])
        variables.time, variables.since = state["time"], state["since"]
        self.y = state["y"]
        self.events = state["events"]
        self.phase = state["phase"]
        self.modes = ContactModes(state["closed"], state["sticking"], state["segment"])
        self.equations.use(variables.regularisation())
        self._changed()

    def to_bytes(self, saved: bytes) -> bytes:
        """A state with header and checksum, for ``from_bytes``."""
        return sealed(saved, _STATE, self._digest)

    @exception_barrier(lambda *_: None)
    def from_bytes(self, block: bytes) -> bytes:
        """The state of ``to_bytes``; None, and an error is logged, for other bytes."""
        self._logged.clear()
        return opened(block, _STATE, self._digest)
