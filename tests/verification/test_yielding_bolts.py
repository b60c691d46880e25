"""Bolts whose shanks yield: the bilinear law in closed form, overloaded and unloaded, in statics and in motion."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from latin_fmu import scene_from_dict, solve
from latin_fmu.api import check
from latin_fmu.assembly import yielding_bolts
from latin_fmu.assembly.yielding_bolts import TensionLoss
from latin_fmu.cosim import Session, Settings
from latin_fmu.errors import SceneError
from latin_fmu.stability.scenes import Box, Material, column

from .bolted_meshes import write_joint
from .test_bolts import joint

E, AREA, LENGTH, YIELD = 200e9, 1e-4, 0.05, 400e6
STIFF, LIMIT = E * AREA / LENGTH, YIELD * AREA
STEEL = Material(E, 7800.0, 0.0, "steel")
LAW = {"type": "table", "times": [0.0, 1.0, 2.0, 3.0], "values": [0.0, 1.0, -1.2, 0.6]}


def bar(hardening: float, reach: float = 250e-6, **keys: Any) -> dict[str, Any]:
    """A bar with one bolt of 10 kN; its upper end is moved up, down and up again."""
    data = column(
        {"bar": Box(STEEL, (0.01, 0.01, LENGTH), (1, 1, 5))},
        {},
        {"end": 3.0, "instants": 60, "quasi_static": True},
        boundary={
            "low": {"type": "fixed", "face": "bar.zmin"},
            "top": {"type": "displacement", "face": "bar.zmax", "components": ["z"], "value": [reach], "law": LAW},
        },
        bolt={"b": {"substructure": "bar", "axis": [0, 0, 1], "shortening": 10e3 / STIFF, "hardening": hardening}},
        output={"stress": True},
    )
    data["material"]["steel"]["yield_stress"] = YIELD
    return data | keys


def bilinear(travel: np.ndarray, hardening: float) -> tuple[np.ndarray, np.ndarray]:
    """Tension and plastic elongation of a bar that is strained along a path, step by step: elastic to the yield force
    beyond the back stress, then with the slope k H / (k + H)."""
    force, plastic, q = [], [], 0.0
    for x in travel:
        trial = STIFF * (x - q) + 10e3
        if (over := abs(trial - hardening * q) - LIMIT) > 0.0:
            q += np.sign(trial - hardening * q) * over / (STIFF + hardening)
        force.append(STIFF * (x - q) + 10e3)
        plastic.append(q)
    return np.array(force), np.array(plastic)


@pytest.mark.parametrize("hardening", [0.0, 0.05 * STIFF, STIFF])
def test_overloaded_and_unloaded_in_closed_form(hardening: float) -> None:
    """Tension, plastic elongation and the stress of all elements; corners of the curve by hand."""
    solution = solve(scene_from_dict(bar(hardening)))
    assert solution.converged
    bolt = solution.bolts["b"]
    travel = 250e-6 * np.interp(solution.time, LAW["times"], LAW["values"])  # type: ignore[arg-type]
    force, plastic = bilinear(travel, hardening)
    assert np.abs(bolt.force - force).max() < 1e-6 * LIMIT
    assert bolt.plastic_elongation is not None
    assert np.abs(bolt.plastic_elongation - plastic).max() < 1e-6 * LIMIT / STIFF
    at_top, tangent = 20, STIFF * hardening / (STIFF + hardening)
    yields = (LIMIT - 10e3) / STIFF
    assert bolt.force[at_top] == pytest.approx(LIMIT + tangent * (250e-6 - yields), rel=1e-6)
    assert bolt.force[21] == pytest.approx(bolt.force[20] - STIFF * 0.11 * 250e-6, rel=1e-6)  # unloading is elastic
    stress = solution.substructures["bar"].stress
    assert stress is not None
    np.testing.assert_allclose(stress[..., 2], np.tile(force[:, None] / AREA, stress.shape[1]), atol=1e-6 * YIELD)
    assert "b by" in solution.outcome.settings["bolts that yield"]
    assert not [str(w) for w in solution.warnings if "exceeds its yield stress" in str(w)]  # it yields in the model


def test_a_bolt_below_its_yield_force_runs_once() -> None:
    """The same bits as without hardening."""
    data = bar(0.1 * STIFF, reach=50e-6)
    yields, elastic = solve(scene_from_dict(data)), bar(0.0, reach=50e-6)
    elastic["bolt"]["b"].pop("hardening")
    assert "bolts that yield" not in yields.outcome.settings
    assert (yields.bolts["b"].force == solve(scene_from_dict(elastic)).bolts["b"].force).all()


def test_a_bolt_yields_over_the_stress_area_of_its_thread() -> None:
    """400 MPa over the 84.3 mm2 of M12 are 33.7 kN, less than the 40 kN over the mesh."""
    data = bar(0.0)
    data["bolt"]["b"]["thread"] = "M12"
    solution = solve(scene_from_dict(data))
    assert solution.bolts["b"].force.max() == pytest.approx(YIELD * 84.3e-6, rel=1e-3)


def test_law_of_a_history() -> None:
    """Play between F_y and -F_y about H q, whatever the steps."""
    trial = np.array([0.0, 5.0, 12.0, 8.0, -8.0, -20.0, 0.0])
    q = TensionLoss(np.full(7, 3.0), np.zeros(0)).elongation(trial, 10.0, 1.0)
    np.testing.assert_allclose(q, [0.0, 0.0, 0.5, 0.5, 0.5, -2.5, -2.5])
    late = TensionLoss(np.full(7, 3.0), np.array([0.5, 0.25]))
    q = late.elongation(trial, 10.0, 1.0)
    force = trial - late.of(q)
    assert np.abs(force - q).max() < 10.0 + 1e-12
    np.testing.assert_allclose(np.abs(force - q)[np.flatnonzero(np.diff(q)) + 1], 10.0, rtol=1e-12)


def pulled(files: dict[str, Path], **keys: Any) -> dict[str, Any]:
    """The plates of a tight joint pulled apart by 13 kN and let go."""
    data = joint(files, pull=13e3)
    data["load"]["pull"]["law"] = {"type": "table", "times": [0.0, 0.5, 1.0], "values": [0.0, 1.0, 0.0]}
    data["material"]["steel"]["yield_stress"] = 250e6
    data["bolt"]["b"]["hardening"] = 200e6
    return data | keys


def test_an_overloaded_joint_loses_clamp_force(tmp_path: Path) -> None:
    """Contacts that open: F = F_y + H q at the largest load, the clamp force is lost by the slope of the joint, and the
    bolt carries what the plates do not."""
    files = write_joint(tmp_path)
    time = {"end": 1.0, "instants": 20, "quasi_static": True}
    solution = solve(scene_from_dict(pulled(files, time=time)))
    assert solution.converged
    bolt = solution.bolts["b"]
    assert bolt.plastic_elongation is not None
    limit, q = 250e6 * bolt.area, bolt.plastic_elongation
    assert q[10] > 1e-6
    assert bolt.force[10] == pytest.approx(limit + 200e6 * q[10], rel=1e-5)
    assert (np.diff(q) >= -1e-12).all()
    np.testing.assert_allclose(q[10:], q[10], rtol=1e-9)
    assert 0.2 * bolt.force[0] < bolt.force[-1] < 0.8 * bolt.force[0]
    clamp = solution.interfaces["head"].normal_resultant()
    np.testing.assert_allclose(clamp[1:], bolt.force[1:], rtol=2e-4)
    assert solution.trustworthy


def test_elongations_that_still_change_are_not_trusted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With two runs where more are needed; the status has the number."""
    monkeypatch.setattr(yielding_bolts, "_RUNS", 2)
    time = {"end": 1.0, "instants": 20, "quasi_static": True}
    solution = solve(scene_from_dict(pulled(write_joint(tmp_path), time=time)))
    assert not solution.trustworthy
    assert "not trustworthy: plastic elongations of bolts change" in solution.status


