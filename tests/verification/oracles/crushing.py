"""Reference transients of the crushing of two specimens (quarter model), bonded or in frictional contact.

Lower block on a frictionless wall, upper block under a half-sine pressure; 10 mm cubes of n^3 bricks. Same
matrices, same HHT scheme and, for ``in_contact``, the same law of contact as the package; other algorithms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .contact_march import Body, ContactFace, ContactMarch, march_contact
from .hexahedra import Array, Block, Index, Solid, merged
from .monolithic import LinearSystem, March, Scheme, march

SIDE, PRESSURE, PULSE = 0.01, 200e6, 10e-6  # m, Pa, s
ALUMINIUM, STEEL = (70e9, 0.3, 2700.0), (210e9, 0.3, 7800.0)


@dataclass(frozen=True)
class Model:
    """n elements per edge, ``instants`` steps of ``step`` seconds."""

    n: int
    instants: int
    step: float = 0.15e-6

    @property
    def time(self) -> Array:
        """All instants, the first at 0, s."""
        return np.linspace(0.0, self.instants * self.step, self.instants + 1)

    def block(self, bottom: float, material: tuple[float, float, float]) -> Block:
        """One cube with its bottom at the given height."""
        return Block((0.0, 0.0, bottom), (SIDE, SIDE, SIDE), (self.n, self.n, self.n), *material)

    def system(self, solid: Solid, on_wall: bool) -> LinearSystem:
        """The solid between its planes of symmetry, on the wall or not."""
        held = [3 * solid.on_plane(0, 0.0), 3 * solid.on_plane(1, 0.0) + 1]
        if on_wall:
            held.append(3 * solid.on_plane(2, 0.0) + 2)
        fixed = np.unique(np.concatenate(held))
        return LinearSystem(solid.mass, None, solid.stiffness, fixed, self.step, Scheme.hht())

    def loads(self, solid: Solid) -> Array:
        """The pressure on the top at z = 2 sides, as nodal forces (n_time, n_dof)."""
        pulse = np.where(self.time < PULSE * (1 - 1e-12), np.sin(np.pi * self.time / PULSE), 0.0)
        top = solid.on_plane(2, 2 * SIDE)
        force = np.zeros((len(self.time), solid.n_dof))
        force[:, 3 * top + 2] = -PRESSURE * np.outer(pulse, solid.face_areas(top))
        return force


def bonded(model: Model) -> tuple[Solid, March]:
    """One merged mesh: what a perfect interface must give."""
    solid = merged([model.block(0.0, ALUMINIUM), model.block(SIDE, STEEL)])
    return solid, march(model.system(solid, on_wall=True), model.loads(solid))


def in_contact(model: Model, friction: float) -> tuple[Array, ContactMarch]:
    """Coordinates of the contact points and the march; force and gap are those of face 0."""
    lower, upper = merged([model.block(0.0, ALUMINIUM)]), merged([model.block(SIDE, STEEL)])
    faces: tuple[Index, Index] = (lower.on_plane(2, SIDE), upper.on_plane(2, SIDE))
    count = len(faces[0])
    normals = np.tile([0.0, 0.0, 1.0], (count, 1))
    still = np.zeros((len(model.time), lower.n_dof))
    bodies = [
        Body(model.system(solid, wall), loads, np.zeros(solid.n_dof), np.zeros(solid.n_dof))
        for solid, wall, loads in ((lower, True, still), (upper, False, model.loads(upper)))
    ]
    face = ContactFace((0, 1), faces, normals, np.zeros(count), friction)
    return lower.nodes[faces[0]], march_contact(bodies, [face])
