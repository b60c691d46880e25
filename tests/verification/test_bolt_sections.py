"""Forces and moments on sections of shanks: statics of a cantilever, balance of a flange, one answer of all marches."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from latin_fmu import scene_from_dict, solve
from latin_fmu.assembly.bolts import BoltCut
from latin_fmu.building import discretise, started
from latin_fmu.latin.outcome import BoltHistory
from latin_fmu.results.solution import Solution

from .bolted_meshes import write_joint
from .screw_meshes import Part, Profile, write
from .test_bolts import E, bar, joint
from .test_threads import _flat
from .test_threads import scene as tapped_screw

Array = np.ndarray
LENGTH, WIDTH = 0.05, 0.01
PUSH, MOMENT = [40.0, -70.0, 300.0], [0.3, -0.5, 0.8]  # N, N m
RAMP = {"type": "table", "times": [0, 1], "values": [0, 1]}
ECCENTRIC = {"pull": {"face": "upper.far", "traction": [2e6, 1e6, 4e6], "law": RAMP}}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Meshes of two plates and one bolt."""
    return write_joint(tmp_path_factory.mktemp("joint"))


def on(bolt: BoltHistory, name: str, instant: int = -1) -> tuple[Array, Array, Array]:
    """Force, moment and centre of a section."""
    assert bolt.sections is not None
    assert bolt.section_force is not None
    assert bolt.section_moment is not None
    i = bolt.sections.names.index(name)
    return bolt.section_force[instant, i], bolt.section_moment[instant, i], bolt.sections.centres[i]


def whole(bolt: BoltHistory) -> Array:
    """Forces and moments of all sections over time, (n_time, n_section, 6)."""
    assert bolt.section_force is not None
    assert bolt.section_moment is not None
    return np.concatenate([bolt.section_force, bolt.section_moment], axis=2)


