"""Damping ratios of modes that ``modes`` prints, against free ring-downs in ordinary runs and against closed forms.

A ring-down starts with the velocities of one mode. The decrement is taken between the first and the last ten periods,
weighted by Hann's window, which leaves out the few per cent of other modes that the mass of a scheme brings in.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.building import discretise
from latin_fmu.cli import main
from latin_fmu.joined.modal_damping import LIMIT, scheme_damping
from latin_fmu.latin.outcome import Outcome
from latin_fmu.march import march
from latin_fmu.modal.modes import VibrationModes, vibration_modes
from latin_fmu.stability.scenes import Box, Material, column
from latin_fmu.statics.statics import tightened
from latin_fmu.time_scheme import HHT, CentralDifference, GeneralizedAlpha, Newmark, TimeScheme

from .bolted_meshes import write_joint
from .test_bolts import joint

PERIODS, WINDOW, STICK = 30, 10, 1
ALPHA: dict[str, Any] = {"type": "generalized_alpha"}
UNDAMPED_LANDING = ALPHA | {"landing_damping": 0.0}
JOINT: dict[str, Any] = {"friction_coefficient": 10.0, "preload": 1e7}


def pair(step: float, instants: int = 1, scheme: Any = "automatic", **tables: Any) -> dict[str, Any]:
    """Two steel bars end to end, pressed together and held at the bottom; nothing slips. ``joint`` : of the interface,
    ``keys`` : of the material."""
    steel = Material(210e9, 7800.0, 0.3, name="steel", keys=tables.pop("keys", {}))
    bar, law = Box(steel, (0.02, 0.03, 0.1), (2, 2, 6)), tables.pop("joint", JOINT)
    time = {"end": instants * step, "instants": instants, "scheme": scheme}
    clamp = {"clamp": {"type": "fixed", "face": "low.zmin"}}
    fixed = {"boundary": clamp, "solver": {"tolerance": 1e-9}, "output": {"fields": True}}
    return column({"low": bar, "up": bar}, {"joint": law}, time, **(fixed | tables))


def modes_of(scene: dict[str, Any], count: int = 5) -> VibrationModes:
    return vibration_modes(latin_fmu.scene_from_dict(scene), count=count)


def ringing(modes: VibrationModes, mode: int, step: float, scheme: Any, **tables: Any) -> float:
    """Damping ratio of the decay of a mode over its periods in a run that starts with its shape as velocity."""
    frequency = modes.frequency[mode]
    scene = pair(step, round(PERIODS / (frequency * step)), scheme, **tables)
    for name, table in scene["substructure"].items():
        points, values = modes.meshes[name].nodes.tolist(), (1e-3 * modes.shapes[name][mode]).tolist()
        table["initial_velocity_field"] = {"file": "mode", "points": points, "values": values}
    return decay_of(latin_fmu.solve(latin_fmu.scene_from_dict(scene)).outcome, modes, mode, step)


def decay_of(outcome: Outcome, modes: VibrationModes, mode: int, step: float) -> float:
    """Damping ratio of the motion along a mode; the contacts stick at every instant."""
    assert outcome.converged
    for history in outcome.interfaces.values():
        assert history.contact_status is None or (history.contact_status == STICK).all()
    motion = sum(
        np.einsum("tnc,nc->t", history.displacement - history.displacement[0], modes.shapes[name][mode])
        for name, history in outcome.substructures.items()
    )
    return decrement(np.asarray(motion), 2 * np.pi * modes.frequency[mode] * step)


def decrement(motion: np.ndarray, angle: float) -> float:
    """Damping ratio of an oscillation of about ``angle`` per step, its frequency that of the motion itself."""
    n = round(WINDOW * 2 * np.pi / angle)
    weights = np.hanning(n) * np.exp(-1j * angle * np.arange(n))
    first, later, last = (weights @ motion[at : at + n] for at in (0, 1, len(motion) - n))
    turned = angle + np.angle(later / first * np.exp(-1j * angle))
    decay = np.log(abs(first) / abs(last)) / (len(motion) - n)
    return float(decay / np.hypot(decay, turned))


def test_the_decrement_of_a_known_motion() -> None:
    zeta, angle = 2e-3, 0.4
    steps = np.arange(500)
    motion = np.exp(-zeta * angle * steps) * np.cos(np.sqrt(1 - zeta**2) * angle * steps + 0.3) + 0.1
    assert decrement(motion, 0.39) == pytest.approx(zeta, rel=1e-3)


@pytest.mark.parametrize("scheme", ["hht", {"type": "hht", "alpha": -0.3}, ALPHA, UNDAMPED_LANDING])
@pytest.mark.parametrize("mode", [0, 4])
def test_a_ring_down_decays_as_predicted(scheme: Any, mode: int) -> None:
    """First and fifth mode at 15 steps a period: within 3 %, ratios from 4e-5 to 5e-3."""
    step = 1 / (15 * modes_of(pair(1e-6)).frequency[mode])
    modes = modes_of(pair(step, scheme=scheme))
    assert modes.damping is not None
    assert ringing(modes, mode, step, scheme) == pytest.approx(modes.damping.numerical[mode], rel=0.03)


def test_all_modes_with_the_same_step() -> None:
    """One printed table: from 2.8e-6 in mode 1, with 97 steps a period, to 1.3e-3 in mode 5 with 12."""
    step = 1 / (12 * modes_of(pair(1e-6)).frequency[4])
    modes = modes_of(pair(step))
    assert modes.damping is not None
    assert modes.damping.time_scheme.startswith("hht (no body lands")
    assert modes.damping.landing.tolist() == [0.0] * 5
    measured = [ringing(modes, mode, step, "automatic") for mode in range(5)]
    assert measured == pytest.approx(modes.damping.numerical.tolist(), rel=0.02)


@pytest.mark.parametrize("scheme", ["newmark", "massless_contact"])
@pytest.mark.parametrize("mode", [0, 3])
def test_undamped_schemes(scheme: str, mode: int) -> None:
    """The ring-down loses less than 1e-6 of critical, and nothing is predicted."""
    step = 1 / (15 * modes_of(pair(1e-6)).frequency[mode])
    modes = modes_of(pair(step, scheme=scheme))
    assert modes.damping is not None
    assert np.abs(modes.damping.numerical).max() < 1e-12
    assert modes.damping.remedy == ""
    assert abs(ringing(modes, mode, step, scheme)) < 1e-6


@pytest.mark.slow
def test_a_bolted_joint(tmp_path: Path) -> None:
    """Two plates under one bolt, tight: the layer gives the third mode 0.3 % of critical."""
    data = joint(write_joint(tmp_path), mu=10.0, solver={"tolerance": 1e-9}, output={"fields": True})
    data["time"] = {"end": 1e-6, "instants": 1, "scheme": ALPHA, "start": {"type": "static", "increments": 1}}
    step = 1 / (15 * modes_of(data).frequency[2])
    data["time"] |= {"end": 450 * step, "instants": 450}
    modes = modes_of(data)
    assert modes.damping is not None
    discretised = discretise(latin_fmu.scene_from_dict(data))
    classes = [  # a bolt, tightened at rest, has no initial velocity in a scene
        replace(c, members=[replace(m, velocity=1e-3 * modes.shapes[m.name][2].ravel()) for m in c.members])
        for c in discretised.classes
    ]
    outcome = march(replace(discretised, classes=classes).build(tightened(discretised, {}))).outcome
    measured = decay_of(outcome, modes, 2, step)
    assert measured == pytest.approx(modes.damping.numerical[2], rel=0.01)
    assert measured > 0.002


@pytest.mark.parametrize(
    "law",
    [
        {"behaviour": "perfect"},
        {"behaviour": "no_slip", "preload": 1e7},
        {"behaviour": "soft_contact", "normal_stiffness": 1e14, "friction_coefficient": 10.0, "preload": 1e7},
        {"behaviour": "elastic_layer", "normal_stiffness": 1e12, "tangential_stiffness": 1e12},
    ],
    ids=lambda law: law["behaviour"],
)
@pytest.mark.parametrize("scheme", ["hht", ALPHA])
def test_other_joints(law: dict[str, Any], scheme: Any) -> None:
    """The layer is viscous at faces that may open, a fifth as much where they are closed from the start, and at no
    others."""
    step = 1 / (15 * modes_of(pair(1e-6, joint=law)).frequency[3])
    modes = modes_of(pair(step, scheme=scheme, joint=law))
    assert modes.damping is not None
    assert (modes.damping.landing[3] > 0.0) == (scheme == ALPHA and law["behaviour"] == "no_slip")
    assert ringing(modes, 3, step, scheme, joint=law) == pytest.approx(modes.damping.numerical[3], rel=0.02)


def test_damping_of_the_bodies() -> None:
    """a / (2 omega) + b omega / 2 of Rayleigh damping, beside the scheme's."""
    step, a, b = 1e-6, 20.0, 1e-8
    modes = modes_of(pair(step, keys={"frame": "absolute", "rayleigh_mass": a, "rayleigh_stiffness": b}))
    assert modes.damping is not None
    omega = 2 * np.pi * modes.frequency
    assert modes.damping.bodies == pytest.approx(a / (2 * omega) + b * omega / 2, rel=1e-6)
    assert "bodies, %" in "\n".join(modes.lines())
    assert "bodies, %" not in "\n".join(modes_of(pair(step)).lines())


