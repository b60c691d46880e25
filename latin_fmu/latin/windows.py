"""Successive windows over [0, T]: two drivers on the same stages, hand-over of state, fall-backs.

A window starts from the state of the substructures, the gaps read from their displacements, and the last interface
tractions and velocities as first guess. One window over the whole interval is the method as published; windows of one
instant (the default) need the fewest passes.

The compiled driver solves many windows of one instant in one call (``kernels.instants``); the Python driver takes the
stages one by one, for observers, longer windows, laws written in Python and windows in which the iteration stalls. Both
run the same functions in the same order on the same numbers.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..kernels import entries
from .assembly import Array, Assembly
from .initial_conditions import start
from .instant_solve import Bonds, all_bonded
from .record import Timings, WindowRecord
from .recorder import Recorder, Tape
from .run_image import SlideProbes, Stages, Threads, histories, make_image
from .search_direction import Direction
from .settings import Settings
from .solver import SOFTENED, Observer, WindowSolver, softened_start
from .status import WindowList

# Stop the run if a window ends with sqrt(eta) above this value.
HOPELESS = 0.3
_FIRST = 16  # instants of the first call, whose time sets the number of those of the next calls
_SECONDS = 0.2  # aimed at per call: progress is shown and interruptions are handled between calls
# search directions: windows of one instant, longer ones, perfect interfaces at once
_ONE, _LONG, _BONDS = 1, 2, 3

Progress = Callable[[int, int, int, float], None]  # windows done, windows, iteration, indicator


@dataclass
class RunState:
    """Records and counts of the windows so far."""

    windows: WindowList = field(default_factory=WindowList)
    marched: int = 0  # substructure-instants
    condensed: int = 0
    interface_indicator: Array | None = None


class Run:
    """A run of an assembly; ``advance`` solves one window after the other.

    Parameters
    ----------
    assembly, settings : the problem and the rules of its solution. recorder : keeps the accepted fields.
    observer : called after each iteration. progress : called after each iteration with window counts.
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
        self.stopped = False
        self.state = RunState()
        traction, velocity = start(assembly)
        self._set_up(traction, velocity, None)
        self.image.call(entries.OPEN_ACCOUNTS)
        self._begin_recording()

    # -- the image ----------------------------------------------------------------------------------------------
    def _set_up(self, traction: Array, velocity: Array, scales: Array | None) -> None:
        """Image and search directions for the operators of now; ``scales``: largest norms met, None for negligible
        ones."""
        assembly = self.assembly
        self._operators = [p.operators for p in assembly.propagators]
        self._directions: dict[int, Direction] = {}
        self._bonds: Bonds | None = None
        self._single = _ONE  # direction of windows of one instant
        first = self.direction(1)
        first.bind()
        self._probes = SlideProbes(assembly, self.recorder.sliding)
        self.image = make_image(assembly, self.settings, first, self._probes)
        self.f_hat[:], self.w_hat[:] = traction, velocity
        self._use(_ONE)
        if scales is None:
            scales = self._negligible()
        self.image.field("scales", 3)[:] = scales
        self._threads = Threads([float(r["n_panels"] * r["m"]) for r in self.image.classes], self.settings.threads)
        self._per_instant, self._refused = 0.0, False

    def _negligible(self) -> Array:
        """Scales of negligible fields, relative to the largest load: denominator of eta, normal and tangential
        forces."""
        image, level = self.image, self.direction(1).level
        image.field("local_f", image.n_flat)[:], image.field("r", image.n_flat)[:] = level, 0.0
        measures = image.field("measure", 8)
        measures[:] = 0.0
        if image.n_flat:
            image.call(entries.FORCES, 1)
        tiny = np.finfo(float).tiny
        weights = self.direction(1).weights[1, self.assembly.layout.normal]
        fields = float(level.max(initial=0.0)) ** 2 * float(weights.sum())
        force = max(float(measures[3]), tiny)
        return np.array([max(fields, tiny), force, force])

    @property
    def f_hat(self) -> Array:
        """Tractions of the last accepted instant (n_flat,), a view, Pa."""
        return self.image.field("f_hat", self.image.n_flat)

    @property
    def w_hat(self) -> Array:
        """Velocities of the last accepted instant (n_flat,), a view, m s-1."""
        return self.image.field("w_hat", self.image.n_flat)

    def handed_on(self) -> list[tuple[str, int]]:
        """Names and sizes of the fields of the image that the next segment starts from, beside the states of the
        propagators."""
        return [("f_hat", self.image.n_flat), ("w_hat", self.image.n_flat), ("scales", 3), ("carry", 1)]

    def direction(self, n: int) -> Direction:
        """Search direction for windows of n instants (kept: one for n = 1, one for longer windows)."""
        key = _ONE if n == 1 else _LONG
        if key not in self._directions:
            self._directions[key] = Direction(self.assembly, self.settings, n)
        return self._directions[key]

    def _use(self, key: int) -> None:
        """Bind propagators and image to a search direction."""
        direction = self.direction(2 if key == _LONG else 1)
        direction.bind()
        if key == _BONDS:
            self.image.bind(key)
        else:
            self.image.bind(key, direction.run_fields(), direction.group_fields())

    def resume(self, recorder: Recorder) -> None:
        """Go on after the assembly has begun a new segment of time."""
        self.recorder = recorder
        self.state.windows, self.state.interface_indicator, self.stopped = WindowList(), None, False
        operators = [p.operators for p in self.assembly.propagators]
        if any(a is not b for a, b in zip(operators, self._operators, strict=True)):
            f_hat, w_hat = self.f_hat.copy(), self.w_hat.copy()
            self._set_up(f_hat, w_hat, self.image.field("scales", 3).copy())
        else:
            self.image.begin(len(self.assembly.time), histories(self.assembly))
        self.image.field("worst", len(self.assembly.interfaces))[:] = 0.0
        self._begin_recording()

    def _begin_recording(self) -> None:
        self.image.set({"first_row": 0})
        self.image.call(entries.READ_START)
        self.recorder.start(self.assembly, self.image, self._probes)

    def choices(self) -> dict[str, str]:
        """Automatic choices, in words."""
        kinds = {_ONE: "windows of one instant", _LONG: "longer windows"}
        if self._bonds is not None:
            return {"bonds": "one linear solve per instant"}
        return {f"search direction, {kinds[key]}": d.choice for key, d in self._directions.items()}

    def gaps(self) -> list[Array]:
        """Gaps (n_point,) of each group at the present instant."""
        groups = self.assembly.layout.groups
        return [self.image.group_field(g, "gap", group.n_point).copy() for g, group in enumerate(groups)]

    # -- windows ------------------------------------------------------------------------------------------------
    def all(self) -> None:
        """Solve every window of the interval; stops after one whose best iterate is far from a solution (HOPELESS)."""
        total = self.assembly.n_instant
        length = self.settings.window or total
        count = -(-total // length)
        if self._bonds is None and self.settings.direct_bonds and all_bonded(self.assembly):
            self._solve_bonds_at_once()
        self._use(_LONG if length > 1 else self._single)
        compiled = length == 1 and self._observer is None and self._compiles()
        number = 0
        while number < count and not self.stopped:
            done = self._march(count - number) if compiled else 0
            number += done
            if done and self._progress is not None:
                last = self.state.windows[-1]
                self._progress(number - 1, count, last.iterations, last.final_error)
            if number < count and (not compiled or self._refused):
                self.advance(min(length, total - number * length), number, count)
                number += 1

    def _compiles(self) -> bool:
        """Whether the kernels hold every factor and every law, and the bonds where those are solved at once."""
        if self._bonds is not None and self._single != _BONDS:
            return False
        return self.image.factored and all(g["law"] >= 0 for g in self.image.groups)

    def _march(self, n: int) -> int:
        """Solve up to n windows of one instant in one call; how many converged (fewer: the next one needs a
        fall-back)."""
        image, recorder, assembly = self.image, self.recorder, self.assembly
        longest = max(1, int(_SECONDS / self._per_instant)) if self._per_instant > 0 else _FIRST
        n = min(n, image.rows, longest, recorder.instants_unseen())
        first, before = assembly.instant + 1, clock.perf_counter()
        image.set({"first_row": first})
        done = self._march_together(first, n) if self._threads.several else image.call(entries.MARCH, first, n)
        if done:
            self._step_to(first + done - 1)
            recorder.kept(assembly, image, self._probes, done)
            self._keep_curves(first, done)
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

    def _step_to(self, instant: int) -> None:
        for propagator in self.assembly.propagators:
            propagator.instant = instant
            propagator.sample()

    def _keep_curves(self, first: int, done: int) -> None:
        most = self.settings.max_iterations
        counts = self.image.counts("iterations", done)
        errors, mismatches = (self.image.field(name, done, most) for name in ("errors", "mismatches"))
        self.state.windows.keep(first, counts, errors, mismatches)
        self._take_indicator()

    def _take_indicator(self) -> None:
        if self.assembly.interfaces:
            self.state.interface_indicator = self.image.field("worst", len(self.assembly.interfaces)).copy()

    def _count(self, before: float) -> None:
        """Add the work and the time since ``before``."""
        marched, condensed = self.image.marched()
        self.state.marched += marched
        self.state.condensed += condensed
        self.timings.march += clock.perf_counter() - before

    def advance(self, n: int, number: int, count: int) -> WindowRecord:
        """Solve the next window of n instants from Python."""
        before, image, state = clock.perf_counter(), self.image, self.state
        first = self.assembly.instant + 1
        record = WindowRecord(first, first + n - 1)
        if not self.assembly.interfaces:
            self._free(first, n, record)
            self._count(before)
            return record
        guess = self._sequential_guess(n) if n > 1 and self.settings.sequential_start else None
        self._use(_LONG if n > 1 else self._single)
        stages = Stages(image, self.direction(n), n, first)

        def report(iteration: int, error: float) -> None:
            if self._progress is not None:
                self._progress(number, count, iteration, error)

        solver = WindowSolver(self.settings, self._observer, report, self._trial)
        self._begin_window(stages)
        if guess is not None:
            stages.field("q")[...] = guess
        accepted = solver.solve(stages, record, number)
        if self.assembly.quasi_static and not record.converged and self._soften(stages, record):
            accepted = solver.solve(stages, record, number)
        if not record.converged and n > 1:
            image.call(entries.REWIND)
            self._count(before)
            return self._one_by_one(record, n, number, count)
        if not record.converged:
            # NaN included; without inertia nothing can follow a state that is no equilibrium
            self.stopped = self.assembly.quasi_static or not accepted.error <= HOPELESS
            if self.stopped:
                image.call(entries.REWIND)
                state.windows.append(record)
                self._count(before)
                return record
        self._end_window(stages, record)
        self._count(before)
        return record

    def _begin_window(self, stages: Stages) -> None:
        """State at the start, free responses of one instant, first guess."""
        image = self.image
        image.call(entries.BEGIN)
        image.call(entries.OPEN, stages.n, stages.first - 1)
        if stages.n == 1:
            for c in range(len(image.propagators)):
                image.predict(c, stages.first)
            image.call(entries.FIRST_GUESS, stages.first)
            if self._bonds is not None and self._single != _BONDS:  # too many for one matrix, or redundant
                image.call(entries.FREE_MOTION, stages.first)
                stages.field("q")[0] = self._bonds.guess(image.field("w", image.n_flat).copy(), stages.direction.k)
            return
        stages.field("q")[...] = stages.direction.incoming(self.f_hat, self.w_hat)

    def _end_window(self, stages: Stages, record: WindowRecord) -> None:
        """Move the substructures to the end of the window and keep its fields."""
        image, n, first = self.image, stages.n, stages.first
        scales = image.field("scales", 3).copy()
        image.call(entries.ACCEPT, n)
        if not record.converged:
            image.field("scales", 3)[:] = scales  # a failed iterate must not loosen the windows that follow
        # bodies that travelled far have arrived
        image.field("carry", 1)[0] = float(SOFTENED not in record.fallbacks)
        if n > 1:
            image.call(entries.REWIND)
        image.set({"first_row": first})
        self._march_accepted(stages, lambda _: None)
        self._step_to(first + n - 1)
        self._take_indicator()
        self.state.windows.append(record)

    def _march_accepted(self, stages: Stages, after: Callable[[int], None], keep: bool = True) -> None:
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
            self._move(first + i)
            if keep:
                self.recorder.kept(self.assembly, image, self._probes, 1, i)
            after(i)

    def _move(self, instant: int) -> None:
        for propagator in self.assembly.propagators:
            propagator.instant = instant

    def _trial(self, stages: Stages, after: Callable[[int], None]) -> None:
        """March the linear stage of the last iterate, and put everything back."""
        image = self.image
        kept, begun, row = image.moving.copy(), self.assembly.instant, int(image.run[0]["first_row"])
        if stages.n > 1:
            image.call(entries.REWIND)
        image.set({"first_row": stages.first})
        self._march_accepted(stages, after, keep=False)
        image.moving[:] = kept
        image.set({"first_row": row})
        self._move(begun)

    def _soften(self, stages: Stages, record: WindowRecord) -> bool:
        """Begin the window once more with a softened start, where that makes a difference."""
        q = softened_start(self.assembly, self.settings, self.image, stages, self.gaps())
        if q is None:
            return False
        record.fallbacks.append(SOFTENED)
        self._use(self._single)
        self._begin_window(stages)
        stages.field("q")[...] = q
        return True

    def _one_by_one(self, record: WindowRecord, n: int, number: int, count: int) -> WindowRecord:
        """Fall-back: the window as windows of one instant."""
        record.fallbacks.append("windows of one instant")
        done = len(self.state.windows)
        for _ in range(n):
            self.advance(1, number, count)
            if self.stopped:
                break
        parts = self.state.windows.cut(done)
        record.converged = all(p.converged for p in parts)
        worst = max(parts, key=lambda p: (not p.converged, p.final_error))
        record.error_indicator.append(worst.final_error)
        record.force_mismatch.append(worst.final_mismatch)
        record.accepted = record.iterations - 1
        self.state.windows.append(record)
        return record

    def _sequential_guess(self, n: int) -> Array | None:
        """q (n, n_flat) of a pass with windows of one instant; everything is put back after it."""
        image, state = self.image, self.state
        kept, begun = image.state.copy(), self.assembly.instant
        observer, progress, recorder, windows = self._observer, self._progress, self.recorder, state.windows
        indicator = state.interface_indicator
        self._observer = self._progress = None
        tape = Tape(image.n_flat)
        self.recorder, state.windows = tape, WindowList()  # type: ignore[assignment]
        try:
            self._use(self._single)
            done, spent = 0, self.timings.march
            while done < n and not self.stopped:
                marched = self._march(n - done) if self._compiles() else 0
                done += marched
                if done < n and (marched == 0 or self._refused):
                    self.advance(1, 0, 1)
                    done += 1
            self.timings.march = spent  # counted by the window
        finally:
            self.recorder, state.windows, state.interface_indicator = recorder, windows, indicator
            self._observer, self._progress = observer, progress
            image.state[:] = kept
            self._move(begun)
        if self.stopped:  # there is no guess: the window starts from the last values
            self.stopped = False
            return None
        direction = self.direction(n)
        return direction.incoming(np.concatenate(tape.f_hat), np.concatenate(tape.w_hat))

    def _solve_bonds_at_once(self) -> None:
        """All interfaces are perfect: start every instant with the solution of its bonds, one linear solve."""
        self._bonds = Bonds(self.assembly)
        direction = self.direction(1)
        operator = self._bonds.incoming(direction.k)
        if operator is not None:
            fields = {**direction.run_fields(), "direct_bonds": 1, "bonds": operator}
            self.image.bind(_BONDS, fields, direction.group_fields())
            self._single = _BONDS

    def _free(self, first: int, n: int, record: WindowRecord) -> None:
        """No interface at all: march."""
        image = self.image
        for i in range(n):
            image.set({"first_row": first + i})
            for c in range(len(image.propagators)):
                image.predict(c, first + i)
                image.end(c, first + i)
            image.call(entries.END_INSTANT, first + i)
            self._step_to(first + i)
            self.recorder.kept(self.assembly, image, self._probes, 1)
        record.error_indicator, record.force_mismatch, record.converged = [0.0], [0.0], True
        self.state.windows.append(record)
