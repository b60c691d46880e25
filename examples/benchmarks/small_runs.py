"""Small runs: the march of blocks of up to 216 elements, and what a run costs beside its march.

    python examples/benchmarks/small_runs.py [--former FOLDER] [--rounds N] [--only PART ...]

  march    march of P1, P2 and P3 (``harness``) per pass, a substructure marched over one instant once, us; with
           --former over that of a former tree of this repository, for example of ``git worktree add FOLDER e281a00``,
           whose package numba (extra "kernels") compiles for the processor that the library of this package is made for
  blocks   P3 with blocks of 64 elements: march over that of the bonded mesh by the same kernels, factorised before, and
           over the time in which the processor reads the factors as often as the march does, twice an instant
  set-up   a second run of P1 and of P2: laying out the image, and all beside the march, ms
  reduced  P3 with reduced blocks: march of identical blocks together over the march of each on its own
  lid      P2 with 6,000 unknowns below a block that rests behind a gap and is never touched, over P2 alone
  first    a new process that solves P1: its CPU time, s, and its memory at most, MB

CPU time of one thread, in turn, median of the rounds.
"""

from __future__ import annotations

import copy
import importlib.util
import os
import subprocess
import sys
import time as clock
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from statistics import median
from typing import Any
from unittest.mock import patch

import numpy as np
from floor import Floor
from harness import OWN, Case, bars, contact_run, cpu, crushing, prepared, tower
from threadpoolctl import threadpool_limits

import latin_fmu
from latin_fmu.latin import run_state
from latin_fmu.latin.outcome import Outcome
from latin_fmu.march import march as march_problem

PARTS = ("march", "blocks", "set-up", "reduced", "lid", "first")
ROUNDS = 15
TARGET = {"NUMBA_CPU_NAME": "x86-64-v3", "NUMBA_CPU_FEATURES": "+avx2,+fma,+bmi,+bmi2,+lzcnt,+popcnt"}
"""What numba compiles a former package for: the processor of ``latin_fmu.aot``."""
FIRST = """
import time
import latin_fmu
from latin_fmu.machine import peak_memory
latin_fmu.solve(latin_fmu.scene_from_dict({tables!r}))
print(time.process_time(), peak_memory())
"""


def small_cases() -> list[Case]:
    """Bars, pairs of cubes and stacks, all with the scheme ``hht``, the default of former trees."""
    cases = [bars((1, 1, 50), None), crushing(4, 0.3), crushing(6, 0.3), tower(2, 4), tower(16, 4)]
    for case in cases:
        case.description["time"]["scheme"] = {"type": "hht"}
    return cases


def per_pass(case: Case, outcome: Outcome) -> float:
    """CPU seconds of the march per pass."""
    march = getattr(outcome.timings, "march", None)  # former trees name its parts
    march = outcome.timings.global_stage + outcome.timings.local_stage if march is None else march
    return float(march / outcome.passes / (case.n_blocks * (len(outcome.time) - 1)))


def medians(works: dict[str, Callable[[], float]], rounds: int) -> dict[str, float]:
    """Median of what each returns, called in turn in every round, on one thread; before them once."""
    found: dict[str, list[float]] = {name: [] for name in works}
    with threadpool_limits(1):
        for work in works.values():
            work()
        for _ in range(rounds):
            for name, work in works.items():
                found[name].append(work())
    return {name: median(values) for name, values in found.items()}


# -- march ------------------------------------------------------------------------------------------------------------
def former_package(folder: Path) -> Any:
    """The package ``latin_fmu`` of a former tree, under another name; its modules ``api`` and ``scene.build``."""
    os.environ.update(TARGET)
    package = folder / "latin_fmu"
    found = importlib.util.spec_from_file_location(
        "former_fmu", package / "__init__.py", submodule_search_locations=[str(package)]
    )
    assert found is not None
    assert found.loader is not None
    former = sys.modules["former_fmu"] = importlib.util.module_from_spec(found)
    found.loader.exec_module(former)
    return former, importlib.import_module("former_fmu.api"), importlib.import_module("former_fmu.scene.build")


