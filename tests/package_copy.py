"""Recipes of CONTRIBUTING carried out in a copy of the sources, whose kernels are plain Python: nothing is compiled."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

ROOT = Path(__file__).parents[1]
Edits = Mapping[str, Iterable[tuple[str, str]]]
"""By file what stands there, and what stands there then."""


def copy_of(folder: Path, *parts: str) -> Path:
    """A copy of the package, and of other parts of the repository, in a folder."""
    for part in ("latin_fmu", *parts):
        shutil.copytree(ROOT / part, folder / part, ignore=shutil.ignore_patterns("__pycache__", "*.so"))
    shutil.copy(ROOT / "pyproject.toml", folder)
    return folder


def carry_out(folder: Path, edits: Edits, *commands: list[str]) -> None:
    """Edit a copy of the sources and run commands in it."""
    for name, pairs in edits.items():
        text = (folder / name).read_text()
        for before, after in pairs:
            assert text.count(before) == 1, (name, before)
            text = text.replace(before, after)
        (folder / name).write_text(text)
    environment = {**os.environ, "PYTHONPATH": str(folder), "LATIN_FMU_COMPILE": "setup"}
    for command in commands:
        done = subprocess.run(
            [sys.executable, *command], cwd=folder, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
