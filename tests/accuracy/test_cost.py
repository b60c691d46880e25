"""The command ``latin-fmu cost``: its files and its output; failures are listed."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from latin_fmu.accuracy import study as study_module
from latin_fmu.accuracy.price_figure import price_figure
from latin_fmu.accuracy.runs import MeasuredRun, Resolution, RunCost, RunTimeFit, run_at
from latin_fmu.accuracy.study import (
    REDUCTION,
    SPACE,
    TIGHT,
    TIME,
    TOGETHER,
    TOLERANCE,
    Reference,
    Row,
    Study,
    StudyRuns,
    cheapest,
    sources,
    unreduced,
    useful_tolerances,
    variants_of,
)
from latin_fmu.accuracy.study_text import as_text
from latin_fmu.cli import main
from latin_fmu.latin.outcome import Timings
from latin_fmu.reader import load_scene
from latin_fmu.run_quantities import Quantities
from latin_fmu.scene.settings import MasslessContactTable
from latin_fmu.time_scheme import SCHEMES

from ..verification.known_answers import MODELS, shipped

Q = "meet.impulse"


def made_up(mesh: float, steps: float, tolerance: float = 1e-3, cpu: float = 1.0, left: float = 0.0) -> Row:
    """A run whose impulse is 1 + 0.04 h + 0.01 dt + 0.3 tolerance (+ ``left``)."""
    value = 1.0 + 0.04 / mesh + 0.01 / steps + 0.3 * tolerance + left
    at = Resolution(mesh, steps, tolerance)
    run = MeasuredRun(at, Quantities({Q: value}, {Q: 1.0}), cpu, Timings(), (3.0, 4), True, "", 100, 4.0)
    return Row("", "own", tolerance, run)


@pytest.fixture
def linear() -> Study:
    """A study with every source of error known, exact reference 1."""
    rows = []
    for f in (0.5, 1.0, 2.0, 4.0):
        rows.append((TOGETHER, made_up(f, f, cpu=f**2)))
        rows += [(SPACE, made_up(f, 1.0, cpu=3.0 * f)), (TIME, made_up(1.0, f, cpu=2.0 + f))]
        rows += [(TOLERANCE, made_up(f, f, t)) for t in (TIGHT, 1e-1, 1e-2, 1e-3, 1e-4)]
    for series, row in rows:
        row.series = series
    study = Study(shipped("impact_bar"), "own", Reference(Quantities({Q: 1.0}, {Q: 1.0}), True, "made up"))
    study.rows = [row for _, row in rows]
    return study


def test_sources_are_separated(linear: Study) -> None:
    parts = sources(linear, Q)
    assert parts.total == pytest.approx(0.0503)
    assert parts.space == pytest.approx(0.04, rel=0.02)
    assert parts.time == pytest.approx(0.01, rel=0.02)
    assert parts.iteration == pytest.approx(0.3e-3, rel=0.02)
    assert math.isnan(parts.reduction)
    linear.rows.append(replace(made_up(1.0, 1.0, left=-0.02), series=REDUCTION, variant="whole"))
    assert sources(linear, Q).reduction == pytest.approx(0.02)
    assert parts.order_together == pytest.approx(1.0, abs=0.01)
    assert parts.order_space == pytest.approx(1.0, abs=0.01)
    assert parts.order_time == pytest.approx(1.0, abs=0.01)


def test_the_price_is_that_of_the_cheapest_run_that_keeps_the_target(linear: Study) -> None:
    """Error 0.05 / f: 3 % from f = 2 on, which costs 4; a lucky coarse run does not count."""
    lucky = made_up(0.25, 0.25, cpu=0.1, left=-0.2)
    lucky.series = TOGETHER
    linear.rows.append(lucky)
    assert abs(linear.error(lucky, Q)) < 0.03
    found = cheapest(linear, Q, 0.03)
    assert found is not None
    assert found.run.cpu == 4.0
    assert cheapest(linear, Q, 1e-3) is None


def test_the_cheapest_way_may_be_the_mesh_alone(linear: Study) -> None:
    """Error 0.04 / m + 0.01 at the steps as written: 3.1 % at twice the mesh, which costs 6 in place of 4 together;
    with a mesh that costs less, it is the cheapest."""
    for row in linear.rows:
        if row.series == SPACE:
            row.run = replace(row.run, cpu=0.5 * row.run.cpu)
    found = cheapest(linear, Q, 0.032)
    assert found is not None
    assert (found.series, found.run.cpu) == (SPACE, 3.0)


def test_the_figure_shows_three_ways_the_run_and_its_stars(linear: Study) -> None:
    """Lines of the three ways, the run as written, one star for the targets of one run, and what is not reached."""
    figure = price_figure([linear])
    (axes,) = figure.axes
    labels = [line.get_label() for line in axes.get_lines()]
    assert labels[:3] == ["finer mesh and shorter steps", "finer mesh", "shorter steps"]
    together = axes.get_lines()[0]
    # 10, 5, 2.5, 1.25 %, each with the error of the tolerance
    assert together.get_ydata() == pytest.approx([10.03, 5.03, 2.53, 1.28])
    texts = "\n".join(text.get_text() for text in axes.texts)
    assert "5 %: 4 s\nelements, steps x 2" in texts
    assert "2 %: 16 s\nelements, steps x 4" in texts
    assert "1 %: not reached" in texts


def test_where_the_tolerance_stops_to_matter(linear: Study) -> None:
    """Iteration error 0.3 tol against a tenth of 0.05 / f: 1e-2 for f = 1 (3e-3 < 5e-3), 1e-3 for f = 4."""
    tolerances = useful_tolerances(linear, Q)
    assert tolerances == {0.5: 1e-2, 1.0: 1e-2, 2.0: 1e-3, 4.0: 1e-3}


def test_a_run_that_fails_is_kept(linear: Study) -> None:
    linear.rows.append(Row(TOGETHER, "other", 1e-3, MeasuredRun(Resolution(), status="no step is stable")))
    assert math.isnan(linear.error(linear.rows[-1], Q))
    assert linear.of(TOGETHER, "other") == []


def test_every_scheme_of_the_registry_is_tried() -> None:
    scene = shipped("impact_bar")
    names = {v.name for v in variants_of(scene)} | {study_module.main_variant(scene).name}
    assert {name for name in SCHEMES if "static" not in name and "euler" not in name} <= names
    assert MasslessContactTable().type in names


def test_run_time_fit_follows_two_runs() -> None:
    """0.1 + 0.2 m of the set-up and (0.3 + 0.4 m) n of the steps, of bars."""
    costs = [RunCost(Resolution(f, f), 0.1 + 0.2 * f, (0.3 + 0.4 * f) * f) for f in (1.0, 2.0)]
    fit = RunTimeFit.of(shipped("impact_bar"), costs)
    assert fit.seconds(4.0, 4.0) == pytest.approx(0.1 + 0.2 * 4 + (0.3 + 0.4 * 4) * 4)
    assert fit.seconds(1.0, 3.0) == pytest.approx(0.1 + 0.2 + (0.3 + 0.4) * 3)
    assert fit.seconds(3.0, 1.0) == pytest.approx(0.1 + 0.2 * 3 + 0.3 + 0.4 * 3)


@pytest.mark.parametrize(("setup", "foreseen"), [((0.5, 0.3, 0.5), 0.1 + 0.2 * 4), ((0.5, 0.4, 0.1), 0.1 / 2 * 4)])
def test_run_time_fit_with_an_expensive_first_run(setup: tuple[float, float, float], foreseen: float) -> None:
    """The first run of a process also pays for loading kernels: the cheapest and the largest count; where the largest
    is the cheapest, all its cost is taken for work."""
    costs = [RunCost(Resolution(f, f), seconds, 0.0) for f, seconds in zip((0.5, 1.0, 2.0), setup, strict=True)]
    assert RunTimeFit.of(shipped("impact_bar"), costs).seconds(4.0, 4.0) == pytest.approx(foreseen)


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few tolerances and windows: the command in seconds."""
    monkeypatch.setattr(study_module, "TOLERANCES", (1e-1, 1e-3))
    monkeypatch.setattr(study_module, "directions_of", lambda _: ["automatic"])


