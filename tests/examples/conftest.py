"""Scripts of ``examples`` and ``examples/benchmarks`` as modules."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType

import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.fixture(autouse=True)
def _examples(monkeypatch: pytest.MonkeyPatch) -> None:
    for folder in (EXAMPLES, EXAMPLES / "benchmarks"):
        monkeypatch.syspath_prepend(str(folder))


@pytest.fixture
def example(request: pytest.FixtureRequest) -> ModuleType:
    """The module named by the test's parameter."""
    return importlib.import_module(request.param)
