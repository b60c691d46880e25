"""8-node hexahedra with uniform strain: ranks, patch test, resistance to hourglass modes, keys of a scene."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.errors import InputError
from latin_fmu.fem.elasticity import Isotropic, Orthotropic
from latin_fmu.fem.elements import Elements, Recovery, rigid_modes, stiffness
from latin_fmu.fem.mesh import Mesh, box_mesh
from latin_fmu.fem.reference_cells import UNIFORM_CELLS

STEEL = Isotropic(7800.0, 210e9, 0.3)
SLOPE = np.array([[1e-3, 2e-4, 0.0], [0.0, -3e-4, 1e-4], [5e-4, 0.0, 2e-4]])


def uniform(counts: tuple[int, int, int], distortion: float = 0.0) -> Mesh:
    """A unit cube of such cells, its nodes moved at random."""
    mesh = box_mesh(np.zeros(3), np.ones(3), counts).with_reduced_rules(UNIFORM_CELLS)
    moved = distortion * np.random.default_rng(1).uniform(-1.0, 1.0, mesh.nodes.shape)
    return replace(mesh, nodes=mesh.nodes + moved)


def test_a_distorted_cell_resists_all_but_its_rigid_motions() -> None:
    """Rank 24 - 6, of which six strains are those of the material and twelve weak: full integration bounds it."""
    mesh = uniform((1, 1, 1), 0.15)
    matrix = stiffness(Elements(mesh), STEEL).toarray()
    rigid = rigid_modes(mesh.nodes, mesh.nodes.mean(axis=0), 1.0)
    assert np.abs(matrix @ rigid).max() < 1e-10 * np.abs(matrix).max()
    values = np.sort(np.linalg.eigvalsh(matrix)) / STEEL.young_modulus
    assert (values[6:18] > 4e-3).all()
    assert (values[6:18] < 1e-2).all()
    assert values[18] > 0.1
    one = replace(mesh.blocks[0], reduced=False)
    whole = stiffness(Elements(replace(mesh, blocks=(one,))), STEEL).toarray()
    assert np.linalg.eigvalsh(whole - matrix).min() > -1e-9 * np.abs(whole).max()


@pytest.mark.parametrize(
    "material",
    [STEEL, Orthotropic(1.0, (1e9, 2e9, 4e9), (0.1, 0.15, 0.2), (3e8, 5e8, 7e8))],
    ids=["steel", "three axes"],
)
def test_the_modes_of_a_cube_have_the_measured_stiffness(material: Isotropic | Orthotropic) -> None:
    """c M V (sum b . b) gamma . gamma = 5e-4 M a^3 (3 / (2 a^2)) 8 = 6e-3 M a, M the modulus E, or C_1111."""
    mesh = uniform((1, 1, 1))
    mode = np.prod(2.0 * mesh.nodes - 1.0, axis=1)
    matrix = stiffness(Elements(mesh), material)
    modulus = material.stress(np.array([1.0, 0, 0, 0, 0, 0]))[0] if isinstance(material, Orthotropic) else 210e9
    for axis in range(3):
        moved = np.outer(mode, np.eye(3)[axis]).ravel()
        np.testing.assert_allclose(matrix @ moved, 6e-3 * modulus * moved, atol=1e-9 * modulus)


def test_uniform_strain_is_exact_on_distorted_cells() -> None:
    """Patch test: strains, stresses at nodes and points, and no forces inside."""
    mesh = uniform((3, 3, 3), 0.08)
    moved = mesh.nodes @ SLOPE.T
    strain = 0.5 * (SLOPE + SLOPE.T)[(0, 1, 2, 1, 0, 0), (0, 1, 2, 2, 2, 1)]
    recovery = Recovery(Elements(mesh), STEEL)
    np.testing.assert_allclose(recovery.strain(moved[None]), np.broadcast_to(strain, (1, 27, 6)), atol=1e-15)
    stress = STEEL.stress(strain)
    at_nodes = recovery.nodal_stress(moved[None])[0]
    np.testing.assert_allclose(at_nodes, np.broadcast_to(stress, at_nodes.shape), atol=1e-9 * np.abs(stress).max())
    forces = (stiffness(Elements(mesh), STEEL) @ moved.ravel()).reshape(-1, 3)
    skin = np.unique(np.concatenate([face.nodes for face in mesh.faces.values()]))
    inside = np.setdiff1d(np.arange(mesh.n_node), skin)
    assert np.abs(forces[inside]).max() < 1e-10 * np.abs(forces).max()


@pytest.mark.parametrize("softened", [False, True])
def test_nodal_forces_are_those_of_the_stiffness(softened: bool) -> None:
    """Any displacements: K u, hourglass forces and moduli of single cells among them."""
    mesh = uniform((2, 2, 2), 0.08)
    elements = Elements(mesh, np.linspace(0.2, 1.0, 8) if softened else None)
    moved = np.random.default_rng(3).normal(size=mesh.nodes.shape)
    forces = (stiffness(elements, STEEL) @ moved.ravel()).reshape(-1, 3)
    found = Recovery(elements, STEEL).nodal_forces(moved)
    np.testing.assert_allclose(found, forces, atol=1e-12 * np.abs(forces).max())


def scene(**keys: Any) -> dict[str, Any]:
    """A box under its weight, or what ``keys`` of its body make of it."""
    body = {"material": "m", "box": {"size": [0.01, 0.01, 0.04], "elements": [4, 4, 8]}, **keys}
    return {
        "name": "one",
        "material": {"m": {"young_modulus": 1e9, "poisson_ratio": 0.3, "density": 1e3}},
        "substructure": {"a": {k: v for k, v in body.items() if v is not None}},
        "boundary": {"foot": {"face": "a.zmin", "type": "fixed"}},
        "load": {"side": {"face": "a.zmax", "traction": [1e3, 0.0, 0.0]}},
        "sensor": {"tip": {"substructure": "a", "point": [0.01, 0.01, 0.04]}},
        "time": {"end": 1.0, "step": 1.0, "quasi_static": True},
    }


def test_a_box_of_such_cells_bends_more_easily() -> None:
    """Four elements across: above the beam of full length, by 1 / (1 - 1 / 16), as points lie inside the skin."""
    tips = {
        key: latin_fmu.solve(latin_fmu.scene_from_dict(scene(**{key: True}))).sensors["tip"].displacement[-1, 0]
        for key in ("uniform_strain", "bending_modes")
    }
    assert tips["uniform_strain"] / tips["bending_modes"] == pytest.approx(16.0 / 15.0, abs=0.02)


def test_keys_that_do_not_fit_are_refused() -> None:
    with pytest.raises(InputError, match="uniform_strain: elements with bending modes are integrated at eight points"):
        latin_fmu.solve(latin_fmu.scene_from_dict(scene(bending_modes=True, uniform_strain=True)))
    with pytest.raises(InputError, match="reduced_integration: the mesh has no 20-node hexahedra"):
        latin_fmu.solve(latin_fmu.scene_from_dict(scene(reduced_integration=True)))
