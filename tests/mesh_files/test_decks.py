"""Abaqus and Nastran decks: every way of naming parts and faces that the formats have."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from latin_fmu.errors import MeshError
from latin_fmu.fem.faces import face
from latin_fmu.fem.mesh import Mesh
from latin_fmu.fem.mesh_file import mesh_of
from latin_fmu.mesh_files.abaqus import SOLID_FACES
from latin_fmu.mesh_files.abaqus_elements import element_type
from latin_fmu.mesh_files.reading import read_content

from .decks import LABEL_OF, cube, element_rows, instances_deck, nastran_deck, node_rows, read_mesh, surfaces_deck


def written(folder: Path, text: str, name: str = "deck.inp") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def refused(call: Callable[[], object], *words: str) -> str:
    with pytest.raises(MeshError) as caught:
        call()
    for word in words:
        assert word in str(caught.value), str(caught.value)
    return str(caught.value)


def assert_same_face(ours: Mesh, theirs: Mesh, name: str) -> None:
    """Same points and vector areas, so same facets and the normal outwards."""
    np.testing.assert_array_equal(face(ours, name).nodes, face(theirs, name).nodes)
    np.testing.assert_allclose(face(ours, name).vector_areas, face(theirs, name).vector_areas, atol=1e-15)


def test_surfaces_of_element_faces(tmp_path: Path) -> None:
    """The six labels of hexahedra, by set and by element, give the six faces of the box."""
    mesh, box = read_mesh(written(tmp_path, surfaces_deck()), "part"), cube()
    assert set(mesh.faces) == {*LABEL_OF, "NALL"}
    for name in LABEL_OF:
        assert_same_face(mesh, box, name)


@pytest.mark.parametrize(
    ("kind", "nodes"),
    [
        ("C3D4", [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]),
        ("C3D5", [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1]]),
        ("C3D6", [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]]),
    ],
)
def test_labels_of_tetrahedra_pyramids_and_wedges(tmp_path: Path, kind: str, nodes: list[list[float]]) -> None:
    """Where the faces lie, by hand: Abaqus Analysis User's Guide, solid elements."""
    planes = {
        "C3D4": [("z", 0), ("y", 0), ("xyz", 1), ("x", 0)],
        "C3D5": [("z", 0), ("y", 0), ("xz", 1), ("yz", 1), ("x", 0)],
        "C3D6": [("z", 0), ("z", 1), ("y", 0), ("xy", 1), ("x", 0)],
    }[kind]
    points = np.array(nodes, dtype=float)
    text = "*NODE\n" + node_rows(points) + f"*ELEMENT, TYPE={kind}\n" + element_rows(np.arange(len(points))[None])
    for i in range(len(planes)):
        text += f"*SURFACE, NAME=f{i + 1}\n1, S{i + 1}\n"
    content = read_content(written(tmp_path, text))
    for i, (axis, value) in enumerate(planes):
        corners = content.points[content.facets[f"f{i + 1}"][0][0]]
        np.testing.assert_allclose(corners[:, ["xyz".index(a) for a in axis]].sum(axis=1), value)
    assert len(SOLID_FACES[len(points)]) == len(planes)


def test_instances_are_placed_and_named(tmp_path: Path) -> None:
    content = read_content(written(tmp_path, instances_deck()))
    assert content.part_names("deck") == ("Bar-1", "Bar-2")
    first, second = (mesh_of(content, "deck", name) for name in ("Bar-1", "Bar-2"))
    # translated by 2 along z, then turned by 90 degrees about the line x = 1, y = 0: (x, y) -> (1 - y, x - 1)
    x, y, z = first.nodes.T
    np.testing.assert_allclose(second.nodes, np.stack([1 - y, x - 1, z + 2], axis=1), atol=1e-14)
    assert_same_face_normal(first, "Top", [0, 0, 2])
    assert_same_face_normal(second, "Top", [0, 0, 2])
    assert_same_face_normal(second, "Left", [0, -1, 0])  # x = 0 of the bar, turned
    assert "Left" not in first.faces
    assert_same_face_normal(second, "Direct", [0, 0, -2])
    assert_same_face_normal(first, "Direct", [-1, 0, 0])
    assert_same_face_normal(first, "End", [1, 0, 0])  # the facet with all its corners in the node set
    assert "Both" in first.faces
    assert "Both" not in second.faces  # one node makes no facet


def assert_same_face_normal(mesh: Mesh, name: str, area: list[float]) -> None:
    np.testing.assert_allclose(face(mesh, name).vector_areas.sum(axis=0), area, atol=1e-14)


