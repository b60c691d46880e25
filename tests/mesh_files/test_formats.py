"""Exodus by netCDF4, other formats by meshio: names of blocks and sets, integer data, what is missing is named."""

from __future__ import annotations

import sys
from pathlib import Path

import meshio
import netCDF4
import numpy as np
import pytest

from latin_fmu.errors import MeshError
from latin_fmu.fem.faces import face
from latin_fmu.fem.mesh_file import mesh_of
from latin_fmu.mesh_files.child import NO_LIMIT
from latin_fmu.mesh_files.content import FileProblems
from latin_fmu.mesh_files.exodus import _SIDES, _facets
from latin_fmu.mesh_files.reading import read_content

from .decks import cube, read_mesh

# Sides of HEX8 by number (Exodus II manual), as faces of a box with VTK order of nodes
SIDE_OF = {"ymin": 1, "xmax": 2, "ymax": 3, "xmin": 4, "zmin": 5, "zmax": 6}


def exodus(path: Path, named: bool = True) -> Path:
    """The cube as two blocks of four elements, all faces of the box as side sets, a node set."""
    box = cube()
    cells = box.blocks[0].cells
    with netCDF4.Dataset(path, "w", format="NETCDF3_64BIT_OFFSET") as data:
        for name, size in {
            "num_nodes": 27,
            "num_dim": 3,
            "num_el_blk": 2,
            "num_side_sets": 6,
            "num_node_sets": 1,
            "len_name": 33,
            "four": 4,
            "eight": 8,
            "nine": 9,
        }.items():
            data.createDimension(name, size)
        for i, axis in enumerate("xyz"):
            data.createVariable(f"coord{axis}", "f8", ("num_nodes",))[:] = box.nodes[:, i]
        for i in range(2):
            block = data.createVariable(f"connect{i + 1}", "i4", ("four", "eight"))
            block.elem_type = "HEX8"
            block[:] = cells[4 * i : 4 * i + 4] + 1
        for short, names in {"eb": ["lower", "upper"], "ss": list(SIDE_OF), "ns": ["feet"]}.items():
            dimension = {"eb": "num_el_blk", "ss": "num_side_sets", "ns": "num_node_sets"}[short]
            data.createVariable(f"{short}_prop1", "i4", (dimension,))[:] = 10 * np.arange(1, len(names) + 1)
            if named:
                table = np.array([list(n.ljust(33, "\0")) for n in names], dtype="S1")
                data.createVariable(f"{short}_names", "S1", (dimension, "len_name"))[:] = table
        for i, (name, side) in enumerate(SIDE_OF.items(), 1):
            corners = set(np.unique(box.faces[name].blocks[0].facets).tolist())
            elements = [j + 1 for j, cell in enumerate(cells.tolist()) if len(corners & set(cell)) == 4]
            data.createVariable(f"elem_ss{i}", "i4", ("four",))[:] = elements
            data.createVariable(f"side_ss{i}", "i4", ("four",))[:] = side
        data.createVariable("node_ns1", "i4", ("nine",))[:] = np.arange(1, 10)
    return path


def test_exodus_blocks_side_sets_and_node_sets(tmp_path: Path) -> None:
    box, path = cube(), exodus(tmp_path / "cube.e")
    content = read_content(path)
    assert content.part_names("cube.e") == ("lower", "upper")
    whole = read_mesh(path)
    for name in SIDE_OF:
        expected = face(box, name).vector_areas.sum(axis=0)
        np.testing.assert_allclose(face(whole, name).vector_areas.sum(axis=0), expected, atol=1e-15)
        np.testing.assert_array_equal(face(whole, name).nodes, face(box, name).nodes)
    lower = mesh_of(content, "cube.e", "lower")
    assert lower.n_cell == 4
    assert "zmax" not in lower.faces
    assert face(lower, "feet").areas.sum() == pytest.approx(1.0)
    assert len(_SIDES[8]) == 6


def test_exodus_without_names(tmp_path: Path) -> None:
    content = read_content(exodus(tmp_path / "cube.exo", named=False))
    assert list(content.volumes) == ["block_10", "block_20"]
    assert list(content.facets) == [f"sideset_{10 * i}" for i in range(1, 7)]
    assert list(content.node_sets) == ["nodeset_10"]


