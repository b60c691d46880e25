"""Readers of the package for text formats and HDF5: parts, faces, middle nodes, what is refused and why."""

from __future__ import annotations

import gzip
import importlib
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import netCDF4
import numpy as np
import pytest

from latin_fmu.errors import MeshError
from latin_fmu.fem.elements import Elements
from latin_fmu.fem.faces import face
from latin_fmu.fem.mesh_file import mesh_of
from latin_fmu.fem.reference_cells import CELL_EDGES, cell_functions
from latin_fmu.mesh_files import ansys, child
from latin_fmu.mesh_files.child import NO_LIMIT
from latin_fmu.mesh_files.content import MeshContent
from latin_fmu.mesh_files.gmsh import write_gmsh
from latin_fmu.mesh_files.node_orders import in_another_order
from latin_fmu.mesh_files.reading import included_files, read_content
from tests.fem.meshes import skewed, typed_box

from .decks import cube, node_rows, read_mesh
from .test_formats import exodus
from .test_middle_nodes import CORNERS, TOP_BEFORE_VERTICAL, assert_in_place, nodes_in

BOX = cube()
CELLS = BOX.blocks[0].cells
TOP = BOX.faces["zmax"].blocks[0].facets


def refused(path: Path, *words: str) -> None:
    with pytest.raises(MeshError) as caught:
        read_content(path)
    for word in words:
        assert word in str(caught.value)


# -- universal files ---------------------------------------------------------------------------------------------------
ROUND = {  # edges and corners as a file counts them: below, between, above (universal dataset 2412)
    "tetra10": ["1", "12", "2", "23", "3", "31", "14", "24", "34", "4"],
    "wedge15": ["1", "12", "2", "23", "3", "31", "14", "25", "36", "4", "45", "5", "56", "6", "64"],
    "hexahedron20": [
        *["1", "12", "2", "23", "3", "34", "4", "41", "15", "26", "37", "48"],
        *["5", "56", "6", "67", "7", "78", "8", "85"],
    ],
}
CODES = {"tetra10": 118, "wedge15": 113, "hexahedron20": 116, "hexahedron": 115, "quad": 94}


def dataset(number: int, *lines: str) -> str:
    return "\n".join(["    -1", f"{number:6d}", *lines, "    -1", ""])


def unv_nodes(nodes: np.ndarray, number: int = 2411) -> str:
    rows = [
        f"{i:10d}         1         1        11\n{x:25.16E}{y:25.16E}{z:25.16E}" for i, (x, y, z) in enumerate(nodes, 1)
    ]
    return dataset(number, *rows).replace("E+", "D+").replace("E-", "D-")


def unv_elements(rows: list[tuple[int, str, int, list[int]]]) -> str:
    lines = []
    for label, kind, owner, nodes in rows:
        lines.append(f"{label:10d}{CODES[kind]:10d}{owner:10d}         1         7{len(nodes):10d}")
        lines += ["".join(f"{n:10d}" for n in nodes[i : i + 8]) for i in range(0, len(nodes), 8)]
    return dataset(2412, *lines)


@pytest.mark.parametrize("kind", CORNERS)
def test_middle_nodes_of_universal_files(tmp_path: Path, kind: str) -> None:
    corners = np.array(CORNERS[kind], dtype=float)
    nodes = np.array([corners[[int(n) - 1 for n in place]].mean(axis=0) for place in ROUND[kind]])
    text = unv_nodes(nodes) + unv_elements([(1, kind, 1, list(range(1, len(nodes) + 1)))])
    (tmp_path / "cell.unv").write_text(text)
    assert_in_place(read_content(tmp_path / "cell.unv"), kind)


def unv_cube(groups: str = "", owners: tuple[int, int] = (3, 3)) -> str:
    rows = [(i, "hexahedron", owners[i > 4], (c + 1).tolist()) for i, c in enumerate(CELLS, 1)]
    rows += [(20 + i, "quad", 9, (f + 1).tolist()) for i, f in enumerate(TOP)]
    return unv_nodes(BOX.nodes) + unv_elements(rows) + groups


