"""Results of a study as text: orders, sources of error, the cost of an accuracy, failed runs."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import Any

from ..results.quantities_of_interest import FLOOR
from ..results.summary import aligned, percent
from .estimate import observed_order, relative, same_way
from .study import REDUCTION, SPACE, TIGHT, TIME, TOGETHER, TOLERANCE, Row, Study

NEGLIGIBLE = 0.1
"""Share of the whole error below which the iteration error is negligible."""


@dataclass(frozen=True)
class Sources:
    """Relative error of a quantity at the scene's own resolution by source, and observed orders (NaN: none).

    ``reduction``: change by the modes that reduced substructures leave out; NaN where none is reduced.
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

    def at_scene(row: Row) -> bool:
        return row.resolution.mesh == row.resolution.time == 1.0 and row.run is not None

    own = next((r for r in study.of(TOGETHER) if at_scene(r)), None)
    tight = next((r for r in study.of(TOLERANCE) if r.tolerance == TIGHT and at_scene(r)), None)
    whole = next((r for r in study.rows if r.series == REDUCTION and not r.failure), None)
    return Sources(
        quantity,
        math.nan if own is None else study.error(own, quantity),
        _remaining(study.of(SPACE), quantity, mesh=True),
        _remaining(study.of(TIME), quantity, mesh=False),
        _distance(own, tight, quantity),
        _distance(own, whole, quantity),
        _order(study.of(TOGETHER), quantity, mesh=False),
        _order(study.of(SPACE), quantity, mesh=True),
        _order(study.of(TIME), quantity, mesh=False),
    )


def _distance(row: Row | None, other: Row | None, quantity: str) -> float:
    """Relative distance of a quantity between two rows, over the scale of the second; NaN where one is missing."""
    if row is None or other is None or row.run is None or other.run is None:
        return math.nan
    return relative(quantity, other.run.quantities, row.run.quantities, other.run.quantities)


def _remaining(rows: list[Row], quantity: str, mesh: bool) -> float:
    """Error at factor 1 from the distance d to the finest of a series: d / (1 - 1 / ratio), order 1."""
    by_factor = {_factor(r, mesh): r for r in rows}
    base = min(by_factor, key=lambda f: abs(f - 1.0), default=math.nan)
    finest = max(by_factor, default=math.nan)
    if not finest > base:
        return math.nan
    return _distance(by_factor[base], by_factor[finest], quantity) / (1.0 - base / finest)


def _order(rows: list[Row], quantity: str, mesh: bool) -> float:
    """Observed order of the finest runs whose factors are about 1 : 2 : 4 (NaN where the changes differ in sign)."""
    runs = {_factor(r, mesh): r.run.quantities for r in reversed(rows) if r.run is not None}
    if len(runs) < 3:
        return math.nan
    finest = max(runs)
    half, quarter = (min(runs, key=lambda f: abs(math.log(part * f / finest))) for part in (2.0, 4.0))
    if not finest > half > quarter:
        return math.nan
    a, b, c = runs[finest], runs[half], runs[quarter]
    if quantity not in a.values or not same_way(quantity, a, b, c):
        return math.nan
    changes = relative(quantity, a, a, b), relative(quantity, a, b, c)
    return observed_order(*changes, (finest / half, finest / quarter))


def _factor(row: Row, mesh: bool) -> float:
    return row.resolution.mesh if mesh else row.resolution.time


@dataclass(frozen=True)
class Price:
    """The cheapest setting that reaches a target, as all finer runs of its variant do."""

    quantity: str
    target: float
    row: Row | None
    error: float


def price(study: Study, quantity: str, target: float, variant: str | None = None) -> Price:
    """Cost of a target accuracy over all variants refined in mesh and step together (or one of them).

    The error of a reference that is not exact is added to the errors.
    """
    best: Row | None = None
    own = study.reference.own_error
    own_error = 0.0 if own is None else own[quantity].error
    tried = dict.fromkeys(r.variant for r in study.rows if r.series == TOGETHER)
    for name in tried if variant is None else (variant,):
        for row in reversed(study.of(TOGETHER, name)):
            error = study.error(row, quantity)
            if row.run is None or math.isnan(error):
                continue
            if error + own_error > target:
                break
            if best is None or best.run is None or row.run.cpu < best.run.cpu:
                best = row
    return Price(quantity, target, best, math.nan if best is None else study.error(best, quantity))


