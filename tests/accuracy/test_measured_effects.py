"""``explain --run``: what effects cost and change, measured by runs without them."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.accuracy import measured_effects as module
from latin_fmu.accuracy.effects_figure import effects_figure
from latin_fmu.accuracy.measured_effects import MeasuredEffect, MeasuredEffects, changes, measured_effects
from latin_fmu.cli import main
from latin_fmu.commands import LIMITED
from latin_fmu.pictures.style import save_figure
from latin_fmu.stability.scenes import STEEL, Box, column, half_sine

from ..verification.known_answers import MODELS, shipped

Tables = dict[str, Any]


@pytest.fixture(autouse=True)
def once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every run is made once: nothing here is timed."""
    monkeypatch.setattr(module, "MOST_ROUNDS", 1)


def blocks(**changed: Any) -> Tables:
    """Two blocks pressed and sheared by a pulse, the upper one of a lossy material."""
    block = Box(STEEL, (0.01, 0.01, 0.01), (2, 2, 2))
    made = column(
        {"low": block, "up": block},
        {"meet": {"friction_coefficient": 0.2}},
        {"end": 1e-5, "instants": 30},
        boundary={"base": {"type": "fixed", "face": "low.zmin"}},
        load={"push": {"face": "up.zmax", "traction": [4e7, 0.0, -1e8], "law": half_sine(8e-6)}},
        sensor={"top": {"face": "up.zmax", "spectrum": {}}},
        output={"energy": True, "fields": True},
    )
    made["material"]["lossy"] = made["material"]["steel"] | {"rayleigh_stiffness": 1e-8}
    made["substructure"]["up"]["material"] = "lossy"
    return made | changed


def measured(tables: Tables, **options: Any) -> dict[str, MeasuredEffect]:
    found = measured_effects(latin_fmu.scene_from_dict(copy.deepcopy(tables)), **options)
    return {effect.effect: effect for effect in found.effects}


def test_every_effect_of_a_scene_is_switched() -> None:
    shares: list[float] = []
    found = measured(blocks(), report=shares.append)
    assert shares == sorted(shares)
    assert 0.0 < shares[0] < 0.1
    assert shares[-1] == 1.0
    assert list(found) == [
        "friction of meet",
        "opening and slip of meet",
        "elasticity of low",
        "elasticity of up",
        "inertia of low",
        "inertia of up",
        "damping of materials",
        "waves above some modes",
        "inertia",
        "output of fields",
        "output of energy",
        "spectra",
        "sensors",
    ]
    assert all(effect.times or effect.remark for effect in found.values())
    assert set(found["friction of meet"].changes) == {"forces", "motions", "accelerations"}


def test_what_is_stored_changes_nothing_and_friction_does() -> None:
    found = measured(blocks())
    for name in ("output of fields", "output of energy", "spectra"):
        assert set(found[name].changes.values()) == {0.0}, name
    assert "accelerations" not in found["sensors"].changes
    assert found["friction of meet"].changes["motions"] > 0.05
    assert found["damping of materials"].changes["motions"] < found["friction of meet"].changes["motions"]


def test_the_change_of_the_forces_is_the_distance_of_their_histories() -> None:
    """Against the resultants of both runs, integrated by the trapezoidal rule."""
    first, second = blocks(), blocks()
    second["interface"]["meet"]["friction_coefficient"] = 0.0
    runs = [latin_fmu.solve(latin_fmu.scene_from_dict(copy.deepcopy(tables))) for tables in (first, second)]
    force, other = (run.interfaces["meet"].force() for run in runs)
    apart, size = (np.sqrt(np.trapezoid((f**2).sum(axis=1), runs[0].time)) for f in (force - other, force))
    told = changes(latin_fmu.scene_from_dict(first), *runs)["forces"]
    assert told == pytest.approx(apart / size, rel=0.05)
    assert told == measured(first)["friction of meet"].changes["forces"]


def test_a_body_that_nothing_touches_and_a_joint_that_is_stuck_are_named() -> None:
    """The body is left out with its interface and its sensor; friction that holds everything."""
    made = blocks()
    made["substructure"]["far"] = copy.deepcopy(made["substructure"]["low"])
    made["substructure"]["far"]["box"]["origin"] = [0.0, 0.0, 0.03]
    made["interface"]["apart"] = {"sides": ["up.zmax", "far.zmin"], "gap": 0.01}
    made["sensor"]["far"] = {"face": "far.zmax"}
    made["interface"]["meet"] |= {"friction_coefficient": 5.0, "preload": 1e9}
    made["load"]["push"]["traction"] = [1e6, 0.0, -1e8]
    found = measured(made)
    left_out = found["body far, never touched"]
    assert not left_out.remark
    assert max(left_out.changes.values()) < 1e-3
    assert "joint meet, stuck all the time" in found
    assert "elasticity of far" not in found


