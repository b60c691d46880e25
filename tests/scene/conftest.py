"""A small valid scene as a dictionary, fresh for each test."""

from __future__ import annotations

from typing import Any

import pytest


def _box(z: float) -> dict[str, Any]:
    return {"origin": [0.0, 0.0, z], "size": [0.1, 0.1, 1.0], "elements": [1, 1, 10]}


@pytest.fixture
def small() -> dict[str, Any]:
    """Two bars with a gap, one of each kind of table."""
    return {
        "name": "small",
        "material": {"steel": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}},
        "substructure": {
            "left": {"material": "steel", "box": _box(0.0)},
            "right": {"material": "steel", "box": _box(1.0)},
        },
        "interface": {"meet": {"sides": ["left.zmax", "right.zmin"], "friction_coefficient": 0.2}},
        "boundary": {"held": {"type": "fixed", "face": "right.zmax"}},
        "load": {"push": {"face": "left.zmin", "pressure": 1e6, "law": {"type": "half_sine", "duration": 1e-4}}},
        "time": {"end": 1e-3, "step": 1e-5},
        "solver": {"search_direction": "automatic", "window": "whole"},
    }
