"""Random base motions beside what their specification says: densities, mean squares, integrals, independence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.signal import welch

import latin_fmu
from latin_fmu.errors import InputError, SceneError
from latin_fmu.shock.random_motion import AccelerationDensity, RandomMotion

DENSITY = AccelerationDensity.of([20.0, 80.0, 350.0, 1000.0, 2000.0], [1.0, 4.0, 4.0, 4.0 / 1000.0 * 350.0, 0.7])
G = 9.80665


@pytest.mark.parametrize("end", [30.0, 80.0, 200.0, 2000.0])
def test_mean_squares_are_integrals_of_the_density(end: float) -> None:
    breaks = [f for f in DENSITY.frequency if 20.0 < f < end]
    expected, _ = quad(lambda f: float(DENSITY.at(f)), 20.0, end, points=breaks or None, epsabs=0.0, epsrel=1e-10)
    assert float(DENSITY.below(end)) == pytest.approx(expected, rel=1e-8)


def test_motions_have_their_density() -> None:
    """Mean of 200 motions: 1 % of the mean square, and of bands of the spectrum 5 %."""
    step, period = 1e-4, 0.5
    time = step * np.arange(5001)
    squares, spectra = [], []
    for window in range(200):
        motion = RandomMotion(DENSITY, period, (5, window))
        stationary = motion.acceleration(time)[time >= motion.faded]
        squares.append(np.mean(stationary**2))
        spectra.append(welch(stationary, 1.0 / step, nperseg=1000)[1])
    assert np.mean(squares) == pytest.approx(DENSITY.rms**2, rel=0.01)
    frequency = np.fft.rfftfreq(1000, step)
    for low, high in ((60.0, 110.0), (300.0, 600.0), (1000.0, 1800.0)):
        inside = (frequency >= low) & (frequency <= high)
        ratio = np.mean(spectra, axis=0)[inside].sum() / DENSITY.at(frequency[inside]).sum()
        assert ratio == pytest.approx(1.0, abs=0.05), (low, high)
    # none below the specification, and so no drift: means of the second half of a long motion
    long = RandomMotion(DENSITY, 20.0, (5, 0))
    late = np.linspace(10.0, 20.0, 100_001)
    for motion in (long.velocity(late), long.displacement(late)):
        assert abs(motion.mean()) < 0.01 * motion.std()


def test_velocity_and_displacement_are_integrals_from_rest() -> None:
    motion = RandomMotion(DENSITY, 0.4, (1, 0))
    fine = np.linspace(0.0, 0.4, 160_001)
    a, v, d = motion.acceleration(fine), motion.velocity(fine), motion.displacement(fine)
    step = fine[1]
    assert a[0] == v[0] == d[0] == 0.0
    by_trapezoids = np.concatenate([[0.0], np.cumsum(0.5 * step * (a[1:] + a[:-1]))])
    assert np.abs(by_trapezoids - v).max() < 1e-5 * np.abs(v).max()
    by_trapezoids = np.concatenate([[0.0], np.cumsum(0.5 * step * (v[1:] + v[:-1]))])
    assert np.abs(by_trapezoids - d).max() < 1e-5 * np.abs(d).max()


def test_a_motion_is_the_same_at_any_times() -> None:
    """Samples by a transform, of which the period is a multiple, and sums at other times."""
    motion = RandomMotion(DENSITY, 0.4, (1, 2))
    grid = np.linspace(0.0, 0.4, 8001)
    every = motion.acceleration(grid)
    picked = [3, 700, 701, 5000, 8000]
    assert motion.acceleration(grid[picked]) == pytest.approx(every[picked], abs=1e-9)
    # too few samples for the highest harmonic
    assert motion.acceleration(grid[::8]) == pytest.approx(every[::8], abs=1e-9)
    assert np.array_equal(RandomMotion(DENSITY, 0.4, (1, 2)).acceleration(grid), every)


def test_windows_are_independent() -> None:
    time = np.linspace(0.0, 2.0, 20_001)
    motions = [RandomMotion(DENSITY, 2.0, (3, window)).acceleration(time)[2000:] for window in range(8)]
    motions.append(RandomMotion(DENSITY, 2.0, (4, 0)).acceleration(time)[2000:])
    apart = np.corrcoef(motions) - np.eye(9)
    assert np.abs(apart).max() < 0.1


def test_breakpoints_that_are_none_are_refused() -> None:
    with pytest.raises(InputError, match="frequencies do not increase"):
        AccelerationDensity.of([100.0, 50.0], [1.0, 1.0])


def scene(law: dict[str, object], folder: Path, **keys: object) -> latin_fmu.Scene:
    """A bar on a base that a law drives."""
    data: dict[str, object] = {
        "name": "driven",
        "material": {"steel": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}},
        "substructure": {"bar": {"material": "steel", "box": {"size": [0.01, 0.01, 0.005], "elements": [1, 1, 1]}}},
        "boundary": {
            "base": {"type": "acceleration", "face": "bar.zmin", "components": ["x", "y", "z"], "value": [0, 0, 1.0]}
            | {"law": {"type": "psd", **law}}
        },
        "time": {"end": 0.25, "step": 1e-4},
    }
    return latin_fmu.scene_from_dict(data | keys, folder)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("20,0.01\n2000,0.01\n", "the header names no unit"),
        ("f [Hz],psd [g]\n20,0.01\n2000,0.01\n", "gives the spectral density of an accelerations in g"),
        ("f [kHz],psd [g^2/Hz]\n0.02,0.01\n2,0.01\n", "gives the frequencies in kHz"),
        ("f [Hz],psd [g^2/Hz]\n20,0.01\n10,0.01\n", "line 3: frequencies do not increase"),
        ("f [Hz],psd [g^2/Hz]\n\n0,0.01\n10,0.01\n", "line 3: the frequency is not positive"),
        ("f [Hz],psd [g^2/Hz]\n20,0.01\n2000,-0.01\n", "line 3: the value is not positive"),
        ("f [Hz],psd [g^2/Hz]\n20,0.01\n6000,0.01\n", "goes beyond the steps of the run"),
        ("f [Hz],psd [g^2/Hz]\n2,0.01\n600,0.01\n", "too short for the lowest frequency"),
    ],
)
def test_files_that_do_not_fit_are_refused(text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "spec.csv").write_text(text)
    with pytest.raises(SceneError) as caught:
        scene({"file": "spec.csv"}, tmp_path)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("law", "words"),
    [
        ({}, "a specification is a file, or breakpoints"),
        ({"frequency": [20.0, 200.0], "density": [1.0, 1.0], "duration": 0.2}, "which would repeat itself"),
        ({"file": "spec.csv", "unit": "g"}, "an acceleration"),
    ],
)
def test_laws_that_do_not_fit_are_refused(law: dict[str, object], words: str, tmp_path: Path) -> None:
    (tmp_path / "spec.csv").write_text("20,0.01\n200,0.01\n")
    with pytest.raises(SceneError) as caught:
        scene(law, tmp_path)
    assert words in str(caught.value)


@pytest.mark.parametrize("header", ["f [Hz], psd [g^2/Hz]", "f [Hz]; psd [g²/Hz]", "Frequency (Hz), ASD (g2/Hz)"])
def test_units_of_a_file(header: str, tmp_path: Path) -> None:
    separator = ";" if ";" in header else ","
    (tmp_path / "spec.csv").write_text(f"{header}\n20{separator} 0.01\n200{separator} 0.02\n")
    law = scene({"file": "spec.csv"}, tmp_path).boundary["base"].law  # type: ignore[union-attr]
    assert law.density == pytest.approx((0.01 * G**2, 0.02 * G**2), rel=1e-12)  # type: ignore[union-attr]
    (tmp_path / "spec.csv").write_text("f [Hz],psd [(m/s2)^2/Hz]\n20,1\n200,2\n")
    law = scene({"file": "spec.csv"}, tmp_path).boundary["base"].law  # type: ignore[union-attr]
    assert law.density == (1.0, 2.0)  # type: ignore[union-attr]


def test_a_scene_keeps_its_specification_and_not_its_duration(tmp_path: Path) -> None:
    (tmp_path / "spec.csv").write_text("f [Hz],psd [g^2/Hz]\n20,0.01\n200,0.02\n")
    made = scene({"file": "spec.csv", "seed": 3}, tmp_path)
    (line,) = (line for line in latin_fmu.check(made) if "random vibration" in line)
    assert "20 to 200 Hz, 16.76 m/s2 rms, seed 3, window 0" in line
    again = latin_fmu.scene_from_dict(made.tables(), Path())
    assert again.boundary["base"].law == made.boundary["base"].law  # type: ignore[union-attr]
    longer = made.replace("time.end", 0.5)
    assert longer.boundary["base"].law.duration == 0.5  # type: ignore[union-attr]
    with pytest.raises(SceneError, match="of the acceleration of a driven face"):
        scene(
            {"file": "spec.csv"},
            tmp_path,
            load={
                "p": {
                    "face": "bar.zmax",
                    "pressure": 1.0,
                    "law": {"type": "psd", "frequency": [20.0, 200.0], "density": [1.0, 1.0]},
                }
            },
        )
