"""Results of a run: datasets, files, measures, figures and text."""

from __future__ import annotations

from .files import open_results
from .solution import Solution

__all__ = ["Solution", "open_results"]
