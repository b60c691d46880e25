"""A face as flat pieces, for clipping and for the search of opposite faces."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .faces import flat_pieces, is_straight, shape
from .mesh import Array, FacetSet, Index
from .reference_cells import FACET_CORNERS

_CREASE = 0.7  # rad; pieces that meet at a larger angle form an edge of the body, not a curved face


@dataclass(frozen=True)
class Pieces:
    """Flat pieces with 3 or 4 corners of the facets of one block.

    Attributes
    ----------
    kind : of the facets. facet : (n_piece,) row of the facet in its block. nodes : (n_piece, n_node) of that facet.
    corners : (n_piece, 3 | 4, 3), m. reference : (n_piece, 3 | 4, 2) their coordinates in the facet.
    """

    kind: str
    facet: Index
    nodes: Index
    corners: Array
    reference: Array

    @property
    def n_piece(self) -> int:
        """Number of pieces."""
        return len(self.facet)

    @cached_property
    def vector_areas(self) -> Array:
        """Areas times unit normals, (n_piece, 3), m2."""
        c = self.corners
        second = c[:, 3] - c[:, 1] if c.shape[1] == 4 else c[:, 2] - c[:, 1]
        first = c[:, 2] - c[:, 0] if c.shape[1] == 4 else c[:, 1] - c[:, 0]
        return np.asarray(0.5 * np.cross(first, second))

    @cached_property
    def areas(self) -> Array:
        """Areas of the pieces, (n_piece,), m2."""
        return np.asarray(np.linalg.norm(self.vector_areas, axis=1))

    @cached_property
    def normals(self) -> Array:
        """Unit normals (n_piece, 3), outwards."""
        return np.asarray(self.vector_areas / self.areas[:, None])

    @cached_property
    def centres(self) -> Array:
        """Means of the corners, (n_piece, 3), m."""
        return np.asarray(self.corners.mean(axis=1))

    @cached_property
    def radii(self) -> Array:
        """Largest distance of a corner from the centre, (n_piece,), m."""
        return np.asarray(np.linalg.norm(self.corners - self.centres[:, None], axis=2).max(axis=1))


@dataclass(frozen=True)
class Surface:
    """One face of a mesh: ``nodes`` (n_node, 3) of the whole mesh, ``facets`` of the face."""

    nodes: Array
    facets: FacetSet

    @cached_property
    def pieces(self) -> tuple[Pieces, ...]:
        """Flat pieces of each block of facets."""
        return tuple(self._cut(block.kind, block.facets) for block in self.facets.blocks)

    def _cut(self, kind: str, facets: Index) -> Pieces:
        places = self.nodes[facets]
        reference = flat_pieces(kind, is_straight(kind, places))
        n_facet, n_piece = len(facets), len(reference)
        if n_piece == 1:
            corners = places[:, : FACET_CORNERS[kind]]
        else:
            corners = np.einsum("pca,fai->fpci", shape(kind, reference), places).reshape(-1, reference.shape[1], 3)
        facet = np.repeat(np.arange(n_facet), n_piece)
        return Pieces(kind, facet, facets[facet], corners, np.tile(reference, (n_facet, 1, 1)))

    @cached_property
    def area(self) -> float:
        """Area of the pieces, m2."""
        return float(sum(p.areas.sum() for p in self.pieces))

    @cached_property
    def facet_area(self) -> float:
        """Median area of its facets, m2."""
        return float(np.median(np.concatenate([np.bincount(p.facet, p.areas) for p in self.pieces])))

    @cached_property
    def size(self) -> float:
        """Longest side of the bounding box of the face, m."""
        return float(np.ptp(self.nodes[self.facets.nodes], axis=0).max())

    @cached_property
    def is_plane(self) -> bool:
        """Whether all pieces have one normal (to 1e-6)."""
        first = self.pieces[0].normals[0]
        return all(bool(np.abs(p.normals @ first - 1).max() < 1e-6) for p in self.pieces)

    @cached_property
    def sags(self) -> tuple[Array, ...]:
        """Distance of each flat piece from the smooth surface that it stands for, per block (n_piece,), m.

        A chord h of a circle is h^2 / (8 R) away, and neighbours stand at the angle theta = h / R: h theta / 8, with
        h the height of the piece over the edge it shares. 0 on plane faces and across the edges of a body.
        """
        ends = [np.stack([p.corners, np.roll(p.corners, -1, axis=1)], axis=2).reshape(-1, 2, 3) for p in self.pieces]
        owner = [np.repeat(np.arange(p.n_piece), p.corners.shape[1]) for p in self.pieces]
        normals = np.concatenate([p.normals[o] for p, o in zip(self.pieces, owner, strict=True)])
        height = np.concatenate(
            [
                (2 if p.corners.shape[1] == 3 else 1) * p.areas[o] / np.linalg.norm(e[:, 1] - e[:, 0], axis=1)
                for p, o, e in zip(self.pieces, owner, ends, strict=True)
            ]
        )
        bend = _bend(np.concatenate(ends), normals, 1e-9 * self.size)
        sag = np.where(bend < _CREASE, height * bend / 8, 0.0)
        sags, start = [], 0
        for p, o in zip(self.pieces, owner, strict=True):
            own = np.zeros(p.n_piece)
            np.maximum.at(own, o, sag[start : start + len(o)])
            sags.append(own)
            start += len(o)
        return tuple(sags)


def _bend(ends: Array, normals: Array, tolerance: float) -> Array:
    """Angle (n,) between the normals (n, 3) of pieces that share an edge (n, 2, 3), 0 where an edge is free."""
    scale = max(tolerance, 1e-300)
    middle = np.rint(ends.mean(axis=1) / (1e3 * scale)).astype(np.int64)
    _, label, count = np.unique(middle, axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(label.ravel(), kind="stable")
    starts = np.cumsum(count) - count
    pairs = starts[count == 2]
    one, two = order[pairs], order[pairs + 1]
    bend = np.zeros(len(ends))
    sine = np.linalg.norm(np.cross(normals[one], normals[two]), axis=1)
    angle = np.arctan2(sine, np.einsum("pi,pi->p", normals[one], normals[two]))
    bend[one] = bend[two] = np.where(angle < 1e-7, 0.0, angle)
    return bend
