"""Stable steps of central differences against all eigenvalues: the bound is safe, the longest step is the longest."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from latin_fmu.fem.elasticity import Isotropic
from latin_fmu.fem.elements import Elements, mass, stiffness
from latin_fmu.fem.mesh import box_mesh
from latin_fmu.propagator import stable_step
from latin_fmu.propagator.model import lumped
from latin_fmu.propagator.stable_step import StableStep, eigenvalue_bound, largest_eigenvalue

Array = np.ndarray


def lanczos_numpy(
    pointers: Any,
    columns: Any,
    values: np.ndarray,
    inverse: np.ndarray,
    vectors: np.ndarray,
    diagonal: np.ndarray,
    beside: np.ndarray,
    first: int,
    last: int,
) -> None:
    """Steps of the Lanczos process on D A D, D = diag(inverse): fills ``diagonal`` and ``beside`` of the tridiagonal
    matrix; ``vectors`` (2, n) are the last two, q_-1 = 0 and q_0 at the start."""
    n = len(inverse)
    matrix = sp.csr_array((values, columns, pointers), shape=(n, n))
    for step in range(first, last):
        before, now = vectors
        after = inverse * (matrix @ (inverse * now)) - (beside[step - 1] if step else 0.0) * before
        diagonal[step] = now @ after
        after -= diagonal[step] * now
        beside[step] = np.linalg.norm(after)
        vectors[0] = now
        vectors[1] = after / beside[step] if beside[step] > 0.0 else 0.0


def box(elements: tuple[int, int, int], shape: tuple[float, ...], nu: float, held: bool) -> tuple[Array, sp.csr_array]:
    """Lumped mass and stiffness of a box of elements of this shape; ``held``: symmetry on three of its faces."""
    mesh = box_mesh(np.zeros(3), np.asarray(elements) * np.asarray(shape), elements)
    basis = Elements(mesh)
    free = np.ones((mesh.n_node, 3), dtype=bool)
    if held:
        free[mesh.nodes < 1e-12] = False
    kept = np.flatnonzero(free)
    stiff = stiffness(basis, Isotropic(1.0, 210e9, nu))
    return lumped(mass(basis, 7800.0), nodal=False).diagonal()[kept], sp.csr_array(stiff[kept][:, kept])


def exact(matrix: sp.csr_array, masses: Array) -> float:
    return float(la.eigh(matrix.toarray(), np.diag(masses), eigvals_only=True)[-1])


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.49])
@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize(
    ("elements", "shape"),
    [((4, 4, 4), (1, 1, 1)), ((2, 3, 4), (1, 1, 4)), ((5, 5, 2), (4, 4, 1)), ((1, 1, 50), (5, 5, 1))],
    ids=str,
)
def test_boxes(elements: tuple[int, int, int], shape: tuple[float, ...], nu: float, held: bool) -> None:
    """The bound is never too long and at least two thirds of the longest step, which is met to 2e-4 from below."""
    masses, stiff = box(elements, shape, nu, held)
    longest = 2.0 / np.sqrt(exact(stiff, masses))
    step = StableStep(masses, stiff)
    assert 2 / 3 * longest <= step.certain <= longest
    assert longest * (1 - 2e-4) <= step.longest <= longest * (1 + 1e-12)
    assert step.allows(step.certain)
    assert step.allows(step.longest)
    assert not step.allows(1.001 * longest)


@pytest.mark.parametrize("n", [1, 7, 61, 130])
@pytest.mark.parametrize("density", [0.02, 0.3])
def test_symmetric_matrices_of_any_sign(n: int, density: float) -> None:
    rng = np.random.default_rng(n)
    half = sp.random_array((n, n), density=density, rng=rng, data_sampler=lambda size: rng.normal(size=size))
    matrix = sp.csr_array(half + half.T + sp.diags_array(rng.normal(size=n)))
    masses = rng.uniform(0.1, 10.0, n)
    largest = exact(matrix, masses)
    assert largest <= eigenvalue_bound(matrix, masses) * (1 + 1e-12)
    assert largest <= largest_eigenvalue(matrix, masses) + 1e-9
    assert largest_eigenvalue(matrix, masses) <= largest + 3e-4 * abs(largest) + 1e-9


def test_lagged_damping() -> None:
    """dt^2 K + 2 dt R <= 4 M for the step returned, by all eigenvalues; with a margin for the bounds of both."""
    masses, stiff = box((3, 3, 3), (1, 1, 1), 0.3, True)
    lagged = sp.csr_array(2e-9 * stiff)
    step = StableStep(masses, stiff, lagged)
    for dt in (step.certain, step.longest):
        left = 4.0 * np.diag(masses) - 2.0 * dt * lagged.toarray() - dt * dt * stiff.toarray()
        assert la.eigvalsh(left)[0] >= -1e-9 * masses.max()
    assert step.certain < step.longest < StableStep(masses, stiff).longest


def test_eigenvalues_are_left_alone_where_the_bound_allows_the_step(monkeypatch: pytest.MonkeyPatch) -> None:
    masses, stiff = box((3, 3, 3), (1, 1, 1), 0.3, True)
    called: list[int] = []
    real: Callable[..., float] = largest_eigenvalue

    def watched(matrix: sp.csr_array, masses: Array) -> float:
        called.append(len(masses))
        return real(matrix, masses)

    monkeypatch.setattr(stable_step, "largest_eigenvalue", watched)
    step = StableStep(masses, stiff)
    assert step.allows(0.999 * step.certain)
    assert not called
    assert step.allows(1.01 * step.certain)
    assert step.allows(1.02 * step.certain)
    assert called == [len(masses)]


def test_nothing_stiff_allows_any_step() -> None:
    assert StableStep(np.zeros(0), sp.csr_array((0, 0))).allows(1e9)
    assert StableStep(np.ones(3), sp.csr_array((3, 3))).longest == np.inf


def test_lanczos_kernel_and_its_twin(monkeypatch: pytest.MonkeyPatch) -> None:
    masses, stiff = box((4, 4, 4), (1, 1, 1), 0.3, True)
    compiled = largest_eigenvalue(stiff, masses)
    monkeypatch.setattr(stable_step, "_lanczos", lanczos_numpy)
    assert largest_eigenvalue(stiff, masses) == pytest.approx(compiled, rel=1e-6)
