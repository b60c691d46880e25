"""What the entries of Nastran decks say of nodes and elements, and what becomes of those that are not read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from latin_fmu.building import discretise
from latin_fmu.errors import LatinError, MeshError
from latin_fmu.fem.elements import Elements
from latin_fmu.fem.mesh import box_mesh
from latin_fmu.fem.mesh_file import mesh_of
from latin_fmu.fem.reference_cells import CELL_EDGES, cell_functions
from latin_fmu.mesh_files.content import MeshContent
from latin_fmu.mesh_files.middle_nodes import ORDERS
from latin_fmu.mesh_files.reading import included_files, read_content
from latin_fmu.reader import scene_from_dict
from latin_fmu.scene.schema import Scene

CUBE = box_mesh(np.zeros(3), np.full(3, 10.0), (1, 1, 1))
NODES = CUBE.nodes[CUBE.blocks[0].cells[0]]  # in the order of the corners of a CHEXA
BLOCK = "CHEXA,1,1,1,2,3,4,5,6\n,7,8\n"


def grids(nodes: np.ndarray, first: int = 1, system: str = "") -> str:
    return "".join(f"GRID,{i},{system},{x!r},{y!r},{z!r}\n" for i, (x, y, z) in enumerate(nodes.tolist(), first))


def content_of(folder: Path, text: str, name: str = "deck.bdf") -> MeshContent:
    (folder / name).write_text(text)
    return read_content(folder / name)


def volume(content: MeshContent, group: str | None = None) -> float:
    points = Elements(mesh_of(content, "deck.bdf", group)).points()
    return float(sum(p.volumes.sum() for _, p in points))


def scene_of(folder: Path, text: str, **tables: Any) -> Scene:
    """The scene of a deck in mm, t, s of steel; keys of [mesh.deck] in ``mesh``."""
    (folder / "deck.bdf").write_text(text)
    mesh = {"file": "deck.bdf", "scale": 1e-3, "material": "steel", **tables.pop("mesh", {})}
    steel = {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}
    whole = {"name": "t", "material": {"steel": steel}, "mesh": {"deck": mesh}, "time": {"end": 2e-6, "step": 0.5e-6}}
    return scene_from_dict({**whole, **tables}, folder)


def remarks_of(scene: Scene) -> str:
    return "\n".join(remark for remark in discretise(scene).remarks if remark.code == "deck")


def refused(folder: Path, text: str, *words: str) -> None:
    with pytest.raises(MeshError) as caught:
        content_of(folder, text).refuse()
    for word in words:
        assert word in str(caught.value), str(caught.value)


# -- coordinate systems ------------------------------------------------------------------------------------------------
SECTOR = 0.5 * (30.0**2 - 20.0**2) * np.sin(np.radians(30.0)) * 10.0  # of straight edges over 30 degrees
CYLINDRICAL = np.array(
    [(20, 0, 0), (30, 0, 0), (30, 30, 0), (20, 30, 0), (20, 0, 10), (30, 0, 10), (30, 30, 10), (20, 30, 10)],
    dtype=float,
)
UPRIGHT = "CORD2C,1,,0.,0.,0.,0.,0.,1.\n,1.,0.,0.\n"


def test_nodes_in_cylindrical_coordinates(tmp_path: Path) -> None:
    """By CP, by GRDSET, in a system placed in another one, by three nodes; CP = 0 stays basic under GRDSET."""
    for text in (
        UPRIGHT + grids(CYLINDRICAL, system="1"),
        "GRDSET,,1\n" + UPRIGHT + grids(CYLINDRICAL),
        "CORD2R,7,,5.,5.,5.,5.,9.,5.\n,5.,5.,8.\nCORD2C,1,7,1.,0.,0.,1.,2.,3.\n,9.,0.,0.\n"
        + grids(CYLINDRICAL, system="1"),
        "CORD1C,3,91,92,93,1,91,92,94\nGRID,91,,4.,4.,4.\nGRID,92,,4.,4.,9.\nGRID,93,,7.,4.,4.\nGRID,94,,4.,7.,4.\n"
        + grids(CYLINDRICAL, system="1"),
    ):
        assert volume(content_of(tmp_path, text + BLOCK)) == pytest.approx(SECTOR, rel=1e-12)
    content = content_of(tmp_path, "GRDSET,,1\n" + UPRIGHT + grids(NODES, system="0") + BLOCK)
    assert volume(content) == pytest.approx(1000.0)


def test_a_spherical_system(tmp_path: Path) -> None:
    """r, angle from the z axis, angle about it: z axis along x, x axis along y, so that y is along z; by hand."""
    system = "CORD2S,4,,1.,0.,0.,2.,0.,0.\n,1.,1.,0.\n"
    content = content_of(tmp_path, system + "GRID,1,4,2.,30.,60.\n")
    across = 2.0 * np.sin(np.radians(30.0))
    place = [1.0 + 2.0 * np.cos(np.radians(30.0)), across * 0.5, across * np.sin(np.radians(60.0))]
    np.testing.assert_allclose(content.points, [place], atol=1e-14)


def test_systems_that_cannot_be_had(tmp_path: Path) -> None:
    around = "CORD2R,1,2,0.,0.,0.,0.,0.,1.\n,1.,0.,0.\nCORD2R,2,1,0.,0.,0.,0.,0.,1.\n,1.,0.,0.\n"
    refused(tmp_path, around + "GRID,1,1,0.,0.,0.\n", "depends on itself")
    refused(tmp_path, "GRID,1,9,0.,0.,0.\n", "no coordinate system of this label", "line 1")
    refused(tmp_path, "CORD2R,1,,0.,0.,0.,0.,0.,1.\n,0.,0.,2.\nGRID,1,1,0.,0.,0.\n", "on one line", "line 1")
    refused(tmp_path, "CORD1R,1,5,6,7\nGRID,1,1,0.,0.,0.\n", "node that no GRID has")


# -- labels, copies, continuation --------------------------------------------------------------------------------------
def test_labels_given_twice(tmp_path: Path) -> None:
    """Equal nodes may stand twice, as in Nastran; different ones, and elements, may not."""
    text = grids(NODES) + BLOCK
    assert volume(content_of(tmp_path, text + grids(NODES[7:], 8))) == pytest.approx(1000.0)
    refused(tmp_path, text + "GRID,8,,0.,10.,20.\n", "two nodes have the same label", "line 8", "GRID 8")
    refused(tmp_path, text + "CTETRA,1,1,1,2,3,5\n", "two elements have the same label", "line 9", "CTETRA 1")


def test_entries_that_make_others_are_refused(tmp_path: Path) -> None:
    refused(tmp_path, "GRID,1,,0.,0.,0.\n=,*1,=,*1.,==\n", "made of the one before it", "line 2")
    refused(tmp_path, "BEGIN BULK\nGRID,1,,0.,0.,0.\nBEGIN SUPER=2\n", "superelements", "line 3")
    refused(tmp_path, grids(NODES) + BLOCK + "CGEN,QUAD4,101,17,19\n", "CGEN", "makes more of the mesh")
    refused(tmp_path, grids(NODES) + BLOCK + "BOLT,1,2,3\n", "BOLT", "[bolt.NAME]")


def test_continuation_lines_are_found_by_their_mark(tmp_path: Path) -> None:
    """A sorted deck has them apart from their entries."""
    text = grids(NODES) + grids(NODES + np.array([20.0, 0.0, 0.0]), 11)
    for label, first in ((1, 1), (2, 11)):
        fields = [f"{n:<8d}" for n in (label, 1, *range(first, first + 6))]
        text += f"CHEXA   {''.join(fields)}+H{label}\n"
    text += "+H1     7       8\n+H2     17      18\n"
    assert volume(content_of(tmp_path, text)) == pytest.approx(2000.0)


@pytest.mark.parametrize("name", ["deck.dat", "deck.nas", "deck.NAS", "deck.bdf", "deck.fem"])
def test_suffixes(tmp_path: Path, name: str) -> None:
    (tmp_path / "nodes.txt").write_text(grids(NODES))
    assert volume(
        content_of(tmp_path, "SOL 101\nCEND\nBEGIN BULK\nINCLUDE 'nodes.txt'\n" + BLOCK, name)
    ) == pytest.approx(1e3)
    assert included_files(tmp_path / name) == ["nodes.txt"]


# -- elements ----------------------------------------------------------------------------------------------------------
def cell_text(name: str, kind: str, order: str) -> str:
    """One quadratic cell of slightly curved edges with its nodes in the order of a program."""
    corners = cell_functions(kind).nodes[: 1 + max(n for edge in CELL_EDGES[kind] for n in edge)]
    nodes = [*corners, *(corners[list(place)].mean(axis=0) for place in ORDERS[order][kind])]
    nodes = np.array(nodes)
    nodes = nodes + 0.03 * np.sin(nodes[:, [1, 2, 0]])
    fields = [str(i) for i in range(1, len(nodes) + 1)]
    text = f"{name},1,1,{','.join(fields[:6])}\n"
    return grids(nodes) + text + "".join(f",{','.join(fields[i : i + 8])}\n" for i in range(6, len(fields), 8))


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        *(("CTETRA", "tetra10"), ("CPYRAM", "pyramid13"), ("CPENTA", "wedge15"), ("CPENTA", "wedge18")),
        *(("CHEXA", "hexahedron20"), ("CHEXA", "hexahedron27")),
    ],
)
def test_quadratic_cells_in_both_orders(tmp_path: Path, name: str, kind: str) -> None:
    """Middle nodes lie near the middle of their edges in the order of Nastran and in that of gmsh, which is said."""
    for order in ("Nastran", "gmsh"):
        content = content_of(tmp_path, cell_text(name, kind, order))
        cell = content.points[content.solids[kind][0]]
        corners = len(cell) - len(ORDERS["Nastran"][kind])
        for i, place in enumerate(CELL_EDGES[kind]):
            assert np.abs(cell[corners + i] - cell[list(place)].mean(axis=0)).max() < 0.05
        assert bool(content.said) == (ORDERS[order][kind] != ORDERS["Nastran"][kind] and order == "gmsh")
        assert volume(content) > 0


def test_a_pyramid_of_13_nodes_is_not_cut_to_five(tmp_path: Path) -> None:
    """Base of side 2 bulged by 0.3 at its middle nodes, height 1: the closed form by the integral of its section."""
    base = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], dtype=float)
    middles = np.array([(0, -1.3, 0), (1.3, 0, 0), (0, 1.3, 0), (-1.3, 0, 0)])
    apex = np.array([[0.0, 0.0, 1.0]])
    nodes = np.concatenate([base, apex, middles, 0.5 * (base + apex)])
    rows = ",".join(map(str, range(1, 7)))
    text = grids(nodes) + f"CPYRAM,1,1,{rows}\n,7,8,9,10,11,12,13\n"
    content = content_of(tmp_path, text)
    # at the height z the section has the width 2 h, h = 1 - z, and each of its sides a parabola of height 0.3 h^2
    # (4 L1 L2 of the triangle), of the area 2/3 x 0.3 h^2 x 2 h; the integral of h^3 is 1/4
    assert volume(content) == pytest.approx(4 / 3 + 4 * (2 / 3) * 0.3 * 2 / 4, rel=1e-12)


def test_middle_nodes_that_are_left_out(tmp_path: Path) -> None:
    """Blank and 0: the node that a neighbour has on that edge, else the middle; without any it is a linear cell."""
    points = np.array(
        [[0, 0, 0], [6, 0, 0], [0, 6, 0], [0, 0, 6], [3, 0, 0], [3, 3, 0], [0, 3, 0], [0, 0, 3], [3, 0, 3]]
    )
    text = grids(points.astype(float))
    content = content_of(tmp_path, text + "CTETRA,1,1,1,2,3,4,5,0\n,7,8,9,\n")
    np.testing.assert_allclose(content.points[content.solids["tetra10"][0, [5, 9]]], [[3, 3, 0], [0, 3, 3]])
    assert volume(content) == pytest.approx(36.0)
    assert content.said == ["2 middle nodes that the file leaves out were put in the middle of the edge"]
    below = "GRID,10,,0.,0.,-6.\nCTETRA,2,1,1,3,2,10,7,6\n,5,,,\n"
    content = content_of(tmp_path, text + below + "CTETRA,1,1,1,2,3,4,5,0\n,7,8,9,\n")
    assert content.solids["tetra10"][1, 5] == 5  # the node of the other cell
    assert mesh_of(content, "deck.bdf").n_cell == 2
    assert list(content_of(tmp_path, text + "CTETRA,1,1,1,2,3,4,,\n,,,,\n").solids) == ["tetra"]


def test_shells_without_middle_nodes_do_not_stop_a_deck(tmp_path: Path) -> None:
    shells = "CQUAD8,9,7,1,2,3,4,,\n,,\nCTRIA6,10,8,5,6,7,,,\nCQUAD9,11,9,1,2,6,5,,\n"
    content = content_of(tmp_path, grids(NODES) + BLOCK + shells)
    mesh = mesh_of(content, "deck.bdf", "PSOLID_1")
    assert mesh.faces["PSHELL_7"].n_facet == 1
    assert mesh.faces["PSHELL_9"].n_facet == 1


def test_solids_without_a_property(tmp_path: Path) -> None:
    """One body for each connected piece, named by its lowest label; a part of 0 is none."""
    text = (
        grids(NODES) + grids(NODES[4:] + np.array([0.0, 0.0, 10.0]), 9) + grids(NODES + np.array([50.0, 0.0, 0.0]), 21)
    )
    text += "CHEXA,5,,1,2,3,4,5,6\n,7,8\nCHEXA,3,,5,6,7,8,9,10\n,11,12\nCHEXA,9,,21,22,23,24,25,26\n,27,28\n"
    content = content_of(tmp_path, text)
    assert {name: sum(map(len, rows.values())) for name, rows in content.volumes.items()} == {
        "PSOLID_3": 2,
        "PSOLID_9": 1,
    }
    assert content.said == ["3 solids without a property are 2 bodies, one for each connected piece"]


def test_pyramids_of_optistruct(tmp_path: Path) -> None:
    text = grids(NODES) + "GRID,9,,5.,5.,16.\n" + BLOCK + "CPYRA,2,1,5,6,7,8,9\n"
    assert volume(content_of(tmp_path, text)) == pytest.approx(1200.0)


@pytest.mark.parametrize("name", ["CHEXAFD", "CIHEX2", "CHACAB", "CHEXCZ", "CGASK8"])
def test_solids_of_other_kinds_are_refused_unless_ignored(tmp_path: Path, name: str) -> None:
    text = grids(NODES) + BLOCK + f"{name},2,1,1,2,3,4,5,6\n,7,8\n"
    with pytest.raises(LatinError, match=name) as caught:
        scene_of(tmp_path, text)
    assert f'ignore = ["{name}"]' in str(caught.value)
    assert f"1 {name} is not used" in remarks_of(scene_of(tmp_path, text, mesh={"ignore": [name]}))


def test_unknown_elements(tmp_path: Path) -> None:
    """Refused where most of their nodes are in no cell, else named; entries without nodes are no elements."""
    apart = "GRID,91,,0.,0.,90.\nGRID,92,,0.,0.,91.\nGRID,93,,0.,0.,92.\nCWHAT,7,1,91,92,93\n"
    refused(tmp_path, grids(NODES) + BLOCK + apart, "CWHAT", "ignore")
    content = content_of(tmp_path, grids(NODES) + BLOCK + "CWHAT,7,1,1,2,3\nCMETHOD,5\n")
    content.refuse()
    assert content.skipped == {"CWHAT": 1}


# -- what a deck holds beside solids -----------------------------------------------------------------------------------
PLATE = (
    grids(NODES)
    + BLOCK
    + grids(NODES[:4] + np.array([0.0, 0.0, 20.0]), 101)
    + "CQUAD4,50,7,101,102,103,104\nCBAR,60,8,5,101,1.,0.,0.\nCBAR,61,9,7,103,1.,0.,0.\n"
    + "CONM2,70,101,,1.0-3\nRBE2,80,101,123456,102,103,104\n"
)
SPIDER = (
    grids(NODES)
    + BLOCK
    + "GRID,100,,5.,5.,30.\nCONM2,70,100,,2.0-3,0.,0.,1.\n,8.0-2,,9.0-2,,,7.0-2\nCONM2,71,7,,3.0-3\n"
)


def test_everything_that_is_not_used_is_named_once(tmp_path: Path) -> None:
    remarks = remarks_of(scene_of(tmp_path, PLATE))
    assert "2 CBAR (properties 8, 9) are not used: write [spring.NAME], for a screw [bolt.NAME]" in remarks
    assert '1 CONM2 is not used: write [point_mass.NAME], or take = ["CONM2"]' in remarks
    assert "1 RBE2 is not used: write [coupling.NAME]" in remarks
    assert "1 surface cell lies on no solid and is not used (PSHELL_7: 1): for a plate mesh it with solids" in remarks
    assert len(remarks.splitlines()) == 4


@pytest.mark.parametrize(
    ("spider", "word"), [("RBE2,80,100,123456,5,6,7,8\n", "RBE2"), ("RBE3,80,,100,123456,1.,123,5,6\n,7,8\n", "RBE3")]
)
def test_masses_and_spiders_are_taken(tmp_path: Path, spider: str, word: str) -> None:
    """The mass above the block moves with its upper face; an RBE2 makes the face rigid, an RBE3 does not."""
    scene = scene_of(tmp_path, SPIDER + spider, mesh={"take": ["CONM2", word]})
    above, corner = scene.point_mass["CONM2_70"], scene.point_mass["CONM2_71"]
    assert above.face == f"PSOLID_1.{word}_80"
    assert above.point == pytest.approx((5e-3, 5e-3, 31e-3))
    assert above.mass == pytest.approx(2.0)
    assert above.inertia == pytest.approx((8e-5, 9e-5, 7e-5))
    assert (corner.substructure, corner.mass) == ("PSOLID_1", pytest.approx(3.0))
    assert corner.point == pytest.approx((10e-3, 10e-3, 10e-3))
    assert [c.rigid for c in scene.coupling.values()] == ([True] if word == "RBE2" else [])
    problem = discretise(scene)
    assert problem.bodies["PSOLID_1"].rigid_motions.mass[0, 0] == pytest.approx(5.0078)
    assert "is not used" not in remarks_of(scene)


def test_a_spider_between_two_parts(tmp_path: Path) -> None:
    """Legs on both: their faces are coupled, and move as rigid bodies."""
    text = (
        grids(NODES) + BLOCK + grids(NODES + np.array([0.0, 0.0, 20.0]), 11) + "CHEXA,2,2,11,12,13,14,15,16\n,17,18\n"
    )
    text += "GRID,100,,5.,5.,15.\nRBE2,80,100,123456,5,6,7,8,11\n,12,13,14\n"
    (coupling,) = scene_of(tmp_path, text, mesh={"take": ["RBE2"]}).coupling.values()
    assert [end.face for end in coupling.ends] == ["PSOLID_1.RBE2_80", "PSOLID_2.RBE2_80"]
    assert coupling.rigid


@pytest.mark.parametrize(
    ("text", "take", "words"),
    [
        (PLATE, ["CONM2"], "CONM2_70 is at a node of no part"),
        (SPIDER.replace("CONM2,71,7,,", "CONM2,71,999,,"), ["CONM2"], "not usable .*line 14: no GRID 999"),
        (PLATE, ["RBE2"], "the legs of RBE2_80 end at no face of a part"),
        (
            SPIDER.replace("CONM2,71,7,,3.0-3", "CONM2,71,7,,3.0-3,1.,0.,0."),
            ["CONM2"],
            "an offset from a node of solids",
        ),
        (SPIDER, ["RBE2"], "the file has no such entry .value: RBE2"),
        (SPIDER + "RBE2,80,100,3,5,6,7,8\n", ["RBE2"], "joins the components 3 alone"),
    ],
)
def test_what_cannot_be_taken(tmp_path: Path, text: str, take: list[str], words: str) -> None:
    with pytest.raises(LatinError, match=words):
        scene_of(tmp_path, text, mesh={"take": take})
