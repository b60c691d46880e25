"""The benchmark runs, prints its table, and its floor is the linear transient."""

from __future__ import annotations

import importlib
import json
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
KEYS = ("case", "n_blocks", "mu", "propagator", "ratio", "floor_seconds", "seconds", "iterations", "error")


@pytest.fixture
def module(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(EXAMPLES))
    return importlib.import_module(request.param)


def _rows(module: ModuleType, arguments: list[str], capsys: pytest.CaptureFixture[str]) -> list[dict[str, object]]:
    module.main([*arguments, "--json"])
    rows = json.loads(capsys.readouterr().out)
    for row in rows:
        assert tuple(row) == KEYS
        assert row["ratio"] == pytest.approx(row["seconds"] / row["floor_seconds"])
        assert 0.0 < row["error"] < (0.02 if "direct" in row["propagator"] else 0.3)
        assert 1.0 < row["iterations"] < 12.0
    return rows


@pytest.mark.parametrize("module", ["price_of_friction"], indirect=True)
def test_json_is_one_list(module: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    rows = _rows(module, ["--quick", "--only", "P2", "--rounds", "1"], capsys)
    assert {(r["case"], r["n_blocks"], r["mu"]) for r in rows} == {("P2 n=4", 2, 0.1), ("P2 n=4", 2, 10.0)}
    assert "direct" in {r["propagator"] for r in rows}


@pytest.mark.slow
@pytest.mark.parametrize("module", ["price_of_friction"], indirect=True)
def test_quick_cases(module: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    rows = _rows(module, ["--quick"], capsys)
    combinations = {(r["case"], r["n_blocks"], r["mu"], r["propagator"]) for r in rows}
    assert combinations >= {
        ("P1 1x1x50", 2, 0.0, "direct"),
        ("P2 n=4", 2, 0.1, "direct"),
        ("P2 n=4", 2, 10.0, "direct"),
        ("P3 n=4", 2, 0.3, "direct"),
        ("P3 n=4", 16, 0.3, "direct"),
        ("P3 n=4", 16, 0.3, "direct_batched"),
    }


@pytest.mark.parametrize("module", ["benchmark_timing"], indirect=True)
def test_floors_are_the_same_linear_transient(module: ModuleType) -> None:
    problems = importlib.import_module("benchmark_problems")
    floor = importlib.import_module("benchmark_floor").Floor(
        module.prepared(problems.tower(3, 2), {"share_identical": False})
    )
    ends = {name: march() for name, march in floor.marches.items()}
    package = floor.package().state.u[:, 0]
    for name, end in ends.items():
        last = end if isinstance(end, np.ndarray) else end.state.u[:, 0]
        assert np.abs(last - package).max() < 1e-12 * np.abs(package).max(), name


@pytest.mark.parametrize("module", ["benchmark_figure"], indirect=True)
def test_figure_shows_every_row(module: ModuleType, tmp_path: Path) -> None:
    rows = [
        dict(zip(KEYS, (case, blocks, mu, kind, 1.2, 0.1, 0.12, 4.0, 1e-3), strict=True))
        for case, blocks, mu in (("P1 1x1x50", 2, 0.0), ("P2 n=4", 2, 0.1), ("P3 n=4", 2, 0.3), ("P3 n=4", 16, 0.3))
        for kind in ("direct", "direct_batched")
    ]
    drawing = module.figure(rows)
    drawing.savefig(tmp_path / "figure.png")
    points = sum(len(line.get_xdata()) for axis in drawing.axes for line in axis.lines if line.get_marker() != "None")
    assert points == len(rows)


@pytest.mark.parametrize("module", ["benchmark_accuracy"], indirect=True)
def test_iteration_adds_nothing_to_the_error_of_the_steps(module: ModuleType) -> None:
    """Default tolerances against the coupled discrete problem, both measured from the exact solution of P1."""
    problems, exact = (importlib.import_module("benchmark_problems"), importlib.import_module("benchmark_exact"))
    case = problems.bars((1, 1, 50), None)
    at = np.linspace(0.0, 100e-6, 2001)
    full, default = (
        module.errors(*module.histories(case, module.LINES[n], 1e-4), at, exact.bars_exact(at))
        for n in ("full march", "direct")
    )
    assert full["contact force"] < 0.15
    assert full["top displacement"] < 0.02
    assert full["impulse"] < 0.004
    for name, value in default.items():
        assert value < 1.05 * full[name], name


@pytest.mark.parametrize("module", ["benchmark_exact"], indirect=True)
def test_exact_motion_of_the_loaded_face(module: ModuleType) -> None:
    """p t / (rho c) until the front is back from the gap, three times as fast while the reflection of it holds."""
    speed, transit = 100e6 / np.sqrt(210e9 * 7800.0), 0.1 * np.sqrt(7800.0 / 210e9)
    at = np.array([0.5, 1.9, 2.05]) * transit
    moved = module.bars_exact(at)["top displacement"]
    expected = -speed * np.array([0.5 * transit, 1.9 * transit, 2.0 * transit + 3.0 * 0.05 * transit])
    assert moved == pytest.approx(expected, rel=2e-3)
