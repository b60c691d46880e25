"""Settings of the iteration, as the scene gives them."""

from __future__ import annotations

from dataclasses import dataclass, field

from .search_direction import SearchDirection


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
