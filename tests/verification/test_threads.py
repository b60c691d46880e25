"""Threads without a face: lengths, holes that fit, axes, moduli; slips of the keyboard; many screws by one table."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from latin_fmu import scene_from_dict, solve
from latin_fmu.assembly.body import Body, build_bodies
from latin_fmu.assembly.threads import BoundaryFacets, Mask, with_threads
from latin_fmu.building import discretise
from latin_fmu.errors import Problems, SceneError
from latin_fmu.fem.elasticity import Isotropic
from latin_fmu.fem.elements import Elements, MeanStress, stiffness
from latin_fmu.fem.mesh import FacetBlock, FacetSet, box_mesh
from latin_fmu.scene.reference import reference_schema
from latin_fmu.scene.threads import tensile_stress_area, thread_named
from latin_fmu.scene.units import SI
from latin_fmu.stability.surfaces import turned, write_mesh

from .bolted_meshes import Lattice
from .screw_meshes import Part, Profile, write

R, HEAD = 2.5, 4.25  # radii of shank and head, mm
PRELOAD = 5e3
CORE = 0.5 * 4.01855  # radius of the core of M5, mm: d - 17/12 sqrt(3)/2 P by hand


def _flat(low: float) -> Any:
    return lambda _, z, extent: extent < 1e-3 and abs(z - low) < 1e-3


def _seat(height: float, up: float) -> Any:
    return lambda x, n: (np.abs(x[:, 2] - 1e-3 * height) < 1e-7) & (n[:, 2] * up > 0.9)


def scene(file: Path, thread: Any) -> dict[str, Any]:
    """A screw whose thread is in a block."""
    law = {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}
    return {
        "name": "thread",
        "material": {"steel": law},
        "mesh": {"cad": {"file": str(file), "scale": 1e-3, "parts": "*", "material": "steel"}},
        "contact": {"all": {"search": 0.05e-3, "friction_coefficient": 0.2}},
        "boundary": {"floor": {"type": "fixed", "face": "base.bottom"}},
        "bolt": {"m5": {"substructure": "screw", "force": PRELOAD, "thread": thread}},
        "time": {"quasi_static": True, "end": 1.0, "instants": 1},
    }


# -- lengths, holes, axes ---------------------------------------------------------------------------------------------
def _lattice(folder: Path, hole: float = R, turn: Any = None) -> dict[str, Any]:
    """A screw and a sleeve of hexahedra in layers of 2 mm, held at the top of the head and the foot of the sleeve."""
    heights = [1e-3 * z for z in range(-8, 11, 2)]
    screw = Lattice([R * 1e-3, HEAD * 1e-3], heights, n_core=4).part(
        lambda r, z: (r < R * 1e-3) | (z > 6e-3), {"top": lambda x, n: (x[:, 2] > 9.9e-3) & (n[:, 2] > 0.9)}
    )
    sleeve = Lattice([hole * 1e-3, 7e-3], heights, n_core=4).part(
        lambda r, z: (r > hole * 1e-3) & (z < 0.0), {"foot": lambda x, n: (x[:, 2] < -7.9e-3) & (n[:, 2] < -0.9)}
    )
    for name, mesh in (("screw", screw), ("sleeve", sleeve)):
        write_mesh(folder / f"{name}.msh", mesh, *([] if turn is None else [lambda x: x @ turn.T]))
    held = {"top": "screw.top", "foot": "sleeve.foot"}
    return {
        "name": "sleeve",
        "material": {"steel": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}},
        "substructure": {
            n: {"material": "steel", "mesh": {"file": str(folder / f"{n}.msh")}} for n in ("screw", "sleeve")
        },
        "boundary": {name: {"type": "fixed", "face": face} for name, face in held.items()},
        "bolt": {"m5": {"substructure": "screw", "force": PRELOAD, "thread": {"size": "M5", "part": "sl*"}}},
        "time": {"quasi_static": True, "end": 1.0, "instants": 1},
    }


@pytest.mark.parametrize(
    ("length", "reached", "words"),
    [
        (None, "0.008 m", ""),
        (6e-3, "0.006 m", ""),
        (4.5e-3, "0.0045 m", ""),
        (12e-3, "0.008 m of 0.012 asked for", "in the place of 0.012: shank and hole of sleeve overlap over 0.008 m"),
    ],
)
def test_the_length_reached_is_told(length: float | None, reached: str, words: str, tmp_path: Path) -> None:
    """Exactly, with an edge of the mesh there or without; a length longer than the overlap by a tenth is warned."""
    data = _lattice(tmp_path)
    data["bolt"]["m5"]["thread"] |= {} if length is None else {"length": length}
    problem = discretise(scene_from_dict(data))
    assert f"thread bonded to sleeve over {reached}" in problem.cuts["m5"].note
    told = [remark for remark in problem.remarks if remark.code == "thread"]
    assert len(told) == bool(words)
    assert all(words in text for text in told)
    # sixteen chords around
    around = 32 * R * 1e-3 * np.sin(np.pi / 16)
    unit = next(unit for unit in problem.units if unit.name == "m5_thread")
    assert unit.geometry.areas.sum() == pytest.approx(around * float(reached.split()[0]), rel=1e-9)


@pytest.mark.parametrize(("ratio", "fits"), [(0.7, False), (0.75, True), (0.84, True), (1.1, True), (1.2, False)])
def test_holes_from_core_to_nominal_fit(ratio: float, fits: bool, tmp_path: Path) -> None:
    data = _lattice(tmp_path, ratio * R)
    if fits:
        made = discretise(scene_from_dict(data))
        (unit,) = made.units
        assert unit.name == "m5_thread"
        # that a thread is deeper than its hole is no surprise; it is told beside the interface
        assert not [remark for remark in made.remarks if remark.code == "overlap"]
        assert "overlap" in unit.note or ratio == 1.1
        return
    with pytest.raises(SceneError, match=rf"bolt.m5.thread.part: no round hole.*sleeve: {2e-3 * ratio * R:.4g} m"):
        discretise(scene_from_dict(data))


def test_a_stud_has_both_of_its_nuts(tmp_path: Path) -> None:
    """It is cut between them, in a free shank from mouth to mouth, and has its force."""
    heights = [1e-3 * z for z in range(-8, 15, 2)]
    lattice = Lattice([R * 1e-3, 2.8e-3, HEAD * 1e-3, 7e-3], heights, n_core=3)
    parts = {
        "stud": lattice.part(lambda r, _: r < R * 1e-3, {}),
        "nut_1": lattice.part(lambda r, z: (r > R * 1e-3) & (r < HEAD * 1e-3) & (z < -4e-3), {"seat": _seat(-4, 1)}),
        "nut_2": lattice.part(
            lambda r, z: (r > R * 1e-3) & (r < HEAD * 1e-3) & (z > 8e-3) & (z < 12e-3), {"seat": _seat(8, -1)}
        ),
        "plate": lattice.part(
            lambda r, z: (r > 2.8e-3) & (z > -4e-3) & (z < 8e-3),
            {
                "low": _seat(-4, -1),
                "high": _seat(8, 1),
                "rim": lambda x, n: (np.hypot(x[:, 0], x[:, 1]) > 6.5e-3) & (np.abs(n[:, 2]) < 0.1),
            },
        ),
    }
    for name, mesh in parts.items():
        write_mesh(tmp_path / f"{name}.msh", mesh)
    data = _lattice(tmp_path)
    data["substructure"] = {n: {"material": "steel", "mesh": {"file": str(tmp_path / f"{n}.msh")}} for n in parts}
    data["boundary"] = {"rim": {"type": "fixed", "face": "plate.rim"}}
    data["interface"] = {
        "low": {"sides": ["nut_1.seat", "plate.low"], "friction_coefficient": 0.2},
        "high": {"sides": ["plate.high", "nut_2.seat"], "friction_coefficient": 0.2},
    }
    data["bolt"]["m5"] |= {"substructure": "stud", "thread": {"size": "M5", "part": "nut_*", "plain": 4e-3}}
    made = discretise(scene_from_dict(data))
    assert "thread bonded to nut_1 over 0.004 m and nut_2 over 0.004 m;" in made.cuts["m5"].note
    assert -4e-3 < made.cuts["m5"].point[2] < 8e-3
    body = made.bodies["stud"]
    height = body.mesh.nodes[body.mesh.blocks[0].cells].mean(axis=1)[:, 2]
    assert body.shape.moduli is not None
    softer = np.unique(height[body.shape.moduli < 0.99])
    # 4 mm in the middle have no thread
    assert softer == pytest.approx([-3e-3, -1e-3, 5e-3, 7e-3])
    assert solve(scene_from_dict(data)).bolts["m5"].force[-1] == pytest.approx(PRELOAD, rel=1e-4)


def test_the_axis_is_that_of_the_round_faces(tmp_path: Path) -> None:
    """Along any direction; and between mouth and head what carries has the area of the core."""
    turn = turned(np.array([1.0, 2.0, 3.0]), 40.0)
    made = discretise(scene_from_dict(_lattice(tmp_path, turn=turn)))
    assert abs(made.cuts["m5"].axis @ turn[:, 2]) == pytest.approx(1.0, abs=1e-9)
    body = made.bodies["screw"]
    height = body.mesh.nodes[body.mesh.blocks[0].cells].mean(axis=1) @ turn[:, 2]
    moduli, volume = body.shape.moduli, body.shape.elements.volume
    assert moduli is not None
    assert (moduli[(height < 0.0) | (height > 6e-3)] == 1.0).all()
    for low in (0.0, 2e-3, 4e-3):
        layer = (height > low) & (height < low + 2e-3)
        assert moduli[layer] @ volume[layer] == pytest.approx(2e-3 * np.pi * (1e-3 * CORE) ** 2, rel=0.02)


def test_chamfers_do_not_count(tmp_path: Path) -> None:
    """From a chamfer of 0.5 mm down to the chamfer of the tip, of 1 mm."""
    hole: Profile = ((0, -9), (R, -9), (R, -0.5), (R + 0.5, 0), (R + 0.5, 1), (0, 1))
    screw: Profile = ((0, -8), (R - 1, -8), (R, -7), (R, 6), (HEAD, 6), (HEAD, 10), (0, 10))
    file = write(
        tmp_path / "parts.msh",
        {"screw": Part(screw), "base": Part(hole, ((-10, -10, -12), (20, 20, 12)), {"bottom": _flat(-12.0)})},
        8.0,
        curvature=8,
    )
    made = scene_from_dict(scene(file, {"size": "M5", "part": "base"}))
    problems = Problems()
    notes = with_threads(made, build_bodies(made, problems), problems)[2]
    assert not problems
    assert "thread bonded to base over 0.0065 m;" in notes["m5"]


def test_a_shank_in_contact_leaves_a_belt_for_the_cut(tmp_path: Path) -> None:
    """Free, the shank takes part in no search; else it does but for facets around the cut."""
    data = _lattice(tmp_path)
    areas = []
    for shank in ("free", "contact"):
        data["bolt"]["m5"]["shank"] = shank
        body = discretise(scene_from_dict(data)).bodies["screw"]
        moduli = body.shape.moduli
        assert moduli is not None
        # a shank in contact needs its surface
        scaled = np.isclose(moduli[moduli < 0.99], (CORE / R) ** 2, rtol=1e-3)
        assert scaled.all() == (shank == "contact")
        areas.append(body.surface(body.touching).facet_area)
    skin = BoundaryFacets(body)
    assert areas[0] < areas[1] < skin.areas.sum()


# -- sizes and slips --------------------------------------------------------------------------------------------------
# ASME B1.1-2003, tables 3: tensile stress areas, in2
UNIFIED = {
    "1/4-20": 0.0318,
    "1/4 UNF": 0.0364,
    "#10-32": 0.0200,
    "#10 UNC": 0.0175,
    "3/8-16 UNC": 0.0775,
    "1/2-13": 0.1419,
}


def test_stress_areas_of_unified_threads() -> None:
    inch = {name: tensile_stress_area(name) / 25.4**2 for name in UNIFIED}
    assert inch == pytest.approx(UNIFIED, rel=5e-3)
    assert [thread_named(text) for text in ("1/4-21", "#10", "1/4-20 UNF", "M6.1")] == [None] * 4


def _bar(**bolt: Any) -> dict[str, Any]:
    """Three bars of 10 x 10 x 50 mm (a section of a diameter of 11.28 mm), bolts by one table."""
    box = {"size": [0.01, 0.01, 0.05], "elements": [2, 2, 7]}
    bodies = {f"m12_{i}": {"material": "steel", "box": {**box, "origin": [0.1 * i, 0.0, 0.0]}} for i in range(3)}
    held = {f"{n}_{end}": {"type": "fixed", "face": f"{n}.{end}"} for n in bodies for end in ("zmin", "zmax")}
    return {
        "name": "bars",
        "material": {"steel": {"young_modulus": 200e9, "poisson_ratio": 0.3, "density": 7800.0}},
        "substructure": bodies,
        "boundary": held,
        "bolt": {"lid": {"parts": "m12_*", "axis": [0.0, 0.0, 1.0], **bolt}},
        "time": {"quasi_static": True, "end": 1.0, "instants": 1},
    }


def test_one_table_stands_for_many_screws() -> None:
    """Each has the force T / (K d) with the diameter of its thread; their names are those of table and part."""
    made = scene_from_dict(_bar(torque=24.0, thread="M12", property_class="8.8"))
    assert list(made.bolt) == ["lid_m12_0", "lid_m12_1", "lid_m12_2"]
    assert scene_from_dict(made.tables()) == made
    solution = solve(made)
    for bolt in solution.bolts.values():
        assert bolt.force[-1] == pytest.approx(24.0 / (0.2 * 12e-3), rel=1e-8)
    assert made.bolt["lid_m12_0"].nominal(SI) == pytest.approx(12e-3)


def test_a_list_of_patterns_names_screws_one_by_one() -> None:
    bars = _bar(force=1e3, thread="M12")
    bars["bolt"]["lid"]["parts"] = ["m12_0", "m12_[12]"]
    assert list(scene_from_dict(bars).bolt) == ["lid_m12_0", "lid_m12_1", "lid_m12_2"]
    bars["bolt"]["lid"]["parts"] = ["m12_0", "m5_*"]
    with pytest.raises(SceneError, match=r"bolt.lid.parts: no substructure has a name like this \(value: .*m5_"):
        scene_from_dict(bars)
    for wrong in ([], 3, [3]):
        bars["bolt"]["lid"]["parts"] = wrong
        with pytest.raises(SceneError, match=r"bolt.lid.parts"):
            scene_from_dict(bars)
    screws = reference_schema()["$defs"]["Bolt"]["properties"]["parts"]["anyOf"]
    assert {"type": "string"} in screws
    assert {"type": "array", "items": {"type": "string"}, "minItems": 1} in screws


SLIPS = {
    "no such parts": ({"parts": "m4_*", "force": 1e3}, ("bolt.lid.parts", "no substructure", "m12_0")),
    "metres for millimetres": (
        {"torque": 24.0, "thread": "M12", "diameter": 12.0},
        ("bolt.lid_m12_0.diameter", "not the diameter of the thread M12", "12 m", "0.012 m"),
    ),
    "metres without a thread": (
        {"torque": 24.0, "diameter": 12.0},
        ("bolt.lid_m12_0.diameter", "that of a diameter of 0.01128 m", "12 m"),
    ),
    "a thread of another screw": (
        {"force": 1e3, "thread": "M16"},
        ("bolt.lid_m12_1.thread", "0.01128 m", "0.016 m, M16"),
    ),
    "above the class": (
        {"force": 25e3, "thread": "M12", "property_class": "4.6"},
        ("bolt.lid_m12_2", "above the yield stress of class 4.6", "at most 2.4e+08 Pa"),
    ),
    "above any class": ({"force": 90e3, "thread": "M12"}, ("bolt.lid_m12_0", "that of any screw", "at most 1e+09 Pa")),
    "no class": ({"force": 1e3, "property_class": "8.9"}, ("property_class", "unknown property class", "8.8")),
    "no part": (
        {"force": 1e3, "thread": {"size": "M12", "part": "nut_*"}},
        ("bolt.lid_m12_0.thread.part", "no other substructure", "nut_*"),
    ),
    "no torque arm": ({"torque": 24.0}, ("'torque' needs 'diameter'", "add 'thread'")),
}


@pytest.mark.parametrize("name", SLIPS)
def test_slips_of_the_keyboard_are_refused(name: str) -> None:
    bolt, words = SLIPS[name]
    with pytest.raises(SceneError) as error:
        discretise(scene_from_dict(_bar(**bolt)))
    for word in words:
        assert word in str(error.value)


def test_relative_moduli_scale_stiffness_and_stress() -> None:
    """A bar of two moduli in series under a uniform stress: no force inside, the same stress in both."""
    mesh = box_mesh(np.zeros(3), np.array([0.01, 0.01, 0.04]), (2, 2, 4))
    upper = mesh.nodes[mesh.blocks[0].cells].mean(axis=1)[:, 2] > 0.02
    elements, law = Elements(mesh, np.where(upper, 0.25, 1.0)), Isotropic(7800.0, 200e9, 0.0)
    z = mesh.nodes[:, 2]
    moved = np.zeros_like(mesh.nodes)
    moved[:, 2] = 1e-3 * (np.minimum(z, 0.02) + 4.0 * np.maximum(z - 0.02, 0.0))
    assert MeanStress(elements, law)(moved)[:, 2] == pytest.approx(200e6, rel=1e-12)
    force = (stiffness(elements, law) @ moved.ravel()).reshape(-1, 3)
    inside = (z > 1e-6) & (z < 0.04 - 1e-6)
    assert np.abs(force[inside]).max() < 1e-9 * 200e6 * 1e-4
    assert force[z > 0.04 - 1e-6, 2].sum() == pytest.approx(200e6 * 1e-4, rel=1e-12)


# -- axes of half a shank ---------------------------------------------------------------------------------------------
def half_shank(turn: Mask) -> BoundaryFacets:
    """The round half of a shank of 3 x 16 mm, triangles all inclined to one side, along the turned z axis."""
    across, along = np.meshgrid(np.linspace(0.0, np.pi, 9), np.linspace(0.0, 1.0, 7), indexing="ij")
    angle = across + 0.8 * along * np.sin(across)
    places = np.stack([3.0 * np.cos(angle), 3.0 * np.sin(angle), 16.0 * along**1.3], axis=-1).reshape(-1, 3)
    number = np.arange(63).reshape(9, 7)
    a, b, c, d = (number[i : i + 8, j : j + 6].ravel() for i, j in ((0, 0), (1, 0), (1, 1), (0, 1)))
    facets = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    body = SimpleNamespace(
        mesh=SimpleNamespace(nodes=1e-3 * places @ turn.T + [0.1, -0.2, 0.3]),
        outside=FacetSet((FacetBlock("triangle", facets),)),
    )
    return BoundaryFacets(cast(Body, body))


@pytest.mark.parametrize("degrees", [0.0, 25.0, 80.0])
def test_the_axis_of_half_a_shank_is_that_of_its_cylinder(degrees: float) -> None:
    """The mean of the normals is off by more than what counts as a global axis; the nodes are on the cylinder."""
    turn = turned(np.array([0.6, 0.8, 0.0]), degrees)
    skin = half_shank(turn)
    weighted = skin.normals * np.sqrt(skin.areas)[:, None]
    mean = np.linalg.eigh(weighted.T @ weighted)[1][:, 0]
    assert np.linalg.norm(np.cross(mean, turn[:, 2])) > 3.5e-3
    line = skin.line(None)
    assert line is not None
    assert np.linalg.norm(np.cross(line.axis, turn[:, 2])) < 1e-9
    # a point of the axis, to what the normals of chords leave of it
    off = line.arms(np.array([0.1, -0.2, 0.3]))
    assert np.linalg.norm(off) < 0.05e-3
