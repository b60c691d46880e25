"""The line of ``check`` on each mesh file and body: volume, mass, size, unit of length, what is left out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from latin_fmu import api, load_scene
from latin_fmu.mesh_files.gmsh import write_gmsh

from .decks import cube
from .test_med import write_med

SCENE = """
name = "lines"
[material.m]
young_modulus = 210e9
poisson_ratio = 0.3
density = 7800.0
[mesh.v]
file = "FILE"
scale = SCALE
material = "m"
[time]
end = 2e-5
step = 1e-6
"""


def checked(folder: Path, file: str, scale: str = "1e-3") -> api.Checked:
    (folder / "scene.toml").write_text(SCENE.replace("FILE", file).replace("SCALE", scale))
    return api.checked(load_scene(folder / "scene.toml"))


def test_a_line_for_each_file_and_body(tmp_path: Path) -> None:
    box = cube()
    cells = box.blocks[0].cells
    groups = {"low": (3, [("hexahedron", cells[:4])]), "up": (3, [("hexahedron", cells[4:])])}
    write_gmsh(tmp_path / "part.msh", box.nodes, groups)
    lines = checked(tmp_path, "part.msh").lines
    assert lines[1] == "  file part.msh: 2 bodies, 1e-09 m3, 7.8e-06 kg, a unit of it is 0.001 m"
    assert lines[2].startswith("  body low: 0.001 x 0.001 x 0.0005 m, 5e-10 m3, 3.9e-06 kg, 18 nodes, 4 hexahedron")


def test_what_is_left_out_is_counted(tmp_path: Path) -> None:
    box = cube()
    cells = box.blocks[0].cells
    groups = {"low": (3, [("hexahedron", cells[:4])]), "up": (3, [("hexahedron", cells[4:])])}
    write_gmsh(tmp_path / "part.msh", box.nodes, groups)
    (tmp_path / "scene.toml").write_text(
        SCENE.replace("FILE", "part.msh")
        .replace("SCALE", "1e-3")
        .replace('material = "m"', 'material = "m"\nparts = ["low"]')
    )
    lines = api.checked(load_scene(tmp_path / "scene.toml")).lines
    assert lines[1].endswith("a unit of it is 0.001 m; left out: 4 solid cells")


@pytest.mark.parametrize(("lost", "told"), [(4, True), (0, False)])
def test_nodes_of_lost_cells_are_told(tmp_path: Path, lost: int, told: bool) -> None:
    """meshio 5.3.5 leaves pyramids out of .h5m and middle nodes out of .f3grid; their nodes stay."""
    box = cube()
    groups = {"low": (3, [("hexahedron", box.blocks[0].cells[lost:])])}
    write_gmsh(tmp_path / "part.msh", box.nodes, groups)
    said = [text for text in checked(tmp_path, "part.msh").remarks if "9 of its 27 nodes belong to no cell" in text]
    assert bool(said) == told


@pytest.mark.parametrize(("scale", "warned"), [("1e-3", False), ("1.0", True)])
def test_the_unit_of_the_file_is_read_and_said(tmp_path: Path, scale: str, warned: bool) -> None:
    pytest.importorskip("h5py")
    box = cube()
    write_med(tmp_path / "part.med", box.nodes, {"HE8": (box.blocks[0].cells, np.zeros(8, int))}, {}, unit="mm")
    found = checked(tmp_path, "part.med", scale)
    assert "(the file says mm)" in found.lines[1]
    said = [text for text in found.remarks if "its lengths are in mm by its own account" in text]
    assert bool(said) == warned
    assert not warned or "is it scale = 0.001?" in said[0]
