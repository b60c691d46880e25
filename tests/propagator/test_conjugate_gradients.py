"""Solutions without a factor against the factor."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from latin_fmu.cholesky.factor import CholeskyFactor
from latin_fmu.errors import SolverError
from latin_fmu.propagator.direct import ConjugateGradients, IterativeFactor


def matrix(n: int = 90, seed: int = 0) -> sp.csr_array:
    """Sparse, symmetric, positive definite, of several scales."""
    rng = np.random.default_rng(seed)
    a = sp.random_array((n, n), density=0.06, rng=rng)
    scale = sp.diags_array(10.0 ** rng.uniform(-2, 2, n))
    return sp.csr_array(scale @ (a @ a.T + 0.5 * sp.eye_array(n)) @ scale)


def close(actual, expected, tolerance: float = 1e-8) -> None:
    np.testing.assert_allclose(actual, expected, rtol=0, atol=tolerance * np.abs(expected).max())


@pytest.mark.parametrize("count", [0, 1, 40])
def test_half_solves_are_those_of_the_factor(count: int) -> None:
    a = matrix()
    last = np.sort(np.random.default_rng(2).permutation(90)[:count]).astype(np.int64)
    b = np.random.default_rng(3).normal(size=(90, 5))
    factor, iterative = CholeskyFactor(a, last), IterativeFactor(a, last)
    if count:
        close(iterative.schur, factor.schur)
        close(iterative.schur @ iterative.schur_inverse, np.eye(count), 1e-6)
    y, c = iterative.forward(b)
    close(c, factor.forward(b)[1]) if count else None
    x_last = np.random.default_rng(4).normal(size=(count, 5))
    residual = (a @ iterative.backward(y, x_last) - b)[iterative.interior]
    assert np.abs(residual).max() <= 1e-8 * np.abs(b).max() * (1 + np.abs(a.toarray()).max())
    close(a @ iterative.solve(b), b)


def test_columns_do_not_see_each_other() -> None:
    solver = ConjugateGradients(matrix())
    b = np.random.default_rng(5).normal(size=(90, 40)) * 10.0 ** np.arange(-20, 20)
    b[:, 7] = 0.0
    together = solver.solve(b)
    for j in (0, 7, 39):
        np.testing.assert_allclose(together[:, j : j + 1], solver.solve(b[:, j : j + 1]), rtol=1e-12)


def test_matrices_it_cannot_take_are_refused() -> None:
    with pytest.raises(SolverError, match="not positive"):
        ConjugateGradients(sp.csr_array(np.diag([1.0, -1.0])))
    crossed = sp.csr_array(np.array([[1.0, 2.0], [2.0, 1.0]]))  # indefinite: no descent along some direction
    with pytest.raises(SolverError, match="not converged"):
        ConjugateGradients(crossed).solve(np.array([[1.0], [-1.0]]))


def test_a_singular_matrix_is_named_with_a_remedy() -> None:
    """Steps so long that the inertia of a free body is lost in rounding errors."""
    chain = sp.csr_array(
        sp.diags_array([np.r_[1.0, np.full(8, 2.0), 1.0], -np.ones(9), -np.ones(9)], offsets=[0, 1, -1])
    )
    with pytest.raises(SolverError, match=r"singular to rounding errors .* use smaller steps"):
        IterativeFactor(chain, np.array([0, 9]))
