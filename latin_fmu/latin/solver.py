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

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..kernels import entries
from ..kernels.instants import CORRECTED, WITHIN
from ..kernels.iteration import BEST, BROKEN, CONVERGED, PATIENCE
from ..propagator.image import Image
from .assembly import Array
from .outcome import WindowRecord
from .run_image import RELAXATION as _RELAXATION
from .run_image import Iterate, Stages, rules
from .search_direction import Direction
from .settings import Settings

RELAXED, POINT_BY_POINT = "relaxation 1/2", "point by point"
SOFTENED, FROM_REST = "softened start", "start from rest"
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
        settings: Settings,
        observer: Observer | None = None,
        progress: Callable[[int, float], None] | None = None,
        trial: Callable[[Stages, Callable[[int], None]], None] | None = None,
        fallbacks: bool = True,
    ) -> None:
        self._fallbacks = fallbacks
        self._settings, self._observer, self._progress, self._trial = settings, observer, progress, trial

    def solve_by_tables(self, stages: Stages, record: WindowRecord, number: int) -> bool:
        """Solve one instant as ``kernels.instants.march_instants`` does where tables of Y are taken; whether they end
        it."""
        begin, verdict, image = 0, CORRECTED, stages.image
        while verdict == CORRECTED:
            self.solve(stages, record, number, begin)
            if not record.converged or record.fallbacks:
                break
            image.counts("corrections", 1)[0] = record.corrections
            verdict, begin = image.call(entries.CORRECT, stages.first), record.iterations
            record.corrections = int(image.counts("corrections", 1)[0])
            record.defect = float(image.field("defects", 1)[0])
            record.converged = verdict == WITHIN
            if begin >= self._settings.max_iterations:
                break
        return record.converged

    def solve(self, stages: Stages, record: WindowRecord, number: int, begin: int = 0) -> Iterate:
        """Iterate from the q of the image, with ``begin`` iterations made before in this window under another
        reference; fills ``record`` and returns the accepted (else the best) iterate, which is the last one of the image
        then."""
        settings, used, kept, bits = self._settings, list[str](), list[Iterate](), 0

        def look(_: int, verdict: int, __: int) -> None:
            nonlocal bits
            bits, measures = verdict, stages.measures()
            record.error_indicator.append(float(measures[0]))
            record.force_mismatch.append(float(measures[1]))
            if verdict & (BEST | CONVERGED) or not kept:
                kept[:], record.accepted = [stages.iterate()], record.iterations - 1
            record.newton_steps = stages.newton_steps()
            self._report(number, record, stages)

        limit, phase, start = settings.max_iterations, begin, begin
        try:
            while True:
                stages.accelerate(settings, relaxed=used[-1:] == [RELAXED], again=bool(used))
                made = stages.iterations((begin, start, phase, limit), look)
                best, record.converged, start = kept[0], made > 0, abs(made)
                ended = record.converged or bits & BROKEN
                fallback = None if ended else self._fallback(stages, used, start >= limit)
                if fallback is None:
                    break
                used.append(fallback)
                stages.leave_newton()
                record.fallbacks.append(fallback)
                phase = start
                if fallback == RELAXED:
                    stages.put(best)
                    stages.field("q")[...] += _RELAXATION * stages.field("r")
                else:
                    limit = start + _AFTER_POINTS
                    stages.points_one_by_one(best.f_hat[0])
        finally:
            stages.accelerate(settings)
        if not record.converged:
            stages.put(best)
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
        return POINT_BY_POINT if usable and POINT_BY_POINT not in used else None

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
    crossed = assembly.characteristic_traction / float(direction.whole.k.max()) * assembly.dt / gap
    return crossed if crossed < _FAR else None


def softened_start(
    settings: Settings, image: Image, stages: Stages, gap: float, make: Callable[[Settings], Direction]
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
        force_tolerance=np.inf,
        max_iterations=_SOFT_ITERATIONS,
        newton=False,
    )
    soft = make(rough)
    soft.bind()
    image.bind(_SOFT, soft.run_fields(), soft.group_fields(), afresh=True)
    image.set(rules(rough))
    window = stages.of(soft)
    window.predict()
    window.begin()
    window.field("q")[...] = 0.0
    iterate = WindowSolver(rough).solve(window, WindowRecord(stages.first, stages.first), 0)
    image.set(rules(settings))
    return direction.incoming(iterate.f_hat[0], iterate.w_hat[0])
