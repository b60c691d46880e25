"""Bands of results from parameters that scatter, against closed forms and against samples."""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

import latin_fmu
from latin_fmu.errors import ResultsError, SceneError
from latin_fmu.pictures.sensitivity_picture import bands_figure
from latin_fmu.results.spread import Scatter, coverage
from latin_fmu.scene.spread import Distribution
from tests.scenes import MODELS

SMALL = (
    "solver.tolerance=1e-9",
    "substructure.lower.box.elements=[2,2,2]",
    "substructure.upper.box.elements=[2,2,2]",
    "time.step=0.3e-6",
    "output.fields=false",
    "sensor.top={face='upper.zmax',spectrum={},filter={type='low_pass',cutoff=3e5}}",
)
SPREAD = ("spread.load.press.pressure=5 %", "spread.interface.crush.friction_coefficient=[0.05,0.15]")


def crushing(*settings: str) -> latin_fmu.Scene:
    return latin_fmu.load_scene(MODELS / "two_specimen_crushing/scene.toml", (*SMALL, *settings))


@cache
def solved(*settings: str) -> latin_fmu.Solution:
    solution = latin_fmu.solve(crushing(*settings))
    assert solution.converged, solution.status
    return solution


def test_half_widths_are_those_of_normal_uniform_and_triangular_distributions() -> None:
    """Two equal uniform parameters make a triangle: 95 % lie within 1 - sqrt(0.05) of its half width, sqrt(6) sigma."""
    known = stats.norm.ppf(0.975), 0.95 * np.sqrt(3.0), (1.0 - np.sqrt(0.05)) * np.sqrt(6.0)
    made = coverage(np.array([0.0, -1.2, -0.6]))
    np.testing.assert_allclose(made[:2], known[:2], rtol=1e-12)
    assert made[2] == pytest.approx(known[2], rel=1e-2)
    # it goes over into the normal one
    near = coverage(np.array([-1.01e-5, -0.99e-5]))
    assert near[0] == pytest.approx(near[1], rel=1e-5)


def test_bands_of_a_linear_function_are_those_of_samples() -> None:
    """q = 2 a + b + c about a = 1, b = 2, c = 10, of which b is uniform in [1, 5] and c in [9, 10.5]."""
    distributions = {
        "a": Distribution.of(1.0, "50 %"),
        "b": Distribution.of(2.0, (1.0, 5.0)),
        "c": Distribution.of(10.0, (9.0, 10.5)),
    }
    # derivatives are for the changes a = 1, b = 2, c = 10; another parameter comes first
    scatter = Scatter(distributions, [1, 2, 3], np.array([1.0, 2.0, 10.0]))
    changes = np.array([[7.0, 0.0], [2.0, 0.0], [2.0, 2.0], [10.0, 0.0]])
    band = scatter.band(np.array([14.0, 2.0]), changes)
    rng, n = np.random.default_rng(3), 400_000
    b = rng.uniform(1.0, 5.0, n)
    samples = 2.0 * rng.normal(1.0, 0.5, n) + b + rng.uniform(9.0, 10.5, n)
    found = [[np.quantile(s, share) for s in (samples, b)] for share in (0.025, 0.975)]
    np.testing.assert_allclose(band.low, found[0], rtol=5e-3)
    np.testing.assert_allclose(band.high, found[1], rtol=5e-3)
    np.testing.assert_allclose(band.deviation, [samples.std(), b.std()], rtol=5e-3)


def test_forces_that_follow_a_load_have_its_band() -> None:
    """Stick throughout and no gap: everything is linear in the pressure, 1.96 x 5 % of it."""
    settings = ("interface.crush.friction_coefficient=5.0", "spread.load.press.pressure=5 %")
    bands = solved(*settings).bands
    peak = bands["crush.peak_force"]
    assert float(peak.band.half) == pytest.approx(1.959964 * 0.05 * peak.value, rel=1e-6)
    assert not peak.flagged
    # of the spectrum and of the filtered motion as well
    for path in ("/spread/sensors/top", "/spread/sensors/top/spectrum", "/spread/interfaces/crush"):
        results, _ = bands.histories[path]
        for row, value, band in results:
            largest = np.abs(value).max()
            np.testing.assert_allclose(band.deviation, 0.05 * np.abs(value), atol=1e-7 * largest, err_msg=row.name)
    assert {row.name for row, _, _ in bands.histories["/spread/sensors/top"][0]} >= {"acceleration_filtered"}


