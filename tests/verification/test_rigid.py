"""Rigid substructures against closed forms, stiff elastic twins and an event-by-event oracle."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from latin_fmu.building import build
from latin_fmu.errors import SceneError
from latin_fmu.fem.elements import Elements, mass, rigid_body
from latin_fmu.fem.mesh import Mesh, box_mesh
from latin_fmu.reader import scene_from_dict
from latin_fmu.stability.scenes import Box, Material, column
from tests.scenes import given_motion, solve

from .oracles import sliding_block

STEEL = Material(210e9, 7800.0, name="steel")
SIZE = (0.1, 0.2, 0.3)
WAVE = STEEL.speed


def block(**more: Any) -> dict[str, Any]:
    """A scene of one rigid block, alone."""
    body = Box(STEEL, SIZE, (2, 2, 2), keys={"rigid": True, **more})
    time, output = {"end": 1e-2, "instants": 20}, {"fields": True, "energy": True}
    return column({"block": body}, {}, time, name="block", output=output)


# -- mass ---------------------------------------------------------------------------------------------------------
def test_mass_of_a_box_is_that_of_the_textbook() -> None:
    body = rigid_body(box_mesh(np.array([1.0, 2.0, 3.0]), np.array(SIZE), (2, 3, 1)), 7800.0)
    m, (a, b, c) = 7800.0 * 0.006, SIZE
    inertia = m / 12 * np.array([b * b + c * c, a * a + c * c, a * a + b * b]) / body.length**2
    np.testing.assert_allclose(body.centre, np.array([1.05, 2.1, 3.15]), rtol=1e-14)
    np.testing.assert_allclose(body.mass, np.diag([m, m, m, *inertia]), rtol=1e-13, atol=1e-12 * m)


@pytest.mark.parametrize("cell", ["hexahedron", "tetra"])
def test_mass_is_the_consistent_one_of_the_mesh(cell: str) -> None:
    mesh = box_mesh(np.zeros(3), np.array(SIZE), (2, 1, 2))
    rng = np.random.default_rng(3)
    nodes = mesh.nodes + 0.01 * rng.normal(size=mesh.nodes.shape)
    if cell == "tetra":  # a box into six tetrahedra
        tets = ((0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6))
        mesh = Mesh.uniform(nodes, cell, mesh.blocks[0].cells[:, tets].reshape(-1, 4))
    else:
        mesh = replace(mesh, nodes=nodes)
    body = rigid_body(mesh, 7800.0)
    full = mass(Elements(mesh), 7800.0)
    np.testing.assert_allclose(body.mass, body.modes.T @ (full @ body.modes), rtol=1e-12, atol=1e-12)


# -- free motion --------------------------------------------------------------------------------------------------
def test_pushed_and_spinning_block_follows_newton() -> None:
    """Constant force off the centre, initial velocity and spin: every node on its parabola."""
    tables = block(initial_velocity=[1.0, 0.5, 0.0], initial_spin=[0.2, 0.0, 0.7], body_force=[0.0, -100.0, 0.0])
    tables["load"] = {"push": {"face": "block.zmax", "traction": [4e4, 0.0, 0.0]}}
    outcome = solve(tables)
    m, force, t = 7800.0 * 0.006, 4e4 * 0.02, outcome.time
    inertia = m * (SIZE[0] ** 2 + SIZE[2] ** 2) / 12
    shift = np.outer(t, [1.0, 0.5, 0.0]) + 0.5 * np.outer(t**2, [force / m, -100.0 * 0.006 / m, 0.0])
    turn = np.outer(t, [0.2, 0.0, 0.7]) + 0.5 * np.outer(t**2, [0.0, force * 0.15 / inertia, 0.0])
    history = outcome.substructures["block"]
    arm = history.nodes - np.array(SIZE) / 2
    expected = shift[:, None] + np.cross(turn[:, None], arm[None])
    np.testing.assert_allclose(history.displacement, expected, atol=1e-13)
    assert outcome.energy["elastic"].max() == 0.0
    assert np.abs(outcome.energy["balance"]).max() < 1e-12 * outcome.energy["kinetic"].max()


def test_a_rigid_body_has_six_unknowns_and_no_stiffness() -> None:
    propagator = build(scene_from_dict(block())).assembly.propagators[0]
    assert propagator.n_dof == 6
    assert propagator.members[0].stiffness.nnz == 0
    assert propagator.members[0].mass.shape == (6, 6)


# -- held and driven ----------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("boundary", "left"),
    [
        ({"type": "symmetry", "face": "block.xmin"}, 3),
        ({"type": "fixed", "face": "block.xmin"}, 0),
        ({"type": "fixed", "face": "block.zmin", "components": ["z"]}, 3),
        ({"type": "fixed", "face": "block.zmin", "components": ["x", "y"]}, 3),
        ({"type": "velocity", "face": "block.zmin", "components": ["z"], "value": [1.0]}, 3),
    ],
)
def test_conditions_take_directions_out_of_the_six(boundary: dict[str, Any], left: int) -> None:
    moving = {"initial_velocity": [1.0, 2.0, 3.0], "initial_spin": [1.0, 1.0, 1.0]}
    driven = {"initial_velocity": [0.0, 0.0, 1.0]}  # as fast as its face
    tables = block(**driven if boundary["type"] == "velocity" else moving)
    tables["boundary"] = {"held": boundary}
    propagator = build(scene_from_dict(tables)).assembly.propagators[0]
    assert propagator.n_dof == left
    model = propagator.members[0]
    nodal = model.nodal @ model.expansion.toarray()
    faces = box_mesh(np.zeros(3), np.array(SIZE), (2, 2, 2)).faces[boundary["face"].split(".")[1]]
    components = {"symmetry": ["x"]}.get(boundary["type"], boundary.get("components", ["x", "y", "z"]))
    rows = (3 * faces.nodes[:, None] + ["xyz".index(c) for c in components]).ravel()
    assert np.abs(nodal[rows]).max(initial=0.0) < 1e-14


def test_a_guided_block_moves_where_it_may() -> None:
    """x driven, y held, z free and pulled: three rotations and two translations gone, the last one is Newton's."""
    tables = block(initial_velocity=[0.3, 0.0, 0.0])
    tables["boundary"] = {
        "plane": {"type": "fixed", "face": "block.ymin", "components": ["y"]},
        "driven": {"type": "velocity", "face": "block.ymax", "components": ["x"], "value": [0.3]},
    }
    tables["load"] = {"push": {"face": "block.zmax", "pressure": -5e4}}
    outcome = solve(tables)
    u, t = outcome.substructures["block"].displacement, outcome.time
    m = 7800.0 * 0.006
    np.testing.assert_allclose(u[..., 0], np.repeat(0.3 * t[:, None], u.shape[1], axis=1), atol=1e-14)
    np.testing.assert_allclose(u[..., 1], 0.0, atol=1e-15)
    np.testing.assert_allclose(u[:, 0, 2], 0.5 * 5e4 * 0.02 / m * t**2, rtol=1e-12, atol=1e-16)
    assert np.abs(outcome.energy["balance"]).max() < 1e-12 * outcome.energy["kinetic"].max()


