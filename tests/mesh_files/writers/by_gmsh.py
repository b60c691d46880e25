"""gmsh: a discrete model with a physical volume for each body and a physical surface for each face."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import gmsh
import numpy as np

from .solid import Format, Solid

TITLE: Final = "gmsh"
REQUIRES: Final = ("gmsh==4.15.2", "numpy")
PACKAGE: Final = "gmsh"
_NUMBERS: Final = {
    **{"triangle": 2, "quad": 3, "tetra": 4, "hexahedron": 5, "wedge": 6, "pyramid": 7, "triangle6": 9, "quad9": 10},
    **{"tetra10": 11, "hexahedron27": 12, "wedge18": 13, "quad8": 16, "hexahedron20": 17, "wedge15": 18},
    "pyramid13": 19,
}
FORMATS: Final = {
    ".msh 2.2": Format(".msh", option={"MshFileVersion": 2.2}),
    ".msh 2.2 binary": Format(".msh", option={"MshFileVersion": 2.2, "Binary": 1}),
    ".msh 4.0": Format(".msh", option={"MshFileVersion": 4.0}),
    ".msh 4.1": Format(".msh", option={"MshFileVersion": 4.1}),
    ".msh 4.1 binary": Format(".msh", option={"MshFileVersion": 4.1, "Binary": 1}),
    ".inp": Format(".inp"),
    ".inp, sets of nodes": Format(".inp", option={"SaveGroupsOfNodes": 1}),
    ".bdf, free fields": Format(".bdf", near=1e-5, option={"BdfFieldFormat": 0}),
    ".bdf, short fields": Format(".bdf", near=1e-3, option={"BdfFieldFormat": 1}),
    ".bdf, long fields": Format(".bdf", option={"BdfFieldFormat": 2}),
    ".unv": Format(".unv"),
    ".med": Format(".med"),
    ".cgns": Format(".cgns"),
    ".vtk": Format(".vtk"),
    ".vtk binary": Format(".vtk", option={"Binary": 1}),
    ".mesh": Format(".mesh"),
    ".su2": Format(".su2", bodies=False),
    ".key": Format(".key"),
}


def write(solid: Solid, form: Format, path: Path) -> None:
    """The solid in a format."""
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.add("solid")
    marks = solid.marks()
    for name, tag in marks.items():
        gmsh.model.addDiscreteEntity(3 if name in solid.bodies else 2, tag)
    for body in solid.bodies:
        nodes = np.unique(np.concatenate([rows.ravel() for _, rows, name in solid.cells if name == body]))
        gmsh.model.mesh.addNodes(3, marks[body], nodes + 1, solid.points[nodes].ravel())
    for kind, rows, name in solid.rows("gmsh"):
        gmsh.model.mesh.addElementsByType(marks[name], _NUMBERS[kind], [], (rows + 1).ravel())
    for name, tag in marks.items():
        gmsh.model.addPhysicalGroup(3 if name in solid.bodies else 2, [tag], tag, name)
    for key, value in (form.option or {}).items():
        gmsh.option.setNumber(f"Mesh.{key}", value)
    gmsh.write(str(path))
    gmsh.finalize()
