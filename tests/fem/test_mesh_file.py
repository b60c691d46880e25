"""Meshes from files: named groups, units, orientation, and a clear refusal of everything else."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

from latin_fmu.errors import MeshError
from latin_fmu.fem.elements import Elements, jacobians, mass
from latin_fmu.fem.faces import face
from latin_fmu.fem.mesh import CellBlock, Mesh, boundary, box_mesh, unjoined
from latin_fmu.fem.mesh_file import oriented, refined
from latin_fmu.fem.reference_cells import CELL_FACES, cell_rule, mirrored
from latin_fmu.mesh_files.child import NO_LIMIT
from latin_fmu.mesh_files.reading import read_content

from .conftest import write_inp, write_msh
from .meshes import SIZE, cut, read_mesh, typed_box

SURFACE = {"hexahedron": "quad", "tetra": "triangle"}
Write = Callable[..., Path]


def facets(mesh: Mesh, name: str) -> np.ndarray:
    """Facets of a face of one kind."""
    (block,) = mesh.faces[name].blocks
    return block.facets


def groups_of(mesh: Mesh, **faces: str) -> dict[str, Any]:
    """The volume as group "part" and some faces of the box under new names."""
    (block,) = mesh.blocks
    groups: dict[str, Any] = {"part": (block.cell_type, block.cells)}
    for name, box_face in faces.items():
        groups[name] = (SURFACE[block.cell_type], facets(mesh, box_face))
    return groups


def test_volume_and_faces_come_back(straight: Mesh, written: Write) -> None:
    path = written(straight.nodes, groups_of(straight, foot="zmin", top="zmax"))
    for group in ("part", None):
        mesh = read_mesh(path, group)
        np.testing.assert_array_equal(mesh.nodes, straight.nodes)
        np.testing.assert_array_equal(mesh.blocks[0].cells, straight.blocks[0].cells)
        assert mesh.cell_types == straight.cell_types
        assert set(mesh.faces) == {"foot", "top"}
        for name, box_face in (("foot", "zmin"), ("top", "zmax")):
            ours, theirs = face(mesh, name), face(straight, box_face)
            np.testing.assert_array_equal(ours.nodes, theirs.nodes)
            np.testing.assert_allclose(ours.vector_areas, theirs.vector_areas, atol=1e-15)


def test_scale_is_metres_per_unit_of_the_file(straight: Mesh, written: Write) -> None:
    path = written(straight.nodes, groups_of(straight, top="zmax"))
    mesh = read_mesh(path, "part", scale=1e-3)
    np.testing.assert_allclose(mesh.nodes, 1e-3 * straight.nodes, rtol=1e-15)
    assert face(mesh, "top").areas.sum() == pytest.approx(0.8e-6, rel=1e-12)


def two_parts(cell: str) -> tuple[np.ndarray, dict[str, Any]]:
    """Two boxes one on the other that share the nodes of their common face "middle", with nodes nobody uses."""
    lower, upper = (box_mesh(np.array([0.0, 0.0, z]), np.ones(3), (2, 2, 2)) for z in (0.0, 1.0))
    shift = lower.n_node
    renumber = np.arange(upper.n_node) + shift
    bottom, top = upper.faces["zmin"].nodes, lower.faces["zmax"].nodes
    renumber[bottom] = top
    nodes = np.concatenate([lower.nodes, upper.nodes])
    groups = {
        "lower": (cell, lower.blocks[0].cells),
        "upper": (cell, renumber[upper.blocks[0].cells]),
        "base": ("quad", facets(lower, "zmin")),
        "middle": ("quad", facets(lower, "zmax")),
        "roof": ("quad", renumber[facets(upper, "zmax")]),
    }
    return nodes, groups


def test_a_group_takes_its_own_nodes_and_the_faces_it_touches(written: Write) -> None:
    """A face between two parts belongs to both, outwards for each."""
    path = written(*two_parts("hexahedron"))
    lower, upper = read_mesh(path, "lower"), read_mesh(path, "upper")
    assert lower.n_node == upper.n_node == 27
    assert set(lower.faces) == {"base", "middle"}
    assert set(upper.faces) == {"middle", "roof"}
    np.testing.assert_allclose(face(lower, "middle").normals, np.tile([0.0, 0.0, 1.0], (9, 1)), atol=1e-15)
    np.testing.assert_allclose(face(upper, "middle").normals, np.tile([0.0, 0.0, -1.0], (9, 1)), atol=1e-15)
    assert read_mesh(path).n_node == 45  # without a group: all volume cells together


def test_inverted_cells_are_turned(straight: Mesh, written: Write) -> None:
    """Same shape, mirrored numbering: volumes become positive again, faces stay outwards."""
    mirror = [0, 3, 2, 1, 4, 7, 6, 5] if straight.cell_types == ("hexahedron",) else [0, 2, 1, 3]
    cells = straight.blocks[0].cells.copy()
    cells[::2] = cells[::2][:, mirror]
    groups = groups_of(straight, top="zmax")
    groups["part"] = (straight.cell_types[0], cells)
    groups["top"] = (groups["top"][0], groups["top"][1][:, ::-1])
    mesh = read_mesh(written(straight.nodes, groups))
    basis = Elements(mesh)
    assert basis.volume.min() > 0
    assert basis.volume.sum() == pytest.approx(1.2, rel=1e-12)
    assert mass(basis, 1.0).sum() == pytest.approx(3 * 1.2, rel=1e-12)
    assert face(mesh, "top").vector_areas.sum(axis=0)[2] == pytest.approx(0.8, rel=1e-12)


def assert_refused(call: Callable[[], object], *words: str) -> MeshError:
    with pytest.raises(MeshError) as caught:
        call()
    for word in words:
        assert word in str(caught.value)
    return caught.value


def test_unknown_group_lists_the_known_ones(box: Mesh, written: Write) -> None:
    path = written(box.nodes, groups_of(box, top="zmax"))
    assert_refused(lambda: read_mesh(path, "prat"), "prat", "part", path.name)
    assert_refused(lambda: read_mesh(path, "top"), "top", "part")  # a surface is no volume


def other_cells(kind: str, corners: int) -> tuple[np.ndarray, dict[str, Any]]:
    nodes = np.random.default_rng(0).normal(size=(max(20, corners), 3))
    return nodes, {"part": (kind, np.arange(corners)[None])}


@pytest.mark.parametrize(("kind", "corners", "write"), [("hexahedron64", 64, write_msh)])
def test_other_cells_are_refused_with_a_remedy(kind: str, corners: int, write: Write, tmp_path: Path) -> None:
    path = tmp_path / ("part.inp" if write is write_inp else "part.msh")
    write(path, *other_cells(kind, corners))
    assert_refused(lambda: read_mesh(path), f"1 {kind}", "hexahedron", "tetra10", "mesh the part")


@pytest.mark.parametrize(
    ("cell_type", "writer"),
    [
        (t, w)
        for t in ("tetra10", "hexahedron20", "hexahedron27", "wedge", "wedge15", "pyramid")
        for w in ("msh", "inp")
        if (t, w) != ("hexahedron27", "inp")
    ],
)
def test_every_type_of_cell_comes_back(cell_type: str, writer: str, tmp_path: Path) -> None:
    """Cells, also those numbered inside out, faces of each kind of facet, volume."""
    mesh = typed_box(cell_type, (2, 2, 2), shift=0.2)
    (block,) = mesh.blocks
    cells = block.cells.copy()
    cells[::3] = cells[::3][:, mirrored(cell_type)]
    groups: dict[str, Any] = {"part": (cell_type, cells)}
    for name in ("zmax", "xmin"):
        (facet,) = mesh.faces[name].blocks
        groups[name] = (facet.kind, facet.facets)
    path = tmp_path / f"part.{writer}"
    {"msh": write_msh, "inp": write_inp}[writer](path, mesh.nodes, groups)
    read_back = read_mesh(path, "part")
    assert read_back.cell_types == (cell_type,)
    assert Elements(read_back).volume.sum() == pytest.approx(float(np.prod(SIZE)), rel=1e-12)
    np.testing.assert_array_equal(read_back.blocks[0].cells[1::3], cells[1::3])
    for name in ("zmax", "xmin"):
        wanted, has = (sorted(map(sorted, m.faces[name].blocks[0].facets.tolist())) for m in (mesh, read_back))
        assert wanted == has


def test_mixed_cells_are_one_body(msh: Write) -> None:
    """Hexahedra beside wedges, the face on top made of both kinds of facets."""
    mesh = typed_box("mixed")
    groups: dict[str, Any] = {b.cell_type: (b.cell_type, b.cells) for b in mesh.blocks}
    groups |= {f"top_{b.kind}": (b.kind, b.facets) for b in mesh.faces["zmax"].blocks}
    read_back = read_mesh(msh(mesh.nodes, groups))
    assert set(read_back.cell_types) == {"hexahedron", "wedge"}
    assert Elements(read_back).volume.sum() == pytest.approx(float(np.prod(SIZE)), rel=1e-12)
    assert boundary(read_back).n_facet == boundary(mesh).n_facet
    assert {f.blocks[0].kind for f in read_back.faces.values()} == {"quad", "triangle"}


def test_a_cell_with_a_middle_node_gone_astray_is_refused(tmp_path: Path) -> None:
    mesh = typed_box("tetra10", (1, 1, 1))
    nodes = mesh.nodes.copy()
    first, second, middle = mesh.blocks[0].cells[2, [0, 1, 4]]
    nodes[middle] = 0.8 * nodes[first] + 0.2 * nodes[second]
    write_msh(tmp_path / "part.msh", nodes, {"part": ("tetra10", mesh.blocks[0].cells)})
    path = tmp_path / "part.msh"
    assert_refused(
        lambda: read_mesh(path), "tetra10", "tangled", "integration point", "number 2 of them, around [", "gmsh"
    )


def test_a_surface_alone_is_no_volume(box: Mesh, written: Write) -> None:
    path = written(box.nodes, {"top": ("quad", facets(box, "zmax"))})
    assert_refused(lambda: read_mesh(path), "no volume cells")


def test_flat_cells_are_refused(straight: Mesh, written: Write) -> None:
    nodes = straight.nodes.copy()
    nodes[:, 1] = 0.0
    assert_refused(lambda: read_mesh(written(nodes, groups_of(straight))), "no volume")


def test_a_tangled_hexahedron_is_refused(written: Write) -> None:
    """Right at its first corner and inside out at the opposite one: its stiffness would be nonsense."""
    mesh = box_mesh(np.zeros(3), np.ones(3), (1, 1, 1))
    nodes = mesh.nodes.copy()
    nodes[7] = [0.1, 0.1, 0.1]
    assert_refused(lambda: read_mesh(written(nodes, groups_of(mesh))), "part.")


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_coordinates_must_be_finite(box: Mesh, written: Write, value: float) -> None:
    nodes = box.nodes.copy()
    nodes[5, 0] = value
    assert_refused(lambda: read_mesh(written(nodes, groups_of(box))), "node coordinates are not finite")


def test_a_facet_named_twice_counts_once(box: Mesh, written: Write) -> None:
    groups = groups_of(box, top="zmax")
    groups["top"] = ("quad", np.concatenate([facets(box, "zmax"), facets(box, "zmax")[:, ::-1]]))
    surface = face(read_mesh(written(box.nodes, groups)), "top")
    assert surface.areas.sum() == pytest.approx(0.8, rel=1e-12)


def test_facets_inside_the_volume_are_no_face(written: Write) -> None:
    mesh = read_mesh(written(*two_parts("hexahedron")))
    assert set(mesh.faces) == {"base", "roof"}


# Abaqus files in which groups are not one ELSET per block; "part" are the hexahedra, "top" the quadrilaterals.
INP_STYLES = {
    "sets_after": "{nodes}*ELEMENT, TYPE=C3D8\n{cells}*ELEMENT, TYPE=S4\n{quads}"
    "*ELSET, ELSET=part\n1,2,3,4,5,6,7,8\n*ELSET, ELSET=top\n101,102,103,104\n",
    "generated": "{nodes}*ELEMENT, TYPE=C3D8\n{cells}*ELEMENT, TYPE=S4\n{quads}"
    "*ELSET, ELSET=part, GENERATE\n1,8,1\n*ELSET, ELSET=top\n101,102,103,104\n",
    "gmsh": "*HEADING\n part\n{nodes}*ELEMENT, type=CPS4, ELSET=Surface1\n{quads}*ELEMENT, type=C3D8, ELSET=Volume1\n"
    "{cells}*ELSET,ELSET=part\n1,2,3,4,5,6,7,8\n*ELSET,ELSET=top\n101,102,103,104\n",
    "set_before_a_later_block": "{nodes}*ELEMENT, TYPE=C3D8\n{cells}*ELSET, ELSET=part\n1,2,3,4,5,6,7,8\n"
    "*ELEMENT, TYPE=S4, ELSET=top\n{quads}",
    "set_of_sets": "{nodes}*ELEMENT, TYPE=C3D8, ELSET=a\n{cells}*ELEMENT, TYPE=S4, ELSET=b\n{quads}"
    "*ELSET, ELSET=part\na\n*ELSET, ELSET=top\nb\n",
}


@pytest.mark.parametrize("style", INP_STYLES)
def test_styles_of_abaqus_files(tmp_path: Path, style: str) -> None:
    """All of them give the same groups."""
    mesh = box_mesh(np.zeros(3), np.ones(3), (2, 2, 2))

    def rows(table: np.ndarray, first: int, shift: int) -> str:
        return "".join(f"{first + i}, " + ", ".join(str(x + shift) for x in row) + "\n" for i, row in enumerate(table))

    text = INP_STYLES[style].format(
        nodes="*NODE\n" + rows(mesh.nodes, 1, 0),
        cells=rows(mesh.blocks[0].cells, 1, 1),
        quads=rows(facets(mesh, "zmax"), 101, 1),
    )
    path = tmp_path / "part.inp"
    path.write_text(text)
    for group in ("part", None):
        read_back = read_mesh(path, group)
        assert read_back.n_cell == 8
        assert "top" in read_back.faces
        for name, surface in read_back.faces.items():
            assert name in ("top", "Surface1", "b")
            assert surface.n_facet == 4


def test_missing_file_and_folder(tmp_path: Path) -> None:
    assert_refused(lambda: read_mesh(tmp_path / "none.msh"), "none.msh", "no such mesh file")
    assert_refused(lambda: read_content(tmp_path), tmp_path.name)


GARBAGE = (
    b"",
    b"\n",
    b"hello",
    b"\x00\xff\xfe" * 200,
    b"$MeshFormat\n4.1 0 8\n",
    b"$MeshFormat\n9.9 0 8\n$EndMeshFormat\n",
    b"*NODE\n1, a, b, c\n",
    b"*ELEMENT, TYPE=C3D8\n1,1,2\n",
    b"*NODE\n1,0,0,0\n*ELEMENT, TYPE=X9\n1,1\n",
    b"<VTKFile type='UnstructuredGrid'",
    b"# vtk DataFile Version 2.0\n",
)


@pytest.mark.parametrize(
    "suffix",
    ["msh", "inp", "vtu", "vtk", "med", "xdmf", "bdf", "mesh", "stl", "zzz", "", "su2", "vol", "unv", "k", "cgns", "e"],
)
def test_garbage_is_a_mesh_error_and_never_ends_the_process(
    tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Libraries read in this process."""
    monkeypatch.setenv(NO_LIMIT, "0")
    path = tmp_path / (f"bad.{suffix}" if suffix else "bad")
    for content in GARBAGE:
        path.write_bytes(content)
        assert_refused(lambda: read_mesh(path), path.name)


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("tag", [-1, 0, -3])
def test_node_tags_below_one_are_refused(tag: int, binary: bool, box: Mesh, tmp_path: Path) -> None:
    """Version 2 of .msh; counted from the end, they would be the last nodes."""
    cells = box.blocks[0].cells.copy()
    tags = [np.ones(len(cells), dtype=np.int32)]
    data = {"gmsh:physical": tags, "gmsh:geometrical": tags}
    whole, path = tmp_path / "whole.msh", tmp_path / "damaged.msh"
    meshio.write(whole, meshio.Mesh(box.nodes, [("hexahedron", cells)], cell_data=data), "gmsh22", binary=binary)
    read_mesh(whole)
    cells[-1, 3] = tag - 1
    meshio.write(path, meshio.Mesh(box.nodes, [("hexahedron", cells)], cell_data=data), "gmsh22", binary=binary)
    assert_refused(lambda: read_mesh(path), "node tag below 1", str(tag))


