"""Numbers of the scene that a host sets: parameters of an FMU that makes its image at initialization."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from fmu_build.build import build_fmu, model_exchange_files
from fmu_build.checks import validate
from latin_fmu import Scene, cli, scene_from_dict
from latin_fmu.cosim.session import Session
from latin_fmu.cosim.settings import Settings
from latin_fmu.errors import InputError, NeedsPythonError, SceneError
from tests.cosim.scenes import blocks

FRICTION = "interface.crush.friction_coefficient"
STIFFNESS = "material.steel.young_modulus"
DENSITY = "material.steel.density"
FORCE = "interface.crush.force[1]"


def with_parameters(*names: str, **changes: Any) -> Scene:
    """Two blocks whose hosts set numbers of them."""
    return blocks(fmu={"parameters": names}, **changes)


def last_force(scene: Scene, settings: Settings | None = None) -> float:
    """Friction force after 20 steps under a constant load."""
    session = Session(scene, settings)
    session.set_load("press", 0.3)
    session.initialize()
    for i in range(20):
        assert session.step(i * 0.2e-6, 0.2e-6)
    return session.value(FORCE)


@pytest.mark.parametrize("fmi", ["2", "3"])
def test_a_host_sets_numbers_of_the_scene(fmi: str, tmp_path: Path) -> None:
    from fmpy import read_model_description, simulate_fmu

    scene = with_parameters(FRICTION, STIFFNESS, DENSITY)
    file = build_fmu(scene, tmp_path / "blocks.fmu", fmi=fmi, extra={}, python=True)
    assert not validate(file)
    variables = {v.name: v for v in read_model_description(str(file)).modelVariables}
    friction, modulus, density = (variables[name] for name in (FRICTION, STIFFNESS, DENSITY))
    assert (friction.causality, friction.variability, float(friction.start)) == ("parameter", "fixed", 0.2)
    assert (modulus.unit, density.unit) == ("Pa", None)
    assert "kg m-3" in density.description
    forces = []
    for value in (0.2, 0.05):
        starts = {FRICTION: value, "load.press.value": 0.3}
        result = simulate_fmu(str(file), start_values=starts, stop_time=4e-6, output_interval=0.2e-6, output=[FORCE])
        forces.append(float(result[FORCE][-1]))
        assert forces[-1] == last_force(scene.replace(FRICTION, value))
        assert forces[-1] == last_force(scene, Settings(values=((FRICTION, value),)))
    assert abs(forces[1]) < 0.6 * abs(forces[0])


def test_a_value_that_does_not_fit_ends_the_initialization(tmp_path: Path) -> None:
    from fmpy import simulate_fmu
    from fmpy.fmi1 import FMICallException

    file = build_fmu(with_parameters(FRICTION), tmp_path / "blocks.fmu", extra={}, python=True)
    messages: list[str] = []

    def logger(_env: Any, _name: Any, _status: Any, _category: Any, message: bytes) -> None:
        messages.append(message.decode())

    with pytest.raises(FMICallException):
        simulate_fmu(str(file), start_values={FRICTION: -0.1}, stop_time=1e-6, logger=logger)
    assert any(FRICTION in message and "-0.1" in message for message in messages)
    result = simulate_fmu(str(file), start_values={FRICTION: 0.1}, stop_time=1e-6, output=[FORCE])
    assert len(result) > 1


def test_an_image_is_made_for_the_numbers_of_the_scene(tmp_path: Path) -> None:
    """Neither a compiled FMU nor one for Model Exchange has them; the command makes the FMU that has."""
    scene = with_parameters(FRICTION)
    with pytest.raises(NeedsPythonError, match=r"fmu\.parameters"):
        build_fmu(scene, tmp_path / "blocks.fmu")
    with pytest.raises(InputError, match=r"fmu\.parameters"):
        model_exchange_files(scene, 4, 2)
    path = tmp_path / "scene.toml"
    path.write_text(scene.text(), encoding="utf-8")
    assert cli.main(["fmu", str(path), "-o", str(tmp_path / "made.fmu"), "--reference", "none"]) == 0
    assert not validate(tmp_path / "made.fmu")


@pytest.mark.parametrize("name", ["interface.crush.friction", "interface.crush.sides", "load.push.traction"])
def test_what_is_no_number_is_refused(name: str) -> None:
    with pytest.raises(SceneError, match=r"fmu\.parameters"):
        with_parameters(name)


def test_an_assembly_by_its_modes_takes_them() -> None:
    """Friction of a stack whose equilibrium is found anew."""
    from tests.cosim.test_modal_sessions import input_stack

    tables = input_stack() | {"fmu": {"parameters": ["interface.lap.friction_coefficient", "load.press.pressure"]}}
    scene = scene_from_dict(tables)
    values = (("interface.lap.friction_coefficient", 0.15), ("load.press.pressure", 1.4e6))
    changed, plain = Session(scene, Settings(values=values)), Session(scene)
    for session in (changed, plain):
        session.set_load("tip", 0.0, 3e3)
        session.initialize()
        for i in range(40):
            session.set_load("tip", 6e-3 * i, 3e3)
            assert session.step(i * 2e-6, 2e-6)
    pressed = [session.value("interface.lap.normalForce") for session in (changed, plain)]
    assert pressed[0] == pytest.approx(1.4 * pressed[1], rel=0.3)
    assert pressed[0] > pressed[1]
