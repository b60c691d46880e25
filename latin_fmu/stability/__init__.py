"""The stability suite: hard cases as data, run and reported by ``latin-fmu stress``.

``case`` what a case is, ``scenes`` the descriptions they are made of, one file per family of cases, ``suite`` the
list of all of them, ``runner`` runs it, ``report`` and ``figure`` tell the outcome.
"""

from __future__ import annotations

from .case import Bench, Case, Measure, Row
from .runner import run_case, run_suite
from .suite import CASES, cases

__all__ = ["CASES", "Bench", "Case", "Measure", "Row", "cases", "run_case", "run_suite"]
