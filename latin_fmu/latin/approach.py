"""First guesses without inertia: loads that turn, bodies that travel far before they touch.

The velocities of the last increment are a good guess as long as the loads go on as they did. Where the loads turn or
stop, these velocities have the wrong sign at sliding points: ``run_image.continuation`` is the share of them that the
guess keeps.

An iteration moves a body that is not held yet by the load over k. Where that is a small part of the gap to close, many
iterations are needed, and the differences of their residuals are useless to the acceleration. On springs soft enough to
cross the gap at once, k = load / gap, the strains of the bodies are negligible: a few iterations of the same loop find
the faces in contact. Their tractions and velocities are the first guess of the loop with the right k.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..kernels import entries
from ..propagator.image import Image
from .assembly import Assembly
from .direction import Direction
from .layout import Array
from .record import WindowRecord
from .run_image import rules
from .settings import Settings
from .solver import Stages, WindowSolver

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
