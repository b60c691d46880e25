"""``latin-fmu mesh`` on CAD of ``assemblies``: from a STEP file to a scene, and after a change in CAD."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import latin_fmu
from latin_fmu.cad.record import read_record
from latin_fmu.cli import main
from latin_fmu.fem.elements import points_in
from latin_fmu.fem.faces import face as face_of
from latin_fmu.fem.mesh import Mesh
from latin_fmu.fem.mesh_file import mesh_of
from latin_fmu.fem.reference_cells import volume_rule
from latin_fmu.mesh_files.reading import read_content
from tests.cad.assemblies_names import BOX_SCREWS, FLANGE_BOLTS

pytestmark = pytest.mark.skipif(find_spec("gmsh") is None, reason="gmsh, of the extra meshes, is not installed")


def make(name: str, file: Path) -> Path:
    """Write an assembly as a file of CAD."""
    root = Path(__file__).parents[2]
    code = [sys.executable, "-m", "tests.cad.assemblies", name, str(file)]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    subprocess.run(code, check=True, capture_output=True, cwd=root, env=environment)
    return file


@pytest.fixture(scope="module")
def bracket(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with bracket.step, and its mesh and scene."""
    folder = tmp_path_factory.mktemp("bracket")
    file = make("bracket", folder / "bracket.step")
    assert main(["mesh", str(file), "-o", str(folder / "joint"), "-q"]) == 0
    return folder


def test_a_bracket_becomes_a_scene_that_loads_with_its_screw(bracket: Path) -> None:
    scene = latin_fmu.load_scene(bracket / "joint.toml")
    assert set(scene.substructure) == {"base", "bracket", "dowel_pin", "iso_4762_m6x16"}
    (bolt,) = scene.bolt.values()
    assert bolt.thread is not None
    assert (bolt.substructure, bolt.thread.size, bolt.thread.part) == ("iso_4762_m6x16", "M6", "base")
    assert scene.boundary["base"].type == "fixed"
    record = read_record(bracket / "joint.parts.json")
    assert record is not None
    assert {s.part: s.used for s in record.screws} == {"iso_4762_m6x16": True, "dowel_pin": False}


def test_parts_keep_their_volumes_share_no_nodes_and_are_split_where_others_touch_them(bracket: Path) -> None:
    record = read_record(bracket / "joint.parts.json")
    assert record is not None
    nodes = 0
    for part in record.parts:
        mesh = read(bracket / "joint.msh", part.name)
        nodes += len(mesh.nodes)
        faces = mesh.faces
        assert {"zmin", "zmax"} <= set(faces)
        low, high = mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)
        np.testing.assert_allclose([*low, *high], [*part.low, *part.high], atol=0.05)
        assert volume(mesh) == pytest.approx(part.volume, rel=0.01)
    # what is below the foot, 50 x 30 mm without its holes of 6.6 and 4 mm
    foot = area(read(bracket / "joint.msh", "base"), "on_bracket")
    assert foot == pytest.approx(1500.0 - np.pi * (3.3**2 + 2.0**2), rel=0.01)
    assert nodes == len(read(bracket / "joint.msh").nodes)


def read(file: Path, part: str | None = None) -> Mesh:
    """A part of a mesh, or all of it."""
    return mesh_of(read_content(file), file.name, part)


def volume(mesh: Mesh) -> float:
    """Volume of a mesh, mm3."""
    return sum(float(points_in(mesh.nodes, b, volume_rule(b.cell_type, 3)).volumes.sum()) for b in mesh.blocks)


def area(mesh: Mesh, face: str) -> float:
    """Area of a face, mm2."""
    return float(np.sum(face_of(mesh, face).positive_areas))


def test_the_same_file_gives_the_same_mesh(bracket: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = (bracket / "joint.msh").read_bytes()
    assert main(["mesh", str(bracket / "bracket.step"), "-o", str(bracket / "joint"), "-q"]) == 0
    assert (bracket / "joint.msh").read_bytes() == before
    said = capsys.readouterr().out
    assert "no changes" in said
    assert "as it was" in said
    assert not (bracket / "joint.new.toml").exists()


@pytest.mark.parametrize(
    ("change", "told", "fits"),
    [
        ("moved", "changed: base, something in it has moved", True),
        pytest.param("renamed", "renamed: bracket is now angle (same place and shape)", False, marks=pytest.mark.slow),
        pytest.param("gone", "gone: dowel_pin", False, marks=pytest.mark.slow),
    ],
)
def test_after_a_change_in_cad_the_scene_stays_and_the_change_is_told(
    bracket: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], change: str, told: str, fits: bool
) -> None:
    for name in ("joint.msh", "joint.toml", "joint.parts.json"):
        (tmp_path / name).write_bytes((bracket / name).read_bytes())
    mine = (tmp_path / "joint.toml").read_text().replace("torque = 11", "torque = 9.5")
    (tmp_path / "joint.toml").write_text(mine)
    file = make(change, tmp_path / "bracket.step")
    assert main(["mesh", str(file), "-o", str(tmp_path / "joint"), "-q"]) == 0
    said = capsys.readouterr().out
    assert told in said
    assert (tmp_path / "joint.toml").read_text() == mine
    new = latin_fmu.load_scene(tmp_path / "joint.new.toml")
    assert new.bolt
    assert ("dowel_pin" in new.substructure) == (change != "gone")
    assert ("does not fit the mesh any more" not in said) == fits


