"""Small scenes of the reduced model."""

from __future__ import annotations

from typing import Any

import numpy as np

import latin_fmu
from latin_fmu.model_exchange.contact_law import Modes
from latin_fmu.model_exchange.equations import Equations
from latin_fmu.scene.schema import Scene

SIZE, STEEL = 0.01, {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}


def pair(**changes: Any) -> Scene:
    """Two free blocks with friction between them; ``changes`` replace top-level tables."""
    box = {"size": [SIZE, SIZE, SIZE], "elements": [2, 2, 2]}
    data: dict[str, Any] = {
        "name": "pair",
        "material": {"steel": STEEL},
        "substructure": {
            "lower": {"material": "steel", "box": {"origin": [0.0, 0.0, 0.0], **box}},
            "upper": {"material": "steel", "box": {"origin": [0.0, 0.0, SIZE], **box}},
        },
        "interface": {"meet": {"sides": ["lower.zmax", "upper.zmin"], "friction_coefficient": 0.3}},
        "load": {
            "press": {
                "face": "upper.zmax",
                "pressure": 100e6,
                "law": {"type": "rectangular_pulse", "start": 1e-6, "duration": 2e-6},
            }
        },
        "time": {"end": 6e-6, "step": 0.2e-6},
        "output": {"energy": True},
    }
    return latin_fmu.scene_from_dict({**data, **changes})


def rods(behaviour: str = "perfect", **changes: Any) -> Scene:
    """Two rods in line (no Poisson effect), held at the bottom, pulled at the top by a constant traction."""
    box = {"size": [0.2, 0.1, 1.0], "elements": [1, 1, 6]}
    data: dict[str, Any] = {
        "name": "rods",
        "material": {"soft": {"young_modulus": 900.0, "poisson_ratio": 0.0, "density": 1.0}},
        "substructure": {
            "a": {"material": "soft", "box": {"origin": [0.0, 0.0, 0.0], **box}},
            "b": {"material": "soft", "box": {"origin": [0.0, 0.0, 1.0], **box}},
        },
        "interface": {"joint": {"sides": ["a.zmax", "b.zmin"], "behaviour": behaviour}},
        "boundary": {"base": {"type": "fixed", "face": "a.zmin"}},
        "load": {"pull": {"face": "b.zmax", "traction": [0.0, 0.0, 3.0]}},
        "sensor": {"top": {"substructure": "b", "point": [0.0, 0.0, 2.0]}},
        "time": {"end": 1.0, "instants": 100},
    }
    return latin_fmu.scene_from_dict({**data, **changes})


def thrown(**changes: Any) -> Scene:
    """A rod thrown at the ground."""
    data: dict[str, Any] = {
        "name": "thrown",
        "material": {"soft": {"young_modulus": 900.0, "poisson_ratio": 0.0, "density": 1.0}},
        "substructure": {
            "bar": {
                "material": "soft",
                "box": {"origin": [0.0, 0.0, 0.5], "size": [1.0, 1.0, 10.0], "elements": [1, 1, 30]},
                "initial_velocity": [0.0, 0.0, -10.0],
            }
        },
        "interface": {"wall": {"sides": ["bar.zmin", "ground"], "gap": 0.5}},
        "time": {"end": 1.0, "instants": 100},
    }
    return latin_fmu.scene_from_dict({**data, **changes})


def random_state(equations: Equations, seed: int) -> tuple[np.ndarray, Modes]:
    """States of the sizes expected, and the discrete states that go with them."""
    rng = np.random.default_rng(seed)
    while True:  # shapes have no sign of their own: whether a state presses is not known beforehand
        y = 0.1 * rng.normal(size=equations.n_state) * equations.nominals()
        modes = equations.modes_at(0.0, y)
        if modes.closed.any():
            return y, modes
