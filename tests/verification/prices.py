"""Price lists against doing it: random scenes are run at the settings of their price lists, once for each entry.

    python -m tests.verification.prices --solids 0:20 --chains 480:490

Of each headline quantity of a scene the entries that ask for another run: its CPU time over the predicted one, its
estimated error over the target, and where an exact solution or a reference is known, its true error over the target.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import latin_fmu
from latin_fmu.accuracy.estimate import coarser_runs_of, estimate_error, quantity_estimate
from latin_fmu.accuracy.runs import Resolution, at_resolution, in_short_windows, solved
from latin_fmu.errors import LatinError
from latin_fmu.run_quantities import Quantities
from latin_fmu.scene.quantity_table import FLOOR, definition_of

from .solid_strangers import _Judge, solid
from .strangers import chain

SHORTEST = 0.02
"""Runs of less CPU time are left out: the clock of a process decides them, s."""


@dataclass(frozen=True)
class Entry:
    """An entry done: ratios to what was predicted (module docstring); NaN where they are not known."""

    scene: str
    quantity: str
    target: float
    setting: str
    predicted: float
    cost: float
    estimated: float
    true: float


def entries(scene: latin_fmu.Scene, truth: Quantities | None) -> Iterator[Entry]:
    """Entries of the price list of a scene; ``truth`` : an exact solution, or a finer run."""
    lean = in_short_windows(scene)
    latin_fmu.solve(lean)  # kernels are loaded
    solution = latin_fmu.solve(lean)
    if not solution.trustworthy:
        sys.stderr.write(f"{scene.name}: {solution.status}\n")
        return
    estimate = estimate_error(lean, solution)
    runs: dict[Resolution, tuple[float, dict[str, float], Quantities]] = {}
    for quantity in (q for q in estimate.quantities if definition_of(q.quantity).headline):
        for price in quantity.prices:
            at = Resolution(price.mesh, price.steps, price.tolerance)
            if price.reason or price.mesh == price.steps == 1.0:
                continue
            try:
                if at not in runs:
                    runs[at] = _done(scene, lean, at)
            except LatinError as error:
                sys.stderr.write(f"{scene.name} {quantity.quantity}: {error}\n")
                continue
            cpu, errors, measured = runs[at]
            name, target = quantity.quantity, price.target
            true = np.nan
            if truth is not None and name in truth.values and name in measured.values:
                true = max(measured.error(name, truth), FLOOR) / target
            found = errors.get(name, np.nan) / target
            yield Entry(scene.name, name, target, price.setting, price.cpu, cpu / price.cpu, found, true)


def _done(scene: latin_fmu.Scene, lean: latin_fmu.Scene, at: Resolution) -> tuple[float, dict[str, float], Quantities]:
    """CPU time of a run at a resolution, its estimated errors in the bands of the scene as written, its quantities."""
    there = at_resolution(lean, at)
    run, _ = solved(scene, there, at)
    runs = [(at, run.quantities)]
    plan = coarser_runs_of(there)
    for coarser in () if plan is None else plan.by_name().values():
        below = Resolution(at.mesh * coarser.mesh, at.time * coarser.time, at.tolerance)
        found, _ = solved(scene, at_resolution(lean, below), below)
        if found.converged:
            runs.append((below, found.quantities))
    errors = {}
    if len(runs) > 1:
        errors = {q: max(quantity_estimate(there, q, runs).error, FLOOR) for q in run.quantities.values}
    return run.cost.setup + run.cost.steps, errors, run.quantities


def _solids(seeds: range) -> Iterator[Entry]:
    for seed in seeds:
        with tempfile.TemporaryDirectory() as folder:
            scene = solid(seed, Path(folder))
            judge = _Judge.of(scene)
            yield from entries(scene, None if judge is None else judge.finest)


def _chains(seeds: range) -> Iterator[Entry]:
    for seed in seeds:
        known = chain(seed)
        yield from entries(known.scene, known.exact)


def _seeds(text: str) -> range:
    first, _, last = text.partition(":")
    return range(int(first), int(last))


def main() -> None:
    """Print every entry, and how often cost and error are as predicted."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--solids", type=_seeds, default=range(0), help="seeds, from:to")
    parser.add_argument("--chains", type=_seeds, default=range(0))
    parser.add_argument("--models", nargs="*", type=Path, default=[], help="scene files")
    given = parser.parse_args()
    done: list[Entry] = []
    lists = [_chains(given.chains), _solids(given.solids)]
    lists += [entries(latin_fmu.load_scene(path), None) for path in given.models]
    for entry in (e for some in lists for e in some):
        done.append(entry)
        print(  # noqa: T201
            f"{entry.scene:26s} {entry.quantity:32s} {100 * entry.target:g} % {entry.setting:28s} "
            f"predicted {entry.predicted:.3g} s, cost x {entry.cost:.2f}, "
            f"estimated / target {entry.estimated:.2f}, true / target {entry.true:.2f}",
            flush=True,
        )
    long = [e for e in done if e.predicted >= SHORTEST]
    within = np.mean([0.5 <= e.cost <= 2.0 for e in long]) if long else np.nan
    estimated = np.mean([e.estimated <= 1.0 for e in done])
    true = [e.true <= 1.0 for e in done if np.isfinite(e.true)]
    print(  # noqa: T201
        f"{len(done)} entries of {len({e.scene for e in done})} scenes: cost within a factor of 2 {within:.0%} of "
        f"{len(long)}; estimated error within the target {estimated:.0%}, true error {np.mean(true):.0%} of {len(true)}"
    )


if __name__ == "__main__":
    main()