@pytest.mark.parametrize(
    ("change", "where"),
    [
        ({"boundary": {"a": {"type": "periodic", "faces": ["block.xmin", "block.xmax"]}}}, "boundary.a"),
        (
            {
                "boundary": {
                    "a": {"type": "fixed", "face": "block.zmin"},
                    "b": {"type": "velocity", "face": "block.zmax", "components": ["z"], "value": [1.0]},
                }
            },
            "substructure.block.rigid",
        ),
        ({"time": {"end": 1.0, "instants": 2, "scheme": "massless_contact"}}, "substructure.block.rigid"),
    ],
    ids=["periodic", "impossible", "massless"],
)
def test_what_a_rigid_body_cannot_do_is_refused(change: dict[str, Any], where: str) -> None:
    with pytest.raises(SceneError) as caught:
        build(scene_from_dict({**block(), **change}))
    assert [p.where for p in caught.value.problems] == [where]
    assert caught.value.problems[0].remedy


# -- against elastic bodies ---------------------------------------------------------------------------------------
def ram(rigid: bool = True, young_modulus: float = 210e9, behaviour: str = "contact") -> dict[str, Any]:
    """A block (0.02 x 0.02 x 0.05) meets the end of a long bar at 1 m s-1; the bar's far end absorbs."""
    hard = Material(young_modulus, STEEL.density, name="hard")
    return column(
        {
            "bar": Box(STEEL, (0.02, 0.02, 0.5), (1, 1, 100)),
            "ram": Box(hard, (0.02, 0.02, 0.05), (1, 1, 2), (0.0, 0.0, -1.0), {"rigid": rigid}),
        },
        {"hit": {"behaviour": behaviour}},
        {"end": 0.15 / WAVE, "instants": 120},
        boundary={"out": {"type": "absorbing", "face": "bar.zmin"}},
        output={"energy": True},
    )


