"""Settings of the iteration; the tolerance that leaves a relative accuracy.

settings
--------
Settings of the iteration, as the scene gives them.

wanted_accuracy
---------------
From a relative accuracy to the tolerance of the iteration and back: one door for users and FMI hosts.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final


@dataclass(frozen=True)
class SearchDirection:
    """What the scene asks for: ``kind`` of the module docstring, ``factor`` multiplying k, and for "uniform" the
    normal and tangential values, Pa s m-1."""

    kind: str = "automatic"
    factor: float = 1.0
    normal: float = 0.0
    tangential: float = 0.0


@dataclass(frozen=True)
class Settings:
    """Settings of a run.

    Attributes
    ----------
    tolerance : on sqrt(eta). force_tolerance : on the force mismatch.
    max_iterations : LATIN iterations per window.
    search_direction : see ``search_direction``.
    anderson_depth : 0 for no acceleration. relaxation : in (0, 1].
    window : instants per window, 0 for the whole interval.
    quasi_static : no inertia.
    direct_bonds : windows of one instant with perfect interfaces only are solved without iteration.
    threads : cores for the substructures (windows of one instant).
    skip_unchanged : substructures are not asked again for what they have answered (``unchanged``).
    sequential_start : a window of several instants starts from a sequential pass (else from its initial values).
    """

    tolerance: float = 1e-3
    force_tolerance: float = 1e-2
    max_iterations: int = 200
    search_direction: SearchDirection = field(default_factory=SearchDirection)
    anderson_depth: int = 6
    relaxation: float = 1.0
    window: int = 1
    sequential_start: bool = True
    quasi_static: bool = False
    direct_bonds: bool = True
    threads: int = 1
    skip_unchanged: bool = True


ITERATION_SHARE: Final = 0.1
"""The iteration may leave this share of the error: mesh and time step leave the rest."""

LEFT: Final = 0.5
"""Relative error that the iteration leaves in an impulse, over the tolerance on sqrt(eta): the largest of eight scenes
at two resolutions, tolerances 1e-1 to 1e-4. Instants less, friction work up to 2 (table in ``results``)."""

_DIGITS = 12  # what a host is told and hands back gives the same tolerance to the last bit


def tolerance_for(accuracy: float, left: float = LEFT) -> float:
    """Tolerance on sqrt(eta) with which the iteration leaves a tenth of a relative ``accuracy``.

    >>> tolerance_for(0.01)
    0.002
    """
    return float(f"{ITERATION_SHARE * accuracy / left:.{_DIGITS}g}")


def accuracy_of(tolerance: float, left: float = LEFT) -> float:
    """The relative accuracy whose tenth a tolerance on sqrt(eta) leaves: the inverse of ``tolerance_for``.

    >>> accuracy_of(0.001)
    0.005
    """
    return float(f"{tolerance * left / ITERATION_SHARE:.{_DIGITS}g}")
