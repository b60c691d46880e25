"""Decks for CalculiX: what they hold, what is read back, and the same displacements where ccx is installed."""

from __future__ import annotations

import copy
import importlib
import re
import subprocess
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.assembly.merged_assembly import is_selection
from latin_fmu.assembly.problem import DiscretisedProblem
from latin_fmu.building import build, discretise, start_state, without_scheme
from latin_fmu.decks.deck_mesh import NumberedMesh
from latin_fmu.decks.export_draft import DeckChoices
from latin_fmu.decks.exporting import export_deck
from latin_fmu.errors import InputError
from latin_fmu.joined.joined_assembly import JoinedAssembly, pressed_of
from latin_fmu.mesh_files.abaqus import SOLID_FACES
from latin_fmu.propagator.base import full_displacement
from tests.alone import alone_of, started_alone
from tests.scenes import clamp
from tests.verification.test_equivalence import bonded


@pytest.fixture
def modules() -> dict[str, ModuleType]:
    names = ("harness", "calculix")
    return {name: importlib.import_module(name) for name in names}


def _crushing(modules: dict[str, ModuleType], n: int, mu: float = 0.3, **time: Any) -> DiscretisedProblem:
    scene = copy.deepcopy(modules["harness"].crushing(n, mu).description)
    scene["time"] |= time
    return discretise(latin_fmu.scene_from_dict(scene))


def _deck(ready: DiscretisedProblem, **choices: Any) -> str:
    return export_deck(ready, DeckChoices(**choices)).text


def _cards(text: str) -> dict[str, list[str]]:
    """Lines below every card."""
    cards: dict[str, list[str]] = {}
    for line in text.splitlines():
        if line.startswith("*"):
            below = cards.setdefault(line, [])
        else:
            below.append(line)
    return cards


def test_deck_holds_the_scene(modules: dict[str, ModuleType]) -> None:
    cards = _cards(_deck(_crushing(modules, 2), penalty=10.0))
    assert len(cards["*NODE, NSET=NALL"]) == 2 * 27
    assert len(cards["*ELEMENT, TYPE=C3D8, ELSET=b1"]) == len(cards["*ELEMENT, TYPE=C3D8, ELSET=b2"]) == 8
    # a block is made of elements 1 to 8, then 9 to 16; the upper four of each touch its upper face, number 2
    assert cards["*SURFACE, NAME=b1_zmax, TYPE=ELEMENT"] == [f"{e}, S2" for e in (5, 6, 7, 8)]
    assert cards["*SURFACE, NAME=b2_zmin, TYPE=ELEMENT"] == [f"{e}, S1" for e in (9, 10, 11, 12)]
    assert cards["*SURFACE, NAME=press, TYPE=ELEMENT"] == [f"{e}, S2" for e in (13, 14, 15, 16)]
    assert cards["*DSLOAD, AMPLITUDE=press"] == ["press, P, 200000000"]
    assert cards["*CONTACT PAIR, INTERACTION=i1, TYPE=SURFACE TO SURFACE"] == ["b1_zmax, b2_zmin"]
    # penalty 10 E/h of the softer side, h = 5 mm; a tenth of it before slip
    assert [float(x) for x in cards["*FRICTION"][0].split(",")] == pytest.approx([0.3, 70e9 / 0.005])
    scene = _crushing(modules, 2).scene
    held = {name: 1 + "xyz".index(table.face.split(".")[1][0]) for name, table in scene.boundary.items()}
    assert cards["*BOUNDARY"] == [f"{name}, {axis}, {axis}" for name, axis in held.items()]
    assert cards["*DYNAMIC, ALPHA=-0.1"][0].split(", ")[:2] == ["1.5e-07", "3e-05"]
    law = np.array([float(x) for line in cards["*AMPLITUDE, NAME=press"] for x in line.split(",")]).reshape(-1, 2)
    assert len(law) > 60
    times = np.linspace(0.0, 30e-6, 201)
    pulse = np.where(times < 10e-6, np.sin(np.pi * times / 10e-6), 0.0)
    assert np.interp(times, *law.T) == pytest.approx(pulse, abs=1e-8)


def test_no_friction_card_without_friction(modules: dict[str, ModuleType]) -> None:
    assert "*FRICTION" not in _deck(_crushing(modules, 1, 0.0))


