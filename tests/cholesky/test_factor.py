"""Supernodal Cholesky factor with the interface last, against dense and sparse solves of NumPy and SciPy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from latin_fmu.cholesky.factor import CholeskyFactor, InsideFactor
from latin_fmu.cholesky.symbolic import analyse
from latin_fmu.errors import LatinError, SolverError
from latin_fmu.fem.dissection import dissection, nested_dissection
from latin_fmu.fem.elasticity import Isotropic
from latin_fmu.fem.elements import Elements, mass, stiffness
from latin_fmu.fem.faces import face
from latin_fmu.fem.mesh import box_mesh

Array = NDArray[np.float64]
Index = NDArray[np.int64]


def body(elements: tuple[int, int, int]) -> tuple[sp.csr_array, Array]:
    """Operator M + c K of a box (some dofs held) and the nested dissection rank of its dofs."""
    mesh = box_mesh(np.zeros(3), np.asarray(elements, dtype=float), elements)
    basis = Elements(mesh)
    kept = np.ones(3 * mesh.n_node, dtype=bool)
    kept[3 * face(mesh, "xmin").nodes] = False
    kept = np.flatnonzero(kept)
    a = sp.csr_array(mass(basis, 1.0) + 0.4 * stiffness(basis, Isotropic(1.0, 1.0, 0.3)))
    return sp.csr_array(a[kept][:, kept]), np.repeat(nested_dissection(mesh), 3)[kept]


def scattered(n: int, density: float, seed: int) -> sp.csr_array:
    """Random symmetric positive definite matrix."""
    rng = np.random.default_rng(seed)
    half = sp.random_array((n, n), density=density, rng=rng, data_sampler=lambda size: rng.normal(size=size))
    both = half + half.T
    return sp.csr_array(both + sp.diags_array(1.0 + abs(both).sum(axis=1)))


def assert_factor(matrix: sp.csr_array, last: Index, factor: Any, tolerance: float = 1e-12) -> None:
    """Everything the factor offers against dense algebra, for 1, 2 and 7 members."""
    dense = matrix.toarray()
    n = len(dense)
    inside = np.setdiff1d(np.arange(n), last)
    np.testing.assert_array_equal(np.sort(factor.interior), inside)
    np.testing.assert_array_equal(factor.last, last)
    to_last = dense[np.ix_(inside, last)]
    schur = dense[np.ix_(last, last)] - to_last.T @ np.linalg.solve(dense[np.ix_(inside, inside)], to_last)
    if len(last):
        scale = np.abs(schur).max()
        np.testing.assert_allclose(factor.schur, schur, atol=1e-12 * scale)
        np.testing.assert_allclose(factor.schur_inverse @ schur, np.eye(len(last)), atol=1e-10)
    np.testing.assert_array_equal(factor.schur, factor.schur.T)
    np.testing.assert_array_equal(factor.schur_inverse, factor.schur_inverse.T)
    rng = np.random.default_rng(5)
    for m in (1, 2, 7):
        b, g = rng.normal(size=(n, m)), rng.normal(size=(len(last), m))
        kept = b.copy()
        loaded = b.copy()
        loaded[last] += g
        y, c = factor.forward(b)
        y_before = y.copy()
        x = factor.backward(y, factor.schur_inverse @ (c + g))
        expected = np.linalg.solve(dense, loaded)
        assert x.shape == (n, m)
        assert c.shape == (len(last), m)
        assert c.dtype == x.dtype == np.float64
        np.testing.assert_allclose(x, expected, atol=tolerance * np.abs(expected).max())
        np.testing.assert_allclose(factor.solve(loaded), expected, atol=tolerance * np.abs(expected).max())
        np.testing.assert_array_equal(b, kept)
        np.testing.assert_array_equal(y, y_before)


@pytest.mark.parametrize("ranked", [False, True], ids=["own_order", "given_order"])
@pytest.mark.parametrize("n_last", [0, 1, 17, 80, 119, 120])
@pytest.mark.parametrize("density", [0.0, 0.004, 0.03, 0.5])
def test_random_matrices(density: float, n_last: int, ranked: bool) -> None:
    """From a diagonal to nearly full, from no interface to nothing else; sparse ones fall into many pieces."""
    matrix = scattered(120, density, seed=n_last)
    rng = np.random.default_rng(n_last)
    last = np.sort(rng.permutation(120)[:n_last])
    rank = rng.permutation(120).astype(float) if ranked else None
    assert_factor(matrix, last, CholeskyFactor(matrix, last, rank))


@pytest.mark.parametrize("ranked", [False, True], ids=["own_order", "given_order"])
@pytest.mark.parametrize("elements", [(1, 1, 1), (1, 1, 30), (4, 3, 5), (6, 6, 6)], ids=str)
@pytest.mark.parametrize("interface", ["none", "node", "dof", "top", "two_faces", "all"])
def test_bodies(elements: tuple[int, int, int], interface: str, ranked: bool) -> None:
    matrix, rank = body(elements)
    n = matrix.shape[0]
    layer = 3 * (elements[0] + 1) * (elements[1] + 1) - (elements[1] + 1)
    last = {
        "none": np.arange(0),
        "node": np.arange(n - 3, n),
        "dof": np.array([n // 2]),
        "top": np.arange(n - layer, n),
        "two_faces": np.r_[0:layer, n - layer : n],
        "all": np.arange(n),
    }[interface]
    assert_factor(matrix, last, CholeskyFactor(matrix, last, rank if ranked else None))


@pytest.mark.parametrize("m", [1, 8, 40])
@pytest.mark.parametrize("ranked", [False, True], ids=["own_order", "given_order"])
def test_an_interface_that_is_held(m: int, ranked: bool) -> None:
    """The inside alone, column by column, in tiles and by matrix products; S of a body that nothing else holds is
    singular, which no inverse of it is needed for."""
    matrix, rank = body((3, 4, 5))
    n = matrix.shape[0]
    inside, last = np.arange(n - 30), np.arange(n - 30, n)
    coupling = matrix[inside][:, last].toarray()
    condensed = coupling.T @ np.linalg.solve(matrix[inside][:, inside].toarray(), coupling)
    singular = matrix.tolil()
    singular[np.ix_(last, last)] = condensed
    factor = InsideFactor(sp.csr_array(singular.tocsr()), last, rank if ranked else None)
    assert np.abs(factor.schur).max() < 1e-12 * np.abs(condensed).max()
    load = np.random.default_rng(m).normal(size=(n, m))
    expected = np.zeros((n, m))
    expected[inside] = np.linalg.solve(matrix[inside][:, inside].toarray(), load[inside])
    np.testing.assert_allclose(factor.held_solve(load), expected, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("ranked", [False, True], ids=["own_order", "given_order"])
@pytest.mark.parametrize("n_last", [0, 30])
def test_numbers_of_the_factor_are_those_of_dense_cholesky(n_last: int, ranked: bool) -> None:
    """L, written out from the panels, and the factor of the Schur complement."""
    matrix, rank = body((3, 4, 5))
    n = matrix.shape[0]
    last = np.arange(n - n_last, n)
    factor = CholeskyFactor(matrix, last, rank if ranked else None)
    shape, lower = factor.symbolic, np.zeros((n, n))
    for s in range(len(shape.first) - 1):
        columns = np.arange(shape.first[s], shape.first[s + 1])
        rows = shape.rows[shape.row_start[s] : shape.row_start[s + 1]]
        panel = factor.panels[shape.panel_start[s] : shape.panel_start[s + 1]].reshape(-1, len(columns))
        lower[np.ix_(columns, columns)] = np.linalg.inv(panel[: len(columns)])
        lower[np.ix_(rows, columns)] = panel[len(columns) :]
    lower[shape.n_interior :, shape.n_interior :] = np.linalg.cholesky(factor.schur) if n_last else 0.0
    expected = np.linalg.cholesky(matrix.toarray()[np.ix_(shape.order, shape.order)])
    np.testing.assert_allclose(lower, expected, atol=1e-13 * np.abs(expected).max())


def test_disconnected_parts_only_one_of_which_has_the_interface() -> None:
    one, rank = body((2, 2, 3))
    matrix = sp.csr_array(sp.block_diag([one, one, sp.diags_array(np.arange(1.0, 5.0)), one]))
    last = np.arange(4, 20)
    n = one.shape[0]
    assert_factor(matrix, last, CholeskyFactor(matrix, last, np.concatenate([rank, rank, np.zeros(4), rank + n])))
    assert_factor(matrix, last, CholeskyFactor(matrix, last))


def test_entries_that_happen_to_be_zero_may_be_missing_on_one_side() -> None:
    matrix, rank = body((3, 3, 3))
    coo = matrix.tocoo()
    rows, columns = coo.coords
    tiny = (np.abs(coo.data) < 0.05) & (rows != columns)
    dense = matrix.toarray()
    dense[rows[tiny], columns[tiny]] = 0.0
    gone = tiny & (rows < columns)
    assert gone.sum() > 100
    data = np.where(tiny, 0.0, coo.data)[~gone]
    lopsided = sp.csr_array((data, (rows[~gone], columns[~gone])), shape=matrix.shape)
    lopsided += sp.eye_array(len(dense), format="csr")
    last = np.arange(7, 30)
    for order in (rank, None):
        assert_factor(lopsided, last, CholeskyFactor(lopsided, last, order))


def test_ill_conditioned_matrix_has_a_small_residual() -> None:
    matrix, rank = body((4, 4, 6))
    scale = np.random.default_rng(3).uniform(-4, 4, matrix.shape[0])
    grown = sp.diags_array(10.0**scale)
    matrix = sp.csr_array(grown @ matrix @ grown)
    last = np.arange(60, 90)
    b = matrix @ np.ones((matrix.shape[0], 1))
    x = CholeskyFactor(matrix, last, rank).solve(b)
    backward_error = np.abs(b - matrix @ x) / (abs(matrix) @ np.abs(x))
    assert backward_error.max() < 1e-13


@pytest.mark.parametrize("m", [1, 3, 16])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_repeat_runs_are_bit_identical(m: int, dtype: type) -> None:
    matrix, rank = body((6, 5, 7))
    last = np.arange(50, 99)
    b = np.random.default_rng(0).normal(size=(matrix.shape[0], m))
    results = []
    for _ in range(3):
        factor = CholeskyFactor(matrix, last, rank, dtype)
        shifted = np.empty(b.size + 1)[1:].reshape(b.shape)  # elsewhere in memory
        shifted[:] = b
        results += [np.concatenate([factor.solve(b), factor.solve(shifted)]), factor.schur, factor.schur_inverse]
    for first, again in zip(results[:3] * 2, results[3:], strict=True):
        np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(*np.split(results[0], 2))


@pytest.mark.parametrize("m", [1, 4])
def test_views_and_other_memory_orders(m: int) -> None:
    matrix, rank = body((3, 3, 3))
    last = np.arange(10, 22)
    factor = CholeskyFactor(matrix, last, rank)
    wide = np.random.default_rng(0).normal(size=(matrix.shape[0], 2 * m))
    expected = factor.solve(np.ascontiguousarray(wide[:, ::2]))
    np.testing.assert_array_equal(factor.solve(wide[:, ::2]), expected)
    np.testing.assert_array_equal(factor.solve(np.asfortranarray(wide[:, ::2])), expected)


@pytest.mark.parametrize("m", [1, 5])
def test_float32_storage(m: int) -> None:
    matrix, rank = body((6, 6, 6))
    last = np.arange(100, 200)
    exact = CholeskyFactor(matrix, last, rank)
    stored = CholeskyFactor(matrix, last, rank, np.float32)
    b = np.random.default_rng(0).normal(size=(matrix.shape[0], m))
    x, y = exact.solve(b), stored.solve(b)
    assert y.dtype == np.float64
    error = np.abs(x - y).max() / np.abs(x).max()
    assert 1e-10 < error < 2e-6
    np.testing.assert_array_equal(stored.schur, exact.schur)
    assert stored.panels.nbytes == 0.5 * exact.panels.nbytes


def test_other_storage_is_refused() -> None:
    with pytest.raises(ValueError, match="float64, float32"):
        CholeskyFactor(scattered(5, 0.1, 0), np.arange(1), dtype=np.int32)


def test_analysis_serves_matrices_of_one_pattern() -> None:
    matrix, rank = body((3, 3, 4))
    last = np.arange(0, 21)
    symbolic = analyse(matrix, last, rank)
    for shift in (0.0, 3.0):
        moved = sp.csr_array(matrix + shift * sp.eye_array(matrix.shape[0]))
        assert_factor(moved, last, CholeskyFactor(moved, last, symbolic=symbolic))
    full = sp.csr_array(np.eye(matrix.shape[0]) + 1e-3)
    with pytest.raises(SolverError, match="outside the pattern"):
        CholeskyFactor(full, last, symbolic=symbolic)


@pytest.mark.parametrize("where", [5, 140, 199])
@pytest.mark.parametrize("ranked", [False, True])
def test_pivot_that_is_not_positive_is_named(where: int, ranked: bool) -> None:
    matrix = scattered(200, 0.02, 1).tolil()
    matrix[where, :] = 0.0
    matrix[:, where] = 0.0
    matrix[where, where] = -1.0
    rank = np.random.default_rng(0).permutation(200).astype(float) if ranked else None
    with pytest.raises(LatinError, match=f"pivot of dof {where} is not positive"):
        CholeskyFactor(sp.csr_array(matrix), np.arange(120, 200), rank)


def test_semidefinite_matrix_is_refused() -> None:
    """A graph Laplacian less a little: the last pivot of the interface is negative."""
    n = 40
    chain = sp.diags_array([-np.ones(n - 1), np.r_[1.0, 2 * np.ones(n - 2), 1.0], -np.ones(n - 1)], offsets=[-1, 0, 1])
    with pytest.raises(SolverError, match=r"pivot of dof \d+ is not positive"):
        CholeskyFactor(sp.csr_array(chain - 1e-6 * sp.eye_array(n)), np.array([3, 20]))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_entries_that_are_no_numbers_are_refused(value: float) -> None:
    matrix = scattered(20, 0.1, 0)
    matrix[7, 7] = value
    with pytest.raises(SolverError, match=r"row of dof 7"):
        CholeskyFactor(matrix, np.arange(3))


def test_large_body_against_scipy() -> None:
    matrix, rank = body((10, 9, 8))
    last = np.arange(matrix.shape[0] - 200, matrix.shape[0])
    b = np.random.default_rng(0).normal(size=(matrix.shape[0], 1))
    factor = CholeskyFactor(matrix, last, rank)
    np.testing.assert_allclose(factor.solve(b)[:, 0], spla.spsolve(matrix.tocsc(), b[:, 0]), atol=1e-12)


def test_rows_in_groups_or_one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Factors beyond the cache are read row by row: same result."""
    matrix, rank = body((3, 4, 5))
    last = np.arange(20, 50)
    grouped = CholeskyFactor(matrix, last, rank)
    monkeypatch.setattr("latin_fmu.cholesky.factor._CACHE", 0)
    single = CholeskyFactor(matrix, last, rank)
    assert grouped.grouped
    assert not single.grouped
    assert_factor(matrix, last, single)


