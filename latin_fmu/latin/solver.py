"""The LATIN loop over one window from Python, with its fall-backs.

solver
------
The LATIN loop over one window from Python, with its fall-back chain.

The stages are those of ``kernels.iteration``, called one by one: for observers, laws written in Python, factors that
the kernels do not hold, and windows in which the iteration stalls. A stalled acceleration is followed by Newton's
method (without inertia), by relaxation 1/2 from the best iterate, and in windows of one instant by a solution point by
point. A window that does not converge returns its best iterate, which need not be the last.

newton
------
Newton-Krylov steps on the fixed point of the iteration, where the acceleration stalls (quasi-static mode).

A front of slip that runs along a slender body moves a few points per iteration, and every point that changes its state
spoils the memory of the acceleration. The residual r(q) = F_hat + k W_hat - q of one iteration is piecewise smooth, so
that Newton's method settles stick, slip and opening in about ten steps,

    J dq = -r(q),   J x by the difference of two iterations,   GMRES in the norm of the iteration,

with the step halved until the residual falls. Every product with J is one iteration: nothing is factorised, and any
interface behaviour will do.

approach
--------
First guesses without inertia: loads that turn, bodies that travel far before they touch.

The velocities of the last increment are a good guess as long as the loads go on as they did. Where the loads turn or
stop, these velocities have the wrong sign at sliding points: ``run_image.continuation`` is the share of them that the
guess keeps.

An iteration moves a body that is not held yet by the load over k. Where that is a small part of the gap to close, many
iterations are needed, and the differences of their residuals are useless to the acceleration. On springs soft enough to
cross the gap at once, k = load / gap, the strains of the bodies are negligible: a few iterations of the same loop find
the faces in contact. Their tractions and velocities are the first guess of the loop with the right k.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from ..kernels import entries
from ..kernels.iteration import BEST, BROKEN, CONVERGED, PATIENCE, STALLED
from ..propagator.image import Image
from .assembly import Array, Assembly
from .record import WindowRecord
from .run_image import Iterate, Stages, rules
from .search_direction import Direction
from .settings import Settings

RELAXED, POINT_BY_POINT, NEWTON = "relaxation 1/2", "points one after the other", "Newton-Krylov"
_NEWTON = 3  # iterations of the Newton-Krylov fall-back, in max_iterations
_AFTER_LAST = 20  # iterations after the last fall-back


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


Evaluate = Callable[[Array], tuple[Array, Array]]
"""q (1, n_flat) -> q as it acts, and its residual."""

_STEPS, _KRYLOV, _HALVINGS = 25, 60, 6
_LINEAR, _DIFFERENCE = 1e-2, 1e-7
_FALLS, _STUCK = (
    0.1,
    0.98,
)  # part of the linear decrease asked for; residual over the one before that ends the attempt
_ENOUGH = 0.01  # residual over the size of q, in units of the tolerance


def newton(evaluate: Evaluate, q: Array, weight: Array, tolerance: float, budget: int) -> Array:
    """The q with the smallest residual that was found.

    Parameters
    ----------
    q : (1, n_flat) first iterate. weight : (n_flat,) square root of area / k, 0 where there is nothing to find.
    tolerance : of the window. budget : iterations after which no new step is begun.
    """
    free = weight > 0
    spent = 0

    def at(trial: Array) -> tuple[Array, Array]:
        nonlocal spent
        spent += 1
        return evaluate(trial)

    def size(x: Array) -> float:
        return float(np.linalg.norm(weight * x))

    q, r = at(q)
    for _ in range(_STEPS):
        before = size(r)
        if before <= _ENOUGH * tolerance * size(q) or not np.isfinite(before) or spent > budget:
            break
        step = np.zeros_like(q)
        step[0, free] = _linear(at, q, r, weight, free)
        best: tuple[float, Array, Array] | None = None
        for halving in range(_HALVINGS):
            length = 0.5**halving
            trial, rest = at(q + length * step)
            if best is None or size(rest) < best[0]:
                best = size(rest), trial, rest
            if size(rest) <= (1 - _FALLS * length) * before:
                break
        assert best is not None
        if best[0] < before:
            q, r = best[1], best[2]
        if best[0] > _STUCK * before:
            break
    return q


def _linear(at: Evaluate, q: Array, r: Array, weight: Array, free: NDArray[np.bool_]) -> Array:
    """Newton's step on the free unknowns."""
    scale, image = weight[free], q + r
    reference = float(np.linalg.norm(weight * q))

    def product(x: Array) -> Array:
        length = float(np.linalg.norm(x))
        if length == 0.0:
            return np.zeros_like(x)
        step = np.zeros_like(q)
        epsilon = _DIFFERENCE * max(reference, np.finfo(float).tiny) / length
        step[0, free] = epsilon * x / scale
        moved, rest = at(q + step)
        change: Array = scale * ((moved + rest) - image)[0, free] / epsilon - x
        return change

    n = len(scale)
    operator = spla.LinearOperator((n, n), matvec=product, dtype=float)
    x, _ = spla.gmres(operator, -scale * r[0, free], rtol=_LINEAR, restart=_KRYLOV, maxiter=1)
    found: Array = x / scale
    return found


APPROACH = "a first look on soft springs"
_FAR = 0.3  # the load crosses less than this part of the largest gap in one iteration
_ROUGHLY, _ITERATIONS = 1e-2, 12
_SOFT = -1  # the soft search direction among those of the image


def softening(assembly: Assembly, k: Array, gaps: list[Array]) -> float | None:
    """Factor on k (n_flat,) that lets the loads close the largest gap at once; None where k does."""
    gap = max((float(g.max(initial=0.0)) for g in gaps), default=0.0)
    if gap <= 0.0 or assembly.characteristic_traction <= 0.0:
        return None
    crossed = assembly.characteristic_traction / float(k.max()) * assembly.dt / gap
    return crossed if crossed < _FAR else None


def second_guess(
    assembly: Assembly, settings: Settings, image: Image, stages: Stages, f_hat: Array, gaps: list[Array]
) -> tuple[str, Array]:
    """Guess after one from which the iteration has not converged: a name and q (n_flat,) of the next increment.

    From rest with the last tractions ``f_hat``; where the gap to close is large, from a first run of the iteration on
    soft springs, which leaves propagators and image bound to the soft direction.
    """
    direction = stages.direction
    factor = softening(assembly, direction.k, gaps)
    if factor is None:
        return "from rest", f_hat
    wanted = replace(settings.search_direction, factor=factor * settings.search_direction.factor)
    rough = replace(
        settings,
        search_direction=wanted,
        tolerance=max(_ROUGHLY, settings.tolerance),
        force_tolerance=np.inf,
        max_iterations=_ITERATIONS,
    )
    soft = Direction(assembly, rough, 1)
    soft.bind()
    image.bind(_SOFT, soft.run_fields(), soft.group_fields(), afresh=True)
    image.set(rules(rough))
    looking = Stages(image, soft, 1, stages.first)
    for c in range(len(image.propagators)):
        image.predict(c, stages.first)
    image.call(entries.OPEN, 1, stages.first - 1)
    looking.field("q")[...] = 0.0
    found = WindowSolver(rough).solve(looking, WindowRecord(stages.first, stages.first), 0)
    image.set(rules(settings))
    return APPROACH, direction.incoming(found.f_hat[0], found.w_hat[0])
