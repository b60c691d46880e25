"""What a study says, as text: orders, sources of error, the price of an accuracy, what failed."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ..results.quantities_of_interest import FLOOR
from .estimate import observed_order, relative, same_way
from .study import REDUCTION, SPACE, TIGHT, TIME, TOGETHER, TOLERANCE, Row, Study

NEGLIGIBLE = 0.1
"""An iteration error below this share of the whole one no longer matters."""


@dataclass(frozen=True)
class Sources:
    """Relative error of a quantity at the scene's own resolution by source, and observed orders (NaN: none).

    ``reduction``: what the modes left out of reduced substructures change; NaN where none is reduced.
    """

    quantity: str
    total: float
    space: float
    time: float
    iteration: float
    reduction: float
    order_together: float
    order_space: float
    order_time: float


def sources(study: Study, quantity: str) -> Sources:
    """Error by source: mesh and step from their own series, assuming first order beyond its finest run."""
    own = next((r for r in study.of(TOGETHER) if r.resolution.mesh == r.resolution.time == 1.0), None)
    return Sources(
        quantity,
        math.nan if own is None else study.error(own, quantity),
        _remaining(study.of(SPACE), quantity, mesh=True),
        _remaining(study.of(TIME), quantity, mesh=False),
        _iteration(study, own, quantity),
        _reduction(study, own, quantity),
        _order(_with_reference(study), quantity, mesh=False),
        _order(study.of(SPACE), quantity, mesh=True),
        _order(study.of(TIME), quantity, mesh=False),
    )


def _with_reference(study: Study) -> list[Row]:
    return [r for r in study.of(TOGETHER) if r.run is not None]


def _remaining(rows: list[Row], quantity: str, mesh: bool) -> float:
    """Error at factor 1 from the distance d to the finest of a series: d / (1 - 1 / ratio), order 1."""
    found = {_factor(r, mesh): r for r in rows}
    base = min(found, key=lambda f: abs(f - 1.0), default=math.nan)
    finest = max(found, default=math.nan)
    if not finest > base:
        return math.nan
    a, b = found[base].run, found[finest].run
    assert a is not None
    assert b is not None
    return relative(quantity, b.measured, a.measured, b.measured) / (1.0 - base / finest)


def _iteration(study: Study, own: Row | None, quantity: str) -> float:
    """Distance between the scene's tolerance and a tight one."""
    tight = next(
        (r for r in study.of(TOLERANCE) if r.tolerance == TIGHT and r.resolution.mesh == r.resolution.time == 1.0), None
    )
    if own is None or own.run is None or tight is None or tight.run is None:
        return math.nan
    return relative(quantity, tight.run.measured, own.run.measured, tight.run.measured)


def _reduction(study: Study, own: Row | None, quantity: str) -> float:
    """Distance between the run as written and the same without reduction."""
    whole = next((r.run for r in study.rows if r.series == REDUCTION and not r.failure), None)
    if own is None or own.run is None or whole is None:
        return math.nan
    return relative(quantity, whole.measured, own.run.measured, whole.measured)


def _order(rows: list[Row], quantity: str, mesh: bool) -> float:
    """Observed order of the finest runs whose factors are about 1 : 2 : 4 (NaN where they do not go one way)."""
    factors = sorted({_factor(r, mesh) for r in rows}, reverse=True)
    if len(factors) < 3:
        return math.nan
    half = min(factors, key=lambda f: abs(math.log(f / factors[0]) + math.log(2.0)))
    quarter = min(factors, key=lambda f: abs(math.log(f / factors[0]) + math.log(4.0)))
    if not factors[0] > half > quarter:
        return math.nan
    a, b, c = (next(r.run for r in rows if _factor(r, mesh) == f) for f in (factors[0], half, quarter))
    assert a is not None
    assert b is not None
    assert c is not None
    if quantity not in a.measured.values or not same_way(quantity, a.measured, b.measured, c.measured):
        return math.nan
    first = relative(quantity, a.measured, a.measured, b.measured)
    second = relative(quantity, a.measured, b.measured, c.measured)
    return observed_order(first, second, (factors[0] / half, factors[0] / quarter))


def _factor(row: Row, mesh: bool) -> float:
    return row.resolution.mesh if mesh else row.resolution.time


@dataclass(frozen=True)
class Price:
    """The cheapest setting that reaches a target, and that every finer run of its curve keeps to."""

    quantity: str
    target: float
    row: Row | None
    error: float


def price(study: Study, quantity: str, target: float, variant: str | None = None) -> Price:
    """What a target costs, over all variants refined in mesh and step together (or one of them).

    Against a reference that is not exact its own error is added: what it cannot tell is not claimed.
    """
    best: Row | None = None
    own = study.reference.own_error
    doubt = 0.0 if own is None else own[quantity].error
    tried = dict.fromkeys(r.variant for r in study.rows if r.series == TOGETHER)
    for name in tried if variant is None else (variant,):
        for row in reversed(study.of(TOGETHER, name)):
            error = study.error(row, quantity)
            if row.run is None or math.isnan(error):
                continue
            if error + doubt > target:
                break
            if best is None or best.run is None or row.run.cpu < best.run.cpu:
                best = row
    return Price(quantity, target, best, math.nan if best is None else study.error(best, quantity))


def useful_tolerances(study: Study, quantity: str) -> dict[float, float]:
    """Per mesh factor, the largest tolerance below which a smaller one buys nothing.

    The iteration error (against a tight tolerance on the same mesh) is then a tenth of the error of that mesh, or of
    the floor of 0.1 %.
    """
    found = {}
    for mesh in sorted({(r.resolution.mesh, r.resolution.time) for r in study.of(TOLERANCE)}):
        rows = [r for r in study.of(TOLERANCE) if (r.resolution.mesh, r.resolution.time) == mesh]
        tight = next((r for r in rows if r.tolerance == TIGHT), None)
        if tight is None or tight.run is None:
            continue
        allowed = NEGLIGIBLE * max(study.error(tight, quantity), FLOOR)
        largest = math.nan
        for row in sorted((r for r in rows if r is not tight), key=lambda r: r.tolerance):
            assert row.run is not None
            if not relative(quantity, tight.run.measured, row.run.measured, tight.run.measured) <= allowed:
                break
            largest = row.tolerance
        found[mesh[0] if mesh[0] != 1.0 else mesh[1]] = largest
    return found


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
