"""Quasi-static patch tests: uniform states that the mesh holds exactly, through any number of interfaces."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.scenes import given_motion, ramp, solve

from .static_scenes import STEEL, add_block, add_stack, scene

E, NU = STEEL["young_modulus"], STEEL["poisson_ratio"]
SHEAR = E / (2 * (1 + NU))
SIZE, ELEMENTS, PRESSURE = (0.02, 0.01, 0.01), (4, 2, 2), 80e6
TIGHT = {"tolerance": 1e-10}


def column(n: int, friction: float) -> dict[str, Any]:
    """Blocks free to spread, pressed on a plane of symmetry."""
    made = add_stack(scene(4, **TIGHT), SIZE, [ELEMENTS] * n, PRESSURE, friction_coefficient=friction)
    made["boundary"]["base"] = {"type": "symmetry", "face": "b1.zmin"}
    return made


@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_compressed_stack_is_uniform(friction: float):
    """sigma_z = -p everywhere: u = (nu p x / E, nu p y / E, -p z / E), though every block but the lowest floats."""
    n = 5
    solution = solve(column(n, friction))
    for history in solution.interfaces.values():
        expected = PRESSURE * np.array([0.25, 0.5, 0.75, 1.0])
        pressure = -np.einsum("tpc,pc->tp", history.traction[1:], history.normals)
        assert pressure == pytest.approx(np.tile(expected[:, None], (1, pressure.shape[1])), rel=1e-7)
    for body in solution.substructures.values():
        x = body.nodes
        exact = PRESSURE / E * np.stack([NU * x[:, 0], NU * x[:, 1], -x[:, 2]], axis=1)
        assert body.displacement[-1] == pytest.approx(exact, abs=1e-7 * PRESSURE / E * n * SIZE[2])


def layers(n: int, friction: float) -> dict[str, Any]:
    """Layers without ends along x (periodic) and y (symmetry), on a fixed base, pressed first."""
    made = scene(8, **TIGHT)
    for i in range(n):
        name = f"b{i + 1}"
        add_block(made, name, (0.0, 0.0, i * SIZE[2]), SIZE, ELEMENTS)
        made["boundary"][f"{name}_x"] = {"type": "periodic", "faces": [f"{name}.xmin", f"{name}.xmax"]}
        for side in ("min", "max"):
            made["boundary"][f"{name}_y{side}"] = {"type": "symmetry", "face": f"{name}.y{side}"}
        if i:
            sides = [f"b{i}.zmax", f"{name}.zmin"]
            made["interface"][f"i{i}"] = {"sides": sides, "friction_coefficient": friction}
    made["boundary"]["base"] = {"type": "fixed", "face": "b1.zmin"}
    law = ramp((0, 0), (0.5, 1), (1, 1))
    made["load"]["press"] = {"face": f"b{n}.zmax", "pressure": PRESSURE, "law": law}
    return made


def test_sheared_stack_sticks_below_the_cone():
    """tau < mu p: u_x = tau z / G, u_z = -p z / (lambda + 2 mu), no slip anywhere."""
    n, friction, tau = 3, 0.3, 0.99 * 0.3 * PRESSURE
    made = layers(n, friction)
    law = ramp((0, 0), (0.5, 0), (1, 1))
    made["load"]["shear"] = {"face": f"b{n}.zmax", "traction": [tau, 0.0, 0.0], "law": law}
    solution = solve(made)
    modulus = E * (1 - NU) / ((1 + NU) * (1 - 2 * NU))
    for body in solution.substructures.values():
        z = body.nodes[:, 2]
        exact = np.stack([tau * z / SHEAR, 0 * z, -PRESSURE * z / modulus], axis=1)
        assert body.displacement[-1] == pytest.approx(exact, abs=1e-7 * tau / SHEAR * n * SIZE[2])
    for history in solution.interfaces.values():
        assert (history.contact_status[1:] == 1).all()
        assert history.traction[-1, :, 0] == pytest.approx(tau, rel=1e-7)  # on the lower side, from the upper one
    assert solution.energy["friction_dissipation"][-1] == pytest.approx(0.0, abs=1e-9 * solution.energy["elastic"][-1])


def test_sheared_stack_slips_at_the_cone():
    """A top driven further than the friction allows: tau = mu p, the rest of the way is slip, its work mu p A slip."""
    n, friction, travel = 2, 0.2, 40e-6
    made = layers(n, friction)
    made["boundary"]["drive"] = given_motion("b2.zmax", [travel], ramp((0, 0), (0.5, 0), (1, 1)), kind="displacement")
    solution = solve(made)
    history = solution.interfaces["i1"]
    tau = friction * PRESSURE
    assert history.traction[-1, :, 0] == pytest.approx(tau, rel=1e-8)
    assert (history.contact_status[-1] == 2).all()
    slip = travel - tau * n * SIZE[2] / SHEAR
    area = SIZE[0] * SIZE[1]
    energy = {term: values[-1] for term, values in solution.energy.items()}
    assert energy["friction_dissipation"] == pytest.approx(tau * area * slip, rel=1e-7)
    way = travel * np.maximum(2 * solution.time - 1, 0.0)
    drawn = float(np.trapezoid(area * np.minimum(SHEAR * way / (n * SIZE[2]), tau), way))
    pressed = 0.5 * PRESSURE**2 * area * n * SIZE[2] * (1 + NU) * (1 - 2 * NU) / (E * (1 - NU))
    assert energy["work_of_loads"] == pytest.approx(drawn + pressed, rel=1e-7)
    assert energy["elastic"] == pytest.approx(0.5 * tau**2 / SHEAR * area * n * SIZE[2] + pressed, rel=1e-7)
    top = solution.substructures["b2"]
    foot = top.displacement[-1][top.nodes[:, 2] < 1.001 * SIZE[2], 0]
    assert foot == pytest.approx(travel - tau * SIZE[2] / SHEAR, rel=1e-7)


@pytest.mark.parametrize("behaviour", ["perfect", "no_slip"])
def test_stretched_by_driven_faces(behaviour: str):
    """Bonded layers whose ends are drawn apart: u = d (x, -nu y, -nu z) / L, nodes of the interface driven as well."""
    made, stretch = column(2, 0.0), 1e-5
    made["interface"]["i1"] = {"sides": ["b1.zmax", "b2.zmin"], "behaviour": behaviour}
    made["load"]["press"]["pressure"] = 1e-3 * PRESSURE  # keeps the faces of no_slip together
    drawn = [stretch], ramp((0, 0), (1, 1))
    for name in ("b1", "b2"):
        made["boundary"][f"{name}_draw"] = given_motion(f"{name}.xmax", *drawn, kind="displacement")
    solution = solve(made)
    pressed = 1e-3 * PRESSURE
    along = E * stretch / SIZE[0] - NU * pressed  # sigma_x
    strain = np.array([along + NU * pressed, -NU * (along - pressed), -pressed - NU * along]) / E
    for body in solution.substructures.values():
        exact = body.nodes * strain
        assert body.displacement[-1] == pytest.approx(exact, abs=1e-6 * stretch)


def test_ground_drags_a_layer():
    """Ground that speeds up drags a layer held at its top: tau = G travel / h, travel = v t / 2, then mu p."""
    friction, travel = 0.3, 2.5e-6
    made = layers(1, friction)
    made["boundary"] |= {"base": {"type": "fixed", "face": "b1.zmax", "components": ["x", "y"]}}
    made["interface"]["table"] = {
        "sides": ["b1.zmin", "ground"],
        "friction_coefficient": friction,
        "ground_velocity": {
            "direction": [1.0, 0.0, 0.0],
            "amplitude": 8 * travel,
            "law": ramp((0, 0), (0.5, 0), (1, 1)),
        },
    }
    solution = solve(made)
    moved = 8 * travel * np.maximum(solution.time - 0.5, 0.0) ** 2  # integral of the law: v (t - 1/2)^2 / (2 * 1/2)
    tau = np.minimum(SHEAR * moved / SIZE[2], friction * PRESSURE)
    assert 0 < tau[-2] < tau[-1]
    history = solution.interfaces["table"]
    assert history.traction[:, :, 0] == pytest.approx(
        np.tile(tau[:, None], (1, len(history.areas))), abs=1e-7 * friction * PRESSURE
    )


@pytest.mark.parametrize(("slope", "holds"), [(0.99, True), (1.05, False)])
def test_block_on_an_incline(slope: float, holds: bool):
    """Weight along the plane below mu times the weight across it: friction carries it all; above: no equilibrium, and
    the run reports it instead of giving a result."""
    friction, weight = 0.5, 4e9
    made = scene(2, **(TIGHT if holds else {}))
    add_block(made, "block", (0.0, 0.0, 0.0), SIZE, ELEMENTS)
    made["boundary"]["ends"] = {"type": "periodic", "faces": ["block.xmin", "block.xmax"]}
    made["boundary"]["side"] = {"type": "symmetry", "face": "block.ymin"}
    made["substructure"]["block"]["body_force"] = [slope * friction * weight, 0.0, -weight]
    made["interface"]["plane"] = {"sides": ["block.zmin", "ground"], "friction_coefficient": friction}
    solution = solve(made, converged=holds)
    if holds:
        volume = SIZE[0] * SIZE[1] * SIZE[2]
        expected = weight * volume * np.array([-slope * friction, 0.0, 1.0])
        force = solution.interfaces["plane"].force()[-1]
        assert force[[0, 2]] == pytest.approx(expected[[0, 2]], rel=1e-8)
    else:
        assert "no equilibrium" in solution.status
        assert len(solution.time) < 3


def test_bulging_block_meets_a_wall():
    """A block pressed between plates bulges by nu p w / E, closes the gap g and is pushed back by nu p - E g / w."""
    gap = 0.4 * NU * PRESSURE / E * SIZE[0]
    made = column(1, 0.0)
    made["time"]["instants"] = 10
    made["interface"]["wall"] = {"sides": ["b1.xmax", "ground"], "gap": gap}
    solution = solve(made)
    history = solution.interfaces["wall"]
    p = PRESSURE * solution.time
    expected = np.maximum(0.0, NU * p - E * gap / SIZE[0])
    pressure = -np.einsum("tpc,pc->tp", history.traction, history.normals)
    assert pressure == pytest.approx(np.tile(expected[:, None], (1, pressure.shape[1])), abs=1e-7 * PRESSURE)
    assert history.gap == pytest.approx(
        np.tile(np.maximum(0.0, gap - NU * p / E * SIZE[0])[:, None], (1, pressure.shape[1])), abs=1e-7 * gap
    )


@pytest.mark.parametrize("gap", [1e-7, 1e-5, 1e-3])
def test_far_travel_before_contact(gap: float):
    """Four blocks fall through gaps of up to 10 % of their size, ten thousand times their compression, and settle."""
    n, size = 4, 0.01
    made = add_stack(scene(3, tolerance=1e-6), (size,) * 3, [(2, 2, 2)] * n, 1e6, gap)
    made["interface"]["base"] = {"sides": ["b1.zmin", "ground"], "gap": gap}
    solution = solve(made)
    for i in range(n):
        body = solution.substructures[f"b{i + 1}"]
        height = body.nodes[:, 2] - i * gap  # in the closed stack
        for instant, p in ((1, 1e6 / 3), (3, 1e6)):
            exact = -(i + 1) * gap - p * height / E
            assert body.displacement[instant][:, 2] == pytest.approx(exact, abs=1e-3 * p * n * size / E)
