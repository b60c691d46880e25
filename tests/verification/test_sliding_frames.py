"""Frames tightened by a bonded shank: columns between two beams, held by friction alone, slide far under side loads."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu import scene_from_dict

Tables = dict[str, Any]


def frame(seed: int) -> Tables:
    """A frame by its seed: sizes, meshes, moduli, friction 0.05 ... 0.5, bolt force, side load, heat."""
    rng = np.random.default_rng(1000 + seed)
    modulus, friction = 10 ** rng.uniform(9.5, 11.3), float(10 ** rng.uniform(np.log10(0.05), np.log10(0.5)))
    length = 10 ** rng.uniform(-1.3, 0)
    width, height, tall = (length * rng.uniform(*ends) for ends in ((0.15, 0.3), (0.15, 0.25), (0.3, 0.6)))

    def block(origin: list[float], size: list[float], elements: list[int]) -> Tables:
        box = {"origin": [float(x) for x in origin], "size": [float(x) for x in size], "elements": elements}
        return {"material": "m", "box": box}

    column, shank = length * rng.uniform(0.12, 0.22), length * rng.uniform(0.05, 0.12)
    middle = length * rng.uniform(0.4, 0.6) - shank / 2
    bodies = {
        "low": block([0, 0, -height], [length, width, height], [6, int(rng.integers(1, 3)), 2]),
        "high": block([0, 0, tall], [length, width, height], [int(rng.integers(5, 8)), int(rng.integers(1, 3)), 2]),
        "shank": block([middle, width / 2 - shank / 2, 0], [shank, shank, tall], [2, 2, 4]),
    }
    joints: Tables = {
        "foot": {"sides": ["low.zmax", "shank.zmin"], "behaviour": "perfect"},
        "head": {"sides": ["shank.zmax", "high.zmin"], "behaviour": "perfect"},
    }
    for i, x in enumerate((0.0, length - column)):
        bodies[f"c{i}"] = block([x, 0, 0], [column, width, tall], [2, int(rng.integers(1, 3)), 3])
        joints[f"low{i}"] = {"sides": ["low.zmax", f"c{i}.zmin"], "friction_coefficient": friction}
        joints[f"high{i}"] = {"sides": [f"c{i}.zmax", "high.zmin"], "friction_coefficient": friction}
    force = float(modulus * 10 ** rng.uniform(-3.7, -2.7) * shank**2)
    direction = rng.normal(size=3)
    push = force * rng.uniform(0.3, 5.0) * direction / np.linalg.norm(direction)
    law = {"type": "table", "times": [0.0, 1.0], "values": [0.0, 1.0]}
    heated = {"hot": {"change": 40.0, "substructures": list(bodies), "law": law}} if rng.random() < 0.5 else {}
    return {
        "name": f"frame{seed}",
        "material": {
            "m": {"young_modulus": modulus, "poisson_ratio": 0.3, "density": 7800.0, "thermal_expansion": 1.2e-5}
        },
        "substructure": bodies,
        "interface": joints,
        "bolt": {"b": {"substructure": "shank", "axis": [0.0, 0.0, 1.0], "force": force}},
        "boundary": {"base": {"type": "fixed", "face": "low.zmin"}},
        "load": {"push": {"face": "high.xmax", "force": push.tolist(), "law": law}},
        "temperature": heated,
        "time": {"end": 1.0, "instants": int(rng.integers(5, 20)), "quasi_static": True},
    }


@pytest.mark.parametrize("seed", range(10))
def test_a_frame_that_slides_converges(seed: int) -> None:
    """At default settings, to an equilibrium of all bodies in the cone of friction; the base carries the load."""
    tables = frame(seed)
    solution = latin_fmu.solve(scene_from_dict(tables))
    assert solution.converged, solution.status
    friction = tables["interface"]["low0"]["friction_coefficient"]
    strain = tables["bolt"]["b"]["force"] / tables["material"]["m"]["young_modulus"]
    shortening = strain / float(np.sqrt(solution.interfaces["foot"].areas.sum()))
    for name in ("low0", "high0", "low1", "high1"):
        history = solution.interfaces[name]
        assert history.gap is not None
        normal = np.einsum("tpc,pc->tp", history.traction, history.normals)
        shear = np.linalg.norm(history.traction - normal[..., None] * history.normals, axis=2)
        size = float(-normal.min())
        assert normal.max() <= 0.0
        assert (shear + friction * normal).max() <= 1e-9 * size
        assert history.gap.min() >= -1e-5 * shortening
    push = np.array(tables["load"]["push"]["force"])
    total = np.sum([solution.interfaces[n].force()[-1] for n in ("low0", "low1", "foot")], axis=0)
    # on ``low``, from those above it: the load
    np.testing.assert_allclose(total, push, atol=1e-3 * np.linalg.norm(push))
