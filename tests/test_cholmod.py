"""CHOLMOD beside the factors and the linear march: the same answer, and our own numbers where it is missing."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import scipy.sparse as sp

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


@pytest.fixture
def example(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(EXAMPLES))
    return importlib.import_module("against_cholmod")


def test_fill_is_that_of_the_dense_factor(example: ModuleType) -> None:
    """A band of three in its own order has no fill; an arrow with its tip first is full."""
    n = 7
    band = sp.csr_array(sp.diags_array([np.ones(n - 1), 4.0 * np.ones(n), np.ones(n - 1)], offsets=[-1, 0, 1]))
    assert example.fill(band, np.arange(n)) == 2 * n - 1
    arrow = sp.lil_array(4.0 * np.eye(n))
    arrow[0, :], arrow[:, 0] = 1.0, 1.0
    assert example.fill(sp.csr_array(arrow), np.arange(n)) == n * (n + 1) // 2
    assert example.fill(sp.csr_array(arrow), -np.arange(n)) == 2 * n - 1


def test_linear_march_of_the_peer(example: ModuleType) -> None:
    found = example.library()
    if found is None:
        pytest.skip(example.MISSING)
    problems, timing = (importlib.import_module(name) for name in ("benchmark_problems", "benchmark_timing"))
    floor = importlib.import_module("benchmark_floor").Floor(timing.prepared(problems.crushing(3, 0.3), example.OWN))
    own = floor.lean()
    for way in example.WAYS:
        assert np.abs(example.march(found, way, floor) - own).max() < 1e-12 * np.abs(own).max(), way


def test_our_own_numbers_without_the_peer(
    example: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(example, "library", lambda: None)
    (seconds,) = example.main(["--quick", "--rounds", "1"])
    assert set(seconds) == {"contact and friction", "own floor", "own factor, same loop"}
    out = capsys.readouterr().out
    assert out.startswith(example.MISSING)
    assert "over the best CHOLMOD" not in out
