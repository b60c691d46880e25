"""A run: successive windows over [0, T], state between windows, fall-backs.

A window starts from the state of the substructures, the gaps read from their displacements, and the last interface
tractions and velocities as first guess. One window over the whole interval is the method as published; windows of one
instant (the default) need the fewest iterations over all instants.

Many windows of one instant are solved in one call (``kernels.instants``). The Python driver takes windows one by one:
longer ones, those that are observed, and those in which the iteration stalls (``solver``). The loop is the same.
"""

from __future__ import annotations

import time as clock
from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from ..interface.laws import bonds
from ..kernels import entries
from .assembly import Array, Assembly
from .instant_solve import PerfectInterfaceSolve, pays
from .outcome import Timings
from .part import Part
from .recorder import Recorder
from .run_image import rules
from .run_state import ONE, SAMPLED
from .settings import SolverSettings
from .solver import MOST_REFUSALS, Observer, Progress, StopError, WindowFields, WindowRun

_PASS = 0.1  # of the tolerances, for the pass over the instants of a window that its iteration starts from
INTERRUPTED = "interrupted"
_FIRST = 16  # instants of the first call, whose time sets the number of those of the next calls
_SECONDS = 0.2  # aimed at per call: progress is shown and interruptions are handled between calls
_RESTORED = ("windows", "interface_indicator", "stopped", "_sequence", "_observer", "_progress")  # after a first guess


class WindowMonitor(Protocol):
    """Checks a run between its windows, and may stop it."""

    def instants(self, run: Run) -> int:
        """Instants, at least 1, that may be solved until the next ``check``."""

    def check(self, run: Run) -> bool:
        """Called between two windows; whether the run has to stop."""

    def stops(self) -> bool:
        """Whether the run has to stop, inside a long window too."""


@dataclass(frozen=True)
class RunControl:
    """Who watches a run, what it begins from, and how long it may take.

    Attributes
    ----------
    observer : called after each iteration. progress : called after each iteration with window counts.
    monitor : checks the run between windows. fields : first guesses of windows of several instants, in the place of
        those of ``settings.sequential_start``; it is given the converged fields.
    max_cpu : CPU time that the run may take, its set-up (``timings.setup``) included, s; None for no limit. Of a run on
        several processes, each of them: all stop before the same instant, when the first one has reached it.
    """

    observer: Observer | None = None
    progress: Progress | None = None
    monitor: WindowMonitor | None = None
    fields: WindowFields | None = None
    max_cpu: float | None = None


