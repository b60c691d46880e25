"""Reduced substructures: frequencies of bars, static responses, and the identities of Ritz vectors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from latin_fmu.fem.elasticity import Isotropic
from latin_fmu.fem.elements import Elements, mass, stiffness
from latin_fmu.fem.faces import face
from latin_fmu.fem.mesh import box_mesh
from latin_fmu.propagator import LoadTerm, SubstructureModel, vibration
from latin_fmu.propagator.reduction import reduce_model

from .conftest import make_model

LENGTH, YOUNG, RHO = 2.0, 8.0, 0.5
SPEED = np.sqrt(YOUNG / RHO)


def bar(held: bool, n: int = 24) -> SubstructureModel:
    """A bar along z (no Poisson effect) with a normal interface at its upper end and an end load at the lower one."""
    mesh = box_mesh(np.zeros(3), np.array([0.3, 0.2, LENGTH]), (1, 1, n))
    basis = Elements(mesh)
    top, bottom = face(mesh, "zmax"), face(mesh, "zmin")
    dofs = np.arange(3 * mesh.n_node)
    free = np.setdiff1d(dofs, 3 * bottom.nodes + 2) if held else dofs
    count = len(top.nodes)
    pick = sp.csr_array((np.ones(count), (np.arange(count), 3 * top.nodes + 2)), shape=(count, len(dofs)))
    push = np.zeros(len(dofs))
    push[3 * bottom.nodes + 2] = bottom.areas
    velocity = np.zeros(len(dofs))
    velocity[2::3] = 0.0 if held else 1.5
    return SubstructureModel(
        name="bar",
        mass=mass(basis, RHO),
        damping=None,
        stiffness=stiffness(basis, Isotropic(1.0, YOUNG, 0.0)),
        expansion=sp.csr_array(sp.eye_array(len(dofs), format="csr")[:, free]),
        trace=pick,
        channel_area=top.areas,
        loads=[LoadTerm("push", push)],
        displacement=np.zeros(len(dofs)),
        velocity=velocity,
        imposed_pattern=np.zeros((len(dofs), 0)),
        imposed_start=np.zeros(0),
    )


def linear_element_eigenvalues(numbers: np.ndarray, n: int) -> np.ndarray:
    """Waves of wave number k on a row of linear elements with consistent mass: exact eigenvalues of that row."""
    h = LENGTH / n
    return 6.0 * (SPEED / h) ** 2 * (1.0 - np.cos(numbers * h)) / (2.0 + np.cos(numbers * h))


@pytest.mark.parametrize("held", [False, True])
def test_frequencies_of_a_bar(held):
    """Free: k L = j pi; one end held: k L = (j - 1/2) pi. Bending and torsion cannot be excited and are left out."""
    n, n_mode = 24, 5
    reduced = reduce_model(bar(held, n), n_mode, np.ones((4, 1)))
    j = np.arange(1, n_mode + 1)
    numbers = (j - 0.5 * held) * np.pi / LENGTH
    elastic = reduced.eigenvalues[reduced.n_rigid :]
    assert reduced.n_rigid == (0 if held else 1)
    np.testing.assert_allclose(elastic[:n_mode], linear_element_eigenvalues(numbers, n), rtol=1e-9)
    np.testing.assert_allclose(np.sqrt(elastic[:2]), SPEED * numbers[:2], rtol=3e-3)
    assert n_mode < len(elastic) <= n_mode + 2  # and what the static answers of two ends add


def test_static_answer_of_a_held_bar_is_exact():
    """Uniform traction t on the end: u = t L / E there, whatever the number of modes."""
    for n_mode in (0, 3):
        reduced = reduce_model(bar(held=True), n_mode, np.ones((4, 1)))
        force = reduced.trace.T @ (reduced.area * 0.7)
        moved = reduced.trace @ (force / reduced.eigenvalues)
        np.testing.assert_allclose(moved, 0.7 * LENGTH / YOUNG, rtol=1e-10)


def test_static_answer_of_a_free_bar_is_exact():
    """Pulled at both ends by equal forces: the stretch is t L / E."""
    reduced = reduce_model(bar(held=False), 2, np.ones((4, 1)))
    area = reduced.area.sum()
    force = reduced.trace.T @ (reduced.area * 0.7) - 0.7 * reduced.loads[:, 0]
    assert force[0] == pytest.approx(0.0, abs=1e-10 * area)
    q = force[1:] / reduced.eigenvalues[1:]
    ends = reduced.trace[:, 1:] @ q, reduced.loads[1:, 0] @ q / area
    np.testing.assert_allclose(ends[0] - ends[1], 0.7 * LENGTH / YOUNG, rtol=1e-9)


def test_rigid_start_is_kept():
    reduced = reduce_model(bar(held=False), 4, np.ones((4, 1)))
    np.testing.assert_allclose(reduced.basis @ reduced.velocity, bar(held=False).velocity, atol=1e-10)
    np.testing.assert_allclose(reduced.velocity[1:], 0.0, atol=1e-10)
    assert not reduced.displacement.any()


@pytest.mark.parametrize("kind", ["free", "held", "damped", "driven", "periodic", "everything"])
def test_ritz_identities(kind):
    """B^T M B = 1, B^T K B = diag(eigenvalues), and every channel's static response is inside."""
    model = make_model(kind).model
    reduced = reduce_model(model, 6)
    b = reduced.basis
    np.testing.assert_allclose(b.T @ (model.mass @ b), np.eye(b.shape[1]), atol=1e-9)
    scale = reduced.eigenvalues.max()
    np.testing.assert_allclose(b.T @ (model.stiffness @ b) / scale, np.diag(reduced.eigenvalues) / scale, atol=1e-9)
    if not reduced.n_rigid:
        e = model.expansion
        k = (e.T @ model.stiffness @ e).toarray()
        force = model.trace.T @ (model.channel_area * np.cos(np.arange(model.channel_area.size)))
        full = model.trace @ (e @ np.linalg.solve(k, e.T @ force))
        np.testing.assert_allclose(
            reduced.trace @ (b.T @ force / reduced.eigenvalues), full, atol=1e-8 * abs(full).max()
        )