@pytest.mark.parametrize("m", [1, 3])
def test_wrong_sizes_are_refused(m: int) -> None:
    factor = CholeskyFactor(scattered(30, 0.1, 0), np.arange(5))
    with pytest.raises(ValueError, match="b has 29 rows; allowed: 30"):
        factor.forward(np.ones((29, m)))
    with pytest.raises(ValueError, match="x_last has 4 rows; allowed: 5"):
        factor.backward(np.ones((25, m)), np.ones((4, m)))
    with pytest.raises(ValueError, match="y has 30 rows; allowed: 25"):
        factor.backward(np.ones((30, m)), np.ones((5, m)))


def on_face(elements: tuple[int, int, int], name: str) -> tuple[sp.csr_array, Index, Array]:
    """Operator M + c K of a box, dofs of a face, and the elimination order with the face last in every part."""
    mesh = box_mesh(np.zeros(3), np.asarray(elements, dtype=float), elements)
    matrix = sp.csr_array(mass(Elements(mesh), 1.0) + 0.4 * stiffness(Elements(mesh), Isotropic(1.0, 1.0, 0.3)))
    nodes = np.unique(np.concatenate([face(mesh, part).nodes for part in name.split("+")]))
    rank, parts = dissection(mesh)
    late = np.isin(np.arange(mesh.n_node), nodes)
    order = np.empty(mesh.n_node)
    order[np.lexsort((rank, late, parts))] = np.arange(mesh.n_node)
    return matrix, np.sort((3 * nodes[:, None] + np.arange(3)).ravel()), np.repeat(order, 3)


