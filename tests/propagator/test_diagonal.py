"""The factor of a diagonal matrix against the Cholesky factor, and its effect on the channels."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from latin_fmu.cholesky.factor import DiagonalFactor
from latin_fmu.propagator.interface_matrices import condensed, projected_diagonal
from latin_fmu.propagator.model import diagonal_matrix, lumped, reduced_diagonal


def test_half_solves() -> None:
    rng = np.random.default_rng(0)
    diagonal, b, g = rng.uniform(0.5, 2.0, 9), rng.normal(size=(9, 2)), rng.normal(size=(9, 2))
    factor = DiagonalFactor(diagonal)
    y, c = factor.forward(b)
    x = factor.backward(y, factor.schur_inverse @ (c + g))
    np.testing.assert_allclose(x, (b + g) / diagonal[:, None], rtol=1e-14)
    np.testing.assert_allclose(factor.solve(b), b / diagonal[:, None], rtol=1e-14)
    np.testing.assert_array_equal(factor.schur, np.diag(diagonal))


@pytest.mark.parametrize("kind", ["own dofs", "one dof twice", "mixed"])
def test_channels_see_a_diagonal(kind: str) -> None:
    """Held channels included; diagonal where every channel has a dof of its own, dense where two share one."""
    dense = np.zeros((5, 8))
    dense[[0, 1, 3], [2, 5, 7]] = [1.0, -1.0, 1.0]
    if kind == "one dof twice":
        dense[4, 5] = 1.0
    if kind == "mixed":
        dense[4, [0, 5]] = [0.6, 0.8]
    diagonal = np.random.default_rng(1).uniform(0.5, 2.0, 8)
    actual = projected_diagonal(sp.csr_array(dense), 0.3, diagonal)
    np.testing.assert_allclose(actual, 0.3 * dense @ np.diag(diagonal) @ dense.T, atol=1e-15)
    dashpots = np.array([0.0, 3.0, 1.0, 0.5, 2.0])
    expected = np.linalg.solve(np.eye(5) + actual * dashpots, actual)
    np.testing.assert_allclose(condensed(actual, dashpots), expected, atol=1e-14)


def test_lumped_and_reduced_masses(model) -> None:  # type: ignore[no-untyped-def]
    """Kept for a model, with the reduced one as the sum over tied dofs; what is no mass is shared."""
    m = model("everything").model
    other = m.with_lumped_mass
    assert m.with_lumped_mass is other
    p = m.expansion.toarray()
    full = np.diag(m.mass.toarray().sum(axis=1))
    np.testing.assert_allclose(other.inertia.toarray(), full, atol=1e-14)
    np.testing.assert_allclose(other.reduced[0].toarray(), p.T @ full @ p, atol=1e-14)
    assert other.reduced[2] is m.reduced[2]
    np.testing.assert_allclose(reduced_diagonal(m.expansion, np.diag(full)), np.diag(p.T @ full @ p))
    values = np.array([0.0, 2.0, 0.0, -1.0])
    np.testing.assert_array_equal(diagonal_matrix(values).toarray(), np.diag(values))
    assert diagonal_matrix(values).nnz == 2
    assert lumped(m.mass, nodal=False).nnz == m.n_full
