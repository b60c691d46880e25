"""Settings on top of a scene."""

from __future__ import annotations

import tomllib
from inspect import isabstract
from pathlib import Path
from typing import Any

import pytest

import latin_fmu
from latin_fmu import tables
from latin_fmu.errors import SceneError
from latin_fmu.reader import load_scene, scene_from_dict
from latin_fmu.scene.overrides import parse_value
from latin_fmu.scene.schema import Scene, with_settings
from tests.scenes import MODELS


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1", 1),
        ("1e-3", 1e-3),
        ("true", True),
        ("whole", "whole"),
        ('"1"', "1"),
        ("[1, 2]", [1, 2]),
        ("{type = 'step'}", {"type": "step"}),
        ("right.zmax", "right.zmax"),
        ("10e", "10e"),
        ("a#b", "a#b"),
    ],
)
def test_values(text: str, value: object) -> None:
    assert parse_value(text) == value
    assert type(parse_value(text)) is type(value)


@pytest.mark.parametrize("text", ["", "[1", "{a", "'a", "1\nb = 2", "9" * 5000, "[" * 100_000])
def test_values_that_are_none(text: str) -> None:
    with pytest.raises(ValueError, match=r"not a value|more than one|too many digits|too deeply"):
        parse_value(text)


def test_settings_reach_every_place(small: dict[str, Any]) -> None:
    settings = [
        "name=other",
        "interface.meet.friction_coefficient=0.1",
        "substructure.left.box.elements.2=20",
        "substructure.right.box.size=[0.1, 0.1, 2]",
        "solver.window=10",
        "solver.search_direction.factor=0.1",
        "solver.acceleration=none",
        "time.scheme.alpha=-0.2",
        "load.push.law.duration=2e-4",
        "output.energy=true",
        "solver.window = 20",
    ]
    scene = scene_from_dict(with_settings(small, settings))
    assert scene.name == "other"
    assert scene.interface["meet"].friction_coefficient == 0.1
    assert scene.substructure["left"].box is not None
    assert scene.substructure["left"].box.elements == (1, 1, 20)
    assert scene.solver.window == 20
    assert scene.solver.search_direction.factor == 0.1
    assert scene.solver.acceleration.type == "none"
    assert scene.time.scheme.model_dump() == {"type": "hht", "alpha": -0.2}
    assert scene.load["push"].law.impulse(0.0, 1.0) == pytest.approx(2e-4 * 0.6366197723675814)
    assert scene.output.energy


def test_the_scene_itself_stays(small: dict[str, Any]) -> None:
    with_settings(small, ["interface.meet.friction_coefficient=0.9"])
    assert small["interface"]["meet"]["friction_coefficient"] == 0.2


@pytest.mark.parametrize(
    ("setting", "parts"),
    [
        ("nothing", ["not a setting", "name.key=value"]),
        ("a..b=1", ["not a setting"]),
        ("=1", ["not a setting"]),
        ("interface.met.gap=1", ["interface.met", "no table of this name", "did you mean 'meet'"]),
        ("bondary.x.y=1", ["bondary", "unknown key", "did you mean 'boundary'"]),
        ("interface.meet.friction=1", ["interface.meet.friction", "unknown key", "friction_coefficient"]),
        ("substructure.left.box.elements.3=1", ["no such item", "0 to 2"]),
        ("substructure.left.box.elements.x=1", ["no such item"]),
        ("time.end.x=1", ["time.end", "not a table"]),
        ("time.end.x.y=1", ["not a table"]),
        ("time.end=[", ["time.end", "not a value"]),
        ("time.end=soon", ["time.end", "must be a number", "'soon'"]),
        ("time.end=nan", ["time.end", "finite"]),
        ("interface.meet=3", ["interface.meet", "must be a table"]),
    ],
)
def test_settings_that_cannot_be(small: dict[str, Any], setting: str, parts: list[str]) -> None:
    with pytest.raises(SceneError) as caught:
        scene_from_dict(with_settings(small, [setting]))
    assert all(part in str(caught.value) for part in parts), str(caught.value)


def test_all_bad_settings_at_once(small: dict[str, Any]) -> None:
    with pytest.raises(SceneError) as caught:
        with_settings(small, ["a", "interface.met.gap=1", "name=ok", "b="])
    assert len(caught.value.problems) == 3


def test_a_scene_with_another_value() -> None:
    """``replace`` checks the whole, keeps the folder of the files, and leaves the scene as it is."""
    scene = load_scene(MODELS / "punched_plates" / "scene.toml")
    changed = scene.replace("solver.tolerance", 1e-5).replace("time.end", 0.5 * scene.time.end)
    assert (changed.solver.tolerance, changed.time.end) == (1e-5, 0.5 * scene.time.end)
    assert changed.base_dir == scene.base_dir
    assert changed.replace("solver.tolerance", scene.solver.tolerance).replace("time.end", scene.time.end) == scene
    name = next(iter(scene.material))
    steel = tables.Material(young_modulus=1e9, poisson_ratio=0.2, density=1000.0)
    assert scene.replace(f"material.{name}", steel).material[name] == steel
    with pytest.raises(SceneError, match=r"solver\.tolerence: unknown key"):
        scene.replace("solver.tolerence", 1e-5)
    with pytest.raises(SceneError, match=r"time\.end"):
        scene.replace("time.end", -1.0)
    with pytest.raises(SceneError, match="no table of this name"):
        scene.replace("interface.nothing.gap", 0.0)


