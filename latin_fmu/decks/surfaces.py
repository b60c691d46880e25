"""Surfaces of a deck: distances of the nodes of one from the facets of another, facets that are inside a body."""

from __future__ import annotations

import numpy as np

from ..fem.reference_cells import CELL_FACES, FACET_CORNERS, FACET_KIND, N_CORNER
from ..mesh_files.abaqus import SOLID_FACES
from ..mesh_files.content import CORNERS, NO_ROWS, Array, Index, MeshContent

_NEIGHBOURS = 8  # facets that are tried, by their middles


def closest(content: MeshContent, slave: str, master: str) -> Array:
    """Distance (n,) of each node of the surface ``slave`` from the surface ``master``, in the units of the deck; none
    where one of them is not there.

    The nearest of the triangles of ``_NEIGHBOURS`` facets with the nearest middles.
    """
    nodes, triangles = surface_nodes(content, slave), _triangles(content, master)
    if not len(nodes) or not len(triangles):
        return np.zeros(0)
    from scipy.spatial import cKDTree  # a tenth of a second to load, and decks without contact do without

    points = content.points[nodes]
    count = min(_NEIGHBOURS, len(triangles))
    near = cKDTree(triangles.mean(axis=1)).query(points, k=count)[1].reshape(len(points), count)
    found: Array = np.min([_from_triangles(points, triangles[near[:, i]]) for i in range(count)], axis=0)
    return found


def inner_facets(content: MeshContent, name: str) -> int:
    """Number of facets of a surface that lie between two cells."""
    wanted = [np.sort(table, axis=1) for table in _tables(content, name)]
    if not wanted:
        return 0
    count = 0
    for corners in (3, 4):
        some = [table for table in wanted if table.shape[1] == corners]
        faces = [
            np.sort(cells[:, list(face)], axis=1)
            for kind, cells in content.solids.items()
            for face in SOLID_FACES[CORNERS[kind]]
            if len(face) == corners
        ]
        if some and faces:
            unique, times = np.unique(np.concatenate(faces), axis=0, return_counts=True)
            within = {row.tobytes() for row in unique[times > 1]}
            count += sum(row.tobytes() in within for row in np.concatenate(some))
    return count


def unlisted_middles(content: MeshContent, rows: Index) -> int:
    """Number of middle nodes that are not among some nodes, of outer facets that have all their corners there: a face
    of quadratic cells has them, and so has what acts on it."""
    inside = np.zeros(len(content.points), dtype=bool)
    inside[rows] = True
    outer: dict[bytes, Index] = {}
    for kind, cells in content.solids.items():
        if kind not in CELL_FACES or cells.shape[1] == N_CORNER[kind]:
            continue
        for face in CELL_FACES[kind]:
            corners = FACET_CORNERS[FACET_KIND[len(face)]]
            nodes = cells[:, list(face)]
            for row in nodes[inside[nodes[:, :corners]].all(axis=1)]:
                key = np.sort(row[:corners]).tobytes()
                # the same facet of a second cell: it is inside the body
                outer[key] = row[:0] if key in outer else row[corners:]
    middles = np.unique(np.concatenate([NO_ROWS, *outer.values()]))
    return int((~inside[middles]).sum())


def _tables(content: MeshContent, name: str) -> list[Index]:
    """Corners of the facets of a surface."""
    spelled = {key.upper(): key for key in reversed(list(content.facets))}
    return list(content.facets.get(spelled.get(name.rpartition(".")[2].upper(), ""), []))


def surface_nodes(content: MeshContent, name: str) -> Index:
    """Rows of the nodes of a surface of facets or nodes."""
    if tables := _tables(content, name):
        return np.unique(np.concatenate([table.ravel() for table in tables]))
    spelled = {key.upper(): key for key in content.node_sets}
    return content.node_sets.get(spelled.get(name.rpartition(".")[2].upper(), ""), NO_ROWS)


def _triangles(content: MeshContent, name: str) -> Array:
    """Corners (n, 3, 3) of the facets of a surface, quadrilaterals cut in two."""
    pieces = [np.zeros((0, 3, 3))]
    for table in _tables(content, name):
        corners = content.points[table]
        pieces.append(corners[:, [0, 1, 2]])
        if corners.shape[1] == 4:
            pieces.append(corners[:, [0, 2, 3]])
    return np.concatenate(pieces)


def mean_facet(content: MeshContent, name: str) -> float:
    """Mean area of the facets of a surface; 0 of one of nodes."""
    triangles = _triangles(content, name)
    areas = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1) / 2.0
    return float(areas.sum()) / max(sum(len(table) for table in _tables(content, name)), 1)


def _from_triangles(points: Array, triangles: Array) -> Array:
    """Distance (n,) of each point from its triangle (n, 3, 3): from its plane inside, else from the nearest edge."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    normal = np.cross(b - a, c - a)
    size = (normal**2).sum(axis=1)
    share = [
        (np.cross(second - first, points - first) * normal).sum(axis=1) / size
        for first, second in ((a, b), (b, c), (c, a))
    ]
    inside = np.min(share, axis=0) >= 0.0
    plane = np.abs(((points - a) * normal).sum(axis=1)) / np.sqrt(size)
    edges = np.min([_from_segments(points, p, q) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    distance: Array = np.where(inside, plane, edges)
    return distance


def _from_segments(points: Array, start: Array, end: Array) -> Array:
    """Distance (n,) of each point from its segment."""
    along = end - start
    share = np.clip(((points - start) * along).sum(axis=1) / (along**2).sum(axis=1), 0.0, 1.0)
    distance: Array = np.linalg.norm(points - start - share[:, None] * along, axis=1)
    return distance
