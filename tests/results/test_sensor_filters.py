"""Filters of sensors: SAE J211 channel classes and Butterworth low passes, in attributes; refusals."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

import latin_fmu
from latin_fmu.parametric.point import QUANTITIES
from latin_fmu.results.filters import low_pass
from latin_fmu.results.sensitivities import scalars_of
from latin_fmu.run_quantities import measure_solution
from latin_fmu.scene.sensors import ChannelClass, LowPass, filter_problems

from .test_sensors import pressed

STEP = 1e-5


def gain(chosen: ChannelClass | LowPass, f: float) -> complex:
    """Amplitude and phase of a long sine behind the filter, from its middle."""
    n = round(40 / (f * STEP))
    t = STEP * np.arange(n)
    out = low_pass(np.sin(2 * np.pi * f * t), chosen, STEP)
    middle = slice(n // 4, 3 * n // 4)
    parts = np.stack([np.sin(2 * np.pi * f * t), np.cos(2 * np.pi * f * t)], axis=1)[middle]
    a, b = np.linalg.lstsq(parts, out[middle], rcond=None)[0]
    return complex(a, b)


@pytest.mark.parametrize("channel_class", [60, 180, 600, 1000])
@pytest.mark.parametrize("times", [0.3, 1.0, 1.65, 4.0])
def test_channel_classes(channel_class: int, times: float) -> None:
    """|H|^2 = 1 / (1 + (tan(pi f T) / tan(pi f_c T))^4) of one pass, two passes, no phase (SAE J211-1, appendix C)."""
    f = times * channel_class
    ratio = math.tan(np.pi * f * STEP) / math.tan(np.pi * 2.0775 * channel_class * STEP)
    measured = gain(ChannelClass(channel_class=channel_class), f)
    assert measured.real == pytest.approx(1 / (1 + ratio**4), rel=2e-3)
    assert abs(measured.imag) < 2e-3
    if times == 1.65:
        assert 20 * math.log10(measured.real) == pytest.approx(-3.0, abs=0.2)


def test_channel_class_is_the_published_recursion() -> None:
    """y_t = a0 x_t + a1 x_t-1 + a2 x_t-2 + b1 y_t-1 + b2 y_t-2, forwards then backwards, away from the ends."""
    wd = 2 * math.pi * 600 * 2.0775
    wa = math.sin(wd * STEP / 2) / math.cos(wd * STEP / 2)
    a0 = wa**2 / (1 + math.sqrt(2) * wa + wa**2)
    b1 = -2 * (wa**2 - 1) / (1 + math.sqrt(2) * wa + wa**2)
    b2 = (-1 + math.sqrt(2) * wa - wa**2) / (1 + math.sqrt(2) * wa + wa**2)
    x = np.zeros(4000)
    x[1500:2500] = np.random.default_rng(1).normal(size=1000)
    once = lfilter([a0, 2 * a0, a0], [1, -b1, -b2], x)
    expected = lfilter([a0, 2 * a0, a0], [1, -b1, -b2], once[::-1])[::-1]
    assert low_pass(x, ChannelClass(channel_class=600), STEP) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("phaseless", [True, False])
@pytest.mark.parametrize("order", [1, 4])
def test_low_pass_has_half_the_power_at_its_cut_off(order: int, phaseless: bool) -> None:
    chosen = LowPass(cutoff=2000.0, order=order, phaseless=phaseless)
    at_cutoff = gain(chosen, 2000.0)
    assert abs(at_cutoff) == pytest.approx(math.sqrt(0.5), rel=3e-3)
    assert (at_cutoff.real > 0 and abs(at_cutoff.imag) < 2e-3) == phaseless
    assert abs(gain(chosen, 300.0)) == pytest.approx(1.0, abs=0.02)


def test_constants_pass() -> None:
    for chosen in (ChannelClass(channel_class=180), LowPass(cutoff=500.0)):
        assert low_pass(np.full((3000, 3), 7.0), chosen, STEP) == pytest.approx(np.full((3000, 3), 7.0))


TOP = {"substructure": "upper", "point": [0.005, 0.005, 0.02]}


def test_in_the_results(tmp_path: Path) -> None:
    keys = {"type": "low_pass", "cutoff": 5e5}
    solution = latin_fmu.solve(pressed(sensor={"top": TOP | {"filter": keys}, "bare": TOP}))
    solution.save(tmp_path / "out.nc")
    tree = latin_fmu.open_results(tmp_path / "out.nc")
    top = tree["sensors/top"]
    for name in ("displacement", "velocity", "acceleration"):
        raw = getattr(solution.sensors["top"], name)
        assert np.array_equal(top[name].values, raw)  # the raw motion stays
        assert np.array_equal(top[f"{name}_filtered"].values, low_pass(raw, LowPass(**keys), solution.time[-1] / 20))
    assert top["velocity_filtered"].attrs["filter"] == "Butterworth low pass 500000 Hz, order 4, phaseless"
    assert top["velocity_filtered"].attrs["units"] == "m s-1"
    assert "velocity_filtered" not in tree["sensors/bare"]
    assert top["acceleration"].attrs["long_name"] == "unfiltered acceleration of the sensor"
    assert top["acceleration_filtered"].attrs["long_name"] == "acceleration of the sensor behind its filter"
    tree.close()


def test_peaks_with_and_without_a_filter_have_names_of_their_own() -> None:
    """What the estimate measures behind the filter is no quantity of the derivatives, the report or a study."""
    scene = pressed(sensor={"top": TOP | {"filter": {"type": "low_pass", "cutoff": 5e5}}})
    solution = latin_fmu.solve(scene)
    band, whole = measure_solution(scene, solution).values, scalars_of(solution.outcome, {})
    assert band["top.acceleration_peak"] < 0.9 * whole["top.acceleration_peak_unfiltered"]
    for name in band.keys() & whole.keys():
        assert band[name] == pytest.approx(whole[name], rel=1e-9), name
    top = solution.report()["sensors"]["top"]
    assert top["largest_unfiltered_acceleration"] == whole["top.acceleration_peak_unfiltered"]
    assert {"velocity_peak_unfiltered", "acceleration_peak_unfiltered"} <= {q.name for q in QUANTITIES}
    assert "largest unfiltered acceleration" in solution.summary(details=True)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        (
            {"type": "low_pass", "cutoff": 3e6},
            ("beyond the Nyquist frequency", "2.5e+06 Hz", "at most 1.667e-07 s (it is"),
        ),
        ({"channel_class": 600}, ("shorter than one period of the cut-off of SAE J211 CFC 600", "4e-06 s")),
        ({"channel_class": 500}, ("sensor.top.filter", "60", "1000")),
        ({"type": "low_pass"}, ("sensor.top.filter.cutoff",)),
    ],
)
def test_refused_with_numbers(keys: dict[str, Any], words: tuple[str, ...]) -> None:
    with pytest.raises(latin_fmu.SceneError) as refused:
        pressed(sensor={"top": TOP | {"filter": keys}})
    for word in words:
        assert word in str(refused.value)


def test_the_sampling_rate_of_j211() -> None:
    """Ten samples per period of the class: 10 000 a second for CFC 1000; less is refused, even above Nyquist's rate."""
    chosen = ChannelClass(channel_class=1000)
    assert list(filter_problems("filter", chosen, 1e-4, 1.0)) == []
    (problem,) = filter_problems("filter", chosen, 1.2e-4, 1.0)
    assert "at least 10000 samples a second for CFC 1000" in str(problem)
    assert "8333 samples a second" in str(problem)
    assert "take a time step of at most 0.0001 s (it is" in str(problem)
