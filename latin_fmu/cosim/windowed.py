"""Windowed mode of a session: a communication step is one segment of the run, and the state is carried on."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np

from ..assembly.segments import Segment, SegmentedRun
from ..errors import SolverError
from ..kernels.outputs import N_SOLVER
from ..latin.outcome import Array, InterfaceHistory
from ..latin.state_serialization import check_like, check_numbers, unlike
from ..latin.windows import Run
from ..machine import one_thread
from ..scene.schema import Scene
from .kernel_steps import KernelSteps
from .loads import Loads
from .output_rows import OutputRecorder, OutputRows
from .outputs import first_event, shifted
from .settings import MAX_INSTANTS, SHORTEST, Settings, StepReport, refused
from .step_history import INTERFACE_FIELDS
from .variables import LINE

_ENTRIES: Final = ("run", "row", "time", "fields")  # of a state


class LastStep(NamedTuple):
    """Start of the last step: a function that returns to the state, and the loads; and of the step its ``end``, s,
    ``h``, s, and number of time steps."""

    before: Callable[[], None]
    loads: Loads
    end: float
    h: float
    n: int


class Windowed:
    """A run advanced by communication steps.

    A step in kernels is one call of them (``KernelSteps``); the Python driver makes the others: steps of other sizes or
    that need a fall-back, and what the kernels do not hold.

    Attributes
    ----------
    row : scalar outputs now, (n_output,). n_instant : instants of the last step. rule : of interpolation.
    segment : the last step, None before the first, after a state was restored, and where it was not recorded.
    """

    def __init__(self, scene: Scene, settings: Settings) -> None:
        self.run = SegmentedRun(scene, settings.tolerance)
        self.rule, self._time_step, self._keeps = settings.interpolation, settings.step_of(scene), settings.keep
        self._outputs = OutputRows(scene, self.run)
        self._kernels = KernelSteps(scene, self.rule, self.run, self._outputs)
        self.row = np.zeros(0)
        self._instants: tuple[float, float, int] | Array = np.zeros(1)  # first, last, how many; or all
        self._interfaces: dict[str, InterfaceHistory] | None = {}  # None: those of the last step
        self._known: dict[str, InterfaceHistory] = {}  # of each interface, for its geometry
        self.segment: Segment | None = None
        self._last_step: LastStep | None = None

    @property
    def time(self) -> Array:
        """Instants of the last step, (n + 1,), s, counted from the start."""
        return np.linspace(*self._instants) if isinstance(self._instants, tuple) else self._instants

    @property
    def n_instant(self) -> int:
        """Number of instants of the last step."""
        return self._instants[2] if isinstance(self._instants, tuple) else len(self._instants)

    @property
    def interfaces(self) -> dict[str, InterfaceHistory]:
        """Histories over the instants of the last step."""
        if self._interfaces is None:
            if self.segment is not None:
                self._interfaces = self.segment.interfaces
            else:
                self._interfaces = self._kernels.histories()
        return self._interfaces

    def start(self, loads: Loads, t0: float) -> None:
        """Compute the outputs at the start ``t0``, s, under the loads that are set."""
        self._outputs_now(loads)
        self.row = self._with_start(self.row, t0)

    def _outputs_now(self, loads: Loads) -> None:
        self.run.settle(loads.value)
        time = self.run.problem.assembly.time
        time = time - time[0]  # that of the last segment where there was one
        given = loads.at_rest(len(time))
        self.run.reset()
        with one_thread():
            run = self.run.begin(time, given, self._outputs.recorder(given))
        self._interfaces = self._known = run.recorder.interfaces()
        self._instants, self.segment = np.zeros(1), None
        self.row = self._outputs.present.copy()
        self.reset()

    def step(self, loads: Loads, t: float, h: float, t0: float, early: bool = False) -> StepReport:
        """Solve from t to t + h, s; ``t0`` is the start of the simulation.

        early : where there is a contact event, solve up to the end of its time step alone.

        Raises
        ------
        SolverError : the solver cannot continue; nothing has changed.
        """
        n = max(1, math.ceil(h / self._time_step * (1.0 - SHORTEST)))
        if n > MAX_INSTANTS:
            return refused(
                f"a step of {h:g} s would take {n} time steps of {self._time_step:g} s; at most {MAX_INSTANTS}: "
                "make shorter steps, or a longer timeStep",
                again=True,
            )
        report = self._by_kernels(loads, t, h, t0, n, early)
        return self._by_python(loads, t, h, t0, n, early) if report is None else report

    # -- steps in kernels -----------------------------------------------------------------------------------------
    def _by_kernels(self, loads: Loads, t: float, h: float, t0: float, n: int, early: bool) -> StepReport | None:
        """A step in one call of the kernels; None where the Python driver has to make it, for which nothing changes."""
        kernels, end = self._kernels, t + h - t0
        now = kernels.time if kernels.valid else self.run.time
        if not kernels.fit(now, end, n):
            return None
        if not kernels.ready(n):
            kernels.take_over(loads, end, n)
        segment, row = None, kernels.march(loads, end, n)
        if row is None:
            return None
        if early and n > 1 and kernels.has_event(row):
            kernels.take_back()
            return None
        if self._keeps or kernels.must_record:
            segment = kernels.recorded()
            if not segment.accepted:
                return None
        self._instants, self._interfaces, self.segment = (now, end, n + 1), None, segment
        self._last_step = None
        kernels.accept(loads)
        self.row = row if t0 == 0.0 else self._with_start(row, t0)
        return StepReport(True, "", n, *kernels.iterations(row))

    def _with_start(self, row: Array, t0: float) -> Array:
        """Outputs with their instants counted from a zero that is ``t0``, s, earlier."""
        return shifted(row, self._outputs.of_solver + N_SOLVER - 1, self._outputs.of_event, t0)

    # -- the Python driver ----------------------------------------------------------------------------------------
    def run_state(self) -> dict[str, Any] | None:
        """The present state of ``run``, whose steps follow."""
        self._kernels.give_back()
        self._kernels.leave()
        return self.run.get_state()

    def _by_python(self, loads: Loads, t: float, h: float, t0: float, n: int, early: bool) -> StepReport:
        before, given = self.run_state(), loads.copy()
        dt, whole, early_end = h / n, n, None
        driving = loads.driving(dt, n, self.rule)
        segment = self.advance(t + h - t0, n, driving, every=early)
        if early and n > 1 and segment.accepted:
            assert isinstance(segment.recorder, OutputRecorder)
            event = first_event(segment.recorder.outputs[:, self._outputs.of_event :])
            if event is not None and event < n:
                self.run.set_state(before)
                h, n, early_end = event * dt, event, t + event * dt
                segment = self.advance(early_end - t0, n, {name: line[: n + 1] for name, line in driving.items()})
        if not segment.accepted:
            return refused(f"no convergence in the step of {h:g} s at {t:g} s: {segment.status}", again=True)
        loads.accept(dt, n, whole, self.rule)
        end = (t + h if early_end is None else early_end) - t0
        self._last_step = LastStep(partial(self.run.set_state, before), given, end, h, n)
        if early_end is not None and self.rule == LINE:
            self._last_step = None  # these loads over this step are other lines
        self._kernels.reset()
        self.row = self._with_start(self.outputs_of(segment), t0)
        self._instants, self.segment, self._interfaces = segment.time, segment, None
        return StepReport(True, "", n, segment.iterations, segment.error_indicator, early=early_end)

    def advance(
        self,
        end: float,
        n: int,
        loads: Mapping[str, Array],
        solve: Callable[[Run], None] = Run.all,
        every: bool = False,
    ) -> Segment:
        """Solve n time steps up to ``end``, s; nothing changes where the segment is not accepted. ``solve`` : as for
        ``SegmentedRun.advance``. ``every`` : as for ``OutputRows.recorder``."""
        try:
            with np.errstate(all="ignore"):  # an overflow is reported as "not converged"
                return self.run.advance(end, n, loads, solve=solve, recorder=self._outputs.recorder(loads, every))
        except (ArithmeticError, ValueError, RuntimeError, np.linalg.LinAlgError) as error:
            raise SolverError(f"the solver cannot make this step: {error}") from error

    def outputs_of(self, segment: Segment) -> Array:
        """Scalar outputs (n_output,) at the end of a segment that ``advance`` has just made; the instants of events are
        counted from the start of the simulation."""
        return self._outputs.at_end(segment)

    @property
    def last_step(self) -> LastStep | None:
        """What the last step started from; None before the first, and after a state was restored."""
        step = self._kernels.origin
        if self._last_step is None and step is not None:
            before, h = self._kernels.return_to_origin, step.end - step.time
            self._last_step = LastStep(before, step.loads, step.end, h, step.n)
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
        self._kernels.reset()
        self._last_step = None

    def get_state(self) -> dict[str, Any]:
        """Everything that determines the next steps and the present outputs; completes that of the loads."""
        self._kernels.give_back()
        return {
            "run": np.frombuffer(self.run.snapshot(), dtype=np.uint8),
            "row": self.row,
            "time": self.time,
            "fields": self._fields(),
        }

    def set_state(self, state: Mapping[str, Any], loads: Loads, check: bool = False) -> None:
        """Restore a state. Raises InputError where its run is of another scene.

        check : compare its numbers with those of this run before.
        """
        if not len(self.row):
            self._outputs_now(loads)  # gives the geometry of the interfaces
        if check:
            self._check(state)
        self.run.restore(state["run"].tobytes(), check)
        self.row, self._instants = state["row"], state["time"]
        if check:
            fields = state["fields"].items()
            self.run.check_gaps({name: field["gap"][-1] for name, field in fields if field["gap"] is not None})
        self._interfaces = {name: replace(self._known[name], **f) for name, f in state["fields"].items()}
        self._kernels.reset()
        self.segment = self._last_step = None

    def _check(self, state: Mapping[str, Any]) -> None:
        """Compare a state that came from outside with this run. Raises InputError."""
        time = state.get("time")
        check_like(state, dict.fromkeys(_ENTRIES), "state", free=_ENTRIES)
        check_numbers(state["row"], "state.row", self.row)
        check_numbers(time, "state.time")
        if not isinstance(time, np.ndarray) or time.ndim != 1 or not len(time) or (np.diff(time) <= 0.0).any():
            raise unlike("state.time", "times that do not increase")
        check_like(state["fields"], dict.fromkeys(self._known), "state.fields", free=tuple(self._known))
        for name, history in self._known.items():
            fields = {f: getattr(history, f) for f in INTERFACE_FIELDS}
            known = {f: None if v is None else np.zeros((len(time), *v.shape[1:]), v.dtype) for f, v in fields.items()}
            check_like(state["fields"].get(name), known, f"state.fields.{name}")

    def _fields(self) -> dict[str, dict[str, Any]]:
        return {n: {f: getattr(h, f) for f in INTERFACE_FIELDS} for n, h in self.interfaces.items()}
