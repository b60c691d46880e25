"""Windowed mode: a communication step is one segment of the run, the state is carried on."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ..assembly.segments import Segment, SegmentedRun
from ..blas_threads import one_thread
from ..errors import SolverError
from ..latin.record import Array, InterfaceHistory, Timings
from ..latin.recorder import Recorder
from ..latin.windows import Run
from ..scene.schema import Scene
from .loads import Loads
from .reading import impulses, rows_of, series_of
from .sensors import motion_now, places_of
from .settings import Settings
from .step_report import SHORTEST, StepReport, refused

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
