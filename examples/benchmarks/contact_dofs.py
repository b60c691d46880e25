"""Hierarchical dofs of contact faces of second order beside the values at their nodes; needs gmsh.

The bracket of ``tests.cad.assemblies`` is meshed by ``latin-fmu mesh`` with at most so many unknowns of contacts. Its
first three modes are computed, tightening included, with either kind of dofs in turn: CPU seconds, median. The
frequencies must be the same.

    OMP_NUM_THREADS=1 python examples/benchmarks/contact_dofs.py [--contacts N] [--rounds N]
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
from contextlib import nullcontext
from pathlib import Path
from statistics import median
from time import process_time
from unittest.mock import patch

import numpy as np

import latin_fmu
from latin_fmu.joined.hierarchical_dofs import HierarchicalDofs

ROOT = Path(__file__).resolve().parents[2]
_SAME = 1e-7  # of a frequency


def meshed(folder: Path, contacts: int) -> tuple[Path, str]:
    """Scene of the bracket, and the number of its unknowns of contacts."""
    step = folder / "bracket.step"
    drawn = [sys.executable, "-m", "tests.cad.assemblies", "bracket", str(step)]
    subprocess.run(drawn, check=True, cwd=ROOT, capture_output=True)
    command = [sys.executable, "-m", "latin_fmu", "mesh", str(step), "-o", str(folder / "bracket")]
    command += ["--contacts", str(contacts)]
    printed = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    found = re.search(r"some ([\d,]+) unknowns", printed)
    assert found is not None
    return folder / "bracket.toml", found[1]


def timed(scene: latin_fmu.Scene, by_nodes: bool) -> tuple[float, np.ndarray]:
    """CPU seconds and frequencies of the modes."""
    nodal = patch.object(HierarchicalDofs, "of", staticmethod(lambda *_: HierarchicalDofs(None)))
    with nodal if by_nodes else nullcontext():
        start = process_time()
        frequency = latin_fmu.vibration_modes(scene, count=3).frequency[:3]
        return process_time() - start, np.asarray(frequency)


def main() -> None:
    """Print both times and their ratio."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--contacts", type=int, default=4000, help="unknowns, at most")
    parser.add_argument("--rounds", type=int, default=1)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        file, unknowns = meshed(Path(temporary), options.contacts)
        scene = latin_fmu.load_scene(file)
        rounds = [[timed(scene, by_nodes) for by_nodes in (False, True)] for _ in range(options.rounds)]
    reference = rounds[0][0][1]
    apart = max(float(np.abs(frequency / reference - 1.0).max()) for pair in rounds for _, frequency in pair)
    assert apart < _SAME, apart
    hierarchical, nodal = (median(pair[i][0] for pair in rounds) for i in (0, 1))
    print(f"{unknowns} unknowns of contacts: hierarchical dofs {hierarchical:.1f} s, values at nodes {nodal:.1f} s")
    print(f"ratio {nodal / hierarchical:.2f}; frequencies {apart:.1e} apart")


if __name__ == "__main__":
    main()
