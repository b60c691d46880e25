"""The LATIN loop over one window, with its fall-back chain.

global stage -> local stage -> indicator, until both the indicator and the force mismatch are below tolerance.
An acceleration that stalls gives way to relaxation 1/2 from the best iterate; the best iterate, never the last,
is what a window that does not converge returns.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .acceleration import Anderson, Relaxation, Slide
from .assembly import Assembly
from .coarse import Coarse
from .error_indicator import Indicator, Scales
from .global_stage import GlobalStage
from .kernels import outgoing
from .layout import Array
from .local_stage import LocalStage, Opening
from .newton import newton
from .point_by_point import PointByPoint
from .record import Timings, WindowRecord
from .search_direction import channel_k
from .settings import Settings
from .stopping import AT_REST, PATIENCE, RECENT, STALL_ACCELERATED, STALL_PLAIN

RELAXED, POINT_BY_POINT, NEWTON = "relaxation 1/2", "points one after the other", "Newton-Krylov"
_NEWTON = 3  # iterations of the Newton-Krylov fall-back, in max_iterations
_LONGEST_STATIC = 20.0  # step of the acceleration without inertia, in lengths of the residual
_LAST_WORD = 20  # iterations after the last fall-back


@dataclass
class Iterate:
    """One iterate of a window; arrays (n, n_flat)."""

    q: Array
    f_hat: Array
    w_hat: Array
    residual: Array
    error: float
    scales: Scales


@dataclass(frozen=True)
class IterationEvent:
    """What an observer sees after each iteration (fields of the window's instants).

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


class _Merits:
    """How far each iterate is from both tolerances (1: met); where the mismatch is not known it is taken in
    proportion to the indicator, with the ratio of the last iterate that knows it."""

    def __init__(self, settings: Settings) -> None:
        self._settings, self._ratio = settings, 1.0
        self._errors: list[float] = []
        self._known: list[float] = []

    @property
    def values(self) -> list[float]:
        """Merit of every iterate so far."""
        pairs = zip(self._errors, self._known, strict=True)
        return [known if np.isfinite(known) else self._ratio * error for error, known in pairs]

    def add(self, error: float, mismatch: float) -> bool:
        """Add an iterate; True where it is the best so far."""
        merit = error / self._settings.tolerance if np.isfinite(error) else np.inf
        known = max(merit, mismatch / self._settings.force_tolerance) if np.isfinite(mismatch) else np.nan
        if np.isfinite(known) and merit > 0:
            self._ratio = known / merit
        self._errors.append(merit)
        self._known.append(known)
        values = self.values
        return bool(np.isfinite(merit) and values[-1] <= min(values))


class Direction:
    """Everything that depends on the search direction, for windows of ``n`` instants."""

    def __init__(self, assembly: Assembly, settings: Settings, n: int) -> None:
        self.assembly = assembly
        self.k, self.choice = channel_k(assembly, settings.search_direction, n)
        self.local = LocalStage(assembly, self.k)
        self.indicator = Indicator(assembly, self.k)
        self.weight = np.sqrt(assembly.layout.area * self.local.z)
        self.coarse: Coarse | None = None  # without inertia, from ``bind``

    @cached_property
    def points(self) -> PointByPoint:
        """Gauss-Seidel over the points, built where it is needed."""
        return PointByPoint(self.assembly)

    def bind(self) -> None:
        """Condense the propagators on this direction."""
        for propagator, channels in zip(self.assembly.propagators, self.assembly.channels, strict=True):
            propagator.bind(self.k[channels[:, 0]])
        if self.assembly.quasi_static:
            self.coarse = Coarse(self.assembly, self.k)

    def incoming(self, f_hat: Array, w_hat: Array) -> Array:
        """q = F_hat + k W_hat."""
        q: Array = f_hat + self.k * w_hat
        return q


class WindowSolver:
    """Iterates one window from the present state of the propagators."""

    def __init__(
        self,
        direction: Direction,
        settings: Settings,
        timings: Timings,
        observer: Observer | None = None,
        progress: Callable[[int, float], None] | None = None,
    ) -> None:
        self._direction, self._settings, self._timings = direction, settings, timings
        self._observer, self._progress = observer, progress
        self._static = settings.quasi_static

    def solve(
        self,
        stage: GlobalStage,
        q: Array,
        opening: Opening,
        scales: Scales,
        record: WindowRecord,
        number: int,
    ) -> Iterate:
        """Iterate from q (n, n_flat); fills ``record`` and returns the accepted (else the best) iterate."""
        settings = self._settings
        best: Iterate | None = None
        phase_start, before = 0, len(record.fallbacks)
        limit = record.iterations + settings.max_iterations
        merits = _Merits(settings)
        accelerator = self._accelerator(settings.anderson_depth)
        while True:
            if stage.answers is not None:
                stage.answers.begin(scales.field if stage.n == 1 or best is None else best.scales.field)
            now, mismatch = self._evaluate(stage, q, opening, scales)
            record.error_indicator.append(now.error)
            record.force_mismatch.append(mismatch)
            self._tell(number, record, now, stage)
            if merits.add(now.error, mismatch) or best is None:
                best, record.accepted = now, record.iterations - 1
            met = now.error <= settings.tolerance and mismatch <= settings.force_tolerance
            # A warm start within tolerance is not accepted as it is: step after step its lag would add up.
            if met and (stage.n > 1 or record.iterations > 1 or now.error <= AT_REST * settings.tolerance):
                record.converged, record.accepted = True, record.iterations - 1
                return now
            if not np.isfinite(now.error):
                return best
            exhausted = record.iterations >= limit
            progress = merits.values[phase_start:]
            accelerated = isinstance(accelerator, Anderson)
            # without inertia a body may take many equal steps back to where it sticks
            patient = self._static and not accelerated
            if not exhausted and (patient or not self._stalled(progress, accelerated)):
                q = accelerator.next(now.q, now.residual)
                continue
            fallback = self._fallback(stage, record.fallbacks[before:], exhausted)
            if fallback is None:
                return best
            record.fallbacks.append(fallback)
            phase_start = record.iterations
            if fallback == NEWTON:
                accelerator = self._accelerator(settings.anderson_depth)
                q = self._newton(stage, best, opening, scales, record)
                limit = record.iterations + settings.max_iterations
            elif fallback == RELAXED:
                accelerator = Slide(self._direction.weight) if self._static else Relaxation(0.5)
                q = accelerator.next(best.q, best.residual)
            else:
                limit = record.iterations + _LAST_WORD
                accelerator = self._accelerator(settings.anderson_depth)
                q = self._point_by_point(stage, best, opening)

    def _fallback(self, stage: GlobalStage, used: list[str], exhausted: bool) -> str | None:
        """The next fall-back, None when there is none left."""
        if self._static and NEWTON not in used and self._settings.max_iterations >= PATIENCE:
            return NEWTON
        if RELAXED not in used and not exhausted:
            return RELAXED
        wanted = self._settings.max_iterations >= PATIENCE  # fewer: a look at the iteration, not an answer
        # without inertia a floating body has no admittance to go from point to point with
        wanted = wanted and stage.n == 1 and not self._static
        return POINT_BY_POINT if wanted and POINT_BY_POINT not in used else None

    def _point_by_point(self, stage: GlobalStage, best: Iterate, opening: Opening) -> Array:
        """q (1, n_flat) of the solution point by point."""
        clock = time.perf_counter()
        points, k = self._direction.points, self._direction.k
        free = points.free_velocity(stage.free(), k)
        f_hat, w_hat = points.solve(free, best.f_hat[0], opening.gap)
        self._timings.local_stage += time.perf_counter() - clock
        return self._direction.incoming(f_hat, w_hat)[None]

    def _newton(
        self, stage: GlobalStage, best: Iterate, opening: Opening, scales: Scales, record: WindowRecord
    ) -> Array:
        """q (1, n_flat) where Newton's method has come to; each of its products counts as an iteration."""

        def evaluate(q: Array) -> tuple[Array, Array]:
            now, mismatch = self._evaluate(stage, q, opening, scales)
            record.error_indicator.append(now.error)
            record.force_mismatch.append(mismatch)
            return now.q, now.residual

        settings = self._settings
        weight = np.where(self._direction.k > 0, self._direction.weight, 0.0)
        return newton(evaluate, best.q, weight, settings.tolerance, _NEWTON * settings.max_iterations)

    def _accelerator(self, depth: int) -> Anderson | Relaxation | Slide:
        if depth == 0:
            return Relaxation(self._settings.relaxation)
        longest = _LONGEST_STATIC if self._static else np.inf
        return Anderson(self._direction.weight, depth, self._settings.relaxation, longest)

    def _evaluate(
        self, stage: GlobalStage, q: Array, opening: Opening, scales: Scales
    ) -> tuple[Iterate, float]:
        """One global and one local stage from q, measured."""
        direction, timings, settings = self._direction, self._timings, self._settings
        clock = time.perf_counter()
        q, w = stage.balanced(q)
        after_global = time.perf_counter()
        timings.global_stage += after_global - clock
        f, s = np.empty_like(q), np.empty_like(q)
        outgoing(q, w, direction.k, direction.local.z, f, s)
        if len(s) == 1:
            f_hat, w_hat = direction.local.instant(s[0], opening.gap)
            f_hat, w_hat = f_hat[None], w_hat[None]
        else:
            f_hat, w_hat, _ = direction.local.window(s, opening)
        timings.local_stage += time.perf_counter() - after_global
        residual, measure = direction.indicator.field(q, (f, w, f_hat, w_hat), scales)
        mismatch, reached = float("nan"), measure.scales
        if measure.value <= settings.tolerance:
            forces = direction.indicator.mismatch(residual, f_hat, measure.scales)
            mismatch, reached = forces.value, forces.scales
        return Iterate(q, f_hat, w_hat, residual, measure.value, reached), mismatch

    @staticmethod
    def _stalled(errors: list[float], accelerated: bool) -> bool:
        if len(errors) < PATIENCE:
            return False
        bound = STALL_ACCELERATED if accelerated else STALL_PLAIN
        return min(errors[-RECENT:]) > bound * min(errors[:-RECENT])

    def _tell(self, number: int, record: WindowRecord, now: Iterate, stage: GlobalStage) -> None:
        if self._progress is not None:
            self._progress(record.iterations, now.error)
        if self._observer is None:
            return

        def trial(after: Callable[[int], None]) -> None:
            stage.trial(now.q, now.f_hat, after)

        self._observer(
            IterationEvent(
                number, record.iterations, now.error, record.force_mismatch[-1], now.f_hat, now.w_hat, trial
            )
        )
