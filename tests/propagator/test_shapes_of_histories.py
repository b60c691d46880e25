"""Shapes that hold the histories of relative motions (``reduced_assembly.compressed``)."""

from __future__ import annotations

import numpy as np

from latin_fmu.joined.reduced_assembly import _EXACT, compressed


def histories(seed: int) -> np.ndarray:
    """(n_time, n) with singular values that fall by a decade every ten."""
    rng = np.random.default_rng(seed)
    left, _ = np.linalg.qr(rng.normal(size=(120, 90)))
    right, _ = np.linalg.qr(rng.normal(size=(150, 90)))
    return np.asarray((left * 10.0 ** (-0.1 * np.arange(90))) @ right.T)


def test_shapes_hold_every_instant_and_are_hardly_more_than_the_fewest() -> None:
    given = histories(3)
    size = np.linalg.norm(given, axis=1).max()
    shapes = compressed(given)
    np.testing.assert_allclose(shapes.T @ shapes, np.eye(shapes.shape[1]), atol=1e-12)
    left = given - (given @ shapes) @ shapes.T
    assert np.linalg.norm(left, axis=1).max() <= _EXACT * size
    u, s, _ = np.linalg.svd(given, full_matrices=False)
    tails = np.sqrt(np.cumsum(((u * s) ** 2)[:, ::-1], axis=1)[:, ::-1]).max(axis=0)
    fewest = int((tails > _EXACT * size).sum())
    assert fewest <= shapes.shape[1] <= fewest + 3


def test_nothing_moves() -> None:
    assert compressed(np.zeros((5, 6))).shape == (6, 0)
    assert compressed(np.zeros((5, 0))).shape == (0, 0)