@pytest.mark.usefixtures("small")
def test_the_command_writes_page_figure_and_dataset(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["cost", str(MODELS / "impact_bar/scene.toml"), "--budget", "4", "--json", "-o", str(tmp_path)]
    settings = ["--methods", "--set", "substructure.bar.box.elements=[1, 1, 32]", "--set", "time.instants=128"]
    assert main([*arguments, *settings]) == 0
    captured = capsys.readouterr()
    (printed,) = json.loads(captured.out, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))
    assert printed["reference"]["exact"] is True
    assert printed["reference"]["values"]["wall.impulse"] == pytest.approx(200.0)
    assert {r["series"] for r in printed["runs"]} == {"together", "space", "time", "tolerance", "windows"}
    refused = [r for r in printed["runs"] if r["failure"]]
    assert any(r["scheme"] == "central_difference" for r in refused)  # its step is too long: listed
    own = [
        r["errors"]["wall.impulse"]
        for r in printed["runs"]
        if r["series"] == "together" and r["scheme"] == "generalized_alpha"
    ]
    assert own[-1] < own[0] < 0.2
    assert "mesh x" in captured.err  # progress
    page = (tmp_path / "impact_bar_cost.md").read_text(encoding="utf-8")
    for part in (
        "cheapest setting",
        "sources of error",
        "is negligible",
        "failed or were refused",
        "impact_bar_cost.png",
    ):
        assert part in page
    assert (tmp_path / "impact_bar_cost.png").read_bytes().startswith(b"\x89PNG")
    with xr.open_datatree(tmp_path / "impact_bar_cost.nc") as tree:
        assert tree["runs"].sizes["run"] == len(printed["runs"])
        errors = tree["runs"]["error"].sel(quantity="wall.impulse").values
        assert np.isfinite(errors).sum() == sum(r["failure"] is None for r in printed["runs"])


