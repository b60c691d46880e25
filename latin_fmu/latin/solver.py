"""The LATIN loop over one window from Python, with its fall-backs.

The stages are those of ``kernels.iteration``, called one by one: for observers, laws written in Python, factors that
the kernels do not hold, and windows in which the iteration stalls. A stalled acceleration is followed by Newton's
method (without inertia), by relaxation 1/2 from the best iterate, and in windows of one instant by a solution point by
point. A window that does not converge returns its best iterate, which need not be the last.

Newton's method, without inertia: a front of slip that runs along a slender body moves a few points per iteration, and
every point that changes its state makes the stored differences of the acceleration useless. The residual
r(q) = F_hat + k W_hat - q of one iteration is piecewise smooth, so that Newton's method settles stick, slip and opening
in about ten steps,

    J dq = -r(q),   J x by the difference of two iterations,   GMRES in the norm of the iteration,

with the step halved until the residual decreases. Every product with J is one iteration: nothing is factorised, and
any interface behaviour is admitted.

Softened start, without inertia, where a gap is large: one iteration moves a body that is not held yet by the load over
k. Where that is a small part of the gap, many iterations are needed, and the differences of their residuals are useless
to the acceleration. With a search direction soft enough to close the gap at once, k = load / gap, the strains of the
bodies are negligible: a few iterations of the same loop give the faces in contact. Their tractions and velocities are
the first guess of the loop with the regular k.
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
SOFTENED, FROM_REST = "softened start", "start from rest"
_NEWTON_BUDGET = 3  # iterations of Newton's method, in max_iterations
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
    """

    def __init__(
        self,
        settings: Settings,
        observer: Observer | None = None,
        progress: Callable[[int, float], None] | None = None,
        trial: Callable[[Stages, Callable[[int], None]], None] | None = None,
    ) -> None:
        self._settings, self._observer, self._progress, self._trial = settings, observer, progress, trial

    def solve(self, stages: Stages, record: WindowRecord, number: int) -> Iterate:
        """Iterate from the q of the image; fills ``record`` and returns the accepted (else the best) iterate, which is
        the last one of the image then."""
        settings, used = self._settings, list[str]()
        best: Iterate | None = None
        limit, phase, iteration = record.iterations + settings.max_iterations, 0, 0
        while True:
            self._evaluate(stages, record, iteration)
            accelerated = settings.anderson_depth > 0 and used[-1:] != [RELAXED]
            verdict = stages.judge(phase, iteration, accelerated)
            if verdict & (BEST | CONVERGED) or best is None:
                best, record.accepted = stages.iterate(), record.iterations - 1
            self._report(number, record, stages)
            iteration += 1
            if verdict & CONVERGED:
                record.converged = True
                return best
            if verdict & BROKEN:
                break
            exhausted = record.iterations >= limit
            # without inertia a body may take many equal steps back to where it sticks
            patient = settings.quasi_static and not accelerated
            if not exhausted and (patient or not verdict & STALLED):
                self._next(stages, iteration - 1 - phase, used)
                continue
            fallback = self._fallback(stages, used, exhausted)
            if fallback is None:
                break
            used.append(fallback)
            record.fallbacks.append(fallback)
            phase = iteration
            if fallback == NEWTON:
                self._newton(stages, best, record)
                limit = record.iterations + settings.max_iterations
            elif fallback == RELAXED:
                stages.put(best)
                self._next(stages, 0, used)
            else:
                limit = record.iterations + _AFTER_POINTS
                self._point_by_point(stages, best)
        stages.put(best)
        return best

    @staticmethod
    def _evaluate(stages: Stages, record: WindowRecord, iteration: int) -> None:
        """One iteration from the q of the image; its measures go to ``record``."""
        stages.evaluate(iteration)
        measures = stages.measures()
        record.error_indicator.append(float(measures[0]))
        record.force_mismatch.append(float(measures[1]))

    def _next(self, stages: Stages, steps: int, used: list[str]) -> None:
        """The next q of the image, ``steps`` made since the start or the last fall-back."""
        if used and (used[-1] == RELAXED or self._settings.anderson_depth == 0):
            stages.field("q")[...] += 0.5 * stages.field("r")
        else:
            stages.image.call(entries.NEXT, stages.n, steps)

    def _fallback(self, stages: Stages, used: list[str], exhausted: bool) -> str | None:
        """The next fall-back, None when there is none left."""
        static = self._settings.quasi_static
        enough = self._settings.max_iterations >= PATIENCE  # fewer: a study of the iteration, not of its solution
        if static and NEWTON not in used and enough:
            return NEWTON
        if RELAXED not in used and not exhausted:
            return RELAXED
        # without inertia a floating body has no admittance, which the solution point by point needs
        usable = enough and stages.n == 1 and not static
        return POINT_BY_POINT if usable and POINT_BY_POINT not in used else None

    def _point_by_point(self, stages: Stages, best: Iterate) -> None:
        """Set q by the solution point by point, from the tractions of the best iterate."""
        image, direction = stages.image, stages.direction
        image.call(entries.FREE_MOTION, stages.first)
        free = image.field("w", image.n_flat).copy()
        gaps = [
            image.group_field(g, "reach", group.n_point, group.n_component if group.behaviour.elastic else 1).copy()
            for g, group in enumerate(direction.assembly.layout.groups)
        ]
        rates = float(1.0 / image.run[0]["dt"]), float(image.run[0]["layer_rate"])
        f_hat, w_hat = direction.points.solve(free, best.f_hat[0], gaps, rates)
        stages.field("q")[0] = direction.incoming(f_hat, w_hat)

    def _newton(self, stages: Stages, best: Iterate, record: WindowRecord) -> None:
        """Set q by Newton's method from the best iterate; each of its products counts as an iteration."""

        def evaluate(q: Array) -> tuple[Array, Array]:
            stages.field("q")[...] = q
            self._evaluate(stages, record, 1)
            return stages.field("q").copy(), stages.field("r").copy()

        settings, direction = self._settings, stages.direction
        weight = np.where(direction.k > 0, np.sqrt(direction.metric), 0.0)
        budget = _NEWTON_BUDGET * settings.max_iterations
        stages.field("q")[...] = newton(evaluate, best.q, weight, settings.tolerance, budget)

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