# -- statics ----------------------------------------------------------------------------------------------------------
def test_cantilever_has_the_forces_of_statics() -> None:
    """A bar that is held at its foot, with a force beside the axis of its tip and a moment: axial and shear forces,
    torsion and bending moments at two sections, on a coarse mesh, to round-off."""
    tip = {"face": "bar.zmax", "force": PUSH, "moment": MOMENT, "point": [WIDTH, WIDTH / 2, LENGTH], "law": RAMP}
    scene = bar(["zmin"], {"shortening": 1e-6}, load={"tip": tip})
    bolt = solve(scene_from_dict(scene)).bolts["b"]
    assert bolt.sections is not None
    assert bolt.sections.names == ("cut", "thread")
    assert bolt.sections.missing == ("no head: nothing holds this end of the shank",)
    np.testing.assert_allclose(bolt.sections.directions, [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-15)
    for name in bolt.sections.names:
        force, moment, centre = on(bolt, name)
        np.testing.assert_allclose(centre[:2], WIDTH / 2)
        expected = np.asarray(MOMENT) + np.cross(tip["point"] - centre, PUSH)
        # N, Vx, Vy and T, Mx, My of what lies beyond
        np.testing.assert_allclose(force, np.roll(PUSH, 1), atol=1e-6 * max(PUSH))
        np.testing.assert_allclose(moment, np.roll(expected, 1), atol=1e-6 * np.abs(expected).max())


def test_flange_under_an_eccentric_pull_is_in_balance(files: dict[str, Path]) -> None:
    """The upper plate and the bolt above the joint: load, contact forces of the joint, and the section of the shank."""
    solution = solve(scene_from_dict(joint(files, load=ECCENTRIC)))
    bolt, plates = solution.bolts["b"], solution.interfaces["plates"]
    force, moment, centre = on(bolt, "parting")
    assert bolt.sections is not None
    to_global = bolt.sections.directions.T
    ready = discretise(scene_from_dict(joint(files, load=ECCENTRIC)))
    face = ready.bodies["upper"].face("far")
    pulled = face.areas[:, None] * np.asarray(ECCENTRIC["pull"]["traction"])
    # on side E, the lower plate
    pressed = -plates.areas[:, None] * plates.traction[-1]
    places = [ready.bodies["upper"].mesh.nodes[face.nodes], plates.points, centre[None]]
    forces = [pulled, pressed, -(to_global @ force)[None]]
    total = sum(f.sum(axis=0) for f in forces)
    turned = sum(np.cross(x, f).sum(axis=0) for x, f in zip(places, forces, strict=True)) - to_global @ moment
    assert np.abs(total).max() < 1e-4 * np.linalg.norm(pulled.sum(axis=0))
    assert np.abs(turned).max() < 1e-4 * np.linalg.norm(np.cross(places[0], pulled).sum(axis=0))
    # the bolt bends, and is more bent at its ends than at the joint
    bending = {name: float(np.linalg.norm(on(bolt, name)[1][1:])) for name in bolt.sections.names}
    assert bending["head"] > 2.0 * bending["parting"] > 0.0


# -- the same as the tension ------------------------------------------------------------------------------------------
def cut_of(scene: dict[str, Any], stressed: bool = False) -> BoltCut:
    """The cut of the bolt of a scene, with the stiffness of its stress where it is ``stressed``."""
    problem = discretise(scene_from_dict(scene))
    return (started(problem, {})[0] if stressed else problem).cuts["b"]


@pytest.mark.parametrize("stressed", [False, True])
def test_axial_force_at_the_cut_is_the_tension(files: dict[str, Path], stressed: bool) -> None:
    """Its row is that of the cut, found another way, with the stiffness of stress too."""
    moving = {"time": {"end": 1e-6, "instants": 1}, "effects": {"prestress": "on"}}
    cut = cut_of(joint(files, **(moving if stressed else {})), stressed)
    plain = cut_of(joint(files))
    # the stress changes the row
    changed = np.abs(cut.pattern - plain.pattern).max() > 1e-9 * np.abs(plain.pattern).max()
    assert bool(changed) is stressed
    first = cut.sections[0]
    np.testing.assert_allclose(first.pattern[[0]].toarray()[0], cut.pattern, atol=1e-12 * np.abs(cut.pattern).max())
    assert first.jumps["b"][0] == pytest.approx(cut.stiffness, rel=1e-12)
    assert first.heated[0] == pytest.approx(cut.heated, rel=1e-9, abs=1e-9 * cut.stiffness)
    # a rigid translation strains nothing, and no rotation does where there is no stress
    if not stressed:
        shift = np.tile([1.0, 2.0, 3.0], len(cut.moving))
        size = np.abs(cut.rows).max()
        np.testing.assert_allclose(cut.rows @ shift, 0.0, atol=1e-9 * size)


def heated_joint(files: dict[str, Path]) -> dict[str, Any]:
    """A joint whose bolt alone is heated, and cools down again by half."""
    scene = joint(files)
    scene["material"]["steel"]["thermal_expansion"] = 12e-6
    law = {"type": "table", "times": [0.0, 1.0], "values": [0.0, 1.0]}
    scene["temperature"] = {"warm": {"substructures": ["bolt"], "change": 40.0, "law": law}}
    return scene


def test_heat_is_in_all_sections(files: dict[str, Path]) -> None:
    """A shank that only its ends hold has one axial force, however warm it is."""
    bolt = solve(scene_from_dict(heated_joint(files))).bolts["b"]
    assert abs(bolt.force[-1] - bolt.force[0]) > 0.01 * bolt.force[0]
    assert bolt.section_force is not None
    np.testing.assert_allclose(bolt.section_force[..., 0], np.tile(bolt.force[:, None], 4), rtol=1e-6)


@pytest.fixture(scope="module")
def shaken(files: dict[str, Path]) -> dict[str, Solution]:
    """A joint under a short push: with contacts, and bonded, directly and by modes."""
    push = {"type": "half_sine", "duration": 100e-6}
    load = {"push": {"face": "upper.far", "traction": [5e6, 2e6, 0.0], "law": push}}
    scene = joint(files, load=load, time={"end": 100e-6, "step": 1e-6})
    scene |= {"output": {"fields": True, "every": 1}, "effects": {"prestress": "off"}}
    bonds = {name: {"sides": t["sides"], "behaviour": "perfect"} for name, t in scene["interface"].items()}
    bonded = scene | {"interface": bonds, "accuracy": {"estimate": False}}
    return {
        "contacts": solve(scene_from_dict(scene)),
        "direct": solve(scene_from_dict(bonded | {"solver": {"propagator": "direct"}})),
        "modal": solve(scene_from_dict(bonded | {"solver": {"propagator": {"type": "modal", "highest": 1e6}}})),
    }


@pytest.mark.slow
@pytest.mark.parametrize("march", ["contacts", "direct", "modal"])
def test_marches_read_the_sections_of_their_motion(
    files: dict[str, Path], shaken: dict[str, Solution], march: str
) -> None:
    """What is recorded at every instant is that of the displacements of the bolt that the run has stored."""
    solution = shaken[march]
    recorded, moved = whole(solution.bolts["b"]), solution.substructures["bolt"].displacement
    assert moved is not None
    bolt = solution.bolts["b"]
    assert bolt.sections is not None
    cut = cut_of(joint(files))
    terms = cut.terms({})["bolt.b"] * bolt.shortening
    found = (terms - moved.reshape(len(moved), -1) @ cut.rows.T).reshape(len(moved), -1, 6)[:, bolt.sections.rows]
    for part in (slice(0, 3), slice(3, 6)):
        changed = np.abs(recorded[..., part] - recorded[0, :, part]).max()
        assert changed > 0.01 * np.abs(recorded[..., part]).max()
        np.testing.assert_allclose(found[..., part], recorded[..., part], atol=1e-4 * changed)


def test_marches_have_one_answer(shaken: dict[str, Solution]) -> None:
    """Every section of the shank, directly and by modes: their time schemes damp the motion of a coarse mesh apart."""
    direct, modal = (whole(shaken[name].bolts["b"]) for name in ("direct", "modal"))
    for part in (slice(0, 3), slice(3, 6)):
        changed = direct[..., part] - direct[0, :, part]
        apart = np.linalg.norm(modal[..., part] - direct[..., part]) / np.linalg.norm(changed)
        assert apart < 0.1


def test_datasets_have_the_sections(shaken: dict[str, Solution]) -> None:
    """Forces with the names of sections and directions, the margins with their clauses."""
    tree = shaken["contacts"].to_datatree()["bolts/b"]
    tension = tree["section_force"].sel(section="cut", direction="axial")
    np.testing.assert_array_equal(tension.values, tree["force"].values)
    assert tree["section_moment"].attrs["units"] == "N m"
    np.testing.assert_allclose(tree["direction_vector"].sel(direction="axial"), [0, 0, 1])
    edge = tree["nominal_stress"] + tree["bending_stress"]
    np.testing.assert_allclose(tree["edge_stress"], edge)
    assert dict(zip(tree["check"].values, tree["clause"].values, strict=True))["slip"] == "R12/4"
    report = shaken["contacts"].report()["bolts"]["b"]
    assert report["sections"]["head"]["bending"] == pytest.approx(
        float(np.linalg.norm(tree["section_moment"].sel(section="head")[:, 1:], axis=1).max())
    )


def test_half_a_screw_has_no_bending_stress(files: dict[str, Path]) -> None:
    """The moments of a part of a screw are none of the whole."""
    scene = joint(files)
    scene["bolt"]["b"] |= {"share": 0.5, "thread": "M12"}
    scene["bolt"]["b"]["force"] = 2000.0
    solution = solve(scene_from_dict(scene))
    tree = solution.to_datatree()["bolts/b"]
    assert "bending_stress" not in tree.data_vars
    assert "edge_yield" not in tree["check"].values


def test_a_section_that_is_not_there_is_told() -> None:
    """Both ends of a bar whose nodes are held, two layers of elements: one section alone, without a traceback."""
    scene = bar(["zmin", "zmax"], {"shortening": 1e-6})
    bolt = solve(scene_from_dict(scene)).bolts["b"]
    assert bolt.sections is not None
    assert bolt.sections.names == ("head", "cut", "thread")
    np.testing.assert_allclose(bolt.section_force[-1, :, 0], bolt.force[-1], rtol=1e-9)  # type: ignore[index]
    np.testing.assert_allclose(bolt.force[-1], E * WIDTH**2 * 1e-6 / LENGTH, rtol=0.2)


@pytest.mark.slow
def test_on_tetrahedra_the_thread_begins_beyond_its_section(tmp_path: Path) -> None:
    """Stepped sections: no node of the bond lies between the section ``thread`` and the cut, but on the section; the
    joint, at the mouth of the hole, has one of its own."""
    tapped: Profile = ((0, -12), (2.5, -12), (2.5, 0.01), (0, 0.01))
    clear: Profile = ((0, -0.01), (2.8, -0.01), (2.8, 6.01), (0, 6.01))
    screw: Profile = ((0, -8), (2.5, -8), (2.5, 6), (4.25, 6), (4.25, 10), (0, 10))
    parts = {
        "screw": Part(screw),
        "base": Part(tapped, ((-10, -10, -14), (20, 20, 14)), {"bottom": _flat(-14.0)}),
        "plate": Part(clear, ((-10, -10, 0), (20, 20, 6)), {"top": _flat(6.0)}),
    }
    file = write(tmp_path / "parts.msh", parts, 4.0, order=1)
    ready = discretise(scene_from_dict(tapped_screw(file, {"size": "M5", "part": "base"})))
    cut, mesh = ready.cuts["m5"], ready.bodies["screw"].mesh
    assert cut.named is not None
    assert cut.named.names == ("head", "cut", "parting", "thread")
    assert [face.interface for face in cut.clamped] == ["base_plate"]
    section = cut.sections[cut.named.rows[cut.named.names.index("thread")]]
    bond = next(unit for unit in ready.units if not unit.behaviour.opens)
    side = [face.split(".")[0] for face in bond.sides].index("screw")
    trace = bond.geometry.traces[side]
    assert trace is not None
    held = np.unique(trace.indices) // 3
    near = np.unique(mesh.blocks[0].cells[section.side])
    assert np.isin(held, section.nodes).any()
    assert not np.isin(held, np.setdiff1d(near, section.nodes)).any()
