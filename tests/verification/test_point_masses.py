"""Point masses against closed forms: frequencies of a bar with an end mass, common mass centres, momentum, damping."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

import latin_fmu
from latin_fmu.building import discretise
from latin_fmu.errors import SceneError
from latin_fmu.scene.strain_damping import StrainDamping, fitted
from latin_fmu.stability.scenes import Box, Material, column, placed

E, RHO, L, SIDE, N = 210e9, 7800.0, 1.0, 0.05, 20
MASS = RHO * L * SIDE**2
SPEED = np.sqrt(E / RHO)
WALLS = {wall: {"type": "symmetry", "face": f"bar.{wall}"} for wall in ("ymin", "ymax", "zmin", "zmax")}
ROOT = {"root": {"type": "fixed", "face": "bar.xmin"}}


def bar(material: dict[str, Any] | None = None, free: bool = False, **tables: Any) -> latin_fmu.Scene:
    """A bar along x that moves along its axis only, held at x = 0; ``free``: held nowhere."""
    steel = Material(E, RHO, name="steel", keys=material or {})
    body = Box(steel, (L, SIDE, SIDE), (N, 1, 1), keys=tables.pop("body", {}))
    time = {"end": 1e-4, "instants": 100}
    data = column({"bar": body}, {}, time, boundary={} if free else WALLS | ROOT)
    return latin_fmu.scene_from_dict(data | tables)


@pytest.mark.parametrize(
    "place",
    [
        {"face": "bar.xmax"},
        {"substructure": "bar", "point": [L, SIDE / 2, SIDE / 2]},
        {"face": "bar.xmax", "point": [L, SIDE / 2, SIDE / 2]},
    ],
    ids=["spread", "point", "reference point"],
)
@pytest.mark.parametrize("share", [0.2, 3.0])
def test_bar_with_an_end_mass(place: dict[str, Any], share: float) -> None:
    """x tan x = M / m with x = omega L / c, M of the bar and m at its end."""
    scene = bar(point_mass={"tip": {**place, "mass": share * MASS}})
    x = [brentq(lambda x: x * np.tan(x) - 1 / share, i * np.pi + 1e-9, (i + 0.5) * np.pi - 1e-9) for i in range(2)]
    exact = np.array(x) * SPEED / (2 * np.pi * L)
    frequency = latin_fmu.vibration_modes(scene, count=8).frequency
    nearest = [np.abs(frequency / f - 1).min() for f in exact]  # uneven end sections have frequencies of their own
    assert max(nearest) < 5e-3


def test_an_arm_and_an_inertia_give_the_moments_of_a_rigid_mass() -> None:
    """Rigid body: mass centre and moments of inertia by Steiner's theorem."""
    m, arm = 2.0, np.array([L + 0.3, 0.1, SIDE / 2])
    inertia = [0.3, 0.2, 0.25]
    place = {"face": "bar.xmax", "point": arm.tolist(), "mass": m, "inertia": inertia}
    (body,) = discretise(bar(free=True, body={"rigid": True}, point_mass={"tip": place})).bodies.values()
    rigid = body.rigid_motions
    own = np.array([L / 2, SIDE / 2, SIDE / 2])
    centre = (MASS * own + m * arm) / (MASS + m)
    np.testing.assert_allclose(rigid.centre, centre, rtol=1e-12)
    box = MASS / 12 * np.array([2 * SIDE**2, L**2 + SIDE**2, L**2 + SIDE**2])
    total = np.diag(box) + np.diag(inertia)
    for mass, place_of in ((MASS, own), (m, arm)):
        r = place_of - centre
        total += mass * (r @ r * np.eye(3) - np.outer(r, r))
    np.testing.assert_allclose(rigid.mass[3:, 3:] * rigid.length**2, total, rtol=1e-10, atol=1e-12 * total.max())
    np.testing.assert_allclose(rigid.mass[:3], (MASS + m) * np.eye(3, 6), atol=1e-10 * MASS)


SCHEMES = {
    "direct": {},
    "reduced": {"solver": {"propagator": {"type": "reduced", "modes": 30}}},
    "cg": {"solver": {"propagator": "cg"}},
    "explicit": {"solver": {"propagator": "explicit"}},
    "massless": {"time": {"end": 1e-4, "instants": 100, "scheme": "generalized_alpha"}},
}
PLACES = [
    {"face": "bar.xmax", "mass": 5.0},
    {"substructure": "bar", "point": [0.33 * L, 0.3 * SIDE, 0.6 * SIDE], "mass": 7.0},
]


