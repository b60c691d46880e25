"""Relaxation and Anderson acceleration on fixed points with known answers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from latin_fmu.latin.acceleration import Anderson, Relaxation

Map = Callable[[np.ndarray], np.ndarray]


def linear_map(n: int, size: float, seed: int = 1) -> tuple[Map, np.ndarray]:
    """q -> A q + b with |eigenvalues| up to ``size``, and its fixed point."""
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(n, n))
    a *= size / np.abs(np.linalg.eigvals(a)).max()
    b = rng.normal(size=n)
    return (lambda q: (a @ q.ravel() + b).reshape(q.shape)), np.linalg.solve(np.eye(n) - a, b)


def iterate(method: Anderson | Relaxation, g: Map, q: np.ndarray, steps: int) -> np.ndarray:
    for _ in range(steps):
        q = method.next(q, g(q) - q)
    return q


@pytest.mark.parametrize("size", [0.5, 0.99, 3.0])
@pytest.mark.parametrize("relaxation", [1.0, 0.5])
def test_anderson_ends_on_a_linear_map_in_as_many_steps_as_unknowns(size: float, relaxation: float) -> None:
    """n differences span the space: n + 1 steps give the answer, contraction or not (finite termination)."""
    for n, shape in ((1, (1, 1)), (5, (1, 5)), (6, (2, 3))):
        g, answer = linear_map(n, size)
        weight = np.random.default_rng(2).uniform(0.5, 2.0, shape[1])
        q = iterate(Anderson(weight, 10, relaxation), g, np.zeros(shape), n + 1)
        np.testing.assert_allclose(q.ravel(), answer, atol=1e-7 * np.abs(answer).max())


def test_first_step_is_the_plain_one() -> None:
    q, r = np.array([[1.0, 2.0]]), np.array([[0.5, -1.0]])
    np.testing.assert_array_equal(Anderson(np.ones(2), 4, 0.5).next(q, r), q + 0.5 * r)
    np.testing.assert_array_equal(Relaxation(0.5).next(q, r), q + 0.5 * r)


def test_relaxation_converges_where_the_plain_iteration_turns_in_circles() -> None:
    """Peaceman-Rachford against Douglas-Rachford: an isometry has eigenvalues on the unit circle."""
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    g: Map = lambda q: (turn @ q.ravel()).reshape(q.shape)  # noqa: E731
    start = np.array([[1.0, 1.0]])
    assert np.linalg.norm(iterate(Relaxation(1.0), g, start, 40)) == pytest.approx(np.sqrt(2))
    assert np.linalg.norm(iterate(Relaxation(0.5), g, start, 40)) < 1e-5


def test_depth_limits_the_memory() -> None:
    g, answer = linear_map(8, 0.9)
    method = Anderson(np.ones(8), 3, 1.0)
    q = iterate(method, g, np.zeros((1, 8)), 9)
    assert len(method._dq) == len(method._dr) == 3
    assert np.abs(q.ravel() - answer).max() > 1e-6  # three differences do not span eight unknowns


def test_a_rigid_channel_has_no_weight_and_does_no_harm() -> None:
    """Weight 0 (k = 0, ground): the channel follows the plain step; the others converge as before."""
    g, answer = linear_map(4, 0.8)
    whole: Map = lambda q: np.column_stack([g(q[:, :4]), [[5.0]]])  # noqa: E731
    q = iterate(Anderson(np.array([1.0, 1.0, 1.0, 1.0, 0.0]), 10, 1.0), whole, np.zeros((1, 5)), 6)
    np.testing.assert_allclose(q[0, :4], answer, atol=1e-7)
    assert np.isfinite(q).all()


def test_a_repeated_iterate_gives_no_nan() -> None:
    method = Anderson(np.ones(3), 5, 1.0)
    q, r = np.ones((1, 3)), np.array([[0.1, 0.2, 0.3]])
    for _ in range(4):
        assert np.isfinite(method.next(q, r)).all()


def test_scaled_weights_change_nothing() -> None:
    g, _ = linear_map(6, 0.9)
    runs = [iterate(Anderson(np.full(6, w), 3, 1.0), g, np.zeros((1, 6)), 8) for w in (1.0, 1e-7, 1e9)]
    np.testing.assert_allclose(runs[1], runs[0], rtol=1e-9)
    np.testing.assert_allclose(runs[2], runs[0], rtol=1e-9)