def test_tables_in_python_are_those_of_the_file() -> None:
    steel = tables.Material(young_modulus=210e9, poisson_ratio=0.3, density=7800.0)
    bar = tables.Substructure(material="steel", box=tables.Box(size=(1.0, 1.0, 1.0), elements=(1, 1, 1)))
    load = tables.Load(face="bar.zmax", pressure=1.0, law=tables.HalfSineLaw(duration=1.0))
    time = tables.Time(end=1.0, step=0.5)
    scene = Scene(name="one", material={"steel": steel}, substructure={"bar": bar}, load={"push": load}, time=time)
    assert scene == scene_from_dict(tomllib.loads(scene.text()))
    assert set(dir(latin_fmu)) == {"__version__", *latin_fmu.__all__}


def test_tables_of_python_keep_their_types() -> None:
    """Where defaults are completed (a static start for temperatures), and in the shape of a file, with a mesh read."""
    steel = tables.Material(young_modulus=210e9, poisson_ratio=0.3, density=7800.0, thermal_expansion=12e-6)
    box = tables.Box(size=(0.02, 0.02, 0.02), elements=(2, 2, 2))
    given: dict[str, Any] = {
        "name": "oven",
        "material": {"steel": steel},
        "substructure": {"cube": tables.Substructure(material="steel", box=box)},
        "boundary": {"base": tables.Fixed(face="cube.zmin")},
        "load": {"push": tables.Load(face="cube.zmax", pressure=1e6, law=tables.HalfSineLaw(duration=1e-5))},
        "spring": {
            "rest": tables.Spring(
                ends=(tables.End(face="cube.zmax"), tables.End(face="cube.zmin")),
                direction=(0.0, 0.0, 1.0),
                stiffness=1e5,
            )
        },
        "temperature": {"warm": tables.Temperature(change=60.0)},
        "time": tables.Time(end=1e-5, step=1e-6),
    }
    scene = Scene(**given)
    assert scene.time.start.type == "static"
    assert scene == scene_from_dict(given)
    assert scene == scene_from_dict(scene.tables())


def test_every_table_is_offered_in_python() -> None:
    def below(table: type) -> set[type]:
        return {table}.union(*(below(other) for other in table.__subclasses__()))

    from latin_fmu.scene.fields import SceneTable

    offered = {getattr(tables, name) for name in tables.__all__}
    made = {t for t in below(SceneTable) if t.__module__.startswith("latin_fmu.scene") and t.__name__[0] != "_"}
    made = {table for table in made if not isabstract(table)}  # kinds of loads are keys of one table
    assert made - {SceneTable, Scene} == offered


def test_problems_of_a_file_have_its_lines(tmp_path: Path) -> None:
    """The line of the key, or of the table around a key that is missing; none of a key given on top of the file."""
    text = (MODELS / "impact_bar" / "scene.toml").read_text()
    lines = text.splitlines()
    density = next(i for i, line in enumerate(lines, 1) if line.startswith("density"))
    time = lines.index("[time]") + 1
    (tmp_path / "a.toml").write_text(text.replace(lines[density - 1], "density = -1.0").replace("\nend =", "\nent ="))
    with pytest.raises(SceneError) as caught:
        load_scene(tmp_path / "a.toml", ["solver.tolerance=-1.0", "time.instants=-1"])
    found = {problem.where.partition(".")[2].rpartition(".")[2]: problem.line for problem in caught.value.problems}
    assert found["density"] == density
    assert found["end"] == time
    assert found["tolerance"] is None
    assert found["instants"] is None
    assert f"(line {density})" in str(caught.value)


def test_items_of_lists_and_files_are_replaced(tmp_path: Path) -> None:
    lap = load_scene(MODELS / "lap_joint" / "scene.toml")
    assert lap.replace("interface.shank.sides.1", "nut.nut_cut") == lap
    with pytest.raises(SceneError, match="are read already"):
        lap.replace("mesh.joint.scale", 2e-3)
    for name, last in (("one", 1.0), ("two", 2.0)):
        (tmp_path / f"{name}.csv").write_text(f"0, 0\n1, {last}\n")
    small = MODELS / "impact_bar" / "scene.toml"
    tables_of = tomllib.loads(small.read_text())
    tables_of["load"] = {"push": {"face": "bar.zmin", "pressure": 1.0, "law": {"type": "csv", "file": "one.csv"}}}
    scene = scene_from_dict(tables_of, tmp_path)
    assert scene.replace("load.push.law.file", "two.csv").load["push"].law.values == (0.0, 2.0)
    with pytest.raises(SceneError, match=r"three\.csv"):
        scene.replace("load.push.law.file", "three.csv")


def test_lines_are_those_of_the_tables(tmp_path: Path) -> None:
    """Texts of several lines and names in quotes are no tables of the scene."""
    text = (MODELS / "impact_bar" / "scene.toml").read_text()
    odd = 'description = """\n[time]\nend = 3\n"""\n'
    changed = odd + "\n".join(line for line in text.splitlines() if not line.startswith("description"))
    place = max(i for i, line in enumerate(changed.splitlines(), 1) if line.startswith("end ="))
    lines = changed.splitlines()
    lines[place - 1] = "end = -1.0"
    (tmp_path / "a.toml").write_text("\n".join(lines))
    with pytest.raises(SceneError) as caught:
        load_scene(tmp_path / "a.toml")
    assert [p.line for p in caught.value.problems if p.where == "time.end"] == [place]
