"""PyVista: grids, PartId at the cells, with its defaults."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
import pyvista

from .solid import VTK_NUMBERS, Format, Solid

TITLE: Final = "PyVista"
REQUIRES: Final = ("pyvista==0.49.1",)
PACKAGE: Final = "pyvista"
FORMATS: Final = {
    ".vtu": Format(".vtu", option={}),
    ".vtu, text": Format(".vtu", near=1e-9, option={"binary": False}),
    ".vtk": Format(".vtk", option={}),
    ".vtk, text": Format(".vtk", near=1e-5, option={"binary": False}),
    ".vtkhdf": Format(".vtkhdf", option={}),
}


def write(solid: Solid, form: Format, path: Path) -> None:
    """The solid in a format."""
    pieces = solid.rows()
    cells = np.concatenate([np.insert(rows, 0, rows.shape[1], axis=1).ravel() for _, rows, _ in pieces])
    types = np.concatenate([np.full(len(rows), VTK_NUMBERS[kind]) for kind, rows, _ in pieces])
    grid = pyvista.UnstructuredGrid(cells, types, solid.points)
    grid.cell_data["PartId"] = np.concatenate([np.full(len(rows), solid.marks()[name]) for _, rows, name in pieces])
    grid.save(path, **form.option)
