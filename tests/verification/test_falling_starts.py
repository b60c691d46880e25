"""Static starts of bodies that nothing holds at t = 0, but what may catch them: in place, at rest, then free fall."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.api import check
from latin_fmu.cosim import Session
from latin_fmu.errors import SceneError
from tests.verification.test_thrown_assembly import PRELOAD, bolted, with_floor

SIDE, GAP, G = 0.01, 0.1e-3, 9.81
SOFT = {"behaviour": "soft_contact", "normal_stiffness": 1e12}


def above(gap: float = GAP, rigid: bool = False, **floor: Any) -> dict[str, Any]:
    """A block above the ground, with its weight and a static start."""
    body = {"material": "steel", "rigid": rigid, "box": {"size": [SIDE] * 3, "elements": [2, 2, 2]}}
    ground = {"point": [0.0, 0.0, -gap], "normal": [0.0, 0.0, 1.0]}
    table = {"sides": ["block.zmin", "ground"], "friction_coefficient": 0.2, "ground": ground}
    return {
        "name": "above",
        "material": {"steel": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}},
        "substructure": {"block": body},
        "interface": {"floor": {**table, **(floor or SOFT)}},
        "gravity": {"acceleration": [0.0, 0.0, -G]},
        "sensor": {"top": {"face": "block.zmax"}},
        "time": {"end": 2e-3, "step": 10e-6, "start": "static"},
    }


def solved(tables: dict[str, Any]) -> Any:
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(tables))
    assert solution.converged
    return solution


@pytest.mark.parametrize("scheme", ["hht", "newmark", "generalized_alpha"])
@pytest.mark.parametrize("rigid", [False, True])
def test_it_falls_from_where_it_is(rigid: bool, scheme: str) -> None:
    tables = above(rigid=rigid)
    tables["time"]["scheme"] = scheme
    solution = solved(tables)
    height = solution.sensors["top"].displacement[:, 2]
    assert height == pytest.approx(-0.5 * G * solution.time**2, abs=1e-12)
    said = [w for w in solution.warnings if "it starts in its place, at rest" in w]
    assert len(said) == 1
    assert "until interface floor closes" in said[0]


def test_it_lands_and_rests_on_what_catches_it() -> None:
    tables = above(gap=1e-6)
    solution = solved(tables)
    touch = solution.time[np.argmax(solution.interfaces["floor"].force()[:, 2] > 0.0)]
    assert touch == pytest.approx(np.sqrt(2.0 * 1e-6 / G), abs=2e-5)


def test_what_lies_on_the_floor_stays_there() -> None:
    solution = solved(above(gap=0.0))
    assert np.ptp(solution.sensors["top"].displacement, axis=0).max() < 1e-10
    assert not any("starts in its place" in w for w in solution.warnings)


def test_what_nothing_may_catch_is_refused() -> None:
    tables = above()
    tables["interface"] = {}
    with pytest.raises(SceneError, match="nothing holds it, so that a static position does not exist"):
        check(latin_fmu.scene_from_dict(tables))


def test_all_that_nothing_holds_is_one_list() -> None:
    """Two blocks above the ground, one above nothing whose weight a load carries; then without the ground."""
    tables = above()
    block, floor = tables["substructure"]["block"], tables["interface"]["floor"]
    for number, name in enumerate(("other", "alone"), start=1):
        place = {**block["box"], "origin": [2.0 * number * SIDE, 0.0, 0.0]}
        tables["substructure"][name] = {**block, "box": place}
    tables["interface"]["table"] = {**floor, "sides": ["other.zmin", "ground"]}
    weight = 7800.0 * SIDE**3 * G
    tables["load"] = {"lift": {"face": "alone.zmax", "force": [0.0, 0.0, weight], "law": "constant"}}
    for said in (check(latin_fmu.scene_from_dict(tables)), solved(tables).warnings):
        (remark,) = (text for text in said if "nothing holds" in text)
        assert "at t = 0: alone can move along x, along y, along z and turn, loads in balance" in remark
        assert "; block can move" in remark
        assert "until interface floor closes; other can move" in remark
    tables["interface"] = {}
    with pytest.raises(SceneError, match=r"1 problem\n.*nothing holds block, other, so that.*block, other can move"):
        check(latin_fmu.scene_from_dict(tables))


def test_a_spring_that_holds_it_sags() -> None:
    """It is held at t = 0: the equilibrium is where the spring carries its weight."""
    tables = above(gap=1.0)
    tables["boundary"] = {"guide": {"type": "fixed", "face": "block.zmax", "components": ["x", "y"]}}
    tables["spring"] = {"back": {"ends": ["block.zmax", "ground"], "direction": [0.0, 0.0, 1.0], "stiffness": 1e4}}
    moved = solved(tables).sensors["top"].displacement[:, 2]
    assert moved == pytest.approx(-7800.0 * SIDE**3 * G / 1e4, rel=1e-4)


def test_loads_that_hold_each_other_strain_it() -> None:
    """Pressed from both sides by 1 MPa, above the floor: shortened, and falling as a whole."""
    tables = above()
    tables["load"] = {face: {"face": f"block.{face}", "pressure": 1e6} for face in ("zmin", "zmax")}
    tables["sensor"]["foot"] = {"face": "block.zmin"}
    sensors = solved(tables).sensors
    length = sensors["top"].displacement[:, 2] - sensors["foot"].displacement[:, 2]
    assert length == pytest.approx(-1e6 / 210e9 * SIDE, rel=1e-6)


def test_a_tightened_assembly_falls_with_its_preload() -> None:
    scene = with_floor(bolted(), 1e-3)
    scene["gravity"] = {"acceleration": [0.0, 0.0, -G]}
    solution = solved(scene)
    assert solution.bolts["m5"].force == pytest.approx(PRELOAD, rel=1e-8)
    moved = solution.sensors["top"].displacement[:, 2]
    assert moved - moved[0] == pytest.approx(-0.5 * G * solution.time**2, abs=1e-12)


def test_a_session_falls_too() -> None:
    session, solution = Session(latin_fmu.scene_from_dict(above())), solved(above())
    session.initialize()
    for i in range(10):
        assert session.step(i * 1e-4, 1e-4)
    expected = solution.sensors["top"].displacement[100, 2]
    assert session.values(["sensor.top.displacement[3]"])[0] == pytest.approx(expected, rel=1e-9)
