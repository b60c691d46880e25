"""The same scenes by this package and by CalculiX: time and result side by side.

  P1  two slender bars, a gap, a step of pressure (reference: exact contact force by characteristics)
  P2  a steel block crushed on an aluminium one, mu = 0.3 (reference: own run with steps eight times shorter)
  P3  four blocks, mu = 0.3 (reference as for P2, one setting); not with --quick

CalculiX gets the same mesh, the same steps (it may cut them), the Hilber-Hughes-Taylor scheme and face-to-face penalty
contact in several settings. First the decks are checked: with the interfaces bonded both codes march the same
linear transient, and the displacements of all nodes at all instants must agree to the digits that CalculiX prints.

CPU seconds of one thread from the scene, or the deck, to the end, assembly included; own kernels are compiled before.
With --static also stacks of 4, 8 and 16 plates, pressed and then sheared, without inertia. With --flange only a bolted
flange of ten parts on one mesh, and by the package on meshes that do not match (gmsh makes them; some minutes).
Writes against_calculix.png. Without ccx it prints a message only.
"""

from __future__ import annotations

import copy
import time as clock
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import flange
import numpy as np
from calculix import MISSING, Finished, installed, run, shared_nodes
from floor import Floor
from harness import (
    TIGHT,
    Case,
    bars,
    bars_exact,
    contact_run,
    cpu,
    crushing,
    in_turn,
    plates,
    prepared,
    rounds_for,
    tools,
    tower,
)
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

import latin_fmu
from latin_fmu.decks.export_draft import DeckChoices
from latin_fmu.decks.exporting import export_deck
from latin_fmu.latin.outcome import Outcome

FINER = 8  # steps of the reference
SECTION = 1e-4  # of P1, m2
SETTINGS = {
    "same scheme": DeckChoices(penalty=10.0),
    "stiffer penalty": DeckChoices(penalty=50.0),
    "more damping": DeckChoices(penalty=50.0, alpha=-0.3),
}
PENALTY = DeckChoices(penalty=1000.0)
SAME = {"tolerance": 3e-4}  # errors no larger than those of CalculiX
PLATES: dict[str, dict[str, Any]] = {"own factors": {"share_identical": False, **SAME}, "shared factors": SAME}
Stacks = Sequence[tuple[int, Mapping[str, tuple[float, float]]]]


# -- forces of an interface -------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class ForceHistory:
    """Normal force of the first interface by one code.

    ``seconds`` of CPU, time (n,) s, force (n,) N, compression positive; ``complete``: the window was finished.
    """

    name: str
    seconds: float
    time: tools.Array
    force: tools.Array
    complete: bool = True
    work: str = ""

    @property
    def separation(self) -> float:
        """Last instant with more than 1 % of the largest force, s."""
        return float(self.time[np.flatnonzero(self.force > 0.01 * self.force.max())[-1]])

    def distance(self, reference: ForceHistory) -> float:
        """Relative L2 distance of the histories on the instants of the reference."""
        here = np.interp(reference.time, self.time, self.force)
        return float(np.linalg.norm(here - reference.force) / np.linalg.norm(reference.force))


def of_package(case: Case, name: str, **solver: float) -> ForceHistory:
    """This package, from the scene to the histories."""
    found: list[Outcome] = []
    scene = latin_fmu.scene_from_dict({**case.description, "solver": {"share_identical": False, **solver}})

    def work() -> None:
        found.append(latin_fmu.solve(scene))

    work()
    seconds = float(np.median([cpu(work) for _ in range(3)]))
    last = found[-1]
    return ForceHistory(
        name, seconds, last.time, last.interfaces["i1"].normal_resultant(), work=f"{last.passes:.1f} passes"
    )


def reference(case: Case) -> ForceHistory:
    """Exact for P1, with finer steps of the same mesh elsewhere."""
    if case.case.startswith("P1"):
        time = np.linspace(0.0, case.description["time"]["end"], 250 * FINER + 1)
        return ForceHistory("exact", 0.0, time, SECTION * bars_exact(time)["contact force"])
    steps = case.description["time"] | {"instants": FINER * case.description["time"]["instants"]}
    finer = replace(case, description=case.description | {"time": steps})
    found = contact_run(prepared(finer, {"tolerance": 1e-4}))
    return ForceHistory("finer steps", 0.0, found.time, found.interfaces["i1"].normal_resultant())


def of_calculix(case: Case, name: str, choices: DeckChoices, limit: float) -> ForceHistory:
    """CalculiX on the deck of the scene."""
    ready = prepared(case, {})
    deck = export_deck(ready, choices)
    found = run(deck.text, float(ready.time[-1]), limit)
    slave, master = (surface.upper() for surface in deck.pairs["i1"])
    # on the lower block, which gives the points
    force = -found.printed.force.get((slave, master), np.zeros((1, 3)))[:, 2]
    time = found.printed.time if len(found.printed.time) else np.zeros(1)
    work = f"{found.increments} increments, {found.iterations} iterations"
    return ForceHistory(f"CalculiX, {name}", found.seconds, time, force, found.complete, work)


