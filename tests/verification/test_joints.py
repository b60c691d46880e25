"""Elastic layers, soft contact, viscous joints, preload: whole runs against closed forms."""

from __future__ import annotations

import copy
from functools import cache
from typing import Any

import numpy as np
import pytest

from latin_fmu.errors import SceneError
from latin_fmu.reader import scene_from_dict
from latin_fmu.stability.scenes import Box, Material, column
from tests.scenes import solve

AREA, FIRST, SECOND = 0.01, 1.0, 2.0  # m2, kg, kg
REDUCED = 1 / (1 / FIRST + 1 / SECOND)
STIFFNESS, VISCOSITY = 1e8, 1e3
PULSATION = np.sqrt(STIFFNESS * AREA / REDUCED)
DECAY = VISCOSITY * AREA / REDUCED
WINDOWS = [1, 20, "whole"]


def masses(behaviour: str, end: float, n: int, scheme: str = "newmark", window: Any = 1, **keys: Any) -> dict[str, Any]:
    """Two rigid blocks of 1 and 2 kg along z, the first one moving at 1 m s-1."""
    material, rigid = Material(2e11, 1000.0, 0.3), {"rigid": True}
    return column(
        {
            "a": Box(material, (0.1, 0.1, 0.1), (1, 1, 1), (0.0, 0.0, 1.0), rigid),
            "b": Box(material, (0.1, 0.1, 0.2), (1, 1, 1), keys=rigid),
        },
        {"joint": {"behaviour": behaviour, **keys}},
        {"end": end, "instants": n, "scheme": scheme},
        solver={"tolerance": 1e-8, "window": window},
        output={"fields": True, "energy": True},
    )


def spring(**more: Any) -> dict[str, Any]:
    period = 2 * np.pi / PULSATION
    return masses(
        "elastic_layer", 2 * period, 200, normal_stiffness=STIFFNESS, tangential_stiffness=STIFFNESS / 3, **more
    )


@cache
def dashed(window: Any) -> Any:
    """Two masses and a dashpot over two time constants."""
    return solve(
        masses("viscous_joint", 2 / DECAY, 100, window=window, normal_viscosity=VISCOSITY, tangential_viscosity=0.0)
    )


def elongation(outcome: Any) -> np.ndarray:
    a, b = (outcome.substructures[n].displacement[:, 0, 2] for n in "ab")
    return b - a


# -- two masses ---------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("window", WINDOWS)
def test_two_masses_on_a_layer_swing_at_their_frequency(window: Any) -> None:
    """Average acceleration: sin w t with the pulsation tan(w' dt / 2) = w dt / 2 of the scheme, to the tolerance."""
    outcome = solve(spring(window=window))
    t = outcome.time
    dt = t[1] - t[0]
    shifted = 2 / dt * np.arctan(PULSATION * dt / 2)
    exact = -np.sin(shifted * t) / PULSATION
    np.testing.assert_allclose(elongation(outcome), exact, atol=2e-6 / PULSATION)
    assert shifted == pytest.approx(PULSATION, rel=4e-4)
    force = outcome.interfaces["joint"].force()[:, 2]
    np.testing.assert_allclose(force, STIFFNESS * AREA * elongation(outcome), atol=1e-6 * np.abs(force).max())


def test_energy_goes_into_the_layer_and_comes_back() -> None:
    energy = solve(spring()).energy
    total = energy["kinetic"] + energy["layer_energy"]
    np.testing.assert_allclose(total, total[0], rtol=1e-7)
    np.testing.assert_allclose(energy["interface_work"], -energy["layer_energy"], atol=1e-7 * total[0])
    assert energy["layer_energy"].max() == pytest.approx(0.5 * REDUCED, rel=1e-3)
    assert np.abs(energy["balance"]).max() < 1e-12 * total[0]


@pytest.mark.parametrize("scheme", ["hht", "central_difference"])
def test_other_schemes_swing_alike(scheme: str) -> None:
    outcome = solve(spring(scheme=scheme))
    exact = -np.sin(PULSATION * outcome.time) / PULSATION
    np.testing.assert_allclose(elongation(outcome), exact, atol=1e-2 / PULSATION)


@pytest.mark.parametrize("window", WINDOWS)
def test_two_masses_and_a_dashpot_lose_their_relative_speed(window: Any) -> None:
    outcome = dashed(window)
    velocity = outcome.interfaces["joint"].velocity[:, :, 0, 2]
    exact = -np.exp(-DECAY * outcome.time)
    np.testing.assert_allclose(velocity[:, 1] - velocity[:, 0], exact, atol=3e-5)


