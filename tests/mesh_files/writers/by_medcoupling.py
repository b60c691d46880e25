"""The library of Salome: a mesh on two levels with groups of cells, and the unit of length."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import medcoupling as mc
import numpy as np

from .solid import Format, Solid

TITLE: Final = "MEDCoupling (Salome)"
REQUIRES: Final = ("medcoupling==9.15.0", "numpy")
PACKAGE: Final = "medcoupling"
_TYPES: Final = {
    **{"triangle": mc.NORM_TRI3, "quad": mc.NORM_QUAD4, "triangle6": mc.NORM_TRI6, "quad8": mc.NORM_QUAD8},
    **{"quad9": mc.NORM_QUAD9, "tetra": mc.NORM_TETRA4, "hexahedron": mc.NORM_HEXA8, "wedge": mc.NORM_PENTA6},
    **{"pyramid": mc.NORM_PYRA5, "tetra10": mc.NORM_TETRA10, "hexahedron20": mc.NORM_HEXA20},
    **{"hexahedron27": mc.NORM_HEXA27, "wedge15": mc.NORM_PENTA15, "wedge18": mc.NORM_PENTA18},
    "pyramid13": mc.NORM_PYRA13,
}
FORMATS: Final = {
    ".med": Format(".med", option="cells"),
    ".med, faces by groups of nodes": Format(".med", option="nodes"),
    ".med 3.3.1": Format(".med", option="old"),
    ".med, one mesh of cells": Format(".med", bodies=False, faces=False, option="plain"),
    ".vtu": Format(".vtu", bodies=False, faces=False, near=1e-6, option="vtu"),
}


def level(solid: Solid, flat: bool, points: Any) -> tuple[Any, dict[str, Any]]:
    """Cells of one dimension sorted by type, and the numbers of those of each group."""
    names = solid.faces if flat else solid.bodies
    pieces = [piece for piece in solid.rows("med") if piece[2] in names]
    mesh = mc.MEDCouplingUMesh("solid", 2 if flat else 3)
    mesh.setCoords(points)
    mesh.allocateCells(sum(len(rows) for _, rows, _ in pieces))
    groups: dict[str, list[int]] = {name: [] for name in names}
    for kind, rows, name in sorted(pieces, key=lambda piece: _TYPES[piece[0]]):
        for row in rows.tolist():
            groups[name].append(mesh.getNumberOfCells())
            mesh.insertNextCell(_TYPES[kind], len(row), row)
    mesh.finishInsertingCells()
    return mesh, groups


def array(name: str, numbers: list[int]) -> Any:
    """A group."""
    made = mc.DataArrayInt64(sorted(numbers))
    made.setName(name)
    return made


def write(solid: Solid, form: Format, path: Path) -> None:
    """The solid in a format."""
    points = mc.DataArrayDouble(np.ascontiguousarray(solid.points))
    points.setInfoOnComponents(["X [mm]", "Y [mm]", "Z [mm]"])
    cells, bodies = level(solid, False, points)
    if form.option == "vtu":
        cells.writeVTK(str(path))
        return
    if form.option == "plain":
        mc.WriteUMesh(str(path), cells, True)
        return
    file = mc.MEDFileUMesh()
    file.setMeshAtLevel(0, cells)
    file.setGroupsAtLevel(0, [array(name, rows) for name, rows in bodies.items()])
    if form.option == "nodes":
        file.setGroupsAtLevel(1, [array(face, solid.nodes_of(face).tolist()) for face in solid.faces])
    else:
        facets, faces = level(solid, True, points)
        file.setMeshAtLevel(-1, facets)
        file.setGroupsAtLevel(-1, [array(name, rows) for name, rows in faces.items()])
    if form.option == "old":
        file.write33(str(path), 2)
    else:
        file.write(str(path), 2)
