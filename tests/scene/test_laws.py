"""Time laws: jumps, exact impulses, and the impulse the solver makes of the samples."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

import latin_fmu
from latin_fmu.errors import SceneError
from latin_fmu.scene.laws import (
    ConstantLaw,
    CsvLaw,
    HalfSineLaw,
    InputLaw,
    Law,
    RectangularPulseLaw,
    StepLaw,
    TableLaw,
    TimeLaw,
    sampled,
    sampled_impulse_error,
)
from latin_fmu.scene.number_files import factor
from latin_fmu.stability.scenes import Box, column

LAWS: list[TimeLaw] = [
    ConstantLaw(),
    StepLaw(start=0.3),
    StepLaw(start=-1.0),
    RectangularPulseLaw(start=0.2, duration=0.5),
    RectangularPulseLaw(start=-0.2, duration=0.5),
    HalfSineLaw(start=0.1, duration=0.6),
    HalfSineLaw(start=-0.3, duration=2.0),
    TableLaw(times=(0.1, 0.2, 0.7), values=(1.0, -2.0, 3.0)),
    InputLaw(start_value=2.5),
]


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
@pytest.mark.parametrize(("t0", "t1"), [(0.0, 1.0), (0.15, 0.55), (-1.0, 0.05), (0.4, 0.4), (2.0, 3.0)])
def test_impulse_is_the_integral(law: TimeLaw, t0: float, t1: float) -> None:
    """Against midpoint sums, which need no value at a jump."""
    n = 200_000
    middle = t0 + (np.arange(n) + 0.5) * (t1 - t0) / n
    assert law.impulse(t0, t1) == pytest.approx(float(law.sample(middle).mean()) * (t1 - t0), abs=2e-5)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_impulse_is_additive(law: TimeLaw) -> None:
    whole = law.impulse(-0.5, 1.5)
    assert law.impulse(-0.5, 0.35) + law.impulse(0.35, 1.5) == pytest.approx(whole, rel=1e-13, abs=1e-13)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_sample_keeps_the_shape(law: TimeLaw) -> None:
    assert law.sample(np.zeros((2, 3))).shape == (2, 3)
    assert law.sample(0.25).shape == ()
    assert law.sample([]).shape == (0,)


def test_exact_values() -> None:
    assert HalfSineLaw(duration=3.0).impulse(0.0, 9.0) == pytest.approx(6.0 / math.pi, rel=1e-15)
    assert RectangularPulseLaw(start=1.0, duration=3.0).impulse(0.0, 9.0) == 3.0
    assert TableLaw(times=(0.0, 1.0), values=(0.0, 2.0)).impulse(-1.0, 3.0) == 5.0
    np.testing.assert_array_equal(TableLaw(times=(0.0, 1.0), values=(3.0, 4.0)).sample([-9.0, 0.5, 9.0]), [3, 3.5, 4])


def test_value_at_a_jump_is_the_value_before_it() -> None:
    times = [-1.0, 0.0, 0.5, 1.0, 1.5]
    np.testing.assert_array_equal(StepLaw().sample(times), [0, 0, 1, 1, 1])
    np.testing.assert_array_equal(RectangularPulseLaw(duration=1.0).sample(times), [0, 0, 1, 1, 0])


def test_half_sine_is_zero_after_its_end() -> None:
    np.testing.assert_array_equal(HalfSineLaw(start=1.0, duration=1.0).sample([0.0, 1.0, 2.0, 2.5]), np.zeros(4))


@pytest.mark.parametrize("n_step", [7, 42, 97, 1000, 100_003])
@pytest.mark.parametrize("unit", [1.0, 1e-9, 1e12])
def test_round_off_never_decides_a_jump(n_step: int, unit: float) -> None:
    """A pulse of n steps is 1 at n instants, however the instants were computed."""
    duration = unit * 0.5 / math.sqrt(3.0)
    step = duration / n_step
    law = RectangularPulseLaw(start=3 * step, duration=duration)
    for times in (np.arange(n_step + 10) * step, np.cumsum(np.full(n_step + 9, step))):
        assert law.sample(times).sum() == min(n_step, np.count_nonzero(times > 3.5 * step))


def test_sampled_impulse_error() -> None:
    times = np.linspace(0.0, 1.0, 101)
    assert sampled_impulse_error(ConstantLaw(), times) == pytest.approx(0.0, abs=1e-14)
    assert sampled_impulse_error(InputLaw(), times) == 0.0
    assert sampled_impulse_error(RectangularPulseLaw(start=0.1, duration=0.3), times) == pytest.approx(0.0, abs=1e-12)
    assert sampled_impulse_error(RectangularPulseLaw(start=0.105, duration=0.3), times) == pytest.approx(0.0, abs=1e-12)
    assert sampled_impulse_error(RectangularPulseLaw(duration=0.305), times) == pytest.approx(0.005 / 0.305, rel=1e-9)
    assert sampled_impulse_error(RectangularPulseLaw(start=0.501, duration=0.001), times) == 1.0
    # trapezoid rule of half a sine over m steps: relative error (pi / m)^2 / 12
    assert sampled_impulse_error(HalfSineLaw(duration=1.0), times) == pytest.approx((math.pi / 100) ** 2 / 12, rel=1e-3)


def test_sampled_impulse_error_of_a_law_without_mean() -> None:
    law = TableLaw(times=(0.0, 0.5, 1.0), values=(1.0, -1.0, 1.0))
    assert sampled_impulse_error(law, np.linspace(0.0, 1.0, 101)) < 1e-12


def test_arrays_make_tables() -> None:
    times = np.linspace(0.0, 1.0, 5)
    assert TableLaw(times=times, values=times**2).values[-1] == 1.0  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "text", ["0,1\n1,2\n", "t,a\n0,1\n1,2", "# note\n\n0;1\n1;2", "0\t1\r\n1\t2", "time value\n0 1\n 1  2 \n"]
)
def test_csv_files(tmp_path: Path, text: str) -> None:
    (tmp_path / "law.csv").write_text(text, encoding="utf-8-sig")
    law = CsvLaw.model_validate({"type": "csv", "file": "law.csv"}, context={"base_dir": tmp_path})
    assert (law.times, law.values) == ((0.0, 1.0), (1.0, 2.0))
    (tmp_path / "law.csv").unlink()
    assert CsvLaw.model_validate(law.model_dump()) == law


@pytest.mark.parametrize(
    ("content", "part"),
    [
        (b"", "two points"),
        (b"t,a\n", "two points"),
        (b"0,1\n1,nan\n", "line 2"),
        (b"0,1\n1,inf\n", "line 2"),
        (b"nan,1\n1,2\n", "line 1"),
        (b"a,b\nc,d\n", "no numbers in the first column of 2 lines"),
        (b"0,1,2\n1,2,3\n", "the file has 3 columns"),
        (b"0,1\n0,2\n", "do not increase"),
        (b"0,5;1\n1.5;2\n", "decimal points and decimal commas are mixed .line 2"),
        (b"0.5;1\n1.5;2,000.5\n", "line 2"),
        (b"\xff\xfe\x00", "not a text file"),
        (b"0,1\n1,1e999\n", "line 2"),
    ],
)
def test_bad_csv_files(tmp_path: Path, content: bytes, part: str) -> None:
    (tmp_path / "law.csv").write_bytes(content)
    with pytest.raises(ValidationError, match=part):
        CsvLaw.model_validate({"type": "csv", "file": "law.csv"}, context={"base_dir": tmp_path})


@pytest.mark.parametrize(
    ("text", "keys"),
    [
        ("0,1\n1,2\n", {"time_unit": "ms", "value_unit": "kN"}),
        ("1,0\n2,1\n", {"time_column": 2, "column": 1, "time_unit": 1e-3, "value_unit": 1000}),
        ('t [ms];"unused";F [kN]\n0;-;1\n1;-;2\n', {"column": "F [kN]", "time_unit": "ms", "value_unit": "kN"}),
        ("t\tF\tG\n0\t9\t1\n1\t9\t2\n", {"column": "G", "time_unit": "ms", "value_unit": "kN"}),
        ("t F G\n0 9 1\n1 9 2\n", {"time_column": "t", "column": 3, "time_unit": "ms", "value_unit": 1e3}),
    ],
)
def test_columns_and_units_of_csv_files(tmp_path: Path, text: str, keys: dict[str, Any]) -> None:
    (tmp_path / "law.csv").write_text(text)
    law = CsvLaw.model_validate({"type": "csv", "file": "law.csv", **keys}, context={"base_dir": tmp_path})
    assert (law.times, law.values) == ((0.0, 1e-3), (1e3, 2e3))
    (tmp_path / "law.csv").unlink()
    assert CsvLaw.model_validate(law.model_dump()) == law  # not scaled again


def test_units_are_those_of_their_definitions() -> None:
    for name, size in (("g", 9.80665), ("bar", 1e5), ("psi", 6894.757293168361), ("km/h", 1 / 3.6), ("lbf", 4.4482216)):
        assert factor(name) == pytest.approx(size, rel=1e-8), name


@pytest.mark.parametrize(
    ("keys", "part"),
    [
        ({"column": "force"}, "no column of this name"),
        ({"column": 4}, "no such column"),
        ({"column": 0}, "not a column"),
        ({"column": 2.5}, "not a column"),
        ({"column": 3, "time_unit": "sec"}, "unknown unit"),
        ({"column": 3, "value_unit": 0}, "not a unit"),
        ({"column": 2}, "line 3 is not 2 finite numbers"),
        ({}, "line 2"),
    ],
)
def test_bad_columns_and_units(tmp_path: Path, keys: dict[str, Any], part: str) -> None:
    (tmp_path / "law.csv").write_text("t,F,G\n0,1,1\n1,,2\n")
    with pytest.raises(ValidationError, match=part):
        CsvLaw.model_validate({"type": "csv", "file": "law.csv", **keys}, context={"base_dir": tmp_path})


@pytest.mark.parametrize("name", ["none.csv", ".", "a\0b", "x" * 5000, "law.csv/deeper"])
def test_unreadable_csv_names(tmp_path: Path, name: str) -> None:
    (tmp_path / "law.csv").write_text("0,1\n1,2\n")
    with pytest.raises(ValidationError, match="file"):
        CsvLaw.model_validate({"type": "csv", "file": name}, context={"base_dir": tmp_path})


def test_a_bare_word_is_a_law() -> None:
    law: object = TypeAdapter(Law).validate_python("step")
    assert law == StepLaw()


@pytest.mark.parametrize(
    "law",
    [
        RectangularPulseLaw(start=-1.0, duration=1.0),
        TableLaw(times=(0.0, 1e-9, 2.0), values=(1.0, 0.0, 0.0)),
        TableLaw(times=(0.0, 1e-9, 2.0), values=(1.0, 0.25, 0.25)),
    ],
)
def test_a_load_released_at_the_start_acts_no_longer(law: RectangularPulseLaw | TableLaw) -> None:
    """A static start is under the value before the release; the march begins with the value after it."""
    times = np.linspace(0.0, 1.0, 101)
    assert law.sample(times)[0] == 1.0
    np.testing.assert_allclose(sampled(law, times), law.sample(times[1:2])[0], rtol=1e-12)
    assert sampled_impulse_error(law, times) < 1e-6


def test_only_a_release_at_the_start_changes_a_sample() -> None:
    """Loads that begin at t = 0, fall smoothly from there, or start later keep the value of the law."""
    times = np.linspace(0.0, 1.0, 101)
    smooth = TableLaw(times=tuple(times), values=tuple(np.cos(times)))
    for law in (ConstantLaw(), StepLaw(), RectangularPulseLaw(duration=0.3), smooth, HalfSineLaw(duration=0.5)):
        np.testing.assert_array_equal(sampled(law, times), law.sample(times))
        np.testing.assert_array_equal(sampled(law, times + 0.5), law.sample(times + 0.5))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes")
@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("pipe.csv", "not a regular file"),
        ("/dev/zero", "not a regular file"),
        ("secret.csv", "no numbers in the first column of 2 lines"),
        ("inf.csv", "(value: inf)"),
    ],
)
def test_a_law_comes_from_a_regular_file_and_is_not_quoted(tmp_path: Path, name: str, words: str) -> None:
    """A pipe or a device is refused at once; of a file that is no table no text is shown."""
    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "secret.csv").write_text("user:hunter2\nroot:swordfish\n")
    (tmp_path / "inf.csv").write_text("0 1\n1 inf\n")
    scene = column(
        {"bar": Box(elements=(1, 1, 1))},
        {},
        {"end": 1e-5, "instants": 2},
        load={"push": {"face": "bar.zmax", "pressure": 1.0, "law": {"type": "csv", "file": name}}},
    )
    with pytest.raises(SceneError) as caught:
        latin_fmu.scene_from_dict(scene, tmp_path)
    assert words in str(caught.value)
    assert "swordfish" not in str(caught.value)
