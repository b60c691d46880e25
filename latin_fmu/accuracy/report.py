"""A study as text: what an accuracy costs, where the error comes from, what failed."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

from .analysis import Price, Sources, price, sources, useful_tolerances
from .bench import Row
from .study import Study

TARGETS = (0.05, 0.01, 0.002)
"""Accuracies whose price is told."""

_SPLIT: tuple[str, ...] = (
    "quantity",
    "error as written",
    "mesh",
    "time step",
    "iteration",
    "reduction",
    "order",
    "mesh alone",
    "step alone",
)


def as_text(study: Study) -> str:
    """The answer for the terminal: price of each accuracy, sources, orders, tolerances, failures."""
    own = study.reference.own_error
    lines = [
        f"{study.scene.name}: what accuracy costs ({study.seconds:.0f} CPU s for the study)",
        f"reference: {study.reference.text}",
    ]
    if own is not None:
        lines.append("  its own error: " + ", ".join(f"{q.quantity} {percent(q.error)}" for q in own.quantities))
    prices: list[tuple[str, ...]] = [("quantity", *(f"for {percent(t)}" for t in TARGETS))]
    prices += [(q, *(_price(price(study, q, t)) for t in TARGETS)) for q in study.quantities]
    split = [_SPLIT, *(_source(sources(study, q)) for q in study.quantities)]
    lines += ["", "cheapest setting that reaches an accuracy, and keeps it when refined (CPU s):", *aligned(prices)]
    lines += ["", "sources of error at the resolution of the scene, observed orders:", *aligned(split)]
    lines += ["", "tolerance on sqrt(eta) below which a smaller one buys nothing, by mesh:", *aligned(_useful(study))]
    failed = failures(study)
    lines += ["", f"{len(failed)} run(s) failed or were refused" + (":" if failed else "")]
    return "\n".join([*lines, *(f"  {text}" for text in failed)])


def as_markdown(study: Study, picture: str) -> str:
    """The text as a page with the figure and the table of all runs."""
    head = [f"# What accuracy costs: {study.scene.name}", "", f"![Work-precision diagrams]({picture})", ""]
    runs = ["series", "scheme", "mesh", "steps", "tolerance", "CPU s", "iterations", *study.quantities]
    table = ["| " + " | ".join(runs) + " |", "|" + "---|" * len(runs)]
    table += ["| " + " | ".join(_cells(study, row)) + " |" for row in study.rows]
    return "\n".join([*head, "```", as_text(study), "```", "", "## Every run", "", *table]) + "\n"


def as_data(study: Study) -> dict[str, Any]:
    """Plain data for strict JSON."""
    own = study.reference.own_error
    return {
        "scene": study.scene.name,
        "cpu_seconds": study.seconds,
        "reference": {
            "exact": study.reference.exact,
            "source": study.reference.text,
            "values": {q: _plain(v) for q, v in study.reference.measured.values.items()},
            "error_estimate": None if own is None else own.report(),
        },
        "runs": [
            {
                "series": row.series,
                "scheme": row.variant,
                "mesh": row.resolution.mesh,
                "steps": row.resolution.time,
                "tolerance": _plain(row.tolerance),
                "cpu_seconds": None if row.run is None else row.run.cpu,
                "iterations": None if row.run is None else row.run.iterations[0],
                "failure": row.failure or None,
                "errors": {q: _plain(study.error(row, q)) for q in study.quantities},
            }
            for row in study.rows
        ],
        "sources": {q: {k: _plain(v) for k, v in vars(sources(study, q)).items()} for q in study.quantities},
        "prices": {q: [_price_data(price(study, q, t)) for t in TARGETS] for q in study.quantities},
        "useful_tolerances": {
            q: [{"mesh": m, "tolerance": _plain(t)} for m, t in useful_tolerances(study, q).items()]
            for q in study.quantities
        },
        "windows": [
            {"window": length, "search_direction": direction, "iterations": iterations, "passes": passes}
            for (length, direction), (iterations, passes) in study.windows.items()
        ],
    }


def as_json(study: Study) -> str:
    """``as_data`` with one key a line."""
    lines = (f"  {json.dumps(k)}: {json.dumps(v, allow_nan=False)}" for k, v in as_data(study).items())
    return "{\n" + ",\n".join(lines) + "\n}"


def _useful(study: Study) -> list[tuple[str, ...]]:
    """Where the tolerance stops to matter: one row a quantity, one column a mesh."""
    found = {q: useful_tolerances(study, q) for q in study.quantities}
    meshes = sorted({m for table in found.values() for m in table})
    rows: list[tuple[str, ...]] = [("quantity", *(f"x {m:.2g}" for m in meshes))]
    for q, table in found.items():
        told = (table.get(m, math.nan) for m in meshes)
        rows.append((q, *("none tried" if math.isnan(t) else f"{t:g}" for t in told)))
    return rows


def failures(study: Study) -> list[str]:
    """Runs without an answer, with their reason; those whose refinement succeeds with shorter steps included."""
    told = [
        f"{r.variant}, mesh x {r.resolution.mesh:.3g}, steps x {r.resolution.time:.3g}, "
        f"tolerance {r.tolerance:g}: {r.failure}"
        for r in study.rows
        if r.failure
    ]
    return list(dict.fromkeys(told))


def percent(error: float) -> str:
    """A relative error in per cent."""
    return "-" if math.isnan(error) else f"{100 * error:.2g} %"


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Columns two spaces apart, the first to the left."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return [
        "  " + "  ".join(c.ljust(w) if i == 0 else c.rjust(w) for i, (c, w) in enumerate(zip(row, widths, strict=True)))
        for row in rows
    ]


def _price(found: Price) -> str:
    row = found.row
    if row is None or row.run is None:
        return "not reached"
    mesh, steps = row.resolution.mesh, row.resolution.time
    return f"{row.run.cpu:.2g} ({row.variant}, x {mesh:.2g}, steps x {steps:.2g})"


def _price_data(found: Price) -> dict[str, Any]:
    row = found.row
    reached = (
        {}
        if row is None or row.run is None
        else {
            "cpu_seconds": row.run.cpu,
            "scheme": row.variant,
            "mesh": row.resolution.mesh,
            "steps": row.resolution.time,
            "error": _plain(found.error),
        }
    )
    return {"target": found.target, "reached": row is not None, **reached}


def _source(s: Sources) -> tuple[str, ...]:
    shares = (percent(e) for e in (s.total, s.space, s.time, s.iteration, s.reduction))
    orders = ("-" if math.isnan(p) else f"{p:.1f}" for p in (s.order_together, s.order_space, s.order_time))
    return (s.quantity, *shares, *orders)


def _cells(study: Study, row: Row) -> list[str]:
    cost = ["-", "-"] if row.run is None else [f"{row.run.cpu:.3g}", f"{row.run.iterations[0]:.1f}"]
    at = row.resolution
    told = [percent(study.error(row, q)) for q in study.quantities]
    if row.failure:
        told = ["failed"] * len(told)
    return [row.series, row.variant, f"{at.mesh:.3g}", f"{at.time:.3g}", f"{row.tolerance:g}", *cost, *told]


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value
