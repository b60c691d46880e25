"""Damaged scenes, meshes and load tables through the command line: solved, or refused with exit code 2 and a place."""

from __future__ import annotations

import os

import pytest

from .mutations import attempt


def check(seed, tmp_path, capsys):
    result = attempt(seed, tmp_path / f"s{seed}", capsys)
    hint = f"seed {seed}, changed {result.changed}: {result.code}, {result.said[:400]!r}, left {result.left}"
    assert result.code in (0, 1, 2), hint
    assert "Traceback" not in result.said, hint
    if result.code == 2:
        assert result.left == [], hint
        assert result.said.startswith("latin-fmu: "), hint
        named = result.said.split("latin-fmu: ", 1)[1]
        places = (
            "material",
            "substructure",
            "interface",
            "boundary",
            "load",
            "time",
            "solver",
            "output",
            "line",
            "scene",
            os.sep,
            "name",
        )
        assert any(place in named for place in places), hint
    else:
        assert set(result.left) <= {"out.nc"}, hint


@pytest.mark.parametrize("seed", range(24))
def test_damaged_input(seed, tmp_path, capsys):
    check(seed, tmp_path, capsys)


@pytest.mark.slow
@pytest.mark.parametrize("block", range(24))
def test_a_thousand_damaged_inputs(block, tmp_path, capsys):
    for seed in range(1000 + 50 * block, 1000 + 50 * (block + 1)):
        check(seed, tmp_path, capsys)