@pytest.mark.slow
@pytest.mark.usefixtures("small")
def test_what_a_reduction_costs_is_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two modes against all: the distance to the same march by factors, both solved here once more; the curve of the
    march by factors stands beside that of the modes."""
    monkeypatch.setattr(study_module, "_vary_windows", lambda *_: None)
    settings = ["substructure.bar.box.elements=[1, 1, 32]", "time.instants=128", "output.energy=false"]
    settings += ["time.scheme=hht"]  # which the modes take
    file = MODELS / "impact_bar/scene.toml"
    few = ["solver.propagator={type = 'reduced', modes = 2}"]
    study = study_module.study(load_scene(file, [*settings, *few]), 3.0, lambda _: None, methods=True)
    reduced, whole = (run_at(load_scene(file, [*settings, *s]), Resolution()) for s in (few, []))
    value, expected = (r.quantities.values["wall.impulse"] for r in (reduced, whole))
    error_parts = sources(study, "wall.impulse")
    assert error_parts.reduction == pytest.approx(abs(value - expected) / expected, rel=1e-9)
    assert error_parts.reduction > 0.02
    assert f"{100 * error_parts.reduction:.2g} %" in as_text(study)
    assert study.of(TOGETHER, "hht -0.1")
    direct = load_scene(file, settings)
    assert unreduced(direct) is None
    assert unreduced(study.scene).scene.solver.propagator.type == "direct"
    assert unreduced(direct, [replace(made_up(1.0, 1.0).run, by_modes=True)]).scene.solver.propagator.type == "direct"


def test_the_target_folder_is_checked_before_the_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "taken").write_text("")
    scene = str(MODELS / "impact_bar/scene.toml")
    assert main(["cost", scene, "-o", str(tmp_path / "taken")]) == 2
    assert main(["cost", scene, "-o", str(tmp_path / "no" / "where")]) == 2
    assert main(["cost", scene, "--budget", "-1"]) == 2
    assert "latin-fmu:" in capsys.readouterr().err


def test_what_cannot_be_studied_is_refused_with_the_reason(capsys: pytest.CaptureFixture[str]) -> None:
    """A quantity that no scene has, before any run; a scene of which no run converges."""
    scene = str(MODELS / "impact_bar/scene.toml")
    assert main(["cost", scene, "--of", "wall.peak_farce"]) == 2
    assert "--of: unknown quantity (value: wall.peak_farce)" in capsys.readouterr().err
    settings = ["solver.max_iterations=1", "solver.tolerance=1e-12", "time.instants=32"]
    assert main(["cost", scene, "-q", *(word for s in settings for word in ("--set", s))]) != 0
    told = capsys.readouterr().err
    assert "no run as written or coarser has converged" in told
    assert "Traceback" not in told


def test_a_scene_without_a_declared_reference_gets_a_refined_run_with_its_own_error() -> None:
    made = StudyRuns(3.0, lambda _: None)
    scene = shipped("impact_bar")
    main_variant = study_module.main_variant(scene)
    run = made.run(TOGETHER, main_variant, Resolution(0.5, 0.5))
    assert run is not None
    reference = study_module.finest_reference(scene, made, main_variant, [run])
    assert not reference.exact
    assert reference.own_error is not None
    assert 0.01 < reference.own_error["wall.impulse"].error < 0.06  # true 1.7 %
