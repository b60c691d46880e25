"""Shock response spectra: closed forms, an ODE solver, the published filter; scenes, files and the command."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import firwin, oaconvolve

import latin_fmu
from latin_fmu.accuracy.estimate import estimate_error
from latin_fmu.cli import main
from latin_fmu.results.spectra import shock_response_spectrum, spectrum_error
from latin_fmu.shock.oscillators import ramp_filter

from .test_sensors import pressed

TAU = 0.011  # s, duration of the half sine
STEP = TAU / 500


def half_sine(step: float = STEP, peak: float = 1.0) -> np.ndarray:
    t = np.arange(round(TAU / step) + 1) * step
    return peak * np.sin(np.pi * t / TAU)


def undamped_half_sine(f: float) -> tuple[float, float]:
    """Primary and residual spectrum of a unit half sine: largest of (sin W t - b sin w t) / (1 - b^2), b = W / w, until
    TAU, and 2 b cos(pi / (2 b)) / (1 - b^2) after it."""
    b = 0.5 / (f * TAU)
    t = np.linspace(0, TAU, 40001)
    during = (np.sin(np.pi * t / TAU) - b * np.sin(2 * np.pi * f * t)) / (1 - b * b)
    return float(np.abs(during).max()), abs(2 * b * math.cos(np.pi / (2 * b)) / (1 - b * b))


def test_half_sine_without_damping() -> None:
    f = np.geomspace(0.04, 9.7, 40) / TAU
    spectrum = shock_response_spectrum(half_sine(), STEP, f, math.inf)
    primary, residual = np.array([undamped_half_sine(x) for x in f]).T
    assert spectrum.acceleration[1] == pytest.approx(primary, rel=0.005)
    assert spectrum.acceleration[2] == pytest.approx(residual, rel=0.005, abs=0.002)
    assert spectrum.acceleration[0] == pytest.approx(np.maximum(primary, residual), rel=0.005)
    # without damping the pseudo-velocity is the absolute acceleration over omega
    assert spectrum.pseudo_velocity * (2 * np.pi * f) == pytest.approx(spectrum.acceleration, rel=1e-9)


def by_integration(f: float, quality: float) -> np.ndarray:
    """(kind, response) of a half sine, absolute acceleration and pseudo-velocity, by an adaptive ODE solver."""
    omega, damping = 2 * np.pi * f, 0.5 / quality
    end = TAU + 1.5 / f

    def rate(t: float, state: np.ndarray) -> list[float]:
        base = math.sin(np.pi * t / TAU) if t < TAU else 0.0
        return [state[1], -base - 2 * damping * omega * state[1] - omega**2 * state[0]]

    solved = solve_ivp(
        rate, (0, end), [0.0, 0.0], rtol=1e-9, atol=1e-14, max_step=min(TAU, 1 / f) / 30, dense_output=True
    )
    parts = [np.linspace(0, TAU, 6001), np.linspace(TAU, end, 6001)]
    rows, signed = [], []
    for t in parts:
        z, v = solved.sol(t)
        both = np.stack([-2 * damping * omega * v - omega**2 * z, -omega * z])
        rows.append(np.abs(both).max(axis=1))
        signed.append([both.max(axis=1), -both.min(axis=1)])
    primary, residual = np.array(rows)
    return np.stack([np.maximum(primary, residual), primary, residual, *np.maximum(*signed).clip(min=0.0)], axis=1)


@pytest.mark.parametrize("quality", [10.0, 2.0, 0.8])
@pytest.mark.parametrize("times", [0.11, 0.9, 6.3])
def test_half_sine_with_damping_by_another_route(times: float, quality: float) -> None:
    f = times / TAU
    spectrum = shock_response_spectrum(half_sine(), STEP, [f], quality)
    expected = by_integration(f, quality)
    assert spectrum.acceleration[:, 0] == pytest.approx(expected[0], rel=0.01, abs=1e-4)
    assert spectrum.pseudo_velocity[:, 0] == pytest.approx(expected[1], rel=0.01, abs=1e-6)
    omega = 2 * np.pi * f
    assert spectrum.relative_displacement == pytest.approx(spectrum.pseudo_velocity / omega)
    assert spectrum.equivalent_static_acceleration == pytest.approx(spectrum.pseudo_velocity * omega)


def test_a_residual_begins_where_the_pulse_ends() -> None:
    """Samples after a pulse, as records have them, make no difference."""
    f = np.geomspace(0.1, 9.0, 30) / TAU
    alone = shock_response_spectrum(half_sine(), STEP, f, interpolation="lines")
    for after in (1, 5000):
        record = np.concatenate([half_sine(), np.zeros(after)])
        longer = shock_response_spectrum(record, STEP, f, interpolation="lines")
        assert longer.acceleration == pytest.approx(alone.acceleration, rel=2e-3)


@pytest.mark.parametrize("damping", [0.0, 0.05, 0.4])
@pytest.mark.parametrize("angle", [1e-3, 0.05, 0.9, 1.1, 3.0])
def test_filter_of_the_absolute_acceleration_is_smallwoods(angle: float, damping: float) -> None:
    """b = 1 - S', 2 (S' - C), E^2 - S' with S' = S / K (Smallwood 1981, ISO 18431-4)."""
    decay, k = math.exp(-damping * angle), angle * math.sqrt(1 - damping**2)
    c, s = decay * math.cos(k), decay * math.sin(k) / k
    _, numerator, denominator = ramp_filter(angle, damping)
    assert numerator == pytest.approx([1 - s, 2 * (s - c), decay**2 - s], rel=1e-9)
    assert denominator == pytest.approx([1.0, -2 * c, decay**2], rel=1e-15)


def test_maxima_between_the_samples_are_met() -> None:
    """Straight lines between few samples, against the same lines sampled 200 times as often."""
    coarse = np.random.default_rng(2).normal(size=(25, 2))
    places = np.arange(24 * 200 + 1) / 200
    lines = np.stack([np.interp(places, np.arange(25), column) for column in coarse.T], axis=1)
    f = np.array([0.13, 0.27, 0.36, 0.4])
    pairs = (coarse, 1.0), (lines, 1 / 200)
    few, many = (shock_response_spectrum(a, step, f, 20.0, interpolation="lines") for a, step in pairs)
    assert few.acceleration == pytest.approx(many.acceleration, rel=0.006)
    assert few.pseudo_velocity == pytest.approx(many.pseudo_velocity, rel=0.006)


@pytest.mark.parametrize("ratio", [1e-6, 1e-4])
def test_low_frequencies_meet_the_jump_of_velocity(ratio: float) -> None:
    """An oscillator far slower than the pulse has nearly the pseudo-velocity of the jump, 2 tau / pi."""
    f = ratio / STEP
    expected = 2 * TAU / np.pi * abs(math.cos(np.pi * f * TAU)) / (1 - (2 * f * TAU) ** 2)
    spectrum = shock_response_spectrum(half_sine(), STEP, [f], math.inf)
    assert spectrum.pseudo_velocity[2, 0] == pytest.approx(expected, rel=1e-4)


def test_a_step_has_twice_its_height() -> None:
    """The base accelerates from the first sample on; damped: 1 + exp(-pi zeta / sqrt(1 - zeta^2))."""
    for quality, factor in ((math.inf, 2.0), (5.0, 1 + math.exp(-math.pi * 0.1 / math.sqrt(0.99)))):
        spectrum = shock_response_spectrum(np.full((400, 2), [3.0, -1.0]), 1e-3, [11.0, 390.0], quality)
        assert spectrum.pseudo_velocity[1, 0] * 2 * np.pi * 11.0 == pytest.approx([3 * factor, factor], rel=5e-3)
        assert spectrum.pseudo_velocity[1, 1] * 2 * np.pi * 390.0 == pytest.approx([3 * factor, factor], rel=6e-3)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"frequencies": [100.0, 6e4]}, ("60000 Hz", "1.818e+04 Hz", "at most 6.667e-06 s (it is", "2.2e-05 s")),
        ({"frequencies": [0.0]}, ("not a positive frequency",)),
        ({"quality": 0.5}, ("quality", "Q > 0.5")),
        ({"step": 0.0}, ("not a positive time",)),
        ({"acceleration": [1.0]}, ("two or more finite samples",)),
        ({"acceleration": [1.0, math.nan]}, ("two or more finite samples",)),
    ],
)
def test_refused_with_numbers(changes: dict[str, Any], words: tuple[str, ...]) -> None:
    given: dict[str, Any] = {"acceleration": half_sine(), "step": STEP, "frequencies": [100.0]} | changes
    with pytest.raises(latin_fmu.InputError) as refused:
        latin_fmu.shock_response_spectrum(**given)
    for word in words:
        assert word in str(refused.value)


def band_limited(seed: int, finer: int = 64) -> np.ndarray:
    """Bursts that start and end at rest, a sample a second ``finer`` times as dense, without anything above 0.4 Hz."""
    rng = np.random.default_rng(seed)
    t = np.arange(600 * finer) / finer
    made = np.zeros_like(t)
    for _ in range(12):
        size, f, decay, phase = rng.normal(), rng.uniform(0.005, 0.45), rng.uniform(5, 60), rng.uniform(0, 2 * np.pi)
        since = np.maximum(t - rng.uniform(40, 200), 0.0)
        made += size * np.exp(-since / decay) * (1 - np.exp(-since / 2)) * np.sin(2 * np.pi * f * since + phase)
    low_pass = firwin(96 * finer + 1, 2 * 0.36 / finer, window=("kaiser", 9.0))
    return oaconvolve(made, low_pass, mode="same")


@pytest.mark.parametrize("seed", range(10))
def test_spectra_of_band_limited_records(seed: int) -> None:
    """From a hundredth to a quarter of the sampling rate, against the same signal sampled 64 times finer."""
    signal, f = band_limited(seed), np.geomspace(0.01, 0.25, 24)
    exact = shock_response_spectrum(signal, 1 / 64, f, interpolation="lines")
    made = shock_response_spectrum(signal[::64], 1.0, f, interpolation="band")
    assert made.interpolation == "band"
    assert made.acceleration[0] == pytest.approx(exact.acceleration[0], rel=0.005)
    assert made.pseudo_velocity[0] == pytest.approx(exact.pseudo_velocity[0], rel=0.005)
    lines = shock_response_spectrum(signal[::64], 1.0, f, interpolation="lines")
    assert np.abs(lines.acceleration[0] / exact.acceleration[0] - 1).max() > 0.05


@pytest.mark.parametrize(
    ("signal", "samples", "jump"),
    [
        (lambda t: np.where(t < 40, np.sin(np.pi * np.minimum(t / 40, 1)), 0.0), 200, False),
        (lambda t: t / 40, 41, True),  # terminal-peak sawtooth
        (np.ones_like, 41, True),
        (lambda t: 0.3 + np.exp(-t / 30) * np.sin(0.5 * t), 200, True),
    ],
)
@pytest.mark.parametrize("quality", [10.0, 50.0])
def test_spectra_of_pulses_and_jumps(signal: Any, samples: int, jump: bool, quality: float) -> None:
    """Up to a tenth of the sampling rate; a record that starts or ends with a jump has the larger of both readings."""
    t, f = np.arange((samples - 1) * 64 + 1) / 64, np.geomspace(0.01, 0.1, 16)
    exact = shock_response_spectrum(signal(t), 1 / 64, f, quality, interpolation="lines")
    made = shock_response_spectrum(signal(t)[::64], 1.0, f, quality)
    lines = shock_response_spectrum(signal(t)[::64], 1.0, f, quality, interpolation="lines")
    assert made.interpolation == ("larger of band and lines" if jump else "band")
    assert made.acceleration[0] == pytest.approx(exact.acceleration[0], rel=0.01)
    assert not jump or (made.acceleration >= lines.acceleration * (1 - 1e-12)).all()


def test_unknown_interpolations_are_refused() -> None:
    with pytest.raises(latin_fmu.InputError, match="interpolation"):
        shock_response_spectrum(half_sine(), STEP, [100.0], interpolation="cubic")  # type: ignore[arg-type]


def test_srs_of_a_record(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A file of a recorder with a decimal comma: interpolated in its band; one with a jump by both readings."""
    signal = band_limited(3)[::64]
    rows = "".join(f"{1e-1 * i:.1f};{9.0 * a:.9f}\n".replace(".", ",") for i, a in enumerate(signal))
    (tmp_path / "record.csv").write_text("Zeit (ms);a (g)\n" + rows)
    options = ["--lowest", "100", "--highest", "2500", "-o", str(tmp_path / "made")]
    assert main(["srs", str(tmp_path / "record.csv"), *options]) == 2
    assert 'value_unit = "g"' in capsys.readouterr().err
    assert main(["srs", str(tmp_path / "record.csv"), *options, "--value-unit", "g"]) == 0
    said = capsys.readouterr().out
    assert "decimal comma, times in ms by the header" in said
    assert "interpolated in its band" in said
    exact = shock_response_spectrum(9.0 * 9.80665 * band_limited(3), 1e-4 / 64, [100.0, 2500.0], interpolation="lines")
    table = np.loadtxt(tmp_path / "made.csv", delimiter=",", skiprows=1)
    assert table[[0, -1], 0] == pytest.approx([100.0, 2500.0])
    assert table[[0, -1], 1] == pytest.approx(exact.acceleration[0], rel=0.005)
    with latin_fmu.open_results(tmp_path / "made.nc") as tree:
        assert tree.attrs["interpolation"] == "band"
        assert tree["acceleration"].sel(response="maximax").values == pytest.approx(table[:, 1], rel=1e-8)
    (tmp_path / "jump.csv").write_text("".join(f"{1e-4 * i:.4f},{1 + i % 2}\n" for i in range(100)))
    assert main(["srs", str(tmp_path / "jump.csv"), "--value-unit", "m/s2"]) == 0
    assert "the larger of both readings, band and lines; they differ by" in capsys.readouterr().out
    for more, words in (([], "the unit of the values is unknown"), (["--value-unit", "N"], "not an acceleration")):
        assert main(["srs", str(tmp_path / "jump.csv"), *more]) == 2
        assert words in capsys.readouterr().err


