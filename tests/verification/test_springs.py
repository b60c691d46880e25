"""Springs and dashpots against closed forms: oscillators, two masses, momentum, bars that end in springs."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

import latin_fmu
from latin_fmu.cosim.variables import scalar_table
from latin_fmu.errors import SceneError
from latin_fmu.stability.scenes import Box, Material, column, placed

E, RHO, EDGE = 210e9, 7800.0, 0.1
MASS = RHO * EDGE**3
OMEGA = 1e4
STIFFNESS = MASS * OMEGA**2
PERIOD = 2 * np.pi / OMEGA
STEEL = Material(E, RHO, name="steel")
MIDDLE = EDGE / 2


def blocks(spring: dict[str, Any], *velocities: list[float], rigid: bool = True, **tables: Any) -> latin_fmu.Scene:
    """Cubes in a row along x, half an edge apart, with initial velocities, and one spring."""
    cube = Box(STEEL, (EDGE,) * 3, (2, 2, 2), keys={"rigid": rigid})
    bodies = {f"b{i}": (replace(cube, velocity=v), (1.5 * EDGE * i, 0.0, 0.0)) for i, v in enumerate(velocities)}
    data = placed(
        bodies,
        {"end": PERIOD, "instants": 200},
        spring={"s": spring},
        sensor={n: {"face": f"{n}.xmax"} for n in bodies},
        solver={"tolerance": 1e-8},
        output={"energy": True},
    )
    return latin_fmu.scene_from_dict(data | tables)


def history(scene: latin_fmu.Scene, sensor: str = "b0") -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Instants, displacement and velocity along x of a sensor."""
    outcome = latin_fmu.solve(scene)
    assert outcome.converged, outcome.status
    motion = outcome.sensors[sensor]
    return np.linspace(0.0, scene.time.end, scene.time.n_step + 1), motion.displacement[:, 0], motion.velocity[:, 0]


TO_GROUND = {"ends": ["b0.xmin", "ground"], "direction": [1.0, 0.0, 0.0]}


@pytest.mark.parametrize(
    ("values", "exact"),
    [
        ({"stiffness": STIFFNESS}, lambda t: np.sin(OMEGA * t) / OMEGA),
        ({"viscosity": 0.5 * MASS * OMEGA}, lambda t: (1 - np.exp(-0.5 * OMEGA * t)) / (0.5 * OMEGA)),
        (
            {"stiffness": STIFFNESS, "viscosity": 0.4 * MASS * OMEGA},
            lambda t: np.exp(-0.2 * OMEGA * t) * np.sin(np.sqrt(0.96) * OMEGA * t) / (np.sqrt(0.96) * OMEGA),
        ),
    ],
    ids=["spring", "dashpot", "both"],
)
def test_oscillator_of_one_degree(values: dict[str, float], exact: Any) -> None:
    """Second order in the step."""
    errors = []
    for n in (100, 200):
        scene = blocks(TO_GROUND | values, [1.0, 0.0, 0.0], time={"end": PERIOD, "instants": n, "scheme": "newmark"})
        time, u, _ = history(scene)
        errors.append(float(np.abs(u - exact(time)).max()) * OMEGA)
    assert errors[1] < 2e-3
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)


@pytest.mark.parametrize("viscosity", [0.0, 0.1 * MASS * OMEGA], ids=["elastic", "damped"])
def test_two_masses(viscosity: float) -> None:
    """Frequency sqrt(2 k / m), momentum and energy of the sum: the spring is massless and pulls both ends alike."""
    spring = {"ends": ["b0.xmax", "b1.xmin"], "stiffness": STIFFNESS, "viscosity": viscosity}
    scene = blocks(spring, [1.0, 0.0, 0.0], [0.0, 0.0, 0.0], time={"end": PERIOD, "instants": 400, "scheme": "newmark"})
    modes = latin_fmu.vibration_modes(scene, count=1)
    assert modes.frequency[-1] == pytest.approx(np.sqrt(2) * OMEGA / (2 * np.pi), rel=1e-9)
    outcome = latin_fmu.solve(scene)
    v = [outcome.sensors[n].velocity[:, 0] for n in ("b0", "b1")]
    np.testing.assert_allclose(v[0] + v[1], 1.0, rtol=1e-10)
    time, zeta = np.linspace(0.0, PERIOD, 401), viscosity * np.sqrt(2) * OMEGA / (2 * STIFFNESS)
    own = np.sqrt(2) * OMEGA
    damped = own * np.sqrt(1 - zeta**2)
    relative = np.exp(-zeta * own * time) * (np.cos(damped * time) - zeta * own / damped * np.sin(damped * time))
    np.testing.assert_allclose(v[0] - v[1], relative, atol=2e-3)


