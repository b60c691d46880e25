"""Shipped scenes for the verification tests, solved once for a whole session."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import latin_fmu

MODELS = Path(__file__).parents[2] / "models"


@cache
def solved(model: str, *overrides: str) -> latin_fmu.Solution:
    """Solution of ``models/<model>.toml`` with overrides; must converge."""
    solution = latin_fmu.solve(latin_fmu.load_scene(MODELS / f"{model}.toml", overrides))
    assert solution.converged, solution.status
    return solution


def pressure(solution: latin_fmu.Solution, interface: str):
    """Mean contact pressure over the face, (n_time,), Pa."""
    history = solution.interfaces[interface]
    return history.normal_resultant() / history.areas.sum()
