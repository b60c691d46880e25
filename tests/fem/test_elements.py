"""Every type of cell, straight and curved: patch test, rigid motions, mass, loads, convergence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse.linalg as spla

from latin_fmu.fem import elements as elements_module
from latin_fmu.fem.elasticity import Isotropic
from latin_fmu.fem.elements import (
    Elements,
    MeanStress,
    Recovery,
    body_load,
    element_stiffness,
    lumped_mass,
    mass,
    principal,
    stiffness,
)
from latin_fmu.fem.mesh import CellBlock, Mesh, boundary, box_mesh, unjoined
from latin_fmu.fem.reference_cells import HEX_FACES

from .meshes import ORIGIN, QUADRATIC, SIZE, TYPES, inner_nodes, reference_cell, skewed, typed_box

E, NU, RHO = 3.0, 0.3, 2.5
VOLUME = float(np.prod(SIZE))
GRADIENT = np.array([[0.7, -0.2, 0.4], [0.3, 0.5, -0.6], [-0.1, 0.8, -0.9]])
STRAIN = 0.5 * (GRADIENT + GRADIENT.T)
ORDER = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
# type of cells, with bending modes
KINDS = (*((t, False) for t in TYPES), ("hexahedron", True), ("mixed", True))


def six(tensor: np.ndarray) -> np.ndarray:
    return np.array([tensor[ij] for ij in ORDER])


def uniform_stress() -> np.ndarray:
    return E / (1 + NU) * (STRAIN + NU / (1 - 2 * NU) * np.trace(STRAIN) * np.eye(3))


def distorted(cell_type: str) -> Mesh:
    """Inner corners moved; with quadratic cells all edges and faces curved as well."""
    mesh = typed_box(cell_type, shift=0.25)
    return replace(mesh, nodes=skewed(mesh.nodes, 0.05)) if cell_type in QUADRATIC else mesh


def dofs(nodes: np.ndarray) -> np.ndarray:
    return (3 * nodes[:, None] + np.arange(3)).ravel()


def solved(k: object, held: np.ndarray, values: np.ndarray, load: np.ndarray | None = None) -> np.ndarray:
    """Displacements with those of the nodes ``held`` given."""
    fixed = dofs(held)
    free = np.setdiff1d(np.arange(k.shape[0]), fixed)
    u = values.ravel().copy()
    force = -(k[free][:, fixed] @ u[fixed]) + (0.0 if load is None else load[free])
    u[free] = spla.spsolve(k[free][:, free].tocsc(), force)
    return u.reshape(-1, 3)


@pytest.mark.parametrize(("cell_type", "bending"), KINDS)
def test_patch_test(cell_type: str, bending: bool) -> None:
    """Boundary moved by a linear field: the interior follows exactly, whatever its distortion."""
    mesh = distorted(cell_type)
    assert len(inner_nodes(mesh)) >= 8
    linear = mesh.nodes @ GRADIENT.T
    k = stiffness(Elements(mesh), Isotropic(1.0, E, NU), bending)
    actual = solved(k, boundary(mesh).nodes, linear)
    assert np.abs(actual - linear).max() < 1e-10
    assert np.abs(linear[inner_nodes(mesh)]).max() > 0.1


def test_patch_test_of_a_hex_dominant_mesh() -> None:
    """Hexahedra, some of them cut into pyramids about their centre, one pyramid at the surface into two tetrahedra."""
    mesh = typed_box("hexahedron", (3, 3, 3), shift=0.25)
    cells = mesh.blocks[0].cells
    some = cells[[0, 13, 14, 26]]
    apex = mesh.n_node + np.arange(len(some))
    sides = np.concatenate([some[:, np.array(HEX_FACES)[:, ::-1]], np.repeat(apex, 6).reshape(-1, 6, 1)], axis=2)
    pyramids = sides.reshape(-1, 5)
    (outer,) = np.flatnonzero((mesh.nodes[pyramids[:6, :4], 0] == ORIGIN[0]).all(axis=1))
    tetrahedra = pyramids[outer][[[0, 1, 2, 4], [0, 2, 3, 4]]]
    blocks = (
        CellBlock("hexahedron", np.delete(cells, [0, 13, 14, 26], axis=0)),
        CellBlock("pyramid", np.delete(pyramids, outer, axis=0)),
        CellBlock("tetra", tetrahedra),
    )
    nodes = np.concatenate([mesh.nodes, mesh.nodes[some].mean(axis=1)])
    mixed = Mesh(nodes, blocks, {})
    assert unjoined(boundary(mixed)) == 0
    assert Elements(mixed).volume.sum() == pytest.approx(VOLUME, rel=1e-12)
    linear = nodes @ GRADIENT.T
    actual = solved(stiffness(Elements(mixed), Isotropic(1.0, E, NU)), boundary(mixed).nodes, linear)
    assert np.abs(actual - linear).max() < 1e-10
    assert len(inner_nodes(mixed)) == 8 + 4


@pytest.mark.parametrize(("cell_type", "bending"), KINDS)
def test_uniform_stress_at_cells_and_nodes(cell_type: str, bending: bool) -> None:
    mesh = distorted(cell_type)
    elements = Elements(mesh)
    linear = mesh.nodes @ GRADIENT.T
    stress = six(uniform_stress())
    recovery = Recovery(elements, Isotropic(1.0, E, NU), bending)
    history = np.stack([linear, -2.0 * linear])
    np.testing.assert_allclose(
        MeanStress(elements, Isotropic(1.0, E, NU))(linear), np.tile(stress, (mesh.n_cell, 1)), atol=1e-12
    )
    nodal = recovery.nodal_stress(history)
    assert nodal.shape == (2, mesh.n_node, 6)
    np.testing.assert_allclose(nodal[0], np.tile(stress, (mesh.n_node, 1)), atol=1e-11)
    np.testing.assert_allclose(nodal[1], -2 * nodal[0], atol=1e-11)
    strain = recovery.strain(history)
    np.testing.assert_allclose(strain[0], np.tile(six(STRAIN), (mesh.n_cell, 1)), atol=1e-13)
    assert strain.shape == (2, mesh.n_cell, 6)


@pytest.mark.parametrize("cell_type", QUADRATIC)
def test_linear_stress_is_exact_at_the_nodes(cell_type: str) -> None:
    """Quadratic displacements on straight cells."""
    mesh = typed_box(cell_type, (2, 2, 2))
    x, y, z = mesh.nodes.T
    u = np.stack([x * x - y * z, x * y + 2 * z * z, y * y - x * z], axis=1)
    zero = np.zeros_like(x)
    slope = np.array([[2 * x, -z, -y], [y, x, 4 * z], [-z, 2 * y, -x]])
    strain = 0.5 * (slope + slope.transpose(1, 0, 2))
    wanted = Isotropic(1.0, E, NU).stress(np.stack([strain[ij] for ij in ORDER], axis=-1))
    assert zero.shape == wanted.shape[:1]
    actual = Recovery(Elements(mesh), Isotropic(1.0, E, NU)).nodal_stress(u[None])[0]
    np.testing.assert_allclose(actual, wanted, atol=1e-11)


def test_bent_element_has_the_stress_of_the_beam() -> None:
    """Pure bending of one layer of hexahedra: sigma_xx linear over the thickness with bending modes, 0 without."""
    from latin_fmu.fem.mesh import box_mesh

    mesh = box_mesh(np.zeros(3), np.array([4.0, 1.0, 1.0]), (4, 1, 1))
    x, y, z = mesh.nodes.T
    y, z = y - 0.5, z - 0.5
    curvature = 0.01
    u = np.stack([-curvature * x * z, -NU * -curvature * y * z * 1.0, 0.5 * curvature * (x * x + NU * (z * z - y * y))])
    actual = Recovery(Elements(mesh), Isotropic(1.0, E, NU), bending_modes=True).nodal_stress(u.T[None])[0]
    np.testing.assert_allclose(actual[:, 0], -E * curvature * z, rtol=1e-10)
    assert np.abs(actual[:, [1, 3, 4, 5]]).max() < 1e-12
    stiff = Recovery(Elements(mesh), Isotropic(1.0, E, NU)).nodal_stress(u.T[None])[0]
    assert np.abs(stiff[:, 4]).max() > 0.1 * E * curvature  # parasitic shear


@pytest.mark.parametrize(("cell_type", "bending"), KINDS)
def test_rigid_motions_and_only_they_have_no_energy(cell_type: str, bending: bool) -> None:
    """On one cell alone, distorted: six energies are zero, the next is not."""
    mesh = typed_box("mixed", (2, 1, 1)) if cell_type == "mixed" else reference_cell(cell_type)
    rng = np.random.default_rng(5)
    nodes = mesh.nodes + rng.uniform(-0.08, 0.08, mesh.nodes.shape)
    k = stiffness(Elements(replace(mesh, nodes=nodes)), Isotropic(1.0, E, NU), bending).toarray()
    assert np.abs(k - k.T).max() < 1e-13
    axes = np.eye(3)
    motions = [np.tile(a, (len(nodes), 1)) for a in axes] + [np.cross(a, nodes) for a in axes]
    assert np.abs(k @ np.stack([m.ravel() for m in motions]).T).max() < 1e-12
    values = np.linalg.eigvalsh(k)
    assert np.abs(values[:6]).max() < 1e-12
    assert values[6] > 1e-3


def volume_of_the_map(amplitude: float) -> float:
    """Volume of the box under ``skewed``: Gauss points, derivatives by central differences."""
    x, w = np.polynomial.legendre.leggauss(6)
    points = ORIGIN + SIZE * 0.5 * (1 + np.stack(np.meshgrid(x, x, x, indexing="ij"), axis=-1).reshape(-1, 3))
    h = 1e-5
    slope = [(skewed(points + h * a, amplitude) - skewed(points - h * a, amplitude)) / (2 * h) for a in np.eye(3)]
    return float(np.einsum("i,j,k->ijk", w, w, w).ravel() @ np.linalg.det(np.stack(slope, axis=2))) * VOLUME / 8


@pytest.mark.parametrize("cell_type", TYPES)
def test_mass_and_moments(cell_type: str) -> None:
    mesh = typed_box(cell_type, shift=0.25)
    m = mass(Elements(mesh), RHO)
    up, height = np.zeros((2, mesh.n_node, 3))
    up[:, 2], height[:, 2] = 1.0, mesh.nodes[:, 2] - 0.1
    assert up.ravel() @ (m @ up.ravel()) == pytest.approx(RHO * VOLUME, rel=1e-12)
    assert height.ravel() @ (m @ up.ravel()) == pytest.approx(RHO * VOLUME * 0.75, rel=1e-12)
    if cell_type in QUADRATIC:  # the square of the height is of degree 2
        assert height.ravel() @ (m @ height.ravel()) == pytest.approx(RHO * VOLUME * 0.75, rel=1e-12)
    assert np.linalg.eigvalsh(m.toarray())[0] > 0


@pytest.mark.parametrize("cell_type", QUADRATIC)
def test_mass_of_curved_cells(cell_type: str) -> None:
    m = mass(Elements(distorted(cell_type)), RHO)
    assert m[::3][:, ::3].sum() == pytest.approx(RHO * volume_of_the_map(0.05), rel=1e-3)


@pytest.mark.parametrize("cell_type", TYPES)
def test_lumped_masses_are_positive_and_keep_the_total(cell_type: str) -> None:
    mesh = distorted(cell_type)
    elements = Elements(mesh)
    masses = lumped_mass(elements, RHO)
    if cell_type not in ("tetra10", "hexahedron20", "wedge15", "wedge18", "pyramid13"):
        assert masses is None
        masses = mass(elements, RHO).sum(axis=1)[::3]
    total = mass(elements, RHO)[::3][:, ::3].sum()
    assert masses.min() > 0
    assert masses.sum() == pytest.approx(total, rel=1e-12)
    if cell_type == "tetra10":  # 1/36 and 4/27 of the mass of a straight cell
        alone = reference_cell("tetra10")
        shares = lumped_mass(Elements(alone), 6.0)
        np.testing.assert_allclose(shares, [1 / 36] * 4 + [4 / 27] * 6, rtol=1e-12)


@pytest.mark.parametrize("cell_type", TYPES)
def test_body_load_total_and_moment(cell_type: str) -> None:
    mesh = typed_box(cell_type, shift=0.25)
    force = np.array([0.4, -1.0, 2.0])
    nodal = body_load(Elements(mesh), force).reshape(-1, 3)
    np.testing.assert_allclose(nodal.sum(axis=0), VOLUME * force, rtol=1e-12)
    moment = np.cross(mesh.nodes, nodal).sum(axis=0)
    np.testing.assert_allclose(moment, np.cross([0.8, 0.2, 0.85], VOLUME * force), rtol=1e-11)


def manufactured(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Displacement (sin x e^z, 0, 0)-like field of the nodes and the body force that holds it, at any points."""
    first, shear = Isotropic(1.0, E, NU).lame
    x, y, z = mesh.nodes.T if isinstance(mesh, Mesh) else mesh
    wave = np.sin(2 * x) * np.cos(y) * np.exp(0.5 * z)
    u = np.stack([wave, 0 * x, 0 * x], axis=1)
    laplace = -4 - 1 + 0.25
    slope = [-4 * wave, -2 * np.cos(2 * x) * np.sin(y) * np.exp(0.5 * z), np.cos(2 * x) * np.cos(y) * np.exp(0.5 * z)]
    force = -(first + shear) * np.stack(slope, axis=1)
    force[:, 0] -= shear * laplace * wave
    return u, force


