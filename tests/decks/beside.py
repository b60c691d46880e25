"""A deck run by CalculiX (ccx) where it is installed: displacements that it prints."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

_TITLE = re.compile(r"displacements.* for set (\S+) and time\s+(\S+)")


def displacements(deck: str, folder: Path, name: str) -> dict[float, np.ndarray]:
    """Displacements (n, 3) of a node set by instant, as ``*NODE PRINT`` of the deck prints them."""
    if shutil.which("ccx") is None:
        pytest.skip("ccx is not installed (Debian and Ubuntu: calculix-ccx)")
    (folder / "there.inp").write_text(deck)
    done = subprocess.run(["ccx", "-i", "there"], cwd=folder, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout[-2000:]
    found: dict[float, list[list[float]]] = {}
    rows: list[list[float]] | None = None
    for line in (folder / "there.dat").read_text().splitlines():
        title = _TITLE.search(line)
        if title is not None:
            rows = found.setdefault(float(title[2]), []) if title[1] == name.upper() else None
        elif rows is not None and re.match(r"\s+\d+\s", line):
            rows.append([float(x) for x in line.split()[1:4]])
        elif line.strip():
            rows = None
    return {time: np.array(table) for time, table in found.items()}
