"""A run: successive windows over [0, T] by two drivers on the same stages, state between windows, fall-backs.

A window starts from the state of the substructures, the gaps read from their displacements, and the last interface
tractions and velocities as first guess. One window over the whole interval is the method as published; windows of one
instant (the default) need the fewest iterations over all instants.

The compiled driver solves many windows of one instant in one call (``kernels.instants``); the Python driver takes the
stages one by one, for observers, longer windows, laws written in Python and windows in which the iteration stalls. Both
run the same functions in the same order on the same numbers.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping

import numpy as np

from ..kernels import entries
from .assembly import Array, Assembly
from .initial_conditions import initial_conditions
from .instant_solve import PerfectInterfaceSolve, all_perfect
from .probes import Probes
from .record import Timings, WindowRecord
from .recorder import Recorder
from .run_image import Stages, Threads, all_in_kernels, histories, make_image, negligible_scales
from .search_direction import Direction
from .settings import Settings
from .solver import FROM_REST, SOFTENED, Observer, WindowSolver, softened_start
from .status import WindowList, status

# Stop the run if a window ends with sqrt(eta) above this value.
HOPELESS = 0.3
_FIRST = 16  # instants of the first call, whose time sets the number of those of the next calls
_SECONDS = 0.2  # aimed at per call: progress is shown and interruptions are handled between calls
_ONE, _LONG = 1, 2  # keys of the search directions in the image: windows of one instant, longer ones
_RESTORED = ("windows", "interface_indicator", "stopped", "_sequence", "_observer", "_progress")  # after a first guess

Progress = Callable[[int, int, int, float], None]  # windows done, windows, iteration, indicator


class Run:
    """A run of an assembly; ``all`` solves the windows of the present segment, ``advance`` one of them.

    Parameters
    ----------
    assembly, settings : the problem and the rules of its solution. recorder : keeps the accepted fields.
    observer : called after each iteration. progress : called after each iteration with window counts.

    Attributes
    ----------
    windows : records of the windows of the segment. interface_indicator : (n_interface,) largest indicator of each.
    marched, condensed : substructure-instants marched, and solved through the condensed operator, since the start.
    stopped : whether a window ended so far from a solution that the run cannot continue.
    """

    def __init__(
        self,
        assembly: Assembly,
        settings: Settings,
        recorder: Recorder,
        timings: Timings,
        observer: Observer | None = None,
        progress: Progress | None = None,
    ) -> None:
        self.assembly, self.settings, self.recorder, self.timings = assembly, settings, recorder, timings
        self._observer, self._progress = observer, progress
        self.marched = self.condensed = 0
        self._clear()
        traction, velocity = initial_conditions(assembly)
        self._set_up(traction, velocity, None)
        self.image.call(entries.OPEN_ACCOUNTS)
        self._begin_recording()

    def _clear(self) -> None:
        """Forget the windows of the last segment."""
        self.windows = WindowList()
        self.interface_indicator: Array | None = None
        self.stopped = False
        self._sequence: list[tuple[Array, Array]] | None = None  # fields of a sequential first guess, not recorded

    # -- the image ----------------------------------------------------------------------------------------------
    def _set_up(self, traction: Array, velocity: Array, scales: Array | None) -> None:
        """Image and search directions for the present operators; ``scales``: largest norms met, None at the start."""
        assembly = self.assembly
        self._operators = [p.operators for p in assembly.propagators]
        self._directions: dict[int, Direction] = {}
        self._direct_bonds = False
        # where the perfect interfaces are too many, or redundant, for one matrix in the kernels
        self._bonds: PerfectInterfaceSolve | None = None
        one = self.direction(1)
        one.bind()
        self._probes = Probes(assembly, self.recorder.sliding, self.recorder.places)
        self.image = make_image(assembly, self.settings, one, self._probes)
        self.f_hat[:], self.w_hat[:] = traction, velocity
        self._use(1)
        self.image.field("scales", 3)[:] = negligible_scales(self.image, one) if scales is None else scales
        self._threads = Threads([float(r["n_panels"] * r["m"]) for r in self.image.classes], self.settings.threads)
        self._per_instant, self._refused = 0.0, False

    @property
    def f_hat(self) -> Array:
        """Tractions of the last accepted instant (n_flat,), a view, Pa."""
        return self.image.field("f_hat", self.image.n_flat)

    @property
    def w_hat(self) -> Array:
        """Velocities of the last accepted instant (n_flat,), a view, m s-1."""
        return self.image.field("w_hat", self.image.n_flat)

    def get_state(self) -> dict[str, Array]:
        """Copies of the fields that the next segment starts from, beside the states of the propagators."""
        n = self.image.n_flat
        sizes = {"f_hat": n, "w_hat": n, "scales": 3, "carry": 1}
        return {name: self.image.field(name, size).copy() for name, size in sizes.items()}

    def set_state(self, fields: Mapping[str, Array]) -> None:
        """Restore the fields of ``get_state``."""
        for name, values in fields.items():
            self.image.field(name, len(values))[:] = values

    def direction(self, n: int) -> Direction:
        """Search direction for windows of n instants (kept: one for n = 1, one for longer windows)."""
        key = min(n, _LONG)
        if key not in self._directions:
            self._directions[key] = Direction(self.assembly, self.settings, n)
        return self._directions[key]

    def _use(self, n: int) -> None:
        """Bind propagators and image to the search direction for windows of n instants."""
        direction = self.direction(n)
        direction.bind()
        self.image.bind(min(n, _LONG), direction.run_fields(), direction.group_fields())

    def begin_segment(self, recorder: Recorder) -> None:
        """Continue after the assembly has begun a new segment of time."""
        self.recorder = recorder
        self._clear()
        operators = [p.operators for p in self.assembly.propagators]
        if any(a is not b for a, b in zip(operators, self._operators, strict=True)):
            f_hat, w_hat = self.f_hat.copy(), self.w_hat.copy()
            self._set_up(f_hat, w_hat, self.image.field("scales", 3).copy())
        else:
            self.image.begin(len(self.assembly.time), histories(self.assembly))
        self.image.field("worst", len(self.assembly.interfaces))[:] = 0.0
        self._begin_recording()

    def _begin_recording(self) -> None:
        """Record the first instant of the segment."""
        self.image.set({"first_row": 0})
        self.image.call(entries.READ_START)
        self.recorder.keep(self.assembly, self.image, self._probes, 1)

    def _record(self, n: int, row: int = 0) -> None:
        """Record n accepted instants, rows of the image's output from ``row`` on."""
        if self._sequence is None:
            self.recorder.keep(self.assembly, self.image, self._probes, n, row)
        else:
            f_hat, w_hat = (
                self.image.field(name, self.image.rows, self.image.n_flat) for name in ("history_f", "history_w")
            )
            self._sequence.append((f_hat[row : row + n].copy(), w_hat[row : row + n].copy()))

    def choices(self) -> dict[str, str]:
        """Automatic choices, in words."""
        if self._direct_bonds:
            return {"bonds": "one linear solve per instant"}
        windows = {_ONE: "windows of one instant", _LONG: "longer windows"}
        return {f"search direction, {windows[key]}": d.choice for key, d in self._directions.items()}

    def gaps(self) -> list[Array]:
        """Gaps (n_point,) of each group at the present instant, m."""
        groups = self.assembly.layout.groups
        return [self.image.group_field(g, "gap", group.n_point).copy() for g, group in enumerate(groups)]

    def status(self) -> tuple[bool, str]:
        """Whether every window of the segment converged, and a sentence on it."""
        return status(self.assembly, self.settings, self.windows, self.interface_indicator)

    # -- windows ------------------------------------------------------------------------------------------------
    def all(self) -> None:
        """Solve every window of the segment; stops after one whose best iterate is far from a solution (HOPELESS)."""
        if not self._direct_bonds and self.settings.direct_bonds and all_perfect(self.assembly):
            self._solve_bonds_directly()
        total = self.assembly.n_instant
        length = self.settings.window or total
        self._use(length)
        self._solve(total, length)

    def _solve(self, total: int, length: int) -> None:
        """Solve the next ``total`` instants in windows of ``length``."""
        count, number = -(-total // length), 0
        compiled = length == 1 and self._observer is None and self._compiles()
        while number < count and not self.stopped:
            done = self._march(count - number) if compiled else 0
            number += done
            if done and self._progress is not None:
                last = self.windows[-1]
                self._progress(number - 1, count, last.iterations, last.final_error)
            if number < count and (not compiled or self._refused):
                self.advance(min(length, total - number * length), number, count)
                number += 1

    def _compiles(self) -> bool:
        """Whether the kernels hold every factor and every law, and the bonds where those are solved directly."""
        return self._bonds is None and all_in_kernels(self.image)

    def _solve_bonds_directly(self) -> None:
        """Start every instant with the solution of its perfect interfaces, one linear solve; there are no others."""
        bonds, direction = PerfectInterfaceSolve(self.assembly), self.direction(1)
        operator = bonds.incoming(direction.k)
        self._direct_bonds = True
        if operator is None:
            self._bonds = bonds
        else:
            fields = {**direction.run_fields(), "direct_bonds": 1, "bonds": operator}
            self.image.bind(_ONE, fields, direction.group_fields(), afresh=True)

    # -- the compiled driver --------------------------------------------------------------------------------------
    def _march(self, n: int) -> int:
        """Solve up to n windows of one instant in one call; how many converged (fewer: the next one needs a
        fall-back)."""
        image, before, first = self.image, clock.perf_counter(), self.assembly.instant + 1
        longest = max(1, int(_SECONDS / self._per_instant)) if self._per_instant > 0 else _FIRST
        n = min(n, image.rows, longest, image.rows if self._sequence is not None else self.recorder.until_fields())
        image.set({"first_row": first})
        done = self._march_together(first, n) if self._threads.several else image.call(entries.MARCH, first, n)
        if done:
            for propagator in self.assembly.propagators:
                propagator.instant = first + done - 1
                propagator.sample()
            self._record(done)
            most = self.settings.max_iterations
            errors, residuals = (image.field(name, done, most) for name in ("errors", "force_residuals"))
            self.windows.keep(first, image.counts("iterations", done), errors, residuals)
            self._read_indicator()
        self._refused = done < n
        self._count(before)
        self._per_instant = (clock.perf_counter() - before) / max(done, 1)
        return done

    def _march_together(self, first: int, n: int) -> int:
        """The same with the substructures on several threads; same functions, same order within a substructure."""
        image = self.image
        for call in range(n):
            instant = first + call
            self._threads.each(lambda c, at=instant: image.call(entries.PREDICT, c, at))  # type: ignore[misc]
            if not image.call(entries.SOLVE, instant, call):
                return call
            self._threads.each(lambda c, at=instant: image.call(entries.END_CLASS, c, at))  # type: ignore[misc]
            image.call(entries.END_INSTANT, instant)
        return n

    def _read_indicator(self) -> None:
        """Copy the largest indicators of the interfaces from the image."""
        if self.assembly.interfaces:
            self.interface_indicator = self.image.field("worst", len(self.assembly.interfaces)).copy()

    def _count(self, before: float) -> None:
        """Add the work and the time since ``before``."""
        marched, condensed = self.image.marched()
        self.marched += marched
        self.condensed += condensed
        self.timings.march += clock.perf_counter() - before

    # -- the Python driver ----------------------------------------------------------------------------------------
    def advance(self, n: int, number: int, count: int) -> WindowRecord:
        """Solve the next window of n instants, ``number`` of ``count``, with the Python driver."""
        before, first = clock.perf_counter(), self.assembly.instant + 1
        record = WindowRecord(first, first + n - 1)
        if not self.assembly.interfaces:
            self._march_free(first, n, record)
            self._count(before)
            return record
        guess = self._sequential_guess(n) if n > 1 and self.settings.sequential_start else None
        self._use(n)
        stages = Stages(self.image, self.direction(n), n, first)

        def report(iteration: int, error: float) -> None:
            if self._progress is not None:
                self._progress(number, count, iteration, error)

        solver = WindowSolver(self.settings, self._observer, report, self._trial)
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
        image.call(entries.OPEN, stages.n, stages.first - 1)
        if stages.n == 1:
            for c in range(len(image.propagators)):
                image.predict(c, stages.first)
            image.call(entries.FIRST_GUESS, stages.first)
            if self._bonds is not None:
                image.call(entries.FREE_MOTION, stages.first)
                guess = self._bonds.guess(image.field("w", image.n_flat).copy(), stages.direction.k)
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
        image.set({"first_row": first})
        self._march_accepted(stages, lambda i: self._record(1, i))
        for propagator in self.assembly.propagators:
            propagator.sample()
        self._read_indicator()

    def _march_accepted(self, stages: Stages, after: Callable[[int], None]) -> None:
        """March the window with the accepted iterate; ``after(i)`` is called at its instants."""
        image, n, first = self.image, stages.n, stages.first
        for i in range(n):
            if n == 1:
                for c in range(len(image.propagators)):
                    image.end(c, first)
                image.call(entries.END_INSTANT, first)
            elif image.factored:
                image.call(entries.END_WINDOW, first + i, i)
            else:
                image.end_window_instant(first + i, i)
            self._set_instant(first + i)
            after(i)

    def _set_instant(self, instant: int) -> None:
        for propagator in self.assembly.propagators:
            propagator.instant = instant

    def _trial(self, stages: Stages, after: Callable[[int], None]) -> None:
        """March the linear stage of the last iterate, and restore the state before it."""
        image = self.image
        kept, begun, row = image.moving.copy(), self.assembly.instant, int(image.run[0]["first_row"])
        if stages.n > 1:
            image.call(entries.REWIND)
        image.set({"first_row": stages.first})
        self._march_accepted(stages, after)
        image.moving[:] = kept
        image.set({"first_row": row})
        self._set_instant(begun)

    def _march_free(self, first: int, n: int, record: WindowRecord) -> None:
        """March an assembly without any interface."""
        image = self.image
        for instant in range(first, first + n):
            image.set({"first_row": instant})
            for c in range(len(image.propagators)):
                image.predict(c, instant)
                image.end(c, instant)
            image.call(entries.END_INSTANT, instant)
            for propagator in self.assembly.propagators:
                propagator.instant = instant
                propagator.sample()
            self._record(1)
        record.error_indicator, record.force_mismatch, record.converged = [0.0], [0.0], True
        self.windows.append(record)

    # -- first guesses and fall-backs of windows --------------------------------------------------------------------
    def _restart(self, stages: Stages, record: WindowRecord) -> None:
        """Begin the window once more: with a softened start, or from rest where the loads close the gaps without it."""
        q = softened_start(self.assembly, self.settings, self.image, stages, self.gaps())
        record.fallbacks.append(FROM_REST if q is None else SOFTENED)
        self._use(1)
        self._begin_window(stages)
        stages.field("q")[...] = self.f_hat if q is None else q

    def _one_by_one(self, record: WindowRecord, n: int, number: int, count: int) -> WindowRecord:
        """Solve the window as windows of one instant."""
        record.fallbacks.append("windows of one instant")
        done = len(self.windows)
        for _ in range(n):
            self.advance(1, number, count)
            if self.stopped:
                break
        parts = self.windows.cut(done)
        record.converged = all(p.converged for p in parts)
        worst = max(parts, key=lambda p: (not p.converged, p.final_error))
        record.error_indicator.append(worst.final_error)
        record.force_mismatch.append(worst.final_mismatch)
        record.accepted = record.iterations - 1
        self.windows.append(record)
        return record

    def _sequential_guess(self, n: int) -> Array | None:
        """First guess q (n, n_flat) from windows of one instant; restores the state. None where one of them fails."""
        image, begun = self.image, self.assembly.instant
        kept, state = image.state.copy(), {name: getattr(self, name) for name in _RESTORED}
        spent = self.timings.march
        self._clear()
        self._observer = self._progress = None
        sequence: list[tuple[Array, Array]] = []
        self._sequence = sequence
        try:
            self._use(1)
            self._solve(n, 1)
            failed = self.stopped
            self.timings.march = spent  # counted by the window
        finally:
            vars(self).update(state)
            image.state[:] = kept
            self._set_instant(begun)
        if failed:
            return None
        f_hat, w_hat = (np.concatenate(fields) for fields in zip(*sequence, strict=True))
        return self.direction(n).incoming(f_hat, w_hat)
