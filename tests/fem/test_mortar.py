"""Contracts of the mortar traces on every kind of facet: T 1 = 1, equal places, T^T area = int phi on both sides."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from latin_fmu.fem.faces import (
    ALPHA,
    Surface,
    face_of,
    facet_change,
    shape,
    slopes,
    square_quadrature,
    triangle_quadrature,
)
from latin_fmu.fem.mesh import FacetSet
from latin_fmu.fem.mortar import Mortar, areas, clip, mortar

Array = np.ndarray
KINDS = ("triangle", "quad", "triangle6", "quad8", "quad9")
PLANE: Callable[[Array], Array] = lambda x: np.column_stack([x, np.zeros(len(x))])  # noqa: E731


def sheet(
    kind: str,
    n: int,
    m: int,
    size: tuple[float, float] = (1.0, 1.0),
    start: tuple[float, float] = (0.0, 0.0),
    shape_of: Callable[[Array], Array] = PLANE,
    up: bool = True,
    skew: float = 0.0,
) -> Surface:
    """n x m rectangles of facets, mapped to space; ``up`` : normals along +z of the plane sheet."""
    fine = kind in ("triangle6", "quad8", "quad9")
    step = 2 if fine else 1
    x, y = (
        start[0] + size[0] * np.arange(step * n + 1) / (step * n),
        start[1] + size[1] * np.arange(step * m + 1) / (step * m),
    )
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    number = np.arange(grid[..., 0].size).reshape(grid.shape[:2])
    a, b, c, d = (
        number[i : i + step * n : step, j : j + step * m : step].ravel()
        for i, j in ((0, 0), (step, 0), (step, step), (0, step))
    )
    flat = grid.reshape(-1, 2)
    flat = flat + skew * np.stack([flat[:, 0] * flat[:, 1] * (1 - flat[:, 0]), 0 * flat[:, 0]], axis=1)
    if kind.startswith("triangle"):
        corners = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    else:
        corners = np.stack([a, b, c, d], 1)
    if not up:
        corners = corners[:, ::-1]
    facets = corners
    if fine:
        lookup = {tuple(np.round(p, 9)): i for i, p in enumerate(grid.reshape(-1, 2))}
        raw = grid.reshape(-1, 2)
        middles = [
            [lookup[tuple(np.round(0.5 * (raw[f[i]] + raw[f[(i + 1) % len(f)]]), 9))] for i in range(len(f))]
            for f in corners
        ]
        facets = np.concatenate([corners, np.array(middles)], axis=1)
        if kind == "quad9":
            facets = np.column_stack([facets, [lookup[tuple(np.round(raw[f].mean(axis=0), 9))] for f in corners]])
    return Surface(shape_of(flat), FacetSet.of(facets.astype(np.int64)))


def integrals(surface: Surface) -> Array:
    """int phi over the whole face, for every node of the mesh."""
    face = face_of(surface.nodes, surface.facets)
    whole = np.zeros(len(surface.nodes))
    whole[face.nodes] = face.areas
    return whole


def check_contract(coupling: Mortar, owner: Surface, other: Surface, tolerance: float) -> None:
    for trace in (coupling.owner, coupling.other):
        assert np.abs(trace.sum(axis=1) - 1).max() < tolerance
    assert np.abs(coupling.owner @ owner.nodes - coupling.other @ other.nodes).max() < tolerance
    assert (coupling.areas > 0).all()


@pytest.mark.parametrize("mine", KINDS)
@pytest.mark.parametrize("theirs", KINDS)
def test_whole_faces(mine: str, theirs: str) -> None:
    owner, other = sheet(mine, 4, 3), sheet(theirs, 3, 5, up=False)
    coupling = mortar(owner, other)
    assert coupling is not None
    check_contract(coupling, owner, other, 1e-12)
    assert coupling.owner.T @ coupling.areas == pytest.approx(integrals(owner), abs=1e-14)
    assert coupling.other.T @ coupling.areas == pytest.approx(integrals(other), abs=1e-14)
    assert coupling.normals == pytest.approx(np.tile([0.0, 0.0, 1.0], (len(coupling.areas), 1)), abs=1e-14)
    assert coupling.shares == pytest.approx(1.0)
    assert coupling.covered == pytest.approx(1.0)


@pytest.mark.parametrize("mine", ["triangle6", "quad8", "quad9"])
@pytest.mark.parametrize("theirs", KINDS)
def test_points_at_corners(mine: str, theirs: str) -> None:
    """Linear fields pass exactly, and uniform pressures have the forces of both faces, at the corners alone."""
    owner, other = sheet(mine, 4, 3), sheet(theirs, 3, 5, up=False)
    coupling = mortar(owner, other, corners=True)
    assert coupling is not None
    assert len(coupling.areas) == 5 * 4
    check_contract(coupling, owner, other, 1e-12)
    assert coupling.owner.T @ coupling.areas == pytest.approx(integrals(owner), abs=1e-14)
    assert coupling.other.T @ coupling.areas == pytest.approx(integrals(other), abs=1e-14)
    assert coupling.shares == pytest.approx(1.0)


@pytest.mark.parametrize("kind", KINDS)
def test_turned_facets_look_the_other_way(kind: str) -> None:
    one = sheet(kind, 3, 2)
    back = Surface(one.nodes, one.facets.turned)
    assert face_of(back.nodes, back.facets).areas == pytest.approx(face_of(one.nodes, one.facets).areas)
    assert back.pieces[0].normals == pytest.approx(-one.pieces[0].normals)
    # the middle nodes still stand in the middle of the edges
    assert np.ptp(np.concatenate([p.areas for p in back.pieces])) < 1e-12


@pytest.mark.parametrize("kind", KINDS)
def test_a_face_on_itself_needs_no_other_nodes(kind: str) -> None:
    """Equal meshes: the traces of both sides are one, the identity where the areas of the nodes are positive."""
    owner, other = sheet(kind, 3, 2), sheet(kind, 3, 2, up=False)
    coupling = mortar(owner, other)
    assert coupling is not None
    assert np.abs((coupling.owner - coupling.other).toarray()).max() < 1e-12
    if kind in ("triangle", "quad", "quad9"):
        assert np.abs(coupling.owner.toarray() - np.eye(len(owner.nodes))).max() < 1e-12


@pytest.mark.parametrize("kind", KINDS)
def test_partly_covered(kind: str) -> None:
    """Linear fields pass exactly and int phi of the covered part is that of the other face, wholly covered."""
    owner, other = sheet(kind, 5, 4), sheet("quad", 3, 2, (0.43, 0.51), (0.21, 0.18), up=False)
    coupling = mortar(owner, other)
    assert coupling is not None
    check_contract(coupling, owner, other, 1e-10)
    assert coupling.other.T @ coupling.areas == pytest.approx(integrals(other), abs=1e-12)
    assert coupling.areas.sum() == pytest.approx(0.43 * 0.51)
    assert coupling.shares.min() > 0.05
    assert coupling.covered < 0.99


@pytest.mark.parametrize("share", [1e-1, 1e-3, 1e-5])
def test_slivers_leave_no_point_with_little_area(share: float) -> None:
    owner = sheet("quad", 6, 6)
    edge = (2 + np.sqrt(2 * share)) / 6  # a strip of the next facets, whose far nodes have this share of their area
    other = sheet("quad", 5, 5, (edge, edge), (1 / 6, 1 / 6), up=False)
    raw, coupling = mortar(owner, other, least=0.0), mortar(owner, other)
    assert raw is not None
    assert coupling is not None
    assert raw.shares.min() < share
    check_contract(coupling, owner, other, 1e-10)
    assert coupling.areas.min() > 0.2 / 36
    assert np.abs(coupling.other.toarray()).max() < 2.0


def test_distorted_quadrilaterals() -> None:
    """Functions that are no polynomials in the plane: identities to round-off, int phi to the quadrature."""
    owner, other = sheet("quad", 4, 4, skew=0.8), sheet("quad", 3, 3, skew=-0.6, up=False)
    coupling = mortar(owner, other)
    assert coupling is not None
    check_contract(coupling, owner, other, 1e-12)
    assert coupling.other.T @ coupling.areas == pytest.approx(integrals(other), abs=1e-9)


def arc(radius: float) -> Callable[[Array], Array]:
    return lambda x: np.stack([radius * np.sin(x[:, 0]), x[:, 1], radius * np.cos(x[:, 0])], axis=1)


@pytest.mark.parametrize("kind", KINDS)
def test_curved_faces_meet_to_the_chord(kind: str) -> None:
    """Two meshes of one cylinder: the distance between them is of the order of that of the chords, and reported; of
    quadratic facets it is that of parabolas from the circle."""
    owner, other = sheet(kind, 8, 2, shape_of=arc(1.0)), sheet(kind, 6, 3, shape_of=arc(1.0), up=False)
    coupling = mortar(owner, other)
    assert coupling is not None
    curved = kind in ("triangle6", "quad8", "quad9")
    assert (np.abs(coupling.distance) < (1 if curved else 2) * coupling.sags).all()
    expected = sum((h**4 / 512 if curved else h**2 / 8) for h in (1 / 6, 1 / 8))
    # diagonals of triangles are longer than their heights
    assert expected / 1.1 < coupling.sags.max() < (3.0 if kind == "triangle6" else 1.1) * expected
    radial = coupling.owner @ owner.nodes * [1, 0, 1]
    cosine = np.einsum("pi,pi->p", coupling.normals, radial / np.linalg.norm(radial, axis=1)[:, None])
    inner = np.abs(coupling.owner @ owner.nodes)[:, 0] > 0
    assert cosine[inner].min() > 1 - 5e-3


def test_a_closed_face_has_its_own_side_only() -> None:
    """Shaft in a bore: no facet meets those on the far side of the axis."""
    full = 2 * np.pi
    shaft = sheet("quad", 24, 2, (full, 1.0), shape_of=arc(1.0))
    bore = sheet("quad", 16, 3, (full, 1.0), shape_of=arc(1.0), up=False)
    coupling = mortar(shaft, bore)
    assert coupling is not None
    area = 2 * 24 * np.sin(full / 48)
    assert coupling.areas.sum() == pytest.approx(area, rel=1e-3)
    assert np.linalg.norm(coupling.vector_areas.sum(axis=0)) < 1e-12
    jump = np.linalg.norm(coupling.other @ bore.nodes - coupling.owner @ shaft.nodes, axis=1)
    assert jump.max() < 0.05


def test_reach_leaves_out_what_is_farther() -> None:
    owner = sheet("quad", 4, 4)
    near, far = np.array([0.0, 0.0, 0.01]), np.array([0.0, 0.0, 0.2])
    other = sheet("quad", 3, 3, up=False)
    assert mortar(owner, Surface(other.nodes + near, other.facets), 0.02) is not None
    assert mortar(owner, Surface(other.nodes + far, other.facets), 0.02) is None
    assert mortar(owner, Surface(other.nodes + far, other.facets)) is not None


def test_faces_that_look_the_same_way_have_nothing_in_common() -> None:
    assert mortar(sheet("quad", 2, 2), sheet("quad", 3, 3)) is None


@pytest.mark.parametrize("kind", KINDS)
def test_shape_functions_of_facets(kind: str) -> None:
    at = np.random.default_rng(1).random((7, 2))
    assert shape(kind, at).sum(axis=1) == pytest.approx(1.0)
    h = 1e-6
    measured = np.stack([(shape(kind, at + h * e) - shape(kind, at - h * e)) / (2 * h) for e in np.eye(2)], axis=-1)
    assert slopes(kind, at) == pytest.approx(measured, abs=1e-8)


@pytest.mark.parametrize(
    ("kind", "plain", "positive"),
    [("triangle6", (0, 1 / 3), (2 / 15, 1 / 5)), ("quad8", (-1 / 12, 1 / 3), (1 / 20, 1 / 5))],
)
def test_areas_after_the_change_of_basis(kind: str, plain: tuple[float, float], positive: tuple[float, float]) -> None:
    """int phi over the facet's area, at corners and middles (alpha = 1/5)."""
    assert ALPHA == 0.2
    points, weights = triangle_quadrature(4) if kind == "triangle6" else square_quadrature(3)
    whole = weights @ shape(kind, points) / weights.sum()
    changed = facet_change(kind, True).T @ whole
    n = len(whole) // 2
    for actual, expected in ((whole, plain), (changed, positive)):
        assert actual[:n] == pytest.approx(expected[0], abs=1e-14)
        assert actual[n:] == pytest.approx(expected[1])


