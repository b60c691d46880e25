"""Names of bodies and faces with dots, as CAD programs write them."""

from __future__ import annotations

from pathlib import Path

import pytest

from latin_fmu import SceneError, api, load_scene
from latin_fmu.mesh_files.gmsh import write_gmsh
from latin_fmu.mesh_files.reading import read_content

from .decks import cube

SCENE = """
name = "dots"
[material.m]
young_modulus = 210e9
poisson_ratio = 0.3
density = 7800.0
[mesh.v]
file = "part.msh"
material = "m"
[boundary.base]
type = "fixed"
face = "BODY.base"
[load.push]
face = "FACE"
pressure = 1e6
law = {type = "half_sine", duration = 2e-5}
[time]
end = 2e-5
step = 1e-6
"""


def scene(folder: Path, body: str, face: str, text: str) -> Path:
    """A cube with a body and a face of these names, and a scene that loads ``text``."""
    box = cube()
    faces = {"base": "zmin", face: "zmax"}
    groups = {name: (2, [("quad", box.faces[on].blocks[0].facets)]) for name, on in faces.items()}
    write_gmsh(folder / "part.msh", box.nodes, {body: (3, [("hexahedron", box.blocks[0].cells)]), **groups})
    (folder / "scene.toml").write_text(SCENE.replace("BODY", body).replace("FACE", text))
    return folder / "scene.toml"


@pytest.mark.parametrize(
    ("body", "face", "text"),
    [
        ("block", "Top.1", "block.Top.1"),
        ("block", "a.b.c", "block.a.b.c"),
        ("my.block", "Top.1", "my.block.Top.1"),
        ("my.block", "Top.1", "my_block.Top.1"),
        ("my.block.2", "top", "my.block.2.top"),
    ],
)
def test_a_face_is_split_behind_its_body(tmp_path: Path, body: str, face: str, text: str) -> None:
    loaded = load_scene(scene(tmp_path, body, face, text))
    assert loaded.load["push"].face.partition(".")[2] == face
    assert api.checked(loaded).lines


def test_an_empty_face_is_written_and_read(tmp_path: Path) -> None:
    box = cube()
    empty = box.faces["zmax"].blocks[0].facets[:0]
    write_gmsh(
        tmp_path / "x.msh", box.nodes, {"a": (2, [("quad", empty)]), "b": (3, [("hexahedron", box.blocks[0].cells)])}
    )
    content = read_content(tmp_path / "x.msh")
    assert list(content.volumes) == ["b"]
    assert not content.facets


def test_another_name_is_answered_with_one_that_works(tmp_path: Path) -> None:
    path = scene(tmp_path, "block", "Top.1", "block.Top_1")
    with pytest.raises(SceneError, match=r"did you mean block\.Top\.1"):
        api.checked(load_scene(path))