def test_the_force_is_that_of_the_elongation() -> None:
    """Force on the first end: stiffness times elongation, along the line through both ends, points off the faces."""
    ends = [{"face": "b0.xmax", "point": [0.12, MIDDLE, MIDDLE]}, {"substructure": "b1", "point": [0.2, 0.02, 0.03]}]
    spring = {"ends": ends, "stiffness": STIFFNESS}
    still = [0.0, 0.0, 0.0]
    scene = blocks(spring, still, [0.0, 0.3, 0.1], time={"end": PERIOD / 50, "instants": 20, "scheme": "newmark"})
    outcome = latin_fmu.solve(scene)
    history = outcome.interfaces["s"]
    force = np.einsum("p,tpc->tc", history.areas, history.traction)
    line = np.array([0.2 - 0.12, 0.02 - MIDDLE, 0.03 - MIDDLE])
    line /= np.linalg.norm(line)
    elongation = np.array([0.0, 0.3, 0.1]) @ line * scene.time.end  # hardly slowed down yet
    assert force[-1] @ line == pytest.approx(STIFFNESS * elongation, rel=2e-2)
    np.testing.assert_allclose(force[-1] - (force[-1] @ line) * line, 0.0, atol=1e-9 * abs(force[-1] @ line))


@pytest.mark.parametrize("arm", [0.0, 0.13])
def test_lateral_stiffness_acts_on_an_arm(arm: float) -> None:
    """Alike across the direction. Off the centre by d it turns the body, too: omega^2 = k (1 / m + d^2 / I)."""
    end = {"face": "b0.xmin", "point": [-arm, MIDDLE, MIDDLE]}
    spring = TO_GROUND | {"ends": [end, "ground"], "lateral_stiffness": STIFFNESS}
    modes = latin_fmu.vibration_modes(blocks(spring, [0.0, 0.0, 0.0]), count=4)
    expected = np.sqrt(1 + (EDGE / 2 + arm) ** 2 / (EDGE**2 / 6)) * OMEGA / (2 * np.pi)
    assert modes.frequency[~modes.rigid] == pytest.approx([expected] * 2, rel=1e-9)


def bar(spring: dict[str, Any], n: int = 20, **tables: Any) -> latin_fmu.Scene:
    """A bar along x, 1 m, that moves along its axis only."""
    walls = ("ymin", "ymax", "zmin", "zmax")
    data = column(
        {"bar": Box(Material(E, RHO, name="steel"), (1.0, EDGE, EDGE), (n, 1, 1))},
        {},
        {"end": 1e-3, "instants": 100},
        boundary={w: {"type": "symmetry", "face": f"bar.{w}"} for w in walls},
        spring={"s": spring},
        sensor={"tip": {"face": "bar.xmax"}},
    )
    return latin_fmu.scene_from_dict(data | tables)


def test_spring_between_the_ends_of_one_bar() -> None:
    """Modes that stretch the bar: E A beta cot(beta L / 2) = -2 k."""
    k = E * EDGE**2 / 1.0
    frequency = latin_fmu.vibration_modes(bar({"ends": ["bar.xmin", "bar.xmax"], "stiffness": k}), count=1).frequency
    beta = brentq(lambda b: E * EDGE**2 * b / np.tan(b / 2) + 2 * k, np.pi + 1e-9, 2 * np.pi - 1e-9)
    assert frequency[-1] == pytest.approx(beta * np.sqrt(E / RHO) / (2 * np.pi), rel=5e-3)


