"""An assembly marched by its modes and the relative motions of its contacts, against the march of its bodies."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from latin_fmu import scene_from_dict
from latin_fmu.building import discretise
from latin_fmu.joined.reduced_assembly import StaticSolver, compressed, digital, lowest
from latin_fmu.joined.rigid_parts import RigidParts
from latin_fmu.joined.tied_assembly import TiedAssembly, TieError, eliminated, jump_rows
from latin_fmu.propagator.lanczos import lowest_modes
from latin_fmu.results.solution import Solution
from latin_fmu.stability.scenes import STEEL, Box, column
from tests.scenes import solve

PLATE = (0.06, 0.02, 0.01)
PRESSURE = 5e6
HIGHEST = 150e3
TIP = {"face": "up.xmax", "force": [0.0, 0.0, 200.0], "law": {"type": "half_sine", "duration": 0.4e-3}}
PRESS = {"face": "up.zmax", "pressure": PRESSURE, "law": {"type": "constant"}}
CLAMP = {"type": "fixed", "face": "low.xmin", "components": ["x", "y", "z"]}
DASHPOTS = {
    "sides": ["low.zmax", "up.zmin"],
    "behaviour": "viscous_joint",
    "normal_viscosity": 3e7,
    "tangential_viscosity": 3e7,
}
CORD = {"direction": [0.0, 0.0, 1.0], "stiffness": 1e7, "lateral_stiffness": 1e7}
FREE = {"boundary": {}, "load": {"press": PRESS, "hold": PRESS | {"face": "low.zmin"}, "tip": TIP}}
SHAKE = {"type": "acceleration", "face": "low.xmin", "components": ["x", "y", "z"], "value": [0.0, 0.0, 3000.0]}


def lap(
    law: dict[str, Any] | None = None, elements: tuple[int, int, int] = (12, 4, 2), **tables: Any
) -> dict[str, Any]:
    """Two plates pressed on each other, one clamped at its end, the other one hit at its own."""
    given: dict[str, Any] = {
        "boundary": {"clamp": CLAMP},
        "load": {"press": PRESS, "tip": TIP},
        "sensor": {"tip": {"face": "up.xmax"}},
        "output": {"energy": True, "reactions": True, "fields": True, "every": 50},
        "solver": {"tolerance": 1e-5},
    }
    plate = Box(STEEL, PLATE, elements)
    time = {"end": 1e-3, "step": 2e-6, "start": "static"}
    return column({"low": plate, "up": plate}, {"lap": law or {"friction_coefficient": 0.3}}, time, **given | tables)


def damped(scene: dict[str, Any]) -> dict[str, Any]:
    """The scene with damping by strains."""
    for material in scene["material"].values():
        material["rayleigh_stiffness"] = 4e-7
    return scene


def damped_by_ratios(scene: dict[str, Any]) -> dict[str, Any]:
    """The scene with a damping ratio of 5 % in a band of more than a decade."""
    for material in scene["material"].values():
        material["damping_ratios"] = {"frequencies": [1e3, 5e4], "ratios": [0.05, 0.05]}
    return scene


def modal(scene: dict[str, Any]) -> dict[str, Any]:
    """The scene marched by modes."""
    other = copy.deepcopy(scene)
    other["solver"]["propagator"] = {"type": "modal", "highest": HIGHEST}
    return other


def apart(first: np.ndarray, second: np.ndarray) -> float:
    """Largest difference over the largest value."""
    return float(np.abs(first - second).max() / np.abs(first).max())


SCENES: dict[str, dict[str, Any]] = {
    "friction": lap(),
    "bond": lap({"behaviour": "perfect"}),
    "without friction": lap({"friction_coefficient": 0.0}),
    "springs between the sides": lap(
        {"behaviour": "elastic_layer", "normal_stiffness": 1e14, "tangential_stiffness": 4e13}
    ),
    "soft contact": lap({"behaviour": "soft_contact", "normal_stiffness": 1e14, "friction_coefficient": 0.3}),
    "damped": damped(lap()),
    "damped by ratios": damped_by_ratios(lap()),
    "shaken": lap(
        boundary={"clamp": SHAKE | {"law": {"type": "half_sine", "duration": 0.4e-3}}}, load={"press": PRESS}
    ),
    "floating": lap(**FREE),
    "on springs": lap(
        **FREE,
        spring={
            "left": {"ends": [{"substructure": "low", "point": [0.0, 0.01, 0.0]}, "ground"], **CORD},
            "right": {"ends": [{"substructure": "low", "point": [0.06, 0.01, 0.0]}, "ground"], **CORD},
        },
    ),
    "heavy tip": lap(point_mass={"tip": {"face": "up.xmax", "mass": 0.1}}),
}


@pytest.fixture(scope="module", params=list(SCENES))
def both(request: pytest.FixtureRequest) -> tuple[Solution, Solution]:
    """A scene marched body by body and by modes."""
    scene = SCENES[request.param]
    return solve(scene), solve(modal(scene))


def test_the_marches_agree(both: tuple[Solution, Solution]) -> None:
    """As far as step and modes allow, which are those of the bending motion of both."""
    bodies, modes = both
    assert modes.converged
    assert "modes of the assembly" in modes.outcome.settings["propagator"]
    for name, history in bodies.interfaces.items():
        assert apart(history.force(), modes.interfaces[name].force()) < 0.015
        assert apart(history.traction, modes.interfaces[name].traction) < 0.06
        if history.contact_status is not None:
            assert (history.contact_status != modes.interfaces[name].contact_status).mean() < 0.06
    for name, sensor in bodies.sensors.items():
        assert apart(sensor.displacement, modes.sensors[name].displacement) < 0.003
        assert apart(sensor.velocity, modes.sensors[name].velocity) < 0.04
    for name, reaction in bodies.outcome.reactions.items():
        assert apart(reaction.force, modes.outcome.reactions[name].force) < 0.015
    for name, body in bodies.substructures.items():
        assert apart(body.displacement, modes.substructures[name].displacement) < 0.003


def test_energies_agree_and_close(both: tuple[Solution, Solution]) -> None:
    """Each term is that of the whole motion, the driven one included; the account closes to round-off."""
    bodies, modes = (solution.outcome.energy for solution in both)
    assert bodies is not None
    assert modes is not None
    largest = max(float(np.abs(term).max()) for term in modes.values())
    assert np.abs(modes["balance"]).max() < 1e-7 * largest  # S^-1 is kept in single precision
    scale = float(np.abs(bodies["elastic"] - bodies["elastic"][0]).max() + bodies["kinetic"].max())
    for term in ("kinetic", "elastic", "work_of_loads", "friction_dissipation", "damping_dissipation"):
        assert np.abs(bodies[term] - modes[term]).max() < 0.03 * scale
    # small beside the others: by itself
    taken = "damping_dissipation"
    assert modes[taken][-1] == pytest.approx(bodies[taken][-1], rel=0.2, abs=1e-12 * scale)


def test_damping_by_ratios_acts_on_relative_motions_as_on_modes() -> None:
    """Loss of the whole run, most of it by quasi-static motion of modes far above its frequency and of the joint: half
    of it is missing where the joint has none."""
    scene = damped_by_ratios(lap())
    bodies, modes = solve(scene), solve(modal(scene))
    taken = [solution.outcome.energy["damping_dissipation"][-1] for solution in (bodies, modes)]
    assert taken[1] == pytest.approx(taken[0], rel=0.005)
    assert apart(bodies.sensors["tip"].velocity, modes.sensors["tip"].velocity) < 0.02


def test_parts_that_contacts_hold_have_their_mass_with_few_modes() -> None:
    """With the three modes up to 16 kHz, which have little of the inertia of the upper plate."""
    scene = damped_by_ratios(lap())
    few = modal(scene)
    few["solver"]["propagator"]["highest"] = 16e3
    bodies, modes = solve(scene), solve(few)
    assert modes.outcome.settings["propagator"].startswith("3 modes")
    assert apart(bodies.sensors["tip"].displacement, modes.sensors["tip"].displacement) < 0.01
    assert apart(bodies.sensors["tip"].velocity, modes.sensors["tip"].velocity) < 0.03
    taken = [s.outcome.energy["friction_dissipation"][-1] for s in (bodies, modes)]
    assert taken[1] == pytest.approx(taken[0], rel=0.005)


@pytest.mark.parametrize(("highest", "limit"), [(16e3, 0.03), (50e3, 0.01)])
def test_a_sliding_block_obeys_newtons_law(highest: float, limit: float) -> None:
    """m a = F - mu N of a plate that slides as a whole, which is no mode of the assembly that sticks."""
    friction, force, duration, dt = 0.2, 3000.0, 0.8e-3, 4e-6
    mass, normal = STEEL.density * np.prod(PLATE), PRESSURE * PLATE[0] * PLATE[1]
    scene = lap(
        {"friction_coefficient": friction},
        boundary={"clamp": CLAMP | {"face": "low.zmin"}},
        load={
            "press": PRESS,
            "pull": {"face": "up.xmax", "force": [force, 0.0, 0.0], "law": {"type": "half_sine", "duration": duration}},
        },
        sensor={"up": {"face": "up.zmax"}},
    )
    scene["time"] |= {"end": duration, "step": dt}
    scene["solver"]["propagator"] = {"type": "modal", "highest": highest}
    sensor = solve(scene).sensors["up"]
    first = duration / np.pi * np.arcsin(friction * normal / force)
    t = np.arange(len(sensor.velocity)) * dt
    slides = (t > first) & (t < duration - first)
    pulled = force * np.sin(np.pi * t / duration) - friction * normal
    gained = force * duration / np.pi * (np.cos(np.pi * first / duration) - np.cos(np.pi * t / duration))
    speed = (gained - friction * normal * (t - first)) / mass
    assert np.abs(sensor.velocity[:, 0] - speed)[slides].max() < limit * speed[slides].max()
    assert np.abs(sensor.acceleration[:, 0] - pulled / mass)[slides].max() < 2.0 * limit * pulled.max() / mass


@pytest.mark.parametrize(
    ("tables", "count", "common"),
    [
        ({}, 6, 0),  # the upper plate
        (FREE, 12, 6),
        ({"boundary": {"clamp": CLAMP, "rail": CLAMP | {"face": "up.ymin", "components": ["y"]}}}, 3, 0),
        # a point of the plate is held: it turns about it
        ({"spring": {"cord": {"ends": [{"substructure": "up", "point": [0.0, 0.01, 0.02]}, "ground"], **CORD}}}, 3, 0),
    ],
)
def test_parts_move_as_a_whole_where_nothing_strains_them(tables: dict[str, Any], count: int, common: int) -> None:
    problem = discretise(scene_from_dict(lap(**tables)))
    tied = TiedAssembly.of(problem.classes, problem.units, problem.layout)
    parts = RigidParts.of(tied, problem.layout)
    assert parts.mass.shape == (count, count)
    assert np.linalg.matrix_rank(parts.relative, tol=1e-8 * np.abs(parts.relative).max()) == count - common


def test_gaps_of_closed_points_stay_closed(both: tuple[Solution, Solution]) -> None:
    history = both[1].interfaces["lap"]
    if history.gap is None or history.layer_energy is not None:
        pytest.skip("the sides cannot open")
    closed = history.contact_status[1:] != 0
    opened = float(np.abs(history.gap).max())
    assert np.abs(history.gap[1:][closed]).max() < 1e-3 * opened + 1e-20


def test_momentum_of_a_floating_assembly_is_the_impulse() -> None:
    """Half sine of 200 N and 0.4 ms on two plates, none of which is held."""
    scene = modal(SCENES["floating"])
    found = solve(scene)
    problem = discretise(scene_from_dict(copy.deepcopy(scene)))
    momentum = 0.0
    for name, body in problem.bodies.items():
        field = found.substructures[name].velocity[-1].ravel()
        momentum += float(np.tile([0.0, 0.0, 1.0], body.mesh.n_node) @ (body.mass @ field))
    amplitude = 200.0 * np.sin(np.pi * np.minimum(found.time, 0.4e-3) / 0.4e-3)
    assert momentum == pytest.approx(np.trapezoid(amplitude, found.time), rel=1e-9)


def test_a_pressed_joint_at_rest_keeps_its_force() -> None:
    """For 5,000 instants, with nothing that moves it."""
    scene = modal(lap(load={"press": PRESS}))
    scene["time"]["end"] = 10e-3
    force = solve(scene).interfaces["lap"].force()[:, 2]
    assert np.abs(force / force[0] - 1.0).max() < 1e-8


def test_bonds_are_recovered() -> None:
    """Of three plates the upper two are bonded: the traction of the bond, and the drift of its sides, which is none."""
    scene = lap()
    plate = Box(STEEL, PLATE, (12, 4, 2))
    given = {key: scene[key] for key in ("boundary", "sensor", "output", "solver", "load", "time")}
    laws = {"lap": {"friction_coefficient": 0.3}, "bond": {"behaviour": "perfect"}}
    three = column({"low": plate, "up": plate, "top": plate}, laws, given.pop("time"), **given)
    three["load"]["press"] = PRESS | {"face": "top.zmax"}
    bodies, modes = solve(three), solve(modal(three))
    history = modes.interfaces["bond"]
    assert apart(bodies.interfaces["bond"].force(), history.force()) < 0.01
    assert apart(bodies.interfaces["bond"].traction, history.traction) < 0.05
    assert np.abs(history.velocity[:, 0] - history.velocity[:, 1]).max() < 1e-12 * np.abs(history.velocity).max()


@pytest.mark.parametrize(
    ("table", "change", "reason"),
    [
        ("solver", {"window": 10}, "windows of several instants"),
        ("time", {"scheme": "generalized_alpha"}, "generalized_alpha"),
        ("interface", {"lap": DASHPOTS}, "dashpots between its sides"),
        ("boundary", {"far": {"type": "absorbing", "face": "up.xmin"}}, "absorbing face"),
    ],
)
def test_a_scene_that_asks_for_more_is_marched_body_by_body(table: str, change: dict[str, Any], reason: str) -> None:
    """With a remark that says why, to the same bits as without the request."""
    scene = modal(lap())
    scene["time"] |= {"end": 2e-5, "start": "given"}
    scene[table] |= change
    found = solve(scene)
    assert any("marched body by body" in warning and reason in warning for warning in found.warnings)
    scene["solver"]["propagator"] = "automatic"
    assert np.array_equal(found.interfaces["lap"].traction, solve(scene).interfaces["lap"].traction)


# -- parts ---------------------------------------------------------------------------------------------------------
def test_modes_keep_poles_in_average_acceleration() -> None:
    """A mode of 1 s-1 damping ratio 5 %, four steps a period: exp(s t) at every instant."""
    omega, ratio = 2.0 * np.pi, 0.05
    dt = 0.25
    made = digital(np.array([omega**2]), np.array([2 * ratio * omega]), dt)
    value, damping = float(made.values[0]), float(made.damping[0])
    s = -ratio * omega + 1j * omega * np.sqrt(1 - ratio**2)
    x, v = 1.0, 0.0
    a = -damping * v - value * x
    # of the pair of poles: both instants after the start, and the recursion that exp(s t) has
    path = [x]
    for _ in range(20):
        free_x, free_v = x + dt * v + 0.25 * dt**2 * a, v + 0.5 * dt * a
        a = -(damping * free_v + value * free_x) / (1 + 0.5 * dt * damping + 0.25 * dt**2 * value)
        x, v = free_x + 0.25 * dt**2 * a, free_v + 0.5 * dt * a
        path.append(x)
    z = np.exp(s * dt)
    left = np.array(path[2:]) - 2 * z.real * np.array(path[1:-1]) + abs(z) ** 2 * np.array(path[:-2])
    assert np.abs(left).max() < 1e-13


def test_relative_stiffness_is_what_the_modes_leave_at_rest() -> None:
    """S = K_rr - K_rq K_qq^-1 K_qr, of a clamped and of a floating assembly."""
    for tables in ({}, FREE):
        problem = discretise(scene_from_dict(copy.deepcopy(lap(elements=(5, 2, 1), **tables))))
        tied = TiedAssembly.of(problem.classes, problem.units, problem.layout)
        n = tied.n_free
        stiffness, mass = (sp.csr_array(matrix[:n, :n]) for matrix in (tied.stiffness, tied.mass))
        found = lowest(stiffness, mass, None, (2 * np.pi * 1e4) ** 2)
        assert found is not None
        assert found[0].shape[1] == (6 if tables else 0)
        coupling = tied.stiffness[:n, n:].toarray()
        expected = tied.stiffness[n:, n:].toarray() - coupling.T @ la.pinvh(stiffness.toarray()) @ coupling
        solver = StaticSolver(tied, found[0])
        assert np.abs(solver.relative - expected).max() < 1e-9 * np.abs(expected).max()
        for count in (1, 40):  # in tiles, and by matrix products
            # with inertia relief the response to a force leaves the rigid motions alone
            force = np.eye(n, count, -7)
            response = solver.solve(force)
            balanced = force - mass @ found[0] @ (found[0].T @ force)
            assert np.abs(stiffness @ response - balanced).max() < 1e-9
            assert np.abs(found[0].T @ (mass @ response)).max(initial=0.0) < 1e-9 * np.abs(response).max()


def test_tied_dofs_keep_bonds_and_give_relative_motions() -> None:
    problem = discretise(scene_from_dict(copy.deepcopy(lap({"behaviour": "contact", "friction_coefficient": 0.1}))))
    tied = TiedAssembly.of(problem.classes, problem.units, problem.layout)
    moved = (jump_rows(problem.layout, tied.trace, 0) @ tied.expansion).toarray()
    assert np.abs(moved[:, : tied.n_free]).max() < 1e-14
    exists = np.flatnonzero(tied.exists)
    assert np.abs(moved[exists][:, tied.n_free :] - np.eye(len(exists))).max() < 1e-14


def test_rows_are_solved_for_a_dof_each() -> None:
    """Random rows, some of them sums of others: those imply nothing more."""
    random = np.random.default_rng(3)
    rows = random.normal(size=(8, 20)) * (random.random((8, 20)) < 0.3)
    rows = np.vstack([rows, rows[0] + rows[1]])
    weights = np.vstack([np.eye(8), np.zeros((1, 8))])
    weights[8] = weights[0] + weights[1]
    made = eliminated(sp.csr_array(rows), np.zeros((9, 0)), sp.csr_array(weights))
    assert np.abs(rows @ made.q_part).max() < 1e-9
    assert np.abs(rows @ made.r_part.toarray() - weights).max() < 1e-9
    assert made.exists.all()


def test_relative_motions_that_depend_on_each_other_are_refused() -> None:
    rows = sp.csr_array(np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0], [1.0, 0.0, -1.0]]))
    with pytest.raises(TieError, match="depend on each other"):
        eliminated(rows, np.zeros((3, 0)), sp.csr_array(np.eye(3)))


def test_a_point_that_is_held_on_both_sides_has_no_relative_motion() -> None:
    rows = sp.csr_array(np.array([[1.0, -1.0], [0.0, 0.0]]))
    made = eliminated(rows, np.zeros((2, 0)), sp.csr_array(np.eye(2)))
    assert made.exists.tolist() == [True, False]


def test_block_lanczos_finds_equal_eigenvalues() -> None:
    """A square membrane of springs, whose eigenvalues come in pairs, beside a dense solution."""
    n = 40
    line = sp.diags_array([np.full(n - 1, -1.0), np.full(n, 2.0), np.full(n - 1, -1.0)], offsets=[-1, 0, 1])
    stiffness = sp.csr_array(sp.kron(line, sp.eye_array(n)) + sp.kron(sp.eye_array(n), line))
    mass = sp.csr_array(sp.diags_array(np.full(n * n, 2.0)))
    one = 2.0 - 2.0 * np.cos(np.pi * np.arange(1, n + 1) / (n + 1))
    exact = np.sort((one[:, None] + one).ravel()) / 2.0
    factor = sp.linalg.splu(sp.csc_matrix(stiffness))
    found = lowest_modes(mass, factor.solve, 0.0, float(exact[24]) * 1.0001, 100)
    assert found is not None
    values, modes = found
    assert values == pytest.approx(exact[: len(values)], rel=1e-10)
    assert len(values) >= 25
    assert np.abs(modes.T @ (mass @ modes) - np.eye(len(values))).max() < 1e-10
    assert lowest_modes(mass, factor.solve, 0.0, float(exact[60]), 20) is None


def test_few_shapes_hold_the_histories_of_many_points() -> None:
    random = np.random.default_rng(1)
    histories = random.normal(size=(80, 5)) @ random.normal(size=(5, 300))
    shapes = compressed(histories)
    assert shapes.shape[1] == 5
    assert np.abs(histories - histories @ shapes @ shapes.T).max() < 1e-9 * np.abs(histories).max()
