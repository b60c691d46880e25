"""First guess for bodies that travel far before they touch, without inertia.

An iteration moves a body that nothing holds yet by the load over k. Where that is a small part of the gap to close, the
iteration crawls and its acceleration misleads it. On springs soft enough to cross the gap at once, k = load / gap, all
bodies are as good as rigid: the same loop tells in a few iterations who meets whom, and its tractions and velocities
are the guess that the loop with the right k starts from.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

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


def approach(
    assembly: Assembly,
    settings: Settings,
    factor: float,
    q: Array,
    opening: Opening,
    scales: Scales,
    timings: Timings,
) -> tuple[Array, Array]:
    """F_hat and W_hat (1, n_flat) of the next increment on springs softened by ``factor``, started from ``q``.

    The propagators are left bound to the soft direction.
    """
    wanted = replace(settings.search_direction, factor=factor * settings.search_direction.factor)
    rough = replace(settings, search_direction=wanted, tolerance=max(_ROUGHLY, settings.tolerance),
                    force_tolerance=np.inf, max_iterations=_ITERATIONS)  # fmt: skip
    direction = Direction(assembly, rough, 1)
    direction.bind()
    stage = GlobalStage(assembly, direction.k, 1, direction.coarse)
    instant = assembly.propagators[0].state.instant + 1
    found = WindowSolver(direction, rough, timings).solve(
        stage, q, opening, scales, WindowRecord(instant, instant), 0
    )
    stage.rewind()
    return found.f_hat, found.w_hat
