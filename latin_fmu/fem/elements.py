"""Isoparametric elements of a mesh: stiffness, mass and body loads of linear elasticity, Eqs. (3), (5), rigid
motions, strains and stresses.

Incompatible modes of 8-node hexahedra: internal displacements that let an element bend.

    u = N d + sum_m (1 - xi_m^2) a_m,      m = 1, 2, 3

The nine internal unknowns a of an element (Wilson et al. 1973) are eliminated inside it, a = -K_aa^-1 K_ad d, so that
nodes, faces and unknowns of the mesh stay what they are. Their gradients are taken with the Jacobian J_0 of the
element's centre (Taylor, Beresford, Wilson 1976),

    grad_x m = det J_0 / det J  J_0^-T grad_xi m,     hence  int grad_x m dV = 0,

which makes uniform strain exact on distorted elements (patch test). The mass is that of the nodes alone.

Uniform strain of 8-node hexahedra with the reduced rule: the mean b of grad N over the element at all its points, and
a stiffness against the twelve displacements that make no mean strain (hourglass modes; Flanagan, Belytschko,
Int. J. Numer. Meth. Engng. 17, 1981),

    K = V B^T C B + c E V (sum b . b) sum_k gamma_k gamma_k^T I,     gamma_k = h_k - b . (x^T h_k)

h_k the corners' eta zeta, xi zeta, xi eta, xi eta zeta of +-1, x the corners: linear displacements have no part in
gamma, so that uniform strain is exact. c = 5e-4 and E of an isotropic material, C_1111 of others, are those of
CalculiX' C3D8R (``Elasticity.hourglass_modulus``). The mass is the consistent one: that of one point would leave
these displacements without inertia.

Stresses from nodal displacements, means over the elements and values at the nodes (``elasticity``). At the nodes, each
element carries the values at the points of a low rule, where they are most accurate (Barlow 1976), to its nodes by its
linear functions; of elements that share a node the mean is taken, each counting alike.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
import scipy.sparse as sp

from .elasticity import COLUMNS, ROWS, Elasticity
from .mesh import Array, CellBlock, Index, Mesh
from .reference_cells import CELL_EDGES, N_CORNER, UNIFORM_CELLS, Rule, cell_functions, cell_rule

_AT_ONCE = 2**22  # numbers per array of gradients: larger meshes are taken in pieces, for the memory
_STRAIGHT = 1e-9  # of the longest edge: a middle node this close to the middle is there


@dataclass(frozen=True)
class CellPoints:
    """Points in some cells of one type.

    Attributes
    ----------
    cells : (n_cell, n_node). values : (n_point, n_node) shape functions.
    gradients : (n_cell, n_point, n_node, 3) of the shape functions by x, y, z, m-1.
    jacobian : (n_cell, n_point, 3, 3) d x_i / d xi_j. volumes : (n_cell, n_point) weight times det, m3.
    hourglass : gamma (n_cell, 8, 4) of hexahedra with uniform strain (module docstring), whose gradients are means over
        the cell; None of others.
    """

    cells: Index
    values: Array
    gradients: Array
    jacobian: Array
    volumes: Array
    hourglass: Array | None = None


def jacobians(nodes: Array, block: CellBlock, rule: Rule) -> Array:
    """d x_i / d xi_j (n_cell, n_point, 3, 3) of cells at the points of a rule; ``nodes`` (n_node, 3), m."""
    slopes = cell_functions(block.cell_type).gradients(rule.points)
    corners = nodes[block.cells]
    arms = corners - corners[:, :1]  # a cell far from the origin loses no digits
    return np.asarray(np.einsum("pak,cai->cpik", slopes, arms, optimize=True))


def points_in(nodes: Array, block: CellBlock, rule: Rule) -> CellPoints:
    """Geometry of cells at the points of a rule; ``nodes`` (n_node, 3), m."""
    functions = cell_functions(block.cell_type)
    slopes = functions.gradients(rule.points)
    jacobian = jacobians(nodes, block, rule)
    gradients = slopes @ np.linalg.inv(jacobian)
    volumes = rule.weights * np.linalg.det(jacobian)
    points = CellPoints(block.cells, functions.values(rule.points), gradients, jacobian, volumes)
    if block.reduced and block.cell_type in UNIFORM_CELLS:
        return _uniform(nodes, points, block.cell_type)
    return points


def _uniform(nodes: Array, points: CellPoints, cell_type: str) -> CellPoints:
    """The points with the mean gradients of their cells, and gamma."""
    whole = points_in(nodes, CellBlock(cell_type, points.cells), cell_rule(cell_type))
    mean = _mean_gradients(whole)
    corners = cell_functions(cell_type).nodes
    modes = np.stack([np.prod(corners[:, axes], axis=1) for axes in ([1, 2], [0, 2], [0, 1], [0, 1, 2])], axis=1)
    places = nodes[points.cells]
    arms = places - places[:, :1]  # the modes sum up to zero: no part of the first corner
    gamma = modes - mean @ (np.swapaxes(arms, 1, 2) @ modes)
    # those of one point are not the volume of a distorted cell
    volumes = points.volumes * (whole.volumes.sum(axis=1) / points.volumes.sum(axis=1))[:, None]
    gradients = np.broadcast_to(mean[:, None], points.gradients.shape)
    return replace(points, gradients=gradients, volumes=volumes, hourglass=gamma)


def is_curved(nodes: Array, block: CellBlock) -> bool:
    """Whether a middle node of any cell is out of the middle of its edge."""
    n_corner, edges = N_CORNER[block.cell_type], np.array(CELL_EDGES[block.cell_type])
    if block.cells.shape[1] == n_corner:
        return False
    ends = nodes[block.cells[:, edges]]
    off = nodes[block.cells[:, n_corner : n_corner + len(edges)]] - ends.mean(axis=2)
    return bool(np.abs(off).max() > _STRAIGHT * np.abs(ends[:, :, 1] - ends[:, :, 0]).max())


class Elements:
    """Elements of one mesh; what all sums over them share is made once.

    moduli : (n_cell,) of the elements over that of their material; None where all are 1.
    """

    def __init__(self, mesh: Mesh, moduli: Array | None = None) -> None:
        self.mesh, self.moduli = mesh, moduli

    def points(self, of_products: bool = False) -> Iterator[tuple[CellBlock, CellPoints]]:
        """Integration points of all cells, block by block in pieces that fit into memory (see ``cell_rule``)."""
        for _, rule, pieces in self._pieces(of_products):
            for piece in pieces:
                yield piece, points_in(self.mesh.nodes, piece, rule)

    @cached_property
    def volume(self) -> Array:
        """Volume of every cell, (n_cell,), m3."""
        return np.concatenate([p.volumes.sum(axis=1) for _, p in self.points()])

    def distinct(self, of_products: bool = False) -> Iterator[tuple[str, CellPoints, Index]]:
        """Type, integration points of the different cells, and which of them each cell of the mesh is, piece by piece.

        Cells are equal where all their nodes have the same places relative to the first one, to the last bit.
        """
        for block, rule, pieces in self._pieces(of_products):
            for piece in pieces:
                cells, of_cell = _different(self.mesh.nodes, piece.cells)
                yield block.cell_type, points_in(self.mesh.nodes, replace(block, cells=cells), rule), of_cell

    def _pieces(self, of_products: bool) -> Iterator[tuple[CellBlock, Rule, list[CellBlock]]]:
        """Blocks of the mesh with their rule, in pieces that fit into memory."""
        for block in self.mesh.blocks:
            rule = cell_rule(block.cell_type, of_products, is_curved(self.mesh.nodes, block), block.reduced)
            size = max(1, _AT_ONCE // (3 * len(rule.weights) * block.cells.shape[1]))
            firsts = range(0, len(block.cells), size)
            yield block, rule, [replace(block, cells=block.cells[i : i + size]) for i in firsts]

    @cached_property
    def _pattern(self) -> tuple[Index, Index, Index, Index]:
        """Rows and columns of the matrices, compressed rows; where the entries of every pair of nodes begin in the rows
        of the three components of its first node (3, n_pair); which pair those of every cell are, cell by cell."""
        n = self.mesh.n_node
        # one number n i + j for a pair of nodes (i, j): sorted by it they are compressed rows
        keys = np.concatenate([(b.cells[:, :, None] * n + b.cells[:, None, :]).ravel() for b in self.mesh.blocks])
        pairs, where = np.unique(keys, return_inverse=True)
        del keys
        starts = np.searchsorted(pairs, n * np.arange(n + 1, dtype=np.int64)).astype(np.int64)
        counts = np.diff(starts)
        indptr = np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(np.repeat(3 * counts, 3))])
        row = np.repeat(np.arange(n), counts)
        within = 3 * (np.arange(len(pairs)) - starts[row])
        first = np.stack([indptr[3 * row + i] + within for i in range(3)])
        columns = np.empty(9 * len(pairs), dtype=np.int64)
        for i in range(3):
            for j in range(3):
                columns[first[i] + j] = 3 * (pairs % n) + j
        return indptr, columns, first, where.ravel()

    def matrix(self, parts: Iterable[tuple[Array, Index]]) -> sp.csr_array:
        """Sum of element matrices (3 n_node, 3 n_node), dofs numbered 3 * node + component.

        Parameters
        ----------
        parts : for the cells in their order, matrices (n, m, m, 3, 3) of different cells, or (n, m, m) for the same
            entry on all three components, and which of them each cell has.
        """
        indptr, columns, first, where = self._pattern
        data, done = np.zeros(len(columns)), 0
        for matrices, of_cell in parts:
            pairs = where[done : done + len(of_cell) * matrices.shape[1] ** 2]
            here, done = first[:, pairs], done + len(pairs)
            # masses: the same on x, y and z, and no coupling between them
            if matrices.ndim == 3:
                entries = matrices[of_cell].ravel()
                for i in range(3):
                    np.add.at(data, here[i] + i, entries)
                continue
            for i in range(3):
                for j in range(3):
                    np.add.at(data, here[i] + j, np.ascontiguousarray(matrices[..., i, j])[of_cell].ravel())
        n = 3 * self.mesh.n_node
        return sp.csr_array((data, columns, indptr), shape=(n, n))


def _different(nodes: Array, cells: Index) -> tuple[Index, Index]:
    """Different ones of some cells (n, n_node), and which of them each cell is; see ``Elements.distinct``."""
    corners = nodes[cells]
    arms = (corners[:, 1:] - corners[:, :1] + 0.0).reshape(len(cells), -1)  # + 0.0: -0.0 has other bits than 0.0
    # equal sums modulo 2^64 of unlike cells are chance: found below
    weights = np.random.default_rng(0).integers(1, 2**63, arms.shape[1], dtype=np.uint64) | np.uint64(1)
    _, chosen, of_cell = np.unique(arms.view(np.uint64) @ weights, return_index=True, return_inverse=True)
    if np.array_equal(arms, arms[chosen[of_cell]]):
        return cells[chosen], of_cell.ravel()
    return cells, np.arange(len(cells))  # two different cells with one sum


@dataclass(frozen=True)
class RigidBody:
    """Six motions of a mesh and their mass.

    Attributes
    ----------
    centre : (3,) mass centre, m. length : size that scales the rotations, m.
    modes : (3 n_node, 6) nodal displacements of three translations along x, y, z and of three rotations of
        1 / length about x, y, z. mass : (6, 6), kg: the consistent mass of the mesh on these motions, exactly.
    """

    centre: Array
    length: float
    modes: Array
    mass: Array

    def coordinates(self, translation: Array, rotation: Array) -> Array:
        """The six unknowns (6,) of a translation (3,) of the centre, m, and a rotation (3,), rad (or their rates)."""
        return np.concatenate([translation, rotation * self.length])

    def with_mass(self, nodes: Array, added: sp.csr_array) -> RigidBody:
        """The motions about the common mass centre with masses at the nodes (3 n_node, 3 n_node), kg, added; ``nodes``
        (n_node, 3) of the mesh, m."""
        mass = self.mass + self.modes.T @ (added @ self.modes)
        # couplings of translations and rotations: first moments of the mass
        shift = np.array([mass[1, 5], -mass[0, 5], mass[0, 4]]) / mass[0, 0]  # over the length
        turn = np.eye(6)
        turn[:3, 3:] = -np.cross(np.eye(3), shift).T
        centre = self.centre + shift * self.length
        mass = turn.T @ mass @ turn
        return RigidBody(centre, self.length, rigid_modes(nodes, centre, self.length), 0.5 * (mass + mass.T))


def rigid_body(mesh: Mesh, density: float) -> RigidBody:
    """Rigid motions of a mesh of uniform density, kg m-3."""
    pieces = list(Elements(mesh).points(of_products=True))
    points = np.concatenate([(p.values @ mesh.nodes[p.cells]).reshape(-1, 3) for _, p in pieces])
    weights = density * np.concatenate([p.volumes.ravel() for _, p in pieces])
    total = float(weights.sum())
    centre = weights @ points / total
    length = mesh.size
    at_points = rigid_modes(points, centre, length).reshape(-1, 3, 6)
    mass = np.einsum("q,qia,qib->ab", weights, at_points, at_points)
    return RigidBody(centre, length, rigid_modes(mesh.nodes, centre, length), 0.5 * (mass + mass.T))


def rigid_modes(points: Array, centre: Array, length: float) -> Array:
    """Displacements (3 n_point, 6) of points (n_point, 3) in the six motions of ``RigidBody``."""
    arm = (points - centre) / length
    modes = np.zeros((len(points), 3, 6))
    modes[:, :, :3] = np.eye(3)
    for axis in range(3):
        modes[:, :, 3 + axis] = np.cross(np.eye(3)[axis], arm)
    return modes.reshape(-1, 6)


BENDING_CELLS = ("hexahedron",)
_HOURGLASS: Final = 5e-4  # c of the module docstring
_HRZ = (
    "tetra10",
    "hexahedron20",
    "wedge15",
    "wedge18",
    "pyramid13",
)  # row sums of their masses are negative at the corners


def elastic_products(test: Array, trial: Array, volumes: Array, material: Elasticity) -> Array:
    """int eps(v) : C : eps(u) of functions with gradients ``test`` and ``trial`` (n_cell, n_point, n, 3).

    Returns
    -------
    (n_cell, n, 3, n', 3) for vector fields made of each function along each axis.
    """
    n_cell, n_point, n, _ = test.shape
    m = trial.shape[2]
    rows = (test * volumes[:, :, None, None]).reshape(n_cell, n_point, 3 * n)
    pair = (np.swapaxes(rows, 1, 2) @ trial.reshape(n_cell, n_point, 3 * m)).reshape(n_cell, n, 3, m, 3)
    return material.products(pair)


def mode_gradients(jacobian: Array) -> Array:
    """Gradients (n_cell, n_point, 3, 3) of the three modes at the points of the hexahedron's rule."""
    xi = cell_rule("hexahedron").points
    slopes = -2.0 * xi[:, :, None] * np.eye(3)  # d m / d xi_m = -2 xi_m
    # the rule is symmetric about the centre and the Jacobian trilinear: its mean over the points is that of the centre
    centre = jacobian.mean(axis=1)
    ratio = np.linalg.det(centre)[:, None] / np.linalg.det(jacobian)
    return np.asarray(ratio[:, :, None, None] * (slopes[None] @ np.linalg.inv(centre)[:, None]))


def mode_amplitudes(points: CellPoints, material: Elasticity) -> tuple[Array, Array]:
    """The internal unknowns of each element for unit nodal displacements, and what couples the two.

    Returns
    -------
    -K_aa^-1 K_ad (n_cell, 9, 24) and K_ad (n_cell, 9, 24), both 3 * mode (or node) + component.
    """
    modes = mode_gradients(points.jacobian)
    n = len(modes)
    modal = elastic_products(modes, modes, points.volumes, material).reshape(n, 9, 9)
    coupled = elastic_products(modes, points.gradients, points.volumes, material).reshape(n, 9, 24)
    amplitudes = np.asarray(-np.linalg.solve(modal, coupled), dtype=float)
    return amplitudes, coupled


def condensed(points: CellPoints, material: Elasticity) -> Array:
    """Stiffness (n_cell, 8, 3, 8, 3) of hexahedra with bending modes: K_dd - K_da K_aa^-1 K_ad."""
    plain = elastic_products(points.gradients, points.gradients, points.volumes, material)
    amplitudes, coupled = mode_amplitudes(points, material)
    softened = np.swapaxes(coupled, 1, 2) @ amplitudes
    softened = 0.5 * (softened + np.swapaxes(softened, 1, 2))  # round-off of the solution is not symmetric
    return np.asarray(plain + softened.reshape(plain.shape))


def stiffness(elements: Elements, material: Elasticity, bending_modes: bool = False) -> sp.csr_array:
    """Stiffness K (3 n_node, 3 n_node), N m-1, dofs numbered 3 * node + component: int eps(v) : C : eps(u).

    Parameters
    ----------
    bending_modes : 8-node hexahedra get the incompatible modes of the module docstring.
    """

    def parts() -> Iterator[tuple[Array, Index]]:
        done = 0
        for cell_type, points, of_cell in elements.distinct():
            matrices = element_stiffness(points, material, bending_modes and cell_type in BENDING_CELLS)
            if elements.moduli is not None:
                moduli, done = elements.moduli[done : done + len(of_cell)], done + len(of_cell)
                matrices, of_cell = moduli[:, None, None, None, None] * matrices[of_cell], np.arange(len(of_cell))
            yield matrices.transpose(0, 1, 3, 2, 4), of_cell

    return elements.matrix(parts())


def element_stiffness(points: CellPoints, material: Elasticity, bending_modes: bool) -> Array:
    """Stiffness (n_cell, n, 3, n, 3) of each of some cells, N m-1."""
    if bending_modes:
        return condensed(points, material)
    matrices = elastic_products(points.gradients, points.gradients, points.volumes, material)
    if points.hourglass is not None:
        resisting = hourglass_stiffness(points, material)
        for i in range(3):
            matrices[:, :, i, :, i] += resisting
    return matrices


def hourglass_stiffness(points: CellPoints, material: Elasticity) -> Array:
    """c E V (sum b . b) gamma gamma^T (n_cell, 8, 8), N m-1, the same along each axis, of hexahedra with uniform
    strain (module docstring)."""
    assert points.hourglass is not None, "_uniform"
    slope = points.gradients[:, 0]
    scale = _HOURGLASS * material.hourglass_modulus * points.volumes.sum(axis=1) * (slope**2).sum(axis=(1, 2))
    return np.asarray(scale[:, None, None] * (points.hourglass @ np.swapaxes(points.hourglass, 1, 2)))


def mass(elements: Elements, density: float) -> sp.csr_array:
    """Consistent mass M (3 n_node, 3 n_node), kg."""

    def parts() -> Iterator[tuple[Array, Index]]:
        for _, points, of_cell in elements.distinct(of_products=True):
            products = points.values[:, :, None] * points.values[:, None, :]
            n = points.values.shape[1]
            yield (density * points.volumes @ products.reshape(len(products), -1)).reshape(-1, n, n), of_cell

    return elements.matrix(parts())


def lumped_mass(elements: Elements, density: float) -> Array | None:
    """Positive nodal masses (n_node,), kg; None where the row sums of the consistent mass are as good.

    Row sums of cells that keep the corner functions positive; on the others (``_HRZ``) the diagonal of the
    consistent mass of each cell, scaled to the mass of the cell (Hinton, Rock, Zienkiewicz 1976).
    """
    if not any(block.cell_type in _HRZ for block in elements.mesh.blocks):
        return None
    total = np.zeros(elements.mesh.n_node)
    for block, points in elements.points(of_products=True):
        if block.cell_type in _HRZ:
            share = points.volumes @ points.values**2
            # scaled to the volume of the cell: its mass is kept
            share *= (points.volumes.sum(axis=1) / share.sum(axis=1))[:, None]
        else:
            share = points.volumes @ points.values
        total += np.bincount(block.cells.ravel(), density * share.ravel(), len(total))
    return total


def body_load(elements: Elements, force: Array) -> Array:
    """Nodal forces (3 n_node,) of a body force in N m-3, uniform (3,) or by its values at the nodes (n_node, 3)."""
    n_node = elements.mesh.n_node
    if np.ndim(force) == 1:
        share = np.zeros(n_node)
        for block, points in elements.points():
            share += np.bincount(block.cells.ravel(), (points.volumes @ points.values).ravel(), n_node)
        return np.outer(share, np.asarray(force)).ravel()
    total = np.zeros((n_node, 3))
    for block, points in elements.points():
        at_points = np.einsum("pa,cai->cpi", points.values, np.asarray(force)[block.cells])
        np.add.at(total, block.cells, np.einsum("cp,pa,cpi->cai", points.volumes, points.values, at_points))
    return total.ravel()


# Type of the cell of degree one with the same corners: its rule and functions carry values to the nodes.
_LINEAR: Final = {
    "hexahedron20": "hexahedron",
    "hexahedron27": "hexahedron",
    "tetra10": "tetra",
    "wedge15": "wedge",
    "wedge18": "wedge",
    "pyramid13": "pyramid",
}


class MeanStress:
    """Mean stress of each element for one mesh and material; the mean gradients are computed once.

    Parameters
    ----------
    elements : of the mesh. material : its elasticity.
    """

    def __init__(self, elements: Elements, material: Elasticity) -> None:
        self._means = [(b.cells, _mean_gradients(p)) for b, p in elements.points()]
        self._material, self._moduli = material, elements.moduli

    def __call__(self, displacement: Array) -> Array:
        """Mean stress (n_cell, 6), Pa, of displacements (n_node, 3), m."""
        slopes = [np.swapaxes(mean, 1, 2) @ displacement[cells] for cells, mean in self._means]
        stress = self._material.stress(symmetric(np.concatenate(slopes)))
        if self._moduli is None:
            return stress
        return self._moduli[:, None] * stress


class Recovery:
    """Strains of the elements and stresses at the nodes for one mesh and material.

    Parameters
    ----------
    elements, material : as in ``MeanStress``. bending_modes : as in ``elements.stiffness``.
    """

    def __init__(self, elements: Elements, material: Elasticity, bending_modes: bool = False) -> None:
        self._elements = elements
        self._material = material
        self._bending = bending_modes

    def strain(self, displacement: Array) -> Array:
        """Mean strain (n_time, n_cell, 6) of displacements (n_time, n_node, 3), m."""
        parts = [
            symmetric(np.swapaxes(_mean_gradients(points), 1, 2) @ displacement[:, points.cells])
            for _, points in self._elements.points()
        ]
        return np.concatenate(parts, axis=1)

    def nodal_stress(self, displacement: Array) -> Array:
        """Stress at the nodes (n_time, n_node, 6), Pa, of displacements (n_time, n_node, 3), m: mean of the elements
        around, each extended from its integration points."""
        n_time, n_node, _ = displacement.shape
        total = np.zeros((n_node, n_time * 6))
        weight = np.zeros(n_node)
        done = 0
        for block, rule, to_nodes in self._pieces(n_time):
            points = points_in(self._elements.mesh.nodes, block, rule)
            slopes = np.einsum("cpaj,tcai->tcpij", points.gradients, displacement[:, block.cells], optimize=True)
            if self._bending and block.cell_type in BENDING_CELLS:
                slopes += mode_slopes(points, self._material, displacement[:, block.cells])
            stress = self._material.stress(symmetric(slopes))
            if self._elements.moduli is not None:
                stress *= self._elements.moduli[None, done : done + len(block.cells), None, None]
                done += len(block.cells)
            at_nodes = np.einsum("ap,tcpk->catk", to_nodes, stress, optimize=True)
            # every element counts alike, as in other programs: means by volume differ much from theirs where sizes do
            where: Any = (np.ones(block.cells.size), (block.cells.ravel(), np.arange(block.cells.size)))
            share = sp.csr_array(sp.coo_array(where, shape=(n_node, block.cells.size)))
            total += share @ at_nodes.reshape(block.cells.size, -1)
            weight += share @ np.ones(block.cells.size)
        return np.swapaxes((total / weight[:, None]).reshape(n_node, n_time, 6), 0, 1)

    def at_points(self, displacement: Array, number: int, rows: Index, rule: Rule) -> tuple[Array, Array, Array]:
        """Strain and stress at points of some cells: not means, as the integration points of other programs.

        Parameters
        ----------
        displacement : (n_node, 3), m. number : of the block of cells. rows : of its cells. rule : the points; with
        bending modes those of the stiffness, or the centre.

        Returns
        -------
        Strain (n_cell, n_point, 6), stress, Pa, that it makes, and volume (n_cell, n_point), m3, of each point.
        """
        blocks = self._elements.mesh.blocks
        block = replace(blocks[number], cells=blocks[number].cells[rows])
        points = points_in(self._elements.mesh.nodes, block, rule)
        slopes = np.einsum("cpaj,cai->cpij", points.gradients, displacement[block.cells], optimize=True)
        # at the centre alone the modes have no slope
        if self._bending and block.cell_type in BENDING_CELLS and len(rule.weights) > 1:
            slopes += mode_slopes(points, self._material, displacement[None, block.cells])[0]
        strain = symmetric(slopes)
        stress = self._material.stress(strain)
        if self._elements.moduli is not None:
            before = sum(len(b.cells) for b in blocks[:number])
            stress = self._elements.moduli[before + rows, None, None] * stress
        return strain, stress, points.volumes

    def strain_of(self, stress: Array) -> Array:
        """Strain (..., 6) that a stress (..., 6), Pa, makes."""
        compliance = np.linalg.inv(self._material.stress(np.eye(6)))
        return np.asarray(stress @ compliance)

    def nodal_forces(self, displacement: Array, unstrained: Array | None = None) -> Array:
        """Forces (n_node, 3), N, that hold the body in a shape: int grad phi . sigma.

        displacement : (n_node, 3), m. unstrained : (n_cell or 1, 6) stress that no strain makes, Pa.
        """
        total = np.zeros((len(self._elements.mesh.nodes), 3))
        first = 0
        for number, block in enumerate(self._elements.mesh.blocks):
            curved = is_curved(self._elements.mesh.nodes, block)
            rule = cell_rule(block.cell_type, False, curved, block.reduced)
            size = max(1, _AT_ONCE // (9 * len(rule.weights) * block.cells.shape[1]))
            for start in range(0, len(block.cells), size):
                rows = np.arange(start, min(start + size, len(block.cells)))
                _, stress, volumes = self.at_points(displacement, number, rows, rule)
                if unstrained is not None:
                    stress = stress + unstrained[(first + rows) % len(unstrained), None, :]
                some = replace(block, cells=block.cells[rows])
                points = points_in(self._elements.mesh.nodes, some, rule)
                forces = np.einsum("cpaj,cpij,cp->cai", points.gradients, tensors(stress), volumes, optimize=True)
                if points.hourglass is not None:
                    resisting = hourglass_stiffness(points, self._material) @ displacement[some.cells]
                    if self._elements.moduli is not None:
                        resisting *= self._elements.moduli[first + rows, None, None]
                    forces += resisting
                np.add.at(total, some.cells, forces)
            first += len(block.cells)
        return total

    def _pieces(self, n_time: int) -> Iterator[tuple[CellBlock, Rule, Array]]:
        """Blocks in pieces, with the rule of the points and the matrix (n_node, n_point) from there to the nodes."""
        for block in self._elements.mesh.blocks:
            linear = _LINEAR.get(block.cell_type, block.cell_type)
            # wedges by their reduced rule: elsewhere they have strains that cost no energy
            rule = cell_rule(linear, reduced=block.reduced and linear == block.cell_type)
            functions = cell_functions(linear)
            at_nodes = functions.values(cell_functions(block.cell_type).nodes)
            # pyramids have 8 points and 5 functions, wedges by the reduced rule 2 and 6: least squares
            to_nodes = at_nodes @ np.linalg.pinv(functions.values(rule.points))
            size = max(1, _AT_ONCE // (9 * max(n_time, 3) * block.cells.shape[1]))
            for first in range(0, len(block.cells), size):
                yield replace(block, cells=block.cells[first : first + size]), rule, to_nodes


def mode_slopes(points: CellPoints, material: Elasticity, nodal: Array) -> Array:
    """Gradients (n_time, n_cell, n_point, 3, 3) of the bending modes of some hexahedra with displacements ``nodal``
    (n_time, n_cell, 8, 3), m."""
    columns = nodal.reshape(len(nodal), len(points.cells), -1)
    amplitudes = np.einsum("cmd,tcd->tcm", mode_amplitudes(points, material)[0], columns, optimize=True)
    of_modes = amplitudes.reshape(*amplitudes.shape[:2], 3, 3)
    return np.asarray(np.einsum("cpmj,tcmi->tcpij", mode_gradients(points.jacobian), of_modes, optimize=True))


def _mean_gradients(points: CellPoints) -> Array:
    """Mean gradients of the shape functions over each cell, (n_cell, n_node, 3)."""
    volumes = points.volumes / points.volumes.sum(axis=1, keepdims=True)
    return np.asarray(np.einsum("cpaj,cp->caj", points.gradients, volumes))


def symmetric(slope: Array) -> Array:
    """Six components (..., 6) of the symmetric part of gradients (..., 3, 3)."""
    return np.asarray(0.5 * (slope + np.swapaxes(slope, -1, -2))[..., ROWS, COLUMNS])


def tensors(six: Array) -> Array:
    """Symmetric tensors (..., 3, 3) of six components (..., 6)."""
    full = np.empty((*six.shape[:-1], 3, 3))
    full[..., ROWS, COLUMNS] = six
    full[..., COLUMNS, ROWS] = six
    return full


def principal(tensor: Array) -> Array:
    """Principal values (..., 3) of symmetric tensors (..., 6), largest first."""
    return np.asarray(np.linalg.eigvalsh(tensors(tensor))[..., ::-1])
