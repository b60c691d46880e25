"""Quantities and distances against closed forms."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from latin_fmu.accuracy.quantities import measure, of_force
from latin_fmu.results.quantities_of_interest import QUANTITIES_OF_INTEREST, Force
from latin_fmu.scene.settings import QUANTITY_KEYS

from ..results import synthetic


def test_the_scene_accepts_all_quantities() -> None:
    assert tuple(definition.key for definition in QUANTITIES_OF_INTEREST) == QUANTITY_KEYS


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
    """0 at 1, 4 at 2, 0 at 3: impulse 4, level 0.04 met at 1.01 and left at 2.99."""
    triangle = Force(np.array([0.0, 1.0, 2.0, 3.0, 4.0]), np.array([0.0, 0.0, 4.0, 0.0, 0.0]))
    entries = of_force(triangle, 4.0, opens=True)
    assert entries["impulse"] == pytest.approx((4.0, 4.0))
    assert entries["first_contact"][0] == pytest.approx(1.01)
    assert entries["separation"][0] == pytest.approx(2.99)
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
