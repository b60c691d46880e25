"""Peak memory of a run, measured in a process of its own."""

from __future__ import annotations

from multiprocessing import get_context
from typing import Any

from benchmark_floor import Floor
from benchmark_problems import Case, crushing
from benchmark_timing import contact_run, prepared

from latin_fmu.machine import peak_memory


def peak(case: Case, solver: dict[str, Any] | None) -> int:
    """Bytes that a run needs beyond the same with one element in a block; ``solver`` None for the linear transient."""
    with get_context("spawn").Pool(1) as pool:
        found: int = pool.apply(_peak, (case, solver))
    return found


def _peak(case: Case, solver: dict[str, Any] | None) -> int:
    _run(crushing(1, case.mu), solver)
    before = peak_memory()
    _run(case, solver)
    return peak_memory() - before


def _run(case: Case, solver: dict[str, Any] | None) -> None:
    if solver is None:
        Floor(prepared(case, {"propagator": "direct"})).best()
    else:
        contact_run(prepared(case, solver))
