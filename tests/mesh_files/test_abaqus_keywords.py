"""What the keywords of Abaqus and CalculiX decks say of the mesh, of supports, materials and pairs of surfaces."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from latin_fmu.building import discretise
from latin_fmu.errors import LatinError, MeshError
from latin_fmu.fem.elements import Elements
from latin_fmu.fem.mesh import box_mesh
from latin_fmu.fem.mesh_file import mesh_of, refined
from latin_fmu.mesh_files.content import MeshContent
from latin_fmu.mesh_files.reading import included_files, read_content
from latin_fmu.reader import scene_from_dict
from latin_fmu.scene.schema import Scene

from .decks import element_rows, node_rows, read_mesh

CUBE = box_mesh(np.zeros(3), np.full(3, 10.0), (1, 1, 1))  # mm
STEEL = "*MATERIAL, NAME=steel\n*ELASTIC\n210000., 0.3\n*DENSITY\n7.8e-9\n"
NODES = CUBE.nodes[CUBE.blocks[0].cells[0]]  # in the order of the corners of a C3D8
LOW = "*NODE\n" + node_rows(NODES) + "*ELEMENT, TYPE=C3D8, ELSET=low\n1, 1, 2, 3, 4, 5, 6, 7, 8\n"
HIGH = (
    "*NODE\n"
    + node_rows(NODES + np.array([0.0, 0.0, 10.0]), 11)
    + "*ELEMENT, TYPE=C3D8, ELSET=high\n2, 11, 12, 13, 14, 15, 16, 17, 18\n"
)
SECTIONS = "*SOLID SECTION, ELSET=low, MATERIAL=steel\n*SOLID SECTION, ELSET=high, MATERIAL=steel\n"
BASE = "*NSET, NSET=base\n1, 2, 3, 4\n"
SURFACES = "*SURFACE, NAME=over\n1, S2\n*SURFACE, NAME=under\n2, S1\n"
TWO = LOW + HIGH + BASE + SURFACES + STEEL + SECTIONS


def content_of(folder: Path, text: str, **files: str) -> MeshContent:
    (folder / "deck.inp").write_text(text)
    for name, other in files.items():
        (folder / f"{name}.txt").write_text(other)
    return read_content(folder / "deck.inp")


def volume(content: MeshContent, group: str | None = None) -> float:
    points = Elements(mesh_of(content, "deck.inp", group)).points()
    return float(sum(p.volumes.sum() for _, p in points))


def scene_of(folder: Path, text: str, **tables: Any) -> Scene:
    """The scene of a deck in mm, t, s with these tables; keys of [mesh.deck] in ``mesh``."""
    (folder / "deck.inp").write_text(text)
    mesh = {"file": "deck.inp", "scale": 1e-3, **tables.pop("mesh", {})}
    time = {"end": 2e-6, "step": 0.5e-6}
    return scene_from_dict({"name": "t", "mesh": {"deck": mesh}, "time": time, **tables}, folder)


def remarks_of(scene: Scene) -> str:
    return "\n".join(remark for remark in discretise(scene).remarks if remark.code == "deck")


# -- coordinates -------------------------------------------------------------------------------------------------------
SECTOR = 0.5 * (30.0**2 - 20.0**2) * np.sin(np.radians(30.0)) * 10.0  # of straight edges over 30 degrees, mm3
CYLINDRICAL = [(20, 0, 0), (30, 0, 0), (30, 30, 0), (20, 30, 0), (20, 0, 10), (30, 0, 10), (30, 30, 10), (20, 30, 10)]


@pytest.mark.parametrize(
    "system",
    ["", "*SYSTEM\n1., 2., 3.\n", "*SYSTEM\n1., 2., 3., 1., 2., 4.\n1., 3., 3.\n", "*SYSTEM\n0., 0., 0., 3., 4., 9.\n"],
)
def test_nodes_in_cylindrical_coordinates(tmp_path: Path, system: str) -> None:
    """Also where the system is moved and turned: the volume of the sector stays."""
    text = f"{system}*NODE, SYSTEM=C\n{node_rows(np.array(CYLINDRICAL, dtype=float))}"
    content = content_of(tmp_path, text + "*ELEMENT, TYPE=C3D8\n1, 1, 2, 3, 4, 5, 6, 7, 8\n")
    assert volume(content) == pytest.approx(SECTOR, rel=1e-12)


def test_a_system_places_the_nodes_after_it(tmp_path: Path) -> None:
    """Origin (1, 2, 3), x along the z axis, y along the y axis; an empty *SYSTEM ends it."""
    text = "*SYSTEM\n1., 2., 3., 1., 2., 9.\n1., 8., 3.\n*NODE\n1, 10., 20., 30.\n*SYSTEM\n*NODE\n2, 10., 20., 30.\n"
    content = content_of(tmp_path, text)
    np.testing.assert_allclose(content.points, [[1 - 30, 2 + 20, 3 + 10], [10, 20, 30]], atol=1e-12)


def test_spherical_coordinates_and_bad_systems_are_refused(tmp_path: Path) -> None:
    for text in ("*NODE, SYSTEM=S\n1, 1., 2., 3.\n", "*SYSTEM\n0., 0., 0., 1., 0., 0.\n2., 0., 0.\n"):
        with pytest.raises(MeshError, match=r"line 1: (coordinates of nodes are not read so|not a coordinate system)"):
            content_of(tmp_path, text)


# -- keywords that make nodes and elements -----------------------------------------------------------------------------
def test_elgen_repeats_an_element(tmp_path: Path) -> None:
    """Two more layers of nodes, and a block of three elements in a row, set included."""
    tall = "".join(node_rows(NODES[4:] + np.array([0.0, 0.0, 10.0 * i]), 5 + 4 * i) for i in (1, 2))
    text = f"{LOW}*NODE\n{tall}*ELGEN, ELSET=all\n1, 3, 4, 10\n"
    content = content_of(tmp_path, text)
    assert volume(content, "all") == pytest.approx(3000.0)
    assert volume(content, "low") == pytest.approx(1000.0)


def test_a_bar_made_of_its_corners(tmp_path: Path) -> None:
    """*NGEN along edges, *NFILL between them, *ELGEN in two directions, *NCOPY and *ELCOPY of the lot, turned."""
    text = "*NODE\n1, 0., 0., 0.\n5, 4., 0., 0.\n21, 0., 2., 0.\n25, 4., 2., 0.\n"
    text += "*NGEN, NSET=front\n1, 5\n*NGEN, NSET=back\n21, 25, 1\n*NFILL, NSET=floor\nfront, back, 2, 10\n"
    text += "*NCOPY, CHANGE NUMBER=100, OLD SET=floor, SHIFT, NEW SET=roof\n0., 0., 1.\n\n"
    text += "*ELEMENT, TYPE=C3D8, ELSET=one\n1, 1, 2, 12, 11, 101, 102, 112, 111\n"
    text += "*ELGEN, ELSET=slab\n1, 4, 1, 1, 2, 10, 10\n"
    text += "*NSET, NSET=every\nfloor, roof\n*NCOPY, CHANGE NUMBER=1000, OLD SET=every, SHIFT\n10.,\n"
    text += "0., 0., 0., 0., 0., 1., 90.\n"
    text += "*ELCOPY, ELEMENT SHIFT=500, OLD SET=slab, SHIFT NODES=1000, NEW SET=copy\n"
    content = content_of(tmp_path, text)
    assert len(content.points) == 60
    assert volume(content, "slab") == pytest.approx(8.0)
    assert volume(content, "copy") == pytest.approx(8.0)
    copy = mesh_of(content, "deck.inp", "copy").nodes
    # moved by 10 along x, then turned by 90 degrees about z
    np.testing.assert_allclose([copy.min(axis=0), copy.max(axis=0)], [[-2, 10, 0], [0, 14, 1]], atol=1e-12)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("*NGEN, LINE=C\n1, 8\n", "LINE=C"),
        ("*NGEN\n1, 8, 2\n", "does not lead"),
        ("*NGEN\n1, 99\n", "no node 99"),
        ("*NFILL\nbase, none, 2, 10\n", "4 and 0 nodes"),
        ("*NSET, NSET=odd, UNSORTED\n4, 1, 3, 2\n*NFILL\nbase, odd, 2, 10\n", "UNSORTED"),
        ("*NFILL, BIAS=1.5\nbase, base, 2, 10\n", "even intervals"),
        ("*NCOPY, CHANGE NUMBER=9, OLD SET=base, REFLECT=LINE\n0., 0., 0.\n", "neither REFLECT"),
        ("*ELGEN\n7, 2, 4\n", "no element 7"),
        ("*ELGEN\n1, x\n", "not numbers"),
        ("*ELCOPY, OLD SET=low\n", "parameter is missing"),
    ],
)
def test_what_cannot_be_made_is_refused_with_the_line(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(MeshError, match=r"deck.inp, line \d+") as caught:
        content_of(tmp_path, LOW + BASE + text)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    "card", ["*NMAP, NSET=base\n", "*IMPERFECTION, FILE=a, STEP=1\n", "*MODEL CHANGE, TYPE=ELEMENT, REMOVE\nhigh\n"]
)
def test_keywords_that_change_the_mesh_are_refused_unless_ignored(tmp_path: Path, card: str) -> None:
    word = card[1:].split(",")[0]
    with pytest.raises(LatinError, match=word) as caught:
        scene_of(tmp_path, TWO + card)
    assert "ignore" in str(caught.value)
    assert list(scene_of(tmp_path, TWO + card, mesh={"ignore": [word]}).substructure) == ["low", "high"]


def test_a_beam_with_preload_is_refused_by_name(tmp_path: Path) -> None:
    card = "*PRE-TENSION SECTION, ELEMENT=7, NODE=9\n0., 0., 1.\n"
    with pytest.raises(LatinError, match=r"PRE-TENSION SECTION.*\[bolt.NAME\]"):
        scene_of(tmp_path, TWO + card)


# -- other files -------------------------------------------------------------------------------------------------------
def test_data_lines_of_other_files(tmp_path: Path) -> None:
    """INPUT= of *ELEMENT and *NODE, and an *INCLUDE in the middle of data lines."""
    row = "2, 11, 12, 13, 14, 15, 16, 17, 18\n"
    for text in (
        TWO.replace(f"ELSET=high\n{row}", "ELSET=high, INPUT=rows.txt\n"),
        TWO.replace(f"ELSET=high\n{row}", "ELSET=high\n*INCLUDE, INPUT=rows.txt\n"),
    ):
        assert text != TWO
        content = content_of(tmp_path, text, rows=row)
        assert volume(content, "high") == pytest.approx(1000.0)
        # files that an FMU has to take along
        assert included_files(tmp_path / "deck.inp") == ["rows.txt"]
    nodes = node_rows(NODES)
    content = content_of(tmp_path, LOW.replace(f"*NODE\n{nodes}", "*NODE, INPUT=rows.txt\n"), rows=nodes)
    assert volume(content) == pytest.approx(1000.0)


def test_problems_of_included_data_lines_have_their_place(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match=r"deck.inp, in rows.txt, line 2: not a node"):
        content_of(tmp_path, "*NODE\n1, 0., 0., 0.\n*INCLUDE, INPUT=rows.txt\n", rows="2, 1., 0., 0.\n3, x\n")
    with pytest.raises(MeshError, match="holds a keyword"):
        content_of(tmp_path, "*NODE, INPUT=rows.txt\n", rows="*ELEMENT\n")
    with pytest.raises(MeshError, match=r"none.txt"):
        content_of(tmp_path, "*NODE, INPUT=none.txt\n")


# -- elements ----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("kind", ["COH3D8", "AC3D8", "DC3D8", "EC3D8R", "CCL12", "SC8R", "C3D7"])
def test_solids_of_other_kinds_are_refused_unless_ignored(tmp_path: Path, kind: str) -> None:
    text = TWO + f"*ELEMENT, TYPE={kind}, ELSET=glue\n3, 5, 6, 7, 8, 11, 12, 13, 14\n"
    with pytest.raises(LatinError, match=kind) as caught:
        scene_of(tmp_path, text)
    assert f'ignore = ["{kind}"]' in str(caught.value)
    scene = scene_of(tmp_path, text, mesh={"ignore": [kind]})
    assert f"1 {kind} (glue) is not used" in remarks_of(scene)


def test_unknown_elements_of_their_own_are_refused(tmp_path: Path) -> None:
    """Most of their nodes are in no cell; those between cells are named."""
    with pytest.raises(MeshError, match="WHAT3"):
        content_of(
            tmp_path, LOW + "*NODE\n50, 0., 0., 99.\n51, 0., 0., 98.\n*ELEMENT, TYPE=WHAT3\n9, 1, 50, 51\n"
        ).refuse()
    content = content_of(tmp_path, LOW + "*ELEMENT, TYPE=WHAT2\n9, 1, 2\n10, 1, 3\n")
    content.refuse()
    assert content.skipped == {"WHAT2": 2}


@pytest.mark.parametrize("kind", ["S4R5", "S8R5", "S9R5", "S4", "M3D4R", "CPS4"])
def test_shells_are_faces(tmp_path: Path, kind: str) -> None:
    """The middle nodes of a face of shells do not count."""
    count = int(kind.strip("SRCPMD")[0]) if kind.startswith("S") else 4
    middles = [41, 42, 43, 44, 45][: count - 4]
    text = LOW + "*NODE\n" + "".join(f"{n}, 5., 5., 0.\n" for n in middles)
    text += f"*ELEMENT, TYPE={kind}, ELSET=face\n9, {', '.join(map(str, [1, 2, 3, 4, *middles]))}\n"
    assert mesh_of(content_of(tmp_path, text), "deck.inp", "low").faces["face"].n_facet == 1


def test_nodes_of_an_element_set(tmp_path: Path) -> None:
    content = content_of(
        tmp_path, TWO + "*ELSET, ELSET=both\nlow, high\n*NSET, NSET=some, ELSET=low\n*NSET, NSET=all, ELSET=both\n"
    )
    np.testing.assert_array_equal(content.node_sets["some"], np.arange(8))
    np.testing.assert_array_equal(content.node_sets["all"], np.arange(16))


def test_a_deck_of_cgx_under_the_suffix_of_gmsh(tmp_path: Path) -> None:
    (tmp_path / "all.msh").write_text("*NODE, NSET=Nall\n" + LOW.partition("\n")[2])
    assert volume(read_content(tmp_path / "all.msh")) == pytest.approx(1000.0)


def test_an_element_that_is_too_long_is_no_other_one(tmp_path: Path) -> None:
    """Seven elements of eight numbers are no eight elements of seven."""
    rows = element_rows(np.tile(np.arange(7), (7, 1)))
    with pytest.raises(MeshError, match="a label and 6 nodes each"):
        content_of(tmp_path, "*NODE\n" + node_rows(NODES) + "*ELEMENT, TYPE=C3D6\n" + rows)


# -- supports ----------------------------------------------------------------------------------------------------------
def supports_of(scene: Scene) -> dict[str, tuple[str, ...]]:
    return {b.face: b.components for b in scene.boundary.values()}


def test_supports_of_a_preprocessor(tmp_path: Path) -> None:
    """Hidden sets, words of symmetry, sets of sets; two lines on one set are one boundary."""
    text = TWO + "*NSET, NSET=_PickedSet4, INTERNAL\n1, 2, 3, 4\n*NSET, NSET=left\n1, 4\n*NSET, NSET=side\nleft, 5, 8\n"
    text += "*NSET, NSET=front\n1, 2, 5, 6\n"
    text += "*BOUNDARY\n_PickedSet4, ENCASTRE\nside, XSYMM\nfront, 1, 1\nfront, 2\n"
    scene = scene_of(tmp_path, text)
    expected = {"low._PickedSet4": ("x", "y", "z"), "low.side": ("x",), "low.front": ("x", "y")}
    assert supports_of(scene) == expected
    assert all(name[0].isalpha() for name in scene.boundary)
    assert "BOUNDARY" not in remarks_of(scene)


def test_three_two_one(tmp_path: Path) -> None:
    """Edges, points and nodes by number hold: six unknowns of the block are gone, and no more."""
    text = TWO + "*NSET, NSET=edge\n1, 2\n*BOUNDARY\nedge, 3\nedge, 2\n4, 3\n1, 1\n"
    scene = scene_of(tmp_path, text)
    assert supports_of(scene) == {"low.edge": ("y", "z"), "low.NODE_4": ("z",), "low.NODE_1": ("x",)}
    assert discretise(scene).conditions["low"].held.sum() == 6
    assert "BOUNDARY" not in remarks_of(scene)


def test_an_edge_has_no_area(tmp_path: Path) -> None:
    text = TWO + "*NSET, NSET=edge\n1, 2\n"
    load = {"press": {"face": "low.edge", "pressure": 1.0}}
    with pytest.raises(LatinError, match="an edge or a point and has no area"):
        discretise(scene_of(tmp_path, text, load=load))
    scene = scene_of(tmp_path, text, boundary={"hinge": {"type": "fixed", "face": "low.edge"}})
    assert discretise(scene).conditions["low"].held.sum() == 6


def test_a_refined_edge_is_held_between_its_nodes(tmp_path: Path) -> None:
    content = content_of(tmp_path, LOW + "*NSET, NSET=edge\n1, 2\n*NSET, NSET=point\n7\n")
    fine = refined(mesh_of(content, "deck.inp"))
    nodes = fine.nodes[fine.points["edge"]]
    np.testing.assert_allclose(nodes[np.argsort(nodes[:, 0])], [[0, 0, 0], [5, 0, 0], [10, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(fine.nodes[fine.points["point"]], [[10, 10, 10]])


def test_all_nodes_of_a_set_are_held(tmp_path: Path) -> None:
    """A set of a face and one node more."""
    scene = scene_of(tmp_path, TWO + "*NSET, NSET=more\n1, 2, 3, 4, 7\n*BOUNDARY\nmore, 1, 3\n")
    assert discretise(scene).conditions["low"].held.sum() == 15


STEPS = "*STEP\n*STATIC\n*BOUNDARY\nbase, 1, 3, 0.\n*END STEP\n*STEP\n*DYNAMIC\n*BOUNDARY{}\n*END STEP\n"


def test_supports_are_those_of_the_last_step(tmp_path: Path) -> None:
    """OP=NEW releases what was held before it, a motion of a later step what it moves."""
    assert supports_of(scene_of(tmp_path, TWO + STEPS.format("\nbase, 1, 1"))) == {"low.base": ("x", "y", "z")}
    scene = scene_of(tmp_path, TWO + STEPS.format(", OP=NEW"))
    assert not scene.boundary
    assert "released by OP=NEW in line" in remarks_of(scene)
    assert supports_of(scene_of(tmp_path, TWO + STEPS.format(", OP=NEW\nbase, 3"))) == {"low.base": ("z",)}
    scene = scene_of(tmp_path, TWO + STEPS.format("\nbase, 3, 3, 0.1"))
    assert supports_of(scene) == {"low.base": ("x", "y")}
    assert "moved by that of line" in remarks_of(scene)


def test_supports_along_axes_of_a_transformation(tmp_path: Path) -> None:
    """Along straight axes: those of the boundary; along others, not taken, and said."""
    straight = "*TRANSFORM, NSET=base, TYPE=R\n0., 1., 0., -1., 0., 0.\n*BOUNDARY\nbase, 1\n"
    (boundary,) = scene_of(tmp_path, TWO + straight).boundary.values()
    assert boundary.axes is not None
    assert boundary.axes.x == (0.0, 1.0, 0.0)
    round_ = "*TRANSFORM, NSET=base, TYPE=C\n0., 0., 0., 0., 0., 1.\n*BOUNDARY\nbase, 1\n"
    scene = scene_of(tmp_path, TWO + round_)
    assert not scene.boundary
    assert "axes of *TRANSFORM" in remarks_of(scene)
    assert supports_of(scene_of(tmp_path, TWO + round_.replace("base, 1\n", "base, 1, 3\n")))


# -- materials, pairs of surfaces, rigid bodies ------------------------------------------------------------------------
def test_the_scene_completes_a_material_of_the_deck(tmp_path: Path) -> None:
    text = TWO.replace("*DENSITY\n7.8e-9\n", "")
    with pytest.raises(LatinError, match=r"material.STEEL: the material STEEL of the deck lacks density") as caught:
        scene_of(tmp_path, text)
    assert str(caught.value).count("\n") == 1
    scene = scene_of(tmp_path, text, material={"steel": {"density": 7800.0}})
    assert scene.substructure["low"].material == "steel"
    assert scene.material["steel"].young_modulus == pytest.approx(210e9)
    assert scene.material["steel"].density == 7800.0


def test_a_tie_over_a_gap_reaches_as_far_as_its_tolerance(tmp_path: Path) -> None:
    tie = "*TIE, NAME=glue, POSITION TOLERANCE=0.1\nunder, over\n"
    assert scene_of(tmp_path, TWO + tie).interface["glue"].search == pytest.approx(1e-4)
    assert scene_of(tmp_path, TWO + "*TIE, NAME=glue\nunder, over\n").interface["glue"].search is None


def test_a_clearance_is_the_gap_of_the_interface(tmp_path: Path) -> None:
    text = TWO + "*CLEARANCE, SLAVE=under, MASTER=over, VALUE=0.02\n"
    joint = {"sides": ["low.over", "high.under"], "friction_coefficient": 0.2}
    assert scene_of(tmp_path, text, interface={"joint": joint}).interface["joint"].gap == pytest.approx(2e-5)
    closed = {**joint, "gap": "closed"}
    assert scene_of(tmp_path, text, interface={"joint": closed}).interface["joint"].gap == "closed"


def test_a_pair_that_is_adjusted_is_named_with_what_to_write(tmp_path: Path) -> None:
    remarks = remarks_of(scene_of(tmp_path, TWO + "*CONTACT PAIR, INTERACTION=i, ADJUST=0.1\nunder, over\n"))
    assert '*CONTACT PAIR under, over (ADJUST=0.1: gap = "closed" of the interface) is not used' in remarks


def test_two_bodies_in_one_part_with_a_contact_between_them(tmp_path: Path) -> None:
    """Each is a part; without the contact the deck has one part in two pieces."""
    rest = "*ELSET, ELSET=both\nlow, high\n*SOLID SECTION, ELSET=both, MATERIAL=steel\n"
    text = LOW + HIGH + SURFACES + STEEL + rest
    assert list(scene_of(tmp_path, text).substructure) == ["both"]
    scene = scene_of(tmp_path, text + "*CONTACT PAIR, INTERACTION=i\nunder, over\n")
    assert list(scene.substructure) == ["both_1", "both_2"]
    assert scene.substructure["both_1"].material == "STEEL"
    remarks = remarks_of(scene)
    assert "the part both holds 2 bodies with a contact or tie between them: both_1, both_2" in remarks
    tied = scene_of(tmp_path, text + "*TIE, NAME=glue\nunder, over\n")
    assert tied.interface["glue"].sides == ("both_2.under", "both_1.over")


def test_rigid_bodies(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, TWO + "*RIGID BODY, ELSET=high, REF NODE=11\n")
    assert [body.rigid for body in scene.substructure.values()] == [False, True]
    assert "RIGID BODY" not in remarks_of(scene)
    tool = "*NODE\n50, 0., 0., 99.\n51, 9., 0., 99.\n52, 0., 9., 99.\n*ELEMENT, TYPE=R3D3, ELSET=tool\n9, 50, 51, 52\n"
    remarks = remarks_of(scene_of(tmp_path, TWO + tool + "*RIGID BODY, ELSET=tool, REF NODE=50\n"))
    assert "*RIGID BODY TOOL" in remarks
    assert "1 surface cell lies on no solid and is not used (tool: 1)" in remarks


def test_cells_of_no_part_are_named(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, TWO, mesh={"parts": ["low"]})
    assert "1 solid cell (high) belongs to no part of the scene" in remarks_of(scene)


def test_a_middle_node_that_is_0(tmp_path: Path) -> None:
    """It is put in the middle of its edge."""
    points = np.array(
        [[0, 0, 0], [6, 0, 0], [0, 6, 0], [0, 0, 6], [3, 0, 0], [3, 3, 0], [0, 3, 0], [0, 0, 3], [3, 0, 3]]
    )
    text = "*NODE\n" + node_rows(points.astype(float)) + "*ELEMENT, TYPE=C3D10\n1, 1, 2, 3, 4, 5, 6, 7, 8, 9, 0\n"
    content = content_of(tmp_path, text)
    np.testing.assert_allclose(content.points[content.solids["tetra10"][0, 9]], [0, 3, 3])
    assert volume(content) == pytest.approx(36.0)
    assert content.said == ["1 middle node that the file leaves out was put in the middle of the edge"]
    assert read_mesh(tmp_path / "deck.inp").n_node == 10


def test_what_calculix_reads_of_other_decks(tmp_path: Path) -> None:
    """Sets of elements that are not read, names of instances in a deck without any, supports of nodes that are not
    there."""
    text = TWO + "*NODE\n50, 0., 0., 99.\n*ELEMENT, TYPE=B31, ELSET=links\n9, 1, 50\n*ELSET, ELSET=all\nlinks, low\n"
    text += "*NSET, NSET=some, INSTANCE=PART-1-1\n1, 2, 3\n*BOUNDARY\n999, 1, 3\n"
    scene = scene_of(tmp_path, text)
    assert not scene.boundary
    remarks = remarks_of(scene)
    assert "*BOUNDARY 999 (it holds no node of a part)" in remarks
    assert "1 B31 (links) is not used: write [spring.NAME]" in remarks


def test_nodes_held_by_their_numbers_are_points_of_their_names(tmp_path: Path) -> None:
    """Numbers in any order, one of them twice and one that is not there; a set of three nodes is a facet."""
    text = "*NODE\n30, 1., 0., 0.\n10, 0., 0., 0.\n7, 0., 1., 0.\n21, 0., 0., 1.\n"
    text += "*ELEMENT, TYPE=C3D4, ELSET=A\n5, 10, 30, 7, 21\n"
    text += "*NSET, NSET=LOW\n30, 10, 7\n*BOUNDARY\nLOW, 3, 3\n21, 1, 1\n30, 2, 3\n99, 1, 3\n21, 2, 2\n7, 1, 1\n"
    (tmp_path / "deck.inp").write_text(text)
    content = read_content(tmp_path / "deck.inp")
    held = {name: content.labels[rows].tolist() for name, rows in content.node_sets.items() if name.startswith("NODE_")}
    assert held == {"NODE_21": [21], "NODE_30": [30], "NODE_99": [], "NODE_7": [7]}
    mesh = mesh_of(content, "deck.inp")
    assert list(mesh.faces) == ["LOW"]
    assert {name: mesh.nodes[rows].tolist() for name, rows in mesh.points.items()} == {
        "NODE_21": [[0.0, 0.0, 1.0]],
        "NODE_30": [[1.0, 0.0, 0.0]],
        "NODE_7": [[0.0, 1.0, 0.0]],
    }
