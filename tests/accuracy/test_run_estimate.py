"""Every run of the command line prints its estimated error: text, JSON, netCDF; an option leaves it out."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

import latin_fmu
from latin_fmu.accuracy import estimate as estimate_module
from latin_fmu.accuracy.estimate import estimate_error
from latin_fmu.accuracy.resolution import Resolution, at_resolution
from latin_fmu.accuracy.runs import Run, run_at
from latin_fmu.cli import main
from latin_fmu.errors import Problem

from ..test_cli import SCENE
from ..verification.known_answers import MODELS, shipped


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
    assert set(impulse) == {
        "value",
        "unit",
        "relative_error",
        "bound_only",
        "observed_order",
        "expected_order",
        "change_with_mesh",
        "change_with_time_step",
    }
    assert impulse["unit"] == "N s"
    assert 1e-3 <= impulse["relative_error"] < 1.0
    tree = latin_fmu.open_results("a.nc")
    group = tree["accuracy"]
    assert float(group["relative_error"].sel(quantity="meet.impulse")) == impulse["relative_error"]
    assert str(group["quantity_unit"].sel(quantity="meet.impulse").values) == "N s"
    tree.close()
    assert main(["run", scene, "-o", "a.nc"]) == 0
    assert "estimated error" in capsys.readouterr().out


@pytest.mark.parametrize("choice", [["--no-estimate"], ["--set", "accuracy.estimate=false"]])
def test_no_estimate_where_none_is_wanted(scene: str, choice: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", scene, "-o", "a.nc", "--json", *choice]) == 0
    assert "error_estimate" not in json.loads(capsys.readouterr().out)
    assert "accuracy" not in latin_fmu.open_results("a.nc").children


def test_failed_coarser_runs_are_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that cannot be built and one that does not converge: reported, and the rest is only a bound."""
    scene = at_resolution(shipped("impact_bar"), Resolution(0.2, 0.2))
    solution = latin_fmu.solve(scene)

    def failing(
        lean: latin_fmu.Scene,
        resolution: Resolution,
        progress: None = None,
        processes: None = None,
        stream: object = None,
        max_cpu: object = None,
    ) -> Run:
        del progress, stream, max_cpu
        if resolution.mesh < 0.4:
            raise latin_fmu.SceneError([Problem("substructure.bar", "two elements are needed")], "cannot be built")
        run = run_at(lean, resolution, processes=processes)
        return run if resolution.time < 1.0 else replace(run, converged=False)

    monkeypatch.setattr(estimate_module, "run_at", failing)
    estimate = estimate_error(scene, solution)
    assert len(estimate.remarks) == 2
    assert "two elements are needed" in estimate.remarks[0]
    assert "did not converge" in estimate.remarks[1]
    assert estimate["wall.impulse"].bound_only
    assert estimate["wall.impulse"].error > 0.01


def test_quantity_of_the_scene_is_checked() -> None:
    for bad, word in (("impulze", "did you mean"), ("no.impulse", "no interface of this name")):
        with pytest.raises(latin_fmu.SceneError, match=word):
            latin_fmu.load_scene(MODELS / "impact_bar/scene.toml", [f"accuracy.quantity={bad}"])
