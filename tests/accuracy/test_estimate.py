"""The error of a run: extrapolation of a cross of runs, the coarser runs, the estimate in reports and files."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.accuracy import estimate as estimate_module
from latin_fmu.accuracy.estimate import (
    Changes,
    coarser_runs_of,
    estimate_error,
    estimated_error,
    observed_order,
    quantity_estimate,
)
from latin_fmu.accuracy.runs import (
    MeasuredRun,
    Resolution,
    aligned,
    at_resolution,
    in_short_windows,
    mesh_factor,
    reachable,
    run_at,
    sampling_error,
)
from latin_fmu.cli import main
from latin_fmu.errors import Problem
from latin_fmu.results.estimates import ErrorEstimate
from latin_fmu.results.interface_fields import Force
from latin_fmu.run_quantities import Quantities
from latin_fmu.scene.quantity_table import FORCE_RMS, IMPULSE, PEAK_FORCE, QUANTITIES_OF_INTEREST

from ..test_cli import SCENE
from ..verification.known_answers import MODELS, shipped


# -- Orders and estimates from made-up sequences whose error is known -------------------------------------------------
def series(order: float, ratios: tuple[float, float], error: float = 0.01) -> tuple[float, float]:
    """Changes of the sequence q* + error h^order at h = 1 and the ratios."""
    first, second = (error * r**order for r in ratios)
    return first - error, second - first


@pytest.mark.parametrize("order", [0.25, 0.5, 1.0, 1.7, 2.0])
@pytest.mark.parametrize("ratios", [(2.0, 4.0), (5 / 3, 5.0), (1.9, 3.6)])
def test_order_of_a_power(order: float, ratios: tuple[float, float]) -> None:
    assert observed_order(*series(order, ratios), ratios) == pytest.approx(order, abs=1e-6)


def test_no_order_without_differences() -> None:
    assert math.isnan(observed_order(0.0, 1.0, (2.0, 4.0)))
    assert math.isnan(observed_order(1.0, math.nan, (2.0, 4.0)))


@pytest.mark.parametrize("order", [0.75, 1.0, 1.25])
@pytest.mark.parametrize("ratios", [(2.0, 4.0), (5 / 3, 5.0)])
def test_a_regular_sequence_gives_an_estimate_within_five_times(order: float, ratios: tuple[float, float]) -> None:
    half, quarter = series(order, ratios)
    error, bound_only = estimated_error(IMPULSE, Changes(half, quarter, ratios=ratios))
    assert not bound_only
    assert 0.01 <= error <= 0.05


@pytest.mark.parametrize("front", [True, False])
def test_the_changes_add_up(front: bool) -> None:
    """First order with fronts, the observed second order without: e + e', each by its own ratio."""
    p = 1.0 if front else 2.0
    half, quarter = series(p, (2.0, 4.0))
    error = estimated_error(IMPULSE, Changes(half, quarter, front=front))[0] / IMPULSE.safety
    assert error == pytest.approx(0.02)


@pytest.mark.parametrize(("bars", "fewer"), [(True, 1.0), (False, 0.7)])
def test_without_a_third_run_a_share_of_the_change_of_a_history_is_added(bars: bool, fewer: float) -> None:
    error, bound_only = estimated_error(IMPULSE, Changes(0.01, bars=bars, beside=0.3))
    assert error == pytest.approx(fewer * IMPULSE.alone * 0.01 + IMPULSE.share * 0.3)
    assert not bound_only
    smooth, _ = estimated_error(IMPULSE, Changes(0.01, bars=bars, front=False))
    assert smooth == pytest.approx(fewer * IMPULSE.alone * 0.01 / (2.0**1.25 - 1.0))
    assert {q.of for q in QUANTITIES_OF_INTEREST} - {""} <= {q.key for q in QUANTITIES_OF_INTEREST if q.norm}


