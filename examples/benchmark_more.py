"""Further tables of the benchmark: accuracy, runs that use set-up again, whole windows, memory."""

from __future__ import annotations

import gc
import time as clock
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from benchmark_accuracy import table
from benchmark_floor import Floor
from benchmark_memory import peak
from benchmark_problems import Case, crushing, tower
from benchmark_timing import contact_run, cpu, in_turn, prepared, second_run

import latin_fmu
from latin_fmu.assembly.build import build
from latin_fmu.latin.outcome import Timings
from latin_fmu.latin.recorder import Recorder
from latin_fmu.latin.windows import Run
from latin_fmu.scene.schema import Scene

MODELS = Path(__file__).resolve().parents[1] / "models"
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


class _Timed(Run):
    """A run that counts the CPU seconds of its calls of many instants."""

    spent = 0.0

    def _march_instants(self, first: int, n: int) -> int:
        start = clock.process_time()
        done = super()._march_instants(first, n)
        self.spent += clock.process_time() - start
        return done


def around_the_march(scenes: Mapping[str, Scene], rounds: int = 9) -> Iterator[str]:
    """CPU time of a run beside the calls of the kernels, from operators to the end of the march."""
    yield "Around the march of a run whose operators are there (CPU ms, the least of several)"
    for name, scene in scenes.items():
        found = []
        for _ in range(rounds):
            built = build(scene)
            gc.collect()
            begun = clock.process_time()
            march = _Timed(
                built.assembly, built.settings, Recorder(built.assembly, built.output, built.info), Timings()
            )
            ready = clock.process_time()
            march.all()
            found.append((ready - begun, clock.process_time() - ready - march.spent, march.spent))
        set_up, recording, spent = (1e3 * min(values) for values in zip(*found, strict=True))
        yield f"    {name:24} set-up {set_up:6.2f}   recording {recording:6.2f}   kernels {spent:7.2f}"


def batches(counts: Sequence[int], rounds: int = 3) -> Iterator[str]:
    """Reduced blocks of one class together, and each as a class of its own."""
    yield "Reduced blocks marched together (CPU ms of the march, and over that of one by one; P3, n = 4)"
    for count in counts:
        spent = []
        for own in (OWN | {"propagator": "reduced"}, {"propagator": "reduced"}):
            ready = prepared(tower(count, 4), own)
            spent.append(1e3 * min(contact_run(ready).timings.march for _ in range(rounds)))
        yield f"    {count:2} blocks {spent[1]:7.1f}   {spent[1] / spent[0]:5.2f}"


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
    scenes = {name: latin_fmu.load_scene(MODELS / name / "scene.toml") for name in ("impact_bar", "bouncing_bar")}
    scenes |= {c.case: latin_fmu.scene_from_dict(c.description) for c in (crushing(4, 0.3), tower(16, 4))}
    yield from around_the_march(scenes)
    yield from batches((2, 8) if quick else (2, 4, 8, 16))
    yield from whole_windows([crushing(4, 0.1), tower(2, 4), tower(16, 4)])
    yield from memory((4, 16), 4) if quick else memory((2, 4, 8, 16), 6)
