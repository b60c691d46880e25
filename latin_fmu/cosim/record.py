"""Records the time steps that the engine makes: histories of interfaces, bodies, sensors, reactions and energies.

The engine calls before and after each call of the kernels (``engine.Engine``); what is kept is read from the image, as
a run does. Prescribed displacements and loads of the bodies, which histories need, are those of the rows of the image.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from ..kernels import entries
from ..kernels.inputs import DISPLACEMENT
from ..latin.outcome import Array
from ..latin.recorder import Recorder
from ..latin.status import WindowList, stored_energy
from .communication import CommunicationRun
from .segments import Segment, unpacked_motions

_PATH: Final = 4
"""Rule of interpolation of prescribed mode, as in runtime/runtime.h."""


class Record:
    """What the kernels have made, as segments.

    Parameters
    ----------
    run : whose image the engine marches.

    Attributes
    ----------
    segments : of the communication step that is made, or was made last.
    """

    def __init__(self, run: CommunicationRun, rule: int) -> None:
        self._run, self._rule, self.segments = run, rule, list[Segment]()
        self._first, self._steps, self._before = -1, 0, np.zeros(0)

    def begin(self) -> None:
        """Forget what was recorded: a communication step begins."""
        self.segments, self._first = [], -1

    def about_to(self, steps: int, whole: int) -> None:
        """Before a call of the kernels, after so many time ``steps``; ``whole`` : those of the communication step."""
        image = self._run.image
        if steps == 0:  # the state at t = 0 follows from the inputs
            image.call(entries.PRESENT, self._rule, whole)
        if steps <= self._first:  # once more, up to a contact event
            self.segments = []
        if not self.segments:
            self._first = steps
        self._steps, self._before = steps, image.state.copy()

    def have_made(self, n: int) -> None:
        """After a call of the kernels that made n time steps."""
        if n < 1:
            return
        image, march = self._run.image, self._run.run
        drives = image.field("drive", image.rows, int(image.run_fields["n_drive"]))[: n + 1]
        n_x, n_s = int(image.run_fields["n_motion_state"]), int(image.run_fields["n_source"])
        # of each time step amplitudes at both ends: the first ones are those at the start of the step
        amplitudes = np.concatenate([drives[1:2, n_x : n_x + n_s], drives[1:, n_x + n_s : n_x + 2 * n_s]])
        start = drives[0, :n_x].copy()
        after = image.state.copy()
        image.state[:] = self._before
        recorder = self._opened(start, amplitudes, self._steps)
        image.state[:] = after
        march.windows = WindowList()
        self._keep(recorder, 1, n)
        self.segments.append(self._segment(recorder))

    def _opened(self, start: Array, amplitudes: Array, steps: int) -> Recorder:
        """A recorder of the time steps with these amplitudes (n + 1, n_source), from a motion state, after so many
        ``steps``; it has kept the state in the image as its first instant."""
        run, image = self._run, self._run.image
        assembly, problem = run.problem.assembly, run.problem
        motions, ground = unpacked_motions(assembly, start)
        for c, (propagator, motion) in enumerate(zip(assembly.propagators, motions, strict=True)):
            propagator.resume(image, c, motion)
        time = run.drives.dt * np.arange(steps, steps + float(len(amplitudes)))
        problem.timeline.begin(assembly, time, run.sources.named(amplitudes), ground, run.drives.dt)
        recorder = Recorder(assembly, problem.output, problem.info)
        image.set({"first_row": 0})
        image.call(entries.START, 0)
        recorder.keep(assembly, image, run.run.probes, 1)
        return recorder

    def _keep(self, recorder: Recorder, first: int, n: int) -> None:
        """Keep n instants from ``first`` on, rows of the image from 1 on, and their iterations."""
        march = self._run.run
        march.recorder = recorder
        march.keep_marched(first, n, 1)

    def _segment(self, recorder: Recorder) -> Segment:
        run = self._run
        assembly = run.problem.assembly
        energy = recorder.assembly_energy(assembly)
        stored = None
        if energy is not None:
            stored = float(stored_energy(energy)[0])
        converged, sentence = run.run.status(energy, stored)
        histories = recorder.sensors(assembly), recorder.reactions(assembly), recorder.bolt_histories()
        time, windows = assembly.time[: recorder.n_kept], run.run.windows
        return Segment(time, windows, converged, True, sentence, energy, *histories, recorder)


class WholeRecord(Record):
    """The whole interval of prescribed mode as one segment."""

    def __init__(self, run: CommunicationRun) -> None:
        super().__init__(run, _PATH)
        self._recorder: Recorder | None = None

    def open(self, amplitudes: Array) -> None:
        """Before the first time step.

        amplitudes : (n_time, n_input) over the instants of the scene, of displacements their rates over the steps that
            begin there.
        """
        image = self._run.image
        laws = self._run.sources.table
        n = len(amplitudes)
        if len(laws) >= n:
            rows = laws[:n]
        else:
            rows = np.broadcast_to(laws[-1], (n, laws.shape[1]))
        image.call(entries.PRESENT, _PATH, 1)
        drives = image.field("drive", image.rows, int(image.run_fields["n_drive"]))
        start = drives[0, : int(image.run_fields["n_motion_state"])].copy()
        self._run.run.windows, self.segments = WindowList(), []
        self._recorder = self._opened(start, np.concatenate([amplitudes, rows], axis=1), 0)

    def about_to(self, steps: int, _whole: int) -> None:
        """As for ``Record``."""
        self._steps = steps

    def have_made(self, n: int) -> None:
        """As for ``Record``."""
        if n < 1:
            return
        assert self._recorder is not None
        self._keep(self._recorder, self._steps + 1, n)

    def segment(self) -> Segment | None:
        """What was recorded; None before anything was."""
        if self._recorder is None:
            return None
        if not self.segments:
            self.segments = [self._segment(self._recorder)]
        return self.segments[0]


def amplitudes_of(run: CommunicationRun, first: Array, histories: Mapping[int, tuple[Array, Array]], n: int) -> Array:
    """Amplitudes (n + 1, n_input) of the inputs of prescribed mode at its instants: histories by number of the input,
    linear between their points, else the values of ``first`` (n_input, 2); of displacements the rates over the steps
    that begin there, the last one as before."""
    dt, columns = run.drives.dt, [np.zeros((n + 1, 0))]
    instants = dt * np.arange(n + 1.0)
    for i, kind in enumerate(run.sources.kinds):
        if i in histories:
            column = np.interp(instants, *histories[i])
        else:
            column = np.full(n + 1, first[i, 0])
        if kind == DISPLACEMENT:
            rates = np.diff(column) / dt
            column = np.append(rates, rates[-1])
        columns.append(column[:, None])
    return np.concatenate(columns, axis=1)
