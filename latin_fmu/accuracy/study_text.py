"""Text of a study: prices of accuracy, sources of error, orders, tolerances, searches and failed runs."""

from __future__ import annotations

import math

from ..results.prices import TARGETS, Price, cpu_time
from ..scene.readable_numbers import aligned as columns
from ..scene.readable_numbers import percent
from .adaptive_resolution import is_target
from .study import TOLERANCE, ErrorSources, Row, Study, cheapest, sources, useful_tolerances

_SPLIT = ("quantity", "error as written", "mesh", "time step", "iteration", "reduction")
_ORDERS = ("order", "mesh alone", "step alone")


def as_text(study: Study) -> str:
    """Text for the terminal: cost of each accuracy, sources of error, orders, tolerances, failed runs."""
    estimate = study.reference.own_error
    lines = [
        f"{study.scene.name}: cost of accuracy ({study.seconds:.0f} CPU s for the study)",
        f"reference: {study.reference.text}",
    ]
    if estimate is not None:
        lines.append("  its own error: " + ", ".join(f"{q.quantity} {percent(q.error)}" for q in estimate.quantities))
    prices: list[tuple[str, ...]] = [("quantity", *(f"for {percent(t)}" for t in TARGETS))]
    prices += [(q, *(_price(cheapest(study, q, t)) for t in TARGETS)) for q in study.quantities]
    split = [(*_SPLIT, *_ORDERS), *(_source(sources(study, q)) for q in study.quantities)]
    lines += ["", "cheapest setting that reaches an accuracy, and keeps it when refined (CPU time):", *columns(prices)]
    lines += ["", "sources of error at the resolution of the scene, and observed orders:", *columns(split)]
    if len({row.factor for row in study.of(TOLERANCE)}) > 1:
        lines += ["", "tolerance on sqrt(eta) below which the iteration error is negligible, by mesh:"]
        lines += columns(_useful(study))
    lines += ["", "the run as written with its estimate, and searches for an accuracy:", *columns(_searches(study))]
    failed = failures(study)
    lines += ["", f"{len(failed)} run(s) failed or were refused" + (":" if failed else "")]
    return "\n".join([*lines, *(f"  {text}" for text in failed)])


def _searches(study: Study) -> list[tuple[str, ...]]:
    """One row a search: target, CPU time, estimated and true error of the target quantity, largest of its owners."""
    key = study.scene.accuracy.quantity
    rows: list[tuple[str, ...]] = [("target", "CPU s", "mesh", f"estimated, {key}", "true")]
    for search in study.searches:
        names = [q for q in search.told if is_target(study.scene, q)]
        told = max((search.told[q] for q in names), default=math.nan)
        true = max((study.error_of(search.quantities, search.resolution, q) for q in names), default=math.nan)
        target = "as written" if search.target is None else percent(search.target)
        rows.append((target, f"{search.cpu:.2g}", f"x {search.resolution.mesh:.2g}", percent(told), percent(true)))
    return rows


def as_markdown(study: Study, picture: str) -> str:
    """The text as a page with the figure and the table of all runs."""
    head = [f"# Cost of accuracy: {study.scene.name}", "", f"![Work-precision diagrams]({picture})", ""]
    runs = ["series", "scheme", "mesh", "steps", "tolerance", "CPU s", "iterations", *study.quantities]
    table = ["| " + " | ".join(runs) + " |", "|" + "---|" * len(runs)]
    table += ["| " + " | ".join(_cells(study, row)) + " |" for row in study.rows]
    return "\n".join([*head, "```", as_text(study), "```", "", "## Every run", "", *table]) + "\n"


def _useful(study: Study) -> list[tuple[str, ...]]:
    """Table of the useful tolerances: one row a quantity, one column a mesh."""
    tables = {q: useful_tolerances(study, q) for q in study.quantities}
    meshes = sorted({m for table in tables.values() for m in table})
    rows: list[tuple[str, ...]] = [("quantity", *(f"x {m:.2g}" for m in meshes))]
    for q, table in tables.items():
        values = (table.get(m, math.nan) for m in meshes)
        rows.append((q, *("none tried" if math.isnan(t) else f"{t:g}" for t in values)))
    return rows


def failures(study: Study) -> list[str]:
    """Failed or refused runs with the reason, those included that succeed with shorter steps."""
    lines = [
        f"{r.variant}, mesh x {r.resolution.mesh:.3g}, steps x {r.resolution.time:.3g}, "
        f"tolerance {r.tolerance:g}: {r.failure}"
        for r in study.rows
        if r.failure
    ]
    return list(dict.fromkeys(lines))


def _price(row: Row | None) -> str:
    if row is None:
        return "not reached"
    at = row.resolution
    setting = Price(math.nan, at.mesh, at.time).setting
    return f"{cpu_time(row.run.cpu)} ({row.variant}, {setting})"


def _source(s: ErrorSources) -> tuple[str, ...]:
    shares = (percent(e) for e in (s.total, s.space, s.time, s.iteration, s.reduction))
    orders = ("-" if math.isnan(p) else f"{p:.1f}" for p in (s.order_together, s.order_space, s.order_time))
    return (s.quantity, *shares, *orders)


def _cells(study: Study, row: Row) -> list[str]:
    if row.run.steps:
        cost = [f"{row.run.cpu:.3g}", f"{row.run.iterations[0]:.1f}"]
    else:
        cost = ["-", "-"]
    at = row.resolution
    errors = ["failed" if row.failure else percent(study.error(row, q)) for q in study.quantities]
    return [row.series, row.variant, f"{at.mesh:.3g}", f"{at.time:.3g}", f"{row.tolerance:g}", *cost, *errors]
