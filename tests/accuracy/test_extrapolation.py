"""Orders and estimates from made-up sequences whose error is known."""

from __future__ import annotations

import math

import pytest

from latin_fmu.accuracy.estimate import Changes, estimated_error, observed_order
from latin_fmu.results.quantities_of_interest import FORCE_HISTORY, IMPULSE, PEAK_FORCE, PEAK_FORCE_RAW


def series(order: float, ratios: tuple[float, float], error: float = 0.01) -> tuple[float, float]:
    """Changes of the sequence q* + error h^order at h = 1 and the ratios."""
    first, second = (error * r**order for r in ratios)
    return first - error, second - first


@pytest.mark.parametrize("order", [0.25, 0.5, 1.0, 1.7, 2.0])
@pytest.mark.parametrize("ratios", [(2.0, 4.0), (5 / 3, 5.0), (1.9, 3.6)])
def test_order_of_a_power(order: float, ratios: tuple[float, float]) -> None:
    assert observed_order(*series(order, ratios), ratios) == pytest.approx(order, abs=1e-6)


def test_no_order_without_differences() -> None:
    assert math.isnan(observed_order(0.0, 1.0, (2.0, 4.0)))
    assert math.isnan(observed_order(1.0, math.nan, (2.0, 4.0)))


@pytest.mark.parametrize("order", [0.75, 1.0, 1.25])
@pytest.mark.parametrize("ratios", [(2.0, 4.0), (5 / 3, 5.0)])
def test_a_regular_sequence_gives_an_estimate_within_five_times(order: float, ratios: tuple[float, float]) -> None:
    half, quarter = series(order, ratios)
    error, bound_only = estimated_error(IMPULSE, Changes(half, quarter, steps=half, ratios=ratios))
    assert not bound_only
    assert 0.01 <= error <= 0.05


@pytest.mark.parametrize("front", [True, False])
def test_the_three_changes_add_up(front: bool) -> None:
    """First order with fronts, second without: each change by its own weight, e + 3/4 (e' + d)."""
    p = 1.0 if front else 2.0
    half, quarter = series(p, (2.0, 4.0))

    def error_for(changes: Changes) -> float:
        return estimated_error(IMPULSE, changes)[0] / IMPULSE.safety

    assert error_for(Changes(half, 0.0, front=front)) == pytest.approx(0.01)
    assert error_for(Changes(0.0, quarter, front=front)) == pytest.approx(0.0075)
    assert error_for(Changes(0.0, 0.0, steps=0.01, front=front)) == pytest.approx(0.0075 / 2.0**p)
    assert error_for(Changes(half, front=front)) == pytest.approx(0.0175)  # without a third run: the same again
    assert error_for(Changes(half, quarter, steps=0.01, front=front)) == pytest.approx(0.0175 + 0.0075 / 2.0**p)


def test_an_error_of_the_courant_number_alone_is_met() -> None:
    """Nothing changes along the diagonal; four times the steps change 8 %: bound, not guaranteed below it."""
    error, bound_only = estimated_error(PEAK_FORCE_RAW, Changes(half=0.0, quarter=0.0, steps=0.08))
    assert bound_only
    assert error >= 0.08


def test_a_floor_decides_where_the_runs_agree() -> None:
    """The overshoot of a front is the same in all runs of the cross."""
    error, bound_only = estimated_error(PEAK_FORCE, Changes(half=1e-4, quarter=2e-4, steps=1e-4, floor=0.12))
    assert error == 0.12
    assert bound_only


def test_an_irregular_sequence_gives_a_bound_and_says_so() -> None:
    """Two resolutions that agree by chance: the change before and what the time step alone changes count."""
    error, bound_only = estimated_error(IMPULSE, Changes(half=1e-5, quarter=0.02, steps=0.01))
    assert bound_only
    assert error >= 0.01
    assert estimated_error(IMPULSE, Changes(*series(1.0, (2.0, 4.0)), same_way=False))[1]


def test_sampling_and_iteration_count() -> None:
    half, quarter = series(1.0, (2.0, 4.0))
    plain, _ = estimated_error(IMPULSE, Changes(half, quarter))
    assert estimated_error(IMPULSE, Changes(half, quarter, iteration=0.1))[0] == pytest.approx(plain + 0.1)
    sampled, bound_only = estimated_error(IMPULSE, Changes(half, quarter, sampling=0.1))
    assert sampled >= 0.1
    assert bound_only


def test_a_front_in_the_force_history_is_regular_at_one_half() -> None:
    half, quarter = series(0.5, (2.0, 4.0))
    assert not estimated_error(FORCE_HISTORY, Changes(half, quarter))[1]
