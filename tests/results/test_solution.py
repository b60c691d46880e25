"""Access to a solution: forwarded attributes, report for programs, summary for people."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from latin_fmu.results.solution import Solution
from latin_fmu.scene.readable_numbers import prefix_for, readable, readable_vector


def test_attributes_are_those_of_the_outcome(crushing: Solution) -> None:
    for name in ("status", "converged", "time", "windows", "error_indicator", "passes", "timings", "warnings"):
        assert getattr(crushing, name) is not None
    for name in ("interfaces", "substructures", "windows", "energy", "timings"):
        assert getattr(crushing, name) is getattr(crushing.outcome, name)


def test_report_has_its_keys(crushing: Solution) -> None:
    report = crushing.report()
    assert list(report) == [
        "status",
        "converged",
        "trustworthy",
        "complete",
        "interrupted",
        "iterations",
        "newton_steps",
        "passes",
        "error_indicator",
        "defect",
        "cpu_seconds",
        "peak_memory_bytes",
        "penetration",
        "penetration_landed",
        "penetration_closed",
        "resultants",
        "warnings",
        "warning_codes",
        "interfaces",
        "units",
    ]
    parts = ["set_up", "march", "other", "output", "total"]
    assert list(report["cpu_seconds"]) == parts
    assert list(report["interfaces"]["crush"]) == [
        "impulse",
        "peak_force",
        "peak_duration",
        "peak_force_raw",
        "first_contact_time",
        "separation_time",
        "error_indicator",
    ]
    assert len(report["iterations"]) == 200
    assert report["interfaces"]["crush"]["impulse"] == pytest.approx(
        crushing.interfaces["crush"].impulse(crushing.time)[-1]
    )
    assert report["penetration"] == pytest.approx(1e-10)


def test_report_is_strict_json_whatever_the_numbers(crushing: Solution) -> None:
    history = crushing.interfaces["crush"]
    broken = replace(history, traction=np.full_like(history.traction, np.nan))
    outcome = replace(
        crushing.outcome, interfaces={"crush": broken}, passes=np.inf, interface_indicator={"crush": np.nan}
    )
    report = replace(crushing, outcome=outcome).report()
    text = json.dumps(report, allow_nan=False)
    assert json.loads(text)["interfaces"]["crush"]["impulse"] == [None, None, None]
    assert report["passes"] is None


def test_an_interface_never_touched_has_no_times(crushing: Solution) -> None:
    history = crushing.interfaces["crush"]
    silent = replace(history, traction=np.zeros_like(history.traction))
    report = replace(crushing, outcome=replace(crushing.outcome, interfaces={"crush": silent})).report()
    item = report["interfaces"]["crush"]
    assert (item["first_contact_time"], item["separation_time"], item["peak_force"]) == (None, None, 0.0)
    assert (item["peak_duration"], item["peak_force_raw"]) == (0.0, 0.0)


def test_summary_tells_what_matters(crushing: Solution) -> None:
    text = crushing.summary(details=True)
    for words in (
        crushing.status,
        "min 4, mean 6, max 8 over 200 windows",
        "100 pm",
        "36.00 kN",
        "3.150 us",
        "15.70 us",
        "impulse 0.2 % too small",
        "120 MB",
        "balance closed to",
    ):
        assert words in text, words
    assert text.isascii()


def test_summary_of_a_failed_run_says_where(stalled: Solution) -> None:
    assert "use shorter windows" in stalled.summary(details=True)
    assert "1 used a fall-back; 1 not converged" in stalled.summary(details=True)


def test_summary_stays_narrow_for_many_interfaces(stack: Solution) -> None:
    lines = stack.summary(details=True).splitlines()
    assert max(map(len, lines)) <= 140
    assert sum("contact_" in line for line in lines) == 2 * 16


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (26800.0, "26.80 kN"),
        (0.0, "0 N"),
        (None, "-"),
        (-2.5e-7, "-250.0 nN"),
        (999.9999, "1000 N"),
        (1.0, "1.000 N"),
        (1e-30, "1.000e-15 fN"),
        (1000.0, "1.000 kN"),
    ],
)
def test_readable(value: float | None, text: str) -> None:
    assert readable(value, "N") == text


def test_components_share_one_prefix() -> None:
    assert readable_vector([0.0, 1e-12, -0.3896], "N s") == "(0, 0, -389.6) mN s"


def test_prefix_of_nothing() -> None:
    assert prefix_for(0.0, "m") == prefix_for(float("nan"), "m") == (1.0, "m")