class Run(WindowRun):
    """A run of an assembly; ``all`` solves the windows of the present segment, ``advance`` one of them.

    Parameters
    ----------
    assembly, settings, recorder, timings, communication, part : as for ``RunState``. control : see ``RunControl``.

    Attributes
    ----------
    interrupted : why the run was stopped before its end, by ``monitor`` or by ``max_cpu``; empty where it was not.
    """

    def __init__(
        self,
        assembly: Assembly,
        settings: SolverSettings,
        recorder: Recorder,
        timings: Timings,
        control: RunControl = RunControl(),
        communication: Mapping[str, Any] | None = None,
        part: Part | None = None,
    ) -> None:
        self._observer, self._progress = control.observer, control.progress
        self._monitor = control.monitor
        self._fields = control.fields
        self._max_cpu = control.max_cpu
        self.interrupted = ""
        # CPU time of the set-up is spent already
        if self._max_cpu is None:
            self._cpu_end = np.inf
        else:
            self._cpu_end = clock.process_time() - timings.setup + self._max_cpu
        super().__init__(assembly, settings, recorder, timings, communication, part)

    def stops(self) -> str:
        """Why the run has to stop before its end; empty where it may go on."""
        if self._monitor is not None and self._monitor.stops():
            return INTERRUPTED
        return self._out_of_time()

    def _out_of_time(self) -> str:
        over = self._max_cpu is not None and self._least(self._cpu_end - clock.process_time()) <= 0.0
        if over:
            return f"stopped by its limit of {self._max_cpu:g} s of CPU time"
        return ""

    def _least(self, value: float) -> float:
        """The smallest over the processes of the run, all of which call this."""
        if self.part is None:
            return value
        processes = self.part.processes
        return float(processes.gather(np.array([float(value)]), range(processes.size + 1)).min())

    def status(self, energy: Mapping[str, Array] | None = None, stored: float | None = None) -> tuple[bool, str]:
        """Whether the run is complete and every window converged, and a sentence on it; ``energy`` and
        ``stored`` as for ``status.with_energy``."""
        converged, sentence = super().status(energy, stored)
        if not self.interrupted:
            return converged, sentence
        instant, end = self.assembly.instant, self.assembly.n_instant
        time = self.assembly.time[instant]
        return False, f"{self.interrupted} at t = {time:.6g} s (instant {instant} of {end}), until then {sentence}"

    @property
    def ended(self) -> bool:
        """Whether there is nothing left to solve in this segment."""
        return self.stopped or self.assembly.instant == self.assembly.n_instant

    # -- windows ------------------------------------------------------------------------------------------------
    def all(self, monitor: WindowMonitor | None = None) -> None:
        """Solve every window of the segment; stops after one whose best iterate is far from a solution (HOPELESS).

        monitor : of this segment, in the place of the one that the run was made with.
        """
        default, self._monitor = self._monitor, self._monitor if monitor is None else monitor
        try:
            self.open_bonds()
            if self.assembly.lost is None:
                total = self.assembly.n_instant
            else:
                total = self.assembly.lost.instant - 1
            # the image has room for so many instants
            length = min(self.settings.window or total, self.image.window)
            self._use(length)
            self._solve(total, length)
        finally:
            self._monitor = default

    def open_bonds(self) -> None:
        """Solve perfect interfaces directly from here on, where there are no others."""
        perfect = not self.assembly.quasi_static and all(bonds(u.behaviour) for u in self.assembly.interfaces)
        if perfect and not self._direct_bonds and self.settings.direct_bonds and pays(self.assembly):
            self._solve_bonds_directly()

    def _solve(self, total: int, length: int) -> None:
        """Solve the instants up to ``total`` in windows of ``length``."""
        count, number = -(-total // length), len(self.windows)
        # an observer is called from Python
        compiled = length == 1 and self._observer is None and self.marches
        while number < count and not self.stopped and not self._looked():
            refusals, self._refused = self.refusals, self._keeps_failing()
            if compiled and not self._refused:
                done = self._march(count - number)
            else:
                done = 0
            number += done
            if done and self._progress is not None:
                last = self.windows[-1]
                self._progress(number - 1, count, last.iterations, last.final_error)
            # an instant that the kernels have left
            if number < count and (not compiled or self._refused):
                self._advance_or_return(min(length, total - number * length), number, count, refusals)
                number += 1
        self._looked()

    def _advance_or_return(self, n: int, number: int, count: int, refusals: int) -> None:
        """``advance``, or the state before where the run is stopped inside; ``refusals``: before the compiled driver
        refused the window."""
        begun, backup = self.assembly.instant, self.image.state.copy()
        try:
            self.advance(n, number, count)
        except StopError:
            self.image.state[:] = backup
            self._set_instant(begun)
            self.refusals = refusals  # a run that is continued begins with the compiled driver

    def _looked(self) -> bool:
        """Whether the run has to stop here."""
        if self._sequence is not None:
            if self.stops():
                raise StopError
            return False
        if self._monitor is None:
            stop = bool(self.stops()) and not self.ended
        else:
            stop = self._monitor.check(self)
        # a reason found inside a window stays (``_one_by_one``)
        if stop or not self.stopped:
            if stop:
                self.interrupted = self.stops() or INTERRUPTED
            else:
                self.interrupted = ""
        return stop

    @property
    def marches(self) -> bool:
        """Whether windows of one instant are solved by calls of the kernels, but for those that need a fall-back."""
        return self._bonds is None

    def _solve_bonds_directly(self) -> None:
        """Start every instant with the solution of its perfect interfaces, one linear solve; there are no others."""
        bonds, direction = PerfectInterfaceSolve(self.assembly), self.direction(1)
        operator = None
        if self.part is None:
            operator = bonds.incoming(direction.k)
        self._direct_bonds = True
        # the operator acts on velocities without any traction
        fields = {**direction.run_fields(), "from_last": 0, "referenced": 0}
        if operator is None:
            self._bonds = bonds
        else:
            fields |= {"direct_bonds": 1, "bonds": operator}
        self.image.bind(ONE, fields, direction.group_fields(), afresh=True)

    # -- the compiled driver --------------------------------------------------------------------------------------
    def _march(self, n: int) -> int:
        """Solve up to n windows of one instant in one call; how many converged, fewer where one needs a fall-back."""
        image, first = self.image, self.assembly.instant + 1
        wall, cpu = clock.perf_counter(), clock.process_time()
        # after a few refusals all instants take the exact operator
        self._use(1, exact=self.refusals > MOST_REFUSALS)
        if self._max_cpu is None:
            longest = _FIRST
        else:
            longest = 1
        if self._per_instant > 0:
            longest = max(1, int(_SECONDS / self._per_instant))
        rows = image.rows
        n = min(n, rows, longest, rows if self._sequence is not None else self._until(first))
        if self._max_cpu is not None:
            n = int(self._least(n))  # calls of one length, as the limit is looked at between them
        self._set_first_row(first)
        with self._team.at_work():
            done = image.call(entries.MARCH, first, n)
        if done:
            self.keep_marched(first, done)
        self._refused, self.refusals = done < n, self.refusals + (done < n)
        self._count(cpu)
        self._per_instant = (clock.perf_counter() - wall) / max(done, 1)
        return done

    def keep_marched(self, first: int, n: int, row: int = 0) -> None:
        """Record n instants from ``first`` on that a call of the kernels solved: rows of its output from ``row`` on."""
        image, most = self.image, self.settings.max_iterations
        self._set_instant(first + n - 1)
        self._sample()
        self._record(n, row)
        errors, residuals = (image.field(name, n, most) for name in ("errors", "force_residuals"))
        counts = np.stack([image.counts(name, n) for name in ("iterations", "newton_steps", "corrections")], axis=1)
        self.windows.keep(first, counts, errors, residuals, image.field("defects", n))
        self._read_indicator()

    @property
    def several(self) -> bool:
        """Whether several threads march it."""
        return self._team.several

    def at_work(self) -> AbstractContextManager[None]:
        """Context of calls of the kernels by another caller, which the threads of the run share."""
        return self._team.at_work()

    def _until(self, first: int) -> int:
        """Instants from ``first`` on that may be solved before something is kept or looked at."""
        until = min(self.recorder.until_fields(), SAMPLED - (first - 1) % SAMPLED)
        if self._monitor is None:
            return until
        return min(until, self._monitor.instants(self))

    # -- first guesses and fall-backs of windows --------------------------------------------------------------------
    def _sequential_guess(self, n: int) -> Array | None:
        """First guess q (n, n_flat) from windows of one instant, to a tenth of the tolerances; restores the state. None
        where one of them fails.

        The tangent of a window is block lower triangular in time, so that a pass over its instants, each with Newton
        steps, is Newton's method for the window; one iteration of the window certifies it.
        """
        image, begun = self.image, self.assembly.instant
        backup, state = image.state.copy(), {name: getattr(self, name) for name in _RESTORED}
        spent = self.timings.march
        self._clear()
        self._observer = self._progress = None
        sequence: list[tuple[Array, Array]] = []
        self._sequence = sequence
        try:
            self._use(1)
            tolerance, force = self.settings.tolerance, self.settings.force_tolerance
            image.set(rules(replace(self.settings, tolerance=_PASS * tolerance, force_tolerance=_PASS * force)))
            self._solve(n, 1)
            failed = self.stopped
            self.timings.march = spent  # counted by the window
        # attributes of the run as they were
        finally:
            vars(self).update(state)
            image.state[:] = backup
            image.set(rules(self.settings))
            self._set_instant(begun)
        if failed:
            return None
        f_hat, w_hat = (np.concatenate(fields) for fields in zip(*sequence, strict=True))
        return self.direction(n).incoming(f_hat, w_hat)
