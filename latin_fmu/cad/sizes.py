"""Sizes of the edges of a mesh, and the field that hands them to gmsh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from .facts import Array

_NONE = 1e22  # a size that limits nothing, mm


@dataclass(frozen=True)
class PressedZone:
    """A cylinder about a screw, within which contact faces have smaller edges.

    Attributes
    ----------
    centre, half : (3,) its middle, and half of it along the axis, mm. radius, size : mm.
    """

    centre: Sequence[float]
    half: Array
    radius: float
    size: float


@dataclass
class Sizes:
    """Edges of parts by volume and of faces, mm; of the ``flat`` contact faces within ``pressed``."""

    volumes: dict[int, float] = field(default_factory=dict)
    faces: dict[int, float] = field(default_factory=dict)
    flat: list[int] = field(default_factory=list)
    pressed: list[PressedZone] = field(default_factory=list)


def set_sizes(gmsh: Any, sizes: Sizes, floor: float) -> None:
    """Hand the sizes to the library as a field; no edge is below ``floor`` times the largest of a part, but those that
    are given."""
    fields = gmsh.model.mesh.field
    for old in fields.list():
        fields.remove(old)
    least = [
        *_constant(gmsh, "VolumesList", sizes.volumes, boundary=False),
        *_constant(gmsh, "SurfacesList", sizes.faces, boundary=True),
        *(_pressed(gmsh, zone, sizes.flat) for zone in sizes.pressed if sizes.flat),
    ]
    smallest = fields.add("Min")
    fields.setNumbers(smallest, "FieldsList", least)
    fields.setAsBackgroundMesh(smallest)
    every = [*sizes.volumes.values(), *sizes.faces.values(), *(zone.size for zone in sizes.pressed)]
    for key, value in (
        ("MeshSizeFromCurvature", 0),
        ("MeshSizeExtendFromBoundary", 0),
        ("MeshSizeMin", min([*every, floor * max(sizes.volumes.values())])),
        ("MeshSizeMax", max(every)),
        ("Algorithm", 6),
        ("Algorithm3D", 1),
        ("ElementOrder", 1),
        ("SecondOrderLinear", 0),
        ("HighOrderOptimize", 0),
    ):
        gmsh.option.setNumber(f"Mesh.{key}", value)


def _constant(gmsh: Any, key: str, table: dict[int, float], boundary: bool) -> list[int]:
    """A field for each size of volumes or faces, and of what bounds them."""
    by_size: dict[float, list[int]] = {}
    for tag, size in table.items():
        by_size.setdefault(float(f"{size:.6g}"), []).append(tag)
    numbers = []
    for size, tags in sorted(by_size.items()):
        number = gmsh.model.mesh.field.add("Constant")
        gmsh.model.mesh.field.setNumber(number, "VIn", size)
        gmsh.model.mesh.field.setNumbers(number, key, sorted(tags))
        gmsh.model.mesh.field.setNumber(number, "IncludeBoundary", int(boundary))
        numbers.append(number)
    return numbers


def _pressed(gmsh: Any, zone: PressedZone, faces: Sequence[int]) -> int:
    """A field for the edges of faces within a cylinder."""
    fields = gmsh.model.mesh.field
    inside = fields.add("Cylinder")
    values = {"VIn": zone.size, "VOut": _NONE, "Radius": zone.radius}
    for axis, letter in enumerate("XYZ"):
        values |= {f"{letter}Axis": float(zone.half[axis]), f"{letter}Center": float(zone.centre[axis])}
    for key, value in values.items():
        fields.setNumber(inside, key, value)
    on_faces = int(fields.add("Restrict"))
    fields.setNumber(on_faces, "InField", inside)
    fields.setNumbers(on_faces, "SurfacesList", list(faces))
    return on_faces
