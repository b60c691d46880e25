"""Stacks of plates pressed and then sheared, without inertia: this package and CalculiX at comparable error.

Error: distance of the displacements of all nodes at the last instant to a run of this package with tolerances
hundreds of times tighter, relative. What is left of this package's is the tolerance, of CalculiX's the penetration that
its penalty allows: both are chosen for errors of the same size (ten times stiffer is ten times closer, for free here).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from benchmark_problems import Case, plates
from benchmark_timing import contact_run, in_turn, prepared, rounds_for
from calculix_deck import Choices, Deck
from calculix_run import run
from example_tools import Array

TIGHT = {"tolerance": 1e-6, "force_tolerance": 1e-5}
PENALTY = Choices(stiffness=1000.0)
SAME = {"tolerance": 3e-4}  # errors no larger than those of CalculiX
VARIANTS: dict[str, dict[str, Any]] = {"own factors": {"share_identical": False, **SAME}, "shared factors": SAME}


def compare(counts: Sequence[int], limit: float) -> list[tuple[int, dict[str, tuple[float, float]]]]:
    """Print, and return for each stack CPU seconds and error by name."""
    found = []
    for count in counts:
        case = plates(count)
        exact = moved(case, TIGHT)
        works: dict[str, Callable[[], object]] = {
            n: partial(contact_run, prepared(case, s)) for n, s in VARIANTS.items()
        }
        for work in works.values():
            work()
        seconds = in_turn(works, rounds_for(0.2 * count))
        rows = {n: (s, error(moved(case, VARIANTS[n]), exact)) for n, s in seconds.items()}
        spent, there = of_calculix(case, PENALTY, limit)
        rows["CalculiX"] = spent, float("nan") if there is None else error(there, exact)
        print(f"{count} plates:", flush=True)
        for name, (own, distance) in rows.items():
            print(f"    {name:16} {own:8.3f} s   CalculiX takes {spent / own:6.1f} x   error {distance:.1e}")
        found.append((count, rows))
    return found


def of_calculix(case: Case, choices: Choices, limit: float) -> tuple[float, Array | None]:
    """CPU seconds of CalculiX, and ``moved`` by it; None where it did not reach the end."""
    ready = prepared(case, {})
    deck = Deck(ready, replace(choices, displacements=True, last=True))
    there = run(deck.text(), float(ready.time[-1]), limit)
    fields = there.printed.displacement
    if fields is None or not there.complete:
        return there.seconds, None
    return there.seconds, fields[-1][np.concatenate([deck.node[n] for n in ready.bodies]) - 1]


def moved(case: Case, solver: dict[str, Any]) -> Array:
    """Displacements of all nodes at the last instant, (n_node, 3), m."""
    steps = case.description["time"]["instants"]
    scene = case.description | {"output": {"fields": True, "every": steps}}
    outcome = contact_run(prepared(replace(case, description=scene), solver))
    if not outcome.converged:
        raise ValueError(outcome.status)
    histories = [outcome.substructures[n].displacement for n in scene["substructure"]]
    return np.concatenate([h[-1] for h in histories if h is not None])


def error(here: Array, there: Array) -> float:
    """Relative distance."""
    return float(np.linalg.norm(here - there) / np.linalg.norm(there))
