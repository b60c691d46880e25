"""Time of a run: a limit of CPU seconds stops it with its results, and it goes on from there to the same bits."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu import api, attempts
from latin_fmu.accuracy.estimate import estimate_error
from latin_fmu.cli import main
from latin_fmu.sensitivities.tangents import Tangents
from latin_fmu.stability.scenes import STEEL, Box, column

from .test_checkpoint import assert_equal
from .test_cli import SCENE

SLOW_TO_SHOW = 1.5  # s of CPU time over the limit: one call of the kernels, outputs


def thrown(instants: int = 200, **solver: Any) -> dict[str, Any]:
    """Two blocks that meet and rub."""
    low, up = (Box(STEEL, (0.04, 0.04, 0.02), (6, 6, 2), velocity=v) for v in ((0.0,) * 3, (10.0, 3.0, -5.0)))
    joint = {"friction_coefficient": 0.3}
    time_table = {"end": instants * 1e-7, "instants": instants}
    return column({"low": low, "up": up}, {"joint": joint}, time_table) | {"solver": solver}


NEVER = {"tolerance": 1e-17, "force_tolerance": 1e-17}
"""Below round-off: no instant with contact converges."""


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A scene file in the current folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path / "scene.toml"


@pytest.mark.parametrize("window", [1, 20, "whole"])
def test_a_run_that_cannot_converge_ends_within_its_limit(window: int | str) -> None:
    """In windows of one instant, of several, and in one: an hour without a limit."""
    described = latin_fmu.scene_from_dict(thrown(3_000 if window == "whole" else 100_000, window=window, **NEVER))
    latin_fmu.solve(latin_fmu.scene_from_dict(thrown(2)))  # loads the kernels
    start = time.process_time()
    solution = latin_fmu.solve(described, max_cpu=0.5)
    assert time.process_time() - start < 0.5 + SLOW_TO_SHOW
    assert not solution.converged
    assert not solution.complete
    assert solution.interrupted == "stopped by its limit of 0.5 s of CPU time"
    assert f"{solution.interrupted} at t = {solution.time[-1]:.6g} s (instant " in solution.status
    assert all(np.isfinite(h.traction).all() for h in solution.interfaces.values())
    assert (len(solution.time) > 10) == (window != "whole")
    assert solution.report()["interrupted"] == solution.interrupted


def test_a_limit_that_is_not_reached_changes_nothing() -> None:
    whole, limited = (latin_fmu.solve(latin_fmu.scene_from_dict(thrown()), max_cpu=s) for s in (None, 60.0))
    assert whole.converged
    assert limited.complete
    assert limited.interrupted == ""
    assert whole.status == limited.status
    assert np.array_equal(whole.interfaces["joint"].traction, limited.interfaces["joint"].traction)


@pytest.mark.usefixtures("scene")
def test_a_limited_run_is_marked_and_goes_on(capsys: pytest.CaptureFixture[str]) -> None:
    """Exit code, status, attributes; continued to the bits of a run without a limit."""
    plain = ["run", "scene.toml", "--no-estimate", "--quiet", "--set", "time.end=12e-3", "--set", "time.instants=60000"]
    assert main([*plain, "-o", "whole.nc"]) == 0
    assert main([*plain, "-o", "out.nc", "--max-cpu", "0.2"]) == 7
    assert "stopped by its limit of 0.2 s of CPU time at t = " in capsys.readouterr().err
    tree = latin_fmu.open_results("out.nc")
    assert tree.attrs["interrupted"] == "stopped by its limit of 0.2 s of CPU time"
    assert (tree.attrs["converged"], tree.attrs["complete"]) == (0, 0)
    assert tree.attrs["status"].startswith(tree.attrs["interrupted"])
    tree.close()
    assert Path("out.nc.checkpoint").exists()
    assert main([*plain, "-o", "out.nc", "--resume"]) == 0
    assert not Path("out.nc.checkpoint").exists()
    assert_equal(Path("whole.nc"), Path("out.nc"))


@pytest.mark.parametrize(("window", "instants"), [(1, 60), (4, 24)])
def test_a_run_that_fails_instant_after_instant_goes_on_to_the_same_bits(
    window: int, instants: int, tmp_path: Path
) -> None:
    """Stopped inside an instant that the compiled driver has refused, at whatever iteration."""
    tables = thrown(instants, window=window, tolerance=1e-17, force_tolerance=1e-17)
    described, place = latin_fmu.scene_from_dict(tables), tmp_path / "c"
    whole = latin_fmu.solve(described)
    parts = 0
    while True:
        kept = latin_fmu.Checkpoint(place, resume=True, log=lambda _: None)
        solution = latin_fmu.solve(described, checkpoint=kept, max_cpu=0.15)
        if solution.complete or parts == 2000:  # a busy machine stops far more often
            break
        parts += 1
    assert 0 < parts < 2000
    assert np.array_equal(solution.interfaces["joint"].traction, whole.interfaces["joint"].traction)
    assert [w.iterations for w in solution.windows] == [w.iterations for w in whole.windows]


def test_the_estimate_takes_what_is_left() -> None:
    solution = latin_fmu.solve(described := latin_fmu.scene_from_dict(thrown()))
    estimate = estimate_error(described, solution, max_cpu=1e-9)
    assert not estimate.quantities
    assert any("the limit of CPU time is reached" in remark for remark in estimate.remarks)
    stopped = estimate_error(described, solution, max_cpu=0.02)
    assert any("stopped by its limit of " in remark for remark in stopped.remarks)
    assert estimate_error(described, solution).quantities


def test_derivatives_and_their_checks_take_what_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """A clock that stands still but where it is told to go on: after the march of the run, after that of the
    derivatives, and in the run that checks them. The results of the run are whole each time."""
    named = {"sensitivities": ["interface.joint.friction_coefficient"], "check_sensitivities": "all"}
    described = latin_fmu.scene_from_dict(thrown(20) | {"output": named})
    whole = latin_fmu.solve(described)
    assert whole.sensitivities.tried == tuple(named["sensitivities"])
    own, of_derivatives, now = attempts.march, Tangents.march, [0.0]
    later: dict[str, float] = {}

    def marched(*given: Any) -> Any:
        made = own(*given)
        now[0] += later.get("run", 0.0)
        return made

    def derived(*given: Any) -> Any:
        made = of_derivatives(*given)
        now[0] += later.get("derivatives", 0.0)
        return made

    monkeypatch.setattr(attempts, "march", marched)
    monkeypatch.setattr(Tangents, "march", derived)
    monkeypatch.setattr(attempts.clock, "process_time", lambda: now[0])
    for after, said in (
        ({"run": 6.0}, "no derivatives: the limit of 5 s of CPU time is reached before them"),
        ({"derivatives": 6.0}, "are not checked: the limit of 5 s of CPU time is reached before them"),
        ({}, "the limit of"),
    ):
        now[0], later = 0.0, after
        solution = latin_fmu.solve(described, max_cpu=5.0)
        assert solution.converged
        assert solution.interrupted == ""
        assert np.array_equal(solution.interfaces["joint"].traction, whole.interfaces["joint"].traction)
        assert (solution.sensitivities is None) == ("run" in after)
        assert any(said in w for w in solution.warnings) == bool(after)
        if "derivatives" in after:
            assert solution.sensitivities.tried == ()


def test_a_run_that_checks_derivatives_stops_at_the_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is solved with what is left, and what it found until then is not taken for the answer."""
    named = {"sensitivities": ["interface.joint.friction_coefficient"], "check_sensitivities": "all"}
    described, own, given = latin_fmu.scene_from_dict(thrown(20) | {"output": named}), api.solve, list[float]()

    def solve(scene: latin_fmu.Scene, **options: Any) -> latin_fmu.Solution:
        given.append(options["max_cpu"])
        return own(scene, **{**options, "max_cpu": 1e-9})

    monkeypatch.setattr(api, "solve", solve)
    solution = own(described, max_cpu=50.0)
    assert len(given) == 1
    assert 0.0 < given[0] < 50.0
    assert solution.sensitivities.tried == ()
    assert any("not checked: the limit of 50 s of CPU time is reached before them" in w for w in solution.warnings)