TOP = {"substructure": "upper", "point": [0.005, 0.005, 0.02]}


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"spectrum": {"highest": 4e6}}, ("sensor.top.spectrum", "2e+06 Hz", "4e+06 Hz", "at most 1e-07 s (it is")),
        ({"spectrum": {"lowest": 2e5, "highest": 1e5}}, ("last frequency must be above the first",)),
        ({"spectrum": {"quality": 0.4}}, ("sensor.top.spectrum.quality",)),
    ],
)
def test_spectra_of_scenes_are_refused_with_numbers(keys: dict[str, Any], words: tuple[str, ...]) -> None:
    with pytest.raises(latin_fmu.SceneError) as refused:
        pressed(sensor={"top": TOP | keys})
    for word in words:
        assert word in str(refused.value)


def test_quasi_static_runs_have_none() -> None:
    time = {"end": 1.0, "instants": 4, "quasi_static": True}
    with pytest.raises(latin_fmu.SceneError, match="a quasi-static run has no acceleration"):
        pressed(sensor={"top": TOP | {"spectrum": {}}}, time=time)


@pytest.fixture(scope="module")
def solved() -> latin_fmu.Solution:
    scene = pressed(sensor={"top": TOP | {"spectrum": {"lowest": 2e5, "highest": 2e6, "per_octave": 3}}, "bare": TOP})
    solution = latin_fmu.solve(scene)
    return latin_fmu.Solution(
        solution.outcome, scene.text(), scene.name, estimate=estimate_error(scene, solution), sensor_tables=scene.sensor
    )


