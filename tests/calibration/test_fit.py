"""Fits of parameters: truth, intervals, secants, what the data do not determine."""

from __future__ import annotations

import dataclasses
import re
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

import latin_fmu
from latin_fmu.calibration.data import Column, MeasuredTable, read_measured
from latin_fmu.calibration.figure import calibration_figure
from latin_fmu.calibration.prediction import Predicted, Predictor
from latin_fmu.calibration.report import (
    Calibration,
    ColumnFit,
    FitParameter,
    FitStatistics,
    _error_of,
    _estimated,
    _on_derivatives,
    _on_residuals,
    combinations,
)
from latin_fmu.calibration.study import LeastSquares, _weigh
from latin_fmu.errors import InputError, SolverError
from latin_fmu.sensitivities.tangents import Tangents
from tests.scenes import MODELS
from tests.verification.test_backbone import chain, exact

FRICTION, PRESSURE = "interface.crush.friction_coefficient", "load.press.pressure"
COARSE = (
    "substructure.lower.box.elements=[2,2,2]",
    "substructure.upper.box.elements=[2,2,2]",
    "time.step=0.3e-6",
    'sensor.side={substructure="lower",point=[0.01,0.01,0.009]}',
)
TRUTH = (0.1, 200e6)
COLUMNS = ("side.displacement.x", "side.displacement.z", "crush.force.z")


@cache
def crushing() -> latin_fmu.Scene:
    return latin_fmu.load_scene(MODELS / "two_specimen_crushing/scene.toml", COARSE)


def write(path: Path, header: str, table: np.ndarray) -> Path:
    np.savetxt(path, table, delimiter=",", header=header, comments="")
    return path


@cache
def histories() -> tuple[np.ndarray, np.ndarray]:
    """Instants (n,) and the columns of the run with the true values, (n, 3)."""
    run = latin_fmu.solve(crushing())
    moved, force = run.sensors["side"].displacement, run.interfaces["crush"].force()
    kept = slice(5, None, 4)
    return run.time[kept], np.stack([moved[:, 0], moved[:, 2], force[:, 2]], axis=1)[kept]


def noisy(seed: int | None) -> np.ndarray:
    """The true columns with noise of 2 % of their largest value; none where None."""
    _, exact = histories()
    if seed is None:
        return exact
    return exact + 0.02 * np.abs(exact).max(axis=0) * np.random.default_rng(seed).standard_normal(exact.shape)


def fitted(tmp_path: Path, seed: int | None = None, **options: Any) -> Calibration:
    time, _ = histories()
    data = write(tmp_path / "d.csv", ",".join(("time", *COLUMNS)), np.column_stack([time, noisy(seed)]))
    start = [f"{FRICTION}=0.2", f"{PRESSURE}=150e6"]
    return latin_fmu.calibrate(crushing(), data, start, **{"estimate": False, **options})


def test_exact_data_give_the_truth(tmp_path: Path) -> None:
    made = fitted(tmp_path)
    assert made.converged
    assert made.runs <= 8
    for name, value in zip((FRICTION, PRESSURE), TRUTH, strict=True):
        assert made[name].value == pytest.approx(value, rel=2e-3)
        assert abs(made[name].value - value) < 2 * made[name].half + 2e-3 * value
    assert made.scene.interface["crush"].friction_coefficient == made[FRICTION].value
    axes = calibration_figure(made).axes
    assert [axis.get_title() for axis in axes[:3]] == list(COLUMNS)
    for c, above, below in zip(made.columns, axes[:3], axes[3:], strict=True):
        drawn = {line.get_label(): np.asarray(line.get_ydata()) for line in above.lines}
        prefix = np.ptp(c.after) / np.ptp(drawn["after"])
        np.testing.assert_allclose(drawn["before"] * prefix, c.before)
        for line, predicted in zip(below.lines, (c.before, c.after), strict=False):
            residual = np.asarray(line.get_ydata()) * prefix
            np.testing.assert_allclose(residual, c.column.values - predicted, atol=1e-12 * np.abs(c.after).max())