def test_several_blocks_includes_and_sections(tmp_path: Path) -> None:
    """Two *NODE blocks, one of them included, elements over two lines; parts are the sets of the solid sections."""
    box = cube()
    half = len(box.nodes) // 2
    written(tmp_path, "*NODE\n" + node_rows(box.nodes[half:], half + 1), "rest.inp")
    rows = element_rows(box.blocks[0].cells).replace("\n", ",\n").splitlines()
    broken = "".join(f"{r[: r.index(',', 12) + 1]}\n{r[r.index(',', 12) + 1 :].rstrip(',')}\n" for r in rows)
    text = "*NODE\n" + node_rows(box.nodes[:half]) + "*INCLUDE, INPUT=rest.inp\n*ELEMENT, TYPE=C3D8,\nELSET=Eall\n"
    text += broken + "*ELSET, ELSET=low, GENERATE\n1, 4\n*ELSET, ELSET=HIGH\n5, 6, 7, 8\n*ELSET, ELSET=some\n3, 4, 5\n"
    text += "*SOLID SECTION, ELSET=Low, MATERIAL=a\n*SOLID SECTION, ELSET=high, MATERIAL=b\n"
    path = written(tmp_path, text)
    content = read_content(path)
    assert content.part_names("deck") == ("low", "HIGH")
    np.testing.assert_array_equal(read_mesh(path, "Eall").nodes, box.nodes)
    assert read_mesh(path, "low").n_cell == 4


def test_parts_without_sections_leave_gathering_sets_out(tmp_path: Path) -> None:
    text = (
        "*NODE\n" + node_rows(cube().nodes) + "*ELEMENT, TYPE=C3D8, ELSET=Eall\n" + element_rows(cube().blocks[0].cells)
    )
    text += "*ELSET, ELSET=a\n1, 2, 3, 4\n*ELSET, ELSET=b\n5, 6, 7, 8\n*ELSET, ELSET=twin, GENERATE\n5, 8\n"
    content = read_content(written(tmp_path, text))
    assert content.part_names("deck") == ("a", "twin")
    content = read_content(written(tmp_path, text + "*ELSET, ELSET=across\n4, 5\n"))
    refused(lambda: content.part_names("deck.inp"), "deck.inp", "overlap", "across")


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("C3D8I", ("hexahedron", 8)),
        ("c3d20r", ("hexahedron20", 20)),
        ("C3D10MH", ("tetra10", 10)),
        ("CPS6", ("triangle6", 6)),
        ("CPS8", ("quad8", 8)),
        ("S4R", ("quad", 4)),
        ("STRI65", ("triangle6", 6)),
        ("SFM3D4R", ("quad", 4)),
        ("B31", None),
        ("C3D5", ("pyramid", 5)),
        ("C3D7", None),
        ("", None),
    ],
)
def test_element_types(name: str, expected: tuple[str, int] | None) -> None:
    assert element_type(name) == expected


BAD_DECKS = {
    "*NODE\n1, 0, 0, 0\n*ELEMENT, TYPE=C3D4, ELSET=a\n1, 1, 2, 3, 4\n": ("no *NODE block has", "node 2 of element 1"),
    "*NODE\n1, 0, x, 0\n": ("line 2", "not a node"),
    "*ELEMENT, TYPE=C3D8R\n1, 2, 3\n": ("C3D8R", "3 numbers"),
    "*ELEMENT, TYPE=C3D7\n1, 2, 3\n": ("not known", "C3D7"),
    "*ELSET, ELSET=a, GENERATE\n1, 5, 0\n": ("range", "1, 5, 0"),
    "*ELSET, ELSET=a\nb\n": ("no set of this name", "b"),
    "*ELSET, ELSET=a\na\n": ("contains itself",),
    "*NSET, NSET=a\n7\n": ("a node that is not there", "7 in a"),
    "*INSTANCE, NAME=i, PART=p\n": ("part that is not there", "p"),
    "*INCLUDE, INPUT=none.inp\n": ("none.inp",),
    "*INCLUDE, INPUT=deck.inp\n": ("too deeply",),
    "hello\n": ("before the first keyword",),
    "*HEADING\nnothing\n": ("no volume cells",),
}


@pytest.mark.parametrize("text", BAD_DECKS)
def test_bad_decks_are_refused_with_the_place(tmp_path: Path, text: str) -> None:
    path = written(tmp_path, text)
    refused(lambda: read_mesh(path), "deck.inp", *BAD_DECKS[text])


