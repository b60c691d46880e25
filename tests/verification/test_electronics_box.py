"""models/electronics_box: parts and joints, the run at its tolerance against a strict one, iterations as predicted."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from latin_fmu import load_scene
from latin_fmu.building import discretise
from latin_fmu.effects.cost import Prediction
from latin_fmu.mesh_files.reading import read_content
from tests.scenes import MODELS, solved

FOLDER = MODELS / "electronics_box"
SHORT = "time.end=1.5e-3"  # the pulse and two bends of the board after it
SCREWS = tuple(f"screw{i}" for i in range(1, 5))
pytestmark = pytest.mark.slow


def test_parts_and_joints_are_those_of_the_drawing() -> None:
    """Areas of faces by the circles that bound them, which are polygons of sixteen sides for the points."""
    ready = discretise(load_scene(FOLDER / "scene.toml"))
    assert len(ready.bodies) == 12
    assert Counter(unit.behaviour.name for unit in ready.units) == {"perfect": 9, "contact": 9}
    area = {unit.name: 1e6 * float(unit.geometry.areas.sum()) for unit in ready.units}
    rings = {"tray_board": 4 * np.pi * (4**2 - 1.7**2), "lid_standoff1": np.pi * (3.5**2 - 1.7**2)}
    rings |= {"board_standoff1": rings["lid_standoff1"], "lid_screw1": np.pi * (3**2 - 1.7**2)}
    rings |= {"board_component": 20.0 * 16.0, "tray_screw1": 2 * np.pi * 1.5 * 2.0}
    assert {name: area[name] for name in rings} == pytest.approx(rings, rel=0.03)
    assert [cut.area for cut in ready.cuts.values()] == pytest.approx([np.pi * 1.3e-3**2] * 4, rel=0.02)
    assert all(cut.table.tension == pytest.approx(1000.0) for cut in ready.cuts.values())


def test_bolt_forces_and_spectrum_at_the_tolerance_of_the_scene() -> None:
    """Against a tolerance of 1e-6: bolt forces to 0.5 %, the spectrum along the shock to 2 %; iterations within a
    factor of 1.5 of those that ``explain`` predicts."""
    runs = {t: solved("electronics_box/scene", SHORT, f"solver.tolerance={t}") for t in (1e-3, 1e-6)}
    for screw in SCREWS:
        loose, strict = (run.outcome.bolts[screw].force for run in runs.values())
        assert np.abs(loose / strict - 1.0).max() < 5e-3
    loose, strict = (run.spectra["component"].acceleration[0, :, 2] for run in runs.values())
    np.testing.assert_allclose(loose, strict, rtol=0.02)
    for tolerance, run in runs.items():
        ready = discretise(load_scene(FOLDER / "scene.toml", [SHORT, f"solver.tolerance={tolerance}"]))
        met = np.mean([window.iterations for window in run.outcome.windows])
        assert 1 / 1.5 < Prediction(ready).run.iterations / met < 1.5


def test_the_script_makes_the_mesh(tmp_path: Path) -> None:
    """Parts, faces and about the count of a fresh mesh are those of the shipped one."""
    pytest.importorskip("gmsh")
    script, fresh = FOLDER / "electronics_box.py", tmp_path / "fresh.msh"
    subprocess.run([sys.executable, str(script), "10", str(fresh)], check=True, capture_output=True)
    made, shipped = read_content(fresh), read_content(script.with_suffix(".msh"))
    assert list(made.volumes) == list(shipped.volumes)
    assert list(made.facets) == list(shipped.facets)
    assert len(made.solids["tetra10"]) == pytest.approx(len(shipped.solids["tetra10"]), rel=0.1)
    assert script.with_suffix(".msh").stat().st_size < 1e6