def test_data_of_another_unit_are_refused(tmp_path: Path) -> None:
    """Forces in mN and displacements in um, read as N and m, after one run; both columns are named."""
    time, known = histories()
    data = write(tmp_path / "d.csv", ",".join(("time", *COLUMNS)), np.column_stack([time, known * [1e6, 1.0, 1e6]]))
    said: list[str] = []
    start = [f"{FRICTION}=0.2", f"{PRESSURE}=150e6"]
    with pytest.raises(InputError) as caught:
        latin_fmu.calibrate(crushing(), data, start, estimate=False, log=said.append)
    assert len(said) == 1
    assert len(caught.value.problems) == 2
    text = str(caught.value)
    assert "side.displacement.x has values beyond 1000 times those of the run with the start values" in text
    assert "crush.force.z has values beyond 1000 times" in text
    allowed = re.findall(r"allowed: up to ([\d.e+-]+) N", text)
    assert 100.0 < float(allowed[0]) / np.abs(known[:, 2]).max() < 1e4


def test_secants_end_where_derivatives_do(tmp_path: Path) -> None:
    """Values to a tenth of the interval, intervals to a fifth."""
    exact, secants = fitted(tmp_path, 1), fitted(tmp_path, 1, secants=True)
    assert secants.runs <= 14
    assert "derivatives by secants: as requested" in secants.remarks[0]
    for a, b in zip(exact.parameters, secants.parameters, strict=True):
        assert b.value == pytest.approx(a.value, abs=0.2 * a.half)
        assert b.half == pytest.approx(a.half, rel=0.2)


def test_why_there_are_secants_is_said_before_their_runs(tmp_path: Path) -> None:
    """Once, in one line, and at the end."""
    said, time = list[str](), histories()[0]
    data = write(tmp_path / "d.csv", "time,side.displacement.z", np.column_stack([time, noisy(None)[:, 1]]))
    scene, start = crushing().replace("solver.window", 10), f"{PRESSURE}=199e6"
    made = latin_fmu.calibrate(scene, data, start, max_runs=3, estimate=False, log=said.append)
    why = "not known with windows of several instants"
    assert [text for text in said if "secants" in text] == [
        f"secants in the place of derivatives, with more runs: {why}"
    ]
    assert "secants" in said[0]
    assert f"derivatives by secants: {why}" in made.remarks


def test_remarks_on_the_error_of_the_run_are_those_on_the_data(tmp_path: Path) -> None:
    """What a velocity and an acceleration hold for is said of a sensor with data of them, and not of displacements."""
    scene, said = crushing(), list[list[str]]()
    solution = latin_fmu.solve(scene)
    for motion in ("displacement", "velocity"):
        data = write(tmp_path / "d.csv", f"time,side.{motion}.z", np.column_stack([[1e-6, 2e-6], [1.0, 2.0]]))
        (table,) = read_measured([data], scene)
        said.append([])
        assert _estimated(scene, solution, table.columns, said[-1]) is not None
    assert not any("of side" in text for text in said[0])
    assert [text for text in said[1] if "velocity_peak and acceleration_peak of side" in text]
    assert len(said[1]) == len(said[0]) + 1


def test_data_that_a_scene_does_not_follow_are_told(tmp_path: Path) -> None:
    """Of the other sign: the friction at its bound leaves twice the data."""
    time, data = histories()[0], noisy(None)[:, 1]
    for sign, told in ((1.0, False), (-1.0, True)):
        path = write(tmp_path / "d.csv", "time,side.displacement.z", np.column_stack([time, sign * data]))
        made = latin_fmu.calibrate(crushing(), path, f"{FRICTION}=0.1", max_runs=2, estimate=False)
        assert any("the scene does not follow side.displacement.z: 2e+02 % of" in text for text in made.remarks) == told


