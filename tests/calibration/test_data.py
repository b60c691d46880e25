"""Files of measured data, options and the command: every problem with its line, and what is written."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import latin_fmu
from latin_fmu.calibration.data import read_measured
from latin_fmu.calibration.report import Calibration, FitParameter, FittedParameter
from latin_fmu.calibration.study import parameters_of
from latin_fmu.cli import main
from latin_fmu.errors import InputError
from latin_fmu.scene.overrides import text_with_numbers
from tests.calibration.test_fit import COARSE, COLUMNS, FRICTION, PRESSURE, crushing, histories, noisy, write
from tests.scenes import MODELS


def problems(tmp_path: Path, text: str) -> list[tuple[int | None, str]]:
    """Lines and texts of the problems of a file."""
    path = tmp_path / "data.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as raised:
        read_measured([path], crushing())
    return [(p.line, str(p)) for p in raised.value.problems]


def test_all_problems_of_a_header_come_at_once(tmp_path: Path) -> None:
    header = "time,side.acceleraton.x,sid.velocity.x,crush.force,m6.tension,side.velocity.y.sd,side.velocity_filtered.x"
    said = problems(tmp_path, f"# of a test\n{header}\n1e-6,1,2,3,4,5,6\n")
    assert {line for line, _ in said} == {2}
    texts = " ".join(text for _, text in said)
    for words in ("acceleraton", "did you mean 'side'?", "crush.force", "no bolt", "without its column", "no filter"):
        assert words in texts
    assert len(said) == 6


def test_all_problems_of_the_rows_come_at_once(tmp_path: Path) -> None:
    rows = "1e-6,1,1\n2e-6,nan,1\n3e-6,x,1\n4e-6,1\n"
    said = problems(tmp_path, f"time,side.velocity.x,side.velocity.x.sd\n{rows}")
    assert [line for line, _ in said] == [3, 4, 5]
    assert "remove the row" in said[0][1]
    said = problems(tmp_path, "time,side.velocity.x,side.velocity.x.sd\n-1e-6,1,1\n1,1,1\n2e-6,1,0\n")
    assert [line for line, _ in said] == [2, 3, 4]
    assert "set time.end" in said[1][1]
    assert "must be above 0" in said[2][1]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("speed,side.velocity.x\n1,1\n", "unknown first column"),
        ("time,side.srs.x\n1e-6,1\n", "no such column"),
        ("frequency,side.velocity.x\n1e3,1\n", "SENSOR.srs.x"),
        ("frequency,side.srs.x\n1e8,1\n", "0.4 of the sampling rate"),
        ("mode,frequency\n1.5,100\n", "not a number of a mode"),
        ("mode,damping\n1,100\n", "no such column"),
        ("tip.amplitude,frequency\n1e-6,100\n", "no sensor of this name"),
        ("amplitude,frequency\n0,100\n", "not an amplitude"),
        ("time,side.velocity.x,side.velocity.x\n1e-6,1,1\n", "there twice"),
        ("time\n1e-6\n", "no column of measured values"),
        ("time,side.velocity.x\n", "no rows"),
        ("time [ms],side.velocity.x [g]\n1e-3,1\n", "not a unit of this column"),
    ],
)
def test_a_file_that_cannot_be_used_is_told(tmp_path: Path, text: str, words: str) -> None:
    assert any(words in said for _, said in problems(tmp_path, text))


def test_a_file_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nothing.csv.*does not exist"):
        read_measured([tmp_path / "nothing.csv"], crushing())


def test_units_and_deviations_are_read_and_rows_ordered(tmp_path: Path) -> None:
    path = tmp_path / "data.csv"
    path.write_text("time [us];side.displacement.x [um];side.displacement.x.sd [mm]\n2;3;1\n1;-4;2\n", encoding="utf-8")
    (table,) = read_measured([path], crushing())
    np.testing.assert_allclose(table.along, [1e-6, 2e-6])
    np.testing.assert_allclose(table.columns[0].values, [-4e-6, 3e-6])
    np.testing.assert_allclose(table.scatter()[0], [2e-3, 1e-3])


def test_names_with_blanks_are_those_of_exported_motions(tmp_path: Path) -> None:
    (tmp_path / "data.csv").write_text("time [s],side velocity x [m s-1]\n1e-6,1\n2e-6,2\n", encoding="utf-8")
    (table,) = read_measured([tmp_path / "data.csv"], crushing())
    assert [column.name for column in table.columns] == ["side.velocity.x"]


def test_a_history_scatters_alike_and_a_frequency_in_proportion(tmp_path: Path) -> None:
    history = write(tmp_path / "h.csv", "time,side.velocity.x", np.array([[1e-6, 3.0], [2e-6, -4.0]]))
    modes = write(tmp_path / "m.csv", "mode,frequency", np.array([[1, 10.0], [2, 300.0]]))
    tables = read_measured([history, modes], crushing())
    np.testing.assert_allclose(tables[0].scatter()[0], np.sqrt(12.5))
    # of a tenth of the largest at least
    np.testing.assert_allclose(tables[1].scatter()[0], [30.0, 300.0])


def test_all_problems_of_parameters_come_at_once() -> None:
    fit = ["load.press.presure", f"{FRICTION}=2:0:1", f"{FRICTION}=x", "=3", f"{PRESSURE},{FRICTION}"]
    with pytest.raises(InputError) as raised:
        parameters_of(fit, crushing())
    text = str(raised.value)
    for words in ("no number under this name", "not between the bounds", "not a number", "not a parameter"):
        assert words in text
    assert "different values" in text
    assert "given twice" in text
    for many in ([], [f"part.{i}" for i in range(9)]):
        with pytest.raises(InputError, match="number of parameters"):
            parameters_of(many, crushing())


def test_bounds_are_a_factor_of_ten_where_left_out() -> None:
    (parameter,) = parameters_of([f"{FRICTION}=0.3"], crushing())
    assert (parameter.low, parameter.high) == pytest.approx((0.03, 3.0))
    (parameter,) = parameters_of(["substructure.upper.initial_velocity.2"], crushing())
    assert (parameter.start, parameter.scale) == (0.0, 1.0)


def test_more_data_than_parameters_are_needed(tmp_path: Path) -> None:
    data = write(tmp_path / "m.csv", "mode,frequency", np.array([[1, 100.0]]))
    with pytest.raises(InputError, match="too few data"):
        latin_fmu.calibrate(crushing(), data, FRICTION)
    with pytest.raises(InputError, match=r"--max-runs.*out of range"):
        latin_fmu.calibrate(crushing(), data, FRICTION, max_runs=1)


def test_numbers_are_written_where_they_stand() -> None:
    text = "[bolt]\nm6 = {force = 5e3}  # tight\n[load.a]\nforce = [1.0, 2.0]\npressure=2e5 # high\n"
    made = text_with_numbers(text, {"bolt.m6.force": 4e3, "load.a.pressure": 1.5}, {"bolt", "load"})
    assert made == text.replace("5e3", "4000.0").replace("pressure=2e5", "pressure = 1.5")
    assert text_with_numbers(text, {"load.a.force.0": 4e3}, {"bolt", "load"}) is None
    assert text_with_numbers(text, {"load.a.other": 4e3}, {"bolt", "load"}) is None


def test_tied_numbers_are_written_both() -> None:
    names = tuple(f"material.{name}.young_modulus" for name in ("steel", "aluminium"))
    value = FittedParameter(FitParameter(names, 2e11, 1e11, 3e11), 2.1234567e11, 1.0, 0.0, "")
    made = Calibration(crushing(), (value,), (), np.eye(1), 1.0, (), 1, True, ())
    text = "[material.steel]\nyoung_modulus = 2e11\n[material.aluminium]\nyoung_modulus = 7e10 # soft\n"
    assert made.text(text) == text.replace("2e11", "212346000000.0").replace("7e10", "212346000000.0")
    assert made[names[1]] is value
    assert value.of.words == "young modulus of steel, aluminium"


def test_the_command_writes_scene_and_figure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = tmp_path / "scene.toml"
    text = (MODELS / "two_specimen_crushing/scene.toml").read_text(encoding="utf-8")
    text = text.replace("[6, 6, 6]", "[2, 2, 2]").replace("step = 0.15e-6", "step = 0.3e-6")
    scene.write_text(text + '[sensor.side]\nsubstructure = "lower"\npoint = [0.01, 0.01, 0.009]\n', encoding="utf-8")
    time, _ = histories()
    data = write(tmp_path / "d.csv", ",".join(("time", *COLUMNS)), np.column_stack([time, noisy(1)]))
    words = [
        "calibrate",
        str(scene),
        str(data),
        "--fit",
        f"{FRICTION}=0.2",
        "--fit",
        PRESSURE,
        "--no-estimate",
        "--json",
    ]
    assert main(words) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["converged"]
    written = tmp_path / "scene_calibrated.toml"
    assert written.with_suffix(".png").stat().st_size > 10_000
    made = latin_fmu.load_scene(written)
    assert made.interface["crush"].friction_coefficient == pytest.approx(report["parameters"][0]["value"], rel=1e-5)
    assert "# the wall: the base" in written.read_text(encoding="utf-8")
    # with --set the effective scene is written
    assert (
        main([*words[:-1], "-q", "--set", "time.step=0.6e-6", "--max-runs", "2", "-o", str(tmp_path / "b.toml")]) == 1
    )
    out = capsys.readouterr()
    assert "95 % interval" in out.out
    assert not out.err
    made = latin_fmu.load_scene(tmp_path / "b.toml")
    assert made.time.step == 0.6e-6
    assert made.output == latin_fmu.load_scene(scene).output  # with all that the runs of the fit do not keep


def test_the_command_does_not_replace_its_data(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = write(tmp_path / "d.csv", "time,side.velocity.x", np.ones((2, 2)))
    scene = str(MODELS / "two_specimen_crushing/scene.toml")
    overrides = [word for setting in COARSE for word in ("--set", setting)]
    assert main(["calibrate", scene, str(data), "--fit", FRICTION, *overrides, "-o", str(data)]) == 2
    assert "would replace it" in capsys.readouterr().err


@pytest.mark.parametrize("text", [f"{FRICTION}=nan", f"{FRICTION}=0.1:nan:1"])
def test_starts_and_bounds_that_are_no_numbers_are_refused(text: str) -> None:
    with pytest.raises(InputError, match="not a number"):
        parameters_of([text], crushing())


def test_data_without_a_size_or_that_count_twice_are_refused(tmp_path: Path) -> None:
    zeros = np.column_stack([[1e-6, 2e-6, 3e-6], np.zeros((3, 1))])
    data = write(tmp_path / "d.csv", "time,side.velocity.x", zeros)
    with pytest.raises(InputError, match=r"every value is 0.*add side.velocity.x.sd.*line 1") as raised:
        read_measured([data, tmp_path / "." / "d.csv"], crushing())
    assert "given twice" in str(raised.value)
    known = write(tmp_path / "k.csv", "time,side.velocity.x,side.velocity.x.sd", np.column_stack([zeros, np.ones(3)]))
    assert not read_measured([known], crushing())[0].columns[0].values.any()


@pytest.mark.parametrize("options", [{"max_runs": 1}, {"mode": 0}, {"increments": 0}])
def test_counts_out_of_range_are_refused(options: dict[str, int], tmp_path: Path) -> None:
    data = write(tmp_path / "d.csv", "time,side.velocity.x", np.array([[1e-6, 3.0], [2e-6, -4.0]]))
    with pytest.raises(InputError, match=f"--{next(iter(options)).replace('_', '-')}.*out of range"):
        latin_fmu.calibrate(crushing(), data, FRICTION, **options)


def test_a_file_of_the_command_is_looked_for_in_the_current_folder(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r"nothing.csv.*relative to the current folder"):
        read_measured(["nothing.csv"], crushing())
