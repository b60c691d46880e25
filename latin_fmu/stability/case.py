"""What a hard case is: a promise, and numbers that must stay below limits."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..api import solve
from ..results.solution import Solution
from ..scene.reader import scene_from_dict

Description = dict[str, Any]
"""A scene as nested tables, as a scene file holds them."""


@dataclass(frozen=True)
class Measure:
    """One number of a case: it must be at most ``limit`` (a number that is not finite fails)."""

    what: str
    value: float
    limit: float

    @property
    def passed(self) -> bool:
        """Whether the limit is kept."""
        return math.isfinite(self.value) and self.value <= self.limit

    @property
    def margin(self) -> float:
        """Value over limit (infinite where a limit of zero is broken)."""
        if not math.isfinite(self.value):
            return math.inf
        if self.limit == 0:
            return 0.0 if self.value <= 0 else math.inf
        return self.value / self.limit


@dataclass
class Bench:
    """Solves the scenes of a case and counts what they cost."""

    iterations: list[int] = field(default_factory=list)
    fallbacks: int = 0

    def solve(self, description: Description, counted: bool = True) -> Solution:
        """Solution of a description, converged or not; ``counted``: its iterations go into the row."""
        solution = solve(scene_from_dict(copy.deepcopy(description)))
        if counted:
            self.iterations += [window.iterations for window in solution.windows]
            self.fallbacks += sum(bool(window.fallbacks) for window in solution.windows)
        return solution

    def converged(self, description: Description, counted: bool = True) -> Solution:
        """Same; raises ArithmeticError with the status where the run did not converge."""
        solution = self.solve(description, counted)
        if not solution.converged:
            raise ArithmeticError(solution.status)
        return solution


Check = Callable[[Bench], Sequence[Measure]]


@dataclass(frozen=True)
class Case:
    """One hard case.

    Attributes
    ----------
    name : family and parameters, e.g. "contrast E 1e4, bars". family : groups the rows of the report.
    promise : what must hold, one sentence. check : solves and measures. quick : part of the quick suite.
    """

    name: str
    family: str
    promise: str
    check: Check
    quick: bool = True


@dataclass(frozen=True)
class Row:
    """Outcome of one case.

    ``margin`` is the largest value over limit of its measures; ``iterations`` the largest number of LATIN
    iterations in a window, ``mean_iterations`` their mean, ``fallbacks`` the windows in which one was used.
    """

    case: str
    family: str
    asked: str
    measured: str
    passed: bool
    margin: float
    iterations: int
    mean_iterations: float
    fallbacks: int
    seconds: float