@pytest.mark.parametrize(
    ("cell_type", "bending", "order"),
    [
        ("hexahedron", False, 2),
        ("hexahedron", True, 2),
        ("wedge", False, 2),
        ("tetra10", False, 3),
        ("hexahedron20", False, 3),
        ("hexahedron27", False, 3),
        ("wedge15", False, 3),
        ("wedge18", False, 3),
        ("pyramid", False, 2),
        ("pyramid13", False, 3),
    ],
)
def test_order_of_convergence(cell_type: str, bending: bool, order: float) -> None:
    """L2 error of a smooth field on distorted meshes falls with the power p + 1 of the element size."""
    errors = []
    sizes = (2, 4) if cell_type in QUADRATIC else (3, 6)
    for n in sizes:
        mesh = typed_box(cell_type, (n, n, n))
        mesh = replace(mesh, nodes=skewed(mesh.nodes, 0.03))
        elements = Elements(mesh)
        exact, _ = manufactured(mesh)
        load = np.zeros((mesh.n_node, 3))
        for _, p in elements.points(of_products=True):
            places = (p.values @ mesh.nodes[p.cells]).reshape(-1, 3)
            force = manufactured(places.T)[1].reshape(len(p.cells), -1, 3)
            np.add.at(load, p.cells, np.einsum("cp,pa,cpi->cai", p.volumes, p.values, force))
        actual = solved(stiffness(elements, Isotropic(1.0, E, NU), bending), boundary(mesh).nodes, exact, load.ravel())
        square = 0.0
        for _, p in elements.points(of_products=True):
            places = (p.values @ mesh.nodes[p.cells]).reshape(-1, 3)
            wanted = manufactured(places.T)[0].reshape(len(p.cells), -1, 3)
            square += float(np.sum(p.volumes[..., None] * (p.values @ actual[p.cells] - wanted) ** 2))
        errors.append(np.sqrt(square))
    assert np.log2(errors[0] / errors[1]) > order - 0.25


