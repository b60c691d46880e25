"""First guesses without inertia: loads that turn, bodies that travel far before they touch.

The velocities of the last increment are a good guess as long as the loads go on as they did. Where they turn or stop
they would set everything sliding the wrong way: ``continuation`` tells how much of them to keep.

An iteration moves a body that nothing holds yet by the load over k. Where that is a small part of the gap to close, the
iteration crawls and its acceleration misleads it. On springs soft enough to cross the gap at once, k = load / gap, all
bodies are as good as rigid: the same loop tells in a few iterations who meets whom, and its tractions and velocities
are the guess that the loop with the right k starts from.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..propagator import StaticPropagator
from .assembly import Assembly
from .error_indicator import Scales
from .global_stage import GlobalStage
from .layout import Array
from .local_stage import Opening
from .record import Timings, WindowRecord
from .settings import Settings
from .solver import Direction, WindowSolver

APPROACH = "a first look on soft springs"
_FAR = 0.3  # the load crosses less than this part of the largest gap in one iteration
_ROUGHLY, _ITERATIONS = 1e-2, 12


def softening(assembly: Assembly, k: Array, opening: Opening) -> float | None:
    """Factor on k (n_flat,) that lets the loads close the largest gap at once; None where k does."""
    gap = max((float(g.max(initial=0.0)) for g in opening.gap), default=0.0)
    if gap <= 0.0 or assembly.characteristic_traction <= 0.0:
        return None
    crossed = assembly.characteristic_traction / float(k.max()) * assembly.dt / gap
    return crossed if crossed < _FAR else None


def second_guess(
    direction: Direction, settings: Settings, f_hat: Array, opening: Opening, scales: Scales, timings: Timings
) -> tuple[str, Array, Array]:  # fmt: skip
    """Where the first guess has led nowhere: a name, F_hat and W_hat (n_flat,) of the next increment.

    From rest with the last tractions ``f_hat``, or a first look on soft springs where there is far to travel. The
    propagators are left bound to ``direction``.
    """
    assembly = direction.assembly
    factor = softening(assembly, direction.k, opening)
    if factor is None:
        return "from rest", f_hat, np.zeros_like(f_hat)
    wanted = replace(settings.search_direction, factor=factor * settings.search_direction.factor)
    rough = replace(settings, search_direction=wanted, tolerance=max(_ROUGHLY, settings.tolerance),
                    force_tolerance=np.inf, max_iterations=_ITERATIONS)  # fmt: skip
    soft = Direction(assembly, rough, 1)
    soft.bind()
    stage = GlobalStage(assembly, soft.k, 1, soft.coarse)
    instant = assembly.propagators[0].state.instant + 1
    found = WindowSolver(soft, rough, timings).solve(
        stage, np.zeros((1, len(f_hat))), opening, scales, WindowRecord(instant, instant), 0
    )
    stage.rewind()
    direction.bind()
    return APPROACH, found.f_hat[0], found.w_hat[0]


def continuation(assembly: Assembly) -> float:
    """How far the next increment of the loads continues the last one: the part of it along the last, 0 ... 1."""
    instant = assembly.propagators[0].state.instant
    if instant == 0:  # the start of a run has no velocities, that of a segment goes on
        return 1.0
    along = size = change = 0.0
    for propagator in assembly.propagators:
        assert isinstance(propagator, StaticPropagator)
        before, last, coming = (propagator.forcing.at(i) for i in (instant - 1, instant, instant + 1))
        along += float(np.vdot(coming - last, last - before))
        size += float(np.vdot(last - before, last - before))
        change += float(np.vdot(coming - last, coming - last))
    ground = [float(np.vdot(v[instant + 1], v[instant])) for v in assembly.ground.values()]
    if size == 0.0 or change == 0.0:
        return float(any(g > 0.0 for g in ground))
    return min(max(along / size, 0.0), 1.0)
