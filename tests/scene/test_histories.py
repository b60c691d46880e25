"""Histories from recorders: text of oscilloscopes and universal files, their units, and their times in the run."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.errors import SceneError
from latin_fmu.scene.laws import CsvLaw
from latin_fmu.scene.unit_texts import GRAVITY
from latin_fmu.scene.units import UNIT_SYSTEMS

STEP, DURATION, PEAK = 1e-4, 11e-3, 30.0
TIMES = STEP * np.arange(400)
"""Samples of a half sine of 30 g and 11 ms, s."""
VALUES = np.where(TIMES < DURATION, PEAK * np.sin(np.pi * np.minimum(TIMES / DURATION, 1.0)), 0.0)
CHANGE = 2.0 / np.pi * PEAK * GRAVITY * DURATION
"""Integral of the half sine, 2.06 m/s."""


def scene(law: dict[str, Any], folder: Path, kind: str = "acceleration", **keys: Any) -> latin_fmu.Scene:
    """A cube whose base follows a history from a file; 30 ms."""
    driven = {"type": kind, "face": "b.zmin", "components": ["x", "y", "z"], "value": [0.0, 0.0, 1.0], "law": law}
    tables = {
        "name": "history",
        "material": {"m": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}},
        "substructure": {"b": {"material": "m", "box": {"size": [0.02] * 3, "elements": [1, 1, 1]}}},
        "boundary": {"base": driven},
        "time": {"end": 0.03, "step": 1e-4},
    } | keys
    return latin_fmu.scene_from_dict(tables, folder)


def text(
    times: Any,
    values: Any,
    header: str = "Time (s),Z (g)\n",
    separator: str = ",",
    comma: bool = False,
    end: str = "\n",
) -> str:
    """A file of two columns."""
    lines = [f"{t:.6f}{separator}{v:.6f}" for t, v in zip(times, values, strict=True)]
    rows = end.join(line.replace(".", ",") if comma else line for line in lines)
    return header + rows + end


def law(folder: Path, content: str | bytes, **keys: Any) -> dict[str, Any]:
    """A law of a file with this content."""
    (folder / "pulse.csv").write_bytes(content if isinstance(content, bytes) else content.encode())
    return {"type": "csv", "file": "pulse.csv", **keys}


def checked(made: latin_fmu.Scene) -> dict[str, Any]:
    """What ``check`` says of the one history, and the codes of its remarks."""
    from latin_fmu import api

    found = api.checked(made)
    report = found.report()
    lines = [line for line in found.text() if line.startswith("  history boundary.base.law: pulse.csv")]
    return {**report["histories"][0], "codes": [w["code"] for w in report["warnings"]], "line": lines[0]}


def refused(folder: Path, content: str | bytes, **keys: Any) -> str:
    """The message on a scene that is refused."""
    with pytest.raises(SceneError) as caught:
        scene(law(folder, content, **keys), folder)
    return str(caught.value)


# -- the time axis ---------------------------------------------------------------------------------------------
BEFORE = np.concatenate([STEP * np.arange(-80, 0), TIMES])
QUIET = np.concatenate([np.zeros(80), VALUES])


def test_samples_before_the_start_are_refused_with_the_remedies(tmp_path: Path) -> None:
    message = refused(tmp_path, text(BEFORE, QUIET), value_unit="g")
    assert "80 of 480 samples are before t = 0" in message
    for remedy in ('start = "record"', "shift = 0.008", 'start = "cut"'):
        assert remedy in message


@pytest.mark.parametrize("keys", [{"start": "record"}, {"shift": 0.008}, {"start": "record", "shift": 0.001}])
def test_a_record_with_pre_trigger_gives_the_whole_pulse(tmp_path: Path, keys: dict[str, Any]) -> None:
    made = scene(law(tmp_path, text(BEFORE, QUIET), value_unit="g", **keys), tmp_path)
    found = checked(made)
    assert found["peak"] == pytest.approx(30 * GRAVITY, rel=1e-3)
    assert found["integral"] == pytest.approx(CHANGE, rel=1e-3)
    assert found["samples"] == 301 - 10 * ("shift" in keys and "start" in keys)
    assert found["codes"] == []
    assert "peak 30 g (294.2 m/s2) at 0.01" in found["line"] or "peak 30 g (294.2 m/s2) at 0.0135" in found["line"]
    assert "integral 2.06 m/s" in found["line"]


def test_the_body_on_the_base_has_the_change_of_velocity_of_the_record(tmp_path: Path) -> None:
    content = text(BEFORE, QUIET)
    made = scene(law(tmp_path, content, value_unit="g", start="record"), tmp_path, sensor={"top": {"face": "b.zmax"}})
    solution = latin_fmu.solve(made)
    assert float(solution.sensors["top"].velocity[-1, 2]) == pytest.approx(CHANGE, rel=2e-3)


def test_cut_leaves_out_what_is_before_the_start(tmp_path: Path) -> None:
    late = TIMES - 0.5 * DURATION
    made = CsvLaw.model_validate(law(tmp_path, text(late, VALUES), start="cut", value_unit="g"), context=at(tmp_path))
    assert made.times[0] == 0.0
    assert made.values[0] == pytest.approx(30 * GRAVITY, rel=1e-3)  # between the samples beside t = 0
    assert made.impulse(0.0, 0.03) == pytest.approx(0.5 * CHANGE, rel=1e-3)
    assert "all samples are before t = 0" in refused(tmp_path, text(TIMES - 1.0, VALUES), start="cut", value_unit="g")


def at(folder: Path, units: str = "SI") -> dict[str, Any]:
    """Context in which laws are read."""
    return {"base_dir": folder, "units": UNIT_SYSTEMS[units]}  # type: ignore[index]


def test_round_off_of_a_first_sample_at_zero_is_no_pre_trigger(tmp_path: Path) -> None:
    content = "-1.2e-17,0\n" + text(TIMES[1:], VALUES[1:], "")
    assert CsvLaw.model_validate(law(tmp_path, content), context=at(tmp_path)).times[1] == pytest.approx(STEP)


def test_missing_samples_are_refused_with_their_place(tmp_path: Path) -> None:
    there = (TIMES <= 4.05e-3) | (TIMES >= 6.95e-3)
    content = text(TIMES[there], VALUES[there])
    message = refused(tmp_path, content, value_unit="g")
    assert "samples are missing from 0.004 s to 0.007 s" in message
    assert 'gaps = "linear"' in message
    found = checked(scene(law(tmp_path, content, value_unit="g", gaps="linear"), tmp_path))
    assert found["samples"] == 301 - 29


def test_a_hole_and_a_pre_trigger_are_said_at_once(tmp_path: Path) -> None:
    there = (BEFORE <= 4.05e-3) | (BEFORE >= 6.95e-3)
    message = refused(tmp_path, text(BEFORE[there], QUIET[there]), value_unit="g")
    assert "samples are missing" in message
    assert "before t = 0" in message


def test_a_table_made_by_hand_may_have_any_intervals(tmp_path: Path) -> None:
    content = "0,0\n0.001,1\n0.02,1\n0.0201,0\n"
    assert CsvLaw.model_validate(law(tmp_path, content), context=at(tmp_path)).impulse(0.0, 0.03) > 0.019


@pytest.mark.parametrize("moved", [1.0, -1.0])
def test_a_record_without_content_in_the_run_is_refused(tmp_path: Path, moved: float) -> None:
    message = refused(tmp_path, text(TIMES, VALUES), value_unit="g", shift=moved, start="file")
    assert ("nothing of the record is inside the run" if moved > 0 else "before t = 0") in message


def test_the_unit_of_time_in_the_header_is_read_and_said(tmp_path: Path) -> None:
    found = checked(scene(law(tmp_path, text(1e3 * TIMES, VALUES, "Time (ms),Z (g)\n"), value_unit="g"), tmp_path))
    assert found["integral"] == pytest.approx(CHANGE, rel=1e-3)
    assert 'column 2 "Z (g)" over column 1 "Time (ms)", times in ms by the header, values in g' in found["line"]


def test_a_duration_of_a_thousand_runs_without_a_unit_is_refused_or_said(tmp_path: Path) -> None:
    content = text(1e3 * TIMES, VALUES, "t,a\n")
    assert "nothing of the record is inside the run: 1 of 400 samples" in refused(tmp_path, content, value_unit="g")
    found = checked(scene(law(tmp_path, content, value_unit="g"), tmp_path, time={"end": 0.11, "step": 1e-3}))
    assert found["codes"].count("history") == 2  # two samples inside, of which none is near the peak
    rows = [f"{1e-3 * t:.9f},{v:.6f}" for t, v in zip(TIMES, VALUES, strict=True)]
    short = "t,a\n" + "\n".join(rows) + "\n"
    assert "history" in checked(scene(law(tmp_path, short, value_unit="g"), tmp_path))["codes"]
    assert "history" not in checked(scene(law(tmp_path, short, value_unit="g", time_unit="s"), tmp_path))["codes"]


def test_a_peak_outside_the_run_is_said(tmp_path: Path) -> None:
    made = scene(law(tmp_path, text(TIMES, VALUES), value_unit="g"), tmp_path, time={"end": 1e-3, "step": 1e-4})
    assert "history" in checked(made)["codes"]


# -- units in headers ------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("header", "time_unit", "value_unit"),
    [
        ("Time (s),Z (g)", "s", "g"),
        ("Zeit [ms],a [m/s²]", "ms", "m/s2"),
        ("t / us;F / kN", "us", "kN"),
        ("t/ms;a/g", "ms", "g"),
        ("time_ms,force", "ms", ""),
        ("Time (µs);Kraft in kN", "us", "kN"),
        ("s;g", "s", "g"),
        ("x-axis,1\nsecond,Volt", "s", ""),
        ("Time,Channel A\n(ms),(V)", "ms", ""),
        ("Model,MSO24\nSample Interval,1e-4\nTIME,CH1", "", ""),
        ("LECROY,1,Waveform\nSegments,1,SegmentSize,400\nTime,Ampl", "", ""),
        ("t,a", "", ""),
        ("Time (s),Accel m s^-2", "s", ""),
        ("Time (s),Accel (m s^-2)", "s", "m/s2"),
        ('"Time (s)","Accel, Z (mm/s^2)"', "s", "mm/s2"),
        ("Time (s)\tSpeed (m/s)", "s", "m/s"),
        ("Time (s) Z (g)", "s", "g"),
    ],
)
def test_units_of_headers(tmp_path: Path, header: str, time_unit: str, value_unit: str) -> None:
    separator = next((s for s in ";\t," if s in header.splitlines()[-1]), " ")
    content = f"{header}\n" + "".join(f"{i}{separator}{0.5 * i}\n" for i in range(12))
    # a factor is taken whatever the header says
    made = CsvLaw.model_validate(law(tmp_path, content, value_unit=1.0), context=at(tmp_path))
    assert made.header_units == (time_unit, value_unit)
    assert made.values == tuple(0.5 * i for i in range(12))
    assert CsvLaw.model_validate(made.model_dump()) == made


@pytest.mark.parametrize(
    ("header", "keys", "part"),
    [
        ("Time (s),Z (g)", {}, 'write value_unit = "g"'),
        ("Time (s),Z (V)", {}, "no unit"),
        ("Time (s),Z (kN)", {"value_unit": "g"}, "the header gives the values in kN"),
        ("Time (ms),Z (g)", {"value_unit": "g", "time_unit": "s"}, "the header gives the times in ms"),
        ("Frequency (Hz),Z (g)", {"value_unit": "g"}, "no unit of time"),
        ("Time (s),Z (N)", {}, "the header says a force"),
    ],
)
def test_units_that_contradict_the_header_are_refused(
    tmp_path: Path, header: str, keys: dict[str, Any], part: str
) -> None:
    part = "the scene does not say what they are" if part == "no unit" else part
    assert part in refused(tmp_path, text(TIMES, VALUES, f"{header}\n"), **keys)


def test_a_unit_of_the_scene_needs_no_key(tmp_path: Path) -> None:
    content = text(TIMES, VALUES, "Time (s),Z (m/s2)\n")
    assert CsvLaw.model_validate(law(tmp_path, content), context=at(tmp_path)).values == pytest.approx(VALUES, abs=1e-6)
    with pytest.raises(ValueError, match="does not say what they are"):
        CsvLaw.model_validate(law(tmp_path, content), context=at(tmp_path, "mm-t-s-MPa"))


def test_a_changed_key_reads_the_file_again(tmp_path: Path) -> None:
    made = scene(law(tmp_path, text(BEFORE, QUIET), value_unit="g", start="record"), tmp_path)
    moved = made.replace("boundary.base.law.shift", 0.002)
    assert moved.boundary["base"].law.times[0] == pytest.approx(0.002)  # type: ignore[union-attr]


# -- text of recorders -----------------------------------------------------------------------------------------
def content_of(kind: str) -> bytes:
    """The half sine as instruments write it."""
    g, metres = "Zeit (s);Z (g)\r\n", "Zeit [s];Z [m/s²]\r\n"
    made = {
        "decimal comma": text(TIMES, VALUES, g, ";", True, "\r\n").encode(),
        "decimal comma, tabs": text(TIMES, VALUES, g.replace(";", "\t"), "\t", True).encode(),
        "decimal comma, blanks": text(TIMES, VALUES, "", " ", True).encode(),
        "quoted decimal comma": ('"t","a (g)"\n' + text(TIMES, VALUES, "", '","', True, '"\n"')).encode()[:-1],
        "two headers": text(TIMES, VALUES, "x-axis,1\nsecond,Volt\n", end="\r\n").encode(),
        "latin-1": text(TIMES, GRAVITY * VALUES, metres, ";").encode("latin-1"),
        "UTF-16": text(TIMES, VALUES, g, ";").encode("utf-16"),
        "UTF-16 without a mark": text(TIMES, VALUES, g, ";").encode("utf-16-le"),
        "separator at the end": text(TIMES, VALUES, "X,CH1,\nSequence,Volt,\n", end=",\n").encode(),
        "a long header": text(TIMES, VALUES, "LabVIEW Measurement\nWriter_Version,2\n***End***\nX,Y\n").encode(),
    }
    content = made[kind]
    if kind == "quoted decimal comma":
        head, _, body = content.partition(b"\n")
        content = head + b'\n"' + body
    return content


@pytest.mark.parametrize(
    "kind",
    [
        "decimal comma",
        "decimal comma, tabs",
        "decimal comma, blanks",
        "quoted decimal comma",
        "two headers",
        "latin-1",
        "UTF-16",
        "UTF-16 without a mark",
        "separator at the end",
        "a long header",
    ],
)
def test_files_of_instruments(tmp_path: Path, kind: str) -> None:
    unit = "m/s2" if kind == "latin-1" else "g"
    found = checked(scene(law(tmp_path, content_of(kind), value_unit=unit), tmp_path))
    assert found["peak"] == pytest.approx(30 * GRAVITY, rel=1e-3)
    assert found["integral"] == pytest.approx(CHANGE, rel=1e-3)
    assert "column 2" in found["line"]
    assert ("decimal comma" in found["line"]) == ("comma" in kind)


SEVERAL = "Time (ms);X (g);Y (g);Z (g)\n" + "".join(
    f"{1e3 * t:.3f};0;-1;{v:.6f}\n".replace(".", ",") for t, v in zip(TIMES, VALUES, strict=True)
)


def test_several_columns_are_named(tmp_path: Path) -> None:
    message = refused(tmp_path, SEVERAL, value_unit="g")
    assert "the file has 4 columns" in message
    assert '4 "Z (g)"' in message
    for column in (4, "Z (g)"):
        found = checked(scene(law(tmp_path, SEVERAL, value_unit="g", column=column), tmp_path))
        assert found["integral"] == pytest.approx(CHANGE, rel=1e-3)
    wrong = refused(tmp_path, SEVERAL, value_unit="g", column="W (g)")
    assert "no column of this name" in wrong
    assert '4 "Z (g)"' in wrong
    twice = SEVERAL.replace("X (g)", "Z (g)")
    assert "several columns have this name" in refused(tmp_path, twice, value_unit="g", column="Z (g)")


@pytest.mark.parametrize(
    ("content", "part"),
    [
        (text(TIMES, VALUES, "Time,Z\n", ",", True), "decimal commas between commas cannot be told apart"),
        (text(TIMES, VALUES) + "End of data,\n", "line 402 is not two finite numbers"),
        (text(TIMES, VALUES).replace("0.000200,1.7", "0.000200,OVL"), "line 4 is not two finite numbers"),
        ("a;b\n" * 300, "no numbers in the first column of the first 200 lines"),
        (text(TIMES, VALUES, "Z;t\n", ";").replace("0.000100;", "0,000100;"), "decimal points and decimal commas"),
        (b"Time\x00\x01,Z\xff\n0,1\n", "not a text file"),
    ],
)
def test_files_that_are_refused_say_why(tmp_path: Path, content: str | bytes, part: str) -> None:
    assert part in refused(tmp_path, content, value_unit="g")


# -- universal files -------------------------------------------------------------------------------------------
def dataset_58(
    name: str, direction: int, values: Any, kind: int = 4, label: str = "g", function: int = 1, even: bool = True
) -> str:
    """A function of time, even or with its abscissae, in single (kind 2) or double precision (4)."""
    head = [
        f"{-1:6d}",
        f"{58:6d}",
        *[name, "NONE", "NONE", "NONE", "NONE"],
        f"{function:5d}{0:10d}{0:5d}{0:10d} {'NONE':10s}{7:10d}{direction:4d} {'NONE':10s}{0:10d}{0:4d}",
        f"{kind:10d}{len(values):10d}{int(even):10d}{0.0:13.5E}{STEP:13.5E}{0.0:13.5E}",
        f"{17:10d}{0:5d}{0:5d}{0:5d} {'Time':20s} {'s':20s}",
        f"{12:10d}{0:5d}{0:5d}{0:5d} {'Acceleration':20s} {label:20s}",
        *[f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':20s} {'NONE':20s}"] * 2,
    ]
    number = "{:20.12E}" if kind == 4 else "{:13.5E}"
    if even:
        words = [number.format(value) for value in values]
        across = 4 if kind == 4 else 6
    else:
        words = [f"{t:13.5E}" + number.format(value) for t, value in zip(STEP * np.arange(400), values, strict=True)]
        across = 2 if kind == 4 else 3
    rows = ["".join(words[i : i + across]) for i in range(0, len(words), across)]
    return "\n".join([*head, *rows, f"{-1:6d}"]) + "\n"


UNITS_164 = f"{-1:6d}\n{164:6d}\n{1:10d}{'SI: Meter (newton)':20s}{2:10d}\n  1.0  1.0  1.0\n  273.15\n{-1:6d}\n"


@pytest.mark.parametrize(("kind", "even"), [(2, True), (4, True), (2, False), (4, False)])
def test_a_universal_file_is_a_history(tmp_path: Path, kind: int, even: bool) -> None:
    content = dataset_58("base z", 3, VALUES, kind, even=even)
    found = checked(scene(law(tmp_path, content, value_unit="g"), tmp_path))
    assert found["peak"] == pytest.approx(30 * GRAVITY, rel=1e-3)
    assert found["integral"] == pytest.approx(CHANGE, rel=1e-3)
    assert 'column 1 "base z" in g' in found["line"]
    assert "does not say what they are" in refused(tmp_path, content)


def test_numbers_of_a_universal_file_may_touch(tmp_path: Path) -> None:
    content = dataset_58("base z", 3, -1e-100 * (1.0 + np.arange(400) / 1000), 4)
    assert "E-100-1.0" in content
    made = CsvLaw.model_validate(law(tmp_path, content, value_unit=1.0), context=at(tmp_path))
    assert made.values[399] == pytest.approx(-1.399e-100, rel=1e-9)


def test_functions_of_a_universal_file_are_named(tmp_path: Path) -> None:
    response = dataset_58("spectrum", 3, VALUES, function=4)
    content = UNITS_164 + response + dataset_58("base x", 1, 0 * VALUES) + dataset_58("base z", -3, GRAVITY * VALUES)
    content = content.replace("Acceleration         g", "Acceleration          ")
    message = refused(tmp_path, content)
    assert "the universal file has 2 functions of time" in message
    assert '2 "base z" at 7 -Z' in message
    for column in (2, "base z", "7 -z"):
        # the units of dataset 164 are those of the scene
        found = checked(scene(law(tmp_path, content, column=column), tmp_path))
        assert found["integral"] == pytest.approx(CHANGE, rel=1e-3)
    assert "no such function of time" in refused(tmp_path, content, column=3)
    assert "no function of time of this name" in refused(tmp_path, content, column="base y")
    assert "omit time_column" in refused(tmp_path, content, column=2, time_column=1)
    assert "no function of time" in refused(tmp_path, response)
    broken = dataset_58("base z", 3, VALUES).replace("E-01", "Q-01")
    assert "damaged" in refused(tmp_path, broken, value_unit="g")
    assert "too few numbers" in refused(tmp_path, dataset_58("z", 3, VALUES)[:4000], value_unit="g")


@pytest.mark.parametrize(("order", "code"), [("<", 1), (">", 2)])
def test_a_binary_universal_file_is_a_history(tmp_path: Path, order: str, code: int) -> None:
    lines = dataset_58("base z", 3, VALUES).splitlines()
    numbers = VALUES.astype(f"{order}f8").tobytes()
    head = f"{58:6d}b{code:6d}{2:6d}{11:12d}{len(numbers):12d}{0:6d}{0:6d}{0:12d}{0:12d}"
    content = "\n".join([lines[0], head, *lines[2:13]]).encode() + b"\n" + numbers + b"\n    -1\n"
    made = CsvLaw.model_validate(law(tmp_path, content, value_unit="g"), context=at(tmp_path))
    assert made.values == pytest.approx(GRAVITY * VALUES)
    assert math.isclose(made.impulse(0.0, 0.03), CHANGE, rel_tol=1e-3)
    # uneven, by writers that count the values alone
    pairs = np.stack([TIMES, VALUES], axis=1).reshape(-1).astype(f"{order}f8").tobytes()
    lines = dataset_58("base z", 3, VALUES, even=False).splitlines()
    content = "\n".join([lines[0], head, *lines[2:13]]).encode() + b"\n" + pairs + b"    -1\n"
    uneven = CsvLaw.model_validate(law(tmp_path, content, value_unit="g"), context=at(tmp_path))
    assert uneven.values == made.values
    assert uneven.times == pytest.approx(TIMES)