def test_sides_of_pyramids_in_exodus() -> None:
    """Every side of a pyramid behind a hexahedron: three triangles, two more, and the base (Exodus II manual)."""
    cells = [("hexahedron", np.arange(8)[None]), ("pyramid", np.array([[4, 5, 6, 7, 8]]))]
    problems = FileProblems("file")
    facets = _facets(cells, np.array([0, 1, 1, 1, 1, 1]), np.array([4, 0, 1, 2, 3, 4]), problems, "set")
    assert [sorted(facet[0].tolist()) for facet in facets] == [
        *([0, 1, 2, 3], [4, 5, 8], [5, 6, 8], [6, 7, 8], [4, 7, 8], [4, 5, 6, 7])
    ]
    problems.stop()


def test_edges_of_shells_in_exodus_are_no_facets() -> None:
    """Sides 1 and 2 of a shell are its faces, 3 to 6 its edges."""
    shells = cube().faces["zmax"].blocks[0].facets
    sides = np.array([1, 2, 3, 6]) - 1
    problems = FileProblems("shells.e")
    facets = _facets([("quad", shells)], np.arange(4), sides, problems, "set")
    np.testing.assert_array_equal(np.concatenate(facets), shells[:2])
    assert _facets([("quad", shells)], np.arange(4), np.full(4, 2), problems, "set") == []
    problems.stop()


@pytest.mark.parametrize("suffix", ["vtu", "vtk", "mesh"])
def test_integer_cell_data_names_parts(tmp_path: Path, suffix: str) -> None:
    """Value 2 of the data is the group KEY_2, for solids and for the facets of a face."""
    box = cube()
    key = "medit:ref" if suffix == "mesh" else "PartId"
    cells = [("hexahedron", box.blocks[0].cells), ("quad", box.faces["zmax"].blocks[0].facets)]
    tags = [np.array([1] * 4 + [2] * 4), np.array([7] * 4)]
    data: dict[str, list[np.ndarray]] = {key: tags}
    if suffix != "mesh":
        data["quality"] = [np.linspace(0, 1, 8), np.zeros(4)]  # numbers that are not whole name nothing
    path = tmp_path / f"cube.{suffix}"
    meshio.Mesh(box.nodes, cells, cell_data=data).write(path)
    content = read_content(path)
    short = key.split(":")[-1]
    assert content.part_names(path.name) == (f"{short}_1", f"{short}_2")
    upper = mesh_of(content, path.name, f"{short}_2")
    assert face(upper, f"{short}_7").areas.sum() == pytest.approx(1.0)


def test_a_missing_library_is_asked_for_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "h5py", None)
    monkeypatch.setenv(NO_LIMIT, "0")
    path = tmp_path / "part.med"
    path.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(100))
    with pytest.raises(MeshError, match="pip install h5py") as caught:
        read_content(path)
    assert "mesh format" not in str(caught.value)


def test_the_reason_of_the_reader_reaches_the_user(tmp_path: Path) -> None:
    path = tmp_path / "part.msh"
    path.write_text("$MeshFormat\n9.9 0 8\n$EndMeshFormat\n")
    with pytest.raises(MeshError, match=r"9\.9") as caught:
        read_content(path)
    assert "Couldn't read file" not in str(caught.value)
    (tmp_path / "part.zzz").write_text("x")
    with pytest.raises(MeshError, match="no reader for files of this kind"):
        read_content(tmp_path / "part.zzz")


def test_an_element_that_the_reader_does_not_know(tmp_path: Path) -> None:
    """A sentence with the number of the type and the remedy, no name of an error."""
    nodes = "".join(f"{i + 1} {i % 3} {i // 3} {i % 2}\n" for i in range(13))
    cell = "1 140 2 1 1 " + " ".join(str(i + 1) for i in range(13))
    text = f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n13\n{nodes}$EndNodes\n$Elements\n1\n{cell}\n$EndElements\n"
    (tmp_path / "odd.msh").write_text(text)
    with pytest.raises(MeshError, match=r"an element of the unknown type 140; save it again") as caught:
        read_content(tmp_path / "odd.msh")
    assert "Error:" not in str(caught.value)
