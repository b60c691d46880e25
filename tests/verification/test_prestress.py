"""The stiffness of the stress that a motion starts from: strings, columns, plates, stacks; buckling; where it is left
out."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.integrate

import latin_fmu
from latin_fmu.building import discretise, started
from latin_fmu.cosim.session import Session
from latin_fmu.errors import SceneError
from latin_fmu.fem.elasticity import Isotropic
from latin_fmu.fem.elements import Elements, rigid_modes
from latin_fmu.fem.geometric_stiffness import geometric_stiffness
from latin_fmu.fem.mesh import box_mesh
from latin_fmu.stability.surfaces import typed_box, write_mesh

Tables = dict[str, Any]
MODULUS, DENSITY = 210e9, 7800.0
STEEL = {"young_modulus": MODULUS, "poisson_ratio": 0.3, "density": DENSITY, "thermal_expansion": 12e-6}
START = {"type": "static"}

# half of a strip between pins, whose other half is its mirror image
HALF, WIDTH, THICKNESS = 0.05, 0.005, 0.001
SECTION = WIDTH * THICKNESS
BENDING = MODULUS * WIDTH * THICKNESS**3 / 12.0
EULER = np.pi**2 * BENDING / (2.0 * HALF) ** 2


def pinned(force: float, **tables: Any) -> latin_fmu.Scene:
    """A strip between pins under a force along it, N."""
    return latin_fmu.scene_from_dict(
        {
            "name": "pinned",
            "material": {"steel": STEEL},
            "substructure": {
                "strip": {
                    "material": "steel",
                    "bending_modes": True,
                    "box": {"size": [HALF, WIDTH, THICKNESS], "elements": [40, 2, 1]},
                }
            },
            "boundary": {
                "middle": {"type": "symmetry", "face": "strip.xmin"},
                "pin": {"type": "fixed", "face": "strip.xmax", "components": ["z"]},
                "side": {"type": "symmetry", "face": "strip.ymin"},
            },
            "load": {"along": {"face": "strip.xmax", "traction": [force / SECTION, 0.0, 0.0], "law": "constant"}},
            "time": {"end": 2e-3, "step": 2e-5, "start": START},
            **tables,
        }
    )


def frequency_of(time: np.ndarray, motion: np.ndarray) -> float:
    """Of a free vibration, Hz, by the times at which it passes its mean upwards."""
    motion = motion - motion.mean()
    before = np.flatnonzero((motion[:-1] < 0.0) & (motion[1:] >= 0.0))
    share = motion[before] / (motion[before] - motion[before + 1])
    passes = time[before] + share * np.diff(time)[before]
    return float((len(passes) - 1) / (passes[-1] - passes[0]))


@pytest.mark.parametrize("share", [5.8, 1.0, -0.5, -0.8])
def test_a_strip_is_tuned_by_the_force_along_it(share: float) -> None:
    """f^2 = f_0^2 (1 + N / P), P Euler's load, in any mode with its own half waves: here the first, one half wave."""
    plain = latin_fmu.vibration_modes(pinned(share * EULER, effects={"prestress": "off"}), count=1).frequency[0]
    assert plain == pytest.approx(np.pi / (8.0 * HALF**2) * np.sqrt(BENDING / (DENSITY * SECTION)), rel=2e-3)
    modes = latin_fmu.vibration_modes(pinned(share * EULER), count=1)
    assert modes.frequency[0] == pytest.approx(plain * np.sqrt(1.0 + share), rel=5e-3 if share > -0.6 else 1e-2)
    assert any("prestress" in remark for remark in modes.remarks)


def test_the_factor_of_buckling_is_eulers() -> None:
    modes = latin_fmu.vibration_modes(pinned(-0.5 * EULER), count=1)
    (words,) = (remark for remark in modes.remarks if "prestress" in remark)
    assert float(words.split("buckles at ")[1].split()[0]) == pytest.approx(2.0, rel=1e-2)
    with pytest.raises(SceneError, match=r"substructure strip buckles.*load factor of buckling 0\.9"):
        latin_fmu.vibration_modes(pinned(-1.05 * EULER), count=1)
    with pytest.raises(SceneError, match="buckles"):
        latin_fmu.solve(pinned(-1.05 * EULER))
    assert latin_fmu.solve(pinned(-1.05 * EULER, effects={"prestress": "off"})).converged


@pytest.mark.parametrize(("walls", "buckles"), [(["zmin"], True), (["zmax"], True), (["zmin", "zmax"], False)])
def test_a_strip_does_not_buckle_into_walls_on_both_sides(walls: list[str], buckles: bool) -> None:
    """Beyond Euler's load a strip that lies on a wall without pressure buckles away from it; between two it cannot."""
    data = pinned(-1.3 * EULER).tables()
    data["material"]["steel"] = STEEL | {"poisson_ratio": 0.0}
    data["interface"] = {w: {"sides": [f"strip.{w}", "ground"], "behaviour": "contact"} for w in walls}
    scene = latin_fmu.scene_from_dict(data)
    if buckles:
        with pytest.raises(SceneError, match="substructure strip buckles"):
            latin_fmu.vibration_modes(scene, count=1)
        return
    held = latin_fmu.vibration_modes(scene, count=1)
    assert not any("buckles" in remark for remark in held.remarks)


