"""Header of every test run: totals of the sources; what all tests share."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path
from statistics import median

import pytest

from latin_fmu.compiled import library

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="session", autouse=True)
def _imports_followed_once() -> Iterator[None]:
    """Finding the sources of the library of kernels takes as long as the rest of a small FMU: for this package they are
    found once, since they do not change while the tests run."""
    follow = library.sources_of
    known = cache(lambda: tuple(follow(library.PACKAGE)))

    def sources_of(package: Path) -> list[Path]:
        return list(known()) if package == library.PACKAGE else follow(package)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(library, "sources_of", sources_of)
        yield


def pytest_report_header(config: pytest.Config) -> str:
    """Totals of the sources, printed and not limited; the limits are those of test_architecture."""
    del config
    lines = [
        len(path.read_text(encoding="utf-8").splitlines())
        for folder in ("latin_fmu", "fmu_build")
        for path in (ROOT / folder).rglob("*.py")
    ]
    return f"sources: {len(lines)} files, {sum(lines)} lines, median {median(lines):.0f}, longest {max(lines)}"
