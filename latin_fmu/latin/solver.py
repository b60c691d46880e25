"""The LATIN loop over one window from Python, with its fall-back chain.

The stages are those of ``kernels.iteration``, called one by one: for observers, laws written in Python, factors that
the kernels do not hold, and windows in which the iteration stalls. A stalled acceleration is followed by Newton's
method (without inertia), by relaxation 1/2 from the best iterate, and in windows of one instant by a solution point by
point. A window that does not converge returns its best iterate, which need not be the last.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..kernels import entries
from ..kernels.iteration import BEST, BROKEN, CONVERGED, PATIENCE, STALLED
from ..propagator.image import Image
from .direction import Direction
from .layout import Array
from .newton import newton
from .record import WindowRecord
from .settings import Settings

RELAXED, POINT_BY_POINT, NEWTON = "relaxation 1/2", "points one after the other", "Newton-Krylov"
_NEWTON = 3  # iterations of the Newton-Krylov fall-back, in max_iterations
_AFTER_LAST = 20  # iterations after the last fall-back


@dataclass
class Iterate:
    """One iterate of a window; arrays (n, n_flat); ``measures`` as ``kernels.records`` lists them."""

    q: Array
    f_hat: Array
    w_hat: Array
    residual: Array
    error: float
    measures: Array


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


class Slide:
    """Relaxation 1/2 with run-ups, for bodies that slide or topple back to where they stick under a small excess of
    force: the residual is the same iteration after iteration, and so is the step.

    After every ``PERIOD`` iterations with nearly the same residual the step is taken many times at once, twice as many
    as the time before. The relaxations in between reduce the other errors that this step has caused.

    Parameters
    ----------
    metric : (n_flat,) area / k.
    """

    PERIOD, SAME = 8, 0.05

    def __init__(self, metric: Array) -> None:
        self._metric = metric
        self._steps, self._size, self._times = 0, np.inf, 8.0

    def factor(self, residual: Array) -> float:
        """Factor on the residual (n, n_flat) of the next step."""
        self._steps += 1
        if self._steps % self.PERIOD:
            return 0.5
        size = float(np.vdot(self._metric * residual, residual)) ** 0.5
        same, self._size = abs(size - self._size) < self.SAME * size, size
        if not same:
            return 0.5
        self._times *= 2.0
        return 0.5 * self._times


class Stages:
    """The stages of one window of ``n`` instants that starts with instant ``first``, on the image of a run."""

    def __init__(self, image: Image, direction: Direction, n: int, first: int) -> None:
        self.image, self.direction, self.n, self.first = image, direction, n, first
        self._groups = direction.assembly.layout.groups
        self._whole = image.factored and all(g["law"] >= 0 for g in image.groups)
        self._size = n * image.n_flat

    def field(self, name: str) -> Array:
        """A field (n, n_flat) of the window, a view."""
        return self.image.field(name, self.n, self.image.n_flat)

    def evaluate(self, iteration: int) -> None:
        """One linear and one local stage from the q of the image, measured."""
        image, n = self.image, self.n
        if self._whole:
            image.call(entries.STAGE, n, self.first, iteration)
            return
        if n > 1 and not image.factored:
            image.sweep(n, self.first)
        image.call(entries.LINEAR_STAGE, n, self.first, iteration)
        for i in range(n):
            image.call(entries.OUTGOING, i)
            for g in range(len(self._groups)):
                image.call(entries.PREPARE, g, i)
                if image.groups[g]["law"] >= 0:
                    image.call(entries.POINTS, g)
                else:
                    self._law(g)
                image.call(entries.FINISH, g, i, n)
        image.call(entries.MEASURE, n)

    def _law(self, g: int) -> None:
        """The law of a group as its behaviour states it in Python."""
        image, group = self.image, self._groups[g]
        shape = group.n_point, group.n_component
        elastic = group.behaviour.elastic
        reach = image.group_field(g, "reach", *(shape if elastic else shape[:1]))
        rate = image.run[0]["layer_rate"] if elastic else 1.0 / image.run[0]["dt"]
        z = self.direction.group_fields()[g]["z_sum"]
        traction = group.behaviour.local(
            image.group_field(g, "jump", *shape).copy(), z, reach.copy(), float(rate), group.parameters
        )
        image.group_field(g, "traction", *shape)[...] = traction

    def judge(self, phase: int, iteration: int, accelerated: bool) -> int:
        """See ``kernels.iteration.judge``."""
        return self.image.call(entries.JUDGE, self.n, phase, iteration, int(accelerated))

    def measures(self) -> Array:
        """Measures of the last iterate."""
        return self.image.field("measure", 8).copy()

    def iterate(self) -> Iterate:
        """A copy of the last iterate."""
        q, f_hat, w_hat, residual = (self.field(name).copy() for name in ("q", "local_f", "local_w", "r"))
        measures = self.measures()
        return Iterate(q, f_hat, w_hat, residual, float(measures[0]), measures)

    def put(self, iterate: Iterate) -> None:
        """Make an iterate the last one."""
        for name, values in zip(
            ("q", "local_f", "local_w", "r"), (iterate.q, iterate.f_hat, iterate.w_hat, iterate.residual), strict=True
        ):
            self.field(name)[...] = values
        self.image.field("measure", 8)[:] = iterate.measures


class WindowSolver:
    """Iterates one window from the present state of the propagators.

    Parameters
    ----------
    observer : called after each iteration. progress : called with iteration and indicator after each iteration.
    trial : marches the linear stage of the last iterate and restores the state after it (``Run._trial``).
    """

    def __init__(
        self,
        settings: Settings,
        observer: Observer | None = None,
        progress: Callable[[int, float], None] | None = None,
        trial: Callable[[Stages, Callable[[int], None]], None] | None = None,
    ) -> None:
        self._settings, self._observer, self._progress, self._trial = settings, observer, progress, trial
        self._static = settings.quasi_static

    def solve(self, stages: Stages, record: WindowRecord, number: int) -> Iterate:
        """Iterate from the q of the image; fills ``record`` and returns the accepted (else the best) iterate, which is
        the last one of the image then."""
        settings, static = self._settings, self._static
        best: Iterate | None = None
        phase, before = 0, len(record.fallbacks)
        limit, iteration, steps = record.iterations + settings.max_iterations, 0, 0
        slide: Slide | None = None
        accelerated, relaxed = settings.anderson_depth > 0, settings.anderson_depth == 0
        while True:
            stages.evaluate(iteration)
            measures = stages.measures()
            record.error_indicator.append(float(measures[0]))
            record.force_mismatch.append(float(measures[1]))
            found = stages.judge(phase, iteration, accelerated and not relaxed)
            if found & (BEST | CONVERGED) or best is None:
                best, record.accepted = stages.iterate(), record.iterations - 1
            self._report(number, record, stages)
            iteration += 1
            if found & CONVERGED:
                record.converged = True
                return best
            if found & BROKEN:
                break
            exhausted = record.iterations >= limit
            patient = static and relaxed  # a body may take many equal steps back to where it sticks
            if not exhausted and (patient or not found & STALLED):
                self._step(stages, steps, slide, relaxed and record.fallbacks[before:] != [])
                steps += 1
                continue
            fallback = self._fallback(stages, record.fallbacks[before:], exhausted)
            if fallback is None:
                break
            record.fallbacks.append(fallback)
            phase, steps = iteration, 0
            relaxed = fallback == RELAXED or settings.anderson_depth == 0
            if fallback == NEWTON:
                self._newton(stages, best, record)
                limit = record.iterations + settings.max_iterations
            elif fallback == RELAXED:
                slide = Slide(stages.direction.metric) if static else None
                stages.put(best)
                self._step(stages, 0, slide, True)
            else:
                limit = record.iterations + _AFTER_LAST
                self._point_by_point(stages, best)
        stages.put(best)
        return best

    def _step(self, stages: Stages, steps: int, slide: Slide | None, halved: bool) -> None:
        """The next q of the image."""
        if halved:
            factor = 0.5 if slide is None else slide.factor(stages.field("r"))
            stages.field("q")[...] += factor * stages.field("r")
        else:
            stages.image.call(entries.NEXT, stages.n, steps)

    def _fallback(self, stages: Stages, used: list[str], exhausted: bool) -> str | None:
        """The next fall-back, None when there is none left."""
        if self._static and NEWTON not in used and self._settings.max_iterations >= PATIENCE:
            return NEWTON
        if RELAXED not in used and not exhausted:
            return RELAXED
        wanted = self._settings.max_iterations >= PATIENCE  # fewer: the iteration is studied, no solution is wanted
        # without inertia a floating body has no admittance, which the solution point by point needs
        wanted = wanted and stages.n == 1 and not self._static
        return POINT_BY_POINT if wanted and POINT_BY_POINT not in used else None

    def _point_by_point(self, stages: Stages, best: Iterate) -> None:
        """q of the solution point by point."""
        image, direction = stages.image, stages.direction
        image.call(entries.FREE_MOTION, stages.first)
        free = image.field("w", image.n_flat).copy()
        reaches = [
            image.group_field(g, "reach", group.n_point, group.n_component if group.behaviour.elastic else 1).copy()
            for g, group in enumerate(direction.assembly.layout.groups)
        ]
        rates = float(1.0 / image.run[0]["dt"]), float(image.run[0]["layer_rate"])
        f_hat, w_hat = direction.points.solve(free, best.f_hat[0], reaches, rates)
        stages.field("q")[0] = direction.incoming(f_hat, w_hat)

    def _newton(self, stages: Stages, best: Iterate, record: WindowRecord) -> None:
        """q after Newton's method; each of its products counts as an iteration."""

        def evaluate(q: Array) -> tuple[Array, Array]:
            stages.field("q")[...] = q
            stages.evaluate(1)
            measures = stages.measures()
            record.error_indicator.append(float(measures[0]))
            record.force_mismatch.append(float(measures[1]))
            return stages.field("q").copy(), stages.field("r").copy()

        settings, direction = self._settings, stages.direction
        weight = np.where(direction.k > 0, np.sqrt(direction.metric), 0.0)
        stages.field("q")[...] = newton(evaluate, best.q, weight, settings.tolerance, _NEWTON * settings.max_iterations)

    def _report(self, number: int, record: WindowRecord, stages: Stages) -> None:
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
