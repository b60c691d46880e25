"""Meshes of one substructure: nodes, blocks of cells, named faces; nearest nodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .reference_cells import CELL_FACES, CELL_OF_N_NODE, FACET_CORNERS, FACET_KIND, HEX_FACES, REDUCED_CELLS

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]
BOX_FACES = ("xmin", "xmax", "ymin", "ymax", "zmin", "zmax")
_FEW: Final = 300_000  # pairs of points up to which all distances cost less than to load SciPy's tree


@dataclass(frozen=True)
class CellBlock:
    """Cells of one type.

    Attributes
    ----------
    cell_type : a key of ``reference_cells.CELL_FACES``. cells : (n_cell, n_node_of_type) connectivity, VTK order.
    reduced : whether the stiffness is that of the reduced rule (``reference_cells.cell_rule``).
    """

    cell_type: str
    cells: Index
    reduced: bool = False


@dataclass(frozen=True)
class FacetBlock:
    """Facets of one kind, oriented outwards.

    Attributes
    ----------
    kind : "triangle", "quad", "triangle6", "quad8" or "quad9". facets : (n_facet, n_node_of_kind).
    """

    kind: str
    facets: Index

    @property
    def corners(self) -> Index:
        """Corners of the facets, (n_facet, 3 | 4)."""
        return self.facets[:, : FACET_CORNERS[self.kind]]


@dataclass(frozen=True)
class HalfSpace:
    """Places x with normal . x <= height.

    Attributes
    ----------
    normal : (3,) unit vector. height : m.
    """

    normal: Array
    height: float


@dataclass(frozen=True)
class FacetSet:
    """A face of a mesh: facets of one or several kinds.

    Attributes
    ----------
    blocks : facets by kind. within : where the face ends inside its facets, which integrals over the common part of two
        faces take into account (``mortar``); None where its facets are whole.
    """

    blocks: tuple[FacetBlock, ...]
    within: HalfSpace | None = None

    @staticmethod
    def of(*facets: Index) -> FacetSet:
        """Face made of arrays (n_facet, n_node), whose number of nodes determines the kind."""
        return FacetSet(tuple(FacetBlock(FACET_KIND[f.shape[1]], f) for f in facets))

    @property
    def n_facet(self) -> int:
        """Number of facets."""
        return sum(len(block.facets) for block in self.blocks)

    @property
    def nodes(self) -> Index:
        """Nodes of the face, ascending, (n_point,)."""
        every: Index = np.unique(np.concatenate([block.facets.ravel() for block in self.blocks]))
        return every

    @property
    def turned(self) -> FacetSet:
        """The same facets seen from behind."""
        blocks = []
        for block in self.blocks:
            n = FACET_CORNERS[block.kind]
            width = block.facets.shape[1]
            # corners backwards from the first one; the middle of the last edge is that of the first now
            order = [0, *range(n - 1, 0, -1), *range(min(2 * n, width) - 1, n - 1, -1), *range(2 * n, width)]
            blocks.append(FacetBlock(block.kind, block.facets[:, order]))
        return FacetSet(tuple(blocks), self.within)

    @property
    def straight(self) -> FacetSet:
        """Facets of first order on their corners."""
        linear = {3: "triangle", 4: "quad"}
        blocks = tuple(FacetBlock(linear[FACET_CORNERS[b.kind]], b.corners) for b in self.blocks)
        return FacetSet(blocks, self.within)


@dataclass(frozen=True)
class Mesh:
    """Mesh of one substructure.

    Attributes
    ----------
    nodes : (n_node, 3) coordinates, m.
    blocks : cells by type; cells are counted through all blocks in turn.
    faces : named faces, oriented outwards.
    points : named nodes of edges and points: those of a node set that are on no facet of the face of its name.
    """

    nodes: Array
    blocks: tuple[CellBlock, ...]
    faces: dict[str, FacetSet]
    points: dict[str, Index] = field(default_factory=dict)

    @staticmethod
    def uniform(nodes: Array, cell_type: str, cells: Index, faces: Mapping[str, Index] | None = None) -> Mesh:
        """Mesh of one type of cells, every face of one kind of facets."""
        named = {name: FacetSet.of(facets) for name, facets in (faces or {}).items()}
        return Mesh(nodes, (CellBlock(cell_type, cells),), named)

    def with_reduced_rules(self, cell_types: Sequence[str] = REDUCED_CELLS) -> Mesh:
        """The mesh with the reduced rule in all cells of these types."""
        blocks = tuple(replace(b, reduced=b.reduced or b.cell_type in cell_types) for b in self.blocks)
        return replace(self, blocks=blocks)

    @property
    def n_node(self) -> int:
        """Number of nodes."""
        return len(self.nodes)

    @property
    def n_cell(self) -> int:
        """Number of cells of all types."""
        return sum(len(block.cells) for block in self.blocks)

    @property
    def cell_types(self) -> tuple[str, ...]:
        """Type of each block."""
        return tuple(block.cell_type for block in self.blocks)

    def nodes_of(self, name: str) -> Index:
        """Nodes of a named face and of the edges and points of its name, ascending."""
        rows = []
        if name in self.faces:
            rows = [self.faces[name].nodes]
        if name in self.points:
            rows.append(self.points[name])
        return np.unique(np.concatenate(rows))

    def extent(self) -> Array:
        """Size of the bounding box, (3,), m."""
        return np.asarray(np.ptp(self.nodes, axis=0))

    @property
    def size(self) -> float:
        """Longest edge of the bounding box, m."""
        return float(self.extent().max())


def boundary(mesh: Mesh) -> FacetSet:
    """All facets that belong to one cell only, oriented outwards, in the order of blocks, local faces and cells."""
    facets_of: dict[str, list[Index]] = {}
    for block in mesh.blocks:
        for local in CELL_FACES[block.cell_type]:
            facets_of.setdefault(FACET_KIND[len(local)], []).append(block.cells[:, list(local)])
    # facets meet facets of their kind alone (see ``unjoined``)
    candidates = [FacetBlock(kind, np.concatenate(facets)) for kind, facets in facets_of.items()]
    return FacetSet(tuple(b for b in map(_single, candidates) if len(b.facets)))


def _single(block: FacetBlock) -> FacetBlock:
    """Facets whose corners no other facet of the block has."""
    _, inverse, count = np.unique(np.sort(block.corners, axis=1), axis=0, return_inverse=True, return_counts=True)
    # its shape depends on the version of NumPy
    return FacetBlock(block.kind, block.facets[count[inverse.ravel()] == 1])


def unjoined(surface: FacetSet) -> int:
    """Number of boundary facets that share their corners with another one though they are of unlike cells.

    Cells of different types are joined where they have a facet of one kind in common. A quadrilateral of a hexahedron
    on two triangles of tetrahedra, or facets of cells of first and second degree, share nodes and come apart between.
    """
    corners: dict[int, list[Index]] = {3: [], 4: []}
    for block in surface.blocks:
        corners[block.corners.shape[1]].append(np.sort(block.corners, axis=1))
    triangles, quads = (np.concatenate([np.zeros((0, n), dtype=np.int64), *corners[n]]) for n in (3, 4))
    halves = np.concatenate([np.delete(quads, i, axis=1) for i in range(4)])  # by either diagonal
    # twice within a kind of facet corners (cells of two degrees), then triangles on halves of quadrilaterals
    again = sum(len(table) - len(np.unique(table, axis=0)) for table in (triangles, quads))
    both = np.concatenate([np.unique(table, axis=0) for table in (triangles, halves)])
    return again + len(both) - len(np.unique(both, axis=0))


def padded_cells(blocks: tuple[CellBlock, ...]) -> Index:
    """Connectivity of all blocks in one array (n_cell, widest), short rows filled with -1."""
    if len(blocks) == 1:
        return blocks[0].cells
    table = np.full((sum(len(b.cells) for b in blocks), max(b.cells.shape[1] for b in blocks)), -1, dtype=np.int64)
    row = 0
    for block in blocks:
        table[row : row + len(block.cells), : block.cells.shape[1]] = block.cells
        row += len(block.cells)
    return table


def cell_blocks(padded: Index) -> tuple[CellBlock, ...]:
    """Runs of cells of equal type in the table of ``padded_cells`` (the number of nodes determines the type)."""
    width = (padded >= 0).sum(axis=1)
    # no cell has -1 nodes: the first one starts a run, too
    starts = np.flatnonzero(np.diff(width, prepend=-1))
    ends = np.append(starts[1:], len(width))
    return tuple(
        CellBlock(CELL_OF_N_NODE[int(width[a])], padded[a:b, : width[a]]) for a, b in zip(starts, ends, strict=True)
    )


def box_mesh(origin: Array, size: Array, elements: tuple[int, int, int]) -> Mesh:
    """Regular box of 8-node hexahedra with the faces xmin ... zmax.

    Parameters
    ----------
    origin, size : (3,) lowest corner and edge lengths, m. elements : number of elements per edge.
    """
    nx, ny, nz = elements
    axes = [origin[i] + size[i] * np.arange(n + 1) / n for i, n in enumerate(elements)]
    grid = np.meshgrid(*axes, indexing="ij")
    # the first axis runs fastest
    nodes = np.stack([g.ravel(order="F") for g in grid], axis=1)
    number = np.arange(len(nodes), dtype=np.int64).reshape((nx + 1, ny + 1, nz + 1), order="F")
    low, high = slice(None, -1), slice(1, None)
    corners = [
        number[i, j, k].ravel(order="F")
        for i, j, k in (
            (low, low, low),
            (high, low, low),
            (high, high, low),
            (low, high, low),
            (low, low, high),
            (high, low, high),
            (high, high, high),
            (low, high, high),
        )
    ]
    cells = np.stack(corners, axis=1)
    where = np.arange(len(cells)).reshape((nx, ny, nz), order="F")
    # in the order of BOX_FACES, which is that of HEX_FACES
    layers = (where[0], where[-1], where[:, 0], where[:, -1], where[:, :, 0], where[:, :, -1])
    faces = {
        name: cells[layer.ravel(order="F")][:, list(local)]
        for name, layer, local in zip(BOX_FACES, layers, HEX_FACES, strict=True)
    }
    return Mesh.uniform(nodes, "hexahedron", cells, faces)


def nearest(points: Array, candidates: Array) -> tuple[Array, Index]:
    """Distance (n_point,) to, and number of, the nearest of ``candidates`` (n, 3) for each of ``points``."""
    # no candidates: argmin would fail, the tree gives infinite distances
    if 0 < points.shape[0] * candidates.shape[0] <= _FEW:
        square = np.sum((points[:, None] - candidates) ** 2, axis=2)
        number = np.argmin(square, axis=1)
        return np.sqrt(square[np.arange(len(number)), number]), number.astype(np.int64)
    from scipy.spatial import cKDTree

    distance, number = cKDTree(candidates).query(points)
    return np.atleast_1d(np.asarray(distance, dtype=float)), np.atleast_1d(np.asarray(number, dtype=np.int64))