def test_slopes_of_a_spectrum_are_those_of_central_differences(tmp_path: Path) -> None:
    """To 2 % of the largest: points that begin to slip within the difference, and maxima that change their place."""
    scene = crushing().replace("solver.tolerance", 1e-9).replace("solver.force_tolerance", 1e-9)
    frequencies = np.geomspace(2e4, 2e5, 9)
    data = write(tmp_path / "s.csv", "frequency,side.srs.x", np.column_stack([frequencies, np.ones(9)]))
    tables = read_measured([data], scene)
    predictor = Predictor(scene, tables, [(FRICTION,), (PRESSURE,)], 1, 2)
    slopes = predictor(TRUTH).slopes
    assert slopes is not None
    for i in range(2):
        step = 1e-3 * np.eye(2)[i] * TRUTH
        more, less = (predictor(tuple(np.array(TRUTH) + s * step)).predicted for s in (1, -1))
        difference = (more - less) / (2.0 * step[i])
        np.testing.assert_allclose(slopes[:, i], difference, atol=0.02 * np.abs(difference).max())


def test_parameters_that_scatter_are_not_differentiated_in_a_fit(tmp_path: Path) -> None:
    scene = crushing().replace("spread", {PRESSURE: "5 %"})
    data = write(tmp_path / "d.csv", "time,side.velocity.x", np.ones((2, 2)) * 1e-6)
    predictor = Predictor(scene, read_measured([data], scene), [(FRICTION,)], 1, 2)
    predictor.reason = "secants are asked for"
    run = predictor((0.1,)).solution
    assert run is not None
    assert run.sensitivities is None


def test_a_filtered_motion_and_tied_names(tmp_path: Path) -> None:
    """Slopes of two names with one value are the sum of those of each."""
    scene = crushing().replace("sensor.side.filter", {"type": "low_pass", "cutoff": 2e5})
    scene = scene.replace("solver.tolerance", 1e-8)
    both = ("material.steel.young_modulus", "material.aluminium.young_modulus")
    scene = scene.replace(both[1], 210e9)
    time, _ = histories()
    data = write(tmp_path / "f.csv", "time,side.velocity_filtered.z", np.column_stack([time, np.ones(len(time))]))
    tables = read_measured([data], scene)
    tied = Predictor(scene, tables, [both], 1, 2)((210e9,))
    each = Predictor(scene, tables, [both[:1], both[1:]], 1, 2)((210e9, 210e9))
    assert tied.slopes is not None
    assert each.slopes is not None
    np.testing.assert_allclose(
        tied.slopes[:, 0], each.slopes.sum(axis=1), rtol=1e-6, atol=1e-9 * abs(tied.slopes).max()
    )
    assert tied.solution is not None
    filtered = tied.solution.to_datatree()["sensors/side/velocity_filtered"]
    of_file = np.interp(time, filtered["time"], filtered.sel(component="z"))
    for made in (tied, each):
        np.testing.assert_allclose(made.predicted, of_file, rtol=1e-6, atol=1e-9)


def test_frequencies_give_a_modulus(tmp_path: Path) -> None:
    """Where all is of one modulus, frequencies go with its root; there are no derivatives, hence secants."""
    scene = latin_fmu.load_scene(MODELS / "beam_in_traction/scene.toml")
    name = next(f"material.{m}.young_modulus" for m in scene.material)
    modulus = float(scene.material[name.split(".")[1]].young_modulus)
    modes = latin_fmu.vibration_modes(scene, count=4)
    frequency = modes.frequency[~modes.rigid][:4]
    rows = np.column_stack([np.arange(1, 5), np.sqrt(1.1) * frequency])
    made = latin_fmu.calibrate(scene, write(tmp_path / "m.csv", "mode,frequency", rows), name)
    assert made[name].value == pytest.approx(1.1 * modulus, rel=1e-3)
    assert made.runs <= 10
    assert "there are none of modes" in made.remarks[0]


