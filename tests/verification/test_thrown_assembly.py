"""Assemblies that are thrown or fall as they are tightened: [motion] velocity, against the same scene at rest."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.api import check
from latin_fmu.building import discretise
from latin_fmu.cosim import Session, Settings
from latin_fmu.errors import SceneError

VELOCITY = np.array([0.3, -0.2, -1.0])
PRELOAD = 1500.0
MARCHES: dict[str, dict[str, Any]] = {
    "hht": {"time": {"scheme": "hht"}},
    "newmark": {"time": {"scheme": "newmark"}},
    "generalized_alpha": {"time": {"scheme": "generalized_alpha"}},
    "massless_contact": {"time": {"scheme": "massless_contact"}},
    "explicit": {"time": {"scheme": "central_difference", "step": 0.05e-6, "end": 4e-6}},
    "reduced": {"solver": {"propagator": {"type": "reduced", "modes": 8}}},
    "cg": {"solver": {"propagator": "cg"}},
}
BOXES = {
    "bottom": ("aluminium", [0.0, 0.0, 0.0], [0.02, 0.02, 0.004], [4, 4, 1]),
    "frame": ("aluminium", [0.0, 0.0, 0.004], [0.005, 0.02, 0.01], [1, 4, 2]),
    "screw": ("steel", [0.0075, 0.0075, 0.004], [0.005, 0.005, 0.01], [1, 1, 4]),
    "wall": ("aluminium", [0.015, 0.0, 0.004], [0.005, 0.02, 0.01], [1, 4, 2]),
    "top": ("aluminium", [0.0, 0.0, 0.014], [0.02, 0.02, 0.004], [4, 4, 1]),
}


def bolted(velocity: Any = None, **tables: Any) -> dict[str, Any]:
    """Two plates that a screw presses on two walls, in space."""
    joint = {"behaviour": "perfect"}
    scene: dict[str, Any] = {
        "name": "bolted",
        "material": {
            "steel": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0},
            "aluminium": {"young_modulus": 70e9, "poisson_ratio": 0.33, "density": 2700.0},
        },
        "substructure": {
            name: {"material": material, "box": {"origin": origin, "size": size, "elements": elements}}
            for name, (material, origin, size, elements) in BOXES.items()
        },
        "contact": {"all": {"search": 1e-5, "friction_coefficient": 0.2}},
        "interface": {
            "head": {"sides": ["screw.zmax", "top.zmin"], **joint},
            "thread": {"sides": ["screw.zmin", "bottom.zmax"], **joint},
        },
        "bolt": {"m5": {"substructure": "screw", "axis": [0.0, 0.0, 1.0], "force": PRELOAD}},
        "time": {"end": 40e-6, "step": 0.5e-6},
        "solver": {"tolerance": 1e-9},
        "output": {"fields": True, "energy": True},
        "sensor": {"top": {"face": "top.zmax"}},
    }
    if velocity is not None:
        scene["motion"] = {"velocity": list(velocity)}
    for key, table in tables.items():
        scene[key] = {**scene.get(key, {}), **table}
    return scene


def floor(gap: float) -> dict[str, Any]:
    ground = {"point": [0.0, 0.0, -gap], "normal": [0.0, 0.0, 1.0]}
    return {"interface": {"floor": {"sides": ["bottom.zmin", "ground"], "friction_coefficient": 0.2, "ground": ground}}}


def with_floor(scene: dict[str, Any], gap: float) -> dict[str, Any]:
    scene["interface"] |= floor(gap)["interface"]
    return scene


def solved(scene: dict[str, Any]) -> Any:
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(scene))
    assert solution.converged
    return solution


@pytest.mark.parametrize("march", list(MARCHES))
def test_in_flight_it_is_the_assembly_at_rest(march: str) -> None:
    """Displacements, forces and the tension, in a frame that moves with it; the tension stays."""
    still, thrown = (solved(bolted(v, **MARCHES[march])) for v in (None, VELOCITY))
    limit = 1e-6 if march == "reduced" else 1e-8  # whose basis has rigid motions to its own round-off
    path = thrown.time[:, None, None] * VELOCITY
    size = max(float(np.abs(h.displacement).max()) for h in thrown.substructures.values())
    for name, history in thrown.substructures.items():
        other = still.substructures[name]
        assert np.abs(history.displacement - path - other.displacement).max() < limit * size
        assert np.abs(history.velocity - VELOCITY - other.velocity).max() < limit
    for name, history in thrown.interfaces.items():
        assert np.abs(history.force() - still.interfaces[name].force()).max() < limit * PRELOAD
    assert thrown.bolts["m5"].force == pytest.approx(PRELOAD, rel=limit)


def test_six_momenta_stay() -> None:
    scene = bolted(VELOCITY)
    problem, history = discretise(latin_fmu.scene_from_dict(scene)), solved(scene).substructures
    momenta = np.zeros((len(solved(scene).time), 6))
    for name, body in problem.bodies.items():
        places, v = history[name].nodes, history[name].velocity
        momentum = (body.mass @ v.reshape(len(v), -1).T).T.reshape(v.shape)
        momenta[:, :3] += momentum.sum(axis=1)
        momenta[:, 3:] += np.cross(places, momentum).sum(axis=1)
    mass = sum(float(body.rigid_motions.mass[0, 0]) for body in problem.bodies.values())
    assert momenta[0, :3] == pytest.approx(mass * VELOCITY, rel=1e-12)
    assert np.abs(momenta - momenta[0]).max() < 1e-9 * np.abs(momenta[0]).max()


def test_the_preload_stays_until_it_lands() -> None:
    gap = 30e-6
    solution = solved(with_floor(bolted([0.0, 0.0, -1.0]), gap))
    touches = np.flatnonzero(solution.interfaces["floor"].force()[:, 2] != 0.0)
    first = int(touches[0])
    tension = solution.bolts["m5"].force
    # the plate bulges under the screw: it touches a little earlier than a flat one
    assert solution.time[first] == pytest.approx(gap, rel=0.3)
    assert tension[:first] == pytest.approx(PRELOAD, rel=1e-8)
    assert np.abs(tension[first:] / PRELOAD - 1.0).max() > 0.01
    energy = solution.outcome.energy
    assert np.abs(energy["balance"]).max() < 1e-6 * energy["kinetic"][0]


@pytest.mark.parametrize("mode", [0, 1])
def test_a_session_falls_as_the_run_does(mode: int) -> None:
    scene = latin_fmu.scene_from_dict(with_floor(bolted([0.0, 0.0, -1.0]), 30e-6))
    session = Session(scene, Settings(mode=mode))
    session.initialize()
    for i in range(8):
        report = session.step(i * 5e-6, 5e-6)
        assert report, report.message
    run = latin_fmu.solve(scene)
    names = ["bolt.m5.force", "interface.floor.normalForce", "sensor.top.velocity[3]"]
    expected = [run.bolts["m5"].force[-1], run.interfaces["floor"].force()[-1, 2], run.sensors["top"].velocity[-1, 2]]
    assert session.values(names) == pytest.approx(expected, rel=1e-5)


def test_without_bolts_it_is_the_velocity_of_every_body() -> None:
    scene = bolted()
    del scene["bolt"]
    scene["load"] = {"push": {"face": "top.zmax", "pressure": 1e6}}
    each = {name: {**body, "initial_velocity": VELOCITY.tolist()} for name, body in scene["substructure"].items()}
    by_body, at_once = (
        solved({**scene, "substructure": each}),
        solved({**scene, "motion": {"velocity": list(VELOCITY)}}),
    )
    for name, history in at_once.substructures.items():
        assert np.array_equal(history.displacement, by_body.substructures[name].displacement)


def test_velocities_of_bodies_are_relative_to_it() -> None:
    scene = bolted(VELOCITY)
    ball = {"origin": [0.0, 0.0, 0.1], "size": [0.01] * 3, "elements": [1, 1, 1]}
    scene["substructure"]["ball"] = {"material": "steel", "box": ball, "initial_velocity": [0.0, 0.0, 2.0]}
    solution = solved(scene)
    thrown = VELOCITY + np.array([0.0, 0.0, 2.0])
    assert solution.substructures["ball"].velocity[-1] == pytest.approx(np.tile(thrown, (8, 1)))
    assert solution.bolts["m5"].force == pytest.approx(PRELOAD, rel=1e-8)


def refusal(scene: dict[str, Any]) -> Any:
    with pytest.raises(SceneError) as caught:
        check(latin_fmu.scene_from_dict(scene))
    return caught.value.problems[0]


def test_a_velocity_of_a_bolted_body_names_the_way() -> None:
    scene = bolted()
    scene["substructure"]["screw"]["initial_velocity"] = [0.0, 0.0, -1.0]
    assert "[motion] velocity" in refusal(scene).remedy


def test_what_is_held_cannot_be_thrown() -> None:
    held = {"base": {"type": "fixed", "face": "bottom.zmin", "components": ["z"]}}
    problem = refusal(bolted(VELOCITY, boundary=held))
    assert problem.where == "motion.velocity"
    assert "a boundary holds bottom" in problem.what
    check(latin_fmu.scene_from_dict(bolted([0.3, -0.2, 0.0], boundary=held)))


def test_what_is_bonded_to_the_ground_cannot_be_thrown() -> None:
    scene = bolted(VELOCITY)
    scene["interface"]["base"] = {"sides": ["bottom.zmin", "ground"], "behaviour": "perfect"}
    problem = refusal(scene)
    assert problem.where == "motion.velocity"
    assert "interface base bonds bottom to the ground" in problem.what


def test_a_base_that_moves_with_it_is_not_refused() -> None:
    drive = {"type": "velocity", "face": "bottom.zmin", "components": ["x", "y", "z"], "value": VELOCITY.tolist()}
    solution = solved(bolted(VELOCITY, boundary={"base": drive}))
    assert solution.bolts["m5"].force == pytest.approx(PRELOAD, rel=1e-8)
    drive["value"] = [0.0, 0.0, 0.0]
    assert refusal(bolted(VELOCITY, boundary={"base": drive})).where == "boundary.base"


def test_it_needs_inertia() -> None:
    scene = bolted(VELOCITY)
    scene["time"] = {"end": 1.0, "instants": 2, "quasi_static": True}
    with pytest.raises(SceneError, match="a velocity needs inertia"):
        latin_fmu.scene_from_dict(scene)
