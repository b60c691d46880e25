"""Damaged input ends with a result or an error of the project: no traceback, hang, crash or stray output.

The same inputs come from the same seeds. One of them: ``python -m tests.fuzz.worker 5 FORMAT:SEED:1``.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from latin_fmu.compiled import PLAIN

pytestmark = pytest.mark.skipif(PLAIN, reason="the kernels of a run are plain Python: too slow")

ROOT = Path(__file__).parents[2]
NAMES = (
    "msh",
    "vtk",
    "vtu",
    "inp",
    "bdf",
    "exodus",
    "xdmf",
    "med",
    "text",
    "csv",
    "uff",
    "toml",
    "command",
    "fmu",
    "tables",
    "state",
    "tree",
)
SECONDS = 5  # of processor time for one input
QUICK, SLOW = 10, 20_000  # inputs of each format; in all
STORED = {"results": 300, "study": 300, "checkpoint": 300, "whole_fmu": 100}
"""Damaged files that the package wrote, in the slow tests; a thirtieth of them in the quick ones."""


def complaints(*jobs: str) -> list[str]:
    """What inputs "format:first seed:count" did that they must not, from a process of their own."""
    command = [sys.executable, "-m", "tests.fuzz.worker", str(SECONDS), *jobs]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    wrong = ["{} {}: {}".format(*line["wrong"]) for line in lines if "wrong" in line]
    if not lines or lines[-1] != {"at": None}:
        wrong.append(f"the process ends with {done.returncode} after {lines[-1:]}: {done.stderr[-1000:]}")
    return wrong


def test_damaged_input() -> None:
    """Whole files of all formats are read: otherwise the damaged ones would be refused for nothing."""
    assert complaints(*(f"{name}:{job}" for name in NAMES for job in ("whole:1", f"0:{QUICK}"))) == []


def test_damaged_files_of_the_package() -> None:
    """An error of the project and exit code 2, or the numbers of the whole file."""
    assert complaints(*(f"{name}:{count}:{count // 60}" for name, count in STORED.items())) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", STORED)
def test_a_thousand_damaged_files_of_the_package(name: str) -> None:
    assert complaints(f"{name}:0:{STORED[name]}") == []


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_twenty_thousand_damaged_inputs(name: str) -> None:
    assert complaints(f"{name}:{QUICK}:{SLOW // len(NAMES) + 1}") == []
