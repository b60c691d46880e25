"""Measures against numbers known by construction of the histories."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from latin_fmu.results import interface_fields as measures
from latin_fmu.results.dataset import interface_group
from latin_fmu.results.interface_fields import Force, InterfaceFields
from latin_fmu.results.owner_records import InterfaceRecord
from latin_fmu.scene.quantity_table import FIRST_CONTACT, PEAK_FORCE, PEAK_FORCE_RAW, SEPARATION

from . import synthetic

TIME = np.linspace(0.0, 10.0, 1001)


def fields(**changes: object) -> InterfaceFields:
    """One point of area 2 with normal z, pressed by a triangle of height 6 N between t = 2 and t = 6."""
    pressure = 3.0 * np.clip(1.0 - np.abs(TIME - 4.0) / 2.0, 0.0, None)
    traction = np.stack([np.zeros_like(TIME), 0.5 * pressure, -pressure], axis=1)[:, None, :]
    status = (pressure > 0).astype(np.int8)[:, None]
    values = {"time": TIME, "areas": np.array([2.0]), "normals": np.array([[0.0, 0.0, 1.0]])}
    return InterfaceFields(**{**values, "traction": traction, "contact_status": status} | changes)


def first_contact(item: InterfaceFields) -> float | None:
    return FIRST_CONTACT.value(InterfaceRecord.of_fields(item))


def separation(item: InterfaceFields) -> float | None:
    return SEPARATION.value(InterfaceRecord.of_fields(item))


def peaks(item: InterfaceFields) -> tuple[float | None, ...]:
    """Peak force (N), the duration of its mean (s), and the raw peak (N)."""
    record = InterfaceRecord.of_fields(item)
    return PEAK_FORCE.value(record), record.duration, PEAK_FORCE_RAW.value(record)


def test_triangle_has_its_peak_and_its_ends() -> None:
    item = fields()
    # above 1 % of 6 N for 3.96 s: mean over 0.396 s around the top
    assert peaks(item) == pytest.approx((6.0 * (1.0 - 0.396 / 8.0), 0.396, 6.0), rel=1e-6)
    # 1 % of the peak is passed 0.02 after the start of the triangle and 0.02 before its end.
    assert first_contact(item) == pytest.approx(2.02, abs=0.011)
    # mean over 0.396 from t on: 3 (6 - t)^2 / (2 x 0.396) is a tenth of the peak force
    level = 0.1 * 6.0 * (1.0 - 0.396 / 8.0)
    assert separation(item) == pytest.approx(6.0 - np.sqrt(level * 2.0 * 0.396 / 3.0), abs=1e-3)
    assert measures.friction_resultant(item).max() == pytest.approx(3.0)


def test_opposite_frictions_cancel() -> None:
    one = fields()
    traction = np.concatenate([one.traction, one.traction * [1.0, -1.0, 1.0]], axis=1)
    both = fields(traction=traction, areas=np.array([2.0, 2.0]), normals=np.tile([0.0, 0.0, 1.0], (2, 1)))
    assert measures.friction_resultant(both).max() == pytest.approx(0.0, abs=1e-12)


def test_never_in_contact() -> None:
    silent = fields(traction=np.zeros((TIME.size, 1, 3)))
    assert first_contact(silent) is None
    assert separation(silent) is None
    assert peaks(silent) == (0.0, 0.0, 0.0)


def test_round_off_under_pure_shear_is_no_contact() -> None:
    traction = np.zeros((TIME.size, 1, 3))
    traction[:, 0, 0] = 1e8
    traction[::7, 0, 2] = -1e-9
    assert first_contact(fields(traction=traction)) is None


def test_tension_of_a_joint_counts_as_load() -> None:
    pulled = fields()
    pulled = fields(traction=-pulled.traction)
    assert peaks(pulled) == pytest.approx(peaks(fields()))
    assert first_contact(pulled) == first_contact(fields())


def test_still_closed_at_the_end_separates_at_the_last_instant() -> None:
    item = fields(traction=np.tile([[[0.0, 0.0, -1.0]]], (TIME.size, 1, 1)))
    assert first_contact(item) == 0.0
    assert separation(item) == TIME[-1]


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
    stored = InterfaceFields.of_dataset(interface_group(history, TIME).dataset(), motion=True)
    direct = InterfaceFields.of_history(history, TIME)
    for measure in (first_contact, separation, peaks):
        assert measure(stored) == measure(direct)
    np.testing.assert_array_equal(measures.status_shares(stored), measures.status_shares(direct))


@pytest.mark.parametrize("duration", [0.03, 0.1, 0.5])
def test_the_largest_mean_is_that_of_a_fine_search(duration: float) -> None:
    """Random histories on uneven instants: windows start anywhere, not at instants only."""
    rng = np.random.default_rng(3)
    for _ in range(5):
        time, value = np.sort(rng.random(40)), rng.normal(size=40)
        total = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(time) * (value[1:] + value[:-1]))])

        def integral(
            t: np.ndarray, time: np.ndarray = time, value: np.ndarray = value, total: np.ndarray = total
        ) -> np.ndarray:
            i = np.clip(np.searchsorted(time, t, side="right") - 1, 0, len(time) - 2)
            return np.asarray(total[i] + 0.5 * (t - time[i]) * (value[i] + np.interp(t, time, value)))

        starts = np.linspace(time[0], time[-1] - duration, 200_001)
        searched = np.abs(integral(starts + duration) - integral(starts)).max() / duration
        mean = Force(time, value).largest_mean(duration)
        assert searched <= mean * (1.0 + 1e-12)
        assert mean == pytest.approx(searched, rel=1e-6)


def test_the_mean_peak_does_not_depend_on_the_step() -> None:
    """A spike of one step carries an impulse: halving the step doubles the raw peak and leaves the mean."""
    for step in (0.02, 0.01, 0.005):
        time = np.arange(0.0, 1.0 + step / 2, step)
        force = np.where((time > 0.2) & (time < 0.8), 1.0, 0.0)
        force[np.argmin(np.abs(time - 0.5))] += 0.02 / step  # 0.02 N s more
        history = Force(time, force)
        assert history.raw_peak() == pytest.approx(1.0 + 0.02 / step)
        assert history.largest_mean(0.1) == pytest.approx(1.0 + 0.02 / 0.1, rel=1e-9)


def test_the_longest_contact_ends_where_the_force_changes_its_sign() -> None:
    """Triangles of 2 s and, pulled, of 4 s; a jump at the end of a plateau."""
    swing = Force(np.array([0.0, 1.0, 2.0, 4.0, 6.0]), np.array([0.0, 1.0, 0.0, -1.0, 0.0]))
    assert swing.longest_contact() == pytest.approx(4.0 * 0.99)
    plateau = Force(np.array([0.0, 1.0, 1.0, 3.0, 3.0, 4.0]), np.array([0.0, 0.0, 2.0, 2.0, 0.0, 0.0]))
    assert plateau.longest_contact() == 2.0
    assert plateau.peak_duration(None) == pytest.approx(0.2)
    assert plateau.largest_mean(1.0) == pytest.approx(2.0)
    assert plateau.largest_mean(3.0) == pytest.approx(4.0 / 3.0)
    assert plateau.largest_mean(9.0) == pytest.approx(1.0)  # cut to the history


def test_a_named_duration_goes_with_the_history() -> None:
    history = replace(synthetic.contact("c", TIME, 2.0, 6.0, 1e6), peak_duration=4.0)
    peak, duration, raw = peaks(InterfaceFields.of_history(history, TIME))
    assert duration == 4.0
    assert peak == pytest.approx(raw * 2.0 / np.pi, rel=1e-3)  # mean of half a sine
    stored = interface_group(history, TIME).dataset()
    assert stored["peak_force"].attrs["peak_duration"] == 4.0
    assert float(stored["peak_force_raw"]) == pytest.approx(raw)
