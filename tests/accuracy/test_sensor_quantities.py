"""Quantities of sensors and bolts: values in the band of the mesh, distances, estimates, targets of a search."""

from __future__ import annotations

import numpy as np
import pytest

import latin_fmu
from latin_fmu.accuracy.adaptive_resolution import choose
from latin_fmu.accuracy.estimate import element_transit, estimate_error
from latin_fmu.accuracy.runs import Resolution, at_resolution
from latin_fmu.latin.outcome import SensorHistory
from latin_fmu.results.owner_records import Band, Signal
from latin_fmu.run_quantities import Quantities, add_sensor, band_of, measure_solution, resolved_frequency
from latin_fmu.scene.materials import MaterialTable
from latin_fmu.scene.sensors import LowPass, Sensor, Spectrum

from ..verification.strangers import chain

STEP, RATE, SIZE = 1e-5, 500.0, 0.01  # s, Hz, m


def sine(step: float = STEP, size: float = SIZE, end: float = 0.02) -> SensorHistory:
    """x = size (1 - cos(w t)) with its velocity and acceleration along y."""
    time, w = step * np.arange(round(end / step) + 1), 2.0 * np.pi * RATE
    motions = np.zeros((3, len(time), 3))
    motions[:, :, 1] = size * np.stack([1.0 - np.cos(w * time), w * np.sin(w * time), w**2 * np.cos(w * time)])
    return SensorHistory("s", "body", None, np.zeros(3), *motions)


def measured(history: SensorHistory, step: float = STEP, cutoff: float = 5e3, **band: object) -> Quantities:
    """Its quantities until 0.02 s."""
    quantities = Quantities()
    time = step * np.arange(len(history.displacement))
    add_sensor(quantities, time, history, 0.02, Band(LowPass(cutoff=cutoff), cutoff, **band))  # type: ignore[arg-type]
    return quantities


def test_values_of_a_sine_are_its_amplitudes() -> None:
    """Ten periods: root mean squares of 1 - cos and sin are sqrt(3/2) and sqrt(1/2)."""
    values, w = measured(sine()).values, 2.0 * np.pi * RATE
    assert values["s.displacement_peak"] == pytest.approx(2 * SIZE, rel=1e-3)
    assert values["s.displacement"] == pytest.approx(0.0, abs=1e-6)
    assert values["s.displacement_rms"] == pytest.approx(SIZE * np.sqrt(1.5), rel=1e-3)
    assert values["s.velocity_rms"] == pytest.approx(w * SIZE * np.sqrt(0.5), rel=1e-3)
    assert values["s.velocity_peak"] == pytest.approx(w * SIZE, rel=1e-2)


def test_the_band_leaves_out_what_is_above_it() -> None:
    values = measured(sine(), cutoff=100.0).values
    assert values["s.velocity_peak"] < 1e-2 * 2.0 * np.pi * RATE * SIZE
    spectrum = measured(sine(), frequencies=(250.0, 500.0, 1000.0), cutoff=600.0)
    assert list(spectrum.signals["s.spectrum"].along) == [250.0, 500.0]
    assert len(spectrum.spectra["s"].frequency) == 3


def test_steps_too_long_for_the_band_give_no_peak() -> None:
    """A Nyquist frequency of 5 kHz, 90 % of which is below a cut-off of 5 kHz."""
    values = measured(sine(1e-4), 1e-4).values
    assert "s.acceleration_peak" not in values
    assert "s.displacement_peak" in values


def test_changes_of_peaks_are_those_of_the_histories_near_them() -> None:
    """Equal peaks, half a step of phase apart: no distance, but a change."""
    time = np.linspace(0.0, 1.0, 201)
    one, other = (Signal(time, np.sin(2 * np.pi * (time - shift))[:, None]) for shift in (0.0, 0.05))
    first, second = Quantities(), Quantities()
    for quantities, signal in ((first, one), (second, other)):
        quantities.add("s", {"velocity_peak": (signal.peak(),) * 2})
        quantities.signals["s.velocity_peak"] = signal
    assert first.distance("s.velocity_peak", second) == pytest.approx(0.0, abs=1e-12)
    # where |sin a| is 0.8 and more: largest 2 sin(d / 2) cos(a - d / 2), d = 0.1 pi, at a = asin 0.8
    largest = max(
        2 * np.sin(0.05 * np.pi) * abs(np.cos(a - 0.05 * np.pi)) for a in (np.arcsin(0.8), np.pi - np.arcsin(0.8))
    )
    assert first.change("s.velocity_peak", second, first) == pytest.approx(largest, rel=2e-2)