def closed(case: Case) -> Case:
    """The blocks moved together where there is a gap: nodes to be made one must coincide."""
    scene = copy.deepcopy(case.description)
    for i, block in enumerate(scene["substructure"].values()):
        block["box"]["origin"][2] = i * block["box"]["size"][2]
    for interface in scene["interface"].values():
        interface["gap"] = 0.0
    return replace(case, description=scene)


def proof(case: Case, limit: float) -> tuple[float, Finished]:
    """Largest difference of the bonded marches over the largest displacement, and the run of CalculiX."""
    ready = prepared(closed(case), {})
    deck = export_deck(ready, DeckChoices(direct=True, every=True), shared_nodes(ready))
    there = run(deck.text, float(ready.time[-1]), limit)
    fields = there.printed.displacement
    if fields is None or not there.complete:
        return float("nan"), there
    floor, worst = Floor(ready), 0.0
    numbers = np.concatenate([deck.nodes[n] for n in ready.bodies]) - 1
    for here, field in zip(floor.displacements(), fields, strict=True):
        worst = max(worst, float(np.abs(field[numbers] - here).max()))
    return worst / float(np.abs(fields).max()), there


def lines(results: Sequence[ForceHistory], exact: ForceHistory, floor: float) -> Iterator[str]:
    """Table of one case."""
    yield (
        f"    {'':28} {'CPU s':>8} {'x floor':>8} {'x own':>7} {'impulse':>9} {'peak kN':>8} {'at us':>7} "
        f"{'apart us':>8} {'distance':>8}"
    )
    for a in (exact, *results):
        spent = (
            f"{'':25}"
            if a is exact
            else f"{a.seconds:8.3f} {a.seconds / floor:8.1f} {a.seconds / results[0].seconds:7.1f}"
        )
        peak = int(a.force.argmax())
        yield (
            f"    {a.name:28} {spent} {np.trapezoid(a.force, a.time):9.5f} {1e-3 * a.force[peak]:8.2f} "
            f"{1e6 * a.time[peak]:7.2f} {1e6 * a.separation:8.2f} {a.distance(exact):8.4f}  "
            + a.work
            + ("" if a.complete else f"  (stopped at {1e6 * a.time[-1]:.2f} us)")
        )


def compare(case: Case, limit: float) -> tuple[ForceHistory, list[ForceHistory]]:
    """Check the deck, run both codes, print; the reference and the results."""
    ready = prepared(case, {})
    floor = Floor(ready)
    floor.best()
    linear = cpu(floor.best)
    difference, bonded = proof(case, limit)
    print(
        f"{case.case}, {case.n_blocks} blocks, mu = {case.mu:g}: linear transient {linear:.4f} s, CalculiX "
        f"{bonded.seconds:.3f} s ({bonded.seconds / linear:.0f} x); displacements differ by {difference:.1e}",
        flush=True,
    )
    results = [of_package(case, "latin_fmu")]
    shown = SETTINGS if case.n_blocks == 2 else {"more damping": SETTINGS["more damping"]}
    for name, choices in shown.items():
        results.append(of_calculix(case, name, choices, limit))
    exact = reference(case)
    print("\n".join(lines(results, exact, linear)), flush=True)
    return exact, results


# -- plates without inertia -------------------------------------------------------------------------------------------
def compare_plates(counts: Sequence[int], limit: float) -> list[tuple[int, dict[str, tuple[float, float]]]]:
    """Print, and return for each stack CPU seconds and error by name."""
    found = []
    for count in counts:
        case = plates(count)
        exact = moved(case, TIGHT)
        works: dict[str, Callable[[], object]] = {n: partial(contact_run, prepared(case, s)) for n, s in PLATES.items()}
        for work in works.values():
            work()
        seconds = in_turn(works, rounds_for(0.2 * count))
        rows = {n: (s, error(moved(case, PLATES[n]), exact)) for n, s in seconds.items()}
        spent, there = plates_by_calculix(case, PENALTY, limit)
        rows["CalculiX"] = spent, float("nan") if there is None else error(there, exact)
        print(f"{count} plates:", flush=True)
        for name, (own, distance) in rows.items():
            print(f"    {name:16} {own:8.3f} s   CalculiX takes {spent / own:6.1f} x   error {distance:.1e}")
        found.append((count, rows))
    return found


def plates_by_calculix(case: Case, choices: DeckChoices, limit: float) -> tuple[float, tools.Array | None]:
    """CPU seconds of CalculiX, and ``moved`` by it; None where it did not reach the end."""
    ready = prepared(case, {})
    deck = export_deck(ready, replace(choices, every=True, last=True))
    there = run(deck.text, float(ready.time[-1]), limit)
    fields = there.printed.displacement
    if fields is None or not there.complete:
        return there.seconds, None
    return there.seconds, fields[-1][np.concatenate([deck.nodes[n] for n in ready.bodies]) - 1]


