"""Stiffness, mass, body loads and mean stress on distorted meshes of both cell types."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse.linalg as spla

from latin_fmu.fem.elasticity import Isotropic
from latin_fmu.fem.elements import Elements, MeanStress, body_load, mass, stiffness
from latin_fmu.fem.mesh import Mesh

E, NU, RHO = 3.0, 0.3, 2.5
VOLUME = 1.2
GRADIENT = np.array([[0.7, -0.2, 0.4], [0.3, 0.5, -0.6], [-0.1, 0.8, -0.9]])


def hooke(strain: np.ndarray) -> np.ndarray:
    """sigma = E/(1+nu) (eps + nu/(1-2 nu) tr(eps) I)."""
    return E / (1 + NU) * (strain + NU / (1 - 2 * NU) * np.trace(strain) * np.eye(3))


@pytest.fixture
def linear(straight: Mesh) -> np.ndarray:
    """Nodal displacements of a uniform displacement gradient."""
    return straight.nodes @ GRADIENT.T


def test_patch_test(straight: Mesh, linear: np.ndarray) -> None:
    """Boundary nodes moved by a linear field: the interior follows exactly, whatever its distortion."""
    k = stiffness(Elements(straight), Isotropic(1.0, E, NU))
    surface = np.unique(np.concatenate([f.nodes for f in straight.faces.values()]))
    held = (3 * surface[:, None] + np.arange(3)).ravel()
    free = np.setdiff1d(np.arange(k.shape[0]), held)
    assert len(free) == 3 * 8
    u = linear.ravel().copy()
    u[free] = spla.spsolve(k[free][:, free].tocsc(), -(k[free][:, held] @ u[held]))
    np.testing.assert_allclose(u, linear.ravel(), atol=1e-13)


def test_uniform_strain_has_the_energy_and_reactions_of_hooke(straight: Mesh, linear: np.ndarray) -> None:
    strain = 0.5 * (GRADIENT + GRADIENT.T)
    stress = hooke(strain)
    k = stiffness(Elements(straight), Isotropic(1.0, E, NU))
    u = linear.ravel()
    assert u @ (k @ u) == pytest.approx(VOLUME * float(np.sum(stress * strain)), rel=1e-12)
    reactions = (k @ u).reshape(-1, 3)
    top = straight.faces["zmax"].nodes
    inner = top[np.all(np.abs(straight.nodes[top, :2] - [0.8, 0.2]) < [0.49, 0.39], axis=1)]
    side = 1.0 * 0.8 / 9  # area around an inner node of the regular 3 x 3 face
    np.testing.assert_allclose(reactions[inner], np.tile(side * stress[:, 2], (len(inner), 1)), rtol=1e-11)


def test_mean_stress_of_a_uniform_strain(straight: Mesh, linear: np.ndarray) -> None:
    stress = hooke(0.5 * (GRADIENT + GRADIENT.T))
    ordered = [stress[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))]
    recover = MeanStress(Elements(straight), Isotropic(1.0, E, NU))
    result = recover(linear)
    assert result.shape == (straight.n_cell, 6)
    np.testing.assert_allclose(result, np.tile(ordered, (len(result), 1)), atol=1e-12)


def rigid_motions(nodes: np.ndarray) -> np.ndarray:
    """Three translations and three small rotations, (6, 3 n_node)."""
    axes = np.eye(3)
    motions = [np.tile(axis, (len(nodes), 1)) for axis in axes] + [np.cross(axis, nodes) for axis in axes]
    return np.stack([m.ravel() for m in motions])


def test_rigid_motions_and_only_they_have_no_energy(warped: Mesh) -> None:
    k = stiffness(Elements(warped), Isotropic(1.0, E, NU)).toarray()
    assert np.abs(k - k.T).max() < 1e-13
    assert np.abs(k @ rigid_motions(warped.nodes).T).max() < 1e-12
    values = np.linalg.eigvalsh(k)
    assert np.abs(values[:6]).max() < 1e-12 < 1e-4 < values[6]


def test_a_body_far_from_the_origin_is_no_softer(warped: Mesh) -> None:
    near = stiffness(Elements(warped), Isotropic(1.0, E, NU))
    far = stiffness(Elements(replace(warped, nodes=warped.nodes + 1e3)), Isotropic(1.0, E, NU))
    assert np.abs((near - far).toarray()).max() < 1e-9


def test_total_mass_first_moments_and_symmetry(straight: Mesh) -> None:
    m = mass(Elements(straight), RHO)
    ones, x = np.zeros((straight.n_node, 3)), np.zeros((straight.n_node, 3))
    for i in range(3):
        ones[:], x[:] = 0.0, 0.0
        ones[:, i], x[:, i] = 1.0, straight.nodes[:, 2]
        assert ones.ravel() @ (m @ ones.ravel()) == pytest.approx(RHO * VOLUME, rel=1e-13)
        assert ones.ravel() @ (m @ x.ravel()) == pytest.approx(RHO * VOLUME * 0.85, rel=1e-12)
    assert np.linalg.eigvalsh(m.toarray())[0] > 0
    assert np.abs((m - m.T).toarray()).max() < 1e-17
    coupled = m.toarray().reshape(straight.n_node, 3, straight.n_node, 3)
    assert not coupled[:, 0, :, 1].any()


def test_mass_integrates_products_of_linear_fields(box: Mesh) -> None:
    """Consistent mass of the regular box: rotary inertia about its edge, exact for trilinear products."""
    m = mass(Elements(box), RHO)
    motion = np.cross([0.0, 0.0, 1.0], box.nodes - box.nodes[0]).ravel()
    assert motion @ (m @ motion) == pytest.approx(RHO * VOLUME * (1.0**2 + 0.8**2) / 3, rel=1e-13)


def test_body_load_total_and_moment(straight: Mesh) -> None:
    force = np.array([0.4, -1.0, 2.0])
    nodal = body_load(Elements(straight), force).reshape(-1, 3)
    np.testing.assert_allclose(nodal.sum(axis=0), VOLUME * force, rtol=1e-13)
    moment = np.cross(straight.nodes, nodal).sum(axis=0)
    centre = np.array([0.8, 0.2, 0.85])
    np.testing.assert_allclose(moment, np.cross(centre, VOLUME * force), rtol=1e-12)


def test_dofs_are_numbered_node_by_node(box: Mesh) -> None:
    """Stretching along z gives forces on the z faces at dofs 3 node + 2 and, for nu = 0, nowhere else."""
    k = stiffness(Elements(box), Isotropic(1.0, E, 0.0))
    u = np.zeros((box.n_node, 3))
    u[:, 2] = 0.01 * box.nodes[:, 2]
    force = (k @ u.ravel()).reshape(-1, 3)
    top = box.faces["zmax"].nodes
    assert np.abs(force[:, :2]).max() < 1e-16
    assert force[top, 2].sum() == pytest.approx(0.01 * E * 0.8, rel=1e-13)
    assert force[:, 2].sum() == pytest.approx(0.0, abs=1e-16)


def test_lame_constants_and_wave_speeds() -> None:
    steel = Isotropic(7800.0, 210e9, 0.25)
    first, shear = steel.lame
    assert (first, shear) == pytest.approx((84e9, 84e9))
    c_p, c_s = steel.wave_speeds
    assert c_s == pytest.approx((84e9 / 7800) ** 0.5)
    assert c_p == pytest.approx((3 * 84e9 / 7800) ** 0.5)
    assert Isotropic(1.0, 900.0, 0.0).wave_speeds[0] == pytest.approx(30.0)
