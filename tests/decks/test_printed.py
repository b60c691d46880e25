"""What a deck prints of a run, beside the ``.dat`` that ``ccx`` 2.20 writes of the same deck: one parser reads both."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import latin_fmu
from latin_fmu.cli import main
from latin_fmu.decks.dat_file import DatBlock, dat_text, fortran, read_dat
from latin_fmu.decks.printed import printed_text
from latin_fmu.fem.reference_cells import cell_functions
from latin_fmu.stability.surfaces import typed_box
from tests.mesh_files.decks import node_rows

from .blocks import HELD, STEEL, block, contact, one_block, static, two_blocks
from .test_computed import imported

BAR = block((0.0, 0.0, 0.0), (10.0, 10.0, 40.0), (1, 1, 2))
EVERYTHING = (
    "*NODE PRINT, NSET=NALL\nU, RF\n*NODE PRINT, NSET=BOTTOM, TOTALS=ONLY\nRF\n"
    "*EL PRINT, ELSET=BLOCK\nS, E, ME, ENER\n*EL PRINT, ELSET=BLOCK, TOTALS=YES\nEVOL, ELSE\n"
)
PULL = "*CLOAD\nTOP, 3, 100.\nTIP, 1, 30.\n"
KINDS = {"C3D4": "tetra", "C3D10": "tetra10", "C3D15": "wedge15", "C3D8": "hexahedron", "C3D20": "hexahedron20"}
RAMP = "*STEP, INC=100, AMPLITUDE=RAMP\n*DYNAMIC, DIRECT, ALPHA=-0.05\n1e-6, 5e-6\n"


def there(deck: str, folder: Path) -> list[DatBlock]:
    """What CalculiX prints of a deck."""
    if shutil.which("ccx") is None:
        pytest.skip("ccx is not installed (Debian and Ubuntu: calculix-ccx)")
    (folder / "there.inp").write_text(deck)
    done = subprocess.run(["ccx", "-i", "there"], cwd=folder, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout[-2000:]
    return read_dat((folder / "there.dat").read_text())


def here(deck: str, folder: Path) -> list[DatBlock]:
    """What a run of its scene prints."""
    found = imported(deck, folder)
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(dict(found.tables), folder))
    assert solution.trustworthy
    return read_dat(printed_text(found.prints, solution))


def compare(ours: list[DatBlock], theirs: list[DatBlock], tolerance: float) -> None:
    """The same blocks, rows and marks; values within a share of the largest of their kind."""
    assert [(b.kind, b.target, b.time) for b in ours] == [(b.kind, b.target, b.time) for b in theirs]
    assert len(theirs) > 0
    largest: dict[str, float] = {}
    for found in theirs:
        kind = found.kind.removeprefix("total ")
        largest[kind] = max(largest.get(kind, 0.0), float(np.abs(found.values).max()))
    for one, other in zip(ours, theirs, strict=True):
        np.testing.assert_array_equal(one.labels, other.labels)
        assert (one.local is None) == (other.local is None)
        scale = largest[one.kind.removeprefix("total ")]
        np.testing.assert_allclose(one.values, other.values, atol=tolerance * scale, rtol=0.0, err_msg=str(one))


def one_element(name: str) -> str:
    """An element of a type, skewed, held at three of its nodes and pulled at its last one."""
    nodes = cell_functions(KINDS[name]).nodes
    places = nodes @ np.array([[9.0, 1.0, 0.5], [0.3, 8.0, -1.0], [1.5, 0.2, 11.0]])
    low = np.flatnonzero(np.isclose(nodes[:, 2], nodes[:, 2].min())) + 1
    text = "*NODE, NSET=NALL\n" + node_rows(places) + f"*ELEMENT, TYPE={name}, ELSET=BLOCK\n"
    # ccx takes sixteen numbers a line
    numbers = [1, *range(1, len(nodes) + 1)]
    text += ",\n".join(", ".join(map(str, numbers[i : i + 12])) for i in range(0, len(numbers), 12)) + "\n"
    text += f"*NSET, NSET=BOTTOM\n{', '.join(map(str, low))}\n*SOLID SECTION, ELSET=BLOCK, MATERIAL=STEEL\n"
    load = static(f"*CLOAD\n{len(nodes)}, 1, 30.\n{len(nodes)}, 3, 10.\n" + EVERYTHING)
    return text + STEEL + "*BOUNDARY\nBOTTOM, 1, 3\n" + load


def a_block(name: str, kind: str) -> str:
    """A block of elements with a reduced rule: one alone has deformations without a force."""
    mesh = typed_box(kind, np.zeros(3), np.full(3, 10.0), (2, 2, 2))
    text = "*NODE, NSET=NALL\n" + node_rows(mesh.nodes) + f"*ELEMENT, TYPE={name}, ELSET=BLOCK\n"
    for number, cell in enumerate((mesh.blocks[0].cells + 1).tolist(), 1):
        rows = [", ".join(map(str, [number, *cell][i : i + 12])) for i in range(0, len(cell) + 1, 12)]
        text += ",\n".join(rows) + "\n"
    low = np.flatnonzero(mesh.nodes[:, 2] == 0.0) + 1
    text += "*NSET, NSET=BOTTOM\n" + ",\n".join(map(str, low.tolist())) + f"\n*NSET, NSET=TIP\n{mesh.n_node}\n"
    text += f"*SOLID SECTION, ELSET=BLOCK, MATERIAL=STEEL\n{STEEL}*BOUNDARY\nBOTTOM, 1, 3\n"
    return text + static("*CLOAD\nTIP, 1, 30.\nTIP, 3, 10.\n" + EVERYTHING)


DECKS = {
    "a bar": one_block(BAR) + STEEL + HELD + static(PULL + EVERYTHING),
    "heat": one_block(BAR)
    + STEEL
    + "*EXPANSION\n1.2e-5\n*INITIAL CONDITIONS, TYPE=TEMPERATURE\nNALL, 20.\n"
    + HELD
    + static("*TEMPERATURE\nNALL, 120.\n" + EVERYTHING),
    "incompatible modes": one_block(BAR, "C3D8I") + STEEL + HELD + static(PULL + EVERYTHING),
    "C3D8R": one_block(BAR, "C3D8R") + STEEL + HELD + static(PULL + EVERYTHING),
    "axes of a transformation": one_block(BAR)
    + STEEL
    + "*TRANSFORM, NSET=TOP\n1., 1., 0., -1., 1., 0.\n"
    + HELD
    + static("*BOUNDARY\nTOP, 1, 1\n*CLOAD\nTOP, 2, 50.\n" + EVERYTHING),
    "two steps": one_block(BAR)
    + STEEL
    + HELD
    + static(PULL + EVERYTHING)
    + static("*CLOAD\nTOP, 2, 9.\n*NODE PRINT, NSET=TIP\nU\n"),
    **{name: one_element(name) for name in KINDS},
    "C3D20R": a_block("C3D20R", "hexahedron20"),
    "C3D6": a_block("C3D6", "wedge"),
}


@pytest.mark.parametrize("name", DECKS)
def test_a_linear_step_prints_what_calculix_prints(name: str, tmp_path: Path) -> None:
    """Displacements, forces, values at integration points, energies and volumes: titles, sets, times, rows, numbers."""
    compare(here(DECKS[name], tmp_path), there(DECKS[name], tmp_path), 1e-6)


def test_increments_of_a_motion_are_printed_as_calculix_does(tmp_path: Path) -> None:
    """One FREQUENCY counts for all outputs, the last one, also in the next step."""
    cards = PULL + "*NODE PRINT, NSET=TOP, FREQUENCY=3\nU, V\n*EL PRINT, ELSET=BLOCK, FREQUENCY=2\nS\n*END STEP\n"
    later = RAMP + "*CLOAD\nTOP, 3, 50.\n*NODE PRINT, NSET=NALL\nRF\n*END STEP\n"
    deck = one_block(BAR) + STEEL + HELD + RAMP + cards + later
    theirs = there(deck, tmp_path)
    assert [b.time for b in theirs if b.kind == "U"] == pytest.approx([2e-6, 4e-6, 5e-6])
    compare(here(deck, tmp_path), theirs, 5e-3)


def test_the_force_of_a_contact_is_printed_as_calculix_does(tmp_path: Path) -> None:
    """Statistics of a pair: force and moment on the slave, middle, area, normal force; nodes of the pair are left out
    of the forces, which other codes count with those of the contact."""
    deck = two_blocks() + STEEL + contact("*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR\n1e6\n") + HELD
    deck += "*BOUNDARY\nTOP, 1, 2\n" + static(
        "*DSLOAD\nHIGHUP, P, 10.\n*NODE PRINT, NSET=BOTTOM, TOTALS=ONLY\nRF\n"
        "*CONTACT PRINT, SLAVE=HIGHDOWN, MASTER=LOWUP\nCF\n"
    )
    compare(here(deck, tmp_path), there(deck, tmp_path), 1e-4)


def test_what_is_not_printed_is_said(tmp_path: Path) -> None:
    """Quantities and sets that the file has not, each with its reason, in the lines of the import."""
    cards = "*NODE PRINT, NSET=TOP, TIME POINTS=T\nU, NT\n*CONTACT PRINT\nCF\n*NODE PRINT, NSET=NOWHERE\nU\n"
    found = imported(one_block(BAR) + STEEL + HELD + static(PULL + cards), tmp_path)
    lost = "\n".join(line for line in found.summary() if line.startswith("left out"))
    for words in ("NT", "TIME POINTS", "SLAVE and MASTER", "NOWHERE: not in the .dat, no node of the set"):
        assert words in lost
    assert [request.words for request in found.prints.requests[1]] == [("U",)]


def test_run_writes_the_file_beside_the_results(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """``latin-fmu run DECK.inp`` writes NAME.dat, whole or not at all, and says so; a deck that prints nothing none."""
    monkeypatch.chdir(tmp_path)
    Path("bar.inp").write_text(DECKS["a bar"])
    assert main(["run", "bar.inp", "-o", "out.nc"]) == 0
    assert "out.dat" in capsys.readouterr().out
    assert {b.kind for b in read_dat(Path("out.dat").read_text())} >= {"U", "RF", "S", "total RF", "ELSE"}
    Path("still.inp").write_text(one_block(BAR) + STEEL + HELD + static(PULL))
    assert main(["run", "still.inp"]) == 0
    assert not Path("still.dat").exists()


def test_a_deck_that_is_not_there_is_said_to_be_missing(capsys: pytest.CaptureFixture[str]) -> None:
    """--units is for decks alone; of a name without a file nothing says what it is."""
    assert main(["run", "nowhere.inp", "--units", "m"]) == 2
    assert "nowhere.inp: no such file" in capsys.readouterr().err


def test_numbers_are_those_of_fortran() -> None:
    """Rounding up to the next power of ten, zeros, signs; a file that is read and written again stays the same."""
    assert fortran(0.99999999) == " 0.1000000E+01"
    assert fortran(1234.5) == " 0.1234500E+04"
    text = dat_text([DatBlock("U", "TIP", 0.5, np.array([[12]]), np.array([[-1.0, 2e-30, -0.0]]))])
    assert text.splitlines()[3] == "        12 -1.000000E+00  2.000000E-30  0.000000E+00"
    assert dat_text(read_dat(text)) == text
