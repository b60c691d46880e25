"""What is in an FMU, and that validators find nothing."""

from __future__ import annotations

import re
import zipfile
from pathlib import Path

import latin_fmu
from fmu_build.build import build_fmu
from fmu_build.checks import validate

from .scenes import blocks

MODELS = Path(__file__).parents[2] / "models"


def test_with_inputs_and_sensors_too(fmus, fmi):
    assert validate(fmus[fmi]) == []


def test_same_scene_same_bytes(fmi, tmp_path):
    first, again = (build_fmu(blocks(), tmp_path / f"{name}.fmu", fmi) for name in ("first", "again"))
    assert first.read_bytes() == again.read_bytes()


def test_another_scene_has_another_token_and_the_same_program(fmus, tmp_path):
    other = build_fmu(blocks(description="something else"), tmp_path / "other.fmu")
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
    assert "numba" in packages
    roots = {name.split("/")[1] for name in names if name.startswith("resources/latin_fmu_")}
    assert len(roots) == 1
    assert not [name for name in names if "__pycache__" in name or name.endswith(".pyc")]


def test_mesh_files_travel(tmp_path):
    scene = latin_fmu.load_scene(MODELS / "punched_plates" / "scene.toml")
    fmu = build_fmu(scene, tmp_path / "plates.fmu")
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
