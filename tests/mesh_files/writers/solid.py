"""The solids that every program writes, in a file that needs nothing but NumPy, and what a program says of its formats.

The orders of nodes are those of VTK; each program is asked in its own, by the tables here, which follow its manual.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Index = NDArray[np.int64]

FLAT: Final = ("triangle", "triangle6", "quad", "quad8", "quad9")
_UPPER_LAST: Final = {
    "wedge15": [*range(9), 12, 13, 14, 9, 10, 11],
    "hexahedron20": [*range(12), 16, 17, 18, 19, 12, 13, 14, 15],
}
ORDERS: Final[dict[str, dict[str, list[int]]]] = {
    "gmsh": {  # reference manual, node ordering
        "tetra10": [0, 1, 2, 3, 4, 5, 6, 7, 9, 8],
        "pyramid13": [*range(6), 8, 9, 6, 10, 7, 11, 12],
        "wedge15": [*range(7), 8, 12, 7, 13, 14, 9, 11, 10],
        "wedge18": [*range(7), 8, 12, 7, 13, 14, 9, 11, 10, 15, 17, 16],
        "hexahedron20": [*range(8), 8, 11, 16, 9, 17, 10, 18, 19, 12, 15, 13, 14],
        "hexahedron27": [*range(8), 8, 11, 16, 9, 17, 10, 18, 19, 12, 15, 13, 14, 24, 22, 20, 21, 23, 25, 26],
    },
    # vertical edges before upper ones: Nastran (CHEXA, CPENTA), Exodus, CGNS (SIDS, HEXA_20, PENTA_15)
    "vertical first": _UPPER_LAST,
    # CGNS (SIDS, HEXA_27): below, four sides, above, inside
    "cgns": {
        **_UPPER_LAST,
        "hexahedron27": [*_UPPER_LAST["hexahedron20"], 24, 22, 21, 23, 20, 25, 26],
        "wedge18": [*_UPPER_LAST["wedge15"], 15, 16, 17],
    },
    # Exodus II (HEX27): inside, below, above, left, right, front, back
    "exodus": {
        **_UPPER_LAST,
        "hexahedron27": [*_UPPER_LAST["hexahedron20"], 26, 24, 25, 20, 21, 22, 23],
        "wedge18": [*_UPPER_LAST["wedge15"], 15, 16, 17],
    },
    # hexahedra_3d_27.h: below, in front, right, behind, left, above
    "kratos": {**_UPPER_LAST, "hexahedron27": [*_UPPER_LAST["hexahedron20"], 24, 22, 21, 23, 20, 25, 26]},
    "med": {"hexahedron27": [*range(20), 24, 22, 21, 23, 20, 25, 26]},
}
"""Columns of the nodes in the order of VTK that are written one after another, by program or format."""

VTK_NUMBERS: Final = {
    **{"triangle": 5, "quad": 9, "tetra": 10, "hexahedron": 12, "wedge": 13, "pyramid": 14, "triangle6": 22},
    **{"quad8": 23, "quad9": 28, "tetra10": 24, "hexahedron20": 25, "wedge15": 26, "pyramid13": 27},
    **{"hexahedron27": 29, "wedge18": 32},
}
"""Numbers of cells in VTK (vtkCellType.h)."""
EXODUS_NAMES: Final = {
    **{"tetra": "TETRA", "tetra10": "TETRA10", "hexahedron": "HEX", "hexahedron20": "HEX20", "hexahedron27": "HEX27"},
    **{"wedge": "WEDGE", "wedge15": "WEDGE15", "wedge18": "WEDGE18", "pyramid": "PYRAMID", "pyramid13": "PYRAMID13"},
}
EXODUS_SIDES: Final = {  # Exodus II manual, table of element sides
    "tetra": ((0, 1, 3), (1, 2, 3), (0, 3, 2), (0, 2, 1)),
    "pyramid": ((0, 1, 4), (1, 2, 4), (2, 3, 4), (0, 4, 3), (0, 3, 2, 1)),
    "wedge": ((0, 1, 4, 3), (1, 2, 5, 4), (0, 3, 5, 2), (0, 2, 1), (3, 4, 5)),
    "hexahedron": ((0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (0, 4, 7, 3), (0, 3, 2, 1), (4, 5, 6, 7)),
}


@dataclass(frozen=True)
class Format:
    """A format of a program.

    Attributes
    ----------
    suffix : of the file. bodies, faces : whether the program writes which cells belong to a body, facets to a face.
    near : relative difference of volumes and areas that the digits of the file leave. keys : further lines of the
    table [mesh] that a user writes for such a file, with the reason beside the format. option : of the program.
    """

    suffix: str
    bodies: bool = True
    faces: bool = True
    near: float = 1e-9
    keys: str = ""
    option: Any = None
    own: bool = False


@dataclass(frozen=True)
class Solid:
    """Two bodies and named parts of their surface; lengths in mm.

    Attributes
    ----------
    name : of its cells. points : (n, 3). cells, facets : type, rows (n_cell, n_node) of points, body or face.
    """

    name: str
    points: NDArray[np.float64]
    cells: tuple[tuple[str, Index, str], ...] = ()
    facets: tuple[tuple[str, Index, str], ...] = ()
    bodies: tuple[str, ...] = field(default=("left", "right"))
    faces: tuple[str, ...] = field(default=("foot", "tip", "side"))

    def nodes_of(self, face: str) -> Index:
        """Nodes of a face, ascending."""
        return np.unique(np.concatenate([rows.ravel() for _, rows, name in self.facets if name == face]))

    def rows(self, order: str = "", flat: bool = True) -> list[tuple[str, Index, str]]:
        """Cells and facets, their nodes in the order of a program."""
        columns = ORDERS.get(order, {})
        pieces = [*self.cells, *(self.facets if flat else ())]
        return [(kind, rows[:, columns.get(kind, list(range(rows.shape[1])))], name) for kind, rows, name in pieces]

    def marks(self) -> dict[str, int]:
        """A number for each body and face, from 1."""
        return {name: i for i, name in enumerate((*self.bodies, *self.faces), 1)}

    def save(self, path: Path) -> None:
        """Write the solid."""
        tables: dict[str, Any] = {"points": self.points}
        for word, pieces in (("cells", self.cells), ("facets", self.facets)):
            for i, (kind, rows, name) in enumerate(pieces):
                tables[f"{word}:{i}:{kind}:{name}"] = rows
        np.savez(path, **tables)

    @classmethod
    def load(cls, path: Path) -> Solid:
        """The solid of a file."""
        tables: dict[str, list[tuple[str, Index, str]]] = {"cells": [], "facets": []}
        with np.load(path) as data:
            for key in data.files:
                if key != "points":
                    word, _, kind, name = key.split(":")
                    tables[word].append((kind, data[key], name))
            return cls(path.stem, data["points"], tuple(tables["cells"]), tuple(tables["facets"]))


def sides_of(solid: Solid, face: str) -> tuple[Index, Index]:
    """Elements and their sides, from 1, of a face in Exodus, whose elements are counted through all cells."""
    wanted = {
        tuple(sorted(row[: 3 if kind[0] == "t" else 4]))
        for kind, rows, name in solid.facets
        if name == face
        for row in rows.tolist()
    }
    elements, sides, number = [], [], 0
    for kind, rows, _ in solid.cells:
        for row in rows.tolist():
            number += 1
            for i, corners in enumerate(EXODUS_SIDES[kind.rstrip("0123456789")], 1):
                if tuple(sorted(row[j] for j in corners)) in wanted:
                    elements.append(number)
                    sides.append(i)
    return np.array(elements), np.array(sides)
