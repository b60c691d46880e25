"""[mesh.NAME]: one file, many parts; and what ``check`` prints about bodies and of files that cannot be read."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from latin_fmu import api
from latin_fmu.assembly.body import build_bodies
from latin_fmu.errors import Problem, Problems, SceneError
from latin_fmu.fem.mesh import box_mesh
from latin_fmu.reader import scene_from_dict
from latin_fmu.scene.schema import Scene, with_settings
from latin_fmu.scene.substructures import part_name

Tables = dict[str, Any]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A deck of two boxes, one on the other: element sets "low-er" and "upper", and a set of all elements."""
    lower, upper = (box_mesh(np.array([0.0, 0.0, z]), np.ones(3), (2, 2, 2)) for z in (0.0, 1.0))
    text = "*NODE\n"
    for first, mesh in ((1, lower), (101, upper)):
        text += "".join(f"{first + i}, {x}, {y}, {z}\n" for i, (x, y, z) in enumerate(mesh.nodes.tolist()))
    for first, mesh, name in ((1, lower, "low-er"), (101, upper, "upper")):
        text += f"*ELEMENT, TYPE=C3D8, ELSET={name}\n" + "".join(
            f"{first + i}, " + ", ".join(str(first + n) for n in cell) + "\n"
            for i, cell in enumerate(mesh.blocks[0].cells.tolist())
        )
    text += "*ELSET, ELSET=Eall\nlow-er, upper\n"
    text += "*SURFACE, NAME=top\nlow-er, S2\n*SURFACE, NAME=bottom\nupper, S1\n*SURFACE, NAME=base\nlow-er, S1\n"
    (tmp_path / "two.inp").write_text(text)
    return tmp_path


def scene(**mesh: Any) -> Tables:
    return {
        "name": "two",
        "material": {n: {"young_modulus": 2e11, "poisson_ratio": 0.3, "density": 7800.0} for n in ("steel", "alu")},
        "mesh": {"all": {"file": "two.inp", "scale": 1e-3, "material": "steel"} | mesh},
        "interface": {"joint": {"sides": ["low_er.top", "upper.bottom"]}},
        "boundary": {"bed": {"type": "fixed", "face": "low_er.base"}},
        "time": {"end": 1e-6, "step": 1e-7},
    }


def problems_of(data: Tables, folder: Path) -> list[Problem]:
    with pytest.raises(SceneError) as caught:
        scene_from_dict(data, folder)
    return list(caught.value.problems)


def test_every_part_is_a_substructure(folder: Path) -> None:
    data = scene() | {"substructure": {"upper": {"material": "alu", "initial_velocity": [0.0, 0.0, -1.0]}}}
    effective = scene_from_dict(data, folder)
    assert list(effective.substructure) == ["low_er", "upper"]
    lower, upper = effective.substructure["low_er"], effective.substructure["upper"]
    assert (lower.material, upper.material) == ("steel", "alu")
    assert lower.mesh is not None
    assert (lower.mesh.group, lower.mesh.scale) == ("low-er", 1e-3)
    assert upper.initial_velocity == (0.0, 0.0, -1.0)
    assert effective.mesh == {}  # the effective scene is written out
    assert scene_from_dict(tomllib.loads(effective.text()), folder) == effective
    lines = "\n".join(api.check(effective))
    assert "body upper: 0.001 x 0.001 x 0.001 m, 1e-09 m3, 7.8e-06 kg, 27 nodes, 8 hexahedron" in lines
    assert "interface joint: contact, 9 points" in lines


def test_settings_reach_parts_without_a_table(folder: Path) -> None:
    data = with_settings(scene(), ["substructure.upper.material=alu", "mesh.all.scale=1e-2"])
    effective = scene_from_dict(data, folder)
    assert effective.substructure["upper"].material == "alu"
    assert effective.substructure["low_er"].mesh is not None
    assert effective.substructure["low_er"].mesh.scale == 1e-2


def test_listed_parts_and_other_bodies(folder: Path) -> None:
    box = {"material": "alu", "box": {"origin": [0.0, 0.0, 1e-3], "size": [1e-3] * 3, "elements": [2, 2, 2]}}
    data = scene(parts=["low-er"]) | {"substructure": {"upper": box}}
    data["interface"]["joint"]["sides"][1] = "upper.zmin"
    assert list(scene_from_dict(data, folder).substructure) == ["low_er", "upper"]
    assert list(scene_from_dict(scene(parts=["low_er", "upper"]), folder).substructure) == ["low_er", "upper"]