# frequencies and factor of CalculiX 2.20 on the same mesh: *STATIC, NLGEOM then *FREQUENCY, PERTURBATION; *BUCKLE
CALCULIX = {
    "strip of C3D8I": ("hexahedron", [0.1, 0.01, 0.001], [40, 4, 1], 14.0, [381.2099, 1297.291]),
    "strip of C3D10": ("tetra10", [0.1, 0.01, 0.001], [30, 3, 1], 14.0, [386.3914, 1309.418]),
    "sheet of C3D20": ("hexahedron20", [0.1, 0.1, 0.001], [12, 12, 1], 5.0, [842.3824, 1815.442]),
    "cold strip of C3D20": ("hexahedron20", [0.1, 0.01, 0.001], [20, 2, 1], -30.0, [779.804, 1860.436]),
}


def heated(case: str, folder: Path) -> latin_fmu.Scene:
    """A part held at its ends, or at all sides, under heat."""
    cell, size, elements, change, _ = CALCULIX[case]
    write_mesh(folder / "part.msh", typed_box(cell, np.zeros(3), np.array(size), tuple(elements)), lambda x: x)
    faces = ["xmin", "xmax", *(["ymin", "ymax"] if size[0] == size[1] else [])]
    part = {"material": "steel", "mesh": {"file": "part.msh"}, "bending_modes": cell == "hexahedron"}
    return latin_fmu.scene_from_dict(
        {
            "name": "heated",
            "material": {"steel": STEEL},
            "substructure": {"part": part},
            "boundary": {face: {"type": "fixed", "face": f"part.{face}"} for face in faces},
            "temperature": {"heat": {"change": change}},
            "time": {"end": 1e-3, "step": 1e-5, "start": START},
        },
        folder,
    )


@pytest.mark.parametrize("case", CALCULIX)
def test_heated_parts_ring_as_in_calculix(case: str, tmp_path: Path) -> None:
    expected = CALCULIX[case][-1]
    found = latin_fmu.vibration_modes(heated(case, tmp_path), count=2).frequency
    assert found == pytest.approx(expected, rel=3e-3)
    assert found[0] == pytest.approx(expected[0], rel=1.2e-3)


def column(folder: Path, cell: str = "tetra10") -> latin_fmu.Scene:
    """A cantilever under a pressure on its end."""
    write_mesh(folder / "part.msh", typed_box(cell, np.zeros(3), np.array([0.1, 0.01, 0.002]), (20, 2, 1)))
    part = {"material": "steel", "mesh": {"file": "part.msh"}, "bending_modes": cell == "hexahedron"}
    return latin_fmu.scene_from_dict(
        {
            "name": "column",
            "material": {"steel": STEEL},
            "substructure": {"part": part},
            "boundary": {"root": {"type": "fixed", "face": "part.xmin"}},
            "load": {"push": {"face": "part.xmax", "pressure": 5e6, "law": "constant"}},
            "time": {"end": 1e-3, "step": 1e-5, "start": START},
        },
        folder,
    )


COLUMN, FACTOR = [144.9223, 831.5732, 1037.512], 3.499534


def test_a_column_buckles_as_in_calculix(tmp_path: Path) -> None:
    modes = latin_fmu.vibration_modes(column(tmp_path), count=3)
    assert modes.frequency == pytest.approx(COLUMN, rel=1e-4)
    assert float(modes.remarks[-1].split("buckles at ")[1].split()[0]) == pytest.approx(FACTOR, rel=5e-3)


def by_calculix(scene: latin_fmu.Scene, folder: Path, step: str, count: int) -> list[float]:
    """Frequencies, Hz, after *STATIC, NLGEOM, or factors of buckling (``step`` FREQUENCY or BUCKLE) of the part of a
    scene by ccx, on its mesh, with its forces and its change of temperature."""
    problem = discretise(scene)
    mesh, (model,) = problem.bodies["part"].mesh, problem.classes[0].members
    (block,) = mesh.blocks
    kind = {"hexahedron": "C3D8I", "tetra10": "C3D10", "hexahedron20": "C3D20"}[block.cell_type]
    lines = ["*NODE, NSET=NALL"]
    lines += [f"{i}, {x:.12e}, {y:.12e}, {z:.12e}" for i, (x, y, z) in enumerate(mesh.nodes.tolist(), 1)]
    lines += [f"*ELEMENT, TYPE={kind}, ELSET=ALL"]
    for i, cell in enumerate(block.cells + 1, 1):
        numbers = [str(n) for n in (i, *cell.tolist())]
        lines += [", ".join(numbers[:11]) + ("," if len(numbers) > 11 else "")]
        lines += [", ".join(numbers[11:])] if len(numbers) > 11 else []
    held = np.unique(np.concatenate([mesh.faces[b.face.split(".")[1]].nodes for b in scene.boundary.values()])) + 1
    lines += ["*NSET, NSET=HELD", *(f"{n}," for n in held)]
    lines += [
        "*MATERIAL, NAME=M",
        "*ELASTIC",
        f"{MODULUS}, 0.3",
        "*DENSITY",
        f"{DENSITY}",
        "*EXPANSION, ZERO=0.",
        "12e-6",
    ]
    lines += ["*SOLID SECTION, ELSET=ALL, MATERIAL=M", "*BOUNDARY", "HELD, 1, 3"]
    lines += ["*INITIAL CONDITIONS, TYPE=TEMPERATURE", "NALL, 0."]
    loads = [f"*TEMPERATURE\nNALL, {table.change}" for table in scene.temperature.values()]
    if scene.load:
        forces = model.loads[0].pattern.reshape(-1, 3)
        rows = [f"{i + 1}, {c + 1}, {forces[i, c]:.12e}" for i, c in zip(*np.nonzero(forces), strict=True)]
        loads.append("\n".join(["*CLOAD", *rows]))
    if step == "FREQUENCY":
        lines += ["*STEP, NLGEOM", "*STATIC", *loads, "*END STEP", "*STEP, PERTURBATION", "*FREQUENCY", str(count)]
    else:
        lines += ["*STEP", "*BUCKLE", f"{count}, 1e-4", *loads]
    (folder / "deck.inp").write_text("\n".join([*lines, "*END STEP"]) + "\n", encoding="utf-8")
    subprocess.run(["ccx", "-i", "deck"], cwd=folder, check=True, capture_output=True, timeout=300)
    rows = [line.split() for line in (folder / "deck.dat").read_text(encoding="utf-8").splitlines()]
    width, place = (5, 3) if step == "FREQUENCY" else (2, 1)
    return [float(row[place]) for row in rows if len(row) == width and row[0].isdigit()][:count]


