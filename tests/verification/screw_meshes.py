"""Meshes of screws and the parts they clamp, all of them bodies of revolution or blocks with round holes (needs gmsh).

Every part is meshed for itself, as parts of a CAD assembly are: nodes of neighbours do not match.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

Profile = Sequence[tuple[float, float]]
Chosen = Callable[[float, float, float], bool]


@dataclass(frozen=True)
class Part:
    """A part of an assembly, lengths in mm.

    Attributes
    ----------
    profile : corners (r, z) of a body of revolution about the z axis through ``centre``; of the hole of a block where
        there is one. block : lower corner and lengths of a block with that hole, without any where the profile is
        empty. faces : by name, no two alike in a file, which ones by half their width, the height of their centre of
        mass and their extent in height. centre : (x, y) of the axis. more : centres of further holes
        of the same profile.
    """

    profile: Profile = ()
    block: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None
    faces: Mapping[str, Chosen] = field(default_factory=dict)
    centre: tuple[float, float] = (0.0, 0.0)
    more: tuple[tuple[float, float], ...] = ()


def write(file: Path, parts: Mapping[str, Part], size: float, order: int = 2, curvature: int = 12) -> Path:
    """Mesh the parts with edges of ``size``, mm, ``curvature`` around a circle at least, and write them."""
    gmsh: Any = pytest.importorskip("gmsh")
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        for name, part in parts.items():
            volume = _volume(gmsh, part)
            gmsh.model.occ.synchronize()
            gmsh.model.addPhysicalGroup(3, [volume], name=name)
            for face, chosen in part.faces.items():
                tags = [
                    tag for _, tag in gmsh.model.getBoundary([(3, volume)], oriented=False) if _is(gmsh, tag, chosen)
                ]
                assert tags, (name, face)
                gmsh.model.addPhysicalGroup(2, tags, name=face)
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        gmsh.option.setNumber("Mesh.MeshSizeMin", 0.2 * size)
        gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", curvature)
        gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 1)
        gmsh.option.setNumber("Mesh.HighOrderOptimize", 1 if order > 1 else 0)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(order)
        gmsh.option.setNumber("Mesh.MshFileVersion", 2.2)
        gmsh.option.setNumber("Mesh.Binary", 1)
        gmsh.write(str(file))
    finally:
        gmsh.finalize()
    return file


def _is(gmsh: Any, tag: int, chosen: Chosen) -> bool:
    z = gmsh.model.occ.getCenterOfMass(2, tag)[2]
    box = gmsh.model.getBoundingBox(2, tag)
    radius = max(box[3] - box[0], box[4] - box[1]) / 2.0
    return chosen(radius, z, box[5] - box[2])


def _volume(gmsh: Any, part: Part) -> int:
    """The volume of a part."""
    occ = gmsh.model.occ
    turned = [_turned(occ, part.profile, place) for place in (part.centre, *part.more)] if part.profile else []
    if part.block is None:
        return int(turned[0][1])
    box = (3, occ.addBox(*part.block[0], *part.block[1]))
    return int(occ.cut([box], turned)[0][0][1]) if turned else int(box[1])


def _turned(occ: Any, profile: Profile, centre: tuple[float, float]) -> tuple[int, int]:
    """A profile turned about the axis."""
    points = [occ.addPoint(centre[0] + r, centre[1], z) for r, z in profile]
    lines = [occ.addLine(a, b) for a, b in zip(points, [*points[1:], points[0]], strict=True)]
    surface = occ.addPlaneSurface([occ.addCurveLoop(lines)])
    made = occ.revolve([(2, surface)], *centre, 0.0, 0.0, 0.0, 1.0, 6.283185307179586)
    return next((dim, tag) for dim, tag in made if dim == 3)
