"""The direct propagator against a dense march of the same equations, and the rules of its protocol."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from latin_fmu.propagator import LoadTerm
from latin_fmu.propagator.energy import TERMS

Array = np.ndarray
Make = Callable[..., Any]


def close(found: Array, expected: Array, tolerance: float = 1e-10) -> None:
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * np.abs(expected).max())


def test_march_under_given_tractions(
    scheme: Any, kind: str, model: Make, reference: Make, begin: Make, advance: Make, tractions: Make
) -> None:
    """Loads, initial motion, holds, ties, damping, prescribed motion and tractions: all fields at all instants."""
    m = model(kind)
    given = tractions(len(m.channel_area))
    expected = reference(m, scheme, given[..., 0], np.zeros(len(m.channel_area)))
    found = advance(begin([m], scheme, given[0]), given)
    for name in "uva":
        close(getattr(found, name), getattr(expected, name))


def test_respond_is_a_march_with_dashpots(
    scheme: Any, kind: str, model: Make, reference: Make, begin: Make, tractions: Make
) -> None:
    """W = W_0 + Y q equals the velocities of a march with k in its matrix, loaded by q; commit(q - k W) agrees."""
    m = model(kind)
    n = len(m.channel_area)
    k = np.random.default_rng(3).uniform(0.0, 4.0, n)
    k[::5] = 0.0
    q = tractions(n)
    q[0] = (k * (m.trace @ m.velocity))[:, None]  # tractions of the start are zero: q_0 = k W_0
    expected = reference(m, scheme, q[..., 0], k)
    propagator = begin([m], scheme)
    propagator.bind(k)
    for i in range(1, len(q)):
        w = propagator.respond(propagator.predict(), q[i])
        close(w[:, 0], m.trace @ expected.v[i], 1e-9)
        propagator.commit(q[i] - propagator.k * w)
        close(propagator.channel_velocity(), w)
    close(propagator.full_displacement(0).ravel(), expected.u[-1])


def test_channels_read_the_motion(hht: Any, model: Make, begin: Make, advance: Make, tractions: Make) -> None:
    m = model("everything")
    given = tractions(len(m.channel_area))
    propagator = begin([m], hht)
    motion = advance(propagator, given)
    close(propagator.channel_displacement()[:, 0], m.trace @ motion.u[-1])
    close(propagator.channel_velocity()[:, 0], m.trace @ motion.v[-1])
    close(propagator.channel_acceleration()[:, 0], m.trace @ motion.a[-1])


def test_the_response_without_search_direction_is_the_admittance(hht: Any, model: Make, begin: Make) -> None:
    propagator = begin([model("held")], hht)
    before = propagator.response.copy()
    propagator.bind(np.zeros(propagator.n_channel))
    close(propagator.response, before, 1e-13)
    close(propagator.response, propagator.operators.admittance, 1e-13)


def test_respond_takes_one_or_many_columns(hht: Any, model: Make, begin: Make, tractions: Make) -> None:
    members = [model("held", seed) for seed in range(3)]
    propagator = begin(members, hht)
    propagator.bind(np.full(propagator.n_channel, 0.7))
    q = tractions(propagator.n_channel, 3)[4]
    w_0 = propagator.predict()
    together = propagator.respond(w_0, q)
    for j in range(3):
        close(propagator.respond(w_0[:, j : j + 1], q[:, j : j + 1]), together[:, j : j + 1], 1e-13)


def test_causality(
    kind: str, hht: Any, model: Make, begin: Make, advance: Make, tractions: Make, changed: Make
) -> None:
    """What is changed after instant 10 changes nothing up to it, bit for bit."""
    m = model(kind)
    given = tractions(len(m.channel_area))
    later = given.copy()
    later[11:] += 1.0
    after = np.arange(len(given)) > 10
    loads = [LoadTerm(t.name, t.pattern, np.where(after, 3.0, t.history)) for t in m.loads[:2]] + m.loads[2:]
    velocity = np.where(after[:, None], 1.0, m.imposed_velocity)
    first = advance(begin([m], hht, given[0]), given)
    second = advance(begin([changed(m, loads=loads, imposed_velocity=velocity)], hht, given[0]), later)
    for name in "uva":
        np.testing.assert_array_equal(getattr(first, name)[:11], getattr(second, name)[:11])
    assert np.abs(first.a[11] - second.a[11]).max() > 0.1


def test_superposition(
    kind: str, hht: Any, model: Make, begin: Make, advance: Make, tractions: Make, changed: Make
) -> None:
    """Linear in loads, initial motion, prescribed motion and tractions together."""
    a, b = model(kind, 0), model(kind, 1)
    n = len(a.channel_area)
    given = tractions(n), tractions(n, seed=60)
    loads = [LoadTerm("", t.pattern, 2 * t.history) for t in a.loads]
    loads += [LoadTerm("", t.pattern, -3 * t.history) for t in b.loads]
    both = changed(
        a, loads=loads, displacement=2 * a.displacement - 3 * b.displacement,
        velocity=2 * a.velocity - 3 * b.velocity, imposed_velocity=2 * a.imposed_velocity - 3 * b.imposed_velocity,
    )  # fmt: skip
    found = advance(begin([both], hht, 2 * given[0][0] - 3 * given[1][0]), 2 * given[0] - 3 * given[1])
    parts = [advance(begin([m], hht, g[0]), g) for m, g in zip((a, b), given, strict=True)]
    for name in "uva":
        close(getattr(found, name), 2 * getattr(parts[0], name) - 3 * getattr(parts[1], name))


def test_restore_repeats_bit_by_bit(
    kind: str, scheme: Any, model: Make, begin: Make, advance: Make, tractions: Make
) -> None:
    m = model(kind)
    given = tractions(len(m.channel_area))
    propagator = begin([m], scheme, given[0])
    advance(propagator, given[:9])
    snapshot = propagator.snapshot()
    first = advance(propagator, given)
    energies = {t: propagator.meter.totals[t].copy() for t in TERMS}
    propagator.restore(snapshot)
    assert propagator.state.instant == 8
    second = advance(propagator, given)
    for name in "uva":
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    for term in TERMS:
        np.testing.assert_array_equal(propagator.meter.totals[term], energies[term])


def test_predict_and_trials_leave_the_state_alone(
    hht: Any, model: Make, begin: Make, tractions: Make
) -> None:
    m = model("everything")
    given = tractions(len(m.channel_area))
    propagator = begin([m], hht)
    before = propagator.state.copy()
    first = propagator.predict().copy()
    propagator.respond(first, given[3])
    np.testing.assert_array_equal(propagator.predict(), first)
    for name in ("u", "v", "a", "residual"):
        np.testing.assert_array_equal(getattr(propagator.state, name), getattr(before, name))
    assert propagator.state.instant == 0


def test_members_march_as_if_alone(
    kind: str, hht: Any, model: Make, begin: Make, advance: Make, tractions: Make
) -> None:
    """Identical substructures with their own loads, initial and prescribed motions share one factor."""
    members = [model(kind, seed) for seed in range(3)]
    n = len(members[0].channel_area)
    given = tractions(n, 3)
    together = begin(members, hht, given[0])
    advance(together, given)
    for j, m in enumerate(members):
        alone = begin([m], hht, given[0, :, j : j + 1])
        advance(alone, given[..., j : j + 1])
        close(together.full_displacement(j), alone.full_displacement(0), 1e-12)
        close(together.full_velocity(j), alone.full_velocity(0), 1e-12)
        close(together.state.residual[:, j : j + 1], alone.state.residual, 1e-11)
        for term in TERMS:
            assert together.meter.totals[term][j] == pytest.approx(
                alone.meter.totals[term][0], rel=1e-9, abs=1e-12
            )


def test_admittance_is_symmetric_and_positive(scheme: Any, kind: str, model: Make, begin: Make) -> None:
    operators = begin([model(kind)], scheme).operators
    compliance = operators.compliance
    np.testing.assert_array_equal(compliance, compliance.T)
    values = np.linalg.eigvalsh(compliance)
    assert values[0] > -1e-14 * values[-1]
    close(operators.admittance, compliance * operators.area, 1e-15)


def test_admittance_is_the_velocity_of_one_instant(scheme: Any, kind: str, model: Make, begin: Make) -> None:
    """Column j: change of the channel velocities for a traction 1 on channel j."""
    m = model(kind)
    propagator = begin([m], scheme)
    n = propagator.n_channel
    columns = []
    for j in (None, 0, 4, n - 1):
        traction = np.zeros((n, 1))
        if j is not None:
            traction[j] = 1.0
        snapshot = propagator.snapshot()
        propagator.predict()
        propagator.commit(traction)
        columns.append(propagator.channel_velocity()[:, 0])
        propagator.restore(snapshot)
    for column, j in zip(columns[1:], (0, 4, n - 1), strict=True):
        close(column - columns[0], propagator.operators.admittance[:, j], 1e-11)


def test_condensed_response(kind: str, hht: Any, model: Make, begin: Make) -> None:
    """Y = (1 + D k)^-1 D, symmetric after division by the areas; k may be 0 somewhere."""
    propagator = begin([model(kind)], hht)
    k = np.random.default_rng(3).uniform(0.0, 4.0, propagator.n_channel)
    k[1] = 0.0
    propagator.bind(k)
    d = propagator.operators.admittance
    close(propagator.response, np.linalg.solve(np.eye(len(k)) + d * k, d), 1e-12)
    force = propagator.response / propagator.operators.area
    close(force, force.T, 1e-13)


def test_energy_identity_of_every_member(
    scheme: Any, kind: str, model: Make, begin: Make, tractions: Make
) -> None:
    """T + V + damping + scheme = work of loads (reactions included) + work of interfaces, at every instant."""
    members = [model(kind, seed) for seed in range(2)]
    given = tractions(len(members[0].channel_area), 2)
    propagator = begin(members, scheme, given[0])
    start = dict(propagator.meter.totals)
    for traction in given[1:]:
        propagator.predict()
        propagator.commit(traction)
        now = propagator.meter.totals
        change = {t: now[t] - start[t] for t in TERMS}
        balance = (
            change["kinetic"] + change["elastic"] + change["damping_dissipation"] + change["scheme_dissipation"]
            - change["work_of_loads"] - change["interface_work"]
        )  # fmt: skip
        size = np.max([np.abs(now[t]) for t in TERMS], axis=0)
        assert (np.abs(balance) <= 1e-10 * size).all(), f"{balance / size}"


def test_energies_are_those_of_the_motion(
    hht: Any, model: Make, begin: Make, advance: Make, tractions: Make
) -> None:
    m = model("everything")
    given = tractions(len(m.channel_area))
    propagator = begin([m], hht, given[0])
    motion = advance(propagator, given)
    totals = propagator.meter.totals
    assert totals["kinetic"][0] == pytest.approx(0.5 * motion.v[-1] @ (m.mass @ motion.v[-1]), rel=1e-12)
    assert totals["elastic"][0] == pytest.approx(0.5 * motion.u[-1] @ (m.stiffness @ motion.u[-1]), rel=1e-12)
    assert totals["damping_dissipation"][0] > 0


def test_trial_commits_are_not_accounted(hht: Any, model: Make, begin: Make) -> None:
    m = model("held")
    propagator = begin([m], hht)
    before = dict(propagator.meter.totals)
    propagator.predict()
    propagator.commit(np.ones((propagator.n_channel, 1)), account=False)
    for term in TERMS:
        np.testing.assert_array_equal(propagator.meter.totals[term], before[term])