@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed")
@pytest.mark.parametrize("case", [*CALCULIX, "column"])
def test_the_numbers_of_calculix_are_its_own(case: str, tmp_path: Path) -> None:
    """Those that the tests above compare with, by a run on the same mesh."""
    if case == "column":
        scene = column(tmp_path)
        assert by_calculix(scene, tmp_path, "FREQUENCY", 3) == pytest.approx(COLUMN, rel=1e-5)
        assert by_calculix(scene, tmp_path, "BUCKLE", 1) == pytest.approx([FACTOR], rel=1e-5)
        return
    scene = heated(case, tmp_path)
    assert by_calculix(scene, tmp_path, "FREQUENCY", 2) == pytest.approx(CALCULIX[case][-1], rel=1e-5)


@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed")
@pytest.mark.parametrize("cell", ["hexahedron", "hexahedron20"])
def test_hexahedra_buckle_as_in_calculix(cell: str, tmp_path: Path) -> None:
    scene = column(tmp_path, cell)
    modes = latin_fmu.vibration_modes(scene, count=3)
    assert modes.frequency == pytest.approx(by_calculix(scene, tmp_path, "FREQUENCY", 3), rel=5e-3)
    (factor,) = by_calculix(scene, tmp_path, "BUCKLE", 1)
    assert float(modes.remarks[-1].split("buckles at ")[1].split()[0]) == pytest.approx(factor, rel=1e-2)


def stack(force: float, end: float = 60e-3, **tables: Any) -> latin_fmu.Scene:
    """Four slender parts on each other, held by a force and by friction, and tapped from the side."""
    side, height = 0.01, 0.075
    data: Tables = {
        "name": "stack",
        "material": {"steel": STEEL},
        "substructure": {},
        "interface": {},
        "boundary": {"base": {"type": "fixed", "face": "p0.zmin"}},
        "load": {
            "clamp": {"face": "p3.zmax", "pressure": force / side**2, "law": "constant"},
            "tap": {"face": "p3.xmax", "force": [0.2, 0.0, 0.0], "law": {"type": "half_sine", "duration": 1e-3}},
        },
        "sensor": {"top": {"substructure": "p3", "point": [side, side / 2, 4 * height]}},
        "solver": {"tolerance": 1e-5},
        "time": {"end": end, "step": 4e-5, "start": START},
        **tables,
    }
    for i in range(4):
        box = {"origin": [0.0, 0.0, height * i], "size": [side, side, height], "elements": [2, 2, 10]}
        data["substructure"][f"p{i}"] = {"material": "steel", "bending_modes": True, "box": box}
        data["boundary"][f"side{i}"] = {"type": "symmetry", "face": f"p{i}.ymin"}
        if i:
            data["interface"][f"i{i}"] = {"sides": [f"p{i - 1}.zmax", f"p{i}.zmin"], "friction_coefficient": 0.3}
    return latin_fmu.scene_from_dict(data)


LOADS = [500.0, 2000.0, 1000.0, 1500.0, 2500.0, 3000.0, 3500.0, 4300.0]


@pytest.mark.parametrize("propagator", ["direct", "modal"])
@pytest.mark.parametrize(
    "force", [LOADS[1], *(pytest.param(force, marks=pytest.mark.slow) for force in (LOADS[0], *LOADS[2:]))]
)
def test_a_stack_in_contact_rings_at_the_frequency_of_its_modes(force: float, propagator: str) -> None:
    modes = latin_fmu.vibration_modes(stack(force), count=1)
    end = round(12.0 / modes.frequency[0] / 4e-5) * 4e-5
    scene = stack(force, end, solver={"propagator": propagator, "tolerance": 1e-5})
    solution = latin_fmu.solve(scene)
    assert solution.converged
    later = solution.time > 2e-3
    rung = frequency_of(solution.time[later], solution.sensors["top"].displacement[later, 0])
    assert rung == pytest.approx(modes.frequency[0], rel=5e-3)


def test_loads_that_are_there_from_the_start_stress_bodies() -> None:
    """A strip under a constant force along it that begins at rest and unstrained: its bending rings as in the modes,
    and as from the equilibrium."""
    data = pinned(-0.5 * EULER).tables()
    data["load"]["tap"] = {"face": "strip.zmax", "pressure": 10.0, "law": {"type": "half_sine", "duration": 1e-3}}
    data["sensor"] = {"middle": {"substructure": "strip", "point": [0.0, 0.0, 0.0]}}
    data["time"] = {"end": 60e-3, "step": 2e-5}
    data["effects"] = {"prestress": "on"}
    scene = latin_fmu.scene_from_dict(data)
    expected = latin_fmu.vibration_modes(pinned(-0.5 * EULER), count=1).frequency[0]
    assert latin_fmu.vibration_modes(scene, count=1).frequency[0] == pytest.approx(expected, rel=1e-6)
    solution = latin_fmu.solve(scene)
    assert any("begins from initial values" in warning for warning in solution.warnings)
    assert (solution.sensors["middle"].displacement[0] == 0.0).all()
    rung = frequency_of(solution.time[100:], solution.sensors["middle"].displacement[100:, 2])
    assert rung == pytest.approx(expected, rel=3e-3)


