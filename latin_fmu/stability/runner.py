"""Runs cases and turns what they measure into rows."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable

from ..errors import LatinError
from .case import Bench, Case, Measure, Row


def run_case(case: Case) -> Row:
    """Row of one case. A case whose run fails is a failed row, with what it said as its measure."""
    start = time.perf_counter()
    bench = Bench()
    measures: list[Measure] = []
    said = ""
    try:
        measures = list(case.check(bench))
    except (ArithmeticError, LatinError, ValueError) as error:
        said = f"{type(error).__name__}: {error}"
    limits = "; ".join(f"{m.what} <= {m.limit:.3g}" for m in measures)
    counts = bench.iterations
    return Row(
        case=case.name,
        family=case.family,
        asked=f"{case.promise}: {limits}" if limits else case.promise,
        measured=said or "; ".join(f"{m.value:.3g}" for m in measures),
        passed=bool(measures) and all(m.passed for m in measures),
        margin=max((m.margin for m in measures), default=math.inf),
        iterations=max(counts, default=0),
        mean_iterations=sum(counts) / len(counts) if counts else 0.0,
        fallbacks=bench.fallbacks,
        seconds=time.perf_counter() - start,
    )


def run_suite(cases: Iterable[Case], tell: Callable[[Row], None] | None = None) -> list[Row]:
    """Rows of all cases, in their order; ``tell`` hears each as it is done."""
    rows = []
    for case in cases:
        rows.append(run_case(case))
        if tell is not None:
            tell(rows[-1])
    return rows
