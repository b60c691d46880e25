"""Gravity, body forces with laws and accelerated faces against the loads and frames that they are equal to."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.cosim.segments import SegmentedRun
from latin_fmu.cosim.session import Session
from latin_fmu.errors import SceneError
from latin_fmu.stability.scenes import Box, Material, column
from tests.scenes import clamp, given_motion

Tables = dict[str, Any]
EXACT = 1e-8
STEEL, ALUMINIUM = Material(210e9, 7800.0, 0.3, "steel"), Material(70e9, 2700.0, 0.3, "aluminium")
SHAKE = {"type": "table", "times": [0.0, 5e-6, 1e-5, 2e-5, 3e-5], "values": [0.3, 1.0, -1.5, 0.7, 0.0]}
BASE = np.array([3e5, 0.0, -2e5])  # acceleration of the base where the law is 1, m s-2


def pair(behaviour: str = "contact", instants: int = 60, rigid: bool = False, **keys: Any) -> Tables:
    """A block of aluminium pressed on one of steel; ``keys`` : of [time] or [solver]."""
    boxes = {"b1": Box(STEEL, (0.02, 0.02, 0.01), (2, 2, 2)), "b2": Box(ALUMINIUM, (0.02, 0.02, 0.01), (2, 2, 2))}
    time = {"end": 3.6e-5, "instants": instants} | {k: v for k, v in keys.items() if k in ("scheme", "start")}
    solver = {k: v for k, v in keys.items() if k not in time}
    made = column(
        boxes,
        {"i1": {"behaviour": behaviour} | ({"friction_coefficient": 0.2} if behaviour == "contact" else {})},
        time,
        boundary={"base": {"type": "fixed", "face": "b1.zmin"}},
        load={"press": {"face": "b2.zmax", "pressure": 2e6}},
        solver={"tolerance": 1e-12, "max_iterations": 3000, **solver},
        output={"fields": True, "energy": True},
    )
    if rigid:
        made["substructure"]["b2"]["rigid"] = True
    return made


def solved(tables: Tables, folder: Path | None = None) -> latin_fmu.Solution:
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(copy.deepcopy(tables), folder))
    assert solution.converged, solution.status
    return solution


def fields(solution: latin_fmu.Solution, relative_to: np.ndarray | float = 0.0) -> np.ndarray:
    """Displacements of all nodes, (n_time, n_node, 3), m."""
    moved = np.concatenate([b.displacement for b in solution.substructures.values()], axis=1)
    return np.asarray(moved - relative_to)


def off(one: np.ndarray, other: np.ndarray) -> float:
    """Largest difference over the largest value."""
    return float(np.abs(one - other).max() / np.abs(other).max())


def in_both_frames(tables: Tables) -> tuple[float, float]:
    """Differences of relative displacements and of tractions between a shaken base and a shaken frame."""
    lab, frame = copy.deepcopy(tables), copy.deepcopy(tables)
    lab["boundary"]["base"] = given_motion("b1.zmin", BASE.tolist(), SHAKE, "xyz", kind="acceleration")
    frame["gravity"] = {"acceleration": (-BASE).tolist(), "law": SHAKE}
    a, b = solved(lab), solved(frame)
    base = a.substructures["b1"].displacement[:, :1]  # a node of the base
    moved = off(fields(a, base), fields(b))
    return moved, off(a.interfaces["i1"].traction, b.interfaces["i1"].traction)


HHT_ALPHA = {"type": "hht", "alpha": -0.2}
NEWMARK = {"type": "newmark", "beta": 0.3025, "gamma": 0.6}
NO_VISCOSITY = {"type": "generalized_alpha", "landing_damping": 0.0}


@pytest.mark.parametrize(
    "keys",
    [
        {"behaviour": "perfect"},
        {"behaviour": "perfect", "scheme": "generalized_alpha"},
        {"scheme": HHT_ALPHA},
        {"scheme": NEWMARK},
        {"scheme": NO_VISCOSITY},
        {"scheme": "massless_contact"},
        {"rigid": True},
        {"propagator": "cg"},
        {"propagator": "explicit", "instants": 400},
    ],
    ids=str,
)
def test_a_shaken_base_moves_the_assembly_as_its_frame_does(keys: Tables) -> None:
    """Motion relative to a base of acceleration a(t) = that on a fixed base under the body force -rho a(t)."""
    moved, traction = in_both_frames(pair(**keys))
    assert moved < EXACT
    assert traction < EXACT


@pytest.mark.parametrize("keys", [{"scheme": "hht"}, {"propagator": "explicit", "instants": 400}], ids=str)
def test_a_point_mass_weighs(keys: Tables) -> None:
    """Gravity acts on point masses as the acceleration of a frame does."""
    tables = pair(**keys)
    tables["point_mass"] = {"lump": {"face": "b2.zmax", "mass": 0.02}}
    assert max(in_both_frames(tables)) < EXACT


def test_approximations_of_a_shaken_base_agree_as_they_should() -> None:
    """The viscosity of contact layers acts on velocities that lag half a step; a reduced basis is another one."""
    assert max(in_both_frames(pair(scheme="generalized_alpha"))) < 5e-3
    assert in_both_frames(pair(propagator={"type": "reduced", "modes": 60}))[0] < 1e-2


def test_a_pulse_of_acceleration_leaves_its_exact_velocity_and_path() -> None:
    """After a triangular pulse: v = a T / 2, u = v (t - T / 2); nothing drifts beyond that."""
    width = 1.2e-5  # 20 steps
    law = {"type": "table", "times": [0.0, width / 2, width], "values": [0.0, 1.0, 0.0]}
    for scheme in ("hht", NEWMARK, "generalized_alpha"):
        tables = pair(scheme=scheme)
        face = {"type": "acceleration", "face": "b1.zmin", "components": ["x"], "value": [1e5], "law": law}
        tables["boundary"]["base"] = face
        body = solved(tables).substructures["b1"]
        time = np.linspace(0.0, 3.6e-5, 61)[35:]
        v = 0.5e5 * width
        assert off(body.velocity[35:, 0, 0], np.full(26, v)) < 1e-6, scheme
        lag = 5e-2 if scheme == NEWMARK else 1e-6  # with gamma = 0.6 it is of first order
        assert off(body.displacement[35:, 0, 0], v * (time - 0.5 * width)) < lag, scheme


def test_gravity_is_a_body_force_of_the_density() -> None:
    """With a law, on two materials, for elastic and rigid bodies."""
    for keys in ({}, {"rigid": True}, {"propagator": {"type": "reduced", "modes": 10}}):
        one, other = pair(**keys), pair(**keys)
        one["gravity"] = {"acceleration": [1e5, 0.0, -2e5], "law": SHAKE}
        for name, material in (("b1", STEEL), ("b2", ALUMINIUM)):
            force = [1e5 * material.density, 0.0, -2e5 * material.density]
            other["substructure"][name] |= {"body_force": force, "body_force_law": SHAKE}
        assert off(fields(solved(one)), fields(solved(other))) < EXACT


def test_the_weight_of_a_rigid_block_is_a_traction_through_its_centre() -> None:
    """rho g h on the top face moves a rigid block as its weight does."""
    one, other = pair(rigid=True), pair(rigid=True)
    one["substructure"]["b2"] |= {"body_force": [0.0, 0.0, -4e9], "body_force_law": SHAKE}
    other["load"]["weight"] = {"face": "b2.zmax", "traction": [0.0, 0.0, -4e7], "law": SHAKE}
    assert off(fields(solved(one)), fields(solved(other))) < EXACT


@pytest.mark.parametrize("scheme", ["hht", "generalized_alpha"])
def test_a_free_body_falls_without_strain(scheme: str) -> None:
    tables = pair(scheme=scheme)
    del tables["boundary"]["base"], tables["load"]["press"], tables["interface"]
    tables["gravity"] = {"acceleration": [0.0, 0.0, -1e5]}
    body = solved(tables).substructures["b1"]
    t = np.linspace(0.0, 3.6e-5, 61)
    assert np.ptp(body.displacement[:, :, 2], axis=1).max() < 1e-12 * np.abs(body.displacement).max()
    assert off(body.displacement[:, 0, 2], -0.5e5 * t**2) < 1e-3  # the paths of the schemes are of second order


def test_laws_come_from_files_with_units(tmp_path: Path) -> None:
    """A record in microseconds and g moves the bodies as the same table in SI does."""
    rows = [f"{i};{1e6 * t!r};{a!r}" for i, (t, a) in enumerate(zip(SHAKE["times"], SHAKE["values"], strict=True))]
    (tmp_path / "shake.csv").write_text("\n".join(["number;t [us];a [g]", *rows]))
    record = {"type": "csv", "file": "shake.csv", "time_column": "t [us]", "column": "a [g]"}
    made = []
    for size, law in ((9806.65, SHAKE), (1000.0, record | {"time_unit": "us", "value_unit": "g"})):
        tables = pair()
        tables["gravity"] = {"acceleration": [size, 0.0, 0.0], "law": law}
        made.append(fields(solved(tables, tmp_path)))
    assert off(*made) < EXACT


def test_a_force_is_its_traction_times_the_area_also_along_local_axes() -> None:
    """On a face of 4 cm2, along axes turned by 30 degrees about z."""
    c, s = np.sqrt(0.75), 0.5
    turned = {"x": [c, s, 0.0], "y": [-1.0, 1.0, 0.0]}
    made = []
    for load in (
        {"traction": [1e6 * c - 2e6 * s, 1e6 * s + 2e6 * c, -3e6]},
        {"force": [4e2, 8e2, -12e2], "axes": turned},
        {"traction": [1e6, 2e6, -3e6], "axes": turned},
    ):
        tables = pair(instants=20)
        tables["load"]["push"] = {"face": "b2.zmax", **load, "law": SHAKE}
        made.append(fields(solved(tables)))
    assert max(off(made[0], other) for other in made[1:]) < EXACT


def test_inputs_of_a_session_shake_as_laws_do() -> None:
    tables, n = pair(), 60
    tables["gravity"] = {"acceleration": [0.0, 0.0, -1e5], "law": SHAKE}
    tables["substructure"]["b2"] |= {"body_force": [1e9, 0.0, 0.0], "body_force_law": SHAKE}
    base = {"type": "acceleration", "face": "b1.zmin", "components": ["x"], "value": [1e5], "law": SHAKE}
    tables["boundary"]["base"] = base
    meeting = solved(tables).interfaces["i1"]
    whole = np.einsum("p,tpi->ti", meeting.areas, meeting.traction)[1:]
    driven = copy.deepcopy(tables)
    start = {"type": "input", "start_value": 0.3}
    driven["gravity"]["law"] = driven["boundary"]["base"]["law"] = start
    driven["substructure"]["b2"]["body_force_law"] = start
    session = Session(latin_fmu.scene_from_dict(driven))
    names = ("gravity.acceleration", "body_force.b2", "boundary.base")
    assert set(session.loads) == set(names)
    h, forces = 3.6e-5 / n, []
    for i in range(n):
        first, last = np.interp([i * h, (i + 1) * h], SHAKE["times"], SHAKE["values"])
        for name in names:
            session.set_load(name, first, (last - first) / h)
        if i == 0:
            session.initialize()
        assert session.step(i * h, h), i
        forces.append(session.values([f"interface.i1.force[{k}]" for k in (1, 2, 3)]))
    assert off(np.array(forces), whole) < EXACT


def test_a_run_in_segments_keeps_the_velocity_of_an_accelerated_face() -> None:
    tables = pair()
    base = {"type": "acceleration", "face": "b1.zmin", "components": ["x"], "value": [1e5], "law": SHAKE}
    tables["boundary"]["base"] = base
    whole = fields(solved(tables))[-1]
    run = SegmentedRun(latin_fmu.scene_from_dict(tables))
    for i in range(3):
        assert run.advance((i + 1) * 1.2e-5, 20).converged
        if i < 2:
            state = run.snapshot()
            run.reset()
            run.restore(state)
    assert off(np.concatenate([run.displacement("b1"), run.displacement("b2")]), whole) < EXACT


def test_a_static_start_is_the_equilibrium_under_the_weight_at_its_start() -> None:
    """Bodies stay at rest under what acts at t = 0 and goes on."""
    tables = pair(start="static")
    tables["gravity"] = {"acceleration": [0.0, 0.0, -1e6]}
    tables["substructure"]["b2"] |= {"body_force": [0.0, 0.0, -1e9]}
    tables["substructure"]["b2"]["body_force_law"] = {"type": "table", "times": [0.0, 1.0], "values": [0.5, 0.5]}
    still = solved(tables)
    weight = np.abs(fields(still)).max() / 3.6e-5
    assert max(np.abs(b.velocity).max() for b in still.substructures.values()) < 1e-8 * weight
    force = float(still.interfaces["i1"].areas @ still.interfaces["i1"].traction[-1, :, 2])
    assert force == pytest.approx(-(2e6 + (1e6 * 2700.0 + 0.5e9) * 0.01) * 4e-4, rel=1e-6)


@pytest.mark.parametrize("law", ["constant", {"type": "table", "times": [0.0, 1e-4], "values": [0.5, 0.5]}])
def test_a_bolt_is_tightened_without_body_forces_which_then_act(law: Any) -> None:
    """As the gravity that they are, in the tightened state and after it."""
    runs = []
    for own in (False, True):
        tables = clamp()
        if own:
            for body in tables["substructure"].values():
                body |= {"body_force": [0.0, 0.0, -1e5 * 7800.0], "body_force_law": law}
        else:
            tables["gravity"] = {"acceleration": [0.0, 0.0, -1e5], "law": law}
        solution = latin_fmu.solve(latin_fmu.scene_from_dict(tables))
        assert solution.converged
        runs.append((solution.sensors["tip"].displacement, solution.bolts["b"].force))
    (moved, force), (other, same) = runs
    assert off(moved, other) < 1e-6
    assert off(force, same) < 1e-6


def test_a_body_force_that_begins_with_nothing_has_no_part_in_the_start() -> None:
    tables = pair(start="static")
    still = solved(tables)
    tables["substructure"]["b2"] |= {"body_force": [0.0, 0.0, -1e9]}
    tables["substructure"]["b2"]["body_force_law"] = {"type": "table", "times": [0.0, 1.0], "values": [0.0, 1.0]}
    rising = solved(tables)
    assert np.array_equal(fields(rising)[0], fields(still)[0])
    assert np.abs(fields(rising)[-1] - fields(still)[-1]).max() > 0.0


def test_what_needs_inertia_is_refused_without() -> None:
    tables = pair()
    tables["boundary"]["base"] = {"type": "acceleration", "face": "b1.zmin", "components": ["z"], "value": [1.0]}
    tables["time"]["quasi_static"] = True
    with pytest.raises(SceneError, match=r"boundary\.base.*an acceleration needs inertia"):
        latin_fmu.scene_from_dict(tables)
