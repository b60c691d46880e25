"""Changes of temperature: free and hindered expansion, a bolt between unlike materials, waves, sessions, CalculiX."""

from __future__ import annotations

import copy
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.building import discretise
from latin_fmu.cosim import Session, Settings
from latin_fmu.cosim.segments import SegmentedRun
from latin_fmu.fem.elements import Elements
from latin_fmu.fem.mesh import Mesh
from latin_fmu.reader import scene_from_dict
from tests.fem.scenes import box_file

from .bolted_meshes import SHANK_AREA, write_joint
from .test_bolts import joint, shank_stress

E, NU, RHO, ALPHA, RISE = 70e9, 0.3, 2700.0, 23e-6, 80.0
ALUMINIUM = {"young_modulus": E, "poisson_ratio": NU, "density": RHO, "thermal_expansion": ALPHA}
STATIC = {"end": 1.0, "instants": 1, "quasi_static": True}
ALL_STRESSES = {"stress": True, "nodal_stress": True, "principal_stress": True, "fields": True}
RAMP = {"type": "table", "times": [0, 1], "values": [0, 1]}


def block(material: dict[str, Any] = ALUMINIUM, **keys: Any) -> dict[str, Any]:
    """A box with three planes of symmetry, heated while t goes from 0 to 1."""
    box = {"size": [0.03, 0.02, 0.05], "elements": [3, 2, 4]}
    made = {
        "name": "block",
        "material": {"steel": material},
        "substructure": {"body": {"material": "steel", "box": box}},
        "boundary": {a: {"type": "symmetry", "face": f"body.{a}min"} for a in "xyz"},
        "temperature": {"day": {"change": RISE, "law": RAMP}},
        "time": STATIC,
        "output": ALL_STRESSES,
    }
    return copy.deepcopy(made) | keys


def solved(data: dict[str, Any]) -> latin_fmu.Solution:
    solution = latin_fmu.solve(scene_from_dict(data))
    assert solution.converged, solution.status
    return solution


@pytest.mark.parametrize("cells", ["box", "bending", "tetra10", "hexahedron20", "wedge"])
def test_free_expansion_has_no_stress(tmp_path: Path, cells: str) -> None:
    """u = alpha T x."""
    data = block()
    if cells == "bending":
        data["substructure"]["body"]["bending_modes"] = True
    elif cells != "box":
        data["substructure"]["body"] = box_file(tmp_path / "body.msh", cells, (0.03, 0.02, 0.05), (2, 2, 2))
    history = solved(data).substructures["body"]
    assert history.displacement is not None
    assert history.stress is not None
    np.testing.assert_allclose(history.displacement[-1], ALPHA * RISE * history.nodes, atol=1e-14)
    assert np.abs(history.stress).max() < 1e-9 * E * ALPHA * RISE


def test_free_expansion_of_an_orthotropic_body() -> None:
    """Its axes turned about z: the expansion alpha_ij of the scene, shear included."""
    c, s = np.cos(0.5), np.sin(0.5)
    table = {
        "young_moduli": [22e9, 18e9, 8e9],
        "poisson_ratios": [0.14, 0.3, 0.28],
        "shear_moduli": [4.5e9, 3e9, 2.6e9],
        "thermal_expansions": [14e-6, 18e-6, 60e-6],
        "axes": {"x": [c, s, 0.0], "y": [-s, c, 0.0]},
    }
    data = block({"density": 1850.0, "orthotropic": table})
    data["boundary"] = {"z": {"type": "symmetry", "face": "body.zmin"}}
    springs = {"a": ([0.0, 0.0, 0.0], [1.0, 0.0, 0.0]), "b": ([0.0, 0.0, 0.0], [0.0, 1.0, 0.0])}
    springs["c"] = [0.0, 0.02, 0.0], [1.0, 0.0, 0.0]
    data["spring"] = {
        n: {"ends": [{"substructure": "body", "point": p}, "ground"], "direction": d, "stiffness": 1e6}
        for n, (p, d) in springs.items()
    }
    history = solved(data).substructures["body"]
    assert history.stress is not None
    assert history.displacement is not None
    assert np.abs(history.stress).max() < 1e-6 * 22e9 * 14e-6 * RISE
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    strain = RISE * turn @ np.diag([14e-6, 18e-6, 60e-6]) @ turn.T
    gradient = np.linalg.lstsq(history.nodes, history.displacement[-1], rcond=None)[0]
    np.testing.assert_allclose(0.5 * (gradient + gradient.T), strain, atol=1e-12)