def test_clipped_polygons() -> None:
    """Against squares moved over each other: areas in closed form; none where they do not meet."""
    square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    moves = np.array([[0.0, 0], [0.3, 0.4], [-0.9, 0.2], [2, 0], [0, -1.5]])
    corners, count = clip(square[None] + moves[:, None], np.repeat(square[None], len(moves), axis=0))
    expected = np.prod(np.clip(1 - np.abs(moves), 0, None), axis=1)
    assert np.where(count > 2, areas(corners), 0) == pytest.approx(expected)
    turned = np.array([[0.5, -0.2], [1.2, 0.5], [0.5, 1.2], [-0.2, 0.5]])
    corners, count = clip(turned[None], square[None])
    assert count[0] == 8
    assert areas(corners)[0] == pytest.approx(1 - 4 * 0.5 * 0.3**2)


def renumbered(surface: Surface, order: Array) -> Surface:
    """The surface with node ``order[i]`` as its i-th one, and its facets the other way round."""
    place = np.argsort(order)
    blocks = surface.facets.blocks
    return Surface(surface.nodes[order], FacetSet.of(*(place[block.facets][::-1] for block in blocks)))


@pytest.mark.parametrize("kind", ["quad", "quad9"])
@pytest.mark.parametrize("seed", range(5))
def test_the_order_of_the_nodes_does_not_count(kind: str, seed: int) -> None:
    """A patch that covers facets of a regular face in part: its slivers have neighbours that are equally near."""
    rng = np.random.default_rng(seed)
    owner = sheet(kind, 4, 4)
    other = sheet("quad", 3, 3, (0.6, 0.6), (0.2, 0.2), up=False)
    order = rng.permutation(len(owner.nodes))
    first, second = mortar(owner, other), mortar(renumbered(owner, order), other)
    assert first is not None
    assert second is not None
    assert len(second.areas) == len(first.areas)
    # by place: points of one face do not share theirs
    back = np.empty_like(order)
    back[order] = np.arange(len(order))
    found, expected = second.owner.toarray()[:, back], first.owner.toarray()
    places = found @ owner.nodes, expected @ owner.nodes
    match = [int(np.linalg.norm(places[0] - place, axis=1).argmin()) for place in places[1]]
    assert sorted(match) == list(range(len(first.areas)))
    assert found[match] == pytest.approx(expected, abs=1e-12)
    assert second.other.toarray()[match] == pytest.approx(first.other.toarray(), abs=1e-12)
    assert second.areas[match] == pytest.approx(first.areas, rel=1e-12)
