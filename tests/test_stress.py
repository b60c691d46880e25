"""The command ``latin-fmu stress`` on a short list of cases: table, figure, JSON, exit codes."""

from __future__ import annotations

import json

import pytest

from latin_fmu import stability
from latin_fmu.cli import main
from latin_fmu.stability import CASES, Case, Measure, report, run_case

KEYS = {"family", "case", "expected", "measured", "margin", "passed", "iterations", "fallbacks", "seconds"}


@pytest.fixture
def few(monkeypatch):
    """Three quick cases instead of all of them."""
    names = ("bars that overlap", "in contact at rest, no load", "bars, gap 0.001 L")
    chosen = tuple(c for c in CASES if c.name in names)
    assert len(chosen) == 3
    monkeypatch.setattr(stability, "CASES", chosen)
    return chosen


def test_json_is_one_list_of_rows(few, capsys):
    assert main(["stress", "--quick", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [row["case"] for row in rows] == [c.name for c in few]
    assert all(set(row) == KEYS for row in rows)
    assert all(row["passed"] is True for row in rows)


def test_report_and_figure(few, tmp_path, monkeypatch, capsys):
    first = dict([next(iter(report.SCHEMES.items()))])
    monkeypatch.setattr(report, "SCHEMES", first)
    target = tmp_path / "stability.md"
    assert main(["stress", "--quick", "-o", str(target)]) == 0
    text = target.read_text(encoding="utf-8")
    assert "3 of 3 hard cases hold" in text
    assert "| **gap** | 0, 1e-16 to 0.5 lengths" in text
    assert "| 3 of 3 | in contact at rest, no load: iterations per step 1 <= 1 |" in text
    assert len(text.splitlines()) < 40
    assert "Time schemes on impact" in text
    assert (tmp_path / "stability.png").read_bytes().startswith(b"\x89PNG")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["stability.json", "stability.md", "stability.png"]
    rows = json.loads((tmp_path / "stability.json").read_text(encoding="utf-8"))
    assert [row["case"] for row in rows] == [case.name for case in few]
    assert "3 of 3" in capsys.readouterr().out


def broken(_):
    raise ArithmeticError("not converged in 1 of 2 window(s)")


def test_a_case_that_fails_is_told(monkeypatch, capsys):
    """Too large a number, a number that is not finite, a run that stops: three failed rows, exit code 1."""
    bad = (
        Case("too large", "x", "small", lambda _: [Measure("off by", 2.0, 1.0)]),
        Case("no number", "x", "small", lambda _: [Measure("off by", float("nan"), 1.0)]),
        Case("stops", "x", "runs", broken),
    )
    monkeypatch.setattr(stability, "CASES", bad)
    assert main(["stress", "--json"]) == 1
    rows = json.loads(capsys.readouterr().out)
    assert [row["passed"] for row in rows] == [False] * 3
    assert "not converged" in rows[2]["measured"]
    assert [row["margin"] for row in rows] == [2.0, None, None]


@pytest.mark.usefixtures("few")
def test_target_is_checked_before_the_run(tmp_path, capsys):
    assert main(["stress", "-o", str(tmp_path / "nowhere" / "report.md")]) == 2
    assert "the folder does not exist" in capsys.readouterr().err


def test_a_margin_of_one_is_the_limit():
    row = run_case(Case("edge", "x", "at most", lambda _: [Measure("a", 0.5, 1.0), Measure("b", 3.0, 3.0)]))
    assert row.passed
    assert row.margin == 1.0


def test_every_family_says_what_it_varies_and_where_its_limits_come_from():
    assert set(report.FAMILIES) == {case.family for case in CASES}


def test_quick_is_a_part_of_all():
    assert set(stability.cases(quick=True)) < set(stability.cases())
    assert len(stability.cases(quick=True)) > 100
