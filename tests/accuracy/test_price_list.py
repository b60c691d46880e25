"""Prices of smaller errors: the cheapest mesh and steps of a made-up error and cost, and what the command prints."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
import xarray as xr

import latin_fmu
from latin_fmu.accuracy import price_list
from latin_fmu.accuracy.price_list import MARGIN, PricedRuns, priced, split_of
from latin_fmu.accuracy.runs import Resolution, RunCost
from latin_fmu.cli import main
from latin_fmu.latin.outcome import Timings
from latin_fmu.results.estimates import ErrorEstimate, QuantityEstimate
from latin_fmu.results.prices import Price
from latin_fmu.run_quantities import Quantities
from latin_fmu.scene.schema import Scene

from ..verification.known_answers import MODELS, shipped

Q = "crush.impulse"
CRUSH = MODELS / "two_specimen_crushing/scene.toml"


def measured(of_mesh: float, of_steps: float, split: bool = True) -> PricedRuns:
    """Changes of a value of 1 to a mesh half as fine and to steps twice as long; costs 1 + 2 m^3.5 and (1 + m^4) n."""

    def run(value: float) -> Quantities:
        return Quantities({Q: value}, {Q: 1.0})

    costs = [RunCost(Resolution(m, m), 1.0 + 2.0 * m**3.5, (1.0 + m**4) * m) for m in (1.0, 0.5)]
    other = run(1.0 + of_mesh) if split else None
    return PricedRuns(run(1.0), run(1.0 + of_mesh + of_steps), other, costs, Timings(peak_memory=200_000_000))


def price(scene: Scene, target: float, found: PricedRuns, error: float = 0.08, **more: Any) -> Price:
    """Price of an estimated error (without that of the iteration) of first order."""
    tight = scene.model_copy(update={"solver": scene.solver.model_copy(update={"tolerance": 1e-9})})
    estimate = QuantityEstimate(Q, 1.0, error, 1.0, False, **more)
    prices = priced(tight, ErrorEstimate((estimate,)), found)[Q].prices
    return next(p for p in prices if p.target == target)


def test_the_cheapest_way_by_search_over_all_meshes() -> None:
    """Error 0.08 (0.75 / m + 0.25 / n) to 2 %: the best of the meshes, with the steps that follow, by hand."""
    found = price(shipped("two_specimen_crushing"), 0.02, measured(0.06, 0.02))
    assert not found.reason
    assert 0.08 * (0.75 / found.mesh + 0.25 / found.steps) == pytest.approx(MARGIN * 0.02, rel=1e-6)
    assert found.cpu == pytest.approx(1 + 2 * found.mesh**3.5 + (1 + found.mesh**4) * found.steps, rel=1e-9)
    # no other mesh on a fine grid is cheaper by more than the whole elements that it leaves out cost
    best = math.inf
    for m in (0.5 + 0.01 * k for k in range(351)):
        rest = MARGIN * 0.02 - 0.06 / m
        if rest > 0.02 / 8.0:
            n = max(0.02 / rest, 0.5)
            best = min(best, 1 + 2 * m**3.5 + (1 + m**4) * n)
    assert best <= found.cpu < 1.1 * best


@pytest.mark.parametrize(("of_mesh", "of_steps"), [(0.08, 0.0), (0.0, 0.08)])
def test_what_has_no_share_does_not_change(of_mesh: float, of_steps: float) -> None:
    """An error of the mesh alone costs a finer mesh with the fewest steps; one of the steps, steps on a coarse mesh."""
    found = price(shipped("two_specimen_crushing"), 0.05, measured(of_mesh, of_steps))
    if of_steps == 0.0:
        assert (found.mesh > 1.0, found.steps) == (True, 0.5)
    else:
        assert found.mesh == 0.5
        assert found.steps == pytest.approx(0.08 / (MARGIN * 0.05))


def test_without_the_split_both_change_at_one_ratio() -> None:
    found = price(shipped("two_specimen_crushing"), 0.05, measured(0.06, 0.02, split=False))
    assert found.mesh == found.steps
    assert 0.08 / found.mesh <= MARGIN * 0.05 < 0.08 / (found.mesh / 1.25)


def test_a_run_that_is_within_the_target_is_reached_even_if_no_coarser_one_is() -> None:
    found = price(shipped("two_specimen_crushing"), 0.05, measured(0.04, 0.01), error=0.0499)
    assert (found.mesh, found.steps, found.text) == (1.0, 1.0, "reached")


@pytest.mark.parametrize(
    ("error", "more", "reason"),
    [
        (math.inf, {}, "error unknown"),
        (9.0, {}, "more than 21 min"),
        (9.0, {"bound_only": True}, "changes do not decrease yet"),
    ],
)
def test_what_cannot_be_had_has_a_reason(error: float, more: dict[str, Any], reason: str) -> None:
    scene = shipped("two_specimen_crushing")
    estimate = QuantityEstimate(Q, 1.0, error, 1.0, **{"bound_only": False, **more})
    (found, *_) = priced(scene, ErrorEstimate((estimate,)), measured(0.06, 0.02))[Q].prices
    assert found.reason == reason
    assert math.isnan(found.cpu)


def test_memory_that_the_machine_does_not_have_is_a_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(price_list, "memory_room", lambda: (150e6, "a test"))
    found = price(shipped("two_specimen_crushing"), 0.02, measured(0.06, 0.02))
    assert found.reason == "needs 0.76 GB of memory"


def test_a_raw_peak_has_no_price() -> None:
    scene = shipped("two_specimen_crushing")
    estimate = QuantityEstimate("crush.peak_force_raw", 1.0, 0.03)
    (found, *_) = priced(scene, ErrorEstimate((estimate,)), measured(0.06, 0.02))["crush.peak_force_raw"].prices
    assert found.reason == "no limit as the mesh is refined"


def test_the_iteration_gets_a_tenth_of_a_target() -> None:
    scene = shipped("two_specimen_crushing")
    loose = scene.model_copy(update={"solver": scene.solver.model_copy(update={"tolerance": 0.1})})
    estimate = QuantityEstimate(Q, 1.0, 0.1, 1.0, False)
    prices = priced(loose, ErrorEstimate((estimate,)), measured(0.06, 0.02))[Q].prices
    # the iteration leaves 0.5 of the tolerance on sqrt(eta)
    assert [p.tolerance for p in prices] == pytest.approx([0.01, 0.004, math.nan], nan_ok=True)


def test_the_split_is_run_where_it_is_cheap() -> None:
    """Solids: a sixteenth of the work of the steps; bars: half of it."""
    half = Resolution(0.5, 0.5)
    assert split_of(shipped("two_specimen_crushing"), half) == Resolution(0.5, 1.0)
    assert split_of(shipped("impact_bar"), half) is None
    assert split_of(shipped("two_specimen_crushing"), Resolution(1.0, 0.5)) is None


def test_summary_json_and_dataset_have_the_prices(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", str(CRUSH), "-o", str(tmp_path / "a.nc"), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)["error_estimate"]["quantities"]["crush.peak_force"]["prices"]
    assert [entry["target"] for entry in report] == [0.05, 0.02, 0.01]
    assert report[0]["cpu_seconds"] > 0.0
    assert 0.3 < report[0]["mesh"] <= 1.0
    with xr.open_datatree(tmp_path / "a.nc") as tree:
        group = tree["accuracy"]
        stored = group["cost_cpu"].sel(quantity="crush.peak_force", target=0.05)
        assert float(stored) == pytest.approx(report[0]["cpu_seconds"])
        assert group["cost_cpu"].attrs["units"] == "s"
        assert str(group["cost_reason"].sel(quantity="crush.peak_force_raw", target=0.01).values)
    assert main(["run", str(CRUSH), "-o", str(tmp_path / "b.nc")]) == 0
    lines = capsys.readouterr().out.splitlines()
    (head,) = (i for i, line in enumerate(lines) if line.startswith("  CPU time for an error of"))
    # the largest error first
    assert [line.split()[0] for line in lines[head + 1 : head + 3]] == ["crush.friction_work", "crush.peak_force"]
    assert "reached" in lines[head + 2]


def test_prices_of_a_long_run_are_split_between_mesh_and_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the split, a price may ask for another ratio of mesh and steps."""
    monkeypatch.setattr("latin_fmu.accuracy.estimate.LONG", 0.0)
    scene = shipped("two_specimen_crushing")
    estimate = latin_fmu.estimate_error(scene, latin_fmu.solve(scene))
    prices = [p for q in estimate.quantities for p in q.prices if not p.reason]
    assert any(p.mesh != pytest.approx(p.steps, rel=0.05) for p in prices)


