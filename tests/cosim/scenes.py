"""Small scenes for co-simulation tests: a second or less each."""

from __future__ import annotations

from typing import Any

import numpy as np

import latin_fmu
from latin_fmu.cosim import Session
from latin_fmu.scene.schema import Scene
from latin_fmu.stability.scenes import STEEL, Box, Material, column, half_sine


def blocks(**changes: Any) -> Scene:
    """Two blocks of 2 x 2 x 2 elements pressed together with friction; load ``press`` is set from outside.

    ``changes`` replace top-level tables.
    """
    block = Box(STEEL, (0.01,) * 3, (2,) * 3)
    data = column(
        {"lower": block, "upper": block},
        {"crush": {"friction_coefficient": 0.2}},
        {"end": 6e-6, "step": 0.2e-6},
        name="blocks",
        boundary={"base": {"type": "fixed", "face": "lower.zmin"}},
        load={
            "press": {"face": "upper.zmax", "pressure": 100e6, "law": {"type": "input", "start_value": 0.25}},
            "push": {"face": "upper.xmin", "traction": [10e6, 0.0, 0.0], "law": half_sine(9e-6)},
        },
        sensor={"head": {"substructure": "upper", "point": [0.005, 0.005, 0.02]}},
        output={"energy": True},
    )
    return latin_fmu.scene_from_dict(data | changes)


def bar(**changes: Any) -> Scene:
    """A bar of five elements thrown against a wall, no load from outside."""
    data = column(
        {"bar": Box(Material(900.0, name="soft"), (1.0, 1.0, 10.0), (1, 1, 5), (0.0, 0.0, -10.0))},
        {},
        {"end": 1.0, "instants": 50},
        name="thrown_bar",
        interface={"wall": {"sides": ["bar.zmin", "ground"], "gap": 0.5}},
    )
    data["substructure"]["bar"]["box"]["origin"][2] = 0.5
    return latin_fmu.scene_from_dict(data | changes)


def driven(session: Session, n: int) -> np.ndarray:
    """Amplitudes (n, n_source) that drove a session at the ends of the n time steps of its last step."""
    run = session._solver.run
    assert run is not None
    n_source, width = int(run.image.run[0]["n_source"]), int(run.image.run[0]["n_drive"])
    rows = run.image.field("drive", run.image.rows, width)[1 : n + 1]
    return rows[:, width - 1 - n_source : width - 1].copy()
