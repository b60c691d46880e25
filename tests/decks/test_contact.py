"""Decks with contact pairs and pre-tension: laws of the deck beside CalculiX 2.20, the exact ones by closed forms."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import latin_fmu
from latin_fmu.building import discretise
from latin_fmu.decks.printed import printed_blocks

from .beside import displacements
from .blocks import HELD, OUTPUT, STEEL, block, contact, one_block, static, two_blocks
from .test_computed import imported, solved

PRESS = "*DSLOAD\nHIGHUP, P, 100.\n"
GUIDED = "*BOUNDARY\nNHIGH, 1, 2\nNLOW, 1, 2\n"
LINEAR = "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR\n1e6, 1.\n"
TIED = "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=TIED\n1e6\n*FRICTION\n0.5, 4e5\n"
HARD = "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=HARD\n"
CONSTRAINED = 210e3 * 0.7 / (1.3 * 0.4)  # MPa: E (1 - nu) / ((1 + nu) (1 - 2 nu)), no strain across


def pair(behavior: str, cards: str, more: str = "", gap: float = 0.0, line: str = "0.25, 1.") -> str:
    """Two blocks with a contact pair and one static step."""
    return two_blocks(gap=gap) + STEEL + contact(behavior, more) + HELD + static(cards + OUTPUT, line)


PENALTIES = {
    "linear": (pair(LINEAR, "*BOUNDARY\nNHIGH, 1, 2\n" + PRESS), 1e-4),
    # a corner of a block that is sheared: the stick slope is left out here
    "linear and friction": (pair(LINEAR + "*FRICTION\n0.5, 1e6\n", PRESS + "*CLOAD\nTOP, 1, -100.\n"), 1e-2),
    "tied": (pair(TIED, "*CLOAD\nTOP, 1, -100.\nTOP, 3, 50.\n"), 5e-3),
}


@pytest.mark.parametrize("name", PENALTIES)
def test_the_penalty_of_a_deck_is_that_of_calculix(name: str, tmp_path: Path) -> None:
    """Displacement of a corner with the stiffness of the deck: pressed, sheared, bonded."""
    deck, tolerance = PENALTIES[name]
    there = displacements(deck, tmp_path, "TIP")[1.0][0]
    solution = solved(deck, tmp_path)
    assert solution.converged
    here = solution.sensors["TIP"].displacement[-1]
    np.testing.assert_allclose(here, there, atol=tolerance * np.abs(there).max())


@pytest.mark.parametrize(("behavior", "layer"), [(HARD, 0.0), (LINEAR, 100.0 / 1e6)])
def test_pressed_blocks_shorten_by_hooke(behavior: str, layer: float, tmp_path: Path) -> None:
    """Guided blocks of 20 mm under 100 MPa: 20 p / M, and p / K of the layer."""
    solution = solved(pair(behavior, GUIDED + PRESS), tmp_path)
    assert solution.sensors["TIP"].displacement[-1, 2] == pytest.approx(-(20.0 * 100.0 / CONSTRAINED + layer), rel=1e-6)
    assert solution.interfaces["JOINT"].force()[-1, 2] == pytest.approx(100.0 * 100.0, rel=1e-6)


@pytest.mark.parametrize(
    ("more", "before", "gap"),
    [
        ("", "", 0.05),
        ("", "*CLEARANCE, MASTER=LOWUP, SLAVE=HIGHDOWN, VALUE=0.02\n", 0.02),
        (", ADJUST=0.06", "", 0.0),
        (", ADJUST=0.01", "", 0.05),
    ],
)
def test_a_gap_closes_before_it_carries(more: str, before: str, gap: float, tmp_path: Path) -> None:
    """The upper end of guided blocks is pushed down by 0.1 mm, over a gap of 0.05 mm of the meshes, one of *CLEARANCE,
    none by ADJUST, which lengthens the upper block by the gap: force M A (0.1 - gap) / 20."""
    deck = pair(HARD, GUIDED + "*BOUNDARY\nTOP, 3, 3, -0.1\n", more, 0.05, "0.1, 1.")
    solution = solved(deck.replace("*SURFACE INTERACTION", before + "*SURFACE INTERACTION"), tmp_path)
    force = solution.interfaces["JOINT"].force()[:, 2]
    length = 20.0 + 0.05 * (more == ", ADJUST=0.06")
    assert force[-1] == pytest.approx(CONSTRAINED * 100.0 * (0.1 - gap) / length, rel=1e-5)
    assert force[int(10.0 * gap / 0.1)] == pytest.approx(0.0, abs=1e-6 * force[-1])


def test_friction_slips_at_its_limit(tmp_path: Path) -> None:
    """Pressed, then pulled along by a displacement in the second step: the friction force is mu N, to the end."""
    first = static(PRESS + OUTPUT, "1., 1.")
    deck = two_blocks() + STEEL + contact(HARD + "*FRICTION\n0.2\n") + HELD
    held = first.replace(PRESS, "*BOUNDARY\nTOP, 3, 3, -0.01\nTOP, 1, 2\n")
    deck += held + static("*BOUNDARY\nTOP, 1, 1, 0.05\n", "0.25, 1.")
    solution = solved(deck, tmp_path)
    assert solution.converged
    force = solution.interfaces["JOINT"].force()
    assert solution.time[-1] == pytest.approx(2.0)
    # the upper block is side E: what holds it back points along -x
    assert force[-1, 0] == pytest.approx(-0.2 * force[-1, 2], rel=1e-4)
    assert force[-1, 2] > 1e3


@pytest.mark.parametrize(("face", "z", "normal", "pull"), [("S1", 25.0, "", 1.0), ("S1", 25.0, "0., 0., 1.\n", -1.0)])
@pytest.mark.parametrize("kind", ["force", "shortening"])
def test_a_pretension_section_is_a_bolt(
    face: str, z: float, normal: str, pull: float, kind: str, tmp_path: Path
) -> None:
    """A bar between two supports: tension as given, or by the shortening; the sign of the deck is that of its normal,
    and the force on the support is that which ccx 2.20 prints."""
    bar = block((0.0, 0.0, 0.0), (10.0, 10.0, 40.0), (2, 2, 4))
    middle = bar.nodes[bar.blocks[0].cells].mean(axis=1)
    cut = "".join(f"{i + 1}, {face}\n" for i in np.flatnonzero(np.abs(middle[:, 2] - z) < 1.0))
    deck = one_block(bar) + f"*SURFACE, NAME=CUT, TYPE=ELEMENT\n{cut}*NODE, NSET=PRE\n9999, 0., 0., 0.\n"
    deck += f"*PRE-TENSION SECTION, SURFACE=CUT, NODE=9999\n{normal}" + STEEL + "*BOUNDARY\nBOTTOM, 1, 3\nTOP, 1, 3\n"
    cards = {"force": f"*CLOAD\n9999, 1, {pull * 1000.0}\n", "shortening": f"*BOUNDARY\n9999, 1, 1, {pull * 0.01}\n"}
    deck += static(cards[kind] + "*NODE PRINT, NSET=BOTTOM, TOTALS=ONLY\nRF\n")
    solution = solved(deck, tmp_path)
    tension = solution.bolts["PRE"].force[-1]
    if kind == "force":
        assert tension == pytest.approx(1000.0, rel=1e-6)
    else:
        # E A delta / L, stiffened by the supports that hold the ends across
        assert 1.0 < tension / (210e3 * 100.0 * 0.01 / 40.0) < 1.1
    if shutil.which("ccx") is not None:
        (tmp_path / "there.inp").write_text(deck)
        subprocess.run(["ccx", "-i", "there"], cwd=tmp_path, check=True, capture_output=True, timeout=60)
        line = (tmp_path / "there.dat").read_text().splitlines()[-1]
        # the bar in tension pulls its support up, which pulls it down
        assert tension == pytest.approx(-float(line.split()[2]), rel=1e-5)


def test_bolts_in_steps_of_their_own_come_before_the_loads(tmp_path: Path) -> None:
    """Two steps that tighten, one that loads: orders of the bolts, and time of the last step alone."""
    text = ""
    bars = [block((20.0 * i, 0.0, 0.0), (10.0, 10.0, 40.0), (1, 1, 4)) for i in range(2)]
    nodes, cells, first, element = "", "", 1, 1
    for i, bar in enumerate(bars):
        nodes += "".join(f"{first + k}, {x}, {y}, {z}\n" for k, (x, y, z) in enumerate(bar.nodes.tolist()))
        cells += f"*ELEMENT, TYPE=C3D8, ELSET=BAR{i}\n"
        cells += "".join(
            f"{element + k}, " + ", ".join(str(n + first) for n in cell) + "\n"
            for k, cell in enumerate(bar.blocks[0].cells.tolist())
        )
        text += f"*SURFACE, NAME=CUT{i}, TYPE=ELEMENT\n{element + 2}, S1\n"
        text += f"*PRE-TENSION SECTION, SURFACE=CUT{i}, NODE={9000 + i}\n*SOLID SECTION, ELSET=BAR{i}, MATERIAL=STEEL\n"
        first, element = first + bar.n_node, element + bar.n_cell
    ends = [n + 1 for n in range(first - 1) if np.concatenate([b.nodes for b in bars])[n, 2] in (0.0, 40.0)]
    deck = f"*NODE\n{nodes}9000, 0., 0., 0.\n9001, 0., 0., 0.\n{cells}{text}*NSET, NSET=ENDS\n"
    deck += ",\n".join(map(str, ends)) + "\n" + STEEL + "*BOUNDARY\nENDS, 1, 3\n"
    deck += static("*CLOAD\n9000, 1, 500.\n") + static("*CLOAD\n9001, 1, 700.\n*BOUNDARY, FIXED\n9000, 1, 1\n")
    deck += static("*BOUNDARY, FIXED\n9001, 1, 1\n*CLOAD\n20, 1, 5.\n", "0.5, 1.")
    found = imported(deck, tmp_path)
    bolts = found.tables["bolt"]
    assert [(table["force"], table["order"]) for table in bolts.values()] == [(500.0, 1), (700.0, 2)]
    assert found.tables["time"] == {"end": 1.0, "instants": 2, "quasi_static": True}
    assert found.tables["load"]["NODE_20"]["law"]["times"] == [0.0, 1.0]
    solution = solved(deck, tmp_path)
    tensions = [history.force for history in solution.bolts.values()]
    assert [tension[0] for tension in tensions] == pytest.approx([500.0, 700.0], rel=1e-5)


def punched(kind: str, held: str) -> str:
    """A punch of 4 x 4 mm, with four facets, on the middle of a block of 12 x 12 mm, with four as well."""
    low = block((0.0, 0.0, 0.0), (12.0, 12.0, 10.0), (2, 2, 2))
    high = block((4.0, 4.0, 10.0), (4.0, 4.0, 8.0), (2, 2, 2))
    text = one_block(low).replace("UP", "LOWUP").replace("ELSET=BLOCK", "ELSET=LOW")
    text = text.replace("NSET=TOP", "NSET=LOWTOP").replace("NSET=TIP", "NSET=LOWTIP")
    first = low.n_node + 1
    text += "*NODE\n" + "".join(f"{first + i}, {x}, {y}, {z}\n" for i, (x, y, z) in enumerate(high.nodes.tolist()))
    text += "*ELEMENT, TYPE=C3D8, ELSET=HIGH\n"
    for i, cell in enumerate((high.blocks[0].cells + first).tolist()):
        text += f"{low.n_cell + 1 + i}, " + ", ".join(map(str, cell)) + "\n"
    text += "*SURFACE, NAME=HIGHDOWN\n" + "".join(f"{low.n_cell + i}, S1\n" for i in range(1, 5))
    text += "*SURFACE, NAME=HIGHUP\n" + "".join(f"{low.n_cell + i}, S2\n" for i in range(5, 9))
    top = [str(first + i) for i in np.flatnonzero(high.nodes[:, 2] > 17.0)]
    text += f"*NSET, NSET=TOP\n{', '.join(top)}\n*NSET, NSET=TIP\n{first + high.n_node - 1}\n"
    text += "*SOLID SECTION, ELSET=HIGH, MATERIAL=STEEL\n" + STEEL
    text += contact(LINEAR).replace("SURFACE TO SURFACE", kind) + HELD + held.format(first=first)
    return text + static("*BOUNDARY\nTOP, 1, 2\n*DSLOAD\nHIGHUP, P, 100.\n" + OUTPUT)


@pytest.mark.parametrize("held", ["", "*BOUNDARY\n{first}, 1, 1\n"], ids=["free", "a corner held along x"])
@pytest.mark.parametrize("kind", ["SURFACE TO SURFACE", "NODE TO SURFACE"])
def test_the_slave_gives_the_points(kind: str, held: str, tmp_path: Path) -> None:
    """Its facets are smaller than those of the master: nine points, whatever else holds its nodes. With those of the
    master a single one was left under the punch."""
    deck = punched(kind, held)
    found = imported(deck, tmp_path)
    assert found.tables["interface"]["JOINT"]["points_from"] == "E"
    solution = solved(deck, tmp_path)
    assert len(solution.interfaces["JOINT"].areas) == 9
    here = solution.sensors["TIP"].displacement[-1]
    there = displacements(deck, tmp_path, "TIP")[1.0][0]
    np.testing.assert_allclose(here, there, atol=0.01 * np.abs(there).max())


def test_facets_of_the_slave_that_are_larger_do_not_give_the_points(tmp_path: Path) -> None:
    """A pair of element surfaces has many points on each facet in CalculiX, where the nodes of these would be few."""
    deck = punched("SURFACE TO SURFACE", "").replace("HIGHDOWN, LOWUP\n", "LOWUP, HIGHDOWN\n")
    assert "points_from" not in imported(deck, tmp_path).tables["interface"]["JOINT"]
    here = solved(deck, tmp_path).sensors["TIP"].displacement[-1]
    there = displacements(deck, tmp_path, "TIP")[1.0][0]
    np.testing.assert_allclose(here, there, atol=0.02 * np.abs(there).max())


def test_a_clearance_is_that_of_calculix_at_the_end_of_the_step(tmp_path: Path) -> None:
    """*CLEARANCE over a gap of the meshes: ccx 2.20 lets the one become the other over the step."""
    deck = pair(LINEAR, GUIDED + "*BOUNDARY\nTOP, 3, 3, -0.1\n", "", 0.05, "0.1, 1.")
    deck = deck.replace("*SURFACE INT", "*CLEARANCE, MASTER=LOWUP, SLAVE=HIGHDOWN, VALUE=0.02\n*SURFACE INT")
    deck = deck.replace(OUTPUT, "*NODE PRINT, NSET=NHIGH\nU\n").replace(
        "*STEP\n*STATIC", "*STEP, NLGEOM\n*STATIC, DIRECT"
    )
    there = displacements(deck, tmp_path, "NHIGH")[1.0]
    found = imported(deck, tmp_path)
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(dict(found.tables), tmp_path))
    *_, printed = printed_blocks(found.prints, solution)
    np.testing.assert_allclose(printed.values, there, atol=1e-4 * np.abs(there).max())
    assert np.ptp(there[:, 2]) > 0.01  # the upper block is pressed


def test_few_points_because_of_a_support_are_named(tmp_path: Path) -> None:
    """A scene that leaves the side to the program: one point in the place of nine has a remark."""
    for held, named in (("", False), ("*BOUNDARY\n{first}, 1, 1\n", True)):
        tables = dict(imported(punched("SURFACE TO SURFACE", held), tmp_path).tables)
        del tables["interface"]["JOINT"]["points_from"]
        remarks = discretise(latin_fmu.scene_from_dict(tables, tmp_path)).remarks
        said = [str(remark) for remark in remarks if "it has 1 points, those of LOW" in str(remark)]
        assert bool(said) == named