def test_hindered_expansion() -> None:
    """Held along z: -E alpha T there, at elements, nodes and the support; along x, too: -E alpha T / (1 - nu)."""
    data = block()
    data["boundary"]["top"] = {"type": "fixed", "face": "body.zmax", "components": ["z"]}
    data["output"] = {**ALL_STRESSES, "reactions": True}
    solution = solved(data)
    tree = solution.to_datatree()
    wanted = np.array([0, 0, -E * ALPHA * RISE, 0, 0, 0])
    for name in ("stress", "nodal_stress"):
        stress = tree["substructures/body"][name].values
        assert np.abs(stress[0]).max() < 1.0
        np.testing.assert_allclose(stress[-1], np.tile(wanted, (stress.shape[1], 1)), atol=1e-8 * E * ALPHA * RISE)
    lowest = tree["substructures/body"]["principal_stress"].values[-1, :, 2]
    np.testing.assert_allclose(lowest, wanted[2], rtol=1e-8)
    force = solution.reactions["top"].force[-1]
    np.testing.assert_allclose(force, [0, 0, -E * ALPHA * RISE * 6e-4], atol=1e-8 * E * ALPHA * RISE * 6e-4)
    data["boundary"]["side"] = {"type": "fixed", "face": "body.xmax", "components": ["x"]}
    stress = solved(data).substructures["body"].stress
    assert stress is not None
    np.testing.assert_allclose(stress[-1][:, [0, 2]], wanted[2] / (1 - NU), rtol=1e-8)


# -- a bolt between unlike materials ----------------------------------------------------------------------------------
AREAS = {"bolt": 1e-4, "sleeve": 3e-4}
STEEL = {"young_modulus": 210e9, "poisson_ratio": 0.0, "density": 7800.0, "thermal_expansion": 11.7e-6}


def clamped(time: dict[str, Any], law: Any = "constant", **keys: Any) -> dict[str, Any]:
    """A steel bolt presses a rigid cap on an aluminium sleeve beside it, both on the ground; motion along z only."""
    width = {name: area / 0.01 for name, area in AREAS.items()}
    boxes = {
        "bolt": {"origin": [0.0, 0.0, 0.0], "size": [width["bolt"], 0.01, 0.05], "elements": [1, 1, 8]},
        "sleeve": {"origin": [0.02, 0.0, 0.0], "size": [width["sleeve"], 0.01, 0.05], "elements": [3, 1, 8]},
        "cap": {"origin": [0.0, 0.0, 0.05], "size": [0.05, 0.01, 0.01], "elements": [5, 1, 1]},
    }
    materials = {"bolt": "steel", "sleeve": "aluminium", "cap": "steel"}
    held = {
        f"{name}_{face}": {"type": "fixed", "face": f"{name}.{face}", "components": [face[0]]}
        for name in ("bolt", "sleeve")
        for face in ("xmin", "xmax", "ymin", "ymax", "zmin")
    }
    held |= {"cap": {"type": "fixed", "face": "cap.xmin", "components": ["x", "y"]}}
    made = {
        "name": "clamped",
        "material": {"steel": STEEL, "aluminium": {**ALUMINIUM, "poisson_ratio": 0.0}},
        "substructure": {n: {"material": materials[n], "box": box} for n, box in boxes.items()},
        "interface": {
            "thread": {"sides": ["bolt.zmax", "cap.zmin"], "behaviour": "perfect"},
            "seat": {"sides": ["sleeve.zmax", "cap.zmin"]},
        },
        "boundary": held,
        "bolt": {"b": {"substructure": "bolt", "axis": [0, 0, 1], "force": 10e3}},
        "temperature": {"oven": {"change": RISE, "law": law}},
        "time": time,
        "solver": {"tolerance": 1e-9},
        "output": {"stress": True, "energy": True},
    }
    made["substructure"]["cap"]["rigid"] = True
    made["boundary"]["cap_turn"] = {"type": "fixed", "face": "cap.zmax", "components": ["x", "y"]}
    return made | keys


