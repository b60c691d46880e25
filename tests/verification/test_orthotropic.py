"""Orthotropic bodies in scenes: frequencies of a plate and of CalculiX, a pulled ply, waves, all propagators."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.building import discretise
from latin_fmu.reader import scene_from_dict
from tests.fem.scenes import box_file

FR4 = {
    "density": 1850.0,
    "orthotropic": {
        "young_moduli": [22e9, 18e9, 8e9],
        "poisson_ratios": [0.14, 0.3, 0.28],
        "shear_moduli": [4.5e9, 3e9, 2.6e9],
    },
}
SIDE = [0.0, 1.0, 0.0]


def turned(x: list[float], y: list[float]) -> dict[str, Any]:
    return {**FR4, "orthotropic": {**FR4["orthotropic"], "axes": {"x": x, "y": y}}}  # type: ignore[dict-item]


def body(size: list[float], elements: list[int], material: dict[str, Any] = FR4, **keys: Any) -> dict[str, Any]:
    """One box of the material."""
    return {
        "name": "body",
        "material": {"fr4": material},
        "substructure": {"body": {"material": "fr4", "box": {"size": size, "elements": elements}, **keys}},
        "time": {"end": 1e-4, "instants": 100},
    }


def test_simply_supported_plate() -> None:
    """Thin plate (Jones, eq. 5.41): omega^2 rho h = D_11 p^4 + 2 (D_12 + 2 D_66) p^2 q^2 + D_22 q^4, p = m pi / a,
    q = n pi / b. The fibres run along y of the scene."""
    a, b, h = 0.16, 0.1, 0.001
    e1, e2, nu, g = 22e9, 18e9, 0.14, 4.5e9
    scale = h**3 / 12 / (1 - nu * nu * e2 / e1)
    stiff, soft, mixed = e1 * scale, e2 * scale, nu * e2 * scale + 2 * g * h**3 / 12
    data = body([a, b, h], [48, 30, 1], turned(SIDE, [-1.0, 0.0, 0.0]), bending_modes=True)
    data["boundary"] = {
        f"{face}{end}": {"type": "fixed", "face": f"body.{face}{end}", "components": [other, "z"]}
        for face, other in (("x", "y"), ("y", "x"))
        for end in ("min", "max")
    }
    actual = latin_fmu.vibration_modes(scene_from_dict(data), count=5).frequency
    squares = [
        soft * p**4 + 2 * mixed * p * p * q * q + stiff * q**4
        for p in np.arange(1, 6) * np.pi / a
        for q in np.arange(1, 6) * np.pi / b
    ]
    wanted = np.sort(np.sqrt(np.array(squares) / (1850.0 * h)))[:5] / (2 * np.pi)
    np.testing.assert_allclose(actual, wanted, rtol=0.01)


def test_pulled_along_an_axis() -> None:
    """Uniform stress: extension p / E_2 along it, contractions nu_21 and nu_23 of it, no other stress at any node."""
    data = body([0.1, 0.02, 0.01], [4, 2, 2], turned(SIDE, [-1.0, 0.0, 0.0]))
    data["boundary"] = {axis: {"type": "symmetry", "face": f"body.{axis}min"} for axis in "xyz"}
    data["load"] = {"pull": {"face": "body.xmax", "pressure": -1e6}}
    data["time"] = {"quasi_static": True, "end": 1.0, "instants": 1}
    data["output"] = {"stress": True, "nodal_stress": True, "strain": True}
    solution = latin_fmu.solve(scene_from_dict(data))
    strain = 1e6 / 18e9 * np.array([1.0, -0.14 * 18 / 22, -0.28, 0.0, 0.0, 0.0])
    tree = solution.to_datatree()["substructures/body"]
    np.testing.assert_allclose(tree["strain"][-1], np.tile(strain, (16, 1)), rtol=1e-9, atol=1e-14)
    for name in ("stress", "nodal_stress"):
        stress = tree[name][-1]
        np.testing.assert_allclose(stress, np.tile([1e6, 0, 0, 0, 0, 0], (len(stress), 1)), rtol=1e-9, atol=1e-3)


def column(**keys: Any) -> dict[str, Any]:
    """A bar along z of which z is axis 1, kept from moving sideways; a pulse of pressure on its upper end."""
    stiff = np.linalg.inv(
        [[1 / 22, -0.14 / 22, -0.3 / 22], [-0.14 / 22, 1 / 18, -0.28 / 18], [-0.3 / 22, -0.28 / 18, 1 / 8]]
    )
    speed = float(np.sqrt(1e9 * stiff[0, 0] / 1850.0))
    data = body([0.01, 0.01, 0.2], [1, 1, 60], turned([0.0, 0.0, 1.0], [1.0, 0.0, 0.0]))
    data["boundary"] = {f: {"type": "symmetry", "face": f"body.{f}"} for f in ("xmin", "xmax", "ymin", "ymax")}
    data["load"] = {
        "hit": {"face": "body.zmax", "pressure": 1e6, "law": {"type": "half_sine", "duration": 0.05 / speed}}
    }
    data["time"] = {"end": 0.5 / speed, "instants": 600}
    data["output"] = {"energy": True}
    data["sensor"] = {"end": {"face": "body.zmax"}, "foot": {"face": "body.zmin"}}
    return data | keys


@pytest.mark.parametrize("propagator", ["direct", "cg", "explicit", "reduced"])
def test_wave_along_an_axis(propagator: str) -> None:
    """The loaded end moves by impulse / (rho c A) while the pulse enters; it arrives at the foot after L / c."""
    data = column()
    if propagator != "direct":
        data["solver"] = {"propagator": propagator}
    scene = scene_from_dict(data)
    solution = latin_fmu.solve(scene)
    c_p, _ = discretise(scene).bodies["body"].shape.elasticity.wave_speeds
    time, end, foot = solution.time, solution.sensors["end"], solution.sensors["foot"]
    duration = 0.05 / c_p
    pushed = end.displacement[np.searchsorted(time, 2 * duration), 2]
    assert pushed == pytest.approx(-1e6 * 2 * duration / np.pi / (1850.0 * c_p), rel=0.01)
    half = 0.5 * foot.displacement[np.searchsorted(time, 1.6 * 0.2 / c_p), 2]
    arrival = np.interp(
        -half,
        -foot.displacement[: np.searchsorted(time, 1.6 * 0.2 / c_p), 2],
        time[: np.searchsorted(time, 1.6 * 0.2 / c_p)],
    )
    assert arrival == pytest.approx(0.2 / c_p + 0.5 * duration, rel=0.01)


def test_absorbing_end_takes_the_pulse() -> None:
    """With rho c of axis 1, which is 1.9 times that of the third."""
    data = column()
    data["boundary"]["out"] = {"type": "absorbing", "face": "body.zmin"}
    energy = latin_fmu.solve(scene_from_dict(data)).energy
    assert energy is not None
    total = energy["kinetic"] + energy["elastic"]
    assert total[-1] < 3e-3 * total.max()
    assert np.abs(energy["balance"]).max() < 1e-10 * total.max()


def frequencies_of_calculix(folder: Path, scene: latin_fmu.Scene, clamped: str, count: int) -> np.ndarray:
    """Frequencies (count,), Hz, by ccx on the mesh of the body of a scene, one face of it clamped."""
    mesh = discretise(scene).bodies["body"].mesh
    table = scene.material["fr4"].orthotropic
    assert table is not None
    assert table.axes is not None
    (e1, e2, e3), (n12, n13, n23), (g12, g13, g23) = table.young_moduli, table.poisson_ratios, table.shear_moduli
    kind = {"tetra10": "C3D10", "hexahedron20": "C3D20"}[mesh.blocks[0].cell_type]
    lines = ["*NODE, NSET=NALL"]
    lines += [f"{i}, {x:.12e}, {y:.12e}, {z:.12e}" for i, (x, y, z) in enumerate(mesh.nodes.tolist(), 1)]
    lines += [f"*ELEMENT, TYPE={kind}, ELSET=ALL"]
    for i, cell in enumerate(mesh.blocks[0].cells + 1, 1):
        numbers = [str(n) for n in (i, *cell.tolist())]
        lines += [", ".join(numbers[:11]) + ("," if len(numbers) > 11 else "")]
        lines += [", ".join(numbers[11:])] if len(numbers) > 11 else []
    lines += ["*NSET, NSET=CLAMPED", *(f"{n}," for n in mesh.faces[clamped].nodes + 1)]
    lines += ["*ORIENTATION, NAME=OWN, SYSTEM=RECTANGULAR", ", ".join(map(str, (*table.axes.x, *table.axes.y)))]
    lines += ["*MATERIAL, NAME=FR4", "*ELASTIC, TYPE=ENGINEERING CONSTANTS"]
    lines += [f"{e1}, {e2}, {e3}, {n12}, {n13}, {n23}, {g12}, {g13}", f"{g23}, 294.", "*DENSITY", "1850."]
    lines += ["*SOLID SECTION, ELSET=ALL, MATERIAL=FR4, ORIENTATION=OWN", "*BOUNDARY", "CLAMPED, 1, 3"]
    lines += ["*STEP", "*FREQUENCY", str(count), "*NODE FILE", "U", "*END STEP"]
    (folder / "deck.inp").write_text("\n".join(lines) + "\n", encoding="utf-8")
    subprocess.run(["ccx", "-i", "deck"], cwd=folder, check=True, capture_output=True, timeout=300)
    rows = [line.split() for line in (folder / "deck.dat").read_text(encoding="utf-8").splitlines()]
    return np.array([float(row[3]) for row in rows if len(row) == 5 and row[0].isdigit()][:count])


@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed")
@pytest.mark.parametrize("cells", ["hexahedron20", "tetra10"])
def test_frequencies_of_calculix_on_the_same_mesh(tmp_path: Path, cells: str) -> None:
    """A cantilever plate whose axes lie at 30 degrees in its plane and tilted out of it."""
    material = turned([0.8, 0.5, 0.2], [-0.5, 0.8, 0.1])
    data = body([1.0, 1.0, 1.0], [1, 1, 1], material)
    file = box_file(tmp_path / "plate.msh", cells, (0.08, 0.05, 0.002), (8, 5, 1))
    data["substructure"]["body"] = {**file, "material": "fr4"}
    data["boundary"] = {"clamp": {"type": "fixed", "face": "body.xmin"}}
    scene = scene_from_dict(data)
    wanted = frequencies_of_calculix(tmp_path, scene, "xmin", 5)
    actual = latin_fmu.vibration_modes(scene, count=5).frequency
    np.testing.assert_allclose(actual, wanted, rtol=2.5e-3)