def test_dashpot_takes_the_energy_of_the_relative_motion() -> None:
    outcome = dashed(1)
    energy, t = outcome.energy, outcome.time
    lost = 0.5 * REDUCED * (1 - np.exp(-2 * DECAY * t))
    np.testing.assert_allclose(energy["joint_dissipation"], lost, atol=2e-4 * lost[-1])
    np.testing.assert_allclose(energy["interface_work"], -energy["joint_dissipation"], atol=1e-3 * lost[-1])
    assert outcome.interfaces["joint"].joint_power.min() > 0
    assert "layer_energy" not in energy


@pytest.mark.parametrize("window", WINDOWS)
def test_soft_impact_is_elastic(window: Any) -> None:
    """Half a swing of the layer, then free: velocities exchanged as in an elastic impact, the energy with them."""
    period = 2 * np.pi / PULSATION
    outcome = solve(masses("soft_contact", 0.75 * period, 150, window=window, normal_stiffness=STIFFNESS))
    final = [outcome.substructures[n].velocity[-1, 0, 2] for n in "ab"]
    np.testing.assert_allclose(final, [-1 / 3, 2 / 3], atol=2e-5)
    history = outcome.interfaces["joint"]
    contact = outcome.time[history.normal_resultant() > 0]
    assert contact[-1] == pytest.approx(period / 2, abs=2 * outcome.time[1])
    assert history.contact_status.max() == 2
    assert history.penetration() == 0.0
    assert outcome.energy["contact_dissipation"].max() == 0.0
    assert outcome.energy["layer_energy"].max() == pytest.approx(0.5 * REDUCED, rel=1e-3)


