"""The table of a folder of decks: what runs is compared with its reference, what does not has its line."""

from __future__ import annotations

import csv
import gzip
import importlib
import sys
from pathlib import Path

import pytest

import latin_fmu
from latin_fmu.decks.dat_file import DatBlock, dat_text
from latin_fmu.decks.importing import import_deck
from latin_fmu.decks.printed import printed_blocks
from tests.decks.blocks import HELD, OUTPUT, STEEL, block, one_block, static

DECK = one_block(block((0.0, 0.0, 0.0), (10.0, 10.0, 40.0), (1, 1, 2))) + STEEL + HELD
LOAD = "*CLOAD\nTOP, 3, 100.\n"


@pytest.mark.slow
def test_a_folder_of_decks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A reference that is 2 % larger, packed; a deck with plasticity."""
    folder = tmp_path / "folder"
    folder.mkdir()
    runs = folder / "runs.inp"
    runs.write_text(DECK + static(LOAD + OUTPUT))
    (folder / "bent.inp").write_text(DECK.replace("*DENSITY", "*PLASTIC\n300., 0.\n*DENSITY") + static(LOAD))
    deck = import_deck(runs)
    [found] = printed_blocks(deck.prints, latin_fmu.solve(latin_fmu.scene_from_dict(dict(deck.tables), folder)))
    reference = dat_text([DatBlock(found.kind, found.target, found.time, found.labels, 1.02 * found.values)])
    (folder / "runs.dat.ref.gz").write_bytes(gzip.compress(reference.encode()))
    monkeypatch.setattr(sys, "argv", ["calculix_decks.py", str(folder), "-o", str(tmp_path)])
    importlib.import_module("calculix_decks").main()
    with (tmp_path / "decks.csv").open() as file:
        bent, ran = csv.DictReader(file)
    assert bent["deck"] == "bent"
    assert bent["outcome"].startswith("refused: bent.inp, line ")
    assert "*PLASTIC" in bent["outcome"]
    assert (ran["outcome"], ran["small"], ran["elements"], ran["nodes"]) == ("runs", "yes", "2", "12")
    assert float(ran["difference"]) == pytest.approx(0.02 / 1.02, rel=1e-3)
    assert ran["worst"] == "U of TIP at 1"
    assert "| runs | " in (tmp_path / "decks.md").read_text()
