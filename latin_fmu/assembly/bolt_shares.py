"""Bolts cut by planes of symmetry: the share of the whole screw that is modelled.

A plane of symmetry along the axis leaves one half of a screw, two planes that meet in the axis at the angle phi leave
phi / 2 pi. The force of a bolt is that of the modelled part. Torque, thread and yield force are those of the whole
screw:

    F = share T / (K d),      stress = F / (share A_s)
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from typing import Final

import numpy as np

from ..errors import Problems
from ..fem.mesh import Array, Index
from ..scene.boundaries import AXES, Fixed, Symmetry
from ..scene.fields import split_face
from ..scene.schema import Scene
from .body import Body

_FLAT: Final = 1e-6  # deviation of normals from one, and of the axis from a plane along it
_ON_PLANE: Final = 1e-6  # of the size of the body
_LARGEST_DENOMINATOR: Final = 48


def share_of(name: str, scene: Scene, body: Body, axis: Array, section: Index, problems: Problems) -> float:
    """Share of the screw that is modelled: as given, or from the planes of symmetry along the axis.

    Parameters
    ----------
    name : of the bolt. axis : (3,) unit vector. section : nodes of the cut.
    """
    bolt = scene.bolt[name]
    if bolt.share is not None:
        return bolt.share
    planes = list(_planes(scene, body, axis, section))
    if not planes:
        return 1.0
    if len(planes) == 1:
        return 0.5
    # parallel planes on both sides of a shank do not contain its axis, and three do not meet in one
    cosine = float(planes[0] @ planes[1])
    if len(planes) == 2 and abs(cosine) < 1.0 - _FLAT:
        # outward normals: the angle between the planes inside of the body
        return float(np.arccos(-cosine) / (2.0 * np.pi))
    if bolt.torque is not None or bolt.thread is not None:
        problems.add(
            f"bolt.{name}.share",
            f"{len(planes)} faces of symmetry cut the shank along its axis and do not meet in it: the share of the "
            "screw that is modelled does not follow",
            None,
            "more than 0, up to 1",
            "give share (1/2 is 0.5): torque and thread are those of the whole screw",
        )
    return 1.0


def _planes(scene: Scene, body: Body, axis: Array, section: Index) -> Iterator[Array]:
    """Outward normals (3,) of the planes of symmetry along the axis that nodes of the section are on, each once."""
    found: list[Array] = []
    for boundary in scene.boundaries_of(body.name).values():
        if not isinstance(boundary, Symmetry | Fixed):
            continue
        face = body.face(split_face(boundary.face)[1])
        normal = face.normals[0]
        if np.abs(face.normals @ normal - 1.0).max() > _FLAT or abs(float(normal @ axis)) > _FLAT:
            continue
        if isinstance(boundary, Fixed) and not _along(boundary, normal):
            continue
        away = np.abs((body.mesh.nodes[section] - body.mesh.nodes[face.nodes[0]]) @ normal)
        # an edge of the section, not one point of it
        if (away <= _ON_PLANE * body.mesh.size).sum() < 2:
            continue
        if all(float(normal @ other) < 1.0 - _FLAT for other in found):
            found.append(normal)
            yield normal


def _along(boundary: Fixed, normal: Array) -> bool:
    """Whether a fixed face is held along its normal alone, as a plane of symmetry is."""
    if boundary.axes is not None or len(boundary.components) != 1:
        return False
    return abs(abs(float(normal[AXES.index(boundary.components[0])])) - 1.0) <= _FLAT


def fraction(share: float) -> str:
    """A share in words, as 1/2."""
    near = Fraction(share).limit_denominator(_LARGEST_DENOMINATOR)
    if abs(float(near) - share) < _FLAT:
        return str(near)
    return f"{share:.4g}"
