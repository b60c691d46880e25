"""What follows where the iteration of a window does not converge, and who looks at its iterates.

The loop is ``kernels.iteration.iterate``. A stalled acceleration is followed by relaxation 1/2 from the best iterate,
and in windows of one instant by a solution point by point. A window that does not converge returns its best iterate,
which need not be the last.

Newton steps (``kernels.newton``) take part in the iteration of windows of one instant; a fall-back ends them.

Softened start, without inertia, where a gap is large: one iteration moves a body that is not held yet by the load over
k. Where that is a small part of the gap, many iterations are needed, and the differences of their residuals are useless
to the acceleration. With a search direction soft enough to close the gap at once, k = load / gap, the strains of the
bodies are negligible: a few iterations of the same loop give the faces in contact. Their tractions and velocities are
the first guess of the loop with the regular k.
"""

from __future__ import annotations

import time as clock
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from ..kernels import entries
from ..kernels.instants import CORRECTED, GUESS, OPENINGS, WITHIN
from ..kernels.iteration import BEST, BROKEN, CONVERGED, PATIENCE
from ..propagator.image import Image
from .assembly import Array
from .outcome import WindowRecord
from .run_image import RELAXATION as _RELAXATION
from .run_image import Iterate, Stages, rules
from .run_state import RunState
from .search_direction import Direction
from .settings import SolverSettings
from .sliding_start import sliding_start, suits
from .status import BALANCED

RELAXED, POINT_BY_POINT = "relaxation 1/2", "point by point"
SOFTENED = "softened start"
FROM_REST = "start from rest"
SLIDING = "Newton's method on all relative motions"
COLD = "default first guess"  # where that of other runs does not converge
_AFTER_POINTS = 20  # iterations after the solution point by point


@dataclass(frozen=True)
class IterationEvent:
    """Argument of an observer after each iteration (fields of the instants of the window).

    ``f_hat``, ``w_hat`` : (n, n_flat) local-stage tractions and velocities. ``trial`` marches the linear stage
    of this iterate, calling its argument at each instant.
    """

    window: int
    iteration: int
    error_indicator: float
    force_mismatch: float
    f_hat: Array
    w_hat: Array
    trial: Callable[[Callable[[int], None]], None]


Observer = Callable[[IterationEvent], None]


class WindowSolver:
    """Iterates one window from the present state of the propagators.

    Parameters
    ----------
    observer : called after each iteration. progress : called with iteration and indicator after each iteration.
    trial : marches the linear stage of the last iterate and restores the state after it (``Run._trial``).
    fallbacks : whether they are tried.
    """

    def __init__(
        self,
        settings: SolverSettings,
        observer: Observer | None = None,
        progress: Callable[[int, float], None] | None = None,
        trial: Callable[[Stages, Callable[[int], None]], None] | None = None,
        fallbacks: bool = True,
    ) -> None:
        self._fallbacks = fallbacks
        self._settings = settings
        self._observer = observer
        self._progress = progress
        self._trial = trial

    def solve_by_tables(self, stages: Stages, record: WindowRecord, number: int) -> bool:
        """Solve one instant as ``kernels.instants.march_instants`` does where tables of Y are taken; whether they end
        it."""
        begin = 0
        verdict = CORRECTED
        image = stages.image
        while verdict == CORRECTED:
            self.solve(stages, record, number, begin)
            if not record.converged or record.fallbacks:
                break
            image.counts("corrections", 1)[0] = record.corrections
            verdict, begin = image.call(entries.CORRECT, stages.first), record.iterations
            record.corrections = int(image.counts("corrections", 1)[0])
            record.defect = float(image.field("defects", 1)[0])
            record.converged = verdict == WITHIN
            # corrections are iterations, too
            if begin >= self._settings.max_iterations:
                break
        return record.converged

    def solve(self, stages: Stages, record: WindowRecord, number: int, begin: int = 0) -> Iterate:
        """Iterate from the q of the image, with ``begin`` iterations made before in this window under another
        reference; fills ``record`` and returns the accepted (else the best) iterate, which is the last one of the image
        then."""
        settings = self._settings
        used = list[str]()
        iterates = list[Iterate]()
        bits = 0

        def look(_: int, verdict: int, __: int) -> None:
            nonlocal bits
            bits, measures = verdict, stages.measures()
            record.error_indicator.append(float(measures[0]))
            record.force_mismatch.append(float(measures[1]))
            # the first one, too: a best iterate must exist where all are NaN
            if verdict & (BEST | CONVERGED) or not iterates:
                iterates[:], record.accepted = [Iterate.last(stages)], record.iterations - 1
            record.newton_steps = stages.newton_steps()
            self._report(number, record, stages)

        limit = settings.max_iterations
        phase = begin
        start = begin
        try:
            while True:
                stages.accelerate(settings, relaxed=used[-1:] == [RELAXED], again=bool(used))
                count = stages.iterations((begin, start, phase, limit), look)
                best, record.converged, start = iterates[0], count > 0, abs(count)
                ended = record.converged or bits & BROKEN
                fallback = None
                if not ended:
                    fallback = self._fallback(stages, used, start >= limit)
                if fallback is None:
                    break
                used.append(fallback)
                stages.leave_newton()
                record.fallbacks.append(fallback)
                # differences and stalls count from here on
                phase = start
                if fallback == RELAXED:
                    best.put(stages)
                    # relaxation goes on from the best iterate, whose residual is among its fields
                    stages.field("q")[...] += _RELAXATION * stages.field("r")
                else:
                    limit = start + _AFTER_POINTS
                    stages.points_one_by_one(best.f_hat[0])
        finally:
            stages.accelerate(settings)
        # the last iterate need not be the best one
        if not record.converged:
            best.put(stages)
        return best

    def _fallback(self, stages: Stages, used: list[str], exhausted: bool) -> str | None:
        """The next fall-back, None when there is none left."""
        if not self._fallbacks:
            return None
        static = self._settings.quasi_static
        enough = self._settings.max_iterations >= PATIENCE  # fewer: a study of the iteration, not of its solution
        if RELAXED not in used and not exhausted:
            return RELAXED
        # without inertia a floating body has no admittance, which the solution point by point needs; large interfaces
        # have no matrix of theirs
        usable = enough and stages.n == 1 and not static and not stages.direction.assembly.swept
        if usable and POINT_BY_POINT not in used:
            return POINT_BY_POINT
        return None

    def _report(self, number: int, record: WindowRecord, stages: Stages) -> None:
        """Call the receivers of progress and of iterates."""
        error = record.error_indicator[-1]
        if self._progress is not None:
            self._progress(record.iterations, error)
        if self._observer is None:
            return
        f_hat, w_hat = stages.field("local_f").copy(), stages.field("local_w").copy()

        def trial(after: Callable[[int], None]) -> None:
            assert self._trial is not None
            self._trial(stages, after)

        self._observer(IterationEvent(number, record.iterations, error, record.force_mismatch[-1], f_hat, w_hat, trial))


