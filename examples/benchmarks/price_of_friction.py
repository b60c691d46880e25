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
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from floor import Floor
from harness import (
    OWN,
    TIGHT,
    Case,
    all_cases,
    contact_run,
    cpu,
    force_error,
    in_turn,
    prepared,
    quick_cases,
    rounds_for,
    second_run,
    stable,
    tools,
)
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, NullLocator

from latin_fmu.assembly.problem import DiscretisedProblem
from latin_fmu.march import march

VARIANTS: dict[str, dict[str, Any]] = {
    "direct": OWN,
    "direct_batched": {"propagator": "direct"},
    "explicit": {"propagator": "explicit", "share_identical": False},
    "explicit_batched": {"propagator": "explicit"},
    "reduced": {"propagator": "reduced", "share_identical": False},
    "reduced_batched": {"propagator": "reduced"},
}
COLOURS = {
    "direct": tools.BLUE,
    "direct_batched": tools.GREEN,
    "explicit": tools.ORANGE,
    "explicit_batched": tools.PURPLE,
    "reduced": tools.VERMILION,
    "reduced_batched": "#7F3C00",
}
LABELS = {
    "direct": "direct, every block its own factor",
    "direct_batched": "direct, identical blocks share one",
    "explicit": "explicit",
    "explicit_batched": "explicit, identical blocks together",
    "reduced": "reduced, set-up apart",
    "reduced_batched": "reduced, identical blocks together, set-up apart",
}
_APART = 1.25  # of two labels
LINES = ("-", "--", ":")
MARKERS = ("o", "s", "^")


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
    march(built)
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


def figure(rows: Sequence[Row]) -> Figure:
    """Ratio to the linear transient: P3 against the number of blocks, P2 against friction, P1 for each mesh."""
    drawing = Figure(figsize=(12.5, 5.6), layout="constrained")
    drawing.suptitle("CPU time of contact in units of the linear transient of the same mesh", fontweight="bold")
    towers, crushing, bars = drawing.subplots(1, 3, width_ratios=(1.3, 1.3, 0.9), sharey=True)
    curves(towers, [r for r in rows if r.case.startswith("P3")], "n_blocks")
    towers.set(xscale="log", xlabel="blocks", ylabel="ratio to the linear transient")
    towers.set_title("P3: contact surfaces", loc="left")
    ticks(towers, {r.n_blocks for r in rows if r.case.startswith("P3")})
    curves(crushing, [r for r in rows if r.case.startswith("P2")], "mu")
    crushing.set_xscale("symlog", linthresh=0.05)
    crushing.set_xlabel("friction coefficient")
    crushing.set_title("P2: friction", loc="left")
    ticks(crushing, {r.mu for r in rows if r.case.startswith("P2")})
    slender(bars, [r for r in rows if r.case.startswith("P1")])
    for axis in (towers, crushing, bars):
        axis.set_yscale("log")
        axis.axhline(1.0, color="0.4", linewidth=0.8, linestyle=(0, (5, 2)))
        axis.yaxis.set_major_locator(FixedLocator([0.05, 0.1, 0.2, 0.5, 1.0, 1.5, 2.0, 5.0, 10.0]))
        axis.yaxis.set_minor_locator(NullLocator())
        axis.yaxis.set_major_formatter("{x:g}")
        axis.grid(axis="y", color="0.92", linewidth=0.6)
        tools.tidy(axis)
    found = {r.propagator for r in rows}
    kinds = [Line2D([], [], color=c, marker="o", label=LABELS[k]) for k, c in COLOURS.items() if k in found]
    drawing.legend(handles=kinds, loc="outside lower center", ncols=3, frameon=False)
    return drawing


def ticks(axis: Axes, values: Collection[float]) -> None:
    """These ticks and no others."""
    places = sorted(values)
    axis.set_xticks(places, [f"{v:g}" for v in places])
    axis.minorticks_off()


def curves(axis: Axes, rows: Sequence[Row], over: str) -> None:
    """One curve for each mesh (by line and marker) and propagator (by colour)."""
    cases = sorted({r.case for r in rows}, key=lambda c: int(c.split("=")[1]))
    for kind, colour in COLOURS.items():
        for case, line, marker in zip(cases, LINES, MARKERS, strict=False):
            found = sorted((getattr(r, over), r.ratio) for r in rows if (r.case, r.propagator) == (case, kind))
            if found:
                axis.plot(*zip(*found, strict=True), line, marker=marker, color=colour)
    meshes = [
        Line2D([], [], color="0.3", linestyle=line, marker=marker, label=case.split()[1])
        for case, line, marker in zip(cases, LINES, MARKERS, strict=False)
    ]
    axis.legend(handles=meshes, fontsize="small", frameon=False, loc="upper right", bbox_to_anchor=(1.0, 1.12), ncols=3)


def slender(axis: Axes, rows: Sequence[Row]) -> None:
    """P1: one point for each mesh and propagator."""
    meshes = list(dict.fromkeys(r.case.split()[1] for r in rows))
    for place, mesh in enumerate(meshes):
        above = 0.0
        for row in sorted((r for r in rows if r.case.split()[1] == mesh), key=lambda r: r.ratio):
            ratio = row.ratio
            axis.plot([place], [ratio], "o", color=COLOURS[row.propagator], markersize=8)
            above = max(ratio, _APART * above)  # labels of points that lie together: one above the other
            axis.annotate(f"  {ratio:.2f}", (place, above), va="center")
    axis.set_xticks(range(len(meshes)), meshes)
    axis.set(xlabel="elements in a bar", xlim=(-0.5, max(len(meshes), 1) - 0.3))
    axis.set_title("P1: slender bars", loc="left")


def options(argv: Sequence[str] | None) -> Namespace:
    """The command line."""
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="five small cases, under a minute")
    parser.add_argument("--finest", action="store_true", help="P2 with 20^3 elements in a block too")
    parser.add_argument("--only", default="", metavar="TEXT", help='cases whose name holds TEXT, as "P3 n=4"')
    parser.add_argument("--rounds", type=int, help="repetitions; chosen by the time of the floor if left out")
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
    arguments.output.mkdir(parents=True, exist_ok=True)
    tools.save(figure(rows), arguments.output, "price_of_friction")
    return rows


if __name__ == "__main__":
    main()
