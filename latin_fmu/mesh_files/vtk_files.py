"""VTK files (.vtu, .vtk, .vtkhdf and the structured ones), read with the modules of VTK for files; nothing is drawn.

Where ``vtk`` is not installed the library of mesh formats reads .vtu and .vtk, which knows fewer of their kinds. Data
of the cells name the parts (``cell_groups``).
"""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any, Final

import numpy as np

from ..errors import MeshError, Problem
from .cell_groups import groups_of_data
from .content import CORNERS, FLAT, Index, MeshContent
from .library import missing_library, read_with_library
from .node_orders import n_node_of

_READERS: Final = {
    "vtu": ("vtkIOXML", "vtkXMLUnstructuredGridReader"),
    "vts": ("vtkIOXML", "vtkXMLStructuredGridReader"),
    "vtr": ("vtkIOXML", "vtkXMLRectilinearGridReader"),
    "vti": ("vtkIOXML", "vtkXMLImageDataReader"),
    "vtk": ("vtkIOLegacy", "vtkGenericDataObjectReader"),
    "vtkhdf": ("vtkIOHDF", "vtkHDFReader"),
}
_TYPES: Final = {
    1: "vertex",
    2: "vertex",
    3: "line",
    4: "line",
    5: "triangle",
    8: "quad",  # pixel
    9: "quad",
    10: "tetra",
    11: "hexahedron",  # voxel
    12: "hexahedron",
    13: "wedge",
    14: "pyramid",
    21: "line3",
    22: "triangle6",
    23: "quad8",
    24: "tetra10",
    25: "hexahedron20",
    26: "wedge15",
    27: "pyramid13",
    28: "quad9",
    29: "hexahedron27",
    32: "wedge18",
    33: "hexahedron24",
    34: "triangle7",
}
"""Types of cells by number (vtkCellType.h)."""

_LAGRANGE: Final = {
    (69, 3): "triangle",
    (69, 6): "triangle6",
    (70, 4): "quad",
    (70, 9): "quad9",
    (71, 4): "tetra",
    (71, 10): "tetra10",
    (72, 8): "hexahedron",
    (72, 27): "hexahedron27",
    (73, 6): "wedge",
    (73, 18): "wedge18",
    (74, 5): "pyramid",
    (74, 14): "pyramid14",
}
"""Lagrange cells of first and second order: number and count of nodes."""

_CROSSED: Final = {8: [0, 1, 3, 2], 11: [0, 1, 3, 2, 4, 5, 7, 6]}  # pixels and voxels count row by row
_NO_CELLS: Final = ("vertex", "line", "line3")
_GHOST: Final = "vtkGhostType"
_DUPLICATE: Final = 1  # bit of a cell that another piece has


def read_vtk(path: Path) -> MeshContent:
    """The mesh of a file.

    Raises
    ------
    MeshError : the messages of VTK, cells that are not known, or that ``vtk`` is needed.
    """
    try:
        core = importlib.import_module("vtkmodules.vtkCommonCore")
    except ModuleNotFoundError:
        return _without_vtk(path)
    core.vtkLogger.SetStderrVerbosity(core.vtkLogger.VERBOSITY_OFF)  # errors are in the window below, too
    window = core.vtkStringOutputWindow()
    core.vtkOutputWindow.SetInstance(window)
    grid = _grid(path)
    if said := " ".join(window.GetOutput().split()):
        what = f"cannot be read: {said.partition('): ')[2][:300] or said[:300]}"
        raise MeshError.of("unreadable mesh", path.name, what, remedy="write the file again")
    return _content(path, grid)


def _without_vtk(path: Path) -> MeshContent:
    remedy = "pip install vtk, which reads all files of VTK"
    if path.suffix.lower()[1:] not in ("vtu", "vtk"):
        raise missing_library(path, "vtk", remedy)
    try:
        return read_with_library(path)
    except MeshError as error:
        problems = [Problem(p.where, p.what, p.value, p.allowed, f"{remedy}; {p.remedy}") for p in error.problems]
        raise MeshError(problems, error.heading) from None


