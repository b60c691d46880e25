"""Many runs of an assembly on one set-up: what the march by modes takes from the run before changes no result."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from latin_fmu import scene_from_dict
from latin_fmu.api import solve
from latin_fmu.assembly.models import KeptOperators
from latin_fmu.effects import cost, modal_choice
from latin_fmu.joined import reduced_assembly
from latin_fmu.parametric.point import CONVERGED, Grid, Parameter, Plan, PointSolver, quantities_of
from latin_fmu.results.solution import Solution
from latin_fmu.stability.scenes import STEEL, Box, column
from tests.verification.test_modal_march import CLAMP, PLATE, SHAKE, TIP, damped_by_ratios

RECOVERED = 2e-3  # of a resultant of a bond: what the shapes leave out, which a run alone takes


def stacked(held: dict[str, Any] = CLAMP, **solver: Any) -> dict[str, Any]:
    """Two plates with friction and a third one bonded on top, pressed and hit at its tip."""
    plate = Box(STEEL, PLATE, (8, 3, 2))
    scene = column(
        {"low": plate, "up": plate, "top": plate},
        {"lap": {"friction_coefficient": 0.3}, "glue": {"behaviour": "perfect"}},
        {"end": 3e-4, "step": 2e-6, "start": "static"},
        boundary={"clamp": held},
        load={"press": {"face": "top.zmax", "pressure": 1e6, "law": "constant"}, "tip": TIP},
        sensor={"tip": {"face": "up.xmax"}},
        solver={"tolerance": 1e-5, "reduction_error": 0.9} | solver,
        output={"reactions": True},
    )
    return damped_by_ratios(scene)


@pytest.fixture(autouse=True)
def always_pays(monkeypatch: pytest.MonkeyPatch) -> None:
    """Scenes are small here."""
    monkeypatch.setattr(cost, "PAYS", 0.0)


@pytest.fixture
def bases(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Number of modes each time that these are looked for."""
    found = []
    lowest: Callable[..., Any] = reduced_assembly.lowest

    def counted(*args: Any) -> Any:
        modes = lowest(*args)
        found.append(len(modes[1]))
        return modes

    monkeypatch.setattr(reduced_assembly, "lowest", counted)
    return found


def assert_same(first: Solution, second: Solution) -> None:
    """To the bits."""
    assert first.converged
    assert second.converged
    for name in ("lap", "glue"):
        assert np.array_equal(first.interfaces[name].traction, second.interfaces[name].traction)
    assert np.array_equal(first.sensors["tip"].velocity, second.sensors["tip"].velocity)
    assert np.array_equal(first.reactions["clamp"].force, second.reactions["clamp"].force)


CHANGES: dict[str, Any] = {
    "interface.lap.friction_coefficient": 0.2,
    "interface.lap.gap": 1e-6,
    "load.press.pressure": 1.3e6,
    "load.tip.force": [0.0, 0.0, 300.0],
    "material.steel.damping_ratios": {"frequencies": [1e3, 5e4], "ratios": [0.02, 0.02]},
    "material.steel.density": 7000.0,
    "material.steel.young_modulus": 1.5e11,
}
OF_MODES = ["material.steel.density", "material.steel.young_modulus"]


@pytest.mark.slow
def test_a_run_on_the_set_up_of_another(bases: list[int]) -> None:
    """One change after the other, against runs that start from nothing: modes are looked for where they change."""
    scene = scene_from_dict(stacked())
    kept, counts = KeptOperators(), {}
    solve(scene, kept=kept)
    for key, value in CHANGES.items():
        changed = scene.replace(key, value)
        fresh = solve(changed)
        del bases[:]
        assert_same(fresh, solve(changed, kept=kept))
        counts[key] = len(bases)
    assert [key for key, count in counts.items() if count] == OF_MODES


def test_the_error_is_estimated_once(monkeypatch: pytest.MonkeyPatch) -> None:
    estimates = []
    estimate = modal_choice.truncation_of
    monkeypatch.setattr(modal_choice, "truncation_of", lambda *args: estimates.append(1) or estimate(*args))
    scene, kept = scene_from_dict(stacked()), KeptOperators()
    solutions = [solve(scene.replace("interface.lap.friction_coefficient", c), kept=kept) for c in (0.3, 0.2, 0.4)]
    assert len(estimates) == 1
    assert len({s.outcome.settings["error of the modes"] for s in solutions}) == 1


def test_all_runs_are_marched_by_bodies_where_the_first_is_refused(bases: list[int]) -> None:
    """With the reason of the first run, and without another try."""
    scene, kept = scene_from_dict(stacked(reduction_error=1e-6)), KeptOperators()
    for coefficient in (0.3, 0.2):
        solution = solve(scene.replace("interface.lap.friction_coefficient", coefficient), kept=kept)
        assert solution.truncation is None
        assert any("march by modes was tried" in text for text in solution.warnings)
    assert len(bases) == 1


def test_points_of_a_study_are_marched_by_modes(bases: list[int]) -> None:
    """As runs of their scenes are, on one set-up."""
    tables = stacked()
    grid = Grid(copy.deepcopy(tables), ".", (Parameter("interface.lap.friction_coefficient", (0.3, 0.2)),))
    solver = PointSolver(Plan(grid))
    records = [solver.solve((i,)) for i in range(2)]
    assert len(bases) == 1
    for i, record in enumerate(records):
        scene = grid.scene((i,))
        alone = quantities_of(scene, solve(scene))
        assert record["state"] == CONVERGED
        owned = {quantity: values for quantity, values in alone.items() if isinstance(values, dict)}
        assert set(owned["impulse"]) == {"lap", "glue"}
        for quantity, values in owned.items():
            assert record[quantity] == pytest.approx(values, rel=RECOVERED), quantity


@pytest.mark.parametrize("held", [CLAMP, SHAKE], ids=["clamped", "driven"])
def test_series_leave_nothing_out(held: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """Sensors and reactions do not depend on what shapes of relative motions leave out, and the resultant of a bond is
    that of its tractions where these leave out nothing."""
    scene = scene_from_dict(stacked(held))
    runs = []
    for left_out in (1e-9, 0.3):
        monkeypatch.setattr(reduced_assembly, "_EXACT", left_out)
        runs.append(solve(scene))
    exact, crude = runs
    assert np.array_equal(exact.sensors["tip"].acceleration, crude.sensors["tip"].acceleration)
    assert np.array_equal(exact.reactions["clamp"].force, crude.reactions["clamp"].force)
    resultant = exact.interfaces["glue"].normal_resultant()
    size = np.abs(resultant).max()
    assert np.abs(crude.interfaces["glue"].normal_resultant() - resultant).max() > 1e-2 * size
    alone = solve(scene, kept=KeptOperators(resultants_alone=True))
    assert "glue" not in alone.interfaces
    assert np.abs(alone.outcome.bond_resultants["glue"] - resultant).max() < 1e-6 * size
    assert np.array_equal(alone.interfaces["lap"].traction, exact.interfaces["lap"].traction)


def test_a_reaction_beside_a_bond_is_that_of_a_run_alone() -> None:
    """The held face shares nodes with a bond, whose tractions a study does not read."""
    tables = stacked(propagator={"type": "modal"})
    lap, glue = tables["interface"]["lap"], tables["interface"]["glue"]
    lap["sides"], glue["sides"] = glue["sides"], lap["sides"]
    scene = scene_from_dict(tables)
    alone, study = solve(scene), solve(scene, kept=KeptOperators(resultants_alone=True))
    force = alone.reactions["clamp"].force
    assert np.abs(study.reactions["clamp"].force - force).max() < RECOVERED * np.abs(force).max()
