"""Scenes of the tests: shipped ones, solved once for a whole session, and tables of ``latin_fmu.stability.scenes``."""

from __future__ import annotations

import copy
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import latin_fmu
from latin_fmu.stability.scenes import Description

MODELS = Path(__file__).parents[1] / "models"


def solve(description: Description, converged: bool = True) -> latin_fmu.Solution:
    """Solve a description, which stays as it is; ``converged`` : whether it must."""
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(copy.deepcopy(description)))
    assert solution.converged is converged, solution.status
    return solution


@cache
def solved(model: str, *overrides: str) -> latin_fmu.Solution:
    """Solution of ``models/<model>.toml`` with overrides; must converge."""
    solution = latin_fmu.solve(latin_fmu.load_scene(MODELS / f"{model}.toml", overrides))
    assert solution.converged, solution.status
    return solution


def pressure(solution: latin_fmu.Solution, interface: str) -> np.ndarray:
    """Mean contact pressure over the face, (n_time,), Pa."""
    history = solution.interfaces[interface]
    mean: np.ndarray = history.normal_resultant() / history.areas.sum()
    return mean


def ramp(*points: tuple[float, float]) -> dict[str, Any]:
    """Table law through (time, value) points."""
    return {"type": "table", "times": [t for t, _ in points], "values": [v for _, v in points]}
