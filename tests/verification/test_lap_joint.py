"""models/lap_joint: five parts of one mesh file, found interfaces; forces by equilibrium, what friction allows."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from latin_fmu import api, load_scene
from latin_fmu.mesh_files.reading import read_content
from tests.scenes import MODELS, solved

AXIAL = {"lower_upper": -1.0, "lower_nut": 1.0, "upper_washer": -1.0, "washer_bolt": -1.0}  # on the first side


@pytest.fixture(scope="module")
def pulled() -> xr.DataTree:
    return solved("lap_joint/scene").to_datatree()


def test_parts_and_interfaces_are_found() -> None:
    lines = "\n".join(api.check(load_scene(MODELS / "lap_joint" / "scene.toml")))
    for words in (
        "5 substructure(s)",
        "5 interface(s)",
        "body washer: 0.012 x 0.012 x 0.0016 m",
        "366 hexahedron, 4 wedge",
    ):
        assert words in lines
    assert all(f"interface {name}" in lines for name in AXIAL)


def test_forces_are_those_of_equilibrium(pulled: xr.DataTree) -> None:
    """The tension of the bolt through every interface; the pull through the plates and, by friction under head and nut,
    the bolt (tolerance 1e-5)."""
    tension = pulled["bolts/m6"]["force"].values
    assert tension[0] == pytest.approx(5000.0, rel=1e-6)
    assert np.all(np.diff(tension) < 0.0)  # the bent plates get thinner under the head
    assert tension[-1] == pytest.approx(4951.0, abs=2.0)  # of the shipped mesh
    along = np.zeros(11)
    for name, sign in AXIAL.items():
        force = pulled[f"interfaces/{name}"]["force"].values
        np.testing.assert_allclose(force[:, 2], sign * tension, rtol=1e-4)
        np.testing.assert_allclose(force[:, 1], 0.0, atol=2.0)
        along += force[:, 0] if name in ("lower_upper", "lower_nut") else 0.0
    np.testing.assert_allclose(along, -60.0 * np.arange(11), atol=0.1)  # on the lower plate


def test_pressure_between_the_plates_is_a_cone(pulled: xr.DataTree) -> None:
    plates = pulled["interfaces/lower_upper"].to_dataset().isel(time=0)
    pressure = -np.einsum("pi,pi->p", plates["traction"].values, plates["normal"].values)
    radius = np.hypot(plates["x"].values, plates["y"].values)
    share = [float((pressure * plates["area"].values)[radius < r].sum()) / 5000.0 for r in (6e-3, 8e-3)]
    assert 0.7 < share[0] < 0.9
    assert share[1] > 0.98
    assert pressure.min() >= 0.0


def test_shock_slips_the_joint_as_far_as_friction_lets_it() -> None:
    tree = solved("lap_joint/shock").to_datatree()
    plates: Any = tree["interfaces/lower_upper"].to_dataset()
    force, time = plates["force"].values, plates["time"].values
    ratio = np.abs(force[:, 0]) / -force[:, 2]
    assert ratio.max() == pytest.approx(0.2, rel=1e-3)
    assert force[0, 2] == pytest.approx(-5000.0, rel=1e-3)  # tightened
    jump = plates["velocity"].values[:, 1, :, 0] - plates["velocity"].values[:, 0, :, 0]
    slip = np.trapezoid(jump, time, axis=0)
    # the shipped mesh and step; towards -x, and little enough that the shank does not meet the hole (0.3 mm)
    assert slip.mean() == pytest.approx(-47e-6, rel=0.05)
    energy = {str(k): float(v.values[-1]) for k, v in tree["energy"].to_dataset().items()}
    assert energy["friction_dissipation"] == pytest.approx(0.108, rel=0.03)
    assert energy["friction_dissipation"] < energy["work_of_loads"]
    tension = tree["bolts/m6"]["force"].values
    assert tension[-1] == pytest.approx(4780.0, rel=0.01)  # less than it was tightened to: the joint has slipped


def test_the_script_makes_the_mesh(tmp_path: Path) -> None:
    """Parts and faces of a fresh mesh are those of the shipped one (elements differ between versions of gmsh)."""
    pytest.importorskip("gmsh")
    script, fresh = MODELS / "lap_joint" / "lap_joint.py", tmp_path / "fresh.msh"
    subprocess.run([sys.executable, str(script), str(fresh)], check=True, capture_output=True)
    made, shipped = read_content(fresh), read_content(script.with_suffix(".msh"))
    assert list(made.volumes) == list(shipped.volumes)
    assert list(made.facets) == list(shipped.facets)
    assert fresh.stat().st_size < 2e6
    lengths = [np.ptp(content.points, axis=0) for content in (made, shipped)]
    np.testing.assert_allclose(*lengths, rtol=1e-3)
