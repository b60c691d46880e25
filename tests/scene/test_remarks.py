"""Remarks: contact at a point or an edge only; the same ones from ``check`` and ``explain``; none on shipped models."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

import latin_fmu
from latin_fmu.api import checked
from latin_fmu.building import discretise
from latin_fmu.effects.explanation import explain
from latin_fmu.fem.mesh import box_mesh
from latin_fmu.reader import scene_from_dict
from tests.scenes import MINUTES, MODELS

STEEL = {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}


def box(x: float, z: float) -> dict[str, Any]:
    return {"material": "steel", "box": {"origin": [x, 0.0, z], "size": [0.01] * 3, "elements": [2, 2, 2]}}


def edge_remarks(data: dict[str, Any], folder: Path | None = None) -> list[str]:
    return [r for r in checked(scene_from_dict(data, folder))[1] if r.code == "edge"]


def scene(substructure: dict[str, Any], **more: Any) -> dict[str, Any]:
    time = {"end": 2e-6, "step": 1e-7}
    return {"name": "edges", "material": {"steel": STEEL}, "substructure": substructure, "time": time, **more}


@pytest.mark.parametrize(("x", "pairs"), [(0.01, "a and b meet"), (0.009, None), (0.0101, None)])
def test_boxes_along_an_edge_make_no_interface(x: float, pairs: str | None) -> None:
    """With a strip in common they make one; farther apart than the search they do not meet at all."""
    data = scene({"a": box(0.0, 0.0), "b": box(x, 0.01), "c": box(0.0, -0.01)}, contact={"all": {"search": 1e-5}})
    found = edge_remarks(data)
    assert [pairs in text for text in found] == [True] if pairs else found == []


def turned(folder: Path, angles: tuple[float, float]) -> None:
    """A cube over the ground, turned about x and y, as a mesh file whose face ``foot`` was horizontal."""
    nodes = box_mesh(np.zeros(3), np.full(3, 0.01), (2, 2, 2)).nodes
    cells = box_mesh(np.zeros(3), np.full(3, 0.01), (2, 2, 2)).blocks[0].cells
    (cx, sx), (cy, sy) = ((np.cos(a), np.sin(a)) for a in angles)
    about_x, about_y = (
        np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]]),
        np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]]),
    )
    low = nodes[:, 2] < 1e-9
    quads = [[i for i in cell if low[i]] for cell in cells]
    ordered = [[q[0], q[1], q[2], q[3]] for q in quads if len(q) == 4]
    points = nodes @ (about_y @ about_x).T
    points[:, 2] -= points[:, 2].min() - 1e-4
    mesh = meshio.Mesh(
        points,
        [("hexahedron", cells), ("quad", np.array(ordered))],
        cell_data={"gmsh:physical": [np.full(len(cells), 1), np.full(len(ordered), 2)]},
        field_data={"cube": np.array([1, 3]), "foot": np.array([2, 2])},
    )
    meshio.write(folder / "cube.msh", mesh, file_format="gmsh22")


@pytest.mark.parametrize(
    ("angles", "where"), [((0.0, 0.0), None), ((0.2, 0.0), "along an edge (3 points)"), ((0.2, 0.1), "at one point")]
)
def test_a_cube_that_lands_on_a_corner(angles: tuple[float, float], where: str | None, tmp_path: Path) -> None:
    turned(tmp_path, angles)
    ground = {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}
    cube = {"material": "steel", "mesh": {"file": "cube.msh"}, "initial_velocity": [0.0, 0.0, -1.0]}
    data = scene({"cube": cube}, interface={"foot": {"sides": ["cube.foot", "ground"], "ground": ground}})
    found = edge_remarks(data, tmp_path)
    assert [where in text for text in found] == [True] if where else found == []


def test_a_ball_gives_none() -> None:
    """The closest point of a curved face is no corner."""
    path = Path(__file__).parents[1] / "verification" / "ball.msh"
    names = {str(n): d for n, d in meshio.read(path).field_data.items()}
    face = next(name for name, (_, dim) in names.items() if dim == 2)
    nodes = meshio.read(path).points
    ground = {"point": [0.0, 0.0, float(nodes[:, 2].min())], "normal": [0.0, 0.0, 1.0]}
    ball = {"material": "steel", "mesh": {"file": str(path)}, "initial_velocity": [0.0, 0.0, -1.0]}
    data = scene({"ball": ball}, interface={"foot": {"sides": [f"ball.{face}", "ground"], "ground": ground}})
    assert [r for r in checked(scene_from_dict(data))[1] if r.code == "edge"] == []


BAD = {
    "material.steel.young_modulus": 210.0,
    "interface.joint.friction_coefficient": 30.0,
    "substructure.b.box.origin.0": 0.0001,
    "load.press.pressure": -1e6,
    "time.step": 2e-9,
}


@pytest.mark.parametrize("change", [None, *BAD])
def test_explain_gives_the_remarks_of_check(change: str | None) -> None:
    data = scene(
        {"a": box(0.0, 0.0), "b": box(0.0, 0.01)},
        interface={"joint": {"sides": ["a.zmax", "b.zmin"], "friction_coefficient": 0.3}},
        boundary={"hold": {"type": "fixed", "face": "a.zmin"}},
        load={"press": {"face": "b.zmax", "pressure": 1e6}},
    )
    if change:
        *path, last = change.split(".")
        table: Any = data
        for part in path:
            table = table[part]
        table[int(last) if last.isdigit() else last] = BAD[change]
    known = scene_from_dict(data)
    full = {(r.code, str(r)) for r in checked(known)[1]}
    told = explain(known)
    assert {(r.code, str(r)) for r in told.warnings} == {r for r in full if r[0] not in ("resolution", "start")}
    assert any("latin-fmu check" in text for text in told.unchecked)
    assert not any("latin-fmu backbone" in text for text in told.unchecked)


def test_explain_says_how_small_losses_of_bolted_joints_are_found() -> None:
    for friction, said in ((0.3, True), (0.0, False)):
        settings = [f"contact.all.friction_coefficient={friction}"]
        told = explain(latin_fmu.load_scene(MODELS / "lap_joint" / "shock.toml", settings))
        assert any("latin-fmu backbone" in text for text in told.unchecked) is said


MODEL_FILES = [
    pytest.param(path, marks=pytest.mark.slow) if path.parent.name in ("lap_joint", *MINUTES) else path
    for path in sorted(MODELS.glob("*/*.toml"))
]


@pytest.mark.parametrize("path", MODEL_FILES, ids=lambda p: f"{p.parent.name}/{p.stem}")
def test_shipped_models_give_no_remark(path: Path) -> None:
    if path.parent.name in MINUTES:  # bolts take long to be tightened
        # nothing holds the thin beam: the remark says so
        expected = ["free"] if path.parent.name == "thin_beam" else []
        assert [r.code for r in explain(latin_fmu.load_scene(path)).warnings] == expected
    else:
        assert checked(latin_fmu.load_scene(path))[1] == ()


# -- bonds around a loop --------------------------------------------------------------------------------------------
def four_blocks(last: list[int], behaviour: str = "perfect") -> dict[str, Any]:
    """Four blocks that meet along an edge, each joined to the next; ``last`` : elements of the last one."""
    bodies, joints = {}, {}
    for i in range(2):
        for k in range(2):
            elements = last if (i, k) == (1, 1) else [3, 3, 3]
            box = {"origin": [0.1 * i, 0.0, 0.1 * k], "size": [0.1, 0.1, 0.1], "elements": elements}
            bodies[f"b{i}{k}"] = {"material": "steel", "box": box}
    for n in range(2):
        joints[f"x{n}"] = {"sides": [f"b0{n}.xmax", f"b1{n}.xmin"], "behaviour": behaviour}
        joints[f"z{n}"] = {"sides": [f"b{n}0.zmax", f"b{n}1.zmin"], "behaviour": behaviour}
    return {
        "name": "four",
        "material": {"steel": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}},
        "substructure": bodies,
        "interface": joints,
        "boundary": {"base": {"type": "fixed", "face": "b00.zmin"}},
        "load": {"pull": {"face": "b11.zmax", "force": [1e5, 0.0, -1e5]}},
        "time": {"end": 1e-5, "instants": 10},
    }


def loops(tables: dict[str, Any]) -> list[str]:
    remarks = discretise(latin_fmu.scene_from_dict(tables)).remarks
    return [remark for remark in remarks if remark.code == "redundant"]


@pytest.mark.parametrize("last", [[3, 3, 3], [2, 2, 2]], ids=["matching", "not matching"])
def test_bonds_around_a_loop_are_told(last: list[int]) -> None:
    """One condition too many at each of the four nodes of the edge, which every block has."""
    (remark,) = loops(four_blocks(last))
    assert "bonds x0, z0, x1, z1 close a loop of bodies at 4 place(s)" in remark
    assert "not unique" in remark


def test_a_loop_through_the_ground_is_told() -> None:
    made = four_blocks([3, 3, 3])
    made["substructure"] = {name: made["substructure"][name] for name in ("b00", "b10")}
    feet = {name: {"sides": [f"{name}.zmin", "ground"], "behaviour": "perfect"} for name in ("b00", "b10")}
    made["interface"] = {"x0": made["interface"]["x0"], **feet}
    made["boundary"], made["load"] = {}, {}
    (remark,) = loops(made)
    assert "bonds x0, b00, b10 close a loop of bodies at 4 place(s)" in remark


def test_open_chains_and_contacts_are_no_loops() -> None:
    assert not loops(four_blocks([3, 3, 3], "contact"))
    made = four_blocks([3, 3, 3])
    del made["interface"]["z1"]
    assert not loops(made)


@pytest.mark.parametrize("behaviour", ["perfect", "contact"])
def test_modal_damping_of_joined_bodies_is_told_before_a_run(behaviour: str) -> None:
    made = four_blocks([3, 3, 3], behaviour)
    names = list(made["substructure"])[:2]
    for name in names:
        made["substructure"][name]["modal_damping"] = {"ratio": 0.02, "below": 1e5}
    told = [r for r in discretise(latin_fmu.scene_from_dict(made)).remarks if r.code == "damping"]
    assert [r.split(":")[0] for r in told] == [f"substructure {', '.join(sorted(names))}"]
    made["interface"] = {}
    assert not [r for r in discretise(latin_fmu.scene_from_dict(made)).remarks if r.code == "damping"]


@pytest.mark.parametrize(
    ("name", "told"), [("hex_bolt_2", True), ("iso_4762_m6x16_1", True), ("dowel_pin", False), ("bolted_plate", False)]
)
def test_a_screw_that_no_bolt_tightens_is_told(name: str, told: bool) -> None:
    data = scene({name: box(0.0, 0.0), "plate": box(0.0, 0.01)}, contact={"all": {"search": 1e-5}})
    found = [r for r in checked(scene_from_dict(data))[1] if r.code == "screw"]
    assert len(found) == told
    assert all(f"no [bolt] tightens {name}" in text for text in found)
    if told:  # the same between two walls, tightened
        del data["contact"], data["substructure"]["plate"]
        data["substructure"][name]["box"]["size"] = [0.01, 0.01, 0.04]
        data["boundary"] = {end: {"type": "fixed", "face": f"{name}.{end}"} for end in ("zmin", "zmax")}
        data["bolt"] = {"m": {"substructure": name, "axis": [0.0, 0.0, 1.0], "force": 100.0}}
        assert not [r for r in checked(scene_from_dict(data))[1] if r.code == "screw"]
