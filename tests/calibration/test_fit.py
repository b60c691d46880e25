"""Fits of parameters: truth, intervals, secants, what the data do not determine."""

from __future__ import annotations

import dataclasses
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.calibration.data import read_measured
from latin_fmu.calibration.prediction import Predicted, Predictor
from latin_fmu.calibration.report import Calibration, FitParameter, FitStatistics, combinations
from latin_fmu.calibration.study import LeastSquares
from latin_fmu.errors import SolverError
from tests.scenes import MODELS

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


def test_secants_end_where_derivatives_do(tmp_path: Path) -> None:
    """Values to a tenth of the interval, intervals to a fifth."""
    exact, secants = fitted(tmp_path, 1), fitted(tmp_path, 1, secants=True)
    assert secants.runs <= 14
    assert "derivatives by secants: as requested" in secants.remarks[0]
    for a, b in zip(exact.parameters, secants.parameters, strict=True):
        assert b.value == pytest.approx(a.value, abs=0.2 * a.half)
        assert b.half == pytest.approx(a.half, rel=0.2)


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
    np.testing.assert_allclose(tied.predicted, each.predicted, rtol=1e-6, atol=1e-9)


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


def test_a_floor_above_the_scatter_takes_its_place() -> None:
    slopes = np.ones((10, 1))
    statistics = FitStatistics(slopes, np.tile([0.1, -0.1], 5), np.full(10, 0.5), np.ones(1, dtype=bool))
    assert statistics.covariance()[0, 0] == pytest.approx(0.5**2 / 10)
    assert statistics.shifts()[0] == pytest.approx(0.5)


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


def test_a_trial_that_fails_is_cut_back() -> None:
    made = search(most=3.5)
    found = made.run(np.ones(2))
    assert found.best.values[0] == pytest.approx(3.0, abs=0.05)
    assert any(e is None for e in made.known.values()) or len(made.known) < 20


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
