"""The sparse Cholesky factorisation of ``latin_fmu.cholesky`` against SuperLU (``scipy.sparse.linalg.splu``).

Discrete Laplacians on squares and cubes and elastic blocks of 8-node hexahedra (M + c K, as a march factorises them).
CPU times of one thread, median of several; the residual is |b - A x| / (|A| |x| + |b|) in the maximum norm. SuperLU
orders by minimum degree on A^T + A in its symmetric mode, the best of its settings here.

    python examples/benchmark_cholesky.py [--quick]
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from statistics import median
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from latin_fmu.cholesky.factor import CholeskyFactor
from latin_fmu.cholesky.symbolic import analyse
from latin_fmu.fem.dissection import nested_dissection
from latin_fmu.fem.elements import Elements, mass, stiffness
from latin_fmu.fem.mesh import box_mesh
from latin_fmu.machine import one_thread

Array = NDArray[np.float64]
Case = tuple[str, sp.csr_array, "Array | None"]
NOTHING = np.zeros(0, dtype=np.int64)  # no dofs are kept for an interface


def laplacian(*cells: int) -> sp.csr_array:
    """Five- or seven-point Laplacian on a grid, values zero all around."""
    total = sp.csr_array((1, 1))
    for n in cells:
        line = sp.diags_array([-np.ones(n - 1), 2.0 * np.ones(n), -np.ones(n - 1)], offsets=[-1, 0, 1])
        total = sp.kron(total, sp.eye_array(n)) + sp.kron(sp.eye_array(total.shape[0]), line)
    return sp.csr_array(total)


def block(n: int) -> tuple[sp.csr_array, Array]:
    """Operator M + 0.4 K of a cube of n^3 hexahedra, and the nested dissection of its nodes."""
    mesh = box_mesh(np.zeros(3), np.full(3, float(n)), (n, n, n))
    basis = Elements(mesh)
    return sp.csr_array(mass(basis, 1.0) + 0.4 * stiffness(basis, 1.0, 0.3)), np.repeat(nested_dissection(mesh), 3)


def cases(quick: bool) -> list[Case]:
    """Names, matrices and elimination orders (None: minimum degree)."""
    squares, cubes, blocks = ((40,), (8,), (4,)) if quick else ((100, 300), (20, 32), (8, 14))
    return [
        *((f"Laplacian {n} x {n}", laplacian(n, n), None) for n in squares),
        *((f"Laplacian {n} x {n} x {n}", laplacian(n, n, n), None) for n in cubes),
        *((f"elastic block {n} x {n} x {n}", *block(n)) for n in blocks),
    ]


def seconds(call: Callable[[], Any], repeats: int) -> tuple[float, Any]:
    """Median CPU time of a call and its last result."""
    times: list[float] = []
    result = None
    for _ in range(repeats):
        begin = time.process_time()
        result = call()
        times.append(time.process_time() - begin)
    return median(times), result


def residual(matrix: sp.csr_array, x: Array, b: Array) -> float:
    """Backward error of a solution."""
    size = float(abs(matrix).sum(axis=1).max())
    return float(np.abs(b - matrix @ x).max() / (size * np.abs(x).max() + np.abs(b).max()))


def measured(matrix: sp.csr_array, rank: Array | None, repeats: int) -> dict[str, tuple[float, ...]]:
    """Times to analyse, factorise and solve, entries of the factor and residual, of both."""
    b = np.cos(np.arange(matrix.shape[0]))[:, None]
    first, symbolic = seconds(lambda: analyse(matrix, NOTHING, rank), repeats)
    factorised, factor = seconds(lambda: CholeskyFactor(matrix, NOTHING, symbolic=symbolic), repeats)
    solved, x = seconds(lambda: factor.solve(b), repeats)
    own = (first, factorised, solved, float(factor.panels.size), residual(matrix, x, b))
    columns = sp.csc_matrix(matrix)

    def superlu() -> spla.SuperLU:
        options = {"SymmetricMode": True}
        return spla.splu(columns, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)

    factorised, other = seconds(superlu, repeats)
    solved, x = seconds(lambda: other.solve(b), repeats)
    return {"Cholesky": own, "SuperLU": (0.0, factorised, solved, float(other.L.nnz), residual(matrix, x, b))}


def main() -> None:
    """Print one table for all cases."""
    quick = "--quick" in sys.argv
    print(f"{'':32}{'unknowns':>9}{'analysis':>10}{'factor':>10}{'solve':>10}{'entries':>11}{'residual':>10}")
    for name, matrix, rank in cases(quick):
        with one_thread():
            rows = measured(matrix, rank, 3 if quick else 7)
        for solver, (first, factorised, solved, entries, error) in rows.items():
            times = f"{1e3 * first:7.1f} ms{1e3 * factorised:7.1f} ms{1e3 * solved:7.2f} ms"
            print(f"{name + ', ' + solver:32}{matrix.shape[0]:9d}{times}{entries:11.0f}{error:10.0e}")


if __name__ == "__main__":
    main()