Evaluate = Callable[[Array], tuple[Array, Array]]
"""q (1, n_flat) -> q after the coarse problem, and the residual of its iteration."""

_STEPS, _KRYLOV, _HALVINGS = 25, 60, 6
_LINEAR, _DIFFERENCE = 1e-2, 1e-7
_DECREASE = 0.1  # share of the linear decrease that a step has to give
_STUCK = 0.98  # residual over the one before that ends the method
_SMALL = 0.01  # residual over the size of q that ends the method, in units of the tolerance


def newton(evaluate: Evaluate, q: Array, weight: Array, tolerance: float, budget: int) -> Array:
    """Iterate q (1, n_flat) with the smallest residual of a damped Newton-Krylov method.

    Parameters
    ----------
    q : (1, n_flat) first iterate. weight : (n_flat,) square root of area / k, 0 where there is no unknown.
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
        if before <= _SMALL * tolerance * size(q) or not np.isfinite(before) or spent > budget:
            break
        step = np.zeros_like(q)
        step[0, free] = _newton_step(at, q, r, weight, free)
        best: tuple[float, Array, Array] | None = None
        for halving in range(_HALVINGS):
            length = 0.5**halving
            trial, rest = at(q + length * step)
            if best is None or size(rest) < best[0]:
                best = size(rest), trial, rest
            if size(rest) <= (1 - _DECREASE * length) * before:
                break
        assert best is not None
        if best[0] < before:
            q, r = best[1], best[2]
        if best[0] > _STUCK * before:
            break
    return q


def _newton_step(at: Evaluate, q: Array, r: Array, weight: Array, free: NDArray[np.bool_]) -> Array:
    """Newton's step on the free unknowns, by GMRES on differences of residuals."""
    scale, mapped = weight[free], q + r
    reference = float(np.linalg.norm(weight * q))

    def product(x: Array) -> Array:
        length = float(np.linalg.norm(x))
        if length == 0.0:
            return np.zeros_like(x)
        step = np.zeros_like(q)
        epsilon = _DIFFERENCE * max(reference, np.finfo(float).tiny) / length
        step[0, free] = epsilon * x / scale
        moved, rest = at(q + step)
        change: Array = scale * ((moved + rest) - mapped)[0, free] / epsilon - x
        return change

    n = len(scale)
    operator = spla.LinearOperator((n, n), matvec=product, dtype=float)
    x, _ = spla.gmres(operator, -scale * r[0, free], rtol=_LINEAR, restart=_KRYLOV, maxiter=1)
    step: Array = x / scale
    return step


_FAR = 0.3  # share of the largest gap that the load closes in one iteration, below which the start is softened
_SOFT_TOLERANCE, _SOFT_ITERATIONS = 1e-2, 12
_SOFT = -1  # key of the soft search direction in the image


def softening(assembly: Assembly, k: Array, gaps: list[Array]) -> float | None:
    """Factor on k (n_flat,) with which the loads close the largest gap at once; None where k does."""
    gap = max((float(g.max(initial=0.0)) for g in gaps), default=0.0)
    if gap <= 0.0 or assembly.characteristic_traction <= 0.0:
        return None
    crossed = assembly.characteristic_traction / float(k.max()) * assembly.dt / gap
    return crossed if crossed < _FAR else None


def softened_start(
    assembly: Assembly, settings: Settings, image: Image, stages: Stages, gaps: list[Array]
) -> Array | None:
    """First guess q (n_flat,) of an increment without inertia by a short iteration with a soft search direction, which
    stays bound to propagators and image; None where the loads close the gaps without it."""
    direction = stages.direction
    factor = softening(assembly, direction.k, gaps)
    if factor is None:
        return None
    search = replace(settings.search_direction, factor=factor * settings.search_direction.factor)
    rough = replace(
        settings,
        search_direction=search,
        tolerance=max(_SOFT_TOLERANCE, settings.tolerance),
        force_tolerance=np.inf,
        max_iterations=_SOFT_ITERATIONS,
    )
    soft = Direction(assembly, rough, 1)
    soft.bind()
    image.bind(_SOFT, soft.run_fields(), soft.group_fields(), afresh=True)
    image.set(rules(rough))
    window = Stages(image, soft, 1, stages.first)
    for c in range(len(image.propagators)):
        image.predict(c, stages.first)
    image.call(entries.OPEN, 1, stages.first - 1)
    window.field("q")[...] = 0.0
    iterate = WindowSolver(rough).solve(window, WindowRecord(stages.first, stages.first), 0)
    image.set(rules(settings))
    return direction.incoming(iterate.f_hat[0], iterate.w_hat[0])
