"""Kernels as plain Python, where arrays end where they end, give the numbers of the compiled ones.

Compiled kernels check no bounds: a slice that is too short or an index outside of its array reads whatever follows in
the block, and most results stay as they are.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from latin_fmu.compiled import PLAIN
from tests.scenes import given_motion

pytestmark = pytest.mark.skipif(PLAIN, reason="nothing to compare with")

ROOT = Path(__file__).parents[2]
ALIKE = 1e-7  # sums are taken in another order, which contact turns into some 1e-9 of the largest number
SOLVE = """
import json, sys
import numpy as np
import latin_fmu

def numbers(tables):
    scene = latin_fmu.scene_from_dict(tables)
    solution = latin_fmu.solve(scene)
    kept = {"iterations": [window.iterations for window in solution.windows]}
    kept |= {f"energy {name}": values for name, values in (solution.energy or {}).items()}
    kept["indicator"] = [window.error_indicator[-1] for window in solution.windows]
    kept["residual"] = [window.force_mismatch[-1] for window in solution.windows]
    fields = ("traction", "velocity", "gap", "friction_power", "layer_energy", "joint_power")
    for name, history in solution.interfaces.items():
        kept |= {f"{name} {key}": getattr(history, key) for key in fields}
    for name, history in solution.substructures.items():
        kept |= {f"{name} {key}": getattr(history, key) for key in ("displacement", "velocity")}
    return {key: np.asarray(values).tolist() for key, values in kept.items() if values is not None}
