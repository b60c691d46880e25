"""Faces of bodies as their loads see them, `scene.load_kinds.LoadedFace`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..fem.faces import Face
from ..fem.location import MeanMotion
from ..latin.assembly import Array
from ..scene.fields import ALL_OF_IT, split_face
from .body import Body


def _with_points(body: Body, name: str) -> Face:
    """A face with the edges and points of its name, which have no area."""
    nodes = body.nodes_of(name)
    areas, vector_areas = np.zeros(len(nodes)), np.zeros((len(nodes), 3))
    if name in body.mesh.faces:
        facets = body.face(name)
        rows = np.searchsorted(nodes, facets.nodes)
        areas[rows], vector_areas[rows] = facets.areas, facets.vector_areas
    return Face(nodes, areas, vector_areas)


@dataclass(frozen=True)
class BodyFace:
    """A face of a body.

    Attributes
    ----------
    places : (n_node, 3) nodes of the whole body, m. face : nodes and areas of the face; edges and points of its name
    have no area. node_area : around the nodes, m2: as many shares of the whole boundary.

    Examples
    --------
    >>> from latin_fmu.assembly.body import build_bodies
    >>> from latin_fmu.errors import Problems
    >>> scene = latin_fmu.load_scene("models/two_specimen_crushing/scene.toml")
    >>> load = next(iter(scene.loads.values()))
    >>> face = BodyFace.of(build_bodies(scene, Problems()), load.face)
    >>> load.nodal_forces(face).shape == face.points.shape
    True
    """

    places: Array
    face: Face
    node_area: float

    @staticmethod
    def of(bodies: Mapping[str, Body], face: str) -> BodyFace:
        """The face ``"substructure.face"`` of one of the bodies."""
        name, face_part = split_face(face)
        body = bodies[name]
        whole = body.face(ALL_OF_IT)
        if face_part in body.mesh.points:
            found = _with_points(body, face_part)
        else:
            found = body.face(face_part)
        share = float(whole.areas.sum()) / len(whole.nodes)
        return BodyFace(body.mesh.nodes, found, share * len(found.nodes))

    @property
    def points(self) -> Array:
        """Nodes (n, 3), m."""
        return self.places[self.face.nodes]

    @property
    def areas(self) -> Array:
        """int psi_a dA (n,), m2."""
        return self.face.areas

    @property
    def vector_areas(self) -> Array:
        """int psi_a n dA (n, 3), m2, n outwards."""
        return self.face.vector_areas

    @property
    def area(self) -> float:
        """Sum of the areas, m2."""
        return float(self.face.areas.sum())

    @property
    def centre(self) -> Array:
        """Mean place by area (3,), m."""
        return MeanMotion.of_face(self.places, self.face).centre

    def couple(self, moment: Sequence[float]) -> Array:
        """Nodal forces (n, 3), N, without resultant that have this moment (3,), N m: those of the mean motion."""
        rotation = MeanMotion.of_face(self.places, self.face).rotation
        assert rotation is not None  # of a face
        forces: Array = (rotation.T @ np.asarray(moment)).reshape(-1, 3)[self.face.nodes]
        return forces
