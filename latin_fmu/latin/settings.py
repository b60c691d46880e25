"""Settings of the iteration, and the tolerance that belongs to a relative accuracy."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from ..scene.quantity_table import ITERATION_ERROR

ITERATION_SHARE: Final = 0.1
"""Share of the error that the iteration may cause; mesh and time step cause the rest."""

_DIGITS = 12  # a tolerance that is converted to an accuracy and back stays the same to the last bit


@dataclass(frozen=True)
class SearchDirection:
    """The search direction of the scene: ``kind`` as in ``latin.search_direction``, ``factor`` multiplying k, and for
    "uniform" the normal and tangential values, Pa s m-1."""

    kind: str = "automatic"
    factor: float = 1.0
    normal: float = 0.0
    tangential: float = 0.0


@dataclass(frozen=True)
class SolverSettings:
    """Settings of a run.

    Attributes
    ----------
    tolerance : on sqrt(eta). force_tolerance : on the interface force residual.
    max_iterations : LATIN iterations per window.
    search_direction : see ``SearchDirection``.
    anderson_depth : 0 for no acceleration. relaxation : in (0, 1].
    window : instants per window, 0 for the whole interval.
    quasi_static : no inertia.
    direct_bonds : where all interfaces are perfect, windows of one instant are one linear solve each.
    threads : of the march.
    skip_unchanged : reuse the previous solve of a substructure whose interface load has not changed.
    newton : end windows of one instant in which the iteration is slow by Newton steps.
    residual_alone : tolerances are met by the residuals of an iterate alone, whatever work they do and however many
        iterations there were: of a model whose own error is larger than what an iterate leaves.
    tables : largest share of the entries of a large interface up to which the iteration takes a sparse table of them
        (``propagator.interface_probing``); 0: never.
    sequential_start : a window of several instants starts from the solution of windows of one instant (else from its
        initial values).
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
    newton: bool = True
    residual_alone: bool = False
    tables: float = 0.0


def tolerance_for(accuracy: float, iteration_error: float = ITERATION_ERROR) -> float:
    """Tolerance on sqrt(eta) with which the iteration causes a tenth of a relative error ``accuracy``.

    >>> tolerance_for(0.01)
    0.002
    """
    return float(f"{ITERATION_SHARE * accuracy / iteration_error:.{_DIGITS}g}")


def accuracy_of(tolerance: float, iteration_error: float = ITERATION_ERROR) -> float:
    """Relative error a tenth of which a tolerance on sqrt(eta) causes: the inverse of ``tolerance_for``.

    >>> accuracy_of(0.001)
    0.005
    """
    return float(f"{tolerance * iteration_error / ITERATION_SHARE:.{_DIGITS}g}")