def compare_marches(former_folder: Path | None, rounds: int) -> Iterator[float]:
    """Print a line for each of the small cases; seconds a pass."""
    former = None if former_folder is None else former_package(former_folder)
    for case in small_cases():
        ready = prepared(case, OWN)
        works: dict[str, Callable[[], float]] = {"this": lambda c=case, r=ready: per_pass(c, contact_run(r))}  # type: ignore[misc]
        if former is not None:
            package, api, build = former
            theirs = build.prepare(package.scene_from_dict({**case.description, "solver": OWN}))
            works["former"] = lambda c=case, r=theirs, api=api: per_pass(c, api.run(r.build()))  # type: ignore[misc]
        seconds = medians(works, rounds)
        line = f"{case.case:12} {case.n_blocks:3d} blocks   {1e6 * seconds['this']:8.2f} us a pass"
        if former is not None:
            line += f"   former {1e6 * seconds['former']:8.2f}   ratio {seconds['this'] / seconds['former']:5.2f}"
        print(line, flush=True)
        yield seconds["this"]


# -- blocks -----------------------------------------------------------------------------------------------------------
def marched(case: Case, solver: dict[str, Any]) -> Callable[[], float]:
    """CPU seconds of the march of a case, set up anew each time."""
    ready = prepared(case, solver)
    return lambda: contact_run(ready).timings.march


def panels_of(case: Case) -> list[np.ndarray]:
    """The factors of all blocks, where they lie in a run."""
    built = prepared(case, OWN).build()
    return [propagator.operators.factor.panels for propagator in built.assembly.propagators]


def read(panels: Sequence[np.ndarray], times: int) -> float:
    """CPU seconds in which every number of the factors is read so many times."""
    start = clock.process_time()
    for _ in range(times):
        for block in panels:
            block.max()
    return clock.process_time() - start


def compare_blocks(rounds: int) -> Iterator[float]:
    """Print the march of stacks over their floors; over the bonded mesh."""
    for count in (2, 16):
        case = tower(count, 4)
        ready, panels = prepared(case, OWN), panels_of(case)
        instants, floor = len(ready.time) - 1, Floor(ready)
        works = {
            "contact": marched(case, OWN),
            "bonded": floor.march,
            "reading": lambda panels=panels, n=2 * instants: read(panels, n),  # type: ignore[misc]
        }
        seconds = medians(works, rounds)
        print(
            f"{case.case:12} {count:3d} blocks   {1e3 * seconds['contact']:8.2f} ms   "
            f"over the bonded mesh {seconds['contact'] / seconds['bonded']:5.2f}   "
            f"over reading {1e-6 * sum(p.nbytes for p in panels):.2f} MB of factors twice an instant "
            f"{seconds['contact'] / seconds['reading']:5.2f}",
            flush=True,
        )
        yield seconds["contact"] / seconds["bonded"]


# -- set-up -----------------------------------------------------------------------------------------------------------
class Watch:
    """CPU seconds spent in a function of a module since the last reading."""

    def __init__(self, module: Any, name: str) -> None:
        self.seconds, self._function = 0.0, getattr(module, name)
        self.patch = patch.object(module, name, self._timed)

    def _timed(self, *given: Any, **named: Any) -> Any:
        start = clock.process_time()
        try:
            return self._function(*given, **named)
        finally:
            self.seconds += clock.process_time() - start


def set_up(case: Case) -> tuple[float, float, float]:
    """CPU seconds of the lay-out of the image of a run, of all beside the march, and of the march; the operators are
    those of a run before."""
    built = prepared(case, OWN).build()
    march_problem(built)
    for propagator in built.assembly.propagators:
        propagator.restart()
    built.timeline.begin(built.assembly, built.assembly.time, {}, built.assembly.ground.start)
    watch, found = Watch(run_state, "make_image"), list[Outcome]()
    with watch.patch:
        whole = cpu(lambda: found.append(march_problem(built).outcome))
    march = found[0].timings.march
    return watch.seconds, whole - march, march


def compare_set_up(rounds: int) -> Iterator[float]:
    """Print the parts of a small run beside its march; ms beside it."""
    for case in (bars((1, 1, 50), None), crushing(4, 0.3)):
        with threadpool_limits(1):
            turns = [set_up(case) for _ in range(rounds)]
        image, beside, march = (1e3 * median(part) for part in zip(*turns, strict=True))
        print(
            f"{case.case:12} image laid out in {image:6.2f} ms, all beside the march {beside:6.2f} ms, "
            f"march {march:6.2f} ms",
            flush=True,
        )
        yield beside