@pytest.mark.parametrize(
    ("change", "substructure", "where", "words"),
    [
        ({"parts": ["uper"]}, {}, "mesh.all.parts[0]", ("no such volume group", "Eall, low-er, upper")),
        ({"parts": "all"}, {}, "mesh.all.parts", ("list of names",)),
        ({"fil": 1}, {}, "mesh.all.fil", ("unknown key",)),
        ({"scale": 0.0}, {}, "mesh.all.scale", ("out of range",)),
        ({"file": "none.inp"}, {}, "mesh.all.file", ("none.inp", "no such mesh file")),
        ({}, {"uper": {}}, "substructure.uper", ("no part of this name", "low_er, upper")),
        (
            {},
            {"upper": {"box": {"size": [1.0] * 3, "elements": [1] * 3}}},
            "substructure.upper.box",
            ("several parts",),
        ),
        ({"material": "wood"}, {}, "substructure.low_er.material", ("no material",)),
        ({"parts": ["upper", "Eall", "low-er", "low_er"]}, {}, "mesh.all.parts", ("same name", "low-er")),
    ],
)
def test_bad_tables(folder: Path, change: Tables, substructure: Tables, where: str, words: tuple[str, ...]) -> None:
    problems = problems_of(scene(**change) | {"substructure": substructure}, folder)
    messages = "\n".join(map(str, problems))
    assert where in [p.where for p in problems], messages
    assert all(word in messages for word in words), messages
    assert len(problems) <= 2, messages


def test_an_unreadable_file_hides_no_other_mistake_and_makes_none(folder: Path) -> None:
    (folder / "bad.inp").write_text("*NODE\n1, x\n")
    data = scene(file="bad.inp")
    data["time"]["end"] = -1.0
    assert {p.where for p in problems_of(data, folder)} == {"mesh.all.file", "time.end"}


def test_the_tables_alone_read_no_mesh_file(folder: Path) -> None:
    with pytest.raises(SceneError, match="mesh files are not read here"):
        Scene.model_validate(scene(), context={"base_dir": folder})


def test_one_problem_of_a_file_is_told_once(folder: Path) -> None:
    """Of three substructures from one broken file, and of a group that two of them name."""
    (folder / "bad.inp").write_text("*NODE\n1, x\n")
    data = scene()
    del data["mesh"]
    mesh = {"file": "bad.inp", "scale": 1e-3}
    data["substructure"] = {n: {"material": "steel", "mesh": mesh} for n in ("low_er", "upper", "third")}
    problems = Problems()
    build_bodies(scene_from_dict(data, folder), problems)
    assert len(problems) == 1
    assert "line 2" in str(problems[0])


@pytest.mark.parametrize(("scale", "size"), [(50.0, "50 m"), (1e-7, "1e-07 m")])
def test_absurd_sizes_are_warned_of(folder: Path, scale: float, size: str) -> None:
    remarks = [line for line in api.check(scene_from_dict(scene(scale=scale), folder)) if "largest body" in line]
    assert len(remarks) == 1
    assert size in remarks[0]
    assert "kg" in remarks[0]
    assert "scale" in remarks[0]


def test_names_of_parts() -> None:
    assert [part_name(n) for n in ("bolt", "Part-1.x", "1st", "ground", "Å")] == [
        "bolt",
        "Part_1_x",
        "part_1st",
        "ground_",
        "part__",
    ]


def test_materials_by_patterns_of_which_the_first_that_fits_counts(folder: Path) -> None:
    effective = scene_from_dict(scene(material={"up*": "alu", "*": "steel"}), folder)
    assert {name: s.material for name, s in effective.substructure.items()} == {"low_er": "steel", "upper": "alu"}
    own = scene(material={"*": "steel"}) | {"substructure": {"upper": {"material": "alu"}}}
    assert scene_from_dict(own, folder).substructure["upper"].material == "alu"


def test_a_pattern_of_materials_that_no_part_fits_and_a_part_without_a_material(folder: Path) -> None:
    (problem,) = problems_of(scene(material={"uper": "alu", "*": "steel"}), folder)
    assert problem.where == 'mesh.all.material."uper"'
    assert problem.remedy == "did you mean 'upper'?"
    problems = problems_of(scene(material={"up*": "alu"}), folder)
    assert "substructure.low_er.material" in {p.where for p in problems}
