"""Co-simulation of a scene through numbered variables: what an FMI adapter hands its calls to.

No exception leaves an instance: an error is logged with a level, and the method returns False.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import LatinError
from ..latin.settings import tolerance_for
from ..latin.state_serialization import decode, encode
from .variable import Variable
from .variable_store import DISCARD, ERROR, WARNING, Log, VariableStore, exception_barrier

if TYPE_CHECKING:  # imported at initialization: hosts instantiate an FMU only to look at it
    from ..scene.schema import Scene
    from .session import Session
    from .settings import Settings
    from .step_history import Link


class SavedState(bytes):
    """State of an instance; ``last_step`` keeps the accepted steps before it in memory."""

    last_step: Link | None = None


class FmiInstance:
    """Variables by value reference (their place in the table), life cycle, states.

    Parameters
    ----------
    table : the variables. scene : called once, when the scene is needed. log : takes the level and the text of a
        message.
    """

    def __init__(self, table: Sequence[Variable], scene: Callable[[], Scene], log: Log) -> None:
        self._open_scene, self.log = scene, log
        self._variables = VariableStore(table, log)
        self._session: Session | None = None
        self.clear()

    @property
    def table(self) -> tuple[Variable, ...]:
        """The variables; their place is the value reference."""
        return self._variables.table

    def log_error(self, message: str) -> None:
        """Log a message with the level of an error."""
        self.log(ERROR, message)

    def clear(self) -> None:
        """Set every variable to its start value, before initialization; operators are kept."""
        self._variables.clear()
        self._host_tolerance: float | None = None
        self._failure = ""
        self._start_time = 0.0
        if self._session is not None:
            self._session.reset()

    # -- variables ------------------------------------------------------------------------------------------------
    def get(self, references: Sequence[int]) -> Sequence[float]:
        """Numbers by value reference, arrays in row-major order; zeros, and an error is logged, on failure."""
        return self._get(references) or [0.0] * self._variables.size(references)

    @exception_barrier(())
    def _get(self, references: Sequence[int]) -> Sequence[float]:
        return self._variables.get(references, self._session)

    @exception_barrier(False)
    def set(self, references: Sequence[int], values: Sequence[float]) -> bool:
        """Set numbers; an array takes as many values as it has elements."""
        self._variables.set(references, values)
        return True

    def get_texts(self, references: Sequence[int]) -> Sequence[str]:
        """Values of strings by value reference; empty, and an error is logged, on failure."""
        return self._get_texts(references) or [""] * len(references)

    @exception_barrier(())
    def _get_texts(self, references: Sequence[int]) -> Sequence[str]:
        return self._variables.get_texts(references)

    @exception_barrier(False)
    def set_texts(self, references: Sequence[int], values: Sequence[str]) -> bool:
        """Set strings by value reference."""
        self._variables.set_texts(references, values)
        return True

    # -- life cycle -----------------------------------------------------------------------------------------------
    @exception_barrier(None)
    def setup(self, start_time: float, tolerance: float | None) -> None:
        """Start time, s, and the tolerance of the host, None where it gives none."""
        self._start_time, self._host_tolerance = start_time, tolerance

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
        session = self._session_with(self.settings())
        session.reset()
        self._set_loads(session)
        self._set_histories(session)
        session.initialize(self._start_time)
        for remark in session.warnings:
            self.log(WARNING, remark)
        self._variables.update(session)
        return True

    def _estimates_errors(self) -> bool:
        return bool(self._variables.number("estimateError"))

    def _session_with(self, settings: Settings) -> Session:
        """The session with these settings; the present one, with its operators, where they are equal."""
        from .session import Session

        if self._session is None or self._session.settings != settings:
            self._session = Session(self._open_scene(), settings)
        return self._session

    def _set_loads(self, session: Session) -> None:
        number = self._variables.number
        for name in session.loads:
            session.set_load(name, number(f"load.{name}.value"), number(f"load.{name}.rate"))

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
    def step(self, t: float, h: float) -> bool:
        """Advance from t by h, s; False, and the reason is logged, where the step is discarded."""
        session = self._session
        if not self._variables.fixed or session is None:
            self.log(DISCARD, self._failure or "a step before initialization")
            return False
        before = {name: session.load(name) for name in session.loads}
        self._set_loads(session)
        report = session.step(t, h)
        if not report.accepted:
            for name, (value, rate) in before.items():
                session.set_load(name, value, rate)
            self.log(DISCARD, report.message)
            return False
        self._variables.update(session)
        return True

    @exception_barrier(False)
    def terminate(self) -> bool:
        """Write the results file, where one is named."""
        target = self._variables.text("resultsFile")
        if target and self._variables.fixed and self._session is not None:
            from ..results.files import write_netcdf

            write_netcdf(self._session.dataset(estimate=self._estimates_errors()), target)
        return True

    # -- states ---------------------------------------------------------------------------------------------------
    @exception_barrier(None)
    def get_state(self) -> SavedState | None:
        """Everything that determines the next steps, bit for bit; None, and an error is logged, on failure."""
        session = self._session if self._variables.fixed else None
        snapshot = None if session is None else np.frombuffer(session.snapshot(), dtype=np.uint8)
        saved = SavedState(encode({**self._own_state(), "session": snapshot}, self._kind))
        saved.last_step = None if session is None else session.step_history.head
        return saved

    @exception_barrier(False)
    def set_state(self, saved: bytes) -> bool:
        """Restore a state; where it cannot be used an error is logged and nothing changes."""
        state = decode(saved, self._kind)
        before, session = self._own_state(), self._session
        try:
            self._set_own_state(state)
            if state["session"] is not None:
                self._session_with(self.settings()).restore(state["session"].tobytes())
                self._variables.forget_arrays()
        except LatinError:
            self._set_own_state(before)
            self._session = session
            raise
        return True

    @property
    def _kind(self) -> str:
        return f"co-simulation {len(self.table)} {self.table[-1].name}"

    def _own_state(self) -> dict[str, Any]:
        return {
            "variables": self._variables.get_state(),
            "start_time": self._start_time,
            "tolerance": self._host_tolerance,
            "failure": self._failure,
        }

    def _set_own_state(self, state: dict[str, Any]) -> None:
        self._variables.set_state(state["variables"])
        self._start_time, self._host_tolerance = state["start_time"], state["tolerance"]
        self._failure = state["failure"]
