"""``latin-fmu scene``: the scene of a mesh that comes from elsewhere."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import latin_fmu
from latin_fmu.cli import main
from latin_fmu.fem.mesh import box_mesh


def deck(file: Path) -> Path:
    """A plate of 60 x 40 x 10 mm on the ground, a block on it and a box that is called a screw."""
    boxes = {
        "plate": ((0.0, 0.0, 0.0), (60.0, 40.0, 10.0)),
        "block-1": ((0.0, 0.0, 10.0), (30.0, 40.0, 10.0)),
        "cap screw": ((40.0, 10.0, 10.0), (10.0, 10.0, 10.0)),
    }
    text, sides, first = "*NODE\n", "", 1
    cells = ""
    for name, (origin, size) in boxes.items():
        mesh = box_mesh(np.array(origin), np.array(size), (2, 2, 2))
        text += "".join(f"{first + i}, {x}, {y}, {z}\n" for i, (x, y, z) in enumerate(mesh.nodes.tolist()))
        cells += f'*ELEMENT, TYPE=C3D8, ELSET="{name}"\n'
        for i, cell in enumerate(mesh.blocks[0].cells.tolist()):
            cells += f"{first + i}, " + ", ".join(str(first + n) for n in cell) + "\n"
        sides += f'*SURFACE, NAME="{name}_above"\n"{name}", S2\n*SURFACE, NAME="{name}_below"\n"{name}", S1\n'
        first += 100
    file.write_text(f"{text}{cells}{sides}")
    return file


def test_a_mesh_from_elsewhere_becomes_a_scene_that_loads_and_is_never_written_over(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "data").mkdir()
    file, target = deck(tmp_path / "data" / "three.inp"), tmp_path / "joint.toml"
    assert main(["scene", str(file), "-o", str(tmp_path / "joint")]) == 0
    said = capsys.readouterr().out
    assert "three.inp: 3 parts in mm, 60 x 40 x 20 mm over all" in said
    assert "the file names no unit: mm by its size" in said
    assert "latin-fmu import takes it" in said

    scene = latin_fmu.load_scene(target)
    assert set(scene.substructure) == {"plate", "block_1", "cap_screw"}
    mesh = scene.substructure["block_1"].mesh
    assert mesh is not None
    assert (mesh.file, mesh.scale, mesh.group, mesh.mesh_only) == ("data/three.inp", 1e-3, "block-1", True)
    # the plate is the largest part, and what is above it touches it
    assert getattr(scene.boundary["base"], "face", None) == "plate.plate_below"
    assert not scene.bolt
    assert "#   cap_screw: screw, by its name" in target.read_text()
    checked = "\n".join(latin_fmu.check(scene))
    assert "body plate: 0.06 x 0.04 x 0.01 m" in checked
    assert "contact" in checked

    assert main(["scene", str(file), "-o", str(tmp_path / "joint")]) == 0
    assert "as it was" in capsys.readouterr().out
    mine = target.read_text().replace("7850", "7700")
    target.write_text(mine)
    assert main(["scene", str(file), "-o", str(tmp_path / "joint"), "--unit", "in"]) == 0
    assert target.read_text() == mine
    new = latin_fmu.load_scene(tmp_path / "joint.new.toml")
    mesh = new.substructure["plate"].mesh
    assert mesh is not None
    assert mesh.scale == 0.0254
    assert "(?) m for a unit" in mine
    assert "(?) m for a unit" not in (tmp_path / "joint.new.toml").read_text()


def test_a_file_without_groups_is_one_part_and_what_is_no_mesh_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh = box_mesh(np.zeros(3), np.array([1.0, 0.1, 0.1]), (4, 1, 1))
    lines = [f"{i}, {x}, {y}, {z}" for i, (x, y, z) in enumerate(mesh.nodes.tolist(), start=1)]
    lines.append("*ELEMENT, TYPE=C3D8")
    for i, cell in enumerate(mesh.blocks[0].cells.tolist(), start=1):
        lines.append(", ".join(str(n) for n in (i, *(node + 1 for node in cell))))
    file = tmp_path / "bar.v1.inp"
    file.write_text("*NODE\n" + "\n".join(lines) + "\n")
    assert main(["scene", str(file), "-o", str(tmp_path / "joint")]) == 0
    scene = latin_fmu.load_scene(tmp_path / "joint.toml")
    assert list(scene.substructure) == ["joint"]
    assert "1 part in m" in capsys.readouterr().out
    assert not scene.boundary

    assert main(["scene", str(tmp_path / "none.inp")]) == 2
    assert "no such file" in capsys.readouterr().err
    (tmp_path / "a.step").write_text("ISO-10303-21;")
    assert main(["scene", str(tmp_path / "a.step"), "-o", str(tmp_path / "a")]) == 2
    assert "latin-fmu mesh a.step" in capsys.readouterr().err
    assert not (tmp_path / "a.toml").exists()


def test_groups_that_overlap_are_chosen(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = deck(tmp_path / "three.inp")
    file.write_text(file.read_text() + "*ELSET, ELSET=some\n1, 101\n")
    command = ["scene", str(file), "-o", str(tmp_path / "three")]
    assert main(command) == 2
    assert "--part A --part B" in capsys.readouterr().err
    assert main([*command, "--part", "plate", "--part", "block-1"]) == 0
    assert list(latin_fmu.load_scene(tmp_path / "three.toml").substructure) == ["plate", "block_1"]
    assert main([*command, "--part", "plat"]) == 2
    assert "no such volume group" in capsys.readouterr().err