def test_a_brep_file_needs_a_unit(bracket: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = make("bracket", bracket / "bracket.brep")
    assert main(["mesh", str(file), "-o", str(bracket / "brep"), "-q"]) == 2
    assert "--unit mm" in capsys.readouterr().err
    assert not (bracket / "brep.msh").exists()
    assert main(["mesh", str(file), "-o", str(bracket / "brep"), "-q", "--unit", "in"]) == 0
    assert latin_fmu.load_scene(bracket / "brep.toml").substructure["part_1"].mesh.scale == 0.0254


def test_half_of_a_bracket_has_planes_of_symmetry_and_the_names_of_the_whole(bracket: Path, tmp_path: Path) -> None:
    file, half = str(bracket / "bracket.step"), tmp_path / "half"
    assert main(["mesh", file, "-o", str(half), "--cut", "y", "-q"]) == 0
    whole, record = read_record(bracket / "joint.parts.json"), read_record(half.with_suffix(".parts.json"))
    assert whole is not None
    assert record is not None
    assert {p.name: p.volume for p in record.parts} == pytest.approx({p.name: 0.5 * p.volume for p in whole.parts})
    scene = latin_fmu.load_scene(half.with_suffix(".toml"))
    planes = {table.face for table in scene.boundary.values() if table.type == "symmetry"}
    assert planes == {f"{part.name}.ymin" for part in whole.parts}
    for part in whole.parts:
        mesh = read(half.with_suffix(".msh"), part.name)
        np.testing.assert_allclose(mesh.nodes[face_of(mesh, "ymin").nodes][:, 1], 20.0, atol=1e-6)
    modes = [latin_fmu.vibration_modes(latin_fmu.load_scene(f), count=1).frequency[0] for f in
             (half.with_suffix(".toml"), bracket / "joint.toml")]  # fmt: skip
    # the wall swings in the plane of symmetry; two meshes
    assert modes[0] == pytest.approx(modes[1], rel=0.05)
    # names stay when it is read again
    assert main(["mesh", file, "-o", str(half), "--cut", "y=20", "-q"]) == 0
    again = read_record(half.with_suffix(".parts.json"))
    assert again is not None
    assert [p.name for p in again.parts] == [p.name for p in record.parts]
    # the whole parts are those that a part is known by
    assert {p.name: p.volume for p in again.whole} == pytest.approx({p.name: p.volume for p in whole.parts})
    assert not whole.whole


@pytest.mark.parametrize(
    ("planes", "words"),
    [
        (["w"], "no plane (value: w)"),
        (["y=mm"], "no plane (value: y=mm)"),
        (["x", "--cut", "x=2"], "two planes across one axis"),
        (["y", "--figure", "screws.gif"], "figures cannot be saved in this format (value: .gif)"),
        (["y=50"], "the plane is beside the assembly (value: 50); allowed: between 0 and 40 mm"),
    ],
)
def test_what_is_no_plane_of_symmetry_is_refused(
    bracket: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], planes: list[str], words: str
) -> None:
    options = ["--cut", *planes]
    assert main(["mesh", str(bracket / "bracket.step"), "-o", str(tmp_path / "half"), "-q", *options]) == 2
    assert words in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_what_a_plane_leaves_out_and_mirror_images_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = make("handed", tmp_path / "handed.step")
    assert main(["mesh", str(file), "-o", str(tmp_path / "all"), "-q"]) == 0
    said = capsys.readouterr().out
    assert "clip_left is the mirror image of clip" in said
    assert "spare_clip is the mirror" not in said
    assert main(["mesh", str(file), "-o", str(tmp_path / "half"), "--cut", "x=-5", "--cut", "y", "-q"]) == 0
    said = capsys.readouterr().out
    # clip_left is the image of clip across x = -5; nothing is symmetric about the middle along y
    assert said.count("has no mirror image") == 1
    assert "spare_clip has no mirror image across x = -5 mm, and stays" in said
    assert said.count("so that y = 5 mm is no plane of its symmetry") == 2
    record = read_record(tmp_path / "half.parts.json")
    assert record is not None
    assert [p.name for p in record.parts] == ["clip", "spare_clip"]
    assert main(["mesh", str(file), "-o", str(tmp_path / "far"), "--cut", "x=100", "-q"]) == 0
    said = capsys.readouterr().out
    assert "clip has no mirror image across x = 100 mm, and is left out" in said


@pytest.mark.slow
@pytest.mark.parametrize(("name", "screws"), [("flange", FLANGE_BOLTS), ("box", BOX_SCREWS)])
def test_all_screws_of_a_flange_and_of_a_box_are_found(tmp_path: Path, name: str, screws: dict[str, str]) -> None:
    file = make(name, tmp_path / f"{name}.step")
    assert main(["mesh", str(file), "-o", str(tmp_path / name), "-q"]) == 0
    scene = latin_fmu.load_scene(tmp_path / f"{name}.toml")
    found = {b.substructure: b.thread.size for b in scene.bolt.values() if b.thread is not None}
    assert found == screws