@pytest.mark.parametrize("suffix", ["vtk", "vtu"])
@pytest.mark.parametrize("node", [-1, 8, 10**6])
def test_nodes_that_are_not_there_are_refused(node: int, suffix: str, tmp_path: Path) -> None:
    box = box_mesh(np.zeros(3), np.ones(3), (1, 1, 1))
    cells = box.blocks[0].cells.copy()
    cells[0, 5] = node
    path = tmp_path / f"damaged.{suffix}"
    meshio.write(path, meshio.Mesh(box.nodes, [("hexahedron", cells)]))
    assert_refused(lambda: read_mesh(path), "nodes that are not there", "8 nodes")


@pytest.mark.parametrize("count", [1, 8])
def test_cells_given_twice_are_refused(count: int, box: Mesh, msh: Write) -> None:
    cells = box.blocks[0].cells
    path = msh(box.nodes, {"part": ("hexahedron", np.concatenate([cells, cells[:count]]))})
    assert_refused(lambda: read_mesh(path), "same corners as others", f"{min(count, len(cells))} cells")


@pytest.mark.parametrize(("value", "words"), [(1e155, "beyond 1e+60 m"), (3e-110, "have no volume")])
def test_absurd_sizes_are_refused_without_a_warning(value: float, words: str, box: Mesh, msh: Write) -> None:
    """Products of three edges overflow or vanish."""
    path = msh(box.nodes * value, {"part": ("hexahedron", box.blocks[0].cells)})
    assert_refused(lambda: read_mesh(path), words)


