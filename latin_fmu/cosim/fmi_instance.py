"""A session behind numbered variables: everything an adapter to a co-simulation standard needs.

No exception leaves a participant: what goes wrong is logged with a level, and answered by False.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import LatinError
from ..latin.settings import tolerance_for
from ..latin.state_serialization import decode, encode
from .variable import Variable
from .variable_store import DISCARD, WARNING, Log, Values, guarded

if TYPE_CHECKING:
    from ..scene.schema import Scene
    from .session import Session
    from .settings import Settings
    from .step_history import Link


class SavedState:
    """A saved state: its bytes, and what keeps the accepted steps before it alive."""

    def __init__(self, blob: bytes, link: Link | None = None) -> None:
        self.blob, self.link = blob, link


class Participant:
    """Variables by reference (their place in the table), life cycle, states.

    Parameters
    ----------
    table : the variables. scene : called for the scene when it is first needed. log : takes level and message.
    """

    def __init__(self, table: Sequence[Variable], scene: Callable[[], Scene], log: Log) -> None:
        self._open, self.log = scene, log
        self._values = Values(table, log)
        self._session: Session | None = None
        self._host_tolerance: float | None = None
        self._failure = ""
        self.clear()

    @property
    def table(self) -> tuple[Variable, ...]:
        """The variables; their place is the reference."""
        return self._values.table

    def clear(self) -> None:
        """Every variable at its start value; before initialization."""
        self._values.clear()
        self._host_tolerance, self._failure, self._ready = None, "", False
        self._start_time = 0.0
        if self._session is not None:
            self._session.reset()

    # -- variables ------------------------------------------------------------------------------------------------
    @guarded(())
    def get(self, references: Sequence[int]) -> Sequence[float]:
        """Numbers, those of arrays one after the other in row-major order."""
        return self._values.get(references, self._session)

    def size(self, references: Sequence[int]) -> int:
        """How many numbers ``get`` gives."""
        return self._values.size(references)

    @guarded(False)
    def set(self, references: Sequence[int], values: Sequence[float]) -> bool:
        """Set numbers; arrays take as many as they hold."""
        self._values.set(references, values, self._ready)
        return True

    @guarded(())
    def get_texts(self, references: Sequence[int]) -> Sequence[str]:
        """Strings."""
        return self._values.get_texts(references)

    @guarded(False)
    def set_texts(self, references: Sequence[int], values: Sequence[str]) -> bool:
        """Set strings."""
        self._values.set_texts(references, values, self._ready)
        return True

    # -- life cycle -----------------------------------------------------------------------------------------------
    @guarded(None)
    def setup(self, start_time: float, tolerance: float | None) -> None:
        """Start time, s, and the tolerance of the host, None where it gives none."""
        self._start_time, self._host_tolerance = start_time, tolerance

    def settings(self) -> Settings:
        """The parameters as settings of a session."""
        return settings_of(self._values, self._host_tolerance)

    def initialize(self) -> bool:
        """Build, and in prescribed mode solve; False and logged where that fails."""
        self._failure = "initialization failed, see the message before"
        if self._initialize():
            self._failure, self._ready = "", True
        return self._ready

    @guarded(False)
    def _initialize(self) -> bool:
        check_results_file(self._values)
        if estimate_wanted(self._values) and not self._values.text("resultsFile"):
            self.log(WARNING, "estimateError has no effect without resultsFile, where the estimate is told")
        session = self._session_for(self.settings())
        session.reset()
        push_loads(self._values, session)
        push_histories(self._values, session, self.log)
        session.initialize(self._start_time)
        for remark in session.warnings:
            self.log(WARNING, remark)
        self._values.take(session)
        return True

    def _session_for(self, settings: Settings) -> Session:
        """The session with these settings; one that exists keeps its operators."""
        from .session import Session

        if self._session is None or self._session.settings != settings:
            self._session = Session(self._open(), settings)
        return self._session

    @guarded(False)
    def step(self, t: float, h: float) -> bool:
        """Go on from t by h, s; False and logged where the step is refused."""
        session = self._session
        if not self._ready or session is None:
            self.log(DISCARD, self._failure or "a step before initialization")
            return False
        before = {name: session.load(name) for name in session.loads}
        push_loads(self._values, session)
        report = session.step(t, h)
        if not report.accepted:
            for name, (value, rate) in before.items():
                session.set_load(name, value, rate)
            self.log(DISCARD, report.message)
            return False
        self._values.take(session)
        return True

    @guarded(False)
    def terminate(self) -> bool:
        """Write the results, where they are asked for."""
        target = self._values.text("resultsFile")
        if target and self._ready and self._session is not None:
            from ..results.files import write_netcdf

            write_netcdf(self._session.dataset(estimate=estimate_wanted(self._values)), target)
        return True

    # -- states ---------------------------------------------------------------------------------------------------
    @guarded(None)
    def save(self) -> SavedState | None:
        """All of it, bit-exact; None where that fails (logged)."""
        session = self._session if self._ready else None
        tree: dict[str, Any] = {
            "values": self._values.tree(),
            "start_time": self._start_time,
            "tolerance": self._host_tolerance,
            "ready": int(self._ready),
            "failure": self._failure,
            "session": None if session is None else np.frombuffer(session.snapshot(), dtype=np.uint8),
        }
        return SavedState(encode(tree, self._kind), None if session is None else session.chain.head)

    @property
    def _kind(self) -> str:
        return f"participant {len(self.table)} {self.table[-1].name}"

    @guarded(False)
    def load(self, state: SavedState) -> bool:
        """Back to a saved state; nothing changes where it cannot be used (logged)."""
        tree = decode(state.blob, self._kind)
        keep = self._parts()
        try:
            self._take(tree)
            if tree["session"] is not None:
                self._session_for(self.settings()).restore(tree["session"].tobytes())
                self._values.changed()
        except LatinError:
            self._take_parts(keep)
            raise
        return True

    def _take(self, tree: dict[str, Any]) -> None:
        self._values.resume(tree["values"])
        self._start_time, self._host_tolerance = tree["start_time"], tree["tolerance"]
        self._ready, self._failure = bool(tree["ready"]), tree["failure"]

    def _parts(self) -> tuple[Any, ...]:
        return (self._values.tree(), self._start_time, self._host_tolerance, self._ready, self._failure, self._session)

    def _take_parts(self, parts: tuple[Any, ...]) -> None:
        values, self._start_time, self._host_tolerance, self._ready, self._failure, self._session = parts
        self._values.resume(values)


# -- From the values of the variables to the settings, loads and histories of a session.
def settings_of(values: Values, host_tolerance: float | None) -> Settings:
    """The parameters as settings; the tolerance of the host, where it gives one, goes first.

    The host's tolerance is a relative accuracy wanted; the parameter ``tolerance`` is on sqrt(eta).
    """
    from .settings import Settings

    given = None if host_tolerance is None or not host_tolerance > 0.0 else tolerance_for(host_tolerance)
    return Settings(
        mode=int(values.number("mode")),
        interpolation=int(values.number("inputInterpolation")),
        time_step=values.number("timeStep"),
        end_time=values.number("endTime"),
        tolerance=values.number("tolerance") if given is None else given,
        max_iterations=int(values.number("maxIterations")),
        keep=bool(values.text("resultsFile")),
    )


def check_results_file(values: Values) -> None:
    """Raises ResultsError where the results, if they are asked for, cannot be written."""
    if target := values.text("resultsFile"):
        from ..results.files import check_target

        check_target(target)


def estimate_wanted(values: Values) -> bool:
    """Whether the errors of what was solved are to be estimated at the end."""
    return bool(values.number("estimateError"))


def push_loads(values: Values, session: Session) -> None:
    """Inputs to the session."""
    for name in session.loads:
        session.set_load(name, values.number(f"load.{name}.value"), values.number(f"load.{name}.rate"))


def push_histories(values: Values, session: Session, log: Log) -> None:
    """Histories to the session, those of the file first.

    Raises InputError where the file, or a history, cannot be used.
    """
    from .loads import read_histories

    file = values.text("historyFile")
    if not session.prescribed:
        if file:
            log(WARNING, "historyFile has no effect in windowed mode: set mode = 1")
        return
    if file:
        for name, (times, amplitudes) in read_histories(file, session.loads).items():
            session.set_history(name, times, amplitudes)
    for name, (times, amplitudes) in values.histories().items():
        session.set_history(name, times, amplitudes)
