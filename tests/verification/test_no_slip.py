"""no_slip under pressure is a perfect bond in motion too, whatever gaps of the size of a rounding error there are."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

import latin_fmu


def pressed(behaviour: str, scheme: str) -> dict[str, Any]:
    """Two blocks under a dead pressure, in equilibrium; then a shear shock that the pressure outlasts."""
    box = {"size": [0.02, 0.02, 0.01], "elements": [3, 3, 2]}
    return {
        "name": "pressed",
        "material": {"steel": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}},
        "substructure": {
            "lower": {"material": "steel", "box": box},
            "upper": {"material": "steel", "box": {**box, "origin": [0.0, 0.0, 0.01]}},
        },
        "interface": {"meet": {"sides": ["lower.zmax", "upper.zmin"], "behaviour": behaviour}},
        "boundary": {"base": {"type": "fixed", "face": "lower.zmin"}},
        "load": {
            "press": {"face": "upper.zmax", "pressure": 100e6},
            "shock": {
                "face": "upper.zmax",
                "traction": [1e7, 4e6, 0.0],
                "law": {"type": "half_sine", "duration": 5e-6},
            },
        },
        "time": {"end": 1.5e-5, "instants": 75, "start": "static", "scheme": scheme},
        "output": {"fields": True},
        "solver": {"tolerance": 1e-8},
    }


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
