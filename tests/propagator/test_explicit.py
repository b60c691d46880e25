"""The explicit propagator against a dense march of the same equations, and its stable step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from latin_fmu.errors import SolverError
from latin_fmu.propagator.base import channel_displacement, full_displacement, full_velocity
from latin_fmu.propagator.explicit import ExplicitPropagator
from latin_fmu.propagator.model import lumped
from latin_fmu.propagator.stable_step import StableStep
from latin_fmu.time_scheme import CentralDifference
from tests.alone import alone_of, started_alone

Array = np.ndarray
Make = Callable[..., Any]
DT = 0.05


def started(members: list[Any], dt: float = DT, traction: Array | None = None) -> ExplicitPropagator:
    """Explicit propagator with energies at t = 0."""
    scheme = CentralDifference()
    propagator = ExplicitPropagator([d.model for d in members], scheme, dt, energy=True)
    propagator.begin([d.histories for d in members], dt)
    zero = np.zeros((propagator.n_channel, len(members)))
    started_alone(propagator, zero if traction is None else traction, propagator.mass_factor())
    return propagator


def leapfrog(driven: Any, tractions: Array, dt: float) -> tuple[Array, Array]:
    """u, v (n + 1, n_full) with the equations of the scheme, dense, in the full space; tractions (n + 1, n_channel)."""
    model, history = driven.model, driven.histories
    p, trace = model.expansion.toarray(), model.trace.toarray()
    mass, stiff = np.diag(model.mass.toarray().sum(axis=1)), model.stiffness.toarray()
    damp = np.zeros_like(mass) if model.damping is None else model.damping.toarray()
    nodes = damp.reshape(len(damp) // 3, 3, -1, 3).sum(axis=2)  # (node, component, component)
    implicit = la.block_diag(*nodes)
    terms = zip(history.amplitudes, model.loads, strict=True)
    loads = sum(np.outer(amplitude, term.pattern) for amplitude, term in terms)
    forces = (tractions * model.channel_area) @ trace
    given_v = history.imposed @ model.imposed_pattern.T
    free = p @ np.linalg.pinv(p)
    n = len(loads) - 1
    u, v = np.zeros((n + 1, model.n_full)), np.zeros((n + 1, model.n_full))
    u[0], v[0] = model.displacement, model.velocity
    reduced = p.T @ (mass + 0.5 * dt * implicit) @ p
    for i in range(n):
        x = u[i] + 0.5 * dt * v[i]
        f = 0.5 * (loads[i] + loads[i + 1]) + forces[i + 1] - stiff @ x - damp @ v[i]
        jump = given_v[i + 1] - given_v[i]
        f -= 0.5 * implicit @ jump
        v[i + 1] = v[i] + jump + dt * p @ np.linalg.solve(reduced, p.T @ f)
        u[i + 1] = x + 0.5 * dt * v[i + 1]
    assert np.abs((np.eye(len(free)) - free) @ (v - given_v).T).max() < 1e-12  # only driven dofs move besides
    return u, v


def test_march_under_given_tractions(kind: str, model: Make, tractions: Make) -> None:
    """Loads, initial motion, holds, ties, damping, prescribed motion and tractions at all instants."""
    m = model(kind)
    given = tractions(len(m.model.channel_area))
    u, v = leapfrog(m, given[..., 0], DT)
    propagator = started([m])
    for i in range(1, len(given)):
        alone_of(propagator).predict()
        alone_of(propagator).commit(given[i])
        for actual, expected in ((full_displacement(propagator, 0), u), (full_velocity(propagator, 0), v)):
            np.testing.assert_allclose(actual.ravel(), expected[i], rtol=0, atol=1e-11 * np.abs(expected).max())


def test_energy_identity_of_every_member(kind: str, model: Make, tractions: Make, unbalanced: Make) -> None:
    members = [model(kind, seed) for seed in range(2)]
    given = tractions(len(members[0].model.channel_area), 2)
    assert unbalanced(started(members), given[1:]) <= 1e-11


def test_answers_to_tractions(kind: str, model: Make, answers: Make) -> None:
    answers(started([model(kind)]), 1e-11)


def test_channels_read_the_motion_half_a_step_ahead(model: Make, tractions: Make) -> None:
    m = model("everything")
    given = tractions(len(m.model.channel_area))
    propagator = started([m])
    alone_of(propagator).predict()
    alone_of(propagator).commit(given[1])
    u, v = full_displacement(propagator, 0).ravel(), full_velocity(propagator, 0).ravel()
    expected = m.model.trace @ (u + 0.5 * DT * v)
    np.testing.assert_allclose(channel_displacement(propagator)[:, 0], expected, atol=1e-12)


@pytest.mark.parametrize("kind", ["free", "everything"])
def test_a_march_taken_up_again_is_the_same_to_the_last_bit(kind: str, model: Make, resumes: Make) -> None:
    m = model(kind)
    resumes(m, lambda: started([m]), DT)


@pytest.mark.parametrize("kind", ["free", "held", "damped", "periodic", "everything"])
def test_the_stable_step_is_the_longest_one(kind: str, model: Make, changed: Make) -> None:
    """98 % of it stays bounded over 600 steps, 103 % does not (undamped); damping leaves a margin."""
    m = changed(model(kind), {"loads": []}, {"amplitudes": []})
    limit = started([m], 1e-3).stability.longest
    p = m.model.expansion.toarray()
    mass, stiff = p.T @ np.diag(m.model.mass.toarray().sum(axis=1)) @ p, p.T @ m.model.stiffness.toarray() @ p
    undamped = 2.0 / np.sqrt(la.eigh(stiff, mass, eigvals_only=True)[-1])
    if m.model.damping is None:
        assert undamped * (1 - 1e-3) <= limit <= undamped * (1 + 1e-9)
    else:
        assert 0.5 * undamped < limit < undamped

    def grown(dt: float) -> float:
        rest = type(m.histories)(dt * np.arange(2), [], np.zeros((2, m.model.imposed_pattern.shape[1])))
        still = changed(m, {"velocity": m.model.velocity * (m.model.expansion.sum(axis=1).ravel() > 0)})
        propagator = started([type(m)(still.model, rest)], 1e-3)
        propagator.stability = StableStep(np.zeros(0), sp.csr_array((0, 0)))  # allows any step
        propagator.begin([rest], dt)
        zero = np.zeros((propagator.n_channel, 1))
        for _ in range(600):
            propagator.begin([rest], dt)
            alone_of(propagator).predict()
            alone_of(propagator).commit(zero)
        return float(np.abs(full_velocity(propagator, 0)).max())

    assert grown(0.98 * limit) < 50.0
    if m.model.damping is None:
        assert grown(1.03 * undamped) > 1e6


def test_a_step_that_is_too_long_is_refused(model: Make) -> None:
    m = model("free")
    with pytest.raises(SolverError, match="stable"):
        started([m], 10.0)


def test_largest_eigenvalues_of_large_and_small_systems_agree() -> None:
    """A chain of n masses: largest eigenvalue 2 k / m (1 + cos(pi / n)), free ends."""
    for n in (5, 400):
        k = sp.diags_array([-np.ones(n - 1), np.r_[1.0, 2 * np.ones(n - 2), 1.0], -np.ones(n - 1)], offsets=[-1, 0, 1])
        exact = 2.0 / np.sqrt((2.0 + 2.0 * np.cos(np.pi / n)) / 0.25)
        assert StableStep(np.full(n, 0.25), sp.csr_array(k)).longest == pytest.approx(exact, rel=1e-3)


def test_lumping_keeps_mass_and_what_translations_feel(model: Make) -> None:
    m = model("damped").model
    for component in range(3):
        shift = np.tile(np.eye(3)[component], m.n_full // 3)
        for matrix, nodal in ((m.mass, False), (m.damping, True)):
            np.testing.assert_allclose(lumped(matrix, nodal) @ shift, matrix @ shift, atol=1e-12)
    assert (lumped(m.mass, False).diagonal() > 0).all()
    assert lumped(m.mass, False).nnz == m.n_full
