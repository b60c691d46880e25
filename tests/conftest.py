"""Header of every test run: totals of the sources."""

from __future__ import annotations

from pathlib import Path
from statistics import median

import pytest

ROOT = Path(__file__).parents[1]


def pytest_report_header(config: pytest.Config) -> str:
    """Totals of the sources, printed and not limited; the limits are those of test_architecture."""
    del config
    lines = [
        len(path.read_text(encoding="utf-8").splitlines())
        for folder in ("latin_fmu", "fmu_build")
        for path in (ROOT / folder).rglob("*.py")
    ]
    return f"sources: {len(lines)} files, {sum(lines)} lines, median {median(lines):.0f}, longest {max(lines)}"