def test_all_modes_are_the_whole_substructure():
    """With every mode, eigenvalues are those of the full problem and the initial state is exact."""
    model = make_model("held").model
    e = model.expansion
    reduced = reduce_model(model, 10_000)
    assert reduced.basis.shape[1] == e.shape[1]
    np.testing.assert_allclose(reduced.basis @ reduced.displacement, e @ (e.T @ model.displacement), atol=1e-9)
    np.testing.assert_allclose(reduced.trace @ reduced.velocity, model.trace @ (e @ (e.T @ model.velocity)), atol=1e-9)


def test_modes_that_matter_are_taken_before_lower_ones():
    """Tractions on single nodes can bend the bar; the modes a uniform traction excites are still the axial ones."""
    low = reduce_model(bar(held=True), 3)
    strong = reduce_model(bar(held=True), 3, exciting=np.ones((4, 1)))
    axial = linear_element_eigenvalues((np.arange(3) + 0.5) * np.pi / LENGTH, 24)
    assert low.eigenvalues[2] < 0.1 * axial[2]
    for value in axial:
        assert np.abs(strong.eigenvalues / value - 1.0).min() < 1e-9
    assert np.abs(low.eigenvalues / axial[2] - 1.0).min() > 1e-4


@pytest.mark.parametrize("exciting", [None, np.ones((4, 1))], ids=["lowest", "strongest"])
def test_sparse_eigenvalues_are_the_dense_ones(monkeypatch, exciting):
    dense = reduce_model(bar(held=False), 4, np.ones((4, 1)), exciting=exciting)
    monkeypatch.setattr(vibration, "DENSE", 10)
    sparse = reduce_model(bar(held=False), 4, np.ones((4, 1)), exciting=exciting)
    np.testing.assert_allclose(sparse.eigenvalues, dense.eigenvalues, rtol=1e-7)
    np.testing.assert_allclose(np.abs(sparse.loads), np.abs(dense.loads), rtol=1e-6, atol=1e-9)


def test_damping_and_loads_are_projected():
    model = make_model("damped").model
    reduced = reduce_model(model, 5)
    assert reduced.damping is not None
    np.testing.assert_allclose(
        reduced.damping,
        0.3 * np.eye(len(reduced.eigenvalues)) + 0.02 * np.diag(reduced.eigenvalues),
        atol=1e-8 * reduced.eigenvalues.max(),
    )
    assert reduced.loads.shape == (len(reduced.eigenvalues), 3)


def test_dashpots_excite_what_no_force_does():
    """A bar pulled along its axis, with dashpots along one edge alone: they bend it, and turn it."""
    model = bar(held=False, n=3)
    edge = np.flatnonzero(box_mesh(np.zeros(3), np.array([0.3, 0.2, LENGTH]), (1, 1, 3)).nodes[:, 0] == 0.0)
    rates = np.zeros(model.n_full)
    rates[3 * edge + 2] = 0.7
    model = replace(model, damping=sp.csr_array(sp.diags_array(rates)), velocity=np.zeros(model.n_full))
    reduced = reduce_model(model, 10_000, np.ones((4, 1)))
    s = 1.7j * np.sqrt(reduced.eigenvalues[reduced.n_rigid])
    whole = (s**2 * model.inertia + s * model.damping + model.stiffness).toarray()
    expected = model.trace @ np.linalg.solve(whole, model.loads[0].pattern)
    assert reduced.damping is not None
    few = s**2 * np.eye(len(reduced.eigenvalues)) + s * reduced.damping + np.diag(reduced.eigenvalues)
    found = reduced.trace @ np.linalg.solve(few, reduced.loads[:, 0])
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * abs(expected).max())
    # across the axis, by the dashpots alone
    assert np.ptp(abs(expected)) > 0.1 * abs(expected).max()


def test_what_cannot_be_reduced_is_said():
    model = bar(held=True)
    with pytest.raises(ValueError, match="number of modes"):
        reduce_model(model, -1)
    with pytest.raises(ValueError, match="shapes must be"):
        reduce_model(model, 1, np.ones((3, 1)))
    with pytest.raises(ValueError, match="no mass"):
        reduce_model(replace(model, mass=sp.csr_array(0.0 * model.mass)), 1)