_FAR = 0.3  # share of the largest gap that the load closes in one iteration, below which the start is softened
_SOFT_TOLERANCE, _SOFT_ITERATIONS = 1e-2, 12
_SOFT = -1  # key of the soft search direction in the image


def softening(direction: Direction, gap: float) -> float | None:
    """Factor on k with which the loads close the largest gap at once; None where k does."""
    assembly = direction.whole.assembly
    if gap <= 0.0 or assembly.characteristic_traction <= 0.0:
        return None
    # way that the load makes a free side go in an iteration, over the gap
    crossed = assembly.characteristic_traction / float(direction.whole.k.max()) * assembly.dt / gap
    if crossed < _FAR:
        return crossed
    return None


def softened_start(
    settings: SolverSettings, image: Image, stages: Stages, gap: float, make: Callable[[SolverSettings], Direction]
) -> Array | None:
    """First guess q (n_flat,) of an increment without inertia by a short iteration with a soft search direction, which
    stays bound to propagators and image; None where the loads close the gaps without it.

    gap : the largest one, m. make : the search direction for one instant by settings.
    """
    direction = stages.direction
    factor = softening(direction, gap)
    if factor is None:
        return None
    search = replace(settings.search_direction, factor=factor * settings.search_direction.factor)
    rough = replace(
        settings,
        search_direction=search,
        tolerance=max(_SOFT_TOLERANCE, settings.tolerance),
        # the indicator alone decides: a first guess is wanted
        force_tolerance=np.inf,
        max_iterations=_SOFT_ITERATIONS,
        newton=False,
    )
    soft = make(rough)
    soft.bind()
    image.bind(_SOFT, soft.run_fields(), soft.group_fields(), afresh=True)
    image.set(rules(rough))
    window = stages.of(soft)
    window.begin()
    window.field("q")[...] = 0.0
    iterate = WindowSolver(rough).solve(window, WindowRecord(stages.first, stages.first), 0)
    # the record has the rules of the short iteration still
    image.set(rules(settings))
    return direction.incoming(iterate.f_hat[0], iterate.w_hat[0])


# -- a window of a run -------------------------------------------------------------------------------------------------
MOST_REFUSALS = 3
"""Instants that need a fall-back, after which all others take the exact operator."""
# Stop the run if a window ends with sqrt(eta) above this value.
HOPELESS = 0.5
# After so many windows in a row that no fall-back has brought to converge, an instant takes so many iterations at most
# and no fall-back, but for one in so many: an instant that does not converge costs at most fifty that do, in the mean.
_FAILURES = 2
_AGAIN = 24
_ONCE_IN = 32

