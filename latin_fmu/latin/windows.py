"""Successive windows over [0, T]: hand-over of state, warm start, fall-back to windows of one instant.

A window starts from the state of the substructures, the opening read from their displacements, and the last
interface tractions and velocities as first guess. One window over the whole interval is the method as published;
windows of one instant (the default) need the fewest passes.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from .approach import APPROACH, continuation, second_guess
from .assembly import Assembly
from .bonded import Bonds, all_bonded
from .compiled_run import CompiledRun, marches
from .error_indicator import Scales
from .global_stage import GlobalStage
from .layout import Array
from .local_stage import Opening, left, read_gaps, read_opening
from .record import Timings, WindowRecord
from .recorder import Recorder
from .resting import Resting
from .settings import Settings
from .solver import Direction, Iterate, Observer, WindowSolver
from .start import start
from .unchanged import Answers, negligible
from .window_list import WindowList

# A window that fails with an indicator above this holds no answer worth going on from.
HOPELESS = 0.3

Progress = Callable[[int, int, int, float], None]  # windows done, windows, iteration, indicator


@dataclass
class RunState:
    """Everything besides the propagators that the next window needs."""

    f_hat: Array
    w_hat: Array
    scales: Scales
    windows: WindowList = field(default_factory=WindowList)
    marched: int = 0  # substructure-instants
    condensed: int = 0
    interface_indicator: Array | None = None


class Run:
    """A run of an assembly; ``advance`` solves one window after the other.

    Parameters
    ----------
    assembly, settings : what and how. recorder : keeps the accepted fields.
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
        self._directions: dict[bool, Direction] = {}
        self._bound: Direction | None = None
        self._bonds: Bonds | None = None
        self._operators = [p.operators for p in assembly.propagators]
        self._compiled: CompiledRun | None = None
        traction, velocity = start(assembly)
        self.state = RunState(traction, velocity, self.direction(1).indicator.floor())
        self._gaps: list[Array] | None = recorder.start(assembly, traction, velocity)

    def direction(self, n: int) -> Direction:
        """Search direction for windows of n instants (kept: one for n = 1, one for longer windows)."""
        if (n == 1) not in self._directions:
            self._directions[n == 1] = Direction(self.assembly, self.settings, n)
        return self._directions[n == 1]

    def _bind(self, direction: Direction) -> None:
        if self._bound is not direction:
            direction.bind()
            self._bound = direction

    def resume(self, recorder: Recorder) -> None:
        """Go on after the assembly has begun a new segment of time."""
        operators = [p.operators for p in self.assembly.propagators]
        if any(a is not b for a, b in zip(operators, self._operators, strict=True)):
            self._directions.clear()
            self._bound, self._bonds, self._compiled, self._operators = None, None, None, operators
        self.state.windows, self.state.interface_indicator, self.stopped = WindowList(), None, False
        self.recorder = recorder
        self._gaps = recorder.start(self.assembly, self.state.f_hat, self.state.w_hat)
        if self._compiled is not None:
            self._compiled.begin(recorder)

    def choices(self) -> dict[str, str]:
        """What was chosen automatically."""
        kinds = {True: "windows of one instant", False: "longer windows"}
        if self._bonds is not None:
            return {"bonds": "one linear solve per instant"}
        return {f"search direction, {kinds[one]}": d.choice for one, d in self._directions.items()}

    def all(self) -> None:
        """Solve every window of the interval; stops after one whose best iterate is far from any answer."""
        total = self.assembly.n_instant
        length = self.settings.window or total
        count = -(-total // length)
        compiled = self._compiled_road() if length == 1 else None
        number = 0
        while number < count and not self.stopped:
            done = 0 if compiled is None else compiled.advance(count - number)
            number += done
            if done and self._progress is not None:
                last = self.state.windows[-1]
                self._progress(number - 1, count, last.iterations, last.final_error)
            if number < count and (compiled is None or compiled.refused):
                self.advance(min(length, total - number * length), number, count)
                number += 1

    def _compiled_road(self) -> CompiledRun | None:
        """The compiled march, where nothing asks for the long road."""
        assembly = self.assembly
        if self._observer is not None or not marches(assembly):
            return None
        direction, at_once = self.direction(1), None
        if self._bonds_directly():
            if self._bonds is None:
                self._bonds = Bonds(assembly)
            if self._compiled is None and (at_once := self._bonds.incoming(direction.k)) is None:
                return None
        self._bind(direction)
        if self._compiled is None:
            self._compiled = CompiledRun(self, at_once)
        return self._compiled

    def gaps(self) -> list[Array]:
        """Gaps (n_point,) of each group at the present instant."""
        return read_gaps(self.assembly) if self._gaps is None else self._gaps

    def take_gaps(self, gaps: list[Array]) -> None:
        """Gaps that the compiled march has reached."""
        self._gaps = gaps

    def count(self, marched: int, condensed: int) -> None:
        """Add substructure-instants marched, and solved through the condensed operator."""
        self.state.marched += marched
        self.state.condensed += condensed

    def advance(self, n: int, number: int, count: int) -> WindowRecord:
        """Solve the next window of n instants."""
        if not self.assembly.interfaces:
            return self._free(n)
        if n == 1 and self._bonds_directly() and (solved := self._bonded()) is not None:
            return solved
        assembly, state = self.assembly, self.state
        first = assembly.propagators[0].state.instant + 1
        record = WindowRecord(first, first + n - 1)
        guess = self._sequential_guess(n) if n > 1 and self.settings.sequential_start else None
        direction = self.direction(n)
        self._bind(direction)
        stage = GlobalStage(assembly, direction.k, n, direction.coarse, self._answers(direction, n))
        q = direction.incoming(*guess) if guess is not None else self._warm_start(direction, stage)

        def report(iteration: int, error: float) -> None:
            if self._progress is not None:
                self._progress(number, count, iteration, error)

        solver = WindowSolver(direction, self.settings, self.timings, self._observer, report)
        opening = self._opening(n)
        accepted = solver.solve(stage, q, opening, state.scales, record, number)
        if assembly.quasi_static and not record.converged:
            accepted = solver.solve(
                stage, self._again(stage, opening, record), opening, state.scales, record, number
            )
        if not record.converged and n > 1:
            stage.rewind()
            self._count(stage)
            return self._one_by_one(record, n, number, count)
        if not record.converged:
            accepted.scales = state.scales  # a failed iterate must not loosen the windows that follow
            # NaN included; without inertia a state that is no equilibrium leads nowhere
            self.stopped = assembly.quasi_static or not accepted.error <= HOPELESS
            if self.stopped:
                stage.rewind()
                state.windows.append(record)
                return record
        self._commit(stage, accepted, record)
        return record

    def _answers(self, direction: Direction, n: int) -> Answers | None:
        """Answers of the classes over the next window, where those are to be kept."""
        enough = negligible(self.settings)
        if enough < 0.0:
            return None
        return Answers(n, direction.indicator.weights[0], enough, len(self.assembly.propagators))

    def _again(self, stage: GlobalStage, opening: Opening, record: WindowRecord) -> Array:
        """Another first guess of q (1, n_flat) without inertia."""
        state, direction = self.state, self.direction(1)
        stage.rewind()
        name, f_hat, w_hat = second_guess(
            direction, self.settings, state.f_hat, opening, state.scales, self.timings
        )
        record.fallbacks.append(name)
        return direction.incoming(f_hat, w_hat)[None]

    def _opening(self, n: int) -> Opening:
        """Opening at the start of a window; one instant needs the gaps alone, known from the last one kept."""
        if n > 1:
            return read_opening(self.assembly)
        return Opening(left(self.assembly, self.gaps()), [], [])

    def _warm_start(self, direction: Direction, stage: GlobalStage) -> Array:
        """First guess of q (n, n_flat): the last value; where nothing touched, the free motion, which is the answer as
        long as nothing does (an instant of open contacts costs one check).

        No extrapolation: accepted within the tolerance as it is, it would feed its own error and gain energy.
        """
        state, w_hat = self.state, self.state.w_hat
        if state.windows and APPROACH in state.windows[-1].fallbacks:
            w_hat = np.zeros_like(w_hat)  # bodies that have travelled far have arrived
        elif self.assembly.quasi_static:
            w_hat = continuation(self.assembly) * w_hat
        elif stage.n == 1 and not state.f_hat.any():
            return direction.incoming(state.f_hat, stage.free_velocity())
        return np.repeat(direction.incoming(state.f_hat, w_hat)[None], stage.n, axis=0)

    def _commit(self, stage: GlobalStage, accepted: Iterate, record: WindowRecord) -> None:
        state, recorder = self.state, self.recorder
        before = clock.perf_counter()

        def keep(i: int) -> None:
            self._gaps = recorder.keep(self.assembly, accepted.f_hat[i], accepted.w_hat[i])

        stage.commit(accepted.q, accepted.f_hat, keep)
        self.timings.global_stage += clock.perf_counter() - before
        self._count(stage)
        local = (
            self._bound.indicator.per_interface(accepted.residual, accepted.scales) if self._bound else None
        )
        if local is not None:
            worst = state.interface_indicator
            state.interface_indicator = local if worst is None else np.maximum(worst, local)
        state.scales = accepted.scales
        state.f_hat, state.w_hat = accepted.f_hat[-1], accepted.w_hat[-1]
        state.windows.append(record)

    def _count(self, stage: GlobalStage) -> None:
        self.state.marched += stage.marched
        self.state.condensed += stage.condensed
        stage.marched = stage.condensed = 0

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

    def _sequential_guess(self, n: int) -> tuple[Array, Array] | None:
        """F_hat, W_hat (n, n_flat) of a pass with windows of one instant; everything is put back after it."""
        assembly, state, recorder = self.assembly, self.state, self.recorder
        snapshot = assembly.snapshot()
        observer, progress = self._observer, self._progress
        self._observer = self._progress = None
        tape = _Tape()
        self.recorder, self.state = tape, replace(state, windows=WindowList())  # type: ignore[assignment]
        gaps = self._gaps
        try:
            for _ in range(n):
                self.advance(1, 0, 1)
                if self.stopped:
                    break
            state.marched, state.condensed = self.state.marched, self.state.condensed
        finally:
            self.recorder, self.state, self._gaps = recorder, state, gaps
            self._observer, self._progress = observer, progress
            assembly.restore(snapshot)
        if self.stopped:  # no guess to be had: start from the last values
            self.stopped = False
            return None
        return np.stack(tape.f_hat), np.stack(tape.w_hat)

    def _bonds_directly(self) -> bool:
        """Whether an instant is one linear solve: all interfaces perfect, nobody watches an iteration."""
        return self.settings.direct_bonds and self._observer is None and all_bonded(self.assembly)

    def _bonded(self) -> WindowRecord | None:
        """One instant of an assembly whose interfaces are all perfect; None where it has to be iterated."""
        state, before = self.state, clock.perf_counter()
        if self._bonds is None:
            self._bonds = Bonds(self.assembly)
        self._bonds.bind()
        self._bound = None
        solved = self._bonds.instant()
        if solved is None:
            return None
        state.f_hat, state.w_hat, left = solved
        self._gaps = self.recorder.keep(self.assembly, state.f_hat, state.w_hat)
        last = self.assembly.propagators[0].state.instant
        record = WindowRecord(last, last, [left], [left], converged=True)
        state.windows.append(record)
        state.marched += self._bonds.marched
        self._bonds.marched = 0
        self.timings.global_stage += clock.perf_counter() - before
        return record

    def _free(self, n: int) -> WindowRecord:
        """No interface at all: march."""
        propagators, bodies = self.assembly.propagators, Resting(self.assembly)
        for _ in range(n):
            bodies.predict()
            for c, propagator in enumerate(propagators):
                self.state.marched += bodies.commit(c, np.zeros((0, len(propagator.names))))
            self.recorder.keep(self.assembly, np.zeros(0), np.zeros(0))
        last = propagators[0].state.instant
        record = WindowRecord(last - n + 1, last, [0.0], [0.0], converged=True)
        self.state.windows.append(record)
        return record


class _Tape:
    """Recorder of a sequential pass."""

    def __init__(self) -> None:
        self.f_hat: list[Array] = []
        self.w_hat: list[Array] = []

    def keep(self, assembly: Assembly, f_hat: Array, w_hat: Array) -> None:  # noqa: ARG002, as Recorder.keep
        """Keep one instant."""
        self.f_hat.append(f_hat)
        self.w_hat.append(w_hat)
