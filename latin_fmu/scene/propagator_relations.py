"""Propagator and time scheme of a scene as written: which go together."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from ..errors import Problem, shown
from .raw_scene import RawTable, given, single_table

EXPLICIT, REDUCED, CENTRAL = "explicit", "reduced", "central_difference"
REDUCIBLE = ("hht", "newmark")


def with_its_scheme(raw: Any) -> Any:
    """The scene with the time scheme of its propagator where none is written."""
    time = single_table(raw, "time")
    if _kind(single_table(raw, "solver"), "propagator") != EXPLICIT or not time or given(time, "scheme"):
        return raw
    return {**raw, "time": {**time, "scheme": CENTRAL}}


def propagator_problems(raw: Any) -> Iterator[Problem]:
    """Propagators and time schemes that exclude each other."""
    kind = _kind(single_table(raw, "solver"), "propagator")
    scheme = _kind(single_table(raw, "time"), "scheme")
    if kind == EXPLICIT and scheme not in (None, CENTRAL):
        yield Problem(
            "solver.propagator",
            "the explicit propagator has a time scheme of its own",
            shown(scheme),
            f'time.scheme = "{CENTRAL}", or none',
            "leave out time.scheme, or choose another propagator",
        )
    if kind == REDUCED and scheme not in (None, CENTRAL, *REDUCIBLE):
        yield Problem(
            "solver.propagator",
            "vibration modes need a scheme in which every node has its mass",
            shown(scheme),
            " or ".join(f'time.scheme = "{name}"' for name in REDUCIBLE),
            "choose another time scheme or propagator",
        )
    precision = single_table(raw, "solver").get("precision")
    if precision == "float32" and (scheme == CENTRAL or kind in (EXPLICIT, REDUCED, "cg")):
        yield Problem(
            "solver.precision",
            "only the direct propagator has factors",
            shown(precision),
            'solver.propagator = "direct" or "automatic"',
            "leave out solver.precision",
        )
    if scheme == CENTRAL and kind not in (None, "automatic", EXPLICIT):
        yield Problem(
            "time.scheme",
            "central differences are marched by the explicit propagator only",
            shown(kind),
            'solver.propagator = "explicit" or "automatic"',
            "choose another time scheme, or that propagator",
        )


def _kind(table: RawTable, key: str) -> str | None:
    """Type that a key chooses, by a bare word or in a table."""
    value = table.get(key)
    chosen = value.get("type") if isinstance(value, Mapping) else value
    return chosen if isinstance(chosen, str) else None