def test_principal_values() -> None:
    """Uniaxial, pure shear, and a tensor turned in space."""
    tensors = np.array([[5.0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 2.0], [0, 0, 0, 3.0, 0, 0], [-1, -1, -1, 0, 0, 0]])
    wanted = [[5, 0, 0], [2, 0, -2], [3, 0, -3], [-1, -1, -1]]
    np.testing.assert_allclose(principal(tensors), wanted, atol=1e-14)
    turn, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    np.testing.assert_allclose(principal(six(turn @ np.diag([4.0, -7.0, 1.0]) @ turn.T)), [4, 1, -7], rtol=1e-13)


def summed(mesh: Mesh, bending: bool) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and mass (n, n), dense: each cell by itself, one after the other."""
    n = 3 * mesh.n_node
    total, masses = np.zeros((n, n)), np.zeros((n, n))
    for block in mesh.blocks:
        for cell in block.cells:
            alone = Elements(Mesh(mesh.nodes, (replace(block, cells=cell[None]),), {}))
            dofs = (3 * cell[:, None] + np.arange(3)).ravel()
            ((_, p),) = alone.points()
            own = element_stiffness(p, Isotropic(1.0, E, NU), bending and block.cell_type == "hexahedron")
            total[np.ix_(dofs, dofs)] += own.reshape(len(dofs), -1)
            ((_, p),) = alone.points(of_products=True)
            pairs = RHO * np.einsum("p,pa,pb->ab", p.volumes[0], p.values, p.values)
            masses[np.ix_(dofs, dofs)] += np.kron(pairs, np.eye(3))
    return total, masses


@pytest.mark.parametrize(("cell_type", "bending"), KINDS)
@pytest.mark.parametrize("one_piece", [True, False])
def test_matrices_are_sums_of_those_of_the_cells(
    cell_type: str, bending: bool, one_piece: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With equal cells, whose matrices are made once, and with different ones; in one piece and in several."""
    if not one_piece:
        monkeypatch.setattr(elements_module, "_AT_ONCE", 2000)
    for mesh in (typed_box(cell_type), distorted(cell_type)):
        elements, (total, masses) = Elements(mesh), summed(mesh, bending)
        whole, inertia = stiffness(elements, Isotropic(1.0, E, NU), bending), mass(elements, RHO)
        np.testing.assert_allclose(whole.toarray(), total, atol=1e-13 * np.abs(total).max())
        np.testing.assert_allclose(inertia.toarray(), masses, atol=1e-13 * np.abs(masses).max())
        for matrix in (whole, inertia):
            assert matrix.has_canonical_format
            assert matrix.indices.dtype == matrix.indptr.dtype == np.int64


def test_equal_cells_are_found() -> None:
    mesh = box_mesh(np.zeros(3), np.array([8.0, 4.0, 2.0]), (8, 8, 8))
    ((_, points, of_cell),) = Elements(mesh).distinct()
    assert len(points.cells) == 1
    assert of_cell.tolist() == 512 * [0]
    moved = replace(mesh, nodes=mesh.nodes + 1e-9 * (np.arange(mesh.n_node) == 364)[:, None])
    ((_, points, of_cell),) = Elements(moved).distinct()
    assert len(points.cells) == 9  # one inner node has eight cells
    assert np.bincount(of_cell).max() == 504
    np.testing.assert_array_equal(np.sort(np.bincount(of_cell)), 8 * [1] + [504])
