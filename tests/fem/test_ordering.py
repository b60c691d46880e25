"""Elimination order by nested dissection, and nearest points."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from latin_fmu import load_scene
from latin_fmu.assembly.body import build_bodies
from latin_fmu.errors import Problems
from latin_fmu.fem.dissection import nested_dissection
from latin_fmu.fem.elasticity import Isotropic
from latin_fmu.fem.elements import Elements, mass, stiffness
from latin_fmu.fem.mesh import Mesh, box_mesh, nearest

from .meshes import TYPES, typed_box

MODELS = Path(__file__).parents[2] / "models"


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
    matrix = mass(basis, 1.0) + stiffness(basis, Isotropic(1.0, 1.0, 0.3))
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


# entries of the factor of the graph of the nodes in the order of METIS 5.1 (pymetis 2025.2.2, nested dissection)
METIS = {
    ("bolted_beam", "lower"): 167_208,
    ("bolted_beam", "bolt1"): 28_724,
    ("lap_joint", "lower"): 13_731,
    ("lap_joint", "upper"): 21_321,
    ("punched_plates", "lower"): 36_437,
}


@pytest.mark.parametrize("model", ["bolted_beam", "lap_joint", "punched_plates"])
def test_fill_of_meshes_from_files(model: str) -> None:
    """Plates with holes, bolts: at most 1.15 times the fill of METIS."""
    bodies = build_bodies(load_scene(MODELS / model / "scene.toml"), Problems())
    for (name, body), entries in METIS.items():
        if name == model:
            mesh = bodies[body].mesh
            blocks = [
                (np.repeat(b.cells, b.cells.shape[1], axis=1), np.tile(b.cells, b.cells.shape[1])) for b in mesh.blocks
            ]
            i, j = (np.concatenate([pair[k].ravel() for pair in blocks]) for k in range(2))
            graph = sp.csr_array(sp.coo_array((np.ones(len(i)), (i, j)), shape=(mesh.n_node, mesh.n_node)))
            graph.sum_duplicates()
            graph.data[:] = 1.0
            matrix = sp.csr_array(graph + sp.eye_array(mesh.n_node) * 2.0 * mesh.n_node)
            assert fill(matrix, np.argsort(nested_dissection(mesh))) <= 1.15 * entries, body
