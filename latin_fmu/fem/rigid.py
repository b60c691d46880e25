"""Rigid motions of a mesh: their shapes, and the mass they carry.

A point x moves by t + theta x (x - c) with the mass centre c (small rotations). The rotations are taken as
theta * length, so that the six unknowns have one unit and the mass matrix is well scaled.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .elements import Elements
from .mesh import Array, Mesh


@dataclass(frozen=True)
class RigidBody:
    """Six motions of a mesh and their mass.

    Attributes
    ----------
    centre : (3,) mass centre, m. length : size that scales the rotations, m.
    modes : (3 n_node, 6) nodal displacements of three translations along x, y, z and of three rotations of
        1 / length about x, y, z. mass : (6, 6), kg: the consistent mass of the mesh on these motions, exactly.
    """

    centre: Array
    length: float
    modes: Array
    mass: Array

    def coordinates(self, translation: Array, rotation: Array) -> Array:
        """The six unknowns (6,) of a translation (3,) of the centre, m, and a rotation (3,), rad (or their rates)."""
        return np.concatenate([translation, rotation * self.length])


def rigid_body(mesh: Mesh, density: float) -> RigidBody:
    """Rigid motions of a mesh of uniform density, kg m-3."""
    found = list(Elements(mesh).points(of_products=True))
    points = np.concatenate([(p.values @ mesh.nodes[p.cells]).reshape(-1, 3) for _, p in found])
    weights = density * np.concatenate([p.volumes.ravel() for _, p in found])
    total = float(weights.sum())
    centre = weights @ points / total
    length = float(mesh.extent().max())
    at_points = rigid_modes(points, centre, length).reshape(-1, 3, 6)
    mass = np.einsum("q,qia,qib->ab", weights, at_points, at_points)
    return RigidBody(centre, length, rigid_modes(mesh.nodes, centre, length), 0.5 * (mass + mass.T))


def rigid_modes(points: Array, centre: Array, length: float) -> Array:
    """Displacements (3 n_point, 6) of points (n_point, 3) in the six motions of ``RigidBody``."""
    arm = (points - centre) / length
    modes = np.zeros((len(points), 3, 6))
    modes[:, :, :3] = np.eye(3)
    for axis in range(3):
        modes[:, :, 3 + axis] = np.cross(np.eye(3)[axis], arm)
    return modes.reshape(-1, 6)
