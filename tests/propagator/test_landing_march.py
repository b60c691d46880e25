"""The march of generalised alpha against a dense one written from its equations, with massless dofs and viscosity."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

from latin_fmu.propagator.base import channel_displacement, full_displacement, full_velocity
from latin_fmu.propagator.direct import CgPropagator
from latin_fmu.time_scheme import GeneralizedAlpha
from latin_fmu.time_scheme.implicit import MasslessContact
from tests.alone import alone_of, started_alone

Make = Callable[..., Any]
Array = np.ndarray
DT, N = 0.11, 24


def layered(driven: Any, changed: Make) -> Any:
    """A model whose nodes on the face z max carry no mass, and whose stiffness damps three of its elements' worth."""
    model = driven.model
    nodal = np.unique(model.trace.tocoo().coords[1] // 3)[:9]
    keep = np.ones(model.n_full // 3)
    keep[nodal] = 0.0
    bare = sp.diags_array(np.repeat(keep, 3))
    viscous = sp.diags_array(np.repeat(0.2 + keep, 3))
    landing = sp.csr_array(0.05 * viscous @ model.stiffness @ viscous)
    damping = landing if model.damping is None else sp.csr_array(model.damping + landing)
    mass = sp.csr_array(bare @ model.mass @ bare)
    mass.eliminate_zeros()
    return changed(driven, {"mass": mass, "damping": damping, "landing": landing})


def dense_march(driven: Any, scheme: Any, given: Array) -> dict[str, Array]:
    """Motion and terms of the energy identity; all matrices dense, tractions (n + 1, n_channel) unweighted."""
    model = driven.model
    p, m, k, c = (x.toarray() for x in (model.expansion, model.mass, model.stiffness, model.damping))
    c_landing, shapes = model.landing.toarray(), model.imposed_pattern
    terms = zip(driven.histories.amplitudes, model.loads, strict=True)
    loads = sum(np.outer(amplitude, term.pattern) for amplitude, term in terms)
    forces = (given * model.channel_area) @ model.trace.toarray()
    (a_m, a_f), be, ga = scheme.old_weights, scheme.beta, scheme.gamma
    v_p = driven.histories.imposed
    a_p = np.zeros_like(v_p)
    a_p[0] = (v_p[1] - v_p[0]) / DT
    for i in range(len(v_p) - 1):
        a_p[i + 1] = ((v_p[i + 1] - v_p[i]) / DT - (1 - ga) * a_p[i]) / ga
    a_p = a_p @ shapes.T
    reduced = p.T @ m @ p
    moves = np.flatnonzero(reduced.diagonal() > 0)
    bare = np.setdiff1d(np.arange(len(reduced)), moves)
    u, v, a = model.displacement.copy(), model.velocity.copy(), a_p[0].copy()
    free = p.T @ (loads[0] + forces[0] - c @ v - k @ u - m @ a_p[0])
    start = np.zeros(len(reduced))
    start[moves] = np.linalg.solve(reduced[np.ix_(moves, moves)], free[moves])
    a += p @ start
    operator = p.T @ ((1 - a_m) * m + (1 - a_f) * (ga * DT * c + be * DT**2 * k)) @ p
    names = ("u", "v", "kinetic", "elastic", "work_of_loads", "interface_work", "damping", "landing", "scheme")
    out: dict[str, list[Any]] = {name: [] for name in names}
    works = dict.fromkeys(names[4:], 0.0)

    def keep() -> None:
        for name, value in (("u", u), ("v", v), ("kinetic", 0.5 * v @ m @ v), ("elastic", 0.5 * u @ k @ u)):
            out[name].append(np.copy(value))
        for name in names[4:]:
            out[name].append(works[name])

    keep()
    for i in range(N):
        f = (1 - a_f) * loads[i + 1] + a_f * loads[i]
        u_free = u + DT * v + DT**2 * ((0.5 - be) * a + be * a_p[i + 1])
        v_free = v + DT * ((1 - ga) * a + ga * a_p[i + 1])
        left = f + forces[i + 1] - k @ ((1 - a_f) * u_free + a_f * u) - c @ ((1 - a_f) * v_free + a_f * v)
        x = np.linalg.solve(operator, p.T @ (left - m @ ((1 - a_m) * a_p[i + 1] + a_m * a)))
        a_new = a_p[i + 1] + p @ x
        u_new, v_new = u_free + be * DT**2 * (p @ x), v_free + ga * DT * (p @ x)
        du, da = u_new - u, a_new - a
        v_w, u_w = (1 - a_f) * v_new + a_f * v, (1 - a_f) * u_new + a_f * u
        a_w, v_mean = (1 - a_m) * a_new + a_m * a, 0.5 * (v + v_new)
        dx = p @ np.linalg.lstsq(p, du, rcond=None)[0] if not shapes.size else du * (p.sum(axis=1) > 0)
        works["interface_work"] += dx @ forces[i + 1]
        works["work_of_loads"] += dx @ f + (du - dx) @ (m @ a_w + c @ v_w + k @ u_w)
        works["landing"] += du @ c_landing @ v_w
        works["damping"] += du @ (c - c_landing) @ v_w
        works["scheme"] += du @ k @ (u_w - 0.5 * (u + u_new)) + DT**2 * (be - ga / 2) * da @ m @ a_w
        works["scheme"] += DT * (1 - a_m - ga) * v_mean @ m @ da
        massless = p[:, bare].sum(axis=1) > 0
        v_new[massless], a_new[massless] = (du / DT)[massless], 0.0
        u, v, a = u_new, v_new, a_new
        keep()
    return {name: np.array(values) for name, values in out.items()}


@pytest.mark.parametrize("rho", [0.5, 0.8, 1.0])
def test_march_and_energies_are_those_of_the_equations(
    rho: float, kind: str, model: Make, begin: Make, tractions: Make, changed: Make
) -> None:
    """Loads, body forces on massless nodes, prescribed motions, damping; unbalanced from the first step on."""
    members = [layered(model(kind, seed), changed) for seed in range(2)]
    scheme = GeneralizedAlpha(rho_inf=rho)
    given = tractions(len(members[0].model.channel_area), 2)
    propagator = begin(members, scheme, given[0])
    expected = [dense_march(d, scheme, given[..., j]) for j, d in enumerate(members)]
    for i in range(N + 1):
        if i:
            alone_of(propagator).predict()
            alone_of(propagator).commit(given[i])
        totals = alone_of(propagator).totals
        for j, dense in enumerate(expected):
            size = np.abs(dense["u"]).max()
            np.testing.assert_allclose(full_displacement(propagator, j).ravel(), dense["u"][i], atol=1e-10 * size)
            size = np.abs(dense["v"]).max()
            np.testing.assert_allclose(full_velocity(propagator, j).ravel(), dense["v"][i], atol=1e-10 * size)
            size = max(np.abs(dense[name]).max() for name in list(dense)[2:])
            for term, name in (("damping_dissipation", "damping"), ("landing_dissipation", "landing")):
                assert totals[term][j] == pytest.approx(dense[name][i], abs=1e-10 * size), term
            for term in ("kinetic", "elastic", "work_of_loads", "interface_work"):
                assert totals[term][j] == pytest.approx(dense[term][i], abs=1e-10 * size), term
            assert totals["scheme_dissipation"][j] == pytest.approx(dense["scheme"][i], abs=1e-10 * size)
    for dense in expected:
        stored = dense["kinetic"] + dense["elastic"]
        rest = stored - stored[0] + dense["damping"] + dense["landing"] + dense["scheme"]
        rest -= dense["work_of_loads"] + dense["interface_work"]
        assert np.abs(rest).max() <= 1e-11 * max(np.abs(dense[name]).max() for name in list(dense)[2:])


@pytest.mark.parametrize("scheme", [GeneralizedAlpha(), MasslessContact()], ids=lambda s: s.name)
def test_balance_closes_where_massless_nodes_are_not_in_balance_at_the_start(
    scheme: Any, kind: str, model: Make, begin: Make, tractions: Make, changed: Make, unbalanced: Make
) -> None:
    member = layered(model(kind), changed)
    given = tractions(len(member.model.channel_area), 1)
    assert unbalanced(begin([member], scheme, given[0]), given[1:]) < 1e-11


def test_conjugate_gradients_march_alike(model: Make, begin: Make, tractions: Make, changed: Make) -> None:
    member = layered(model("everything"), changed)
    given = tractions(len(member.model.channel_area), 1)
    direct = begin([member], GeneralizedAlpha(), given[0])
    other = CgPropagator([member.model], GeneralizedAlpha(), DT, energy=True)
    other.begin([member.histories], DT)
    started_alone(other, given[0], other.mass_factor())
    for traction in given[1:]:
        for propagator in (direct, other):
            alone_of(propagator).predict()
            alone_of(propagator).commit(traction)
    np.testing.assert_allclose(other.state.u, direct.state.u, atol=1e-7 * np.abs(direct.state.u).max())


def test_response_is_what_the_tractions_cause(
    model: Make, begin: Make, tractions: Make, changed: Make, kind: str
) -> None:
    """W = (u_new - u_old)/dt = w_free + D F, with the dashpots k in place."""
    member = layered(model(kind), changed)
    given = tractions(len(member.model.channel_area), 1)
    propagator = begin([member], GeneralizedAlpha(), given[0])
    propagator.bind(np.random.default_rng(1).uniform(0.5, 2.0, propagator.n_channel))
    for q in given[1:5]:
        before = channel_displacement(propagator)
        alone_of(propagator).predict()
        w = alone_of(propagator).respond(q)
        alone_of(propagator).commit(q - propagator.k * w)
        np.testing.assert_allclose((channel_displacement(propagator) - before) / DT, w, atol=1e-10)