@pytest.mark.parametrize("scheme", ["hht", "central_difference"])
def test_a_ring_down_of_damped_bodies(scheme: str) -> None:
    """Scheme and bodies add up; central differences with lumped masses add nothing."""
    step, keys = 1e-6, {"frame": "absolute", "rayleigh_mass": 20.0, "rayleigh_stiffness": 1e-8}
    modes = modes_of(pair(step, scheme=scheme, keys=keys))
    assert modes.damping is not None
    total = modes.damping.numerical[3] + modes.damping.bodies[3]
    assert ringing(modes, 3, step, scheme, keys=keys) == pytest.approx(total, rel=0.03)
    assert modes.damping.numerical[3] < (1e-12 if scheme == "central_difference" else 1e-6)


@pytest.mark.parametrize(("angle", "rel"), [(1e-3, 1e-5), (0.02, 1e-3), (0.1, 2e-2)])
@pytest.mark.parametrize(
    ("scheme", "old"),
    [
        (HHT(-0.1), (0.0, 0.1)),
        (HHT(-0.3), (0.0, 0.3)),
        (GeneralizedAlpha(0.8), (1 / 3, 4 / 9)),
        (GeneralizedAlpha(0.5), (0.0, 1 / 3)),
    ],
)
def test_small_steps_of_the_scheme(scheme: TimeScheme, old: tuple[float, float], angle: float, rel: float) -> None:
    """(a_f - a_m)(1 - a_f - a_m)^2 (omega dt)^3 / 8, from the logarithm of the characteristic polynomial."""
    a_m, a_f = old
    expected = (a_f - a_m) * (1 - a_f - a_m) ** 2 * angle**3 / 8
    assert scheme_damping(scheme, 1e4, angle / 1e4) == pytest.approx(expected, rel=max(rel, 1e-15 / expected))