def test_what_flies_has_no_stress() -> None:
    data = pinned(0.0).tables()
    data["load"], data["boundary"] = {}, {}
    data["gravity"] = {"acceleration": [0.0, 0.0, -9.81e6]}
    data["time"] = {"end": 1e-3, "step": 1e-5}
    data["effects"] = {"prestress": "on"}
    for velocity in ([0.0, 0.0, 0.0], [0.0, 0.0, 1.0]):
        data["substructure"]["strip"]["initial_velocity"] = velocity
        problem, start = started(discretise(latin_fmu.scene_from_dict(data)), {})
        assert start is None
        assert problem.prestress is None
        assert any(
            "nothing that acts at t = 0 stresses bodies that are held" in str(remark) for remark in problem.remarks
        )


def test_a_block_that_stands_has_stress_whatever_its_initial_spin() -> None:
    """Housner's block with an initial spin about its edge, beside one of the same weight that is thrown: the first
    rocks as after a kick, under the stress of its weight, and the second has none in flight."""
    share, half, height = 0.5, ROCKS["half"], ROCKS["height"]
    radius, angle = _radius()
    topples = np.sqrt(1.5 * ROCKS["gravity"] / radius * (1.0 - np.cos(angle)))
    data = rocking(0.0, "on", True).tables()
    spin = share * topples
    data["substructure"]["block"] |= {
        "initial_spin": [0.0, spin, 0.0],
        # about its lower edge at +x
        "initial_velocity": [spin * height / 2, 0.0, spin * half],
    }
    data["load"] = {}
    thrown = {"origin": [1.0, 0.0, 0.5], "size": [2 * half, 0.04, height], "elements": [2, 1, 5]}
    data["substructure"]["thrown"] = {
        "material": "steel",
        "rigid": True,
        "box": thrown,
        "initial_velocity": [0.0, 0.0, 2.0],
    }
    data["time"] = {"end": 0.2, "step": 1e-4}
    scene = latin_fmu.scene_from_dict(data)
    problem, start = started(discretise(scene), {})
    assert start is None
    assert problem.prestress is not None
    assert list(problem.prestress.stiffness) == ["block"]
    solution = latin_fmu.solve(scene)
    assert any("in flight, without stress: thrown" in warning for warning in solution.warnings)
    leans = solution.sensors["top"].displacement[:, 0] / height
    # of small rotations: angle'' = p^2 (angle - a), from 0 with the spin
    assert leans.max() == pytest.approx(angle * (1.0 - np.sqrt(1.0 - share**2)), rel=1e-2)
    back = np.flatnonzero((leans[:-1] > 0.0) & (leans[1:] <= 0.0))
    rate = np.sqrt(0.75 * ROCKS["gravity"] / radius)
    assert solution.time[back[0]] == pytest.approx(2.0 / rate * np.arctanh(share), rel=1e-2)


@pytest.mark.parametrize("propagator", ["direct", "modal", {"type": "reduced", "modes": 10}], ids=str)
@pytest.mark.parametrize("share", [1.0, -0.5])
def test_stress_neither_adds_to_damping_nor_takes_from_it(share: float, propagator: Any) -> None:
    """Damping by strains loses a share of the strain energy: of a string that its tension stiffens to twice the square
    of the frequency half the ratio, of a column at half its buckling load twice."""
    data = pinned(share * EULER).tables()
    data["damping"] = {"ratio": 0.02, "band": [100.0, 2000.0]}
    data["load"]["tap"] = {"face": "strip.zmax", "pressure": 10.0, "law": {"type": "half_sine", "duration": 1e-3}}
    data["sensor"] = {"middle": {"substructure": "strip", "point": [0.0, 0.0, 0.0]}}
    data["time"] = {"end": 60e-3, "step": 2e-5, "start": START}
    data["solver"] = {"propagator": propagator}
    scene = latin_fmu.scene_from_dict(data)
    modes = latin_fmu.vibration_modes(scene, count=1)
    assert modes.damping is not None
    assert modes.damping.bodies[0] == pytest.approx(0.02 / (1.0 + share), rel=3e-2)
    motion = latin_fmu.solve(scene).sensors["middle"].displacement[200:, 2]
    turns = np.flatnonzero(np.diff(np.sign(np.diff(motion)))) + 1
    swings = np.abs(np.diff(motion[turns]))[:13]
    rung = np.log(swings[0] / swings[-1]) / (np.pi * (len(swings) - 1))
    assert rung == pytest.approx(modes.damping.bodies[0], rel=2e-2)