def test_nothing_is_lost_where_a_run_is_cut() -> None:
    """The layer takes its displacements from the bodies."""
    from latin_fmu.cosim.segments import SegmentedRun

    tables = spring()
    end, n = tables["time"]["end"], tables["time"]["instants"]
    run = SegmentedRun(scene_from_dict(copy.deepcopy(tables)))
    parts = [run.advance(end * k / n, m) for k, m in ((n // 4, n // 4), (n // 2, n // 2 - n // 4), (n, n - n // 2))]
    assert all(p.accepted for p in parts)
    exact = -np.sin(PULSATION * end) / PULSATION
    moved = [run.displacement(n)[0, 2] for n in "ab"]
    assert moved[1] - moved[0] == pytest.approx(exact, abs=2e-2 / PULSATION)
    energy = parts[-1].energy
    np.testing.assert_allclose(energy["kinetic"] + energy["layer_energy"], 0.5 * FIRST, rtol=1e-6)


# -- waves --------------------------------------------------------------------------------------------------------
SOUND = np.sqrt(210e9 / 7800.0)
IMPEDANCE = 7800.0 * SOUND


def bars(behaviour: str, **keys: Any) -> dict[str, Any]:
    """Two bars of 0.5 m; a step of 2 x 1 MPa on an absorbing end launches 1 MPa towards the joint; far end absorbs."""
    bar = Box(Material(210e9, 7800.0), (0.02, 0.02, 0.5), (1, 1, 100))
    ends = {"left": "a.zmin", "right": "b.zmax"}
    return column(
        {"a": bar, "b": bar},
        {"joint": {"behaviour": behaviour, **keys}},
        {"end": 1.8 * 0.5 / SOUND, "instants": 180},
        boundary={name: {"type": "absorbing", "face": face} for name, face in ends.items()},
        load={"step": {"face": "a.zmin", "pressure": 2e6, "law": "step"}},
        output={"energy": True},
    )


def behind_the_front(outcome: Any) -> np.ndarray:
    """Time since the wave met the joint; a step sampled at the instants starts half a step late."""
    return np.maximum(outcome.time - 0.5 / SOUND - 0.5 * outcome.time[1], 0.0)


@pytest.mark.parametrize("ratio", [0.25, 1.0, 4.0])
def test_wave_through_an_elastic_layer(ratio: float) -> None:
    """Transmitted stress sigma (1 - exp(-2 k t / Z)) behind the front, the rest is reflected."""
    stiffness = ratio * IMPEDANCE * SOUND / 0.5
    outcome = solve(bars("elastic_layer", normal_stiffness=stiffness, tangential_stiffness=stiffness))
    t = behind_the_front(outcome)
    impulse = -outcome.interfaces["joint"].impulse(outcome.time)[:, 2] / 4e-4
    tau = IMPEDANCE / (2 * stiffness)
    exact = 1e6 * (t - tau * (1 - np.exp(-t / tau)))
    assert np.abs(impulse - exact).max() < 1.5e-2 * exact[-1]
    assert impulse[-1] == pytest.approx(exact[-1], rel=1e-3)
    stress = -outcome.interfaces["joint"].force()[-1, 2] / 4e-4
    assert stress == pytest.approx(1e6 * (1 - np.exp(-t[-1] / tau)), rel=1e-2)


@pytest.mark.parametrize("ratio", [0.1, 0.5, 3.0])
def test_wave_through_a_viscous_joint(ratio: float) -> None:
    """Transmission 2c / (2c + Z) of the stress, at once."""
    outcome = solve(bars("viscous_joint", normal_viscosity=ratio * IMPEDANCE, tangential_viscosity=0.0))
    t = behind_the_front(outcome)
    impulse = -outcome.interfaces["joint"].impulse(outcome.time)[:, 2] / 4e-4
    exact = 1e6 * t * 2 * ratio / (2 * ratio + 1)
    assert np.abs(impulse - exact).max() < 1.5e-2 * exact[-1]
    assert impulse[-1] == pytest.approx(exact[-1], rel=1e-3)


def test_matched_dashpot_against_the_ground_absorbs() -> None:
    """c = rho c on a face against the ground is the absorbing end."""
    tables = bars("perfect")
    del tables["boundary"]["right"]
    tables["interface"]["out"] = {
        "sides": ["b.zmax", "ground"],
        "behaviour": "viscous_joint",
        "normal_viscosity": IMPEDANCE,
        "tangential_viscosity": IMPEDANCE,
    }
    tables["time"] = {"end": 3.8 * 0.5 / SOUND, "instants": 380}
    outcome = solve(tables)
    stress = -outcome.interfaces["joint"].force()[:, 2] / 4e-4
    late = outcome.time > 3.2 * 0.5 / SOUND
    np.testing.assert_allclose(stress[late], 1e6, rtol=2e-2)


# -- preload ------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "pressed",
    [
        {"behaviour": "contact", "preload": 3e5},
        {"behaviour": "contact", "preload_force": 3e5 * 4e-4},
        {"behaviour": "elastic_layer", "preload": 3e5, "normal_stiffness": 1e14, "tangential_stiffness": 1e14},
        {"behaviour": "soft_contact", "preload_force": 3e5 * 4e-4, "normal_stiffness": 1e14},
    ],
    ids=["pressure", "bolt", "glued", "soft_bolt"],
)
def test_preload_lets_a_tension_wave_through_up_to_its_level(pressed: dict[str, Any]) -> None:
    """A tension of 1 MPa meets a joint pressed with 0.3 MPa: a contact passes 0.3 MPa and opens, a glued one all.

    Tractions at rest are the preload and nothing moves before the wave.
    """
    tables = bars(**pressed)
    tables["load"]["step"]["pressure"] = -2e6
    outcome = solve(tables)
    stress = -outcome.interfaces["joint"].force()[:, 2] / 4e-4
    before = outcome.time < 0.7 * 0.5 / SOUND
    np.testing.assert_allclose(stress[before], 3e5, rtol=2e-3)
    passed = 3e5 - stress[-1]
    if pressed["behaviour"] == "elastic_layer":
        assert passed == pytest.approx(1e6, rel=2e-2)
    else:
        assert passed == pytest.approx(3e5, rel=1e-6)
        assert outcome.interfaces["joint"].gap[-1].min() > 0


# -- wrong scenes -------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("interface", "where"),
    [
        ({"behaviour": "elastic_layer"}, {"normal_stiffness", "tangential_stiffness"}),
        ({"behaviour": "viscous_joint", "normal_viscosity": 1.0}, {"tangential_viscosity"}),
        ({"behaviour": "soft_contact", "normal_stiffness": 0.0}, {"normal_stiffness"}),
        ({"behaviour": "contact", "normal_stiffness": 1.0}, {"normal_stiffness"}),
        ({"normal_viscosity": 1.0}, {"normal_viscosity"}),
        ({"behaviour": "contact", "preload": 1.0, "preload_force": 1.0}, {"preload_force"}),
        ({"behaviour": "perfect", "interference": 1e-6}, {"interference"}),
        ({"behaviour": "contact", "preload": 1.0, "interference": 1e-6}, {"interference"}),
        ({"behaviour": "soft_contact", "normal_stiffness": 1.0, "gap": 1.0, "interference": 1e-6}, {"interference"}),
    ],
)
def test_keys_that_do_not_fit_are_told(interface: dict[str, Any], where: set[str]) -> None:
    tables = bars("perfect")
    tables["interface"]["joint"] = {"sides": ["a.zmax", "b.zmin"], **interface}
    with pytest.raises(SceneError) as caught:
        scene_from_dict(tables)
    assert {p.where for p in caught.value.problems} == {f"interface.joint.{key}" for key in where}