def bar_force(rise: float = RISE) -> float:
    """Tension of the bolt by its equilibrium with the sleeve, both bars of one length."""
    flexibility = 1 / (210e9 * AREAS["bolt"]) + 1 / (E * AREAS["sleeve"])
    return 10e3 + (ALPHA - 11.7e-6) * rise / flexibility


@pytest.mark.parametrize("start", ["static", "quasi_static"])
def test_thermal_preload_of_a_bolt(start: str) -> None:
    """In statics while it is heated, and as the state that a motion starts from."""
    slow = start == "quasi_static"
    time = {"end": 1.0, "instants": 4, "quasi_static": True} if slow else {"end": 1e-5, "instants": 20}
    solution = solved(clamped(time, RAMP if slow else "constant"))
    force = solution.bolts["b"].force
    wanted = bar_force() if start == "static" else bar_force(RISE * np.linspace(0, 1, 5))
    np.testing.assert_allclose(force, wanted, rtol=1e-4)
    assert solution.bolts["b"].tightening[-1] == pytest.approx(10e3, rel=1e-9)
    pressed = solution.interfaces["seat"].normal_resultant()
    np.testing.assert_allclose(pressed[1:], force[1:], rtol=1e-6)
    stress = solution.substructures["bolt"].stress
    assert stress is not None
    np.testing.assert_allclose(stress[-1, :, 2], force[-1] / AREAS["bolt"], rtol=1e-6)


def test_a_temperature_in_pieces_and_in_a_session() -> None:
    """A motion that is heated by a table: the run in segments and a session have the bolt forces of the whole run."""
    law = {"type": "table", "times": [0.0, 1e-5, 4e-5], "values": [0.5, 1.0, -0.5]}
    scene = scene_from_dict(clamped({"end": 4e-5, "instants": 40}, law))
    whole = latin_fmu.solve(scene)
    assert whole.converged
    force = whole.bolts["b"].force
    assert np.ptp(force) > 100.0
    balance = np.abs(whole.energy["balance"]).max()  # type: ignore[index]
    assert balance < 1e-6 * np.abs(whole.energy["work_of_loads"]).max()  # type: ignore[index]
    run = SegmentedRun(scene)
    parts = [run.advance(2e-5, 20).bolts["b"].force, run.advance(4e-5, 20).bolts["b"].force[1:]]
    np.testing.assert_allclose(np.concatenate(parts), force, rtol=1e-6)
    session = Session(scene, Settings())
    session.initialize()
    told = [float(session.values(["bolt.b.force"])[0])]
    for i in range(4):
        assert session.step(i * 1e-5, 1e-5)
        told.append(float(session.values(["bolt.b.force"])[0]))
    np.testing.assert_allclose(told, force[::10], rtol=1e-6)


def thrown(law: Any, rigid: bool = False) -> latin_fmu.Scene:
    """A block in flight towards one on the ground, both heated."""
    data = block(time={"end": 2e-5, "instants": 20}, temperature={"day": {"change": RISE, "law": law}})
    box = {"origin": [0.0, 0.0, 0.051], "size": [0.03, 0.02, 0.02], "elements": [3, 2, 2]}
    data["substructure"]["hammer"] = {"material": "steel", "box": box, "initial_velocity": [0.0, 0.0, -1.0]}
    data["substructure"]["hammer"]["rigid"] = rigid
    data["interface"] = {"blow": {"sides": ["hammer.zmin", "body.zmax"]}}
    return scene_from_dict(data)


