"""Boundary conditions of a scene at work: closed forms of waves and oscillations, equal models built otherwise."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy.linalg as la

from latin_fmu.assembly.problem import SolverReadyProblem
from latin_fmu.building import build
from latin_fmu.errors import SceneError
from latin_fmu.latin.outcome import Outcome
from latin_fmu.march import march
from latin_fmu.propagator import DirectPropagator, Histories
from latin_fmu.propagator.base import full_displacement
from latin_fmu.reader import scene_from_dict
from latin_fmu.time_scheme import Newmark
from tests.alone import alone_of, started_alone

# c = 2 along a bar with E = 4, rho = 1, nu = 0; shear waves at sqrt(2)
MATERIAL = {"young_modulus": 4.0, "poisson_ratio": 0.0, "density": 1.0}
LENGTH, SPEED = 10.0, 2.0


def body(
    size: tuple[float, ...] = (1.0, 1.0, LENGTH),
    elements: tuple[int, ...] = (1, 1, 100),
    origin: tuple[float, ...] = (0.0, 0.0, 0.0),
    **others: Any,
) -> dict[str, Any]:
    """Table of a box."""
    box = {"origin": list(origin), "size": list(size), "elements": list(elements)}
    return {"material": "m", "box": box, **others}


def periodic(axis: str) -> dict[str, Any]:
    return {"type": "periodic", "faces": [f"bar.{axis}min", f"bar.{axis}max"]}


def built(**tables: Any) -> SolverReadyProblem:
    """A bar of 1 x 1 x 10 along z with 100 elements, and other tables."""
    base: dict[str, Any] = {
        "name": "bar",
        "material": {"m": MATERIAL},
        "substructure": {"bar": body()},
        "time": {"end": 4.0, "instants": 200},
        "output": {"fields": True, "energy": True},
    }
    return build(scene_from_dict(base | tables))


def solved(**tables: Any) -> Outcome:
    return march(built(**tables)).outcome


def half_sine(duration: float) -> dict[str, Any]:
    return {"type": "half_sine", "start": 0.0, "duration": duration}


def pulse(t: np.ndarray) -> np.ndarray:
    """sin^2 from t = 0 to 2: no kink."""
    return np.where((t > 0) & (t < 2.0), np.sin(0.5 * np.pi * t) ** 2, 0.0)


def smooth() -> dict[str, Any]:
    """The law of ``pulse``, given at the instants of the tests."""
    times = np.linspace(0.0, 2.0, 101)
    return {"type": "table", "times": times.tolist(), "values": pulse(times).tolist()}


@pytest.mark.parametrize("scheme", [{"type": "hht"}, {"type": "newmark"}], ids=["hht", "newmark"])
def test_a_driven_end_sends_its_velocity_along_the_bar(scheme: dict[str, Any]) -> None:
    """v(z, t) = V(t - z/c) until the front reaches the free end."""
    push = {"type": "velocity", "face": "bar.zmin", "components": ["z"], "value": [0.3], "law": smooth()}
    outcome = solved(boundary={"push": push}, time={"end": 4.0, "instants": 200, "scheme": scheme})
    bar = outcome.substructures["bar"]
    z = bar.nodes[:, 2]
    for i in (60, 120, 200):
        exact = 0.3 * pulse(outcome.time[i] - z / SPEED)
        assert np.abs(bar.velocity[i, :, 2] - exact).max() < 0.015 * 0.3
        assert np.abs(bar.velocity[i, :, :2]).max() < 1e-14
    end = z == 0.0
    np.testing.assert_allclose(bar.velocity[:, end, 2], np.tile(0.3 * pulse(outcome.time)[:, None], (1, 4)), atol=1e-15)
    # energy sent: rho c A int V^2 dt
    assert outcome.energy["work_of_loads"][-1] == pytest.approx(SPEED * 0.09 * 0.75, rel=2e-3)
    assert np.abs(outcome.energy["balance"]).max() < 1e-12


def test_prescribed_displacement_is_followed() -> None:
    """Quadratic in time to the accuracy of the scheme; a value at t = 0 is there from the start."""
    law = {"type": "table", "times": [0.0, 1.0, 2.0, 4.0], "values": [1.0, 1.0, 0.0, 0.5]}
    move = {"type": "displacement", "face": "bar.zmin", "components": ["x", "z"], "value": [0.2, -0.1], "law": law}
    outcome = solved(
        boundary={"move": move}, substructure={"bar": body(elements=(1, 1, 20), initial_displacement=[0.2, 0.0, -0.1])}
    )
    bar = outcome.substructures["bar"]
    wanted = np.interp(outcome.time, law["times"], law["values"])
    displacement = bar.displacement[:, bar.nodes[:, 2] == 0.0]
    for component, value in ((0, 0.2), (2, -0.1)):
        # one step (dt = 0.02) of rounding at the corners of the law, and no drift
        error = displacement[..., component] - value * wanted[:, None]
        assert np.abs(error).max() < abs(value) * 0.02
        assert np.abs(error[-1]).max() < abs(value) * 0.006
    assert np.abs(bar.displacement[:40, :, 0] - 0.2).max() < 1e-13  # at rest until the law moves


@pytest.mark.parametrize(("direction", "reflected"), [(2, 0.01), (0, 0.01)], ids=["pressure", "shear"])
def test_absorbing_end_sends_nothing_back(direction: int, reflected: float) -> None:
    """Pressure and shear pulses in a periodic column: nothing is left after they have left, and no rigid motion."""
    traction = [0.0, 0.0, 0.0]
    traction[direction] = 1.0
    speed = (math.sqrt(2.0), math.sqrt(2.0), 2.0)[direction]
    end = 2.0 + 1.3 * LENGTH / speed
    outcome = solved(
        boundary={"out": {"type": "absorbing", "face": "bar.zmax"}, "x": periodic("x"), "y": periodic("y")},
        load={"hit": {"face": "bar.zmin", "traction": traction, "law": half_sine(2.0)}},
        time={"end": end, "instants": 400},
    )
    bar = outcome.substructures["bar"]
    peak = 1.0 / speed  # v = t / (rho c)
    assert np.abs(bar.velocity).max() == pytest.approx(peak, rel=0.02)
    assert np.abs(bar.velocity[-1]).max() < reflected * peak
    stored = outcome.energy["kinetic"][-1] + outcome.energy["elastic"][-1]
    assert stored < reflected**2 * outcome.energy["work_of_loads"][-1]
    assert outcome.energy["damping_dissipation"][-1] == pytest.approx(outcome.energy["work_of_loads"][-1], rel=0.01)
    assert np.abs(outcome.energy["balance"]).max() < 1e-12


def test_a_free_end_reflects_all() -> None:
    """The same pulse without the absorbing end is all there after its reflection: the test above can fail."""
    outcome = solved(
        load={"hit": {"face": "bar.zmin", "pressure": 1.0, "law": half_sine(2.0)}}, time={"end": 8.5, "instants": 400}
    )
    stored = outcome.energy["kinetic"][-1] + outcome.energy["elastic"][-1]
    assert stored == pytest.approx(outcome.energy["work_of_loads"][-1], rel=0.01)


def test_mass_damping_of_a_rigid_motion() -> None:
    """v = v_0 exp(-a t)."""
    damped = MATERIAL | {"frame": "absolute", "rayleigh_mass": 0.5}
    outcome = solved(
        material={"m": damped},
        substructure={"bar": body((1.0, 1.0, 2.0), (1, 1, 2), initial_velocity=[1.0, -2.0, 0.5])},
    )
    velocity = outcome.substructures["bar"].velocity
    expected = np.exp(-0.5 * outcome.time)[:, None, None] * np.array([1.0, -2.0, 0.5])
    np.testing.assert_allclose(velocity, np.broadcast_to(expected, velocity.shape), atol=1e-4)
    lost = 0.5 * 2.0 * 5.25 * (1 - math.exp(-4.0))
    assert outcome.energy["damping_dissipation"][-1] == pytest.approx(lost, rel=1e-3)


def test_rayleigh_damping_of_a_mode(model: Callable[..., Any]) -> None:
    """A mode phi with w decays as exp(-z w t) cos(w_d t) + ...; z = (0.3 / w + 0.02 w) / 2 (the model's damping)."""
    m = model("damped").model
    values, modes = la.eigh(m.stiffness.toarray(), m.mass.toarray())
    w, phi = math.sqrt(values[6]), modes[:, 6]
    z = 0.5 * (0.3 / w + 0.02 * w)
    w_d = w * math.sqrt(1 - z * z)
    alone = replace(m, loads=[], displacement=phi, velocity=np.zeros_like(phi))
    dt, n = 0.01 / w, 400
    propagator = DirectPropagator([alone], Newmark(), dt, energy=False)
    propagator.begin([Histories(dt * np.arange(n + 1), [], np.zeros((n + 1, 0)))], dt)
    nothing = np.zeros((propagator.n_channel, 1))
    started_alone(propagator, nothing, propagator.mass_factor())
    for i in range(1, n + 1):
        alone_of(propagator).predict()
        alone_of(propagator).commit(nothing)
        t = i * dt
        exact = math.exp(-z * w * t) * (math.cos(w_d * t) + z * w / w_d * math.sin(w_d * t))
        assert full_displacement(propagator, 0).ravel() @ phi / (phi @ phi) == pytest.approx(exact, abs=2e-4)


def test_periodic_column_moves_as_one_line() -> None:
    """Nodes of one height move together, like the column with one element across."""

    def column(n: int) -> Outcome:
        return solved(
            substructure={"bar": body(elements=(n, n, 40))},
            boundary={"x": periodic("x"), "y": periodic("y")},
            load={"shear": {"face": "bar.zmin", "traction": [1.0, 0.5, 0.2], "law": half_sine(1.0)}},
            material={"m": MATERIAL | {"poisson_ratio": 0.3}},
            time={"end": 4.0, "instants": 80},
        )

    thin, wide = column(1).substructures["bar"], column(2).substructures["bar"]
    heights = np.linspace(0.0, LENGTH, 41)
    for bar in (thin, wide):
        for z in heights[::10]:
            line = bar.velocity[:, np.isclose(bar.nodes[:, 2], z)]
            assert np.ptp(line, axis=1).max() < 1e-13
    profile = [
        bar.velocity[-1][[np.flatnonzero(np.isclose(bar.nodes[:, 2], z))[0] for z in heights]] for bar in (thin, wide)
    ]
    np.testing.assert_allclose(profile[1], profile[0], atol=1e-12)


def test_quarter_with_symmetries_equals_the_whole() -> None:
    def block(origin: float, size: float, n: int, planes: tuple[str, ...]) -> Outcome:
        return solved(
            material={"m": MATERIAL | {"poisson_ratio": 0.3}},
            substructure={"bar": body((size, size, 2.0), (n, n, 3), (origin, origin, 0.0))},
            boundary={"base": {"type": "symmetry", "face": "bar.zmin"}}
            | {f"plane{i}": {"type": "symmetry", "face": f"bar.{p}"} for i, p in enumerate(planes)},
            load={"press": {"face": "bar.zmax", "pressure": 1.0, "law": half_sine(1.0)}},
            time={"end": 2.0, "instants": 40},
        )

    whole = block(-1.0, 2.0, 4, ()).substructures["bar"]
    quarter = block(0.0, 1.0, 2, ("xmin", "ymin")).substructures["bar"]
    same = [int(np.argmin(np.linalg.norm(whole.nodes - x, axis=1))) for x in quarter.nodes]
    np.testing.assert_allclose(whole.displacement[:, same], quarter.displacement, atol=1e-12)
    assert np.abs(quarter.displacement[..., 0]).max() > 0.01  # it does bulge


def test_fixed_components_and_symmetry_hold_what_they_say() -> None:
    outcome = solved(
        boundary={
            "base": {"type": "fixed", "face": "bar.zmin", "components": ["x", "z"]},
            "side": {"type": "symmetry", "face": "bar.xmax"},
        },
        load={"push": {"face": "bar.zmax", "traction": [1.0, 1.0, 1.0], "law": half_sine(1.0)}},
        material={"m": MATERIAL | {"poisson_ratio": 0.3}},
    )
    bar = outcome.substructures["bar"]
    base, side = bar.nodes[:, 2] == 0.0, bar.nodes[:, 0] == 1.0
    assert not bar.displacement[:, base][..., [0, 2]].any()
    assert not bar.displacement[:, side, 0].any()
    assert np.abs(bar.displacement[:, base, 1]).max() > 0
    assert np.abs(bar.displacement[:, side, 1:]).max() > 0


def test_pressure_pushes_inwards_and_gravity_falls() -> None:
    small = ((1.0, 1.0, 2.0), (1, 1, 2))
    pushed = solved(substructure={"bar": body(*small)}, load={"p": {"face": "bar.xmax", "pressure": 3.0}})
    impulse = pushed.substructures["bar"].velocity[-1].mean(axis=0) * 2.0
    np.testing.assert_allclose(impulse, [-3.0 * 2.0 * 4.0, 0.0, 0.0], atol=1e-9)
    falling = solved(substructure={"bar": body(*small, body_force=[0.0, 0.0, -9.81])})
    depth = falling.substructures["bar"].displacement[-1]
    np.testing.assert_allclose(depth, np.tile([0.0, 0.0, -0.5 * 9.81 * 16.0], (12, 1)), rtol=1e-12, atol=1e-12)


def refused(words: tuple[str, ...], **tables: Any) -> None:
    with pytest.raises(SceneError) as caught:
        built(**tables)
    for word in words:
        assert word in str(caught.value)


def test_two_conditions_on_one_edge_are_refused() -> None:
    """Faces that share an edge: the same component cannot be driven twice, nor held and driven."""

    def drive(face: str) -> dict[str, Any]:
        return {"type": "velocity", "face": face, "components": ["x"], "value": [1.0]}

    refused(("boundary.second", "bar.xmin"), boundary={"first": drive("bar.zmin"), "second": drive("bar.xmin")})
    for order in (("held", "driven"), ("driven", "held")):
        tables = {"held": {"type": "fixed", "face": "bar.zmin"}, "driven": drive("bar.xmin")}
        refused(("boundary.",), boundary={name: tables[name] for name in order})


def test_identical_bodies_share_one_class() -> None:
    def box(x: float, elements: tuple[int, int, int] = (1, 1, 2)) -> dict[str, Any]:
        return {"material": "m", "box": {"origin": [x, 0.1, 0.7], "size": [1.0, 1.0, 2.0], "elements": list(elements)}}

    loaded = box(3.3) | {"initial_velocity": [1.0, 0.0, 0.0]}
    stiff = box(6.0) | {"material": "stiff"}
    assembly = built(
        material={"m": MATERIAL, "stiff": MATERIAL | {"young_modulus": 8.0}},
        substructure={"a": box(0.0), "b": loaded, "c": stiff, "d": box(9.0, (1, 1, 3)), "e": box(12.0), "f": box(15.0)},
        load={"push": {"face": "b.xmin", "pressure": 1.0}},
        boundary={"hold": {"type": "fixed", "face": "e.zmin"}, "out": {"type": "absorbing", "face": "f.zmin"}},
    ).assembly
    assert [p.names for p in assembly.propagators] == [["a", "b"], ["c"], ["d"], ["e"], ["f"]]


SHAKEN = {"type": "acceleration", "face": "bar.zmin", "components": ["x", "y", "z"], "law": half_sine(1.0)}
PLANE = {"type": "symmetry", "face": "bar.xmin"}


@pytest.mark.parametrize("kind", ["acceleration", "velocity", "displacement"])
def test_driven_by_zero_where_another_condition_holds(kind: str) -> None:
    """On the common edge of a plane of symmetry and of a face that does not move across it: no conflict, and the
    solution is that of a drive without this component."""
    drive = {**SHAKEN, "type": kind, "value": [0.0, 0.0, 1e-3]}
    whole = solved(boundary={"plane": PLANE, "shaker": drive, "other": {**drive, "face": "bar.zmax"}})
    fixed = {"type": "fixed", "components": ["x", "y"]}
    ends = {"zmin": {**fixed, "face": "bar.zmin"}, "zmax": {**fixed, "face": "bar.zmax"}}
    alone = {**drive, "components": ["z"], "value": [1e-3]}
    split = solved(boundary={"plane": PLANE, **ends, "shaker": alone, "other": {**alone, "face": "bar.zmax"}})
    one, other = (outcome.substructures["bar"].displacement for outcome in (whole, split))
    assert one is not None
    assert np.abs(one).max() > 1e-5
    assert one == pytest.approx(other, abs=1e-12 * np.abs(one).max())


@pytest.mark.parametrize(
    ("value", "more"), [([1e-3, 0.0, 0.0], {}), ([0.0, 0.0, 1e-3], {"initial_velocity": [1.0, 0.0, 0.0]})]
)
def test_driven_where_another_condition_holds(value: list[float], more: dict[str, Any]) -> None:
    """By a number, or on from an initial velocity across the plane: the conditions contradict each other."""
    with pytest.raises(SceneError, match="drives nodes that another condition already fixes or drives"):
        built(boundary={"plane": PLANE, "shaker": {**SHAKEN, "value": value}}, substructure={"bar": body(**more)})