def unv_group(number: int, name: str, members: list[tuple[int, int]]) -> str:
    head = "".join(f"{n:10d}" for n in (number, 0, 0, 0, 0, 0, 0, len(members)))
    fields = [f"{kind:10d}{label:10d}         0         0" for kind, label in members]
    return dataset(2467, head, name, *("".join(fields[i : i + 2]) for i in range(0, len(fields), 2)))


def test_groups_and_units_of_universal_files(tmp_path: Path) -> None:
    groups = dataset(164, "         5mm (milli-newton)         2", "  1.0D+03  1.0D+00  1.0D+00", "  2.7D+02")
    groups += unv_group(1, "low", [(8, i) for i in (1, 2, 3, 4)]) + unv_group(2, "up", [(8, i) for i in (5, 6, 7, 8)])
    groups += unv_group(3, "roof", [(8, 20 + i) for i in range(4)])
    groups += unv_group(4, "feet", [(7, i) for i in range(1, 10)])
    (tmp_path / "cube.unv").write_text(unv_cube(groups))
    content = read_content(tmp_path / "cube.unv")
    assert content.unit == "mm"
    assert content.part_names("cube.unv") == ("low", "up")
    assert face(mesh_of(content, "cube.unv", "up"), "roof").areas.sum() == pytest.approx(1.0, rel=1e-12)
    assert face(mesh_of(content, "cube.unv", "low"), "feet").areas.sum() == pytest.approx(1.0, rel=1e-12)
    (tmp_path / "cube.unv").write_text(unv_cube(owners=(3, 4)))
    assert read_content(tmp_path / "cube.unv").part_names("cube.unv") == ("property_3", "property_4")


def test_what_universal_files_may_not_have(tmp_path: Path) -> None:
    path = tmp_path / "cube.unv"
    turned = dataset(2420, "         1", "Part1", "         1         1         8", "CS1", *["  0. 1. 0."] * 4)
    path.write_text(turned + unv_cube())
    refused(path, "coordinate system of their own", "system 1")
    path.write_text(
        unv_nodes(BOX.nodes) + dataset(2412, "         1       117         1         1         7         2", "1 2")
    )
    refused(path, "line", "a solid element that is not read", "type 117")
    path.write_text(unv_cube() + unv_nodes(BOX.nodes[:2]))
    refused(path, "two nodes with one label")
    path.write_text(dataset(58, "measured"))
    refused(path, "the file has no nodes", "dataset 2411")


# -- LS-DYNA -----------------------------------------------------------------------------------------------------------
def dyna_nodes(nodes: np.ndarray, commas: bool = False) -> str:
    if commas:
        return "*NODE\n" + node_rows(nodes)
    return "*NODE\n" + "".join(f"{i:8d}{x:16.9f}{y:16.9f}{z:16.9f}\n" for i, (x, y, z) in enumerate(nodes, 1))


def dyna_solids(rows: list[tuple[int, int, list[int]]], one_line: bool = True) -> str:
    text = "*ELEMENT_SOLID\n"
    for label, part, nodes in rows:
        text += f"{label:8d}{part:8d}" + ("" if one_line else "\n") + "".join(f"{n:8d}" for n in nodes) + "\n"
    return text


def dyna_cube(commas: bool = False, one_line: bool = True) -> str:
    rows = [(i, 1 + (i > 4), (c + 1).tolist()) for i, c in enumerate(CELLS, 1)]
    text = "$ a comment\n*KEYWORD\n*TITLE\na cube\n" + dyna_nodes(BOX.nodes, commas)
    text += dyna_solids(rows, one_line)
    text += "*PART\nlower half\n         1         1         1\nupper half\n         2         1         1\n"
    text += "*SET_NODE_LIST_TITLE\nfeet\n         7\n" + "".join(f"{i:10d}" for i in range(1, 9)) + "\n         9\n"
    text += "*SET_SEGMENT\n         4\n" + "".join("".join(f"{n + 1:10d}" for n in f) + "\n" for f in TOP.tolist())
    text += "*ELEMENT_BEAM\n       1       9       1       2       3\n*END\nnothing is read here\n"
    return text


