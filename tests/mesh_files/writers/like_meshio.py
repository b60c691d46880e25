"""What meshio and its fork meshlane have in common: formats, and how bodies and faces get into each of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from .solid import Format, Solid

# option: name of the format, and what names the bodies and faces: a key of cell data, or "sets", "gmsh", "med"
FORMATS: Final = {
    ".vtu": Format(".vtu", option=("vtu", "PartId")),
    ".vtk 5.1": Format(".vtk", option=("vtk", "PartId")),
    ".vtk 4.2": Format(".vtk", option=("vtk42", "PartId")),
    ".xdmf": Format(".xdmf", option=("xdmf", "PartId")),
    ".msh 4.1": Format(".msh", option=("gmsh", "entities")),
    ".msh 2.2": Format(".msh", option=("gmsh22", "gmsh")),
    ".med": Format(".med", option=("med", "med")),
    ".mesh": Format(".mesh", option=("medit", "medit:ref")),
    ".e": Format(".e", bodies=False, faces=False, option=("exodus", "points")),
    ".inp (Abaqus)": Format(".inp", option=("abaqus", "sets")),
    ".bdf": Format(".bdf", bodies=False, faces=False, near=1e-6, option=("nastran", "")),
    ".su2": Format(".su2", bodies=False, option=("su2", "su2:tag")),
    ".cgns": Format(".cgns", bodies=False, faces=False, option=("cgns", "")),
    ".vol": Format(".vol", option=("netgen", "netgen:index")),
    ".h5m": Format(".h5m", bodies=False, faces=False, option=("h5m", "")),
    ".mdpa": Format(".mdpa", bodies=False, faces=False, option=("mdpa", "")),
    ".f3grid": Format(".f3grid", faces=False, option=("flac3d", "sets")),
    ".ugrid": Format(".ugrid", bodies=False, option=("ugrid", "ugrid:ref")),
    ".avs": Format(".avs", option=("avsucd", "avsucd:material")),
    ".xml": Format(".xml", faces=False, option=("dolfin-xml", "PartId")),
    ".hmf": Format(".hmf", option=("hmf", "PartId")),
    ".post": Format(".post", bodies=False, faces=False, option=("permas", "")),
    ".tec": Format(".tec", faces=False, option=("tecplot", "PartId")),
    ".node": Format(".node", option=("tetgen", "")),
    ".msh of Fluent": Format(".msh", bodies=False, faces=False, option=("ansys", "")),
}
_ONE_BLOCK: Final = ("exodus", "med", "cgns", "tecplot", "dolfin-xml", "su2")


def write(library: Any, solid: Solid, form: Format, path: Path) -> None:
    """The solid by a module that has the interface of meshio."""
    name, how = form.option
    marks = solid.marks()
    pieces: list[Any] = []  # one of each type and name
    for kind, rows, part in solid.rows(flat=form.faces or how == "points"):
        same = [i for i, piece in enumerate(pieces) if (piece[0], piece[2]) == (kind, part)]
        if same:
            pieces[same[0]] = (kind, np.concatenate([pieces[same[0]][1], rows]), part)
        else:
            pieces.append((kind, rows, part))
    if name in _ONE_BLOCK:  # one block of each type
        kinds = dict.fromkeys(kind for kind, _, _ in pieces)
        blocks = [(kind, np.concatenate([r for k, r, _ in pieces if k == kind])) for kind in kinds]
        numbers = [np.concatenate([np.full(len(r), marks[n]) for k, r, n in pieces if k == kind]) for kind in kinds]
    else:
        blocks = [(kind, rows) for kind, rows, _ in pieces]
        numbers = [np.full(len(rows), marks[part]) for _, rows, part in pieces]
    keys: dict[str, Any] = {}
    if how == "sets":
        keys["cell_sets"] = {
            part: [np.flatnonzero(table == mark) for table in numbers]
            for part, mark in marks.items()
            if form.faces or part in solid.bodies
        }
    elif how == "points":
        keys["point_sets"] = {face: solid.nodes_of(face) for face in solid.faces}
    elif how == "gmsh":
        keys["cell_data"] = {"gmsh:physical": numbers, "gmsh:geometrical": numbers}
        keys["field_data"] = {part: np.array([m, 3 if part in solid.bodies else 2]) for part, m in marks.items()}
    elif how == "entities":
        keys["cell_sets"] = {part: [np.flatnonzero(table == mark) for table in numbers] for part, mark in marks.items()}
        keys["field_data"] = {part: np.array([m, 3 if part in solid.bodies else 2]) for part, m in marks.items()}
        keys["cell_data"] = {"gmsh:physical": numbers, "gmsh:geometrical": numbers}
        # of each node the entity that it is on, of those with the fewest dimensions
        entities = np.zeros((len(solid.points), 2), dtype=int)
        for _, rows, part in pieces:
            entities[rows.ravel()] = 3 if part in solid.bodies else 2, marks[part]
        keys["point_data"] = {"gmsh:dim_tags": entities}
    elif how == "med":
        keys["cell_data"] = {"cell_tags": [-table for table in numbers]}
    elif how:
        keys["cell_data"] = {how: numbers}
    mesh = library.Mesh(solid.points, blocks, **keys)
    if how == "med":
        mesh.cell_tags = {-mark: [part] for part, mark in marks.items()}
    library.write(path, mesh, name)
