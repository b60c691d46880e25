"""The stability suite, one test per hard case; those that take long carry the marker ``slow``."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from latin_fmu.stability import CASES, Case, run_case


def marks(case: Case) -> Iterator[pytest.MarkDecorator]:
    """Long cases are slow; those of a known fault must fail until it is mended."""
    if not case.quick:
        yield pytest.mark.slow
    if case.fault:
        yield pytest.mark.xfail(reason=case.fault, strict=True)


@pytest.mark.parametrize("case", [pytest.param(c, id=f"{c.family}: {c.name}", marks=[*marks(c)]) for c in CASES])
def test_hard_case(case: Case) -> None:
    """Every measure within its limit (the limits and their reasons stand with the case)."""
    row = run_case(case)
    assert row.passed, f"expected: {row.expected}\nmeasured: {row.measured}"


def test_names_are_unique() -> None:
    assert len({c.name for c in CASES}) == len(CASES)