def useful_tolerances(study: Study, quantity: str) -> dict[float, float]:
    """Largest tolerance by mesh factor below which the iteration error is negligible.

    The iteration error (against a tight tolerance on the same mesh) is then at most a tenth of the error of that mesh,
    or of 0.1 %.
    """
    useful = {}
    for mesh in sorted({(r.resolution.mesh, r.resolution.time) for r in study.of(TOLERANCE)}):
        rows = [r for r in study.of(TOLERANCE) if (r.resolution.mesh, r.resolution.time) == mesh]
        tight = next((r for r in rows if r.tolerance == TIGHT), None)
        if tight is None:
            continue
        allowed = NEGLIGIBLE * max(study.error(tight, quantity), FLOOR)
        largest = math.nan
        for row in sorted((r for r in rows if r is not tight), key=lambda r: r.tolerance):
            if not _distance(row, tight, quantity) <= allowed:
                break
            largest = row.tolerance
        useful[mesh[0] if mesh[0] != 1.0 else mesh[1]] = largest
    return useful


TARGETS = (0.05, 0.01, 0.002)
"""Target accuracies listed in the cost table."""

_SPLIT = ("quantity", "error as written", "mesh", "time step", "iteration", "reduction")
_ORDERS = ("order", "mesh alone", "step alone")


def as_text(study: Study) -> str:
    """Text for the terminal: cost of each accuracy, sources of error, orders, tolerances, failed runs."""
    own = study.reference.own_error
    lines = [
        f"{study.scene.name}: cost of accuracy ({study.seconds:.0f} CPU s for the study)",
        f"reference: {study.reference.text}",
    ]
    if own is not None:
        lines.append("  its own error: " + ", ".join(f"{q.quantity} {percent(q.error)}" for q in own.quantities))
    prices: list[tuple[str, ...]] = [("quantity", *(f"for {percent(t)}" for t in TARGETS))]
    prices += [(q, *(_price(price(study, q, t)) for t in TARGETS)) for q in study.quantities]
    split = [(*_SPLIT, *_ORDERS), *(_source(sources(study, q)) for q in study.quantities)]
    lines += ["", "cheapest setting that reaches an accuracy, and keeps it when refined (CPU s):", *aligned(prices)]
    lines += ["", "sources of error at the resolution of the scene, and observed orders:", *aligned(split)]
    lines += ["", "tolerance on sqrt(eta) below which the iteration error is negligible, by mesh:"]
    lines += aligned(_useful(study))
    failed = failures(study)
    lines += ["", f"{len(failed)} run(s) failed or were refused" + (":" if failed else "")]
    return "\n".join([*lines, *(f"  {text}" for text in failed)])


def as_markdown(study: Study, picture: str) -> str:
    """The text as a page with the figure and the table of all runs."""
    head = [f"# Cost of accuracy: {study.scene.name}", "", f"![Work-precision diagrams]({picture})", ""]
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
            "values": {q: _plain(v) for q, v in study.reference.quantities.values.items()},
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
    """The data of ``as_data`` as strict JSON, one key a line."""
    lines = (f"  {json.dumps(k)}: {json.dumps(v, allow_nan=False)}" for k, v in as_data(study).items())
    return "{\n" + ",\n".join(lines) + "\n}"


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


def _price(cheapest: Price) -> str:
    row = cheapest.row
    if row is None or row.run is None:
        return "not reached"
    mesh, steps = row.resolution.mesh, row.resolution.time
    return f"{row.run.cpu:.2g} ({row.variant}, x {mesh:.2g}, steps x {steps:.2g})"


def _price_data(cheapest: Price) -> dict[str, Any]:
    row = cheapest.row
    if row is None or row.run is None:
        return {"target": cheapest.target, "reached": False}
    setting = {"scheme": row.variant, "mesh": row.resolution.mesh, "steps": row.resolution.time}
    cost = {"target": cheapest.target, "reached": True, "cpu_seconds": row.run.cpu}
    return {**cost, **setting, "error": _plain(cheapest.error)}


def _source(s: Sources) -> tuple[str, ...]:
    shares = (percent(e) for e in (s.total, s.space, s.time, s.iteration, s.reduction))
    orders = ("-" if math.isnan(p) else f"{p:.1f}" for p in (s.order_together, s.order_space, s.order_time))
    return (s.quantity, *shares, *orders)


def _cells(study: Study, row: Row) -> list[str]:
    cost = ["-", "-"] if row.run is None else [f"{row.run.cpu:.3g}", f"{row.run.iterations[0]:.1f}"]
    at = row.resolution
    errors = ["failed" if row.failure else percent(study.error(row, q)) for q in study.quantities]
    return [row.series, row.variant, f"{at.mesh:.3g}", f"{at.time:.3g}", f"{row.tolerance:g}", *cost, *errors]


def _plain(value: Any) -> Any:
    return value if not isinstance(value, float) or math.isfinite(value) else None
