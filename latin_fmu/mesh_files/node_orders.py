"""Order of the nodes of quadratic cells: every format counts the middle nodes of its edges in an order of its own.

A format is described by the edges, and the faces with a node in their middle, in the order in which it counts their
nodes; what is the order of VTK follows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

Corners = Sequence[Sequence[int]]
"""Corners of the edges or faces that have a node in their middle."""

EDGES: Final[Mapping[str, Corners]] = {
    "triangle6": ((0, 1), (1, 2), (2, 0)),
    "quad8": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "quad9": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "tetra10": ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    "pyramid13": ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)),
    "pyramid14": ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)),
    "wedge15": ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
    "wedge18": ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
    "hexahedron20": (
        *((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4)),
        *((0, 4), (1, 5), (2, 6), (3, 7)),
    ),
    "hexahedron27": (
        *((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4)),
        *((0, 4), (1, 5), (2, 6), (3, 7)),
    ),
}
"""Edges of the quadratic cells in the order in which VTK counts their middle nodes."""

FACES: Final[Mapping[str, Corners]] = {
    "quad9": ((0, 1, 2, 3),),
    "pyramid14": ((0, 1, 2, 3),),
    "wedge18": ((0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    "hexahedron27": ((0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7)),
}
"""Faces with a node in their middle, in the order in which VTK counts these; one more node is that of the cell."""

_N_CORNER: Final = {"triangle": 3, "quad": 4, "tetra": 4, "pyramid": 5, "wedge": 6, "hexahedron": 8}


_SAMPLE: Final = 2000  # cells that are looked at
_BETTER: Final = 0.25  # sum of squares of another order, of that of the order in the file, from which on it is that one
_FAR: Final = 1e-4  # sum of squares of distances of nodes from their places, of that of cell sizes; less is curvature


def in_another_order(points: NDArray[np.float64], kind: str, cells: NDArray[np.int64]) -> bool:
    """Whether the middle nodes of cells lie badly in the order of VTK, and well in another one.

    The places of middle nodes are the middles of the corners of their edge, face or cell. The order in which the sum of
    squares of the distances between nodes and places is the smallest solves an assignment; it is compared with the sum
    in the order of VTK.

    Parameters
    ----------
    points : (n_point, 3). cells : (n_cell, n_node) of a type, in the order of VTK.
    """
    from scipy.optimize import linear_sum_assignment  # few files need it

    if kind not in EDGES or not len(cells):
        return False
    some = points[cells[:: max(1, len(cells) // _SAMPLE)]]
    corners = _N_CORNER[kind.rstrip("0123456789")]
    places: list[Sequence[int]] = [*EDGES[kind], *FACES.get(kind, ()), range(corners)]
    nodes = some[:, corners:]
    with np.errstate(all="ignore"):  # absurd coordinates are refused later
        middles = np.stack([some[:, list(place)].mean(axis=1) for place in places[: nodes.shape[1]]], axis=1)
        # (n_node, n_place) sums over the cells
        distances = ((nodes[:, :, None] - middles[:, None]) ** 2).sum(axis=(0, 3))
        size = ((some[:, :corners] - some[:, :corners].mean(axis=1, keepdims=True)) ** 2).sum()
        here = float(np.trace(distances))
        if not np.isfinite(distances).all() or here <= _FAR * size:
            return False
        return float(distances[linear_sum_assignment(distances)].sum()) < _BETTER * here


def n_node_of(kind: str) -> int:
    """Number of nodes of a cell type: the one in its name, else its corners."""
    stem = kind.rstrip("0123456789")
    if len(stem) < len(kind):
        return int(kind[len(stem) :])
    return _N_CORNER[kind]


def to_vtk(kind: str, edges: Corners, faces: Corners = ()) -> list[int]:
    """Columns of a connectivity of another format in the order of VTK: ``cells[:, to_vtk(...)]``.

    Parameters
    ----------
    kind : type of cell; its corners and the node of the cell stand where VTK has them.
    edges, faces : in the order in which the format counts their middle nodes.
    """
    corners = _N_CORNER[kind.rstrip("0123456789")]
    places = {frozenset(item): corners + i for i, item in enumerate((*edges, *faces))}
    wanted = [*EDGES.get(kind, ()), *FACES.get(kind, ())]
    return [
        *range(corners),
        *(places[frozenset(item)] for item in wanted),
        *range(corners + len(wanted), n_node_of(kind)),
    ]