def test_resolved_frequency_of_a_bar() -> None:
    """Smallest c / (8 h) of the bars, at most a tenth of the sampling rate."""
    scene = chain(2).scene
    bodies = scene.substructure.values()
    speeds = [np.sqrt(scene.material[b.material].young_modulus / scene.material[b.material].density) for b in bodies]
    edges = [b.box.size[2] / b.box.elements[2] for b in bodies if b.box is not None]
    lowest = min(c / (8 * h) for c, h in zip(speeds, edges, strict=True))
    assert resolved_frequency(scene) == pytest.approx(min(lowest, 0.1 / scene.time.time_step))
    coarse = at_resolution(scene, Resolution(0.5, 1.0))
    assert resolved_frequency(coarse) < resolved_frequency(scene)


def test_waves_along_each_axis_of_an_orthotropic_bar() -> None:
    """The band, and the time that a wave needs to cross an element, are by the modulus along that axis."""
    rod = {"young_moduli": [16e9, 1e9, 4e9], "poisson_ratios": [0.0] * 3, "shear_moduli": [1e9] * 3}
    scene, own = chain(2).scene, MaterialTable.model_validate({"density": 1000.0, "orthotropic": rod})
    scene = scene.model_copy(update={"material": dict.fromkeys(scene.material, own)})
    boxes = [b.box for b in scene.substructure.values() if b.box is not None]
    long = max(box.size[2] / box.elements[2] for box in boxes)
    assert resolved_frequency(scene) == pytest.approx(min(2000.0 / (8 * long), 0.1 / scene.time.time_step))
    meet = next(iter(scene.interface.values()))
    beside = [scene.substructure[side.partition(".")[0]].box for side in meet.sides if side != "ground"]
    longest = max(box.size[2] / box.elements[2] for box in beside if box is not None)
    assert element_transit(scene, meet.sides, 0.0) == pytest.approx(longest / 2000.0)


def test_a_filter_of_the_sensor_is_the_band() -> None:
    scene, own = chain(2).scene, LowPass(cutoff=0.7, order=2)
    sensor = Sensor(substructure="bar0", point=(0.0, 0.0, 0.0), filter=own, spectrum=Spectrum(quality=5.0))
    band = band_of(scene, sensor)
    assert band.chosen == own
    assert band.quality == 5.0
    assert band.highest == resolved_frequency(scene)


@pytest.fixture(scope="module")
def run() -> tuple[latin_fmu.Scene, latin_fmu.Solution]:
    """The chain of a seed, which has two sensors with spectra."""
    scene = chain(8).scene
    return scene, latin_fmu.solve(scene)


def test_every_sensor_has_its_estimates(run: tuple[latin_fmu.Scene, latin_fmu.Solution]) -> None:
    scene, solution = run
    estimate, exact = estimate_error(scene, solution), chain(8).exact
    fine = measure_solution(scene, solution)
    keys = {q.quantity.partition(".")[2] for q in estimate.quantities if q.quantity.startswith("foot.")}
    assert keys == {
        "displacement",
        "displacement_peak",
        "displacement_rms",
        "velocity_rms",
        "velocity_peak",
        "acceleration_peak",
        "spectrum",
    }
    assert all(np.isfinite(estimate[f"foot.{key}"].error) for key in keys)
    assert "unfiltered acceleration grows without limit" in "\n".join(estimate.remarks)
    assert set(estimate.spectra) == {"foot", "tip"}
    for key in ("velocity_rms", "displacement_rms"):  # norms, estimated over true narrow
        true = fine.error(f"foot.{key}", exact)
        assert true <= 1.5 * estimate[f"foot.{key}"].error <= 8.0 * true


def test_a_sensor_can_be_the_target(run: tuple[latin_fmu.Scene, latin_fmu.Solution]) -> None:
    scene, _ = run
    accuracy = scene.accuracy.model_copy(update={"quantity": "foot.displacement_rms"})
    choice = choose(scene.model_copy(update={"accuracy": accuracy}), 0.2, 60.0, lambda _: None)
    assert choice.reached
    assert choice.solution is not None
    assert measure_solution(scene, choice.solution).error("foot.displacement_rms", chain(8).exact) <= 0.2
