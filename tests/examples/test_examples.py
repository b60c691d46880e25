"""The examples run, and their numbers are right (coarse variants, as ``--quick``)."""

from __future__ import annotations

import importlib
import importlib.util
import json
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from ..verification.oracles import cases


def _figures(folder: Path) -> set[str]:
    return {path.name for path in folder.glob("*.png") if path.stat().st_size > 10_000}


EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
SCRIPTS = sorted(p.stem for folder in (EXAMPLES, EXAMPLES / "benchmarks") for p in folder.glob("*.py"))


@pytest.mark.parametrize("example", [name for name in SCRIPTS if name != "figures"], indirect=True)
def test_every_example_says_what_it_shows(example: ModuleType) -> None:
    """It loads, so that what it uses of the package is there, and its head is more than a title."""
    assert example.__doc__ is not None
    assert len(example.__doc__.splitlines()) >= 2 or example.__name__.startswith(("example_tools", "fmu_"))


@pytest.mark.parametrize("example", ["waves_in_bars"], indirect=True)
def test_exact_stress_of_the_waves_is_that_of_the_characteristics(example: ModuleType) -> None:
    exact = example.exact_stress(250 / 42)
    waves = cases.beam_in_traction().waves
    places = (np.arange(example.CELLS) + 0.5) / example.CELLS * 0.5
    for time in (0.5, 1.75, 2.25, 2.8, 3.25, 4.0, 4.6, 5.5):
        along = np.concatenate([waves.field(i, places, time * example.TRANSIT)[0] for i in range(3)])
        assert exact.at(time) == pytest.approx(1e-6 * along, abs=1e-9)


