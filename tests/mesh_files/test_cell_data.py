"""Which data of cells name parts: not those that number the cells, PartId before others, also as a float; VTK files."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

from latin_fmu.errors import MeshError
from latin_fmu.fem.faces import face
from latin_fmu.fem.mesh_file import mesh_of
from latin_fmu.mesh_files.cell_groups import groups_of_data
from latin_fmu.mesh_files.reading import read_content

from .decks import cube

with_vtk = pytest.mark.skipif(not find_spec("vtkmodules"), reason="needs vtk")
IDS, PARTS = np.arange(1, 9), np.repeat([1, 2], 4)


def names(data: dict[str, Any]) -> list[str]:
    return list(groups_of_data({key: [np.asarray(values)] for key, values in data.items()}, [8]))


@pytest.mark.parametrize("name", ["ElementId", "GlobalElementId", "vtkOriginalCellIds", "cell_id", "anything", "Ids"])
def test_numbers_of_cells_name_nothing(name: str) -> None:
    assert names({name: IDS}) == []
    assert names({name: IDS, "PartId": PARTS}) == ["PartId_1", "PartId_2"]
    assert names({name: IDS, "zone": PARTS}) == ["zone_1", "zone_2"]


def test_the_surest_of_known_names_counts() -> None:
    data = {"Material": np.repeat([5, 6, 7, 8], 2), "PartId": PARTS, "vtkGhostType": np.zeros(8, np.uint8)}
    assert names(data) == ["PartId_1", "PartId_2"]
    assert names({"Material": data["Material"]}) == [f"Material_{i}" for i in (5, 6, 7, 8)]
    # a part of one cell each, called so
    assert len(names({"PartId": IDS})) == 8


def test_a_float_names_parts_where_it_is_called_so() -> None:
    assert names({"PartId": PARTS.astype(float)}) == ["PartId_1", "PartId_2"]
    assert names({"quality": PARTS.astype(float)}) == []
    assert names({"PartId": PARTS + 0.5}) == []
    assert names({"PartId": np.where(PARTS == 1, np.nan, 1.0)}) == []


def test_unknown_data_that_do_not_agree_are_the_choice_of_the_user(tmp_path: Path) -> None:
    box = cube()
    data = {"a": [PARTS], "b": [np.tile([1, 2], 4)]}
    meshio.Mesh(box.nodes, [("hexahedron", box.blocks[0].cells)], cell_data=data).write(tmp_path / "cube.vtu")
    with pytest.raises(MeshError, match="the volume groups overlap"):
        read_content(tmp_path / "cube.vtu").part_names("cube.vtu")


def test_a_file_with_numbers_of_its_cells(tmp_path: Path) -> None:
    box = cube()
    data = {"ElementId": [IDS], "PartId": [PARTS.astype(float)]}
    meshio.Mesh(box.nodes, [("hexahedron", box.blocks[0].cells)], cell_data=data).write(tmp_path / "cube.vtu")
    assert read_content(tmp_path / "cube.vtu").part_names("cube.vtu") == ("PartId_1", "PartId_2")


def grid(kinds: list[tuple[int, np.ndarray]], nodes: np.ndarray, data: dict[str, np.ndarray]) -> Any:
    """An unstructured grid of VTK: number of the type and nodes of every cell, data of the cells."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import vtkPoints, vtkStringArray
    from vtkmodules.vtkCommonDataModel import vtkUnstructuredGrid

    points = vtkPoints()
    points.SetData(numpy_to_vtk(nodes, deep=True))
    result = vtkUnstructuredGrid()
    result.SetPoints(points)
    for number, cell in kinds:
        result.InsertNextCell(number, len(cell), cell.tolist())
    for name, values in data.items():
        array = numpy_to_vtk(values, deep=True)
        array.SetName(name)
        result.GetCellData().AddArray(array)
    title = vtkStringArray()
    title.SetName("Title")
    title.InsertNextValue("a text")
    result.GetFieldData().AddArray(title)
    return result


WRITERS = {
    "vtu": ("vtkIOXML", "vtkXMLUnstructuredGridWriter", ""),
    "vtu LZ4": ("vtkIOXML", "vtkXMLUnstructuredGridWriter", "SetCompressorTypeToLZ4"),
    "vtu text": ("vtkIOXML", "vtkXMLUnstructuredGridWriter", "SetDataModeToAscii"),
    "vtk": ("vtkIOLegacy", "vtkUnstructuredGridWriter", "SetFileTypeToBinary"),
    "vtkhdf": ("vtkIOHDF", "vtkHDFWriter", ""),
}


@with_vtk
@pytest.mark.parametrize("name", WRITERS)
def test_what_vtk_writes_is_read(tmp_path: Path, name: str) -> None:
    """Voxels and pixels beside hexahedra, an integer array and a float one, a text field."""
    from importlib import import_module

    box = cube()
    crossed = [0, 1, 3, 2, 4, 5, 7, 6]
    kinds = [(11, cell[crossed]) for cell in box.blocks[0].cells[:4]] + [(12, c) for c in box.blocks[0].cells[4:]]
    kinds += [(8, facet[[0, 1, 3, 2]]) for facet in box.faces["zmax"].blocks[0].facets]
    data = {"ElementId": np.arange(12), "PartId": np.concatenate([PARTS, [7, 7, 7, 7]]).astype(float)}
    module, writer, option = WRITERS[name]
    made = getattr(import_module(f"vtkmodules.{module}"), writer)()
    path = tmp_path / f"cube.{name.split()[0]}"
    made.SetFileName(str(path))
    made.SetInputData(grid(kinds, box.nodes, data))
    if option:
        getattr(made, option)()
    made.Write()
    content = read_content(path)
    assert content.part_names(path.name) == ("PartId_1", "PartId_2")
    assert face(mesh_of(content, path.name, "PartId_2"), "PartId_7").areas.sum() == pytest.approx(1.0, rel=1e-12)


@with_vtk
def test_structured_grids_and_polyhedra(tmp_path: Path) -> None:
    from vtkmodules.vtkCommonDataModel import vtkImageData
    from vtkmodules.vtkIOXML import vtkXMLImageDataWriter, vtkXMLUnstructuredGridWriter

    image = vtkImageData()
    image.SetDimensions(3, 4, 2)
    image.SetSpacing(1.0, 2.0, 3.0)
    writer = vtkXMLImageDataWriter()
    writer.SetFileName(str(tmp_path / "image.vti"))
    writer.SetInputData(image)
    writer.Write()
    mesh = mesh_of(read_content(tmp_path / "image.vti"), "image.vti")
    assert mesh.n_cell == 6
    np.testing.assert_array_equal(np.ptp(mesh.nodes, axis=0), [2.0, 6.0, 3.0])
    box = cube()
    odd = vtkXMLUnstructuredGridWriter()
    odd.SetFileName(str(tmp_path / "odd.vtu"))
    odd.SetInputData(grid([(72, np.arange(12))], box.nodes, {}))
    odd.Write()
    with pytest.raises(MeshError, match="number 72 of VTK with 12 nodes"):
        read_content(tmp_path / "odd.vtu")
    (tmp_path / "torn.vtu").write_bytes((tmp_path / "image.vti").read_bytes()[:200])
    with pytest.raises(MeshError, match="cannot be read: "):
        read_content(tmp_path / "torn.vtu")
