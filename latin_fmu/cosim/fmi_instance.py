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
NOT_ACTED: Final = (
    "nothing has acted: every input has stayed 0, and nothing else loads or moves a body in this FMU; set {}"
)
"""As in ``fmu_build/compiled/run.c``."""


class SavedState(bytes):
    """State of an instance; ``last_step`` keeps the accepted steps before it in memory.

    ``foreign``: it came from bytes of the host, and its content is checked before it is used.
    """

    last_step: Link | None = None
    foreign: bool = False


class HostedSession:
    """The session of an instance: it is made of the parameters and the inputs of the variables.

    Parameters
    ----------
    scene : called once, when the scene is needed. variables : their values. log : takes the level and the text of a
        message.

    Attributes
    ----------
    session : None before it was needed. start_time : of the simulation, s. host_tolerance : of the host, None where it
    gives none. opened : whether the session is at its start under the variables as they are. acted : whether an input
    has had another value than 0.
    """

    def __init__(self, scene: Callable[[], Scene], variables: VariableStore, log: Log) -> None:
        self._scene, self._variables, self._log = scene, variables, log
        self.session: Session | None = None
        self._inputs: list[tuple[str, int, int]] | None = None  # value references by name, once they are known
        self.clear()

    def clear(self) -> None:
        """Return to before initialization; operators are kept."""
        self.host_tolerance: float | None = None
        self.start_time, self.opened, self.acted = 0.0, False, False
        if self.session is not None:
            self.session.reset()

    def settings(self) -> Settings:
        """Settings of a session from the parameters.

        A tolerance of the host is a relative accuracy and replaces the parameter ``tolerance``, which is on sqrt(eta).
        """
        from .settings import Settings

        number, accuracy = self._variables.number, self.host_tolerance
        return Settings(
            mode=int(number("mode")),
            interpolation=int(number("inputInterpolation")),
            time_step=number("timeStep"),
            end_time=number("endTime"),
            tolerance=tolerance_for(accuracy) if accuracy is not None and accuracy > 0.0 else number("tolerance"),
            max_iterations=int(number("maxIterations")),
            keep=bool(self._variables.text("resultsFile")),
        )

    def present(self) -> Session:
        """The session with the settings as they are; the last one, with its operators, where they are equal."""
        from .session import Session

        settings = self.settings()
        if self.session is None or self.session.settings != settings:
            self.session = Session(self._scene(), settings)
        return self.session

    def open(self) -> Session:
        """The session at its start, under the parameters and inputs as they are."""
        session = self.present()
        if not self.opened:
            session.reset()
            self.give_loads(session)
            self._give_histories(session)
            session.initialize(self.start_time)
            self._variables.update(session)
            self.opened = True
        return session

    def give_loads(self, session: Session) -> None:
        """Set the loads of a session from the inputs."""
        place, numbers = self._variables.place, self._variables.numbers
        if self._inputs is None:
            named = [(n, input_variable(n, "value"), input_variable(n, "rate")) for n in session.loads]
            self._inputs = [(name, place[value], place[rate]) for name, value, rate in named]
        for name, value, rate in self._inputs:
            session.set_load(name, numbers[value], numbers[rate])
            self.acted |= bool(numbers[value] or numbers[rate])

    def _give_histories(self, session: Session) -> None:
        """Set the histories of a session in prescribed mode: those of the file, then those given as arrays."""
        file = self._variables.text("historyFile")
        if not session.settings.prescribed:
            if file:
                self._log(WARNING, "historyFile has no effect in windowed mode: set mode = 1")
            return
        if file:
            from .loads import read_histories

            for name, history in read_histories(file, session.loads).items():
                self._give_history(session, name, history)
        # after the file: arrays replace its columns
        for name, history in self._variables.histories().items():
            self._give_history(session, name, history)

    def _give_history(self, session: Session, name: str, history: tuple[Any, Any]) -> None:
        session.set_history(name, *history)
        self.acted |= bool(np.any(history[1]))

    def check_acted(self, time: float) -> None:
        """Warn where nothing has loaded or moved a body until ``time``, s."""
        from .input_table import acting_of

        session = self.session
        if session is None or self.acted or time <= self.start_time or not session.loads:
            return
        if not acting_of(session.scene):
            self._log(WARNING, NOT_ACTED.format(input_variable(session.loads[0], "value")))

    def check_results_file(self) -> None:
        """Whether a results file that is named can be written. Raises InputError."""
        target = self._variables.text("resultsFile")
        if target:
            from ..results.writing import check_target

            check_target(target)
        elif self._variables.number("estimateError"):
            self._log(WARNING, "estimateError has no effect without resultsFile, to which the estimate is written")

    def write_results(self) -> None:
        """Write the results file where one is named."""
        target = self._variables.text("resultsFile")
        if target and self._variables.fixed and self.session is not None:
            from ..results.files import write_netcdf

            write_netcdf(self.session.dataset(estimate=bool(self._variables.number("estimateError"))), target)


