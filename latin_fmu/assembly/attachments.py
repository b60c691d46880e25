"""Point masses on substructures: their places on the meshes, and their mass matrices.

With T the motion of the place and R the rotation of the mean motion of its face (``fem.location.MeanMotion``) the
kinetic energy of a mass m with the moments of inertia J gives

    M = m T^T T + R^T J R

A mass spread evenly over a face has its share of it at every node.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from ..errors import Problems
from ..fem.location import MeanMotion
from ..fem.mesh import Array, Index
from ..propagator.model import diagonal_matrix
from ..scene.attachments import Place, PointMass
from ..scene.fields import split_face
from ..scene.schema import Scene
from .body import AddedMass, Body, located

_NONE: Index = np.zeros(0, dtype=np.int64)


def with_masses(scene: Scene, bodies: dict[str, Body], problems: Problems) -> dict[str, Body]:
    """The bodies with the point masses of the scene; points outside their bodies are added to ``problems``."""
    added: dict[str, list[AddedMass]] = {}
    for name, mass in scene.point_mass.items():
        body = bodies[mass.body]
        made = _spread(body, mass) if mass.spread else _at_place(body, mass, f"point_mass.{name}", problems)
        if made is not None:
            added.setdefault(mass.body, []).append(made)
    return {n: replace(b, added=_sum(added[n])) if n in added else b for n, b in bodies.items()}


def motion_of(body: Body, place: Place, where: str, problems: Problems) -> tuple[Array, MeanMotion] | None:
    """Point (3,), m, of a place and the motion that it follows; None, with a problem at the key ``where``, where the
    point is outside the body."""
    if place.face is not None:
        motion = MeanMotion.of_face(body.mesh.nodes, body.face(split_face(place.face)[1]))
        return motion.centre if place.point is None else np.asarray(place.point, dtype=float), motion
    point = np.asarray(place.point, dtype=float)
    location = located(body, point, f"{where}.point", problems)
    return None if location is None else (point, MeanMotion.of_point(point, location, body.mesh.n_node))


def _spread(body: Body, mass: PointMass) -> AddedMass:
    """A mass spread evenly over a face."""
    face = body.face(split_face(str(mass.face))[1])
    nodal = np.zeros(body.mesh.n_node)
    nodal[face.nodes] = mass.mass * face.positive_areas / face.positive_areas.sum()
    lumped = np.repeat(nodal, 3)
    return AddedMass(diagonal_matrix(lumped), lumped, _NONE)


def _at_place(body: Body, mass: PointMass, where: str, problems: Problems) -> AddedMass | None:
    """A mass at a point of the body, or of an arm on a face."""
    place = motion_of(body, mass, where, problems)
    if place is None:
        return None
    at = place[1].at(place[0])
    matrix = sp.csr_array(mass.mass * (at.T @ at))
    lumped, rotation = np.zeros(body.full_size()), place[1].rotation
    if rotation is None:
        weights = np.maximum(at.sum(axis=0), 0.0)  # functions of quadratic cells have negative values
        return AddedMass(matrix, 3.0 * mass.mass * weights / weights.sum(), _NONE)
    if mass.inertia is not None:
        matrix = sp.csr_array(matrix + rotation.T @ sp.diags_array(np.asarray(mass.inertia)) @ rotation)
    return AddedMass(matrix, lumped, np.unique(at.indices // 3).astype(np.int64))


def _sum(masses: list[AddedMass]) -> AddedMass:
    """All masses of one body."""
    matrix = sp.csr_array(sum((m.matrix for m in masses[1:]), masses[0].matrix))
    matrix.sort_indices()
    matrix.indices, matrix.indptr = matrix.indices.astype(np.int64), matrix.indptr.astype(np.int64)
    lumped: Array = np.sum([m.lumped for m in masses], axis=0)
    return AddedMass(matrix, lumped, np.unique(np.concatenate([m.arms for m in masses])))