def test_a_thrown_body_does_not_begin_hot() -> None:
    """The static start leaves it out: refused with the remedy, and taken where the law begins with 0."""
    with pytest.raises(latin_fmu.InputError, match=r"temperature.day.*without its expansion.*list only the others"):
        latin_fmu.solve(thrown("constant"))
    latin_fmu.solve(thrown({"type": "table", "times": [0, 1], "values": [0, 1]}))
    latin_fmu.solve(thrown("constant", rigid=True))  # it does not expand


@pytest.mark.parametrize("propagator", ["direct", "cg", "explicit", "reduced"])
def test_a_bar_heated_at_once(propagator: str) -> None:
    """Its free end leaves with alpha T c (a front of the stress -E alpha T leaves the end), until one comes back."""
    data = block({**ALUMINIUM, "poisson_ratio": 0.0})
    data["substructure"]["body"]["box"] = {"size": [0.01, 0.01, 0.2], "elements": [1, 1, 80]}
    speed = float(np.sqrt(E / RHO))
    data["temperature"] = {"flash": {"change": RISE}}
    data["time"] = {"end": 0.35 / speed, "instants": 280, "start": "given"}
    data["sensor"] = {"end": {"face": "body.zmax"}}
    data["output"] = {"energy": True}
    if propagator != "direct":
        data["solver"] = {"propagator": propagator}
    solution = solved(data)
    sensor, n = solution.sensors["end"], int(280 * 0.3 / 0.35)
    mean = sensor.displacement[n, 2] / solution.time[n]
    assert mean == pytest.approx(ALPHA * RISE * speed, rel=0.01)
    energy = solution.energy
    assert energy is not None
    assert np.abs(energy["balance"]).max() < 1e-9 * np.abs(energy["work_of_loads"]).max()
    assert np.abs(energy["work_of_loads"]).max() > 0.1


# -- CalculiX ---------------------------------------------------------------------------------------------------------
def bonded_joint(files: dict[str, Path], heated: bool) -> latin_fmu.Scene:
    """A steel bolt through aluminium plates, head, nut and joint bonded; 80 K or cold."""
    data = joint(files)
    data["material"]["steel"]["thermal_expansion"] = 11.7e-6
    data["material"]["aluminium"] = ALUMINIUM
    for plate in ("lower", "upper"):
        data["substructure"][plate]["material"] = "aluminium"
    for table in data["interface"].values():
        table.pop("friction_coefficient")
        table["behaviour"] = "perfect"
    data["boundary"] = {"hold": {"type": "fixed", "face": "lower.far", "components": ["z"]}}
    data["spring"] = {
        f"{p}{axis}": {
            "ends": [{"substructure": "lower", "point": [0.012 * (p == "a"), 0.012 * (p == "b"), -0.005]}, "ground"],
            "direction": [float(axis == "x"), float(axis == "y"), 0.0],
            "stiffness": 1e3,
        }
        for p, axis in (("a", "y"), ("b", "x"), ("a", "x"))
    }
    if heated:
        data["temperature"] = {"day": {"change": RISE, "law": RAMP}}
    return scene_from_dict(data)


