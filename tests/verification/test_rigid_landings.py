"""Rigid bodies that land on each other: refused without a layer, independent of step and place with one."""

from __future__ import annotations

from typing import Any

import pytest

import latin_fmu
from latin_fmu.api import check
from latin_fmu.building import discretise
from latin_fmu.cosim import Session
from latin_fmu.errors import SceneError
from latin_fmu.laws.contact import Contact

SPEED, SIDE, DENSITY = 2.0, 0.05, 8000.0
MASS = DENSITY * SIDE**3


def weight(gap: float = 2.02e-3, **floor: Any) -> dict[str, Any]:
    """A rigid weight above rigid ground; ``floor`` : further keys of the interface."""
    box = {"size": [SIDE] * 3, "elements": [2, 2, 2]}
    ground = {"point": [0.0, 0.0, -gap], "normal": [0.0, 0.0, 1.0]}
    return {
        "name": "landing",
        "material": {"lead": {"young_modulus": 16e9, "poisson_ratio": 0.44, "density": DENSITY}},
        "substructure": {
            "weight": {"material": "lead", "rigid": True, "box": box, "initial_velocity": [0.0, 0.0, -SPEED]}
        },
        "interface": {"floor": {"sides": ["weight.zmin", "ground"], "ground": ground, **floor}},
        "time": {"end": 4e-3, "step": 20e-6},
        "output": {"fields": True},
    }


def refusal(tables: dict[str, Any]) -> str:
    with pytest.raises(SceneError) as caught:
        check(latin_fmu.scene_from_dict(tables))
    (problem,) = caught.value.problems
    assert problem.where.startswith("interface.")
    assert "soft_contact" in problem.remedy
    assert "rigid = false" in problem.remedy
    return str(problem)


@pytest.mark.parametrize("scheme", ["hht", "newmark", "generalized_alpha"])
def test_a_rigid_weight_that_lands_on_rigid_ground_is_refused(scheme: str) -> None:
    tables = weight()
    tables["time"]["scheme"] = scheme
    assert "a gap of 0.00202 m" in refusal(tables)


def test_a_rigid_body_that_strikes_a_rigid_body_is_refused() -> None:
    tables = weight()
    anvil = {"size": [SIDE] * 3, "elements": [2, 2, 2], "origin": [0.0, 0.0, -SIDE]}
    tables["substructure"]["anvil"] = {"material": "lead", "rigid": True, "box": anvil}
    tables["interface"] = {"face": {"sides": ["weight.zmin", "anvil.zmax"]}}
    assert "sides that approach each other" in refusal(tables)
    tables["substructure"]["anvil"]["rigid"] = False
    check(latin_fmu.scene_from_dict(tables))


def test_what_stands_on_the_ground_is_not() -> None:
    tables = weight(gap=0.0)
    tables["substructure"]["weight"]["initial_velocity"] = [1.0, 0.0, 0.0]
    check(latin_fmu.scene_from_dict(tables))


@pytest.mark.parametrize("step", [20e-6, 5e-6])
@pytest.mark.parametrize("gap", [2.00e-3, 2.01e-3, 2.02e-3])
def test_with_a_layer_it_rebounds_as_fast_as_it_came(gap: float, step: float) -> None:
    tables = weight(gap, behaviour="soft_contact", normal_stiffness=MASS * 2000.0**2 / SIDE**2)
    tables["time"] = {"end": 6e-3, "step": step, "scheme": "newmark"}
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(tables))
    velocity = solution.outcome.substructures["weight"].velocity[-1, :, 2]
    assert velocity == pytest.approx(SPEED, rel=2e-2)


def test_a_law_of_the_caller_may_have_a_restitution() -> None:
    class Law(Contact):
        compiled = False

    assert discretise(latin_fmu.scene_from_dict(weight()), behaviours={"floor": Law(0.0)}).units


def test_a_session_refuses_it_too() -> None:
    with pytest.raises(SceneError, match="nothing says how they rebound"):
        Session(latin_fmu.scene_from_dict(weight())).initialize()


def test_a_weight_that_is_thrown_up_and_comes_back_is_remarked() -> None:
    """Closed at the start: nothing tells that it will land until it has."""
    tables = weight(gap=0.0)
    tables["substructure"]["weight"]["initial_velocity"] = [0.0, 0.0, 0.5]
    tables["gravity"] = {"acceleration": [0.0, 0.0, -1000.0]}
    warnings = latin_fmu.solve(latin_fmu.scene_from_dict(tables)).warnings
    assert any("both sides are rigid" in w and "closes by an impact" in w for w in warnings), warnings
