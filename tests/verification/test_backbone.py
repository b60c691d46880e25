"""Backbones of joints: a mass on Jenkins elements and a lap in closed form, a clamp against its linear modes, a
ring-down.

A Jenkins element is a spring k_s on a block that slides under f = mu N. With a spring k beside n of them, the mass m at
the amplitude u meets the force F = k u + sum min(k_s u, f) (Masing), and a loop loses D = sum 4 f max(u - f / k_s, 0):

    omega^2 = F / (m u),    zeta = D / (2 pi F u)

A bar of stiffness E A, free over a length L and pressed between rough planes behind it, slides over s = F / f, f the
friction per length (Goodman, Klumpp, J. Appl. Mech. 23 (1956) 421):

    u = F L / (E A) + F^2 / (2 f E A),    D = 2 F^3 / (3 f E A)
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import latin_fmu
from latin_fmu.cli import main
from latin_fmu.errors import InputError, SolverError
from latin_fmu.modal.backbone import LOOPS, Backbone, Loop
from tests.scenes import clamp

SIDE, K = 0.02, 2e6
MASS = 7800.0 * SIDE**3
SPRINGS, LIMITS = (1e6, 1e6), (10.0, 60.0)  # they slide from 10 and 60 um on


def chain() -> dict[str, Any]:
    """A rigid mass that moves along x, on a spring and on two Jenkins elements beside each other."""
    point = {"substructure": "mass", "point": [SIDE / 2] * 3}
    made: dict[str, Any] = {
        "name": "jenkins",
        "material": {
            "steel": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0},
            "light": {"young_modulus": 210e9, "poisson_ratio": 0.0, "density": 10.0},
        },
        "substructure": {
            "mass": {"material": "steel", "rigid": True, "box": {"size": [SIDE] * 3, "elements": [1, 1, 1]}}
        },
        "interface": {},
        "spring": {"k": {"ends": [point, "ground"], "direction": [1.0, 0.0, 0.0], "stiffness": K}},
        "boundary": {"guide": {"type": "fixed", "face": "mass.zmin", "components": ["y", "z"]}},
        "load": {},
        "sensor": {"tip": {"face": "mass.xmax"}},
        "time": {"end": 1e-3, "instants": 100, "start": "static"},
    }
    for i, (stiffness, limit) in enumerate(zip(SPRINGS, LIMITS, strict=True)):
        box = {"origin": [0.0, 0.03 * (i + 1), 0.0], "size": [0.01] * 3, "elements": [1, 1, 1]}
        made["substructure"][f"s{i}"] = {"material": "light", "box": box}
        made["interface"][f"f{i}"] = {"sides": [f"s{i}.zmin", "ground"], "friction_coefficient": 0.3}
        made["load"][f"p{i}"] = {"face": f"s{i}.zmax", "pressure": limit / 0.3 / 1e-4}
        made["boundary"][f"y{i}"] = {"type": "symmetry", "face": f"s{i}.ymin"}
        ends = [point, {"face": f"s{i}.zmin"}]
        made["spring"][f"k{i}"] = {"ends": ends, "direction": [1.0, 0.0, 0.0], "stiffness": stiffness}
    return made


def exact(u: float) -> tuple[float, float, float]:
    """Frequency, Hz, damping ratio and loss, J, at an amplitude."""
    pairs = list(zip(SPRINGS, LIMITS, strict=True))
    force = K * u + sum(min(k * u, f) for k, f in pairs)
    loss = sum(4 * f * max(u - f / k, 0.0) for k, f in pairs)
    return float(np.sqrt(force / u / MASS)) / (2 * np.pi), loss / (2 * np.pi * force * u), loss


@pytest.mark.parametrize("loop", LOOPS)
def test_jenkins_elements(loop: Loop) -> None:
    """Secant and loss at three amplitudes; none, one and two elements slide."""
    wanted = [5e-6, 20e-6, 100e-6]
    curve = latin_fmu.backbone(latin_fmu.scene_from_dict(chain()), 1, wanted[::-1], "tip", loop=loop)
    assert curve.linear_frequency == pytest.approx(np.sqrt((K + sum(SPRINGS)) / MASS) / (2 * np.pi), rel=1e-5)
    assert curve.amplitude == pytest.approx(wanted, rel=0.01)
    assert curve.slipping.tolist()[-1] == 8
    assert loop == "full" or curve.slipping.tolist() == [0, 4, 8]
    for u, *found in zip(curve.amplitude, curve.frequency, curve.damping, curve.loss, strict=True):
        frequency, damping, loss = exact(u)
        assert found[0] == pytest.approx(frequency, rel=1e-6)
        assert found[1] == pytest.approx(damping, rel=1e-6, abs=1e-9)
        assert found[2] == pytest.approx(loss, rel=1e-6, abs=1e-12)
    assert curve.amplitude[0] == pytest.approx(5e-6, rel=1e-6)


def test_the_loads_of_the_linear_mode_make_other_amplitudes() -> None:
    """Loops of those loads alone, as many times as they are asked for: with F the force of the linear mode."""
    scene, wanted = latin_fmu.scene_from_dict(chain()), 100e-6
    curve = latin_fmu.backbone(scene, 1, [wanted], "tip", within=np.inf)
    slid = ((K + sum(SPRINGS)) * wanted - sum(LIMITS)) / K
    assert curve.amplitude[0] == pytest.approx(slid, rel=1e-6)
    near = latin_fmu.backbone(scene, 1, [wanted], "tip", within=1e-4)
    assert near.amplitude[0] == pytest.approx(wanted, rel=1e-4)


def test_an_amplitude_that_friction_cannot_hold() -> None:
    """Without a spring beside them the elements slide away under more than both forces of friction; below, the first
    slides and the second holds, up to the 60 um from which on it slides."""
    data = chain()
    del data["spring"]["k"]
    with pytest.raises(SolverError, match=r"amplitude not reached: 1.000 mm is wanted.*makes") as caught:
        latin_fmu.backbone(latin_fmu.scene_from_dict(data), 1, [1e-3], "tip", increments=1)
    found = re.search(r"ask for at most ([\d.]+) um", str(caught.value))
    assert found is not None
    assert 20.0 < float(found[1]) <= 60.1
    curve = latin_fmu.backbone(latin_fmu.scene_from_dict(data), 1, [50e-6], "tip")
    assert curve.amplitude[0] == pytest.approx(50e-6, rel=0.01)


def thrown() -> dict[str, Any]:
    """A block that moves onto another at the start."""
    box = {"size": [0.01] * 3, "elements": [1, 1, 1]}
    return {
        "name": "thrown",
        "material": {"steel": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}},
        "substructure": {
            "low": {"material": "steel", "box": box},
            "up": {
                "material": "steel",
                "box": {**box, "origin": [0.0, 0.0, 0.01]},
                "initial_velocity": [1.0, 0.0, -5.0],
            },
        },
        "interface": {"strike": {"sides": ["low.zmax", "up.zmin"], "friction_coefficient": 0.2}},
        "boundary": {"base": {"type": "fixed", "face": "low.zmin"}},
        "gravity": {"acceleration": [0.0, 0.0, -9.81]},
        "time": {"end": 1e-5, "instants": 100},
    }


def test_a_body_that_moves_at_the_start_is_no_part_of_an_equilibrium() -> None:
    with pytest.raises(InputError, match=r"substructure.up: it moves at t = 0.*initial_velocity"):
        latin_fmu.backbone(latin_fmu.scene_from_dict(thrown()), 1, [1e-6])


FREE, LAP, WIDE, THICK, TIP = 0.05, 0.02, 0.01, 0.5e-3, 0.5  # m, and the mass at the end, kg
EA, ROUGH = 210e9 * WIDE * THICK, 0.3 * 10e6 * WIDE  # N; N/m


def bar(**tables: Any) -> dict[str, Any]:
    """Half of a bar between rough planes, its middle plane above, and a mass at its free end; it moves along x."""
    light = {"young_modulus": 210e9, "poisson_ratio": 0.0, "density": 1.0}
    held = [("free", "zmax"), ("free", "ymin"), ("lap", "ymin"), ("free", "ymax"), ("lap", "ymax")]
    return {
        "name": "bar",
        "material": {"steel": light},
        "substructure": {
            "free": {
                "material": "steel",
                "box": {"origin": [LAP, 0.0, 0.0], "size": [FREE, WIDE, THICK], "elements": [10, 1, 1]},
            },
            "lap": {"material": "steel", "box": {"size": [LAP, WIDE, THICK], "elements": [40, 1, 1]}},
        },
        "point_mass": {"tip": {"face": "free.xmax", "mass": TIP}},
        "interface": {
            "rub": {"sides": ["lap.zmin", "ground"], "friction_coefficient": 0.3},
            "bond": {"sides": ["lap.xmax", "free.xmin"], "behaviour": "perfect"},
        },
        "boundary": {f"{body}_{side}": {"type": "symmetry", "face": f"{body}.{side}"} for body, side in held},
        "load": {"press": {"face": "lap.zmax", "pressure": 10e6}, **tables.pop("load", {})},
        "sensor": {"tip": {"face": "free.xmax"}},
        "time": {"end": 1e-3, "instants": 100, "start": "static"},
        **tables,
    }


def of_bar(amplitude: float) -> tuple[float, float]:
    """Frequency, Hz, and damping ratio in closed form."""
    force = ROUGH * (np.sqrt(FREE**2 + 2 * amplitude * EA / ROUGH) - FREE)
    loss = 2 * force**3 / (3 * ROUGH * EA)
    return float(np.sqrt(force / amplitude / TIP)) / (2 * np.pi), loss / (2 * np.pi * force * amplitude)


@pytest.fixture(scope="module")
def of_lap() -> Backbone:
    return latin_fmu.backbone(latin_fmu.scene_from_dict(bar()), 1, np.geomspace(5e-6, 20e-6, 5), "tip")


def test_a_lap_that_slides_from_its_edge(of_lap: Backbone) -> None:
    """Frequency to half an element in the free length, whose share in omega is half of that in the compliance; damping
    to that in the length that slides."""
    for u, frequency, damping in zip(of_lap.amplitude, of_lap.frequency, of_lap.damping, strict=True):
        wanted = of_bar(u)
        sliding = 2 * np.pi * wanted[0] * 2 * np.pi * wanted[0] * TIP * u / ROUGH
        assert frequency == pytest.approx(wanted[0], rel=0.5 * (0.5 * LAP / 40) / FREE)
        assert damping == pytest.approx(wanted[1], rel=0.5 * (LAP / 40) / sliding + 0.01)
    assert of_lap.slipping[-1] > 40


def test_ring_down_of_jenkins_elements() -> None:
    """The mass released from 200 um on a stiffer spring: frequency within .2 %, damping within 10 % of the backbone at
    two amplitudes; time scheme and iteration add less than .01 %."""
    law = {"type": "table", "times": [0.0, 1e-9], "values": [1.0, 0.0]}
    data = chain()
    data["spring"]["k"]["stiffness"] = 10 * K
    levels = np.geomspace(20e-6, 150e-6, 9)
    curve = latin_fmu.backbone(latin_fmu.scene_from_dict(data), 1, levels, "tip", loop="masing")
    data["load"]["pull"] = {"face": "mass.xmax", "force": [10 * K * 200e-6, 0.0, 0.0], "law": law}
    data["time"] = {"end": 0.04, "step": 4e-6, "start": "static"}
    data["solver"] = {"tolerance": 1e-8}
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(data))
    assert len(solution.time) == 10_001
    found = latin_fmu.ring_down(solution.to_datatree(), "tip", (2e3, 4e3))
    sizes = found["amplitude"].values
    assert sizes.max() > 100e-6
    for wanted in (100e-6, 30e-6):
        at = int(np.abs(np.log(sizes / wanted)).argmin())
        assert sizes[at] == pytest.approx(wanted, rel=0.2)
        rule = np.log(sizes[at]), np.log(curve.amplitude)
        assert float(found["frequency"][at]) == pytest.approx(np.interp(*rule, curve.frequency), rel=2e-3)
        assert float(found["damping"][at]) == pytest.approx(np.interp(*rule, curve.damping), rel=0.1)
    held = sizes < 9.99e-6  # no element slides
    assert held.sum() > 5
    assert np.abs(found["damping"].values[held]).max() < 1e-4


@pytest.fixture(scope="module")
def clamped() -> Backbone:
    return latin_fmu.backbone(latin_fmu.scene_from_dict(clamp()), 1, [1e-6, 1e-5, 1e-4], "tip")


def test_small_amplitudes_are_linear(clamped: Backbone) -> None:
    """Nothing slides at 1 um: the frequency of the linear mode, no loss; more amplitude, lower and more damped."""
    linear = latin_fmu.vibration_modes(latin_fmu.scene_from_dict(clamp()), count=1).frequency[0]
    assert clamped.linear_frequency == pytest.approx(linear, rel=1e-12)
    assert clamped.frequency[0] == pytest.approx(linear, rel=1e-7)
    assert clamped.damping[0] < 1e-8
    assert clamped.slipping[0] == 0
    assert (np.diff(clamped.frequency) < -1.0).all()
    assert (np.diff(clamped.damping) > 5e-4).all()
    assert clamped.amplitude[0] == pytest.approx(1e-6, rel=1e-6)


def test_increments_hardly_count(clamped: Backbone) -> None:
    twice = latin_fmu.backbone(latin_fmu.scene_from_dict(clamp()), 1, [1e-6, 1e-5, 1e-4], "tip", increments=8)
    assert twice.frequency == pytest.approx(clamped.frequency, rel=2e-4)
    assert twice.damping == pytest.approx(clamped.damping, rel=0.1, abs=1e-9)


def test_a_free_assembly_in_balance() -> None:
    """Nothing holds the clamp: rigid motions have no part in amplitude and frequency."""
    free = latin_fmu.scene_from_dict(clamp(boundary={}, load={}))
    curve = latin_fmu.backbone(free, 1, [1e-8])
    modes = latin_fmu.vibration_modes(free, count=1)
    assert modes.n_rigid == 7  # a plate may turn about the edge at which the jaws hold it, too
    assert curve.frequency[0] == pytest.approx(modes.frequency[7], rel=1e-5)
    assert curve.amplitude[0] == pytest.approx(1e-8, rel=1e-5)


@pytest.mark.parametrize(
    ("mode", "amplitudes", "sensor", "options", "words"),
    [
        (0, [1e-6], None, {}, "mode"),
        (10**6, [1e-6], None, {}, "fewer elastic modes"),
        (1, [], None, {}, "amplitude"),
        (1, [-1e-6], None, {}, "amplitude"),
        (1, [1e-6], "tipp", {}, "did you mean 'tip'"),
        (1, [1e-6], None, {"loop": "whole"}, "half, full, masing"),
        (1, [1e-6], None, {"increments": 0}, "1 to 1000"),
        (1, [1e-6], None, {"tolerance": 0.0}, "tolerance"),
        (1, [1e-6], None, {"within": 0.0}, "within"),
        (1, [1e-20, 1e-6, 1.0], None, {}, r"no amplitude of an assembly of this size.*1e-20, 1\);"),
        (1, [1e300], None, {}, "no amplitude of an assembly of this size"),
    ],
)
def test_refused(mode: int, amplitudes: list[float], sensor: str | None, options: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        latin_fmu.backbone(latin_fmu.scene_from_dict(chain()), mode, amplitudes, sensor, **options)


def test_nothing_presses_the_joint() -> None:
    data = bar()
    del data["load"]["press"]
    with pytest.raises(InputError, match="nothing presses"):
        latin_fmu.backbone(latin_fmu.scene_from_dict(data), 1, [1e-6])


def test_area_of_a_loop_is_the_work_of_friction() -> None:
    """Force and displacement at the sensor, N and m, do the work of the modal load on its displacement."""
    made = latin_fmu.backbone(latin_fmu.scene_from_dict(chain()), 1, [5e-5], sensor="tip", increments=10, within=np.inf)
    force, moved = made.sensor_force, made.sensor_displacement
    # the largest loop is measured the second time; from +alpha to -alpha is half of it
    first = np.flatnonzero(force > 0.999 * force.max())[1]
    half = slice(first, first + int(np.argmin(force[first:])) + 1)
    assert 2 * np.trapezoid(force[half], moved[half]) == pytest.approx(made.loss[0], rel=1e-6)
    assert np.ptp(moved[half]) / 2 == pytest.approx(made.amplitude[0], rel=1e-6)


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Table, dataset with units and figure; measured points in um and %."""
    scene, stem, points = tmp_path / "scene.toml", tmp_path / "curve", tmp_path / "test.csv"
    scene.write_text(latin_fmu.scene_from_dict(chain()).text())
    points.write_text("um;Hz;percent\n10;1100;0.1\n100;950;1.4\n")
    words = ["backbone", str(scene), "--amplitude", "5um:0.05mm", "--points", "3", "--sensor", "tip", "-o", str(stem)]
    assert main([*words, "--measured", str(points), "--measured-units", "um", "%"]) == 0
    out = capsys.readouterr().out
    assert "mode 1, 1274.26" in out
    assert "fewer than 40 points slide" in out
    tree = xr.open_datatree(f"{stem}.nc")
    assert tree["backbone/amplitude"].attrs["units"] == "m"
    assert tree["backbone/frequency"].values[0] == pytest.approx(exact(5e-6)[0], rel=1e-4)
    force, moved = tree["loops/sensor_force"], tree["loops/sensor_displacement"]
    assert (force.attrs["units"], moved.attrs["units"]) == ("N", "m")
    rows = np.loadtxt(f"{stem}.csv", delimiter=",", skiprows=1)
    assert rows[:, 1] == pytest.approx(tree["backbone/frequency"].values)
    tree.close()
    assert (tmp_path / "curve.png").stat().st_size > 10_000
    for option, value, said in (
        ("--amplitude", "5um:1um", "no range of amplitudes"),
        ("--amplitude", "five", "no range of amplitudes"),
        ("--points", "0", "out of range"),
        ("--measured", str(tmp_path / "none.csv"), "does not exist"),
    ):
        assert main([*words, option, value]) == 2
        assert said in capsys.readouterr().err
    assert main([*words, "--measured", str(points), "--measured-units", "furlong", "1"]) == 2
    assert "unknown unit" in capsys.readouterr().err
