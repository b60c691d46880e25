"""A small valid scene as a dictionary, fresh for each test."""

from __future__ import annotations

from typing import Any

import pytest

from latin_fmu.stability.scenes import STEEL, Box, column, half_sine


@pytest.fixture
def small() -> dict[str, Any]:
    """Two bars with a gap, one of each kind of table."""
    bar = Box(STEEL, (0.1, 0.1, 1.0), (1, 1, 10))
    return column(
        {"left": bar, "right": bar},
        {"meet": {"friction_coefficient": 0.2}},
        {"end": 1e-3, "step": 1e-5},
        name="small",
        boundary={"held": {"type": "fixed", "face": "right.zmax"}},
        load={"push": {"face": "left.zmin", "pressure": 1e6, "law": half_sine(1e-4)}},
        solver={"search_direction": "automatic", "window": "whole"},
    )
