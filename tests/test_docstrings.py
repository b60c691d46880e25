"""Docstrings: their examples run; every public function and class has one, with what it takes and what it raises."""

from __future__ import annotations

import doctest
import inspect
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import latin_fmu

ROOT = Path(__file__).parents[1]
WITH_EXAMPLES = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    for folder in ("latin_fmu", "fmu_build")
    for path in (ROOT / folder).rglob("*.py")
    if ">>> " in path.read_text(encoding="utf-8")
)
PUBLIC = [f"{module}.{name}" for module in ("latin_fmu",) for name in import_module(module).__all__]


@pytest.mark.parametrize("module", WITH_EXAMPLES)
def test_examples_run(module: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the folder of the repository, with ``latin_fmu``, ``np`` and a ``folder`` to write to."""
    monkeypatch.chdir(ROOT)
    known = {"latin_fmu": latin_fmu, "np": np, "folder": tmp_path}
    options = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS
    failed, tried = doctest.testmod(import_module(module), extraglobs=known, optionflags=options)
    assert tried > 0
    assert failed == 0


@pytest.mark.parametrize("name", PUBLIC)
def test_public_names_have_an_example(name: str) -> None:
    thing = getattr(latin_fmu, name.rpartition(".")[2])
    text = inspect.getdoc(thing) or ""
    if isinstance(thing, type) and issubclass(thing, Exception):
        assert text
        return
    assert ">>> " in text
    if not isinstance(thing, type):
        assert "Raises" in text
