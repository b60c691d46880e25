"""no_slip under pressure is a perfect bond in motion too, whatever gaps of the size of a rounding error there are."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.stability.scenes import STEEL, Box, column, half_sine


def pressed(behaviour: str, scheme: str) -> dict[str, Any]:
    """Two blocks under a dead pressure, in equilibrium; then a shear shock that the pressure outlasts."""
    block = Box(STEEL, (0.02, 0.02, 0.01), (3, 3, 2))
    return column(
        {"lower": block, "upper": block},
        {"meet": {"behaviour": behaviour}},
        {"end": 1.5e-5, "instants": 75, "start": "static", "scheme": scheme},
        boundary={"base": {"type": "fixed", "face": "lower.zmin"}},
        load={
            "press": {"face": "upper.zmax", "pressure": 100e6},
            "shock": {"face": "upper.zmax", "traction": [1e7, 4e6, 0.0], "law": half_sine(5e-6)},
        },
        output={"fields": True},
        solver={"tolerance": 1e-8},
    )


@pytest.mark.parametrize("scheme", ["hht", "newmark"])
def test_no_slip_under_pressure_is_a_bond(scheme: str) -> None:
    bonded, held = (
        latin_fmu.solve(latin_fmu.scene_from_dict(copy.deepcopy(pressed(behaviour, scheme))))
        for behaviour in ("perfect", "no_slip")
    )
    assert held.converged, held.status
    history = held.interfaces["meet"]
    assert history.traction[..., 2].max() < -2e7  # pressed everywhere and always
    shaken = bonded.substructures["upper"].velocity
    difference = held.substructures["upper"].velocity - shaken
    assert np.abs(difference).max() < 1e-5 * np.abs(shaken).max()
