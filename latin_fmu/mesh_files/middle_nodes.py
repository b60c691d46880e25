"""Middle nodes of quadratic cells: brought into the order of VTK, and made where a file leaves them out.

Formats count the middle nodes of edges in different orders, and some writers use the order of another format. The order
of a format counts unless the nodes of a block lie in the middle of the edges of another one: a middle node lies between
the corners of its edge, in curved cells, too.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from .content import CORNERS, Array, Index, MeshContent

_TETRA: Final = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))
_PYRAMID: Final = ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4))
_WEDGE: Final = ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5))
_HEXAHEDRON: Final = (
    *((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4)),
    *((0, 4), (1, 5), (2, 6), (3, 7)),
)
_HEXAHEDRON_FACES: Final = ((0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7))
_WEDGE_FACES: Final = ((0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5))
_WHOLE: Final = (0, 1, 2, 3, 4, 5, 6, 7)
Places = tuple[tuple[int, ...], ...]

VTK: Final[dict[str, Places]] = {
    "tetra10": _TETRA,
    "pyramid13": _PYRAMID,
    "wedge15": _WEDGE,
    "wedge18": (*_WEDGE, *_WEDGE_FACES),
    "hexahedron20": _HEXAHEDRON,
    "hexahedron27": (*_HEXAHEDRON, *_HEXAHEDRON_FACES, _WHOLE),
}
"""Corners whose middle each node after the corners is, in the order of VTK."""
_NASTRAN: Final[dict[str, Places]] = {
    **VTK,
    # vertical edges before upper ones (MSC Nastran Quick Reference Guide, CPENTA and CHEXA)
    "wedge15": (*_WEDGE[:3], *_WEDGE[6:], *_WEDGE[3:6]),
    "hexahedron20": (*_HEXAHEDRON[:4], *_HEXAHEDRON[8:], *_HEXAHEDRON[4:8]),
}
_ABAQUS: Final[dict[str, Places]] = {
    **VTK,
    # C3D27: the middle of the cell, then of its faces S1 to S6
    "hexahedron27": (
        *_HEXAHEDRON,
        _WHOLE,
        *((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
    ),
}
_GMSH_WEDGE: Final = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 4), (2, 5), (3, 4), (3, 5), (4, 5))
_GMSH_HEXAHEDRON: Final = (
    *((0, 1), (0, 3), (0, 4), (1, 2), (1, 5), (2, 3), (2, 6), (3, 7), (4, 5), (4, 7), (5, 6), (6, 7)),
)
# Reference manual of gmsh, node ordering
_GMSH: Final[dict[str, Places]] = {
    "tetra10": (*_TETRA[:4], (2, 3), (1, 3)),
    "pyramid13": ((0, 1), (0, 3), (0, 4), (1, 2), (1, 4), (2, 3), (2, 4), (3, 4)),
    "wedge15": _GMSH_WEDGE,
    "wedge18": (*_GMSH_WEDGE, (0, 1, 4, 3), (0, 2, 5, 3), (1, 2, 5, 4)),
    "hexahedron20": _GMSH_HEXAHEDRON,
    "hexahedron27": (
        *_GMSH_HEXAHEDRON,
        *((0, 3, 2, 1), (0, 1, 5, 4), (0, 3, 7, 4), (1, 2, 6, 5), (2, 3, 7, 6), (4, 5, 6, 7)),
        _WHOLE,
    ),
}
ORDERS: Final[dict[str, dict[str, Places]]] = {"Nastran": _NASTRAN, "Abaqus": _ABAQUS, "gmsh": _GMSH}
"""Orders that files of decks have, by the program that is known for them."""
_CLEAR: Final = 0.25  # another order counts where the nodes are so many times nearer to their edges


def in_vtk_order(points: Array, kind: str, cells: Index, format_name: str) -> tuple[Index, str]:
    """Cells (n_cell, n_node) in the order of VTK, and the program whose order they had.

    points : (n_point, 3). cells : rows of ``points``, -1 for middle nodes that are not there. format_name : a key of
    ``ORDERS``, that of the format.
    """
    if kind not in VTK or not len(cells):
        return cells, format_name
    distances = {name: _distance(points, cells, CORNERS[kind], order[kind]) for name, order in ORDERS.items()}
    best = min(distances, key=distances.__getitem__)
    if distances[best] < _CLEAR * distances[format_name]:
        name = best
    else:
        name = format_name
    places = {frozenset(place): CORNERS[kind] + i for i, place in enumerate(ORDERS[name][kind])}
    return cells[:, [*range(CORNERS[kind]), *(places[frozenset(place)] for place in VTK[kind])]], name


def _distance(points: Array, cells: Index, corners: int, order: Places) -> float:
    """Mean square of the distances of middle nodes from the middle of their corners."""
    total = 0.0
    for i, place in enumerate(order):
        there = cells[:, corners + i] >= 0
        middle = points[cells[there][:, list(place)]].mean(axis=1)
        with np.errstate(all="ignore"):  # absurd coordinates, refused later
            total += float(((points[cells[there, corners + i]] - middle) ** 2).sum())
    return total


def complete(content: MeshContent) -> None:
    """Give cells the middle nodes that are not there, -1: the node that another cell has on that edge, else a new one
    in the middle of its corners, which is said."""
    on_edge: dict[tuple[int, ...], int] = {}
    lacking = {kind for kind, cells in content.solids.items() if (cells < 0).any()}
    if not lacking:
        return
    for kind, cells in content.solids.items():
        for i, place in enumerate(VTK.get(kind, ())):
            column = CORNERS[kind] + i
            there = cells[:, column] >= 0
            corners = np.sort(cells[there][:, list(place)], axis=1).tolist()
            on_edge.update(zip(map(tuple, corners), cells[there, column].tolist(), strict=True))
    points, first = [content.points], len(content.points)
    count = first
    for kind in sorted(lacking):
        cells = content.solids[kind]
        for i, place in enumerate(VTK[kind]):
            column = CORNERS[kind] + i
            for row in np.flatnonzero(cells[:, column] < 0).tolist():
                corners = cells[row, list(place)]
                key = tuple(sorted(corners.tolist()))
                if key not in on_edge:
                    on_edge[key] = count
                    points.append(content.points[corners].mean(axis=0)[None])
                    count += 1
                cells[row, column] = on_edge[key]
    content.points = np.concatenate(points)
    if count > first:
        if count == first + 1:
            new = "1 middle node that the file leaves out was"
        else:
            new = f"{count - first} middle nodes "
        if count != first + 1:
            new += "that the file leaves out were"
        content.said.append(f"{new} put in the middle of the edge")
