"""The stability suite: hard cases as data, run and reported by ``latin-fmu stress``.

``case`` what a case is and how it runs, ``scenes`` the descriptions they are made of, one file per family of cases,
``report`` the table and figure of the outcome.
"""

from __future__ import annotations

from . import contrast, impact, joints, surfaces
from .case import Bench, Case, CaseResult, Measure, run_case, run_suite

CASES: tuple[Case, ...] = (
    *contrast.contrast_cases(),
    *impact.gap_cases(),
    *joints.friction_cases(),
    *joints.joint_cases(),
    *surfaces.surface_cases(),
    *contrast.shape_cases(),
    *contrast.setting_cases(),
    *impact.long_cases(),
    *contrast.bad_input_cases(),
)
"""All hard cases, in the order of the report."""


def cases(quick: bool = False) -> tuple[Case, ...]:
    """All cases, or the quick ones (under a minute together)."""
    return tuple(case for case in CASES if case.quick or not quick)


__all__ = ["CASES", "Bench", "Case", "CaseResult", "Measure", "cases", "run_case", "run_suite"]
