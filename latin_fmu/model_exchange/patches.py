"""Faces cut into patches of about equal area."""

from __future__ import annotations

import numpy as np

from ..latin.assembly import Array, Index

_SAME = 1e-9  # of the extent: coordinates closer than this are one, so that round-off never decides


def patches(points: Array, areas: Array, n: int) -> list[Index]:
    """Points of each patch: the largest patch is halved across its longest direction until there are n.

    points : (n_point, 3), m. areas : (n_point,), m2. n : wanted number, >= 1; no more than points.
    """
    found = [np.arange(len(points))]
    while len(found) < n:
        order = sorted(range(len(found)), key=lambda i: (-areas[found[i]].sum(), i))
        largest = next((i for i in order if len(found[i]) > 1), None)
        if largest is None:
            break
        found[largest : largest + 1] = _halves(found[largest], points, areas)
    return found


def _halves(members: Index, points: Array, areas: Array) -> list[Index]:
    there = points[members]
    extent = np.ptp(there, axis=0)
    axis = int(np.argmax(extent > (1.0 - _SAME) * extent.max()))
    along = np.round(there[:, axis] / max(float(extent.max()), np.finfo(float).tiny) / _SAME) * _SAME
    order = np.argsort(along, kind="stable")
    reached = np.cumsum(areas[members[order]])
    cut = int(np.searchsorted(reached, reached[-1] / 2 * (1.0 + _SAME)))
    cut = min(max(cut, 1), len(members) - 1)
    return [members[order[:cut]], members[order[cut:]]]
