"""Sums of matrices on their common pattern against those of SciPy, and models that hold equal patterns once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

from latin_fmu.cholesky.factor import CholeskyFactor
from latin_fmu.propagator.model import OperatorPattern, SubstructureModel, reduced_rank, share_patterns

Make = Callable[..., Any]


def sparse(seed: int, density: float, n: int = 30) -> sp.csr_array:
    rng = np.random.default_rng(seed)
    return sp.csr_array(
        sp.random_array((n, n), density=density, rng=rng, data_sampler=lambda size: rng.normal(size=size))
    )


@pytest.mark.parametrize("densities", [(0.2,), (0.1, 0.2), (0.0, 0.3), (0.3, 0.0, 0.1), (0.05, 0.05, 0.05)])
def test_sum(densities: tuple[float, ...]) -> None:
    """To the last bit, and again with other numbers in the same places."""
    matrices = [sparse(i, d) for i, d in enumerate(densities)]
    pattern = OperatorPattern(matrices)
    for seed in (1, 2):
        factors = np.random.default_rng(seed).normal(size=len(matrices)).tolist()
        expected = sum((f * m for f, m in zip(factors[1:], matrices[1:], strict=True)), factors[0] * matrices[0])
        np.testing.assert_array_equal(pattern.sum(factors, matrices).toarray(), expected.toarray())
        for matrix in matrices:
            matrix.data = np.random.default_rng(seed + 5).normal(size=matrix.nnz)


def test_places_of_a_part_and_numbers_that_cancel() -> None:
    """A pattern within the other; entries that add up to zero stay in the pattern."""
    whole = sp.csr_array(np.array([[2.0, 1.0, 0.0], [1.0, 3.0, 4.0], [0.0, 4.0, 5.0]]))
    part = sp.csr_array(np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 4.0], [0.0, 0.0, 1.0]]))
    pattern = OperatorPattern([part, whole])
    actual = pattern.sum([-1.0, 1.0], [part, whole])
    assert actual.nnz == whole.nnz
    np.testing.assert_array_equal(actual.toarray(), whole.toarray() - part.toarray())


def test_equal_patterns_are_held_once(model: Make, changed: Make) -> None:
    """Values stay their own, other patterns too."""
    first, other = model("held").model, model("everything").model
    stiffer = changed(model("held"), {"stiffness": 2.0 * first.stiffness}).model
    before = [m.toarray() for m in stiffer.reduced if m is not None]
    share_patterns([first, other, stiffer])
    assert stiffer.reduced[2].indices is first.reduced[2].indices
    assert stiffer.operator_pattern is first.operator_pattern
    assert other.operator_pattern is not first.operator_pattern
    after = [m.toarray() for m in stiffer.reduced if m is not None]
    for was, now in zip(before, after, strict=True):
        np.testing.assert_array_equal(now, was)
    np.testing.assert_array_equal(stiffer.reduced[2].toarray(), 2.0 * first.reduced[2].toarray())


def test_factor_of_an_operator(model: Make, kind: str) -> None:
    """Reduced operators as the march builds them, with held, tied and driven dofs: against dense algebra."""
    m = model(kind).model
    p = m.expansion
    a = sp.csr_array(p.T @ (m.mass + 0.02 * m.stiffness) @ p)
    dofs = np.flatnonzero(np.diff(sp.csc_array(m.trace @ p).indptr))
    factor = CholeskyFactor(a, dofs, reduced_rank(p, m.ordering))
    inverse, b = np.linalg.inv(a.toarray()), np.random.default_rng(5).normal(size=(a.shape[0], 3))
    np.testing.assert_allclose(factor.solve(b), inverse @ b, atol=1e-12 * np.abs(inverse @ b).max())
    expected = inverse[np.ix_(dofs, dofs)]
    np.testing.assert_allclose(factor.schur_inverse, expected, atol=1e-12 * np.abs(expected).max())


def reduced(matrix: sp.csr_array, expansion: sp.csr_array) -> sp.csr_array:
    """Reduced stiffness of a model that has these matrices and no interfaces."""
    n, nothing = matrix.shape[0], np.zeros(0)
    zeros = np.zeros(n)
    trace, motions = sp.csr_array((0, n)), np.zeros((n, 0))
    model = SubstructureModel("a", None, None, matrix, expansion, trace, nothing, [], zeros, zeros, motions, nothing)
    return model.reduced_stiffness


@pytest.mark.parametrize("held", [(), (0, 1, 5, 11), tuple(range(1, 12))])
def test_dofs_that_are_some_of_all_are_reduced_by_their_rows_and_columns(held: tuple[int, ...]) -> None:
    """The same arrays as those of the product P^T A P, which leaves stored zeros out."""
    random = np.random.default_rng(1)
    dense = random.standard_normal((12, 12)) * (random.random((12, 12)) < 0.4)
    dense[3] = 0.0  # a row without entries
    matrix = sp.csr_array(dense)
    matrix.data[::5] = 0.0
    expansion = sp.csr_array(np.eye(12)[:, np.setdiff1d(np.arange(12), held)])
    wanted, actual = sp.csr_array(expansion.T @ matrix @ expansion), reduced(matrix, expansion)
    for name in ("data", "indices", "indptr"):
        np.testing.assert_array_equal(getattr(actual, name), getattr(wanted, name))
    assert actual.has_canonical_format


def test_tied_dofs_are_reduced_by_the_product() -> None:
    matrix = sp.csr_array(np.arange(9.0).reshape(3, 3))
    expansion = sp.csr_array(np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 0.0]]))
    np.testing.assert_array_equal(reduced(matrix, expansion).toarray(), [[16.0, 8.0], [8.0, 4.0]])