@pytest.mark.slow
def test_a_backbone_gives_the_limit_of_friction(tmp_path: Path) -> None:
    """Of the first slider of a chain, in closed form; it goes further than the amplitudes aimed at, and the smallest
    datum is below the curve."""
    scene, amplitude = latin_fmu.scene_from_dict(chain()), np.geomspace(13e-6, 25e-6, 8)
    known = np.array([exact(u)[:2] for u in amplitude])
    data = write(tmp_path / "b.csv", "tip.amplitude,frequency,damping", np.column_stack([amplitude, known]))
    true = scene.load["p0"].pressure
    predicted = Predictor(scene, read_measured([data], scene), [("load.p0.pressure",)], 1, 2)((true,)).predicted
    np.testing.assert_allclose(predicted[:8], known[:, 0], rtol=1e-3)
    np.testing.assert_allclose(predicted[8:], known[:, 1], rtol=0.02, atol=2e-3)
    made = latin_fmu.calibrate(scene, data, f"load.p0.pressure={0.8 * true}")
    assert made.converged
    assert made["load.p0.pressure"].value == pytest.approx(true, rel=0.01)
    assert "there are none of backbone" in made.remarks[0]


def test_a_run_without_derivatives_has_no_slopes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the size of a box there are none, and where they have no unique value none either; the reason is told."""

    def fails(*_: object) -> None:
        raise SolverError("they have no unique value")

    data = write(tmp_path / "d.csv", "time,side.velocity.z", np.array([[1e-6, 1.0], [2e-6, 1.0]]))
    tables = read_measured([data], crushing())
    monkeypatch.setattr(Tangents, "march", fails)
    for name, value, words in (
        ("substructure.upper.box.size.2", 0.01, "substructure.upper.box.size.2: changes the shape"),
        (PRESSURE, TRUTH[1], "no derivatives: they have no unique value"),
    ):
        predictor = Predictor(crushing(), tables, [(name,)], 1, 2)
        assert predictor((value,)).slopes is None
        assert words in predictor.reason


def test_a_run_that_does_not_converge_is_no_prediction(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = crushing().replace("solver.max_iterations", 1).replace("solver.newton", False)
    data = write(tmp_path / "d.csv", "time,side.velocity.z", np.array([[1e-6, 1.0], [2e-6, 1.0]]))
    with pytest.raises(SolverError, match="did not converge"):
        Predictor(scene, read_measured([data], scene), [(PRESSURE,)], 1, 2)(TRUTH[1:])
    monkeypatch.setattr(Predictor, "_of_series", lambda *_: np.full(2, np.nan))
    with pytest.raises(SolverError, match="no finite values at some of the data"):
        Predictor(crushing(), read_measured([data], crushing()), [(PRESSURE,)], 1, 2)(TRUTH[1:])


def test_flagged_derivatives_are_told_with_what_they_predict(tmp_path: Path) -> None:
    """Of one column and one parameter; the change of the data between two runs to the share that they leave of it."""
    data = write(tmp_path / "d.csv", "time,crush.normal_force", np.array([[1e-6, 1.0], [2e-6, 1.0]]))
    predictor = Predictor(crushing(), read_measured([data], crushing()), [(FRICTION,), (PRESSURE,)], 1, 2)
    run = predictor(TRUTH).solution
    assert run is not None
    assert run.sensitivities is not None
    flags = [
        dataclasses.replace(q, flagged=np.array([q.quantity == "crush.impulse", q.quantity == "crush.friction_work"]))
        for q in run.sensitivities.quantities
    ]
    flagged = dataclasses.replace(run, sensitivities=dataclasses.replace(run.sensitivities, quantities=flags))
    (told,) = predictor._flagged(flagged)
    assert told.startswith("crush.normal_force by friction coefficient of crush: contact states change at ")
    # y = p^2 at p = 1 and 1.1, weights 2: the trapezoidal rule is exact, half the slopes leave half the change
    for share, words in ((1.0, " 0 %"), (0.5, " 50 %")):
        done = [Predicted((p,), np.array([p**2] * 3), np.full((3, 1), 2 * p * share), (told,)) for p in (1.0, 1.125)]
        said = _on_derivatives(done[1], done, np.full(3, 2.0), np.ones(1))
        assert said[0] == f"derivatives flagged: {told}"
        assert said[1].endswith(words)
    assert _on_derivatives(dataclasses.replace(done[1], flagged=()), done, np.ones(3), np.ones(1)) == []


def test_secants_that_are_not_made_anew_are_told(tmp_path: Path) -> None:
    made = fitted(tmp_path, 1, secants=True, max_runs=4)
    assert not made.converged
    assert any("intervals are rough" in remark for remark in made.remarks)


def test_a_bound_that_holds_a_parameter_is_told(tmp_path: Path) -> None:
    time, _ = histories()
    data = write(tmp_path / "d.csv", ",".join(("time", *COLUMNS)), np.column_stack([time, noisy(1)]))
    made = latin_fmu.calibrate(crushing(), data, [f"{FRICTION}=0.3:0.2:0.6", PRESSURE], estimate=False)
    assert made[FRICTION].bound == "lower"
    assert np.isnan(made[FRICTION].half)
    assert np.isfinite(made[PRESSURE].half)
    assert "at its lower bound" in "\n".join(made.lines())


def test_the_error_of_the_run_is_a_floor(tmp_path: Path) -> None:
    """The coarse mesh has errors of per cents, far above the scatter of exact data."""
    without, made = fitted(tmp_path), fitted(tmp_path, estimate=True)
    assert made[PRESSURE].value == without[PRESSURE].value
    assert made[PRESSURE].half > 3 * without[PRESSURE].half
    assert made[PRESSURE].shift > made[PRESSURE].half
    assert all(np.isfinite(column.error) for column in made.columns)


def test_intervals_and_shifts_are_those_of_the_weighted_derivatives(tmp_path: Path) -> None:
    """With deviations given, for which those of the noise are the scatter; of one column they are larger, so that its
    error of the run does not count."""
    time, exact_columns = histories()
    sd = 0.02 * np.abs(exact_columns).max(axis=0) * [1.0, 100.0, 1.0]
    rows = [time, *noisy(1).T, *(np.full(len(time), x) for x in sd)]
    header = ",".join(("time", *COLUMNS, *(f"{name}.sd" for name in COLUMNS)))
    data = write(tmp_path / "d.csv", header, np.column_stack(rows))
    made = latin_fmu.calibrate(crushing(), data, [f"{FRICTION}=0.2", f"{PRESSURE}=150e6"])
    predictor = Predictor(crushing(), read_measured([data], crushing()), [(FRICTION,), (PRESSURE,)], 1, 2)
    slopes = predictor([p.value for p in made.parameters]).slopes
    assert slopes is not None
    weights = np.repeat(sd, len(time))
    inverse = np.linalg.pinv(slopes / weights[:, None])
    floor = np.repeat([column.floor for column in made.columns], len(time)) / weights
    residuals = np.concatenate([column.after - column.column.values for column in made.columns]) / weights
    scatter = np.sqrt(residuals @ residuals / (len(residuals) - 2))
    half = inverse * np.maximum(scatter, floor)
    assert (floor > scatter).any()
    assert (floor < scatter).any()
    quantile = stats.t.ppf(0.975, len(residuals) - 2)
    for p, row, bent in zip(made.parameters, half, inverse, strict=True):
        assert p.half == pytest.approx(quantile * np.linalg.norm(row), rel=1e-6)
        assert p.shift == pytest.approx(np.abs(bent) @ floor, rel=1e-6)


def test_frequencies_beside_a_history_have_no_error_of_the_run(tmp_path: Path) -> None:
    modulus = "material.steel.young_modulus"
    modes = write(tmp_path / "m.csv", "mode,frequency", np.array([[1, 2e4], [2, 2e4]]))
    time, exact = histories()
    data = write(tmp_path / "d.csv", f"time,{COLUMNS[2]}", np.column_stack([time, exact[:, 2]]))
    made = latin_fmu.calibrate(crushing(), [data, modes], modulus, max_runs=2)
    assert [np.isfinite(column.error) for column in made.columns] == [True, False]


def test_runs_end_with_the_number_allowed(tmp_path: Path) -> None:
    made = fitted(tmp_path, max_runs=3)
    assert made.runs == 3
    assert not made.converged
    assert "--max-runs" in made.status
    assert made.columns[0].rms(made.columns[0].after) < made.columns[0].rms(made.columns[0].before)


# -- statistics -------------------------------------------------------------------------------------------------------
def test_intervals_are_those_of_a_line() -> None:
    """A straight line through points: covariance of numpy.polyfit, times t."""
    rng = np.random.default_rng(3)
    x = np.linspace(0.0, 1.0, 12)
    y = 2.0 * x + 1.0 + 0.1 * rng.standard_normal(12)
    line, covariance = np.polyfit(x, y, 1, cov=True)
    slopes = np.stack([x, np.ones(12)], axis=1)
    statistics = FitStatistics(slopes, slopes @ line - y, np.zeros(12), np.ones(2, dtype=bool))
    np.testing.assert_allclose(statistics.covariance(), covariance, rtol=1e-9)
    assert statistics.quantile == pytest.approx(2.2281, abs=1e-4)
    assert not statistics.shifts().any()
    # whatever the unit of a parameter is
    scale = np.array([1e-18, 1.0])
    other = dataclasses.replace(statistics, slopes=slopes * scale)
    np.testing.assert_allclose(other.covariance() * np.outer(scale, scale), covariance, rtol=1e-9)


def test_combinations_are_of_relative_changes() -> None:
    """One parameter of value 5 with the slope 0.1: +- t s / (0.5 sqrt(n))."""
    statistics = FitStatistics(np.full((10, 1), 0.1), np.tile([0.1, -0.1], 5), np.zeros(10), np.ones(1, dtype=bool))
    ((interval, _),) = statistics.directions(np.array([5.0]))
    assert interval == pytest.approx(2.2622 * np.sqrt(0.1 / 9) / (0.5 * np.sqrt(10.0)), rel=1e-4)


@pytest.mark.parametrize(("sign", "words"), [(1.0, "more of one with less of the other"), (-1.0, "more of both")])
def test_parameters_that_go_together_are_told(sign: float, words: str) -> None:
    """Both are known, to some per cent, and their errors follow each other."""
    rng = np.random.default_rng(1)
    slope = rng.standard_normal(50)
    slopes = np.stack([slope, sign * slope + 0.2 * rng.standard_normal(50)], axis=1)
    statistics = FitStatistics(slopes, 0.02 * rng.standard_normal(50), np.zeros(50), np.ones(2, dtype=bool))
    sizes = np.sqrt(np.diag(statistics.covariance()))
    said = combinations(statistics, parameters(), np.ones(2), statistics.covariance() / np.outer(sizes, sizes))
    assert said[0].startswith("friction coefficient of a and force of b are correlated (")
    assert said[0].endswith(words)


def test_errors_of_columns_are_those_of_their_quantity() -> None:
    """Of the root mean square of a history of forces, of the largest value of a tension."""
    known = {"crush.force_rms": 0.1, "crush.peak_force": 0.3, "m6.largest_bolt_force": 0.2}
    estimate = SimpleNamespace(by_quantity={q: SimpleNamespace(error=e) for q, e in known.items()})
    for owner, quantity, expected in (("crush", "force", (0.1, True)), ("m6", "tension", (0.2, False))):
        column = Column(f"{owner}.{quantity}", owner, quantity, None, np.ones(2), None)
        error, of_rms = _error_of(estimate, column)  # type: ignore[arg-type]
        assert (error, of_rms) == expected
        table = MeasuredTable("d.csv", "history", np.arange(2.0), (column,))
        fit = ColumnFit(table, column, np.ones(2), np.array([3.0, -4.0]), error, of_rms)
        assert fit.floor == pytest.approx(error * (np.sqrt(12.5) if of_rms else 4.0))


def test_a_floor_above_the_scatter_takes_its_place() -> None:
    slopes = np.ones((10, 1))
    statistics = FitStatistics(slopes, np.tile([0.1, -0.1], 5), np.full(10, 0.5), np.ones(1, dtype=bool))
    assert statistics.covariance()[0, 0] == pytest.approx(0.5**2 / 10)
    assert statistics.shifts()[0] == pytest.approx(0.5)


def test_residuals_that_are_no_noise_or_too_large_are_told() -> None:
    time, sd = np.linspace(0.0, 1.0, 40), np.full(40, 0.1)
    noise = np.random.default_rng(2).standard_normal(40)
    for residual, words in (
        (0.1 * noise, None),
        (0.4 * noise, "times the standard deviations given"),
        (0.1 * np.sin(2 * np.pi * time), "are correlated (0.9"),
    ):
        column = Column("side.velocity.x", "side", "velocity", 0, np.zeros(40), sd)
        table = MeasuredTable("d.csv", "history", time, (column,))
        statistics = FitStatistics(np.ones((40, 1)), residual / sd, np.zeros(40), np.ones(1, dtype=bool))
        said = _on_residuals([ColumnFit(table, column, residual, residual)], statistics)
        assert len(said) == (words is not None)
        assert words is None or words in said[0]


def parameters() -> list[FitParameter]:
    return [FitParameter((name,), 1.0, 0.1, 10.0) for name in ("interface.a.friction_coefficient", "bolt.b.force")]


def test_a_product_is_told_as_what_is_known() -> None:
    """Data that depend on the product of two parameters alone."""
    rng = np.random.default_rng(1)
    slope = rng.standard_normal(50)
    slopes = np.stack([slope, slope + 1e-4 * rng.standard_normal(50)], axis=1)
    statistics = FitStatistics(slopes, 0.02 * rng.standard_normal(50), np.zeros(50), np.ones(2, dtype=bool))
    sizes = np.sqrt(np.diag(statistics.covariance()))
    said = combinations(statistics, parameters(), np.ones(2), statistics.covariance() / np.outer(sizes, sizes))
    assert said[0].startswith("not determined (+-")
    assert "+10 % friction coefficient of a, -10 % force of b" in said[0] or (
        "+10 % force of b, -10 % friction coefficient of a" in said[0]
    )
    assert "best determined: (friction coefficient of a)^1 (force of b)^1" in said[-1]


def test_a_parameter_without_effect_is_not_known() -> None:
    rng = np.random.default_rng(1)
    slopes = np.stack([rng.standard_normal(20), np.zeros(20)], axis=1)
    statistics = FitStatistics(slopes, 0.02 * rng.standard_normal(20), np.zeros(20), np.ones(2, dtype=bool))
    assert np.isinf(statistics.covariance()[1, 1])
    assert np.isfinite(statistics.covariance()[0, 0])
    said = combinations(statistics, parameters(), np.ones(2), np.eye(2))
    assert said[0] == "not determined by these data at all: force of b"


# -- the search -------------------------------------------------------------------------------------------------------
class Decay:
    """a exp(-b t) at some instants, without derivatives; fails where a is above a limit."""

    reason = ""

    time = np.linspace(0.0, 2.0, 15)

    def __init__(self, most: float = np.inf) -> None:
        self._most = most

    def __call__(self, values: tuple[float, ...]) -> Predicted:
        if values[0] > self._most:
            raise SolverError("too large")
        return Predicted(values, values[0] * np.exp(-values[1] * self.time), None)


def search(most: float = np.inf, runs: int = 20) -> LeastSquares:
    data = 3.0 * np.exp(-1.5 * Decay.time) + 0.01 * np.random.default_rng(0).standard_normal(15)
    return LeastSquares(Decay(most), parameters(), data, runs, None)  # type: ignore[arg-type]


def test_secants_find_the_least_squares() -> None:
    from scipy.optimize import curve_fit

    made = search()
    found = made.run(np.ones(2))
    best, covariance = curve_fit(lambda t, a, b: a * np.exp(-b * t), Decay.time, made._data, [1.0, 1.0])
    sizes = np.sqrt(np.diag(covariance))
    assert found.converged
    assert len(made.known) <= 20
    np.testing.assert_allclose(found.best.values, best, atol=0.2 * sizes.min())
    # made anew at the end, over 5 %
    a, b = found.best.values
    decay = np.exp(-b * Decay.time)
    exact_slopes = np.stack([decay, -a * Decay.time * decay], axis=1)
    np.testing.assert_allclose(found.slopes, exact_slopes, atol=0.05 * np.abs(exact_slopes).max())


def test_a_fit_goes_on_where_secants_made_anew_lead_further() -> None:
    """From secants of the wrong sign, which lead nowhere."""
    made = search(runs=40)
    made.renew(np.ones(2))
    assert made._secants is not None
    made._secants = -made._secants
    found = made.run(np.ones(2))
    assert found.converged
    assert found.best.values == pytest.approx((3.0, 1.5), rel=0.05)


def test_columns_are_weighted_by_their_residuals() -> None:
    """Where these differ much: one of 1, one of 4; not a column whose deviations are given."""
    time, ones = np.arange(4.0), np.ones(4)
    for sizes, sd, factors in (
        ((1.0, 4.0), None, (1.0, 4.0)),
        ((1.0, 1.4), None, None),
        ((1.0, 4.0), ones, (1.0, 1.0)),
    ):
        columns = tuple(
            Column(f"side.velocity.{'xy'[i]}", "side", "velocity", i, 0 * ones, sd if i else None) for i in range(2)
        )
        made = LeastSquares(Decay(), parameters(), np.zeros(8), 9, None)  # type: ignore[arg-type]
        best = Predicted((1.0, 1.0), np.repeat(sizes, 4) * np.tile([1.0, -1.0], 4), None)
        assert _weigh([MeasuredTable("d.csv", "history", time, columns)], made, best) == (factors is not None)
        np.testing.assert_allclose(made.weights, np.repeat(factors or (1.0, 1.0), 4))


def test_a_trial_that_fails_is_cut_back() -> None:
    made = search(most=3.1)
    found = made.run(np.array([0.5, 4.0]))
    assert found.best.values[0] == pytest.approx(3.0, abs=0.05)
    # secants are made at the end, beside the best values
    failed = [values for values, predicted in made.known.items() if predicted is None]
    assert failed[0][1] > 1.1 * found.best.values[1]


@pytest.mark.parametrize(("high", "most"), [(10.0, np.inf), (1.02, np.inf), (10.0, 1.02)])
def test_secants_are_made_towards_the_other_side_at_a_bound_or_a_failure(high: float, most: float) -> None:
    """The derivative of a exp(-b t) by a is exp(-b t), whichever side it is taken from."""
    limited = [dataclasses.replace(parameters()[0], high=high), parameters()[1]]
    made = LeastSquares(Decay(most), limited, np.ones(15), 9, None)  # type: ignore[arg-type]
    slopes = made.slopes(np.ones(2))
    np.testing.assert_allclose(slopes[:, 0], np.exp(-Decay.time), rtol=1e-9)
    assert made.done[-1].values == pytest.approx((1.0, 1.05))
    assert all(values[0] <= high for values in made.known)


def test_the_first_run_must_not_fail() -> None:
    with pytest.raises(SolverError, match="too large"):
        search(most=0.5).run(np.ones(2))


def test_only_the_best_run_keeps_its_results() -> None:
    """Results of a run may be large; trials of a fit are many."""
    made = search()
    heavy = dataclasses.replace(made._predictor((1.0, 1.0)), solution=object())  # type: ignore[arg-type]
    made.known = {(1.0, 1.0): heavy, (2.0, 1.0): dataclasses.replace(heavy, values=(2.0, 1.0))}
    made.at(np.array([3.0, 1.5]))
    assert [e.solution is None for e in made.done] == [True, True, True]
    assert made.best().values == (3.0, 1.5)