@pytest.mark.parametrize("name", SCHEMES)
def test_every_propagator_gives_the_momentum_of_the_whole(name: str) -> None:
    """A pulse on a free bar: the velocity of the mass centre is the impulse over the total mass."""
    pulse = {"type": "half_sine", "duration": 2e-5}
    load = {"push": {"face": "bar.xmin", "traction": [1e6, 0.0, 0.0], "law": pulse}}
    masses = {f"m{i}": place for i, place in enumerate(PLACES)}
    output = {"output": {"fields": True}}
    wall = {"wall": {"sides": ["bar.xmax", "ground"], "gap": 1.0}}
    more = {"interface": wall} if name == "massless" else {}
    outcome = latin_fmu.solve(bar(free=True, load=load, point_mass=masses, **SCHEMES[name], **output, **more))
    last = outcome.substructures["bar"].velocity[-1]
    scene = bar(free=True, load=load, point_mass=masses, **SCHEMES[name], **more)
    discretised = discretise(scene)
    (model,) = (m for c in discretised.classes for m in c.members)
    mass = (model.with_lumped_mass if discretised.scheme.explicit else model).inertia
    momentum = (mass @ last.ravel()).reshape(-1, 3).sum(axis=0)
    impulse = 1e6 * SIDE**2 * 2e-5 * 2 / np.pi
    assert mass[::3, ::3].sum() == pytest.approx(MASS + 12.0, rel=1e-12)
    assert momentum[0] == pytest.approx(impulse, rel=1e-2)


def test_point_masses_take_part_in_a_spin() -> None:
    """A free rigid bar with a mass turns about the common mass centre, which stays where it is."""
    place = {"substructure": "bar", "point": [L, SIDE / 2, SIDE / 2], "mass": 2 * MASS}
    body = {"rigid": True, "initial_spin": [0.0, 0.0, 10.0]}
    scene = bar(free=True, body=body, point_mass={"tip": place}, output={"fields": True})
    fields = latin_fmu.solve(scene).substructures["bar"]
    at = (0.5 + 2 * 1.0) / 3 * L
    expected = np.zeros_like(fields.nodes)
    expected[:, 0] = -10.0 * (fields.nodes[:, 1] - SIDE / 2)
    expected[:, 1] = 10.0 * (fields.nodes[:, 0] - at)
    np.testing.assert_allclose(fields.velocity[-1], expected, atol=1e-9)


def test_check_tells_the_masses() -> None:
    lines = latin_fmu.check(bar(point_mass={f"m{i}": place for i, place in enumerate(PLACES)}))
    assert any("31.5 kg (12 kg in point masses)" in line for line in lines)


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("point", [2.0, 0.0, 0.0], "outside bar, 1 m from its surface"),
        ("substructure", "bat", "did you mean 'bar'"),
        ("mass", -1.0, "> 0"),
        ("face", "bar.xmax", "names its substructure already"),
        ("inertia", [1.0, 1.0, 1.0], "no rotation for an inertia"),
    ],
)
def test_bad_masses_are_refused(key: str, value: Any, words: str) -> None:
    place: dict[str, Any] = {"substructure": "bar", "point": [0.5, 0.0, 0.0], "mass": 1.0}
    with pytest.raises(SceneError, match=words):
        latin_fmu.check(bar(point_mass={"tip": place | {key: value}}))


def test_an_arm_needs_an_implicit_scheme() -> None:
    place = {"face": "bar.xmax", "point": [1.2, 0.0, 0.0], "mass": 1.0}
    with pytest.raises(SceneError, match="no lumped mass"):
        bar(point_mass={"tip": place}, solver={"propagator": "explicit"})
    wall = {"wall": {"sides": ["bar.xmax", "ground"], "gap": 1.0}}
    with pytest.raises(SceneError, match="spread the mass evenly"):
        discretise(bar(point_mass={"tip": place}, interface=wall, time=SCHEMES["massless"]["time"]))


# -- damping by ratios and by a loss factor ------------------------------------------------------------------
FIRST = SPEED / (4 * L)


def decay(damping: StrainDamping, static: float) -> float:
    """Damping ratio of the free decay of a mode, from s^2 + (2 pi f)^2 G(s) / G(0) = 0; ``static`` : its f, Hz."""
    s = 2j * np.pi * static
    for _ in range(50):
        branches = sum(g * s * t / (1 + s * t) for g, t in zip(damping.strengths, damping.times, strict=True))
        s = 2j * np.pi * static * np.sqrt(1 + damping.viscosity * s + branches)
    return float(-s.real / abs(s))