@pytest.mark.parametrize("angle", [0.01, 0.1, 0.5, 1.5])
def test_schemes_of_second_order_polynomials(angle: float) -> None:
    """Newmark: |z|^2 = (1 + (beta - gamma + 1/2) x) / (1 + beta x), x = (omega dt)^2; central differences: |z| = 1."""
    scheme, x = Newmark(beta=0.3025, gamma=0.6), angle**2
    size = np.sqrt((1 + (0.3025 - 0.1) * x) / (1 + 0.3025 * x))
    zeta = scheme_damping(scheme, 3.0, angle / 3.0)
    trace = 2 - (0.6 + 0.5) * x / (1 + 0.3025 * x)
    turned = np.arccos(trace / (2 * size))
    assert zeta == pytest.approx(-np.log(size) / np.hypot(np.log(size), turned), rel=1e-9)
    assert abs(scheme_damping(CentralDifference(), 3.0, angle / 3.0)) < 1e-14
    assert abs(scheme_damping(Newmark(), 3.0, angle / 3.0)) < 1e-13  # round-off over the angle


def test_a_damped_oscillator_keeps_its_damping_at_small_steps() -> None:
    for scheme in (HHT(), GeneralizedAlpha(), Newmark()):
        assert scheme_damping(scheme, 10.0, 1e-3, 0.03) == pytest.approx(0.03, rel=1e-3)