"""


def _set(tables: dict[str, Any], path: str, value: Any) -> None:
    *above, key = path.split(".")
    for name in above:
        tables = tables.setdefault(name, {})
    tables[key] = value


def _changed(**changes: Any) -> Callable[[dict[str, Any]], None]:
    """Sets keys of a scene; two underscores stand for a point."""

    def change(tables: dict[str, Any]) -> None:
        for path, value in changes.items():
            _set(tables, path.replace("__", "."), value)

    return change


rub = partial(dict, sides=["low.zmax", "high.zmin"])
VARIANTS: dict[str, Callable[[dict[str, Any]], None]] = {
    "as it is": _changed(),
    "newmark": _changed(time__scheme="newmark"),
    "massless contact": _changed(
        time__scheme="massless_contact",
        substructure__low__box__elements=[1, 1, 2],
        interface__floor={"sides": ["low.zmin", "ground"], "behaviour": "perfect"},
    ),
    "explicit": _changed(solver__propagator="explicit", time__end=0.4),
    "conjugate gradients": _changed(solver__propagator="cg"),
    "reduced": _changed(solver__propagator={"type": "reduced", "modes": 6}),
    "float32": _changed(solver__precision="float32"),
    "windows": _changed(solver__window=2, solver__max_iterations=30),
    "diagonal search direction, no acceleration": _changed(
        solver__search_direction="diagonal", solver__acceleration="none", solver__relaxation=0.7
    ),
    "row search direction": _changed(solver__search_direction="row"),
    "quasi-static": _changed(
        time__quasi_static=True,
        substructure__high__initial_velocity=[0.0, 0.0, 0.0],
        interface__floor={"sides": ["low.zmin", "ground"], "behaviour": "perfect"},
        interface__rub={"sides": ["low.zmax", "high.zmin"], "behaviour": "perfect"},
    ),
    "quasi-static contact": _changed(
        time__quasi_static=True,
        substructure__high__initial_velocity=[0.0, 0.0, 0.0],
        load__push={
            "face": "high.zmax",
            "traction": [0.01, 0.0, -0.1],
            "law": {"type": "table", "times": [0.0, 0.6], "values": [0.0, 1.0]},
        },
    ),
    "nine bodies of one class": _changed(
        substructure={
            f"c{i}": {
                "material": "m",
                "box": {"origin": [2.0 * i, 0.0, 0.0], "size": [1.0, 1.0, 1.0], "elements": [1, 1, 1]},
                "initial_velocity": [0.0, 0.01 * i, -0.1],
            }
            for i in range(9)
        },
        interface={f"i{i}": {"sides": [f"c{i}.zmin", "ground"], "friction_coefficient": 0.3} for i in range(9)},
        load={},
        sensor={},
    ),
    "no slip, damping": _changed(
        interface__rub=rub(behaviour="no_slip"),
        material__m__rayleigh_mass=0.2,
        material__m__frame="absolute",
        material__m__rayleigh_stiffness=0.01,
    ),
    "elastic layer": _changed(
        interface__rub=rub(behaviour="elastic_layer", normal_stiffness=20.0, tangential_stiffness=8.0)
    ),
    "soft contact": _changed(
        interface__rub=rub(behaviour="soft_contact", normal_stiffness=20.0, friction_coefficient=0.3)
    ),
    "viscous joint": _changed(
        interface__rub=rub(behaviour="viscous_joint", normal_viscosity=3.0, tangential_viscosity=1.0)
    ),
    "bonded": _changed(interface__rub=rub(behaviour="perfect")),
    "driven, absorbing, rigid": _changed(
        boundary__pushed=given_motion("high.zmax", [-0.1], {"type": "half_sine", "duration": 1.0}, "z"),
        boundary__out={"type": "absorbing", "face": "low.xmin"},
        substructure__high__initial_velocity=[0.0, 0.0, 0.0],
    ),
    "rigid block, moving ground": _changed(
        substructure__high__rigid=True,
        interface__floor__ground_velocity={
            "direction": [1.0, 0.0, 0.2],
            "amplitude": 0.1,
            "law": {"type": "half_sine", "duration": 1.0},
        },
    ),
}


def scene(blocks: Callable[..., dict[str, Any]], change: Callable[[dict[str, Any]], None]) -> dict[str, Any]:
    """Two rubbing blocks, few elements and instants."""
    tables = blocks(time={"end": 0.6, "instants": 5})
    tables["substructure"]["low"]["box"]["elements"] = [1, 1, 1]
    tables["substructure"]["high"]["box"]["elements"] = [1, 1, 2]
    tables["sensor"] = {"tip": {"substructure": "high", "point": [0.5, 0.5, 1.9]}}
    tables["load"] = {"push": {"face": "high.zmax", "traction": [0.02, 0.0, -0.1]}}
    change(tables)
    return tables


@pytest.fixture(scope="module")
def plain(blocks_scene: Callable[..., dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Numbers of all variants, from a process without compiled kernels."""
    code = f"{SOLVE}\nprint(json.dumps({{name: numbers(t) for name, t in json.load(sys.stdin).items()}}))"
    done = subprocess.run(
        [sys.executable, "-c", code],
        input=json.dumps({name: scene(blocks_scene, change) for name, change in VARIANTS.items()}),
        capture_output=True,
        text=True,
        check=False,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT), "LATIN_FMU_COMPILE": "setup"},
    )
    assert done.returncode == 0, done.stderr[-2000:]
    result: dict[str, dict[str, Any]] = json.loads(done.stdout)
    return result


@pytest.mark.parametrize("name", VARIANTS)
def test_plain_and_compiled_kernels_agree(name, plain, blocks_scene):
    made: dict[str, Any] = {}
    exec(SOLVE, made)
    compiled = made["numbers"](scene(blocks_scene, VARIANTS[name]))
    assert compiled.keys() == plain[name].keys()
    assert compiled.pop("iterations") == plain[name].pop("iterations")
    largest = {"indicator": 1.0, "residual": 1.0}  # of a quantity, over the bodies and interfaces; of all energies
    smallest = 1e-6  # below it a quantity of these scenes is round-off: friction that does no work
    for key, values in compiled.items():
        largest[quantity(key)] = max(largest.get(quantity(key), smallest), float(np.abs(values).max()))
    for key, values in compiled.items():
        atol = ALIKE * largest[quantity(key)]
        np.testing.assert_allclose(plain[name][key], values, rtol=0.0, atol=atol, err_msg=key)


def quantity(key: str) -> str:
    """What the numbers under a key are: "energy", or the last word."""
    return "energy" if key.startswith("energy ") else key.rpartition(" ")[2]
