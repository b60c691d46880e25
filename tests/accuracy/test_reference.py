"""Quantities declared with models: valid for their scene, equal to the oracles or to runs of another scheme within the
errors stated, dropped when physics change."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import pytest

import latin_fmu
from latin_fmu.accuracy.reference import FILE, declared, physics_of
from latin_fmu.accuracy.resolution import Resolution, at_resolution
from latin_fmu.accuracy.runs import measure_solution

from ..verification.known_answers import MODELS, beam_in_traction, bouncing_bar, impact_bar, shear_interface, shipped

REFINED = "two_specimen_crushing"
DECLARED = tuple(sorted(file.parent.name for file in MODELS.glob(f"*/{FILE}")))


def test_there_are_some() -> None:
    exact = ("beam_in_traction", "bouncing_bar", "impact_bar", "shear_interface")
    assert sorted(DECLARED) == sorted((*exact, "hammer_on_plate", REFINED))


@pytest.mark.parametrize("known", [beam_in_traction(), bouncing_bar(), impact_bar(), shear_interface()])
def test_declared_values_are_those_of_the_waves(known) -> None:
    reference = declared(shipped(known.name))
    assert reference is not None
    assert reference.exact
    for quantity, value in reference.quantities.values.items():
        assert value == pytest.approx(known.exact.values[quantity], rel=1e-9, abs=1e-12)
    for name, force in reference.quantities.forces.items():
        assert force.distance(known.exact.forces[name]) <= 1e-9 * force.norm()


@pytest.mark.parametrize("model", DECLARED)
def test_meshes_and_solvers_do_not_change_the_physics(model: str) -> None:
    scene = shipped(model)
    steps = "time.step=0.3e-6" if scene.time.step else "time.instants=77"
    overrides = [steps, "solver.tolerance=1e-5", "time.scheme=newmark", "output.energy=false"]
    other = latin_fmu.load_scene(MODELS / model / "scene.toml", overrides)
    assert physics_of(other) == physics_of(scene)
    finer = at_resolution(scene, Resolution(2.0, 1.0))
    assert physics_of(finer) == physics_of(scene)


@pytest.mark.parametrize(
    "change", ["material.bar.density=1.1", "substructure.bar.initial_velocity=[0.0, 0.0, -9.0]", "time.end=1.9"]
)
def test_other_physics_have_no_reference(change: str) -> None:
    assert declared(latin_fmu.load_scene(MODELS / "impact_bar/scene.toml", [change])) is None


def test_refined_runs_agree_with_another_scheme() -> None:
    """The reference of the crushing is from explicit runs; the implicit scheme of the scene, its own estimated error
    granted, gives the same numbers."""
    scene = at_resolution(shipped(REFINED), Resolution(4 / 3, 4 / 3))
    reference = declared(shipped(REFINED))
    assert reference is not None
    assert not reference.exact
    assert reference.own_error is not None
    solution = latin_fmu.solve(scene)
    measured = measure_solution(shipped(REFINED), solution)
    estimate = latin_fmu.estimate_error(scene, solution)
    assert {q.quantity for q in reference.own_error.quantities} == set(measured.values)
    for quantity in measured.values:
        granted = max(estimate[quantity].error, 1e-3) + reference.own_error[quantity].error
        assert measured.error(quantity, reference.quantities) <= granted, quantity
    sharp = {"impulse": 5e-4, "separation": 2e-3, "peak_force": 6e-3, "first_contact": 1e-2}
    for key, error in sharp.items():
        assert measured.error(f"crush.{key}", reference.quantities) <= error, key


@pytest.mark.parametrize("errors", [{}, {"wall.impulse": 0.0}, {"wall.impulse": "small"}])
def test_errors_of_a_reference_are_told_for_all_or_it_is_refused(errors: dict, tmp_path: Path) -> None:
    """One missing, one of zero, one that is no number."""
    scene = latin_fmu.scene_from_dict(tomllib.loads(shipped("impact_bar").text()), tmp_path)
    data = {
        "scene": "impact_bar",
        "source": "runs",
        "holds_for": physics_of(scene),
        "errors": errors,
        "values": {"wall.impulse": 200.0},
    }
    (tmp_path / FILE).write_text(json.dumps(data))
    with pytest.raises(latin_fmu.SceneError, match="not a usable reference"):
        declared(scene)
    (tmp_path / FILE).write_text(json.dumps(data | {"errors": {"wall.impulse": 0.02}}))
    reference = declared(scene)
    assert reference is not None
    assert reference.text == "refined runs: runs"
    assert reference.own_error is not None
    assert reference.own_error["wall.impulse"].error == 0.02


@pytest.mark.parametrize("text", ["{", "[]", '{"scene": "impact_bar"}', "\x00"])
def test_a_damaged_reference_is_an_error_not_a_crash(text: str, tmp_path) -> None:
    (tmp_path / FILE).write_text(text)
    scene = latin_fmu.scene_from_dict(tomllib.loads(shipped("impact_bar").text()), tmp_path)
    with pytest.raises(latin_fmu.SceneError, match="not a usable reference"):
        declared(scene)
