"""Netgen: the elements of the solids, and meshes of its own geometry."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import netgen.meshing as ng

from .solid import Format, Solid

TITLE: Final = "Netgen"
REQUIRES: Final = ("netgen-mesher==6.2.2608",)
PACKAGE: Final = "netgen-mesher"
FORMATS: Final = {
    ".vol": Format(".vol"),
    ".vol.gz": Format(".vol.gz"),
    ".inp (Abaqus Format)": Format(".inp", near=1e-5, option="Abaqus Format"),
    ".msh (Gmsh2 Format)": Format(".msh", near=1e-5, option="Gmsh2 Format"),
    ".msh (Gmsh Format)": Format(".msh", near=1e-5, option="Gmsh Format"),
    ".mesh (Neutral Format)": Format(".mesh", near=1e-5, option="Neutral Format"),
    ".cgns": Format(".cgns", option="CGNS Format"),
}


def write(solid: Solid, form: Format, path: Path) -> None:
    """The solid in a format."""
    mesh = ng.Mesh()
    nodes = [mesh.Add(ng.MeshPoint(ng.Pnt(*place))) for place in solid.points.tolist()]
    marks = solid.marks()
    for body in solid.bodies:
        mesh.SetMaterial(marks[body], body)
    faces = {}
    for i, face in enumerate(solid.faces, 1):
        faces[face] = mesh.Add(ng.FaceDescriptor(surfnr=i, domin=1, domout=0, bc=i))
        mesh.SetBCName(i - 1, face)
    for kind, rows, name in solid.cells:
        columns = [0, 1, 2, 3, 4, 6, 7, 5, 8, 9] if kind == "tetra10" else list(range(rows.shape[1]))
        for row in rows[:, columns].tolist():
            mesh.Add(ng.Element3D(marks[name], [nodes[i] for i in row]))
    for kind, rows, name in solid.facets:
        columns = [0, 1, 2, 4, 5, 3] if kind == "triangle6" else list(range(rows.shape[1]))
        for row in rows[:, columns].tolist():
            mesh.Add(ng.Element2D(faces[name], [nodes[i] for i in row]))
    if form.option is None:
        mesh.Save(str(path))
    else:
        mesh.Export(str(path), form.option)
