"""The coarser runs that tell the error of a run, and how far they can go on a given scene."""

from __future__ import annotations

from dataclasses import dataclass

from ..scene.schema import Scene
from .refinement import Resolution, counts_that_vary, meshed_by_the_program
from .sampling import aligned

_FEWEST_STEPS = 8


@dataclass(frozen=True)
class Companions:
    """Resolutions relative to the run.

    Attributes
    ----------
    half : mesh and time step about twice as coarse, at one ratio. quarter : about four times; None where the scene
        is too coarse for it. half_mesh : the mesh of ``half`` with the steps of the run; None where no mesh changes.
    remarks : what cannot be told.
    """

    half: Resolution
    quarter: Resolution | None
    half_mesh: Resolution | None
    remarks: tuple[str, ...]

    @property
    def ratios(self) -> tuple[float, float]:
        """How many times coarser in time ``half`` and ``quarter`` are."""
        return 1.0 / self.half.time, 4.0 if self.quarter is None else 1.0 / self.quarter.time


def companions_of(scene: Scene) -> Companions | None:
    """Coarser runs of a scene; None where it is too short to be coarsened at all."""
    if scene.time.n_step < 2 * _FEWEST_STEPS:
        return None
    counts = counts_that_vary(scene)
    if not meshed_by_the_program(scene):
        return _steps_only(scene, ("the mesh comes from a file: its share of the error is not estimated",))
    if not counts:
        return _steps_only(scene, ())
    first, second = reachable(counts, 0.5), reachable(counts, 0.25)
    half, quarter_steps = aligned(scene, first), aligned(scene, second)
    if first == 1.0:
        return _steps_only(scene, ("the mesh cannot be coarsened: its share of the error is not estimated",))
    quarter = None
    remarks: tuple[str, ...] = ()
    if second < 0.8 * first and scene.time.n_step * second >= _FEWEST_STEPS:
        quarter = Resolution(second, quarter_steps)
    else:
        remarks = ("too coarse for a third run: no order is observed",)
    return Companions(Resolution(first, half), quarter, Resolution(first, 1.0), remarks)


def _steps_only(scene: Scene, remarks: tuple[str, ...]) -> Companions:
    long = scene.time.n_step >= 4 * _FEWEST_STEPS
    quarter = Resolution(1.0, aligned(scene, 0.25)) if long else None
    return Companions(Resolution(1.0, aligned(scene, 0.5)), quarter, None, remarks)


def reachable(counts: list[int], factor: float) -> float:
    """The factor nearest to ``factor`` that leaves the largest number of elements whole.

    >>> reachable([6, 6], 0.25), reachable([5], 0.5)
    (0.3333333333333333, 0.6)
    """
    largest = max(counts)
    return max(1, int(largest * factor + 0.5)) / largest
