"""The converged result is that of the discrete problem, whatever the windows and the search direction."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import latin_fmu
from latin_fmu.assembly.merged_assembly import _check_start, merge
from latin_fmu.assembly.problem import SolverReadyProblem
from latin_fmu.building import build, discretise
from latin_fmu.propagator import DirectPropagator
from latin_fmu.propagator.base import full_displacement
from tests.alone import alone_of, started_alone
from tests.scenes import solve

from .blocks import apart, stack
from .blocks import bonded as bonded_reference
from .oracles.contact_march import march_contact
from .oracles.hexahedra import matching_nodes
from .oracles.monolithic import Scheme, march

SCHEMES = {
    "hht": ({"type": "hht", "alpha": -0.1}, Scheme.hht(-0.1)),
    "newmark": ({"type": "newmark", "beta": 0.25, "gamma": 0.5}, Scheme.newmark()),
}


def bonded(built: SolverReadyProblem) -> tuple[DirectPropagator, dict[str, slice]]:
    """The assembly as one body, begun at its instants; slices of the full dofs of its substructures."""
    assembly = built.assembly
    merged = merge([m for p in assembly.propagators for m in p.members], assembly.interfaces, built.info)
    propagator = DirectPropagator([merged.model], assembly.scheme, assembly.dt, False)
    propagator.begin([merged.histories(built.timeline, assembly.time)], assembly.dt)
    return propagator, merged.where


def displacements(body: DirectPropagator, n: int) -> np.ndarray:
    """March of a body over n instants, (n + 1, n_node, 3), m."""
    nothing = np.zeros((0, 1))
    started_alone(body, nothing, body.mass_factor())
    fields = [full_displacement(body, 0)]
    for _ in range(n):
        alone_of(body).predict()
        alone_of(body).commit(nothing)
        fields.append(full_displacement(body, 0))
    return np.stack(fields)


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize(("window", "bonds"), [(1, "direct"), (1, "iterate"), (7, "iterate"), ("whole", "iterate")])
def test_perfect_interfaces_are_the_merged_mesh(scheme, window, bonds):
    """All interfaces perfect, solved at once or iterated to round-off: the merged mesh to 1e-8."""
    described, reference = SCHEMES[scheme]
    scene = stack(3, "perfect", tolerance=1e-11, window=window, max_iterations=400, bonds=bonds)
    scene["time"]["scheme"] = described
    solution = solve(scene)
    solid, system, loads = bonded_reference(3, reference)
    expected = march(system, loads)
    for name, history in solution.substructures.items():
        there = matching_nodes(history.nodes, solid.nodes)
        for computed, exact in ((history.displacement, expected.displacement), (history.velocity, expected.velocity)):
            wanted = exact.reshape(len(exact), -1, 3)[:, there]
            assert np.abs(computed - wanted).max() <= 1e-8 * np.abs(exact).max(), name


@pytest.mark.parametrize("friction", [0.0, 0.1, 10.0])
def test_contact_is_the_coupled_discrete_problem(friction):
    """Against Newton and Gauss-Seidel on the whole contact operator at every instant: forces to 1e-6."""
    solids, bodies, faces = apart(3, friction, Scheme.hht(-0.1))
    expected = march_contact(bodies, faces)
    solution = solve(stack(3, "contact", friction, tolerance=1e-9, max_iterations=2000))
    for i, face in enumerate(faces):
        history = solution.interfaces[f"i{i + 1}"]
        order = matching_nodes(history.points, solids[i].nodes[face.nodes[0]])
        nodal = history.traction * history.areas[:, None]
        assert np.abs(nodal - expected.force[i][:, order]).max() < 1e-6 * np.abs(expected.force[i]).max()
    for b, name in enumerate(("b1", "b2", "b3")):
        history = solution.substructures[name]
        order = matching_nodes(history.nodes, solids[b].nodes)
        moved = expected.displacement[b].reshape(len(history.time), -1, 3)[:, order]
        assert np.abs(history.displacement - moved).max() < 1e-6 * np.abs(moved).max()


def resultants(solution):
    return np.stack([h.force() for h in solution.interfaces.values()])


@pytest.fixture(scope="module")
def tight():
    """Stack of three blocks with friction, windows of one instant, iterated far."""
    return resultants(solve(stack(3, "contact", 0.2, tolerance=1e-8, max_iterations=2000)))


@pytest.mark.parametrize("window", [1, 4, 13, "whole"])
def test_windows_do_not_change_the_answer(window, tight):
    """One window or many: within ten times the tolerance on sqrt(eta)."""
    forces = resultants(solve(stack(3, "contact", 0.2, window=window, tolerance=1e-4, max_iterations=400)))
    assert np.abs(forces - tight).max() < 1e-3 * np.abs(tight).max()


@pytest.mark.parametrize("acceleration", ["anderson", "none"])
@pytest.mark.parametrize("kind", ["automatic", "impedance", "row", "diagonal"])
def test_search_directions_do_not_change_the_answer(kind, acceleration, tight):
    """Every choice of k, plain or accelerated, ends in one result."""
    scene = stack(
        3, "contact", 0.2, search_direction=kind, acceleration=acceleration, tolerance=1e-4, max_iterations=2000
    )
    assert np.abs(resultants(solve(scene)) - tight).max() < 1e-3 * np.abs(tight).max()


@pytest.mark.parametrize("friction", [None, 0.3])
def test_merged_body_is_the_monolithic_march(friction):
    """The bonded assembly as one body, whatever its interfaces are: the reference march to 1e-10."""
    scene = stack(3, "perfect") if friction is None else stack(3, "contact", friction)
    built = build(latin_fmu.scene_from_dict(scene))
    body, where = bonded(built)
    moved = displacements(body, built.assembly.n_instant)
    solid, system, loads = bonded_reference(3, Scheme.hht(-0.1))
    expected = march(system, loads).displacement.reshape(len(moved), -1, 3)
    for name, rows in where.items():
        there = matching_nodes(built.info[name].nodes, solid.nodes)
        nodes = slice(rows.start // 3, rows.stop // 3)
        assert np.abs(moved[:, nodes] - expected[:, there]).max() <= 1e-10 * np.abs(expected).max()


@pytest.mark.parametrize("elements", [2, 4])
def test_merged_body_of_non_matching_meshes(elements):
    """Bonds as constraints of one body: the march with every bond iterated to round-off, coarser or finer in between.

    The quarter models share planes of symmetry, where both sides of a bond are held."""
    scene = stack(3, "perfect", tolerance=1e-11, bonds="iterate", max_iterations=400)
    scene["substructure"]["b2"]["box"]["elements"] = [elements] * 3
    solution = solve(scene)
    built = build(latin_fmu.scene_from_dict(scene))
    assert not any(unit.geometry.matching for unit in built.assembly.interfaces)
    body, where = bonded(built)
    moved = displacements(body, built.assembly.n_instant)
    for name, rows in where.items():
        expected = solution.substructures[name].displacement
        nodes = slice(rows.start // 3, rows.stop // 3)
        assert np.abs(moved[:, nodes] - expected).max() <= 1e-8 * np.abs(moved).max()


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_identical_blocks_may_have_a_factor_each(friction):
    """Shared or not: the same result to the accuracy of the iteration, only classes differ."""
    forces, classes = [], []
    for share in (True, False):
        scene = stack(5, "contact", friction, share_identical=share, tolerance=1e-9, force_tolerance=1e-9)
        prepared = discretise(latin_fmu.scene_from_dict(scene))
        classes.append([len(c.members) for c in prepared.classes])
        forces.append(resultants(solve(scene)))
    assert classes == [[1, 2, 1, 1], [1, 1, 1, 1, 1]]
    assert np.abs(forces[0] - forces[1]).max() < 1e-8 * np.abs(forces[0]).max()


def test_a_spin_across_bonded_faces_of_unlike_meshes_is_refused() -> None:
    """Weighted means of the nodes of the other face give translations, which every node shares, and no rotations."""
    moving = [(0.0, 0.0, 0.0), (3.0, -2.0, 1.0)]
    for velocity in moving:
        model = SimpleNamespace(name="a", displacement=np.zeros(12), velocity=np.tile(velocity, 4))
        _check_start([model])
    turning = SimpleNamespace(name="a", displacement=np.zeros(12), velocity=np.arange(12.0))
    with pytest.raises(ValueError, match="a starts with a spin"):
        _check_start([turning])