def test_the_force_of_a_bond_is_that_of_the_other_march() -> None:
    """A pulled strip in two bonded parts, damped by strains: the march by modes finds the bond from the equilibrium of
    the parts, their stress and its stiffness included."""
    forces = {}
    for propagator in ("direct", "modal"):
        data = pinned(EULER).tables()
        data["damping"] = {"ratio": 0.05, "band": [100.0, 2000.0]}
        data["substructure"] = {
            name: {
                "material": "steel",
                "bending_modes": True,
                "box": {"origin": [at, 0.0, 0.0], "size": [HALF / 2, WIDTH, THICKNESS], "elements": [20, 2, 1]},
            }
            for name, at in (("near", 0.0), ("far", HALF / 2))
        }
        data["interface"] = {"bond": {"sides": ["near.xmax", "far.xmin"], "behaviour": "perfect"}}
        data["boundary"] = {
            "middle": {"type": "symmetry", "face": "near.xmin"},
            "pin": {"type": "fixed", "face": "far.xmax", "components": ["z"]},
            "near_side": {"type": "symmetry", "face": "near.ymin"},
            "far_side": {"type": "symmetry", "face": "far.ymin"},
        }
        data["load"]["along"]["face"] = "far.xmax"
        data["load"]["tap"] = {"face": "near.zmax", "pressure": 1e3, "law": {"type": "half_sine", "duration": 1e-3}}
        data["time"] = {"end": 4e-3, "step": 1e-5, "start": START}
        data["solver"] = {"propagator": propagator, "tolerance": 1e-7}
        solution = latin_fmu.solve(latin_fmu.scene_from_dict(data))
        assert any("changes natural frequencies" in warning for warning in solution.warnings)
        forces[propagator] = solution.interfaces["bond"].force()[:, 2]
    largest = np.abs(forces["direct"]).max()
    assert np.abs(forces["modal"] - forces["direct"]).max() < 1e-2 * largest


def test_a_bent_column_bends_more_under_its_load() -> None:
    """The start of a strip under a force along it and one across it: the deflection grows by 1 / (1 + N / P), its
    shape that of the mode but for 1.5 %; Timoshenko and Gere, Theory of Elastic Stability, section 1.11."""
    deflections = {}
    for share in (-0.5, -0.1):
        for choice in ("on", "off"):
            sensor = {"middle": {"substructure": "strip", "point": [0.0, 0.0, 0.0]}}
            data = pinned(share * EULER, sensor=sensor, effects={"prestress": choice}).tables()
            data["load"]["across"] = {"face": "strip.zmax", "pressure": 100.0, "law": "constant"}
            motion = latin_fmu.solve(latin_fmu.scene_from_dict(data)).sensors["middle"].displacement[:, 2]
            # at rest: all of it acts at t = 0
            assert np.ptp(motion) < 1e-6 * np.abs(motion).max()
            deflections[share, choice] = motion[0]
        ratio = deflections[share, "on"] / deflections[share, "off"]
        assert ratio == pytest.approx(1.0 / (1.0 + share), rel=1.5e-2)


def test_a_contact_that_opens_for_long_is_a_fault() -> None:
    """A part that is pulled off what it was pressed on keeps a stiffness that is no longer there."""
    data = stack(2000.0, 8e-3).tables()
    law = {"type": "table", "times": [0.0, 1e-3, 1.1e-3, 8e-3], "values": [1.0, 1.0, -0.001, -0.001]}
    data["load"]["clamp"]["law"] = law
    data["load"].pop("tap")
    data["time"]["end"] = 24e-3
    status = latin_fmu.solve(latin_fmu.scene_from_dict(data)).status
    assert "carries less than 10 % of its force of t = 0" in status
    assert status.startswith("not trustworthy")
    data["effects"]["prestress"] = "off"
    assert "carries less than" not in latin_fmu.solve(latin_fmu.scene_from_dict(data)).status


ROCKS = {"half": 0.02, "height": 0.2, "gravity": 9.81, "pulse": 2e-3}


def rocking(share: float, choice: str, rigid: bool) -> latin_fmu.Scene:
    """A slender block that stands on the ground under its weight, kicked at its upper edge: the spin is this share of
    that at which it topples."""
    half, height = ROCKS["half"], ROCKS["height"]
    box = {"origin": [-half, 0.0, 0.0], "size": [2 * half, 0.04, height], "elements": [2, 1, 5]}
    kick = {"face": "block.zmax", "traction": [_kick(share) / (2 * half * 0.04), 0.0, 0.0]}
    data: Tables = {
        "name": "block",
        "material": {"steel": STEEL},
        "substructure": {"block": {"material": "steel", "rigid": rigid, "box": box}},
        "interface": {"floor": {"sides": ["block.zmin", "ground"], "friction_coefficient": 0.9}},
        "gravity": {"acceleration": [0.0, 0.0, -ROCKS["gravity"]]},
        "load": {"kick": kick | {"law": {"type": "half_sine", "duration": ROCKS["pulse"]}}},
        "effects": {"prestress": choice},
        "solver": {"tolerance": 1e-4},
        "sensor": {"top": {"substructure": "block", "point": [half, 0.02, height]}},
        "time": {"end": 0.4, "step": 1e-4, "start": START},
    }
    if not rigid:
        data["boundary"] = {"side": {"type": "symmetry", "face": "block.ymin"}}
    return latin_fmu.scene_from_dict(data)


def _radius() -> tuple[float, float]:
    """Distance of the mass centre from the edge, m, and the angle at which it is above it."""
    half, height = ROCKS["half"], ROCKS["height"]
    return float(np.hypot(half, height / 2)), float(np.arctan(half / (height / 2)))


def _kick(share: float) -> float:
    """Peak force, N, that gives the block the spin."""
    radius, angle = _radius()
    mass = DENSITY * 2 * ROCKS["half"] * ROCKS["height"] * 0.04
    inertia = 4.0 / 3.0 * mass * radius**2
    topples = np.sqrt(2.0 * mass * ROCKS["gravity"] * radius * (1.0 - np.cos(angle)) / inertia)
    return float(share * topples * inertia / (ROCKS["height"] * ROCKS["pulse"] * 2.0 / np.pi))


