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
        "4 interface(s)",
        "body washer: 0.012 x 0.012 x 0.0016 m",
        "366 hexahedron, 4 wedge",
    ):
        assert words in lines
    assert all(f"interface {name}" in lines for name in AXIAL)


def test_forces_are_those_of_equilibrium(pulled: xr.DataTree) -> None:
    """5 kN through every interface once the bolt is tight, the pull through the plates alone (tolerance 1e-5)."""
    for name, sign in AXIAL.items():
        force = pulled[f"interfaces/{name}"]["force"].values
        np.testing.assert_allclose(force[5:, 2], 5000.0 * sign, rtol=1e-4)
        np.testing.assert_allclose(force[1:6, 2], 1000.0 * sign * np.arange(1, 6), rtol=1e-4)
        pull = 120.0 * np.arange(6) if name == "lower_upper" else np.zeros(6)
        np.testing.assert_allclose(force[5:, 0], -pull, atol=0.5)
        np.testing.assert_allclose(force[5:, 1], 0.0, atol=0.5)


def test_pressure_between_the_plates_is_a_cone(pulled: xr.DataTree) -> None:
    plates = pulled["interfaces/lower_upper"].to_dataset().isel(time=5)
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
    assert force[0, 2] == pytest.approx(-5000.0, rel=1e-3)  # the static start
    jump = plates["velocity"].values[:, 1, :, 0] - plates["velocity"].values[:, 0, :, 0]
    slip = np.trapezoid(jump, time, axis=0)
    assert slip.mean() == pytest.approx(-0.12e-3, rel=0.05)  # the shipped mesh and step; towards -x
    energy = {str(k): float(v.values[-1]) for k, v in tree["energy"].to_dataset().items()}
    assert energy["friction_dissipation"] == pytest.approx(0.122, rel=0.03)
    assert energy["friction_dissipation"] < energy["work_of_loads"]


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