@pytest.mark.parametrize("commas", [False, True])
@pytest.mark.parametrize("one_line", [False, True])
def test_parts_and_sets_of_lsdyna(tmp_path: Path, commas: bool, one_line: bool) -> None:
    path = tmp_path / "cube.k"
    path.write_text(dyna_cube(commas, one_line))
    content = read_content(path)
    assert content.part_names("cube.k") == ("lower half", "upper half")
    assert content.skipped == {"*ELEMENT_BEAM": 1}
    upper, lower = (mesh_of(content, "cube.k", name) for name in ("upper half", "lower half"))
    assert Elements(upper).volume.sum() == pytest.approx(0.5, rel=1e-9)
    assert face(upper, "segment_set_4").areas.sum() == pytest.approx(1.0, rel=1e-9)
    assert face(lower, "feet").areas.sum() == pytest.approx(1.0, rel=1e-9)


def test_bricks_with_equal_nodes_in_lsdyna(tmp_path: Path) -> None:
    """A wedge, a pyramid and a tetrahedron in the forms of the manual; ten nodes."""
    wedge = np.array([[0, 0, 0], [1, 0, 0], [1, 2, 0], [0, 2, 0], [0, 0, 1], [0, 2, 1]], float)
    forms = {
        "wedge": (wedge, [1, 2, 3, 4, 5, 5, 6, 6], 1.0),
        "pyramid": (wedge[:5], [1, 2, 3, 4, 5, 5, 5, 5], 2.0 / 3.0),
        "tetra": (wedge[[0, 1, 2, 4]], [1, 2, 3, 4, 4, 4, 4, 4], 1.0 / 3.0),
        "tetra10": (nodes_in("tetra10", {"tetra10": ["12", "23", "31", "14", "24", "34"]}), [*range(1, 11)], 1.0 / 6.0),
    }
    for kind, (nodes, cell, volume) in forms.items():
        path = tmp_path / f"{kind}.key"
        path.write_text("*KEYWORD\n" + dyna_nodes(nodes) + dyna_solids([(1, 1, cell)], one_line=len(cell) == 8))
        content = read_content(path)
        assert list(content.solids) == [kind]
        assert Elements(mesh_of(content, kind)).volume.sum() == pytest.approx(volume, rel=1e-9), kind


def test_a_part_without_a_title_in_lsdyna(tmp_path: Path) -> None:
    (tmp_path / "cube.k").write_text(dyna_cube().replace("lower half\n", " \n"))
    assert read_content(tmp_path / "cube.k").part_names("cube.k") == ("part_1", "upper half")


def test_an_included_file_of_lsdyna(tmp_path: Path) -> None:
    head, _, rest = dyna_cube().partition("*ELEMENT_SOLID")
    (tmp_path / "mesh.k").write_text(f"*ELEMENT_SOLID{rest}")
    (tmp_path / "main.k").write_text(head + "*INCLUDE\nmesh.k\n*END\n")
    assert len(read_content(tmp_path / "main.k").solids["hexahedron"]) == 8
    assert included_files(tmp_path / "main.k") == ["mesh.k"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("*PART", "*INCLUDE_TRANSFORM\nx.k\n*PART"), ["changes the mesh", "*INCLUDE_TRANSFORM", "line"]),
        (("*ELEMENT_BEAM", "*ELEMENT_SOLID_H20"), ["solid elements that are not read", "*ELEMENT_SOLID_H20"]),
        (("*ELEMENT_BEAM", "*ELEMENT_TSHELL"), ["solid elements that are not read"]),
        (("       8       2", "       7       2"), ["two elements with one label"]),
        (("$ a comment", "*NODE\n       5      0.0\n"), ["two nodes with one label"]),
    ],
)
def test_what_lsdyna_may_not_have(tmp_path: Path, change: tuple[str, str], words: list[str]) -> None:
    path = tmp_path / "cube.k"
    path.write_text(dyna_cube().replace(*change))
    refused(path, *words)