@pytest.mark.usefixtures("scene")
def test_a_set_up_beyond_the_limit_ends_at_the_start() -> None:
    """Everything that is written or printed of a run holds with a single instant."""
    assert main(["run", "scene.toml", "-o", "out.nc", "--vtk", "vtk", "--max-cpu", "1e-6"]) == 7
    tree = latin_fmu.open_results("out.nc")
    assert "at t = 0 s (instant 0 of " in tree.attrs["status"]
    tree.close()


def test_points_of_a_study_are_limited() -> None:
    study = latin_fmu.sweep(
        latin_fmu.scene_from_dict(thrown(100_000, **NEVER)),
        {"interface.joint.friction_coefficient": [0.3]},
        max_cpu=0.3,
    )
    assert "stopped by its limit of 0.3 s of CPU time" in str(study["message"].values.ravel()[0])


@pytest.mark.usefixtures("scene")
def test_the_coarse_run_of_explain_is_limited(capsys: pytest.CaptureFixture[str]) -> None:
    """Instants that take minutes in all; what is found until then is printed, and marked."""
    long = ["explain", "scene.toml", "--run", "--set", "time.end=4e-2", "--set", "time.instants=200000"]
    start = time.process_time()
    assert main([*long, "--json", "--max-cpu", "0.5"]) == 7
    assert time.process_time() - start < 60.0
    coarse = json.loads(capsys.readouterr().out)["coarse_run"]
    assert coarse["interrupted"] == "stopped by its limit of 0.5 s of CPU time"
    assert coarse["findings"][0].startswith(coarse["interrupted"])
    assert main(["explain", "scene.toml", "--max-cpu", "1"]) == 2
    assert "has no effect without --run" in capsys.readouterr().err


