"""What a quasi-static scene cannot have: everything that lives on inertia or on rates."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ..errors import Problem, shown
from .raw_scene import RawTable, given, named_tables, number, single_table
from .time_settings import HHT

_DAMPING = ("rayleigh_mass", "rayleigh_stiffness")


def static_problems(raw: Any) -> Iterator[Problem]:
    """All contradictions of a scene as written with ``time.quasi_static``."""
    time = single_table(raw, "time")
    if time.get("quasi_static") is not True:
        return
    scheme = time.get("scheme")
    if scheme is not None and scheme not in ("hht", {"type": "hht"}, HHT().model_dump()):  # but for the default
        yield _refused("time.scheme", "a time scheme integrates inertia", scheme, "leave the scheme out")
    start = time.get("start")
    if (start.get("type", "static") if isinstance(start, dict) else start) == "static":
        yield _refused("time.start", "every step is an equilibrium already", start, "leave the start out")
    for name, table in named_tables(raw, "substructure").items():
        for key in ("initial_velocity", "initial_spin"):
            if _moves(table.get(key)):
                yield _refused(f"substructure.{name}.{key}", "a velocity needs inertia", table[key], "remove it")
    for name, table in named_tables(raw, "boundary").items():
        if table.get("type") == "absorbing":
            yield _refused(
                f"boundary.{name}", "an absorbing end resists waves only", "absorbing", "remove it, or hold the face"
            )
    for name, table in named_tables(raw, "material").items():
        for key in _DAMPING:
            if number(table, key):
                yield _refused(f"material.{name}.{key}", "damping acts on rates", table[key], "remove it")
    yield from _solver_problems(single_table(raw, "solver"))


def _solver_problems(solver: RawTable) -> Iterator[Problem]:
    if given(solver, "window") and solver["window"] != 1:
        yield _refused(
            "solver.window", "increments of load are solved one by one", solver["window"], "leave the window out"
        )
    propagator = solver.get("propagator")
    kind = propagator.get("type") if isinstance(propagator, dict) else propagator
    if isinstance(kind, str) and kind not in ("automatic", "direct"):
        yield _refused("solver.propagator", "equilibria are not marched", kind, "leave the propagator out")


def _moves(value: object) -> bool:
    return isinstance(value, list | tuple) and any(isinstance(v, int | float) and v != 0 for v in value)


def _refused(where: str, what: str, value: object, remedy: str) -> Problem:
    return Problem(
        where, f"{what}: not with quasi_static = true", shown(value), None, f"{remedy}, or leave quasi_static out"
    )