# -- Ansys -------------------------------------------------------------------------------------------------------------
def archive(rows: list[list[int]], **components: Any) -> Any:
    """What mapdl-archive gives of a file: the numbers of elements as in an EBLOCK."""
    return SimpleNamespace(
        elem=rows,
        ekey=np.array([[1, 186], [2, 185], [3, 187], [4, 154]]),
        element_components=components.get("of_elements", {}),
        node_components=components.get("of_nodes", {}),
    )


def element(owner: int, label: int, nodes: list[int]) -> list[int]:
    return [1, owner, 1, 1, 0, 0, 0, 0, label, 0, *nodes]


def content_of(rows: list[list[int]], nodes: np.ndarray, **components: Any) -> MeshContent:
    labels = np.arange(1, len(nodes) + 1)
    return ansys._Archive(Path("x.cdb"), archive(rows, **components), labels, nodes).content()


def test_parts_and_components_of_ansys() -> None:
    rows = [element(2, i, (c + 1).tolist()) for i, c in enumerate(CELLS, 1)]
    rows += [element(4, 20 + i, (f + 1).tolist()) for i, f in enumerate(TOP)]
    sets = {"of_elements": {"LOW": [1, 2, 3, 4], "UP": [5, 6, 7, 8]}, "of_nodes": {"FEET": np.arange(1, 10)}}
    content = content_of(rows, BOX.nodes, **sets)
    assert content.part_names("x.cdb") == ("LOW", "UP")
    assert face(mesh_of(content, "x.cdb", "UP"), "type_4").areas.sum() == pytest.approx(1.0, rel=1e-12)
    assert face(mesh_of(content, "x.cdb", "LOW"), "FEET").areas.sum() == pytest.approx(1.0, rel=1e-12)


def test_a_type_with_two_materials_is_two_bodies_in_ansys() -> None:
    """As mapdl-archive 0.4.2 writes a grid whose bodies are their materials; components of elements come first."""
    rows = [[1 + i // 4, *element(2, i + 1, (c + 1).tolist())[1:]] for i, c in enumerate(CELLS)]
    content = content_of(rows, BOX.nodes)
    assert content.part_names("x.cdb") == ("type_2_material_1", "type_2_material_2")
    sets = {"of_elements": {"EVEN": [2, 4, 6, 8], "ODD": [1, 3, 5, 7]}}
    assert content_of(rows, BOX.nodes, **sets).part_names("x.cdb") == ("EVEN", "ODD")


BRICK = np.array(CORNERS["hexahedron20"], float)
COLUMNS = {  # corners of a brick by the form of its cell (Ansys Element Reference, SOLID186)
    "hexahedron20": [0, 1, 2, 3, 4, 5, 6, 7],
    "wedge15": [0, 1, 2, 2, 4, 5, 6, 6],
    "pyramid13": [0, 1, 2, 3, 4, 4, 4, 4],
    "tetra10": [0, 1, 2, 2, 4, 4, 4, 4],
}
EDGES = ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))


@pytest.mark.parametrize("kind", COLUMNS)
@pytest.mark.parametrize("missing", [False, True])
def test_bricks_with_equal_nodes_in_ansys(kind: str, missing: bool) -> None:
    """Middle nodes follow their edges; one that is 0 becomes one in the middle."""
    corners = COLUMNS[kind]
    nodes, cell = [*BRICK], [c + 1 for c in corners]
    for a, b in EDGES:
        ends = corners[a], corners[b]
        if ends[0] == ends[1]:
            cell.append(ends[0] + 1)
            continue
        nodes.append(0.5 * (BRICK[ends[0]] + BRICK[ends[1]]))
        cell.append(len(nodes))
    if missing:
        cell[8] = 0
    content = content_of([element(1, 1, cell)], np.array(nodes))
    assert list(content.solids) == [kind]
    points, row = content.points, content.solids[kind][0]
    for i, (a, b) in enumerate(CELL_EDGES[kind.rstrip("0123456789")]):
        middle = points[row[len(set(corners)) + i]]
        np.testing.assert_allclose(middle, 0.5 * (points[row[a]] + points[row[b]]), atol=1e-15)


