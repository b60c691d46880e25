"""Prescribed mode: the whole interval solved from given histories, then played back."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..errors import SolverError
from ..latin.record import Array, InterfaceHistory
from ..scene.schema import Scene
from ..scene.segments import Segment, SegmentedRun
from .history_file import Histories
from .reading import impulses, rows_of, series_of
from .sensors import motion_of, places_of

ROUND_OFF = 1e-9  # of a time step: an instant this close is that instant


class Prescribed:
    """The solution over [0, T] and its playback.

    Attributes
    ----------
    segment : the whole interval. time : its instants (n + 1,), s. rows : scalar outputs (n + 1, n_output).
    """

    def __init__(
        self, scene: Scene, tolerance: float | None, histories: Histories, start: Mapping[str, float]
    ) -> None:
        """Solve. ``histories``: times and amplitudes of loads; ``start``: amplitude of those without a history.

        Raises
        ------
        SolverError : the solution did not converge.
        """
        self.run = SegmentedRun(_with_sensor_fields(scene), tolerance)
        n = scene.time.n_step
        instants = np.linspace(0.0, scene.time.end, n + 1)
        loads = {name: np.full(n + 1, value) for name, value in start.items()}
        loads |= {name: np.interp(instants, times, values) for name, (times, values) in histories.items()}
        with np.errstate(all="ignore"):
            self.segment = self.run.advance(scene.time.end, n, loads)
        if not self.segment.converged:
            raise SolverError(self.segment.status)
        self.time = self.segment.time
        self.rows = self._rows(self.segment, n)
        self._series = series_of(self.segment.interfaces)

    def _rows(self, segment: Segment, n: int) -> Array:
        series = series_of(segment.interfaces)
        impulse = [history.impulse(segment.time) for history in segment.interfaces.values()]
        running = np.stack(impulse, axis=1) if impulse else impulses(series, 0.0, np.zeros((0, 3)))
        motion = motion_of(places_of(self.run.scene, self.run.built.info), segment.substructures)
        solver = (segment.iterations, segment.error_indicator, float(segment.converged), n)
        return rows_of(series, running, motion, solver, segment.energy, n + 1)

    @property
    def interfaces(self) -> dict[str, InterfaceHistory]:
        """Histories over the whole interval."""
        return self.segment.interfaces

    def row_at(self, time: float) -> Array:
        """Scalar outputs at a time within the interval: those of an instant, linear between two instants."""
        dt = self.time[1] - self.time[0]
        place = time / dt
        near = round(place)
        if abs(place - near) <= ROUND_OFF * max(1.0, abs(place)):
            row: Array = self.rows[min(max(near, 0), len(self.rows) - 1)].copy()
            return row
        i = int(np.clip(np.floor(place), 0, len(self.rows) - 2))
        share = place - i
        mixed: Array = (1.0 - share) * self.rows[i] + share * self.rows[i + 1]
        return mixed

    def instant_at(self, time: float) -> int:
        """Index of the last instant that is not after a time."""
        place = time / (self.time[1] - self.time[0])
        return int(np.clip(np.floor(place + ROUND_OFF * max(1.0, abs(place))), 0, len(self.rows) - 1))


def _with_sensor_fields(scene: Scene) -> Scene:
    """Sensors are read from the fields, which are then kept at every instant."""
    if not scene.sensor:
        return scene
    output = scene.output.model_copy(update={"fields": True, "every": 1})
    return scene.model_copy(update={"output": output})
