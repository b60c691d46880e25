"""mapdl-archive: the archive of a grid, a type of elements for each body, components of nodes for the faces."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import mapdl_archive
import numpy as np
import pyvista

from .solid import VTK_NUMBERS, Format, Solid

TITLE: Final = "mapdl-archive"
REQUIRES: Final = ("mapdl-archive==0.4.2", "pyvista==0.49.1")
PACKAGE: Final = "mapdl-archive"
FORMATS: Final = {".cdb": Format(".cdb", option={}), ".cdb, plain": Format(".cdb", faces=False, option={"plain": 1})}


def write(solid: Solid, form: Format, path: Path) -> None:
    """The solid in a format."""
    pieces = solid.rows(flat=False)
    cells = np.concatenate([np.insert(rows, 0, rows.shape[1], axis=1).ravel() for _, rows, _ in pieces])
    types = np.concatenate([np.full(len(rows), VTK_NUMBERS[kind]) for kind, rows, _ in pieces])
    grid = pyvista.UnstructuredGrid(cells, types, solid.points)
    marks = np.concatenate([np.full(len(rows), solid.marks()[name]) for _, rows, name in pieces])
    grid.cell_data["ansys_material_type"] = marks
    if form.faces:
        for face in solid.faces:
            inside = np.zeros(len(solid.points), dtype=bool)
            inside[solid.nodes_of(face)] = True
            grid.point_data[face] = inside
    mapdl_archive.save_as_archive(path, grid, mtype_start=1, exclude_missing=True, reset_etype=False)