@pytest.mark.parametrize("form", ["(3i9,6e21.13e3)", "(1i9,3e20.9e3)", "(3i8,6e16.9)"])
def test_nodes_of_ansys_in_every_form(tmp_path: Path, form: str) -> None:
    """A block has one or three whole numbers in a row; zeros at its end are left out."""
    count, width, size = {"(3": (3, 9, 21), "(1": (1, 9, 20)}.get(form[:2], (3, 8, 16)) if "i9" in form else (3, 8, 16)
    rows = ["/PREP7", "NBLOCK,6,SOLID", form]
    for label, place in enumerate(BOX.nodes.tolist(), 1):
        wholes = f"{label:{width}d}" + f"{0:{width}d}" * (count - 1)
        rows.append(wholes + "".join(f"{x:{size}.9E}" for x in place))
    rows += [
        f"{99:{width}d}" + f"{0:{width}d}" * (count - 1) + f"{1.5:{size}.9E}",
        "N,R5.3,LOC,       -1,",
        "EBLOCK,19,SOLID",
    ]
    (tmp_path / "x.cdb").write_text("\n".join(rows))
    labels, points = ansys._nodes(tmp_path / "x.cdb")
    np.testing.assert_array_equal(labels, [*range(1, 28), 99])
    np.testing.assert_allclose(points, [*BOX.nodes, [1.5, 0.0, 0.0]], rtol=1e-9)


def test_what_ansys_may_not_have() -> None:
    for nodes, what in (([1, 2, 3, 4, 5, 5, 6, 7], "equal nodes"), ([1, 2, 3, 4, 5, 6, 7, 99], "not there")):
        with pytest.raises(MeshError, match=what):
            content_of([element(2, 1, nodes)], BOX.nodes)
    content = content_of([element(9, 1, [1, 2]), element(2, 2, (CELLS[0] + 1).tolist())], BOX.nodes)
    assert content.skipped == {"element type 0": 1}


@pytest.mark.skipif(not find_spec("mapdl_archive"), reason="needs mapdl-archive")
@pytest.mark.parametrize(
    ("name", "kinds", "volume"), [("HexBeam", {"hexahedron20": 40}, 5.0), ("TetBeam", {"tetra": 3913}, 10.0)]
)
def test_archives_that_ansys_wrote(name: str, kinds: Mapping[str, int], volume: float) -> None:
    """Beams of 1 x 1 x 5 and of 1 x 1 x 10: examples of the library."""
    folder = Path(str(importlib.import_module("mapdl_archive").__file__)).parent / "examples"
    content = read_content(folder / f"{name}.cdb")
    assert {kind: len(cells) for kind, cells in content.solids.items()} == kinds
    assert Elements(mesh_of(content, name)).volume.sum() == pytest.approx(volume, rel=1e-12)