@pytest.mark.parametrize("start", [False, True], ids=["quasi-static", "static start"])
def test_statics(start: bool) -> None:
    """A bar on a spring, pulled: F / k + F L / (E A)."""
    k, force = 1e8, 1e5
    static = {"end": 1.0, "instants": 4, "quasi_static": True}
    time = {"end": 1e-3, "instants": 50, "start": "static"} if start else static
    load = {"pull": {"face": "bar.xmax", "traction": [force / EDGE**2, 0.0, 0.0]}}
    spring = {"ends": ["bar.xmin", "ground"], "direction": [1.0, 0.0, 0.0], "stiffness": k}
    spring |= {"viscosity": 1e6} if start else {}
    outcome = latin_fmu.solve(bar(spring, load=load, time=time, solver={"tolerance": 1e-8}))
    assert outcome.converged
    u = outcome.sensors["tip"].displacement[:, 0]
    exact = force / k + force / (E * EDGE**2)
    np.testing.assert_allclose(u if start else u[-1], exact, rtol=1e-5)


@pytest.mark.parametrize(
    "solver",
    [{"propagator": {"type": "reduced", "modes": 40}}, {"propagator": "cg"}, {"propagator": "explicit"}],
    ids=["reduced", "cg", "explicit"],
)
def test_every_propagator(solver: dict[str, Any]) -> None:
    """A blow on the free end of a bar that stands on a spring and a dashpot."""
    law = {"type": "half_sine", "duration": 4e-4}
    load = {"blow": {"face": "bar.xmax", "traction": [-1e6, 0.0, 0.0], "law": law}}
    spring = {"ends": ["bar.xmin", "ground"], "direction": [1.0, 0.0, 0.0], "stiffness": 5e8, "viscosity": 2e4}
    time = {"end": 1.5e-3, "instants": 400}
    plain = latin_fmu.solve(bar(spring, load=load, time=time)).sensors["tip"].displacement[:, 0]
    other = latin_fmu.solve(bar(spring, load=load, time=time, solver=solver)).sensors["tip"].displacement[:, 0]
    assert np.abs(other - plain).max() < 1e-2 * np.abs(plain).max()


def test_springs_are_variables_of_an_fmu() -> None:
    """In the order of the interfaces that stand for them."""
    names = [
        v.name
        for v in scalar_table(bar(TO_GROUND | {"ends": ["bar.xmin", "ground"], "stiffness": 1.0, "viscosity": 1.0}))
    ]
    forces = [n for n in names if n.endswith(".force.x") or n.endswith(".force[1]")]
    assert [n.split(".")[1] for n in forces] == ["s", "s_viscosity"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"stiffness": 0.0}, "without stiffness and viscosity"),
        ({"ends": ["ground", "bar.xmin"]}, "name the ground second"),
        ({"ends": ["bar.xmin", "ground"], "direction": None}, "the spring has no direction"),
        ({"ends": ["bar.xmin", "bar.xmin"], "direction": None}, "the ends are at the same place"),
        ({"ends": ["bar.xmin", "bar.top"]}, "has no face of this name"),
        (
            {"ends": ["bar.xmin", {"substructure": "bar", "point": [2.0, 0.0, 0.0]}]},
            r"spring.s.ends\[1\].point: the point",
        ),
        ({"ends": ["bar.xmin", {"substructure": "rod", "point": [2.0, 0.0, 0.0]}]}, "no substructure of this name"),
        ({"ends": ["bar.xmin", {"point": [2.0, 0.0, 0.0]}]}, "'substructure' is missing"),
    ],
)
def test_bad_springs_are_refused(change: dict[str, Any], words: str) -> None:
    spring = {"ends": ["bar.xmin", "ground"], "direction": [1.0, 0.0, 0.0], "stiffness": 1e8}
    with pytest.raises(SceneError, match=words):
        latin_fmu.check(bar({k: v for k, v in (spring | change).items() if v is not None}))


def test_names_of_springs_are_free() -> None:
    spring = {"ends": ["bar.xmin", "ground"], "direction": [1.0, 0.0, 0.0], "stiffness": 1e8}
    with pytest.raises(SceneError, match="the results of interface s have this name"):
        bar(spring, interface={"s": {"sides": ["bar.xmax", "ground"]}})
