"""Windowed mode: a communication step is one segment of the run, the state is carried on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ..errors import SolverError
from ..latin.record import Array, InterfaceHistory, Timings
from ..latin.recorder import Recorder
from ..latin.windows import Run
from ..scene.schema import Scene
from ..scene.segments import Segment, SegmentedRun
from .reading import impulses, rows_of, series_of
from .sensors import motion_now, places_of


class Windowed:
    """A run advanced by communication steps.

    Attributes
    ----------
    row : scalar outputs now, (n_output,). time : instants of the last step, (n + 1,), s, counted from the start.
    interfaces : histories over these instants. segment : the last step, None before the first.
    """

    def __init__(self, scene: Scene, tolerance: float | None) -> None:
        self.run = SegmentedRun(scene, tolerance)
        self._places = places_of(scene, self.run.built.info)
        self._start: tuple[Array, Array, dict[str, InterfaceHistory]] | None = None
        self._impulse = np.zeros((len(scene.interface), 3))
        self.row = np.zeros(0)
        self.time = np.zeros(1)
        self.interfaces: dict[str, InterfaceHistory] = {}
        self.segment: Segment | None = None

    def start(self, amplitudes: Mapping[str, float]) -> None:
        """Outputs at t = 0, with the loads set from outside at their start."""
        built = self.run.built
        assembly = built.assembly
        given = {name: np.full(len(assembly.time), value) for name, value in amplitudes.items()}
        built.timeline.begin(assembly, assembly.time, given, assembly.ground_start)
        recorder = Recorder(assembly, built.wanted, built.info)
        Run(assembly, built.settings, recorder, Timings())
        self.interfaces = recorder.interfaces(assembly)
        self.time, self.segment = np.zeros(1), None
        self._impulse = np.zeros_like(self._impulse)
        motion = motion_now(self._places, self.run.displacement, self.run.velocity)
        series = series_of(self.interfaces)
        energy = recorder.assembly_energy(assembly)
        rows = rows_of(series, self._impulse[None], motion, (0.0, 0.0, 1.0, 0.0), energy, 1)
        self.row = rows[0]
        self.run.reset()

    def advance(self, end: float, n: int, loads: Mapping[str, Array]) -> Segment:
        """Solve n time steps up to ``end``, s; nothing changes where the segment is not accepted.

        Raises
        ------
        SolverError : the solver cannot continue; nothing has changed.
        """
        before = self.run.snapshot()
        try:
            with np.errstate(all="ignore"):  # what overflows ends as "not converged"
                segment = self.run.advance(end, n, loads)
        except (ArithmeticError, ValueError, RuntimeError, np.linalg.LinAlgError) as error:
            self.run.restore(before)
            raise SolverError(f"the solver cannot make this step: {error}") from error
        if segment.accepted:
            self._read(segment)
        return segment

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

    def tree(self) -> dict[str, Any]:
        """All that determines the next steps and the outputs now."""
        return {
            "run": np.frombuffer(self.run.snapshot(), dtype=np.uint8),
            "impulse": self._impulse,
            "row": self.row,
            "time": self.time,
            "fields": {name: _fields(history) for name, history in self.interfaces.items()},
        }

    def resume(self, tree: Mapping[str, Any]) -> None:
        """Back to a tree. Raises InputError where the run in it is of another scene."""
        if not self.interfaces:
            self.start({})  # gives the geometry of the interfaces
        self.run.restore(tree["run"].tobytes())
        self._impulse, self.row, self.time = tree["impulse"], tree["row"], tree["time"]
        known = self.interfaces
        self.interfaces = {name: replace(known[name], **f) for name, f in tree["fields"].items()}
        self.segment = None


_FIELDS = ("traction", "velocity", "gap", "contact_status", "friction_power", "layer_energy", "joint_power")


def _fields(history: InterfaceHistory) -> dict[str, Any]:
    return {key: getattr(history, key) for key in _FIELDS}