def housner(share: float) -> tuple[float, float]:
    """Time at which a rigid block is back, infinite where it falls, and its largest angle (Housner 1963)."""
    radius, angle = _radius()
    mass = DENSITY * 2 * ROCKS["half"] * ROCKS["height"] * 0.04
    inertia, peak = 4.0 / 3.0 * mass * radius**2, _kick(share)

    def rate(t: float, y: np.ndarray) -> list[float]:
        force = peak * np.sin(np.pi * t / ROCKS["pulse"]) if t < ROCKS["pulse"] else 0.0
        moment = force * ROCKS["height"] - mass * ROCKS["gravity"] * radius * np.sin(angle - y[0])
        return [y[1], moment / inertia]

    def back(_: float, y: np.ndarray) -> float:
        return float(y[0])

    back.terminal, back.direction = True, -1  # type: ignore[attr-defined]
    first = scipy.integrate.solve_ivp(
        rate, (1e-5, 2.0), [1e-9, 1e-6], events=back, rtol=1e-9, atol=1e-12, max_step=2e-4
    )
    time = first.t_events[0]
    return (float(time[0]) if len(time) else np.inf), float(first.y[0].max())


@pytest.mark.parametrize("rigid", [True, pytest.param(False, marks=pytest.mark.slow)])
@pytest.mark.parametrize("share", [0.5, 0.9, 1.1])
def test_a_standing_block_rocks_as_housners(share: float, rigid: bool) -> None:
    expected, angle = housner(share)
    solution = latin_fmu.solve(rocking(share, "on", rigid))
    leans = solution.sensors["top"].displacement[:, 0] / ROCKS["height"]
    back = np.flatnonzero((leans[:-1] > 0.0) & (leans[1:] <= 0.0))
    if not np.isfinite(expected):
        assert not len(back)
        assert leans[-1] > _radius()[1]
        return
    # the kick bends an elastic block, too; near toppling the time grows ten times as fast as the spin
    assert solution.time[back[0]] == pytest.approx(expected, rel=2e-2 if rigid else 6e-2)
    assert leans.max() == pytest.approx(angle, rel=3e-2 if rigid else 6e-2)
    assert solution.converged
    without = latin_fmu.solve(rocking(share, "off", rigid))
    assert (without.sensors["top"].displacement[:, 0] / ROCKS["height"]).max() < 0.95 * angle
    (said,) = (warning for warning in without.warnings if "has rocked on floor" in warning)
    assert 'effects.prestress = "on"' in said
    assert not any("has rocked" in warning for warning in solution.warnings)


@pytest.mark.parametrize("share", [0.5, 1.1])
def test_what_rocks_is_run_again_with_the_stiffness_of_its_stress(share: float) -> None:
    chosen, on = (latin_fmu.solve(rocking(share, choice, True)) for choice in ("automatic", "on"))
    assert np.array_equal(chosen.sensors["top"].displacement, on.sensors["top"].displacement)
    assert chosen.outcome.settings["stiffness of stress"] == "taken, as parts rocked in a run without it"
    assert chosen.warnings == on.warnings
    little = latin_fmu.solve(rocking(0.05, "automatic", True))
    assert "stiffness of stress" not in little.outcome.settings


def lifted(choice: str, side: float) -> latin_fmu.Scene:
    """The same block, thrown up, and tilted by a force on its side (N) before."""
    data = rocking(0.0, choice, True).tables()
    weight = DENSITY * ROCKS["height"] * ROCKS["gravity"]
    law = {"type": "half_sine", "duration": 5e-3}
    tilt = {"face": "block.xmin", "traction": [side / (0.04 * ROCKS["height"]), 0.0, 0.0], "law": law}
    data["load"]["tilt"] = tilt
    data["load"]["throw"] = {"face": "block.zmax", "traction": [0.0, 0.0, 12.0 * weight], "law": law | {"start": 8e-3}}
    data["time"]["end"] = 0.06
    return latin_fmu.scene_from_dict(data)


@pytest.mark.parametrize("side", [0.0, 400.0])
def test_a_block_in_flight_keeps_its_spin(side: float) -> None:
    """With the stiffness of its stress the block would be turned on in flight: it is not taken, or the run not
    trustworthy."""
    solution = latin_fmu.solve(lifted("automatic", side))
    flies = solution.time > 15e-3
    assert (solution.interfaces["floor"].normal_resultant()[flies] == 0.0).all()
    spin = solution.sensors["top"].velocity[flies, 0]
    assert np.ptp(spin) < 1e-6 * max(np.abs(spin).max(), 1e-3)
    if side:
        assert solution.outcome.settings["stiffness of stress"].startswith("left out")
        driven = latin_fmu.solve(lifted("on", side))
        assert "changes its spin by" in driven.status
        turned = driven.sensors["top"].velocity[flies, 0]
        assert np.ptp(turned) > 1e-2 * np.abs(turned).max()


MARCHES: Tables = {
    "direct": {},
    "damped": {"damping": {"ratio": 0.02, "band": [100.0, 2000.0]}},
    "reduced": {"solver": {"propagator": {"type": "reduced", "modes": 10}, "tolerance": 1e-6}},
    "reduced, damped": {
        "solver": {"propagator": {"type": "reduced", "modes": 10}, "tolerance": 1e-6},
        "damping": {"ratio": 0.02, "band": [100.0, 2000.0]},
    },
    "modal": {"solver": {"propagator": "modal", "tolerance": 1e-6}},
    "explicit": {
        "solver": {"propagator": "explicit", "tolerance": 1e-6},
        "time": {"end": 2e-4, "step": 4e-7, "scheme": "central_difference", "start": START},
    },
}


