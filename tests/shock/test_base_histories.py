"""Base histories: their spectra by another route, their ends, what a stand allows, pulses and envelopes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid, solve_ivp

import latin_fmu
from latin_fmu.cli import main
from latin_fmu.errors import InputError, SceneError
from latin_fmu.shock.base_histories import BaseHistory, TestStand, base_history
from latin_fmu.shock.envelopes import tolerance_factor, tolerance_limit
from latin_fmu.shock.pulses import PULSES, pulse_history
from latin_fmu.shock.specification import Specification

G = 9.80665
# spectra like those of MIL-STD-810 method 516 (functional test, crash hazard) and of pyroshocks
STANDARDS = {
    "functional": ([10.0, 45.0, 2000.0], [9.0 * G, 40.0 * G, 40.0 * G]),
    "crash": ([10.0, 45.0, 2000.0], [16.7 * G, 75.0 * G, 75.0 * G]),
    "pyroshock": ([100.0, 1600.0, 10000.0], [20.0 * G, 1000.0 * G, 1000.0 * G]),
}


def drawn(seed: int) -> Specification:
    """Breakpoints 0.2 to 1 decade apart, -3 to 12 dB an octave."""
    random = np.random.default_rng(seed)
    f, a = [random.uniform(20.0, 200.0)], [random.uniform(50.0, 500.0)]
    while f[-1] < 4000.0:
        decades = random.uniform(0.2, 1.0)
        f.append(f[-1] * 10.0**decades)
        a.append(a[-1] * 10.0 ** (random.uniform(-3.0, 12.0) / 20.0 * decades / np.log10(2.0)))
    return Specification.of(f, a)


CASES = {name: Specification.of(*points) for name, points in STANDARDS.items()}
CASES |= {f"seed {seed}": drawn(seed) for seed in range(100, 109)}


@pytest.mark.parametrize("waves", ["wavelets", "damped_sines"])
@pytest.mark.parametrize(
    "case", ["pyroshock", "seed 103", *(pytest.param(c, marks=pytest.mark.slow) for c in CASES if c[-1] not in "k3")]
)
def test_histories_meet_their_specification(case: str, waves: str) -> None:
    history = base_history(CASES[case], waves, seeds=range(2))  # type: ignore[arg-type]
    assert history.error < 1.0
    f = history.frequency
    assert np.log2(f[1:] / f[:-1]).max() < 1.3 / 12
    # the public function, which samples the lines again
    step = float(history.time[1])
    spectrum = latin_fmu.shock_response_spectrum(history.acceleration, step, f, 10.0, interpolation="lines")
    decibels = 20.0 * np.log10(spectrum.acceleration[0] / CASES[case].at(f))
    assert np.abs(decibels).max() < 1.0
    at_rest(history)


def at_rest(history: BaseHistory) -> None:
    """Velocity and displacement at the end, by sums of fine samples of the lines."""
    time = np.linspace(0.0, history.time[-1], 20 * (len(history.time) - 1) + 1)
    acceleration = np.interp(time, history.time, history.acceleration)
    velocity = cumulative_trapezoid(acceleration, time, initial=0.0)
    displacement = cumulative_trapezoid(velocity, time, initial=0.0)
    assert abs(history.velocity[-1]) < 1e-9 * np.abs(history.velocity).max()
    assert abs(history.displacement[-1]) < 1e-9 * np.abs(history.displacement).max()
    assert history.acceleration[0] == history.acceleration[-1] == 0.0
    assert abs(velocity[-1]) < 1e-9 * np.abs(velocity).max()
    assert abs(displacement[-1]) < 1e-3 * np.abs(displacement).max()
    assert np.abs(history.velocity - velocity[::20]).max() < 1e-9 * np.abs(velocity).max()
    assert np.abs(history.displacement - displacement[::20]).max() < 1e-3 * np.abs(displacement).max()


def test_an_oscillator_on_the_base_has_what_was_specified() -> None:
    """By an adaptive solver of its equation of motion."""
    specification = Specification.of([100.0, 1000.0, 2000.0], [200.0, 4000.0, 4000.0])
    history = base_history(specification, seeds=[3])
    omega = 2.0 * np.pi * 400.0
    end = float(history.time[-1])

    def rate(t: float, state: np.ndarray) -> list[float]:
        base = np.interp(t, history.time, history.acceleration)
        return [state[1], -base - 0.1 * omega * state[1] - omega**2 * state[0]]

    found = solve_ivp(rate, (0.0, end + 5e-3), [0.0, 0.0], rtol=1e-7, atol=1e-12, max_step=2e-5)
    largest = np.abs(0.1 * omega * found.y[1] + omega**2 * found.y[0]).max()
    assert 20.0 * abs(np.log10(largest / specification.at(400.0))) < 1.1


def test_the_smallest_peak_of_the_seeds_is_taken() -> None:
    specification = Specification.of([100.0, 1000.0, 2000.0], [200.0, 4000.0, 4000.0])
    alone = [base_history(specification, seeds=[seed]) for seed in range(3)]
    met = [h for h in alone if h.error <= 1.0]
    best = base_history(specification, seeds=range(3))
    assert np.abs(best.acceleration).max() == min(np.abs(h.acceleration).max() for h in met)


def test_what_a_stand_cannot_do_is_told() -> None:
    specification = Specification.of([100.0, 1000.0, 2000.0], [200.0, 4000.0, 4000.0])
    history = base_history(specification, seeds=[0], stand=TestStand(displacement=1e-6))
    assert not history.meets(1.0)
    assert list(history.excess) == ["displacement"]
    assert history.error < 1.0


@pytest.mark.parametrize("kind", PULSES)
def test_a_pulse_brings_its_base_back(kind: str) -> None:
    time, acceleration = pulse_history(kind, 500.0, 11e-3, 0.05)
    fine = np.linspace(0.0, time[-1], 20 * (len(time) - 1) + 1)
    velocity = cumulative_trapezoid(np.interp(fine, time, acceleration), fine, initial=0.0)
    displacement = cumulative_trapezoid(velocity, fine, initial=0.0)
    assert acceleration.max() == pytest.approx(500.0, rel=1e-3)
    assert acceleration.min() == pytest.approx(-25.0, rel=5e-3)
    assert abs(velocity[-1]) < 1e-9 * np.abs(velocity).max()
    assert abs(displacement[-1]) < 1e-5 * np.abs(displacement).max()
    # the pulse itself is in it
    bare_time, bare = pulse_history(kind, 500.0, 11e-3, 0.0)
    near = int(np.argmax(acceleration > 0.0))
    parts = [acceleration[first : first + len(bare)] for first in (near - 1, near, near + 1)]
    assert bare_time[-1] == pytest.approx(11e-3)
    assert min(np.abs(part - bare).max() for part in parts) < 2e-3 * 500.0


def test_a_limit_covers_what_it_says() -> None:
    """Share of a lognormal population below the limit of five of them: at least 95 % in half of the trials."""
    random = np.random.default_rng(1)
    records = np.exp(random.normal(0.0, 0.4, size=(5, 20000)))
    limits = np.log(tolerance_limit(records)) / 0.4
    assert (limits > 1.6449).mean() == pytest.approx(0.5, abs=0.012)
    # table of Owen (1963): n = 10, 95 % with 90 %
    assert tolerance_factor(10, 0.95, 0.9) == pytest.approx(2.568, abs=1e-3)


def test_a_law_drives_a_base_by_its_specification(tmp_path: Path) -> None:
    (tmp_path / "spec.csv").write_text("frequency [Hz], acceleration [g]\n100, 20\n1000, 300\n2000, 300\n")
    law = {"type": "srs", "file": "spec.csv", "seeds": 1, "rate": 50e3}
    data = {
        "name": "driven",
        "units": "mm-t-s-MPa",
        "material": {"steel": {"young_modulus": 210e3, "poisson_ratio": 0.3, "density": 7.8e-9}},
        "substructure": {"bar": {"material": "steel", "box": {"size": [10.0, 10.0, 5.0], "elements": [2, 2, 1]}}},
        "boundary": {
            "base": {"type": "acceleration", "face": "bar.zmin", "components": ["x", "y", "z"], "value": [0, 0, 1.0]}
            | {"law": law}
        },
        "sensor": {"base": {"face": "bar.zmin", "spectrum": {"lowest": 100.0, "highest": 2000.0}}},
        "time": {"end": 0.06, "step": 2e-5},
    }
    scene = latin_fmu.scene_from_dict(data, tmp_path)
    (line,) = (line for line in latin_fmu.check(scene) if "history" in line)
    assert "specification of 3 breakpoints, Q 10, met within" in line
    solution = latin_fmu.solve(scene)
    step = 2e-5
    found = latin_fmu.shock_response_spectrum(
        solution.sensors["base"].acceleration[:, 2], step, [200.0, 1000.0], interpolation="lines"
    )
    asked = Specification.of([100.0, 1000.0, 2000.0], np.array([20.0, 300.0, 300.0]) * G).at([200.0, 1000.0])
    assert np.abs(20.0 * np.log10(found.acceleration[0] / (1e3 * asked))).max() < 1.0
    # the text of the scene has the history
    again = latin_fmu.scene_from_dict(scene.tables(), Path())
    assert again.boundary["base"].law.values == scene.boundary["base"].law.values  # type: ignore[union-attr]
    data["load"] = {"push": {"face": "bar.zmax", "pressure": 1.0, "law": law}}
    with pytest.raises(SceneError, match="a shock response spectrum is of an acceleration"):
        latin_fmu.scene_from_dict(data, tmp_path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("100,20\n1000,300\n", "the header names no unit"),
        ("f [Hz],a [V]\n100,20\n1000,300\n", "gives the accelerations in V"),
        ("f [kHz],a [g]\n1,20\n2,300\n", "gives the frequencies in kHz"),
        ("f [Hz],a [g]\n100,20\n50,300\n", "line 3: frequencies do not increase"),
        ("f [Hz],a [g]\n\n0,20\n50,300\n", "line 3: the frequency is not positive"),
        ("f [Hz],a [g]\n10,20\n50,-3\n", "line 3: the value is not positive"),
        ("f [Hz],a [g]\n10,20\n", "two breakpoints or more"),
    ],
)
def test_files_that_are_no_specification_are_refused(
    text: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "spec.csv"
    file.write_text(text)
    assert main(["base", str(file), "-o", str(tmp_path / "out")]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out.csv").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--rate", "3000"], "beyond its samples"),
        (["--duration", "1e-3"], "too short for its specification"),
        (["--tolerance", "0"], "--tolerance"),
        (["--pulse", "half_sine"], "of a specification or of a pulse"),
    ],
)
def test_options_that_do_not_fit_are_refused(
    options: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "spec.csv"
    file.write_text("f [Hz],a [g]\n100,20\n2000,300\n")
    assert main(["base", str(file), *options, "-o", str(tmp_path / "out")]) == 2
    assert words in capsys.readouterr().err


def test_the_commands_write_what_a_scene_reads(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "spec.csv"
    file.write_text("100;200,5\n1000;3000,5\n")
    stem = tmp_path / "shock"
    assert main(["base", str(file), "--unit", "m/s2", "--seeds", "1", "--json", "-o", str(stem)]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["error_decibels"] < 1.0
    assert report["last_displacement"] < 1e-9
    assert stem.with_suffix(".png").stat().st_size > 10_000
    stored = np.loadtxt(stem.with_suffix(".csv"), delimiter=",", skiprows=1)
    assert np.abs(stored[:, 1]).max() == pytest.approx(report["peak"])
    # the best there is, and exit code 1
    assert main(["base", str(file), "--unit", "m/s2", "--seeds", "1", "--peak", "10", "-o", str(stem)]) == 1
    assert "not met: peak" in capsys.readouterr().out
    pulse = tmp_path / "pulse"
    assert (
        main(["base", "--pulse", "sawtooth", "--size", "50", "--unit", "g", "--duration", "6e-3", "-o", str(pulse)])
        == 0
    )
    records = [str(path.with_suffix(".csv")) for path in (stem, pulse, stem)]
    target = tmp_path / "envelope.csv"
    assert main(["envelope", *records, "-o", str(target), "--lowest", "100", "--highest", "1000"]) == 0
    rows = np.loadtxt(target, delimiter=",", skiprows=2)
    single = latin_fmu.shock_response_spectrum(stored[:, 1], stored[1, 0], rows[:, 0])
    assert (rows[:, 1] >= 0.999 * single.acceleration[0]).all()
    assert main(["base", str(target), "--seeds", "1", "-o", str(stem)]) in (0, 1)


def test_breakpoints_are_checked() -> None:
    with pytest.raises(InputError, match=r"breakpoint 2: frequencies do not increase"):
        Specification.of([10.0, 5.0], [1.0, 1.0])
    with pytest.raises(InputError, match="quality"):
        Specification.of([10.0, 50.0], [1.0, 1.0], 0.3)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"stand": TestStand(rate=3000.0)}, "beyond its samples"),
        ({"stand": TestStand(duration=1e-3)}, "too short for its specification"),
        ({"seeds": []}, "seeds: none"),
        ({"tolerance": 0.0}, "tolerance: not positive"),
    ],
)
def test_requests_are_checked(options: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        base_history(Specification.of([100.0, 2000.0], [200.0, 4000.0]), **options)  # type: ignore[arg-type]
