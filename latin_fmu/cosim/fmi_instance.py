"""Co-simulation of a scene through numbered variables: what an FMI adapter hands its calls to.

No exception leaves an instance: an error is logged with a level, and the method returns False.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ..errors import InputError, Problem
from ..latin.settings import tolerance_for
from ..latin.state_serialization import check_like, decode, encode, opened, sealed
from .variable import Variable, input_variable
from .variable_store import DISCARD, ERROR, WARNING, Log, VariableStore, exception_barrier

if TYPE_CHECKING:  # imported at initialization: hosts instantiate an FMU only to look at it
    from ..latin.assembly import Index
    from ..latin.outcome import Array
    from ..scene.schema import Scene
    from .session import Session
    from .settings import Settings
    from .step_history import Link


_STATE: Final = "state of an FMU"


class SavedState(bytes):
    """State of an instance; ``last_step`` keeps the accepted steps before it in memory.

    ``foreign``: it came from bytes of the host, and its content is checked before it is used.
    """

    last_step: Link | None = None
    foreign: bool = False


class FmiInstance:
    """Variables by value reference (their place in the table), life cycle, states.

    Parameters
    ----------
    table : the variables. scene : called once, when the scene is needed. log : takes the level and the text of a
        message. digest : of the scene, in the states that leave the process.

    Attributes
    ----------
    phase : state of the state machine of the FMI, a number that the library of the FMU sets and finds in states.
    """

    def __init__(self, table: Sequence[Variable], scene: Callable[[], Scene], log: Log, digest: str = "") -> None:
        self._open_scene, self.log, self._digest = scene, log, digest
        self._variables = VariableStore(table, log)
        self._session: Session | None = None
        self._inputs: list[tuple[str, int, int]] | None = None  # value references by name, once they are known
        self.phase = 0
        self.clear()

    @property
    def table(self) -> tuple[Variable, ...]:
        """The variables; their place is the value reference."""
        return self._variables.table

    @property
    def time(self) -> float:
        """Present time, s."""
        return float(self._variables.numbers[0])

    def log_error(self, message: str) -> None:
        """Log a message with the level of an error."""
        self.log(ERROR, message)

    def clear(self) -> None:
        """Set every variable to its start value, before initialization; operators are kept."""
        self._variables.clear()
        self._host_tolerance: float | None = None
        self._failure = ""
        self._discarded = ""  # the last step, where it was not made
        self._start_time = 0.0
        self._opened = self._set_up = False
        if self._session is not None:
            self._session.reset()

    # -- variables ------------------------------------------------------------------------------------------------
    def get(self, references: Sequence[int] | Index) -> Array:
        """Numbers by value reference, arrays in row-major order; zeros, and an error is logged, on failure."""
        numbers = self._get(references)
        return np.zeros(self._variables.size(list(references))) if numbers is None else numbers

    @exception_barrier(None, computes=False)
    def _get(self, references: Sequence[int] | Index) -> Array | None:
        variables = self._variables
        if not variables.fixed and self._set_up and not self._failure and variables.calculates(references):
            with np.errstate(all="ignore"):
                self._open()  # in Initialization Mode: outputs under the inputs as they are set now
        return variables.get(references, self._session)

    @exception_barrier(False, computes=False)
    def set(self, references: Sequence[int], values: Sequence[float]) -> bool:
        """Set numbers; an array takes as many values as it has elements. False, and an error is logged, where one of
        them is refused: then none is set."""
        self._opened = False
        return self._variables.set(references, values)

    def get_texts(self, references: Sequence[int]) -> Sequence[str]:
        """Values of strings by value reference; empty, and an error is logged, on failure."""
        return self._get_texts(references) or [""] * len(references)

    @exception_barrier(())
    def _get_texts(self, references: Sequence[int]) -> Sequence[str]:
        return self._variables.get_texts(references)

    @exception_barrier(False)
    def set_texts(self, references: Sequence[int], values: Sequence[str]) -> bool:
        """Set strings by value reference; as for ``set``."""
        self._opened = False
        return self._variables.set_texts(references, values)

    # -- life cycle -----------------------------------------------------------------------------------------------
    @exception_barrier(None)
    def setup(self, start_time: float, tolerance: float | None) -> None:
        """Start time, s, and the tolerance of the host, None where it gives none."""
        self._start_time, self._host_tolerance, self._set_up = start_time, tolerance, True

    def settings(self) -> Settings:
        """Settings of a session from the parameters.

        A tolerance of the host is a relative accuracy and replaces the parameter ``tolerance``, which is on sqrt(eta).
        """
        from .settings import Settings

        number, accuracy = self._variables.number, self._host_tolerance
        return Settings(
            mode=int(number("mode")),
            interpolation=int(number("inputInterpolation")),
            time_step=number("timeStep"),
            end_time=number("endTime"),
            tolerance=tolerance_for(accuracy) if accuracy is not None and accuracy > 0.0 else number("tolerance"),
            max_iterations=int(number("maxIterations")),
            keep=bool(self._variables.text("resultsFile")),
        )

    def initialize(self) -> bool:
        """Build the scene, in prescribed mode solve it; False, and an error is logged, where that fails."""
        self._failure = "initialization failed, see the message before"
        if self._initialize():
            self._failure, self._variables.fixed = "", True
        return self._variables.fixed

    @exception_barrier(False)
    def _initialize(self) -> bool:
        target = self._variables.text("resultsFile")
        if target:
            from ..results.writing import check_target

            check_target(target)
        elif self._estimates_errors():
            self.log(WARNING, "estimateError has no effect without resultsFile, to which the estimate is written")
        for remark in self._open().warnings:
            self.log(WARNING, remark)
        return True

    def _open(self) -> Session:
        """The session at its start, under the parameters and inputs as they are."""
        session = self._session_with(self.settings())
        if not self._opened:
            session.reset()
            self._set_loads(session)
            self._set_histories(session)
            session.initialize(self._start_time)
            self._variables.update(session)
            self._opened = True
        return session

    def _estimates_errors(self) -> bool:
        return bool(self._variables.number("estimateError"))

    def _session_with(self, settings: Settings) -> Session:
        """The session with these settings; the present one, with its operators, where they are equal."""
        from .session import Session

        if self._session is None or self._session.settings != settings:
            self._session = Session(self._open_scene(), settings)
        return self._session

    def _set_loads(self, session: Session) -> None:
        place, numbers = self._variables.place, self._variables.numbers
        if self._inputs is None:
            named = [(n, input_variable(n, "value"), input_variable(n, "rate")) for n in session.loads]
            self._inputs = [(name, place[value], place[rate]) for name, value, rate in named]
        for name, value, rate in self._inputs:
            session.set_load(name, numbers[value], numbers[rate])

    def _set_histories(self, session: Session) -> None:
        """Set the histories of a session in prescribed mode: those of the file, then those given as arrays."""
        file = self._variables.text("historyFile")
        if not session.prescribed:
            if file:
                self.log(WARNING, "historyFile has no effect in windowed mode: set mode = 1")
            return
        if file:
            from .loads import read_histories

            for name, history in read_histories(file, session.loads).items():
                session.set_history(name, *history)
        for name, history in self._variables.histories().items():
            session.set_history(name, *history)

    @exception_barrier(False)
    def step(self, t: float, h: float, early: bool = False) -> bool:
        """Advance from t by h, s; False, and the reason is logged, where the step is not made.

        early : end the step after a contact event, at ``time``.
        The level is DISCARD where a shorter step or another input may help, else ERROR. The state is as before.
        """
        session = self._session
        if not self._variables.fixed or session is None:
            self.log(ERROR, self._failure or "a step before initialization")
            return False
        before = [(name, *session.load(name)) for name in session.loads]
        self._set_loads(session)
        if self._discarded and self._step(session, t, h) == self._discarded:  # some hosts repeat it for ever
            self.log(ERROR, "this very step was discarded before: make it shorter, or with another input")
            return False
        report = session.step(t, h, early)
        if not report.accepted:
            wanted = self._step(session, t, h)
            for given in before:
                session.set_load(*given)
            again = (
                "; the step before was discarded: repeat it, shorter or with another input" if self._discarded else ""
            )
            self.log(DISCARD if report.again else ERROR, report.message + again)
            self._discarded = wanted
            return False
        self._discarded = ""
        self._variables.update(session)
        return True

    @staticmethod
    def _step(session: Session, t: float, h: float) -> str:
        """A step and its inputs, as text."""
        return repr((t, h, [session.load(name) for name in session.loads]))

    @exception_barrier(())
    def directional_derivative(
        self, unknowns: Sequence[int], knowns: Sequence[int], seed: Sequence[float]
    ) -> Sequence[float]:
        """Derivatives of outputs at the end of the last step by inputs over it, by value reference (see
        ``Session.derivative``); empty, and an error is logged, where there are none."""
        if not self._variables.fixed or self._session is None:
            raise InputError([Problem("directional derivative", "not available before initialization")])
        outputs, inputs = ([self.table[reference].name for reference in group] for group in (unknowns, knowns))
        product: list[float] = self._session.derivative(outputs, inputs, seed).tolist()
        return product

    @exception_barrier(False)
    def terminate(self) -> bool:
        """Write the results file, where one is named.

        False, and an error is logged, where the last step was discarded and not made again: the values that the host
        has read since are those before it.
        """
        target = self._variables.text("resultsFile")
        if target and self._variables.fixed and self._session is not None:
            from ..results.files import write_netcdf

            write_netcdf(self._session.dataset(estimate=self._estimates_errors()), target)
        if self._discarded and self._session is not None:
            self.log(ERROR, f"the simulation ends at {self._session.time:g} s: the step from there was discarded")
        return not self._discarded

    def close(self) -> None:
        """Free the session and its operators."""
        if self._session is not None:
            self._session.close()
        self._session = None

    # -- states ---------------------------------------------------------------------------------------------------
    @exception_barrier(None)
    def get_state(self) -> SavedState | None:
        """Everything that determines the next steps, bit for bit; None, and an error is logged, on failure."""
        session = self._session if self._variables.fixed else None
        saved = SavedState(self._encoded())
        saved.last_step = None if session is None else session.step_history.head
        return saved

    def _encoded(self) -> bytes:
        session = self._session if self._variables.fixed else None
        snapshot = None if session is None else np.frombuffer(session.snapshot(), dtype=np.uint8)
        return encode({**self._own_state(), "session": snapshot}, self._kind)

    @exception_barrier(False)
    def set_state(self, saved: bytes) -> bool:
        """Restore a state; where it cannot be used an error is logged and nothing changes."""
        before, session = self._encoded(), self._session
        try:
            self._restore(decode(saved, self._kind), check=getattr(saved, "foreign", True))
        except Exception:  # of any kind: the present state must not be half of another one
            self._session = session
            self._restore(decode(before, self._kind), check=False)
            raise
        self._discarded = ""
        return True

    def _restore(self, state: dict[str, Any], check: bool) -> None:
        if check:
            self._check(state)
        self._set_own_state(state)
        if state["session"] is not None:
            self._session_with(self.settings()).restore(state["session"].tobytes(), check)
            self._variables.forget_arrays()

    def _check(self, state: dict[str, Any]) -> None:
        """Compare a state that came from outside with the variables of this scene. Raises InputError."""
        check_like(state, {**self._own_state(), "session": None}, "state", free=("session", "tolerance"))
        self._variables.check_state(state["variables"])
        if bool(state["variables"]["fixed"]) != (state["session"] is not None):
            raise InputError([Problem("state", "initialized without a session, or the other way round")])

    def to_bytes(self, saved: SavedState) -> bytes:
        """A state with header and checksum, for ``from_bytes``; empty, and an error is logged, on failure."""
        return self._to_bytes(saved) or b""

    @exception_barrier(None)
    def _to_bytes(self, saved: SavedState) -> bytes:
        return sealed(bytes(saved), _STATE, self._digest)

    @exception_barrier(None)
    def from_bytes(self, block: bytes) -> SavedState | None:
        """The state of ``to_bytes``; None, and an error is logged, for other bytes."""
        saved = SavedState(opened(block, _STATE, self._digest))
        saved.foreign = True
        decode(saved, self._kind)
        return saved

    @property
    def _kind(self) -> str:
        return f"co-simulation {len(self.table)} {self.table[-1].name}"

    def _own_state(self) -> dict[str, Any]:
        return {
            "variables": self._variables.get_state(),
            "start_time": self._start_time,
            "tolerance": self._host_tolerance,
            "failure": self._failure,
            "phase": self.phase,
        }

    def _set_own_state(self, state: dict[str, Any]) -> None:
        self._variables.set_state(state["variables"])
        self._opened, self._start_time, self._host_tolerance = False, state["start_time"], state["tolerance"]
        self._failure, self.phase = state["failure"], state["phase"]
