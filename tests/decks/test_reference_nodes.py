"""Reference nodes and equations of decks beside CalculiX 2.20: rigid bodies, couplings, nodes that move as one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import latin_fmu
from latin_fmu.decks.printed import printed_blocks
from latin_fmu.errors import InputError

from .beside import displacements
from .blocks import HELD, STEEL, block, one_block, static
from .test_computed import BAR, dynamic, imported

REF = "*NODE, NSET=REF\n9001, 3., 2., 50.\n*NODE, NSET=ROT\n9002, 3., 2., 50.\n"
RIGID = "*RIGID BODY, NSET=TOP, REF NODE=9001, ROT NODE=9002\n"
COUPLED = "*COUPLING, REF NODE=9001, SURFACE=UP, CONSTRAINT NAME=SPIDER\n"
KINEMATIC = COUPLED + "*KINEMATIC\n1, 3\n"
SPREAD = "*ELEMENT, TYPE=DCOUP3D, ELSET=SPREAD\n99, 9001\n*DISTRIBUTING COUPLING, ELSET=SPREAD\nTOP, 1.\n"
PRINT = "*NODE PRINT, NSET=TOP\nU\n"
BOTH = PRINT + "*NODE PRINT, NSET=REF\nU\n"
# node 9 is a corner of BOTTOM, 37 to 45 are the nodes of TOP, 41 the one in its middle
EQUAL_Z = "*EQUATION\n" + "".join(f"2\n{n}, 3, 1., 41, 3, -1.\n" for n in range(37, 46) if n != 41)
TO_REF = "*EQUATION\n" + "".join(f"2\n{n}, 3, 1., 9001, 3, -1.\n" for n in range(37, 46))


def deck(cards: str, loads: str, held: str = HELD, kind: str = "C3D8") -> str:
    """A bar of 10 x 10 x 40 mm with a node beside it."""
    return one_block(BAR, kind) + REF + STEEL + held + cards + static(loads)


ALONE = "*BOUNDARY\n9001, 1, 2\n"  # what an equation does not join of a node of its own
DECKS = {
    # deck, tolerance
    "rigid body": (deck(RIGID, "*CLOAD\n9001, 3, 100.\n9001, 1, 20.\n9002, 2, 500.\n" + BOTH), 3e-6),
    "rigid body held against turning": (
        deck(RIGID + "*BOUNDARY\n9002, 1, 3\n", "*CLOAD\n9001, 3, 100.\n9001, 1, 20.\n" + BOTH), 3e-6,
    ),
    "rigid body that turns about x alone": (
        deck(RIGID + "*BOUNDARY\n9002, 2, 3\n", "*CLOAD\n9001, 2, 30.\n9002, 1, 300.\n" + PRINT), 3e-6,
    ),
    "rigid body moved along z": (
        deck(RIGID + "*BOUNDARY\n9002, 1, 3\n", "*BOUNDARY\n9001, 3, 3, 0.01\n*CLOAD\n9001, 1, 20.\n" + BOTH), 3e-6,
    ),
    "rigid body on a ball joint": (deck(RIGID + "*BOUNDARY\n9001, 1, 3\n", "*CLOAD\n9002, 2, 500.\n" + PRINT), 3e-6),
    # three rotations, of which that about the edge moves none of its nodes
    "rigid edge": (
        deck("*NSET, NSET=EDGE\n37, 38, 39\n*RIGID BODY, NSET=EDGE\n", "*CLOAD\n37, 3, 9.\n38, 1, 2.\n" + PRINT), 3e-6,
    ),
    "kinematic": (deck(KINEMATIC, "*CLOAD\n9001, 3, 100.\n9001, 1, 20.\n9001, 5, 500.\n" + BOTH), 3e-6),
    "kinematic, held": (
        deck(KINEMATIC, "*BOUNDARY\n9001, 1, 6\n*CLOAD\n19, 1, 50.\n*NODE PRINT, NSET=NALL\nU\n"), 3e-6,
    ),
    "distributing": (
        deck(COUPLED + "*DISTRIBUTING\n1, 6\n", "*CLOAD\n9001, 3, 100.\n9001, 1, 20.\n9001, 5, 500.\n" + PRINT), 3e-6,
    ),
    "distributing, forces alone": (
        deck(COUPLED + "*DISTRIBUTING\n1, 3\n", "*CLOAD\n9001, 3, 100.\n9001, 1, 20.\n" + PRINT), 3e-6,
    ),
    "distributing coupling element": (deck(SPREAD, "*CLOAD\n9001, 3, 100.\n9001, 1, 20.\n" + PRINT), 3e-6),
    "equations": (deck(EQUAL_Z, "*CLOAD\n37, 3, 100.\n40, 1, 20.\n" + PRINT), 3e-6),
    "equations with a node of its own": (
        deck(TO_REF + ALONE, "*CLOAD\n9001, 3, 100.\n40, 1, 20.\n" + PRINT), 3e-6,
    ),
    "equations with a node that is moved": (
        deck(TO_REF + ALONE, "*BOUNDARY\n9001, 3, 3, 0.02\n*CLOAD\n40, 1, 20.\n" + PRINT), 3e-6,
    ),
    "two nodes": (
        deck("*EQUATION\n2\n37, 1, 2., 10, 1, -2.\n2\n37, 2, 2., 10, 2, -2.\n", "*CLOAD\n40, 1, 20.\n" + PRINT), 3e-6,
    ),
    "nodes held along a direction": (
        deck("*EQUATION\n2\n37, 1, 1., 37, 3, 2.\n2\n39, 3, 4., 39, 1, 2.\n", "*CLOAD\n40, 1, 20.\n" + PRINT), 3e-6,
    ),
    "a node held along an axis": (deck("*EQUATION\n1\n37, 2, 1.\n", "*CLOAD\n40, 2, 20.\n" + PRINT), 3e-6),
    # ccx counts the plane with large rotations, also in a linear step
    "nodes that stay in a plane": (
        deck("*MPC\nPLANE, 37, 39, 43, 38, 40, 41, 42, 44, 45\n", "*CLOAD\n37, 3, 1.\n40, 1, 2.\n" + PRINT), 1e-5,
    ),
    "a motion": (
        one_block(BAR) + REF + STEEL + HELD + RIGID
        + dynamic("*CLOAD\n9001, 1, 20.\n9002, 3, 500.\n" + BOTH, step="*STEP, INC=1000, AMPLITUDE=RAMP\n"), 5e-5,
    ),
    "a motion of equal nodes": (
        one_block(BAR) + REF + STEEL + HELD + EQUAL_Z
        + dynamic("*CLOAD\n37, 3, 100.\n" + PRINT, step="*STEP, INC=1000, AMPLITUDE=RAMP\n"), 2e-5,
    ),
}  # fmt: skip


def apart(text: str, folder: Path) -> dict[str, float]:
    """By printed set: largest difference from ccx over the largest displacement."""
    found = imported(text, folder)
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(dict(found.tables) | {"output": {"fields": True}}, folder))
    assert solution.converged, solution.status
    blocks = list(printed_blocks(found.prints, solution))
    differences = {}
    for one in blocks:
        printed = displacements(text, folder, one.target)
        there = printed[min(printed, key=lambda time: abs(time - one.time))]
        assert np.abs(there).max() > 1e-9
        # of several instants the last one
        differences[one.target] = float(np.abs(one.values - there).max() / np.abs(there).max())
    return differences


@pytest.mark.parametrize("name", DECKS)
def test_reference_nodes_are_those_of_calculix(name: str, tmp_path: Path) -> None:
    """Displacements of the face and of the reference node, to the digits that ccx prints."""
    text, tolerance = DECKS[name]
    differences = apart(text, tmp_path)
    assert len(differences) == text.count("*NODE PRINT")
    assert max(differences.values()) < tolerance, differences


# -- closed forms -----------------------------------------------------------------------------------------------------
def test_a_rigid_part_follows_its_reference_node(tmp_path: Path) -> None:
    """Two bars, one on the other, the upper one rigid by all of its nodes: a force at its node bends the lower one as a
    force and a moment at its end do, u = F L^3 / (3 E I) + M L^2 / (2 E I), with shear."""
    low = block((0.0, 0.0, 0.0), (10.0, 10.0, 100.0), (2, 2, 20))
    high = block((0.0, 0.0, 100.0), (10.0, 10.0, 50.0), (2, 2, 2))
    text = one_block(low, "C3D8I")
    first, element = low.n_node, low.n_cell
    text += "*NODE, NSET=UPPER\n"
    text += "".join(f"{first + i + 1}, {x}, {y}, {z}\n" for i, (x, y, z) in enumerate(high.nodes.tolist()))
    text += "*ELEMENT, TYPE=C3D8, ELSET=HIGH\n"
    for i, cell in enumerate((high.blocks[0].cells + first + 1).tolist()):
        text += f"{element + i + 1}, " + ", ".join(map(str, cell)) + "\n"
    text += "*SOLID SECTION, ELSET=HIGH, MATERIAL=STEEL\n" + STEEL
    text += "*SURFACE, NAME=SEAT\n" + "".join(f"{element + i}, S1\n" for i in range(1, 5))
    text += "*TIE, NAME=GLUE\nSEAT, UP\n*NODE, NSET=REF\n9001, 5., 5., 130.\n" + HELD
    for card in ("*RIGID BODY, NSET=UPPER, REF NODE=9001\n", "*RIGID BODY, ELSET=HIGH, REF NODE=REF\n"):
        found = imported(text + card + static("*CLOAD\nREF, 1, 10.\n*NODE PRINT, NSET=REF\nU\n"), tmp_path)
        assert found.tables["substructure"]["HIGH"]["rigid"] is True
        solution = latin_fmu.solve(latin_fmu.scene_from_dict(dict(found.tables), tmp_path))
        stiffness = 210e3 * 10.0**4 / 12.0
        bent = 10.0 * 100.0**3 / (3.0 * stiffness) + 300.0 * 100.0**2 / (2.0 * stiffness)
        turned = (10.0 * 100.0**2 / 2.0 + 300.0 * 100.0) / stiffness
        sheared = 10.0 * 100.0 / (210e3 / 2.6 * 100.0 * 5.0 / 6.0)
        moved = solution.sensors["REF"].displacement[-1, 0]
        assert moved == pytest.approx(bent + sheared + 30.0 * turned, rel=1.5e-2)  # ends that are held are stiffer
        [printed] = printed_blocks(found.prints, solution)
        assert printed.values[0, 0] == pytest.approx(moved, rel=1e-12)


def test_the_mean_motion_of_a_held_distributing_coupling_is_zero(tmp_path: Path) -> None:
    """Held altogether, and as by a ball joint: mean displacement and rotation of the face."""
    for held, joint in (("1, 6", {}), ("1, 3", {"rotations": False})):
        text = deck(COUPLED + "*DISTRIBUTING\n", f"*BOUNDARY\n9001, {held}\n*CLOAD\n19, 1, 50.\n")
        found = imported(text, tmp_path).tables
        end = {"face": "BLOCK.UP", "point": [3.0, 2.0, 50.0]}
        assert found["coupling"] == {"SPIDER": {"ends": [end, "ground"], **joint}}
        sensor = {"sensor": {"arm": {"face": "BLOCK.UP", "point": [3.0, 2.0, 50.0]}}}
        solution = latin_fmu.solve(
            latin_fmu.scene_from_dict(dict(found) | sensor | {"output": {"fields": True}}, tmp_path)
        )
        moved = np.abs(solution.substructures["BLOCK"].displacement[-1]).max()
        assert np.abs(solution.sensors["arm"].displacement[-1]).max() < 1e-5 * moved


# -- tables and refusals ----------------------------------------------------------------------------------------------
def test_a_kinematic_coupling_of_one_axis_keeps_a_face_plane(tmp_path: Path) -> None:
    """ccx 2.20 does not take it: displacements along z are those of a plane, the face strains in itself."""
    found = imported(deck(COUPLED + "*KINEMATIC\n3\n", "*CLOAD\n9001, 3, 100.\n"), tmp_path)
    assert found.tables["coupling"]["SPIDER"] == {
        "ends": ["BLOCK.UP"], "rigid": True, "components": ["z", "rx", "ry", "rz"],
    }  # fmt: skip
    tables = dict(found.tables) | {"output": {"fields": True}}
    moved = latin_fmu.solve(latin_fmu.scene_from_dict(tables, tmp_path)).substructures["BLOCK"].displacement[-1]
    top = BAR.nodes[:, 2] > 39.0
    plane = np.c_[np.ones(top.sum()), BAR.nodes[top, :2]]
    rest = moved[top, 2] - plane @ np.linalg.lstsq(plane, moved[top, 2], rcond=None)[0]
    assert np.abs(rest).max() < 1e-9 * np.abs(moved).max()
    across = (
        moved[top, 0]
        - np.c_[np.ones(top.sum()), BAR.nodes[top, 1]]
        @ np.linalg.lstsq(np.c_[np.ones(top.sum()), BAR.nodes[top, 1]], moved[top, 0], rcond=None)[0]
    )
    assert np.abs(across).max() > 1e-3 * np.abs(moved).max()


BAD = {
    "a rotation of a reference node that is not 0": deck(RIGID, "*BOUNDARY\n9002, 3, 3, 0.1\n"),
    "free to turn": deck(RIGID + "*BOUNDARY\n9001, 1, 2\n", "*CLOAD\n9001, 3, 1.\n"),
    "*KINEMATIC holds the nodes": deck(COUPLED + "*DISTRIBUTING\n*BOUNDARY\n9001, 1\n", "*CLOAD\n9001, 3, 1.\n"),
    "no *COUPLING above it": deck("*KINEMATIC\n1, 3\n", "*CLOAD\nTOP, 3, 1.\n"),
    "no *KINEMATIC or *DISTRIBUTING below it": deck(COUPLED, "*CLOAD\nTOP, 3, 1.\n"),
    "all of 1 to 3 of *DISTRIBUTING": deck(COUPLED + "*DISTRIBUTING\n1\n", "*CLOAD\nTOP, 3, 1.\n"),
    "one set of nodes of one part": deck(SPREAD.replace("TOP, 1.", "TOP, 1.\nLEFT, 2."), "*CLOAD\nTOP, 3, 1.\n"),
    "INFLUENCE RADIUS": deck(KINEMATIC.replace("NAME=SPIDER", "NAME=S, INFLUENCE RADIUS=2."), "*CLOAD\nTOP, 3, 1.\n"),
    "node of a solid": deck("*RIGID BODY, NSET=TOP, REF NODE=5\n", "*CLOAD\nTOP, 3, 1.\n"),
    "no such node as REF NODE": deck("*RIGID BODY, NSET=TOP, REF NODE=77\n", "*CLOAD\nTOP, 3, 1.\n"),
    "nodes of one part": deck("*RIGID BODY, NSET=REF\n", "*CLOAD\nTOP, 3, 1.\n"),
    "along what it does not couple": deck(TO_REF, "*CLOAD\n9001, 1, 1.\n"),
    "opposite factors": deck("*EQUATION\n2\n37, 1, 1., 38, 1, -2.\n", "*CLOAD\nTOP, 3, 1.\n"),
    "of one node": deck("*EQUATION\n3\n37, 1, 1., 38, 1, -1., 39, 1, 1.\n", "*CLOAD\nTOP, 3, 1.\n"),
    "without all its terms": deck("*EQUATION\n2\n37, 1, 1.\n", "*CLOAD\nTOP, 3, 1.\n"),
    "no number of terms": deck("*EQUATION\nTOP\n", "*CLOAD\nTOP, 3, 1.\n"),
    "several parts, or of no solid": deck("*EQUATION\n2\n9001, 1, 1., 9002, 1, -1.\n", "*CLOAD\nTOP, 3, 1.\n"),
    "that two cards join along z": deck(EQUAL_Z + "*MPC\nPLANE, 37, 39, 43, 41\n", "*CLOAD\nTOP, 3, 1.\n"),
    "some of which are moved": deck(EQUAL_Z, "*BOUNDARY\nTOP, 3, 3, 0.1\n"),
    "equation of nodes with *TRANSFORM": deck("*TRANSFORM, NSET=TOP\n1., 1., 0., -1., 1., 0.\n" + EQUAL_Z, ""),
    "nodes on a line that may turn": deck("*MPC\nSTRAIGHT, 37, 38, 39\n", "*CLOAD\nTOP, 3, 1.\n"),
    "not in a plane across x, y or z": deck("*MPC\nPLANE, 37, 39, 7, 9\n", "*CLOAD\nTOP, 3, 1.\n"),
    "reference nodes and other nodes": deck(RIGID + "*NSET, NSET=MIXED\n9001, 5\n", "*CLOAD\nMIXED, 3, 1.\n"),
}  # fmt: skip


@pytest.mark.parametrize("words", BAD)
def test_what_a_scene_has_not_is_refused_by_card_and_line(words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as refused:
        imported(BAD[words], tmp_path)
    assert words in str(refused.value)
    assert ", line " in str(refused.value)
