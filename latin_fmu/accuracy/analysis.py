"""What a study says: orders, sources of error, the price of an accuracy, where the tolerance stops to matter."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .bench import Row
from .differences import relative, same_way
from .extrapolation import observed_order
from .kinds import FLOOR
from .study import REDUCTION, SPACE, TIGHT, TIME, TOGETHER, TOLERANCE, Study

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
