"""The shipped scenes agree with their READMEs and the definitions of the cases."""

from __future__ import annotations

import math
import tomllib
from collections import Counter
from pathlib import Path

import meshio
import numpy as np
import pytest

from latin_fmu.errors import SceneError
from latin_fmu.reader import load_scene, scene_from_dict
from latin_fmu.scene.boundaries import Periodic, Symmetry
from latin_fmu.scene.laws import HalfSineLaw, sampled_impulse_error
from latin_fmu.scene.schema import Scene
from latin_fmu.scene.substructures import BoxTable

MODELS = Path(__file__).parents[2] / "models"
SCENES = sorted(MODELS.glob("*/*.toml"))


def box(scene: Scene, name: str) -> BoxTable:
    described = scene.substructure[name].box
    assert described is not None
    return described


@pytest.mark.parametrize("path", SCENES, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_scene_is_complete(path: Path) -> None:
    scene = load_scene(path)
    suffix = {"scene": ""}.get(path.stem, f"_{path.stem}")
    assert scene.name == path.parent.name + suffix
    assert scene.description
    assert scene.output.energy
    times = np.linspace(0.0, scene.time.end, scene.time.n_step + 1)
    assert all(sampled_impulse_error(load.law, times) < 1e-3 for load in scene.load.values())
    assert scene_from_dict(tomllib.loads(scene.text()), path.parent) == scene


@pytest.mark.parametrize("folder", sorted({path.parent for path in SCENES}), ids=lambda folder: folder.name)
def test_folder_has_a_readme(folder: Path) -> None:
    text = (folder / "README.md").read_text(encoding="utf-8")
    assert f"latin-fmu run models/{folder.name}/" in text
    for part in ("**Expected**", "**What happens**" if folder.name != "punched_plates" else "**Shows**"):
        assert part in text
    assert all(path.stem in text for path in folder.glob("*.toml"))
    assert f"`{folder.name}`" in (MODELS / "README.md").read_text(encoding="utf-8")


def test_beam_in_traction() -> None:
    scene = load_scene(MODELS / "beam_in_traction" / "scene.toml")
    steel = scene.material["steel"]
    c = math.sqrt(steel.young_modulus / steel.density)
    transit = 0.5 / c
    assert scene.time.n_step == 250
    assert scene.time.time_step == pytest.approx(transit / 42, rel=1e-15)
    assert np.count_nonzero(scene.load["pulse"].law.sample(np.arange(251) * scene.time.time_step)) == 42
    gap = box(scene, "bar2").origin[2] - 1.0
    assert gap == pytest.approx(0.3 * 2 * 100e6 / (steel.density * c) * transit, rel=1e-11)
    assert set(scene.interface) == {"joint", "contact"}
    assert scene.solver.window == "whole"
    assert scene.solver.start == "zero"
    assert scene.solver.acceleration.type == "none"


@pytest.mark.parametrize(("name", "speed", "gravity"), [("impact_bar", -10.0, 0.0), ("bouncing_bar", 0.0, -10.0)])
def test_bars_on_the_wall(name: str, speed: float, gravity: float) -> None:
    scene = load_scene(MODELS / name / "scene.toml")
    bar, material = scene.substructure["bar"], scene.material["bar"]
    assert (material.young_modulus, material.density, material.poisson_ratio) == (900.0, 1.0, 0.0)
    assert box(scene, "bar").size == (1.0, 1.0, 10.0)
    assert (bar.initial_velocity[2], bar.body_force[2]) == (speed, gravity)
    assert scene.interface["wall"].gap == 5.0 == box(scene, "bar").origin[2]
    assert scene.interface["wall"].against_ground


def test_shear_interface() -> None:
    scene = load_scene(MODELS / "shear_interface" / "scene.toml")
    steel, fault = scene.material["steel"], scene.interface["fault"]
    shear_speed = math.sqrt(steel.young_modulus / (2 * (1 + steel.poisson_ratio)) / steel.density)
    law, incident = scene.load["incident"].law, scene.load["incident"].traction
    assert isinstance(law, HalfSineLaw)
    assert law.duration == pytest.approx(0.1 / shear_speed, rel=1e-15)
    assert scene.time.time_step == pytest.approx(0.1 / shear_speed / 100, rel=1e-15)
    assert incident is not None
    assert incident[0] == pytest.approx(2 * 2 * fault.friction_coefficient * fault.preload)
    assert sum(isinstance(boundary, Periodic) for boundary in scene.boundary.values()) == 4
    # the numbers of the README
    slip = 2 * 3e6 / (steel.density * shear_speed) * law.duration * (2 * math.sqrt(3) - 2 * math.pi / 3) / math.pi
    assert slip == pytest.approx(3.11422e-6, rel=1e-5)
    assert slip * 3e6 == pytest.approx(9.34267, rel=1e-5)


@pytest.mark.parametrize(
    ("file", "stiffness", "on_ground"), [("scene", 70e9, 0), ("ground", 70e9, 1), ("soft", 2.1e9, 0)]
)
def test_two_specimen_crushing(file: str, stiffness: float, on_ground: int) -> None:
    scene = load_scene(MODELS / "two_specimen_crushing" / f"{file}.toml")
    assert scene.material[scene.substructure["lower"].material].young_modulus == stiffness
    assert scene.material[scene.substructure["upper"].material].young_modulus == 210e9
    assert scene.interface["crush"].friction_coefficient == 0.1
    assert ("ground" in scene.interface) == bool(on_ground)
    assert ("lower_base" in scene.boundary) != bool(on_ground)
    assert box(scene, "upper").origin[2] == box(scene, "lower").size[2]
    assert (scene.time.n_step, scene.time.step) == (200, 0.15e-6)
    check_quarter_symmetry(scene)


@pytest.mark.parametrize("n_block", [2, 4, 8, 16])
def test_stacked_blocks(n_block: int) -> None:
    scene = load_scene(MODELS / "stacked_blocks" / f"n{n_block:02d}.toml")
    names = [f"b{i:02d}" for i in range(1, n_block + 1)]
    assert list(scene.substructure) == names
    for i, name in enumerate(names):
        stiffness = scene.material[scene.substructure[name].material].young_modulus
        assert stiffness == (210e9 if i % 2 else 70e9)
        assert box(scene, name).elements == (4, 4, 4)
        assert box(scene, name).size == (0.01, 0.01, 0.01)
        assert box(scene, name).origin[2] == pytest.approx(0.01 * i, rel=1e-15, abs=0.0)
    assert {name: interface.sides for name, interface in scene.interface.items()} == {
        f"i{i:02d}": (f"b{i:02d}.zmax", f"b{i + 1:02d}.zmin") for i in range(1, n_block)
    }
    assert all(interface.friction_coefficient == 0.3 for interface in scene.interface.values())
    assert scene.load["press"].face == f"{names[-1]}.zmax"
    assert (scene.time.n_step, scene.time.step) == (200, 0.2e-6)
    check_quarter_symmetry(scene)


def check_quarter_symmetry(scene: Scene) -> None:
    planes = {boundary.face for boundary in scene.boundary.values() if isinstance(boundary, Symmetry)}
    lateral = {f"{name}.{face}" for name in scene.substructure for face in ("xmin", "ymin")}
    assert lateral <= planes
    assert len(planes - lateral) <= 1


def test_mesh_of_punched_plates() -> None:
    """The groups that the scene uses are kept by meshio; facing groups have nodes at the same places."""
    scene = load_scene(MODELS / "punched_plates" / "scene.toml")
    mesh = meshio.read(scene.base_dir / "plates.msh")
    groups = {name: tag for name, (tag, _) in mesh.field_data.items()}
    tags = mesh.cell_data["gmsh:physical"]

    def nodes(group: str) -> np.ndarray:
        blocks = [block.data[tag == groups[group]] for block, tag in zip(mesh.cells, tags, strict=True)]
        return np.unique(np.concatenate([block.ravel() for block in blocks]))

    for name, body in scene.substructure.items():
        assert body.mesh is not None, name
        assert body.mesh.group in groups
        assert body.mesh.scale == 1e-3
    for name, interface in scene.interface.items():
        first, second = (nodes(side.split(".")[1]) for side in interface.sides)
        assert not set(first) & set(second)
        places = [np.sort(mesh.points[side].view("f8,f8,f8").ravel()) for side in (first, second)]
        np.testing.assert_array_equal(places[0], places[1], err_msg=name)
    count: Counter[str] = Counter()
    for block in mesh.cells:
        count[block.type] += len(block.data)
    assert count == {"hexahedron": 1104, "quad": 816}
    assert set(nodes("punch_foot")) < set(nodes("punch"))


def test_other_settings_for_a_model() -> None:
    path = MODELS / "two_specimen_crushing" / "scene.toml"
    assert load_scene(path, ["interface.crush.friction_coefficient=0.3"]).interface["crush"].friction_coefficient == 0.3
    with pytest.raises(SceneError, match="did you mean 'crush'"):
        load_scene(path, ["interface.crash.friction_coefficient=0.3"])
