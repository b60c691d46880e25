"""Meshes of one substructure: nodes, cells of one type, named faces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# Faces of the reference cells, VTK node order, oriented so that the normal points outwards.
HEX_FACES = ((0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7))
TET_FACES = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))
CELL_FACES: Final = {"hexahedron": HEX_FACES, "tetra": TET_FACES}
BOX_FACES = ("xmin", "xmax", "ymin", "ymax", "zmin", "zmax")


@dataclass(frozen=True)
class Mesh:
    """Mesh of one substructure.

    Attributes
    ----------
    nodes : (n_node, 3) coordinates, m.
    cells : (n_cell, 8 | 4) connectivity, VTK order.
    cell_type : "hexahedron" (8 nodes) or "tetra" (4 nodes).
    faces : name -> (n_facet, 4 | 3) facets, oriented outwards.
    """

    nodes: Array
    cells: Index
    cell_type: str
    faces: dict[str, Index]

    @property
    def n_node(self) -> int:
        """Number of nodes."""
        return len(self.nodes)

    def extent(self) -> Array:
        """Size of the bounding box, (3,), m."""
        size: Array = np.ptp(self.nodes, axis=0)
        return size


def box_mesh(origin: Array, size: Array, elements: tuple[int, int, int]) -> Mesh:
    """Regular box of 8-node hexahedra with the faces xmin ... zmax.

    Parameters
    ----------
    origin, size : (3,) lowest corner and edge lengths, m. elements : number of elements per edge.
    """
    nx, ny, nz = elements
    axes = [origin[i] + size[i] * np.arange(n + 1) / n for i, n in enumerate(elements)]
    grid = np.meshgrid(*axes, indexing="ij")
    nodes = np.stack([g.ravel(order="F") for g in grid], axis=1)
    number = np.arange(len(nodes), dtype=np.int64).reshape((nx + 1, ny + 1, nz + 1), order="F")
    low, high = slice(None, -1), slice(1, None)
    corners = [
        number[i, j, k].ravel(order="F")
        for i, j, k in (
            (low, low, low), (high, low, low), (high, high, low), (low, high, low),
            (low, low, high), (high, low, high), (high, high, high), (low, high, high),
        )
    ]  # fmt: skip
    cells = np.stack(corners, axis=1)
    where = np.arange(len(cells)).reshape((nx, ny, nz), order="F")
    layers = (where[0], where[-1], where[:, 0], where[:, -1], where[:, :, 0], where[:, :, -1])
    faces = {
        name: cells[layer.ravel(order="F")][:, list(local)]
        for name, layer, local in zip(BOX_FACES, layers, HEX_FACES, strict=True)
    }
    return Mesh(nodes, cells, "hexahedron", faces)
