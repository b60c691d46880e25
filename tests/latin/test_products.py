"""Products of the kernels against NumPy: eight members at once, packed triangles, compressed rows; half solves."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import scipy.sparse as sp

from latin_fmu.cholesky import substitution as sweeps
from latin_fmu.cholesky.factor import CholeskyFactor
from latin_fmu.cholesky.substitution import LANES, SPARE, TILED
from latin_fmu.kernels import products
from latin_fmu.propagator.class_record import BlockLayout, put_dense, put_symmetric
from tests.plain_kernels import in_python

MEMBERS = [1, 2, 3, 7, 8, 9, 17]
RNG = np.random.default_rng(7)


@pytest.fixture(autouse=True)
def every_kernel_in_python() -> Iterator[None]:
    """Lets kernels call each other in Python; the entries of the library are compared with theirs elsewhere."""
    with in_python():
        yield


def definite(n: int) -> sp.csr_array:
    half = sp.random_array((n, n), density=0.08, rng=RNG)
    return sp.csr_array(half + half.T + 20.0 * sp.eye_array(n))


def scratch(n: int) -> np.ndarray:
    return np.full((n + SPARE) * LANES, np.nan)


def written(block: BlockLayout) -> np.ndarray:
    """Numbers of a block, NaN where nothing was put."""
    data = np.full(block.size, np.nan)
    block.fill(data)
    return data


def packed(matrix: np.ndarray, m: int, diagonal: bool, single: bool = False) -> np.ndarray:
    """A whole symmetric matrix as it lies in the fixed block."""
    block = BlockLayout(8)
    at = put_dense(block, matrix, [np.arange(len(matrix))], m, diagonal, single)
    data = written(block)
    return data.view(np.float32)[at:] if single else data[at:]


@pytest.mark.parametrize("m", MEMBERS)
def test_symmetric_sparse_product(m: int) -> None:
    """Strict lower triangle and diagonal below TILED members, whole rows from there on."""
    matrix = definite(41)
    x, out = RNG.normal(size=(2, 41, m))
    expected = out - 0.5 * (matrix @ x)
    block, row = BlockLayout(), {"m": m, "n_piece": 0}
    put_symmetric(block, row, "a", matrix, {})
    data = written(block)
    form = data.view(np.int64)[row["a_starts"] :], data.view(np.uint32)[row["a_columns"] :], data[row["a_values"] :]
    if m >= TILED:
        products.sparse_product(41, *form, -0.5, m, x.ravel(), out.reshape(-1), scratch(41))
        np.testing.assert_allclose(out, expected, rtol=0, atol=1e-12)
        return
    lower = data[row["a_diagonal"] :], data.view(np.uint32)[row["a_together"] :]
    for j in range(m):
        total = out[:, j].copy()
        products.half_product(0, 41, *lower, *form, -0.5, x[:, j].copy(), total)
        np.testing.assert_allclose(total, expected[:, j], rtol=0, atol=1e-12)


@pytest.mark.parametrize(("low", "high"), [(0, 26), (0, 9), (4, 17), (11, 26), (25, 26)])
def test_rows_of_a_node_are_taken_together(low: int, high: int) -> None:
    """Full blocks between nodes of one to four unknowns: the rows from ``low`` to ``high`` and their reflections, to
    the same bits as one after the other."""
    sizes = np.array([3, 1, 2, 4, 3, 3, 2, 3, 1, 4])
    nodes = np.kron(RNG.random((10, 10)) < 0.5, [[1.0]]) + np.eye(10)
    matrix = np.repeat(np.repeat(nodes + nodes.T > 0, sizes, axis=0), sizes, axis=1) * RNG.normal(size=(26, 26))
    a = sp.csr_array(np.tril(matrix) + np.tril(matrix, -1).T)
    block, row = BlockLayout(), {"m": 1, "n_piece": 0}
    put_symmetric(block, row, "a", a, {})
    data = written(block)
    form = data.view(np.int64)[row["a_starts"] :], data.view(np.uint32)[row["a_columns"] :], data[row["a_values"] :]
    diagonal, together = data[row["a_diagonal"] :], data.view(np.uint32)[row["a_together"] :][:26]
    first = np.cumsum(sizes) - sizes
    assert (together[first] >= np.minimum(sizes, 3)).all()
    assert together.max() == 3
    x, start = RNG.normal(size=(2, 26))
    out, one_by_one = start.copy(), start.copy()
    products.half_product(low, high, diagonal, together, *form, 0.7, x, out)
    products.half_product(low, high, diagonal, np.ones_like(together), *form, 0.7, x, one_by_one)
    np.testing.assert_array_equal(out, one_by_one)
    rows = np.zeros((26, 26))
    rows[low:high] = np.tril(a.toarray())[low:high]
    expected = start + 0.7 * ((rows + rows.T - np.diag(rows.diagonal())) @ x)
    np.testing.assert_allclose(out, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("n", [1, 2, 4, 5, 30])
@pytest.mark.parametrize("m", MEMBERS)
def test_symmetric_dense_product(m: int, n: int) -> None:
    matrix, x = definite(n).toarray() + 1.0, RNG.normal(size=(n, m))
    kept = packed(matrix, m, False)
    assert len(kept) >= products.symmetric_size(n, 0, m)
    out = np.full((n, m), np.nan)
    if m != 1:
        products.product(n, kept, 0, m, x.ravel(), out.reshape(-1), scratch(n))
    else:
        out[:] = 0.0
        products.product(n, kept, 0, m, x.ravel(), out.reshape(-1), scratch(n))
    np.testing.assert_allclose(out, matrix @ x, rtol=0, atol=1e-11)
    diagonal = packed(matrix, m, True)
    assert len(diagonal) >= products.symmetric_size(n, 1, m)
    products.product(n, diagonal, 1, m, x.ravel(), out.reshape(-1), scratch(n))
    np.testing.assert_allclose(out, np.diag(matrix)[:, None] * x, rtol=1e-14)


@pytest.mark.parametrize("n", [1, 2, 5, 30])
def test_large_tables_in_single_precision(n: int) -> None:
    """Rounded entries, sums in double precision: products and norms with the rounded matrix are those of NumPy."""
    matrix, x = definite(n).toarray() + 0.3, RNG.normal(size=(2, n))
    kept, rounded = packed(matrix, 1, False, True), matrix.astype(np.float32).astype(float)
    assert kept.dtype == np.float32
    assert np.abs(rounded - matrix).max() > 0.0
    out = np.zeros(n)
    products.packed_product(n, kept, x[0], out)
    np.testing.assert_allclose(out, rounded @ x[0], rtol=0, atol=1e-12)
    actual = products.two_norms(n, kept, x.ravel())
    np.testing.assert_allclose(actual[:2], np.einsum("ij,jk,ik->i", x, rounded, x), rtol=1e-13)


@pytest.mark.parametrize("n", [1, 2, 7])
def test_two_norms(n: int) -> None:
    matrix, x = definite(n).toarray() + 0.3, RNG.normal(size=(2, n))
    actual = products.two_norms(n, matrix[np.tril_indices(n)], x.ravel())
    np.testing.assert_allclose(actual[:2], np.einsum("ij,jk,ik->i", x, matrix, x), rtol=1e-13)
    assert actual[2] == pytest.approx(x[1] @ matrix @ x[0], rel=1e-13)


@pytest.mark.parametrize("m", [1, 2, 3, 8])
def test_products_of_rows(m: int) -> None:
    a = sp.csr_array(sp.random_array((13, 19), density=0.3, rng=RNG))
    form = a.indptr.astype(np.int64), a.indices.astype(np.uint32), a.data
    x = RNG.normal(size=(19, m))
    out, dense = np.ones((13, m)), np.ones((13, m))
    products.add_rows(13, *form, 0.7, m, x.ravel(), out.reshape(-1))
    table = a.toarray().ravel()
    if m == 1:
        products.add_dense(13, 19, table, x.ravel(), dense.reshape(-1))
    else:
        products.add_dense_members(13, 19, table, m, x.ravel(), dense.reshape(-1), np.full((19 + 4) * 8, np.nan))
    np.testing.assert_allclose(out, 1.0 + 0.7 * (a @ x), rtol=0, atol=1e-13)
    np.testing.assert_allclose(dense, 1.0 + a @ x, rtol=0, atol=1e-13)


def test_patterns_times_amplitudes() -> None:
    patterns = RNG.normal(size=(3, 11)) * (RNG.random((3, 11)) < 0.5)
    rows = [np.flatnonzero(p) for p in patterns]
    starts = np.cumsum([0, *map(len, rows)])
    amplitudes, out = np.array([2.0, 0.0, -1.5]), np.ones(11)
    values = np.concatenate([p[r] for p, r in zip(patterns, rows, strict=True)])
    products.add_terms(3, starts, np.concatenate(rows), values, amplitudes, 0.5, out)
    np.testing.assert_allclose(out, 1.0 + 0.5 * amplitudes @ patterns, rtol=0, atol=1e-14)


@pytest.mark.parametrize("single", [False, True], ids=["float64", "float32"])
@pytest.mark.parametrize("m", [1, 3, 7, 8, 9, 17])
def test_half_solves(m: int, single: bool) -> None:
    """Forward and backward in tiles, against the same factor on one member after the other."""
    matrix, last = definite(60), np.array([3, 17, 44, 59])
    factor = CholeskyFactor(matrix, last)
    shape, loads, ends = factor.symbolic, RNG.normal(size=(60, m)), RNG.normal(size=(4, m))
    pattern = (True, shape.first, shape.row_start, shape.rows, shape.panel_start, shape.face_start)
    panels = factor.panels.astype(np.float32) if single else factor.panels
    close = 1e-5 if single else 1e-13
    spare, out = np.full(SPARE * LANES, np.nan), np.full((60, m), np.nan)
    for start in range(0, m, LANES):
        tile, count = np.full((60, LANES), np.nan), min(m - start, LANES)
        products.gather(60, m, start, loads[shape.order].ravel(), tile.reshape(-1))
        assert not tile[:, count:].any()
        sweeps.forward_tile(*pattern, panels, tile.reshape(-1), spare)
        for j in range(count):
            y, reached = factor.forward(np.ascontiguousarray(loads[:, start + j : start + j + 1]))
            np.testing.assert_allclose(tile[:, j], np.concatenate([y[:56, 0], reached[:, 0]]), rtol=0, atol=close)
            for grouped in (False, True):
                alone = loads[shape.order, start + j].copy()
                sweeps.forward_one(grouped, *pattern, panels, alone)
                np.testing.assert_allclose(alone, tile[:, j], rtol=0, atol=1e-13)
        tile[56:, :count] = ends[:, start : start + count]
        halves = tile.copy()
        sweeps.backward_tile(*pattern, panels, tile.reshape(-1), spare)
        for j in range(count):
            alone = np.ascontiguousarray(halves[:, j])
            sweeps.backward_one(False, *pattern, panels, alone)
            np.testing.assert_allclose(alone, tile[:, j], rtol=0, atol=1e-13)
        out[shape.order, start : start + count] = tile[:, :count]
    # with the whole matrix: the inside is in equilibrium with the loads and the values at the interface
    inside = np.setdiff1d(np.arange(60), last)
    np.testing.assert_array_equal(out[last], ends)
    np.testing.assert_allclose((matrix @ out)[inside], loads[inside], rtol=0, atol=1e-3 if single else 1e-11)


@pytest.mark.parametrize("m", range(1, 20))
def test_width_of_tiles(m: int) -> None:
    padded = products.padded(m)
    assert padded >= m
    assert padded == m or (m >= TILED and padded % LANES == 0 and padded < m + LANES)