@pytest.mark.parametrize("march", MARCHES)
def test_the_energy_of_stress_is_a_term_of_a_balance_that_closes(march: str) -> None:
    """It is u.K_sigma u / 2 of the bodies, here by the fields that the run has stored, and negative under a load that
    presses."""
    scene = stack(2000.0, 4e-3, **{"output": {"energy": True, "fields": True}, **MARCHES[march]})
    solution = latin_fmu.solve(scene)
    problem, _ = started(discretise(scene), {})
    energy, expected = solution.energy, 0.0
    assert energy is not None
    assert problem.prestress is not None
    for name, history in solution.substructures.items():
        assert history.displacement is not None
        u = history.displacement.reshape(len(history.displacement), -1)
        expected = expected + 0.5 * np.einsum("td,dt->t", u, problem.prestress.stiffness[name] @ u.T)
    term = energy["prestress"]
    assert term.max() < 0.0
    stored = np.searchsorted(solution.time, next(iter(solution.substructures.values())).time - 1e-12)
    assert term[stored] == pytest.approx(expected, rel=1e-6 if march != "modal" else 1e-5)
    largest = max(float(np.abs(values).max()) for values in energy.values())
    assert np.abs(energy["balance"]).max() < 1e-10 * largest
    changes = max(float(np.abs(values - values[0]).max()) for values in energy.values())
    assert np.abs(energy["balance"]).max() < 1e-6 * changes


def test_a_reduced_body_that_rocks_has_the_stiffness_of_its_stress() -> None:
    """By itself, compressed and held by nothing, it has no positive stiffness: its modes are those without stress."""
    leans = []
    for propagator in ({"type": "direct"}, {"type": "reduced", "modes": 6}):
        data = rocking(0.5, "on", False).tables()
        data["solver"]["propagator"] = propagator
        leans.append(latin_fmu.solve(latin_fmu.scene_from_dict(data)).sensors["top"].displacement[:, 0])
    assert np.abs(leans[1] - leans[0]).max() < 5e-3 * leans[0].max()


def test_a_session_steps_with_the_stress_of_its_start() -> None:
    scene = stack(2000.0, 4e-3)
    expected = latin_fmu.solve(scene).sensors["top"].velocity[:, 0]
    plain = latin_fmu.solve(stack(2000.0, 4e-3, effects={"prestress": "off"})).sensors["top"].velocity[:, 0]
    session = Session(scene)
    session.initialize()
    at = session.outputs.index("sensor.top.velocity[1]")
    rows = [session.row[at]]
    for i in range(10):
        assert session.step(i * 4e-4, 4e-4)
        rows.append(session.row[at])
    largest = np.abs(expected).max()
    assert np.abs(np.array(rows) - expected[::10]).max() < 1e-3 * largest
    assert np.abs(plain - expected).max() > 0.1 * largest


def test_stress_that_does_not_count_leaves_every_bit() -> None:
    """A stout scene with a static start: no matrix and no start is another one."""
    table = {"size": [0.02, 0.02, 0.02], "elements": [2, 2, 2]}
    data: Tables = {
        "name": "stout",
        "material": {"steel": STEEL},
        "substructure": {"block": {"material": "steel", "box": table}},
        "interface": {"floor": {"sides": ["block.zmin", "ground"], "friction_coefficient": 0.3}},
        "load": {
            "weight": {"face": "block.zmax", "pressure": 1e6, "law": "constant"},
            "push": {"face": "block.xmax", "pressure": 1e5, "law": {"type": "half_sine", "duration": 2e-5}},
        },
        "time": {"end": 4e-5, "step": 1e-6, "start": START},
    }
    automatic = latin_fmu.solve(latin_fmu.scene_from_dict(data))
    off = latin_fmu.solve(latin_fmu.scene_from_dict({**data, "effects": {"prestress": "off"}}))
    assert np.array_equal(automatic.interfaces["floor"].traction, off.interfaces["floor"].traction)
    assert not any("stress of t = 0" in warning for warning in automatic.warnings)


def test_bodies_of_unequal_stress_share_no_operators() -> None:
    """Two equal strips side by side, one pulled and one pushed, ring as each of them alone."""
    forces = {"pulled": 0.5 * EULER, "pushed": -0.5 * EULER}
    one = {name: latin_fmu.vibration_modes(pinned(force), count=1).frequency[0] for name, force in forces.items()}
    data: Tables = pinned(0.0).tables()
    data["boundary"], data["load"], data["substructure"] = {}, {}, {}
    for i, (name, force) in enumerate(forces.items()):
        box = {"origin": [0.0, 0.1 * i, 0.0], "size": [HALF, WIDTH, THICKNESS], "elements": [40, 2, 1]}
        data["substructure"][name] = {"material": "steel", "bending_modes": True, "box": box}
        data["boundary"][f"middle_{name}"] = {"type": "symmetry", "face": f"{name}.xmin"}
        data["boundary"][f"pin_{name}"] = {"type": "fixed", "face": f"{name}.xmax", "components": ["z"]}
        data["boundary"][f"side_{name}"] = {"type": "symmetry", "face": f"{name}.ymin"}
        data["load"][name] = {"face": f"{name}.xmax", "traction": [force / SECTION, 0.0, 0.0], "law": "constant"}
    scene = latin_fmu.scene_from_dict(data)
    problem, _ = started(discretise(scene), {})
    assert len(problem.classes) == 2
    assert latin_fmu.vibration_modes(scene, count=2).frequency == pytest.approx(sorted(one.values()), rel=1e-7)


