"""Reduced substructures on whole scenes: the answer of the mesh, the error stated, energy, restarts."""

from __future__ import annotations

import numpy as np
import pytest

import latin_fmu
from latin_fmu.errors import SceneError

from .blocks import segments_and_snapshots, solve, stack
from .test_explicit import closes


def reduced(n: int, modes: int, **changes) -> latin_fmu.Solution:
    """Stack of blocks with friction, reduced."""
    return solve(stack(n, "contact", 0.3, propagator={"type": "reduced", "modes": modes}, **changes))


def stated(solution: latin_fmu.Solution) -> float:
    """Largest error that the warnings state."""
    messages = [w for w in solution.warnings if "estimated error of the interface velocities" in w]
    assert messages
    return max(float(w.split("velocities ")[1].split(" %")[0]) / 100 for w in messages)


def test_error_falls_with_the_modes_and_is_stated():
    """Contact force within 2 % with 40 modes; the stated error is 1 to 20 times that of the velocities."""
    exact = solve(stack(2, "contact", 0.3)).interfaces["i1"]
    force = exact.normal_resultant()
    errors = []
    for modes in (5, 40, 100):
        solution = reduced(2, modes)
        closes(solution.energy)
        history = solution.interfaces["i1"]
        errors.append(np.linalg.norm(history.normal_resultant() - force) / np.linalg.norm(force))
        velocity = np.linalg.norm(history.velocity - exact.velocity) / np.linalg.norm(exact.velocity)
        assert velocity <= stated(solution) <= 20 * velocity, (modes, velocity, stated(solution))
    assert errors[1] <= 0.02
    assert errors[2] < errors[1] < errors[0] < 0.05, errors


def test_every_mode_gives_the_answer_of_the_mesh():
    exact, solution = solve(stack(2, "contact", 0.3, tolerance=1e-8)), reduced(2, 1000, tolerance=1e-8)
    assert stated(solution) == 0.0
    for name, history in exact.interfaces.items():
        scale = np.abs(history.traction).max()
        assert np.abs(solution.interfaces[name].traction - history.traction).max() <= 1e-4 * scale
    for name, field in exact.substructures.items():
        scale = np.abs(field.displacement).max()
        assert np.abs(solution.substructures[name].displacement - field.displacement).max() <= 1e-6 * scale


def test_identical_members_with_loads_of_their_own():
    """Blocks that share operators, one of them loaded, one thrown: the basis serves each."""
    scenes = []
    for propagator in ("direct", {"type": "reduced", "modes": 80}):
        scene = stack(4, "contact", 0.3, propagator=propagator)
        del scene["boundary"]["base"]
        scene["substructure"]["b1"]["initial_velocity"] = [0.0, 0.0, 2.0]
        scenes.append(solve(scene))
    exact, solution = scenes
    closes(solution.energy)
    for name, history in exact.interfaces.items():
        difference = solution.interfaces[name].force() - history.force()
        assert np.linalg.norm(difference) <= 0.04 * np.linalg.norm(history.force()), name


def test_stress_and_sensors_come_from_the_whole_mesh():
    scene = stack(2, "contact", 0.3, propagator={"type": "reduced", "modes": 60})
    scene["output"] = {"stress": True}
    exact = stack(2, "contact", 0.3)
    exact["output"] = {"stress": True}
    stress, expected = (solve(s).substructures["b1"].stress for s in (scene, exact))
    assert np.linalg.norm(stress - expected) <= 0.05 * np.linalg.norm(expected)


def test_segments_and_snapshots_are_exact():
    scene = latin_fmu.scene_from_dict(stack(2, "contact", 0.3, propagator={"type": "reduced", "modes": 30}))
    segments_and_snapshots(scene, 1e-7)


def test_rigid_bodies_stay_as_they_are():
    scenes = [stack(2, "contact", 0.3, propagator=p) for p in ("direct", {"type": "reduced", "modes": 1000})]
    for scene in scenes:
        scene["substructure"]["b2"]["rigid"] = True
    exact, force = (solve(s).interfaces["i1"].force() for s in scenes)
    assert np.linalg.norm(force - exact) <= 1e-2 * np.linalg.norm(exact)


def test_a_scheme_without_mass_at_contacts_is_refused():
    scene = stack(2, "contact", 0.3, propagator="reduced")
    scene["time"]["scheme"] = "massless_contact"
    with pytest.raises(SceneError, match="a scheme in which every node has mass"):
        latin_fmu.scene_from_dict(scene)