# -- reduced bodies ---------------------------------------------------------------------------------------------------
def compare_reduced(rounds: int) -> Iterator[float]:
    """Print the march of identical reduced blocks together over that of each on its own; these ratios."""
    for case in (tower(4, 4), tower(8, 4), tower(16, 4), tower(16, 6)):
        works = {
            "together": marched(case, {"propagator": "reduced"}),
            "apart": marched(case, {"propagator": "reduced", "share_identical": False}),
        }
        seconds = medians(works, rounds)
        print(
            f"{case.case:12} {case.n_blocks:3d} reduced blocks: together {1e3 * seconds['together']:7.2f} ms, "
            f"apart {1e3 * seconds['apart']:7.2f} ms, ratio {seconds['together'] / seconds['apart']:5.2f}",
            flush=True,
        )
        yield seconds["together"] / seconds["apart"]


# -- a body that is never touched -------------------------------------------------------------------------------------
def with_lid(description: dict[str, Any]) -> dict[str, Any]:
    """P2 with a third block, held at its top, 2 mm above the two."""
    tables = copy.deepcopy(description)
    lid = tables["substructure"]["lid"] = copy.deepcopy(tables["substructure"]["b2"])
    lid["box"]["origin"][2] += lid["box"]["size"][2] + 2e-3
    tables["interface"]["top"] = {"sides": ["b2.zmax", "lid.zmin"], "friction_coefficient": 0.3, "gap": 2e-3}
    tables["boundary"]["held"] = {"type": "fixed", "face": "lid.zmax"}
    return tables


def compare_lid(rounds: int, elements: int = 9) -> Iterator[float]:
    """Print set-up and march with the lid over those without; these ratios."""
    alone = crushing(elements, 0.3).description
    alone["time"]["scheme"] = {"type": "hht"}  # with others, masses depend on faces that may open: the lid is marched
    scenes = [latin_fmu.scene_from_dict(tables) for tables in (alone, with_lid(alone))]
    found: list[list[tuple[float, float]]] = [[], []]
    for _ in range(rounds):
        for times, scene in zip(found, scenes, strict=True):
            timings = latin_fmu.solve(scene).outcome.timings
            times.append((timings.setup, timings.march))
    (set_up_alone, march_alone), (set_up_both, march_both) = ([median(t) for t in zip(*f, strict=True)] for f in found)
    print(
        f"P2 n={elements} below a lid: set-up {set_up_both / set_up_alone:5.2f}, march {march_both / march_alone:5.2f} "
        f"of those without ({set_up_alone:.2f} and {march_alone:.2f} s)",
        flush=True,
    )
    yield set_up_both / set_up_alone
    yield march_both / march_alone


# -- first run --------------------------------------------------------------------------------------------------------
def compare_first(rounds: int) -> Iterator[float]:
    """Print what a process that solves P1 takes; seconds."""
    code, spent = FIRST.format(tables={**bars((1, 1, 50), None).description, "solver": OWN}), []
    for _ in range(rounds):
        done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
        spent.append([float(word) for word in done.stdout.split()])
    seconds, memory = (median(part) for part in zip(*spent, strict=True))
    print(f"P1 in a new process: {seconds:.2f} s of CPU time, {memory / 1e6:.0f} MB at most")
    yield seconds


def options(argv: Sequence[str] | None) -> Namespace:
    """The command line."""
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--former", type=Path, help="folder of a former tree, for the march")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="repetitions")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=PARTS, help="parts to measure")
    return parser.parse_args(argv)


def main(argv: Sequence[str] | None = None) -> dict[str, list[float]]:
    """Measure and print; a number of each line, by part."""
    said = options(argv)
    parts: dict[str, Callable[[], Iterator[float]]] = {
        "march": lambda: compare_marches(said.former, said.rounds),
        "blocks": lambda: compare_blocks(said.rounds),
        "set-up": lambda: compare_set_up(said.rounds),
        "reduced": lambda: compare_reduced(said.rounds),
        "lid": lambda: compare_lid(said.rounds),
        "first": lambda: compare_first(min(said.rounds, 5)),
    }
    return {name: list(part()) for name, part in parts.items() if name in said.only}


if __name__ == "__main__":
    main()
