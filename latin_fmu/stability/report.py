"""The stability report as text: one table for people, one list of objects for programs."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence

from .case import Row
from .schemes import SchemeRow

_KEYS = ("case", "asked", "measured", "passed", "iterations", "fallbacks", "seconds")


def as_json(rows: Sequence[Row]) -> str:
    """One list of objects with the keys case, asked, measured, passed, iterations, fallbacks, seconds."""
    lines = (json.dumps({key: _plain(getattr(row, key)) for key in _KEYS}, allow_nan=False) for row in rows)
    return "[\n  " + ",\n  ".join(lines) + "\n]"


def _plain(value: object) -> object:
    return round(value, 4) if isinstance(value, float) and math.isfinite(value) else value


def verdict(rows: Sequence[Row]) -> str:
    """One sentence on the whole suite."""
    failed = [row.case for row in rows if not row.passed]
    seconds = sum(row.seconds for row in rows)
    kept = f"{len(rows) - len(failed)} of {len(rows)} hard cases hold ({seconds:.0f} s)"
    return kept + (f"; failed: {', '.join(failed)}" if failed else "")


def as_markdown(rows: Sequence[Row], schemes: Sequence[SchemeRow], figure: str | None) -> str:
    """The whole report: verdict, figure, one table of cases by family, comparison of time schemes."""
    parts = ["# Stability report", "", verdict(rows) + ".", ""]
    if figure is not None:
        parts += [f"![Margins and iterations of every case]({figure})", ""]
    parts += [
        "Every number is measured in this run and compared with an independent expectation: a closed form, a",
        "scaling, a symmetry, a balance, or the same discrete problem iterated to round-off. Iterations: largest in",
        "a window and mean; fall-backs: windows in which one was used.",
        "",
        "| case | asked | measured | holds | iterations | fall-backs | s |",
        "|---|---|---|---|---|---|---|",
    ]
    family = ""
    for row in rows:
        if row.family != family:
            family = row.family
            parts.append(f"| **{family}** | | | | | | |")
        parts.append(
            f"| {_cell(row.case)} | {_cell(row.asked)} | {_cell(row.measured)} | {'yes' if row.passed else '**no**'} "
            f"| {row.iterations} ({row.mean_iterations:.1f}) | {row.fallbacks} | {row.seconds:.1f} |"
        )
    if schemes:
        parts += ["", *_scheme_table(schemes)]
    return "\n".join(parts) + "\n"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


def _scheme_table(schemes: Sequence[SchemeRow]) -> list[str]:
    lines = [
        "## Time schemes on impact",
        "",
        "Bar of length 10 (wave speed 30) against rigid ground: thrown at speed 10 (exact force 300 for 2/3, impulse",
        "200, one rise and one fall: variation 600), then dropped under gravity (energy kept). Same mesh and step.",
        "",
        "| scheme | impulse off by | peak over 300 | variation over 600 | energy kept after the throw "
        "| penetration (steps x speed) | bounces | energy kept after them | iterations |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    return lines + [
        f"| {row.name} | {100 * row.impulse_error:.2f} % | {row.peak:.2f} | {row.variation:.2f} "
        f"| {100 * row.kept_after_throw:.1f} % | {row.penetration:.2f} | {row.bounces} "
        f"| {100 * row.kept_after_bounces:.1f} % | {row.iterations:.1f} |"
        for row in schemes
    ]
