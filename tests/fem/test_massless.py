"""Mass moved away from contact nodes: totals kept, contact nodes bare, nothing negative."""

from __future__ import annotations

import numpy as np
import pytest

from latin_fmu.fem.elasticity import mass
from latin_fmu.fem.elements import Elements
from latin_fmu.fem.massless import without_contact_mass
from latin_fmu.fem.mesh import box_mesh


def bodies(elements, faces):
    mesh = box_mesh(np.zeros(3), np.array([1.0, 2.0, 3.0]), elements)
    nodes = np.unique(np.concatenate([mesh.faces[f].nodes for f in faces]))
    full = mass(Elements(mesh), 7.0)
    return mesh, nodes, full


@pytest.mark.parametrize("faces", [("zmin",), ("zmin", "zmax"), ("xmin", "zmin"), ("xmin", "ymin", "zmin")])
def test_total_mass_and_bare_nodes(faces):
    """Translations keep their kinetic energy, also where contact faces share edges and a corner."""
    mesh, nodes, full = bodies((3, 3, 4), faces)
    moved = without_contact_mass(full, mesh, nodes)
    for axis in range(3):
        push = np.zeros((mesh.n_node, 3))
        push[:, axis] = 1.0
        assert push.ravel() @ moved @ push.ravel() == pytest.approx(7.0 * 6.0, rel=1e-12)
    bare = (3 * nodes[:, None] + np.arange(3)).ravel()
    assert abs(moved[bare]).max() == 0.0
    assert np.linalg.eigvalsh(moved.toarray()).min() > -1e-12
    assert abs(moved - moved.T).max() < 1e-14


def test_one_element_between_contacts_is_refused():
    mesh, nodes, full = bodies((2, 2, 1), ("zmin", "zmax"))
    with pytest.raises(ValueError, match="inner neighbour"):
        without_contact_mass(full, mesh, nodes)
