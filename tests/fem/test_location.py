"""Points in meshes of every type of cell: exact interpolation there, distance and nearest point outside."""

from __future__ import annotations

import numpy as np
import pytest

from latin_fmu.fem.faces import Surface
from latin_fmu.fem.location import locate, nearest_surface_point
from latin_fmu.fem.mesh import CellBlock, Mesh, boundary, box_mesh
from latin_fmu.fem.reference_cells import TET_EDGES

from .meshes import ORIGIN, QUADRATIC, SIZE, TYPES, cut, typed_box

INNER = ORIGIN + SIZE * np.random.default_rng(3).uniform(0.02, 0.98, (6, 3))


def polynomial(x: np.ndarray, degree: int) -> np.ndarray:
    """A field of this degree at points (n, 3)."""
    linear = 0.3 + x @ np.array([1.0, -2.0, 0.5])
    return linear if degree == 1 else linear**2 + x[:, 0] * x[:, 2]


@pytest.mark.parametrize("cell_type", TYPES)
@pytest.mark.parametrize("point", INNER, ids=lambda p: f"{p[0]:.2f}")
def test_polynomials_of_the_degree_of_the_cells_are_exact(cell_type: str, point: np.ndarray) -> None:
    degree = 2 if cell_type in QUADRATIC else 1
    mesh = typed_box(cell_type, shift=0.0 if degree == 2 else 0.1)
    place = locate(mesh, point)
    assert place is not None
    assert place.weights.sum() == pytest.approx(1.0, abs=1e-14)
    value = place.weights @ polynomial(mesh.nodes[place.nodes], degree)
    assert value == pytest.approx(polynomial(point[None], degree)[0], rel=1e-11)


@pytest.mark.parametrize("cell_type", TYPES)
def test_a_point_at_a_node_has_that_node_alone(cell_type: str) -> None:
    mesh = typed_box(cell_type, shift=0.1)
    for node in (0, 7, mesh.n_node // 2, mesh.n_node - 1):
        place = locate(mesh, mesh.nodes[node])
        assert place is not None
        assert place.nodes.tolist() == [node]
        assert place.weights.tolist() == [1.0]


def test_the_apex_of_pyramids() -> None:
    """In the middle of a cube, where the Jacobian of all six is singular."""
    mesh = cut(box_mesh(np.zeros(3), np.ones(3), (1, 1, 1)), "pyramid")
    place = locate(mesh, mesh.nodes[-1])
    assert place is not None
    assert place.nodes.tolist() == [mesh.n_node - 1]


def test_a_point_in_a_curved_cell() -> None:
    """Cells of 27 nodes bent around an axis hold the map of any reference point."""
    mesh = typed_box("hexahedron27")
    angle, radius = 0.3 * mesh.nodes[:, 0], 2.0 + mesh.nodes[:, 1]
    bent = Mesh(np.stack([radius * np.sin(angle), radius * np.cos(angle), mesh.nodes[:, 2]], axis=1), mesh.blocks, {})
    inner = locate(mesh, INNER[2])
    assert inner is not None
    mapped = inner.weights @ bent.nodes[inner.nodes]
    place = locate(bent, mapped)
    assert place is not None
    assert place.weights @ bent.nodes[place.nodes] == pytest.approx(mapped, abs=1e-12)


def test_points_outside_strongly_curved_cells_are_in_none() -> None:
    """Tetrahedra with middle nodes off by up to 15 %: where a cell is found for a point, it maps to the point."""
    rng, corners, found = np.random.default_rng(1), np.vstack([np.zeros(3), np.eye(3)]), 0
    middles = corners[np.array(TET_EDGES)].mean(axis=1)
    for _ in range(40):
        nodes = np.vstack([corners, middles + rng.uniform(-0.15, 0.15, (6, 3))])
        mesh = Mesh(nodes, (CellBlock("tetra10", np.arange(10)[None]),), {})
        for point in rng.uniform(-0.4, 1.4, (20, 3)):
            if (place := locate(mesh, point)) is not None:
                found += 1
                assert place.weights @ nodes[place.nodes] == pytest.approx(point, abs=1e-5)
    assert found > 10


@pytest.mark.parametrize("cell_type", ["hexahedron", "tetra", "wedge"])
@pytest.mark.parametrize(
    ("offset", "near"),
    [((0.0, 0.0, 2e-3), (0.5, 0.4, 1.0)), ((0.1, 0.0, 0.2), (1.0, 0.4, 1.0)), ((0.1, -0.2, 0.2), (1.0, 0.0, 1.0))],
    ids=["face", "edge", "corner"],
)
def test_outside_of_a_box(cell_type: str, offset: tuple[float, ...], near: tuple[float, ...]) -> None:
    mesh = typed_box(cell_type)
    foot = ORIGIN + SIZE * (0.5, 0.4, 1.0)
    foot = np.where(np.array(near) == (0.5, 0.4, 1.0), foot, ORIGIN + SIZE * np.array(near))
    point = foot + np.array(offset)
    assert locate(mesh, point) is None
    surface, away = Surface(mesh.nodes, boundary(mesh)), float(np.linalg.norm(offset))
    for within in (np.inf, 1.001 * away):
        distance, nearest = nearest_surface_point(surface, point, within)
        assert distance == pytest.approx(away, rel=1e-12)
        assert nearest == pytest.approx(foot, abs=1e-12)
    assert nearest_surface_point(surface, point, 0.5 * away)[0] > away


def test_round_off_of_a_file_is_inside() -> None:
    mesh = typed_box("tetra10")
    assert locate(mesh, ORIGIN + SIZE * (0.4, 0.3, 1.0) + (0.0, 0.0, 1e-8)) is not None
    assert locate(mesh, ORIGIN + SIZE * (0.4, 0.3, 1.0) + (0.0, 0.0, 1e-5)) is None