NONE = np.zeros(0, dtype=np.int64)


@pytest.mark.parametrize("name", ["zmin", "zmax", "xmin", "zmin+xmax"])
@pytest.mark.parametrize(("kind", "close"), [(np.float64, 1e-13), (np.float32, 1e-5)], ids=["float64", "float32"])
def test_solutions_on_a_face(name: str, kind: type, close: float) -> None:
    """Loads and values on the face alone, through a part of the factor, against all of it; and its diagonal blocks."""
    matrix, dofs, rank = on_face((7, 6, 4), name)
    factor = CholeskyFactor(matrix, NONE, rank, kind, face=dofs)
    assert factor.symbolic.face_entries < 0.9 * factor.panels.size
    load = np.random.default_rng(3).normal(size=(len(dofs), 30))
    for m in (1, 2, 3, 11, 30):
        whole = np.zeros((matrix.shape[0], m))
        whole[dofs] = load[:, :m]
        expected = factor.solve(whole)[dofs]
        assert np.abs(factor.face_solve(load[:, :m]) - expected).max() <= 1e-13 * np.abs(expected).max()
    unit = sp.csr_array(np.isin(np.arange(matrix.shape[0]), dofs)[:, None] * matrix.toarray())
    pattern = sp.csr_array(unit[:, dofs] @ sp.csr_array(np.eye(matrix.shape[0])[dofs]))
    inverse = np.linalg.inv(matrix.toarray())
    entries = factor.face_inverse(pattern).tocoo()
    assert entries.nnz > 3 * len(dofs)
    wanted = inverse[entries.coords[0], entries.coords[1]]
    assert np.abs(entries.data - wanted).max() <= close * np.abs(inverse).max()


def test_a_face_without_an_order_of_its_own() -> None:
    """Minimum degree, dofs without neighbours, and no face at all."""
    matrix = scattered(120, 0.03, seed=4)
    dofs = np.array([0, 5, 6, 50, 119])
    factor = CholeskyFactor(matrix, NONE, face=dofs)
    load = np.random.default_rng(1).normal(size=(5, 2))
    expected = np.linalg.inv(matrix.toarray())[np.ix_(dofs, dofs)] @ load
    np.testing.assert_allclose(factor.face_solve(load), expected, atol=1e-13)
    assert CholeskyFactor(matrix, NONE).symbolic.face_entries == 0
