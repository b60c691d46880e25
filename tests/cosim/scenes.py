"""Small scenes for co-simulation tests: a second or less each."""

from __future__ import annotations

from typing import Any

import latin_fmu
from latin_fmu.scene.schema import Scene

STEEL = {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}


def blocks(**changes: Any) -> Scene:
    """Two blocks of 2 x 2 x 2 elements pressed together with friction; load ``press`` is set from outside.

    ``changes`` replace top-level tables.
    """
    size = {"size": [0.01, 0.01, 0.01], "elements": [2, 2, 2]}
    data: dict[str, Any] = {
        "name": "blocks",
        "material": {"steel": STEEL},
        "substructure": {
            "lower": {"material": "steel", "box": {"origin": [0.0, 0.0, 0.0], **size}},
            "upper": {"material": "steel", "box": {"origin": [0.0, 0.0, 0.01], **size}},
        },
        "interface": {"crush": {"sides": ["lower.zmax", "upper.zmin"], "friction_coefficient": 0.2}},
        "boundary": {"base": {"type": "fixed", "face": "lower.zmin"}},
        "load": {
            "press": {"face": "upper.zmax", "pressure": 100e6, "law": {"type": "input", "start_value": 0.25}},
            "push": {
                "face": "upper.xmin",
                "traction": [10e6, 0.0, 0.0],
                "law": {"type": "half_sine", "duration": 9e-6},
            },
        },
        "sensor": {"head": {"substructure": "upper", "point": [0.005, 0.005, 0.02]}},
        "time": {"end": 6e-6, "step": 0.2e-6},
        "output": {"energy": True},
    }
    return latin_fmu.scene_from_dict({**data, **changes})


def bar(**changes: Any) -> Scene:
    """A bar of five elements thrown against a wall, no load from outside."""
    data: dict[str, Any] = {
        "name": "thrown_bar",
        "material": {"soft": {"young_modulus": 900.0, "poisson_ratio": 0.0, "density": 1.0}},
        "substructure": {
            "bar": {
                "material": "soft",
                "box": {"origin": [0.0, 0.0, 0.5], "size": [1.0, 1.0, 10.0], "elements": [1, 1, 5]},
                "initial_velocity": [0.0, 0.0, -10.0],
            }
        },
        "interface": {"wall": {"sides": ["bar.zmin", "ground"], "gap": 0.5}},
        "time": {"end": 1.0, "instants": 50},
    }
    return latin_fmu.scene_from_dict({**data, **changes})
