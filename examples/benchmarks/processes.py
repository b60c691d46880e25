"""Cost of a run distributed over processes: stacks of blocks, twice as many on two processes.

    python examples/benchmarks/processes.py [--rounds 3]

Stacks of cubes under a pressure that slides and presses them, friction 0.3, one instant per window. One process solves
n blocks, then 2 n; two processes solve 2 n; in turns. Seconds are of the processor: on a machine with other work the
wall clock measures that work. The time in exchanges is printed apart: it contains the wait for the other process.

From them the model of an instant with P processes, B blocks on each, I interfaces in all, n channels on the two sides
that a process has to its neighbours, and i iterations:

    B own + calls + i I SUM + i (neighbour + gather) + 2 neighbour + gather'
    neighbour = latency + 8 bytes n / bandwidth,    gather = latency log2 P + 8 bytes SUMS I / bandwidth

``own`` : what a block costs one process. ``calls`` : what a process of two spends beyond that, measured: an interface
that it shares with another, and the calls of kernels from Python. SUM : time in which a process adds the SUMS numbers
of an interface to the sums over the assembly. SUM, LATENCY and BANDWIDTH, those of a network, are assumed; gather' is
that of the norms of the forces.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from latin_fmu import scene_from_dict
from latin_fmu.api import solve
from latin_fmu.stability.scenes import STEEL, Box, column, rubbing

INSTANTS = 60
LATENCY, BANDWIDTH = 3e-5, 1e10  # s, bytes s-1
SUMS, SUM = 13, 2e-8  # numbers of an interface in the sums of an iteration; s
LARGE = 1e5, 0.08, 6534  # unknowns of a block of 32^3 elements, s of its sweeps and products, channels of two faces
LOCAL = 3e-8  # s for a channel and iteration in the local stage, the indicator and the acceleration, about


def stack(blocks: int, elements: int) -> dict[str, Any]:
    """Scene of a stack of cubes of 10 mm."""
    names = [f"b{i}" for i in range(blocks)]
    tables = column(
        dict.fromkeys(names, Box(STEEL, (0.01,) * 3, (elements,) * 3)),
        {f"i{i}": {"friction_coefficient": 0.3} for i in range(blocks - 1)},
        {"end": INSTANTS * 1.5e-7 * 10 / elements, "instants": INSTANTS},
        name="stack",
        load={f"press_{n}": {"face": f"{n}.xmin", "traction": [5e6, 0.0, -2e7], "law": "step"} for n in names},
        solver={"share_identical": False},
    )
    tables["interface"]["floor"] = rubbing("b0.zmin", "ground", 0.3)
    return tables


def measure(blocks: int, elements: int) -> dict[str, float]:
    """One run in this process, or in all that ``mpiexec`` has started; seconds of the processor per instant."""
    from latin_fmu.latin import processes as module

    processes, waited = None, [0.0]

    def timed(exchange: Any) -> Any:
        def called(self: Any, *given: Any) -> None:
            before = time.process_time()
            exchange(self, *given)
            waited[0] += time.process_time() - before

        return called

    if int(os.environ.get("PMI_SIZE", "1")) > 1:
        from mpi4py import MPI

        kind = module.Processes
        kind._gather, kind._exchange = timed(kind._gather), timed(kind._exchange)  # type: ignore[method-assign]
        processes = kind(MPI.COMM_WORLD)
    solution = solve(scene_from_dict(stack(blocks, elements)), processes=processes)
    assert solution.converged, solution.status
    iterations = sum(window.iterations for window in solution.windows) / INSTANTS
    cpu, wait = solution.timings.march / INSTANTS, waited[0] / INSTANTS
    own = {"compute": cpu - wait, "exchange": wait, "iterations": iterations}
    if processes is None:
        return own
    every = processes.collect(own)
    return own | {"compute": max(o["compute"] for o in every), "exchange": max(o["exchange"] for o in every)}


def started(count: int, blocks: int, elements: int) -> dict[str, float]:
    """``measure`` in processes of their own."""
    here = [sys.executable, str(Path(__file__)), "--measure", str(blocks), str(elements)]
    start = [] if count == 1 else [str(Path(sys.executable).parent / "mpiexec"), "-n", str(count)]
    text = subprocess.run([*start, *here], capture_output=True, text=True, check=True).stdout
    result: dict[str, float] = json.loads(text.splitlines()[0])
    return result


def exchanged(p: int, blocks: int, channels: float, iterations: float) -> float:
    """Seconds of the exchanges of an instant among p processes, each with so many blocks, and channels of its own on
    interfaces with neighbours."""
    interfaces, doublings = p * blocks, math.ceil(math.log2(p))
    neighbour = LATENCY + 8.0 * channels / BANDWIDTH
    gather, norms = (LATENCY * doublings + 8.0 * n * interfaces / BANDWIDTH for n in (SUMS, 4))
    return iterations * (neighbour + gather) + 2.0 * neighbour + norms


def modelled(p: int, blocks: int, own: float, calls: float, channels: float, iterations: float) -> float:
    """Weak scaling on p processes by the model of this file."""
    sums = iterations * p * blocks * SUM
    return blocks * own / (blocks * own + calls + sums + exchanged(p, blocks, channels, iterations))


def main() -> None:
    """Measure in turns and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])  # type: ignore[union-attr]
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--blocks", type=int, default=4, help="on each process")
    parser.add_argument("--measure", nargs=2, type=int, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.measure:
        result = measure(*arguments.measure)
        if os.environ.get("PMI_RANK", "0") == "0":
            print(json.dumps(result))
        return
    n = arguments.blocks
    print("elements  blocks  processes  compute ms  exchange ms  iterations   per instant, least of the rounds")
    for elements in (4, 6, 10):
        cases = {(1, n): [], (1, 2 * n): [], (2, 2 * n): []}  # type: dict[tuple[int, int], list[dict[str, float]]]
        for _ in range(arguments.rounds):
            for (count, blocks), runs in cases.items():
                runs.append(started(count, blocks, elements))
        least = {case: min(runs, key=lambda run: run["compute"]) for case, runs in cases.items()}
        for (count, blocks), run in least.items():
            numbers = f"{1e3 * run['compute']:10.3f}  {1e3 * run['exchange']:11.3f}  {run['iterations']:10.2f}"
            print(f"{elements**3:8d}  {blocks:6d}  {count:9d}  {numbers}")
        one, two, both = (least[case]["compute"] for case in cases)
        measured = f"weak {one / both:.2f}, half of the larger stack {0.5 * two / both:.2f}, without exchanges"
        alone, pair = least[1, n], least[2, 2 * n]
        own, calls = alone["compute"] / n, max(pair["compute"] - alone["compute"], 0.0)
        channels, iterations = 6.0 * (elements + 1) ** 2, pair["iterations"]
        shares = ", ".join(f"{modelled(p, n, own, calls, channels, iterations):.2f} on {p}" for p in (2, 4, 8, 16, 64))
        print(f"          {measured}; own {1e3 * own:.3f} ms a block, calls {1e3 * calls:.3f} ms; model: {shares}")
    unknowns, sweeps, channels = LARGE
    own = sweeps + iterations * channels * LOCAL
    print(f"one block of {unknowns:.0e} unknowns on each process: {1e3 * own:.0f} ms")
    for p in (2, 10, 100, 1000, 10000):
        share = modelled(p, 1, own, calls, channels, iterations)
        sums, exchange = iterations * p * SUM, exchanged(p, 1, channels, iterations)
        parts = f"{1e3 * sums:.2f} ms sums, {1e3 * exchange:.2f} ms exchanges"
        print(f"  {p:5d} processes, {p * unknowns:.0e} unknowns: weak scaling {share:.2f}; {parts}")
    print(f"load of the machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")


if __name__ == "__main__":
    main()
