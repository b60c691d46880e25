"""Pieces of a CalculiX deck: faces of elements, tables, lists of numbers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from latin_fmu.fem.mesh import Mesh

Array = NDArray[np.float64]

# Local nodes of the faces of C3D8, in the order of the numbers that CalculiX gives them.
FACES = ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))


def surface(face: str) -> str:
    """Name of a face in the deck."""
    return face.replace(".", "_").upper()


def facets(mesh: Mesh, side: str) -> Iterator[tuple[int, int]]:
    """Elements (from 0) and the numbers of their faces that make up a face of the mesh."""
    wanted = {frozenset(f) for b in mesh.faces[side].blocks for f in b.facets.tolist()}
    for element, cell in enumerate(mesh.blocks[0].cells.tolist()):
        for number, local in enumerate(FACES, 1):
            if frozenset(cell[k] for k in local) in wanted:
                yield element, number


def facet_area(mesh: Mesh, side: str) -> float:
    """Mean area of the facets of a plane face made of parallelograms, m2."""
    corner = mesh.nodes[mesh.faces[side].blocks[0].facets]
    sides = corner[:, 1] - corner[:, 0], corner[:, 3] - corner[:, 0]
    return float(np.linalg.norm(np.cross(*sides), axis=1).mean())


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
