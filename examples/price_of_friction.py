"""What contact and friction cost above the linear transient of the same mesh.

Runs benchmark problems P1 (two slender bars), P2 (crushing with friction) and P3 (2 to 16 blocks) in turn with their
floor, the linear transient of the bonded mesh, and prints the ratio of the CPU times (median of several, one thread).

  timed     from meshes and matrices in memory and compiled kernels to the converged interface histories:
            factorisation, condensation, search direction, march; on the side of the floor factorisation and one solve
            per instant, by the fastest of three marches (the package's kernels, its factor in the shortest loop,
            SciPy's SuperLU). Assembly of the matrices is in neither. No file output.
  accuracy  sqrt(eta) <= 1e-3 and force mismatch <= 1e-2 (the defaults)
  error     relative L2 distance of the resultant force histories of all interfaces to a run of the same
            discretisation with both tolerances 1000 times tighter
  iterations  mean number of times that a substructure is marched over an instant
  propagator  direct: every block has a factor of its own, identical or not; explicit: central differences, lumped
            mass, with as many steps as the others, or the fewest that are stable; reduced: vibration modes and
            static responses, set-up not in the time (it is for repeated runs); with _batched identical blocks share
            operators and are marched together

Writes price_of_friction.png, or with --json one list of objects to standard output and no figure.
"""

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmark_figure import figure
from benchmark_floor import Floor
from benchmark_more import tables
from benchmark_problems import Case, all_cases, quick_cases
from benchmark_timing import contact_run, cpu, force_error, in_turn, prepared, rounds_for, second_run, stable
from example_tools import save

from latin_fmu.api import run
from latin_fmu.assembly.problem import DiscretisedProblem

OWN = {"propagator": "direct", "share_identical": False}
VARIANTS: dict[str, dict[str, Any]] = {
    "direct": OWN,
    "direct_batched": {"propagator": "direct"},
    "explicit": {"propagator": "explicit", "share_identical": False},
    "explicit_batched": {"propagator": "explicit"},
    "reduced": {"propagator": "reduced", "share_identical": False},
    "reduced_batched": {"propagator": "reduced"},
}
TIGHT = {"tolerance": 1e-6, "force_tolerance": 1e-5}


@dataclass(frozen=True)
class Row:
    """One line of the table, seconds of CPU time."""

    case: str
    n_blocks: int
    mu: float
    propagator: str
    ratio: float
    floor_seconds: float
    seconds: float
    iterations: float
    error: float


def measure(case: Case, rounds: int | None = None) -> tuple[list[Row], dict[str, float]]:
    """Every variant of one case, and the CPU seconds of the floors."""
    own = prepared(case, OWN)
    runs = {name: stable(case, solver) for name, solver in VARIANTS.items()}
    runs = {n: r for n, r in runs.items() if "batched" not in n or shares(r)}
    outcomes = {name: contact_run(ready) for name, ready in runs.items()}
    reference = contact_run(prepared(case, OWN | TIGHT))
    marches = Floor(own).marches
    works: dict[str, Callable[[], object]] = dict(marches)
    first = [cpu(work) for work in works.values()]  # compiles what is not yet compiled
    for name, ready in runs.items():
        works[name] = work(name, ready)
    seconds = in_turn(works, rounds_for(max(first)) if rounds is None else rounds)
    floors = {name: seconds[name] for name in marches}
    floor = min(floors.values())
    rows = [
        Row(
            case.case,
            case.n_blocks,
            case.mu,
            name,
            seconds[name] / floor,
            floor,
            seconds[name],
            outcome.passes,
            force_error(outcome, reference),
        )
        for name, outcome in outcomes.items()
    ]
    return rows, floors


def shares(ready: DiscretisedProblem) -> bool:
    """Whether there are identical blocks."""
    return any(len(c.members) > 1 or c.twin is not None for c in ready.classes)


def work(name: str, ready: DiscretisedProblem) -> Callable[[], object]:
    """What is timed: all from the matrices on, but for the reduced one, whose modes are set-up."""
    if not name.startswith("reduced"):
        return lambda: contact_run(ready)
    built = ready.build()
    run(built)
    return lambda: second_run(ready, built)


def lines(case: Case, rows: Sequence[Row], floors: dict[str, float]) -> Iterator[str]:
    """The table of one case."""
    fastest = min(floors, key=lambda name: floors[name])
    published = "" if case.published is None else f"; published {case.published:g} s with assembly"
    yield (
        f"{case.case}, {case.n_blocks} blocks, mu = {case.mu:g}: floor {floors[fastest]:.4f} s ({fastest}; "
        + ", ".join(f"{n} {s:.4f}" for n, s in floors.items() if n != fastest)
        + f"){published}"
    )
    for row in rows:
        yield (
            f"    {row.propagator:16} ratio {row.ratio:6.2f}   {row.seconds:8.4f} s   "
            f"{row.iterations:5.2f} passes   error {row.error:.1e}"
        )


def options(argv: Sequence[str] | None) -> Namespace:
    """The command line."""
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="five small cases, under a minute")
    parser.add_argument("--finest", action="store_true", help="P2 with 20^3 elements in a block too")
    parser.add_argument("--only", default="", metavar="TEXT", help='cases whose name holds TEXT, as "P3 n=4"')
    parser.add_argument("--rounds", type=int, help="repetitions; chosen by the time of the floor if left out")
    parser.add_argument("--more", action="store_true", help="accuracy, second runs, whole windows and memory too")
    parser.add_argument("--json", action="store_true", help="one list of objects, nothing else")
    parser.add_argument("-o", "--output", type=Path, default=Path("figures"), help="folder of the figure")
    return parser.parse_args(argv)


def main(argv: Sequence[str] | None = None) -> list[Row]:
    """Measure, print, draw; the rows."""
    arguments = options(argv)
    cases = quick_cases() if arguments.quick else all_cases(arguments.finest)
    rows: list[Row] = []
    for case in cases:
        if arguments.only not in case.case:
            continue
        found, floors = measure(case, arguments.rounds)
        rows += found
        if not arguments.json:
            print("\n".join(lines(case, found, floors)), flush=True)
    if arguments.json:
        print(json.dumps([asdict(row) for row in rows], indent=1))
        return rows
    if arguments.more:
        for line in tables(arguments.quick):
            print(line, flush=True)
    arguments.output.mkdir(parents=True, exist_ok=True)
    save(figure([asdict(row) for row in rows]), arguments.output, "price_of_friction")
    return rows


if __name__ == "__main__":
    main()
