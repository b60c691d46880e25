"""What the iteration and the propagators add to the error of the discretisation.

P1 against the exact solution, P2 against an own run with steps eight times shorter. The line "full march" is the
coupled discrete problem (both tolerances 1000 times tighter): what any exact solver of contact would give there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from benchmark_exact import bars_exact
from benchmark_problems import Case, bars, crushing
from benchmark_timing import contact_run, stable
from example_tools import Array

FINER = 8
TIGHT = {"tolerance": 1e-6, "force_tolerance": 1e-5}
LINES: dict[str, dict[str, Any]] = {
    "full march": {"propagator": "direct"} | TIGHT,
    "direct": {"propagator": "direct"},
    "explicit": {"propagator": "explicit"},
    "reduced": {"propagator": "reduced"},
}
Histories = dict[str, Array]


def histories(case: Case, solver: dict[str, Any], section: float = 1.0) -> tuple[Array, Histories]:
    """Instants, and what engineers look at: contact force (N, over ``section``), top displacement, corner slip (m)."""
    with_fields = case.description | {"output": {"fields": True}}
    found = contact_run(stable(replace(case, description=with_fields), solver))
    below, above = found.substructures["b1"], found.substructures[f"b{case.n_blocks}"]
    assert below.displacement is not None
    assert above.displacement is not None
    top = above.nodes[:, 2] >= above.nodes[:, 2].max() - 1e-9
    # the free corner of the interface, farthest from the planes of symmetry
    corner = [
        int(np.argmax(b.nodes[:, :2].sum(axis=1) + s * 1e3 * b.nodes[:, 2])) for b, s in ((below, 1), (above, -1))
    ]
    slip = above.displacement[:, corner[1], 0] - below.displacement[:, corner[0], 0]
    force = found.interfaces["i1"].normal_resultant() / section
    return found.time, {
        "contact force": force,
        "top displacement": above.displacement[:, top, 2].mean(axis=1),
        "corner slip": slip,
    }


def errors(time: Array, found: Histories, at: Array, exact: Histories) -> dict[str, float]:
    """Relative L2 distance of each history, and of the impulse at the end."""
    rows = {}
    for name, there in exact.items():
        here = np.interp(at, time, found[name])
        rows[name] = float(np.linalg.norm(here - there) / np.linalg.norm(there))
    impulse = np.trapezoid(exact["contact force"], at)
    rows["impulse"] = abs(float(np.trapezoid(found["contact force"], time) / impulse) - 1.0)
    return rows


def table() -> Iterator[str]:
    """Both problems, line by line."""
    yield "Errors (relative L2 of the histories; impulse at the end)"
    first = bars((1, 1, 50), None)
    at = np.linspace(0.0, first.description["time"]["end"], 250 * FINER + 1)
    yield from _lines(first, at, bars_exact(at), "the exact solution", 1e-4)
    second = crushing(4, 0.3)
    finer = second.description["time"] | {"instants": FINER * second.description["time"]["instants"]}
    fine = replace(second, description=second.description | {"time": finer})
    yield from _lines(second, *histories(fine, {"propagator": "direct", "tolerance": 1e-5}), "finer steps", 1.0)


def _lines(case: Case, at: Array, exact: Histories, reference: str, section: float) -> Iterator[str]:
    yield f"    {case.case}, mu = {case.mu:g}, against {reference}"
    for name, solver in LINES.items():
        time, found = histories(case, solver, section)
        rows = errors(time, found, at, exact)
        yield f"        {name:12}" + "".join(f"   {what} {value:.2e}" for what, value in rows.items())
