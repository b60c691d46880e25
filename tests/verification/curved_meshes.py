"""Meshes of a flat block and of one whose face is curved, refined towards a contact between them, nodes opposite.

The curved face of the upper block follows z = s(x, y); the flat one of the lower block is z = 0. Both are files with
the named groups ``surface`` (towards the other), ``back``, ``xmin``, ``xmax``, ``ymin`` and ``ymax``.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import meshio
import numpy as np

Array = np.ndarray


def about_zero(element: float, fine: int, far: float, growth: float) -> Array:
    """Coordinates from -far to far: 2 ``fine`` equal elements in the middle, growing ones outside."""
    outside = outwards(element * growth, far - fine * element, growth)
    half = np.concatenate([element * np.arange(fine + 1), fine * element + outside[1:]])
    return np.concatenate([-half[:0:-1], half])


def outwards(element: float, far: float, growth: float) -> Array:
    """Coordinates from 0 to far, the first element about as long as requested, each longer than the one before."""
    steps = [element]
    while sum(steps) < far:
        steps.append(growth * steps[-1])
    return np.concatenate([[0.0], np.cumsum(steps)]) * far / sum(steps)


def write_block(file: Path, x: Array, y: Array, z: Array, surface: Callable[[Array, Array], Array] | None) -> None:
    """A block of hexahedra; the lattice x, y, z (z from 0 up or down) is moved by ``surface`` at z = 0, less and less
    towards its back."""
    places = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1)
    if surface is not None:
        near = 1.0 - np.abs(places[..., 2]) / np.abs(z).max()
        places[..., 2] += near * surface(places[..., 0], places[..., 1])
    number = np.arange(places[..., 0].size).reshape(places.shape[:3])
    corners = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
    cells = np.stack(
        [number[i : i - 1 or None, j : j - 1 or None, k : k - 1 or None].ravel() for i, j, k in corners], axis=1
    )
    front, back = (0, -1) if z[0] == 0.0 else (-1, 0)
    planes = {"surface": number[:, :, front], "back": number[:, :, back], "ymin": number[:, 0], "ymax": number[:, -1]}
    planes |= {"xmin": number[0], "xmax": number[-1]}
    quads = {
        name: np.stack([p[:-1, :-1], p[1:, :-1], p[1:, 1:], p[:-1, 1:]], axis=-1).reshape(-1, 4)
        for name, p in planes.items()
    }
    tags = {name: i + 2 for i, name in enumerate(quads)}
    marks = [*(np.full(len(q), tags[n]) for n, q in quads.items()), np.ones(len(cells), dtype=np.int64)]
    mesh = meshio.Mesh(
        places.reshape(-1, 3),
        [*(("quad", q) for q in quads.values()), ("hexahedron", cells)],
        cell_data={"gmsh:physical": marks, "gmsh:geometrical": marks},
        field_data={"body": np.array([1, 3]), **{n: np.array([t, 2]) for n, t in tags.items()}},
    )
    meshio.write(file, mesh, file_format="gmsh22", binary=False)