def _grid(path: Path) -> Any:
    """The unstructured grid of a file; a structured one as such."""
    module, name = _READERS[path.suffix.lower()[1:]]
    reader = getattr(importlib.import_module(f"vtkmodules.{module}"), name)()
    reader.SetFileName(str(path))
    reader.Update()
    grid = reader.GetOutputDataObject(0)
    if grid is None or not grid.IsA("vtkDataSet"):
        if grid is None:
            kind = "no data"
        else:
            kind = grid.GetClassName()
        what, allowed = "a mesh is one grid of cells", "one unstructured or structured grid"
        raise MeshError.of("unreadable mesh", path.name, what, kind, allowed, "save each block as a file")
    if grid.IsA("vtkUnstructuredGrid"):
        return grid
    append = importlib.import_module("vtkmodules.vtkFiltersCore").vtkAppendFilter()
    append.AddInputData(grid)
    append.Update()
    return append.GetOutput()


def _content(path: Path, grid: Any) -> MeshContent:
    to_numpy = importlib.import_module("vtkmodules.util.numpy_support").vtk_to_numpy
    if not grid.GetNumberOfPoints() or not grid.GetNumberOfCells():
        raise MeshError.of("unreadable mesh", path.name, "the file holds no cells")
    content = MeshContent(np.ascontiguousarray(to_numpy(grid.GetPoints().GetData()), dtype=float))
    cells = grid.GetCells()
    offsets = np.asarray(to_numpy(cells.GetOffsetsArray()), dtype=np.int64)
    nodes = np.asarray(to_numpy(cells.GetConnectivityArray()), dtype=np.int64)
    numbers = np.array([grid.GetCellType(i) for i in range(grid.GetNumberOfCells())], dtype=np.int64)
    arrays = _cell_data(grid.GetCellData(), to_numpy)
    if len(offsets) != len(numbers) + 1 or (len(offsets) and offsets[-1] > len(nodes)):
        raise MeshError.of("unreadable mesh", path.name, "cells and their nodes do not fit each other")
    keep = np.ones(len(numbers), dtype=bool)
    if _GHOST in arrays:
        keep = (arrays[_GHOST].astype(np.int64) & _DUPLICATE) == 0
    blocks: list[tuple[str, Index, Index]] = []
    keys = np.stack([numbers, np.diff(offsets)], axis=1)
    for number, width in np.unique(keys[keep], axis=0).tolist():
        rows = np.flatnonzero(keep & (keys == (number, width)).all(axis=1))
        table = nodes[offsets[rows][:, None] + np.arange(width)]
        kind = _TYPES.get(number) or _LAGRANGE.get((number, width))
        if kind is None or (kind not in _NO_CELLS and width != n_node_of(kind)):
            what = f"cells of a type that is not read: number {number} of VTK with {width} nodes"
            remedy = "write cells of first or second order"
            raise MeshError.of("unreadable mesh", path.name, what, f"{len(rows)} cells", ", ".join(CORNERS), remedy)
        if number in _CROSSED:
            table = table[:, _CROSSED[number]]
        blocks.append((kind, table, rows))
    _add_blocks(content, blocks, arrays)
    return content


def _cell_data(data: Any, to_numpy: Any) -> dict[str, Any]:
    """Arrays with one number at each cell."""
    arrays: dict[str, Any] = {}
    for i in range(data.GetNumberOfArrays()):
        array = data.GetArray(i)  # None: an array of texts
        if array is not None and array.GetNumberOfComponents() == 1:
            arrays[str(array.GetName())] = np.asarray(to_numpy(array))
    return arrays


def _add_blocks(content: MeshContent, blocks: list[tuple[str, Index, Index]], arrays: dict[str, Any]) -> None:
    """Cells and their groups; a block has its type, its nodes, and its rows in the arrays."""
    solids: list[Index] = []
    for kind, table, _ in blocks:
        solids.append(content.add_cells(kind, table))
        if kind not in CORNERS and kind not in FLAT and kind not in _NO_CELLS:
            content.skipped[kind] = content.skipped.get(kind, 0) + len(table)
    data = {name: [values[rows] for _, _, rows in blocks] for name, values in arrays.items()}
    for name, chosen in groups_of_data(data, [len(rows) for _, _, rows in blocks]).items():
        for (kind, table, _), solid, select in zip(blocks, solids, chosen, strict=True):
            if kind in CORNERS and len(select):
                content.add_volume(name, kind, solid[select])
            elif kind in FLAT and len(select):
                content.add_facets(name, kind, table[select])
