"""An elastic ball bounces off a rigid plane: Hertz's impact, on curved facets of 10-node tetrahedra.

With E* = E / (1 - nu^2), mass m, speed v (Johnson, Contact Mechanics, 11.4):

    approach d = (5 pi rho v^2 / (4 E*))^(2/5) R     peak 4/3 E* R^(1/2) d^(3/2)     contact time 2.9432 d / v

The centre of the ball moves by d (1 - O(a / R)) only, a = (R d)^(1/2) the radius of contact: at a / R = 0.03 peak and
time of the mesh are 1.5 % off on that account, both towards a stiffer contact.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.accuracy.coarse_effects import coarse_run
from latin_fmu.building import discretise
from latin_fmu.errors import SceneError

E, NU, RHO, R = 210e9, 0.3, 7800.0, 0.01
STAR, APPROACH = E / (1 - NU**2), 1e-3 * R
SPEED = float(np.sqrt((APPROACH / R) ** 2.5 * 4 * STAR / (5 * np.pi * RHO)))
PEAK, TIME = 4 / 3 * STAR * np.sqrt(R) * APPROACH**1.5, 2.9432 * APPROACH / SPEED
MESH = Path(__file__).with_name("ball.msh")


def ball(**interface: Any) -> dict[str, Any]:
    """A quarter of the ball, falling along z on the plane below it."""
    mesh = {"file": str(MESH), "group": "ball", "scale": R}
    ground = {"point": [0.0, 0.0, -R], "normal": [0.0, 0.0, 2.0]}
    return {
        "name": "ball",
        "material": {"steel": {"young_modulus": E, "poisson_ratio": NU, "density": RHO}},
        "substructure": {"ball": {"material": "steel", "mesh": mesh, "initial_velocity": [0.0, 0.0, -SPEED]}},
        "interface": {"touch": {"sides": ["ball.skin", "ground"], "ground": ground, **interface}},
        "boundary": {a: {"type": "symmetry", "face": f"ball.{a}min"} for a in "xy"},
        "time": {"end": 1.3 * TIME, "instants": 200},
        "solver": {"tolerance": 1e-5},
    }


@pytest.mark.slow
def test_peak_and_contact_time() -> None:
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(ball()))
    assert solution.converged
    force = 4 * solution.interfaces["touch"].normal_resultant()
    assert force.max() == pytest.approx(PEAK, rel=0.02)
    touching = np.flatnonzero(force > 0.0)
    assert touching[0] == 1
    end = 0.5 * (solution.time[touching[-1]] + solution.time[touching[-1] + 1])
    assert end == pytest.approx(TIME, rel=0.02)
    impulse = float(np.trapezoid(force, solution.time))
    assert impulse == pytest.approx(2 * 4 / 3 * np.pi * R**3 * RHO * SPEED, rel=2e-3)


@pytest.mark.slow
def test_the_ball_deforms_without_waves() -> None:
    """A ball that is slow against its waves hardly vibrates (Rayleigh 1906), the ground of Hertz's theory of impact."""
    found = [f for f in coarse_run(latin_fmu.scene_from_dict(ball())).findings if "substructure ball" in f]
    assert len(found) == 1
    assert "ball is quasi-static: its vibrations have at most" in found[0]


def test_gap_to_the_plane() -> None:
    """That of the sphere at its vertices; facets turned away from the plane take no part."""
    geometry = discretise(latin_fmu.scene_from_dict(ball())).units[0].geometry
    radius = np.hypot(*geometry.points[:, :2].T)
    assert geometry.gap == pytest.approx(R - np.sqrt(R**2 - radius**2), abs=0.02 * R)
    near = radius < 0.03 * R
    assert geometry.gap[near] == pytest.approx(R - np.sqrt(R**2 - radius[near] ** 2), abs=1e-5 * R)
    assert geometry.areas.min() > 0.0
    assert geometry.frames[:, 0] == pytest.approx(np.tile([0.0, 0.0, -1.0], (len(radius), 1)))
    assert radius.max() < 0.95 * R


@pytest.mark.parametrize(
    ("ground", "words"),
    [
        (None, ["interface.touch.sides", "curved face", "ground = {point"]),
        ({"point": [0.0, 0.0, -R], "normal": [0.0, 0.0, -1.0]}, ["interface.touch", "turn the normal"]),
        (
            {"point": [0.0, 0.0, -0.9 * R], "normal": [0.0, 0.0, 1.0]},
            ["touch.ground", "overlap at the start", "0.001 m"],
        ),
        ({"point": [0.0, 0.0, -R], "normal": [0.0, 0.0, 0.0]}, ["interface.touch.ground.normal", "zero"]),
    ],
)
def test_ground_that_makes_no_sense(ground: dict[str, Any] | None, words: list[str]) -> None:
    made = ball()
    made["interface"]["touch"]["ground"] = ground
    with pytest.raises(SceneError) as caught:
        discretise(latin_fmu.scene_from_dict(made))
    for word in words:
        assert word in str(caught.value)


def test_a_gap_given_counts_and_the_distance_of_the_plane_is_named() -> None:
    problem = discretise(latin_fmu.scene_from_dict(ball(gap=1e-4)))
    np.testing.assert_array_equal(problem.units[0].geometry.gap, 1e-4)
    assert any("gap = 0.0001 m counts; the meshes are" in r for r in problem.remarks)


def test_a_plate_thrown_on_a_placed_plane_meets_it_there() -> None:
    """A plane face: the gap comes from the place, points and areas are those of ground behind the face."""
    made = ball()
    box = {"origin": [0.0, 0.0, 0.0], "size": [0.02, 0.02, 0.01], "elements": [3, 2, 2]}
    made["substructure"]["ball"] = {"material": "steel", "box": box}
    made["boundary"] = {}
    made["interface"]["touch"] |= {
        "sides": ["ball.zmin", "ground"],
        "ground": {"point": [0.0, 0.0, -3e-4], "normal": [0, 0, 1.0]},
    }
    placed = discretise(latin_fmu.scene_from_dict(made)).units[0].geometry
    made["interface"]["touch"] |= {"ground": None, "gap": 3e-4}
    behind = discretise(latin_fmu.scene_from_dict(made)).units[0].geometry
    for name in ("points", "areas", "frames", "gap"):
        assert getattr(placed, name) == pytest.approx(getattr(behind, name), rel=1e-12, abs=1e-18)
