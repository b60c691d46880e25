"""A session behind numbered variables: everything an adapter to a co-simulation standard needs.

No exception leaves a participant: what goes wrong is logged with a level, and answered by False.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np

from ..errors import LatinError
from ..latin.blob import decode, encode
from .arrays import ArrayReader
from .variable import Variable

if TYPE_CHECKING:  # imported when a session is opened: hosts instantiate only to look
    from ..latin.record import Array
    from ..scene.schema import Scene
    from .accepted import Link
    from .session import Session
    from .settings import Settings

OK, WARNING, DISCARD, ERROR = 0, 1, 2, 3
"""Levels of a message, as the FMI counts them."""

Log = Callable[[int, str], None]
Method = TypeVar("Method", bound=Callable[..., Any])


class SavedState:
    """A saved state: its bytes, and what keeps the accepted steps before it alive."""

    def __init__(self, blob: bytes, link: Link | None = None) -> None:
        self.blob, self.link = blob, link


def guarded(fallback: object) -> Callable[[Method], Method]:
    """Log what a method raises and return ``fallback``."""

    def wrap(method: Method) -> Method:
        @wraps(method)
        def call(self: Participant, *args: Any) -> Any:
            try:
                return method(self, *args)
            except LatinError as error:
                self.log(ERROR, str(error))
            except Exception as error:  # the host must survive whatever happens here
                self.log(ERROR, f"unexpected {type(error).__name__} in {method.__name__}: {error}")
            return fallback

        return cast(Method, call)

    return wrap


class Participant:
    """Variables by reference (their place in the table), life cycle, states.

    Parameters
    ----------
    table : the variables. scene : called for the scene when it is first needed. log : takes level and message.
    """

    def __init__(self, table: Sequence[Variable], scene: Callable[[], Scene], log: Log) -> None:
        self.table, self._open, self.log = tuple(table), scene, log
        self._place = {v.name: i for i, v in enumerate(self.table)}
        self._outputs = [i for i, v in enumerate(self.table) if v.causality == "output" and not v.is_array]
        self._session: Session | None = None
        self._arrays = ArrayReader(self.table)
        self._host_tolerance: float | None = None
        self._failure = ""
        self.clear()

    def clear(self) -> None:
        """Every variable at its start value; before initialization."""
        self.numbers: Array = np.array(
            [
                float(v.start) if isinstance(v.start, (int, float)) and not v.is_array else 0.0
                for v in self.table
            ]
        )
        self.texts = {i: str(v.start) for i, v in enumerate(self.table) if v.kind == "string"}
        self._arrays.clear()
        self._host_tolerance, self._failure, self._ready = None, "", False
        self._start_time = 0.0
        if self._session is not None:
            self._session.reset()

    # -- variables ------------------------------------------------------------------------------------------------
    @guarded(())
    def get(self, references: Sequence[int]) -> Sequence[float]:
        """Numbers, those of arrays one after the other in row-major order."""
        if not self._arrays.has(references):
            values: list[float] = self.numbers[references].tolist()
            return values
        found: list[float] = []
        for reference in references:
            if self.table[reference].is_array:
                found += self._arrays.read(reference, self.numbers, self._place, self._session)
            else:
                found.append(float(self.numbers[reference]))
        return found

    def size(self, references: Sequence[int]) -> int:
        """How many numbers ``get`` gives."""
        if not self._arrays.has(references):
            return len(references)
        return sum(
            self._arrays.size(r, self.numbers, self._place) if 0 <= r < len(self.table) else 1
            for r in references
        )

    @guarded(False)
    def set(self, references: Sequence[int], values: Sequence[float]) -> bool:
        """Set numbers; arrays take as many as they hold."""
        if not self._arrays.has(references):
            for reference, value in zip(references, values, strict=True):
                self._set(reference, value)
            return True
        at = 0
        for reference in references:
            if self.table[reference].is_array:
                size = self._arrays.size(reference, self.numbers, self._place)
                self._arrays.write(reference, values[at : at + size])
                at += size
            else:
                self._set(reference, values[at])
                at += 1
        return True

    def _set(self, reference: int, value: float) -> None:
        variable = self.table[reference]
        if variable.causality in ("output", "independent"):
            self.log(WARNING, f"{variable.name} is calculated and was not set")
        elif self._ready and variable.causality != "input":
            self.log(WARNING, f"{variable.name} is fixed after initialization and was not set")
        else:
            self.numbers[reference] = value

    @guarded(())
    def get_texts(self, references: Sequence[int]) -> Sequence[str]:
        """Strings."""
        return [self.texts[reference] for reference in references]

    @guarded(False)
    def set_texts(self, references: Sequence[int], values: Sequence[str]) -> bool:
        """Set strings."""
        for reference, value in zip(references, values, strict=True):
            if self._ready:
                self.log(
                    WARNING, f"{self.table[reference].name} is fixed after initialization and was not set"
                )
            else:
                self.texts[reference] = value
        return True

    def _number(self, name: str) -> float:
        return float(self.numbers[self._place[name]])

    def _text(self, name: str) -> str:
        return self.texts[self._place[name]]

    # -- life cycle -----------------------------------------------------------------------------------------------
    @guarded(None)
    def setup(self, start_time: float, tolerance: float | None) -> None:
        """Start time, s, and the tolerance of the host, None where it gives none."""
        self._start_time, self._host_tolerance = start_time, tolerance

    def settings(self) -> Settings:
        """The parameters as settings of a session."""
        from .settings import Settings

        tolerance = self._host_tolerance
        return Settings(
            mode=int(self._number("mode")),
            interpolation=int(self._number("inputInterpolation")),
            time_step=self._number("timeStep"),
            end_time=self._number("endTime"),
            tolerance=self._number("tolerance") if tolerance is None or tolerance <= 0.0 else tolerance,
            max_iterations=int(self._number("maxIterations")),
            keep=bool(self._text("resultsFile")),
        )

    def initialize(self) -> bool:
        """Build, and in prescribed mode solve; False and logged where that fails."""
        self._failure = "initialization failed, see the message before"
        if self._initialize():
            self._failure, self._ready = "", True
        return self._ready

    @guarded(False)
    def _initialize(self) -> bool:
        self._check_results_file()
        session = self._session_for(self.settings())
        session.reset()
        self._push_inputs(session)
        if session.prescribed:
            self._give_histories(session)
        elif self._text("historyFile"):
            self.log(WARNING, "historyFile has no effect in windowed mode: set mode = 1")
        session.initialize(self._start_time)
        for remark in session.warnings:
            self.log(WARNING, remark)
        self._pull_outputs(session)
        return True

    def _check_results_file(self) -> None:
        if target := self._text("resultsFile"):
            from ..results.files import check_target

            check_target(target)

    def _session_for(self, settings: Settings) -> Session:
        """The session with these settings; one that exists keeps its operators."""
        from .session import Session

        if self._session is None or self._session.settings != settings:
            self._session = Session(self._open(), settings)
        return self._session

    def _give_histories(self, session: Session) -> None:
        from .history_file import read_histories

        if file := self._text("historyFile"):
            for name, (times, values) in read_histories(file, session.loads).items():
                session.set_history(name, times, values)
        for name, (times, values) in self._arrays.histories(self.numbers, self._place).items():
            session.set_history(name, times, values)

    def _push_inputs(self, session: Session) -> None:
        for name in session.loads:
            session.set_load(name, self._number(f"load.{name}.value"), self._number(f"load.{name}.rate"))

    def _pull_outputs(self, session: Session) -> None:
        row = session.row
        self.numbers[self._outputs[: len(row)]] = row
        self.numbers[0] = session.time
        self._arrays.changed()
        count = self._place.get("window.count")
        if count is not None:
            self.numbers[count] = self._arrays.count(session, self.numbers, self._place)

    @guarded(False)
    def step(self, t: float, h: float) -> bool:
        """Go on from t by h, s; False and logged where the step is refused."""
        session = self._session
        if not self._ready or session is None:
            self.log(DISCARD, self._failure or "a step before initialization")
            return False
        before = {name: session.load(name) for name in session.loads}
        self._push_inputs(session)
        report = session.step(t, h)
        if not report.accepted:
            for name, (value, rate) in before.items():
                session.set_load(name, value, rate)
            self.log(DISCARD, report.message)
            return False
        self._pull_outputs(session)
        return True

    @guarded(False)
    def terminate(self) -> bool:
        """Write the results, where they are asked for."""
        target = self._text("resultsFile")
        if target and self._ready and self._session is not None:
            from ..results.netcdf import write_netcdf

            write_netcdf(self._session.dataset(), target)
        return True

    # -- states ---------------------------------------------------------------------------------------------------
    @guarded(None)
    def save(self) -> SavedState | None:
        """All of it, bit-exact; None where that fails (logged)."""
        session = self._session if self._ready else None
        tree: dict[str, Any] = {
            "numbers": self.numbers,
            "texts": {str(i): text for i, text in self.texts.items()},
            "arrays": self._arrays.tree(),
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
                self._arrays.changed()
        except LatinError:
            self._take_parts(keep)
            raise
        return True

    def _take(self, tree: dict[str, Any]) -> None:
        self.numbers = tree["numbers"]
        self.texts = {int(i): text for i, text in tree["texts"].items()}
        self._arrays.resume(tree["arrays"])
        self._start_time, self._host_tolerance = tree["start_time"], tree["tolerance"]
        self._ready, self._failure = bool(tree["ready"]), tree["failure"]

    def _parts(self) -> tuple[Any, ...]:
        return (
            self.numbers, self.texts, self._arrays.tree(), self._start_time, self._host_tolerance, self._ready,
            self._failure, self._session,
        )  # fmt: skip

    def _take_parts(self, parts: tuple[Any, ...]) -> None:
        (self.numbers, self.texts, arrays, self._start_time, self._host_tolerance, self._ready, self._failure,
         self._session) = parts  # fmt: skip
        self._arrays.resume(arrays)
