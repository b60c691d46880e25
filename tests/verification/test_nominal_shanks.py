"""Two plates' worth of load on screws drawn at the nominal diameter and at the core of the thread."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from latin_fmu import scene_from_dict, solve
from latin_fmu.stability.surfaces import write_mesh

from .bolted_meshes import Array, Lattice, shank_radius

D, CORE = 5e-3, 4.01855e-3  # M5; d - 17/12 sqrt(3)/2 P by hand
HEAD, CLEARANCE, RIM = 0.85 * D, 0.55 * D, 2.0 * D  # radii
GRIP, NUT, HIGH = 1.2 * D, 1.2 * D, 0.8 * D  # heights of plate, nut and head
PULL = 80e6 * np.pi * CORE**2 / 4.0
PRELOAD = 2.5 * PULL
N_CORE = 3
LIMIT = 0.03
"""Of the difference of the shares of both screws."""


def _flat(height: float, up: float) -> Any:
    return lambda x, n: (np.abs(x[:, 2] - height) < 1e-7) & (n[:, 2] * up > 0.9)


def _under_head(x: Array, n: Array) -> Array:
    return np.asarray(_flat(GRIP, 1.0)(x, n) & (np.hypot(x[:, 0], x[:, 1]) < HEAD))


def _share(folder: Path, diameter: float, modulus: str) -> float:
    """Change of the tension of a tight screw over the load that pulls the plate away from under its head."""
    shank = shank_radius(np.pi * diameter**2 / 4.0, N_CORE)
    radii = [shank, *([0.5 * D] if diameter < D else []), CLEARANCE, 0.7 * D, HEAD, 1.3 * D, RIM]
    heights = [*np.linspace(-NUT, 0.0, 10)[:-1], *np.linspace(0.0, GRIP, 10), *np.linspace(GRIP, GRIP + HIGH, 6)[1:]]
    lattice = Lattice(radii, heights, n_core=N_CORE, n_first=2)
    parts = {
        "screw": lattice.part(lambda r, z: (r < shank) | ((r < HEAD) & (z > GRIP)), {"seat": _flat(GRIP, -1.0)}),
        "nut": lattice.part(
            lambda r, z: (r > shank) & (r < HEAD) & (z < 0.0), {"top": _flat(0.0, 1.0), "floor": _flat(-NUT, -1.0)}
        ),
        "plate": lattice.part(
            lambda r, z: (r > CLEARANCE) & (z > 0.0) & (z < GRIP), {"top": _under_head, "bottom": _flat(0.0, -1.0)}
        ),
    }
    for name, mesh in parts.items():
        write_mesh(folder / f"{name}.msh", mesh)
    sides = {"head": ["plate.top", "screw.seat"], "nut": ["nut.top", "plate.bottom"]}
    thread = {"size": "M5", "part": "nut", "modulus": modulus}
    scene = {
        "name": "share",
        "material": {"steel": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}},
        "substructure": {n: {"material": "steel", "mesh": {"file": str(folder / f"{n}.msh")}} for n in parts},
        "interface": {name: {"sides": pair, "friction_coefficient": 0.3} for name, pair in sides.items()},
        "boundary": {"floor": {"type": "fixed", "face": "nut.floor"}},
        "bolt": {"m5": {"substructure": "screw", "axis": [0.0, 0.0, 1.0], "force": PRELOAD, "thread": thread}},
        "load": {
            "pull": {
                "face": "plate.top",
                "force": [0.0, 0.0, PULL],
                "law": {"type": "table", "times": [0, 1], "values": [0, 1]},
            }
        },
        "time": {"quasi_static": True, "end": 1.0, "instants": 1},
    }
    force = solve(scene_from_dict(scene)).bolts["m5"].force
    return float(force[-1] - force[0]) / PULL


def test_a_nominal_shank_takes_the_share_of_one_at_its_core(tmp_path: Path) -> None:
    """The two meshes have no ring in common at the core; as drawn the screw takes a third more."""
    core = _share(tmp_path, CORE, "core")
    assert _share(tmp_path, D, "core") == pytest.approx(core, rel=LIMIT)
    assert _share(tmp_path, D, "drawn") > 1.25 * core
