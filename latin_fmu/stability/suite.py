"""All hard cases, in the order of the report."""

from __future__ import annotations

from . import bad_input, contrast, duration, friction, gaps, settings, shapes
from .case import Case

CASES: tuple[Case, ...] = tuple(
    case for family in (contrast, gaps, friction, shapes, settings, duration, bad_input) for case in family.cases()
)


def cases(quick: bool = False) -> tuple[Case, ...]:
    """All cases, or the quick ones (under a minute together)."""
    return tuple(case for case in CASES if case.quick or not quick)
