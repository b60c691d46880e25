"""The contract of an interface behaviour, for every entry of the registry."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from latin_fmu.interface import BEHAVIOURS, Behaviour
from latin_fmu.interface.laws import SEPARATION, SLIP, STICK
from latin_fmu.laws.dispatch import LAWS, apply_to_points, law_tangents

from . import plain_laws
from .conftest import RATE

Array = NDArray[np.float64]
Solve = Callable[[Any], Array]
TIGHT = 1e-12  # of fields of order 1


def hat_velocities(points: Any, f_hat: Array) -> Array:
    """W_hat = K^-1 (F_hat - p) with the outgoing traction p = F - K W, F_hat' = -F_hat; (2, n_point, n_component)."""
    both = np.stack([f_hat, -f_hat])
    rigid = np.isinf(points.k)
    stiffness = np.where(rigid, 1.0, points.k)
    outgoing = points.f - stiffness * points.w
    return np.where(rigid, points.w, (both - outgoing) / stiffness)


def close(a: Array, b: Array, scale: float = 1.0) -> None:
    np.testing.assert_allclose(a, b, rtol=0, atol=TIGHT * max(scale, float(np.abs(b).max(initial=0.0))))


def test_every_registered_behaviour_is_tested_here(covered: Mapping[str, bool]) -> None:
    assert all(covered.values()), f"give parameters and a relation in conftest.py to: {covered}"


def test_registry_makes_what_it_says() -> None:
    assert isinstance(BEHAVIOURS, MappingProxyType)
    for name in BEHAVIOURS:
        assert BEHAVIOURS[name]().name == name
    with pytest.raises(KeyError):
        BEHAVIOURS["glued"]


@pytest.mark.parametrize("ground", [False, True], ids=["two_bodies", "ground"])
def test_relation_holds_with_the_velocities_of_the_search_direction(
    behaviour: Behaviour, solve: Solve, points: Any, residual: Any, ground: bool
) -> None:
    p = points(behaviour, ground=ground)
    f_hat = solve(p)
    w_hat = hat_velocities(p, f_hat)
    if not ground:
        for side, traction in enumerate((f_hat, -f_hat)):  # E+: F_hat - F = k (W_hat - W)
            close(p.k[side] * (w_hat[side] - p.w[side]), traction - p.f[side], scale=10.0)
    scale = float(np.abs(f_hat).max())
    assert residual(behaviour, w_hat[1] - w_hat[0], f_hat, p.normalised_gap) <= TIGHT * max(1.0, scale**2)