def test_independent_parameters_add_by_their_squares() -> None:
    both, one, other = (solved(*chosen).bands for chosen in (SPREAD, SPREAD[:1], SPREAD[1:]))
    assert both is not None
    for q in both.quantities:
        parts = [float(bands[q.quantity].band.deviation) for bands in (one, other)]
        assert float(q.band.deviation) == pytest.approx(np.hypot(*parts), rel=1e-9), q.quantity
        if q.shares.any():
            assert q.shares[0] == pytest.approx(parts[0] ** 2 / (parts[0] ** 2 + parts[1] ** 2), abs=1e-9)
            assert float(q.shares.sum()) == pytest.approx(1.0)


def test_bands_are_stored_said_and_drawn(tmp_path: Path) -> None:
    solution = solved(*SPREAD)
    solution.save(tmp_path / "crushing.nc")
    with latin_fmu.open_results(tmp_path / "crushing.nc") as tree:
        whole = tree["spread"]
        assert list(whole["parameter"].values) == ["load.press.pressure", "interface.crush.friction_coefficient"]
        assert whole["low"].dims == ("quantity",)
        assert (whole["low"].values <= whole["value"].values).all()
        force = tree["spread/interfaces/crush"]["force_high"]
        assert (force.dims, force.attrs["units"]) == (("time", "component"), "N")
        figure = bands_figure(tree)
    titles = [axis.get_title() for axis in figure.axes]
    assert titles == ["crush", "top, along z", "spectrum of top, along z"]
    assert all(axis.collections for axis in figure.axes)
    said = solution.summary().splitlines()
    line = next(line for line in said if "crush peak force" in line)
    assert "+- " in line
    assert "of its variance by pressure of press" in line
    # the parameters are in no other list
    assert not any("for 10 % more" in line for line in said)
    assert solution.report()["bands"]["quantities"]["crush.peak_force"]["low"] == pytest.approx(
        float(solution.bands["crush.peak_force"].band.low)
    )


def test_other_parameters_are_differentiated_beside_those_that_scatter() -> None:
    solution = solved(*SPREAD, 'output.sensitivities=["material.steel.density"]')
    names = [d.name for d in solution.sensitivities.derivatives]
    assert names == ["material.steel.density", "load.press.pressure", "interface.crush.friction_coefficient"]
    assert any("for 10 % more" in line for line in solution.summary().splitlines())
    alone = solved(*SPREAD).bands
    for q in alone.quantities:
        assert float(solution.bands[q.quantity].band.half) == pytest.approx(float(q.band.half), rel=1e-6, abs=1e-30)


def test_results_without_bands_have_no_figure_of_them() -> None:
    with pytest.raises(ResultsError, match="no bands"):
        bands_figure(solved().to_datatree())


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("spread.load.press.pressur=5 %", "no number under this name"),
        ("spread.load.press.pressure=five", 'standard deviation > 0, a share of the value such as "5 %"'),
        ("spread.load.press.pressure=-1.0", "no spread"),
        ("spread.load.press.pressure=[3.0, 1.0]", "no spread"),
        ("spread.load.press.pressure=[1.0, 2.0]", "not in its range"),
        ("spread.load.press.pressure=true", "no spread"),
        ("spread=3", "must be a table"),
        ("spread.substructure.upper.initial_velocity.0=5 %", "a share of 0 is 0"),
    ],
)
def test_spreads_that_are_none_are_refused(setting: str, words: str) -> None:
    with pytest.raises(SceneError, match=words) as caught:
        crushing(setting)
    assert len(caught.value.problems) == 1


def test_a_spread_is_written_as_it_is_read() -> None:
    scene = crushing(*SPREAD)
    text = scene.text()
    assert 'load.press.pressure = "5 %"' in text
    lines = text.splitlines()
    assert ("[spread]", 'load.press.pressure = "5 %"') in list(pairwise(lines))
    moved = scene.replace("spread.load.press.pressure", 3.0)
    assert moved.spread == {"load.press.pressure": 3.0, "interface.crush.friction_coefficient": (0.05, 0.15)}