def test_what_lowers_the_damping_is_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The named steps and keys, set, bring what the line says."""
    step = 1 / (15 * modes_of(pair(1e-6)).frequency[4])

    def printed(scene: dict[str, Any]) -> tuple[str, VibrationModes]:
        file = tmp_path / "scene.toml"
        file.write_text(latin_fmu.scene_from_dict(scene).text())
        assert main(["modes", str(file), "--count", "5"]) == 0
        return capsys.readouterr().out, modes_of(scene)

    text, modes = printed(pair(step))
    assert modes.damping is not None
    assert modes.damping.numerical.max() > LIMIT
    assert "scheme, %" in text
    assert "landing layer, %" in text
    line = text.splitlines()[-1]
    assert line == modes.damping.remedy
    assert line.startswith("numerical damping above 0.005 % of critical in 3 modes, most in mode 5 (0.069 %): ")
    assert (
        "that of the scheme falls with the third power of the step (time.instants = 4 leaves 0.0012 %, with 4" in line
    )
    assert 'time.scheme = {type = "generalized_alpha", landing_damping = 0} leaves 0.0049 %' in line
    text, modes = printed(pair(step / 4))
    assert "numerical damping above" not in text
    assert modes.damping is not None
    assert modes.damping.scheme[4] == pytest.approx(1.16e-5, rel=0.01)

    text, modes = printed(pair(step / 2, scheme=ALPHA))
    assert modes.damping is not None
    assert "that of the landing layer is in proportion to landing_damping" in text
    assert 'time.scheme = {type = "generalized_alpha", landing_damping = 0} leaves' in text
    assert 'time.scheme = "hht" has no layer and leaves 0.0' in text
    assert "that of the scheme" not in text  # 0.005 % at most
    text, modes = printed(pair(step, scheme=UNDAMPED_LANDING))
    assert modes.damping is not None
    assert modes.damping.landing.tolist() == [0.0] * 5
    assert modes.damping.scheme[4] == pytest.approx(5.6e-5, rel=0.02)
    assert "rho_inf = 1, landing_damping = 0} has none" in text.splitlines()[-1]


def test_the_file_has_the_ratios(tmp_path: Path) -> None:
    file = tmp_path / "modes.nc"
    modes = modes_of(pair(2e-6, scheme=ALPHA))
    modes.save(file)
    assert modes.damping is not None
    with latin_fmu.open_results(file) as tree:
        group = tree["modes"]
        assert group["scheme_damping"].values == pytest.approx(modes.damping.scheme)
        assert group["landing_damping"].values == pytest.approx(modes.damping.landing)
        assert group["body_damping"].values.tolist() == [0.0] * 5
        assert group["scheme_damping"].attrs["units"] == "1"
        assert group.attrs["time_scheme"] == "generalized_alpha"
        assert group.attrs["time_step"] == pytest.approx(2e-6)


def test_a_run_without_inertia_has_no_damping_ratios() -> None:
    scene = pair(1e-3)
    scene["time"] = {"end": 1e-3, "instants": 1, "quasi_static": True}
    modes = modes_of(scene)
    assert modes.damping is None
    assert modes.lines()[-1] == "no damping ratios: a quasi-static run has no inertia"
