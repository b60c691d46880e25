"""The visible surface of a body as coloured facets and their edges; the orthographic view."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ..fem.mesh import Array, Index, Mesh, boundary

_SHARP: Final = np.cos(np.radians(30.0))  # facets that meet at a larger angle make an edge of the body
_LIGHT: Final = (-0.35, 0.55, 0.76)  # from the left and above, or below where the viewer is below (right, up, viewer)
_AMBIENT: Final = 0.55


@dataclass(frozen=True)
class Skin:
    """Facets of a body.

    Attributes
    ----------
    points : (n_point, 3), m. facets : (n_facet, 4) corners, the last one twice for triangles.
    colours : (n_facet, 3) red, green, blue between 0 and 1, without light.
    """

    points: Array
    facets: Index
    colours: Array

    def moved(self, shift: Array) -> Skin:
        """The body translated or deformed; ``shift`` is (3,) or (n_point, 3), m."""
        return replace(self, points=self.points + shift)

    def painted(self, nodes: Index, colour: Array) -> Skin:
        """The body with facets in ``colour`` (3,) whose corners are all among ``nodes``."""
        chosen = np.zeros(len(self.points), dtype=bool)
        chosen[nodes] = True
        inside = np.all(chosen[self.facets], axis=1, keepdims=True)
        return replace(self, colours=np.where(inside, colour, self.colours))

    def normals(self) -> Array:
        """Outward unit normals (n_facet, 3)."""
        a, b, c, d = (self.points[self.facets[:, i]] for i in range(4))
        normal = np.cross(c - a, d - b)
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        unit: Array = normal / np.where(length > 0, length, 1.0)
        return unit


def skin_of(mesh: Mesh, colour: Array) -> Skin:
    """Boundary of a mesh in one colour (curved facets are drawn by their corners)."""
    tables = [block.corners for block in boundary(mesh).blocks]
    facets = np.concatenate([t if t.shape[1] == 4 else np.column_stack([t, t[:, 2]]) for t in tables])
    return Skin(mesh.nodes, facets, np.tile(np.asarray(colour, dtype=float), (len(facets), 1)))


@dataclass(frozen=True)
class View:
    """Orthographic view: unit vectors to the right, up, and towards the viewer, (3,) each."""

    right: Array
    up: Array
    viewer: Array

    @staticmethod
    def at(azimuth: float, elevation: float) -> View:
        """The viewer in a direction given by angles in degrees: azimuth from x about z, elevation above the plane."""
        a, e = np.radians(azimuth), np.radians(elevation)
        viewer = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
        right = np.array([-np.sin(a), np.cos(a), 0.0])
        return View(right, np.cross(viewer, right), viewer)

    def project(self, points: Array) -> Array:
        """Coordinates (n, 2) to the right and up."""
        flat: Array = points @ np.stack([self.right, self.up], axis=1)
        return flat

    def lit(self, skin: Skin) -> Array:
        """Colours of the facets (n_facet, 3) with light from the left."""
        side = 1.0 if self.viewer[2] >= 0 else -1.0
        light = np.array([1.0, side, 1.0]) * _LIGHT @ np.stack([self.right, self.up, self.viewer])
        shade = _AMBIENT + (1.0 - _AMBIENT) * np.clip(skin.normals() @ light / np.linalg.norm(_LIGHT), 0.0, 1.0)
        return np.clip(skin.colours * shade[:, None], 0.0, 1.0)


def edges_of(skin: Skin, view: View) -> tuple[Index, Array]:
    """Edges of the facets that face the viewer, (n_edge, 2), and the weight of their lines.

    1: sharp edges and outlines of the body; 0.25: edges of the mesh.
    """
    facets, normals = skin.facets, skin.normals()
    pairs = np.concatenate([facets[:, [i, (i + 1) % 4]] for i in range(4)])
    owner = np.tile(np.arange(len(facets)), 4)
    real = pairs[:, 0] != pairs[:, 1]
    pairs, owner = np.sort(pairs[real], axis=1), owner[real]
    edges, first, inverse = np.unique(pairs, axis=0, return_index=True, return_inverse=True)
    inverse = inverse.ravel()
    last = np.zeros(len(edges), dtype=np.int64)
    last[inverse] = owner  # the other facet of an edge that two facets share
    one, other = owner[first], last
    front = normals @ view.viewer > 0
    sharp = np.einsum("ei,ei->e", normals[one], normals[other]) < _SHARP
    outline = front[one] != front[other]
    seen = front[one] | front[other]
    return edges[seen], np.where((sharp | outline | (one == other))[seen], 1.0, 0.25)