def test_group_of_the_results(solved: latin_fmu.Solution, tmp_path: Path) -> None:
    solved.save(tmp_path / "out.nc")
    tree = latin_fmu.open_results(tmp_path / "out.nc")
    group, history = tree["sensors/top/spectrum"], solved.sensors["top"]
    f = group["frequency"].values
    assert f == pytest.approx([*2e5 * 2.0 ** (np.arange(10) / 3), 2e6])  # the highest one that is requested comes last
    expected = shock_response_spectrum(history.acceleration, 0.2e-6, f, interpolation="lines")
    assert group["acceleration"].sel(response="maximax").values == pytest.approx(expected.acceleration[0])
    assert group["pseudo_velocity"].sel(response="residual").values == pytest.approx(expected.pseudo_velocity[2])
    assert group["frequency"].attrs["units"] == "Hz"
    assert group.attrs["quality"] == 10.0
    assert group.attrs["interpolation"] == "lines"
    error = group["relative_error"].sel(component="z").values
    assert np.isfinite(error[:, :7]).all()  # the coarser run has a step of 0.4 us: 1 MHz
    assert np.isnan(error[:, 7:]).all()
    assert "coarser mesh" in group["relative_error"].attrs["comment"]
    assert "spectrum" not in tree["sensors/bare"].children
    tree.close()
    assert "largest maximax" in solved.summary(details=True)


