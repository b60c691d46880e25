"""Measures against numbers known by construction of the histories."""

from __future__ import annotations

import numpy as np
import pytest

from latin_fmu.results import quantities_of_interest as measures
from latin_fmu.results.dataset import interface_group
from latin_fmu.results.quantities_of_interest import InterfaceFields

from . import synthetic

TIME = np.linspace(0.0, 10.0, 1001)


def fields(**changes: object) -> InterfaceFields:
    """One point of area 2 with normal z, pressed by a triangle of height 6 N between t = 2 and t = 6."""
    pressure = 3.0 * np.clip(1.0 - np.abs(TIME - 4.0) / 2.0, 0.0, None)
    traction = np.stack([np.zeros_like(TIME), 0.5 * pressure, -pressure], axis=1)[:, None, :]
    status = (pressure > 0).astype(np.int8)[:, None]
    values = {"time": TIME, "areas": np.array([2.0]), "normals": np.array([[0.0, 0.0, 1.0]])}
    return InterfaceFields(**{**values, "traction": traction, "contact_status": status} | changes)


def test_triangle_has_its_peak_and_its_ends_at_one_per_cent() -> None:
    item = fields()
    assert measures.peak_force(item) == pytest.approx(6.0)
    # 1 % of the peak is passed 0.02 after the start of the triangle and 0.02 before its end.
    assert measures.first_contact_time(item) == pytest.approx(2.02, abs=0.011)
    assert measures.separation_time(item) == pytest.approx(5.98, abs=0.011)
    assert measures.friction_resultant(item).max() == pytest.approx(3.0)
    assert measures.friction_sum(item).max() == pytest.approx(3.0)


def test_opposite_frictions_cancel_in_the_resultant_only() -> None:
    one = fields()
    traction = np.concatenate([one.traction, one.traction * [1.0, -1.0, 1.0]], axis=1)
    both = fields(traction=traction, areas=np.array([2.0, 2.0]), normals=np.tile([0.0, 0.0, 1.0], (2, 1)))
    assert measures.friction_resultant(both).max() == pytest.approx(0.0, abs=1e-12)
    assert measures.friction_sum(both).max() == pytest.approx(6.0)


def test_never_in_contact() -> None:
    silent = fields(traction=np.zeros((TIME.size, 1, 3)))
    assert measures.first_contact_time(silent) is None
    assert measures.separation_time(silent) is None
    assert measures.peak_force(silent) == 0.0


def test_round_off_under_pure_shear_is_no_contact() -> None:
    traction = np.zeros((TIME.size, 1, 3))
    traction[:, 0, 0] = 1e8
    traction[::7, 0, 2] = -1e-9
    assert measures.first_contact_time(fields(traction=traction)) is None


def test_tension_of_a_joint_counts_as_load() -> None:
    pulled = fields()
    pulled = fields(traction=-pulled.traction)
    assert measures.peak_force(pulled) == pytest.approx(6.0)
    assert measures.first_contact_time(pulled) == measures.first_contact_time(fields())


def test_still_closed_at_the_end_separates_at_the_last_instant() -> None:
    item = fields(traction=np.tile([[[0.0, 0.0, -1.0]]], (TIME.size, 1, 1)))
    assert measures.first_contact_time(item) == 0.0
    assert measures.separation_time(item) == TIME[-1]


def test_shares_of_the_area_add_up_to_one() -> None:
    item = InterfaceFields.of_history(synthetic.contact("c", TIME, 2.0, 6.0, 1e6), TIME)
    shares = measures.status_shares(item)
    np.testing.assert_allclose(shares.sum(axis=1), 1.0)
    np.testing.assert_allclose(shares[0], [1.0, 0.0, 0.0])
    assert 0.0 < measures.largest_slip_share(item) < 1.0


def test_shares_are_weighted_by_area() -> None:
    status = np.array([[1, 2, 0]], dtype=np.int8)
    areas = np.array([1.0, 2.0, 5.0])
    zeros = np.zeros((1, 3, 3))
    item = InterfaceFields(np.array([0.0]), areas, np.tile([0.0, 0.0, 1.0], (3, 1)), zeros, status)
    np.testing.assert_allclose(measures.status_shares(item), [[5 / 8, 1 / 8, 2 / 8]])


def test_an_interface_that_cannot_open_has_no_shares() -> None:
    item = InterfaceFields.of_history(synthetic.joint("j", TIME), TIME)
    assert measures.largest_slip_share(item) is None
    with pytest.raises(ValueError, match="cannot open"):
        measures.status_shares(item)


def test_history_and_dataset_give_the_same_numbers() -> None:
    history = synthetic.contact("c", TIME, 2.0, 6.0, 1e6)
    stored = InterfaceFields.of_dataset(interface_group(history, TIME).dataset())
    direct = InterfaceFields.of_history(history, TIME)
    for measure in (measures.peak_force, measures.first_contact_time, measures.separation_time):
        assert measure(stored) == measure(direct)
    np.testing.assert_array_equal(measures.status_shares(stored), measures.status_shares(direct))
