"""How the cost of an instant grows: with the points of a face, the unknowns of a block, blocks, processes and threads.

    python examples/benchmarks/growth.py [--quick] [-o FOLDER]

    points     two plates of m x m x 2 elements with friction (``large_faces``)
    unknowns   one block on the ground with friction
    blocks     a stack of blocks of 4^3 elements, each a class of its own
    processes  as many such blocks on each of one and two processes (``processes``)
    threads    blocks within and beyond the cache on one thread and on two

Of unknowns and blocks the set-up is measured, too: meshes, matrices and interfaces, factors, tables; the exponents of
both from 25,000 unknowns on are printed. The largest block has 255,552 unknowns and takes 10 GB. All but the last
are seconds of the processor, those of processes without the exchanges. Threads are compared by the
wall clock, in turn, and the least of the rounds is taken; beside the gain stands the memory that an instant reads, over
its time: factors twice, in each iteration but the first the matrices or the part of the factors at the interfaces. A
wall clock means little on a machine with other work: its load is printed. Figure: cost against points, unknowns, blocks
and processes.
"""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import numpy as np
from harness import tools
from large_faces import in_a_process
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from processes import INSTANTS, stack, started

import latin_fmu
from latin_fmu.latin.windows import Run

Line = list[tuple[float, float]]  # size, s per instant, or of the set-up
SET_UP = "set-up, "
PLATES, BLOCKS, TURNS = (12, 16, 24, 40), (6, 10, 14, 20, 29, 36, 43), 3
REAL_SIZE = 25_000.0  # unknowns from which on the growth of a real assembly is stated
STACKS = (2, 4, 8, 16, 32, 64, 128, 256, 512)
MANY = 64  # blocks from which on the cost of each is compared: their operators do not fit in the cache
THREADED = ((16, 4), (8, 6), (4, 10), (1, 14), (2, 14))  # blocks, elements along their edges
QUICK = ((6, 8), (3, 4), 1)
QUICK_STACKS = (2, 4)
QUICK_THREADED = ((2, 4),)


def least(tables: dict[str, Any], rounds: int) -> tuple[float, float]:
    """Seconds of the processor of an instant and of the set-up, the least of the rounds."""
    scene = latin_fmu.scene_from_dict(tables)
    runs = [latin_fmu.solve(scene).timings for _ in range(rounds)]
    return min(run.march for run in runs) / INSTANTS, min(run.setup for run in runs)


def measured(what: str, scenes: dict[float, dict[str, Any]], rounds: int) -> dict[str, Line]:
    """Lines of an instant and of the set-up over the sizes of scenes."""
    costs = {size: least(tables, rounds) for size, tables in scenes.items()}
    return {name: [(size, cost[i]) for size, cost in costs.items()] for i, name in enumerate((what, SET_UP + what))}


def exponent(line: Line, least: float) -> float:
    """Exponent of the growth of a line from a size on, by least squares of logarithms; NaN for fewer than two sizes."""
    points = np.log([(size, cost) for size, cost in line if size >= least] or np.ones((1, 2)))
    return float(np.polyfit(*points.T, 1)[0]) if len(points) > 1 else float("nan")


def by_blocks(count: int, rounds: int) -> Line:
    """A stack on one process and, with as many more blocks, on two."""
    runs = {p: [started(p, p * count, 4) for _ in range(rounds)] for p in (1, 2)}
    return [(float(p), min(r["compute"] for r in own)) for p, own in runs.items()]


def read_by(run: Run, iterations: float) -> float:
    """Bytes that an instant of a run reads: of factors and interface matrices, about."""
    total = 0.0
    for row in run.image.classes:
        tiles = 1 if row["m"] > 2 else int(row["m"])
        interface = row["n_live"] ** 2 / 2 * iterations + row["n_inner"] ** 2
        if row["swept"]:
            interface = 1.4 * row["n_panels"] * (iterations + 1)
        total += tiles * (2 * row["n_panels"] + interface)
    return 8.0 * total


def threads(blocks: int, elements: int, rounds: int) -> tuple[float, float, float]:
    """Seconds of the wall clock of an instant on one thread and on two, bytes that it reads."""
    walls: dict[int, list[float]] = {1: [], 2: []}
    runs: list[Run] = []
    march = Run.all

    def timed(run: Run, *given: Any) -> None:
        before = time.perf_counter()
        march(run, *given)
        walls[run.settings.threads].append(time.perf_counter() - before)
        runs.append(run)

    Run.all = timed  # type: ignore[method-assign]
    try:
        for _ in range(rounds):
            for count in walls:
                tables = stack(blocks, elements)
                tables["solver"]["threads"] = count
                solution = latin_fmu.solve(latin_fmu.scene_from_dict(tables))
    finally:
        Run.all = march  # type: ignore[method-assign]
    iterations = float(np.mean([w.iterations for w in solution.windows]))
    return min(walls[1]) / INSTANTS, min(walls[2]) / INSTANTS, read_by(runs[-1], iterations)