def test_without_fronts_the_order_is_the_observed_one_within_the_expected_one_and_twice_that() -> None:
    for order, counted in ((0.3, 1.0), (1.4, 1.4), (3.0, 2.0)):
        half, quarter = series(order, (2.0, 4.0))
        expected = half / (2.0**counted - 1.0) + quarter / (2.0**counted - 1.0) / 2.0**counted
        error, _ = estimated_error(IMPULSE, Changes(half, quarter, front=False))
        assert error == pytest.approx(IMPULSE.safety * expected), order


def test_of_a_norm_the_last_change_alone_counts() -> None:
    half, quarter = series(1.0, (2.0, 4.0))
    assert estimated_error(PEAK_FORCE, Changes(half, 7.0))[0] == pytest.approx(PEAK_FORCE.safety * half)
    half, quarter = series(0.5, (2.0, 4.0))
    error, bound_only = estimated_error(FORCE_RMS, Changes(half, quarter))
    assert error == pytest.approx(FORCE_RMS.safety * 0.01)
    assert not bound_only


def test_changes_that_do_not_decrease_give_a_bound_and_say_so() -> None:
    """Two resolutions that agree by chance are no convergence: the change before counts."""
    error, bound_only = estimated_error(IMPULSE, Changes(half=1e-5, quarter=0.02))
    assert not bound_only
    assert error >= 0.0095
    assert estimated_error(IMPULSE, Changes(half=0.02, quarter=0.02))[1]


def test_no_coarser_value_no_estimate() -> None:
    assert estimated_error(IMPULSE, Changes(half=math.nan)) == (math.inf, True)


def test_sampling_and_iteration_count() -> None:
    half, quarter = series(1.0, (2.0, 4.0))
    plain, _ = estimated_error(IMPULSE, Changes(half, quarter))
    assert estimated_error(IMPULSE, Changes(half, quarter, iteration=0.1))[0] == pytest.approx(plain + 0.1)
    assert estimated_error(IMPULSE, Changes(half, quarter, sampling=0.1))[0] >= 0.1


@pytest.mark.parametrize("key", ["friction_work", "separation"])
@pytest.mark.parametrize(("late", "known"), [(0.0, True), (0.02, True), (0.5, False)])
def test_numbers_that_agree_by_chance_have_no_error(key: str, late: float, known: bool) -> None:
    """Two runs with the same work and instant, and forces that have nothing in common: no number, and the reason."""
    time = np.linspace(0.0, 1.0, 201)
    runs = []
    for start in (0.1, 0.1 + late):
        force = Force(time, np.clip(np.sin(np.pi * (time - start) / 0.3), 0.0, None) * (time < start + 0.3))
        made = Quantities(forces={"meet": force}, durations={"meet": 0.03})
        made.add("meet", {key: (0.4, 0.4), "force_rms": (force.root_mean_square(),) * 2})
        runs.append((Resolution(1.0, 1.0) if not runs else Resolution(0.5, 0.5), made))
    found = quantity_estimate(shipped("impact_bar"), f"meet.{key}", runs)
    assert math.isfinite(found.error) is known
    assert (found.history <= 1.0) is known
    notes = ErrorEstimate((found,), ("a remark",)).notes
    assert notes[0] == "a remark"
    assert len(notes) == 2 - known
    if not known:
        assert f"meet.{key}: no error: the history of the force, on which it rests" in notes[1]
        assert ErrorEstimate((found,)).report()["remarks"] == [notes[1]]


# -- Which coarser runs a scene allows --------------------------------------------------------------------------------
def test_resolution_scales_elements_and_divides_the_step() -> None:
    scene = shipped("beam_in_traction")
    coarse = at_resolution(scene, Resolution(0.5, 0.31, 1e-2))
    assert coarse.substructure["bar2"].box.elements == (1, 1, 25)
    assert coarse.time.time_step == pytest.approx(scene.time.time_step / 0.31, rel=1e-14)
    assert scene.time.end <= coarse.time.end < scene.time.end + coarse.time.time_step
    assert coarse.solver.tolerance == 1e-2
    assert not coarse.output.fields
    assert scene.substructure["bar2"].box.elements == (1, 1, 50)


