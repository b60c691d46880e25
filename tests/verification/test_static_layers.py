"""Layers, joints and preloads in quasi-static scenes: uniform states with closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.scenes import ramp, solve

from .static_scenes import STEEL, add_block, add_stack, scene

E = STEEL["young_modulus"]
SIZE, ELEMENTS, PRESSURE = (0.02, 0.01, 0.01), (2, 1, 1), 50e6
STEPS = 4


def block(interface: dict[str, Any], steps: int = STEPS) -> dict[str, Any]:
    """A block free to spread on ground, pressed more and more."""
    made = add_stack(scene(steps, tolerance=1e-9), SIZE, [ELEMENTS], PRESSURE)
    made["interface"]["foot"] = {"sides": ["b1.zmin", "ground"], **interface}
    return made


def sinking(solution: Any) -> np.ndarray:
    """Displacement of the foot along z, (n_time,), m; the top follows by - p h / E."""
    body = solution.substructures["b1"]
    low, high = (np.isclose(body.nodes[:, 2], z) for z in (0.0, SIZE[2]))
    foot, head = (body.displacement[:, at, 2] for at in (low, high))
    assert np.ptp(foot, axis=1).max() < 1e-12
    pressed = PRESSURE * solution.time * SIZE[2] / E
    assert head.mean(axis=1) - foot.mean(axis=1) == pytest.approx(-pressed, abs=1e-6 * pressed[-1])
    return foot.mean(axis=1)


def test_elastic_layer():
    """A gasket: u = - p / k."""
    k = 1e13
    foot = sinking(solve(block({"behaviour": "elastic_layer", "normal_stiffness": k, "tangential_stiffness": 0.0})))
    assert foot == pytest.approx(-PRESSURE / k * np.linspace(0, 1, STEPS + 1), rel=1e-6, abs=1e-15)


def test_soft_contact_closes_its_gap_first():
    """u = - gap - p / k."""
    k, gap = 2e13, 1e-6
    foot = sinking(solve(block({"behaviour": "soft_contact", "normal_stiffness": k, "gap": gap})))
    assert foot[1:] == pytest.approx(-gap - PRESSURE / k * np.linspace(0, 1, STEPS + 1)[1:], rel=1e-5)


def test_viscous_joint_creeps():
    """It alone feels the pace of time: u = - sum of p dt / c."""
    c, n = 1e14, 20
    foot = sinking(solve(block({"behaviour": "viscous_joint", "normal_viscosity": c, "tangential_viscosity": 0.0}, n)))
    time = np.linspace(0, 1, n + 1)
    crept = np.concatenate([[0.0], np.cumsum(PRESSURE * time[1:] / n / c)])
    assert foot == pytest.approx(-crept, rel=1e-4, abs=1e-13)


def test_preload_lifts_at_its_own_size():
    """Pulled at more than the preload: the foot opens by nothing until then; beyond, no equilibrium."""
    made = block({"preload": 0.6 * PRESSURE}, 10)
    made["load"]["press"]["pressure"] = -PRESSURE
    solution = solve(made | {"solver": {}}, converged=False)
    history = solution.interfaces["foot"]
    pressure = -np.einsum("tpc,pc->tp", history.traction, history.normals)
    expected = np.maximum(0.6 - solution.time, 0.0) * PRESSURE
    assert pressure == pytest.approx(np.tile(expected[:, None], (1, pressure.shape[1])), abs=1e-2 * PRESSURE)
    assert solution.time[-1] < 0.75


def test_constant_load_is_held_at_once():
    """A constant load: the second increment changes nothing, in a handful of iterations."""
    made = block({"friction_coefficient": 0.3}, 3)
    made["load"]["press"]["law"] = {"type": "constant"}
    solution = solve(made)
    u = solution.substructures["b1"].displacement
    assert u[0] == pytest.approx(np.zeros_like(u[0]))
    assert u[3] == pytest.approx(u[1], abs=1e-7 * np.abs(u[1]).max())
    assert solution.windows[2].iterations <= 3


def test_work_of_loads_of_preloaded_columns():
    """Two columns of two blocks, the second with three times the preload and twice the pressure. A body takes the work
    of its load and of the initial stresses that balance the preload p0: p0 A p L / E less on the foot, more on the
    head, which a ramp presses by p^2 A L / E besides; strain energy and the work of the joint balance it."""
    steps = 2
    made = scene(steps, tolerance=1e-10)
    area, height = SIZE[0] * SIZE[1], SIZE[2]
    for i in range(2):
        for j, name in enumerate((f"foot{i}", f"head{i}")):
            add_block(made, name, (0.1 * i, 0.0, j * height), SIZE, ELEMENTS)
            for axis in "xy":
                made["boundary"][f"{axis}{name}"] = {"type": "symmetry", "face": f"{name}.{axis}min"}
        made["boundary"][f"base{i}"] = {"type": "symmetry", "face": f"foot{i}.zmin"}
        made["interface"][f"joint{i}"] = {
            "sides": [f"foot{i}.zmax", f"head{i}.zmin"],
            "preload": (0.4, 1.2)[i] * PRESSURE,
        }
        made["load"][f"press{i}"] = {
            "face": f"head{i}.zmax",
            "pressure": (i + 1) * PRESSURE,
            "law": ramp((0, 0), (1, 1)),
        }
    made["output"] = {"energy": True}
    solution = solve(made)
    assert solution.time.size == steps + 1
    for i in range(2):
        pressure = (i + 1) * PRESSURE * np.linspace(0.0, 1.0, steps + 1)
        of_preload = (0.4, 1.2)[i] * PRESSURE * area * pressure * height / E
        of_load = pressure**2 * area * height / E
        size = of_load.max()
        foot, head = (solution.substructures[f"{name}{i}"].energy for name in ("foot", "head"))
        assert foot["work_of_loads"] == pytest.approx(of_preload * -1.0, abs=1e-6 * size)
        assert head["work_of_loads"] == pytest.approx(of_load + of_preload, abs=1e-6 * size)
        for terms in (foot, head):
            assert terms["elastic"] == pytest.approx(0.5 * of_load, abs=1e-6 * size)
            assert terms["work_of_loads"] + terms["interface_work"] == pytest.approx(terms["elastic"], abs=1e-6 * size)
