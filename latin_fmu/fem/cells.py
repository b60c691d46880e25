"""Reference cells: numbers of nodes, corners, edges and faces in the node order of VTK and meshio.

Middle nodes of quadratic cells follow the corners in the order of the edges below, then come the centres of the faces
and of the cell. Wedges have their nodes 3, 4, 5 above 0, 1, 2 (Jacobian > 0), as every mesh generator writes them.
"""

from __future__ import annotations

from itertools import combinations
from typing import Final

Local = tuple[tuple[int, ...], ...]

HEX_EDGES = ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))
TET_EDGES = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))
WEDGE_EDGES = ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5))

# Corners of the faces, numbered so that the normal points outwards.
HEX_FACES = ((0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7))
TET_FACES = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))
WEDGE_FACES = ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5))


def _with_middle_nodes(faces: Local, edges: Local, corners: int, centres: bool = False) -> Local:
    """Faces of a quadratic cell: corners, middle nodes of the edges in the same turn, centre where there is one."""
    middle = {frozenset(edge): corners + i for i, edge in enumerate(edges)}
    found = []
    for i, face in enumerate(faces):
        turn = zip(face, (*face[1:], face[0]), strict=True)
        whole = (*face, *(middle[frozenset(edge)] for edge in turn))
        found.append((*whole, corners + len(edges) + i) if centres else whole)
    return tuple(found)


# The types of cells, by their names in meshio, with the nodes of their faces.
CELL_FACES: Final[dict[str, Local]] = {
    "hexahedron": HEX_FACES,
    "tetra": TET_FACES,
    "tetra10": _with_middle_nodes(TET_FACES, TET_EDGES, 4),
    "hexahedron20": _with_middle_nodes(HEX_FACES, HEX_EDGES, 8),
    "hexahedron27": _with_middle_nodes(HEX_FACES, HEX_EDGES, 8, centres=True),
    "wedge": WEDGE_FACES,
}
CELL_EDGES: Final[dict[str, Local]] = {
    "hexahedron": HEX_EDGES,
    "tetra": TET_EDGES,
    "tetra10": TET_EDGES,
    "hexahedron20": HEX_EDGES,
    "hexahedron27": HEX_EDGES,
    "wedge": WEDGE_EDGES,
}
N_NODE: Final = {name: 1 + max(n for face in faces for n in face) for name, faces in CELL_FACES.items()} | {
    "hexahedron27": 27  # the last node is on no face
}
N_CORNER: Final = {name: 1 + max(n for edge in edges for n in edge) for name, edges in CELL_EDGES.items()}


def _links(cell_type: str) -> Local:
    """Neighbouring nodes of a cell: half edges and what joins the middle nodes of one face; edges of linear cells."""
    corners, edges = N_CORNER[cell_type], CELL_EDGES[cell_type]
    if N_NODE[cell_type] == corners:
        return edges
    links = [(end, corners + i) for i, edge in enumerate(edges) for end in edge]
    for face in CELL_FACES[cell_type]:
        n = {6: 3}.get(len(face), 4)
        middles = face[n : 2 * n]
        if n == 3:
            links += list(combinations(middles, 2))
        if cell_type == "hexahedron27":
            links += [(face[8], middle) for middle in middles] + [(face[8], 26)]
    return tuple(links)


CELL_LINKS: Final = {name: _links(name) for name in CELL_FACES}
"""Pairs of neighbouring nodes."""

# Kinds of facets, by their names in meshio: the number of nodes tells the kind.
FACET_KIND: Final = {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8", 9: "quad9"}
FACET_CORNERS: Final = {"triangle": 3, "quad": 4, "triangle6": 3, "quad8": 4, "quad9": 4}
CELL_OF_N_NODE: Final = {count: name for name, count in N_NODE.items()}
