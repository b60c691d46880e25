"""Initial displacements on top of a static start: pulled-back bodies, against closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.api import check
from latin_fmu.cosim import Session
from latin_fmu.errors import SceneError
from latin_fmu.modal.modes import vibration_modes

SIDE, DENSITY, STIFFNESS, GRAVITY = 0.01, 7800.0, 1e5, 9.81
MASS = DENSITY * SIDE**3
OFFSET = 0.5e-3
UP = {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}


def block(shift: tuple[float, float, float], rigid: bool = True, **tables: Any) -> dict[str, Any]:
    """A block with its weight that starts displaced from its equilibrium."""
    box = {"size": [SIDE] * 3, "elements": [2, 2, 2]}
    body = {"material": "steel", "rigid": rigid, "box": box, "initial_displacement": list(shift)}
    return {
        "name": "displaced",
        "material": {"steel": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": DENSITY}},
        "substructure": {"block": body},
        "gravity": {"acceleration": [0.0, 0.0, -GRAVITY]},
        "sensor": {"top": {"face": "block.zmax"}},
        "time": {"end": 4e-3, "step": 10e-6, "start": "static"},
        **tables,
    }


def guided(direction: list[float], components: list[str]) -> dict[str, Any]:
    spring = {"ends": ["block.zmax", "ground"], "direction": direction, "stiffness": STIFFNESS}
    return {
        "boundary": {"guide": {"type": "fixed", "face": "block.zmax", "components": components}},
        "spring": {"back": spring},
    }


def standing(**keys: Any) -> dict[str, Any]:
    return {"interface": {"floor": {"sides": ["block.zmin", "ground"], "ground": UP, **keys}}}


def solved(tables: dict[str, Any]) -> Any:
    return latin_fmu.solve(latin_fmu.scene_from_dict(tables))


@pytest.mark.parametrize("rigid", [True, False])
@pytest.mark.parametrize("scheme", ["hht", "newmark"])
def test_a_pulled_back_block_swings_by_what_it_was_pulled(rigid: bool, scheme: str) -> None:
    tables = block((0.0, OFFSET, 0.0), rigid, **guided([0.0, 1.0, 0.0], ["x", "z"]))
    tables["time"]["scheme"] = scheme
    solution = solved(tables)
    exact = OFFSET * np.cos(np.sqrt(STIFFNESS / MASS) * solution.time)
    assert np.abs(solution.sensors["top"].displacement[:, 1] - exact).max() < 0.01 * OFFSET


def test_it_swings_about_the_equilibrium() -> None:
    """Along its weight, by which the spring is compressed already."""
    solution = solved(block((0.0, 0.0, OFFSET), False, **guided([0.0, 0.0, 1.0], ["x", "y"])))
    sunk = -MASS * GRAVITY / STIFFNESS
    exact = sunk + OFFSET * np.cos(np.sqrt(STIFFNESS / MASS) * solution.time)
    assert np.abs(solution.sensors["top"].displacement[:, 2] - exact).max() < 0.01 * OFFSET


def test_a_block_put_down_beside_its_place_stays_there() -> None:
    solution = solved(block((0.0, OFFSET, 0.0), rigid=False, **standing(friction_coefficient=0.3)))
    moved = solution.sensors["top"].displacement
    assert moved[:, 1] == pytest.approx(OFFSET, rel=1e-6)
    assert np.ptp(moved, axis=0).max() < 1e-5 * OFFSET
    assert solution.interfaces["floor"].force()[:, 2] == pytest.approx(MASS * GRAVITY, rel=1e-3)


def test_a_lifted_block_falls() -> None:
    floor = standing(behaviour="soft_contact", normal_stiffness=1e9, friction_coefficient=0.3)
    solution = solved(block((0.0, 0.0, OFFSET), **floor))
    height, start = solution.sensors["top"].displacement[:, 2], solution.sensors["top"].displacement[0, 2]
    assert start == pytest.approx(OFFSET, rel=1e-2)
    assert height == pytest.approx(start - 0.5 * GRAVITY * solution.time**2, abs=1e-6 * OFFSET)
    assert not solution.interfaces["floor"].force().any()


def test_a_contact_that_is_opened_carries_nothing() -> None:
    """Elastic, pressed on the ground by its weight and then lifted: the force of the equilibrium is gone."""
    solution = solved(block((0.0, 0.0, OFFSET), rigid=False, **standing()))
    assert not solution.interfaces["floor"].force().any()
    height = solution.sensors["top"].displacement[:, 2]
    exact = OFFSET - 0.5 * GRAVITY * solution.time**2
    assert np.abs(height - exact).max() < 1e-3 * OFFSET


def refused(tables: dict[str, Any]) -> str:
    with pytest.raises(SceneError) as caught:
        solved(tables)
    return str(caught.value)


def test_what_sinks_in_is_refused() -> None:
    assert "the sides overlap at the start" in refused(block((0.0, 0.0, -OFFSET), rigid=False, **standing()))


def test_what_sinks_in_below_the_equilibrium_is_refused() -> None:
    """The weight closes the gap that the scene has; a displacement that the gap would allow does not fit any more."""
    gap = 0.5 * MASS * GRAVITY / STIFFNESS
    ground = {"point": [0.0, 0.0, -gap], "normal": [0.0, 0.0, 1.0]}
    tables = block((0.0, 0.0, -0.5 * gap), rigid=False, **guided([0.0, 0.0, 1.0], ["x", "y"]))
    tables |= standing(ground=ground)
    text = refused(tables)
    assert "which a static start counts from the equilibrium, lets the sides overlap" in text
    assert "interface.floor" in text


def test_what_moves_a_held_face_is_refused() -> None:
    tables = block((OFFSET, 0.0, 0.0), **guided([0.0, 1.0, 0.0], ["x", "z"]))
    with pytest.raises(SceneError, match="moves nodes that are held by"):
        check(latin_fmu.scene_from_dict(tables))


def test_what_parts_a_bond_is_refused() -> None:
    tables = block((0.0, 0.0, OFFSET), rigid=False, **standing(behaviour="perfect"))
    with pytest.raises(SceneError, match="initial displacements separate a bonded interface"):
        check(latin_fmu.scene_from_dict(tables))


def test_a_displaced_face_is_not_counted_twice() -> None:
    """The guide is displaced as well: the equilibrium has that, the initial displacement comes on top."""
    tables = block((0.0, OFFSET, 0.0), rigid=False, **guided([0.0, 1.0, 0.0], ["x"]))
    law = {"type": "table", "times": [0.0, 1.0], "values": [1.0, 1.0]}
    lift = {"type": "displacement", "face": "block.zmax", "components": ["z"], "value": [2e-4], "law": law}
    tables["boundary"]["lift"] = lift
    moved = solved(tables).sensors["top"].displacement
    assert moved[0] == pytest.approx([0.0, OFFSET, 2e-4], abs=1e-9)


def test_a_session_starts_there_too() -> None:
    tables = block((0.0, OFFSET, 0.0), **guided([0.0, 1.0, 0.0], ["x", "z"]))
    session, solution = Session(latin_fmu.scene_from_dict(tables)), solved(tables)
    session.initialize()
    name = "sensor.top.displacement[2]"
    assert session.values([name])[0] == pytest.approx(OFFSET, rel=1e-12)
    for i in range(20):
        assert session.step(i * 1e-4, 1e-4)
    assert session.values([name])[0] == pytest.approx(solution.sensors["top"].displacement[200, 1], rel=1e-9)


def test_modes_are_those_about_the_equilibrium() -> None:
    tables = block((0.0, 0.0, OFFSET), rigid=False, **standing(friction_coefficient=0.3))
    still = block((0.0, 0.0, 0.0), rigid=False, **standing(friction_coefficient=0.3))
    first, second = (vibration_modes(latin_fmu.scene_from_dict(t), count=3).frequency for t in (tables, still))
    assert first == pytest.approx(second, rel=1e-9)


def test_derivatives_are_refused() -> None:
    tables = block((0.0, OFFSET, 0.0), rigid=False, **guided([0.0, 1.0, 0.0], ["x", "z"]))
    tables["output"] = {"sensitivities": ["spring.back.stiffness"]}
    assert "initial displacements on top of a static start" in refused(tables)
