"""Windowed mode: a communication step is one segment of the run, the state is carried on."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..assembly.problem import SolverReadyProblem
from ..assembly.segments import Segment, SegmentedRun
from ..blas_threads import one_thread
from ..errors import SolverError
from ..latin.record import Array, InterfaceHistory, Timings
from ..latin.recorder import Recorder
from ..latin.state_serialization import encode
from ..latin.windows import Run
from ..scene.schema import Scene
from .loads import Histories, Loads
from .outputs import Motion, Places, impulses, motion_now, motion_of, nodes_of, places_of, rows_of, series_of
from .settings import SHORTEST, Settings, StepReport, refused

MAX_INSTANTS = 1_000_000  # of one communication step


class Windowed:
    """A run advanced by communication steps.

    Attributes
    ----------
    row : scalar outputs now, (n_output,). time : instants of the last step, (n + 1,), s, counted from the start.
    interfaces : histories over these instants. segment : the last step, None before the first.
    """

    def __init__(self, scene: Scene, settings: Settings) -> None:
        self.run = SegmentedRun(scene, settings.tolerance)
        self._rule, self._time_step = settings.interpolation, settings.step_of(scene)
        self._places = places_of(scene, self.run.problem.info)
        self._impulse = np.zeros((len(scene.interface), 3))
        self.row = np.zeros(0)
        self.time = np.zeros(1)
        self.interfaces: dict[str, InterfaceHistory] = {}
        self.segment: Segment | None = None

    def start(self, loads: Loads) -> None:
        """Outputs at t = 0, with the loads as they are set."""
        self._outputs_now(loads.value)

    def _outputs_now(self, amplitudes: Mapping[str, float]) -> None:
        self.run.settle(amplitudes)
        problem = self.run.problem
        assembly = problem.assembly
        given = {name: np.full(len(assembly.time), value) for name, value in amplitudes.items()}
        problem.timeline.begin(assembly, assembly.time, given, assembly.ground_start)
        recorder = Recorder(assembly, problem.wanted, problem.info)
        with one_thread():
            Run(assembly, problem.settings, recorder, Timings())
        self.interfaces = recorder.interfaces(assembly)
        self.time, self.segment = np.zeros(1), None
        self._impulse = np.zeros_like(self._impulse)
        motion = motion_now(self._places, self.run.displacement, self.run.velocity)
        series = series_of(self.interfaces)
        energy = recorder.assembly_energy(assembly)
        rows = rows_of(series, self._impulse[None], motion, (0.0, 0.0, 1.0, 0.0), energy, 1)
        self.row = rows[0]
        self.run.reset()

    def step(self, loads: Loads, t: float, h: float, t0: float) -> StepReport:
        """Go on from t by h, s, t0 being the start of the simulation.

        Raises
        ------
        SolverError : the solver cannot continue; nothing has changed.
        """
        n = max(1, math.ceil(h / self._time_step * (1.0 - SHORTEST)))
        if n > MAX_INSTANTS:
            return refused(
                f"a step of {h:g} s would take {n} time steps of {self._time_step:g} s; at most {MAX_INSTANTS}: "
                "make shorter steps, or a longer timeStep"
            )
        amplitudes = loads.amplitudes(h, n, self._rule)
        segment = self._advance(t + h - t0, n, amplitudes)
        if not segment.accepted:
            return refused(f"no convergence in the step of {h:g} s at {t:g} s: {segment.status}")
        loads.reach(amplitudes)
        self._read(segment)
        return StepReport(True, "", n, segment.iterations, segment.error_indicator)

    def _advance(self, end: float, n: int, loads: Mapping[str, Array]) -> Segment:
        """Solve n time steps up to ``end``, s; nothing changes where the segment is not accepted."""
        before = self.run.snapshot()
        try:
            with np.errstate(all="ignore"):  # what overflows ends as "not converged"
                return self.run.advance(end, n, loads)
        except (ArithmeticError, ValueError, RuntimeError, np.linalg.LinAlgError) as error:
            self.run.restore(before)
            raise SolverError(f"the solver cannot make this step: {error}") from error

    def _read(self, segment: Segment) -> None:
        n = len(segment.time) - 1
        dt = (segment.time[-1] - segment.time[0]) / n
        series = series_of(segment.interfaces)
        impulse = impulses(series, float(dt), self._impulse)
        motion = motion_now(self._places, self.run.displacement, self.run.velocity)
        energy = None if segment.energy is None else {k: v[-1:] for k, v in segment.energy.items()}
        solver = (segment.iterations, segment.error_indicator, float(segment.converged), n)
        last = {name: s.last() for name, s in series.items()}
        self.row = rows_of(last, impulse[-1:], motion, solver, energy, 1)[0]
        self._impulse = impulse[-1]
        self.time, self.interfaces, self.segment = segment.time, segment.interfaces, segment

    def instant(self, _time: float) -> int:
        """Index in ``time`` of the present instant."""
        return len(self.time) - 1

    def reset(self) -> None:
        """Back to t = 0."""
        self.run.reset()

    def tree(self) -> dict[str, Any]:
        """All that determines the next steps and the outputs now."""
        return {
            "run": np.frombuffer(self.run.snapshot(), dtype=np.uint8),
            "impulse": self._impulse,
            "row": self.row,
            "time": self.time,
            "fields": {name: _fields(history) for name, history in self.interfaces.items()},
        }

    def resume(self, tree: Mapping[str, Any], _loads: Loads) -> None:
        """Back to a tree. Raises InputError where the run in it is of another scene."""
        if not self.interfaces:
            self._outputs_now({})  # gives the geometry of the interfaces
        self.run.restore(tree["run"].tobytes())
        self._impulse, self.row, self.time = tree["impulse"], tree["row"], tree["time"]
        known = self.interfaces
        self.interfaces = {name: replace(known[name], **f) for name, f in tree["fields"].items()}
        self.segment = None


_FIELDS = ("traction", "velocity", "gap", "contact_status", "friction_power", "layer_energy", "joint_power")


def _fields(history: InterfaceHistory) -> dict[str, Any]:
    return {key: getattr(history, key) for key in _FIELDS}


# -- Prescribed mode: the whole interval solved from given histories, then played back.
ROUND_OFF = 1e-9  # of a time step: an instant this close is that instant


class Prescribed:
    """The solution over [0, T] and its playback.

    Attributes
    ----------
    run : the solver. segment : the whole interval. row : scalar outputs at the present time, (n_output,).
    time : instants (n + 1,), s, counted from the start; none before ``start``.
    """

    def __init__(self, scene: Scene, settings: Settings) -> None:
        self._scene, self._tolerance = scene, settings.tolerance
        self._solved_for = ""
        self.run: SegmentedRun | None = None
        self.segment: Segment | None = None
        self.row = np.zeros(0)
        self._table = np.zeros((0, 0))  # rows of all instants

    def start(self, loads: Loads) -> None:
        """Solve, and be at the first instant.

        Raises
        ------
        SolverError : the solution did not converge.
        """
        self._solve(loads.value, loads.histories)
        self.row = self._row_at(0.0)

    def _solve(self, values: Mapping[str, float], histories: Histories) -> None:
        """Solve for these loads: a history, or a constant value; nothing to do where that is solved already."""
        given = {"value": dict(values), "history": {name: list(pair) for name, pair in histories.items()}}
        key = hashlib.sha256(encode(given, "histories")).hexdigest()
        if key == self._solved_for:
            return
        self._solved_for = ""
        try:
            run = SegmentedRun(self._scene, self._tolerance)
            places = places_of(self._scene, run.problem.info)
            run.problem, nodes = _recording(run.problem, places)
            end, n = self._scene.time.end, self._scene.time.n_step
            instants = np.linspace(0.0, end, n + 1)
            loads = {name: np.full(n + 1, value) for name, value in values.items()}
            loads |= {name: np.interp(instants, times, given) for name, (times, given) in histories.items()}
            with np.errstate(all="ignore"):
                segment = run.advance(end, n, loads)
        except (ArithmeticError, ValueError, RuntimeError, np.linalg.LinAlgError) as error:
            raise SolverError(f"the solver cannot continue: {error}") from error
        if not segment.converged:
            raise SolverError(segment.status)
        motion = motion_of(places, segment.substructures, nodes)
        self._table = _rows(segment, motion, n)
        self.run, self.segment, self._solved_for = run, _as_asked(segment, self._scene), key

    def step(self, loads: Loads, t: float, h: float, t0: float) -> StepReport:
        """Play back from t to t + h, s, t0 being the start of the simulation."""
        if changed := loads.changed():
            return refused(
                f"load.{changed} was changed after initialization, which has no effect in prescribed mode: give a "
                "history before initialization, or use mode 0 (windowed)"
            )
        assert self.segment is not None
        end = float(self.time[-1])
        if t + h - t0 > end * (1.0 + ROUND_OFF):
            return refused(f"the interval solved ends at {t0 + end:g} s: set endTime before initialization")
        self.row = self._row_at(t + h - t0)
        return StepReport(True, "", len(self.time) - 1, self.segment.iterations, self.segment.error_indicator)

    @property
    def time(self) -> Array:
        """Instants solved, s."""
        return np.zeros(0) if self.segment is None else self.segment.time

    @property
    def interfaces(self) -> dict[str, InterfaceHistory]:
        """Histories over the whole interval."""
        return {} if self.segment is None else self.segment.interfaces

    def _row_at(self, time: float) -> Array:
        """Scalar outputs at a time within the interval: those of an instant, linear between two instants."""
        place = self._place(time)
        near = round(place)
        if abs(place - near) <= ROUND_OFF * max(1.0, abs(place)):
            row: Array = self._table[min(max(near, 0), len(self._table) - 1)].copy()
            return row
        i = int(np.clip(np.floor(place), 0, len(self._table) - 2))
        share = place - i
        mixed: Array = (1.0 - share) * self._table[i] + share * self._table[i + 1]
        return mixed

    def _place(self, time: float) -> float:
        return time / float(self.time[1] - self.time[0])

    def instant(self, time: float) -> int:
        """Index in ``time`` of the last instant that is not after a time since the start, s."""
        place = self._place(time)
        return int(np.clip(np.floor(place + ROUND_OFF * max(1.0, abs(place))), 0, len(self._table) - 1))

    def reset(self) -> None:
        """Back to before ``start``; the solution is kept."""

    def tree(self) -> dict[str, Any]:
        """What restores the playback: the outputs now; the solution follows from the loads."""
        return {"row": self.row}

    def resume(self, tree: Mapping[str, Any], loads: Loads) -> None:
        """Back to a tree; solves where these loads are not solved yet. Raises SolverError."""
        self._solve(loads.initial_values(), loads.histories)
        self.row = tree["row"]


def _rows(segment: Segment, motion: Sequence[Motion], n: int) -> Array:
    """Scalar outputs at every instant, (n + 1, n_output)."""
    series = series_of(segment.interfaces)
    impulse = [history.impulse(segment.time) for history in segment.interfaces.values()]
    running = np.stack(impulse, axis=1) if impulse else impulses(series, 0.0, np.zeros((0, 3)))
    solver = (segment.iterations, segment.error_indicator, float(segment.converged), n)
    return rows_of(series, running, motion, solver, segment.energy, n + 1)


def _recording(
    problem: SolverReadyProblem, places: Places
) -> tuple[SolverReadyProblem, dict[str, NDArray[np.int64]] | None]:
    """Sensors need fields at every instant: those of their nodes, or all (None) where the scene wants fields."""
    if not places:
        return problem, None
    nodes = None if problem.wanted.fields else nodes_of(places)
    return replace(problem, wanted=replace(problem.wanted, fields=True, every=1, nodes=nodes)), nodes


def _as_asked(segment: Segment, scene: Scene) -> Segment:
    """What only the sensors needed is dropped: the fields, or those of instants the scene leaves out."""
    if not scene.sensor:
        return segment
    keep = slice(None, None, scene.output.every)
    asked = {}
    for name, history in segment.substructures.items():
        if scene.output.keeps_fields:
            asked[name] = replace(
                history,
                time=history.time[keep],
                displacement=_cut(history.displacement, keep),
                velocity=_cut(history.velocity, keep),
                stress=_cut(history.stress, keep),
            )
        elif history.stress is not None or history.energy is not None:
            asked[name] = replace(
                history,
                time=history.time[keep] if history.stress is not None else np.zeros(0),
                displacement=None,
                velocity=None,
                stress=_cut(history.stress, keep),
            )
    return replace(segment, substructures=asked)


def _cut(field: Array | None, keep: slice) -> Array | None:
    return None if field is None else field[keep]
