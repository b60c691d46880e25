"""The direct propagator against a dense march of the same equations, and the rules of its protocol."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from latin_fmu.kernels.energy_parts import TERMS
from latin_fmu.propagator.base import channel_displacement, channel_velocity, full_displacement, full_velocity
from tests.alone import alone_of

from .conftest import DT

Array = np.ndarray
Make = Callable[..., Any]


def close(actual: Array, expected: Array, tolerance: float = 1e-10) -> None:
    np.testing.assert_allclose(actual, expected, rtol=0, atol=tolerance * np.abs(expected).max())


def test_march_under_given_tractions(
    scheme: Any, kind: str, model: Make, reference: Make, begin: Make, advance: Make, tractions: Make
) -> None:
    """Loads, initial motion, holds, ties, damping, prescribed motion and tractions: all fields at all instants."""
    m = model(kind)
    given = tractions(len(m.model.channel_area))
    expected = reference(m, scheme, given[..., 0], np.zeros(len(m.model.channel_area)))
    actual = advance(begin([m], scheme, given[0]), given)
    for name in "uva":
        close(getattr(actual, name), getattr(expected, name))


def test_respond_is_a_march_with_dashpots(
    scheme: Any, kind: str, model: Make, reference: Make, begin: Make, tractions: Make
) -> None:
    """W = W_0 + Y q equals the velocities of a march with k in its matrix, loaded by q; commit(q - k W) agrees."""
    m = model(kind)
    n = len(m.model.channel_area)
    k = np.random.default_rng(3).uniform(0.0, 4.0, n)
    k[::5] = 0.0
    q = tractions(n)
    q[0] = (k * (m.model.trace @ m.model.velocity))[:, None]  # tractions of the start are zero: q_0 = k W_0
    expected = reference(m, scheme, q[..., 0], k)
    propagator = begin([m], scheme)
    propagator.bind(k)
    for i in range(1, len(q)):
        alone_of(propagator).predict()
        w = alone_of(propagator).respond(q[i])
        close(w[:, 0], m.model.trace @ expected.v[i], 1e-9)
        alone_of(propagator).commit(q[i] - propagator.k * w)
        close(channel_velocity(propagator), w)
    close(full_displacement(propagator, 0).ravel(), expected.u[-1])


def response(propagator: Any) -> Array:
    """Y for the k of the last ``bind``, velocities per traction, (n_channel, n_channel)."""
    return propagator.condensed * propagator.operators.area


def test_channels_read_the_motion(hht: Any, model: Make, begin: Make, advance: Make, tractions: Make) -> None:
    m = model("everything")
    given = tractions(len(m.model.channel_area))
    propagator = begin([m], hht)
    motion = advance(propagator, given)
    close(channel_displacement(propagator)[:, 0], m.model.trace @ motion.u[-1])
    close(channel_velocity(propagator)[:, 0], m.model.trace @ motion.v[-1])
    ops, forcing = propagator.operators, propagator.forcing
    imposed = propagator.members[0].trace @ forcing.imposed_a(propagator.instant) if forcing.moves else None
    close((ops.trace @ propagator.state.a[ops.dofs] + imposed)[:, 0], m.model.trace @ motion.a[-1])


@pytest.mark.parametrize("count", [1, 2, 3, 9])
def test_members_respond_each_for_itself(hht: Any, model: Make, begin: Make, tractions: Make, count: int) -> None:
    """W = W_0 + Y (q - k W_0) of every member, one after the other and eight at a time; as it would alone."""
    members = [model("held", seed) for seed in range(count)]
    together = begin(members, hht)
    n = together.n_channel
    k = np.random.default_rng(5).uniform(0.0, 2.0, n)
    together.bind(k)
    q = tractions(n, count)[4]
    w_0 = alone_of(together).predict()
    actual = alone_of(together).respond(q)
    close(actual, w_0 + response(together) @ (q - k[:, None] * w_0), 1e-13)
    for j, member in enumerate(members):
        alone = begin([member], hht)
        alone.bind(k)
        close(alone_of(alone).predict(), w_0[:, j : j + 1], 1e-12)
        close(alone_of(alone).respond(q[:, j : j + 1]), actual[:, j : j + 1], 1e-12)


def test_causality(
    kind: str, hht: Any, model: Make, begin: Make, advance: Make, tractions: Make, changed: Make
) -> None:
    """What is changed after instant 10 changes nothing up to it, bit for bit."""
    m = model(kind)
    given = tractions(len(m.model.channel_area))
    later = given.copy()
    later[11:] += 1.0
    after = np.arange(len(given)) > 10
    drive = m.histories
    other = {
        "amplitudes": [np.where(after, 3.0, x) for x in drive.amplitudes[:2]] + drive.amplitudes[2:],
        "imposed": np.where(after[:, None], 1.0, drive.imposed),
    }
    first = advance(begin([m], hht, given[0]), given)
    second = advance(begin([changed(m, histories=other)], hht, given[0]), later)
    for name in "uva":
        np.testing.assert_array_equal(getattr(first, name)[:11], getattr(second, name)[:11])
    assert np.abs(first.a[11] - second.a[11]).max() > 0.1


def test_superposition(
    kind: str, hht: Any, model: Make, begin: Make, advance: Make, tractions: Make, changed: Make
) -> None:
    """Linear in loads, initial motion, prescribed motion and tractions together."""
    a, b = model(kind, 0), model(kind, 1)
    n = len(a.model.channel_area)
    given = tractions(n), tractions(n, seed=60)
    x, y = a.model, b.model
    both = changed(
        a,
        {
            "loads": x.loads + y.loads,
            "displacement": 2 * x.displacement - 3 * y.displacement,
            "velocity": 2 * x.velocity - 3 * y.velocity,
        },
        {
            "amplitudes": [2 * h for h in a.histories.amplitudes] + [-3 * h for h in b.histories.amplitudes],
            "imposed": 2 * a.histories.imposed - 3 * b.histories.imposed,
        },
    )
    actual = advance(begin([both], hht, 2 * given[0][0] - 3 * given[1][0]), 2 * given[0] - 3 * given[1])
    parts = [advance(begin([m], hht, g[0]), g) for m, g in zip((a, b), given, strict=True)]
    for name in "uva":
        close(getattr(actual, name), 2 * getattr(parts[0], name) - 3 * getattr(parts[1], name))


def test_a_march_taken_up_again_is_the_same_to_the_last_bit(
    kind: str, scheme: Any, model: Make, begin: Make, resumes: Make
) -> None:
    m = model(kind)
    resumes(m, lambda: begin([m], scheme), DT)


def test_predict_and_trials_leave_the_state_alone(hht: Any, model: Make, begin: Make, tractions: Make) -> None:
    m = model("everything")
    given = tractions(len(m.model.channel_area))
    propagator = begin([m], hht)
    before = {name: getattr(propagator.state, name).copy() for name in ("u", "v", "a", "residual")}
    first = alone_of(propagator).predict().copy()
    alone_of(propagator).respond(given[3])
    np.testing.assert_array_equal(alone_of(propagator).predict(), first)
    for name, value in before.items():
        np.testing.assert_array_equal(getattr(propagator.state, name), value)
    assert propagator.instant == 0


def test_members_march_as_if_alone(
    kind: str, hht: Any, model: Make, begin: Make, advance: Make, tractions: Make
) -> None:
    """Identical substructures with their own loads, initial and prescribed motions share one factor."""
    members = [model(kind, seed) for seed in range(3)]
    n = len(members[0].model.channel_area)
    given = tractions(n, 3)
    together = begin(members, hht, given[0])
    advance(together, given)
    for j, m in enumerate(members):
        alone = begin([m], hht, given[0, :, j : j + 1])
        advance(alone, given[..., j : j + 1])
        close(full_displacement(together, j), full_displacement(alone, 0), 1e-12)
        close(full_velocity(together, j), full_velocity(alone, 0), 1e-12)
        close(together.state.residual[:, j : j + 1], alone.state.residual, 1e-11)
        for term in TERMS:
            assert alone_of(together).totals[term][j] == pytest.approx(
                alone_of(alone).totals[term][0], rel=1e-9, abs=1e-12
            )


def test_admittance_is_symmetric_and_positive(scheme: Any, kind: str, model: Make, begin: Make) -> None:
    operators = begin([model(kind)], scheme).operators
    compliance = operators.compliance
    np.testing.assert_array_equal(compliance, compliance.T)
    values = np.linalg.eigvalsh(compliance)
    assert values[0] > -1e-14 * values[-1]
    close(operators.admittance, compliance * operators.area, 1e-15)


def test_answers_to_tractions(scheme: Any, kind: str, model: Make, begin: Make, answers: Make) -> None:
    answers(begin([model(kind)], scheme), 1e-11)


def test_energy_identity_of_every_member(
    scheme: Any, kind: str, model: Make, begin: Make, tractions: Make, unbalanced: Make
) -> None:
    """T + V + damping + scheme = work of loads (reactions included) + work of interfaces, at every instant."""
    members = [model(kind, seed) for seed in range(2)]
    given = tractions(len(members[0].model.channel_area), 2)
    assert unbalanced(begin(members, scheme, given[0]), given[1:]) <= 1e-10


def test_energies_are_those_of_the_motion(hht: Any, model: Make, begin: Make, advance: Make, tractions: Make) -> None:
    m = model("everything")
    given = tractions(len(m.model.channel_area))
    propagator = begin([m], hht, given[0])
    motion = advance(propagator, given)
    totals = alone_of(propagator).totals
    assert totals["kinetic"][0] == pytest.approx(0.5 * motion.v[-1] @ (m.model.mass @ motion.v[-1]), rel=1e-12)
    assert totals["elastic"][0] == pytest.approx(0.5 * motion.u[-1] @ (m.model.stiffness @ motion.u[-1]), rel=1e-12)
    assert totals["damping_dissipation"][0] > 0


def part(driven: Any, changed: Make, start: int, stop: int) -> Any:
    """The histories from instant ``start`` to ``stop``."""
    h = driven.histories
    cut = slice(start, stop + 1)
    return changed(
        driven, histories={"time": h.time[cut], "amplitudes": [x[cut] for x in h.amplitudes], "imposed": h.imposed[cut]}
    ).histories


def test_segments_are_one_run(
    kind: str, scheme: Any, model: Make, begin: Make, advance: Make, tractions: Make, changed: Make
) -> None:
    """Histories given piece by piece: same motion, same energies, prescribed motions go on."""
    m = model(kind)
    given = tractions(len(m.model.channel_area))
    whole = begin([m], scheme, given[0])
    expected = advance(whole, given)
    pieces = begin([m], scheme, given[0])
    for start, stop in ((0, 7), (7, 8), (8, 24)):
        if start:
            pieces.begin([part(m, changed, start, stop)], pieces.dt)
        advance(pieces, given[start : stop + 1])
    close(full_displacement(pieces, 0).ravel(), expected.u[-1], 1e-12)
    close(full_velocity(pieces, 0).ravel(), expected.v[-1], 1e-12)
    close(pieces.state.residual, whole.state.residual, 1e-11)
    for term in TERMS:
        assert alone_of(pieces).totals[term][0] == pytest.approx(alone_of(whole).totals[term][0], rel=1e-10, abs=1e-12)


def test_another_step_in_between(hht: Any, model: Make, begin: Make, advance: Make, changed: Make) -> None:
    """A longer step takes operators of its own and comes back to the first ones; free flight stays exact."""
    m = model("free")
    flight = np.tile([0.3, -0.1, 0.2], m.model.n_full // 3)
    still = {"amplitudes": [0.0 * x for x in m.histories.amplitudes]}
    flying = changed(m, {"displacement": 0.0 * flight, "velocity": flight}, still)
    propagator = begin([flying], hht)
    first = propagator.operators
    for dt in (0.11, 0.5, 0.11):
        propagator.begin([flying.histories], dt)
        advance(propagator, np.zeros((6, len(m.model.channel_area), 1)))
    assert propagator.operators is first
    np.testing.assert_allclose(full_displacement(propagator, 0).ravel(), 5 * (0.11 + 0.5 + 0.11) * flight, atol=1e-12)