def test_the_steps_of_coarser_runs_meet_the_jumps_of_the_loads() -> None:
    """The pulse lasts 42 steps: a quarter of the steps would end it between two instants."""
    scene = shipped("beam_in_traction")
    steps = aligned(scene, 0.25)
    assert 42 * steps == pytest.approx(round(42 * steps))
    assert abs(steps / 0.25 - 1) <= 0.12
    assert sampling_error(scene, scene.time.time_step / steps) < 1e-9
    assert sampling_error(scene, scene.time.time_step / 0.25) > 0.04
    assert aligned(shipped("impact_bar"), 0.25) == 0.25
    assert aligned(scene, 0.3) == pytest.approx(13 / 42)  # the nearest of 12, 13 and 14 steps


def test_small_counts_keep_one_ratio() -> None:
    assert reachable([6, 6, 6], 0.5) == 0.5
    assert reachable([5], 0.5) == 0.6
    scene = latin_fmu.load_scene(MODELS / "two_specimen_crushing/scene.toml")
    coarser = coarser_runs_of(scene)
    assert coarser is not None
    assert coarser.half == Resolution(0.5, 0.5)
    assert coarser.quarter == Resolution(1 / 3, 1 / 3)
    alone = coarser_runs_of(scene, third=False)
    assert alone is not None
    assert alone.by_name() == {"half": coarser.half}


def test_a_mesh_from_a_file_leaves_the_time_step() -> None:
    coarser = coarser_runs_of(shipped("punched_plates"))
    assert coarser is not None
    assert coarser.half == Resolution(1.0, 0.5)
    assert "mesh" in coarser.remarks[0]


def test_a_refined_mesh_from_a_file_has_coarser_ones() -> None:
    """Refined once, the mesh of the file is the coarser one; finer ones exist, four refinements at most."""
    scene = latin_fmu.load_scene(
        MODELS / "punched_plates/scene.toml",
        [f"substructure.{name}.mesh.refine=1" for name in ("lower", "upper", "punch")],
    )
    coarser = coarser_runs_of(scene)
    assert coarser is not None
    assert coarser.half.mesh == 0.5
    assert coarser.quarter is None
    assert "facets" in coarser.remarks[0]
    assert {b.mesh.refine for b in at_resolution(scene, coarser.half).substructure.values() if b.mesh} == {0}
    assert [mesh_factor(scene, f) for f in (0.1, 0.4, 0.8, 1.3, 3.0, 99.0)] == [0.5, 0.5, 1.0, 1.0, 4.0, 8.0]


def test_a_handful_of_steps_cannot_be_coarsened() -> None:
    scene = latin_fmu.load_scene(MODELS / "impact_bar/scene.toml", ["time.instants=10"])
    assert coarser_runs_of(scene) is None


def test_short_windows_keep_the_answer() -> None:
    """The coarser runs of a run in one window use short ones: both are converged, so they agree."""
    scene = at_resolution(shipped("beam_in_traction"), Resolution(0.5, 0.5, 1e-6))
    whole, short = latin_fmu.solve(scene), latin_fmu.solve(in_short_windows(scene))
    assert len(whole.windows) == 1 < len(short.windows)
    force = [s.interfaces["contact"].normal_resultant() for s in (whole, short)]
    assert np.abs(force[0] - force[1]).max() < 1e-4 * force[0].max()