@pytest.mark.parametrize(
    ("material", "ratio"),
    [
        (
            {"damping_ratios": {"frequencies": [FIRST, 5 * FIRST], "ratios": [0.02, 0.03]}},
            decay(fitted(FIRST, 5 * FIRST, 0.02, 0.03), FIRST),
        ),
        ({"loss_factor": 0.06, "at_frequency": FIRST}, 0.03),
        ({"loss_factor": 0.06, "at_frequency": 2 * FIRST}, 0.015),
    ],
    ids=["ratios", "loss factor at its frequency", "loss factor at half its frequency"],
)
def test_logarithmic_decrement(material: dict[str, Any], ratio: float) -> None:
    """The first mode of a clamped bar after a blow: decrement 2 pi zeta / sqrt(1 - zeta^2)."""
    periods, n = 6, 300
    tables = {
        "load": {
            "blow": {"face": "bar.xmax", "traction": [1e6, 0.0, 0.0], "law": {"type": "half_sine", "duration": 1e-4}}
        },
        "time": {"end": periods / FIRST, "instants": n * periods, "scheme": "newmark"},
        "output": {"fields": True},
    }
    fields = latin_fmu.solve(bar(material, **tables)).substructures["bar"]
    mass = discretise(bar()).bodies["bar"].mass
    shape = np.zeros_like(fields.nodes)
    shape[:, 0] = np.sin(np.pi * fields.nodes[:, 0] / (2 * L))  # that of the discrete mode, too
    q = fields.displacement.reshape(n * periods + 1, -1) @ (mass @ shape.ravel())
    peaks = [i for i in range(n // 10, n * periods) if q[i] > max(q[i - 1], q[i + 1])]
    decrement = np.log(q[peaks[0]] / q[peaks[-1]]) / (len(peaks) - 1)
    assert len(peaks) == periods
    assert decrement / np.sqrt(4 * np.pi**2 + decrement**2) == pytest.approx(ratio, rel=1e-2)


REDUCED: dict[str, Any] = {"type": "reduced", "modes": 8}


def modal_history(mode: int, damping: dict[str, float], propagator: Any, periods: int = 6, n: int = 200) -> np.ndarray:
    """Coordinate of a mode of a clamped bar in modal damping after a blow."""
    frequency = (2 * mode - 1) * FIRST
    blow = {"face": "bar.xmax", "traction": [1e6, 0.0, 0.0], "law": {"type": "half_sine", "duration": 0.25 / frequency}}
    tables = {
        "load": {"blow": blow},
        "time": {"end": periods / frequency, "instants": n * periods, "scheme": "newmark"},
        "output": {"fields": True},
        "solver": {"propagator": propagator},
    }
    fields = latin_fmu.solve(bar(body={"modal_damping": damping}, **tables)).substructures["bar"]
    shape = np.zeros_like(fields.nodes)
    shape[:, 0] = np.sin((2 * mode - 1) * np.pi * fields.nodes[:, 0] / (2 * L))
    weights = discretise(bar()).bodies["bar"].mass @ shape.ravel()
    return fields.displacement.reshape(n * periods + 1, -1) @ weights


@pytest.mark.parametrize(
    ("mode", "below", "ratio", "propagator"),
    [
        (1, None, 0.02, REDUCED),
        (3, None, 0.02, REDUCED),
        (1, 2 * FIRST, 0.02, REDUCED),
        (3, 2 * FIRST, 0.0, REDUCED),
        (1, 2 * FIRST, 0.02, "direct"),
        (3, 2 * FIRST, 0.0, "direct"),
        (3, 20 * FIRST, 0.02, "automatic"),
    ],
)
def test_modal_damping(mode: int, below: float | None, ratio: float, propagator: Any) -> None:
    """One ratio for all modes, none above the limit."""
    q = modal_history(mode, {"ratio": 0.02} | ({} if below is None else {"below": below}), propagator)
    peaks = [i for i in range(120, len(q) - 1) if q[i] > max(q[i - 1], q[i + 1])]
    decrement = np.log(q[peaks[0]] / q[peaks[-1]]) / (len(peaks) - 1)
    assert len(peaks) >= 5
    assert decrement / np.sqrt(4 * np.pi**2 + decrement**2) == pytest.approx(ratio, rel=1e-2, abs=1e-5)


@pytest.mark.parametrize("propagator", [REDUCED, "direct"])
def test_modal_damping_leaves_driven_and_rigid_motions_alone(propagator: Any) -> None:
    """A bar whose end is driven at its own velocity goes on uniformly; so does a free one."""
    driven = {"root": {"type": "velocity", "face": "bar.xmin", "components": ["x"], "value": [2.0]}}
    body = {"initial_velocity": [2.0, 0.0, 0.0], "modal_damping": {"ratio": 0.3, "below": 20 * FIRST}}
    solver, time = {"propagator": propagator}, {"end": 2e-3, "instants": 200}
    for boundary in (WALLS | driven, {}):
        scene = bar(body=body, boundary=boundary, solver=solver, time=time, output={"fields": True, "energy": True})
        velocity = latin_fmu.solve(scene).substructures["bar"].velocity[-1]
        np.testing.assert_allclose(velocity[:, 0], 2.0, rtol=1e-9)


def rubbed(propagator: Any, scheme: Any = "hht", count: int = 1, **body: Any) -> latin_fmu.Solution:
    """Blocks in modal damping of 5 % of all modes: one that is shaken at its side, or ``count`` alike that rub on a
    ground."""
    steel = Material(210e9, 7800.0, 0.3, name="steel")
    keys = {"modal_damping": {"ratio": 0.05, "below": 1e9}} | body
    box, blow = Box(steel, (0.02, 0.02, 0.04), (1, 1, 2), keys=keys), {"type": "half_sine", "duration": 10e-6}
    names = [f"b{i}" for i in range(count)]
    scene = placed(
        {name: (box, (0.1 * i, 0.0, 0.0)) for i, name in enumerate(names)},
        {"end": 30e-6, "instants": 30, "scheme": scheme},
        interface={f"on_{n}": {"sides": [f"{n}.zmin", "ground"], "friction_coefficient": 0.1} for n in names},
        load={
            f"push_{n}": {"face": f"{n}.zmax", "traction": [2e6 * (i + 1), 0.0, -3e7], "law": blow}
            for i, n in enumerate(names)
        },
        solver={"propagator": propagator, "tolerance": 1e-10},
        output={"energy": True, "fields": True},
    )
    if count == 1:
        shake = {"type": "velocity", "face": "b0.xmin", "components": ["x"], "value": [0.1], "law": blow}
        scene |= {"interface": {}, "boundary": {"side": shake}}
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(scene))
    assert solution.converged
    return solution


@pytest.mark.parametrize(("count", "propagator"), [(1, "direct"), (2, "direct"), (9, "direct"), (2, "cg")])
def test_modal_damping_by_a_low_rank_addition_is_that_of_all_modes(count: int, propagator: str) -> None:
    """One, two and nine bodies of a class take different loops; the single one has a driven side."""
    added, reduced = rubbed(propagator, count=count), rubbed({"type": "reduced", "modes": 400}, count=count)
    for name, fields in added.substructures.items():
        exact = reduced.substructures[name].displacement
        assert fields.displacement == pytest.approx(exact, abs=1e-9 * np.abs(exact).max())
    without = rubbed(propagator, count=count, modal_damping={"ratio": 0.05, "below": 1.0})
    exact = reduced.substructures["b0"].displacement
    assert np.abs(without.substructures["b0"].displacement - exact).max() > 0.01 * np.abs(exact).max()


@pytest.mark.parametrize("scheme", ["hht", "newmark", "generalized_alpha", "massless_contact"])
def test_energy_balance_with_modal_damping(scheme: str) -> None:
    """What modal damping takes away is accounted for, beside the viscosity of a contact layer, too."""
    energy = rubbed("direct", scheme, count=2).outcome.energy
    assert energy is not None
    put_in = np.abs(energy["work_of_loads"]).max()
    assert energy["damping_dissipation"][-1] > 0.01 * put_in
    assert np.abs(energy["balance"]).max() < 1e-10 * put_in


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ({}, "'below' is missing"),
        ({"solver": {"propagator": "explicit"}}, "explicit steps know no modes"),
        ({"solver": {"interface_operator": "sparse"}}, "modal damping joins all points of an interface"),
        ({"time": {"end": 1e-3, "instants": 2, "quasi_static": True}}, "damping acts on rates"),
        ({"body": {"rigid": True}}, "a rigid body has no elastic modes"),
    ],
)
def test_modal_damping_needs_modes(tables: dict[str, Any], words: str) -> None:
    body = {"modal_damping": {"ratio": 0.01}} | tables.get("body", {})
    with pytest.raises(SceneError, match=words):
        bar(**{**tables, "body": body})


@pytest.mark.parametrize(
    ("material", "words"),
    [
        ({"loss_factor": 0.1}, "'at_frequency' is missing"),
        ({"loss_factor": 0.1, "at_frequency": 10.0, "rayleigh_mass": 1.0}, "damping is given twice"),
        ({"damping_ratios": {"frequencies": [10.0, 100.0], "ratios": [0.01, 0.5]}}, "too large for a damped vibration"),
        ({"damping_ratios": {"frequencies": [100.0, 10.0], "ratios": [0.01, 0.01]}}, "above the first"),
    ],
)
def test_bad_damping_is_refused(material: dict[str, Any], words: str) -> None:
    with pytest.raises(SceneError, match=words):
        bar(material)


def test_a_quasi_static_run_has_no_damping() -> None:
    with pytest.raises(SceneError, match="loss_factor: damping acts on rates"):
        bar({"loss_factor": 0.1, "at_frequency": 10.0}, time={"end": 1.0, "instants": 1, "quasi_static": True})
