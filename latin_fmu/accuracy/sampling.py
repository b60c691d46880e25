"""How well the time steps of a run sample its loads."""

from __future__ import annotations

import math

import numpy as np

from ..scene.laws import InputLaw, RectangularPulseLaw, StepLaw, sampled_impulse_error
from ..scene.schema import Scene


def sampling_error(scene: Scene, step: float | None = None) -> float:
    """Largest relative error of the impulse of a load sampled with a step (s; that of the scene where None).

    Loads that are inputs are not known and count as exact.
    """
    step = scene.time.time_step if step is None else step
    time = step * np.arange(math.ceil(scene.time.end / step - 1e-6) + 1)
    laws = [load.law for load in scene.load.values() if not isinstance(load.law, InputLaw)]
    return max((abs(sampled_impulse_error(law, time)) for law in laws), default=0.0)


def aligned(scene: Scene, factor: float) -> float:
    """A number of steps, relative to that of the scene, near ``factor`` (within 12 %) on which jumps of loads fall.

    A pulse that ends between two instants loses or gains up to half a step of impulse, which would be taken for an
    error of the run.
    """
    step = scene.time.time_step
    choices = [factor]
    for jump in _jumps(scene):
        first, last = math.ceil(0.88 * factor * jump / step), math.floor(1.12 * factor * jump / step)
        choices += [k * step / jump for k in range(max(first, 1), min(last, first + 100) + 1)]
    errors = np.round([sampling_error(scene, step / choice) for choice in choices], 6)
    best = np.flatnonzero(errors == errors.min())
    return min((choices[i] for i in best), key=lambda choice: abs(choice - factor))


def _jumps(scene: Scene) -> list[float]:
    """Instants inside the interval at which a load jumps, s."""
    found = set()
    for load in scene.load.values():
        if isinstance(load.law, StepLaw | RectangularPulseLaw):
            found.add(load.law.start)
        if isinstance(load.law, RectangularPulseLaw):
            found.add(load.law.start + load.law.duration)
    return sorted(t for t in found if 0.0 < t < scene.time.end)