# -- Netgen ------------------------------------------------------------------------------------------------------------
def netgen(second: bool) -> str:
    """Two tetrahedra of different materials; middle nodes in the order of Netgen: 12, 13, 14, 23, 24, 34."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]], float)
    cells, rows = [[1, 2, 3, 4], [2, 3, 4, 5]], list(points)
    if second:
        for cell in cells:
            for a, b in ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)):
                rows.append(0.5 * (points[cell[a] - 1] + points[cell[b] - 1]))
                cell.append(len(rows))
    lines = ["# Generated by NETGEN v6.2.2608", "", "mesh3d", "dimension", "3", "geomtype", "11", ""]
    lines += ["surfaceelementsuv", "1", " 2 2 1 0 3 1 3 2 0 0 0 0 0 0", "", "volumeelements", "2"]
    lines += [f"{i} {len(c)} {' '.join(map(str, c))}" for i, c in enumerate(cells, 1)]
    lines += ["", "points", str(len(rows)), *(" ".join(f"{x:.16f}" for x in row) for row in rows)]
    lines += [
        "",
        "materials",
        "2",
        "1 steel",
        "2 hard steel",
        "",
        "bcnames",
        "2",
        "1\tdefault",
        "2\tfoot",
        "",
        "endmesh",
    ]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("second", [False, True])
@pytest.mark.parametrize("packed", [False, True])
def test_netgen(tmp_path: Path, second: bool, packed: bool) -> None:
    path = tmp_path / ("two.vol.gz" if packed else "two.vol")
    path.write_bytes(gzip.compress(netgen(second).encode()) if packed else netgen(second).encode())
    content = read_content(path)
    assert content.part_names("two.vol") == ("steel", "hard steel")
    mesh = mesh_of(content, "two.vol", "steel")
    assert mesh.cell_types == ("tetra10" if second else "tetra",)
    assert Elements(mesh).volume.sum() == pytest.approx(1.0 / 6.0, rel=1e-12)
    assert face(mesh, "foot").areas.sum() == pytest.approx(0.5, rel=1e-12)


def test_second_order_of_netgen_that_is_not_read(tmp_path: Path) -> None:
    (tmp_path / "x.vol").write_text(netgen(False).replace("1 4 1 2 3 4", "1 15 " + "1 " * 15))
    refused(tmp_path / "x.vol", "a volume element that is not read", "15 nodes")


# -- XDMF --------------------------------------------------------------------------------------------------------------
MIXED = """<Xdmf Version="3.0"><Domain><Grid Name="Grid">
<Geometry GeometryType="XYZ"><DataItem DataType="Float" Dimensions="{n} 3" Format="XML" Precision="8">{nodes}</DataItem>
</Geometry><Topology TopologyType="Mixed" NumberOfElements="2"><DataItem DataType="Int" Dimensions="{m}" Format="XML"
 Precision="8">{cells}</DataItem></Topology>
