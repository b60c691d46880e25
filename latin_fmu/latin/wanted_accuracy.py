"""From a relative accuracy to the tolerance of the iteration and back: one door for users and FMI hosts."""

from __future__ import annotations

from typing import Final

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
