"""Windowed mode of a session: the run goes on over the time steps that end in a communication step."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np

from ..assembly.segments import Segment, SegmentedRun
from ..errors import InputError, NeedsPythonError, SolverError
from ..latin.outcome import Array, InterfaceHistory
from ..latin.state_serialization import check_like, check_numbers, unlike
from ..machine import one_thread
from ..propagator.image import Image
from ..scene.schema import Scene
from .communication import CommunicationRun
from .kernel_steps import KernelSteps
from .loads import GridPart, Loads
from .output_rows import OutputRows
from .settings import MAX_INSTANTS, Settings, StepReport, refused
from .step_history import INTERFACE_FIELDS

_ENTRIES: Final = ("run", "row", "window", "fields")  # of a state
_OF_SOLVER: Final = (ArithmeticError, ValueError, RuntimeError, np.linalg.LinAlgError)


class LastStep(NamedTuple):
    """The last step: its loads, and its number of time steps."""

    loads: Loads
    n: int


class Windowed:
    """A run advanced by communication steps.

    The state stands at the last instant of the grid that is not beyond the communication point; outputs are held from
    there. Every step is made by ``KernelSteps``.

    Attributes
    ----------
    row : scalar outputs now, (n_output,). rule : of interpolation.
    kernels : make the steps. segment : the last step, None before the first, after a state was restored, and where it
    was not recorded.
    """

    def __init__(self, scene: Scene, settings: Settings) -> None:
        self.run = SegmentedRun(scene, settings.tolerance)
        self.rule, self._keeps = settings.interpolation, settings.keep
        self._outputs = OutputRows(scene, self.run)
        self.kernels = KernelSteps(scene, self.rule, self.run, self._outputs)
        self.row = np.zeros(0)
        self._window = 0, 0  # time steps made before the last step, and in it
        self._histories: Callable[[], dict[str, InterfaceHistory]] = dict
        self._known: dict[str, InterfaceHistory] = {}  # of each interface, for its geometry
        self.segment: Segment | None = None
        self._last_step: LastStep | None = None
        self._scene = scene
        self._at_start: Image | None = None

    @property
    def time(self) -> Array:
        """Instants of the last step, (n + 1,), s, counted from the start."""
        return self.run.instants(*self._window)

    @property
    def n_instant(self) -> int:
        """Number of instants of the last step."""
        return self._window[1] + 1

    @property
    def interfaces(self) -> dict[str, InterfaceHistory]:
        """Histories over the instants of the last step."""
        known = self._histories()
        # requested again they are not read again
        self._histories = lambda: known
        return known

    def start(self, loads: Loads, t0: float) -> None:
        """Compute the outputs at the start ``t0``, s, under the loads that are set."""
        self._outputs.start = t0
        self._outputs_now(loads)

    def _outputs_now(self, loads: Loads) -> None:
        self.run.settle(loads.value)
        # as the first time step would have it
        given = loads.driving(GridPart(1, 0.0), self.run.dt, self.rule)
        self.run.reset()
        with one_thread():
            run = self.run.begin(1, given, self._outputs.recorder(given))
        self._known = run.recorder.interfaces()
        self._histories, self._window, self.segment = lambda: self._known, (0, 0), None
        self.row = self._outputs.present.copy()
        # outputs at t = 0 leave no state: loads may change before the first step
        self.reset()

    def step(self, loads: Loads, t: float, h: float, t0: float, early: bool = False) -> StepReport:
        """Solve from t to t + h, s; ``t0`` is the start of the simulation.

        early : where there is a contact event, solve up to the end of its time step alone.

        Raises
        ------
        SolverError : the solver cannot continue; nothing has changed.
        """
        dt, made = self.run.dt, self.run.made
        if h / dt > MAX_INSTANTS:
            return refused(
                f"a step of {h:g} s would take {h / dt:.0f} time steps of {dt:g} s; at most {MAX_INSTANTS}: "
                "make shorter steps, or a longer timeStep",
                again=True,
            )
        self._outputs.start, part, given = t0, loads.part(made, t, h, t0, dt), loads.copy()
        report = self._marched(given, part, early) if part.n else self._held()
        if not report.accepted:
            return refused(f"no convergence in the step of {h:g} s at {t:g} s: {report.message}", again=True)
        n = self._window[1]
        # the kernels have ended what they made to its end; else the loads are ended here
        if n and n == part.n:
            self.kernels.accept(loads)
        else:
            loads.accept(part, dt, self.rule, n)
        self._last_step = LastStep(given, n)
        return report if n == part.n else report._replace(early=float(t0 + self.time[-1]))

    def _held(self) -> StepReport:
        """A step that ends before the next instant: nothing but the loads goes on."""
        if self._window[1]:
            histories = self._histories
            self._histories = lambda: _last_of(histories())
        self._window, self.segment = (self.run.made, 0), None
        return StepReport(True)

    def _marched(self, loads: Loads, part: GridPart, early: bool) -> StepReport:
        """A step in calls of the kernels; not accepted: nothing has changed, and the message says what the run says."""
        kernels, made, segment = self.kernels, self.run.made, None
        try:
            row = kernels.march(loads, part, early)
            if row is None or self._keeps or kernels.must_record:
                segment = kernels.recorded(early)
                row = self._outputs.at_end(segment) if segment.accepted else None
        # of any kind, an interruption among them: the state must not be half of a step
        except BaseException as error:
            kernels.take_back()
            if isinstance(error, _OF_SOLVER):
                raise SolverError(f"the solver cannot make this step: {error}") from error
            raise
        if row is None:
            kernels.take_back()
            return StepReport(False, "" if segment is None else segment.status)
        kernels.keep_state()
        self._window, self.segment, self.row = (made, self.run.made - made), segment, row
        self._histories = kernels.histories if segment is None else lambda: segment.interfaces
        return StepReport(True, "", self._window[1], *kernels.iterations(row))

    def at_start(self) -> Image:
        """The image of a run at t = 0 as a compiled FMU has it, whose state follows from the inputs. Raises InputError
        for a scene that the kernels do not hold."""
        if self._at_start is None:
            try:
                self._at_start = CommunicationRun(self._scene, self.run.problem.settings.tolerance).image
            except NeedsPythonError as error:
                what, remedy = "makes derivatives in the first step unavailable", "take them from the second step on"
                problems = [replace(p, what=f"{p.what}, which {what}", remedy=remedy) for p in error.problems]
                raise InputError(problems, "there is no derivative in the first step of this scene") from error
        return self._at_start

    @property
    def incomplete(self) -> frozenset[str]:
        """Names of the outputs that the kernels do not make (``OutputRows.incomplete``)."""
        return self._outputs.incomplete

    @property
    def last_step(self) -> LastStep | None:
        """The last step; None before the first, and after a state was restored."""
        return self._last_step

    def instant(self, _time: float) -> int:
        """Index in ``time`` of the present instant."""
        return self.n_instant - 1

    def close(self) -> None:
        """Free the operators."""
        self.run.close()

    def reset(self) -> None:
        """Return to t = 0; operators are kept."""
        self.run.reset()
        self._last_step = None

    def get_state(self) -> dict[str, Any]:
        """Everything that determines the next steps and the present outputs; completes that of the loads."""
        return {
            "run": np.frombuffer(self.run.snapshot(), dtype=np.uint8),
            "row": self.row,
            "window": list(self._window),
            "fields": self._fields(),
        }

    def set_state(self, state: Mapping[str, Any], loads: Loads, check: bool = False) -> None:
        """Restore a state. Raises InputError where its run is of another scene.

        check : compare its numbers with those of this run before.
        """
        if not len(self.row):
            # a session that has not begun yet: restored all the same
            self._outputs_now(loads)  # gives the geometry of the interfaces
        if check:
            self._check(state)
        self.run.restore(state["run"].tobytes(), check)
        self.row, self._window = state["row"], (state["window"][0], state["window"][1])
        if check:
            if sum(self._window) != self.run.made:
                raise unlike("state.window", "time steps that do not end at the present one")
            fields = state["fields"].items()
            self.run.check_gaps({name: field["gap"][-1] for name, field in fields if field["gap"] is not None})
        fields = {name: replace(self._known[name], **f) for name, f in state["fields"].items()}
        self._histories = lambda: fields
        self.segment = self._last_step = None

    def _check(self, state: Mapping[str, Any]) -> None:
        """Compare a state that came from outside with this run. Raises InputError."""
        check_like(state, dict.fromkeys(_ENTRIES), "state", free=_ENTRIES)
        check_numbers(state["row"], "state.row", self.row)
        check_like(state["window"], [0, 0], "state.window")
        first, n = state["window"]
        if not (first >= 0 and 0 <= n <= MAX_INSTANTS):
            raise unlike("state.window", "time steps that there cannot be")
        check_like(state["fields"], dict.fromkeys(self._known), "state.fields", free=tuple(self._known))
        for name, history in self._known.items():
            fields = {f: getattr(history, f) for f in INTERFACE_FIELDS}
            known = {f: None if v is None else np.zeros((n + 1, *v.shape[1:]), v.dtype) for f, v in fields.items()}
            check_like(state["fields"].get(name), known, f"state.fields.{name}")

    def _fields(self) -> dict[str, dict[str, Any]]:
        return {n: {f: getattr(h, f) for f in INTERFACE_FIELDS} for n, h in self.interfaces.items()}


def _last_of(histories: Mapping[str, InterfaceHistory]) -> dict[str, InterfaceHistory]:
    """Histories over the last instant alone."""

    def last(history: InterfaceHistory) -> InterfaceHistory:
        known = {name: getattr(history, name) for name in INTERFACE_FIELDS}
        fields: dict[str, Any] = {name: None if field is None else field[-1:] for name, field in known.items()}
        return replace(history, **fields)

    return {name: last(history) for name, history in histories.items()}
