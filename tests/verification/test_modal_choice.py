"""The program's own choice between the march by modes and that of the bodies, and the error that it tells."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from latin_fmu import scene_from_dict
from latin_fmu.api import solve
from latin_fmu.assembly.build import discretise
from latin_fmu.effects import modal_choice
from latin_fmu.effects.modal_choice import tries_modes
from latin_fmu.results.checkpoint import Checkpoint
from latin_fmu.results.estimates import TruncationError
from latin_fmu.run_quantities import measure_solution
from tests.verification.test_modal_march import damped_by_ratios, lap


def joint(**solver: Any) -> dict[str, Any]:
    """A lap joint with a spectrum, its steps longer than waves take through an element."""
    scene = damped_by_ratios(lap())
    scene["sensor"]["tip"]["spectrum"] = {"lowest": 500.0, "highest": 8000.0, "per_octave": 3}
    scene["solver"] |= solver
    return scene


@pytest.fixture(autouse=True)
def always_pays(monkeypatch: pytest.MonkeyPatch) -> None:
    """Scenes are small here."""
    monkeypatch.setattr(modal_choice, "PAYS", 0.0)


def test_modes_are_taken_with_an_error_that_is_not_exceeded() -> None:
    """Against the bodies in steps a quarter as long: none of the quantities is further off than what is told."""
    scene = scene_from_dict(joint(reduction_error=0.1))
    solution = solve(scene)
    assert solution.converged
    assert solution.truncation is not None
    assert "modes of the assembly" in solution.outcome.settings["propagator"]
    name, told = solution.truncation.largest
    assert 0.0 < told <= 0.1
    assert name in solution.summary()
    reference = measure_solution(scene, solve(scene.replace("solver.propagator", "direct").replace("time.step", 5e-7)))
    found = measure_solution(scene, solution)
    for quantity in solution.truncation.errors:
        assert found.error(quantity, reference) <= told, quantity


def test_a_larger_error_than_allowed_takes_the_bodies() -> None:
    """To the bits of the direct propagator, and the remark has the error and the price."""
    scene = scene_from_dict(joint(reduction_error=1e-5))
    solution = solve(scene)
    assert solution.truncation is None
    (remark,) = (text for text in solution.warnings if "march by modes was tried" in text)
    assert "above solver.reduction_error (0.001 %)" in remark
    assert "s of CPU" in remark
    bodies = solve(scene.replace("solver.propagator", "direct"))
    assert np.array_equal(bodies.interfaces["lap"].traction, solution.interfaces["lap"].traction)


@pytest.mark.parametrize(
    ("change", "value"),
    [
        ("time.step", 2e-7),  # waves are followed through the elements
        ("time.scheme", "hht"),
        ("solver.propagator", "direct"),
        ("solver.window", 5),
        ("interface.lap.behaviour", "perfect"),  # nothing slides
    ],
)
def test_scenes_that_are_not_tried(change: str, value: Any) -> None:
    """One change each to a scene that is."""
    scene = scene_from_dict(joint())
    assert tries_modes(discretise(scene))
    if value == "perfect":
        tables = copy.deepcopy(joint())
        tables["interface"]["lap"] = {"sides": tables["interface"]["lap"]["sides"], "behaviour": "perfect"}
        changed = scene_from_dict(tables)
    else:
        changed = scene.replace(change, value)
    assert not tries_modes(discretise(changed))


def test_small_scenes_are_not_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(modal_choice, "PAYS", 1e6)
    assert solve(scene_from_dict(joint(reduction_error=0.5))).truncation is None


@pytest.mark.parametrize("allowed", [0.1, 1e-5])
def test_an_interrupted_run_goes_on_as_it_was(tmp_path: Path, allowed: float) -> None:
    """By modes, or by the bodies after a try that failed: to the bits of a run that is not interrupted."""
    scene, looks = scene_from_dict(joint(reduction_error=allowed)), list[None]()

    def look(last: float) -> bool:
        looks.append(None)
        return len(looks) > last

    whole = solve(scene, checkpoint=Checkpoint(tmp_path / "whole", every=10, stop=lambda: look(np.inf)))
    # of a try and a run of the bodies the second has the last quarter
    last, _ = 0.8 * len(looks), looks.clear()
    first = solve(scene, checkpoint=Checkpoint(tmp_path / "run", every=10, stop=lambda: look(last)))
    assert first.interrupted
    assert first.truncation is None
    resumed = solve(scene, checkpoint=Checkpoint(tmp_path / "run", resume=True, log=lambda _: None))
    assert (resumed.truncation is None) == (whole.truncation is None)
    assert np.array_equal(whole.interfaces["lap"].traction, resumed.interfaces["lap"].traction)


def test_what_cannot_be_told_is_not_small() -> None:
    """A quantity that the second march does not have."""
    assert TruncationError({"a.spectrum": np.nan, "a.impulse": 1e-9}, None).largest == ("a.spectrum", np.inf)  # type: ignore[arg-type]
    assert "not known" in TruncationError({"a.spectrum": np.nan}, None).in_words()  # type: ignore[arg-type]
