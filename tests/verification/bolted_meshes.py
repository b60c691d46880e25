"""Meshes of bolted plates on one lattice of rings and layers about the z axis, so that nodes of neighbours match.

The lattice is a square core of cells, rings from there to the circle of the shank, and circular rings beyond it. A part
is made of the cells between two radii in some layers; its faces are the pieces of its boundary, distinguished by their
normal and their place.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from latin_fmu.fem.mesh import FacetSet, Mesh, boundary
from latin_fmu.stability.surfaces import write_mesh

Array = np.ndarray
_CORE = 0.55  # half the side of the core over the radius of the shank
_CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))


def shank_radius(area: float, n_core: int) -> float:
    """Radius of the corners of the polygon with 4 n_core sides that has this area."""
    angle = 2 * np.pi / (4 * n_core)
    return float(np.sqrt(area / (2 * n_core * np.sin(angle))))


@dataclass(frozen=True)
class Lattice:
    """Lattice of rings: ``radii`` of the circles, the first one that of the shank; ``heights`` of the layers.

    centre : (2,) of the circles. n_core : cells along the side of the core. n_first : rings from there to the shank.
    """

    radii: Sequence[float]
    heights: Sequence[float]
    centre: tuple[float, float] = (0.0, 0.0)
    n_core: int = 4
    n_first: int = 1

    def part(
        self, places: Callable[[Array, Array], Array], faces: Mapping[str, Callable[[Array, Array], Array]]
    ) -> Mesh:
        """Mesh of the cells whose centres (radius, z) are in ``places``; faces by the centre (n, 3) and the normal of
        their facets (n, 3)."""
        flat, quads, reach = self._plane()
        z = np.asarray(self.heights)
        n_flat = len(flat)
        nodes = np.concatenate([np.column_stack([flat, np.full(n_flat, height)]) for height in z])
        cells = np.concatenate([np.hstack([quads + n_flat * i, quads + n_flat * (i + 1)]) for i in range(len(z) - 1)])
        middle = np.repeat(0.5 * (z[1:] + z[:-1]), len(quads))
        chosen = cells[places(np.tile(reach, len(z) - 1), middle)]
        used, numbered = np.unique(chosen, return_inverse=True)
        mesh = Mesh.uniform(nodes[used], "hexahedron", numbered.reshape(chosen.shape))
        skin = boundary(mesh).blocks[0].facets
        corners = mesh.nodes[skin]
        normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        centres = corners.mean(axis=1) - [*self.centre, 0.0]
        named = {name: FacetSet.of(skin[chosen(centres, normals)]) for name, chosen in faces.items()}
        return Mesh(mesh.nodes, mesh.blocks, named)

    def _plane(self) -> tuple[Array, Array, Array]:
        """Nodes (n, 2), quadrilaterals and their mean radii (of the circles; 0 in the core)."""
        n, r = self.n_core, self.radii[0]
        line = np.linspace(-1.0, 1.0, n + 1) * _CORE * r
        core = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
        number = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
        quads = [np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1).reshape(-1, 4)]
        ring = np.concatenate([number[:-1, 0], number[-1, :-1], number[:0:-1, -1], number[0, :0:-1]])
        angles = 2 * np.pi * np.arange(4 * n) / (4 * n) - 0.75 * np.pi
        circle = np.column_stack([np.cos(angles), np.sin(angles)])
        places, reach, count = [core], [np.zeros(n * n)], len(core)
        shares = np.arange(1, self.n_first + 1) / self.n_first
        rings = [(1 - s) * core[ring] + s * r * circle for s in shares] + [radius * circle for radius in self.radii[1:]]
        ends = [0.0, *([r] * self.n_first), *self.radii[1:]]
        ends[: self.n_first] = [0.0] * self.n_first
        for i, points in enumerate(rings):
            outer = count + np.arange(4 * n)
            quads.append(np.stack([ring, outer, np.roll(outer, -1), np.roll(ring, -1)], axis=-1))
            reach.append(np.full(4 * n, 0.5 * (ends[i] + ends[i + 1])))
            places.append(points)
            ring, count = outer, count + 4 * n
        return np.concatenate(places) + np.asarray(self.centre), np.concatenate(quads), np.concatenate(reach)


SHANK_AREA = 5000.0 / 110.2e6
"""Section of the shank, m2."""


def write_joint(folder: Path) -> dict[str, Path]:
    """Two plates of 10 mm under head and nut of one bolt: files ``bolt`` with its nut, ``lower``, ``upper``; and
    ``screw`` and ``nut``, the same bolt in two parts.

    Faces: head and nut (under them), of the plates seat (opposite), joint (to the other plate, next to the bolt) and
    far (outside, away from the joint); thread between screw and nut.
    """
    r = shank_radius(SHANK_AREA, 4)
    heights = [-16e-3, -13e-3, -10e-3, -6.5e-3, -3e-3, 0.0, 3e-3, 6.5e-3, 10e-3, 12.5e-3, 15e-3]
    lattice = Lattice([r, 4.5e-3, 6.5e-3, 8e-3, 11e-3, 16e-3], heights)
    under_nut = {"nut": lambda x, n: (np.abs(x[:, 2] + 10e-3) < 1e-6) & (n[:, 2] > 0.9)}
    under_head = {"head": lambda x, n: (np.abs(x[:, 2] - 10e-3) < 1e-6) & (n[:, 2] < -0.9)}
    thread = {
        "thread": lambda x, n: (x[:, 2] < -10e-3) & (np.abs(n[:, 2]) < 0.1) & (np.hypot(x[:, 0], x[:, 1]) < r + 1e-6)
    }
    parts = {
        "bolt": lattice.part(
            lambda radius, z: (radius < r) | ((radius < 6.5e-3) & (np.abs(z) > 10e-3)), under_nut | under_head
        ),
        "screw": lattice.part(lambda radius, z: (radius < r) | ((radius < 6.5e-3) & (z > 10e-3)), under_head | thread),
        "nut": lattice.part(lambda radius, z: (radius > r) & (radius < 6.5e-3) & (z < -10e-3), under_nut | thread),
        "lower": lattice.part(lambda radius, z: (radius > 4.5e-3) & (z < 0) & (z > -10e-3), _plate(-1)),
        "upper": lattice.part(lambda radius, z: (radius > 4.5e-3) & (z > 0) & (z < 10e-3), _plate(1)),
    }
    files = {name: folder / f"{name}.msh" for name in parts}
    for name, mesh in parts.items():
        write_mesh(files[name], mesh)
    return files


def _plate(side: int) -> dict[str, Callable[[Array, Array], Array]]:
    def outside(x: Array, n: Array) -> Array:
        return np.asarray((np.abs(x[:, 2] - side * 10e-3) < 1e-6) & (side * n[:, 2] > 0.9))

    def radius(x: Array) -> Array:
        return np.hypot(x[:, 0], x[:, 1])

    return {
        "seat": lambda x, n: outside(x, n) & (radius(x) < 6.5e-3),
        "far": lambda x, n: outside(x, n) & (radius(x) > 10.5e-3),
        "joint": lambda x, n: (np.abs(x[:, 2]) < 1e-6) & (side * n[:, 2] < -0.9) & (radius(x) < 8e-3),
    }
