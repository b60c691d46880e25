"""The script that tries decks of strangers tells the outcomes apart."""

from __future__ import annotations

from pathlib import Path

import pytest

from . import real_files
from .decks import instances_deck, nastran_deck, surfaces_deck


def test_outcomes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Read, without solids, refused; other files are left out."""
    (tmp_path / "a.inp").write_text(surfaces_deck())
    (tmp_path / "b.inp").write_text(instances_deck())
    (tmp_path / "c.bdf").write_text(nastran_deck())
    (tmp_path / "d.bdf").write_text("GRID,1,,0.,0.,0.\n")
    (tmp_path / "e.inp").write_text("*NODE\n1, x\n")
    (tmp_path / "notes.txt").write_text("none")
    assert real_files.main([str(tmp_path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[:5]] == ["read", "read", "read", "no", "refused"]
    assert "8 hexahedron, volume 1," in lines[0]
    assert "line 2: not a node" in lines[4]
    assert lines[5] == "3 read, 1 no solids, 1 refused"


def test_a_wrong_volume_and_a_traceback_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.inp").write_text(surfaces_deck())
    monkeypatch.setattr(real_files, "by_scikit_fem", lambda _: {"hexahedron": 1.0 + 1e-8})
    assert real_files.row_of(tmp_path / "a.inp")[0] == "WRONG"
    monkeypatch.setattr(real_files, "by_scikit_fem", lambda _: {}["none"])
    assert real_files.row_of(tmp_path / "a.inp") == ("TRACEBACK", "KeyError: 'none'")
    assert real_files.main([str(tmp_path)]) == 1
