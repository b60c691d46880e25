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
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import calculix_flange
import calculix_static
import numpy as np
from benchmark_floor import Floor
from benchmark_forces import ForceHistory, of_calculix, of_package, reference
from benchmark_problems import Case, bars, crushing, tower
from benchmark_timing import cpu, prepared
from calculix_deck import Choices, Deck
from calculix_figure import figure
from calculix_run import MISSING, Finished, installed, run
from example_tools import save

SETTINGS = {
    "same scheme": Choices(),
    "stiffer penalty": Choices(stiffness=50.0),
    "more damping": Choices(alpha=-0.3, stiffness=50.0),
}


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
    deck = Deck(ready, Choices(bonded=True, fixed=True, displacements=True))
    there = run(deck.text(), float(ready.time[-1]), limit)
    fields = there.printed.displacement
    if fields is None or not there.complete:
        return float("nan"), there
    floor, worst = Floor(ready), 0.0
    numbers = np.concatenate([deck.node[n] for n in ready.bodies]) - 1
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
        return calculix_flange.main(arguments.limit)
    begin = clock.perf_counter()
    cases = [bars((1, 1, 50), None), crushing(4, 0.3)] + ([] if arguments.quick else [tower(4, 4)])
    found = {f"{c.case}, {c.n_blocks} blocks": compare(c, arguments.limit) for c in cases}
    stacks = calculix_static.compare((4, 8, 16), arguments.limit) if arguments.static else ()
    arguments.output.mkdir(parents=True, exist_ok=True)
    save(figure(found, stacks), arguments.output, "against_calculix")
    print(f"in {clock.perf_counter() - begin:.0f} s")
    return 0


if __name__ == "__main__":
    main()
