"""Decks of our own, card by card: the scene that they become has the answer of CalculiX 2.20, or a closed form.

Displacements of CalculiX are those that ``ccx`` 2.20 prints for the same deck, in a run of the test where it is
installed; the numbers of closed forms stand in the tests.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import latin_fmu
from latin_fmu.decks.importing import ImportedDeck, import_deck
from latin_fmu.results.solution import Solution

from .beside import displacements
from .blocks import HELD, OUTPUT, STEEL, block, one_block, static, two_blocks

BAR = block((0.0, 0.0, 0.0), (10.0, 10.0, 40.0), (2, 2, 4))
ENERGY = "*EL FILE\nENER\n"  # without it ccx 2.20 refuses a dynamic step after a static one
AMPLITUDE = "*AMPLITUDE, NAME=A\n0., 0., 0.5, 2., 1., 1.\n"


def imported(deck: str, folder: Path) -> ImportedDeck:
    """The scene of a deck."""
    (folder / "here.inp").write_text(deck)
    return import_deck(folder / "here.inp")


def solved(deck: str, folder: Path) -> Solution:
    """The scene of a deck, solved."""
    return latin_fmu.solve(latin_fmu.scene_from_dict(dict(imported(deck, folder).tables), folder))


def nonlinear(cards: str, line: str) -> str:
    """A static step whose increments ccx prints one by one."""
    return f"*STEP, NLGEOM, INC=100\n*STATIC, DIRECT\n{line}\n{cards}*END STEP\n"


def dynamic(cards: str, line: str = "1e-6, 8e-6", step: str = "*STEP, INC=1000\n") -> str:
    """A dynamic step of fixed increments."""
    return f"{step}*DYNAMIC, DIRECT, ALPHA=-0.05\n{line}\n{cards}*END STEP\n"


STATIC = {
    "nodal forces": one_block(BAR) + STEEL + HELD + static("*CLOAD\nTOP, 3, 100.\nTIP, 1, 30.\n" + OUTPUT),
    "nodal forces by numbers": one_block(BAR) + STEEL + HELD + static("*CLOAD\n43, 3, 9.\n45, 2, 9.\n" + OUTPUT),
    "forces that add up": one_block(BAR) + STEEL + HELD + static("*CLOAD\nTOP, 3, 9.\n*CLOAD\nTOP, 3, 2.\n" + OUTPUT),
    "pressure on faces": one_block(BAR) + "*ELSET, ELSET=SIDE\n2, 4, 6, 8\n" + STEEL + HELD
    + static("*DLOAD\nSIDE, P4, 3.\n" + OUTPUT),
    "pressure on elements": one_block(BAR) + STEEL + HELD + static("*DLOAD\n13, P2, 3.\n14, P2, 5.\n" + OUTPUT),
    "pressure on a surface": one_block(BAR) + STEEL + HELD + static("*DSLOAD\nUP, P, 7.\n" + OUTPUT),
    "gravity": one_block(BAR) + STEEL + HELD + static("*DLOAD\nBLOCK, GRAV, 9810., 1., 0., -1.\n" + OUTPUT),
    "rotation": one_block(BAR) + STEEL + HELD
    + static("*DLOAD\nBLOCK, CENTRIF, 1e7, 30., 0., 5., 1., 2., 0.\n" + OUTPUT),
    "displaced nodes": one_block(BAR) + STEEL + HELD + static("*BOUNDARY\nTOP, 1, 1, 0.1\nTOP, 3, 3, -0.2\n" + OUTPUT),
    "heat": one_block(BAR)
    + STEEL
    + "*EXPANSION\n1.2e-5\n*INITIAL CONDITIONS, TYPE=TEMPERATURE\nNALL, 20.\n"
    + HELD
    + static("*TEMPERATURE\nNALL, 120.\n" + OUTPUT),
    "axes of a transformation": one_block(BAR)
    + STEEL
    + "*TRANSFORM, NSET=TOP\n1., 1., 0., -1., 1., 0.\n"
    + HELD
    + static("*BOUNDARY\nTOP, 1, 1\n*CLOAD\nTOP, 2, 50.\n" + OUTPUT),
    "incompatible modes": one_block(BAR, "C3D8I") + STEEL + HELD + static("*CLOAD\nTOP, 1, 30.\n" + OUTPUT),
    "stiffnesses of three axes": one_block(BAR).replace("MATERIAL=STEEL", "MATERIAL=STEEL, ORIENTATION=AX")
    + "*ORIENTATION, NAME=AX, SYSTEM=RECTANGULAR\n1., 1., 0., -1., 1., 0.\n*MATERIAL, NAME=STEEL\n"
    + "*ELASTIC, TYPE=ORTHO\n70000., 9000., 30000., 8000., 6000., 20000., 8000., 6000.,\n4000., 294.\n"
    + "*DENSITY\n7.8e-9\n"
    + HELD + static("*CLOAD\nTOP, 1, 3.\nTIP, 3, 5.\n" + OUTPUT),
    "tied blocks": two_blocks() + STEEL + "*TIE, NAME=GLUE\nHIGHDOWN, LOWUP\n" + HELD
    + static("*CLOAD\nTOP, 1, 30.\n" + OUTPUT),
}  # fmt: skip


@pytest.mark.parametrize("name", STATIC)
def test_a_linear_step_is_that_of_calculix(name: str, tmp_path: Path) -> None:
    """One increment of loads, supports, heat: the displacement of a corner to the digits that ccx prints."""
    there = displacements(STATIC[name], tmp_path, "TIP")[1.0][0]
    if name == "axes of a transformation":
        # printed along the local axes
        there = np.array([[1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, np.sqrt(2.0)]]) @ there / np.sqrt(2.0)
    solution = solved(STATIC[name], tmp_path)
    assert solution.converged
    here = solution.sensors["TIP"].displacement[-1]
    assert np.abs(there).max() > 1e-6
    np.testing.assert_allclose(here, there, atol=3e-6 * np.abs(there).max())


STEPS = {
    "a ramp after a ramp": nonlinear("*CLOAD\nTOP, 3, 100.\n" + OUTPUT, "0.25, 1.")
    + nonlinear("*CLOAD\nTOP, 3, 300.\n", "0.25, 1."),
    "a load that is taken away": nonlinear("*CLOAD\nTOP, 3, 100.\n" + OUTPUT, "0.25, 1.")
    + nonlinear("*CLOAD, OP=NEW\nTIP, 1, 20.\n", "0.25, 1."),
    "an amplitude of one step": nonlinear("*CLOAD, AMPLITUDE=A\nTOP, 3, 100.\n" + OUTPUT, "0.25, 1.")
    + nonlinear("*DLOAD\n2, P4, 8.\n", "0.5, 1."),
    "a load that comes at once": nonlinear("*CLOAD\nTOP, 3, 100.\n" + OUTPUT, "0.5, 1.").replace(
        "*STEP,", "*STEP, AMPLITUDE=STEP,"
    ),
    "displacement after displacement": nonlinear("*BOUNDARY\nTOP, 3, 3, 0.01\n" + OUTPUT, "0.25, 1.")
    + nonlinear("*BOUNDARY\nTOP, 3, 3, 0.03\n", "0.25, 1."),
}


@pytest.mark.parametrize("name", STEPS)
def test_steps_follow_each_other_as_in_calculix(name: str, tmp_path: Path) -> None:
    """Loads of consecutive static steps, at each of the increments that ccx prints."""
    deck = one_block(BAR) + STEEL + AMPLITUDE + HELD + STEPS[name]
    there = displacements(deck, tmp_path, "TIP")
    solution = solved(deck, tmp_path)
    here = solution.sensors["TIP"].displacement
    scale = max(float(np.abs(values).max()) for values in there.values())
    assert len(there) > 1
    for time, values in there.items():
        row = int(np.argmin(np.abs(solution.time - time)))
        assert solution.time[row] == pytest.approx(time, abs=1e-9)
        # ccx counts with large rotations, of 1e-4 here
        np.testing.assert_allclose(here[row], values[0], atol=1e-3 * scale)


FINE = "1e-7, 8e-6"
BEFORE = "1e-6, 1e-6"  # short: ccx prints seven digits of an instant
MOTIONS = {
    # deck, time before the motion, tolerance
    "a load at once": (dynamic("*CLOAD\nTOP, 3, 100.\n" + OUTPUT), 0.0, 2e-3),
    "a load that grows": (
        dynamic("*CLOAD\nTOP, 3, 100.\n" + OUTPUT, step="*STEP, INC=1000, AMPLITUDE=RAMP\n"),
        0.0,
        2e-5,
    ),
    "an amplitude": (
        "*AMPLITUDE, NAME=B\n0., 0., 2e-6, 1., 5e-6, 0.\n" + dynamic("*CLOAD, AMPLITUDE=B\nTOP, 3, 100.\n" + OUTPUT),
        0.0,
        2e-5,
    ),
    "an amplitude that comes late": (
        "*AMPLITUDE, NAME=B\n0., 0., 2e-6, 1., 4e-6, 0.\n"
        + dynamic("*CLOAD, AMPLITUDE=B, TIME DELAY=2e-6\nTOP, 3, 100.\n" + OUTPUT),
        0.0,
        2e-5,
    ),
    "an initial velocity": ("*INITIAL CONDITIONS, TYPE=VELOCITY\nNALL, 3, 1000.\n" + dynamic(OUTPUT), 0.0, 2e-5),
    "at rest after a static step": (
        static("*CLOAD\nTOP, 3, 100.\n" + OUTPUT + ENERGY, BEFORE) + dynamic("*CLOAD\nTIP, 1, 0.\n" + OUTPUT),
        1e-6,
        2e-5,
    ),
    # a load that jumps at t = 0 grows over the first increment here, and is there at once in ccx
    "released from a static step": (
        static("*CLOAD\nTOP, 3, 100.\n" + OUTPUT + ENERGY, BEFORE) + dynamic("*CLOAD, OP=NEW\n" + OUTPUT, FINE),
        1e-6,
        2e-2,
    ),
    "a second load after a static step": (
        static("*CLOAD\nTOP, 3, 100.\n" + OUTPUT + ENERGY, BEFORE) + dynamic("*CLOAD\nTOP, 3, 150.\n" + OUTPUT, FINE),
        1e-6,
        2e-2,
    ),
    # one speed: where the speed of a driven face jumps, ccx 2.20 goes another way, however small its increments are
    "a displaced face": (
        "*AMPLITUDE, NAME=B\n0., 0., 8e-6, 1.\n"
        + dynamic("*BOUNDARY, AMPLITUDE=B\nTOP, 3, 3, 1e-3\n*NODE PRINT, NSET=MIDDLE\nU\n"),
        0.0,
        2e-5,
    ),
}


@pytest.mark.parametrize("name", MOTIONS)
def test_a_motion_is_that_of_calculix(name: str, tmp_path: Path) -> None:
    """Dynamic steps of the scheme and increments of the deck, alone and from a static step: every instant."""
    cards, before, tolerance = MOTIONS[name]
    deck = one_block(BAR) + STEEL + "*NSET, NSET=MIDDLE\n20\n" + HELD + cards
    points = "MIDDLE" if "MIDDLE\nU" in cards else "TIP"
    there = displacements(deck, tmp_path, points)
    solution = solved(deck, tmp_path)
    here = solution.sensors[points].displacement
    moved = {time - before: values[0] for time, values in there.items() if time > before * 1.01}
    assert len(moved) == len(solution.time) - 1 >= 8
    scale = max(float(np.abs(values).max()) for values in moved.values())
    for time, values in moved.items():
        row = int(np.argmin(np.abs(solution.time - time)))
        np.testing.assert_allclose(here[row], values, atol=tolerance * scale)


def test_an_explicit_step_is_that_of_calculix(tmp_path: Path) -> None:
    """*DYNAMIC, EXPLICIT: ccx 2.20 chooses its increments; what is printed is the end of the step."""
    step = "*STEP, INC=100000, AMPLITUDE=RAMP\n*DYNAMIC, EXPLICIT\n2e-8, 8e-6\n"
    deck = one_block(BAR) + STEEL + HELD + f"{step}*CLOAD\nTOP, 3, 100.\n"
    deck += OUTPUT.replace("NSET=TIP", "NSET=TIP, FREQUENCY=1000") + "*END STEP\n"
    [there] = displacements(deck, tmp_path, "TIP").values()
    assert imported(deck, tmp_path).tables["solver"] == {"propagator": "explicit"}
    here = solved(deck, tmp_path).sensors["TIP"].displacement[-1]
    np.testing.assert_allclose(here, there[0], atol=5e-3 * np.abs(there).max())


def test_rayleigh_damping_is_that_of_calculix(tmp_path: Path) -> None:
    """*DAMPING with both coefficients: of a body that nothing drives both codes have the same matrix."""
    steel = STEEL.replace("*DENSITY", "*DAMPING, ALPHA=2e4, BETA=1e-6\n*DENSITY")
    deck = one_block(BAR) + steel + HELD + dynamic("*CLOAD\nTOP, 3, 100.\n" + OUTPUT)
    there = displacements(deck, tmp_path, "TIP")
    here = solved(deck, tmp_path).sensors["TIP"].displacement
    last = there[max(there)][0]
    free = solved(deck.replace("*DAMPING, ALPHA=2e4, BETA=1e-6\n", ""), tmp_path).sensors["TIP"].displacement[-1]
    assert np.abs(free - last).max() > 0.02 * np.abs(last).max()
    np.testing.assert_allclose(here[-1], last, atol=2e-3 * np.abs(last).max())


ORTHOTROPIC = """*MATERIAL, NAME=STEEL
*ELASTIC, TYPE=ENGINEERING CONSTANTS
1e5, 2e5, 4e4, 0.1, 0.15, 0.2, 3e4, 5e4
2e4, 20.
*DENSITY
7.8e-9
*ORIENTATION, NAME=AXES
1., 1., 0., -1., 1., 0.
"""


@pytest.mark.parametrize("material", ["isotropic", "orthotropic"])
def test_one_point_elements_are_those_of_calculix(material: str, tmp_path: Path) -> None:
    """C3D8R in a leaning prism one element thick: hourglass modes alone resist bending."""
    prism = block((0.0, 0.0, 0.0), (10.0, 10.0, 40.0), (1, 1, 6))
    lean = np.outer(prism.nodes[:, 2], [0.3, 0.1, 0.0]) + np.outer(prism.nodes[:, 0], [0.0, 0.2, 0.1])
    deck = one_block(replace(prism, nodes=prism.nodes + lean), "C3D8R") + STEEL
    if material == "orthotropic":
        deck = deck.replace("MATERIAL=STEEL", "MATERIAL=STEEL, ORIENTATION=AXES").replace(STEEL, ORTHOTROPIC)
    deck += HELD + static("*CLOAD\nTOP, 1, 10.\n" + OUTPUT)
    assert imported(deck, tmp_path).tables["substructure"]["BLOCK"]["uniform_strain"] is True
    there = displacements(deck, tmp_path, "TIP")[1.0][0]
    here = solved(deck, tmp_path).sensors["TIP"].displacement[-1]
    np.testing.assert_allclose(here, there, atol=3e-6 * np.abs(there).max())


@pytest.mark.parametrize(("moved", "apart"), [(0.05, 0.0002), (0.2, 0.0009), (0.6, 0.0021)])
def test_distorted_one_point_elements_differ_by_the_terms_that_calculix_leaves_out(
    moved: float, apart: float, tmp_path: Path
) -> None:
    """In proportion to the distortion, mm of edges of 5 mm (findings/calculix_hourglass_on_distorted_element.sh)."""
    bar = block((0.0, 0.0, 0.0), (10.0, 10.0, 40.0), (2, 2, 6))
    corners = bar.nodes + moved * np.random.default_rng(0).uniform(-1.0, 1.0, bar.nodes.shape)
    deck = one_block(replace(bar, nodes=corners), "C3D8R") + STEEL + HELD + static("*CLOAD\nTOP, 1, 10.\n" + OUTPUT)
    there = displacements(deck, tmp_path, "TIP")[1.0][0]
    here = solved(deck, tmp_path).sensors["TIP"].displacement[-1]
    assert np.abs(here - there).max() / np.abs(there).max() == pytest.approx(apart, rel=0.3)
