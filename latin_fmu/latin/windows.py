"""A run: successive windows over [0, T], state between windows, fall-backs.

A window starts from the state of the substructures, the gaps read from their displacements, and the last interface
tractions and velocities as first guess. One window over the whole interval is the method as published; windows of one
instant (the default) need the fewest iterations over all instants.

Many windows of one instant are solved in one call (``kernels.instants``). The Python driver takes windows one by one:
longer ones, those that are observed, and those in which the iteration stalls (``solver``). The loop is the same.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from ..interface.laws import bonds
from ..kernels import entries
from ..propagator.image import take_marched
from .assembly import Array, Assembly
from .instant_solve import PerfectInterfaceSolve, pays
from .outcome import Timings, WindowRecord
from .part import Part
from .recorder import Recorder
from .run_image import Stages, rules
from .run_state import ONE, SAMPLED, RunState
from .settings import Settings
from .solver import COLD, FROM_REST, SOFTENED, Observer, WindowSolver, softened_start
from .status import BALANCED

_MOST_REFUSALS = 3  # instants that need a fall-back, after which all others take the exact operator
_PASS = 0.1  # of the tolerances, for the pass over the instants of a window that its iteration starts from
# Stop the run if a window ends with sqrt(eta) above this value.
HOPELESS = 0.5
# After so many windows in a row that no fall-back has brought to converge, an instant takes so many iterations at most
# and no fall-back, but for one in so many: an instant that does not converge costs at most fifty that do, in the mean.
_FAILURES, _AGAIN, _ONCE_IN = 2, 24, 32
INTERRUPTED = "interrupted"
_FIRST = 16  # instants of the first call, whose time sets the number of those of the next calls
_SECONDS = 0.2  # aimed at per call: progress is shown and interruptions are handled between calls
_RESTORED = ("windows", "interface_indicator", "stopped", "_sequence", "_observer", "_progress")  # after a first guess

Progress = Callable[[int, int, int, float], None]  # windows done, windows, iteration, indicator


class WindowMonitor(Protocol):
    """Checks a run between its windows, and may stop it."""

    def instants(self, run: Run) -> int:
        """Instants, at least 1, that may be solved until the next ``check``."""

    def check(self, run: Run) -> bool:
        """Called between two windows; whether the run has to stop."""

    def stops(self) -> bool:
        """Whether the run has to stop, inside a long window too."""


class WindowFields(Protocol):
    """Interface fields of windows of several instants, of this run and of runs with other parameters."""

    def first_guess(self, first: int, n: int, n_flat: int) -> tuple[Array, Array] | None:
        """Tractions and velocities (n, n_flat) to start the window of ``n`` instants from ``first`` with; None where
        there are none."""

    def keep(self, first: int, f_hat: Array, w_hat: Array) -> None:
        """Keep the converged fields (n, n_flat) of the window that starts with instant ``first``."""


class _StopError(Exception):
    """Raised inside a long window that is given up."""


class Run(RunState):
    """A run of an assembly; ``all`` solves the windows of the present segment, ``advance`` one of them.

    Parameters
    ----------
    assembly, settings, recorder, timings, communication, part : as for ``RunState``.
    observer : called after each iteration. progress : called after each iteration with window counts.
    monitor : checks the run between windows. fields : first guesses of windows of several instants, in the place of
        those of ``settings.sequential_start``; it is given the converged fields.
    max_cpu : CPU time that the run may take, its set-up (``timings.setup``) included, s; None for no limit. Of a run on
        several processes, each of them: all stop before the same instant, when the first one has reached it.

    Attributes
    ----------
    interrupted : why the run was stopped before its end, by ``monitor`` or by ``max_cpu``; empty where it was not.
    """

    def __init__(
        self,
        assembly: Assembly,
        settings: Settings,
        recorder: Recorder,
        timings: Timings,
        observer: Observer | None = None,
        progress: Progress | None = None,
        monitor: WindowMonitor | None = None,
        fields: WindowFields | None = None,
        communication: Mapping[str, Any] | None = None,
        part: Part | None = None,
        max_cpu: float | None = None,
    ) -> None:
        self._observer, self._progress, self._monitor, self._fields = observer, progress, monitor, fields
        self.interrupted, self._max_cpu = "", max_cpu
        self._cpu_end = np.inf if max_cpu is None else clock.process_time() - timings.setup + max_cpu
        super().__init__(assembly, settings, recorder, timings, communication, part)

    def status(self, energy: Mapping[str, Array] | None = None, stored: float | None = None) -> tuple[bool, str]:
        """Whether the run is complete and every window converged, and a sentence on it; ``energy`` and
        ``stored`` as for ``status.with_energy``."""
        converged, sentence = super().status(energy, stored)
        if not self.interrupted:
            return converged, sentence
        instant, end = self.assembly.instant, self.assembly.n_instant
        time = self.assembly.time[instant]
        return False, f"{self.interrupted} at t = {time:.6g} s (instant {instant} of {end}), until then {sentence}"

    def stops(self) -> str:
        """Why the run has to stop before its end; empty where it may go on."""
        if self._monitor is not None and self._monitor.stops():
            return INTERRUPTED
        return self._out_of_time()

    def _out_of_time(self) -> str:
        over = self._max_cpu is not None and self._least(self._cpu_end - clock.process_time()) <= 0.0
        return f"stopped by its limit of {self._max_cpu:g} s of CPU time" if over else ""

    def _least(self, value: float) -> float:
        """The smallest over the processes of the run, all of which call this."""
        if self.part is None:
            return value
        processes = self.part.processes
        return float(processes.gather(np.array([float(value)]), range(processes.size + 1)).min())

    @property
    def ended(self) -> bool:
        """Whether there is nothing left to solve in this segment."""
        return self.stopped or self.assembly.instant == self.assembly.n_instant

    # -- windows ------------------------------------------------------------------------------------------------
    def all(self, monitor: WindowMonitor | None = None) -> None:
        """Solve every window of the segment; stops after one whose best iterate is far from a solution (HOPELESS).

        monitor : of this segment, in the place of the one that the run was made with.
        """
        own, self._monitor = self._monitor, self._monitor if monitor is None else monitor
        try:
            self._all()
        finally:
            self._monitor = own

    def _all(self) -> None:
        self.open_bonds()
        total = self.assembly.n_instant if self.assembly.lost is None else self.assembly.lost.instant - 1
        length = self.settings.window or total
        self._use(length)
        self._solve(total, length)

    def open_bonds(self) -> None:
        """Solve perfect interfaces directly from here on, where there are no others."""
        perfect = not self.assembly.quasi_static and all(bonds(u.behaviour) for u in self.assembly.interfaces)
        if perfect and not self._direct_bonds and self.settings.direct_bonds and pays(self.assembly):
            self._solve_bonds_directly()

    def _solve(self, total: int, length: int) -> None:
        """Solve the instants up to ``total`` in windows of ``length``."""
        count, number = -(-total // length), len(self.windows)
        compiled = length == 1 and self._observer is None and self._bonds is None
        while number < count and not self.stopped and not self._looked():
            refusals, self._refused = self.refusals, self._keeps_failing()
            done = self._march(count - number) if compiled and not self._refused else 0
            number += done
            if done and self._progress is not None:
                last = self.windows[-1]
                self._progress(number - 1, count, last.iterations, last.final_error)
            if number < count and (not compiled or self._refused):
                self._advance_or_return(min(length, total - number * length), number, count, refusals)
                number += 1
        self._looked()

    def _advance_or_return(self, n: int, number: int, count: int, refusals: int) -> None:
        """``advance``, or the state before where the run is stopped inside; ``refusals``: before the compiled driver
        refused the window."""
        begun, kept = self.assembly.instant, self.image.state.copy()
        try:
            self.advance(n, number, count)
        except _StopError:
            self.image.state[:] = kept
            self._set_instant(begun)
            self.refusals = refusals  # a run that is continued begins with the compiled driver

    def _keeps_failing(self) -> bool:
        """Whether the last windows have not converged in spite of all fall-backs, which are not repeated then but for
        some instants."""
        enough = len(self.windows) >= _FAILURES and (self.assembly.instant + 1) % _ONCE_IN != 0
        return enough and not any(self.windows[-1 - i].converged for i in range(_FAILURES))

    def _looked(self) -> bool:
        """Whether the run has to stop here."""
        if self._sequence is not None:
            if self.stops():
                raise _StopError
            return False
        stop = bool(self.stops()) and not self.ended if self._monitor is None else self._monitor.check(self)
        if stop or not self.stopped:
            self.interrupted = (self.stops() or INTERRUPTED) if stop else ""
        return stop

    @property
    def _single(self) -> bool:
        """Whether windows of one instant are all that is solved, and no part of a longer one."""
        return self.settings.window == 1 and self._sequence is None

    def compiles(self) -> bool:
        """Whether the kernels hold every factor and every law, and the bonds where those are solved directly."""
        return self._bonds is None and self._in_kernels

    @property
    def on_threads(self) -> bool:
        """Whether the substructures are distributed over threads."""
        return self._team.several

    def _solve_bonds_directly(self) -> None:
        """Start every instant with the solution of its perfect interfaces, one linear solve; there are no others."""
        bonds, direction = PerfectInterfaceSolve(self.assembly), self.direction(1)
        operator = None if self.part is not None else bonds.incoming(direction.k)
        self._direct_bonds = True
        fields = {**direction.run_fields(), "from_last": 0}
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
        self._use(1, exact=self.refusals > _MOST_REFUSALS)
        longest = _FIRST if self._max_cpu is None else 1
        if self._per_instant > 0:
            longest = max(1, int(_SECONDS / self._per_instant))
        rows = image.rows - self.recorder.rows_before
        n = min(n, rows, longest, rows if self._sequence is not None else self._until(first))
        if self._max_cpu is not None:
            n = int(self._least(n))  # calls of one length, as the limit is looked at between them
        self._set_first_row(first)
        done = self._march_instants(first, n)
        if done:
            self.keep_marched(first, done, self.recorder.rows_before)
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

    def _until(self, first: int) -> int:
        """Instants from ``first`` on that may be solved before something is kept or looked at."""
        until = min(self.recorder.until_fields(), SAMPLED - (first - 1) % SAMPLED)
        return until if self._monitor is None else min(until, self._monitor.instants(self))

    def _march_instants(self, first: int, n: int) -> int:
        """The same in one call of the kernels."""
        with self._team.at_work():
            return self.image.call(entries.MARCH, first, n)

    def _count(self, before: float) -> None:
        """Add the work, and the CPU time since ``before``, that of the process then."""
        marched, condensed = take_marched(self.image)
        self.marched += marched
        self.condensed += condensed
        self.timings.march += clock.process_time() - before

    # -- the Python driver ----------------------------------------------------------------------------------------
    def advance(self, n: int, number: int, count: int) -> WindowRecord:
        """Solve the next window of n instants, ``number`` of ``count``, with the Python driver."""
        with self._team.at_work():
            return self._advance(n, number, count)

    def _advance(self, n: int, number: int, count: int) -> WindowRecord:
        before, first = clock.process_time(), self.assembly.instant + 1
        record = WindowRecord(first, first + n - 1)
        if not self.assembly.interfaces:
            self._march_free(first, n, record)
            self._count(before)
            return record
        guess = self._given_guess(first, n)
        given = guess is not None
        if not given:
            guess = self._own_guess(n)
        # not where the kernels have refused this instant
        by_tables = n == 1 and self.part is None and not self._refused
        by_tables &= self.refusals <= _MOST_REFUSALS
        self._use(n, exact=not by_tables)
        stages = self.stages(n, first)

        def report(iteration: int, error: float) -> None:
            if (n > 1 and self.stops()) or (self._single and self._out_of_time()):
                raise _StopError
            if self._progress is not None:
                self._progress(number, count, iteration, error)

        again = n == 1 and self._keeps_failing()
        most = min(self.settings.max_iterations, _AGAIN if again else self.settings.max_iterations)
        solver = WindowSolver(
            replace(self.settings, max_iterations=most), self._observer, report, self._trial, fallbacks=not again
        )
        self._begin_window(stages, guess)
        if by_tables and stages.direction.sparse and not solver.solve_by_tables(stages, record, number):
            self.refusals, record = self.refusals + 1, WindowRecord(first, first)
            self._use(n, exact=True)
            self._begin_window(stages, guess)
        if not record.converged:
            solver.solve(stages, record, number)
        if given and not record.converged:
            self.image.call(entries.REWIND)
            record.fallbacks.append(COLD)
            guess = self._own_guess(n)
            self._use(n, exact=True)
            self._begin_window(stages, guess)
            solver.solve(stages, record, number)
        if self.assembly.quasi_static and not record.converged:
            self._restart(stages, record)
            solver.solve(stages, record, number)
        if not record.converged and n > 1:
            self.image.call(entries.REWIND)
            self._count(before)
            return self._one_by_one(record, n, number, count)
        # NaN included; without inertia nothing can follow a state that is no equilibrium
        self.stopped = not record.converged and (self.assembly.quasi_static or not record.final_error <= HOPELESS)
        if self.stopped:
            self.image.call(entries.REWIND)
        else:
            self._end_window(stages, record)
        self.windows.append(record)
        self._count(before)
        return record

    def _begin_window(self, stages: Stages, guess: Array | None = None) -> None:
        """State at the start, free responses of one instant, first guess of q where none is given."""
        image = self.image
        image.call(entries.BEGIN)
        stages.begin()
        if stages.n == 1:
            stages.predict()
            stages.first_guess()
            if self._bonds is not None:
                guess = stages.bonded(self._bonds)
        elif guess is None:
            guess = stages.direction.incoming(self.f_hat, self.w_hat)
        if guess is not None:
            stages.field("q")[...] = guess

    def _end_window(self, stages: Stages, record: WindowRecord) -> None:
        """Move the substructures to the end of the window and record its fields."""
        image, n, first = self.image, stages.n, stages.first
        scales = image.field("scales", 3).copy()
        image.call(entries.ACCEPT, n)
        if not record.converged:
            image.field("scales", 3)[:] = scales  # a failed iterate must not loosen the windows that follow
        # the velocities of bodies that closed a large gap are no guess for the next increment
        image.field("carry", 1)[0] = float(SOFTENED not in record.fallbacks)
        if n > 1:
            image.call(entries.REWIND)
            record.disagreement = stages.disagreement()
            if self._fields is not None and record.converged:
                self._fields.keep(first, stages.field("local_f").copy(), stages.field("local_w").copy())
        self._set_first_row(first)
        before = self._drift_work()
        self._march_accepted(stages, self._record_instant)
        if n > 1 and not self.assembly.quasi_static:
            put_in = self._put_in()
            record.imbalance = abs(self._drift_work() - before) / put_in if put_in > 0.0 else 0.0
            record.converged &= record.imbalance <= BALANCED
        self._sample()
        self._read_indicator()

    def _march_accepted(self, stages: Stages, after: Callable[[int], None]) -> None:
        """March the window with the accepted iterate; ``after(i)`` is called at its instants."""
        image, n, first = self.image, stages.n, stages.first
        for i in range(n):
            if n == 1:
                for c in range(len(image.propagators)):
                    image.call(entries.END_CLASS, c, first)
                stages.end_instant(first)
            else:
                image.call(entries.END_WINDOW, first + i, i)
            stages.ended()
            self._set_instant(first + i)
            after(i)

    def use_single_instants(self) -> None:
        """Bind the search direction of windows of one instant, without tables."""
        self._use(1, exact=True)

    def end_instant(self, stages: Stages) -> None:
        """Move the substructures over a window of one instant with the fields of its local stage, and record it."""
        self._set_first_row(stages.first)
        self._march_accepted(stages, self._record_instant)

    def _trial(self, stages: Stages, after: Callable[[int], None]) -> None:
        """March the linear stage of the last iterate, and restore the state before it."""
        image = self.image
        kept, begun, row = image.moving.copy(), self.assembly.instant, int(image.run[0]["first_row"])
        if stages.n > 1:
            image.call(entries.REWIND)
        self._set_first_row(stages.first)
        self._march_accepted(stages, after)
        image.moving[:] = kept
        image.set({"first_row": row})
        self._set_instant(begun)

    def _march_free(self, first: int, n: int, record: WindowRecord) -> None:
        """March an assembly without any interface."""
        image = self.image
        for instant in range(first, first + n):
            self._set_first_row(instant)
            for c in range(len(image.propagators)):
                image.call(entries.PREDICT, c, instant)
                image.call(entries.END_CLASS, c, instant)
            image.call(entries.END_INSTANT, instant)
            self._set_instant(instant)
            self._sample()
            self._record_instant(0)
        record.error_indicator, record.force_mismatch, record.converged = [0.0], [0.0], True
        self.windows.append(record)

    # -- first guesses and fall-backs of windows --------------------------------------------------------------------
    def _restart(self, stages: Stages, record: WindowRecord) -> None:
        """Begin the window once more: with a softened start, or from rest where the loads close the gaps without it."""
        gap = stages.largest(max((float(g.max(initial=0.0)) for g in self.gaps()), default=0.0))
        q = softened_start(self.settings, self.image, stages, gap, lambda settings: self.made_direction(settings, 1))
        record.fallbacks.append(FROM_REST if q is None else SOFTENED)
        self._use(1)
        self._begin_window(stages)
        stages.field("q")[...] = self.f_hat if q is None else q

    def _one_by_one(self, record: WindowRecord, n: int, number: int, count: int) -> WindowRecord:
        """Solve the window as windows of one instant."""
        record.fallbacks.append("windows of one instant")
        done = len(self.windows)
        for i in range(n):
            self.advance(1, number, count)
            if not self.stopped and i + 1 < n:
                self.interrupted = self._out_of_time()
                self.stopped = bool(self.interrupted)  # inside a window, from which no run can be continued
            if self.stopped:
                break
        parts = self.windows.cut(done)
        record.converged = len(parts) == n and all(p.converged for p in parts)
        worst = max(parts, key=lambda p: (not p.converged, p.final_error))
        record.error_indicator.append(worst.final_error)
        record.force_mismatch.append(worst.final_mismatch)
        record.accepted = record.iterations - 1
        self.windows.append(record)
        return record

    def _given_guess(self, first: int, n: int) -> Array | None:
        """First guess q (n, n_flat) from the fields of other runs; None where there are none."""
        fields = self._fields.first_guess(first, n, self.image.n_flat) if self._fields is not None and n > 1 else None
        return None if fields is None else self.direction(n).incoming(*fields)

    def _own_guess(self, n: int) -> Array | None:
        """First guess q (n, n_flat) by the settings of the run; None for the one of ``_begin_window``."""
        return self._sequential_guess(n) if n > 1 and self.settings.sequential_start else None

    def _sequential_guess(self, n: int) -> Array | None:
        """First guess q (n, n_flat) from windows of one instant, to a tenth of the tolerances; restores the state. None
        where one of them fails.

        The tangent of a window is block lower triangular in time, so that a pass over its instants, each with Newton
        steps, is Newton's method for the window; one iteration of the window certifies it.
        """
        image, begun = self.image, self.assembly.instant
        kept, state = image.state.copy(), {name: getattr(self, name) for name in _RESTORED}
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
        finally:
            vars(self).update(state)
            image.state[:] = kept
            image.set(rules(self.settings))
            self._set_instant(begun)
        if failed:
            return None
        f_hat, w_hat = (np.concatenate(fields) for fields in zip(*sequence, strict=True))
        return self.direction(n).incoming(f_hat, w_hat)
