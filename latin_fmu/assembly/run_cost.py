"""Predicted cost of a run: counts of operations, their seconds, and what it would save to leave something out."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..propagator.cost import (
    MANY,
    Counts,
    added,
    bytes_held,
    bytes_read,
    instant_counts,
    scaled,
    seconds,
    set_up_counts,
)
from ..propagator.seconds import CACHE
from .run_sizes import STATIC, RunSizes

_WHOLE = 0.65  # marches of the whole interval per iteration: instants before the first change are not marched again
_SEQUENTIAL = 1.3  # iterations of the windows of one instant that a longer one starts from, over both its marches
_STATIC_WINDOW = 2.0  # first guess, coarse problem and bookkeeping of an increment, in iterations


@dataclass(frozen=True)
class RunCost:
    """Seconds of CPU of a run: set_up : from the scene to operators. march : all instants, with all that is kept."""

    set_up: float
    march: float

    @property
    def total(self) -> float:
        """Both, s."""
        return self.set_up + self.march


def run_cost(sizes: RunSizes) -> RunCost:
    """Predicted cost."""
    return RunCost(seconds(set_up(sizes)), seconds(march(sizes)))


def march_saved(sizes: RunSizes, without: RunSizes) -> float:
    """CPU seconds of the march that go when something is left out, s."""
    return max(0.0, seconds(march(sizes)) - seconds(march(without)))


def set_up(sizes: RunSizes) -> Counts:
    """Operations from a scene in memory to operators."""
    kind = sizes.kind if not sizes.static else "direct"
    parts = [set_up_counts(kind, c.size, sizes.modes) for c in sizes.classes]
    unknowns = sum(c.n_member * c.size.unknowns for c in sizes.classes)
    whole = {
        "run": 1.0,
        "body": float(sizes.bodies),
        "interface": float(sizes.interfaces),
        "cell": float(sizes.cells),
        "unknown": float(unknowns),
    }
    return added(whole, *parts)


def march(sizes: RunSizes) -> Counts:
    """Operations of all instants, what is kept included."""
    parts = [_kept(sizes), _start(sizes), _around(sizes)]
    if sizes.compiled:
        parts.append(_compiled(sizes))
    elif sizes.static:
        parts.append(_static(sizes))
    else:
        parts.append(_windows(sizes))
    return added(*parts)


def _compiled(sizes: RunSizes) -> Counts:
    """Windows of one instant in the compiled march."""
    parts = [
        instant_counts(sizes.kind, c.size, sizes.iterations, sizes.modes, sizes.precision, marched=c.marched)
        for c in sizes.classes
    ]
    read = sum(c.marched * bytes_read(sizes.kind, c.size, sizes.iterations, sizes.modes) for c in sizes.classes)
    held = sum(bytes_held(sizes.kind, c.size, sizes.modes) for c in sizes.classes)
    bonds = float(sizes.n_flat) ** 2 if sizes.at_once else 0.0
    beyond = {"beyond": read * max(0.0, 1.0 - CACHE / held)} if held else {}
    instant = added(*parts, beyond, {"dense": bonds})
    once = {"bonds": float(sizes.n_flat) ** 3} if sizes.at_once else {}
    return added(scaled(instant, sizes.n_instant), once)


def _windows(sizes: RunSizes) -> Counts:
    """Longer windows, or instants without kernels: every pass goes through the interpreter."""
    repeated = _WHOLE if sizes.window >= sizes.n_instant else 1.0
    passes = 1.0 if sizes.window == 1 else repeated * (sizes.iterations + 1.0)
    if sizes.sequential:
        passes = 2.0
    inner = _SEQUENTIAL if sizes.sequential else sizes.iterations if sizes.window == 1 else 1.0
    parts = [
        instant_counts(sizes.kind, c.size, inner, sizes.modes, sizes.precision, compiled=False, marched=c.marched)
        for c in sizes.classes
    ]
    turns = {"turn": inner * len(sizes.classes), "column": inner * sizes.n_flat} if sizes.interfaces else {}
    return scaled(added(*parts, turns), passes * sizes.n_instant)


def _static(sizes: RunSizes) -> Counts:
    """Increments without inertia."""
    iterations = sizes.iterations
    per_class = []
    for c in sizes.classes:
        m, together = c.n_member, "" if c.n_member == 1 else MANY
        dense = m * (iterations * c.size.channels**2 + 2.0 * c.size.interface**2)
        per_class.append({"call": 1.0, f"{together}sweep": 2.0 * m * c.size.factor_entries, f"{together}dense": dense})
    turns = iterations + _STATIC_WINDOW
    loop = {"turn": turns * len(sizes.classes), "column": turns * sizes.n_flat}
    return scaled(added(*per_class, loop), sizes.n_instant)


def _around(sizes: RunSizes) -> Counts:
    """Histories of the interfaces, and what they read off the bodies."""
    return {
        "finish": 1.0,
        "result": float(sizes.interfaces),
        "history": float(sizes.n_instant * sizes.n_flat),
        "probe": float(len(sizes.probed)),
        "probe_value": float(sizes.n_instant * sum(sizes.probed)),
    }


def _kept(sizes: RunSizes) -> Counts:
    """Fields, stress and energies."""
    counts: Counts = {}
    stored = sizes.n_instant // sizes.every + 1.0
    elastic = [c for c in sizes.classes if not c.rigid]
    if sizes.energy:
        entries = sum(
            c.n_member * (c.size.entries + c.size.mass_entries + c.size.damping_entries) for c in sizes.classes
        )
        counts["energy"] = float(sizes.n_instant * len(sizes.classes))
        counts["energy_entry"] = float(sizes.n_instant * entries)
    if sizes.fields:
        counts["field"] = stored * sizes.members
        counts["field_node"] = stored * sum(c.n_member * c.nodes for c in sizes.classes)
    if sizes.stress:
        counts["stress"] = stored * sum(c.n_member for c in elastic)
        counts["stress_cell"] = stored * sum(c.n_member * c.cells for c in elastic)
    return counts


def _start(sizes: RunSizes) -> Counts:
    """Accelerations at t = 0, or the static equilibrium there."""
    if sizes.increments:
        before = replace(sizes, static=True, n_instant=sizes.increments, iterations=STATIC)
        return added(_static(before), *(set_up_counts("direct", c.size) for c in sizes.classes))
    if sizes.unbalanced:
        return {"start": sum(float(c.size.factor_entries) for c in sizes.classes)}
    return {}
