"""Relaxation and Anderson acceleration on fixed points with known solutions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from latin_fmu import load_scene
from latin_fmu.building import discretise, solver_ready
from latin_fmu.kernels import acceleration
from latin_fmu.kernels.acceleration import Anderson
from latin_fmu.kernels.newton import advance_iterate
from latin_fmu.latin.outcome import Timings
from latin_fmu.latin.recorder import Recorder
from latin_fmu.latin.windows import Run
from tests.plain_kernels import call

MODELS = Path(__file__).parents[2] / "models"

Map = Callable[[np.ndarray], np.ndarray]


class Accelerated:
    """Anderson acceleration of iterates (window, n); ``depth`` 0 relaxes."""

    def __init__(self, weight: np.ndarray, depth: int, relaxation: float) -> None:
        self._weight, self._depth, self._relaxation = weight, depth, relaxation
        self.arrays: list[np.ndarray] = []
        self.count = 0

    def next(self, q: np.ndarray, residual: np.ndarray) -> np.ndarray:
        """Next iterate."""
        n, depth = q.size, self._depth
        if not self.arrays:
            sizes = (n, n, depth * n, depth * n, depth * depth, (depth + 5) * depth)
            self.arrays = [np.full(size, np.nan) for size in sizes]
        out, weight = q.ravel().copy(), np.tile(self._weight, n // len(self._weight))
        acceleration.anderson(out, residual.ravel().copy(), depth, self._relaxation, weight, *self.arrays, self.count)
        self.count += 1
        return out.reshape(q.shape)


def relaxed(factor: float, n: int = 2) -> Accelerated:
    """Relaxation alone."""
    return Accelerated(np.ones(n), 0, factor)


def linear_map(n: int, size: float, seed: int = 1) -> tuple[Map, np.ndarray]:
    """q -> A q + b with |eigenvalues| up to ``size``, and its fixed point."""
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(n, n))
    a *= size / np.abs(np.linalg.eigvals(a)).max()
    b = rng.normal(size=n)
    return (lambda q: (a @ q.ravel() + b).reshape(q.shape)), np.linalg.solve(np.eye(n) - a, b)


def iterate(method: Any, g: Map, q: np.ndarray, steps: int) -> np.ndarray:
    for _ in range(steps):
        q = method.next(q, g(q) - q)
    return q


@pytest.mark.parametrize("size", [0.5, 0.99, 3.0])
@pytest.mark.parametrize("relaxation", [1.0, 0.5])
def test_anderson_ends_on_a_linear_map_in_as_many_steps_as_unknowns(size: float, relaxation: float) -> None:
    """n differences span the space: n + 1 steps give the result, contraction or not (finite termination)."""
    for n, shape in ((1, (1, 1)), (5, (1, 5)), (6, (2, 3))):
        g, answer = linear_map(n, size)
        weight = np.random.default_rng(2).uniform(0.5, 2.0, shape[1])
        q = iterate(Accelerated(weight, 10, relaxation), g, np.zeros(shape), n + 1)
        np.testing.assert_allclose(q.ravel(), answer, atol=1e-7 * np.abs(answer).max())


def test_first_step_is_the_plain_one() -> None:
    q, r = np.array([[1.0, 2.0]]), np.array([[0.5, -1.0]])
    np.testing.assert_array_equal(Accelerated(np.ones(2), 4, 0.5).next(q, r), q + 0.5 * r)
    np.testing.assert_array_equal(relaxed(0.5).next(q, r), q + 0.5 * r)


def test_relaxation_converges_where_the_plain_iteration_turns_in_circles() -> None:
    """Peaceman-Rachford against Douglas-Rachford: an isometry has eigenvalues on the unit circle."""
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    g: Map = lambda q: (turn @ q.ravel()).reshape(q.shape)  # noqa: E731
    start = np.array([[1.0, 1.0]])
    assert np.linalg.norm(iterate(relaxed(1.0), g, start, 40)) == pytest.approx(np.sqrt(2))
    assert np.linalg.norm(iterate(relaxed(0.5), g, start, 40)) < 1e-5


def test_depth_limits_the_memory() -> None:
    """Three differences do not span eight unknowns; the oldest gives way to the newest."""
    g, answer = linear_map(8, 0.9)
    method, iterates = Accelerated(np.ones(8), 3, 1.0), [np.zeros((1, 8))]
    for _ in range(9):
        iterates.append(method.next(iterates[-1], g(iterates[-1]) - iterates[-1]))
    assert np.abs(iterates[-1].ravel() - answer).max() > 1e-6
    differences = np.diff(np.concatenate(iterates[:-1]), axis=0)[-3:]
    kept = method.arrays[2].reshape(3, 8)
    np.testing.assert_allclose(sorted(kept.tolist()), sorted(differences.tolist()), rtol=0, atol=1e-13)


@pytest.mark.parametrize("shape", [(1, 7), (3, 7)], ids=["one instant", "three instants"])
@pytest.mark.parametrize("relaxation", [1.0, 0.7])
def test_step_is_that_of_a_dense_least_squares_problem(shape: tuple[int, int], relaxation: float) -> None:
    """q + r - (DQ + DR) gamma with gamma from numpy.linalg.lstsq in the weighted norm, ground (weight 0) included."""
    rng = np.random.default_rng(3)
    weight = rng.uniform(0.1, 2.0, shape[1])
    weight[::3] = 0.0
    method = Accelerated(weight, 4, relaxation)
    q, r = rng.normal(size=(8, *shape)), rng.normal(size=(8, *shape))
    root = np.sqrt(np.tile(weight, shape[0]))
    for i in range(8):
        actual = method.next(q[i], r[i]).ravel()
        first = max(0, i - 4)
        dq, dr = (np.diff(x[first : i + 1].reshape(i + 1 - first, -1), axis=0).T for x in (q, r))
        gamma = np.linalg.lstsq(root[:, None] * dr, root * r[i].ravel(), rcond=None)[0] if i else np.zeros(0)
        expected = q[i].ravel() + relaxation * r[i].ravel() - (dq + relaxation * dr) @ gamma
        np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("window", [1, 3])
def test_sums_by_interface_give_the_same_step(window: int) -> None:
    """In the image of a run, where sums are taken over each interface first; a step that is too long is shortened to so
    many lengths of the residual, a shorter one left as it is."""
    scene = load_scene(MODELS / "stacked_blocks" / "n04.toml")
    problem = solver_ready(discretise(scene), None)
    settings = replace(problem.settings, window=window, anderson_depth=3, relaxation=0.9)
    run = Run(problem.assembly, settings, Recorder(problem.assembly, problem.output, problem.info), Timings())
    run._use(window)
    assert len(problem.assembly.interfaces) > 2
    image, metric, rng, lengths = run.image, run.direction(window).metric, np.random.default_rng(1), list[float]()
    q, r = (image.field(name, window, image.n_flat) for name in ("q", "r"))
    for longest in (np.inf, 0.9):
        image.set({"longest_step": longest})
        plain = Accelerated(metric, 3, 0.9)
        for count in range(6):
            start, residual = rng.normal(size=(2, *q.shape))
            q[...], r[...] = start, residual
            call(advance_iterate, image, window, count, 0)
            step = plain.next(start, residual) - start
            size = float(np.sqrt((metric * step**2).sum() / (metric * residual**2).sum()))
            share = min(1.0, longest / size) if count else 1.0
            lengths += [size] * (count > 0)
            np.testing.assert_allclose(q - start, share * step, rtol=0, atol=1e-10 * np.abs(step).max())
    assert max(lengths) > 0.9


def test_what_other_iterations_use_is_the_same() -> None:
    weight, rng = np.array([1.0, 4.0, 0.5]), np.random.default_rng(2)
    one, other = Anderson(weight, 3, 0.9), Accelerated(weight, 3, 0.9)
    for _ in range(6):
        q, r = rng.normal(size=(2, 3))
        np.testing.assert_array_equal(one.next(q, r), other.next(q[None], r[None])[0])


def test_a_rigid_channel_has_no_weight_and_does_no_harm() -> None:
    """Weight 0 (k = 0, ground): the channel follows the plain step; the others converge as before."""
    g, answer = linear_map(4, 0.8)
    whole: Map = lambda q: np.column_stack([g(q[:, :4]), [[5.0]]])  # noqa: E731
    q = iterate(Accelerated(np.array([1.0, 1.0, 1.0, 1.0, 0.0]), 10, 1.0), whole, np.zeros((1, 5)), 6)
    np.testing.assert_allclose(q[0, :4], answer, atol=1e-7)
    assert np.isfinite(q).all()


def test_a_repeated_iterate_gives_no_nan() -> None:
    method = Accelerated(np.ones(3), 5, 1.0)
    q, r = np.ones((1, 3)), np.array([[0.1, 0.2, 0.3]])
    for _ in range(4):
        assert np.isfinite(method.next(q, r)).all()


def test_scaled_weights_change_nothing() -> None:
    g, _ = linear_map(6, 0.9)
    runs = [iterate(Accelerated(np.full(6, w), 3, 1.0), g, np.zeros((1, 6)), 8) for w in (1.0, 1e-7, 1e9)]
    np.testing.assert_allclose(runs[1], runs[0], rtol=1e-9)
    np.testing.assert_allclose(runs[2], runs[0], rtol=1e-9)
