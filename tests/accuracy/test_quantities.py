"""Quantities of interest of a run, and those that a model declares as its reference."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import latin_fmu
from latin_fmu.accuracy.runs import Resolution, at_resolution
from latin_fmu.accuracy.study import FILE, declared, physics_of
from latin_fmu.latin.outcome import BoltHistory
from latin_fmu.parametric.point import QUANTITIES
from latin_fmu.results.interface_fields import Force
from latin_fmu.results.owner_records import BoltRecord
from latin_fmu.run_quantities import Quantities, measure, measure_solution, of_force
from latin_fmu.scene.quantity_table import BOLT, QUANTITIES_OF_INTEREST, RUN_SCALARS, values_of
from latin_fmu.scene.settings import Accuracy

from ..results import synthetic
from ..verification.known_answers import MODELS, beam_in_traction, bouncing_bar, impact_bar, shear_interface, shipped


# -- Quantities and distances against closed forms --------------------------------------------------------------------
def test_the_scene_accepts_all_quantities() -> None:
    for definition in QUANTITIES_OF_INTEREST:
        assert Accuracy(quantity=definition.key).quantity == definition.key


def test_a_scalar_of_a_study_is_that_of_derivatives_and_estimates() -> None:
    """One name has one meaning, and the largest and the last tension of a bolt are two."""
    shared = {q.name: q for q in QUANTITIES if q.name in RUN_SCALARS}
    assert {(q.unit, q.long_name) for q in shared.values()} == {
        (RUN_SCALARS[name].unit, RUN_SCALARS[name].long_name) for name in shared
    }
    assert {"displacement_peak", "acceleration_peak_unfiltered", "largest_slip", "peak_force"} <= shared.keys()
    # behind a filter in the estimate: not the values of a study
    assert not {"velocity_peak", "acceleration_peak", "bolt_force"} & shared.keys()
    force = np.array([4e3, 5e3, 3e3])
    bolt = BoltHistory("m6", "bolt", 1, None, 1e-5, 1e-5, force, (1,), (4e3,))
    time, measured = np.array([0.0, 1.0, 2.0]), Quantities()
    for use in ("derivatives", "study"):
        values = values_of(use, BOLT, BoltRecord.of(bolt, time))  # type: ignore[arg-type]
        assert values == {"largest_bolt_force": 5e3, "last_bolt_force": 3e3}
        assert values.keys() <= shared.keys()
    measured.add_record(BOLT, "m6", BoltRecord.of(bolt, time, 2.0))
    assert measured.values == {"m6.largest_bolt_force": 5e3}


def test_distance_of_a_rectangle_and_a_ramp() -> None:
    """Rectangle 1 on [1, 2] against 0: sqrt(1); against the ramp t on [0, 2]: int_0^1 t^2 + int_1^2 (1 - t)^2."""
    rectangle = Force(np.array([0.0, 1.0, 1.0, 2.0, 2.0, 3.0]), np.array([0.0, 0.0, 1.0, 1.0, 0.0, 0.0]))
    ramp = Force(np.array([0.0, 2.0]), np.array([0.0, 2.0]))
    assert rectangle.norm() == pytest.approx(1.0)
    assert ramp.norm() == pytest.approx(np.sqrt(8 / 3))
    assert rectangle.distance(ramp) == pytest.approx(np.sqrt(2 / 3))
    assert ramp.distance(rectangle) == pytest.approx(np.sqrt(2 / 3))
    assert rectangle.distance(rectangle) == 0.0
    one, three = (Force(np.array([0.0, 2.0]), np.array([level, level])) for level in (1.0, 3.0))
    assert one.distance(three) == pytest.approx(np.sqrt(8.0))


def test_quantities_of_a_triangle() -> None:
    """0 at 1, 4 at 2, 0 at 3: impulse 4, level 0.04 met at 1.01; at 2.806 the mean over the next 0.198, 4 (3 - t)^2 /
    0.396, is a tenth of the peak force."""
    triangle = Force(np.array([0.0, 1.0, 2.0, 3.0, 4.0]), np.array([0.0, 0.0, 4.0, 0.0, 0.0]))
    entries = of_force(triangle, 4.0, opens=True)
    assert entries["impulse"] == pytest.approx((4.0, 4.0))
    assert entries["first_contact"][0] == pytest.approx(1.01)
    level = 0.1 * 4.0 * (1.0 - 0.198 / 4.0)
    assert entries["separation"][0] == pytest.approx(3.0 - np.sqrt(level * 2.0 * 0.198 / 4.0), rel=1e-6)
    assert entries["peak_force_raw"][0] == 4.0
    # above 0.04 for 1.98: the mean over 0.198 around the top loses a quarter of the fall of 4 on 1 that it covers
    assert entries["peak_force"][0] == pytest.approx(4.0 * (1.0 - 0.198 / 4.0))
    assert of_force(triangle, 4.0, opens=True, duration=2.0)["peak_force"][0] == pytest.approx(2.0)


def test_a_contact_never_met_is_met_at_the_end() -> None:
    quiet = Force(np.array([0.0, 1.0, 2.0]), np.array([0.0, 1e-20, 0.0]))
    entries = of_force(quiet, 2.0, opens=True, nothing=1e-9)
    assert entries["first_contact"][0] == entries["separation"][0] == 2.0


def test_sides_that_fly_meet_between_two_instants() -> None:
    """Gap 0.5 closing at 2: met at 0.25, although the first loaded instant is 0.4."""
    time = np.array([0.0, 0.2, 0.4, 0.6])
    force = np.array([0.0, 0.0, 3.0, 3.0])
    traction = np.zeros((4, 1, 3))
    traction[:, 0, 2] = -force
    velocity = np.zeros((4, 2, 1, 3))
    velocity[:2, 1, 0, 2] = -2.0
    history = SimpleNamespace(
        name="meet",
        sides=("low.zmax", "high.zmin"),
        areas=np.ones(1),
        normals=np.array([[0.0, 0.0, 1.0]]),
        traction=traction,
        velocity=velocity,
        gap=np.array([[0.5], [0.1], [0.0], [0.0]]),
        contact_status=np.zeros((4, 1), dtype=np.int8),
        friction_power=None,
        friction_coefficient=0.0,
        peak_duration=None,
        normal_resultant=lambda: force,
    )
    quantities = measure(time, {"meet": history}, 0.6)  # type: ignore[dict-item]
    assert quantities.values["meet.first_contact"] == pytest.approx(0.25)


def test_what_comes_after_the_end_is_cut_off() -> None:
    outcome = synthetic.bars(converged=True)
    whole = measure(outcome.time, outcome.interfaces, float(outcome.time[-1]))
    middle = float(outcome.time[len(outcome.time) // 2])
    part = measure(outcome.time, outcome.interfaces, middle)
    name = next(q for q in whole.values if q.endswith(".impulse"))
    history = outcome.interfaces[name.split(".")[0]]
    inside = outcome.time <= middle
    expected = np.trapezoid(history.normal_resultant()[inside], outcome.time[inside])
    assert part.values[name] == pytest.approx(expected)
    assert all(force.time[-1] == middle for force in part.forces.values())


# -- Quantities declared with models: valid for their scene, equal to the oracles or to runs of another scheme within t
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
    "change",
    [
        "material.bar.density=1.1",
        "substructure.bar.initial_velocity=[0.0, 0.0, -9.0]",
        "time.end=1.9",
        "gravity.acceleration=[0.0, 0.0, -9.0]",
        "time.start=static",
    ],
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