def test_error_of_a_spectrum_is_that_of_first_order() -> None:
    """Amplitudes 1 + e and 1 + 2 e: the error of the finer one is e, of which 85 % are estimated, also where the curves
    cross."""
    f = np.geomspace(10.0, 1000.0, 60)
    fine = shock_response_spectrum(np.stack([1.01 * half_sine()] * 3, axis=1), STEP, f)
    coarse = shock_response_spectrum(np.stack([1.02 * half_sine()] * 3, axis=1), STEP, f[:50])
    error = spectrum_error(fine, coarse, 2.0)
    assert error[:, :50] == pytest.approx(np.full((5, 50, 3), 0.85 * 0.01 / 1.01), rel=1e-9)
    assert np.isnan(error[:, 50:]).all()
    assert spectrum_error(fine, coarse, 3.0)[0, 0, 0] == pytest.approx(0.85 * 0.005 / 1.01)


def test_command(solved: latin_fmu.Solution, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "out.nc"
    solved.save(file)
    assert main(["srs", str(file)]) == 0
    rows = (tmp_path / "out_srs.csv").read_text().splitlines()
    assert rows[0].startswith("frequency [Hz],top maximax acceleration x [m s-2]")
    assert "bare" not in rows[0]  # the scene requests the spectrum of top alone
    numbers = np.array([row.split(",") for row in rows[1:]], dtype=float)
    assert numbers[:, 3] == pytest.approx(solved.spectra["top"].acceleration[0, :, 2], rel=1e-8)
    assert (tmp_path / "out_srs.png").stat().st_size > 10_000
    tree = latin_fmu.open_results(tmp_path / "out_srs.nc")
    assert "relative_error" in tree["sensors/top/spectrum"]
    tree.close()
    options = ["--sensor", "bare", "--lowest", "1e5", "--highest", "1e6", "--per-octave", "6", "--quality", "25"]
    assert main(["srs", str(file), *options, "--along", "z", "-o", str(tmp_path / "bare")]) == 0
    assert len((tmp_path / "bare.csv").read_text().splitlines()) == 22
    assert "25" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--sensor", "tpo"], "did you mean 'top'?"),
        (["--highest", "3e6"], "beyond 0.4 of the sampling rate"),
        (["--lowest", "1e6"], "give --lowest and --highest"),
        (["--quality", "0.3"], "--quality"),
        (["--per-octave", "0"], "--per-octave"),
    ],
)
def test_command_refuses(
    options: list[str], words: str, solved: latin_fmu.Solution, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    solved.save(tmp_path / "out.nc")
    assert main(["srs", str(tmp_path / "out.nc"), *options]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out_srs.csv").exists()


def test_command_says_why_a_sensor_has_no_acceleration(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    time = {"end": 4e-6, "instants": 4, "quasi_static": True}
    latin_fmu.solve(pressed(time=time)).save(tmp_path / "out.nc")
    assert main(["srs", str(tmp_path / "out.nc"), "--sensor", "top"]) == 2
    assert "sensor top: it has no acceleration (quasi-static run: no inertia" in capsys.readouterr().err
