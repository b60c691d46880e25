"""Dense matrices of the interface against NumPy: compliance of the channels, with and without dashpots; whole faces."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from latin_fmu.errors import SolverError
from latin_fmu.propagator.interface_matrices import projected, resistance, with_dashpots
from latin_fmu.propagator.interface_sweeps import InterfaceCompliance

Array = np.ndarray


def definite(n: int, seed: int) -> Array:
    root = np.random.default_rng(seed).normal(size=(n, n))
    matrix: Array = root @ root.T + 0.1 * np.eye(n)
    return matrix


def trace(n_channel: int, n: int, kind: str) -> sp.csr_array:
    """Turned axes, a channel that is held (no entry), or several entries per channel."""
    rng = np.random.default_rng(7)
    if kind == "turned":
        dense = np.zeros((n_channel, n))
        dense[np.arange(n_channel), rng.permutation(max(n, n_channel))[:n_channel] % n] = rng.choice(
            [-1.0, 1.0], n_channel
        )
        dense[1] = 0.0
    else:
        dense = np.where(rng.random((n_channel, n)) < 0.3, rng.normal(size=(n_channel, n)), 0.0)
    return sp.csr_array(dense)


@pytest.mark.parametrize("kind", ["turned", "mixed"])
@pytest.mark.parametrize(("n_channel", "n"), [(0, 0), (1, 1), (12, 9), (9, 9), (40, 71)])
def test_seen_by_channels(kind: str, n_channel: int, n: int) -> None:
    if n_channel < 2:
        kind = "mixed"
    matrix, t = definite(n, 1), trace(n_channel, n, kind)
    actual = projected(t, 0.7, matrix)
    expected = 0.7 * t.toarray() @ matrix @ t.toarray().T
    np.testing.assert_allclose(actual, expected, atol=1e-13 * np.abs(expected).max(initial=1.0))
    np.testing.assert_array_equal(actual, actual.T)


@pytest.mark.parametrize("kind", ["turned", "mixed"])
@pytest.mark.parametrize(("n_channel", "n"), [(12, 9), (40, 71)])
def test_with_dashpots_is_the_condensed_compliance(kind: str, n_channel: int, n: int) -> None:
    """(1 + C d)^-1 C for dashpots that may be 0 and for a compliance that need not be invertible."""
    schur, t = definite(n, 2), trace(n_channel, n, kind)
    dashpots = np.random.default_rng(3).uniform(0.0, 5.0, n_channel)
    dashpots[::4] = 0.0
    compliance = projected(t, 0.3, np.linalg.inv(schur))
    actual = with_dashpots(t, 0.3, schur, dashpots)
    expected = np.linalg.solve(np.eye(n_channel) + compliance * dashpots, compliance)
    np.testing.assert_allclose(actual, expected, atol=1e-11 * np.abs(expected).max())
    np.testing.assert_array_equal(actual, actual.T)


def test_numbers_that_are_no_numbers_are_refused() -> None:
    schur = definite(6, 4)
    schur[2, 1] = schur[1, 2] = np.nan
    with pytest.raises(SolverError, match="not positive"):
        with_dashpots(trace(6, 6, "turned"), 1.0, schur, np.ones(6))


def test_resistance_of_a_face() -> None:
    """1^T C^-1 1 of the rows that can move; rows held do not count, nor do faces of such rows alone."""
    compliance = np.zeros((8, 8))
    moving = np.array([0, 2, 3, 5, 7])
    compliance[np.ix_(moving, moving)] = definite(5, 5)
    rows = np.array([1, 5, 2, 6, 7])
    kept = np.array([5, 2, 7])
    expected = np.linalg.inv(compliance[np.ix_(kept, kept)]).sum()
    assert resistance(compliance, rows) == pytest.approx(expected, rel=1e-12)
    assert resistance(compliance, np.array([1, 6])) == 0.0


def test_resistance_of_points_that_move_together() -> None:
    """A singular block (two channels on one dof) still has a response to a uniform velocity."""
    assert resistance(np.array([[2.0, 2.0], [2.0, 2.0]]), np.arange(2)) == pytest.approx(0.5)


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("rank", [1, 2, 4, 12])
def test_resistance_of_points_that_outnumber_their_dofs(rank: int, seed: int) -> None:
    """The least-squares response where no forces move all points alike, by a matrix and by its products. Round-off may
    leave the matrix a factor, by which the points would resist 1e15 times as much."""
    n, few = rank + 3, 1e-9
    weights = np.random.default_rng([rank, seed]).uniform(0.2, 1.0, (n, rank))
    matrix = weights @ weights.T
    expected = np.linalg.pinv(matrix, rcond=1e-10).sum()
    assert resistance(matrix, np.arange(n)) == pytest.approx(expected, rel=1e-6)
    assert Products(matrix).resistance(np.arange(n), few) == pytest.approx(expected, rel=1e-6)


class Products(InterfaceCompliance):
    """A matrix known by its products."""

    def __init__(self, matrix: np.ndarray) -> None:
        self._matrix, self._diagonal = matrix, matrix.diagonal()

    def __matmul__(self, force: np.ndarray) -> np.ndarray:
        return self._matrix @ force
