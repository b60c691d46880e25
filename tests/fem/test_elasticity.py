"""Stiffness, mass, body loads and mean stress on distorted meshes of both cell types."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from latin_fmu.fem.elasticity import Isotropic
from latin_fmu.fem.elements import Elements, mass, stiffness
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
