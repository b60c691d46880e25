"""The reduced propagator: equal to the direct one with every mode, its own equations and energies with few."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from latin_fmu.kernels.energy_parts import TERMS
from latin_fmu.propagator.base import full_displacement, full_velocity
from latin_fmu.propagator.reduced import ReducedPropagator, reduced_members
from tests.alone import alone_of, started_alone

from .conftest import DT

Array = np.ndarray
Make = Callable[..., Any]
ALL = 10_000


def started(members: list[Any], scheme: Any, modes: int, traction: Array | None = None) -> ReducedPropagator:
    """Reduced propagator with energies at t = 0."""
    propagator = ReducedPropagator([d.model for d in members], scheme, DT, energy=True, n_mode=modes)
    propagator.begin([d.histories for d in members], DT)
    zero = np.zeros((propagator.n_channel, len(members)))
    started_alone(propagator, zero if traction is None else traction, propagator.mass_factor())
    return propagator


def test_every_mode_is_the_direct_march(hht: Any, kind: str, model: Make, begin: Make, tractions: Make) -> None:
    _same_march(hht, kind, model, begin, tractions)


def test_every_scheme_is_marched(scheme: Any, model: Make, begin: Make, tractions: Make) -> None:
    _same_march(scheme, "everything", model, begin, tractions)


def _same_march(scheme: Any, kind: str, model: Make, begin: Make, tractions: Make) -> None:
    """All fields of two members at all instants."""
    members = [model(kind, seed) for seed in range(2)]
    given = tractions(len(members[0].model.channel_area), 2)
    direct, reduced = begin(members, scheme, given[0]), started(members, scheme, ALL, given[0])
    for i in range(len(given)):
        if i:
            for propagator in (direct, reduced):
                alone_of(propagator).predict()
                alone_of(propagator).commit(given[i])
        for j in range(2):
            for read in (full_displacement, full_velocity):
                expected = read(direct, j)
                scale = np.abs(expected).max()
                np.testing.assert_allclose(read(reduced, j), expected, rtol=0, atol=1e-8 * scale)
        for term in TERMS:
            expected = alone_of(direct).totals[term]
            np.testing.assert_allclose(alone_of(reduced).totals[term], expected, rtol=1e-7, atol=1e-7)  # type: ignore[union-attr]


def test_the_admittance_with_every_mode_is_that_of_the_mesh(hht: Any, kind: str, model: Make, begin: Make) -> None:
    m = model(kind)
    direct, reduced = begin([m], hht), started([m], hht, ALL)
    expected = direct.operators.compliance
    np.testing.assert_allclose(reduced.operators.compliance, expected, atol=1e-9 * np.abs(expected).max())


def test_energy_identity_with_few_modes(hht: Any, kind: str, model: Make, tractions: Make, unbalanced: Make) -> None:
    _closes(hht, kind, 5, model, tractions, unbalanced)


def test_energy_identity_of_every_scheme(scheme: Any, model: Make, tractions: Make, unbalanced: Make) -> None:
    _closes(scheme, "everything", 0, model, tractions, unbalanced)


def _closes(scheme: Any, kind: str, modes: int, model: Make, tractions: Make, unbalanced: Make) -> None:
    members = [model(kind, seed) for seed in range(2)]
    given = tractions(len(members[0].model.channel_area), 2)
    assert unbalanced(started(members, scheme, modes, given[0]), given[1:]) <= 1e-10


def test_answers_to_tractions(hht: Any, kind: str, model: Make, answers: Make) -> None:
    answers(started([model(kind)], hht, 5), 1e-10)


@pytest.mark.parametrize("kind", ["free", "everything"])
def test_a_march_taken_up_again_is_the_same_to_the_last_bit(kind: str, hht: Any, model: Make, resumes: Make) -> None:
    m = model(kind)
    resumes(m, lambda: started([m], hht, 5), DT)


def test_static_answers_to_the_loads_of_every_member_are_exact(model: Make) -> None:
    """Without any mode: p - K x is what accelerates the rigid motions, M R R^T p, for the loads of both members."""
    members = [model("held", seed) for seed in range(2)]
    reduced, _ = reduced_members([d.model for d in members], 0)
    mass, _, stiffness = members[0].model.reduced
    expansion = members[0].model.expansion
    for small, driven in zip(reduced, members, strict=True):
        assert small.nodal is not None
        shapes, values = expansion.T @ small.nodal, small.stiffness.diagonal()
        rigid, elastic = shapes[:, values == 0.0], shapes[:, values > 0.0]
        for load in driven.model.loads:
            p = expansion.T @ load.pattern
            x = elastic @ ((elastic.T @ p) / values[values > 0.0])
            rest = p - stiffness @ x - mass @ (rigid @ (rigid.T @ p))
            assert np.linalg.norm(rest) <= 1e-8 * np.linalg.norm(p)
