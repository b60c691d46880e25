"""Factor with the interface dofs last: half solves against plain solves."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from latin_fmu.cholesky import factor as condensed
from latin_fmu.cholesky.factor import CondensedFactor
from latin_fmu.fem.elasticity import Isotropic
from latin_fmu.fem.elements import Elements, mass, stiffness
from latin_fmu.fem.mesh import box_mesh


@pytest.fixture
def matrix() -> sp.csr_array:
    """A symmetric positive definite matrix of a body."""
    basis = Elements(box_mesh(np.zeros(3), np.array([1.0, 0.9, 1.6]), (2, 2, 3)))
    return sp.csr_array(mass(basis, 1.2) + 0.05 * stiffness(basis, Isotropic(1.0, 5.0, 0.3)))


@pytest.fixture(params=["stored", "solved_again"])
def response(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> bool:
    """A_II^-1 A_IG kept, or solved for again in each backward sweep."""
    if request.param != "stored":
        monkeypatch.setattr(condensed, "_STORED_ENTRIES", 0)
    return bool(request.param == "stored")


@pytest.mark.parametrize("ranked", [False, True], ids=["library_order", "given_order"])
@pytest.mark.parametrize("n_last", [0, 1, 30, 70, 108])
def test_forward_and_backward_make_one_solve(matrix: sp.csr_array, response: bool, n_last: int, ranked: bool) -> None:
    n = matrix.shape[0]
    rng = np.random.default_rng(1)
    last = np.sort(rng.permutation(n)[:n_last])
    rank = rng.permutation(n).astype(float) if ranked else None
    factor = CondensedFactor(matrix, last, rank)
    assert (factor._response is not None) == (response and n_last < n) or n_last == 0
    b = rng.normal(size=(n, 4))
    expected = np.column_stack([spla.spsolve(matrix.tocsc(), column) for column in b.T])
    np.testing.assert_allclose(factor.solve(b), expected, atol=1e-10 * np.abs(expected).max())
    y, c = factor.forward(b)
    x_last = factor.schur_inverse @ c
    np.testing.assert_allclose(x_last, expected[last], atol=1e-10 * np.abs(expected).max())
    np.testing.assert_allclose(factor.backward(y, x_last), expected, atol=1e-10 * np.abs(expected).max())


@pytest.mark.usefixtures("response")
def test_schur_complement(matrix: sp.csr_array) -> None:
    n = matrix.shape[0]
    last = np.arange(0, n, 4)
    factor = CondensedFactor(matrix, last)
    dense = matrix.toarray()
    np.testing.assert_allclose(factor.schur_inverse, np.linalg.inv(dense)[np.ix_(last, last)], atol=1e-9)
    np.testing.assert_allclose(factor.schur @ factor.schur_inverse, np.eye(len(last)), atol=1e-11)
    np.testing.assert_array_equal(factor.schur, factor.schur.T)
    np.testing.assert_array_equal(factor.schur_inverse, factor.schur_inverse.T)


@pytest.mark.usefixtures("response")
def test_interface_loads_reach_the_interior(matrix: sp.csr_array) -> None:
    """One forward sweep without the interface force g, one backward sweep with it, is the solve with it."""
    n = matrix.shape[0]
    last = np.arange(3, n, 5)
    factor = CondensedFactor(matrix, last)
    rng = np.random.default_rng(2)
    b, g = rng.normal(size=(n, 1)), rng.normal(size=(len(last), 1))
    y, c = factor.forward(b)
    loaded = b.copy()
    loaded[last] += g
    np.testing.assert_allclose(factor.backward(y, factor.schur_inverse @ (c + g)), factor.solve(loaded), atol=1e-11)


@pytest.mark.usefixtures("response")
def test_arguments_are_unchanged(matrix: sp.csr_array) -> None:
    n = matrix.shape[0]
    last = np.arange(0, n, 7)
    before = matrix.copy()
    factor = CondensedFactor(matrix, last)
    b = np.ones((n, 2))
    factor.solve(b)
    np.testing.assert_array_equal(b, 1.0)
    assert abs(matrix - before).max() == 0.0
