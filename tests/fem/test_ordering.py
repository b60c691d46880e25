"""Elimination order by nested dissection, and nearest points."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from latin_fmu.fem.elements import Elements, mass, stiffness
from latin_fmu.fem.mesh import Mesh, box_mesh, nearest, nested_dissection

from .meshes import TYPES, typed_box


def fill(matrix: sp.csr_array, order: np.ndarray) -> int:
    """Entries of the Cholesky-like factor in this elimination order."""
    permuted = sp.csc_matrix(matrix[order][:, order])
    options = {"SymmetricMode": True}
    return int(spla.splu(permuted, permc_spec="NATURAL", diag_pivot_thresh=0.0, options=options).L.nnz)


@pytest.mark.parametrize("elements", [(1, 1, 1), (1, 1, 60), (9, 9, 9), (12, 12, 2), (2, 3, 4)])
def test_rank_is_a_permutation(elements: tuple[int, int, int]) -> None:
    mesh = box_mesh(np.zeros(3), np.ones(3), elements)
    rank = nested_dissection(mesh)
    assert rank.shape == (mesh.n_node,)
    np.testing.assert_array_equal(np.sort(rank), np.arange(mesh.n_node))


def test_rank_is_a_permutation_for_any_mesh(warped: Mesh) -> None:
    np.testing.assert_array_equal(np.sort(nested_dissection(warped)), np.arange(warped.n_node))


@pytest.mark.parametrize("cell_type", TYPES)
def test_rank_of_every_type_of_cell(cell_type: str) -> None:
    """A permutation with less fill than the order of the nodes."""
    mesh = typed_box(cell_type, (4, 4, 4))
    rank = nested_dissection(mesh)
    np.testing.assert_array_equal(np.sort(rank), np.arange(mesh.n_node))
    matrix = sp.csr_array(mass(Elements(mesh), 1.0)[::3][:, ::3])
    assert fill(matrix, np.argsort(rank)) < fill(matrix, np.arange(mesh.n_node))


def test_fill_is_reduced() -> None:
    mesh = box_mesh(np.zeros(3), np.ones(3), (9, 9, 9))
    basis = Elements(mesh)
    matrix = mass(basis, 1.0) + stiffness(basis, 1.0, 0.3)
    dissected = np.argsort(np.repeat(nested_dissection(mesh), 3), kind="stable")
    natural = np.arange(3 * mesh.n_node)
    assert fill(matrix, dissected) < 0.7 * fill(matrix, natural)


def test_nearest_point() -> None:
    rng = np.random.default_rng(0)
    points, candidates = rng.normal(size=(20, 3)), rng.normal(size=(50, 3))
    distance, number = nearest(points, candidates)
    every = np.linalg.norm(points[:, None] - candidates[None], axis=2)
    np.testing.assert_array_equal(number, every.argmin(axis=1))
    np.testing.assert_allclose(distance, every.min(axis=1), rtol=1e-14)
    assert nearest(points[:1], candidates[:1])[1].shape == (1,)
