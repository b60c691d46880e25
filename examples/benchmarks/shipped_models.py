"""CPU time of the shipped models over that of a former version of this package, in turn.

    python examples/benchmarks/shipped_models.py FOLDER [--rounds N] [--only MODEL ...]

``FOLDER`` is a former tree of this repository (``git worktree add FOLDER d672431a``, then there ``python -m
latin_fmu.aot``), which runs in the same environment. A run is that of ``latin_fmu.solve`` in a process of its own, on
one thread, after one that is not timed, without the coarser runs of an estimated error. Printed are medians of the
rounds, new over former, and the geometric mean of these. ``bolted_beam`` and ``electronics_box``, which take minutes,
are left out (``assemblies.py`` runs them).
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path
from statistics import geometric_mean, median
from time import process_time

ROOT = Path(__file__).resolve().parents[2]
MINUTES = ("bolted_beam", "electronics_box")


def timed(file: str) -> float:
    """CPU seconds of a run, after one."""
    import latin_fmu

    scene = latin_fmu.load_scene(file)
    for _ in range(2):
        begin = process_time()
        solution = latin_fmu.solve(scene)
        seconds = process_time() - begin
    if not solution.converged:
        raise SystemExit(f"{file}: {solution.status}")
    return seconds


def apart(tree: Path, file: Path) -> float:
    """The same by the package of a tree, in a process of its own; both trees solve the scenes of this one."""
    env = os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": str(tree)}
    command = [sys.executable, __file__, "--one", str(file)]
    made = subprocess.run(command, capture_output=True, text=True, check=True, env=env, cwd=tree)
    return float(json.loads(made.stdout.splitlines()[-1]))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("former", nargs="?", type=Path, help="a former tree of this repository")
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--only", nargs="+", help="folders of models")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        print(json.dumps(timed(given.one)))
        return
    if given.former is None:
        parser.error("a former tree is missing")
    files = [file for file in sorted((ROOT / "models").glob("*/*.toml")) if file.parent.name not in MINUTES]
    files = [file for file in files if not given.only or file.parent.name in given.only]
    trees = {"new": ROOT, "former": given.former.resolve()}
    ratios = []
    for file in files:
        for tree in trees.values():
            apart(tree, file)
        seconds: dict[str, list[float]] = {name: [] for name in trees}
        for _ in range(given.rounds):
            for name, tree in trees.items():
                seconds[name].append(apart(tree, file))
        new, former = median(seconds["new"]), median(seconds["former"])
        ratios.append(new / former)
        label = f"{file.parent.name}/{file.stem}"
        print(f"{label:40} {new:9.4f} s {former:9.4f} s {ratios[-1]:6.2f}", flush=True)
    print(f"geometric mean of {len(ratios)} models: {geometric_mean(ratios):.3f}")


if __name__ == "__main__":
    main()
