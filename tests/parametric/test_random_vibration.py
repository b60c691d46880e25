"""Random vibration: the linear answer beside Miles and exact integrals, windows beside single runs, bands beside the
distributions that they are of."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

import latin_fmu
from latin_fmu.building import without_scheme
from latin_fmu.cli import main
from latin_fmu.errors import InputError
from latin_fmu.modal.random_response import LinearResponse, random_response
from latin_fmu.parametric.ensembles import mean_band, median_band, positive_band, rate_band
from latin_fmu.parametric.point import Grid, Parameter, Plan, PointSolver
from latin_fmu.parametric.random_figure import random_figure
from latin_fmu.parametric.random_vibration import random_vibration, summed_crossings
from latin_fmu.parametric.window_statistics import RunSignal, WindowEvaluation, WindowSignal, signals_of
from latin_fmu.scene.random_bases import at_window

LEVEL = 4.0  # (m/s2)^2/Hz


def oscillator(**keys: Any) -> latin_fmu.Scene:
    """A mass on a light column with 2 % of critical damping at 200 Hz, under white noise up to 2 kHz."""
    data: dict[str, Any] = {
        "name": "oscillator",
        "material": {
            "light": {"young_modulus": 1.0e7, "poisson_ratio": 0.0, "density": 1.0}
            | {"damping_ratios": {"frequencies": [20.0, 2000.0], "ratios": [0.02, 0.02]}}
        },
        "substructure": {"column": {"material": "light", "box": {"size": [0.02, 0.02, 0.02], "elements": [1, 1, 1]}}},
        "point_mass": {"m": {"face": "column.zmax", "mass": 0.1267}},
        "boundary": {
            "base": {"type": "acceleration", "face": "column.zmin", "components": ["x", "y", "z"], "value": [0, 0, 1.0]}
            | {"law": {"type": "psd", "frequency": [10.0, 2000.0], "density": [LEVEL, LEVEL]}},
            "guide": {"type": "fixed", "face": "column.zmax", "components": ["x", "y"]},
        },
        "sensor": {"mass": {"face": "column.zmax"}},
        "time": {"end": 1.0, "step": 1e-4},
    }
    return latin_fmu.scene_from_dict(data | keys)


def pressed(propagator: str = "modal", **keys: Any) -> latin_fmu.Scene:
    """A block pressed on another one that a base drives: a joint that stays closed."""
    ratios = {"frequencies": [100.0, 1000.0], "ratios": [0.04, 0.04]}
    soft = {"young_modulus": 2e8, "poisson_ratio": 0.3, "density": 2000.0, "damping_ratios": ratios}
    box = {"size": [0.02, 0.02, 0.04], "elements": [2, 2, 2]}
    data: dict[str, Any] = {
        "name": "pressed",
        "material": {"soft": soft},
        "substructure": {
            "lower": {"material": "soft", "box": box},
            "upper": {"material": "soft", "box": box | {"origin": [0.0, 0.0, 0.04]}},
        },
        "interface": {"joint": {"sides": ["lower.zmax", "upper.zmin"], "friction_coefficient": 0.6}},
        "gravity": {"acceleration": [0.0, 0.0, -9000.0]},
        "boundary": {
            "base": {
                "type": "acceleration",
                "face": "lower.zmin",
                "components": ["x", "y", "z"],
                "value": [0.0, 0.0, 1.0],
                "law": {"type": "psd", "frequency": [60.0, 1000.0], "density": [1.0, 1.0]},
            }
        },
        "sensor": {"top": {"face": "upper.zmax"}},
        "solver": {"propagator": propagator, "tolerance": 1e-4},
        "time": {"end": 0.2, "step": 1e-4, "start": {"type": "static"}},
    }
    return latin_fmu.scene_from_dict(data | keys)


def test_the_linear_answer_beside_miles_and_an_exact_integral() -> None:
    made = oscillator()
    response = random_response(made)
    modes = latin_fmu.vibration_modes(made, count=4)
    along = int(modes.effective_mass[:, 2].argmax())  # beside modes that rock
    natural, damping = float(modes.frequency[along]), float(modes.damping.bodies[along])  # type: ignore[union-attr]
    assert damping == pytest.approx(0.02, rel=0.05)

    problem = without_scheme(made)
    (column,) = (member for cls in problem.classes for member in cls.members)
    viscosity = problem.bodies["column"].shape.material.damping.viscosity
    static = float(modes.static_frequency[along])

    def square(f: float) -> float:
        """|H|^2 of a mass on a spring whose stiffness follows the material over frequency."""
        s = 2j * np.pi * f
        stiff = 1.0 + viscosity * s + complex(column.branches.rise(s))
        return float(abs(stiff / (stiff - (f / static) ** 2)) ** 2)

    ends = natural * np.array([1 - 8 * damping, 1 - damping, 1, 1 + damping, 1 + 8 * damping])
    exact, _ = quad(square, 10.0, 2000.0, points=[*ends], limit=500, epsrel=1e-9)
    rms = response.signals["mass.acceleration.z"].rms
    assert rms == pytest.approx(np.sqrt(LEVEL * exact), rel=1e-4)
    miles = np.sqrt(0.5 * np.pi * natural * LEVEL / (2 * damping))
    assert rms == pytest.approx(miles, rel=0.02)
    moved = response.signals["mass.displacement.z"].rms
    assert moved == pytest.approx(miles / (2 * np.pi * natural) ** 2, rel=0.02)
    slowest = (2 * np.pi * modes.frequency * modes.damping.bodies).min()  # type: ignore[union-attr]
    assert response.settled == pytest.approx(np.log(20.0) / slowest, rel=1e-3)


@pytest.mark.slow
def test_windows_of_an_oscillator_have_the_rms_of_miles() -> None:
    found = random_vibration(oscillator(time={"end": 1.0, "step": 2e-4}), 24)
    of = found.signals["mass.acceleration.z"]
    assert of.rms.low < of.linear.rms < of.rms.high  # type: ignore[union-attr]
    assert of.of_linear == pytest.approx(1.0, abs=0.05)
    assert of.kurtosis == pytest.approx(3.0, abs=0.3)
    # Rice: crossings of three standard deviations are exp(-9/2) of those of the mean
    assert of.rate_at(3.0).low <= of.rate_at(0.0).value * np.exp(-4.5) <= of.rate_at(3.0).high
    base = found.signals["base.acceleration"].rms
    assert base.low < found.specified["base"] < base.high
    inside = (found.frequency > 150.0) & (found.frequency < 250.0)
    linear = np.interp(found.frequency[inside], found.linear.frequency, of.linear.spectrum)  # type: ignore[union-attr]
    assert of.spectrum.value[inside].sum() == pytest.approx(linear.sum(), rel=0.1)


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("propagator", ["modal", "direct"])
def test_closed_joints_have_the_rms_of_the_linear_answer(propagator: str) -> None:
    """The band holds the mode at 1 kHz, which has 40 steps a period; the standard deviation of the rms is 0.6 %."""
    boundary = dict(pressed().tables()["boundary"])
    boundary["base"]["law"] = {"type": "psd", "frequency": [200.0, 2000.0], "density": [1.0, 1.0]}
    time = {"end": 0.12, "step": 2.5e-5, "start": {"type": "static"}}
    found = random_vibration(pressed(propagator, boundary=boundary, time=time), 1500)
    for name in ("top.acceleration.z", "top.displacement.z"):
        assert found.signals[name].of_linear == pytest.approx(1.0, abs=0.02), name


@pytest.mark.parametrize("propagator", ["modal", "direct"])
def test_a_window_is_the_run_of_its_scene(propagator: str) -> None:
    made = pressed(propagator)
    parameter = Parameter("boundary.base.law.window", (0, 1, 2))
    how = WindowEvaluation(0.1, 100, 2000.0)
    plan = Plan(Grid(made.tables(), ".", (parameter,), True), evaluation=how)
    first, other = PointSolver(plan), PointSolver(Plan.of_text(plan.text()))
    records = [first.solve((i,)) for i in (0, 2, 1)]
    again = [other.solve((i,)) for i in (1, 2)]
    for record, repeated in ((records[1], again[1]), (records[2], again[0])):
        for a, b in zip(record["window"], repeated["window"], strict=True):
            assert a["name"] == b["name"]
            # but for the size that tolerances refer to
            assert a["moments"] == pytest.approx(b["moments"], rel=1e-3, abs=1e-9 + 1e-4 * abs(b["moments"][1]))
    lone = latin_fmu.solve(at_window(made, 2))
    alone = {s.name: WindowSignal.of(s, lone.time, how) for s in signals_of(at_window(made, 2), lone.outcome)}
    for plain in records[1]["window"]:
        if plain["name"].startswith(("top.acceleration.z", "top.displacement.z", "joint.normal", "base")):
            assert plain["moments"][1] == pytest.approx(alone[plain["name"]].moments[1], rel=1e-4), plain["name"]


def test_displacements_are_relative_to_the_base() -> None:
    made = oscillator(sensor={"foot": {"face": "column.zmin"}, "mass": {"face": "column.zmax"}})
    solution = latin_fmu.solve(made)
    found = {s.name: s.values for s in signals_of(made, solution.outcome)}
    base = solution.sensors["foot"].displacement[:, 2]
    assert np.abs(found["foot.displacement.z"]).max() < 1e-3 * np.abs(base).max()
    # that of the mass: a_rms / omega^2
    assert found["mass.displacement.z"].std() == pytest.approx(
        found["mass.acceleration.z"].std() / (2 * np.pi * 210.0) ** 2, rel=0.05
    )


def test_bands_cover_what_they_are_of() -> None:
    """5,000 bands of 50 windows: mean squares of few lines, largest values, counts."""
    random = np.random.default_rng(7)
    squares = random.chisquare(8, size=(5000, 50))
    covered = [band.low <= 8.0 <= band.high for band in map(positive_band, squares)]
    assert np.mean(covered) == pytest.approx(0.95, abs=0.015)
    covered = [band.low <= 8.0 <= band.high for band in map(mean_band, squares)]
    assert np.mean(covered) == pytest.approx(0.95, abs=0.015)
    median = float(np.median(random.gumbel(size=10**6)))
    peaks = random.gumbel(size=(5000, 50))
    covered = [band.low <= median <= band.high for band in map(median_band, peaks)]
    assert 0.95 <= np.mean(covered) <= 0.98
    counts = random.poisson(0.2, size=(5000, 50))
    covered = [band.low <= 2.0 <= band.high for band in (rate_band(c, 0.1) for c in counts)]
    assert 0.95 <= np.mean(covered) <= 0.99
    assert np.isnan(median_band([1.0, 2.0, 3.0]).low)


def test_crossings_of_windows_of_any_size_are_summed_up() -> None:
    time = np.linspace(0.0, 1.0, 10_001)
    how = WindowEvaluation(0.1, 100, 1000.0)
    # from 0.1 s on, 9 and 18 periods; the values begin at 0
    signals = [
        RunSignal("a.b", "m", "", np.sin(2 * np.pi * 10 * time)),
        RunSignal("a.b", "m", "", 5.0 * np.sin(2 * np.pi * 20 * time)),
    ]
    levels, counts = summed_crossings([WindowSignal.of(signal, time, how) for signal in signals])
    for k, size, periods in ((0, 1.0, 9), (1, 5.0, 18)):
        inside = np.abs(levels) < 0.95 * size
        assert (np.abs(counts[k][inside] - periods) <= 1).all()
        assert (counts[k][np.abs(levels) > 1.05 * size] == 0).all()
    assert np.diff(levels) == pytest.approx(levels[1] - levels[0])
    assert 5.0 / np.sqrt(2.0) / 16.0 < levels[1] - levels[0] <= 5.0 / np.sqrt(2.0) / 8.0
    # jumps over many levels, in windows whose levels are 1, 1/8 and 1/64 apart: each level by itself
    rng = np.random.default_rng(3)
    noises = [8.0 * size * rng.normal(size=len(time)) for size in (1.0, 0.125, 1.0 / 64.0)]
    noises = [np.concatenate([[0.0], noise[1:]]) for noise in noises]
    levels, counts = summed_crossings([WindowSignal.of(RunSignal("a.b", "m", "", x), time, how) for x in noises])
    for x, row in zip(noises, counts, strict=True):
        late = x[time >= how.begin]
        counted = [int(((late[:-1] < level) & (late[1:] >= level)).sum()) for level in levels]
        assert row.tolist() == counted


def test_resonances_that_steps_shift_are_named() -> None:
    band, step = np.array([10.0, 450.0]), 8e-4
    # the third is wide, the last one beyond the band
    natural, ratio = np.array([50.0, 200.0, 400.0, 500.0]), np.array([0.02, 0.02, 0.2, 0.01])
    response = LinearResponse(band, {}, natural, ratio)
    assert response.shifted(1e-4) is None
    assert LinearResponse(band, {}, natural[:0], ratio[:0]).shifted(step) is None
    found = response.shifted(step)
    assert found is not None
    # steps of average acceleration, (I - h A / 2)^-1 (I + h A / 2), turn the state by less than omega h
    omega = 2 * np.pi * 200.0
    half = 0.5 * step * np.array([[0.0, 1.0], [-(omega**2), 0.0]])
    turned = np.linalg.eigvals(np.linalg.solve(np.eye(2) - half, np.eye(2) + half))
    exact = 1.0 - np.abs(np.angle(turned)).max() / (omega * step)
    assert found == (200.0, pytest.approx(exact, rel=0.25))


def test_a_study_with_coarse_steps_says_so() -> None:
    fine = random_vibration(pressed(), 2)
    coarse = random_vibration(pressed(time={"end": 0.2, "step": 4e-4, "start": {"type": "static"}}), 2)
    assert (fine.shifted, fine.report()["shifted"]) == (None, None)
    assert coarse.shifted is not None
    assert any("caution: time steps lower the resonance at" in line for line in coarse.lines())
    assert coarse.report()["shifted"] == {"frequency": coarse.shifted[0], "by": coarse.shifted[1]}


def test_windows_that_are_too_short_are_refused() -> None:
    with pytest.raises(InputError, match="become stationary after"):
        random_vibration(oscillator(time={"end": 0.45, "step": 1e-4}), 4)
    with pytest.raises(InputError, match="number of windows"):
        random_vibration(oscillator(), 1)
    with pytest.raises(InputError, match="lines of the spectra"):
        random_vibration(oscillator(), 2, resolution=0.1)
    undamped = {"light": {"young_modulus": 1.0e7, "poisson_ratio": 0.0, "density": 1.0}}
    with pytest.raises(InputError, match="follows from the damping"):
        random_vibration(oscillator(material=undamped), 2)
    boundary = {"base": {"type": "fixed", "face": "column.zmin"}}
    with pytest.raises(InputError, match="no random vibration"):
        random_vibration(oscillator(boundary=boundary), 2)


def test_supports_that_do_not_follow_have_no_linear_answer() -> None:
    boundary = dict(oscillator().tables()["boundary"])
    boundary["guide"] = {"type": "fixed", "face": "column.zmax", "components": ["z"]}
    found = random_vibration(oscillator(boundary=boundary), 2, startup=0.3)
    assert found.linear is None
    assert "no linear answer: boundary.guide: does not follow the base" in "\n".join(found.lines())


def test_the_command_writes_continues_and_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, out = tmp_path / "scene.toml", tmp_path / "out.nc"
    file.write_text(pressed().text())
    capsys.readouterr()
    assert main(["random", str(file), "--windows", "6", "--jobs", "1", "-o", str(out), "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert (data["windows"], data["left_out"]) == (6, 0)
    of = data["signals"]["top.acceleration.z"]
    assert of["rms_low"] < of["rms"] < of["rms_high"] < of["peak_low"] < of["peak"] < of["peak_high"] <= of["largest"]
    assert of["three_sigma"] == pytest.approx(3 * of["rms"])
    with latin_fmu.open_results(out) as tree:
        stored = tree["signals/top/acceleration_z"]
        assert float(stored["rms"]) == pytest.approx(of["rms"])
        assert stored["spectrum"].attrs["units"] == "m2 s-4 Hz-1"
        power = float(np.trapezoid(stored["spectrum"], stored["frequency"]))
        assert np.sqrt(power) == pytest.approx(of["rms"], rel=0.1)
        panels = random_figure(tree).axes
        assert any("top.acceleration.z" in panel.get_ylabel() for panel in panels)
    assert main(["plot", str(out), "-o", str(tmp_path / "out.png"), "--quantity", "joint.normal_force"]) == 0
    assert main(["plot", str(out), "-o", str(tmp_path / "no.png"), "--quantity", "joint.force"]) == 2
    assert "no signal of this name" in capsys.readouterr().err
    assert main(["random", str(file), "--windows", "2", "--jobs", "1", "-o", str(out), "--quiet"]) == 0
    text = capsys.readouterr().out
    assert "peaks have bands from 6 windows on" in text
    assert "modes of the assembly" in text
