"""Fields that a deck files, ``.frd``, beside those that ``ccx`` 2.20 writes of the same deck: one reader reads both."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import latin_fmu
from latin_fmu.cli import main
from latin_fmu.decks.filed import filed_blocks, filed_text
from latin_fmu.decks.frd_file import FrdBlock, read_frd
from latin_fmu.decks.printed import printed_blocks
from latin_fmu.stability.surfaces import typed_box
from tests.mesh_files.decks import node_rows

from .blocks import HELD, STEEL, contact, one_block, static, two_blocks
from .test_computed import BAR, dynamic, imported, nonlinear

PULL = "*CLOAD\nTOP, 1, 30.\nTOP, 3, 10.\n"
FILES = "*NODE FILE\nU, RF\n*EL FILE\nS, E\n"
KINDS = {
    "C3D4": "tetra", "C3D10": "tetra10", "C3D6": "wedge", "C3D15": "wedge15", "C3D8": "hexahedron",
    "C3D20": "hexahedron20", "C3D20R": "hexahedron20",
}  # fmt: skip


# from integration points to nodes ccx has matrices of five digits
_EXTENDED = {"S": 3e-5, "E": 5e-5, "ME": 5e-5}


def a_box(name: str) -> str:
    """A box of elements of a type, held at its foot."""
    mesh = typed_box(KINDS[name], np.zeros(3), np.array([10.0, 10.0, 20.0]), (2, 1, 2))
    text = "*NODE, NSET=NALL\n" + node_rows(mesh.nodes) + f"*ELEMENT, TYPE={name}, ELSET=BLOCK\n"
    for number, cell in enumerate(mesh.blocks[0].cells + 1, 1):
        row = [number, *cell.tolist()]
        text += ",\n".join(", ".join(map(str, row[i : i + 12])) for i in range(0, len(row), 12)) + "\n"
    for group, height in (("BOTTOM", 0.0), ("TOP", 20.0)):
        labels = np.flatnonzero(np.isclose(mesh.nodes[:, 2], height)) + 1
        text += f"*NSET, NSET={group}\n" + ",\n".join(map(str, labels.tolist())) + "\n"
    return text + f"*SOLID SECTION, ELSET=BLOCK, MATERIAL=STEEL\n{STEEL}{HELD}"


def theirs(deck: str, folder: Path) -> str:
    """The .frd of CalculiX."""
    if shutil.which("ccx") is None:
        pytest.skip("ccx is not installed (Debian and Ubuntu: calculix-ccx)")
    (folder / "there.inp").write_text(deck)
    done = subprocess.run(["ccx", "-i", "there"], cwd=folder, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout[-2000:]
    return (folder / "there.frd").read_text()


def ours(deck: str, folder: Path) -> str:
    """That of a run of the scene."""
    found = imported(deck, folder)
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(dict(found.tables), folder))
    assert solution.trustworthy
    return "".join(filed_text(found.prints, solution))


def mesh_lines(text: str) -> list[str]:
    """Lines of nodes and elements: their heads, numbers and places."""
    lines = text.splitlines()
    return [line.rstrip() for line in lines[: lines.index(" -3", lines.index(" -3") + 1)] if line[:5] != "    1"]


def heads(text: str) -> list[str]:
    """Lines of blocks but for values, running numbers, and the estimates of errors, which are theirs alone."""
    without = re.sub(r"    1PSTEP.*\n  100CL.*\n -4  ERROR(.*\n)*? -3\n", "", text)
    lines = [
        line for line in without.splitlines() if line[:5] in (" -4  ", " -5  ") or line[:6] in ("    1P", "  100C")
    ]
    return [line[:10] + line[36:] if line[4:7] == "1PS" else line for line in lines]


def compare(one: list[FrdBlock], other: list[FrdBlock], tolerance: dict[str, float]) -> None:
    """The same blocks and nodes; values within a share of the largest of their kind."""
    assert [(b.kind, b.time, b.step) for b in one] == [(b.kind, b.time, b.step) for b in other]
    for mine, their in zip(one, other, strict=True):
        np.testing.assert_array_equal(mine.labels, their.labels)
        scale = max(np.abs(block.values).max() for block in other if block.kind == their.kind)
        error = np.abs(mine.values - their.values).max() / scale
        assert error < tolerance.get(mine.kind, _EXTENDED.get(mine.kind, 3e-6)), (mine.kind, mine.time, error)


STEPS = {
    "a static step": one_block(BAR) + STEEL + HELD + static(PULL + FILES),
    "mechanical strains of hot blocks": one_block(BAR)
    + STEEL
    + "*EXPANSION\n1.2e-5\n*INITIAL CONDITIONS, TYPE=TEMPERATURE\nNALL, 20.\n"
    + HELD
    + static("*TEMPERATURE\nNALL, 120.\n*NODE FILE\nU\n*EL FILE\nS, E, ME\n"),
    # a card of nodes takes those of nodes away alone
    "static steps": one_block(BAR) + STEEL + HELD
    + static(PULL + "*NODE FILE, NSET=TOP\nU\n*EL FILE\nS\n") + static("*NODE FILE\nRF\n"),
    "a motion": one_block(BAR) + STEEL + HELD
    + dynamic(PULL + "*NODE FILE, FREQUENCY=2\nU, V\n", step="*STEP, INC=1000, AMPLITUDE=RAMP\n"),
    "a motion after a static step": one_block(BAR) + STEEL + HELD
    + static(PULL + "*NODE FILE\nU\n*EL FILE\nS, ENER\n", "1e-6, 1e-6")
    + dynamic("*NODE FILE\nU\n", "1e-6, 2e-6"),
}  # fmt: skip


@pytest.mark.parametrize("name", STEPS)
def test_fields_are_those_of_calculix(name: str, tmp_path: Path) -> None:
    """Mesh and heads line by line, values to the digits of a file."""
    mine, their = ours(STEPS[name], tmp_path), theirs(STEPS[name], tmp_path)
    without = re.sub(r"    1PSTEP.*\n  100CL.*\n -4  ENER(.*\n)*? -3\n", "", their)
    assert mesh_lines(mine) == mesh_lines(their)
    assert heads(mine) == heads(without)
    moving = "motion" in name
    tolerance = {"U": 2e-5, "V": 2e-4, "S": 1e-4} if moving else {}
    compare(read_frd(mine), read_frd(their), tolerance)


@pytest.mark.parametrize(
    # at the nodes of C3D20 and C3D15 ccx extends more points than a linear field has; those of C3D6 it extends with
    # factors for points elsewhere (findings/calculix_stress_at_wedge_nodes.sh)
    ("name", "stress"),
    [*((name, 3e-5) for name in ("C3D4", "C3D10", "C3D8", "C3D20R")), ("C3D20", 0.2), ("C3D15", 0.02), ("C3D6", None)],
)
def test_nodes_of_elements_stand_in_the_order_of_calculix(name: str, stress: float | None, tmp_path: Path) -> None:
    deck = a_box(name) + static("*CLOAD\nTOP, 1, 3.\nTOP, 3, 1.\n*NODE FILE\nU\n*EL FILE\nS\n")
    mine, their = ours(deck, tmp_path), theirs(deck, tmp_path)
    assert mesh_lines(mine) == mesh_lines(their)
    compare(read_frd(mine), read_frd(their), {"S": np.inf if stress is None else stress})


def test_stresses_at_the_nodes_of_a_wedge_go_on_from_its_two_points(tmp_path: Path) -> None:
    """C3D6: the line through both integration points, of which node 1 has one element alone."""
    deck = a_box("C3D6") + static("*CLOAD\nTOP, 1, 3.\n*NODE FILE\nU\n*EL FILE\nS\n*EL PRINT, ELSET=BLOCK\nS\n")
    found = imported(deck, tmp_path)
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(dict(found.tables), tmp_path))
    [printed] = printed_blocks(found.prints, solution)
    lower, upper = printed.values[:2][:, [0, 1, 2, 3, 5, 4]]
    [_, stress] = filed_blocks(found.prints, solution)
    # points at 1/2 -+ 1/sqrt(12) of the height
    exact = lower - (upper - lower) * (np.sqrt(3.0) - 1.0) / 2.0
    np.testing.assert_allclose(stress.values[0], exact, atol=1e-6 * np.abs(exact).max())


def test_two_parts_have_the_means_of_all_elements_around(tmp_path: Path) -> None:
    """Two sections of one mesh: stresses at their common nodes, and the materials of their elements."""
    deck = one_block(BAR).replace("*SOLID SECTION, ELSET=BLOCK, MATERIAL=STEEL\n", "")
    deck += "*ELSET, ELSET=A, GENERATE\n1, 8\n*ELSET, ELSET=B, GENERATE\n9, 16\n" + STEEL
    deck += "*MATERIAL, NAME=ALU\n*ELASTIC\n70000., 0.3\n*DENSITY\n2.7e-9\n"
    deck += "*SOLID SECTION, ELSET=A, MATERIAL=STEEL\n*SOLID SECTION, ELSET=B, MATERIAL=ALU\n" + HELD
    deck += static(PULL + "*NODE FILE\nU\n*EL FILE\nS\n")
    mine, their = ours(deck, tmp_path), theirs(deck, tmp_path)
    assert mesh_lines(mine) == mesh_lines(their)
    compare(read_frd(mine), read_frd(their), {})


def test_what_is_not_filed_has_a_line(tmp_path: Path) -> None:
    deck = two_blocks() + STEEL + contact() + HELD
    deck += static("*DSLOAD\nHIGHUP, P, 10.\n*NODE FILE\nU, RF\n*EL FILE\nS, ENER\n*CONTACT FILE\nCDIS\n", "1., 1.")
    found = imported(deck, tmp_path)
    said = found.summary()
    assert any("*NODE FILE" in line and "U of all nodes in the .frd" in line for line in said)
    assert any("RF: not in the .frd" in line for line in said)
    assert any("ENER: in the results, not in the .frd" in line for line in said)
    assert any("CDIS" in line and "not in the .frd" in line for line in said)


def test_run_writes_the_fields_beside_the_results(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bar.inp").write_text(one_block(BAR) + STEEL + HELD + nonlinear(PULL + FILES, "0.5, 1."))
    assert main(["run", "bar.inp"]) == 0
    assert "as CalculiX writes it: bar.frd" in capsys.readouterr().out
    blocks = read_frd((tmp_path / "bar.frd").read_text())
    assert [(b.kind, b.time) for b in blocks] == [(kind, t) for t in (0.5, 1.0) for kind in ("U", "S", "E", "RF")]
    assert not (tmp_path / "bar.dat").exists()


def test_other_quantities_of_a_file_are_left_out() -> None:
    """A file written by hand: fixed columns, a number that runs into the one before it, estimates of errors."""
    text = (
        "    1PSTEP                         1           2           3          \n"
        "  100CL  101 0.500000000           1                     1    1           1\n"
        " -4  DISP        4    1\n -5  D1          1    2    1    0\n"
        " -1         3 1.00000E-03-2.00000E-03 0.00000E+00\n -3\n"
        " -4  ERROR       1    1\n -1         3 1.00000E+00\n -3\n 9999\n"
    )
    [found] = read_frd(text)
    assert (found.kind, found.time, found.labels.tolist()) == ("U", 0.5, [3])
    assert (found.step, found.increment, found.moving) == (3, 2, True)
    assert found.values.tolist() == [[1e-3, -2e-3, 0.0]]
