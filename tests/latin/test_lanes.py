"""Products on eight members at once against those of NumPy and the sweeps of the factor."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from latin_fmu.compiled import COMPILES

if not COMPILES:
    pytest.skip("the march is compiled", allow_module_level=True)

from latin_fmu.march.lanes import (
    LANES,
    SPARE,
    backward_tile,
    dense_product,
    forward_tile,
    gather,
    padded,
    sparse_product,
)  # fmt: skip
from latin_fmu.propagator.cholesky.factor import CholeskyFactor

MEMBERS = [3, 7, 8, 9, 17]
RNG = np.random.default_rng(7)


def definite(n: int) -> sp.csr_array:
    half = sp.random_array((n, n), density=0.08, rng=RNG)
    return sp.csr_array(half + half.T + 20.0 * sp.eye_array(n))


@pytest.mark.parametrize("m", MEMBERS)
def test_sparse_product(m: int) -> None:
    matrix = definite(41)
    x, out = RNG.normal(size=(2, 41, m))
    expected = out - 0.5 * (matrix @ x)
    columns, values = matrix.indices.astype(np.uint32), matrix.data
    sparse_product(
        41, matrix.indptr.astype(np.int64), columns.ctypes.data, values.ctypes.data, -0.5, m, x.ravel(),
        out.reshape(-1), np.full((41 + SPARE) * LANES, np.nan),
    )  # fmt: skip
    np.testing.assert_allclose(out, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("n", [1, 4, 30])
@pytest.mark.parametrize("m", MEMBERS)
def test_dense_product(m: int, n: int) -> None:
    matrix, x = RNG.normal(size=(n, n)), RNG.normal(size=(n, m))
    out = np.full((n, m), np.nan)
    dense_product(n, matrix.ctypes.data, m, x.ravel(), out.reshape(-1), np.full((n + SPARE) * LANES, np.nan))
    np.testing.assert_allclose(out, matrix @ x, rtol=0, atol=1e-13 * n)


@pytest.mark.parametrize("m", MEMBERS)
def test_half_solves(m: int) -> None:
    """Forward and backward in tiles, against the same factor on one member after the other."""
    matrix, last = definite(60), np.array([3, 17, 44, 59])
    factor = CholeskyFactor(matrix, last)
    shape, loads, ends = factor.symbolic, RNG.normal(size=(60, m)), RNG.normal(size=(4, m))
    pattern = (shape.first, shape.row_start, shape.rows, shape.panel_start)
    spare, out = np.full(SPARE * LANES, np.nan), np.full((60, m), np.nan)
    for start in range(0, padded(m), LANES):
        tile, lanes = np.full((60, LANES), np.nan), min(m - start, LANES)
        gather(60, m, start, shape.order, loads.ravel(), tile.reshape(-1))
        assert not tile[:, lanes:].any()
        forward_tile(*pattern, factor.panels.ctypes.data, tile.reshape(-1), spare)
        for j in range(lanes):
            y, reached = factor.forward(np.ascontiguousarray(loads[:, start + j : start + j + 1]))
            np.testing.assert_allclose(
                tile[:, j], np.concatenate([y[:56, 0], reached[:, 0]]), rtol=0, atol=1e-13
            )
        tile[56:, :lanes] = ends[:, start : start + lanes]
        backward_tile(*pattern, factor.panels.ctypes.data, tile.reshape(-1), spare)
        out[shape.order, start : start + lanes] = tile[:, :lanes]
    # with the whole matrix: the inside is in equilibrium with the loads and the values at the interface
    inside = np.setdiff1d(np.arange(60), last)
    np.testing.assert_array_equal(out[last], ends)
    np.testing.assert_allclose((matrix @ out)[inside], loads[inside], rtol=0, atol=1e-11)
