"""Reduced rules of 20-node hexahedra and 6-node wedges: ranks, uniform strain, and where a scene may ask for them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import latin_fmu
from latin_fmu.errors import InputError
from latin_fmu.fem.elasticity import Isotropic
from latin_fmu.fem.elements import Elements, Recovery, stiffness
from latin_fmu.fem.mesh import Mesh
from latin_fmu.fem.reference_cells import cell_functions
from latin_fmu.stability.surfaces import typed_box
from tests.mesh_files.decks import element_rows, node_rows

STEEL = Isotropic(7800.0, 210e9, 0.3)


@pytest.mark.parametrize(("kind", "rank"), [("hexahedron20", 48), ("wedge", 11)])
def test_a_cell_has_a_strain_for_each_point(kind: str, rank: int) -> None:
    """8 and 2 points with six strains each, of which those of the wedge have one in common: so many deformations carry
    a force, others of the cell alone none."""
    nodes = cell_functions(kind).nodes
    mesh = Mesh.uniform(nodes, kind, np.arange(len(nodes))[None])
    matrix = stiffness(Elements(mesh.with_reduced_rules()), STEEL).toarray()
    assert np.linalg.matrix_rank(matrix, tol=1e-9 * np.abs(matrix).max()) == rank
    assert np.linalg.matrix_rank(stiffness(Elements(mesh), STEEL).toarray()) == 3 * len(nodes) - 6


def test_uniform_strain_is_exact_and_its_forces_are_those_of_the_stiffness() -> None:
    """A block of 20-node hexahedra: stress of a uniform strain at all points, nodal forces K u."""
    mesh = typed_box("hexahedron20", np.zeros(3), np.ones(3), (2, 2, 2)).with_reduced_rules()
    slope = np.array([[1e-3, 2e-4, 0.0], [0.0, -3e-4, 1e-4], [5e-4, 0.0, 2e-4]])
    moved = mesh.nodes @ slope.T
    recovery = Recovery(Elements(mesh), STEEL)
    strain = 0.5 * (slope + slope.T)[(0, 1, 2, 1, 0, 0), (0, 1, 2, 2, 2, 1)]
    np.testing.assert_allclose(recovery.strain(moved[None]), np.broadcast_to(strain, (1, 8, 6)), atol=1e-15)
    forces = stiffness(Elements(mesh), STEEL) @ moved.ravel()
    np.testing.assert_allclose(recovery.nodal_forces(moved).ravel(), forces, atol=1e-9 * np.abs(forces).max())


def test_a_body_without_such_cells_refuses_the_key(tmp_path: Path) -> None:
    mesh = typed_box("hexahedron", np.zeros(3), np.ones(3), (1, 1, 1))
    text = "*NODE\n" + node_rows(mesh.nodes) + "*ELEMENT, TYPE=C3D8, ELSET=A\n" + element_rows(mesh.blocks[0].cells)
    (tmp_path / "mesh.inp").write_text(text)
    body = {"material": "m", "mesh": {"file": "mesh.inp"}, "reduced_integration": True}
    scene = {
        "name": "one",
        "material": {"m": {"young_modulus": 1e9, "poisson_ratio": 0.3, "density": 1e3}},
        "substructure": {"a": body},
        "time": {"end": 1e-3, "step": 1e-4},
    }
    with pytest.raises(InputError, match="reduced_integration: the mesh has no 20-node hexahedra"):
        latin_fmu.solve(latin_fmu.scene_from_dict(scene, tmp_path))
