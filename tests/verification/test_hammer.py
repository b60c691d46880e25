"""models/hammer_on_plate: the numbers of its README, on the shipped mesh."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from latin_fmu import api, load_scene
from latin_fmu.accuracy.study import declared
from latin_fmu.results.interface_fields import Force
from latin_fmu.run_quantities import of_force

from .known_answers import MODELS

SETTINGS = ["accuracy.estimate=false", "output.fields=true", "output.every=240"]


@pytest.fixture(scope="module")
def run() -> tuple[Any, Any]:
    scene = load_scene(MODELS / "hammer_on_plate" / "scene.toml", SETTINGS)
    return scene, api.solve(scene)


def test_impulse_is_the_momentum_that_the_hammer_loses(run: tuple[Any, Any]) -> None:
    """The mean velocity of the hammer by its nodes (their masses are not equal: 1 %), the impulse by the interface."""
    _, solution = run
    tree = solution.to_datatree()
    impulse = tree["interfaces/blow"]["impulse"].values[-1]
    hammer = tree["substructures/hammer"].to_dataset().isel(time=-1)
    height = hammer["node_z"].values
    ends = [hammer["velocity"].values[height == z, 2].mean() for z in np.unique(height)]
    weights = np.ones(len(ends))
    weights[[0, -1]] = 0.5  # layers of nodes carry the mass of the elements beside them
    velocity = float(np.average(ends, weights=weights))
    mass = 7800.0 * 0.02 * 0.02 * 0.05
    assert impulse[2] == pytest.approx(-mass * (2.0 + velocity), rel=1e-2)  # on side E, the plate
    assert np.abs(impulse[:2]).max() < 1e-9 * abs(impulse[2])
    assert impulse[2] < -mass * 2.0


def test_quantities_agree_with_the_refined_runs(run: tuple[Any, Any]) -> None:
    """Limits: the declared errors and what the shipped mesh may add."""
    scene, solution = run
    reference = declared(scene)
    assert reference is not None
    assert not reference.exact
    blow = solution.to_datatree()["interfaces/blow"]
    force = Force(blow["time"].values, -blow["force"].sel(component="z").values)
    quantities = {key: value for key, (value, _) in of_force(force, scene.time.end, opens=True).items()}
    known = {key.split(".")[1]: value for key, value in reference.quantities.values.items()}
    assert quantities["impulse"] == pytest.approx(known["impulse"], rel=0.01)
    assert quantities["first_contact"] == pytest.approx(1e-5, rel=0.002)
    assert quantities["separation"] == pytest.approx(known["separation"], rel=0.06)
    assert quantities["peak_force_raw"] == pytest.approx(known["peak_force_raw"], rel=0.1)
    work = float(np.trapezoid(blow["friction_power"].values, blow["time"].values))
    assert work == pytest.approx(known["friction_work"], rel=0.05)


def test_non_matching_faces_keep_the_energy_balance(run: tuple[Any, Any]) -> None:
    _, solution = run
    energy = solution.to_datatree()["energy"].to_dataset().isel(time=-1)
    terms = {str(k): float(v) for k, v in energy.data_vars.items()}
    assert terms["kinetic"] + terms["elastic"] < 0.312
    assert terms["friction_dissipation"] > 0
