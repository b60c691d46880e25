"""Slave nodes of contact pairs moved onto the master, as ``ADJUST`` of *CONTACT PAIR says: those of a set, or within a
distance. The master is flat between the corners of its facets."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np

from .content import CORNERS, NO_ROWS, Array, Index, MeshContent
from .deck_card import Card
from .deck_model import numbers
from .deck_scene import rows_of_set
from .middle_nodes import VTK

_AT_ONCE: Final = 2_000_000  # pairs of nodes and triangles
_INSIDE: Final = 1e-9  # of a triangle, beyond its edges
_FLAT: Final = 1e-6  # of the size of the mesh: middle nodes of the master off its facets


def has_adjusted(content: MeshContent) -> bool:
    """Whether a deck has a contact pair with ADJUST."""
    return any(True for _ in _cards(content))


def adjusted(content: MeshContent) -> MeshContent:
    """The mesh with moved nodes: each onto the nearest facet of the master that it is above or below."""
    points = content.points.copy()
    for card in _cards(content):
        for _, fields in card.tokens():
            if len(fields) > 1:
                rows, places = _moves(content, card, fields[0], fields[1])
                points[rows] = places
    return replace(content, points=points)


def surface_rows(content: MeshContent, name: str) -> Index:
    """Rows of the nodes of a surface of facets, those in the middle of its edges, too, or of a set of nodes."""
    tables = _tables(content, name)
    if not tables:
        return rows_of_set(content, name)
    corners = np.unique(np.concatenate([table.ravel() for table in tables]))
    edges = {_key(pair) for table in tables for i in range(table.shape[1]) for pair in table[:, [i - 1, i]].tolist()}
    inside = np.zeros(len(content.points), dtype=bool)
    inside[corners] = True
    found = [corners]
    for kind, cells in content.solids.items():
        ends = np.array([pair for pair in VTK.get(kind, ()) if len(pair) == 2], dtype=np.int64).reshape(-1, 2)
        first = CORNERS[kind]
        for k, pair in enumerate(ends):
            near = np.flatnonzero(inside[cells[:, pair]].all(axis=1))
            chosen = [
                row for row, two in zip(near.tolist(), cells[near][:, pair].tolist(), strict=True) if _key(two) in edges
            ]
            found.append(cells[chosen, first + k])
    return np.unique(np.concatenate(found))


def _key(pair: list[int]) -> tuple[int, int]:
    return min(pair), max(pair)


def _cards(content: MeshContent) -> Iterator[Card]:
    cards = content.deck.cards if content.deck is not None else []
    return (card for card in cards if card.keyword == "CONTACT PAIR" and "ADJUST" in card.parameters)


def _tables(content: MeshContent, name: str) -> list[Index]:
    """Corners of the facets of a surface."""
    spelled = {key.upper(): key for key in reversed(list(content.facets))}
    return list(content.facets.get(spelled.get(name.rpartition(".")[2].upper(), ""), []))


def _moves(content: MeshContent, card: Card, slave: str, master: str) -> tuple[Index, Array]:
    """Rows and new places of the nodes that a pair moves; none where the master is curved."""
    nothing = NO_ROWS, np.zeros((0, 3))
    corners = [content.points[table] for table in _tables(content, master)]
    triangles = [c[:, list(cut)] for c in corners for cut in ((0, 1, 2), (0, 2, 3))[: c.shape[1] - 2]]
    rows = surface_rows(content, slave)
    if not triangles or not len(rows):
        return nothing
    faces = np.concatenate(triangles)
    size = float(np.ptp(content.points, axis=0).max())
    middle = np.setdiff1d(surface_rows(content, master), np.concatenate([t.ravel() for t in _tables(content, master)]))
    if len(middle) and float(np.abs(_nearest(content.points[middle], faces)[1]).max()) > _FLAT * size:
        return nothing
    places, distances = _nearest(content.points[rows], faces)
    reach = numbers([card.name("ADJUST") or "0"])
    if reach is None:
        chosen = np.isin(rows, rows_of_set(content, card.name("ADJUST")))
    else:
        chosen = distances <= reach[0] * (1.0 + 1e-9)
    chosen &= np.isfinite(distances)
    return rows[chosen], places[chosen]


def _nearest(points: Array, triangles: Array) -> tuple[Array, Array]:
    """Foot (n, 3) of each point on the nearest triangle that it is above or below, and its distance; infinite where
    there is none."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    normal = np.cross(b - a, c - a)
    twice = np.linalg.norm(normal, axis=1)
    unit = normal / twice[:, None]
    feet, distances = np.zeros_like(points), np.full(len(points), np.inf)
    step = max(1, _AT_ONCE // len(triangles))
    for first in range(0, len(points), step):
        some = points[first : first + step, None, :]
        height = ((some - a) * unit).sum(axis=2)
        foot = some - height[:, :, None] * unit
        shares = [(np.cross(q - p, foot - p) * unit).sum(axis=2) / twice for p, q in ((a, b), (b, c), (c, a))]
        away = np.where(np.min(shares, axis=0) >= -_INSIDE, np.abs(height), np.inf)
        best = away.argmin(axis=1)
        each = np.arange(len(best))
        feet[first : first + step] = foot[each, best]
        distances[first : first + step] = away[each, best]
    return feet, distances
