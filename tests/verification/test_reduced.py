"""Reduced substructures on whole scenes: the result of the mesh, the error stated, energy, restarts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import latin_fmu
from latin_fmu.propagator import vibration
from latin_fmu.stability.surfaces import turned, typed_box, write_mesh
from tests.scenes import solve

from .blocks import stack
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


def test_rigid_bodies_stay_as_they_are():
    scenes = [stack(2, "contact", 0.3, propagator=p) for p in ("direct", {"type": "reduced", "modes": 1000})]
    for scene in scenes:
        scene["substructure"]["b2"]["rigid"] = True
    exact, force = (solve(s).interfaces["i1"].force() for s in scenes)
    assert np.linalg.norm(force - exact) <= 1e-2 * np.linalg.norm(exact)


def square_bars(folder: Path, axes: np.ndarray, unit: float) -> tuple[np.ndarray, list[int]]:
    """Contact force (n_time, 3) of two square bars, in the axes and units of the first frame; modes of each.

    axes : (3, 3) orthogonal, of the second frame in the first. unit : lengths of the second frame over the first.
    """
    size, elements = np.array([0.02, 0.02, 0.05]), (3, 3, 6)
    for name, level in (("a", 0.0), ("b", size[2])):
        mesh = typed_box("hexahedron", np.array([0.0, 0.0, level]), size, elements)
        write_mesh(folder / f"{name}.msh", mesh, lambda nodes: unit * (nodes @ axes.T))
    described = {
        "name": "square_bars",
        "material": {"steel": {"young_modulus": 210e9 / unit, "poisson_ratio": 0.3, "density": 7800 / unit**3}},
        "substructure": {n: {"material": "steel", "mesh": {"file": f"{n}.msh", "group": "body"}} for n in "ab"},
        "interface": {"meet": {"sides": ["a.zmax", "b.zmin"], "friction_coefficient": 0.3}},
        "boundary": {"base": {"type": "fixed", "face": "a.zmin"}},
        "load": {"push": {"face": "b.zmax", "pressure": 1e8 / unit, "law": {"type": "half_sine", "duration": 1e-5}}},
        "time": {"end": 4e-5, "instants": 80},
        "solver": {"tolerance": 1e-10, "force_tolerance": 1e-10, "propagator": {"type": "reduced", "modes": 50}},
    }
    described["substructure"]["b"]["initial_velocity"] = (unit * axes @ np.array([1.0, 0.5, -2.0])).tolist()
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(described, folder))
    assert solution.converged, solution.status
    counts = [int(w.split("reduced to ")[1].split(" modes")[0]) for w in solution.warnings if "reduced to" in w]
    return solution.interfaces["meet"].force() @ axes / unit, counts


@pytest.mark.parametrize("dense", [True, False])
def test_the_answer_does_not_depend_on_axes_and_units(tmp_path, monkeypatch, dense):
    """A square section has pairs of equal frequencies, and mode 50 of a bar is the first of one: 1e-8 wherever the
    axes are, mirrored, in mm; by dense and by sparse eigenvalues."""
    if not dense:
        monkeypatch.setattr(vibration, "DENSE", 10)
    force, modes = square_bars(tmp_path, np.eye(3), 1.0)
    assert 51 in modes
    for axes, unit in (
        (np.eye(3), 1e3),
        (np.diag([-1.0, 1.0, 1.0]), 1.0),
        (np.eye(3)[[1, 2, 0]], 1.0),
        (turned([1, 2, 3], 30.0), 1.0),
    ):
        other, _ = square_bars(tmp_path, axes, unit)
        assert np.abs(other - force).max() <= 1e-8 * np.abs(force).max()
