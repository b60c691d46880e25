"""MFEM: linear meshes by attribute, of second order by its nodes."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import mfem.ser as mfem

from .solid import Format, Solid

TITLE: Final = "MFEM"
REQUIRES: Final = ("mfem==4.10.0.1", "numpy")
PACKAGE: Final = "mfem"
_LINEAR: Final = ("tetra", "hexahedron", "wedge", "pyramid", "triangle", "quad")
FORMATS: Final = {
    ".vtk": Format(".vtk", faces=False, near=1e-5),
    ".vtu": Format(".vtu", faces=False, near=1e-6),
    ".vtu, second order": Format(".vtu", faces=False, near=1e-6, option=2),
    ".mesh (MFEM)": Format(".mesh"),
}


def write(solid: Solid, form: Format, path: Path) -> None:
    """The solid in a format."""
    cells = sum(len(rows) for _, rows, _ in solid.cells)
    facets = sum(len(rows) for _, rows, _ in solid.facets)
    mesh = mfem.Mesh(3, len(solid.points), cells, facets)
    for place in solid.points.tolist():
        mesh.AddVertex(place)
    marks = solid.marks()
    if not {kind for kind, _, _ in solid.rows()} <= set(_LINEAR):
        raise ValueError("its nodes of second order are a function of its own")
    adders = {
        **{"tetra": mesh.AddTet, "hexahedron": mesh.AddHex, "wedge": mesh.AddWedge, "pyramid": mesh.AddPyramid},
        **{"triangle": mesh.AddBdrTriangle, "quad": mesh.AddBdrQuad},
    }
    for kind, rows, name in solid.rows():
        for row in rows.tolist():
            adders[kind](row, marks[name])
    mesh.FinalizeMesh(0, False)
    if form.option:
        mesh.SetCurvature(form.option)
    if form.suffix == ".mesh":
        mesh.Print(str(path))
    elif form.suffix == ".vtk":
        mesh.PrintVTK(str(path))
    else:
        mesh.PrintVTU(str(path.with_suffix("")), 1, form.option is not None)