def test_faces_have_the_area_of_the_block(modules: dict[str, ModuleType]) -> None:
    numbered = NumberedMesh.of(_crushing(modules, 3).bodies)
    mesh, first = numbered.bodies["b2"].mesh, numbered.elements["b2"]
    for axis, pair in enumerate((("xmin", "xmax"), ("ymin", "ymax"), ("zmin", "zmax"))):
        for side in pair:
            corners = [
                mesh.nodes[[mesh.blocks[0].cells[e - first][k] for k in SOLID_FACES[8][n - 1]]]
                for e, n in numbered.faces("b2", mesh.faces[side])
            ]
            area = sum(np.linalg.norm(np.cross(c[2] - c[0], c[3] - c[1])) / 2 for c in corners)
            assert area == pytest.approx(1e-4)
            assert np.ptp(np.concatenate(corners)[:, axis]) == pytest.approx(0.0, abs=1e-12)


def test_tetrahedra_of_the_flange_have_their_faces_in_the_deck(tmp_path: Path) -> None:
    """Every face, with the numbers that CalculiX gives them: outward normals, areas, and a joint whose nodes match."""
    pytest.importorskip("gmsh")
    flange = importlib.import_module("flange")
    case = flange.Mesh(12.0, 12.0, 3.0).made(tmp_path / "flange.msh")
    ready = discretise(latin_fmu.scene_from_dict(case.description))
    assert [u.geometry.matching for u in ready.units] == [True] * 9
    for name, side, normal in (("upper", "joint", (0, 0, -1)), ("lower_bolt1", "cut", (0, 0, 1)), ("upper", "rim", 0)):
        mesh = ready.bodies[name].mesh
        nodes = mesh.nodes[mesh.blocks[0].cells]
        areas = np.zeros(3)
        numbered = NumberedMesh.of(ready.bodies)
        for label, number in numbered.faces(name, mesh.faces[side]):
            element = label - numbered.elements[name]
            a, b, c = nodes[element][list(SOLID_FACES[4][number - 1])]
            inward = np.cross(b - a, c - a) / 2
            assert inward @ (nodes[element].mean(axis=0) - a) > 0
            areas -= inward
        face = ready.bodies[name].face(side)
        np.testing.assert_allclose(areas, face.areas.sum() * np.asarray(normal), atol=1e-2 * face.areas.sum())
    pull = ready.scene.load["lower_bolt1"]
    assert np.linalg.norm(pull.traction) * ready.bodies["lower_bolt1"].face("cut").areas.sum() == pytest.approx(8e3)
    assert "TYPE=C3D4" in _deck(ready)


@pytest.mark.slow
def test_flange_is_that_of_calculix(modules: dict[str, ModuleType], tmp_path: Path) -> None:
    """Shear of the joint by equilibrium; displacements of one mesh in both codes; meshes that do not match."""
    pytest.importorskip("gmsh")
    flange = importlib.import_module("flange")
    case = flange.Mesh(6.0, 6.0, 2.5).made(tmp_path / "flange.msh")
    shear, here = flange.applied(case), flange.of_package(case, {})
    assert here.force[0] == pytest.approx(shear, rel=1e-3)
    other = flange.Mesh(8.0, 6.0, 2.5, matching=False, order=2).made(tmp_path / "other.msh")
    assert flange.of_package(other, {}).force[0] == pytest.approx(flange.applied(other), rel=1e-3)
    if not modules["calculix"].installed():
        pytest.skip(modules["calculix"].MISSING)
    there = flange.of_calculix(case, flange.PENALTY, 300.0)
    assert there is not None
    assert there.force[0] == pytest.approx(shear, rel=1e-3)
    np.testing.assert_allclose(here.rim[[0, 2]], there.rim[[0, 2]], rtol=1e-2)
    assert here.seconds < there.seconds


def test_bonded_deck_shares_the_nodes_of_the_interface(modules: dict[str, ModuleType]) -> None:
    ready = _crushing(modules, 2)
    text = export_deck(ready, DeckChoices(direct=True), modules["calculix"].shared_nodes(ready)).text
    assert len(_cards(text)["*NODE, NSET=NALL"]) == 27 + 18
    assert "CONTACT" not in text
    assert "*DYNAMIC, ALPHA=-0.1, DIRECT" in text


def test_static_deck(modules: dict[str, ModuleType]) -> None:
    case = modules["harness"].plates(3, (2, 2, 1))
    cards = _cards(_deck(discretise(latin_fmu.scene_from_dict(case.description))))
    assert cards["*STATIC"][0].split(", ")[:2] == ["0.05", "1"]
    [held] = case.description["boundary"]
    assert cards["*BOUNDARY"] == [f"{held}, {k}, {k}" for k in (1, 2, 3)]
    shear = [line.split(", ") for line in cards["*CLOAD, AMPLITUDE=shear"]]
    assert {row[1] for row in shear} == {"1"}
    sizes = {name: sum(len(line.split(", ")) for line in cards[f"*NSET, NSET={name}"]) for name, _, _ in shear}
    assert sum(sizes[name] * float(force) for name, _, force in shear) == pytest.approx(5e6 * 0.04**2)