PUSHED = {"damping": {"ratio": 0.02, "band": [100.0, 2000.0]}, "output": {"check_sensitivities": "none"}}


@pytest.mark.parametrize("propagator", ["direct", pytest.param("modal", marks=pytest.mark.slow)])
def test_derivatives_of_a_stressed_scene_are_those_of_central_differences(propagator: str) -> None:
    """By what does not change the state at t = 0: a load after it, a ratio of damping, a friction that sticks; and, in
    the march of the bodies, a density."""
    names = ["load.tap.force.0", "damping.ratio", "interface.i2.friction_coefficient"]
    names += ["material.steel.density"] if propagator == "direct" else []
    scene = stack(2000.0, 2e-3, solver={"propagator": propagator, "tolerance": 1e-9}, **PUSHED)
    solution = latin_fmu.solve(scene.replace("output.sensitivities", names))
    assert any("changes natural frequencies" in warning for warning in solution.warnings)
    by_name = {d.name: d for d in solution.sensitivities.derivatives}
    for name in names:
        value, step = by_name[name].value, 1e-3
        more, less = (latin_fmu.solve(scene.replace(name, value * (1.0 + sign * step))) for sign in (1.0, -1.0))
        a, b = (s.sensors["top"].velocity for s in (more, less))
        expected, own = (a - b) / (2.0 * step), by_name[name].sensors["top"].velocity
        size = np.abs(expected).max() if "friction" not in name else np.abs(a).max()
        assert np.abs(own - expected).max() < 1e-3 * size, name


@pytest.mark.parametrize("name", ["load.clamp.pressure", "material.steel.young_modulus"])
def test_derivatives_by_what_changes_the_stress_are_refused(name: str) -> None:
    scene = stack(2000.0, 2e-3, output={"sensitivities": [name]})
    with pytest.raises(SceneError, match=r"changes the state at t = 0, whose stress has a stiffness"):
        latin_fmu.solve(scene)


def test_derivatives_from_initial_values_are_refused_where_stress_counts() -> None:
    data = pinned(EULER, output={"sensitivities": ["material.steel.density"]}).tables()
    data["time"] = {"end": 2e-3, "step": 2e-5}
    data["effects"] = {"prestress": "on"}
    with pytest.raises(SceneError, match=r"effects\.prestress: from initial values derivatives do not know"):
        latin_fmu.solve(latin_fmu.scene_from_dict(data))


def test_the_matrix_of_a_stressed_box() -> None:
    """No force in a translation; in a rotation those of the stress on the faces, turned."""
    rng = np.random.default_rng(3)
    mesh = box_mesh(np.zeros(3), np.array([1.0, 2.0, 3.0]), (2, 2, 2))
    six = rng.normal(size=(1, 6))
    stress = np.array(
        [[six[0, 0], six[0, 5], six[0, 4]], [six[0, 5], six[0, 1], six[0, 3]], [six[0, 4], six[0, 3], six[0, 2]]]
    )
    matrix = geometric_stiffness(Elements(mesh), Isotropic(1.0, 1.0, 0.3), np.zeros((mesh.n_node, 3)), six)
    assert abs(matrix - matrix.T).max() < 1e-12
    moves = rigid_modes(mesh.nodes, np.array([0.5, 1.0, 1.5]), 1.0)
    assert np.abs(matrix @ moves[:, :3]).max() < 1e-12
    expected = 6.0 * (np.trace(stress) * np.eye(3) - stress)
    assert moves[:, 3:].T @ matrix @ moves[:, 3:] == pytest.approx(expected, rel=1e-12, abs=1e-12)


def stud(force: float, choice: str = "automatic") -> latin_fmu.Scene:
    """A slender stud between rigid walls, tightened by its cut."""
    box = {"origin": [0.0, 0.0, 0.0], "size": [0.008, 0.008, 0.2], "elements": [2, 2, 40]}
    return latin_fmu.scene_from_dict(
        {
            "name": "stud",
            "material": {"steel": STEEL},
            "substructure": {"stud": {"material": "steel", "bending_modes": True, "box": box}},
            "boundary": {end: {"type": "fixed", "face": f"stud.{end}"} for end in ("zmin", "zmax")},
            "bolt": {"cut": {"substructure": "stud", "axis": [0.0, 0.0, 1.0], "force": force}},
            "effects": {"prestress": choice},
            "output": {"reactions": True},
            "time": {"end": 2e-4, "step": 2e-5, "start": START},
        }
    )


def test_a_slender_bolt_keeps_its_tension() -> None:
    """The jump in the cut of a bolt is a motion like all others: with the stiffness of its stress it pulls as much as
    the rest of the shank. The frequency of the beam between walls grows with its tension."""
    force = 15e3
    solution = latin_fmu.solve(stud(force))
    assert any("changes natural frequencies" in warning for warning in solution.warnings)
    # its shortening is kept: the stress of the stretched shank adds its strain
    assert solution.bolts["cut"].force == pytest.approx(force * (1.0 + force / 0.008**2 / 210e9), rel=2e-4)
    reaction = np.asarray(solution.reactions["zmax"].force)[-1]
    assert abs(reaction[2]) == pytest.approx(force, rel=3e-3)
    # of a clamped beam: f^2 = f_0^2 (1 + 0.0246 N L^2 / (E I)) for small tensions
    lower, upper = (latin_fmu.vibration_modes(stud(force, choice), count=1).frequency[0] for choice in ("off", "on"))
    parameter = force * 0.2**2 / (210e9 * 0.008**4 / 12.0)
    assert (upper / lower) ** 2 - 1.0 == pytest.approx(0.0246 * parameter, rel=3e-2)