def test_reading_says_nothing(box: Mesh, written: Write, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    read_mesh(written(box.nodes, groups_of(box, top="zmax")))
    bad = tmp_path / "bad.msh"
    bad.write_text("hello")
    assert_refused(lambda: read_mesh(bad))
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("other", ["tetra", "hexahedron20"])
def test_cells_that_share_nodes_but_no_facets_are_refused(other: str, msh: Write) -> None:
    """A hexahedron under two others cut into tetrahedra, or of second degree: there would be a crack between."""
    box = box_mesh(np.zeros(3), np.ones(3), (1, 1, 2))
    cells = box.blocks[0].cells
    upper = cut(Mesh.uniform(box.nodes, "hexahedron", cells[1:]), other)
    path = msh(upper.nodes, {"low": ("hexahedron", cells[:1]), "up": (other, upper.blocks[0].cells)})
    assert_refused(lambda: read_mesh(path), "share nodes but not facets", "facets of one kind", "perfect interface")
    assert read_mesh(path, "low").n_cell == 1


def test_pyramids_are_not_refined() -> None:
    with pytest.raises(MeshError, match="pyramids cannot be split"):
        refined(typed_box("pyramid", (1, 1, 1)))


@pytest.mark.parametrize("cell_type", [t for t in CELL_FACES if not t.startswith("pyramid")])
def test_refined_cells_fill_the_box(cell_type: str) -> None:
    """64 times the cells, 16 times the facets after two refinements, each node once, the right side out."""
    coarse = typed_box(cell_type, (3, 2, 1))
    fine = refined(refined(coarse))
    assert fine.n_cell == 64 * coarse.n_cell
    assert len(np.unique(fine.nodes.round(9), axis=0)) == fine.n_node
    if cell_type != "tetra10":  # its middle nodes depend on how the parts are cut
        once = typed_box(cell_type, (12, 8, 4))
        assert sorted(fine.nodes.round(9).tolist()) == sorted(once.nodes.round(9).tolist())
    (block,) = fine.blocks
    cells, bad = oriented(fine.nodes, block)
    assert not bad.any()
    np.testing.assert_array_equal(cells, block.cells)
    rule = cell_rule(cell_type)
    volume = np.linalg.det(jacobians(fine.nodes, block, rule)) @ rule.weights
    assert volume.sum() == pytest.approx(np.prod(SIZE))
    skin = {tuple(sorted(f)) for b in boundary(fine).blocks for f in b.corners.tolist()}
    assert len(skin) == 16 * boundary(coarse).n_facet
    for name, named in coarse.faces.items():
        assert fine.faces[name].n_facet == 16 * named.n_facet
        assert skin >= {tuple(sorted(f)) for b in fine.faces[name].blocks for f in b.corners.tolist()}
        ours, theirs = face(fine, name), face(coarse, name)
        np.testing.assert_allclose(ours.areas @ ours.normals, theirs.areas @ theirs.normals, rtol=1e-12, atol=1e-12)


def test_refined_cells_of_several_types_stay_joined() -> None:
    """A wedge on a hexahedron: the facet between them is split alike from both sides."""
    box = box_mesh(np.zeros(3), np.ones(3), (1, 1, 1))
    nodes = np.concatenate([box.nodes, [[0.0, 0.0, 2.0], [0.0, 1.0, 2.0]]])
    cells, bad = oriented(nodes, CellBlock("wedge", np.array([[4, 5, 8, 6, 7, 9]])))
    assert not bad.any()
    fine = refined(Mesh(nodes, (*box.blocks, CellBlock("wedge", cells)), {}))
    assert len(np.unique(fine.nodes.round(9), axis=0)) == fine.n_node
    assert unjoined(boundary(fine)) == 0
    assert boundary(fine).n_facet == 4 * (5 + 4)