def test_settings_in_words() -> None:
    assert Price(0.01, 1.0, 2.0).setting == "steps x 2"
    assert Price(0.01, 1.0, 1.0, cpu=3.0).text == "reached"
    assert Price(0.01, 2.0, 1.0, cpu=300.0).text == "5 min (elements x 2)"


def test_a_margin_has_an_absolute_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """In a run of half of the shock: the smallest safety less 1, its error beside the table, and in JSON."""
    scene = str(MODELS / "lap_joint" / "shock.toml")
    settings = ["bolt.m6.thread=M6", 'bolt.m6.property_class="8.8"', "time.end=1e-4"]
    changes = [word for setting in settings for word in ("--set", setting)]
    assert main(["run", scene, "-o", str(tmp_path / "a.nc"), "--json", *changes]) == 0
    report = json.loads(capsys.readouterr().out)
    checks = {name: found["safety"] for name, found in report["bolts"]["m6"]["margins"].items()}
    smallest = min(s for name, s in checks.items() if name != "separation" and s is not None)
    estimate = report["error_estimate"]["quantities"]["m6.margin"]
    assert estimate["value"] == pytest.approx(smallest - 1.0)
    assert estimate["unit"] == "1"
    assert 1e-4 < estimate["relative_error"] < 0.3
    with xr.open_datatree(tmp_path / "a.nc") as tree:
        rows = json.loads(tree["summary"].attrs["margins"])
    assert rows[0][-1] == "smallest"
    assert rows[2][-1].startswith(f"{smallest:.3g} +- {max(estimate['relative_error'], 1e-3):.2g}")


@pytest.mark.parametrize(("error", "words"), [(0.3, "0.3"), (1e-5, "0.001"), (math.inf, "unknown")])
def test_words_of_an_absolute_error(error: float, words: str) -> None:
    assert QuantityEstimate("m6.margin", 0.02, error).error_text == words
