"""What is in an FMU, and that validators find nothing."""

from __future__ import annotations

import re
import tomllib
import zipfile
from pathlib import Path
from xml.etree.ElementTree import fromstring

import pytest

import latin_fmu
from fmu_build.adapter import CoSimulationAdapter, ModelExchangeAdapter
from fmu_build.build import build_fmu
from fmu_build.checks import validate
from latin_fmu.errors import InputError
from latin_fmu.scene.schema import Scene
from tests.cosim.scenes import blocks

MODELS = Path(__file__).parents[2] / "models"


def test_with_inputs_and_sensors_too(fmus, fmi):
    assert validate(fmus[fmi]) == []


def test_same_scene_same_bytes(fmi, tmp_path):
    first, again = (build_fmu(blocks(), tmp_path / f"{name}.fmu", fmi, python=True) for name in ("first", "again"))
    assert first.read_bytes() == again.read_bytes()


def test_another_scene_has_another_token_and_the_same_program(fmus, tmp_path):
    other = build_fmu(blocks(description="something else"), tmp_path / "other.fmu", python=True)
    programs, tokens = set(), set()
    for fmu in (fmus["2"], other):
        with zipfile.ZipFile(fmu) as archive:
            programs.add(archive.read("resources/entry.txt"))
            tokens.add(re.search(rb'guid="([^"]+)"', archive.read("modelDescription.xml"))[1])
    assert (len(programs), len(tokens)) == (1, 2)


def test_contents(fmus, fmi):
    with zipfile.ZipFile(fmus[fmi]) as archive:
        names = set(archive.namelist())
        assert all(entry.compress_type == zipfile.ZIP_DEFLATED for entry in archive.infolist())
        page = archive.read("documentation/index.html").decode()
        packages = archive.read("documentation/externalDependencies.txt").decode()
    assert {"modelDescription.xml", "resources/scene/scene.toml", "documentation/licenses/license.txt"} <= names
    assert ("model.png" if fmi == "2" else "terminalsAndIcons/icon.png") in names
    assert "interface.crush.force[3]" in page
    assert "scipy" in packages
    assert "numba" not in packages
    roots = {name.split("/")[1] for name in names if name.startswith("resources/latin_fmu_")}
    assert len(roots) == 1
    assert not [name for name in names if "__pycache__" in name or name.endswith(".pyc")]


def test_terminals_have_names_of_their_own(tmp_path):
    """Unique among their siblings, as members are in a terminal (FMI 3, 2.4.9), whatever the scene names alike."""
    port = {"face": "upper.ymax", "causality": "force_in"}
    sensor = {"substructure": "upper", "point": [0.005, 0.005, 0.02]}
    fmu = build_fmu(blocks(port={"crush": port}, sensor={"crush": sensor, "press": sensor}), tmp_path / "a.fmu", "3")
    assert validate(fmu) == []
    with zipfile.ZipFile(fmu) as archive:
        found = fromstring(archive.read("terminalsAndIcons/terminalsAndIcons.xml")).findall("Terminals/Terminal")
        names = {v.get("name") for v in fromstring(archive.read("modelDescription.xml")).find("ModelVariables")}
    kinds = ("interface.crush", "load.press", "port.crush", "sensor.crush", "sensor.press")
    assert sorted(terminal.get("name") for terminal in found) == sorted(kinds)
    for terminal in found:
        members = [(member.get("variableName"), member.get("memberName")) for member in terminal]
        assert len(dict(members)) == len({name for _, name in members}) == len(members) >= 2
        assert all(f"{terminal.get('name')}.{name}" == variable in names for variable, name in members)


LABELS = {
    "author": "A. Engineer & Co.",
    "version": "3.1",
    "copyright": "(c) A. Engineer",
    "licence": "for internal use",
    "description": "Crushing of <two> blocks",
}


