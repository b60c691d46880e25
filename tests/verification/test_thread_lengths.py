"""A thread by its length beside the same thread on a face of its own, in a mesh without an edge at that length."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from latin_fmu import scene_from_dict, solve
from latin_fmu.fem.mesh import Mesh
from latin_fmu.stability.surfaces import write_mesh

from .bolted_meshes import Array, Lattice

R, HEAD, OUTER = 2.5e-3, 4.25e-3, 10e-3
DEPTH, PLATE = 9.6e-3, 6e-3  # of the hole; thickness of the plate
LENGTH = 6e-3  # of the thread
FINE = 0.15e-3  # layers around its end
PRELOAD = 5e3
LIMIT = 0.01
"""Of the difference of both threads."""


def _heights(shift: float) -> list[float]:
    """Of the layers: those around the end of the thread are thin, and ``shift`` from an edge there, m."""
    thin = -LENGTH + shift + FINE * np.arange(-4, 5)
    below = [-DEPTH - 2.4e-3, -DEPTH - 1.2e-3, -DEPTH, -DEPTH + 1.2e-3]
    return [
        *below,
        *thin,
        *np.linspace(thin[-1], 0.0, 5)[1:],
        *np.linspace(0.0, PLATE, 7)[1:],
        PLATE + 2e-3,
        PLATE + 4e-3,
    ]


def _flat(height: float, up: float) -> Any:
    return lambda x, n: (np.abs(x[:, 2] - height) < 1e-7) & (n[:, 2] * up > 0.9)


def _wall(x: Array, n: Array) -> Array:
    return np.asarray(
        (np.abs(n[:, 2]) < 0.1) & (np.hypot(x[:, 0], x[:, 1]) < 1.01 * R) & (np.abs(x[:, 2] + 3e-3) < 3e-3)
    )


def _parts(shift: float) -> dict[str, Mesh]:
    """Screw, plate and base."""
    lattice = Lattice([R, 2.75e-3, HEAD, 6.5e-3, OUTER], _heights(shift), n_core=3)
    return {
        "screw": lattice.part(
            lambda r, z: ((r < R) & (z > -DEPTH)) | ((r < HEAD) & (z > PLATE)),
            {"head": _flat(PLATE + 4e-3, 1.0), "seat": _flat(PLATE, -1.0), "tip": _flat(-DEPTH, -1.0), "thread": _wall},
        ),
        "base": lattice.part(
            lambda r, z: (z < 0.0) & ((r > R) | (z < -DEPTH)),
            {"floor": _flat(-DEPTH - 2.4e-3, -1.0), "joint": _flat(0.0, 1.0), "thread": _wall},
        ),
        "plate": lattice.part(
            lambda r, z: (r > 2.75e-3) & (z > 0.0) & (z < PLATE),
            {
                "top": lambda x, n: _flat(PLATE, 1.0)(x, n) & (np.hypot(x[:, 0], x[:, 1]) < HEAD),
                "rim": lambda x, n: _flat(PLATE, 1.0)(x, n) & (np.hypot(x[:, 0], x[:, 1]) > 6.5e-3),
                "joint": _flat(0.0, -1.0),
            },
        ),
    }


def _scene(folder: Path, shift: float, by_length: bool, clamped: bool) -> dict[str, Any]:
    names = ("screw", "base", "plate") if clamped else ("screw", "base")
    parts = _parts(shift)
    for name in names:
        write_mesh(folder / f"{name}.msh", parts[name])
    thread: Any = {"size": "M5", "part": "base", "length": LENGTH, "modulus": "drawn"} if by_length else "M5"
    joints = {} if by_length else {"thread": {"sides": ["screw.thread", "base.thread"], "behaviour": "perfect"}}
    if clamped:
        pairs = {"seat": ["plate.top", "screw.seat"], "joint": ["base.joint", "plate.joint"]}
        joints |= {name: {"sides": sides, "friction_coefficient": 0.3} for name, sides in pairs.items()}
    ramp = {"type": "table", "times": [0, 1], "values": [0, 1]}
    face = "plate.rim" if clamped else "screw.head"
    tightened = {"force": PRELOAD} if clamped else {"shortening": 1e-13}
    return {
        "name": "length",
        "material": {"steel": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}},
        "substructure": {n: {"material": "steel", "mesh": {"file": str(folder / f"{n}.msh")}} for n in names},
        "interface": joints,
        "boundary": {"floor": {"type": "fixed", "face": "base.floor"}},
        "bolt": {"m5": {"substructure": "screw", "axis": [0.0, 0.0, 1.0], "thread": thread, **tightened}},
        "load": {"pull": {"face": face, "force": [0.0, 0.0, 0.5 * PRELOAD], "law": ramp}},
        "sensor": {"tip": {"face": "screw.tip"}, "head": {"face": "screw.head"}}
        | ({"rim": {"face": "plate.rim"}} if clamped else {}),
        "time": {"quasi_static": True, "end": 1.0, "instants": 1},
    }


def _measured(folder: Path, shift: float, by_length: bool) -> dict[str, float]:
    """Of the screw pulled at its head, its stiffness from there to its tip, and the displacement of the tip; of the
    joint pulled apart by half of its preload, the change of tension and the displacement of the rim that is pulled."""
    made = {}
    for clamped in (False, True):
        scene = scene_from_dict(_scene(folder, shift, by_length, clamped))
        solution = solve(scene)
        moved = {
            name: float(sensor.displacement[-1, 2] - sensor.displacement[0, 2])
            for name, sensor in solution.sensors.items()
        }
        if clamped:
            force = solution.bolts["m5"].force
            made["change of tension"] = float(force[-1] - force[0])
            made["rim"] = moved["rim"]
        else:
            made["stiffness"] = 0.5 * PRELOAD / (moved["head"] - moved["tip"])
            made["tip"] = moved["tip"]
    return made


def test_a_thread_by_length_is_the_one_on_a_face(tmp_path: Path) -> None:
    """The face ends between two layers of one mesh, the length in the middle of a layer of the other."""
    on_face, by_length = _measured(tmp_path, 0.0, False), _measured(tmp_path, 0.5 * FINE, True)
    assert by_length == pytest.approx(on_face, rel=LIMIT)
