"""Meshes of the bodies of a scene in one deck: numbers of nodes and elements, types of elements, numbers of faces.

Elements of CalculiX by type of cell; pyramids, and cells with nodes in the middle of their faces, have none.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np

from ..assembly.body import Body
from ..fem.mesh import CellBlock, FacetSet, Index, Mask, Mesh
from ..fem.reference_cells import N_CORNER
from ..mesh_files.abaqus import SOLID_FACES
from .card_text import element_card, node_card

ELEMENTS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "tetra": "C3D4",
        "tetra10": "C3D10",
        "hexahedron": "C3D8",
        "hexahedron20": "C3D20",
        "wedge": "C3D6",
        "wedge15": "C3D15",
    }
)
"""Type of element by type of cell."""
_PADDED: Final = 4  # corners of the widest face


def element_of(block: CellBlock, bending_modes: bool) -> str:
    """Type of element of a block of cells of a body; ``bending_modes`` : of its 8-node hexahedra.

    Raises
    ------
    KeyError : CalculiX has none.
    """
    kind = ELEMENTS[block.cell_type]
    if kind == "C3D8" and bending_modes:
        return "C3D8I"
    if kind == "C3D8" and block.reduced:
        return "C3D8R"
    if kind == "C3D20" and block.reduced:
        return "C3D20R"
    return kind


@dataclass(frozen=True)
class NumberedMesh:
    """Meshes of bodies with their numbers in a deck.

    Attributes
    ----------
    bodies : by name. nodes : (n_node,) numbers of the nodes of each body, from 1; two nodes of one number are one.
    elements : number of the first element of each body.
    """

    bodies: Mapping[str, Body]
    nodes: Mapping[str, Index]
    elements: Mapping[str, int]

    @classmethod
    def of(cls, bodies: Mapping[str, Body], nodes: Mapping[str, Index] | None = None) -> NumberedMesh:
        """Bodies one after the other; ``nodes`` : numbers of nodes other than these."""
        if nodes is None:
            ends = np.cumsum([0, *(body.mesh.n_node for body in bodies.values())]).tolist()
            starts = zip(bodies.items(), ends, strict=False)
            nodes = {name: first + 1 + np.arange(body.mesh.n_node) for (name, body), first in starts}
        before = np.cumsum([1, *(body.mesh.n_cell for body in bodies.values())]).tolist()
        return cls(bodies, nodes, dict(zip(bodies, before, strict=False)))

    @property
    def last_node(self) -> int:
        """The largest number of a node."""
        return max(int(numbers.max()) for numbers in self.nodes.values())

    def lines(self, every: str) -> Iterator[str]:
        """Nodes, in a set of the name ``every``, and elements, in a set for each body."""
        names = list(self.bodies)
        numbers = np.concatenate([self.nodes[name] for name in names])
        points = np.concatenate([self.bodies[name].mesh.nodes for name in names])
        unique, first = np.unique(numbers, return_index=True)
        yield from node_card(points[first], unique, every)
        for name, body in self.bodies.items():
            start = self.elements[name]
            for block in body.mesh.blocks:
                labels = start + np.arange(len(block.cells))
                start += len(block.cells)
                kind = element_of(block, body.shape.bending_modes)
                yield from element_card(kind, self.nodes[name][block.cells], labels, name)

    def faces(self, name: str, facets: FacetSet) -> list[tuple[int, int]]:
        """Numbers of the elements of a body and of their faces that are these facets."""
        return self.faces_among(name, [block.corners for block in facets.blocks])

    def faces_among(self, name: str, corners: Sequence[Index], elements: Mask | None = None) -> list[tuple[int, int]]:
        """The same of the corners (n_facet, 3 | 4) of facets; ``elements`` : (n_cell,) whose faces are looked at."""
        owner, number, keys = element_faces(self.bodies[name].mesh)
        if elements is not None:
            owner, number, keys = (table[elements[owner]] for table in (owner, number, keys))
        wanted = _keys([np.asarray(table) for table in corners])
        _, place = np.unique(np.concatenate([wanted, keys]), axis=0, return_inverse=True)
        found = np.flatnonzero(np.isin(place.ravel()[len(wanted) :], place.ravel()[: len(wanted)]))
        return [(int(owner[i]) + self.elements[name], int(number[i])) for i in found]


def element_faces(mesh: Mesh) -> tuple[Index, Index, Index]:
    """Faces of all elements of a mesh, by element: its row (n,), the number of the face from 1 (n,), and its corners in
    ascending order (n, 4), -1 before those of a triangle."""
    owners, numbers, keys = list[Index](), list[Index](), list[Index]()
    first = 0
    for block in mesh.blocks:
        for number, local in enumerate(SOLID_FACES[N_CORNER[block.cell_type]], 1):
            owners.append(first + np.arange(len(block.cells)))
            numbers.append(np.full(len(block.cells), number))
            keys.append(_keys([block.cells[:, list(local)]]))
        first += len(block.cells)
    owner = np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    return owner[order], np.concatenate(numbers)[order], np.concatenate(keys)[order]


def _keys(tables: Sequence[Index]) -> Index:
    """Corners of facets in ascending order, (n, 4), filled with -1."""
    wide = [np.full((len(table), _PADDED), -1, dtype=np.int64) for table in tables]
    for padded, table in zip(wide, tables, strict=True):
        padded[:, : table.shape[1]] = table
    keys: Index = np.sort(np.concatenate([np.zeros((0, _PADDED), dtype=np.int64), *wide]), axis=1)
    return keys
