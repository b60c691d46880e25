"""Points of non-matching interfaces at places where both bodies are held.

A node of the owner that is held (a plane of symmetry, a fixed edge) cannot move, but the other side's row of its point
mixes nodes on the held edge with inner ones: the point would hold those a second time. The tractions were not unique
and the iteration slow, so such a point takes no part in the held direction, as it would not with matching nodes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..fem.facets import N_CORNER
from ..fem.mesh import Array, FacetSet, Index
from ..latin.layout import InterfaceUnit
from ..scene.fields import split_face
from .body import Body
from .conditions import Conditions

Mask = NDArray[np.bool_]
_ON_EDGE = 1e-6  # distance from an edge over the size of the face


def without_held_directions(
    units: list[InterfaceUnit], bodies: Mapping[str, Body], conditions: Mapping[str, Conditions]
) -> list[InterfaceUnit]:
    """The interfaces, their points without the directions that both sides are held in."""
    return [
        unit if unit.geometry.matching or unit.against_ground else _freed(unit, bodies, conditions)
        for unit in units
    ]


def _freed(
    unit: InterfaceUnit, bodies: Mapping[str, Body], conditions: Mapping[str, Conditions]
) -> InterfaceUnit:
    geometry = unit.geometry
    names = [split_face(side)[0] for side in unit.sides]
    if any(bodies[name].rigid for name in names):
        return unit
    held = [_held(conditions[name]) for name in names]
    own, other = (geometry.traces[i] for i in (geometry.owner, 1 - geometry.owner))
    assert own is not None
    assert other is not None
    still = np.asarray(abs(own) @ (~held[geometry.owner]).astype(float)) == 0.0
    name, face = split_face(unit.sides[1 - geometry.owner])
    gone = np.zeros((geometry.n_point, 3), dtype=bool)
    for axis in range(3):
        rows = np.flatnonzero(still[axis::3])
        if len(rows):
            edges = _edges(bodies[name].facets(face), held[1 - geometry.owner][axis::3])
            gone[rows, axis] = _on_edges(
                geometry.points[rows], geometry.frames[rows, 0], bodies[name].mesh.nodes[edges]
            )
    if not gone.any():
        return unit
    keep = sp.diags_array((~gone).astype(float).ravel())
    traces = tuple(sp.csr_array(keep @ trace) for trace in (own, other))
    for trace in traces:
        trace.eliminate_zeros()
    ordered = traces if geometry.owner == 0 else traces[::-1]
    return replace(unit, geometry=replace(geometry, traces=(ordered[0], ordered[1])))


def _held(conditions: Conditions) -> Mask:
    """(n_full,) dofs that never move."""
    held: Mask = (np.diff(conditions.expansion.indptr) == 0) & ~conditions.pattern.any(axis=1)
    return held


def _edges(facets: FacetSet, held: Mask) -> Index:
    """Nodes at the ends (n, 2) of edges whose ends are both ``held`` (n_node,)."""
    found = [np.zeros((0, 2), dtype=np.int64)]
    for block in facets.blocks:
        corners = block.facets[:, : N_CORNER[block.kind]]
        ends = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2)
        found.append(ends[held[ends].all(axis=1)])
    return np.unique(np.sort(np.concatenate(found), axis=1), axis=0)


def _on_edges(points: Array, normals: Array, ends: Array) -> Mask:
    """Whether each of ``points`` (n, 3) lies on one of the edges ``ends`` (m, 2, 3), seen along its normal."""
    on = np.zeros(len(points), dtype=bool)
    if not len(ends):
        return on
    size = float(np.ptp(np.concatenate([points, ends.reshape(-1, 3)]), axis=0).max())
    for i, (point, normal) in enumerate(zip(points, normals, strict=True)):
        start, along = ends[:, 0] - point, ends[:, 1] - ends[:, 0]
        start = start - np.outer(start @ normal, normal)
        along = along - np.outer(along @ normal, normal)
        length = np.maximum(np.einsum("ei,ei->e", along, along), 1e-300)
        at = np.clip(-np.einsum("ei,ei->e", start, along) / length, 0.0, 1.0)
        on[i] = np.linalg.norm(start + at[:, None] * along, axis=1).min() < _ON_EDGE * size
    return on