def test_a_face_that_a_tetrahedron_has_not(tmp_path: Path) -> None:
    text = "*NODE\n" + node_rows(np.eye(4)[:, :3]) + "*ELEMENT, TYPE=C3D4\n1, 1, 2, 3, 4\n*SURFACE, NAME=s\n1, S5\n"
    refused(lambda: read_content(written(tmp_path, text)), "surface s", "S5", "S1 to S4")


def test_all_problems_of_a_deck_come_at_once(tmp_path: Path) -> None:
    text = "*NODE\n1, a\n*ELEMENT, TYPE=C3D8\n1, 2\n*ELSET, ELSET=s, GENERATE\nx\n"
    message = refused(lambda: read_content(written(tmp_path, text)))
    assert "3 problems" in message


def test_nastran_properties_are_parts_and_faces(tmp_path: Path) -> None:
    """Small and free fields with continuation, bulk only, or with case control and large fields: the same mesh."""
    box, text = cube(), nastran_deck()
    large = "".join(
        f"GRID*   {i + 1:<16d}{'':16s}{x:<16.9g}{y:<16.9g}*G{i}\n" + f"*G{i}".ljust(8) + f"{z:<16.9g}\n"
        for i, (x, y, z) in enumerate(box.nodes.tolist())
    )
    rest = text[text.index("CHEXA") :]
    whole = f"SOL 101\nCEND\nTITLE = x\nBEGIN BULK\n{large}{rest}ENDDATA\nnothing, after\n"
    for name, deck in (("a.bdf", text), ("b.nas", whole)):
        content = read_content(written(tmp_path, deck, name))
        assert content.part_names(name) == ("PSOLID_7",)
        mesh = mesh_of(content, name, "PSOLID_7")
        np.testing.assert_allclose(mesh.nodes, box.nodes, rtol=1e-12)
        assert_same_face_normal(mesh, "PSHELL_8", [0, 0, 1])
        assert_same_face_normal(mesh, "SPC_3", [0, 0, -1])  # nodes 1 to 9 are the lowest layer


def test_nastran_constraints_before_their_nodes(tmp_path: Path) -> None:
    """Entries of bulk data may have any order."""
    deck = nastran_deck()
    grids, rest = deck[: deck.index("CHEXA")], deck[deck.index("CHEXA") :]
    after, before = (read_content(written(tmp_path, text, "a.bdf")) for text in (deck, rest + grids))
    np.testing.assert_array_equal(before.node_sets["SPC_3"], np.arange(9))
    np.testing.assert_array_equal(after.node_sets["SPC_3"], np.arange(9))
    mixed = "SPC1,4,3,27,5\nSPC1,4,3,99\nSPC1,4,3,20,THRU,22\nSPC,4,2,3,0.,30,3,0.\n" + deck
    content = read_content(written(tmp_path, mixed, "a.bdf"))
    np.testing.assert_array_equal(content.node_sets["SPC_4"], [1, 4, 19, 20, 21, 26])


def test_names_of_properties_in_comments(tmp_path: Path) -> None:
    text = '$HMNAME PROP                   7"bracket" 4\n$ANSA_NAME_COMMENT;8;PSHELL;top;;\n' + nastran_deck()
    content = read_content(written(tmp_path, text, "a.bdf"))
    assert list(content.volumes) == ["bracket"]
    assert list(content.facets) == ["top"]


def test_nastran_numbers_and_bad_entries(tmp_path: Path) -> None:
    grids = "GRID,1,,1.5-3,1.D0,-2.+1\nGRID,2,,1,0,0\nGRID,3,,0,1,0\nGRID,4,,0,0,1\nCTETRA,1,1,1,2,3,4\n"
    content = read_content(written(tmp_path, grids, "a.bdf"))
    np.testing.assert_allclose(content.points[0], [1.5e-3, 1.0, -20.0])
    refused(
        lambda: read_content(written(tmp_path, "GRID,1,5,0,0,0\n", "b.bdf")),
        "no coordinate system of this label",
        "5",
        "line 1",
    )
    refused(
        lambda: read_content(written(tmp_path, grids + "CTETRA,2,1,1,2,3,9\n", "c.bdf")),
        "line 6",
        "no GRID has",
        "node 9 of element 2",
    )
    refused(lambda: read_content(written(tmp_path, "CHEXA,1,1,1,2,3\n", "d.bdf")), "CHEXA", "8 or 20")
