"""Stresses at the nodes: closed forms of a plate with a hole and of a shouldered bar, and CalculiX if there is one."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from latin_fmu.fem.elements import principal


@pytest.fixture
def example() -> ModuleType:
    return importlib.import_module("stress_at_nodes")


@pytest.mark.parametrize(("name", "counts", "error"), [("plate", (10, 12), 0.01), ("bar", (6, 6, 3), 0.03)])
def test_stress_concentrations(
    example: ModuleType, name: str, counts: tuple[int, ...], error: float, tmp_path: Path
) -> None:
    """The largest tension at a hole is 3.03 times that of the plate, at a fillet 1.79 times that of the bar; every node
    has the stress that CalculiX gives it."""
    solid = getattr(example, name)(*counts)
    here = example.of_package(solid, tmp_path)
    tension = principal(here)[:, 0]
    assert tension.max() == pytest.approx(solid.factor * example.PULL, rel=error)
    end = solid.nodes[:, solid.axis] == solid.nodes[:, solid.axis].max()
    assert tension[end] == pytest.approx(example.PULL, rel=0.02)
    there = example.of_calculix(solid.deck())
    if there is None:
        pytest.skip(example.MISSING)
    found = example.compared(name, here, there, np.zeros(len(here), dtype=bool), 0.0)
    assert found.everywhere < 2e-3
    assert found.here == pytest.approx(found.there, rel=1e-3)


@pytest.mark.slow
def test_flange_away_from_contact_edges(example: ModuleType) -> None:
    """Ten parts with contact and friction on one mesh: von Mises stresses of both codes at the nodes."""
    pytest.importorskip("gmsh")
    if not example.installed():
        pytest.skip(example.MISSING)
    found = example.flange_comparison(example.flange.Mesh(6.0, 6.0, 2.5), 300.0)
    assert found.away < 0.01
    assert 0.0 < found.everywhere < 0.02


def test_says_when_there_is_no_calculix(
    example: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(example, "installed", lambda: False)
    coarse = example.plate(4, 4)
    for name in ("plate", "bar"):
        monkeypatch.setattr(example, name, lambda: coarse)
    monkeypatch.setattr(example, "find_spec", lambda _: None)
    assert example.main([]) == 0
    text = capsys.readouterr().out
    assert example.MISSING in text
    assert "closed form" in text
