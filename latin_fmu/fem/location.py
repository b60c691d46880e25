"""Points in and near a mesh: the cell that holds a point, the shape functions there, the nearest point of the surface,
mean motions of faces.

The reference coordinates xi of a point x in a cell solve x = sum_a N_a(xi) x_a, by Newton's method from the centre of
the cell; in straight tetrahedra the first step is exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.sparse as sp

from .faces import Face, Surface
from .mesh import Array, CellBlock, Index, Mask, Mesh
from .reference_cells import N_CORNER, cell_functions

_MARGIN: Final = 0.25  # of the extent of a cell: a curved one may bulge out of the box around its nodes
_STEPS, _SMALL = 30, 1e-13  # of Newton's method; change of the reference coordinates
INSIDE: Final = 1e-6
"""Distance from a reference cell up to which a point counts as inside: round-off of coordinates in files."""
_ROUND_OFF = 1e-10  # weights below it are zero


@dataclass(frozen=True)
class Location:
    """A point, or a mean over points, in terms of nodes: its motion is sum of weights times motions of the nodes.

    Attributes
    ----------
    nodes : (n,) node numbers. weights : (n,), their sum is 1.
    """

    nodes: Index
    weights: Array

    @staticmethod
    def of(nodes: Index, weights: Array) -> Location:
        """The location without nodes of negligible weight; a point at a node has that node alone."""
        mask = np.abs(weights) > _ROUND_OFF
        weights = weights[mask]
        # exactly 1 at a node
        return Location(nodes[mask], np.ones(1) if len(weights) == 1 else weights / weights.sum())

    def rows(self, n_node: int) -> sp.csr_array:
        """Motion (3, 3 n_node) of the location from those of all nodes."""
        return _rows(self.nodes, self.weights[:, None, None] * np.eye(3), n_node)


@dataclass(frozen=True)
class MeanMotion:
    """Rigid motion that fits the motion of some nodes best, with weights w_i (least squares):

        U = sum w_i u_i,   J Theta = sum w_i r_i x u_i,   J = sum w_i (r_i^2 1 - r_i r_i^T),   r_i from the centre

    The transposed rows spread a force by the weights, and a moment as the moment of forces w_i (J^-1 M) x r_i.

    Attributes
    ----------
    centre : (3,) weighted mean of the places, m. translation, rotation : (3, 3 n_node) rows of U and Theta, global
        axes; no rotation at a point of a solid. radius : size of the nodes around the centre (root mean square), m.
    """

    centre: Array
    translation: sp.csr_array
    rotation: sp.csr_array | None
    radius: float

    @staticmethod
    def of_face(nodes: Array, face: Face) -> MeanMotion:
        """Mean motion by area of a face of a mesh with these nodes (n_node, 3), m."""
        # int phi dA, negative at the corners of 8-node facets: sums of it are still the integrals over the face
        weights = face.areas / face.areas.sum()
        places = nodes[face.nodes]
        centre = weights @ places
        arms = places - centre
        squares = weights @ (arms**2).sum(axis=1)
        inertia = squares * np.eye(3) - np.einsum("n,ni,nj->ij", weights, arms, arms)
        turning = np.einsum("ij,njk->nik", np.linalg.inv(inertia), weights[:, None, None] * cross_matrix(arms))
        blocks = weights[:, None, None] * np.eye(3)
        rows = [_rows(face.nodes, part, len(nodes)) for part in (blocks, turning)]
        return MeanMotion(centre, rows[0], rows[1], float(np.sqrt(squares)))

    @staticmethod
    def of_point(point: Array, location: Location, n_node: int) -> MeanMotion:
        """Motion of a point (3,), m, of a solid."""
        return MeanMotion(point, location.rows(n_node), None, 0.0)

    def at(self, point: Array) -> sp.csr_array:
        """Motion (3, 3 n_node) of a point (3,), m, that follows the mean motion."""
        if self.rotation is None:
            return self.translation
        # U + Theta x arm = U - arm x Theta
        rows = sp.csr_array(self.translation - sp.csr_array(cross_matrix(point - self.centre)) @ self.rotation)
        rows.data[np.abs(rows.data) < _ROUND_OFF] = 0.0
        rows.eliminate_zeros()
        return rows


def cross_matrix(vectors: Array) -> Array:
    """Matrices S (..., 3, 3) with S u = v x u for vectors v (..., 3)."""
    return np.stack([np.cross(vectors, axis) for axis in np.eye(3)], axis=-1)  # columns v x e_j


def _rows(nodes: Index, blocks: Array, n_node: int) -> sp.csr_array:
    """Rows (3, 3 n_node) with blocks (n, 3, 3) at some nodes (n,)."""
    # for each component of the result, the dofs of all nodes
    columns = np.tile(3 * nodes[:, None] + np.arange(3), (3, 1, 1))
    at = np.repeat(np.arange(3), 3 * len(nodes))
    values = blocks.transpose(1, 0, 2).ravel()
    rows = sp.csr_array(sp.coo_array((values, (at, columns.ravel())), shape=(3, 3 * n_node)))
    rows.eliminate_zeros()
    return rows


def locate(mesh: Mesh, point: Array) -> Location | None:
    """The cell of a mesh that holds a point (3,), m, and the shape functions there; None where no cell does."""
    best, least = None, INSIDE  # only a cell nearer than this is taken
    for block in mesh.blocks:
        low, high = _boxes(mesh.nodes, block)
        candidates = block.cells[((low <= point) & (point <= high)).all(axis=1)]
        if not len(candidates):
            continue
        at = _reference(mesh.nodes[candidates] - point, block.cell_type)
        outside = _outside(at, block.cell_type)
        i = int(np.argmin(outside))
        if outside[i] <= least:
            least = outside[i]
            best = Location.of(candidates[i], cell_functions(block.cell_type).values(at[i : i + 1])[0])
    return best


def inside(mesh: Mesh, points: Array) -> Mask:
    """Which of some points (n, 3), m, lie in a cell of a mesh."""
    found = np.zeros(len(points), dtype=bool)
    for block in mesh.blocks:
        low, high = _boxes(mesh.nodes, block)
        cells = [np.flatnonzero(((low <= point) & (point <= high)).all(axis=1)) for point in points]
        point = np.repeat(np.arange(len(points)), [len(near) for near in cells])
        near = block.cells[np.concatenate([np.zeros(0, dtype=np.int64), *cells])]
        at = _reference(mesh.nodes[near] - points[point][:, None], block.cell_type)
        found[point[_outside(at, block.cell_type) <= INSIDE]] = True
    return found


def _boxes(nodes: Array, block: CellBlock) -> tuple[Array, Array]:
    """Corners (n_cell, 3) of the boxes around the cells of a block, somewhat enlarged."""
    places = nodes[block.cells]
    low, high = places.min(axis=1), places.max(axis=1)
    margin = _MARGIN * (high - low) + INSIDE * np.ptp(nodes, axis=0)
    return low - margin, high + margin


def _reference(arms: Array, cell_type: str) -> Array:
    """Reference coordinates (n, 3) of the origin in cells with nodes at ``arms`` (n, n_node, 3); NaN where Newton's
    method fails."""
    functions = cell_functions(cell_type)
    at = np.tile(functions.nodes[: N_CORNER[cell_type]].mean(axis=0), (len(arms), 1))
    with np.errstate(all="ignore"):
        for _ in range(_STEPS):
            residual = np.einsum("ca,cai->ci", functions.values(at), arms)
            jacobian = np.einsum("cak,cai->cik", functions.gradients(at), arms)
            # written so that NaN counts as singular
            singular = ~(np.abs(np.linalg.det(jacobian)) > 0.0)
            jacobian[singular], at[singular] = np.eye(3), np.nan  # one singular matrix would stop the solution of all
            step = np.linalg.solve(jacobian, residual[:, :, None])[:, :, 0]
            at -= np.clip(step, -1.0, 1.0)  # whole steps run away where a cell is strongly curved
            if np.nanmax(np.abs(step), initial=0.0) < _SMALL:
                break
    # the Jacobian is singular at the apex of a pyramid, where a node is
    distance = np.linalg.norm(arms, axis=2)
    nearest = distance.argmin(axis=1)
    at_node = np.isnan(at).any(axis=1) & (distance.min(axis=1) <= INSIDE * distance.max(axis=1))
    at[at_node] = functions.nodes[nearest[at_node]]
    # from a point outside a curved cell the steps may go round in circles, through places inside
    misfit = np.linalg.norm(np.einsum("ca,cai->ci", functions.values(at), arms), axis=1)
    at[misfit > INSIDE * distance.max(axis=1)] = np.nan
    return at


def _outside(at: Array, cell_type: str) -> Array:
    """How far reference coordinates (n, 3) are outside the reference cell, (n,); <= 0 inside, infinite for NaN."""
    corners = N_CORNER[cell_type]
    if corners in (5, 8):  # pyramids have the reference coordinates of hexahedra
        far = np.abs(at).max(axis=1) - 1.0
    elif corners == 4:
        far = np.maximum(-at.min(axis=1), at.sum(axis=1) - 1.0)
    else:
        triangle = np.maximum(-at[:, :2].min(axis=1), at[:, :2].sum(axis=1) - 1.0)
        far = np.maximum(triangle, np.abs(at[:, 2]) - 1.0)
    return np.asarray(np.where(np.isnan(far), np.inf, np.maximum(far, 0.0)))


def nearest_surface_point(surface: Surface, point: Array, within: float = np.inf) -> tuple[float, Array]:
    """Distance of a point (3,) from a surface, m, and the nearest point (3,) of its flat pieces; those whose boxes are
    farther than ``within`` are not looked at, and the distance is infinite where all are."""
    triangles, low, high = surface.triangles
    if np.isfinite(within):
        triangles = triangles[((low - within <= point) & (point <= high + within)).all(axis=1)]
        if not len(triangles):
            return np.inf, np.full(3, np.nan)
    near = _nearest_in(triangles, point)
    distance = np.linalg.norm(near - point, axis=1)
    i = int(np.argmin(distance))
    return float(distance[i]), near[i]


def _nearest_in(triangles: Array, point: Array) -> Array:
    """Nearest point (n, 3) of each triangle (n, 3, 3): the foot of the normal, or on an edge where that is outside."""
    choices = []
    for i in range(3):
        start, along = triangles[:, i], triangles[:, (i + 1) % 3] - triangles[:, i]
        share = np.einsum("ti,ti->t", point - start, along) / np.einsum("ti,ti->t", along, along)
        choices.append(start + np.clip(share, 0.0, 1.0)[:, None] * along)
    first, second = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    normal = np.cross(first, second)
    square = np.einsum("ti,ti->t", normal, normal)
    arm = point - triangles[:, 0]
    # coordinates of the foot along ``first`` and ``second``, by the areas of the parts of the triangle
    one = np.einsum("ti,ti->t", np.cross(arm, second), normal) / square
    two = np.einsum("ti,ti->t", np.cross(first, arm), normal) / square
    foot = triangles[:, 0] + one[:, None] * first + two[:, None] * second
    inside = (one >= 0.0) & (two >= 0.0) & (one + two <= 1.0)
    choices.append(np.where(inside[:, None], foot, np.inf))
    every = np.stack(choices, axis=1)
    with np.errstate(invalid="ignore"):
        closest = np.argmin(np.linalg.norm(every - point, axis=2), axis=1)
    return np.asarray(every[np.arange(len(every)), closest])


def thicknesses(surface: Surface, points: Array, directions: Array) -> Array:
    """Way (n,), m, from points (n, 3) of a closed surface along unit directions (n, 3) into the body to where it is
    left; infinite where that is not found.

    Intersections of a line with triangles by Moller and Trumbore, Journal of Graphics Tools 2 (1997) 21-28.
    """
    corners = surface.triangles[0]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    near = 1e-6 * surface.size
    lengths = np.full(len(points), np.inf)
    for i, (point, direction) in enumerate(zip(points, directions, strict=True)):
        across = np.cross(direction, second)
        volume = np.einsum("ti,ti->t", first, across)
        # along the triangle: no intersection
        scale = np.where(np.abs(volume) > 1e-12 * np.abs(volume).max(), volume, np.inf)
        arm = point - corners[:, 0]
        u = np.einsum("ti,ti->t", arm, across) / scale
        turned = np.cross(arm, first)
        v = turned @ direction / scale
        way = np.einsum("ti,ti->t", second, turned) / scale
        hit = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1.0 + 1e-9) & (way > near)
        lengths[i] = way[hit].min(initial=np.inf)
    return lengths
