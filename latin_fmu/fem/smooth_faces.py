"""Smooth surfaces through the nodes of flat facets.

The nodes of a mesh stand on the faces of the part, its flat facets do not: the middle of a chord h of a circle of
radius R is h^2 / (8 R) inside. With the unit normals n_i and n_j of the surface at the ends of an edge, x_j - x_i = d,
the middle of the edge is moved along the normal by

    (n_j - n_i) . d / 8

which is exact on a circle up to the fourth power of h / R (Nagata, Simple local interpolation of surfaces using normal
vectors, Computer Aided Geometric Design 22 (2005) 327-347). The normals are weighted means of those of the facets
around a node, exact on spheres (Max, Weights for computing vertex normals from facet normals, Journal of Graphics
Tools 4 (1999) 1-6), without those behind an edge of the part. At the rim of a face, where the facets are on one side of
a node alone, their mean is not the normal there; the other end of the edge counts twice.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.sparse as sp

from .faces import CREASE, Pieces, Surface
from .mesh import Array, FacetBlock, FacetSet, Index

_BEHIND: Final = -0.1  # cosine between an edge and the middle of a facet on the other side of its node
_LIFTED: Final = {3: "triangle6", 4: "quad8"}


def smoothed(surface: Surface) -> Surface:
    """The surface with quadratic facets in the place of its flat ones; curved facets stay as they are."""
    flat = [p for p in surface.pieces if not p.curved]
    if not flat:
        return surface
    blocks = []
    places = [surface.nodes]
    n_node = len(surface.nodes)
    corners = _Corners.of(flat, surface.nodes)
    rises, first = corners.rises(), 0
    for block, pieces in zip(surface.facets.blocks, surface.pieces, strict=True):
        if pieces.curved:
            blocks.append(block)
            continue
        n = pieces.corners.shape[1]
        span = slice(first, first + n * pieces.n_piece)
        first = span.stop
        middles = corners.middles[span] + rises[span, None] * corners.mean_normals[span]
        places.append(middles)
        numbers = n_node + np.arange(len(middles)).reshape(-1, n)
        n_node += len(middles)
        blocks.append(FacetBlock(_LIFTED[n], np.hstack([pieces.nodes[:, :n], numbers])))
    return Surface(np.concatenate(places), FacetSet(tuple(blocks)))


@dataclass(frozen=True)
class _Corners:
    """Corners of flat facets, each with the edge from it to the next one; one row each.

    Attributes
    ----------
    nodes, following : (n,) at the ends of the edge. back : (n,) row of the corner at its other end. normals : (n, 3) of
        the surface at the corner. start, edge : (n, 3) place of the corner and the edge, m. two_sided : (2, n) whether
        the facets around the first and the second end are on both sides of it along the edge.
    """

    nodes: Index
    following: Index
    back: Index
    normals: Array
    start: Array
    edge: Array
    two_sided: np.ndarray

    @classmethod
    def of(cls, pieces: list[Pieces], places: Array) -> _Corners:
        """The corners of all facets of some blocks; ``places`` (n_node, 3) of the mesh."""
        widths = [p.corners.shape[1] for p in pieces]
        nodes = np.concatenate([p.nodes[:, :n].ravel() for p, n in zip(pieces, widths, strict=True)])
        steps = [np.arange(p.n_piece * n).reshape(-1, n) for p, n in zip(pieces, widths, strict=True)]
        offset = np.cumsum([0, *(s.size for s in steps)])
        following = np.concatenate([np.roll(s, -1, axis=1).ravel() + o for s, o in zip(steps, offset, strict=False)])
        before = np.concatenate([np.roll(s, 1, axis=1).ravel() + o for s, o in zip(steps, offset, strict=False)])
        facet = np.concatenate([np.repeat(p.normals, n, axis=0) for p, n in zip(pieces, widths, strict=True)])
        centre = np.concatenate([np.repeat(p.centres, n, axis=0) for p, n in zip(pieces, widths, strict=True)])
        start = places[nodes]
        edge, other = start[following] - start, start[before] - start
        weight = np.cross(edge, other) / ((edge**2).sum(axis=1) * (other**2).sum(axis=1))[:, None]
        one, two = _around(nodes, facet)
        total = np.zeros_like(start)
        np.add.at(total, one, weight[two])
        normals = total / np.linalg.norm(total, axis=1)[:, None]
        towards = centre[two] - start[one]
        towards /= np.linalg.norm(towards, axis=1)[:, None]
        two_sided = np.zeros((2, len(nodes)), dtype=bool)
        np.logical_or.at(two_sided[0], one, _cosines(towards, edge[one]) < _BEHIND)
        # the edge before a corner ends there
        at_end = np.zeros(len(nodes), dtype=bool)
        np.logical_or.at(at_end, one, _cosines(towards, other[one]) < _BEHIND)
        two_sided[1] = at_end[following]
        return cls(nodes, nodes[following], following, normals, start, edge, two_sided)

    @property
    def middles(self) -> Array:
        """Middles of the edges, (n, 3), m."""
        return self.start + 0.5 * self.edge

    @property
    def mean_normals(self) -> Array:
        """Unit normals at the middles of the edges, (n, 3), across the edge."""
        mean = self.normals + self.normals[self.back]
        mean -= (_dot(mean, self.edge) / _dot(self.edge, self.edge))[:, None] * self.edge
        return np.asarray(mean / np.linalg.norm(mean, axis=1)[:, None])

    def rises(self) -> Array:
        """How far the surface is from the middles of the edges, along the normal, (n,), m; of an edge between two
        facets that is smooth, the mean of both."""
        at_start, at_end = -_dot(self.normals, self.edge), _dot(self.normals[self.back], self.edge)
        first, second = self.two_sided
        at_start, at_end = np.where(second & ~first, at_end, at_start), np.where(first & ~second, at_start, at_end)
        rise = (at_start + at_end) / 8
        ends = np.sort(np.stack([self.nodes, self.following], axis=1), axis=1)
        label = np.unique(ends, axis=0, return_inverse=True)[1].ravel()
        mean = np.bincount(label, rise) / np.bincount(label)
        # two facets at an edge of the part have normals of their own
        opposed = np.zeros((len(mean), 3))
        np.add.at(opposed, label, self.mean_normals)
        smooth = np.linalg.norm(opposed, axis=1) > np.cos(CREASE / 2) * np.bincount(label)
        return np.asarray(np.where(smooth[label], mean[label], rise))


def _around(nodes: Index, facet: Array) -> tuple[Index, Index]:
    """Pairs of corners at one node whose facets, with unit normals (n, 3), belong to one smooth surface."""
    n = len(nodes)
    at = sp.csr_array((np.ones(n), (np.arange(n), nodes)))
    pairs = sp.coo_array(at @ at.T)
    one, two = pairs.coords
    smooth = _dot(facet[one], facet[two]) > np.cos(CREASE)
    return one[smooth].astype(np.int64), two[smooth].astype(np.int64)


def _dot(one: Array, other: Array) -> Array:
    return np.asarray(np.einsum("ni,ni->n", one, other))


def _cosines(unit: Array, vector: Array) -> Array:
    return np.asarray(_dot(unit, vector) / np.linalg.norm(vector, axis=1))
