"""Boxes and integrals over named faces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from latin_fmu.fem.faces import face
from latin_fmu.fem.mesh import BOX_FACES, FacetSet, Mesh, boundary, box_mesh
from latin_fmu.fem.reference_cells import CELL_FACES


def test_box_nodes_cells_and_faces() -> None:
    mesh = box_mesh(np.array([1.0, 2.0, 3.0]), np.array([2.0, 3.0, 4.0]), (2, 3, 4))
    assert mesh.n_node == 3 * 4 * 5
    assert mesh.blocks[0].cells.shape == (24, 8)
    assert set(mesh.faces) == set(BOX_FACES)
    np.testing.assert_array_equal(mesh.extent(), [2.0, 3.0, 4.0])
    for axis, letter in enumerate("xyz"):
        for end, value in (("min", [1.0, 2.0, 3.0][axis]), ("max", [3.0, 5.0, 7.0][axis])):
            facets = mesh.faces[letter + end].blocks[0].facets
            counts = [2, 3, 4]
            counts[axis] = 1
            assert len(facets) == np.prod(counts)
            np.testing.assert_allclose(mesh.nodes[facets][..., axis], value)


@pytest.mark.parametrize("name", BOX_FACES)
def test_areas_and_normals_of_a_straight_face(straight: Mesh, name: str) -> None:
    surface = face(straight, name)
    axis, sign = "xyz".index(name[0]), 1.0 if name.endswith("max") else -1.0
    area = 1.2 / [1.0, 0.8, 1.5][axis]
    assert surface.areas.min() > 0
    assert surface.areas.sum() == pytest.approx(area, rel=1e-13)
    np.testing.assert_allclose(surface.normals, np.tile(sign * np.eye(3)[axis], (len(surface.nodes), 1)), atol=1e-14)
    np.testing.assert_allclose(surface.vector_areas, surface.areas[:, None] * surface.normals, atol=1e-15)
    assert (np.diff(surface.nodes) > 0).all()
    centre = (surface.areas[:, None] * straight.nodes[surface.nodes]).sum(axis=0) / area
    expected = np.array([0.8, 0.2, 0.85])
    expected[axis] += sign * [0.5, 0.4, 0.75][axis]
    np.testing.assert_allclose(centre, expected, rtol=1e-12)


def test_vector_areas_of_a_closed_surface_sum_to_nothing(warped: Mesh) -> None:
    """int n dA = 0 and int x . n dA = 3 V over the whole boundary, also where its quadrilaterals are warped."""
    total, flux = np.zeros(3), 0.0
    for name in BOX_FACES:
        surface = face(warped, name)
        total += surface.vector_areas.sum(axis=0)
        flux += float(np.sum(surface.vector_areas * warped.nodes[surface.nodes]))
        assert surface.areas.sum() >= np.linalg.norm(surface.vector_areas.sum(axis=0))
    np.testing.assert_allclose(total, 0.0, atol=1e-15)
    assert flux == pytest.approx(3 * volume(warped), rel=1e-12)


def test_pressure_on_a_closed_surface_has_no_moment(warped: Mesh) -> None:
    moment = np.zeros(3)
    for name in BOX_FACES:
        surface = face(warped, name)
        moment += np.cross(warped.nodes[surface.nodes], surface.vector_areas).sum(axis=0)
    np.testing.assert_allclose(moment, 0.0, atol=1e-14)


def volume(mesh: Mesh) -> float:
    """Volume by the divergence theorem on every cell: triangles, or quadrilaterals as bilinear patches."""
    single = 0.0
    (block,) = mesh.blocks
    for cell in block.cells:
        facets = cell[list(map(list, CELL_FACES[block.cell_type]))]
        alone = replace(mesh, faces={"all": FacetSet.of(facets)})
        surface = face(alone, "all")
        single += float(np.sum(surface.vector_areas * mesh.nodes[surface.nodes])) / 3
    return single


def test_facets_of_the_reference_cells_point_outwards() -> None:
    corners = {
        "hexahedron": np.array(
            [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
        ),
        "tetra": np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]),
    }
    for cell_type, nodes in corners.items():
        mesh = Mesh.uniform(nodes.astype(float), cell_type, np.arange(len(nodes))[None])
        for i, local in enumerate(CELL_FACES[cell_type]):
            surface = face(replace(mesh, faces={str(i): FacetSet.of(np.array([local]))}), str(i))
            outwards = nodes[list(local)].mean(axis=0) - nodes.mean(axis=0)
            assert float(surface.vector_areas.sum(axis=0) @ outwards) > 0


def test_a_sphere_has_the_normals_of_a_sphere() -> None:
    """Vector-area normals of a curved face: a cube blown up to a ball."""
    mesh = box_mesh(-np.ones(3), 2 * np.ones(3), (8, 8, 8))
    longest = np.abs(mesh.nodes).max(axis=1)[:, None]
    ball = mesh.nodes * np.divide(
        longest, np.linalg.norm(mesh.nodes, axis=1)[:, None], where=longest > 0, out=np.zeros_like(longest)
    )
    whole = replace(mesh, nodes=ball, faces={"skin": boundary(mesh)})
    surface = face(whole, "skin")
    assert surface.areas.sum() == pytest.approx(4 * np.pi, rel=0.02)
    assert np.einsum("pi,pi->p", surface.normals, ball[surface.nodes]).min() > 0.995
