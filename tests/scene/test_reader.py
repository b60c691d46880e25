"""Scenes from files, from dictionaries, from Python objects, and back to text."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from latin_fmu.assembly.problem import settings_of
from latin_fmu.errors import SceneError
from latin_fmu.reader import load_scene, scene_from_dict
from latin_fmu.scene.boundaries import Absorbing, Fixed
from latin_fmu.scene.interfaces import GroundVelocity, Interface
from latin_fmu.scene.laws import CsvLaw
from latin_fmu.scene.materials import MaterialTable
from latin_fmu.scene.schema import Scene
from latin_fmu.scene.settings import (
    AndersonTable,
    Automatic,
    AutomaticScheme,
    NewmarkTable,
    NoAcceleration,
    RowTable,
    Solver,
    Time,
    Uniform,
    with_defaults,
)
from latin_fmu.scene.substructures import BoxTable, Substructure


@pytest.mark.parametrize(
    ("content", "part"),
    [
        (b"", "name: this key is missing"),
        (b"\x00\xff\xfe", "not a text file"),
        (b"\x7fELF\x02", "not valid TOML"),
        (b"name = \n", "line 1"),
        (b"name = 'a'\n[time]\nend = 1\n[time]\n", "line 4"),
        (b"a = " + b"9" * 5000, "too many digits"),
        (b"a = " + b"[" * 100_000, "nested too deeply"),
        (b"a." * 5000 + b"b = 1", "a key of 5001 parts"),
        (b"name = 1979-05-27", "must be a string"),
        (b"[[material]]\nname = 1", "must be a table"),
        (b"[time]\nend = 07:32:00", "must be a number"),
    ],
)
@pytest.mark.parametrize("overrides", [[], ["name=x"]])
def test_unusable_files(tmp_path: Path, content: bytes, part: str, overrides: list[str]) -> None:
    file = tmp_path / "scene.toml"
    file.write_bytes(content)
    with pytest.raises(SceneError) as caught:
        load_scene(file, overrides)
    if not overrides:
        assert part in str(caught.value)


@pytest.mark.parametrize(
    ("name", "part"),
    [
        ("none.toml", "no such file"),
        (".", "folder"),
        ("a\0b", "not a file name"),
        ("scene.toml/x", "no such file"),
        ("x" * 5000, "cannot be read"),
    ],
)
def test_unusable_paths(tmp_path: Path, name: str, part: str) -> None:
    (tmp_path / "scene.toml").write_text("")
    with pytest.raises(SceneError, match=part):
        load_scene(tmp_path / name)


def test_file_and_dictionary_agree(tmp_path: Path, small: dict[str, Any]) -> None:
    scene = scene_from_dict(small, tmp_path)
    (tmp_path / "scene.toml").write_text(scene.text(), encoding="utf-8")
    assert load_scene(tmp_path / "scene.toml") == scene
    assert load_scene(str(tmp_path / "scene.toml")).base_dir == tmp_path


def test_text_round_trip(tmp_path: Path, small: dict[str, Any]) -> None:
    """Everything optional, awkward texts and numbers are kept; the CSV file is no longer needed."""
    (tmp_path / "law.csv").write_text("0,0\n1e-5,0.1\n2e-5,1\n")
    small["description"] = 'quotes " and \\ and\nlines\tand \x7f and \u20ac and \U0001f600'
    small["load"]["push"]["law"] = {"type": "csv", "file": "law.csv"}
    small["interface"]["glue"] = {"sides": ["left.xmax", "right.xmin"], "behaviour": "perfect"}
    small["interface"]["wall"] = {
        "sides": ["left.zmin", "ground"],
        "gap": 0.1 + 0.2,
        "ground_velocity": {"direction": [1e-300, 0, 3], "amplitude": 5e-324, "law": "step"},
    }
    small["boundary"]["pair"] = {"type": "periodic", "faces": ["left.xmin", "left.xmax"]}
    small["solver"] = {"window": 3, "acceleration": "none", "start": "zero"}
    scene = scene_from_dict(small, tmp_path)
    (tmp_path / "law.csv").unlink()
    text = scene.text()
    again = scene_from_dict(tomllib.loads(text), tmp_path)
    assert again == scene
    assert again.text() == text
    assert isinstance(scene.load["push"].law, CsvLaw)
    assert str(tmp_path) not in text


def test_defaults(small: dict[str, Any]) -> None:
    del small["solver"]
    scene = scene_from_dict(small)
    assert scene.solver.search_direction == Automatic()
    assert scene.solver.acceleration == AndersonTable(depth=6)
    assert scene.solver.window == 1
    assert settings_of(scene).force_tolerance == pytest.approx(1e-2)
    assert scene.time.scheme == AutomaticScheme()
    assert scene.interface["meet"].gap is None
    assert scene.boundary["held"] == Fixed(face="right.zmax")
    assert not scene.output.fields


def test_short_forms(small: dict[str, Any]) -> None:
    small["solver"] = {"acceleration": "none", "search_direction": {"factor": 2}}
    small["time"]["scheme"] = {"type": "newmark"}
    scene = scene_from_dict(small)
    assert scene.solver.acceleration == NoAcceleration()
    assert scene.solver.search_direction == Automatic(factor=2.0)
    assert scene.time.scheme == NewmarkTable(beta=0.25, gamma=0.5)


def test_time_grid() -> None:
    assert Time(end=1.0, step=0.1).n_step == 10
    assert Time(end=1.0, instants=3).time_step == pytest.approx(1 / 3)
    assert Time(end=30e-6, step=0.15e-6).n_step == 200


def test_scenes_built_in_python(small: dict[str, Any]) -> None:
    steel = MaterialTable(young_modulus=210e9, poisson_ratio=0.3, density=7800)
    bars = {
        name: Substructure(
            material="steel",
            box=BoxTable(origin=np.array([0, 0, z]), size=(0.1, 0.1, 1.0), elements=(1, 1, 10)),  # type: ignore[arg-type]
        )
        for name, z in (("left", 0.0), ("right", 1.0))
    }
    meet = Interface(sides=("left.zmax", "right.zmin"), friction_coefficient=0.2)
    scene = Scene(
        name="small",
        material={"steel": steel},
        substructure=bars,
        interface={"meet": meet},
        boundary={"end": Absorbing(face="right.zmax")},
        time=Time(end=1e-3, step=1e-5),
        solver=Solver(window="whole"),
    )
    assert scene.substructure == scene_from_dict(small).substructure
    assert scene_from_dict(tomllib.loads(scene.text())) == scene


def test_mistakes_in_python_are_named_too() -> None:
    steel = MaterialTable(young_modulus=210e9, poisson_ratio=0.3, density=7800)
    bar = Substructure(material="steal", box=BoxTable(size=(1, 1, 1), elements=(1, 1, 1)))
    glue = Interface(sides=("bar.zmin", "grund.zmax"), behaviour="perfect", friction_coefficient=0.1)
    with pytest.raises(SceneError) as caught:
        Scene(
            name="a b", material={"steel": steel}, substructure={"bar": bar}, interface={"glue": glue}, time=Time(end=1)
        )
    assert {problem.where for problem in caught.value.problems} == {
        "name",
        "substructure.bar.material",
        "interface.glue.sides[1]",
        "interface.glue.friction_coefficient",
        "time",
    }


def test_scenes_do_not_change(small: dict[str, Any]) -> None:
    scene = scene_from_dict(small)
    with pytest.raises(ValidationError):
        scene.name = "other"  # type: ignore[misc]
    with pytest.raises(ValidationError):
        scene.time.end = 2.0  # type: ignore[misc]
    copy = scene_from_dict(small)
    small["material"]["steel"]["density"] = 1.0
    assert copy == scene


def test_moving_ground() -> None:
    moving = GroundVelocity(direction=(0.0, 3e200, 4e200), amplitude=10.0)
    assert moving.vector == pytest.approx((0.0, 6.0, 8.0))
    assert Interface(sides=("bar.zmin", "ground"), ground_velocity=moving).against_ground


def test_search_directions(small: dict[str, Any]) -> None:
    small["solver"]["search_direction"] = {"type": "uniform", "normal": 4e7, "tangential": 2e7}
    assert scene_from_dict(small).solver.search_direction == Uniform(normal=4e7, tangential=2e7)
    small["solver"]["search_direction"] = "row"
    assert scene_from_dict(small).solver.search_direction == RowTable()


def test_a_scene_is_a_scene_again(small: dict[str, Any]) -> None:
    scene = scene_from_dict(small, "models")
    again = Scene.model_validate(scene)
    assert again == scene
    assert again.base_dir == Path("models")


def test_deep_nesting_is_refused() -> None:
    """Before any library walks through it; what contains itself is deep, too."""
    deep: dict[str, Any] = {}
    inner = deep
    for _ in range(5000):
        inner["a"] = inner = {}
    endless: dict[str, Any] = {"name": "x"}
    endless["substructure"] = [endless, endless]
    for data in (deep, endless):
        with pytest.raises(SceneError, match="nested too deeply"):
            scene_from_dict(data)


def test_what_would_be_read_without_an_end_is_refused(tmp_path: Path) -> None:
    """A device; a key of many parts, which takes a time that grows with their square."""
    with pytest.raises(SceneError, match="device, pipe or socket"):
        load_scene("/dev/zero")
    for text in ("a" + ".a" * 50_000 + " = 1", "[a" + ".a" * 50_000 + "]", 'b = {"a"' + " . 'a'" * 50_000 + " = 1}"):
        (tmp_path / "scene.toml").write_text(f'name = "x"\n{text}\n')
        with pytest.raises(SceneError, match="50001 parts"):
            load_scene(tmp_path / "scene.toml")
    (tmp_path / "scene.toml").write_text('name = "x"\ndescription = "' + "a." * 500 + '"\n')
    with pytest.raises(SceneError, match="material: this key is missing"):
        load_scene(tmp_path / "scene.toml")


@pytest.mark.parametrize(
    ("tables", "static"),
    [
        ({"bolt": {"b": {}}}, True),
        ({"temperature": {"day": {}}}, True),
        ({"temperature": {"day": {}}, "initial_state": {"file": "out.nc"}}, False),
        ({"temperature": {"day": {}}, "time": {"start": "given"}}, False),
        ({}, False),
    ],
)
def test_scenes_that_start_from_equilibrium(tables: dict[str, Any], static: bool) -> None:
    """Those with bolts, and with temperatures where no other start is given."""
    made = with_defaults({"time": {"end": 1.0}} | tables)
    assert (made["time"].get("start") == {"type": "static"}) == static
