"""Error of a march by modes, told by a second one in steps twice as long with fewer modes.

Both marches leave out what modes above their cut-off and shorter steps would add. With cut-off and step both at a ratio
of two an error of order p is the change from one to the other over 2^p - 1. Exact modes with static responses of those
left out are of order two in both; 2^p - 1 = 2 is taken, since contacts that open and slide are of less. The friction
work has the work of the errors of the iteration besides, which both share.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ..latin.outcome import Outcome
from ..results.quantities_of_interest import FRICTION_WORK, PEAK_FORCE_RAW, definition_of
from ..results.solution import Solution
from ..scene.schema import Scene
from .estimate import relative
from .quantities import Quantities, measure_solution

_CHANGE: Final = 2.0  # change of a quantity over its error (module docstring)


@dataclass(frozen=True)
class ReductionError:
    """Error of a march by modes.

    Attributes
    ----------
    errors : relative, by quantity (``accuracy.quantities``). fine, coarse : quantities of both marches.
    """

    errors: dict[str, float]
    fine: Quantities
    coarse: Quantities

    @property
    def largest(self) -> tuple[str, float]:
        """The quantity with the largest error, and that; infinite where one cannot be told."""
        if not self.errors:
            return "", np.inf
        name = max(self.errors, key=lambda q: np.nan_to_num(self.errors[q], nan=np.inf))
        return name, float(np.nan_to_num(self.errors[name], nan=np.inf))

    def in_words(self) -> str:
        """The largest error and its quantity."""
        name, error = self.largest
        return f"{100.0 * error:.2g} % ({name})" if np.isfinite(error) else f"not known ({name or 'no quantity'})"


def reduction_error(scene: Scene, fine: Solution, coarse: Solution) -> ReductionError:
    """Error of a march by modes, from one in longer steps with fewer modes.

    scene : of both. fine, coarse : the marches.
    """
    first, second = measure_solution(scene, fine), measure_solution(scene, coarse)
    asked = [q for q in first.values if definition_of(q) is not PEAK_FORCE_RAW]
    errors = {q: relative(q, first, first, second) / _CHANGE for q in asked}
    share = _work_of_errors(fine.outcome)
    for quantity in asked:
        if definition_of(quantity) is FRICTION_WORK:
            errors[quantity] += share
    return ReductionError(errors, first, second)


def _work_of_errors(outcome: Outcome) -> float:
    """Work of the errors of the iteration over what friction takes; 0 where energies are not followed."""
    energy = outcome.energy
    if energy is None or "drift_work" not in energy:
        return 0.0
    friction = float(np.abs(energy["friction_dissipation"]).max(initial=0.0))
    return float(np.abs(energy["drift_work"]).max(initial=0.0)) / friction if friction > 0.0 else 0.0