Progress = Callable[[int, int, int, float], None]
"""Windows done, windows, iteration, indicator."""


class WindowFields(Protocol):
    """Interface fields of windows of several instants, of this run and of runs with other parameters."""

    def first_guess(self, first: int, n: int, n_flat: int) -> tuple[Array, Array] | None:
        """Tractions and velocities (n, n_flat) to start the window of ``n`` instants from ``first`` with; None where
        there are none."""

    def keep(self, first: int, f_hat: Array, w_hat: Array) -> None:
        """Keep the converged fields (n, n_flat) of the window that starts with instant ``first``."""


class StopError(Exception):
    """Raised inside a long window that is given up."""


class WindowRun(RunState, ABC):
    """A run as the Python driver takes one window of it, with its first guesses and fall-backs.

    Attributes
    ----------
    interrupted : why the run was stopped before its end; empty where it was not.
    """

    interrupted: str
    _observer: Observer | None
    _progress: Progress | None
    _fields: WindowFields | None

    @abstractmethod
    def stops(self) -> str:
        """Why the run has to stop before its end; empty where it may go on."""

    @abstractmethod
    def _out_of_time(self) -> str:
        """Why the run has to stop before its next instant; empty where it may go on."""

    @abstractmethod
    def _sequential_guess(self, n: int) -> Array | None:
        """First guess q (n, n_flat) from windows of one instant; None where one of them fails."""

    def _keeps_failing(self) -> bool:
        """Whether the last windows have not converged in spite of all fall-backs, which are not repeated then but for
        some instants."""
        # once in so many instants all fall-backs are tried again
        enough = len(self.windows) >= _FAILURES and (self.assembly.instant + 1) % _ONCE_IN != 0
        return enough and not any(self.windows[-1 - i].converged for i in range(_FAILURES))

    @property
    def _single(self) -> bool:
        """Whether windows of one instant are all that is solved, and no part of a longer one."""
        return self.settings.window == 1 and self._sequence is None

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
        warm = guess is not None
        if not warm:
            guess = self._own_guess(n)
        # not where the kernels have refused this instant
        by_tables = n == 1 and self.part is None and not self._refused
        by_tables &= self.refusals <= MOST_REFUSALS
        self._use(n, exact=not by_tables)
        stages = self.stages(n, first)

        def report(iteration: int, error: float) -> None:
            if (n > 1 and self.stops()) or (self._single and self._out_of_time()):
                raise StopError
            if self._progress is not None:
                self._progress(number, count, iteration, error)

        again = n == 1 and self._keeps_failing()
        most = min(self.settings.max_iterations, _AGAIN if again else self.settings.max_iterations)
        solver = WindowSolver(
            replace(self.settings, max_iterations=most), self._observer, report, self._trial, fallbacks=not again
        )
        self._begin_window(stages, guess)
        if by_tables and stages.direction.sparse and not solver.solve_by_tables(stages, record, number):
            # the record of what was refused is dropped
            self.refusals, record = self.refusals + 1, WindowRecord(first, first)
            self._use(n, exact=True)
            self._begin_window(stages, guess)
        if not record.converged:
            solver.solve(stages, record, number)
        # the given fields were no help: once more from the state itself
        if warm and not record.converged:
            self.image.call(entries.LEAVE)
            record.fallbacks.append(COLD)
            guess = self._own_guess(n)
            self._use(n, exact=True)
            self._begin_window(stages, guess)
            solver.solve(stages, record, number)
        self._begin_anew(solver, stages, record, number)
        # the state at the start of the window comes back
        if not record.converged and n > 1:
            self.image.call(entries.LEAVE)
            self._count(before)
            return self._one_by_one(record, n, number, count)
        # NaN included; without inertia nothing can follow a state that is no equilibrium
        self.stopped = not record.converged and (self.assembly.quasi_static or not record.final_error <= HOPELESS)
        if self.stopped:
            self.image.call(entries.LEAVE)
        else:
            self._end_window(stages, record)
        self.windows.append(record)
        self._count(before)
        return record

    def _begin_window(self, stages: Stages, guess: Array | None = None) -> None:
        """State at the start, free responses of one instant, first guess of q where none is given."""
        stages.begin(GUESS if stages.n == 1 else OPENINGS)
        if stages.n == 1:
            if self._bonds is not None:
                guess = stages.bonded(self._bonds)
        elif guess is None:
            guess = stages.direction.incoming(self.f_hat, self.w_hat)
        if guess is not None:
            stages.field("q")[...] = guess

    def _end_window(self, stages: Stages, record: WindowRecord) -> None:
        """Move the substructures to the end of the window and record its fields."""
        image = self.image
        n = stages.n
        first = stages.first
        scales = image.field("scales", 3).copy()
        image.call(entries.LEAVE, n)
        if not record.converged:
            image.field("scales", 3)[:] = scales  # a failed iterate must not loosen the windows that follow
        # the velocities of bodies that closed a large gap are no guess for the next increment
        image.field("carry", 1)[0] = float(SOFTENED not in record.fallbacks)
        # a long window leaves the substructures at its end: back to its start, to march it with the accepted fields
        if n > 1:
            record.disagreement = stages.disagreement()
            if self._fields is not None and record.converged:
                self._fields.keep(first, stages.field("local_f").copy(), stages.field("local_w").copy())
        self._set_first_row(first)
        before = self._drift_work()
        self._march_accepted(stages, self._record_instant)
        if n > 1 and not self.assembly.quasi_static:
            put_in = self._put_in()
            if put_in > 0.0:
                record.imbalance = abs(self._drift_work() - before) / put_in
            else:
                record.imbalance = 0.0
            record.converged &= record.imbalance <= BALANCED
        self._sample()
        self._read_indicator()

    def _march_accepted(self, stages: Stages, after: Callable[[int], None]) -> None:
        """March the window with the accepted iterate; ``after(i)`` is called at its instants."""
        image = self.image
        n = stages.n
        first = stages.first
        for i in range(n):
            image.call(entries.END, first + i, i, n)
            stages.ended()
            self._set_instant(first + i)
            after(i)

    def _trial(self, stages: Stages, after: Callable[[int], None]) -> None:
        """March the linear stage of the last iterate, and restore the state before it."""
        image = self.image
        # the whole block: work of the iteration is needed again, too
        backup = image.moving.copy()
        begun = self.assembly.instant
        row = int(image.run[0]["first_row"])
        # one instant leaves the state at its start; a long window has marched it to its end
        if stages.n > 1:
            image.call(entries.LEAVE)
        self._set_first_row(stages.first)
        self._march_accepted(stages, after)
        image.moving[:] = backup
        image.set({"first_row": row})
        self._set_instant(begun)

    def _march_free(self, first: int, n: int, record: WindowRecord) -> None:
        """March an assembly without any interface."""
        image = self.image
        for instant in range(first, first + n):
            self._set_first_row(instant)
            image.call(entries.BEGIN, 1, instant, OPENINGS)
            image.call(entries.END, instant, 0, 1)
            self._set_instant(instant)
            self._sample()
            self._record_instant(0)
        record.error_indicator = [0.0]
        record.force_mismatch = [0.0]
        record.converged = True
        self.windows.append(record)

    def _begin_anew(self, solver: WindowSolver, stages: Stages, record: WindowRecord, number: int) -> None:
        """Begin a window without inertia once more, in the ways that there are, until its iteration converges."""
        if not self.assembly.quasi_static:
            return
        ways = [self._restart]
        if stages.n == 1 and suits(stages):
            ways = [self._slide, self._restart]
        for begin in ways:
            if not record.converged:
                begin(stages, record)
                solver.solve(stages, record, number)

    def _slide(self, stages: Stages, record: WindowRecord) -> None:
        """Begin the window once more with what Newton's method on all relative motions finds, where it finds it."""
        record.fallbacks.append(SLIDING)
        self._use(1)
        q = sliding_start(stages, self.f_hat, self.settings.tolerance)
        self._begin_window(stages)
        if q is not None:
            stages.field("q")[...] = q

    def _restart(self, stages: Stages, record: WindowRecord) -> None:
        """Begin the window once more: with a softened start, or from rest where the loads close the gaps without it."""
        gap = stages.largest(max((float(g.max(initial=0.0)) for g in self.gaps()), default=0.0))
        q = softened_start(self.settings, self.image, stages, gap, lambda settings: self.made_direction(settings, 1))
        record.fallbacks.append(FROM_REST if q is None else SOFTENED)
        self._use(1)
        self._begin_window(stages)
        # q = F_hat: velocities of zero
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
        # a failed window before any error
        worst = max(parts, key=lambda p: (not p.converged, p.final_error))
        record.error_indicator.append(worst.final_error)
        record.force_mismatch.append(worst.final_mismatch)
        record.accepted = record.iterations - 1
        self.windows.append(record)
        return record

    def _given_guess(self, first: int, n: int) -> Array | None:
        """First guess q (n, n_flat) from the fields of other runs; None where there are none."""
        if self._fields is None or n == 1:
            return None
        fields = self._fields.first_guess(first, n, self.image.n_flat)
        if fields is None:
            return None
        return self.direction(n).incoming(*fields)

    def _own_guess(self, n: int) -> Array | None:
        """First guess q (n, n_flat) by the settings of the run; None for the one of ``_begin_window``."""
        if n > 1 and self.settings.sequential_start:
            return self._sequential_guess(n)
        return None
