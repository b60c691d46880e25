"""The layer of elements at faces that may open: its mass and its viscosity, for bodies that land.

Mass moved from contact nodes to their inner neighbours:

    M' = R^T M R,   R: velocity of a contact node := mean of its neighbours that are no contact nodes

Neighbours along cell edges (half edges of quadratic cells) where there are any, else (edges and corners shared by
contact faces) across the cell. R keeps translations, hence total mass and momentum; kinetic energy changes by the
motion of one layer relative to the next (first order in the element). A node without any inner neighbour (a body one
element thick between two contacts) keeps its mass.

Spread over several layers instead: couplings of contact nodes are lumped, and the mass of each is divided evenly among
the layers (up to four, as many as there are), from a node of one layer to its neighbours in the next.

Mass between the consistent and the lumped one, r M_c + (1 - r) M_l. The first carries short waves too fast, the second
too slow: at small steps r = 1/2 has no fast precursors, which pile up in front of a landing, and a smaller dispersion
than both; the dispersion of the time scheme at longer ones is made up for with r = (1 + C^2)/2, C <= 1 the smallest
Courant number of a body. The peak stays what it is, the error of the force history (L2) falls by up to a tenth.

Viscosity: C = sum q (h_e / c_p) K_e over the elements that touch a contact face, h_e their height over it (volume over
area of the facets, thrice that for tetrahedra and pyramids; the mean of their neighbours' where they own no facet; half
of it for quadratic cells, the distance of their nodes), c_p the speed of pressure waves along the normal there. K_e
resists no rigid motion, so that neither translation nor rotation is damped. Peak over the plateau for a bar of 20
elements (10 quadratic ones) that lands on a wall, Courant number 0.1 to 2, q = 0.6: hexahedra and wedges 1.06 to 1.07,
tetrahedra 1.06 to 1.08 (1.27 with the elements that own a facet alone), 10-node tetrahedra 1.09 to 1.14, 20- and
27-node hexahedra 1.09 to 1.17.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import combinations
from typing import Final

import numpy as np
import scipy.sparse as sp

from .elasticity import Elasticity
from .elements import BENDING_CELLS, element_stiffness, is_curved, points_in
from .mesh import Array, CellBlock, Index, Mask, Mesh
from .reference_cells import CELL_FACES, CELL_LINKS, FACET_CORNERS, FACET_KIND, N_CORNER, N_NODE, Local, cell_rule

LAYERS: Final = 4
"""Layers that the contact mass is spread over at most."""
_DIAGONALS: Final = {name: tuple(combinations(range(count), 2)) for name, count in N_NODE.items()}


def blended_mass(consistent: sp.csr_array, lumped: Array | None, share: float) -> sp.csr_array:
    """Mass (3 n_node, 3 n_node), kg, of which a ``share`` is consistent and the rest lumped.

    Parameters
    ----------
    lumped : (3 n_node,), or None where it is the row sums of ``consistent``.
    """
    if share == 1.0:
        return consistent
    if lumped is None:
        sums = consistent @ np.ones(consistent.shape[0])
    else:
        sums = lumped
    return sp.csr_array(share * consistent + (1.0 - share) * sp.diags_array(sums))


def longest_edge(mesh: Mesh) -> float:
    """Largest distance of two neighbouring nodes along an edge, m."""
    pairs = _linked(mesh, CELL_LINKS)
    return float(np.linalg.norm(mesh.nodes[pairs[:, 1]] - mesh.nodes[pairs[:, 0]], axis=1).max())


def without_contact_mass(
    mass: sp.csr_array, mesh: Mesh, nodes: Index, several_layers: bool = False
) -> tuple[sp.csr_array, Index]:
    """Mass matrix (3 n_node, 3 n_node) with the mass of ``nodes`` on their inner neighbours, and the nodes that have
    none and keep theirs.

    Parameters
    ----------
    several_layers : spread it over up to four layers.
    """
    bare = np.zeros(mesh.n_node, dtype=bool)
    bare[nodes] = True
    follow, rest = _followed(mesh, bare)
    # these keep their mass: for the spreading below they are inner nodes
    bare[rest] = False
    if several_layers and bare.any():
        spread = _spread_mass(mass, mesh, bare, follow)
        # a node without mass has no acceleration: then one layer takes it all
        if spread.diagonal()[np.repeat(~bare, 3)].min() > 0.0:
            return spread, rest
    # dofs are numbered 3 * node + component, hence the order of the factors
    whole = sp.csr_array(sp.kron(follow, sp.eye_array(3)))
    moved = sp.csr_array(whole.T @ mass @ whole)
    moved.eliminate_zeros()
    return moved, rest


def _followed(mesh: Mesh, bare: Mask) -> tuple[sp.csr_array, Index]:
    """R (n_node, n_node): weights of the inner neighbours of nodes marked in ``bare``, one at the others; and the
    marked nodes that have none."""
    pairs = _inner_neighbours(mesh, bare, CELL_LINKS)
    isolated = bare.copy()
    # who has a neighbour along an edge does not look across the cell
    isolated[pairs[:, 0]] = False
    # inner: not ``bare``, rather than not isolated: a node that gives its mass away takes none
    across = _inner_neighbours(mesh, isolated, _DIAGONALS, bare)
    return _means(np.concatenate([pairs, across]), mesh.n_node, bare)


def _means(pairs: Index, n_node: int, of: Mask) -> tuple[sp.csr_array, Index]:
    """Mean over the second nodes of ``pairs`` for each first one, the identity elsewhere; the nodes of ``of`` without
    pair."""
    count = np.bincount(pairs[:, 0], minlength=n_node)
    others = np.flatnonzero(count == 0)
    rows = np.concatenate([pairs[:, 0], others])
    columns = np.concatenate([pairs[:, 1], others])
    weights: Array = np.concatenate([1.0 / count[pairs[:, 0]], np.ones(len(others))])
    return sp.csr_array((weights, (rows, columns)), shape=(n_node, n_node)), others[of[others]]


def _inner_neighbours(mesh: Mesh, of: Mask, links: Mapping[str, Local], bare: Mask | None = None) -> Index:
    """Pairs (n, 2): a node marked in ``of``, a neighbour over one of the ``links`` of its cell that is not ``bare``."""
    pairs = _linked(mesh, links)
    inner = ~(of if bare is None else bare)
    chosen: Index = pairs[of[pairs[:, 0]] & inner[pairs[:, 1]]]
    return chosen


def _linked(mesh: Mesh, links: Mapping[str, Local]) -> Index:
    """Pairs (n, 2) of linked nodes, both ways."""
    pairs = np.concatenate([b.cells[:, np.array(links[b.cell_type])].reshape(-1, 2) for b in mesh.blocks])
    return np.unique(np.concatenate([pairs, pairs[:, ::-1]]), axis=0)


def _spread_mass(mass: sp.csr_array, mesh: Mesh, bare: Mask, follow: sp.csr_array) -> sp.csr_array:
    """The mass of the nodes marked in ``bare`` evenly on the layers of nodes behind them (module docstring)."""
    dofs = np.repeat(bare, 3)
    entries = mass.tocoo()
    rows, columns = entries.coords
    # either row of a coupling keeps its own entry: the inner one here, that of the contact node in ``node_mass``
    crossing = dofs[rows] != dofs[columns]
    inner = ~dofs[rows] & ~dofs[columns]
    inner_mass = sp.csr_array((entries.data[inner], (rows[inner], columns[inner])), shape=mass.shape)
    # rows of inner nodes: what they share with contact nodes goes onto their diagonal, so that row sums stay
    lumped = np.bincount(rows[crossing], entries.data[crossing], len(dofs))
    # components do not couple in a mass: the sum of a row is the mass of its node
    node_mass = np.where(dofs, mass @ np.ones(len(dofs)), 0.0)
    layer, pairs = _layers(mesh, bare), _linked(mesh, CELL_LINKS)
    count = max(1, min(LAYERS, int(layer.max(initial=1))))
    share = sp.csr_array(sp.kron(follow, sp.eye_array(3))).T @ node_mass
    total = np.where(dofs, 0.0, lumped) + share / count
    for k in range(1, count):
        outwards = pairs[(layer[pairs[:, 0]] == k) & (layer[pairs[:, 1]] == k + 1)]
        # a node without a neighbour in the next layer keeps its share: the identity in ``_means``
        means, _ = _means(outwards, mesh.n_node, bare)
        share = sp.csr_array(sp.kron(means, sp.eye_array(3))).T @ share
        total += share / count
    moved = sp.csr_array(inner_mass + sp.diags_array(total))
    moved.eliminate_zeros()
    return moved


def _layers(mesh: Mesh, bare: Mask) -> Index:
    """Number (n_node,) of links from each node to the nodes marked in ``bare``, at most ``LAYERS``."""
    pairs = _linked(mesh, CELL_LINKS)
    # LAYERS + 1: not reached yet
    layer = np.where(bare, 0, LAYERS + 1)
    for k in range(LAYERS):
        reached = pairs[layer[pairs[:, 0]] == k, 1]
        layer[reached] = np.minimum(layer[reached], k + 1)
    return np.where(layer > LAYERS, 0, layer)  # farther nodes are no layer, as the bare ones


def landing_viscosity(mesh: Mesh, q: Array, material: Elasticity, bending_modes: bool = False) -> sp.csr_array | None:
    """Viscosity C (3 n_node, 3 n_node), N s m-1, of the elements at contact nodes (module docstring).

    Parameters
    ----------
    q : (n_node,) at the contact nodes, 0 at others; an element takes the largest of its nodes. material : of the
        mesh. bending_modes : as the stiffness.

    Returns
    -------
    None where no element owns a facet of contact nodes, or q is zero.
    """
    bare = q > 0.0
    total = sp.csr_array((3 * mesh.n_node, 3 * mesh.n_node))
    times = _crossing_times(mesh, bare, material.pressure_speed)
    for block in mesh.blocks:
        touching = np.flatnonzero((times[block.cells] > 0.0).any(axis=1))
        if not len(touching):
            continue
        layer = replace(block, cells=block.cells[touching])
        # the rule of the stiffness of the body, so that the damping is proportional to its element matrices
        points = points_in(
            mesh.nodes, layer, cell_rule(block.cell_type, False, is_curved(mesh.nodes, block), block.reduced)
        )
        bends = bending_modes and block.cell_type in BENDING_CELLS
        matrix = element_stiffness(points, material, bends)
        n = 3 * layer.cells.shape[1]
        here = times[layer.cells]
        time = here.sum(axis=1) / (here > 0.0).sum(axis=1)  # mean over the contact nodes of the element
        values = (q[layer.cells].max(axis=1) * time)[:, None, None] * matrix.reshape(-1, n, n)
        dofs = (3 * layer.cells[:, :, None] + np.arange(3)).reshape(-1, n)
        rows, columns = np.repeat(dofs, n, axis=1), np.tile(dofs, (1, n))
        total = total + sp.csr_array((values.ravel(), (rows.ravel(), columns.ravel())), shape=total.shape)
    if not total.nnz:
        return None
    # sums of products are symmetric up to round-off only
    total = sp.csr_array(0.5 * (total + total.T))
    total.sort_indices()
    # SciPy makes them of 32 bits where they fit, kernels read 64
    total.indices, total.indptr = total.indices.astype(np.int64), total.indptr.astype(np.int64)
    return total


def layer_of(mesh: Mesh, nodes: Index, material: Elasticity) -> tuple[float, float]:
    """Median time in which the wave of a bar crosses the elements from their facets of contact ``nodes``, s (0 where
    there are none), and the share of the elements that touch these nodes."""
    bare = np.zeros(mesh.n_node, dtype=bool)
    bare[nodes] = True
    times = _crossing_times(mesh, bare, lambda normals: np.sqrt(material.moduli_along(normals)[0] / material.density))
    positive = times[times > 0.0]
    touching = sum(int((times[block.cells] > 0.0).any(axis=1).sum()) for block in mesh.blocks)
    return float(np.median(positive)) if len(positive) else 0.0, touching / sum(len(b.cells) for b in mesh.blocks)


def _crossing_times(mesh: Mesh, bare: Mask, speed: Callable[[Array], Array]) -> Array:
    """Mean time (n_node,), s, in which waves cross the elements at each contact node by their height over their facets;
    0 at others, and where no element owns a facet of contact nodes. ``speed`` : along unit normals (..., 3), m s-1."""
    total, count = np.zeros(mesh.n_node), np.zeros(mesh.n_node)
    for block in mesh.blocks:
        swept = _swept(mesh, block, bare, speed)
        part = CellBlock(block.cell_type, block.cells[swept > 0.0])
        volume = points_in(mesh.nodes, part, cell_rule(block.cell_type)).volumes.sum(axis=1)
        corners = N_CORNER[block.cell_type]
        factor = (3.0 if corners in (4, 5) else 1.0) * (0.5 if part.cells.shape[1] > corners else 1.0)
        np.add.at(total, part.cells, (factor * volume / swept[swept > 0.0])[:, None])
        np.add.at(count, part.cells, 1.0)
    # other nodes of these cells are inner ones
    times: Array = np.divide(total, count, out=np.zeros_like(total), where=bare & (count > 0))
    return times


def _swept(mesh: Mesh, block: CellBlock, bare: Mask, speed: Callable[[Array], Array]) -> Array:
    """Volume per time (n_cell,), m3 s-1, that waves sweep from the facets of each cell all of whose nodes are marked in
    ``bare``; 0 where none is."""
    total = np.zeros(len(block.cells))
    for face in CELL_FACES[block.cell_type]:
        nodes = block.cells[:, np.array(face)]
        corner = mesh.nodes[nodes[:, : FACET_CORNERS[FACET_KIND[len(face)]]]]
        # half the cross product of the diagonals is the vector area of a quadrilateral, warped ones included
        if corner.shape[1] == 4:
            arms = corner[:, 2:] - corner[:, :-2]
        else:
            arms = corner[:, 1:] - corner[:, :1]
        facets = np.flatnonzero(bare[nodes].all(axis=1))
        vectors = 0.5 * np.cross(arms[facets, 0], arms[facets, 1])
        areas = np.linalg.norm(vectors, axis=1)
        total[facets] += areas * speed(vectors / np.maximum(areas, np.finfo(float).tiny)[:, None])
    return total
