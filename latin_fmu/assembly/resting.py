"""Classes of identical substructures, cut where some members are reached by waves much later than others.

Members of a class are marched together, which costs less than one by one, but all of them as soon as one moves. Where
substructures at rest are skipped (``solver.skip_at_rest = "tolerance"``) a class is cut into parts by arrival time, as
far as that is predicted to pay; the parts share their operators.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from .models import ModelClass

_TOGETHER = 0.6
"""Cost of one more member of a class, marched with the others, over its cost alone."""


def cut_by_arrival(classes: Sequence[ModelClass], marched: Mapping[str, float]) -> list[ModelClass]:
    """Classes cut where it pays; ``marched``: predicted share of the instants at which each substructure is marched."""
    found: list[ModelClass] = []
    for whole in classes:
        order = sorted(range(len(whole.members)), key=lambda j: -marched[whole.members[j].name])
        shares = [marched[whole.members[j].name] for j in order]
        first = len(found)
        for start, stop in _parts(shares):
            kept = sorted(order[start:stop])
            twin = None if len(found) == first else first
            part = replace(whole, members=[whole.members[j] for j in kept], channels=whole.channels[:, kept])
            found.append(replace(part, twin=twin))
    return found


def _parts(shares: Sequence[float]) -> list[tuple[int, int]]:
    """Consecutive parts of falling shares with the least predicted cost (dynamic programming)."""
    best: list[tuple[float, int]] = [(0.0, 0)]  # cost of the first j members, start of their last part
    for stop in range(1, len(shares) + 1):
        options = [
            (best[start][0] + shares[start] * (1 + _TOGETHER * (stop - start - 1)) + 1e-9, -start)
            for start in range(stop)
        ]
        cost, start = min(options)
        best.append((cost, -start))
    parts, stop = [], len(shares)
    while stop:
        start = best[stop][1]
        parts.append((start, stop))
        stop = start
    return parts[::-1]
