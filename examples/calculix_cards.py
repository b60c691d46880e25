"""Pieces of a CalculiX deck: faces of elements, tables, lists of numbers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from latin_fmu.fem.mesh import Mesh

Array = NDArray[np.float64]

# Elements of CalculiX by type of cell, and the local nodes of their faces in the order of the numbers it gives them.
ELEMENTS = {"hexahedron": "C3D8", "tetra": "C3D4"}
FACES = {
    "hexahedron": ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
    "tetra": ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
}


def surface(face: str) -> str:
    """Name of a face in the deck."""
    return face.replace(".", "_").upper()


def facets(mesh: Mesh, side: str) -> Iterator[tuple[int, int]]:
    """Elements (from 0) and the numbers of their faces that make up a face of the mesh."""
    wanted = {frozenset(f) for b in mesh.faces[side].blocks for f in b.facets.tolist()}
    for element, cell in enumerate(mesh.blocks[0].cells.tolist()):
        for number, local in enumerate(FACES[mesh.blocks[0].cell_type], 1):
            if frozenset(cell[k] for k in local) in wanted:
                yield element, number


def facet_area(mesh: Mesh, side: str) -> float:
    """Mean area of the facets of a plane face made of parallelograms or triangles, m2."""
    corner = mesh.nodes[mesh.faces[side].blocks[0].facets]
    sides = corner[:, 1] - corner[:, 0], corner[:, -1] - corner[:, 0]
    return float(np.linalg.norm(np.cross(*sides), axis=1).mean()) / (2.0 if corner.shape[1] == 3 else 1.0)


def amplitude(name: str, time: Array, values: Array) -> Iterator[str]:
    """A table, four pairs a line."""
    yield f"*AMPLITUDE, NAME={name.upper()}"
    pairs = [f"{t:.9e}, {v:.9e}" for t, v in zip(time, values, strict=True)]
    for first in range(0, len(pairs), 4):
        yield ", ".join(pairs[first : first + 4])


def wrapped(numbers: Iterable[int]) -> Iterator[str]:
    """Numbers, twelve a line."""
    texts = [str(int(n)) for n in numbers]
    for first in range(0, len(texts), 12):
        yield ", ".join(texts[first : first + 12])
