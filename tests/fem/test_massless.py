"""Mass moved away from contact nodes: totals kept, contact nodes bare, nothing negative."""

from __future__ import annotations

import numpy as np
import pytest

from latin_fmu.fem.contact_layer import without_contact_mass
from latin_fmu.fem.elements import Elements, mass
from latin_fmu.fem.mesh import box_mesh
from latin_fmu.fem.reference_cells import CELL_LINKS, cell_functions

from .meshes import QUADRATIC, SIZE, TYPES, typed_box


def bodies(elements, faces):
    mesh = box_mesh(np.zeros(3), np.array([1.0, 2.0, 3.0]), elements)
    nodes = np.unique(np.concatenate([mesh.faces[f].nodes for f in faces]))
    full = mass(Elements(mesh), 7.0)
    return mesh, nodes, full


@pytest.mark.parametrize("several_layers", [False, True])
@pytest.mark.parametrize("faces", [("zmin",), ("zmin", "zmax"), ("xmin", "zmin"), ("xmin", "ymin", "zmin")])
def test_total_mass_and_bare_nodes(faces, several_layers):
    """Translations keep their kinetic energy, also where contact faces share edges and a corner."""
    mesh, nodes, full = bodies((3, 3, 4), faces)
    moved, _ = without_contact_mass(full, mesh, nodes, several_layers)
    for axis in range(3):
        push = np.zeros((mesh.n_node, 3))
        push[:, axis] = 1.0
        assert push.ravel() @ moved @ push.ravel() == pytest.approx(7.0 * 6.0, rel=1e-12)
    bare = (3 * nodes[:, None] + np.arange(3)).ravel()
    assert abs(moved[bare]).max() == 0.0
    assert np.linalg.eigvalsh(moved.toarray()).min() > -1e-12
    assert abs(moved - moved.T).max() < 1e-14


@pytest.mark.parametrize(("elements", "layers"), [(8, 4), (3, 3), (1, 1)])
def test_mass_spread_over_several_layers_is_shared_evenly(elements, layers):
    """A push of one layer alone meets its own mass, and one part of that of the contact face."""
    mesh, nodes, full = bodies((2, 2, elements), ("zmin",))
    moved, _ = without_contact_mass(full, mesh, nodes, several_layers=True)
    level = np.rint(mesh.nodes[:, 2] / 3.0 * elements).astype(int)
    height = 3.0 / elements
    area = 7.0 * 2.0
    own = np.full(elements + 1, area * height)  # of each level of nodes, all its couplings lumped
    own[[0, -1]] *= 0.5
    got = np.bincount(level, (moved @ np.tile([0.0, 0.0, 1.0], mesh.n_node))[2::3])
    expected = own + np.where((np.arange(elements + 1) > 0) & (np.arange(elements + 1) <= layers), own[0] / layers, 0.0)
    expected[0] = 0.0
    np.testing.assert_allclose(got, expected, rtol=1e-12, atol=1e-12 * area)


def test_one_element_between_contacts_keeps_its_mass():
    mesh, nodes, full = bodies((2, 2, 1), ("zmin", "zmax"))
    moved, left = without_contact_mass(full, mesh, nodes)
    assert (left == nodes).all()
    assert abs(moved - full).max() == 0.0


@pytest.mark.parametrize("cell_type", TYPES)
def test_every_type_of_cell_keeps_its_mass(cell_type):
    """One layer of quadratic cells between two contacts has inner nodes enough."""
    mesh = typed_box(cell_type, (2, 2, 1 if cell_type in QUADRATIC else 3), shift=0.1)
    nodes = np.union1d(mesh.faces["zmin"].nodes, mesh.faces["zmax"].nodes)
    full = mass(Elements(mesh), 7.0)
    moved, _ = without_contact_mass(full, mesh, nodes)
    push = np.tile([0.0, 1.0, 0.0], mesh.n_node)
    assert push @ moved @ push == pytest.approx(7.0 * np.prod(SIZE), rel=1e-12)
    bare = (3 * nodes[:, None] + np.arange(3)).ravel()
    assert abs(moved[bare]).max() == 0.0
    assert np.linalg.eigvalsh(moved.toarray()).min() > -1e-12


@pytest.mark.parametrize("cell_type", CELL_LINKS)
def test_neighbours_are_joined_by_straight_lines_without_a_node_between(cell_type):
    """Half edges have half the length of edges; every node has a neighbour."""
    nodes, links = cell_functions(cell_type).nodes, np.array(CELL_LINKS[cell_type])
    assert set(links.ravel()) == set(range(len(nodes)))
    assert len({frozenset(pair) for pair in links.tolist()}) == len(links)
    for a, b in links:
        middle = 0.5 * (nodes[a] + nodes[b])
        assert np.linalg.norm(nodes - middle, axis=1).min() > 1e-9


@pytest.mark.parametrize("cell_type", ["hexahedron", "hexahedron27"])
def test_contact_nodes_follow_the_node_above(cell_type):
    """What does not change along the normal keeps its kinetic energy."""
    mesh = typed_box(cell_type, (3, 2, 3))
    full = mass(Elements(mesh), 7.0)
    moved, _ = without_contact_mass(full, mesh, mesh.faces["zmin"].nodes)
    along = np.zeros((mesh.n_node, 3))
    along[:, 2] = mesh.nodes[:, 0] ** 2
    assert along.ravel() @ moved @ along.ravel() == pytest.approx(along.ravel() @ full @ along.ravel(), rel=1e-12)