class ReferencedVariables:
    """The variables of an instance by value reference, their place in the table.

    Parameters
    ----------
    table : the variables. scene : called once, when the scene is needed. log : takes the level and the text of a
        message.
    """

    def __init__(self, table: Sequence[Variable], scene: Callable[[], Scene], log: Log) -> None:
        self.log = log
        self._variables = VariableStore(table, log)
        self._hosted = HostedSession(scene, self._variables, log)
        self._failure = ""
        self._set_up = False

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

    @exception_barrier(lambda self, references: np.zeros(self._variables.size(list(references))), computes=False)
    def get(self, references: Sequence[int] | Index) -> Array:
        """Numbers by value reference, arrays in row-major order; zeros, and an error is logged, on failure."""
        variables, hosted = self._variables, self._hosted
        initializing = not variables.fixed and self._set_up and not self._failure
        if initializing and any(self.table[reference].causality == "output" for reference in references):
            with np.errstate(all="ignore"):
                hosted.open()  # in Initialization Mode: outputs under the inputs as they are set now
        return variables.get(references, hosted.session)

    @exception_barrier(lambda *_: False, computes=False)
    def set(self, references: Sequence[int], values: Sequence[float]) -> bool:
        """Set numbers; an array takes as many values as it has elements. False, and an error is logged, where one of
        them is refused: then none is set."""
        # outputs in Initialization Mode follow what is set: the session starts anew when they are read
        self._hosted.opened = False
        return self._variables.set(references, values)

    @exception_barrier(lambda _, references: [""] * len(references))
    def get_texts(self, references: Sequence[int]) -> Sequence[str]:
        """Values of strings by value reference; empty, and an error is logged, on failure."""
        return self._variables.get_texts(references)

    @exception_barrier(lambda *_: False)
    def set_texts(self, references: Sequence[int], values: Sequence[str]) -> bool:
        """Set strings by value reference; as for ``set``."""
        self._hosted.opened = False
        return self._variables.set_texts(references, values)