@pytest.mark.slow
def test_a_pulse_overloads_a_bolt(tmp_path: Path) -> None:
    """In motion: the tension never leaves the bounds F_y + H q, and is there where q grows; the energies balance."""
    files = write_joint(tmp_path)
    data = pulled(files, time={"end": 4e-4, "instants": 200}, output={"energy": True})
    data["load"]["pull"]["law"] = {"type": "half_sine", "duration": 2e-4}
    data["load"]["pull"]["traction"] = [0.0, 0.0, 5e7]
    solution = solve(scene_from_dict(data))
    assert solution.converged
    bolt = solution.bolts["b"]
    assert bolt.plastic_elongation is not None
    limit, q = 250e6 * bolt.area, bolt.plastic_elongation
    within = np.abs(bolt.force - 200e6 * q) / limit
    grows = np.flatnonzero(np.diff(q) > 0) + 1
    assert len(grows) > 3
    assert within.max() < 1 + 1e-3
    np.testing.assert_allclose(within[grows], 1.0, atol=1e-3)
    assert solution.energy is not None
    assert np.abs(solution.energy["balance"]).max() < 1e-3 * np.abs(solution.energy["work_of_loads"]).max()


def test_refused(tmp_path: Path) -> None:
    """Without the stress at which it yields, with fields that do not follow, in steps of a session."""
    data = bar(1e6)
    del data["material"]["steel"]["yield_stress"]
    with pytest.raises(SceneError, match=r"material.steel.yield_stress: .*\[Pa\]"):
        check(scene_from_dict(data))
    with pytest.raises(SceneError, match=r"output.nodal_stress: .*do not follow the plastic elongation"):
        check(scene_from_dict(bar(1e6, output={"nodal_stress": True})))
    with pytest.raises(SceneError, match=r"bolt.b.hardening: .*repeated runs"):
        Session(scene_from_dict(bar(1e6)), Settings()).initialize()
    files = write_joint(tmp_path)
    data = pulled(files, time={"end": 1e-5, "instants": 4})
    data["load"]["pull"]["law"] = "constant"
    with pytest.raises(SceneError, match=r"bolt.b: the shank yields in the static start"):
        solve(scene_from_dict(data))