def print_line(what: str, line: Line) -> None:
    """A line of the table with the growth between its ends."""
    (first, cost), (last, highest) = line[0], line[-1]
    growth = np.log(highest / cost) / np.log(last / first)
    print(f"{what:>27}  " + "  ".join(f"{n:.0f}: {1e3 * s:.3g} ms" for n, s in line) + f"   growth {growth:.2f}")


def print_each(line: Line) -> None:
    """Cost of one block in stacks of many."""
    each = [1e3 * s / count for count, s in line]
    print(
        f"cost of each of {line[0][0]:.0f} to {line[-1][0]:.0f} blocks: "
        + ", ".join(f"{s:.3g}" for s in each)
        + f" ms, the last {each[-1] / each[0]:.2f} times the first"
    )


def apart(sizes: NDArray[np.float64]) -> list[float]:
    """Those of rising sizes whose labels do not overlap on a logarithmic axis, the last one among them."""
    kept, least = [float(sizes[-1])], (sizes[-1] / sizes[0]) ** (1 / 4.5)
    for size in sizes[-2::-1].tolist():
        kept += [size] if size * least <= kept[-1] else []
    return kept


def drawn(lines: dict[str, Line]) -> Figure:
    """Figure of the cost against points, unknowns, blocks and processes."""
    figure = Figure(figsize=(7.2, 4.8), layout="constrained")
    axes: list[Axes] = list(figure.subplots(2, 2).ravel())
    instants = {what: line for what, line in lines.items() if not what.startswith(SET_UP)}
    for axis, (what, line), colour in zip(
        axes, instants.items(), (tools.BLUE, tools.GREEN, tools.VERMILION, "black"), strict=True
    ):
        sizes, costs = np.array(line).T
        axis.loglog(sizes, 1e3 * costs, "o-", color=colour, label="an instant")
        if SET_UP + what in lines:
            axis.loglog(sizes, 1e3 * np.array(lines[SET_UP + what])[:, 1], "s--", color=colour, label="set-up")
            axis.legend(frameon=False)
            costs = np.concatenate([costs, np.array(lines[SET_UP + what])[:, 1]])
        flat = what == "processes"
        axis.loglog(sizes, 1e3 * costs[0] * (sizes / sizes[0]) ** (0.0 if flat else 1.0), ":", color="0.5")
        ticks = apart(sizes)
        axis.set_xticks(ticks, [f"{n:,.0f}" for n in ticks])
        axis.minorticks_off()
        axis.set_ylim(0.5 * 1e3 * costs.min(), 2.0 * 1e3 * costs.max())
        tools.label_few(axis)
        axis.set_xlabel("processes, eight blocks on each" if flat else what)
        axis.set_ylabel("CPU ms")
        tools.tidy(axis)
    return figure


def main(argv: list[str] | None = None) -> dict[str, Line]:
    """Print the tables and draw the figure; the lines of the figure."""
    chosen = tools.options(argv, __doc__)
    plates, blocks, rounds = QUICK if chosen.quick else (PLATES, BLOCKS, TURNS)
    stacks = QUICK_STACKS if chosen.quick else STACKS
    faces = [in_a_process(m, 2, "automatic") for m in plates]
    lines: dict[str, Line] = {"points of a face": [(float(cost.points), cost.march) for cost in faces]}
    lines |= measured("unknowns of a block", {3.0 * (n + 1) ** 3: stack(1, n) for n in blocks}, 1)
    lines |= measured("blocks", {float(count): stack(count, 4) for count in stacks}, rounds)
    lines["processes"] = by_blocks(stacks[-1] if chosen.quick else 8, rounds)
    for what, line in lines.items():
        print_line(what, line)
    for what, unknowns in {"unknowns of a block": 1, "blocks": 3 * 5**3}.items():
        march, made = (exponent(lines[head + what], REAL_SIZE / unknowns) for head in ("", SET_UP))
        print(f"{what:>27}  from {REAL_SIZE:,.0f} unknowns on: set-up {made:.2f}, an instant {march:.2f}")
    print_each([(count, s) for count, s in lines["blocks"] if count >= MANY] or lines["blocks"])
    print("blocks  elements      one      two threads, ms   gain   read, GB/s on one and two")
    for count, n in QUICK_THREADED if chosen.quick else THREADED:
        one, two, read = threads(count, n, rounds)
        speed = f"{read / one / 1e9:5.1f} {read / two / 1e9:5.1f}"
        print(f"{count:6d}  {n**3:8d} {1e3 * one:8.3f} {1e3 * two:8.3f}          {one / two:9.2f}   {speed}")
    print(f"load of the machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    tools.save(drawn(lines), Path(chosen.folder), "growth")
    return lines


if __name__ == "__main__":
    main()
