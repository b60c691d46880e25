"""The same matrices by this package and by Siconos, the rival that keeps its operators too.

Problems P2 and P3 with friction 0.3, same mesh and steps. Siconos: Moreau-Jean with one factorisation, two solves an
instant, non-smooth Gauss-Seidel on the contact points; it is given this package's factor and the matrix of the
contact points, built body by body, so that only the method differs. Ratio to the linear transient of the bonded mesh,
CPU time of one thread, everything from the matrices on in the timed region, in turn, median of several.

  tolerance  of Siconos' solver; the package runs with its defaults
  distance   of the normal resultants of all interfaces to the package's (other scheme, impulses between instants:
             a few per cent are the discretisation)

Without Siconos it prints a message only.
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections.abc import Callable, Sequence

import numpy as np
from benchmark_floor import Floor
from benchmark_problems import Case, crushing, tower
from benchmark_timing import contact_run, in_turn, prepared
from siconos_contact import MISSING, library
from siconos_march import MoreauJean

OWN = {"propagator": "direct", "share_identical": False}
TOLERANCES = (1e-3, 1e-6)


def cases(quick: bool) -> list[Case]:
    """What is compared."""
    chosen = [crushing(4, 0.3), tower(2, 4), tower(16, 4)]
    if quick:
        return chosen
    return [*chosen[:1], crushing(10, 0.3), *(tower(blocks, n) for n in (4, 6) for blocks in (2, 4, 8, 16))]


def compare(case: Case, rounds: int) -> None:
    """Print one case."""
    found = library()
    assert found is not None
    ready = prepared(case, OWN)
    outcome = contact_run(ready)
    forces = np.stack([outcome.interfaces[u.name].normal_resultant() for u in ready.units], axis=1)
    rivals = {tolerance: MoreauJean(ready, found, tolerance) for tolerance in TOLERANCES}
    distances = {t: float(np.linalg.norm(r.run() - forces) / np.linalg.norm(forces)) for t, r in rivals.items()}
    floor = Floor(ready)
    works: dict[str, Callable[[], object]] = {"floor": floor.best, "own": lambda: contact_run(ready)}
    works |= {f"{tolerance:g}": rival.run for tolerance, rival in rivals.items()}
    floor.best()
    seconds = in_turn(works, rounds)
    unit = seconds["floor"]
    print(f"{case.case}, {case.n_blocks} blocks: floor {unit:.4f} s")
    print(f"    latin_fmu           ratio {seconds['own'] / unit:6.2f}   {outcome.passes:5.2f} passes")
    for tolerance, rival in rivals.items():
        print(
            f"    Siconos, {tolerance:7.0e}    ratio {seconds[f'{tolerance:g}'] / unit:6.2f}   "
            f"{rival.iterations / outcome.time.size:5.2f} sweeps   distance {distances[tolerance]:.4f}",
            flush=True,
        )


def options(argv: Sequence[str] | None) -> Namespace:
    """The command line."""
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="three small cases")
    parser.add_argument("--rounds", type=int, default=5, help="repetitions")
    return parser.parse_args(argv)


def main(argv: Sequence[str] | None = None) -> int:
    """Compare and print."""
    arguments = options(argv)
    if library() is None:
        print(MISSING)
        return 0
    for case in cases(arguments.quick):
        compare(case, arguments.rounds)
    return 0


if __name__ == "__main__":
    main()
