"""Each term of the account of energies against its definition, dense, from the fields of the march alone.

With D the change over the step n, n + 1, Newmark's relations give

    D T = Du . M a_g - (beta - gamma/2) dt^2 a_g . M Da,   a_g = (1 - gamma) a_n + gamma a_{n+1},

and the equation of motion M a_{n+1} = (1 + alpha) R_{n+1} - alpha R_n makes M a_g a weighted mean of the forces
R = f + lambda - C v - K u of the instants n - 1, n, n + 1 (R_{-1} = R_0 at the start).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import scipy.linalg as la

from latin_fmu.kernels.energy_parts import TERMS
from latin_fmu.propagator.explicit import ExplicitPropagator
from latin_fmu.propagator.reduced import ReducedPropagator
from latin_fmu.propagator.static import StaticPropagator
from latin_fmu.time_scheme import CentralDifference
from tests.alone import alone_of, started_alone

from .conftest import DT

Array = np.ndarray
Make = Callable[..., Any]
STEP = 0.05  # of the explicit march


@dataclass
class Fields:
    """Motion of a member at all instants: full u, v, a (n, n_full), its own unknowns x, prescribed motions g."""

    u: Array
    v: Array
    a: Array
    x: Array
    g: Array
    totals: dict[str, Array]  # (n,) each


def dense(matrix: Any) -> Array:
    """A matrix as an array."""
    return np.asarray(matrix.toarray() if hasattr(matrix, "toarray") else matrix, dtype=float)


def marched(propagator: Any, tractions: Array, incoming: bool = False) -> tuple[list[Fields], Array]:
    """Fields of every member under tractions (n, n_channel, n_member), and the tractions that acted; ``incoming``: what
    is given are incoming quantities q."""
    m, acted = len(propagator.members), [tractions[0]]
    rows: list[list[Any]] = [[] for _ in range(m)]

    def look() -> None:
        totals, now = alone_of(propagator).totals, propagator.state
        for j, member in enumerate(propagator.members):
            full = [
                member.expansion @ field[:, j] + imposed(propagator.instant)[:, j]
                for field, imposed in (
                    (now.u, propagator.forcing.imposed_u),
                    (now.v, propagator.forcing.imposed_v),
                    (now.a, propagator.forcing.imposed_a),
                )
            ]
            rows[j].append((*full, now.u[:, j].copy(), {t: totals[t][j] for t in TERMS}))

    look()
    for given in tractions[1:]:
        alone_of(propagator).predict()
        if incoming:
            acted.append(given - propagator.k * alone_of(propagator).respond(given))
        else:
            acted.append(given)
        alone_of(propagator).commit(given)
        look()
    fields = []
    for j in range(m):
        u, v, a, x = (np.array([row[i] for row in rows[j]]) for i in range(4))
        motion = propagator.forcing.motion_table()[0, ..., j] if propagator.forcing.moves else np.zeros((len(u), 0))
        totals = {t: np.array([row[4][t] for row in rows[j]]) for t in TERMS}
        fields.append(Fields(u, v, a, x, motion[: len(u)], totals))
    return fields, np.array(acted)


def loads_of(model: Any, history: Any) -> Array:
    """Loads (n, n_full) of a member."""
    terms = zip(history.amplitudes, model.loads, strict=True)
    return sum(
        (np.outer(amplitude, term.pattern) for amplitude, term in terms), np.zeros((len(history.time), model.n_full))
    )


def summed(steps: Array) -> Array:
    """Running sum from 0."""
    return np.concatenate([[0.0], np.cumsum(steps)])


def dot(a: Array, b: Array) -> Array:
    """Scalar products of rows."""
    return np.einsum("ni,ni->n", a, b)


def check(fields: Fields, expected: dict[str, Array]) -> None:
    """Every term, and what is left of the balance."""
    size = max(np.abs(values).max() for values in expected.values())
    for term in TERMS:
        there = expected.get(term, np.zeros(len(fields.u)))  # the viscosity of a contact layer: where there is one
        np.testing.assert_allclose(fields.totals[term], there, rtol=0, atol=1e-10 * size, err_msg=term)
    stored = fields.totals["kinetic"] + fields.totals["elastic"]
    rest = (
        stored
        - stored[0]
        + fields.totals["damping_dissipation"]
        + fields.totals["scheme_dissipation"]
        + fields.totals["landing_dissipation"]
        - fields.totals["work_of_loads"]
        - fields.totals["interface_work"]
    )
    assert np.abs(rest).max() <= 1e-10 * size


def weighted_account(model: Any, fields: Fields, loads: Array, forces: Array, scheme: Any) -> dict[str, Array]:
    """Terms of a Newmark or HHT march; loads, forces of interfaces (n, n_full)."""
    al, be, ga = scheme.alpha, scheme.beta, scheme.gamma
    m, k, p = dense(model.mass), dense(model.stiffness), dense(model.expansion)
    c = np.zeros_like(m) if model.damping is None else dense(model.damping)
    shapes = model.imposed_pattern
    before, old, new = -(1 - ga) * al, (1 - ga) * (1 + al) - ga * al, ga * (1 + al)

    def weighted(x: Array) -> Array:
        earlier = np.concatenate([x[:1], x[:-2]])
        return before * earlier + old * x[:-1] + new * x[1:]

    du, da, dx, dg = (np.diff(field, axis=0) for field in (fields.u, fields.a, fields.x, fields.g))
    a_g = (1 - ga) * fields.a[:-1] + ga * fields.a[1:]
    elastic, damping = fields.u @ k, fields.v @ c
    reactions = (a_g @ m + weighted(elastic) + weighted(damping)) @ shapes
    scheme_work = dot(du, weighted(elastic) - 0.5 * (elastic[1:] + elastic[:-1]))
    return {
        "kinetic": 0.5 * dot(fields.v, fields.v @ m),
        "elastic": 0.5 * dot(fields.u, elastic),
        "work_of_loads": summed(dot(dx, weighted(loads) @ p) + dot(dg, reactions)),
        "interface_work": summed(dot(dx, weighted(forces) @ p)),
        "damping_dissipation": summed(dot(du, weighted(damping))),
        "scheme_dissipation": summed(scheme_work + DT**2 * (be - ga / 2) * dot(a_g, da @ m)),
    }


@pytest.mark.parametrize("count", [1, 3])
def test_terms_of_the_direct_march(
    scheme: Any, kind: str, count: int, model: Make, begin: Make, tractions: Make
) -> None:
    members = [model(kind, seed) for seed in range(count)]
    given = tractions(len(members[0].model.channel_area), count)
    fields, _ = marched(begin(members, scheme, given[0]), given)
    for j, member in enumerate(members):
        own = member.model
        forces = (given[..., j] * own.channel_area) @ own.trace.toarray()
        check(fields[j], weighted_account(own, fields[j], loads_of(own, member.histories), forces, scheme))


@pytest.mark.parametrize("modes", [0, 5])
def test_terms_of_the_reduced_march(scheme: Any, kind: str, modes: int, model: Make, tractions: Make) -> None:
    """In the unknowns of the reduced body."""
    members = [model(kind, seed) for seed in range(2)]
    propagator = ReducedPropagator([d.model for d in members], scheme, DT, energy=True, n_mode=modes)
    propagator.begin([d.histories for d in members], DT)
    given = tractions(propagator.n_channel, 2)
    started_alone(propagator, given[0], propagator.mass_factor())
    fields, _ = marched(propagator, given)
    for j, (own, member) in enumerate(zip(propagator.members, members, strict=True)):
        forces = (given[..., j] * own.channel_area) @ dense(own.trace)
        check(fields[j], weighted_account(own, fields[j], loads_of(own, member.histories), forces, scheme))


def test_terms_of_the_explicit_march(kind: str, model: Make, tractions: Make) -> None:
    """D T + D V - dt^2/8 D[v.K v] + Du.(C v_n + C_d Dv / 2) = Du.mean f + Du.lambda_{n+1} + reactions."""
    members = [model(kind, seed) for seed in range(2)]
    propagator = ExplicitPropagator([d.model for d in members], CentralDifference(), STEP, energy=True)
    propagator.begin([d.histories for d in members], STEP)
    given = tractions(propagator.n_channel, 2)
    started_alone(propagator, given[0], propagator.mass_factor())
    fields, _ = marched(propagator, given)
    for j, member in enumerate(members):
        own, f = member.model, fields[j]
        m, k, p = np.diag(dense(own.mass).sum(axis=1)), dense(own.stiffness), dense(own.expansion)
        c = np.zeros_like(m) if own.damping is None else dense(own.damping)
        c_d = la.block_diag(*c.reshape(len(c) // 3, 3, -1, 3).sum(axis=2))
        forces = (given[..., j] * own.channel_area) @ own.trace.toarray()
        loads = loads_of(own, member.histories)
        du, dv, dx, dg = (np.diff(field, axis=0) for field in (f.u, f.v, f.x, f.g))
        damping = f.v[:-1] @ c + 0.5 * dv @ c_d
        middle = f.u[:-1] + 0.5 * STEP * f.v[:-1]
        reactions = (dv @ m / STEP + middle @ k + damping) @ own.imposed_pattern
        squared = dot(f.v, f.v @ k)
        check(
            f,
            {
                "kinetic": 0.5 * dot(f.v, f.v @ m),
                "elastic": 0.5 * dot(f.u, f.u @ k),
                "work_of_loads": summed(dot(dx, 0.5 * (loads[1:] + loads[:-1]) @ p) + dot(dg, reactions)),
                "interface_work": summed(dot(dx, forces[1:] @ p)),
                "damping_dissipation": summed(dot(du, damping)),
                "scheme_dissipation": -(STEP**2) / 8 * (squared - squared[0]),
            },
        )


@pytest.mark.parametrize("kind", ["free", "held", "driven", "everything"])
def test_terms_of_the_static_march(kind: str, model: Make, tractions: Make, changed: Make) -> None:
    """D V = Du.(mean f + mean lambda) + reactions; loads there from the start are counted as growing over the first
    increment."""
    members = [model(kind, seed) for seed in range(2)]
    members = [
        changed(
            d,
            {
                "displacement": np.zeros(d.model.n_full),
                "velocity": np.zeros(d.model.n_full),
                "mass": None,
                "damping": None,
            },
        )
        for d in members
    ]
    n = len(members[0].model.channel_area)
    k = np.random.default_rng(3).uniform(1.0, 4.0, n)
    propagator = StaticPropagator([d.model for d in members], DT, True, np.ones(n))
    propagator.begin([d.histories for d in members], DT)
    given = tractions(n, 2)
    given[0] = 0.0
    started_alone(propagator, given[0], None)
    propagator.bind(k)
    fields, acted = marched(propagator, given, incoming=True)
    for j, member in enumerate(members):
        own, f = member.model, fields[j]
        stiff, p = dense(own.stiffness), dense(own.expansion)
        forces = (acted[..., j] * own.channel_area) @ own.trace.toarray() @ p
        loads, elastic = loads_of(own, member.histories) @ p, f.u @ stiff
        loads[0] = elastic[0] @ p - forces[0]
        dx, dg = np.diff(f.x, axis=0), np.diff(f.g, axis=0)
        # the whole load is balanced at every increment
        np.testing.assert_allclose((elastic[1:] @ p), loads[1:] + forces[1:], rtol=0, atol=1e-9 * np.abs(forces).max())
        zero = np.zeros(len(f.u))
        mean_reaction = 0.5 * (elastic[1:] + elastic[:-1]) @ own.imposed_pattern
        check(
            f,
            {
                "kinetic": zero,
                "elastic": 0.5 * dot(f.u, elastic),
                "work_of_loads": summed(dot(dx, 0.5 * (loads[1:] + loads[:-1])) + dot(dg, mean_reaction)),
                "interface_work": summed(dot(dx, 0.5 * (forces[1:] + forces[:-1]))),
                "damping_dissipation": zero,
                "scheme_dissipation": zero,
            },
        )