@pytest.mark.slow
def test_simulations_are_limited(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A co-simulation of 100,000 steps, and one that is over before its first step."""
    pytest.importorskip("fmpy")
    from fmu_build.build import build_fmu

    path = str(build_fmu(latin_fmu.scene_from_dict(thrown(100)), tmp_path / "pair.fmu", "2", python=True))
    for limit, least in (("6", 2), ("1e-6", 1)):
        out = tmp_path / f"{limit}.csv"
        words = ["simulate", path, "--step", "1e-7", "--stop", "1e-2", "-o", str(out), "--max-cpu", limit]
        assert main(words) == 7
        assert f"stopped by its limit of {float(limit):g} s of CPU time at t = " in capsys.readouterr().err
        rows = out.read_text().splitlines()[1:]
        assert least <= len(rows) < 100_000
        assert float(rows[-1].split(",")[0]) == pytest.approx((len(rows) - 1) * 1e-7)
    assert main(["simulate", path, "--stop", "1e-6", "-o", str(tmp_path / "whole.csv"), "--max-cpu", "100"]) == 0


def test_the_stability_suite_is_limited(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for limit in ("0.5", "1e-9"):
        target = tmp_path / f"{limit}.md"
        assert main(["stress", "--quick", "-o", str(target), "--max-cpu", limit]) == 7
        text = target.read_text(encoding="utf-8")
        assert "; stopped by the limit of CPU time: " in text
        assert "Time schemes on impact" not in text
        assert (tmp_path / f"{limit}.png").exists() == ("![Margins" in text)
    assert "0 of 0 hard cases hold" in text
    capsys.readouterr()


@pytest.mark.parametrize("text", ["0", "-1", "soon", "inf", "nan"])
def test_what_is_no_limit_is_refused(text: str, scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", str(scene), "--max-cpu", text]) == 2
    assert f"'{text}' is not a duration: give a number of seconds > 0" in capsys.readouterr().err


# -- instants that do not converge -------------------------------------------------------------------------------------
def test_fall_backs_that_have_failed_are_not_repeated() -> None:
    """After two instants in vain: fewer iterations and no fall-back, but for one instant in 32."""
    failing = latin_fmu.solve(latin_fmu.scene_from_dict(thrown(100, **NEVER)))
    windows = failing.windows
    at = {i for i, w in enumerate(windows) if i > 1 and not any(v.converged for v in windows[i - 2 : i])}
    repeated = {i for i in at if windows[i].fallbacks}
    assert len(at) > 80
    assert all(windows[i].first_instant % 32 == 0 for i in repeated)
    assert 0 < len(repeated) <= 3
    assert max(windows[i].iterations for i in at - repeated) <= 24
    assert windows[1].fallbacks


def test_instants_that_do_not_converge_take_a_bounded_number_of_iterations() -> None:
    """9.2 times those of a run that converges; 20 with all fall-backs at every instant."""
    failing, converging = (latin_fmu.solve(latin_fmu.scene_from_dict(thrown(100, **s))) for s in (NEVER, {}))
    assert converging.converged
    taken = [sum(w.iterations for w in s.windows) for s in (failing, converging)]
    assert taken[0] <= 12 * taken[1]


def test_fall_backs_that_help_are_taken_at_every_instant() -> None:
    """Few iterations, so that nearly every instant needs one: the status is that of a run that converged."""
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(thrown(100, tolerance=1e-14, max_iterations=12, newton=False)))
    assert solution.converged
    assert sum(bool(w.fallbacks) for w in solution.windows) > 30