def test_unknown_condition_is_refused(modules: dict[str, ModuleType]) -> None:
    scene = copy.deepcopy(modules["harness"].crushing(1, 0.0).description)
    scene["boundary"]["base"] = {"type": "absorbing", "face": "b1.zmin"}
    with pytest.raises(InputError, match="absorbing"):
        _deck(discretise(latin_fmu.scene_from_dict(scene)))


def test_clamped_modes_are_those_of_calculix(modules: dict[str, ModuleType], tmp_path: Path) -> None:
    """Frequencies and effective masses of five parts joined where bolt and load press them, against another code whose
    parts share the nodes that are closed."""
    if not modules["calculix"].installed():
        pytest.skip(modules["calculix"].MISSING)
    scene = latin_fmu.scene_from_dict(clamp())
    ready, count = discretise(scene), 8
    state = start_state(scene)
    assert state is not None
    closed = pressed_of(ready, state)
    numbers = {name: rows.copy() for name, rows in NumberedMesh.of(ready.bodies).nodes.items()}
    for unit in ready.units:
        shared = np.ones(unit.geometry.n_point, dtype=bool) if unit.name in ("top", "thread") else closed[unit.name]
        assert is_selection(unit)
        assert unit.name in ("top", "thread") or 0 < shared.sum() < len(shared)
        nodes = [trace.indices[::3] // 3 for trace in unit.geometry.traces if trace is not None]
        bodies = [side.split(".")[0] for side in unit.sides]
        first, second = (numbers[body][own[shared]] for body, own in zip(bodies, nodes, strict=True))
        for a, b in zip(first, second, strict=True):  # one number for both, in all bodies
            for rows in numbers.values():
                rows[rows == b] = a
    free = replace(ready, cuts={}, scene=ready.scene.model_copy(update={"bolt": {}}))
    model = export_deck(free, nodes=numbers).model
    (tmp_path / "deck.inp").write_text(f"{model}*STEP\n*FREQUENCY\n{count}\n*END STEP\n")
    subprocess.run(["ccx", "-i", "deck"], cwd=tmp_path, check=True, capture_output=True, timeout=120)
    text = (tmp_path / "deck.dat").read_text()

    def table(title: str) -> np.ndarray:
        rows = [line.split() for line in text.split(title)[1].splitlines() if re.match(r"\s+\d+\s", line)]
        return np.array(rows[:count], dtype=float)

    modes = latin_fmu.vibration_modes(scene, count=count)
    assert modes.n_rigid == 0
    assert modes.frequency == pytest.approx(table("E I G E N V A L U E   O U T P U T")[:, 3], rel=1e-5)
    masses = table("E F F E C T I V E   M O D A L   M A S S")[:, 1:4]
    joined = JoinedAssembly.of(without_scheme(scene), "sticking", closed)
    moved = joined.parts.translations.copy()
    moved[np.diff(joined.parts.expansion.indptr) == 0] = 0.0  # there the held nodes do not move with the base
    pulled = (joined.expansion @ joined.modes(count).vectors).T @ (joined.parts.mass @ moved)
    assert pulled**2 == pytest.approx(masses, abs=1e-5 * modes.mass)
    assert modes.effective_mass == pytest.approx(masses, abs=2e-3 * modes.mass)


PRINTED = """
 displacements (vx,vy,vz) for set NALL and time  0.1500000E-06

         1  1.000000E+00  0.000000E+00 -2.500000E-03
         3  0.000000E+00  3.000000E+00 -6.299236-122

 statistics for slave set B2_ZMIN, master set B1_ZMAX and time  0.1500000E-06

   total surface force (fx,fy,fz) and moment about the origin (mx,my,mz)

    1.000000E+00  0.000000E+00  7.500000E+01  0.000000E+00  0.000000E+00  0.000000E+00

   center of gravity and mean normal

             NaN           NaN           NaN           NaN           NaN           NaN
"""


def test_printed_numbers_are_read(modules: dict[str, ModuleType]) -> None:
    printed = modules["calculix"].read(PRINTED + re.sub("0.15", "0.30", PRINTED).replace("7.5", "8.5"))
    assert printed.time == pytest.approx([1.5e-7, 3.0e-7])
    assert printed.displacement.shape == (2, 3, 3)
    assert printed.displacement[1, 2].tolist() == [0.0, 3.0, -6.299236e-122]
    assert printed.force["B2_ZMIN", "B1_ZMAX"].tolist() == [[1.0, 0.0, 75.0], [1.0, 0.0, 85.0]]


def test_bonded_march_is_that_of_calculix(modules: dict[str, ModuleType]) -> None:
    """Mesh, matrices, loads, conditions and time scheme against another code, to the digits it prints."""
    run = modules["calculix"]
    if not run.installed():
        pytest.skip(run.MISSING)
    ready = _crushing(modules, 2, end=40 * 0.15e-6, instants=40)
    made = export_deck(ready, DeckChoices(direct=True, every=True), run.shared_nodes(ready))
    there = run.run(made.text, float(ready.time[-1]), limit=60.0)
    assert there.complete
    built = build(ready.scene)
    body, where = bonded(built)
    nothing = np.zeros((0, 1))
    started_alone(body, nothing, None)
    scale = float(np.abs(there.printed.displacement).max())
    for displacement in there.printed.displacement:
        alone_of(body).predict()
        alone_of(body).commit(nothing)
        moved = full_displacement(body, 0)
        for name, dofs in where.items():
            here = moved[dofs.start // 3 : dofs.stop // 3]
            assert np.abs(displacement[made.nodes[name] - 1] - here).max() < 1e-6 * scale


@pytest.mark.slow
def test_static_contact_with_friction_is_the_limit_of_penalties(modules: dict[str, ModuleType]) -> None:
    """Plates pressed and sheared, edges open and slip: CalculiX comes as near as its penalty is stiff."""
    if not modules["calculix"].installed():
        pytest.skip(modules["calculix"].MISSING)
    static = importlib.import_module("against_calculix")
    case = modules["harness"].plates(12, (4, 2, 1))
    case.description["load"]["shear"]["traction"] = [8e6, 0.0, 0.0]
    timing = modules["harness"]
    histories = timing.contact_run(timing.prepared(case, static.TIGHT)).interfaces.values()
    assert {s for h in histories for s in h.contact_status[-1]} == {0, 1, 2}  # open, stick, slip: all occur
    here = static.moved(case, static.TIGHT)
    errors = []
    for stiffness in (1e2, 1e3):
        choices = DeckChoices(penalty=stiffness)
        there = static.plates_by_calculix(case, choices, 100.0)[1]
        assert there is not None
        errors.append(static.error(there, here))
    assert errors[1] < 6e-3
    assert errors[1] < 0.15 * errors[0]


@pytest.mark.slow
def test_contact_force_is_that_of_calculix(modules: dict[str, ModuleType]) -> None:
    """Unilateral contact with friction against another code: crushing, coarse, within the penalty's penetration."""
    forces = importlib.import_module("against_calculix")
    if not modules["calculix"].installed():
        pytest.skip(modules["calculix"].MISSING)
    case = modules["harness"].crushing(3, 0.3)
    case.description["time"] = {"end": 120 * 0.15e-6, "instants": 120}
    choices = DeckChoices(penalty=50.0, alpha=-0.3)
    there = forces.of_calculix(case, "contact", choices, 200.0)
    here = forces.of_package(case, "here")
    assert there.complete
    assert here.distance(there) < 0.02
    assert here.separation == pytest.approx(there.separation, abs=2 * 0.15e-6)


def test_says_when_there_is_no_calculix(
    modules: dict[str, ModuleType], monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    example = importlib.import_module("against_calculix")
    monkeypatch.setattr(example, "installed", lambda: False)
    assert example.main(["-o", str(tmp_path / "none")]) == 0
    assert capsys.readouterr().out.strip() == modules["calculix"].MISSING
    assert not (tmp_path / "none").exists()


@pytest.mark.usefixtures("modules")
def test_figure_has_a_column_for_each_case(tmp_path: Path) -> None:
    history = importlib.import_module("against_calculix").ForceHistory
    time = np.linspace(0.0, 1e-5, 20)
    made = [history(name, 0.1 * (k + 1), time, np.sin(3e5 * time)) for k, name in enumerate(("own", "other, soft"))]
    drawing = importlib.import_module("against_calculix").figure(
        {"P1": (made[0], made), "P2": (made[0], made)},
        [(n, dict.fromkeys(("own", "shared", "other"), (0.1 * n, 1e-3))) for n in (4, 8)],
    )
    drawing.savefig(tmp_path / "figure.png")
    assert len(drawing.axes) == 6
    assert sum(len(axis.patches) for axis in drawing.axes) == 4
