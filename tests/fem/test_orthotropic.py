"""Orthotropic elasticity: against Hooke's law written out by compliances, isotropic constants, waves."""

from __future__ import annotations

import numpy as np
import pytest

from latin_fmu.fem.contact_layer import landing_viscosity, layer_of
from latin_fmu.fem.elasticity import Isotropic, Orthotropic
from latin_fmu.fem.elements import Elements, MeanStress, Recovery, stiffness
from latin_fmu.fem.mesh import boundary, box_mesh

from .test_elements import GRADIENT, KINDS, STRAIN, distorted, inner_nodes, six, solved

TURN = np.linalg.qr(np.array([[1.0, 2.0, 0.5], [-0.3, 1.0, 2.0], [2.0, 0.2, 1.0]]))[0].T  # rows are the axes
AXES = tuple(tuple(row) for row in (TURN * np.linalg.det(TURN)).tolist())
PLY = Orthotropic(2.0, (10.0, 3.0, 1.0), (0.28, 0.3, 0.4), (1.3, 0.9, 0.5), AXES)
OWN = Orthotropic(2.0, (10.0, 3.0, 1.0), (0.28, 0.3, 0.4), (1.3, 0.9, 0.5))


def strain_of(stress: np.ndarray) -> np.ndarray:
    """Strain (3, 3) of a stress (3, 3) along the axes of the material, term by term."""
    (e1, e2, e3), (n12, n13, n23), (g12, g13, g23) = PLY.moduli, PLY.ratios, PLY.shear_moduli
    (s1, s12, s13), (_, s2, s23), (_, _, s3) = stress
    strain = np.zeros((3, 3))
    strain[0, 0] = s1 / e1 - n12 / e1 * s2 - n13 / e1 * s3
    strain[1, 1] = -n12 / e1 * s1 + s2 / e2 - n23 / e2 * s3
    strain[2, 2] = -n13 / e1 * s1 - n23 / e2 * s2 + s3 / e3
    strain[0, 1], strain[0, 2], strain[1, 2] = s12 / (2 * g12), s13 / (2 * g13), s23 / (2 * g23)
    return np.asarray(np.triu(strain) + np.triu(strain, 1).T)


def test_stress_of_a_strain() -> None:
    """Along turned axes, all six components."""
    stress = np.array([[1.0, 0.3, -0.7], [0.3, -2.0, 0.4], [-0.7, 0.4, 0.6]])
    r = np.asarray(AXES)
    turned = PLY.stress(six(r.T @ strain_of(stress) @ r))
    np.testing.assert_allclose(turned, six(r.T @ stress @ r), atol=1e-13)


@pytest.mark.parametrize(("cell_type", "bending"), KINDS)
def test_patch_test_and_stresses(cell_type: str, bending: bool) -> None:
    """A linear field is followed exactly, its stresses are those of the law, its energy is their work."""
    mesh = distorted(cell_type)
    elements, linear = Elements(mesh), mesh.nodes @ GRADIENT.T
    k = stiffness(elements, PLY, bending)
    assert abs(k - k.T).max() < 1e-12
    actual = solved(k, boundary(mesh).nodes, linear)
    assert np.abs(actual - linear).max() < 1e-10
    assert np.abs(linear[inner_nodes(mesh)]).max() > 0.1
    stress = PLY.stress(six(STRAIN))
    np.testing.assert_allclose(MeanStress(elements, PLY)(linear), np.tile(stress, (mesh.n_cell, 1)), atol=1e-11)
    nodal = Recovery(elements, PLY, bending).nodal_stress(linear[None])[0]
    np.testing.assert_allclose(nodal, np.tile(stress, (mesh.n_node, 1)), atol=1e-10)
    work = stress @ (six(STRAIN) * ([1.0] * 3 + [2.0] * 3)) * elements.volume.sum()
    assert linear.ravel() @ (k @ linear.ravel()) == pytest.approx(work, rel=1e-12)


