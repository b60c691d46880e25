"""Rows of outputs over segments that Python marches: the kernels follow them from instant to instant.

What a row follows from (tractions, velocities, gaps, sensors, energies) is in the output of the image after each
march; the drives of its instants are written beside it (``Drives.rows``). ``kernels.communication.conclude`` then makes
the row from these and from the row before, and ``present`` the one before the first.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any
from weakref import proxy

import numpy as np

from ..assembly.segments import Segment, SegmentedRun
from ..assembly.supports import moved_face_forces
from ..kernels import entries
from ..latin.assembly import Assembly
from ..latin.outcome import Array
from ..latin.probes import OutputRequest, Probes
from ..latin.recorder import Recorder, SubstructureInfo
from ..machine import one_thread
from ..propagator.image import Image
from ..scene.schema import Scene
from .drives import Drives, Sources, history_fields
from .output_table import first_of_events, places_of
from .signals import Signals


class OutputRows:
    """Outputs of a run of segments.

    Parameters
    ----------
    scene, run : what is solved; what is made of it afterwards holds the numbers that outputs follow from.

    Attributes
    ----------
    sources : what drives the run. places : of outputs, by name; n : their number. of_event, of_solver : place of those
    of the events, and of the solver. start : time that instants are counted with, s.
    """

    def __init__(self, scene: Scene, run: SegmentedRun) -> None:
        self.sources, self._scene, self.start = Sources.of(scene), scene, 0.0
        self._run: SegmentedRun = proxy(run)  # which calls this: no circle
        self.places = places_of(scene)
        self.n, self.of_event = len(self.places), first_of_events(self.places)
        self.of_solver = self.places["solver.iterations"]
        self._moved: list[int] = []  # forces of moved faces that no instant gives alone
        # accelerations and tractions of an explicit scheme are means over two time steps
        if run.problem.assembly.scheme.explicit:
            moved = tuple(f"port.{name}." for name, port in scene.port.items() if port.causality == "motion_in")
            self._moved = [i for name, i in self.places.items() if name.startswith(moved)]
        self._of: Any = None  # problem that the fields are of
        self._made: dict[str, Any] = {}
        run.communication = self._fields

    def _fields(self) -> dict[str, Any]:
        """Fields of the record of the run, for its present problem."""
        problem = self._run.problem
        if self._of is not problem:
            with one_thread():
                self._drives = Drives(self._run, self.sources)
                recorder = Recorder(problem.assembly, problem.output, problem.info, len(problem.assembly.time))
                self._made = Signals(self._scene, self._drives, recorder).fields() | history_fields(self._drives)
            self._of = problem
        return self._made

    def recorder(self, given: Mapping[str, Array], every: bool = False) -> Callable[..., OutputRecorder]:
        """What makes the recorder of a segment, for ``SegmentedRun.advance``.

        given : what drives the inputs, (n_time,) by name. every : keep the rows of all instants.
        """

        def made(assembly: Assembly, request: OutputRequest, info: dict[str, SubstructureInfo]) -> OutputRecorder:
            own = self.sources.own(self._scene, assembly.time)
            amplitudes = np.column_stack([*(given[name] for name in self.sources.inputs), own])
            drives, made = self._drives.rows(amplitudes), self._run.made
            opens = self.start if self._run.run is None else None
            return OutputRecorder(assembly, request, info, drives, made, opens, every)

        return made

    def complete(self, rows: Array, segment: Segment) -> None:
        """Write what no instant gives alone into the last outputs (n_row, n_output) of a segment."""
        numbers = segment.iterations, segment.error_indicator, float(segment.converged), len(segment.time) - 1
        rows[:, self.of_solver : self.of_solver + len(numbers)] = numbers
        if self._moved:
            forces = moved_face_forces(self._scene, self._run.problem.assembly, segment.recorder)
            rows[:, self._moved] = forces[-len(rows) :]

    def at_end(self, segment: Segment) -> Array:
        """Outputs (n_output,) at the end of a segment that was just made, a copy."""
        present = self.present
        self.complete(present[None], segment)
        return present.copy()

    @property
    def incomplete(self) -> frozenset[str]:
        """Names of the outputs that no instant gives alone."""
        names = list(self.places)
        return frozenset(names[i] for i in self._moved)

    @property
    def present(self) -> Array:
        """Outputs in the present state, a view."""
        assert self._run.run is not None
        return self._run.run.image.field("present", self.n)


class OutputRecorder(Recorder):
    """Keeps the accepted fields of a segment, and has the kernels follow its outputs.

    Parameters
    ----------
    drives : (n_time, n_drive). made : time steps before the segment. opens : time of its
    start, s, where it begins a simulation, else None. every : keep the rows of all instants.

    Attributes
    ----------
    outputs : outputs at the instants kept so far (n, n_output), with ``every``.
    """

    rows_before = 1

    def __init__(
        self,
        assembly: Assembly,
        request: OutputRequest,
        info: dict[str, SubstructureInfo],
        drives: Array,
        made: int,
        opens: float | None,
        every: bool,
    ) -> None:
        super().__init__(assembly, request, info)
        self._drives, self._opens, self._made = drives, opens, made
        self._every, self._rows = every, list[Array]()

    @property
    def outputs(self) -> Array:
        """Outputs at the instants kept so far, (n, n_output); none unless ``every``."""
        return np.concatenate(self._rows)

    def keep(self, assembly: Assembly, image: Image, probes: Probes | None, n: int, row: int = 0) -> None:
        """Keep the next n instants, and their outputs."""
        first = self.n_kept
        super().keep(assembly, image, probes, n, row)
        drives = image.field("drive", image.rows, self._drives.shape[1])
        drives[row : row + n] = self._drives[first : first + n]
        progress, made = image.field("progress", 9), self._made + max(first - 1, 0)
        progress[0] = made
        if first == 0:
            state = image.field("motion_state", int(image.run_fields["n_motion_state"]))
            # the first row of the drives begins with the motion state
            state[:] = self._drives[0, : len(state)]
            if self._opens is not None:
                progress[6] = self._opens
        for i in range(n if first else 0):
            image.call(entries.CONCLUDE, row + i, made + i)
        image.call(entries.PRESENT, 0, 0, 2 if first == 0 and self._opens is not None else 1)
        if self._every:
            n_output = int(image.run_fields["n_output"])
            self._rows.append(image.field("output", image.rows, n_output)[row : row + n].copy())