@pytest.mark.parametrize("behaviour", ["contact", "perfect"])
def test_mass_on_a_long_bar_slows_down_exponentially(behaviour: str) -> None:
    """F = Z A V exp(-Z A t / m) until waves come back; bonded or in contact alike (Saint-Venant). At the default
    tolerance single instants are off by 3 to 7 per cent of the force that is left, a tenth of its peak."""
    outcome = solve({**ram(behaviour=behaviour), "solver": {"tolerance": 1e-4}})
    area, m, z = 4e-4, 7800.0 * 4e-4 * 0.05, 7800.0 * WAVE
    t = outcome.time
    exact = m * (1 - np.exp(-z * area * t / m))  # impulse
    impulse = -outcome.interfaces["hit"].impulse(t)[:, 2]
    assert np.abs(impulse - exact)[-1] < 3e-3 * exact[-1]
    assert np.abs(impulse - exact).max() < 2.5e-2 * exact[-1]
    force = -outcome.interfaces["hit"].force()[40:, 2]
    np.testing.assert_allclose(force, z * area * np.exp(-z * area * t[40:] / m), rtol=0.05)
    assert np.abs(outcome.energy["balance"]).max() < 1e-9 * outcome.energy["kinetic"][0]


def test_rigid_is_the_limit_of_a_stiff_elastic_body() -> None:
    rigid, stiff = (solve(ram(flag, 210e15)) for flag in (True, False))
    a, b = (o.interfaces["hit"].impulse(o.time)[:, 2] for o in (rigid, stiff))
    assert np.abs(a - b).max() < 2e-3 * np.abs(b).max()


@pytest.mark.parametrize("window", [1, 10, "whole"])
def test_every_window_gives_the_same_answer(window: object) -> None:
    tables = ram()
    reference = solve({**tables, "solver": {"tolerance": 1e-6}})
    outcome = solve({**tables, "solver": {"window": window, "tolerance": 1e-6}})
    a, b = (o.interfaces["hit"].impulse(o.time)[:, 2] for o in (outcome, reference))
    assert np.abs(a - b).max() < 1e-4 * np.abs(b).max()


def test_rigid_tool_at_constant_speed_sends_the_wave_of_its_speed() -> None:
    tables = ram()
    tables["boundary"]["tool"] = {
        "type": "velocity",
        "face": "ram.zmax",
        "components": ["x", "y", "z"],
        "value": [0.0, 0.0, -1.0],
    }
    outcome = solve(tables)
    assert build(scene_from_dict(tables)).assembly.propagators[1].n_dof == 0
    impulse = -outcome.interfaces["hit"].impulse(outcome.time)[-1, 2]
    assert impulse == pytest.approx(7800.0 * WAVE * 4e-4 * outcome.time[-1], rel=5e-3)


# -- friction -----------------------------------------------------------------------------------------------------
def test_block_under_a_harmonic_force_sticks_and_slips_on_time() -> None:
    """Mass 1, mu = 0.8, pushed by 8 cos t: slip and stick within one step, positions to 1e-3 of the travel."""
    step = 0.005
    outcome = solve(shaken(step))
    time, slips = outcome.time, sliding_block.slips(8.0)
    slipping = (outcome.interfaces["floor"].contact_status == 2).all(axis=1)
    events = np.array([[s.begin, s.end] for s in slips]).ravel()
    assert slipping[0]  # pushed by more than it can hold from the start
    np.testing.assert_allclose(time[1 + np.flatnonzero(np.diff(slipping))], events[1:], atol=step * (1 + 1e-9))
    moved = outcome.substructures["block"].displacement[:, 0, 0]
    exact = np.array([sliding_block.position(t) for t in time]) - sliding_block.START
    travel = np.abs(exact).max()
    for slip in slips:  # where it comes to rest
        rest = int(np.ceil(slip.end / step)) + 1
        assert abs(moved[rest] - exact[rest]) < 1e-3 * travel
    assert abs(moved[-1] - exact[-1]) < 1e-3 * travel