@pytest.mark.parametrize(("cell_type", "bending"), KINDS)
def test_isotropic_constants_give_the_isotropic_matrix(cell_type: str, bending: bool) -> None:
    mesh = distorted(cell_type)
    plain = Isotropic(2.0, 3.0, 0.3)
    shear = plain.lame[1]
    same = Orthotropic(2.0, (3.0,) * 3, (0.3,) * 3, (shear,) * 3, AXES)
    first, second = (stiffness(Elements(mesh), m, bending) for m in (plain, same))
    assert abs(first - second).max() < 1e-13 * abs(first).max()
    assert same.wave_speeds == pytest.approx(plain.wave_speeds, rel=1e-12)
    assert same.poisson_ratio == pytest.approx(0.3)
    n = np.array([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0]])
    for name in ("moduli_along", "impedance", "impedances"):
        np.testing.assert_allclose(getattr(same, name)(n), getattr(plain, name)(n), rtol=1e-12, atol=1e-12)


def test_moduli_and_waves_along_the_axes() -> None:
    """Along an axis c_p is that of the stiffness C_ii, the shear waves have the two moduli of its planes."""
    normal = np.linalg.inv([strain_of(np.diag(row)).diagonal() for row in np.eye(3)])
    along, across = OWN.moduli_along(np.eye(3))
    np.testing.assert_allclose(along, PLY.moduli, rtol=1e-12)
    np.testing.assert_allclose(across, [(1.3 + 0.9) / 2, (1.3 + 0.5) / 2, (0.9 + 0.5) / 2], rtol=1e-12)
    along, across = OWN.impedances(np.eye(3))
    np.testing.assert_allclose(along, np.sqrt(2.0 * normal.diagonal()), rtol=1e-12)
    assert across[0] == pytest.approx((np.sqrt(2.0 * 1.3) + np.sqrt(2.0 * 0.9)) / 2)
    fastest, slowest = PLY.wave_speeds
    assert fastest == pytest.approx(np.sqrt(normal[0, 0] / 2.0), rel=1e-3)
    assert slowest <= np.sqrt(0.5 / 2.0) * (1 + 1e-9)
    assert PLY.bar_speed == pytest.approx(np.sqrt(5.0))


def test_a_stiffer_material_is_the_same_with_faster_waves() -> None:
    """Every modulus times 1.44: stresses of strains 1.44 times, waves 1.2 times as large."""
    strain, stiff = np.arange(1.0, 7.0), PLY.stiffened(1.44)
    np.testing.assert_allclose(stiff.stress(strain), 1.44 * PLY.stress(strain), rtol=1e-12)
    assert stiff.wave_speeds == pytest.approx(1.2 * np.array(PLY.wave_speeds))
    plain = Isotropic(2.0, 3.0, 0.3)
    np.testing.assert_allclose(plain.stiffened(1.44).stress(strain), 1.44 * plain.stress(strain), rtol=1e-12)


def test_modulus_off_the_axes() -> None:
    """A bar of a ply at an angle (Jones, eq. 2.97): 1/E_x = c^4/E_1 + (1/G_12 - 2 nu_12/E_1) s^2 c^2 + s^4/E_2."""
    for angle in (0.3, 0.8, 1.2):
        c, s = np.cos(angle), np.sin(angle)
        wanted = 1 / (c**4 / 10 + (1 / 1.3 - 2 * 0.28 / 10) * s * s * c * c + s**4 / 3)
        assert OWN.moduli_along(np.array([c, s, 0.0]))[0] == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_layer_at_a_contact_face_takes_the_waves_along_its_normal(axis: int) -> None:
    """A box of one element: C = q (h / c) K and the time h / c of a bar, by the constants along the axis."""
    size = np.array([1.0, 2.0, 3.0])
    mesh = box_mesh(np.zeros(3), size, (1, 1, 1))
    nodes = np.flatnonzero(mesh.nodes[:, axis] == 0.0)
    q = np.zeros(mesh.n_node)
    q[nodes] = 0.5
    along = np.eye(3)[axis]
    speed = float(np.sqrt(OWN.stress(six(np.outer(along, along)))[axis] / OWN.density))
    made = landing_viscosity(mesh, q, OWN)
    assert made is not None
    expected = 0.5 * size[axis] / speed * stiffness(Elements(mesh), OWN).toarray()
    np.testing.assert_allclose(made.toarray(), expected, atol=1e-12 * np.abs(expected).max())
    bar = size[axis] / np.sqrt(OWN.moduli[axis] / OWN.density)
    assert layer_of(mesh, nodes, OWN) == (pytest.approx(bar), 1.0)
