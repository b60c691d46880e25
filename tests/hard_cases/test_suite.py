"""The stability suite, one test per hard case; those that take long carry the marker ``slow``."""

from __future__ import annotations

import pytest

from latin_fmu.stability import CASES, run_case


@pytest.mark.parametrize(
    "case", [pytest.param(c, id=f"{c.family}: {c.name}", marks=[] if c.quick else [pytest.mark.slow]) for c in CASES]
)
def test_hard_case(case):
    """Every measure within its limit (the limits and their reasons stand with the case)."""
    row = run_case(case)
    assert row.passed, f"expected: {row.expected}\nmeasured: {row.measured}"


def test_names_are_unique():
    assert len({c.name for c in CASES}) == len(CASES)
