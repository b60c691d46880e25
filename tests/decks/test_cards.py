"""Every card is used, left out with its consequence, or refused with its line; units; the scene as it is written."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

import latin_fmu
from latin_fmu.cli import main
from latin_fmu.commands import BAD_INPUT, CONVERGED
from latin_fmu.decks.cards import LEFT_OUT, REFUSED, TRANSLATORS
from latin_fmu.decks.histories import Amplitude, DeckHistory, DeckStep, Setting, common_step, law_of
from latin_fmu.decks.importing import import_deck
from latin_fmu.decks.printed import printed_blocks
from latin_fmu.decks.units import units_of
from latin_fmu.errors import InputError
from latin_fmu.mesh_files.deck_card import Card
from latin_fmu.stability.surfaces import typed_box
from tests.mesh_files.decks import node_rows

from .beside import displacements
from .blocks import HELD, OUTPUT, STEEL, block, contact, one_block, static, two_blocks
from .test_computed import imported

BAR = block((0.0, 0.0, 0.0), (10.0, 10.0, 40.0), (1, 1, 2))
LOAD = "*CLOAD\nTOP, 3, 100.\n"


def plain(model: str = "", step: str = "", after: str = "") -> str:
    """A bar that is pulled, with more cards in its model, its step, and after it."""
    return one_block(BAR) + STEEL + model + HELD + static(LOAD + step + OUTPUT) + after


def refusal(deck: str, folder: Path) -> str:
    """The message of a deck that is refused."""
    with pytest.raises(InputError) as error:
        imported(deck, folder)
    return str(error.value)


def line_of(deck: str, start: str) -> int:
    """Line of the first row that begins so."""
    return next(i for i, row in enumerate(deck.splitlines(), 1) if row.startswith(start))


# -- every card -------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("keyword", [*sorted(REFUSED), "NO SUCH CARD"])
def test_a_card_that_would_change_the_answer_is_refused_with_its_line(keyword: str, tmp_path: Path) -> None:
    deck = plain(f"*{keyword}\n1.,\n")
    message = refusal(deck, tmp_path)
    assert f"line {line_of(deck, '*' + keyword)}: *{keyword}" in message


@pytest.mark.parametrize("keyword", sorted(LEFT_OUT))
def test_a_card_that_is_left_out_is_named(keyword: str, tmp_path: Path) -> None:
    deck = plain(f"*{keyword}\n1.,\n")
    found = imported(deck, tmp_path)
    lines = [line for line in found.summary() if line.startswith(f"left out: *{keyword} (")]
    assert len(lines) == 1
    assert LEFT_OUT[keyword] in lines[0]


def test_no_card_is_in_two_tables() -> None:
    tables = (TRANSLATORS, LEFT_OUT, REFUSED)
    assert len({key for table in tables for key in table}) == sum(len(table) for table in tables)


def test_every_card_of_a_deck_has_a_line(tmp_path: Path) -> None:
    """No card is silent: of a deck with all kinds of them every keyword is in the summary, and in the head of the
    scene as a comment."""
    deck = two_blocks() + STEEL.replace("*DENSITY", "*EXPANSION\n1e-5\n*DAMPING, ALPHA=1.\n*DENSITY")
    deck += contact("*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=HARD\n*FRICTION\n0.1, 1e5\n", ", ADJUST=0.01")
    deck += "*AMPLITUDE, NAME=A\n0., 0., 1., 1.\n*INITIAL CONDITIONS, TYPE=TEMPERATURE\nNALL, 20.\n" + HELD
    deck += (
        "*STEP, NLGEOM\n*STATIC\n0.5, 1.\n*CLOAD, AMPLITUDE=A\nTOP, 3, -10.\n*DLOAD\nLOW, GRAV, 9810., 0., 0., -1.\n"
    )
    deck += "*DSLOAD\nHIGHUP, P, 2.\n*TEMPERATURE\nNALL, 30.\n*CONTROLS, PARAMETERS=FIELD\n1.\n*NODE PRINT, NSET=TIP\n"
    deck += "U, RF, NT\n*EL FILE\nS\n*CONTACT FILE\nCSTR\n*END STEP\n*STEP\n*FREQUENCY\n5\n*NODE FILE\nU\n*END STEP\n"
    found = imported(deck, tmp_path)
    said = found.summary()
    keywords = {line.split(",")[0].strip("*").strip() for line in deck.splitlines() if line.startswith("*")}
    for keyword in keywords:
        assert any(f": *{keyword} (" in line for line in said), keyword
    comments = " ".join(row.lstrip("# ") for row in found.text().splitlines() if row.startswith("#"))
    assert all(line in comments for line in said)
    lost = [line for line in said if line.startswith("left out")]
    assert any("NLGEOM" in line for line in lost)
    assert any("*DAMPING" in line and "rates" in line for line in lost)
    assert any("*FREQUENCY" in line and "latin-fmu modes" in line for line in lost)
    assert any("NT" in line for line in lost)
    # the density of the part that gravity acts on
    assert found.tables["substructure"]["LOW"]["body_force"] == [0.0, 0.0, pytest.approx(-7.8e-9 * 9810.0)]
    assert found.tables["temperature"]["all"]["change"] == 10.0
    assert found.tables["output"] == {"reactions": True, "strain": True, "nodal_stress": True, "surfaces": True}


BAD = {
    "EXPONENTIAL": two_blocks() + STEEL + contact("*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=EXPONENTIAL\n1., 1.\n"),
    "no *SURFACE INTERACTION": two_blocks() + STEEL + "*CONTACT PAIR, INTERACTION=NONE\nHIGHDOWN, LOWUP\n",
    "not on two different parts": two_blocks() + STEEL + contact().replace("HIGHDOWN, LOWUP", "HIGHDOWN, HIGHUP"),
    "tied elsewhere": two_blocks() + STEEL + contact() + "*TIE, NAME=GLUE\nHIGHDOWN, LOWUP\n",
    "CENTRIF takes the square": plain(step="*DLOAD\nBLOCK, CENTRIF, 1e4, 0., 0., 0.\n"),
    "CENTRIF of element sets": plain(step="*DLOAD\n1, CENTRIF, 1e4, 0., 0., 0., 0., 0., 1.\n"),
    "two elements": plain(step="*DLOAD\nBLOCK, P2, 1.\n"),
    "moments on nodes": plain(step="*CLOAD\nTOP, 4, 1.\n"),
    "no such node": plain(step="*CLOAD\nNOWHERE, 1, 1.\n"),
    "no *AMPLITUDE": plain(step="*CLOAD, AMPLITUDE=B\nTOP, 1, 1.\n"),
    "different amplitudes": plain("*AMPLITUDE, NAME=B\n0., 0., 1., 1.\n", "*CLOAD, AMPLITUDE=B\nTOP, 3, 1.\n"),
    "cannot be read": plain(step="*CLOAD\nTOP, one, 1.\n"),
    "different values": plain(step="*BOUNDARY\nTOP, 1, 1, 0.1\nTIP, 1, 1, 0.2\n"),
    "takes away": plain(after=static("*BOUNDARY, OP=NEW\nBOTTOM, 3, 3\n")),
    "comes with a later step": plain(after=static("*BOUNDARY\nTOP, 1, 1\n")),
    "an edge or a point": plain(step="*BOUNDARY\nTIP, 1, 1, 0.1\n"),
    "static step after": one_block(BAR)
    + STEEL
    + HELD
    + f"*STEP\n*DYNAMIC\n1e-6, 1e-5\n{LOAD}*END STEP\n"
    + static(LOAD),
    "jumps": one_block(BAR) + STEEL + HELD + "*STEP\n*DYNAMIC\n1e-6, 1e-5\n*BOUNDARY\nTOP, 3, 3, 1.\n*END STEP\n",
    "one temperature of all nodes": plain(step="*TEMPERATURE\nTOP, 30.\n"),
    "no *EXPANSION": plain(step="*TEMPERATURE\nNALL, 30.\n"),
    "TYPE=TEMPERATURE alone are translated": plain("*INITIAL CONDITIONS, TYPE=STRESS\n1, 1, 0.\n"),
    "velocity of all nodes": plain("*INITIAL CONDITIONS, TYPE=VELOCITY\nTOP, 3, 1.\n"),
    "latin-fmu modes": one_block(BAR) + STEEL + HELD + "*STEP\n*FREQUENCY\n3\n*END STEP\n",
    "nothing to run": one_block(BAR) + STEEL + HELD,
    "without its increment": one_block(BAR)
    + STEEL
    + HELD
    + f"*STEP\n*DYNAMIC, EXPLICIT\n, 1e-5\n{LOAD}*END STEP\n",
    "beams, springs": plain("*ELEMENT, TYPE=B31, ELSET=BEAM\n99, 1, 2\n"),
    "nine constants": plain().replace("*ELASTIC", "*ELASTIC, TYPE=ORTHO"),
    "isotropic and orthotropic": plain().replace("*ELASTIC", "*ELASTIC, TYPE=ANISO"),
    "no *MATERIAL": plain().replace("MATERIAL=STEEL", "MATERIAL=BRASS", 1),
    "lacks density": (one_block(BAR) + STEEL + HELD + static("*DLOAD\nBLOCK, GRAV, 1., 0., 0., 1.\n")).replace(
        "*DENSITY\n7.8e-9\n", ""
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", BAD)
def test_what_a_scene_cannot_say_is_refused(what: str, tmp_path: Path) -> None:
    """The reason, and the line of the card where there is one."""
    deck = BAD[what] if "*STEP" in BAD[what] or what == "nothing to run" else BAD[what] + HELD + static(LOAD)
    message = refusal(deck, tmp_path)
    assert what in message
    assert "line " in message or what in ("nothing to run", "lacks density")


# -- units ------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("modulus", "density", "system"),
    [
        (210e3, 7.8e-9, "mm-t-s-MPa"),
        (210e9, 7800.0, "SI"),
        (30e6, 7.3e-4, "in-lbf-s-psi"),
        (400e3, 1.1e-4, "in-lbf-s-psi"),
        (2e3, 1.2e-9, "mm-t-s-MPa"),
        (210e3, None, "mm-t-s-MPa"),
        (70e9, None, "SI"),
        (30e6, None, "in-lbf-s-psi"),
        (None, 7.8e-9, "mm-t-s-MPa"),
    ],
)
def test_units_are_guessed(modulus: float | None, density: float | None, system: str) -> None:
    constants = {"young_modulus": modulus, "density": density}
    given = {key: value for key, value in constants.items() if value is not None}
    found, sentence = units_of(None, {"M": given}, "deck.inp")
    assert found == system
    assert sentence.endswith(" of M")


@pytest.mark.parametrize(
    "materials",
    [
        {},
        {"M": {"young_modulus": 210e3, "density": 7800.0}},
        {"M": {"young_modulus": 210e3, "density": 7.8e-6}},
        {"M": {"young_modulus": 1.0}},
        {"M": {"young_modulus": 210e3}, "N": {"young_modulus": 210e9}},
    ],
)
def test_units_that_are_not_known_are_refused(materials: dict[str, dict[str, float]]) -> None:
    with pytest.raises(InputError, match="--units mm-t-s"):
        units_of(None, materials, "deck.inp")
    assert units_of("m", materials, "deck.inp") == ("SI", "Units m, kg, s, Pa: given by --units m")


# -- histories --------------------------------------------------------------------------------------------------------
def test_laws_of_steps() -> None:
    card = Card("STEP", {}, "deck.inp", 1)
    steps = [DeckStep(card, card, start, 1.0, 0.5) for start in (0.0, 1.0)]
    history = DeckHistory([Setting(1, 10.0, None, card), Setting(2, 30.0, None, card)])
    assert law_of(history.points(steps), None, 0.5) == (
        30.0,
        {"type": "table", "times": [0.0, 1.0, 2.0], "values": [0.0, pytest.approx(1 / 3), 1.0]},
    )
    swing = Amplitude((0.0, 0.5, 1.0), (0.0, 2.0, 1.0), False)
    held = DeckHistory([Setting(1, 10.0, swing, card)])
    assert held.points(steps)[-2:] == [(1.0, 10.0), (2.0, 10.0)]
    over = Amplitude((0.0, 4.0), (0.0, 4.0), True)
    assert DeckHistory([Setting(1, 10.0, over, card)]).points(steps)[-1] == (2.0, 20.0)
    # from a static start a jump goes over one step
    assert law_of([(0.0, 5.0), (1.0, 5.0)], 2.0, 0.1)[1] == {
        "type": "table",
        "times": [0.0, 0.1, 1.0],
        "values": [0.4, 1.0, 1.0],
    }
    assert common_step([1.0, 0.333], [0.5, 0.333]) == pytest.approx(0.001)
    assert common_step([1.0, 0.123456789], [0.1, 0.1]) is None


# -- the command line -------------------------------------------------------------------------------------------------
def test_import_writes_a_scene_and_run_runs_a_deck(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "decks").mkdir()
    (tmp_path / "decks" / "bar.inp").write_text(plain())
    assert main(["import", "decks/bar.inp"]) == CONVERGED
    shown = capsys.readouterr().out
    assert shown.startswith("Units mm, t, s, MPa: guessed from")
    text = (tmp_path / "bar.toml").read_text()
    assert text.startswith("# Units mm, t, s, MPa: guessed from")
    assert tomllib.loads(text)["mesh"]["bar"]["file"] == "decks/bar.inp"
    scene = latin_fmu.load_scene(tmp_path / "bar.toml")
    assert scene.units == "mm-t-s-MPa"
    assert main(["run", "decks/bar.inp", "-o", "bar.nc"]) == CONVERGED
    told = capsys.readouterr()
    assert "used: *CLOAD" in told.err
    assert "converged" in told.out
    assert (tmp_path / "bar.nc").is_file()
    # a scene that was edited is not lost
    (tmp_path / "bar.toml").write_text(text.replace("nodal_force = [0.0, 0.0, 100.0]", "nodal_force = [0.0, 0.0, 9.0]"))
    assert main(["run", "decks/bar.inp"]) == BAD_INPUT
    assert "may hold your changes" in capsys.readouterr().err
    assert main(["import", "decks/bar.inp", "-o", "bar.toml", "--units", "m"]) == CONVERGED
    assert latin_fmu.load_scene(tmp_path / "bar.toml").units == "SI"
    assert main(["run", "bar.toml", "--units", "m"]) == BAD_INPUT


def test_a_scene_of_a_deck_names_nothing_as_unused(tmp_path: Path) -> None:
    """``mesh_only``: what stands in the scene is not taken from the deck a second time."""
    found = imported(plain("*TIE, NAME=GLUE\n").replace("*TIE, NAME=GLUE\n", ""), tmp_path)
    from latin_fmu.building import discretise

    ready = discretise(latin_fmu.scene_from_dict(dict(found.tables), tmp_path))
    assert not [remark for remark in ready.remarks if remark.code == "deck"]
    assert list(ready.scene.boundary) == ["BOTTOM"]


def test_a_static_deck_without_density_says_what_stands_in_its_place(tmp_path: Path) -> None:
    found = imported(plain().replace("*DENSITY\n7.8e-9\n", ""), tmp_path)
    assert found.tables["material"]["STEEL"]["density"] == pytest.approx(210e3 / (5e6) ** 2)
    assert any(line.startswith("left out: *MATERIAL") and "DENSITY" in line for line in found.summary())


def test_parts_that_share_nodes_are_bonded(tmp_path: Path) -> None:
    """Two sections of one mesh: the answer of one."""
    deck = plain()
    split = deck.replace("*SOLID SECTION, ELSET=BLOCK, MATERIAL=STEEL\n", "").replace(
        "*MATERIAL",
        "*ELSET, ELSET=A\n1\n*ELSET, ELSET=B\n2\n*SOLID SECTION, ELSET=A, MATERIAL=STEEL\n"
        "*SOLID SECTION, ELSET=B, MATERIAL=STEEL\n*MATERIAL",
    )
    one, two = (
        latin_fmu.solve(latin_fmu.scene_from_dict(dict(imported(text, tmp_path).tables), tmp_path))
        for text in (deck, split)
    )
    moved = [solution.sensors["TIP"].displacement[-1] for solution in (one, two)]
    assert moved[0][2] > 1e-5
    assert moved[1] == pytest.approx(moved[0], rel=1e-6, abs=1e-9)


def test_elements_that_differ_are_named(tmp_path: Path) -> None:
    found = imported(plain().replace("C3D8,", "C3D8H,"), tmp_path)
    assert any(line.startswith("left out: *ELEMENT") and "displacement element" in line for line in found.summary())


def test_one_point_elements_have_uniform_strain(tmp_path: Path) -> None:
    """With inertia the mass differs from that of CalculiX, which is named; a part with both kinds is refused."""
    deck = plain().replace("C3D8,", "C3D8R,")
    found = imported(deck.replace("*STATIC\n", "*DYNAMIC\n"), tmp_path)
    assert found.tables["substructure"]["BLOCK"]["uniform_strain"] is True
    assert any(line.startswith("used: *ELEMENT") and "mass is the consistent one" in line for line in found.summary())
    lines = deck.splitlines()
    last = max(
        i
        for i, line in enumerate(lines[: lines.index("*SOLID SECTION, ELSET=BLOCK, MATERIAL=STEEL")])
        if line.startswith("2, ") and len(line.split(",")) == 9
    )
    lines.insert(last, "*ELEMENT, TYPE=C3D8, ELSET=BLOCK")
    said = refusal("\n".join(lines) + "\n", tmp_path)
    assert f"line {lines.index('*ELEMENT, TYPE=C3D8R, ELSET=BLOCK') + 1}" in said
    assert "a *SOLID SECTION for the elements of each type" in said


def corners_held(name: str) -> str:
    """A block of C3D20R or C3D20 held by its lower face; TOP has the corners of the upper facets alone."""
    mesh = typed_box("hexahedron20", np.zeros(3), np.full(3, 10.0), (2, 2, 2))
    text = "*NODE\n" + node_rows(mesh.nodes) + f"*ELEMENT, TYPE={name}, ELSET=BLOCK\n"
    for number, cell in enumerate(mesh.blocks[0].cells + 1, 1):
        text += f"{number}, " + ", ".join(map(str, cell[:10])) + ",\n" + ", ".join(map(str, cell[10:])) + "\n"
    corners = np.unique(mesh.blocks[0].cells[:, :8])
    for group, height, among in (("BOTTOM", 0.0, np.arange(mesh.n_node)), ("TOP", 10.0, corners)):
        labels = among[np.isclose(mesh.nodes[among, 2], height)] + 1
        text += f"*NSET, NSET={group}\n" + ",\n".join(map(str, labels.tolist())) + "\n"
    return text + f"*SOLID SECTION, ELSET=BLOCK, MATERIAL=STEEL\n{STEEL}{HELD}"


def test_moved_corners_of_quadratic_facets_are_refused(tmp_path: Path) -> None:
    """A face that is moved has its middle nodes, too: it would hold more."""
    said = refusal(corners_held("C3D20") + static("*BOUNDARY\nTOP, 3, 3, -0.001\n"), tmp_path)
    assert "corners of quadratic facets without their middle nodes" in said


@pytest.mark.parametrize("name", ["C3D20", "C3D20R"])
def test_forces_on_corners_of_quadratic_facets_act_there_alone(name: str, tmp_path: Path) -> None:
    """As ccx 2.20 has it, also with the reduced rule: a set without the middle nodes is no face."""
    deck = corners_held(name) + static("*CLOAD\nTOP, 3, -10.\nTOP, 1, 4.\n*NODE PRINT, NSET=TOP\nU\n")
    there = displacements(deck, tmp_path, "TOP")[1.0]
    found = imported(deck, tmp_path)
    assert found.tables["mesh"]["here"]["points"] == ["TOP"]
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(dict(found.tables), tmp_path))
    [printed] = printed_blocks(found.prints, solution)
    np.testing.assert_allclose(printed.values, there, atol=1e-6 * np.abs(there).max())


def test_keywords_may_lack_their_blank(tmp_path: Path) -> None:
    """CalculiX takes blanks out of keywords: *ENDSTEP is *END STEP."""
    deck = plain()
    joined = deck.replace("*END STEP", "*ENDSTEP").replace("*SOLID SECTION", "*SOLIDSECTION")
    joined = joined.replace("*NODE PRINT", "*NODEPRINT")
    assert joined != deck
    assert imported(joined, tmp_path).summary() == imported(deck, tmp_path).summary()


def test_a_file_that_is_no_deck_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mesh.inp").write_text("not a deck\n")
    with pytest.raises(InputError):
        import_deck(tmp_path / "mesh.inp")


@pytest.mark.parametrize(
    "cards",
    [
        "*MODEL CHANGE, TYPE=CONTACT PAIR, REMOVE\nHIGHDOWN, LOWUP\n",
        "*CHANGE FRICTION, INTERACTION=JOINT\n*FRICTION\n0.3, 1e5\n",
    ],
)
def test_contact_that_changes_is_refused_with_a_remedy(cards: str, tmp_path: Path) -> None:
    load = "*CLOAD\nTOP, 3, -1.\n"
    deck = two_blocks() + STEEL + contact() + HELD + static(load) + static(cards)
    said = refusal(deck, tmp_path)
    line = deck.splitlines().index(cards.splitlines()[0]) + 1
    assert f"line {line}: {cards.split(',')[0]}: contact that changes from step to step" in said
    assert said.count("write a deck for each state of the contact") == cards.count("*")