@pytest.mark.parametrize("preload", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("sliding", [0.0, 2.0])
def test_a_block_stands_on_the_ground_from_the_first_instant(sliding: float, preload: float) -> None:
    """Its weight is carried at t = 0 already: no fall to stop, no force that swings; what slides is braked."""
    tables = shaken(0.01)
    del tables["load"]
    block = tables["substructure"]["block"]
    block["initial_velocity"] = [0.0, sliding, 0.0]
    block["body_force"] = [0.0, 0.0, (1 - preload) * block["body_force"][2]]
    tables["interface"]["floor"]["preload_force"] = preload * 9.81  # a part of the force is there beforehand
    tables["time"] = {"end": 0.1, "instants": 20}
    outcome = solve(tables)
    force, t = outcome.interfaces["floor"].force(), outcome.time
    np.testing.assert_allclose(force[:, 2], 9.81, rtol=1e-5)
    moved = outcome.substructures["block"].displacement[:, 0]
    np.testing.assert_allclose(moved[:, 2], 0.0, atol=1e-7)
    if sliding:
        np.testing.assert_allclose(force[:, 1], -0.8 * 9.81, rtol=1e-5)
        np.testing.assert_allclose(moved[:, 1], sliding * t - 0.5 * 0.8 * 9.81 * t**2, atol=1e-6)
    else:
        np.testing.assert_allclose(moved, 0.0, atol=1e-7)


def test_a_block_has_the_acceleration_of_the_rigid_base_it_stands_on() -> None:
    """F = m a(t) along x, and the load and m a(t) along z, at every instant: the start has this acceleration already,
    and nothing swings about it."""
    side, height, load, size = 0.02, 0.01, 3200.0, np.array([1e3, 0.0, 2e3])
    law = {"type": "table", "times": [0.0, 8e-6], "values": [0.3, 1.0]}
    tables = column(
        {
            "base": Box(STEEL, (side, side, 0.005), (2, 2, 1), keys={"rigid": True}),
            "block": Box(STEEL, (side, side, height), (2, 2, 1), keys={"rigid": True}),
        },
        {"rest": {"friction_coefficient": 0.3}},
        {"end": 8e-6, "instants": 8, "start": "static"},
        load={"press": {"face": "block.zmax", "pressure": load / side**2}},
        boundary={"base": given_motion("base.zmin", size.tolist(), law, "xyz", "acceleration")},
        solver={"tolerance": 1e-11},
    )
    solution = solve(tables)
    mass = STEEL.density * side**2 * height
    law_at = np.interp(solution.time, law["times"], law["values"])
    expected = -mass * np.outer(law_at, size) - [0.0, 0.0, load]
    force = solution.interfaces["rest"].force()
    np.testing.assert_allclose(force, expected, atol=1e-9 * load)


def shaken(step: float) -> dict[str, Any]:
    """The block of the oracle: its displacement counts from x = 3."""
    n = round(8 / step)
    time = np.linspace(0.0, 8.0, n + 1)
    area = 0.25
    material = replace(STEEL, density=1 / (0.1 * area))
    keys = {"rigid": True, "body_force": [0.0, 0.0, -9.81 / (0.1 * area)]}
    law = {"type": "table", "times": time.tolist(), "values": np.cos(time).tolist()}
    return column(
        {"block": Box(material, (0.5, 0.5, 0.1), (1, 1, 1), keys=keys)},
        {},
        {"end": 8.0, "instants": n},
        interface={"floor": {"sides": ["block.zmin", "ground"], "friction_coefficient": 0.8}},
        load={"push": {"face": "block.zmin", "traction": [sliding_block.FORCE / area, 0.0, 0.0], "law": law}},
        output={"fields": True},
        solver={"tolerance": 1e-6},
    )