class FmiInstance(ReferencedVariables):
    """Variables by value reference, life cycle, states.

    Parameters
    ----------
    table, scene, log : as for ``ReferencedVariables``. digest : of the scene, in the states that leave the process.

    Attributes
    ----------
    phase : state of the state machine of the FMI, a number that the library of the FMU sets and finds in states.
    """

    def __init__(self, table: Sequence[Variable], scene: Callable[[], Scene], log: Log, digest: str = "") -> None:
        super().__init__(table, scene, log)
        self._digest, self.phase = digest, 0
        self.clear()

    def settings(self) -> Settings:
        """Settings of a session from the parameters."""
        return self._hosted.settings()

    def clear(self) -> None:
        """Set every variable to its start value, before initialization; operators are kept."""
        self._variables.clear()
        self._hosted.clear()
        self._failure = ""
        self._discarded = ""  # the last step, where it was not made
        self._set_up = False

    # -- life cycle -----------------------------------------------------------------------------------------------
    @exception_barrier(lambda *_: None)
    def setup(self, start_time: float, tolerance: float | None) -> None:
        """Start time, s, and the tolerance of the host, None where it gives none."""
        self._hosted.start_time, self._hosted.host_tolerance, self._set_up = start_time, tolerance, True

    @exception_barrier(lambda *_: False)
    def initialize(self) -> bool:
        """Build the scene, in prescribed mode solve it; False, and an error is logged, where that fails."""
        # until the end: what fails on the way leaves this for later calls
        self._failure = "initialization failed, see the message before"
        self._hosted.check_results_file()
        for remark in self._hosted.open().warnings:
            self.log(WARNING, remark)
        self._failure, self._variables.fixed = "", True
        return True

    @exception_barrier(lambda *_: False, computes=False)
    def step(self, t: float, h: float, early: bool = False) -> bool:
        """Advance from t by h, s; False, and the reason is logged, where the step is not made.

        early : end the step after a contact event, at ``time``.
        The level is DISCARD where a shorter step or another input may help, else ERROR. The state is as before.
        """
        session = self._hosted.session
        if not self._variables.fixed or session is None:
            self.log(ERROR, self._failure or "a step before initialization")
            return False
        # what the session had, for a step that is refused
        before = [(name, *session.load(name)) for name in session.loads]
        self._hosted.give_loads(session)
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
        # with its inputs: the same step with others may be made
        return repr((t, h, [session.load(name) for name in session.loads]))

    @exception_barrier(lambda *_: ())
    def directional_derivative(
        self, unknowns: Sequence[int], knowns: Sequence[int], seed: Sequence[float]
    ) -> Sequence[float]:
        """Derivatives of outputs at the end of the last step by inputs over it, by value reference (see
        ``Session.derivative``); empty, and an error is logged, where there are none."""
        if not self._variables.fixed or self._hosted.session is None:
            raise InputError([Problem("directional derivative", "not available before initialization")])
        outputs, inputs = ([self.table[reference].name for reference in group] for group in (unknowns, knowns))
        product: list[float] = self._hosted.session.derivative(outputs, inputs, seed).tolist()
        return product

    @exception_barrier(lambda *_: False)
    def terminate(self) -> bool:
        """Write the results file, where one is named.

        False, and an error is logged, where the last step was discarded and not made again: the values that the host
        has read since are those before it.
        """
        self._hosted.check_acted(self.time)
        self._hosted.write_results()
        if self._discarded and self._hosted.session is not None:
            self.log(
                ERROR, f"the simulation ends at {self._hosted.session.time:g} s: the step from there was discarded"
            )
        return not self._discarded

    def close(self) -> None:
        """Free the session and its operators."""
        if self._hosted.session is not None:
            self._hosted.session.close()
        self._hosted.session = None

    # -- states ---------------------------------------------------------------------------------------------------
    @exception_barrier(lambda *_: None)
    def get_state(self) -> SavedState | None:
        """Everything that determines the next steps, bit for bit; None, and an error is logged, on failure."""
        session = self._hosted.session if self._variables.fixed else None
        saved = SavedState(self._encoded())
        saved.last_step = None if session is None else session.step_history.head
        return saved

    def _encoded(self) -> bytes:
        session = self._hosted.session if self._variables.fixed else None
        snapshot = None if session is None else np.frombuffer(session.snapshot(), dtype=np.uint8)
        return encode({**self._own_state(), "session": snapshot}, self._kind)

    @exception_barrier(lambda *_: False)
    def set_state(self, saved: bytes) -> bool:
        """Restore a state; where it cannot be used an error is logged and nothing changes."""
        # encoded, since a restored state may not share arrays with the present one
        before, session = self._encoded(), self._hosted.session
        try:
            self._restore(decode(saved, self._kind), check=getattr(saved, "foreign", True))
        except Exception:  # of any kind: the present state must not be half of another one
            self._hosted.session = session
            self._restore(decode(before, self._kind), check=False)
            raise
        self._discarded = ""
        self._hosted.acted = True  # the inputs before the state are not known
        return True

    def _restore(self, state: dict[str, Any], check: bool) -> None:
        if check:
            self._check(state)
        self._variables.set_state(state["variables"])
        hosted = self._hosted
        hosted.opened, hosted.start_time, hosted.host_tolerance = False, state["start_time"], state["tolerance"]
        self._failure, self.phase = state["failure"], state["phase"]
        if state["session"] is not None:
            self._hosted.present().restore(state["session"].tobytes(), check)
            self._variables.forget_arrays()

    def _check(self, state: dict[str, Any]) -> None:
        """Compare a state that came from outside with the variables of this scene. Raises InputError."""
        check_like(state, {**self._own_state(), "session": None}, "state", free=("session", "tolerance", "arrays"))
        self._variables.check_state(state["variables"])
        if bool(state["variables"]["fixed"]) != (state["session"] is not None):
            raise InputError([Problem("state", "initialized without a session, or the other way round")])

    @exception_barrier(lambda *_: b"")
    def to_bytes(self, saved: SavedState) -> bytes:
        """A state with header and checksum, for ``from_bytes``; empty, and an error is logged, on failure."""
        return sealed(bytes(saved), _STATE, self._digest)

    @exception_barrier(lambda *_: None)
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
            "start_time": self._hosted.start_time,
            "tolerance": self._hosted.host_tolerance,
            "failure": self._failure,
            "phase": self.phase,
        }