def test_the_author_of_the_model_is_that_of_the_scene(fmi, tmp_path):
    """Nobody where the scene names none; this package is the tool, and the licences of what is inside stay."""
    attributes = ("author", "version", "copyright", "license", "description")
    for number, labels in enumerate(({}, LABELS)):
        fmu = build_fmu(blocks(fmu=labels), tmp_path / f"{number}.fmu", fmi, python=True)
        assert validate(fmu) == []
        with zipfile.ZipFile(fmu) as archive:
            root = fromstring(archive.read("modelDescription.xml"))
            assert b"MIT License" in archive.read("documentation/licenses/license.txt")
        assert root.get("generationTool") == f"latin_fmu {latin_fmu.__version__}"
        found = [root.get(name) for name in attributes]
        assert found == ([*LABELS.values()] if labels else [None] * 4 + ["Impact with frictional contact: blocks"])


def test_mesh_files_travel(tmp_path):
    scene = latin_fmu.load_scene(MODELS / "punched_plates" / "scene.toml")
    fmu = build_fmu(scene, tmp_path / "plates.fmu", python=True)
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(tmp_path / "out")
    inside = latin_fmu.load_scene(tmp_path / "out" / "resources" / "scene" / "scene.toml")
    assert latin_fmu.check(inside)


def test_no_trace_of_the_building_machine(fmus, fmi):
    with zipfile.ZipFile(fmus[fmi]) as archive:
        for name in archive.namelist():
            if not name.startswith(("binaries/", "documentation/licenses")):
                text = archive.read(name)
                assert str(Path(__file__).parents[2]).encode() not in text, name
                assert str(Path.home()).encode() + b"/" not in text, name


DECK = """*NODE
{nodes}
*INCLUDE, INPUT=parts/cells.inp
"""


def deck(folder: Path, include: str = "parts/cells.inp") -> Path:
    """A cube of one cell whose cells and face stand in a file of their own."""
    corners = [(x, y, z) for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
    nodes = "\n".join(f"{i}, {x}, {y}, {z}" for i, (x, y, z) in enumerate(corners, 1))
    (folder / "parts").mkdir(parents=True)
    cells = "*ELEMENT, TYPE=C3D8, ELSET=ALL\n1, 1, 2, 3, 4, 5, 6, 7, 8\n*SURFACE, NAME=FOOT\nALL, S1\n"
    (folder / "parts" / "cells.inp").write_text(cells)
    (folder / "cube.inp").write_text(DECK.format(nodes=nodes).replace("parts/cells.inp", include))
    return folder / "cube.inp"


def cube(file: Path) -> Scene:
    return latin_fmu.scene_from_dict(
        {
            "name": "cube",
            "material": {"steel": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}},
            "substructure": {"cube": {"material": "steel", "mesh": {"file": file.name}}},
            "interface": {"foot": {"sides": ["cube.FOOT", "ground"]}},
            "time": {"end": 1e-5, "instants": 2},
        },
        file.parent,
    )


def test_included_files_travel(tmp_path):
    fmu = build_fmu(cube(deck(tmp_path / "in")), tmp_path / "cube.fmu", python=True)
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(tmp_path / "out")
    inside = tmp_path / "out" / "resources" / "scene"
    assert (inside / "mesh_1" / "parts" / "cells.inp").is_file()
    assert latin_fmu.check(latin_fmu.load_scene(inside / "scene.toml"))


def test_included_files_elsewhere_are_refused(tmp_path):
    file = deck(tmp_path / "in", str(tmp_path / "in" / "parts" / "cells.inp"))
    with pytest.raises(InputError, match="outside of its folder, which cannot travel"):
        build_fmu(cube(file), tmp_path / "cube.fmu", python=True)


def test_an_fmu_needs_the_least_versions_of_the_package():
    """The adapter travels without pyproject.toml."""
    project = tomllib.loads((MODELS.parent / "pyproject.toml").read_text())["project"]
    least = dict(line.split(">=") for line in project["dependencies"])
    assert CoSimulationAdapter.needed == {name: least[name] for name in least if name != "matplotlib"}
    assert ModelExchangeAdapter.needed == {name: least[name] for name in ("numpy", "pydantic")}
