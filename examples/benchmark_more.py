"""Further tables of the benchmark: accuracy, runs that use set-up again, whole windows, memory."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from statistics import median
from typing import Any

import numpy as np
from benchmark_accuracy import table
from benchmark_floor import Floor
from benchmark_memory import peak
from benchmark_problems import Case, crushing, tower
from benchmark_timing import contact_run, cpu, in_turn, prepared, second_run

OWN: dict[str, Any] = {"propagator": "direct", "share_identical": False}
WHOLE = {
    "published: zero start, plain": {"window": "whole", "start": "zero", "acceleration": "none"},
    "zero start, Anderson": {"window": "whole", "start": "zero"},
    "sequential start, certified": {"window": "whole"},
    "windows of one instant": {},
}
MEMORY: dict[str, dict[str, Any] | None] = {
    "linear transient": None,
    "direct": OWN,
    "direct_batched": {"propagator": "direct"},
    "explicit": {"propagator": "explicit", "share_identical": False},
    "reduced": {"propagator": "reduced", "share_identical": False},
}


def cases(quick: bool) -> list[Case]:
    """Where the tables look."""
    return [crushing(4, 0.1), tower(16, 4)] if quick else [crushing(10, 0.3), tower(16, 4), tower(16, 6)]


def again(found: Sequence[Case]) -> Iterator[str]:
    """Second run with other loads: everything set up is used again."""
    yield "Second run of the same scene with other loads (CPU s; the linear transient keeps its factor too)"
    for case in found:
        ready = prepared(case, OWN)
        built = ready.build()
        loads = {name: 0.5 * load.law.sample(ready.time) for name, load in ready.scene.load.items()}
        second_run(ready, built, loads)
        floor = Floor(ready)
        march = floor.kept()
        floor.best()
        times = in_turn(
            {
                "first": lambda ready=ready: contact_run(ready),
                "second": lambda ready=ready, built=built, loads=loads: second_run(ready, built, loads),
                "linear": floor.best,
                "again": march,
            },
            5,
        )
        yield (
            f"    {case.case}, {case.n_blocks:2} blocks: first {times['first']:.4f}, second {times['second']:.4f} "
            f"({times['second'] / times['first']:.2f} of it, {times['second'] / times['linear']:.2f} of the linear "
            f"transient, {times['second'] / times['again']:.2f} of its second run)"
        )


def whole_windows(found: Sequence[Case]) -> Iterator[str]:
    """The published way, and what acceleration and a good start save."""
    yield "One window over the whole interval (sqrt(eta) <= 1e-3)"
    for case in found:
        floor = Floor(prepared(case, OWN))
        floor.best()
        unit = median(cpu(floor.best) for _ in range(5))
        for name, settings in WHOLE.items():
            # the force mismatch is no measure of the paper: its iteration stops on the indicator
            ready = prepared(case, OWN | settings | ({"force_tolerance": 1.0} if "window" in settings else {}))
            outcome = contact_run(ready)
            spent = cpu(lambda ready=ready: contact_run(ready))
            fallen = [f for w in outcome.windows for f in w.fallbacks if "window" in settings]
            yield (
                f"    {case.case}, {case.n_blocks:2} blocks: {name:30} {outcome.passes:6.1f} passes   "
                f"ratio {spent / unit:7.2f}"
                + ("" if outcome.converged else "   not converged")
                + (f"   fell back: {', '.join(sorted(set(fallen)))}" if fallen else "")
            )


def memory(counts: Sequence[int], n: int) -> Iterator[str]:
    """Peak memory against the number of blocks."""
    yield f"Peak memory beyond that of a tiny run, MB (P3, n = {n})"
    yield "    " + f"{'blocks':18}" + "".join(f"{c:8}" for c in counts) + "   per block added"
    for name, solver in MEMORY.items():
        sizes = [1e-6 * peak(tower(count, n), solver) for count in counts]
        slope = np.polyfit(counts, sizes, 1)[0]
        yield f"    {name:18}" + "".join(f"{s:8.1f}" for s in sizes) + f"   {slope:6.2f}"


def tables(quick: bool) -> Iterator[str]:
    """All of them, line by line."""
    found = cases(quick)
    yield from table()
    yield from again(found)
    yield from whole_windows([crushing(4, 0.1), tower(2, 4), tower(16, 4)])
    yield from memory((4, 16), 4) if quick else memory((2, 4, 8, 16), 6)