def moved(case: Case, solver: dict[str, Any]) -> tools.Array:
    """Displacements of all nodes at the last instant, (n_node, 3), m."""
    steps = case.description["time"]["instants"]
    scene = case.description | {"output": {"fields": True, "every": steps}}
    outcome = contact_run(prepared(replace(case, description=scene), solver))
    if not outcome.converged:
        raise ValueError(outcome.status)
    histories = [outcome.substructures[n].displacement for n in scene["substructure"]]
    return np.concatenate([h[-1] for h in histories if h is not None])


def error(here: tools.Array, there: tools.Array) -> float:
    """Relative distance."""
    return float(np.linalg.norm(here - there) / np.linalg.norm(there))


# -- figure -----------------------------------------------------------------------------------------------------------
def figure(found: Mapping[str, tuple[ForceHistory, Sequence[ForceHistory]]], stacks: Stacks = ()) -> Figure:
    """One column for each case: normal contact force against time, and bars of the CPU time; one for statics."""
    count = len(found) + bool(stacks)
    drawing = Figure(figsize=(4.6 * count, 6.4), layout="constrained")
    drawing.suptitle("The same scenes by this package and by CalculiX", fontweight="bold")
    grid = drawing.subplots(2, count, height_ratios=(1.6, 1.0), squeeze=False)
    if stacks:
        statics(grid[0, -1], grid[1, -1], stacks)
    names = dict.fromkeys(a.name for _, results in found.values() for a in results)
    colour_of = dict(zip(names, (tools.BLUE, tools.ORANGE, tools.VERMILION, tools.GREEN), strict=False))
    for column, (title, (exact, results)) in enumerate(found.items()):
        above, below = grid[:, column]
        for order, result in enumerate(results):
            curve = {
                "color": colour_of[result.name],
                "linewidth": 1.3,
                "zorder": 3 - 0.1 * order,
            }  # the first one on top
            above.plot(1e6 * result.time, 1e-3 * result.force, label=result.name, **curve)
        above.plot(1e6 * exact.time, 1e-3 * exact.force, **{**tools.EXACT, "label": "reference", "zorder": 4})
        above.set(title=f"{title} (reference: {exact.name})", xlabel="time (µs)", ylabel="normal contact force (kN)")
        places = range(len(results))
        below.barh(places, [a.seconds for a in results], color=[colour_of[a.name] for a in results], height=0.6)
        below.set_yticks(places, [a.name.replace(", ", ",\n") for a in results])
        below.invert_yaxis()
        below.set(xscale="log", xlabel="CPU time (s), one thread")
        for place, result in zip(places, results, strict=True):
            label = f" {result.seconds / results[0].seconds:.0f} x" if place else f" {result.seconds:.2g} s"
            below.annotate(label, (result.seconds, place), va="center")
        below.set_xlim(right=6.0 * max(a.seconds for a in results))
        tools.tidy(above)
        tools.tidy(below)
    drawing.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=5, frameon=False)
    return drawing


def statics(above: Axes, below: Axes, stacks: Stacks) -> None:
    """CPU time and error against the number of plates."""
    counts = [count for count, _ in stacks]
    for name, colour in zip(stacks[0][1], (tools.BLUE, tools.GREEN, tools.ORANGE), strict=True):
        seconds, errors = zip(*(rows[name] for _, rows in stacks), strict=True)
        above.plot(counts, seconds, "o-", color=colour, label=name)
        below.plot(counts, errors, "o-", color=colour)
    above.set(title="plates pressed and sheared, statics", ylabel="CPU time (s), one thread")
    below.set(xlabel="plates", ylabel="error of the displacements")
    for axis in (above, below):
        axis.set(xscale="log", yscale="log")
        axis.set_xticks(counts, [str(c) for c in counts])
        axis.xaxis.set_minor_locator(NullLocator())
        tools.tidy(axis)
    above.legend(fontsize="small", frameon=False)


def options(argv: Sequence[str] | None) -> Namespace:
    """The command line."""
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="P1 and P2 only")
    parser.add_argument("--static", action="store_true", help="stacks of plates")
    parser.add_argument("--flange", action="store_true", help="the bolted flange only, without a figure")
    parser.add_argument("--limit", type=float, default=300.0, help="seconds given to one run of CalculiX")
    parser.add_argument("-o", "--output", type=Path, default=Path("figures"), help="folder of the figure")
    return parser.parse_args(argv)


def main(argv: Sequence[str] | None = None) -> int:
    """Compare, print, draw."""
    arguments = options(argv)
    if not installed():
        print(MISSING)
        return 0
    if arguments.flange:
        return flange.main(arguments.limit)
    begin = clock.perf_counter()
    cases = [bars((1, 1, 50), None), crushing(4, 0.3)] + ([] if arguments.quick else [tower(4, 4)])
    found = {f"{c.case}, {c.n_blocks} blocks": compare(c, arguments.limit) for c in cases}
    stacks = compare_plates((4, 8, 16), arguments.limit) if arguments.static else ()
    arguments.output.mkdir(parents=True, exist_ok=True)
    tools.save(figure(found, stacks), arguments.output, "against_calculix")
    print(f"in {clock.perf_counter() - begin:.0f} s")
    return 0


if __name__ == "__main__":
    main()
