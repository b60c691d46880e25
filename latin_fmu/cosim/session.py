"""A session: one scene taken through a simulation by communication steps.

session = Session(scene)                              # windowed mode
session.set_load("press", value=0.3, rate=1e5)
session.initialize()
report = session.step(0.0, 1e-6)
force = session.value("interface.crush.force[3]")
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from ..errors import InputError, LatinError, Problem, SolverError
from ..latin.blob import decode, encode
from ..latin.record import Array, InterfaceHistory
from ..scene.laws import InputLaw
from ..scene.schema import Scene
from .accepted import AcceptedStep, Chain
from .history_file import Histories, check_history
from .prescribed import Prescribed
from .settings import Settings
from .step_report import StepReport, refused
from .variables import HOLD, LINE, PRESCRIBED, input_loads, scalar_table
from .windowed import Windowed

MAX_INSTANTS = 1_000_000  # of one communication step
SHORTEST = 1e-9  # of a time step: shorter communication steps are round-off
EARLY = 1e-6  # of the step: how far its start may be from the present time


class Session:
    """A scene in a co-simulation.

    Parameters
    ----------
    scene : loads with the law ``input`` are set here, the others keep their law; its time counts from the start of
        the simulation.
    settings : mode and choices, see ``Settings``.

    Raises
    ------
    InputError : a setting out of range.
    """

    def __init__(self, scene: Scene, settings: Settings | None = None) -> None:
        self.settings = Settings() if settings is None else settings
        self.scene = self.settings.applied(scene)
        self.table = scalar_table(scene)
        self.outputs = tuple(v.name for v in self.table if v.causality == "output")
        self._index = {name: i for i, name in enumerate(self.outputs)}
        self._start = {name: _start_value(scene, name) for name in input_loads(scene)}
        self._time_step = scene.time.time_step if self.settings.time_step is None else self.settings.time_step
        self._kind = hashlib.sha256((self.scene.text() + repr(self._choices())).encode()).hexdigest()
        self._windowed: Windowed | None = None
        self._prescribed: Prescribed | None = None
        self._solved_for = ""
        self.chain = Chain()
        self.reset()

    def _choices(self) -> tuple[object, ...]:
        s = self.settings
        return (s.mode, s.interpolation, s.time_step, s.end_time, s.tolerance, s.max_iterations)

    def reset(self) -> None:
        """Back to before ``initialize``; loads at their start values, no histories. Operators are kept."""
        self.time, self._t0, self.started = 0.0, 0.0, False
        self._value = dict(self._start)
        self._rate = dict.fromkeys(self._start, 0.0)
        self._reached = dict(self._start)
        self._initial: dict[str, tuple[float, float]] = {}
        self._histories: Histories = {}
        self.row: Array = np.zeros(len(self.outputs))
        self.chain.clear()
        if self._windowed is not None:
            self._windowed.run.reset()

    @property
    def prescribed(self) -> bool:
        """Whether the mode is prescribed."""
        return self.settings.mode == PRESCRIBED

    # -- inputs ---------------------------------------------------------------------------------------------------
    @property
    def loads(self) -> tuple[str, ...]:
        """Names of the loads set from outside."""
        return tuple(self._start)

    def set_load(self, name: str, value: float, rate: float = 0.0) -> None:
        """Amplitude of a load at the start of the next step and its rate (1/s) over it.

        Raises InputError for a load that is not set from outside.
        """
        self._check_load(name)
        self._value[name], self._rate[name] = float(value), float(rate)

    def load(self, name: str) -> tuple[float, float]:
        """Value and rate that were set."""
        self._check_load(name)
        return self._value[name], self._rate[name]

    def set_history(self, name: str, times: Sequence[float] | Array, values: Sequence[float] | Array) -> None:
        """History of a load for prescribed mode: linear between its points, held at both ends.

        Raises InputError for a load that is not set from outside, numbers that are not finite, times that do not
        increase.
        """
        self._check_load(name)
        self._histories[name] = check_history(
            f"history of load {name}", np.asarray(times), np.asarray(values)
        )

    def _check_load(self, name: str) -> None:
        if name not in self._start:
            allowed = ", ".join(self._start) or 'none: give a load law = "input"'
            raise InputError([Problem(f"load {name}", "not set from outside", None, allowed)])

    # -- run ------------------------------------------------------------------------------------------------------
    def initialize(self, t0: float = 0.0) -> None:
        """Build the scene; in prescribed mode also solve it. ``t0`` is the present time of the simulation, s.

        Raises
        ------
        InputError : the scene cannot be built, an input is no number. SolverError : prescribed mode, no convergence.
        """
        bad = self._not_finite()
        if bad or not math.isfinite(t0):
            raise InputError(
                [Problem(bad or "start time", "is not a finite number")], "the session cannot start"
            )
        tolerance = self.settings.tolerance
        if self.prescribed:
            self._solve()
            assert self._prescribed is not None
            self.row = self._prescribed.row_at(0.0)
        else:
            if self._windowed is None:
                self._windowed = Windowed(self.scene, tolerance)
            self._windowed.start(self._value)
            self.row = self._windowed.row
        self._t0 = self.time = float(t0)
        self._reached = dict(self._value)
        self._initial = {name: self.load(name) for name in self._start}
        self.started = True

    def _solve(self) -> None:
        key = hashlib.sha256(encode(self._history_tree(), "histories")).hexdigest()
        if self._prescribed is None or self._solved_for != key:
            self._prescribed = None
            try:
                self._prescribed = Prescribed(
                    self.scene, self.settings.tolerance, self._histories, self._value
                )
            except (ArithmeticError, ValueError, RuntimeError, np.linalg.LinAlgError) as error:
                raise SolverError(f"the solver cannot continue: {error}") from error
            self._solved_for = key

    def step(self, t: float, h: float) -> StepReport:
        """Go on from t by h, s, with the loads set before. A step that is refused changes nothing."""
        if trouble := self._trouble(t, h):
            return refused(trouble)
        try:
            report = self._play(t, h) if self.prescribed else self._advance(t, h)
        except LatinError as error:
            return refused(str(error))
        if report.accepted:
            self.time = t + h
        return report

    def _trouble(self, t: float, h: float) -> str:
        """Why a step cannot be made; empty where it can."""
        if not self.started:
            return "the session is not initialized"
        if not (math.isfinite(t) and math.isfinite(h)):
            return f"time {t!r} or step size {h!r} is not a finite number"
        if h <= SHORTEST * self._time_step or t + h <= t:
            return f"the step size {h!r} s is too short; it must exceed {SHORTEST * self._time_step:.3g} s"
        if abs(t - self.time) > EARLY * h:
            return f"the step starts at {t!r} s, but the present time is {self.time!r} s: restore a state to go back"
        if bad := self._not_finite():
            return f"{bad} is not a finite number"
        return ""

    def _not_finite(self) -> str:
        for name in self._start:
            for what, number in (("value", self._value[name]), ("rate", self._rate[name])):
                if not math.isfinite(number):
                    return f"load.{name}.{what} = {number!r}"
        return ""

    def _advance(self, t: float, h: float) -> StepReport:
        assert self._windowed is not None
        n = max(1, math.ceil(h / self._time_step * (1.0 - SHORTEST)))
        if n > MAX_INSTANTS:
            return refused(
                f"a step of {h:g} s would take {n} time steps of {self._time_step:g} s; at most {MAX_INSTANTS}: "
                "make shorter steps, or a longer timeStep"
            )
        amplitudes = {name: self._amplitude(name, h, n) for name in self._start}
        segment = self._windowed.advance(t + h - self._t0, n, amplitudes)
        if not segment.accepted:
            return refused(f"no convergence in the step of {h:g} s at {t:g} s: {segment.status}")
        self._reached = {name: float(a[-1]) for name, a in amplitudes.items()}
        self.row = self._windowed.row
        if self.settings.keep:
            self.chain.append(AcceptedStep(t, t + h, self.row, dict(self._value), dict(self._rate), segment))
        return StepReport(True, "", n, segment.iterations, segment.error_indicator)

    def _amplitude(self, name: str, h: float, n: int) -> Array:
        """Amplitudes (n + 1,) of a load over a step."""
        value = self._value[name]
        if self.settings.interpolation == HOLD:
            return np.full(n + 1, value)
        if self.settings.interpolation == LINE:
            return np.linspace(self._reached[name], value, n + 1)
        line: Array = value + self._rate[name] * np.linspace(0.0, h, n + 1)
        return line

    def _play(self, t: float, h: float) -> StepReport:
        assert self._prescribed is not None
        solved = self._prescribed
        for name, initial in self._initial.items():
            if self.load(name) != initial:
                return refused(
                    f"load.{name} was changed after initialization, which has no effect in prescribed mode: give a "
                    "history before initialization, or use mode 0 (windowed)"
                )
        end = float(solved.time[-1])
        if t + h - self._t0 > end * (1.0 + 1e-9):
            return refused(
                f"the interval solved ends at {self._t0 + end:g} s: set endTime before initialization"
            )
        self.row = solved.row_at(t + h - self._t0)
        segment = solved.segment
        if self.settings.keep:
            self.chain.append(AcceptedStep(t, t + h, self.row, dict(self._value), dict(self._rate), None))
        return StepReport(True, "", len(solved.time) - 1, segment.iterations, segment.error_indicator)

    # -- outputs --------------------------------------------------------------------------------------------------
    def value(self, name: str) -> float:
        """A scalar output. Raises InputError for a name that is none."""
        return float(self.values([name])[0])

    def values(self, names: Sequence[str]) -> Array:
        """Scalar outputs (n,), read at once."""
        try:
            return self.row[[self._index[name] for name in names]]
        except KeyError as error:
            raise InputError([Problem(str(error.args[0]), "no output of this name")]) from None

    def window(self) -> tuple[Array, dict[str, InterfaceHistory]]:
        """Instants (n,), s, and interface histories of the last step (the whole interval in prescribed mode)."""
        if self._prescribed is not None:
            return self._t0 + self._prescribed.time, self._prescribed.interfaces
        if self._windowed is not None:
            return self._t0 + self._windowed.time, self._windowed.interfaces
        return np.zeros(0), {}

    def instant(self) -> int:
        """Index of the present instant in ``window``."""
        if self._prescribed is not None:
            return self._prescribed.instant_at(self.time - self._t0)
        return len(self.window()[0]) - 1

    @property
    def warnings(self) -> tuple[str, ...]:
        """Remarks about the scene, known after ``initialize``."""
        engine = self._windowed or self._prescribed
        return () if engine is None else engine.run.built.warnings

    def dataset(self) -> xr.DataTree:
        """Accepted steps as a DataTree: that of a run, and group ``exchange`` with inputs and outputs by step."""
        from .exchange_dataset import session_tree

        return session_tree(self, self._windowed or self._prescribed)

    # -- state ----------------------------------------------------------------------------------------------------
    def _history_tree(self) -> dict[str, Any]:
        return {"value": dict(self._value), "history": {k: list(v) for k, v in self._histories.items()}}

    def snapshot(self) -> bytes:
        """Everything that determines the next steps and the outputs, versioned, bit-exact."""
        tree: dict[str, Any] = {
            "time": self.time, "t0": self._t0, "started": int(self.started), "row": self.row,
            "value": self._value, "rate": self._rate, "reached": self._reached,
            "initial": {name: list(pair) for name, pair in self._initial.items()},
            "histories": {name: list(pair) for name, pair in self._histories.items()},
            "last": self.chain.identity, "engine": None,
        }  # fmt: skip
        if self.started and self._windowed is not None:
            tree["engine"] = self._windowed.tree()
        return encode(tree, self._kind)

    def restore(self, blob: bytes) -> None:
        """Back to a snapshot of this or another session of the same scene and settings.

        Raises
        ------
        InputError : no such bytes; nothing has changed. In prescribed mode a session that has not solved these
        histories solves them.
        """
        tree = decode(blob, self._kind)
        if tree["engine"] is not None:
            if self._windowed is None:
                self._windowed = Windowed(self.scene, self.settings.tolerance)
            self._windowed.resume(tree["engine"])
        self.time, self._t0, self.started = tree["time"], tree["t0"], bool(tree["started"])
        self.row = tree["row"]
        self._value, self._rate, self._reached = tree["value"], tree["rate"], tree["reached"]
        self._initial = {name: (a, b) for name, (a, b) in tree["initial"].items()}
        self._histories = {name: (t, a) for name, (t, a) in tree["histories"].items()}
        self.chain.move_to(tree["last"])
        if self.started and self.prescribed:
            wanted, self._value = self._value, {name: pair[0] for name, pair in self._initial.items()}
            self._solve()
            self._value = wanted


def _start_value(scene: Scene, name: str) -> float:
    law = scene.load[name].law
    assert isinstance(law, InputLaw)
    return law.start_value