def thermal_stress_of_calculix(folder: Path, scene: latin_fmu.Scene) -> np.ndarray:
    """Mean sigma_zz (n_cell,) of the elements of the bolt, Pa, in the heated joint by ccx; interfaces share nodes."""
    bodies = discretise(scene).bodies
    numbers, count, places = {}, 0, []
    for name, body in bodies.items():
        numbers[name] = count + np.arange(body.mesh.n_node)
        count += body.mesh.n_node
        places.append(body.mesh.nodes)
    nodes = np.concatenate(places)
    for interface in scene.interface.values():
        first, second = ((s.split(".")[0], s.split(".")[1]) for s in interface.sides)
        one, two = (bodies[n].mesh.faces[f].nodes for n, f in (first, second))
        a, b = bodies[first[0]].mesh.nodes[one], bodies[second[0]].mesh.nodes[two]
        near = np.linalg.norm(a[:, None] - b, axis=2)
        for i, j in np.argwhere(near < 1e-8):
            old, new = numbers[second[0]][two[j]], numbers[first[0]][one[i]]
            for own in numbers.values():
                own[own == old] = new
    lines = ["*NODE, NSET=NALL"]
    lines += [
        f"{i + 1}, " + ", ".join(f"{x:.12e}" for x in nodes[i]) for i in np.unique(np.concatenate([*numbers.values()]))
    ]
    element = 1
    for name, body in bodies.items():
        lines += [f"*ELEMENT, TYPE=C3D8, ELSET={name.upper()}"]
        for cell in numbers[name][body.mesh.blocks[0].cells] + 1:
            lines += [", ".join(map(str, (element, *cell.tolist())))]
            element += 1
    for name, m in scene.material.items():
        lines += [f"*MATERIAL, NAME={name.upper()}", "*ELASTIC", f"{m.young_modulus}, {m.poisson_ratio}"]
        lines += ["*EXPANSION, ZERO=0.", f"{m.thermal_expansion}"]
    for name, table in scene.substructure.items():
        lines += [f"*SOLID SECTION, ELSET={name.upper()}, MATERIAL={table.material.upper()}"]
    far = numbers["lower"][bodies["lower"].mesh.faces["far"].nodes] + 1
    lines += ["*INITIAL CONDITIONS, TYPE=TEMPERATURE", "NALL, 0.", "*BOUNDARY", *(f"{n}, 3, 3" for n in far)]
    corner = numbers["lower"][[int(np.argmax(bodies["lower"].mesh.nodes[:, 0]))]] + 1
    side = numbers["lower"][[int(np.argmin(bodies["lower"].mesh.nodes[:, 0]))]] + 1
    lines += [f"{corner[0]}, 1, 2", f"{side[0]}, 2, 2"]
    lines += ["*STEP", "*STATIC", "*TEMPERATURE", f"NALL, {RISE}", "*EL PRINT, ELSET=BOLT", "S", "*END STEP"]
    (folder / "deck.inp").write_text("\n".join(lines) + "\n", encoding="utf-8")
    subprocess.run(["ccx", "-i", "deck"], cwd=folder, check=True, capture_output=True, timeout=300)
    rows = [line.split() for line in (folder / "deck.dat").read_text(encoding="utf-8").splitlines()]
    points = np.array([[float(x) for x in row] for row in rows if len(row) == 8])
    return np.asarray(points[:, 4].reshape(-1, 8).mean(axis=1))


@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed")
def test_bolt_in_a_heated_flange_against_calculix(tmp_path: Path) -> None:
    """Change of the mean stress of the shank and of the tension."""
    files = write_joint(tmp_path)
    hot, cold = (latin_fmu.solve(bonded_joint(files, heated)) for heated in (True, False))
    assert hot.converged
    assert cold.converged
    here = shank_stress(hot, 3.1e-3)[-1] - shank_stress(cold, 3.1e-3)[-1]
    cells = hot.substructures["bolt"]
    middle = np.abs(cells.nodes[cells.cells][:, :, 2].mean(axis=1)) < 3.1e-3
    volume = Elements(Mesh.uniform(cells.nodes, "hexahedron", cells.cells)).volume
    there = thermal_stress_of_calculix(tmp_path, bonded_joint(files, True))
    wanted = there[middle] @ volume[middle] / volume[middle].sum()
    assert here > 20e6
    assert here == pytest.approx(wanted, rel=1e-3)
    assert hot.bolts["b"].force[-1] - cold.bolts["b"].force[-1] == pytest.approx(wanted * SHANK_AREA, rel=1e-3)
