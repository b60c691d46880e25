"""VTK: unstructured grids, PartId at the cells."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import vtk
from vtk.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray

from .solid import VTK_NUMBERS, Format, Solid

TITLE: Final = "VTK"
REQUIRES: Final = ("vtk==9.7.2", "numpy")
PACKAGE: Final = "vtk"
LAGRANGE: Final = {
    **{"triangle": 69, "triangle6": 69, "quad": 70, "quad9": 70, "tetra": 71, "tetra10": 71, "hexahedron": 72},
    **{"hexahedron27": 72, "wedge": 73, "wedge18": 73, "pyramid": 74},
}
FORMATS: Final = {
    ".vtu, text": Format(".vtu", near=1e-9, option={"DataMode": 0}),
    ".vtu, binary": Format(".vtu", option={"DataMode": 1, "CompressorType": 0}),
    ".vtu, appended, zlib": Format(".vtu", option={"DataMode": 2, "CompressorType": 1}),
    ".vtu, LZ4": Format(".vtu", option={"DataMode": 2, "CompressorType": 2}),
    ".vtu, LZMA": Format(".vtu", option={"DataMode": 1, "CompressorType": 3}),
    ".vtu, big end first": Format(".vtu", option={"DataMode": 2, "ByteOrder": 0}),
    ".vtu, Lagrange cells": Format(".vtu", option={"DataMode": 2, "Lagrange": 1}),
    ".vtk 5.1, text": Format(".vtk", near=1e-5, option={"FileType": 1}),
    ".vtk 5.1, binary": Format(".vtk", option={"FileType": 2}),
    ".vtk 4.2, binary": Format(".vtk", option={"FileType": 2, "FileVersion": 42}),
    ".vtkhdf": Format(".vtkhdf", option={}),
}


def grid(solid: Solid, lagrange: bool = False) -> Any:
    """The solid as a grid."""
    made = vtk.vtkUnstructuredGrid()
    points = vtk.vtkPoints()
    points.SetData(numpy_to_vtk(solid.points, deep=1))
    made.SetPoints(points)
    types, offsets, nodes, marks = [], [0], [], []
    numbers = LAGRANGE if lagrange else VTK_NUMBERS
    for kind, rows, name in solid.rows():
        for row in rows:
            nodes += row.tolist()
            offsets.append(len(nodes))
            types.append(numbers[kind])
            marks.append(solid.marks()[name])
    cells = vtk.vtkCellArray()
    tables = (numpy_to_vtkIdTypeArray(np.array(t, dtype=np.int64), deep=1) for t in (offsets, nodes))
    cells.SetData(*tables)
    made.SetCells(numpy_to_vtk(np.array(types, dtype=np.uint8), deep=1), cells)
    data = numpy_to_vtk(np.array(marks, dtype=np.int32), deep=1)
    data.SetName("PartId")
    made.GetCellData().AddArray(data)
    return made


def write(solid: Solid, form: Format, path: Path) -> None:
    """The solid in a format."""
    names = {".vtu": "vtkXMLUnstructuredGridWriter", ".vtk": "vtkUnstructuredGridWriter", ".vtkhdf": "vtkHDFWriter"}
    writer = getattr(vtk, names[form.suffix])()
    writer.SetFileName(str(path))
    option = dict(form.option)
    made = grid(solid, bool(option.pop("Lagrange", 0)))
    for key, value in option.items():
        getattr(writer, f"Set{key}")(value)
    writer.SetInputData(made)
    if not writer.Write():
        raise OSError("the writer says that it failed")
