"""The LATIN loop over one window, with its fall-back chain.

global stage -> local stage -> indicator, until both the indicator and the force mismatch are below tolerance.
An acceleration that stalls gives way to relaxation 1/2 from the best iterate; the best iterate, never the last,
is what a window that does not converge returns.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .acceleration import Anderson, Relaxation
from .assembly import Assembly
from .error_indicator import Indicator, Scales
from .global_stage import GlobalStage
from .layout import Array
from .local_stage import LocalStage, Opening
from .record import Timings, WindowRecord
from .search_direction import channel_k
from .settings import Settings

# Stall: the best of the last _RECENT residuals is above this fraction of the best before, after _PATIENCE.
_RECENT, _PATIENCE = 6, 12
_STALL_ACCELERATED, _STALL_PLAIN = 0.7, 0.99


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


class Direction:
    """Everything that depends on the search direction, for windows of ``n`` instants."""

    def __init__(self, assembly: Assembly, settings: Settings, n: int) -> None:
        self.assembly = assembly
        self.k, self.choice = channel_k(assembly, settings.search_direction, n)
        self.local = LocalStage(assembly, self.k)
        self.indicator = Indicator(assembly, self.k)
        self.weight = np.sqrt(assembly.layout.area * self.local.z)

    def bind(self) -> None:
        """Condense the propagators on this direction."""
        for propagator, channels in zip(self.assembly.propagators, self.assembly.channels, strict=True):
            propagator.bind(self.k[channels[:, 0]])

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
        phase_start = 0
        accelerator = self._accelerator(settings.anderson_depth)
        while True:
            now, mismatch = self._evaluate(stage, q, opening, scales)
            record.error_indicator.append(now.error)
            record.force_mismatch.append(mismatch)
            self._tell(number, record, now, stage)
            if best is None or now.error < best.error:
                best = now
            if now.error <= settings.tolerance and mismatch <= settings.force_tolerance:
                record.converged = True
                return now
            if record.iterations >= settings.max_iterations or not np.isfinite(now.error):
                return best
            errors = record.error_indicator[phase_start:]
            if self._stalled(errors, isinstance(accelerator, Anderson)):
                if "relaxation 1/2" in record.fallbacks:
                    return best
                record.fallbacks.append("relaxation 1/2")
                phase_start = record.iterations
                accelerator = Relaxation(0.5)
                now = best
            q = accelerator.next(now.q, now.residual)

    def _accelerator(self, depth: int) -> Anderson | Relaxation:
        if depth == 0:
            return Relaxation(self._settings.relaxation)
        return Anderson(self._direction.weight, depth, self._settings.relaxation)

    def _evaluate(
        self, stage: GlobalStage, q: Array, opening: Opening, scales: Scales
    ) -> tuple[Iterate, float]:
        """One global and one local stage from q, measured."""
        direction, timings, settings = self._direction, self._timings, self._settings
        clock = time.perf_counter()
        w = stage(q)
        after_global = time.perf_counter()
        timings.global_stage += after_global - clock
        f = q - direction.k * w
        s = w - direction.local.z * f
        if len(s) == 1:
            f_hat, w_hat = direction.local.instant(s[0], opening.gap)
            f_hat, w_hat = f_hat[None], w_hat[None]
        else:
            f_hat, w_hat, _ = direction.local.window(s, opening)
        timings.local_stage += time.perf_counter() - after_global
        residual = direction.incoming(f_hat, w_hat) - q
        measure = direction.indicator.field(residual, (f, w, f_hat, w_hat), scales)
        mismatch, reached = float("nan"), measure.scales
        if measure.value <= settings.tolerance:
            forces = direction.indicator.mismatch(residual, f_hat, measure.scales)
            mismatch, reached = forces.value, forces.scales
        return Iterate(q, f_hat, w_hat, residual, measure.value, reached), mismatch

    @staticmethod
    def _stalled(errors: list[float], accelerated: bool) -> bool:
        if len(errors) < _PATIENCE:
            return False
        bound = _STALL_ACCELERATED if accelerated else _STALL_PLAIN
        return min(errors[-_RECENT:]) > bound * min(errors[:-_RECENT])

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