def test_what_a_scene_needs_is_no_effect_of_it() -> None:
    """An equilibrium has no inertia, and friction that alone holds a block cannot be left out of it."""
    made = blocks(time={"end": 1.0, "instants": 4, "quasi_static": True})
    made["load"]["push"] |= {"law": "step", "traction": [1e7, 0.0, -1e8]}
    del made["material"]["lossy"]["rayleigh_stiffness"]
    del made["sensor"]["top"]["spectrum"]
    names = set(measured(made))
    assert "opening and slip of meet" in names
    assert not {"friction of meet", "inertia", "inertia of low", "waves above some modes", "spectra"} & names


def test_suggestions_are_followed_once() -> None:
    found = measured(blocks(), suggested=[("output.every=10",), ("output.energy=false",)])
    assert [e.what for e in found.values()].count("--set output.energy=false") == 1
    assert found["what is suggested above"].times
    assert found["what is suggested above"].changes["forces"] == 0.0


def test_a_change_is_suggested_where_it_saves_more_than_runs_differ_and_changes_little() -> None:
    scene = latin_fmu.scene_from_dict(blocks())
    cases = {
        "cheap": ([0.8], 0.001, True),
        "dear": ([1.4], 0.0, False),
        "hardly cheaper": ([0.97], 0.0, False),
        "within what runs differ": ([0.9], 0.0, False),
        "wrong": ([0.5], 0.2, False),
    }
    rows = [MeasuredEffect(n, n, scene, times, {"forces": change}) for n, (times, change, _) in cases.items()]
    rows.append(MeasuredEffect("unknown", "unknown", scene, [0.1], {}))
    rows.append(MeasuredEffect("failed", "failed", scene, remark="does not converge"))
    found = MeasuredEffects("", MeasuredEffect("nothing", "", scene, [1.0, 1.2, 1.25]), rows, [])
    assert [e.effect for e in found.suggested] == [name for name, (*_, suggested) in cases.items() if suggested]
    assert "* cheap (saves 20 %)" in found.text()
    assert "failed: does not converge" in found.text()


def test_not_more_than_four_of_a_kind_and_the_rest_is_named() -> None:
    block = Box(STEEL, (0.01, 0.01, 0.01), (1, 1, 1))
    made = column(
        {f"b{i}": block for i in range(6)},
        {f"i{i}": {} for i in range(5)},
        {"end": 4e-6, "instants": 4},
        boundary={"base": {"type": "fixed", "face": "b0.zmin"}},
        load={"push": {"face": "b5.zmax", "pressure": 1e8, "law": half_sine(8e-6)}},
    )
    found = measured_effects(latin_fmu.scene_from_dict(made))
    assert sum(e.effect.startswith("opening and slip of") for e in found.effects) == 4
    assert "opening and slip of 1 more than 4" in found.unmeasured


def test_a_limit_of_cpu_time_ends_the_table(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    scene = latin_fmu.scene_from_dict(blocks())
    found = measured_effects(scene, limit=1e-9)
    assert found.limited
    assert not found.effects
    file = tmp_path / "scene.toml"
    file.write_text(scene.text())
    assert main(["explain", str(file), "--run", "--json", "--max-cpu", "1e-9"]) == LIMITED
    assert "measured_effects" not in json.loads(capsys.readouterr().out)  # the coarse run has ended it
    assert main(["explain", str(file), "--run", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)["measured_effects"]
    assert {row["effect"] for row in report["effects"]} >= {"friction of meet", "sensors"}
    assert main(["explain", str(file), "--run"]) == 0
    assert "friction of meet" in capsys.readouterr().out


def test_the_figure_has_a_bar_for_each_effect(tmp_path: Path) -> None:
    """Savings as in the table, the largest on top; changes below a hundredth of a per cent have a bar of no length."""
    plain = MeasuredEffect("nothing", "", shipped("impact_bar"), [2.0])
    rows = [
        MeasuredEffect("friction of a", "", plain.scene, [1.5], {"forces": 0.2, "motions": 0.001}),
        MeasuredEffect("output of energy", "", plain.scene, [1.0], {"forces": 0.0, "motions": 0.0}),
        MeasuredEffect("inertia", "", plain.scene, [9.0], {"forces": 0.9}),
        MeasuredEffect("sensors", "", plain.scene, remark="not run"),
    ]
    figure = effects_figure(MeasuredEffects("by hand (1 run)", plain, rows, []), "bar")
    price, influence = figure.axes
    assert [bar.get_width() for bar in price.patches] == pytest.approx([-350.0, 25.0, 50.0])  # from below
    names = ["inertia", "friction of a", "* output of energy"]
    assert [text.get_text() for text in price.get_yticklabels()] == names
    assert [bar.get_width() for bar in influence.patches] == pytest.approx([90.0, 20.0, 0.01, 0.01, 0.1, 0.01])
    save_figure(figure, tmp_path / "effects.png")
    with pytest.raises(ValueError, match="no effect was measured"):
        effects_figure(MeasuredEffects("", plain, rows[-1:], []), "bar")


def test_a_figure_of_effects_needs_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = str(MODELS / "impact_bar" / "scene.toml")
    assert main(["explain", scene, "--figure", str(tmp_path / "a.png")]) == 2
    assert "add --run" in capsys.readouterr().err
    assert main(["explain", scene, "--run", "--figure", str(tmp_path / "a.txt")]) == 2
    assert not list(tmp_path.iterdir())