@pytest.mark.parametrize("ground", [False, True], ids=["two_bodies", "ground"])
def test_law_is_that_of_numpy(behaviour: Behaviour, solve: Solve, points: Any, ground: bool) -> None:
    """Branch for branch: the statement in NumPy gives the same tractions to round-off."""
    p = points(behaviour, ground=ground)
    parameters = behaviour.point_parameters(len(p.normalised_gap))
    expected = getattr(plain_laws, behaviour.name)(p.jump, p.z, p.normalised_gap, RATE, parameters)
    assert expected.any()
    np.testing.assert_allclose(solve(p), expected, rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize("ground", [False, True], ids=["two_bodies", "ground"])
def test_tangent_is_the_derivative_of_the_value(behaviour: Behaviour, points: Any, ground: bool) -> None:
    """Against central differences, but where a branch changes between them."""
    p = points(behaviour, ground=ground)
    parameters = behaviour.point_parameters(len(p.normalised_gap))

    def slope(step: float) -> Array:
        found = []
        for e in range(behaviour.n_component):
            aside = np.zeros_like(p.jump)
            aside[:, e] = step
            ahead, behind = (
                behaviour.local(p.jump + sign * aside, p.z, p.normalised_gap, RATE, parameters) for sign in (1.0, -1.0)
            )
            found.append((ahead - behind) / (2 * step))
        return np.stack(found, axis=-1)

    coarse, fine = slope(2e-6), slope(1e-6)
    scale = np.maximum(np.abs(fine).max(axis=(1, 2)), 1.0)
    smooth = np.abs(coarse - fine).max(axis=(1, 2)) <= 1e-6 * scale
    assert smooth.mean() > 0.9
    made = law_tangents(LAWS[behaviour.name], p.jump, p.z, p.normalised_gap, RATE, parameters)
    assert (np.abs(made - fine).max(axis=(1, 2)) <= 1e-5 * scale)[smooth].all()


def test_status_is_that_of_the_motion(behaviour: Behaviour, solve: Solve, points: Any) -> None:
    """Separation without traction, stick without sliding, slip where a larger push meets no larger shear."""
    p = points(behaviour)
    f_hat = solve(p)
    w_hat = hat_velocities(p, f_hat)
    status = behaviour.status(f_hat, behaviour.point_parameters(len(p.normalised_gap)))
    carried, sliding = np.abs(f_hat).max(axis=1) > 0.0, np.zeros(len(f_hat))
    if behaviour.n_component > 1:
        sliding = np.linalg.norm((w_hat[1] - w_hat[0])[:, 1:], axis=1)
    if not behaviour.opens:
        assert (status == STICK).all()
        return
    assert ((status == SEPARATION) == ~carried).all()
    assert sliding[status == STICK].max(initial=0.0) <= 1e-9 or behaviour.name == "no_slip"
    further = p.jump * np.where(np.arange(behaviour.n_component) > 0, 1.5, 1.0)
    pushed = behaviour.local(further, p.z, p.normalised_gap, RATE, behaviour.point_parameters(len(f_hat)))
    shear, more = (np.linalg.norm(traction[:, 1:], axis=1)[status == SLIP] for traction in (f_hat, pushed))
    assert (more <= shear * (1 + 1e-9)).all()


def test_every_law_has_its_own_code_and_no_code_gives_nothing() -> None:
    assert list(LAWS) == list(BEHAVIOURS)
    jump, z, traction = np.full((1, 3), -1.0), np.ones((1, 2)), np.zeros((1, 3))
    apply_to_points(len(LAWS), jump, z, np.zeros((1, 1)), 1.0, np.ones((1, 2)), traction)
    assert np.isnan(traction).all()


def test_a_solution_is_a_fixed_point_for_any_search_direction(behaviour: Behaviour, solve: Solve, points: Any) -> None:
    """Idempotence, also when k changes: the result satisfies the relation, in which k does not appear."""
    first = points(behaviour)
    f_hat = solve(first)
    answer = replace(first, w=hat_velocities(first, f_hat), f=np.stack([f_hat, -f_hat]))
    close(solve(answer), f_hat)
    other_k = points(behaviour, seed=7).k
    close(solve(replace(answer, k=other_k)), f_hat, scale=100.0)


def test_exchange_of_sides(behaviour: Behaviour, solve: Solve, points: Any) -> None:
    """Read from E' (N and the jump both turn; the tangents stay): F_hat of the new side E is minus the old."""
    p = points(behaviour)
    turn = np.ones(behaviour.n_component)
    turn[0] = -1.0
    normalised_gap = -p.normalised_gap * turn if behaviour.elastic else p.normalised_gap
    exchanged = replace(p, w=p.w[::-1] * turn, f=p.f[::-1] * turn, k=p.k[::-1], normalised_gap=normalised_gap)
    close(solve(exchanged), -turn * solve(p))


def test_rotation_of_the_tangents(behaviour: Behaviour, solve: Solve, points: Any) -> None:
    angle = 0.7
    turn = np.eye(3)
    turn[1:, 1:] = [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    turn = turn[: behaviour.n_component, : behaviour.n_component]
    p = points(behaviour)
    normalised_gap = p.normalised_gap @ turn.T if behaviour.elastic else p.normalised_gap
    close(solve(replace(p, w=p.w @ turn.T, f=p.f @ turn.T, normalised_gap=normalised_gap)), solve(p) @ turn.T)


def test_friction_dissipates(behaviour: Behaviour, solve: Solve, points: Any) -> None:
    """Power taken from the two bodies, -(F_hat . W_hat + F_hat' . W_hat'), tangential part, at every point."""
    if behaviour.elastic and not behaviour.opens:
        return  # a layer gives back what it takes
    p = points(behaviour)
    f_hat = solve(p)
    slip = hat_velocities(p, f_hat)
    power = np.einsum("pi,pi->p", f_hat[:, 1:], (slip[1] - slip[0])[:, 1:])
    assert power.min(initial=0.0) >= -TIGHT * max(1.0, float(np.abs(f_hat).max()))


@pytest.mark.parametrize("c", [1e-9, 3.0, 1e12])
def test_scaling(behaviour: Behaviour, solve: Solve, scaled: Any, points: Any, c: float) -> None:
    """(F, k) -> (c F, c k), stiffness and viscosity with them, and (W, F, g) -> c (W, F, g), lengths with them,
    scale the traction by c and nothing else."""
    p = points(behaviour)
    f_hat = solve(p)
    close(scaled(c)(replace(p, f=c * p.f, k=c * p.k)) / c, f_hat)
    close(scaled(c, lengths=True)(replace(p, w=c * p.w, f=c * p.f, normalised_gap=c * p.normalised_gap)) / c, f_hat)


def test_points_are_independent(behaviour: Behaviour, solve: Solve, points: Any) -> None:
    p = points(behaviour)
    together = solve(p)
    order = np.random.default_rng(1).permutation(len(p.normalised_gap))
    shuffled = replace(p, w=p.w[:, order], f=p.f[:, order], k=p.k[:, order], normalised_gap=p.normalised_gap[order])
    np.testing.assert_array_equal(solve(shuffled), together[order])
    one = replace(p, w=p.w[:, 5:6], f=p.f[:, 5:6], k=p.k[:, 5:6], normalised_gap=p.normalised_gap[5:6])
    np.testing.assert_array_equal(solve(one), together[5:6])
    none = replace(p, w=p.w[:, :0], f=p.f[:, :0], k=p.k[:, :0], normalised_gap=p.normalised_gap[:0])
    assert solve(none).shape == (0, behaviour.n_component)


def test_parameters_travel_per_point(points: Any) -> None:
    """Interfaces of one kind are solved together, each with its own parameters."""
    low, high = (BEHAVIOURS["contact"](**{"friction_coefficient": mu}) for mu in (0.1, 0.7))
    p = points(low)
    n = len(p.normalised_gap)
    mixed = np.concatenate([low.point_parameters(n // 2), high.point_parameters(n - n // 2)])
    together = low.local(p.jump, p.z, p.normalised_gap, 1.0, mixed)
    for behaviour, part in ((low, slice(0, n // 2)), (high, slice(n // 2, n))):
        alone = behaviour.local(p.jump, p.z, p.normalised_gap, 1.0, behaviour.point_parameters(n))
        np.testing.assert_array_equal(together[part], alone[part])


def test_inputs_are_unchanged(behaviour: Behaviour, points: Any) -> None:
    p = points(behaviour)
    arguments = (p.jump, p.z, p.normalised_gap.copy(), behaviour.point_parameters(len(p.normalised_gap)))
    before = [a.copy() for a in arguments]
    jump, z, normalised_gap, parameters = arguments
    f_hat = behaviour.local(jump, z, normalised_gap, 1.0, parameters)
    behaviour.status(f_hat, parameters)
    for now, then in zip(arguments, before, strict=True):
        np.testing.assert_array_equal(now, then)
    assert not any(np.shares_memory(f_hat, a) for a in arguments)


def test_rigid_on_both_sides_gives_no_traction(behaviour: Behaviour) -> None:
    """z = 0: both sides held. The traction is not determined; 0 and not NaN."""
    n, c = 3, behaviour.n_component
    jump = -np.ones((n, c))
    parameters = behaviour.point_parameters(n)
    if behaviour.compliant:
        assert_definite(behaviour, jump, parameters)
        return
    f_hat = behaviour.local(jump, np.zeros((n, 2)), np.zeros(n), 1.0, parameters)
    np.testing.assert_array_equal(f_hat, np.zeros((n, c)))
    half = behaviour.local(jump, np.tile([1.0, 0.0], (n, 1)), np.zeros(n), 1.0, parameters)
    np.testing.assert_array_equal(half[:, 0], -np.ones(n))
    np.testing.assert_array_equal(half[:, 1:], np.zeros((n, c - 1)))


def assert_definite(behaviour: Behaviour, jump: Array, parameters: Array) -> None:
    """A compliant behaviour: where both sides are held the jumps alone give the traction, whatever z was."""
    n, c = jump.shape
    normalised_gap = np.zeros((n, c)) if behaviour.elastic else np.zeros(n)
    f_hat = behaviour.local(jump, np.zeros((n, 2)), normalised_gap, 1.0, parameters)
    assert np.isfinite(f_hat).all()
    slowly = behaviour.local(jump, np.full((n, 2), 1e-12), normalised_gap, 1.0, parameters)
    np.testing.assert_allclose(f_hat[:, 0], slowly[:, 0], rtol=1e-5)
    if behaviour.elastic:  # displacement and velocity count alike: (g + d) / rate
        moved = behaviour.local(0 * jump, np.zeros((n, 2)), jump, 1.0, parameters)
        np.testing.assert_allclose(f_hat[:, 0], moved[:, 0])


def test_status_has_the_shape_of_the_points(behaviour: Behaviour, solve: Solve, points: Any) -> None:
    f_hat = solve(points(behaviour))
    parameters = behaviour.point_parameters(len(f_hat))
    alone = behaviour.status(f_hat, parameters)
    assert alone.dtype == np.int8
    assert set(np.unique(alone)) <= {0, 1, 2}
    stacked = behaviour.status(np.stack([f_hat, f_hat[::-1]]), parameters)
    np.testing.assert_array_equal(stacked, np.stack([alone, alone[::-1]]))