<Attribute Name="PartId" AttributeType="Scalar" Center="Cell"><DataItem DataType="Int" Dimensions="2" Format="XML"
 Precision="8">4 5</DataItem></Attribute></Grid></Domain></Xdmf>"""


def test_mixed_cells_of_second_order_in_xdmf(tmp_path: Path) -> None:
    order = {"tetra10": ["12", "23", "31", "14", "24", "34"]}
    brick = ["12", "23", "34", "41", "56", "67", "78", "85", "15", "26", "37", "48"]
    nodes = np.concatenate([nodes_in("tetra10", order) + 5.0, nodes_in("hexahedron20", {"hexahedron20": brick})])
    cells = [38, *range(10), 48, *range(10, 30)]
    path = tmp_path / "two.xdmf"
    text = MIXED.format(n=30, nodes=" ".join(map(repr, nodes.ravel().tolist())), m=32, cells=" ".join(map(str, cells)))
    path.write_text(text)
    content = read_content(path)
    assert content.part_names("two.xdmf") == ("PartId_4", "PartId_5")
    assert_in_place(content, "tetra10")
    assert_in_place(content, "hexahedron20")
    path.write_text(text.replace(">38 ", ">77 "))
    refused(path, "cells of a type that is not read", "number 77")


# -- CGNS --------------------------------------------------------------------------------------------------------------
def test_cgns_in_the_elder_form_is_named(tmp_path: Path) -> None:
    pytest.importorskip("h5py")
    (tmp_path / "cube.cgns").write_bytes(b"@(#)ADF Database Version A02011>" + bytes(100))
    refused(tmp_path / "cube.cgns", "in ADF", "adf2hdf")


# -- Exodus ------------------------------------------------------------------------------------------------------------
def test_suffixes_of_cubit(tmp_path: Path) -> None:
    for suffix in ("g", "gen"):
        assert len(read_content(exodus(tmp_path / f"cube.{suffix}")).solids["hexahedron"]) == 8


def test_a_plane_file_of_exodus_says_so(tmp_path: Path) -> None:
    path = tmp_path / "plane.e"
    with netCDF4.Dataset(path, "w") as data:
        for name, size in {"num_nodes": 4, "num_el_blk": 1, "one": 1, "four": 4}.items():
            data.createDimension(name, size)
        for axis, values in (("x", [0, 1, 1, 0]), ("y", [0, 0, 1, 1])):
            data.createVariable(f"coord{axis}", "f8", ("num_nodes",))[:] = values
        block = data.createVariable("connect1", "i4", ("one", "four"))
        block.elem_type = "QUAD4"
        block[:] = [[1, 2, 3, 4]]
    content = read_content(path)
    assert content.without_solids() == "a plane mesh; 1 surface cells in named groups"


@pytest.mark.parametrize(
    ("kind", "straight", "name", "order"),
    [
        # the centre before those of the faces below, above, left, right, in front, behind
        (
            *("hexahedron27", "hexahedron20", "HEX27"),
            "12 23 34 41 15 26 37 48 56 67 78 85 12345678 1234 5678 1485 2376 1265 3487",
        ),
        # the middles of sides 1 to 3
        ("wedge18", "wedge15", "WEDGE18", "12 23 31 14 25 36 45 56 64 1254 2365 1463"),
    ],
)
def test_middles_of_faces_in_exodus(tmp_path: Path, kind: str, straight: str, name: str, order: str) -> None:
    """Element library of the Exodus II manual, HEX27 and WEDGE18."""
    corners = np.array(CORNERS[straight], float)
    middles = [corners[[int(n) - 1 for n in place]].mean(axis=0) for place in order.split()]
    nodes = np.concatenate([corners, middles])
    path = tmp_path / "cell.e"
    with netCDF4.Dataset(path, "w") as data:
        for dimension, size in {"num_nodes": len(nodes), "num_el_blk": 1, "one": 1}.items():
            data.createDimension(dimension, size)
        for i, axis in enumerate("xyz"):
            data.createVariable(f"coord{axis}", "f8", ("num_nodes",))[:] = nodes[:, i]
        block = data.createVariable("connect1", "i4", ("one", "num_nodes"))
        block.elem_type = name
        block[:] = np.arange(1, len(nodes) + 1)[None]
    content = read_content(path)
    cell = content.points[content.solids[kind][0]]
    linear = cell_functions(kind.rstrip("0123456789"))
    places = linear.values(cell_functions(kind).nodes)
    np.testing.assert_allclose(cell, places @ cell[: len(corners)], atol=1e-15)


# -- what writers get wrong ----------------------------------------------------------------------------------------
def test_a_cell_with_more_nodes_than_its_type_has(tmp_path: Path) -> None:
    """A pyramid of 13 nodes under the number of that of 5, as gmsh 4.15.2 writes it to .su2."""
    points = [" ".join(map(repr, x)) for x in np.random.default_rng(0).normal(size=(13, 3)).tolist()]
    cell = f"14 {' '.join(map(str, range(13)))} 0"
    (tmp_path / "x.su2").write_text("\n".join(["NDIME= 3", "NELEM= 1", cell, "NPOIN= 13", *points, ""]))
    refused(tmp_path / "x.su2", "a cell with too many or too few nodes", "pyramid: 14 numbers", "5 nodes")


@pytest.mark.parametrize("kind", ["tetra10", "wedge15", "hexahedron20"])
def test_middle_nodes_in_the_order_of_another_format(kind: str) -> None:
    """Also of thin cells that are bent by more than they are thick, whose right order is taken."""
    right = nodes_in(kind, TOP_BEFORE_VERTICAL)
    cells = np.arange(len(right))[None]
    assert not in_another_order(right, kind, cells)
    bent = right * [1.0, 1.0, 0.01]
    bent[:, 2] += 0.3 * bent[:, 0] ** 2 + 0.1 * bent[:, 1] ** 2
    assert not in_another_order(bent, kind, cells)
    for points in (right, bent):
        swapped = points.copy()
        if kind == "tetra10":
            swapped[[8, 9]] = points[[9, 8]]
        else:
            n = len(CORNERS[kind]) // 2
            first = len(CORNERS[kind]) + n
            swapped[first:] = np.concatenate([points[first + n :], points[first : first + n]])
        assert in_another_order(swapped, kind, cells)


@pytest.mark.parametrize(
    ("kind", "order"),
    [
        # MED and gmsh count the faces below, in front, right, behind, left, above: VTK by axes
        ("hexahedron27", [*range(20), 24, 22, 21, 23, 20, 25, 26]),
        ("wedge18", [*range(15), 15, 17, 16]),  # gmsh
        ("pyramid13", [*range(5), 5, 8, 9, 6, 10, 7, 11, 12]),  # gmsh
    ],
)
def test_nodes_of_faces_in_the_order_of_another_format(kind: str, order: list[int]) -> None:
    """MEDCoupling 9.15.0 writes such hexahedra of 27 nodes to .vtu; curved cells in their own order are taken."""
    mesh = typed_box(kind, (2, 2, 2), shift=0.2)
    (block,) = mesh.blocks
    for points in (mesh.nodes, skewed(mesh.nodes, 0.1)):
        assert not in_another_order(points, kind, block.cells)
        assert in_another_order(points, kind, block.cells[:, order])


# -- libraries that are not there --------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("name", "library", "remedy"),
    [
        ("part.cdb", "mapdl_archive", "pip install mapdl-archive"),
        ("part.cgns", "h5py", "pip install h5py"),
        ("part.vtkhdf", "vtkmodules", "pip install vtk"),
        ("part.ugrid", "meshlane meshio", "pip install meshlane"),
    ],
)
def test_a_library_that_is_missing_is_named(
    tmp_path: Path, name: str, library: str, remedy: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    import sys

    monkeypatch.setenv(NO_LIMIT, "0")
    for word in library.split():
        monkeypatch.setitem(sys.modules, word, None)
    monkeypatch.setitem(sys.modules, "vtkmodules.vtkCommonCore", None)
    (tmp_path / name).write_bytes(bytes(10))
    refused(tmp_path / name, remedy)
    assert child.NO_LIMIT == NO_LIMIT


def test_complete_second_order_is_answered_with_a_remedy(tmp_path: Path) -> None:
    nodes = np.random.default_rng(0).normal(size=(14, 3))
    write_gmsh(tmp_path / "cell.msh", nodes, {"body": (3, [("pyramid14", np.arange(14)[None])])})
    with pytest.raises(MeshError, match=r"1 pyramid14.*SecondOrderIncomplete = 1"):
        read_mesh(tmp_path / "cell.msh")


def test_gmsh_and_the_cube_agree(tmp_path: Path) -> None:
    """A solid that version 2 writes once for each of its groups is one cell; a group without a name has its number."""
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", "1", '3 1 "all"', "$EndPhysicalNames"]
    lines += ["$Nodes", "27", *(f"{i} {x} {y} {z}" for i, (x, y, z) in enumerate(BOX.nodes.tolist(), 1)), "$EndNodes"]
    cells = [(tag, cell) for cell in (CELLS + 1).tolist() for tag in (1, 2)]
    rows = [f"{i} 5 2 {tag} 1 {' '.join(map(str, cell))}" for i, (tag, cell) in enumerate(cells[:12], 1)]
    rows += [f"{i} 5 2 1 1 {' '.join(map(str, cell))}" for i, (tag, cell) in enumerate(cells[12:], 13) if tag == 1]
    path = tmp_path / "cube.msh"
    path.write_text("\n".join([*lines, "$Elements", str(len(rows)), *rows, "$EndElements", ""]))
    content = read_content(path)
    assert {n: sum(map(len, g.values())) for n, g in content.volumes.items()} == {"all": 8, "physical_2": 6}
    assert read_mesh(path).n_cell == 8
