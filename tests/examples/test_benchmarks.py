"""The benchmarks run, their floor is the linear transient, and peers solve the same problems to the same numbers."""

from __future__ import annotations

import importlib
import importlib.util
import json
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import scipy.sparse as sp

from latin_fmu import scene_from_dict, solve
from latin_fmu.building import discretise
from latin_fmu.effects.cost import SECONDS, march_counts, operator_counts, run_size

KEYS = ("case", "n_blocks", "mu", "propagator", "ratio", "floor_seconds", "seconds", "iterations", "error")


def _rows(example: ModuleType, arguments: list[str], capsys: pytest.CaptureFixture[str]) -> list[dict[str, object]]:
    example.main([*arguments, "--json"])
    rows = json.loads(capsys.readouterr().out)
    for row in rows:
        assert tuple(row) == KEYS
        assert row["ratio"] == pytest.approx(row["seconds"] / row["floor_seconds"])
        assert 0.0 < row["error"] < (0.02 if "direct" in row["propagator"] else 0.3)
        assert 1.0 < row["iterations"] < 12.0
    return rows


@pytest.mark.slow
@pytest.mark.parametrize("example", ["price_of_friction"], indirect=True)
def test_json_is_one_list(example: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    rows = _rows(example, ["--quick", "--only", "P2", "--rounds", "1"], capsys)
    assert {(r["case"], r["n_blocks"], r["mu"]) for r in rows} == {("P2 n=4", 2, 0.1), ("P2 n=4", 2, 10.0)}
    assert "direct" in {r["propagator"] for r in rows}


@pytest.mark.slow
@pytest.mark.parametrize("example", ["price_of_friction"], indirect=True)
def test_quick_cases(example: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    rows = _rows(example, ["--quick"], capsys)
    combinations = {(r["case"], r["n_blocks"], r["mu"], r["propagator"]) for r in rows}
    assert combinations >= {
        ("P1 1x1x50", 2, 0.0, "direct"),
        ("P2 n=4", 2, 0.1, "direct"),
        ("P2 n=4", 2, 10.0, "direct"),
        ("P3 n=4", 2, 0.3, "direct"),
        ("P3 n=4", 16, 0.3, "direct"),
        ("P3 n=4", 16, 0.3, "direct_batched"),
    }


def test_floors_are_the_same_linear_transient() -> None:
    harness = importlib.import_module("harness")
    floor = importlib.import_module("floor").Floor(harness.prepared(harness.tower(3, 2), {"share_identical": False}))
    ends = {name: march() for name, march in floor.marches.items()}
    package = floor.compiled().state.u[:, 0]
    for name, end in ends.items():
        last = end if isinstance(end, np.ndarray) else end.state.u[:, 0]
        assert np.abs(last - package).max() < 1e-12 * np.abs(package).max(), name


@pytest.mark.parametrize("example", ["price_of_friction"], indirect=True)
def test_figure_shows_every_row(example: ModuleType, tmp_path: Path) -> None:
    rows = [
        example.Row(case, blocks, mu, kind, 1.2, 0.1, 0.12, 4.0, 1e-3)
        for case, blocks, mu in (("P1 1x1x50", 2, 0.0), ("P2 n=4", 2, 0.1), ("P3 n=4", 2, 0.3), ("P3 n=4", 16, 0.3))
        for kind in ("direct", "direct_batched")
    ]
    drawing = example.figure(rows)
    drawing.savefig(tmp_path / "figure.png")
    points = sum(len(line.get_xdata()) for axis in drawing.axes for line in axis.lines if line.get_marker() != "None")
    assert points == len(rows)


def test_iteration_adds_nothing_to_the_error_of_the_steps() -> None:
    """Default tolerances against the coupled discrete problem, both measured from the exact solution of P1."""
    harness = importlib.import_module("harness")
    case = harness.bars((1, 1, 50), None)
    case = replace(case, description=case.description | {"output": {"fields": True}})
    at = np.linspace(0.0, 100e-6, 2001)
    exact = harness.bars_exact(at)

    def errors(solver: dict[str, float]) -> dict[str, float]:
        found = harness.contact_run(harness.stable(case, {"propagator": "direct", **solver}))
        above = found.substructures["b2"]
        top = above.nodes[:, 2] >= above.nodes[:, 2].max() - 1e-9
        force = found.interfaces["i1"].normal_resultant() / harness.EDGE**2
        histories = {"contact force": force, "top displacement": above.displacement[:, top, 2].mean(axis=1)}
        off = {
            name: np.linalg.norm(np.interp(at, found.time, history) - exact[name]) / np.linalg.norm(exact[name])
            for name, history in histories.items()
        }
        impulse = np.trapezoid(exact["contact force"], at)
        return off | {"impulse": abs(np.trapezoid(force, found.time) / impulse - 1.0)}

    full, default = errors(harness.TIGHT), errors({})
    assert full["contact force"] < 0.15
    assert full["top displacement"] < 0.02
    assert full["impulse"] < 0.004
    for name, value in default.items():
        assert value < 1.05 * full[name], name


def test_exact_solution_of_the_bars() -> None:
    """Closed form: contact a gap over 2 p / (rho c) after the front, then whole transits. The loaded face moves
    p t / (rho c) until the front is back from the gap, three times as fast while the reflection of it holds."""
    harness = importlib.import_module("harness")
    speed, transit = 100e6 / np.sqrt(210e9 * 7800.0), 0.1 * np.sqrt(7800.0 / 210e9)
    first = transit + 1e-5 / (2 * speed)
    assert first == pytest.approx(21.30e-6, abs=5e-9)
    times = [first - 5e-8, first + 5e-8, 3 * transit - 5e-8, 3 * transit + 5e-8, first + 2 * transit + 1e-6]
    found = harness.bars_exact(np.array(times))["contact force"]
    assert found == pytest.approx([0.0, 100e6, 100e6, 200e6, 200e6])
    moved = harness.bars_exact(np.array([0.5, 1.9, 2.05]) * transit)["top displacement"]
    expected = -speed * np.array([0.5 * transit, 1.9 * transit, 2.0 * transit + 3.0 * 0.05 * transit])
    assert moved == pytest.approx(expected, rel=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("example", ["price_of_accuracy"], indirect=True)
def test_price_of_accuracy(example: ModuleType) -> None:
    """Times are printed, not asserted; the accuracy that is reached holds."""
    numbers = example.main(["--quick"])
    assert numbers["cases"] == numbers["reached"] == numbers["true_error_below_target"] == 2
    assert numbers["not_reached_by_the_study"] == 0
    assert 0.0 < numbers["median_ratio_own_scheme"] < 20.0


@pytest.mark.slow
@pytest.mark.parametrize("example", ["cost_model"], indirect=True)
def test_cost_model(example: ModuleType) -> None:
    """Times of a shared machine are printed, not asserted."""
    numbers = example.main(["--quick"])
    assert numbers["scenes"] > 30
    assert 1.0 <= numbers["typical_factor"] <= numbers["worst_factor"]


@pytest.mark.parametrize("example", ["cost_model"], indirect=True)
def test_the_fit_finds_the_seconds_that_made_the_times(example: ModuleType) -> None:
    """Times computed with other seconds than those of the package: the fit finds these."""
    per = SECONDS * np.arange(2.0, 7.0)
    runs = []
    for one in example.benchmarks(quick=True).values():
        size = run_size(discretise(one))
        runs.append(example.Measured(size, operator_counts(size) @ per, march_counts(size) @ per, size.iterations))
    np.testing.assert_allclose(example.fitted(runs), per, rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("example", ["large_faces"], indirect=True)
def test_large_faces(example: ModuleType, tmp_path: Path) -> None:
    costs = example.main(["--quick", "-o", str(tmp_path)])["exact"]
    assert (tmp_path / "large_faces.png").exists()
    assert [c.points for c in costs] == [81, 169]
    assert all(c.ratio > 1.0 and c.set_up > 0.0 and 2.0 < c.iterations < 5.0 for c in costs)


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("mpi4py") is None, reason="no MPI")
@pytest.mark.parametrize("example", ["growth"], indirect=True)
def test_growth(example: ModuleType, tmp_path: Path) -> None:
    lines = example.main(["--quick", "-o", str(tmp_path)])
    assert (tmp_path / "growth.png").exists()
    assert [[n for n, _ in line] for line in lines.values()] == [[49, 81], *[[192, 375]] * 2, *[[2, 4]] * 2, [1, 2]]
    assert all(cost > 0.0 for line in lines.values() for _, cost in line)


@pytest.mark.parametrize("example", ["small_runs"], indirect=True)
def test_small_runs(example: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    found = example.main(["--rounds", "1", "--only", "march", "set-up"])
    assert list(found) == ["march", "set-up"]
    assert [len(numbers) for numbers in found.values()] == [5, 2]
    assert all(0.0 < number < 1e4 for numbers in found.values() for number in numbers)
    assert len(capsys.readouterr().out.splitlines()) == 7
    lidded = scene_from_dict(example.with_lid(example.crushing(2, 0.3).description))
    assert solve(lidded).outcome.settings["left out, never touched"] == "lid"


@pytest.mark.parametrize("example", ["against_cholmod"], indirect=True)
def test_fill_is_that_of_the_dense_factor(example: ModuleType) -> None:
    """A band of three in its own order has no fill; an arrow with its tip first is full."""
    n = 7
    band = sp.csr_array(sp.diags_array([np.ones(n - 1), 4.0 * np.ones(n), np.ones(n - 1)], offsets=[-1, 0, 1]))
    assert example.fill(band, np.arange(n)) == 2 * n - 1
    arrow = sp.lil_array(4.0 * np.eye(n))
    arrow[0, :], arrow[:, 0] = 1.0, 1.0
    assert example.fill(sp.csr_array(arrow), np.arange(n)) == n * (n + 1) // 2
    assert example.fill(sp.csr_array(arrow), -np.arange(n)) == 2 * n - 1


@pytest.mark.parametrize("example", ["against_cholmod"], indirect=True)
def test_linear_march_of_the_peer(example: ModuleType) -> None:
    found = example.library()
    if found is None:
        pytest.skip(example.MISSING)
    floor = importlib.import_module("floor").Floor(example.prepared(example.crushing(3, 0.3), example.OWN))
    own = floor.lean()
    for way in example.WAYS:
        assert np.abs(example.march(found, way, floor) - own).max() < 1e-12 * np.abs(own).max(), way


@pytest.mark.parametrize("example", ["against_cholmod"], indirect=True)
def test_our_own_numbers_without_the_peer(
    example: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(example, "library", lambda: None)
    (seconds,) = example.main(["--quick", "--rounds", "1"])
    assert set(seconds) == {"contact and friction", "own floor", "own factor, same loop"}
    out = capsys.readouterr().out
    assert out.startswith(example.MISSING)
    assert "over the best CHOLMOD" not in out


def _siconos() -> ModuleType:
    benchmark = importlib.import_module("against_siconos")
    if benchmark.library() is None:
        pytest.skip(benchmark.MISSING)
    return benchmark


def test_contact_law_of_the_rival() -> None:
    """Signorini and Coulomb at every point, the first components being normal."""
    benchmark = _siconos()
    random = np.random.default_rng(1)
    n, mu = 12, 0.3
    half = random.normal(size=(3 * n, 3 * n))
    w = half @ half.T + np.eye(3 * n)
    points = benchmark.Contacts(benchmark.library(), w, np.full(n, mu), 1e-12)
    points.q[:] = random.normal(size=3 * n)
    points.solve()
    p, u = points.impulse.reshape(-1, 3), (w @ points.impulse + points.q).reshape(-1, 3)
    scale = np.abs(points.q).max()
    assert (p[:, 0] >= 0.0).all()
    assert u[:, 0].min() > -1e-9 * scale
    assert np.abs(p[:, 0] * u[:, 0]).max() < 1e-9 * scale * p.max()
    pressed = p[:, 0] > 0.0
    assert 0 < pressed.sum() < n
    friction, slip = np.linalg.norm(p[pressed, 1:], axis=1), u[pressed, 1:]
    assert (friction <= mu * p[pressed, 0] * (1 + 1e-9)).all()
    # what slips is at the cone, and pulled against its motion
    speed = np.linalg.norm(slip, axis=1)
    work = np.einsum("ij,ij->i", slip, p[pressed, 1:])
    assert work == pytest.approx(-speed * mu * p[pressed, 0], abs=1e-9 * scale)


def test_answer_of_the_rival() -> None:
    """Moreau-Jean on the same matrices: the same normal forces within the error of the schemes."""
    benchmark = _siconos()
    ready = benchmark.prepared(benchmark.tower(3, 3), benchmark.OWN)
    outcome = benchmark.contact_run(ready)
    here = np.stack([outcome.interfaces[u.name].normal_resultant() for u in ready.units], axis=1)
    there = benchmark.MoreauJean(ready, benchmark.library(), 1e-6).run()
    assert np.linalg.norm(there - here) < 0.04 * np.linalg.norm(here)
    assert there.sum(axis=0) == pytest.approx(here.sum(axis=0), rel=2e-3)


def test_says_when_there_is_no_siconos(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    example = importlib.import_module("against_siconos")
    monkeypatch.setattr(example, "library", lambda: None)
    assert example.main([]) == 0
    assert "not installed" in capsys.readouterr().out
