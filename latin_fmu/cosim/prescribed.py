"""Prescribed mode of a session: solves the interval from given histories at initialization, then plays it back."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..assembly.segments import Segment, SegmentedRun
from ..errors import SolverError
from ..latin.outcome import Array, InterfaceHistory
from ..latin.state_serialization import check_numbers, encode
from ..scene.schema import Scene
from .loads import Loads
from .output_rows import OutputRecorder, OutputRows
from .output_table import first_of_events, places_of
from .outputs import between, first_event, shifted
from .settings import Settings, StepReport, refused
from .variable import variable_of

ROUND_OFF = 1e-9  # of a time step: times closer than this are one instant


class Prescribed:
    """The solution over [0, T] and its playback.

    Attributes
    ----------
    run : the solver. segment : the whole interval. row : scalar outputs at the present time, (n_output,).
    time : instants (n + 1,), s, counted from the start; none before ``start``.
    """

    def __init__(self, scene: Scene, settings: Settings) -> None:
        self._scene, self._tolerance = scene, settings.tolerance
        places = places_of(scene)
        self._n_output, self._inner_time, self._first_event = len(places), places["innerTime"], first_of_events(places)
        self._solved_for = ""
        self.run: SegmentedRun | None = None
        self.segment: Segment | None = None
        self.row = np.zeros(0)
        self._table = np.zeros((0, 0))  # rows of all instants

    def start(self, loads: Loads, t0: float) -> None:
        """Solve the interval and take the outputs of its first instant, at ``t0``, s.

        Raises
        ------
        SolverError : the solution did not converge.
        """
        self._solve(loads)
        self.row = shifted(self._row_at(0.0), self._inner_time, self._first_event, t0)

    def _solve(self, loads: Loads) -> None:
        """Solve for these loads, histories or constants, unless the present solution is theirs."""
        histories = {name: list(pair) for name, pair in loads.histories.items()}
        key = hashlib.sha256(encode({"value": loads.initial_values(), "history": histories}, "histories")).hexdigest()
        if key == self._solved_for:
            return
        # a solution that fails is none, even if the loads are requested again
        self._solved_for = ""
        try:
            run = SegmentedRun(self._scene, self._tolerance)
            end, n = self._scene.time.end, self._scene.time.n_step
            given, outputs = loads.over(np.linspace(0.0, end, n + 1)), OutputRows(self._scene, run)
            with np.errstate(all="ignore"):
                segment = run.advance(end, n, given, recorder=outputs.recorder(given, every=True))
        except (ArithmeticError, ValueError, RuntimeError, np.linalg.LinAlgError) as error:
            raise SolverError(f"the solver cannot continue: {error}") from error
        if not segment.converged:
            raise SolverError(segment.status)
        assert isinstance(segment.recorder, OutputRecorder)
        self._table = segment.recorder.outputs
        outputs.complete(self._table, segment)
        self.run, self.segment, self._solved_for = run, segment, key

    def step(self, loads: Loads, t: float, h: float, t0: float, early: bool = False) -> StepReport:
        """Play back from t to t + h, s; ``t0`` is the start of the simulation.

        early : up to the first instant after a contact event.
        """
        if changed := loads.changed():
            return refused(
                f"{variable_of(changed)} was changed after initialization, which has no effect in prescribed mode: "
                "give a history before initialization, or use mode 0 (windowed)",
                again=True,
            )
        assert self.segment is not None
        end = float(self.time[-1])
        if t + h - t0 > end * (1.0 + ROUND_OFF):
            return refused(f"the interval solved ends at {t0 + end:g} s: set endTime before initialization", again=True)
        stop, ended = t + h - t0, None
        if early:
            first = self.instant(t - t0)
            event = first_event(self._table[first : self.instant(stop) + 1, self._first_event :])
            # not at the end of the step itself: it ends there anyway
            if event is not None and self.time[first + event] < stop - ROUND_OFF * h:
                stop = float(self.time[first + event])
                ended = t0 + stop
        self.row = shifted(self._row_at(stop), self._inner_time, self._first_event, t0)
        n, iterations, indicator = len(self.time) - 1, self.segment.iterations, self.segment.error_indicator
        return StepReport(True, "", n, iterations, indicator, early=ended)

    @property
    def time(self) -> Array:
        """Instants of the solution, s; none before ``start``."""
        return np.zeros(0) if self.segment is None else self.segment.time

    @property
    def n_instant(self) -> int:
        """Number of instants of the solution."""
        return len(self.time)

    @property
    def interfaces(self) -> dict[str, InterfaceHistory]:
        """Interface histories over the whole interval."""
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
        k = self._first_event
        # counts and instants of events are not interpolated
        mixed[k:] = between(self._table[i, k:], self._table[i + 1, k:], time)
        return mixed

    def _place(self, time: float) -> float:
        return time / float(self.time[1] - self.time[0])

    def instant(self, time: float) -> int:
        """Index in ``time`` of the last instant that is not after a time since the start, s."""
        place = self._place(time)
        # a time within round-off of an instant is there
        return int(np.clip(np.floor(place + ROUND_OFF * max(1.0, abs(place))), 0, len(self._table) - 1))

    def reset(self) -> None:
        """Return to before ``start``; the solution is kept."""

    def get_state(self) -> dict[str, Any]:
        """The present outputs; the solution follows from the loads."""
        return {"row": self.row}

    def set_state(self, state: Mapping[str, Any], loads: Loads, check: bool = False) -> None:
        """Restore a state; solves where these loads are not solved yet.

        Raises
        ------
        SolverError : no convergence. InputError : with ``check``, outputs that do not fit.
        """
        if check:
            check_numbers(state["row"], "state.row", np.zeros(self._n_output))
        self._solve(loads)
        self.row = state["row"]
