"""Frequencies of assemblies: closed forms of bars, cut bodies against whole ones, joints open, sticking and bonded."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

import latin_fmu
from latin_fmu.cli import main
from latin_fmu.modal.modes import Joints, vibration_modes
from latin_fmu.stability.scenes import Box, Material, column, rubbing

E, RHO, L, N = 210e9, 7800.0, 1.0, 20
C = np.sqrt(E / RHO)
SIDES = ("xmin", "xmax", "ymin", "ymax")
STEEL = Material(E, RHO, name="steel")


def bars(
    *pieces: tuple[int, int], interface: dict[str, Any] | None = None, ground: bool = False, gap: float = 0.0
) -> latin_fmu.Scene:
    """A bar along z of pieces end to end, (elements along, elements across), that moves along its axis only.

    ``interface`` between the pieces; ``ground`` below the first one; ``gap`` between the pieces.
    """
    total = sum(n for n, _ in pieces)
    bodies = {
        f"b{i}": Box(STEEL, (0.1, 0.1, L * n / total), (across, across, n)) for i, (n, across) in enumerate(pieces)
    }
    joints = {f"cut{i}": interface or {"behaviour": "perfect"} for i in range(len(pieces) - 1)}
    boundary = {f"{b}{s}": {"type": "symmetry", "face": f"{b}.{s}"} for b in bodies for s in SIDES}
    data = column(bodies, joints, {"end": 1e-3, "instants": 10}, gap, boundary=boundary)
    if ground:
        data["interface"]["base"] = rubbing("b0.zmin", "ground", 0.3)
    return latin_fmu.scene_from_dict(data)


def test_free_free_bar() -> None:
    """f = k c / (2 L); eight-node elements with consistent mass: (k pi / n)^2 / 24 too high."""
    modes = vibration_modes(bars((N, 1)), count=2)
    assert modes.rigid.tolist() == [True, False, False]
    assert modes.frequency[0] == 0.0
    assert modes.frequency[1:] == pytest.approx(np.array([1, 2]) * C / (2 * L), rel=5e-3)
    assert modes.modal_mass[1] == pytest.approx(RHO * 0.01 * L / 2, rel=5e-3)
    z = modes.meshes["b0"].nodes[:, 2]
    shape = modes.shapes["b0"][1, :, 2]
    assert shape == pytest.approx(np.sign(shape[0]) * np.cos(np.pi * z / L), abs=2e-3)


def test_effective_masses_of_a_bar() -> None:
    """A bar held at one end: participation 4 / ((2 k - 1) pi), effective mass 8 m / ((2 k - 1) pi)^2; a free bar moves
    with its base as a rigid body only."""
    modes = vibration_modes(bars((N, 1), ground=True), "bonded", count=4)
    odd, mass = 2 * np.arange(1, 4) - 1, RHO * 0.01 * L
    assert modes.mass == pytest.approx(mass)
    for k, n in enumerate(odd):  # elements with consistent mass: off by the square of their length
        assert abs(modes.participation[k, 2]) == pytest.approx(4 / (n * np.pi), rel=5.5e-4 * n**2)
        assert modes.effective_mass[k, 2] == pytest.approx(8 * mass / (n * np.pi) ** 2, rel=5.5e-4 * n**2)
    # all modes leave M_hh - M_hf M_ff^-1 M_fh of the nodes that are held
    every = vibration_modes(bars((N, 1), ground=True), "bonded", count=4 * N)
    assert every.effective_mass[:, 2].sum() == pytest.approx(mass * (1 - np.sqrt(3) / (6 * N)), rel=1e-6)
    free = vibration_modes(bars((N, 1)), count=3)
    assert free.effective_mass[:, 2] == pytest.approx([mass, 0.0, 0.0, 0.0], abs=1e-9 * mass)


def test_effective_masses_of_free_bodies() -> None:
    """Six rigid motions carry the whole mass along each axis, rigid bodies and elastic ones alike."""
    data = blocks(behaviour="elastic_layer", normal_stiffness=1e9, tangential_stiffness=2e9).tables()
    data["substructure"]["low"]["rigid"] = True
    modes = vibration_modes(latin_fmu.scene_from_dict(data), count=2)
    assert modes.n_rigid == 6
    assert modes.effective_mass[:6].sum(axis=0) == pytest.approx(np.full(3, 2 * RHO * 0.4))
    assert modes.effective_mass[6:].max() < 1e-6 * RHO
    assert "100 %, 100 %, 100 %" in "\n".join(modes.lines())


@pytest.mark.parametrize("joints", ["sticking", "bonded"])
def test_a_bar_on_the_ground(joints: Joints) -> None:
    modes = vibration_modes(bars((N, 1), ground=True), joints, count=2)
    assert modes.n_rigid == 0
    assert modes.frequency == pytest.approx(np.array([1, 3]) * C / (4 * L), rel=5e-3)


@pytest.mark.parametrize(
    ("pieces", "tolerance"),
    [(((8, 2), (12, 2)), 1e-10), (((8, 3), (12, 2)), 1e-9), (((5, 2), (7, 3), (8, 2)), 1e-9)],
    ids=["matching", "other mesh", "three"],
)
def test_a_cut_bar_has_the_frequencies_of_the_whole_one(pieces: tuple[tuple[int, int], ...], tolerance: float) -> None:
    whole = vibration_modes(bars((N, 2)), count=5).frequency
    cut = vibration_modes(bars(*pieces), count=5)
    assert cut.frequency == pytest.approx(whole, rel=tolerance)
    ends = [cut.meshes["b0"].nodes[:, 2].max(), cut.meshes["b1"].nodes[:, 2].min()]
    for mode in range(6):  # both sides of the cut move alike
        low, up = (
            cut.shapes[n][mode, cut.meshes[n].nodes[:, 2] == z, 2] for n, z in zip(("b0", "b1"), ends, strict=True)
        )
        assert low.mean() == pytest.approx(up.mean(), abs=1e-8)
    touching = bars(*pieces, interface={"friction_coefficient": 0.3})
    assert vibration_modes(touching, "sticking", 5).frequency == pytest.approx(whole, rel=tolerance)
    assert vibration_modes(bars(*pieces, interface={"behaviour": "no_slip"})).frequency[1:6] == pytest.approx(whole[1:])


def test_an_open_joint_leaves_the_pieces() -> None:
    touching = bars((10, 1), (10, 1), interface={"friction_coefficient": 0.3})
    open_joint = vibration_modes(touching, "open", 2)
    half = vibration_modes(bars((10, 1)), count=1).frequency[1] * 2  # half as long
    assert open_joint.n_rigid == 2
    assert open_joint.frequency[2:] == pytest.approx([half, half], rel=1e-9)
    apart = bars((10, 1), (10, 1), interface={"friction_coefficient": 0.3}, gap=1e-4)
    assert vibration_modes(apart, "sticking", 2).frequency == pytest.approx(open_joint.frequency, rel=1e-9)
    assert vibration_modes(apart, "bonded", 2).n_rigid == 1  # whatever the gap


def test_an_interface_declared_twice_changes_nothing() -> None:
    scene = bars((8, 3), (12, 2))
    data = scene.tables()
    data["interface"]["again"] = data["interface"]["cut0"]
    twice = vibration_modes(latin_fmu.scene_from_dict(data), count=3)
    assert twice.frequency == pytest.approx(vibration_modes(scene, count=3).frequency, rel=1e-4)


def blocks(**joint: Any) -> latin_fmu.Scene:
    """Two free blocks, one on the other; ``joint``: keys of the interface."""
    block = Box(Material(E, RHO, 0.3), (1.0, 0.8, 0.5), (2, 2, 2))
    bodies, time = {"low": block, "up": block}, {"end": 1e-3, "instants": 10}
    return latin_fmu.scene_from_dict(column(bodies, {"joint": joint}, time))


@pytest.mark.parametrize(
    ("joints", "friction", "rigid"), [("open", 0.3, 12), ("sticking", 0.3, 6), ("sticking", 0.0, 9), ("bonded", 0.0, 6)]
)
def test_rigid_motions_of_two_blocks(joints: Joints, friction: float, rigid: int) -> None:
    """Without friction one block slides on the other in two directions and turns about the normal."""
    modes = vibration_modes(blocks(friction_coefficient=friction), joints, 3)
    assert modes.n_rigid == rigid
    assert modes.frequency[rigid:].min() > 100.0


@pytest.mark.parametrize("behaviour", ["elastic_layer", "soft_contact"])
def test_rigid_blocks_on_a_layer(behaviour: str) -> None:
    """omega^2 = k A (1/m + 1/m) along the normal."""
    k = 1e9
    keys = {"normal_stiffness": k} | ({"tangential_stiffness": 2e9} if behaviour == "elastic_layer" else {})
    data = blocks(behaviour=behaviour, **keys).tables()
    for body in data["substructure"].values():
        body["rigid"] = True
    modes = vibration_modes(latin_fmu.scene_from_dict(data), count=6)
    expected = np.sqrt(k * 0.8 * 2 / (RHO * 0.4)) / (2 * np.pi)
    assert modes.n_rigid == (6 if behaviour == "elastic_layer" else 9)
    along = [i for i in range(modes.n_rigid, len(modes.frequency)) if np.ptp(modes.shapes["up"][i, :, 2]) < 1e-9]
    along = [i for i in along if abs(modes.shapes["up"][i, 0, 2]) > 0.5]
    assert modes.frequency[along] == pytest.approx([expected], rel=1e-9)


def test_file_paraview_and_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(bars((10, 1), (10, 1), interface={"friction_coefficient": 0.3}).text())
    file, folder = tmp_path / "modes.nc", tmp_path / "shapes"
    assert main(["modes", str(scene), "--count", "3", "-o", str(file), "--vtk", str(folder)]) == 0
    printed = capsys.readouterr().out
    assert "cut0 (contact): sticking, 4 of 4 points closed" in printed
    assert "rigid" in printed
    tree = latin_fmu.open_results(file)
    assert tree["modes/frequency"].attrs["units"] == "Hz"
    assert tree["modes/rigid"].values.tolist() == [1, 0, 0, 0]
    shape = tree["substructures/b1/shape"].values
    assert shape.shape == (4, 44, 3)
    tree.close()
    played = meshio.read(folder / "substructure_b1_00002.vtu")
    assert played.point_data["shape"] == pytest.approx(shape[2], abs=1e-6)
    assert main(["modes", str(scene), "--count", "0"]) == 2
    assert "--count: out of range (value: 0); allowed: 1 to 1000" in capsys.readouterr().err


def test_a_quasi_static_scene_has_frequencies() -> None:
    modes = vibration_modes(
        latin_fmu.load_scene(Path(__file__).parents[2] / "models/pressed_plates/scene.toml"), count=2
    )
    assert modes.n_rigid == 0
    assert (modes.frequency > 0).all()


def test_bolt_without_tension_slides_in_the_thread() -> None:
    """A bar of three boxes, the one in the middle a bolt: open, its ends come apart along it, one zero mode more;
    bending keeps its frequencies."""
    steel = Material(200e9, 7800.0, 0.3)
    lengths = {"low": (0.03, 4), "bolt": (0.04, 6), "high": (0.03, 4)}
    bodies = {name: Box(steel, (0.01, 0.01, length), (2, 2, n)) for name, (length, n) in lengths.items()}
    bonds = {key: {"behaviour": "perfect"} for key in ("below", "above")}
    bolt = {"b": {"substructure": "bolt", "axis": [0, 0, 1], "shortening": 1e-5}}
    scene = latin_fmu.scene_from_dict(column(bodies, bonds, {"end": 1e-5, "instants": 10}, bolt=bolt))
    slides, tight = (vibration_modes(scene, joints, 4) for joints in ("open", "bonded"))
    assert (slides.n_rigid, tight.n_rigid) == (7, 6)
    np.testing.assert_allclose(slides.frequency[7:9], tight.frequency[6:8], rtol=1e-6)


# -- nearly closed points -------------------------------------------------------------------------------------------
def against_a_stop(gap: float, load: float = 0.0, friction: float = 0.0) -> latin_fmu.Scene:
    """A bar on the ground whose end is a gap from a stop; ``load`` : static force along the bar, N."""
    data = bars((N, 1), ground=True).tables()
    data["interface"]["base"] = {"sides": ["b0.zmin", "ground"], "behaviour": "perfect"}
    data["interface"]["stop"] = {"sides": ["b0.zmax", "ground"], "gap": gap, "friction_coefficient": friction}
    if load:
        data["load"] = {"pull": {"face": "b0.zmax", "force": [0.0, 0.0, load]}}
        data["time"]["start"] = "static"
    return latin_fmu.scene_from_dict(data)


@pytest.mark.parametrize(("gap", "load"), [(3e-6, 0.0), (5e-6, 2e-6 * E * 0.01 / L), (2e-6, -1e-6 * E * 0.01 / L)])
def test_a_nearly_closed_stop_gives_a_range(gap: float, load: float) -> None:
    """f = (2 k - 1) c / (4 L) with the stop open, k c / (2 L) with it closed; the gap is that under the static load."""
    modes = vibration_modes(against_a_stop(gap, load), count=2)
    assert modes.frequency == pytest.approx(np.array([1, 3]) * C / (4 * L), rel=5e-3)
    assert modes.frequency_closed == pytest.approx(np.array([1, 2]) * C / (2 * L), rel=5e-3)
    assert modes.near["stop"] == pytest.approx(np.full(4, 3e-6), rel=1e-6)
    text = "\n".join(modes.lines())
    assert "if closed" in text
    assert "nearly closed, open by less than 0.0001 of the size of the assembly: stop 4 points by 3.00 um" in text
    assert modes.to_datatree()["modes/frequency_closed"].values == pytest.approx(modes.frequency_closed)


@pytest.mark.parametrize("joints", ["open", "bonded"])
def test_only_sticking_joints_have_a_range(joints: Joints) -> None:
    assert not vibration_modes(against_a_stop(3e-6), joints, 1).near


def test_a_wide_gap_is_open() -> None:
    wide = vibration_modes(against_a_stop(1e-3), count=1)
    assert wide.frequency_closed is None
    assert "nearly closed" not in "\n".join(wide.lines())


def test_points_whose_closing_changes_nothing() -> None:
    """A second bar beside the first one that could touch it at its fixed end only: no column, one sentence."""
    data = against_a_stop(1e-3).tables()
    data["interface"]["rest"] = {"sides": ["b0.zmin", "ground"], "gap": 1e-6}
    del data["interface"]["base"]
    data["boundary"]["held"] = {"type": "fixed", "face": "b0.zmin"}
    modes = vibration_modes(latin_fmu.scene_from_dict(data), count=2)
    assert modes.frequency_closed == pytest.approx(modes.frequency)
    text = "\n".join(modes.lines())
    assert "if closed" not in text
    assert "closed, they change no frequency by more than 0.1 %" in text
