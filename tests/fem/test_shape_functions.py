"""Shape functions and integration rules: against scikit-fem, closed integrals, and the faces of the cells."""

from __future__ import annotations

from math import factorial

import numpy as np
import pytest
import skfem

from latin_fmu.fem.reference_cells import CELL_FACES, cell_functions, cell_rule, mirrored, simplex_rule

from .meshes import places_of

TYPES = tuple(CELL_FACES)
SKFEM = {
    "hexahedron": skfem.ElementHex1,
    "hexahedron20": skfem.ElementHexS2,
    "hexahedron27": skfem.ElementHex2,
    "tetra": skfem.ElementTetP1,
    "tetra10": skfem.ElementTetP2,
    "wedge": skfem.ElementWedge1,
}


@pytest.mark.parametrize("cell_type", SKFEM)  # it lacks the wedges of 15 and 18 nodes and the pyramids
def test_functions_are_those_of_scikit_fem(cell_type: str) -> None:
    """The same reference cell up to [0, 1] for [-1, 1]; its functions found by the place where they are one."""
    element, ours = SKFEM[cell_type](), cell_functions(cell_type)
    scale = {"hexahedron": [2, 2, 2], "wedge": [1, 1, 2]}.get(cell_type[:10], [1, 1, 1])
    scale = np.array(scale, dtype=float)
    shift = np.where(scale == 2, 1.0, 0.0)
    points = np.random.default_rng(2).uniform(0.1, 0.3, (5, 3))
    theirs = (ours.nodes + shift) / scale
    values, slopes = ours.values(points * scale - shift), ours.gradients(points * scale - shift) * scale
    seen = set()
    for i in range(len(element.doflocs)):
        (node,) = np.flatnonzero(np.abs(theirs - element.doflocs[i]).max(axis=1) < 1e-12)
        value, slope = element.lbasis(points.T, i)
        np.testing.assert_allclose(values[:, node], value, atol=1e-14)
        np.testing.assert_allclose(slopes[:, node], np.asarray(slope).T, atol=1e-13)
        seen.add(int(node))
    assert len(seen) == len(ours.nodes)


@pytest.mark.parametrize("cell_type", TYPES)
def test_nodes_of_a_face_lie_in_its_plane(cell_type: str) -> None:
    nodes = places_of(cell_type)
    for local in CELL_FACES[cell_type]:
        x = nodes[list(local)]
        normal = np.cross(x[1] - x[0], x[2] - x[0])
        assert np.abs((x - x[0]) @ normal).max() < 1e-14
        assert (nodes.mean(axis=0) - x[0]) @ normal < 0  # outwards
        on_plane = np.flatnonzero(np.abs((nodes - x[0]) @ normal) < 1e-12)
        assert set(on_plane) == set(local)


@pytest.mark.parametrize("cell_type", TYPES)
def test_mirrored_numbering_is_its_own_inverse_and_turns_the_cell(cell_type: str) -> None:
    turned = np.array(mirrored(cell_type))
    assert (turned[turned] == np.arange(len(turned))).all()
    functions = cell_functions(cell_type)
    slopes = functions.gradients(cell_rule(cell_type).points)
    jacobian = np.einsum("pak,ai->pik", slopes, places_of(cell_type)[turned])
    pyramid = cell_type.startswith("pyramid")
    shrunk = 0.25 * (1 - cell_rule(cell_type).points[:, 2]) ** 2 if pyramid else 1.0
    np.testing.assert_allclose(np.linalg.det(jacobian), -shrunk, rtol=1e-12)


def test_rule_of_the_simplex_is_exact_to_its_degree() -> None:
    for n in (1, 2, 3):
        rule = simplex_rule(n, 3)
        assert rule.weights.min() > 0
        for a in range(2 * n):
            for b in range(2 * n - a):
                c = 2 * n - 1 - a - b
                exact = factorial(a) * factorial(b) * factorial(c) / factorial(a + b + c + 3)
                powers = np.prod(rule.points ** np.array([a, b, c]), axis=1)
                assert rule.weights @ powers == pytest.approx(exact, rel=1e-13)


@pytest.mark.parametrize(("cell_type", "products"), [(t, p) for t in TYPES for p in (False, True)])
def test_rules_integrate_what_they_are_for(cell_type: str, products: bool) -> None:
    """Volume of the cell, and squares of its functions by a rule of degree 9 (constant Jacobian)."""
    rule = cell_rule(cell_type, products)
    assert rule.weights.sum() == pytest.approx({"t": 1 / 6, "w": 1.0, "h": 8.0, "p": 8.0}[cell_type[0]], rel=1e-14)
    if not products:
        return
    functions = cell_functions(cell_type)
    fine = np.polynomial.legendre.leggauss(5)
    if cell_type[0] == "t":
        points, weights = simplex_rule(5, 3).points, simplex_rule(5, 3).weights
    elif cell_type[0] == "w":
        flat = simplex_rule(5, 2)
        points = np.array([[*p, z] for p in flat.points for z in fine[0]])
        weights = np.outer(flat.weights, fine[1]).ravel()
    else:
        points = np.stack(np.meshgrid(*[fine[0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
        weights = np.einsum("i,j,k->ijk", *[fine[1]] * 3).ravel()
    exact = functions.values(points).T @ (weights[:, None] * functions.values(points))
    actual = functions.values(rule.points).T @ (rule.weights[:, None] * functions.values(rule.points))
    np.testing.assert_allclose(actual, exact, atol=1e-14)