# -- Every run of the command line prints its estimated error: text, JSON, netCDF; an option leaves it out ------------
@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A scene file in the current folder, long enough to be coarsened."""
    monkeypatch.chdir(tmp_path)
    Path("scene.toml").write_text(SCENE.replace("instants = 20", "instants = 60"))
    return "scene.toml"


def test_summary_json_and_file_tell_the_estimate(scene: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", scene, "-o", "a.nc", "--quiet", "--json"]) == 0
    estimate = json.loads(capsys.readouterr().out)["error_estimate"]
    impulse = estimate["quantities"]["meet.impulse"]
    names = {"value", "unit", "relative_error", "bound_only", "observed_order", "expected_order", "prices"}
    assert set(impulse) == names
    assert impulse["unit"] == "N s"
    assert 1e-3 <= impulse["relative_error"] < 1.0
    tree = latin_fmu.open_results("a.nc")
    group = tree["accuracy"]
    assert float(group["relative_error"].sel(quantity="meet.impulse")) == impulse["relative_error"]
    assert str(group["quantity_unit"].sel(quantity="meet.impulse").values) == "N s"
    tree.close()
    assert main(["run", scene, "-o", "a.nc", "--details"]) == 0
    assert "estimated error" in capsys.readouterr().out


@pytest.mark.parametrize("choice", [["--no-estimate"], ["--set", "accuracy.estimate=false"]])
def test_no_estimate_where_none_is_wanted(scene: str, choice: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", scene, "-o", "a.nc", "--json", *choice]) == 0
    assert "error_estimate" not in json.loads(capsys.readouterr().out)
    assert "accuracy" not in latin_fmu.open_results("a.nc").children


def test_a_short_run_has_one_coarser_run_and_a_long_one_two() -> None:
    """The third run gives the observed order; it is left out where it would cost as much as the run."""
    scene, made = at_resolution(shipped("impact_bar"), Resolution(0.2, 0.2)), list[str]()
    solution = latin_fmu.solve(scene)
    for predicted, count in ((0.1, 1), (10.0, 2)):
        solution.timings.predicted = predicted
        estimate = estimate_error(scene, solution, made.append)
        assert len(made) == count
        assert math.isnan(estimate["wall.impulse"].order) is (count == 1)
        made.clear()


@pytest.mark.parametrize("half_converges", [True, False])
def test_failed_coarser_runs_are_reported(half_converges: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that cannot be built: reported, and the other alone counts; one that does not converge: no estimate."""
    scene = at_resolution(shipped("impact_bar"), Resolution(0.2, 0.2))
    solution = latin_fmu.solve(scene)
    solution.timings.predicted = 10.0  # of a long run, which has a third one

    def failing(lean: latin_fmu.Scene, resolution: Resolution, **options: Any) -> MeasuredRun:
        if resolution.mesh < 0.4:
            raise latin_fmu.SceneError([Problem("substructure.bar", "two elements are needed")], "cannot be built")
        return replace(run_at(lean, resolution, **options), converged=half_converges)

    monkeypatch.setattr(estimate_module, "run_at", failing)
    estimate = estimate_error(scene, solution)
    assert "two elements are needed" in estimate.remarks[-1]
    if half_converges:
        assert math.isnan(estimate["wall.impulse"].order)
        assert estimate["wall.impulse"].error > 0.01
    else:
        assert "did not converge" in estimate.remarks[0]
        assert not estimate.quantities


def test_quantity_of_the_scene_is_checked() -> None:
    for bad, word in (
        ("impulze", "did you mean"),
        ("no.impulse", "no interface of this name"),
        ("no.acceleration_peak", "no sensor of this name"),
        ("no.largest_bolt_force", "no bolt of this name"),
    ):
        with pytest.raises(latin_fmu.SceneError, match=word):
            latin_fmu.load_scene(MODELS / "impact_bar/scene.toml", [f"accuracy.quantity={bad}"])


def test_interfaces_that_a_search_has_found_have_an_estimate() -> None:
    """They are no tables of the scene."""
    box = {"size": [1e-2, 1e-2, 1e-2], "elements": [4, 4, 4]}
    scene = latin_fmu.scene_from_dict(
        {
            "name": "found",
            "material": {"steel": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}},
            "substructure": {
                "low": {"material": "steel", "box": box | {"origin": [0.0, 0.0, 0.0]}},
                "high": {"material": "steel", "box": box | {"origin": [0.0, 0.0, 1e-2]}},
            },
            "contact": {"all": {"search": 1e-4, "friction_coefficient": 0.2}},
            "boundary": {"base": {"type": "fixed", "face": "low.zmin"}},
            "load": {"press": {"face": "high.zmax", "pressure": 1e6, "law": {"type": "half_sine", "duration": 20e-6}}},
            "time": {"end": 30e-6, "step": 0.5e-6},
        }
    )
    estimate = estimate_error(scene, latin_fmu.solve(scene))
    assert 0.0 < estimate["low_high.peak_force"].error < 0.5
