"""Bands of results from parameters that scatter, against closed forms and against samples."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

import latin_fmu
from latin_fmu.accuracy.runs import Resolution, at_resolution
from latin_fmu.cli import main
from latin_fmu.errors import InputError, ResultsError, SceneError, SolverError
from latin_fmu.parametric.point import CONVERGED, NOT_CONVERGED, SAMPLE, Grid, parameters_of
from latin_fmu.parametric.samples import SampledBands, sample_values
from latin_fmu.pictures.sensitivity_picture import bands_figure
from latin_fmu.results.owner_records import InterfaceRecord
from latin_fmu.results.spread import Bands, QuantityBand, ResultBand, Scatter, coverage
from latin_fmu.scene.quantity_table import INTERFACE, values_of
from latin_fmu.scene.spread import Distribution
from tests.scenes import MODELS

SMALL = (
    "solver.tolerance=1e-9",
    "substructure.lower.box.elements=[2,2,2]",
    "substructure.upper.box.elements=[2,2,2]",
    "time.step=0.3e-6",
    "output.fields=false",
    "output.check_sensitivities=none",
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
    # variances 1 of 2 a, 4/3 of b, 2.25/12 of c
    kurtosis = -1.2 * (16 / 9 + 0.1875**2) / (1.0 + 4 / 3 + 0.1875) ** 2
    np.testing.assert_allclose(band.factor, coverage(np.array([kurtosis, -1.2])))


def test_forces_that_follow_a_load_have_its_band() -> None:
    """Stick throughout and no gap: everything is linear in the pressure, 1.96 x 5 % of it."""
    settings = ("interface.crush.friction_coefficient=5.0", "spread.load.press.pressure=5 %")
    bands = solved(*settings).bands
    peak = bands["crush.peak_force"]
    assert float(peak.band.half) == pytest.approx(1.959964 * 0.05 * peak.value, rel=1e-6)
    assert not peak.flagged
    # of the spectrum and of the filtered motion as well
    for path in ("/spread/sensors/top", "/spread/sensors/top/spectrum", "/spread/interfaces/crush"):
        for name, band in bands.bands[path].items():
            size = np.abs(bands.histories[path].variables[name].values)
            np.testing.assert_allclose(band.deviation, 0.05 * size, atol=1e-7 * size.max(), err_msg=name)
    assert "acceleration_filtered" in bands.bands["/spread/sensors/top"]


def test_independent_parameters_add_by_their_squares() -> None:
    both, one, other = (solved(*chosen).bands for chosen in (SPREAD, SPREAD[:1], SPREAD[1:]))
    assert both is not None
    for q in both.quantities:
        parts = [float(bands[q.quantity].band.deviation) for bands in (one, other)]
        assert float(q.band.deviation) == pytest.approx(np.hypot(*parts), rel=1e-9), q.quantity
        if q.shares.any():
            assert q.shares[0] == pytest.approx(parts[0] ** 2 / (parts[0] ** 2 + parts[1] ** 2), abs=1e-9)
            assert float(q.shares.sum()) == pytest.approx(1.0)
    for path in ("/spread/interfaces/crush", "/spread/sensors/top", "/spread/sensors/top/spectrum"):
        for name, band in both.bands[path].items():
            parts = [bands.bands[path][name].deviation for bands in (one, other)]
            size = band.deviation.max()
            np.testing.assert_allclose(band.deviation, np.hypot(*parts), rtol=1e-6, atol=1e-9 * size, err_msg=name)


def test_bands_are_stored_said_and_drawn(tmp_path: Path) -> None:
    solution = solved(*SPREAD)
    solution.save(tmp_path / "crushing.nc")
    with latin_fmu.open_results(tmp_path / "crushing.nc") as tree:
        whole = tree["spread"]
        assert list(whole["parameter"].values) == ["load.press.pressure", "interface.crush.friction_coefficient"]
        assert whole["low"].dims == ("quantity",)
        band = solution.bands.bands["/spread/interfaces/crush"]["force"]
        for end in ("low", "high"):
            scalars = [getattr(q.band, end) for q in solution.bands.quantities]
            np.testing.assert_array_equal(whole[end].values, scalars)
            force = tree[f"spread/interfaces/crush/force_{end}"]
            assert (force.dims, force.attrs["units"]) == (("time", "component"), "N")
            np.testing.assert_array_equal(force.values, getattr(band, end))
        np.testing.assert_array_equal(whole["deviation"].values, [q.band.deviation for q in solution.bands.quantities])
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


def test_a_band_is_flagged_where_a_derivative_that_makes_more_than_a_hundredth_of_it_is() -> None:
    solution = solved(*SPREAD, 'output.sensitivities=["material.steel.density"]')
    scene, known = crushing(*SPREAD), solution.sensitivities
    for flagged in (0, 1, 2):
        flags = [replace(q, flagged=np.arange(3) == flagged) for q in known.quantities]
        bands = Bands.of(
            solution.outcome, replace(known, quantities=flags), scene.distributions, scene.sensor, solution.spectra
        )
        # the first parameter does not scatter
        expected = [bool(flagged and q.shares[flagged - 1] > 0.01) for q in bands.quantities]
        assert [q.flagged for q in bands.quantities] == expected
        assert any(expected) == (flagged > 0)


def test_a_band_is_said_by_its_half_width_or_its_ends() -> None:
    for mean, deviation, words in (
        (10.0, 1.0, "10.00 N s +- 1.96 N s (20 %)"),
        (11.0, 1.0, "10.00 N s, 9.040 N s to 12.96 N s"),
        (10.0, 0.0, "10.00 N s, does not change"),
    ):
        band = ResultBand(np.array(mean), np.array(deviation), np.array(1.96))
        assert QuantityBand("crush.impulse", "N s", 10.0, band, np.ones(1), False).text("N s") == words


def test_a_bolt_force_that_scatters_has_its_band() -> None:
    """Tensions follow the force at t = 0; neither bolt nor load is part of the static scenes that are solved first."""
    settings = ("time.end=1e-6", "spread.bolt.m6.force=5 %", "spread.load.shock.traction.0=3 %")
    solution = latin_fmu.solve(latin_fmu.load_scene(MODELS / "lap_joint/shock.toml", settings))
    assert solution.bands is not None
    band = solution.bands["m6.largest_bolt_force"].band
    assert band.deviation == pytest.approx(0.05 * 5e3, rel=1e-3)


def test_other_parameters_are_differentiated_beside_those_that_scatter() -> None:
    solution = solved(*SPREAD, 'output.sensitivities=["material.steel.density"]')
    names = [d.name for d in solution.sensitivities.derivatives]
    assert names == ["material.steel.density", "load.press.pressure", "interface.crush.friction_coefficient"]
    assert any("for 10 % more" in line for line in solution.summary().splitlines())
    alone = solved(*SPREAD).bands
    for q in alone.quantities:
        assert float(solution.bands[q.quantity].band.half) == pytest.approx(float(q.band.half), rel=1e-6, abs=1e-30)


def test_coarser_runs_and_points_of_a_study_are_not_differentiated() -> None:
    scene = crushing(*SPREAD, 'output.sensitivities=["interface.crush.friction_coefficient"]')
    assert len(scene.differentiated) == 2
    grid = Grid(scene.tables(), str(scene.base_dir), parameters_of(["time.step=0.3e-6,0.6e-6"]))
    for plain in (scene.undifferentiated, at_resolution(scene, Resolution(mesh=0.5, time=0.5)), grid.scene((0,))):
        assert not plain.differentiated


def test_results_without_bands_have_no_figure_of_them() -> None:
    with pytest.raises(ResultsError, match="no bands"):
        bands_figure(solved().to_datatree())


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("spread.load.press.pressur=5 %", "no number under this name"),
        ("spread.substructure.upper.initial_velocity.\u00b2=5 %", "no number under this name"),
        ("spread.load.press.pressure=five", 'standard deviation > 0, a share of the value such as "5 %"'),
        ("spread.load.press.pressure=-1.0", "not a spread"),
        ("spread.load.press.pressure=[3.0, 1.0]", "not a spread"),
        ("spread.load.press.pressure=[1.0, 2.0]", "not in its range"),
        ("spread.load.press.pressure=true", "not a spread"),
        ("spread=3", "must be a table"),
        ("spread.substructure.upper.initial_velocity.0=5 %", "a share of a value of 0 is 0"),
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


def test_samples_have_the_distributions_of_their_parameters() -> None:
    assert Distribution.of(-2.0, "10 %").deviation == pytest.approx(0.2)
    distributions = {"a": Distribution.of(2.0, "10 %"), "b": Distribution.of(1.0, (0.0, 4.0))}
    a, b = (np.array(p.values) for p in sample_values(distributions, 1000, 1))
    assert stats.kstest(a, stats.norm(2.0, 0.2).cdf).statistic < 5e-3
    assert stats.kstest(b, stats.uniform(0.0, 4.0).cdf).statistic < 5e-3
    assert abs(np.corrcoef(a, b)[0, 1]) < 1e-2
    # more of them begin with the same ones, other seeds make others
    more = sample_values(distributions, 2000, 1)
    assert more[0].values[:1000] == tuple(a)
    assert sample_values(distributions, 1000, 2)[0].values != tuple(a)
    # 200 of them have the deviation of a sum of three normal ones to a per cent or two
    sums = [
        np.sum([p.values for p in sample_values({k: Distribution.of(1.0, "10 %") for k in "abc"}, 200, seed)], axis=0)
        for seed in range(20)
    ]
    errors = np.std(sums, axis=1, ddof=1) / (0.1 * np.sqrt(3.0)) - 1.0
    assert np.sqrt(np.mean(errors**2)) < 0.015
    assert np.abs(errors).max() < 0.03


def compared(count: int, *settings: str, output: Path | None = None):
    return latin_fmu.sample(crushing("solver.tolerance=1e-6", *settings), count, output)


def test_samples_of_a_linear_run_have_the_band_to_first_order(tmp_path: Path) -> None:
    """Everything follows the pressure: mean and standard deviation of 32 points of the sequence, to some per cent."""
    settings = ("interface.crush.friction_coefficient=5.0", "spread.load.press.pressure=5 %")
    found, tree = compared(32, *settings, output=tmp_path / "samples.nc")
    assert found.count == 32
    assert found.ratio("crush.peak_force") == pytest.approx(1.0, abs=0.05)
    pressure = tree["load_press_pressure"].values
    scaled = pressure.std(ddof=1) / pressure.mean()
    peak = found.scalars["crush.peak_force"]
    assert float(peak.deviation / peak.mean) == pytest.approx(scaled, rel=1e-4)
    with latin_fmu.open_results(tmp_path / "samples.nc") as stored:
        assert stored.sizes["sample"] == 32
        whole, force = stored["spread"], stored["spread/interfaces/crush"]
        i = list(whole["quantity"].values).index("crush.peak_force")
        assert float(whole["sampled_low"].values[i]) == pytest.approx(float(peak.low))
        own = (force[f"normal_force_{part}high"] - force[f"normal_force_{part}low"] for part in ("", "sampled_"))
        first, sampled = (values.values for values in own)
        np.testing.assert_allclose(sampled, first, atol=0.05 * first.max())
        # band to first order, run, and both ends of the samples
        assert len(bands_figure(stored).axes[0].lines) == 4
    assert not (tmp_path / "samples.nc.points").exists()


def test_samples_that_do_not_count_are_none() -> None:
    """A friction below 0 is refused: its samples fail, the others have a band."""
    found, tree = compared(16, "spread.interface.crush.friction_coefficient=0.1")
    failed = int((tree["state"].values == 2).sum())
    assert 0 < failed < 8
    assert found.count == 16 - failed
    assert tree["friction_work"].dims == ("sample", "interface")


def test_samples_that_did_not_converge_do_not_count() -> None:
    """Though they have results; the others have mean and standard deviation of their values."""
    bands = solved(*SPREAD).bands
    zeros = {path: {name: 0.0 * b.mean for name, b in of.items()} for path, of in bands.bands.items()}
    scalars = [{q.quantity: value for q in bands.quantities} for value in (1.0, 4.0, 100.0)]
    records = [
        {"state": state, SAMPLE: {"scalars": own, "results": zeros}}
        for state, own in zip((CONVERGED, CONVERGED, NOT_CONVERGED), scalars, strict=True)
    ]
    found = SampledBands.of(bands, records)
    assert found.count == 2
    peak = found.scalars["crush.peak_force"]
    assert (float(peak.mean), float(peak.deviation)) == pytest.approx((2.5, 3.0 / np.sqrt(2.0)))
    assert peak.half == bands["crush.peak_force"].band.factor * peak.deviation
    # 1.96 standard deviations each
    ratio = float(bands["crush.peak_force"].band.half / peak.half)
    assert found.ratio("crush.peak_force") == pytest.approx(ratio)
    said = " ".join(" ".join(found.lines()).split())
    assert re.search(r"crush peak force [^;]*; samples 2.500 N \+- 4.16 N, to first order \S+ % wider", said)
    told = found.report()["quantities"]["crush.peak_force"]
    ends = {key: float(getattr(peak, key)) for key in ("mean", "low", "high")}
    assert {key: told[f"sampled_{key}"] for key in ends} == ends
    whole = found.groups()["/spread"].variables
    i = [q.quantity for q in bands.quantities].index("crush.peak_force")
    for key in (*ends, "deviation"):
        assert whole[f"sampled_{key}"].values[i] == getattr(peak, key)
    with pytest.raises(SolverError, match="1 samples have converged"):
        SampledBands.of(bands, records[1:])


def test_a_sample_has_its_value_of_every_parameter() -> None:
    found, tree = compared(8, *SPREAD)
    assert found.count == 8
    scene = crushing("solver.tolerance=1e-6")
    for name in ("load.press.pressure", "interface.crush.friction_coefficient"):
        values = tree[name.replace(".", "_")]
        assert (values.dims, values.attrs["scene_key"]) == (("sample",), name)
        scene = scene.replace(name, float(values[5]))
    alone = latin_fmu.solve(scene)
    expected = values_of("derivatives", INTERFACE, InterfaceRecord.of(alone.interfaces["crush"], alone.time))
    for key in ("friction_work", "peak_force"):
        assert tree[key].values[5, 0] == pytest.approx(expected[key], rel=1e-4)


def test_samples_without_a_spread_or_a_band_are_refused() -> None:
    with pytest.raises(InputError, match="no parameters that scatter"):
        compared(16)
    with pytest.raises(InputError, match="number of samples"):
        compared(2, *SPREAD)
    with pytest.raises(InputError, match="out of range"):
        latin_fmu.sample(crushing(*SPREAD), 8, seed=-1)
    with pytest.raises(SolverError, match="no bands to first order"):
        compared(16, *SPREAD, "solver.max_iterations=1", "solver.newton=false")


def test_the_command_samples_and_says_both_bands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene, output = tmp_path / "crushing.toml", tmp_path / "samples.nc"
    scene.write_text(crushing("solver.tolerance=1e-6", *SPREAD).text(), encoding="utf-8")
    command = ["sweep", str(scene), "--samples", "8", "-o", str(output), "--jobs", "1", "-q"]
    assert main(command) == 0
    said = capsys.readouterr().out
    assert "8 samples:" in said
    assert "; samples" in next(line for line in said.splitlines() if "crush impulse" in line)
    assert main(["plot", str(output), "-o", str(tmp_path / "bands.png")]) == 0
    assert main([*command, "--json"]) == 0
    assert '"sampled_mean"' in capsys.readouterr().out
    assert main([*command, "--vary", "time.step=1e-7,2e-7"]) == 2
    assert "either values or samples" in capsys.readouterr().err


def test_samples_that_fail_are_counted() -> None:
    """Friction of 0.1 with a standard deviation of 0.5: half of the samples are below 0, which no scene allows."""
    bands, study = latin_fmu.sample(crushing("spread.interface.crush.friction_coefficient=0.5", "time.end=6e-6"), 8)
    failed = int((study["state"].values != 0).sum())
    assert 0 < failed < 7
    assert (bands.count, bands.left_out) == (8 - failed, failed)
    assert bands.lines()[0].startswith(f"  {8 - failed} samples; {failed} more failed or did not converge")
    assert bands.report()["left_out"] == failed


@pytest.mark.slow
def test_bands_to_first_order_are_those_of_200_samples() -> None:
    """Pressure, friction and modulus scatter by 5 %: the numbers of docs/spread.md."""
    parameters = ("load.press.pressure", "interface.crush.friction_coefficient", "material.steel.young_modulus")
    found, _ = compared(200, *(f"spread.{name}=5 %" for name in parameters))
    assert found.count == 200
    sound = {q.quantity for q in found.bands.quantities if not q.flagged}
    assert sound == {f"crush.{key}" for key in ("impulse", "peak_force", "separation")} | {
        f"top.displacement{of}" for of in ("", "_peak")
    }
    within = dict.fromkeys(sound, 0.01)
    within |= dict.fromkeys((f"crush.{key}" for key in ("slip", "largest_slip", "friction_work")), 0.06)
    within |= dict.fromkeys((f"top.{key}_peak" for key in ("velocity", "acceleration")), 0.09)
    for quantity, share in within.items():
        assert found.ratio(quantity) == pytest.approx(1.0, abs=share), quantity
    assert found.ratio("crush.first_contact") == pytest.approx(0.32, abs=0.05)
    assert found.ratio("top.spectrum_peak") == pytest.approx(1.69, abs=0.1)
    histories = (("interfaces/crush", "normal_force", 0.01), ("sensors/top", "velocity", 0.09))
    for path, name, share in (*histories, ("sensors/top", "acceleration", 0.6)):
        first, own = (of[f"/spread/{path}"][name].half for of in (found.bands.bands, found.results))
        np.testing.assert_allclose(first, own, atol=share * own.max(), err_msg=name)
