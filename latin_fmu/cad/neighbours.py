"""Which parts touch, and with which faces; how far apart others are, and how much they overlap.

Faces touch where a place of one is on the other, up to a distance, and their normals look at each other. Places are
those of a grid over the parameters of the smaller of the two faces. Two parts overlap where a place of the skin of one,
moved inwards by that distance, is inside the other; the common volume is then that of their intersection.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np

from .facts import Array, CadPair, CadPart

_GRID: Final = 7
_MORE: Final = 25  # of narrow faces, such as rings, that a coarse grid misses
_ENOUGH: Final = 6
_LOOKED_AT: Final = 16  # places of a face, whether they are inside another part
_FACING: Final = -0.7  # cosine between the normals
CLEAR: Final = 0.5
"""Distance up to which a clearance between parts is told, mm."""


class Skins:
    """Faces of the parts, with their places and boxes, kept while the geometry stays as it is.

    Parameters
    ----------
    gmsh : the module, with the geometry. faces : numbers by part.
    """

    def __init__(self, gmsh: Any, faces: dict[str, list[int]]) -> None:
        self._gmsh, self.faces = gmsh, faces
        self._boxes: dict[int, Array] = {}
        self._places: dict[int, tuple[Array, Array]] = {}

    def box(self, face: int) -> Array:
        """Corners (2, 3) of the box around a face."""
        if face not in self._boxes:
            self._boxes[face] = np.array(self._gmsh.model.occ.getBoundingBox(2, face)).reshape(2, 3)
        return self._boxes[face]

    def places(self, face: int) -> tuple[Array, Array]:
        """Places (n, 3) in a face, and the normals there."""
        if face not in self._places:
            found = self._grid(face, _GRID)
            if len(found[0]) < _ENOUGH:
                found = self._grid(face, _MORE)
            self._places[face] = found
        return self._places[face]

    def _grid(self, face: int, count: int) -> tuple[Array, Array]:
        model = self._gmsh.model
        low, high = model.getParametrizationBounds(2, face)
        shares = (np.arange(count) + 0.5) / count
        u, v = (low[i] + (high[i] - low[i]) * shares for i in (0, 1))
        grid = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
        inside = np.array([bool(model.isInside(2, face, list(place), True)) for place in grid])
        chosen = grid[inside].ravel()
        if not len(chosen):
            return np.zeros((0, 3)), np.zeros((0, 3))
        return (
            np.array(model.getValue(2, face, chosen)).reshape(-1, 3),
            np.array(model.getNormal(face, chosen)).reshape(-1, 3),
        )

    def near(self, one: int, other: int, distance: float) -> bool:
        """Whether the boxes of two faces are no farther apart than this, mm."""
        a, b = self.box(one), self.box(other)
        return bool((np.maximum(a[0] - b[1], b[0] - a[1]) <= distance).all())

    def touch(self, one: int, other: int, distance: float) -> bool:
        """Whether two faces of different parts touch."""
        if not self.near(one, other, distance):
            return False
        return self._on(one, other, distance) or self._on(other, one, distance)

    def on_any(self, face: int, others: Sequence[int], distance: float) -> bool:
        """Whether a place of a face is on one of others; the sides that they look to do not count: those of a face that
        was split may be those of what has split it."""
        return any(self.near(face, other, distance) and self._on(face, other, distance, False) for other in others)

    def _on(self, face: int, other: int, distance: float, facing: bool = True) -> bool:
        """Whether some place of a face is on another one, and looks at it."""
        model, box = self._gmsh.model, self.box(other)
        places, normals = self.places(face)
        beside = np.maximum(box[0] - places, places - box[1]).max(axis=1, initial=0.0) > distance
        for place, normal in zip(places[~beside], normals[~beside], strict=True):
            closest, parameters = model.getClosestPoint(2, other, list(place))
            if np.linalg.norm(np.array(closest) - place) > distance:
                continue
            if not model.isInside(2, other, list(parameters), True):
                continue
            cosine = float(np.array(model.getNormal(other, list(parameters))) @ normal)
            if cosine <= _FACING or (not facing and cosine >= -_FACING):
                return True
        return False


def find_pairs(gmsh: Any, parts: Sequence[CadPart], skins: Skins, distance: float) -> list[CadPair]:
    """Pairs of parts that touch up to a ``distance``, mm, are at most ``CLEAR`` apart, or overlap."""
    pairs = []
    for i, one in enumerate(parts):
        for other in parts[i + 1 :]:
            if one.near(other, CLEAR):
                pair = _pair(gmsh, (one, other), skins, distance)
                if pair is not None:
                    pairs.append(pair)
    return pairs


def _pair(gmsh: Any, parts: tuple[CadPart, CadPart], skins: Skins, distance: float) -> CadPair | None:
    """How two parts are to each other; None where they are farther apart than what is told."""
    one, other = parts
    touching = [(f, g) for f in skins.faces[one.name] for g in skins.faces[other.name] if skins.touch(f, g, distance)]
    faces = tuple(sorted({f for f, _ in touching})), tuple(sorted({g for _, g in touching}))
    common = 0.0
    # faces that touch are beside each other, and what is in a hole that it fills would cost most to look at
    beside = {f for side in faces for f in side}
    if any(_inside(gmsh, skins, pair, distance, beside) for pair in (parts, parts[::-1])):
        common = _common(gmsh, one.number, other.number)
    gap = 0.0
    if not touching and common == 0.0:
        gap = _gap(gmsh, one.number, other.number)
        if not distance < gap <= CLEAR:
            return None
    return CadPair((one.name, other.name), gap, common, faces)


def _gap(gmsh: Any, one: int, other: int) -> float:
    """Distance between two solids, mm."""
    return float(gmsh.model.occ.getDistance(3, one, 3, other)[0])


def _inside(gmsh: Any, skins: Skins, parts: Sequence[CadPart], depth: float, beside: set[int]) -> bool:
    """Whether the skin of one part, but for faces ``beside`` the other one, is inside it by this depth at least, mm."""
    one, other = parts
    low, high = np.array(other.low) + depth, np.array(other.high) - depth
    for face in skins.faces[one.name]:
        if face in beside:
            continue
        box = skins.box(face)
        if (np.maximum(low - box[1], box[0] - high) > 0.0).any():
            continue
        places, normals = skins.places(face)
        every = 1 + len(places) // _LOOKED_AT
        for place in (places - depth * normals)[::every]:
            within = ((place > low) & (place < high)).all()
            if within and gmsh.model.isInside(3, other.number, list(place)):
                return True
    return False


def _common(gmsh: Any, one: int, other: int) -> float:
    """Volume that two solids have in common, mm3; 0 where the library cannot tell."""
    occ = gmsh.model.occ
    copies = occ.copy([(3, one), (3, other)])
    try:
        found, _ = occ.intersect(copies[:1], copies[1:], removeObject=True, removeTool=True)
    except Exception:  # the library raises plain exceptions
        occ.remove([entity for entity in copies if entity in occ.getEntities(3)], recursive=True)
        return 0.0
    volume = float(sum(occ.getMass(3, tag) for dim, tag in found if dim == 3))
    occ.remove(found, recursive=True)
    return volume


def overlaps_and_gaps(pairs: Sequence[CadPair], screwed: Sequence[frozenset[str]]) -> Iterator[str]:
    """What is said of pairs that overlap, and of clearances; not of screws and the holes around them, ``screwed``."""
    for pair in pairs:
        if pair.overlap > 0.0 and frozenset(pair.parts) not in screwed:
            yield f"{pair.parts[0]} and {pair.parts[1]} overlap by {pair.overlap:.4g} mm3"
    for pair in pairs:
        if pair.gap > 0.0 and frozenset(pair.parts) not in screwed:
            yield f"{pair.parts[0]} and {pair.parts[1]} are {pair.gap:.4g} mm apart"
