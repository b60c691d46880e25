"""Small scenes of the reduced model."""

from __future__ import annotations

from typing import Any

import numpy as np

import latin_fmu
from latin_fmu.model_exchange.equations import ContactModes, Equations
from latin_fmu.scene.schema import Scene
from latin_fmu.stability.scenes import STEEL, Box, Material, column

SIZE, SOFT = 0.01, Material(900.0, name="soft")


def pair(**changes: Any) -> Scene:
    """Two free blocks with friction between them; ``changes`` replace top-level tables."""
    block = Box(STEEL, (SIZE,) * 3, (2,) * 3)
    law = {"type": "rectangular_pulse", "start": 1e-6, "duration": 2e-6}
    data = column(
        {"lower": block, "upper": block},
        {"meet": {"friction_coefficient": 0.3}},
        {"end": 6e-6, "step": 0.2e-6},
        name="pair",
        load={"press": {"face": "upper.zmax", "pressure": 100e6, "law": law}},
        output={"energy": True},
    )
    return latin_fmu.scene_from_dict(data | changes)


def rods(behaviour: str = "perfect", **changes: Any) -> Scene:
    """Two rods in line (no Poisson effect), held at the bottom, pulled at the top by a constant traction."""
    rod = Box(SOFT, (0.2, 0.1, 1.0), (1, 1, 6))
    data = column(
        {"a": rod, "b": rod},
        {"joint": {"behaviour": behaviour}},
        {"end": 1.0, "instants": 100},
        name="rods",
        boundary={"base": {"type": "fixed", "face": "a.zmin"}},
        load={"pull": {"face": "b.zmax", "traction": [0.0, 0.0, 3.0]}},
        sensor={"top": {"substructure": "b", "point": [0.0, 0.0, 2.0]}},
    )
    return latin_fmu.scene_from_dict(data | changes)


def random_state(equations: Equations, seed: int) -> tuple[np.ndarray, ContactModes]:
    """States of the sizes expected, and the discrete states that go with them."""
    rng = np.random.default_rng(seed)
    while True:  # shapes have no sign of their own: whether a state presses is not known beforehand
        y = 0.1 * rng.normal(size=equations.n_state) * equations.nominals()
        modes = equations.modes_at(0.0, y)
        if modes.closed.any():
            return y, modes