@pytest.mark.parametrize("example", ["waves_in_bars"], indirect=True)
def test_waves_in_bars(example: ModuleType, tmp_path: Path) -> None:
    numbers = example.main(["--quick", "-o", str(tmp_path)])
    assert _figures(tmp_path) == {"waves_in_bars.png"}
    assert numbers["iterations"] <= 8
    assert numbers["error_indicator"] <= 1e-3
    assert abs(numbers["contact_instant_error_in_steps"]) <= 1.5
    assert numbers["impulse_ratio"] == pytest.approx(1.0, abs=0.01)
    assert numbers["stress_error"] < 0.5  # shock fronts on 25 elements per substructure
    assert numbers["tension_level_ratio"] == pytest.approx(1.0, abs=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("example", ["crushing_reference"], indirect=True)
def test_crushing_reference(example: ModuleType, tmp_path: Path) -> None:
    """Half as fine, the values are those of the file beside the scene, within its errors and those estimated."""
    numbers = example.main(["--quick", "-o", str(tmp_path)])
    assert _figures(tmp_path) == {"crushing_reference.png"}
    shipped, made = (json.loads((folder / "reference.json").read_text()) for folder in (example.SCENE.parent, tmp_path))
    assert made["holds_for"] == shipped["holds_for"]
    for quantity, value in shipped["values"].items():
        key = quantity.rpartition(".")[2]
        error = shipped["errors"][quantity] + numbers[f"error_of_{key}"]
        assert numbers[key] == pytest.approx(value, rel=error), quantity
        assert error < 0.25
    for key, error in (("impulse", 1e-3), ("first_contact", 2e-2), ("separation", 5e-3), ("peak_force", 2e-2)):
        assert numbers[f"error_of_{key}"] < error


@pytest.mark.slow
@pytest.mark.parametrize("example", ["convergence_friction"], indirect=True)
def test_convergence_friction(example: ModuleType, tmp_path: Path) -> None:
    numbers = example.main(["--quick", "-o", str(tmp_path)])
    assert _figures(tmp_path) == {"convergence_friction.png"}
    counts = {
        name: [numbers[f"{name}_iterations_to_0.001_mu_{mu:g}"] for mu in example.FRICTION[::2]]
        for name in ("none", "anderson", "springs_none", "springs_anderson")
    }
    # Tangential unknowns cost iterations, friction hardly more; with springs no more than half of those without.
    without = numbers["none_iterations_without_tangential_unknowns"]
    assert min(counts["none"]) > 1.5 * without
    assert max(counts["none"]) < 1.5 * min(counts["none"])
    assert max(counts["springs_anderson"]) <= 1.5 * numbers["anderson_iterations_without_tangential_unknowns"]
    assert max(counts["springs_anderson"]) <= 1.2 * min(counts["springs_anderson"])
    assert counts["springs_anderson"][-1] < 0.8 * counts["anderson"][-1]


@pytest.mark.parametrize("example", ["convergence_friction"], indirect=True)
def test_springs_of_zero_give_the_iterates_of_the_package(example: ModuleType) -> None:
    """The search direction with springs is that of the package where the springs are zero: the same sqrt(eta)."""
    found = example.Window(example.QUICK).iterate(0.1, 0)[:20]
    package = example.indicator(0.1, "none", example.COARSER)[:20]
    np.testing.assert_allclose(found, package, rtol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("example", ["convergence_friction"], indirect=True)
def test_springs_lead_to_the_same_solution(example: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    """The fields at the end are those of the published search direction."""
    monkeypatch.setattr(example, "TOLERANCE", 1e-7)
    scene = replace(example.QUICK, instants=60, friction=0.3)
    window = example.Window(scene, spring=1.0)
    assert window.iterate(0.3, 6)[-1] <= 1e-7
    published = importlib.import_module("latin_in_numpy").solve(scene, scene.instants, 1e-8)
    for found, right in zip(window.fields, published[:2], strict=True):
        np.testing.assert_allclose(found.reshape(right.shape), right, rtol=0, atol=1e-5 * np.abs(right).max())


@pytest.mark.slow
@pytest.mark.parametrize("example", ["the_paper"], indirect=True)
def test_the_paper(example: ModuleType, tmp_path: Path) -> None:
    numbers = example.main(["--quick", "-o", str(tmp_path)])
    assert _figures(tmp_path) == {"the_paper_beam.png", "the_paper_crushing.png"}
    assert numbers["beam_HHT_iterations"] <= 8
    assert numbers["beam_Newmark_iterations"] > 2 * numbers["beam_HHT_iterations"]
    assert numbers["beam_Newmark_damped_iterations"] <= 8
    for name in ("HHT", "Newmark"):
        whole, single = (numbers[f"beam_{name}{way}_impulse_over_exact"] for way in ("", "_single_instants"))
        assert whole == pytest.approx(single, rel=1e-3) == pytest.approx(1.0, abs=0.01)
        assert numbers[f"crushing_{name}_force_error_30"] < (1e-3 if name == "HHT" else 0.1)
        assert numbers[f"crushing_{name}_long_window_iterations_mu_0"] == 1.0


@pytest.mark.parametrize("example", ["static_friction"], indirect=True)
def test_static_friction(example: ModuleType, tmp_path: Path) -> None:
    numbers = example.main(["--quick", "-o", str(tmp_path)])
    assert _figures(tmp_path) == {"static_friction.png"}
    assert numbers["end_error"] < 3e-3
    assert numbers["loss_error"] < 3e-3
    assert numbers["iterations_8"] < 1.3 * numbers["iterations_2"]
    assert numbers["iterations_8_without_coarse"] > 1.5 * numbers["iterations_8"]


@pytest.mark.parametrize("example", ["landing"], indirect=True)
def test_landing(example: ModuleType, tmp_path: Path) -> None:
    """Peaks of the schemes, and what they lose in one impact."""
    numbers = example.main(["--quick", "-o", str(tmp_path)])
    assert _figures(tmp_path) == {"landing.png"}
    for courant in (0.2, 1):
        assert numbers[f"generalized_alpha, peak, Courant {courant}"] < 1.1
        assert numbers[f"generalized_alpha, L2, Courant {courant}"] < 0.125
        assert numbers[f"generalized_alpha, landing_damping 0, peak, Courant {courant}"] < 1.2
        assert numbers[f"generalized_alpha, landing_damping 0, energy lost, Courant {courant}"] < 0.015
    assert numbers["hht, peak, Courant 0.2"] > 1.5
    assert numbers["massless_contact, peak, Courant 0.2"] > 1.3


@pytest.mark.slow
@pytest.mark.parametrize("example", ["front_through_joint"], indirect=True)
def test_front_through_joint(example: ModuleType, tmp_path: Path) -> None:
    """What the default leaves behind a front, and why HHT stays where loads grow slowly."""
    numbers = example.main(["--quick", "-o", str(tmp_path)])
    assert _figures(tmp_path) == {"front_through_joint.png"}
    assert numbers["default, pressure after separation, %"] < 0.3 < numbers["hht, pressure after separation, %"]
    hht, default = (numbers[f"crushing, 6 elements, {s}: L2 error, %"] for s in ("hht", "generalized_alpha"))
    assert hht < 1.0 < default


@pytest.mark.slow
@pytest.mark.parametrize("example", ["estimated_error"], indirect=True)
def test_estimated_error(example: ModuleType, tmp_path: Path) -> None:
    """Against closed solutions the true error is below the estimate."""
    numbers = example.main(["--quick", "-o", str(tmp_path)])
    assert _figures(tmp_path) == {"estimated_error.png"}
    for quantity, mesh in (("wall.impulse", 0.5), ("wall.impulse", 1.0), ("fault.friction_work", 0.4)):
        assert 0.0 < numbers[f"true_{quantity}_{mesh:g}"] < numbers[f"estimated_{quantity}_{mesh:g}"] < 0.05


@pytest.mark.slow
@pytest.mark.parametrize("example", ["prestress"], indirect=True)
def test_prestress(example: ModuleType, tmp_path: Path) -> None:
    """A stack in contact under a force against the exact column, and its ring-down."""
    numbers = example.main(["--quick", "-o", str(tmp_path)])
    assert _figures(tmp_path) == {"prestress.png"}
    assert numbers["modes against the column, %"] < 1.0
    assert numbers["ring-down against modes, %"] < 0.5


@pytest.mark.parametrize("example", ["joint_damping"], indirect=True)
def test_fit_of_a_ring_down(example: ModuleType) -> None:
    time = np.linspace(0.0, 12e-3, 400)
    for zeta in (1e-4, 3e-2):
        w = 2 * np.pi * 163.0
        bending = 1e-5 * np.exp(-zeta * w * time) * np.cos(w * time - 0.7) + 2e-6 + 1e-4 * time
        np.testing.assert_allclose(example.fit(time, bending), (1e-5, 163.0, zeta), rtol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("example", ["joint_damping"], indirect=True)
def test_joint_damping(example: ModuleType, tmp_path: Path) -> None:
    """A hard hit: friction in the joint takes several per cent of a cycle, and the frequency is below that of small
    motions, 174 Hz."""
    numbers = example.main(["--quick", "-o", str(tmp_path)])
    assert _figures(tmp_path) == {"joint_damping.png"}
    assert 0.02 < numbers["damping_1000_N"] < 0.08
    assert 155.0 < numbers["frequency_Hz_1000_N"] < 168.0


@pytest.mark.slow
@pytest.mark.parametrize("example", ["thin_beam"], indirect=True)
def test_thin_beam(example: ModuleType, tmp_path: Path) -> None:
    """The crown at 0.1 mm: the measured frequency, and less damping than measured."""
    numbers = example.main(["--quick", "-o", str(tmp_path)])
    assert _figures(tmp_path) == {"thin_beam.png"}
    assert numbers["crown_friction_0.6: frequency, Hz"] == pytest.approx(80.40, rel=0.005)
    assert 0.0 < numbers["crown_friction_0.6: damping at 100 um, %"] < 0.096


@pytest.mark.parametrize("example", ["thin_beam"], indirect=True)
def test_exponent_of_the_damping(example: ModuleType) -> None:
    sizes = np.geomspace(10e-6, 100e-6, 7)
    rows = np.stack([sizes, np.full(7, 80.0), 3.0 * sizes**1.5], axis=1)
    assert example.exponent(rows) == pytest.approx(1.5)
    rows[:5, 2] = 0.0
    assert np.isnan(example.exponent(rows))


@pytest.mark.slow
@pytest.mark.parametrize("example", ["electronics_box"], indirect=True)
def test_electronics_box(example: ModuleType, tmp_path: Path) -> None:
    """The first 0.3 ms with two coefficients of friction: the board slips less on the bosses where it rubs more."""
    numbers = example.main(["--quick", "-o", str(tmp_path)])
    assert _figures(tmp_path) == {"electronics_box.png"}
    assert 0.0 < numbers["friction 0.3: slip, um"] < numbers["friction 0.1: slip, um"]
    assert 900.0 < numbers["friction 0.3: smallest tension, N"] < 1000.0
