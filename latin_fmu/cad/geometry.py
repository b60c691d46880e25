"""Solids of a CAD file by gmsh, in the process that is made for it: parts, round faces, what is left out.

gmsh has the licence GPL. It belongs to the extra ``meshes``, and no other module but those that run in that process
imports it.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from ..errors import MeshError
from .facts import Array, CadCylinder, CadPart, Triple, merged
from .labels import path_of
from .step_text import StepText

SUFFIXES: Final = (".step", ".stp", ".brep", ".iges", ".igs")
"""Suffixes of CAD files."""
WITHOUT_UNIT: Final = (".brep",)
_GRID: Final = 5  # places of a face along each of its parameters
ALONG: Final = 17
"""Places along an edge in the outline of a part."""
_ROUND: Final = 2e-3  # of the radius: from a cylinder at most
_LEAST_TURN: Final = 0.03


def start(gmsh: Any) -> None:
    """Start gmsh: silent, one thread, one seed, millimetres."""
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    for key, value in (
        ("General.Terminal", 0),
        ("General.NumThreads", 1),
        ("Mesh.MaxNumThreads1D", 1),
        ("Mesh.MaxNumThreads2D", 1),
        ("Mesh.MaxNumThreads3D", 1),
        ("Mesh.RandomSeed", 1),
        ("Geometry.OCCImportLabels", 1),
        ("Geometry.OCCBoundsUseStl", 0),
    ):
        gmsh.option.setNumber(key, value)
    gmsh.option.setString("Geometry.OCCTargetUnit", "MM")


def read_solids(gmsh: Any, path: Path, said: StepText) -> tuple[list[CadPart], list[str]]:
    """Parts of a file without names, and what is left out, in words.

    Raises
    ------
    MeshError : the library cannot read it; it holds no solids.
    """
    try:
        gmsh.model.occ.importShapes(str(path), highestDimOnly=False)
        gmsh.model.occ.synchronize()
    except Exception as error:  # the library raises plain exceptions
        what = f"cannot be read as CAD: {error}"
        raise MeshError.of("unreadable CAD", path.name, what, remedy="export it again as STEP (AP214, AP242)") from None
    solids = [tag for _, tag in gmsh.model.getEntities(3)]
    left = list(_left_out(gmsh))
    if not solids:
        holds = "; ".join(left) or "nothing"
        remedy = "export solids, or close its sheets in CAD"
        raise MeshError.of("unreadable CAD", path.name, "the file holds no solids", holds, remedy=remedy)
    return [part_of(gmsh, tag, said) for tag in solids], left


def _left_out(gmsh: Any) -> Iterator[str]:
    """Faces of no solid, edges of no face, points of no edge."""
    kinds = ((2, "sheet body", "sheet bodies"), (1, "wire", "wires"), (0, "point", "points"))
    for dim, one, many in kinds:
        names: dict[str, int] = {}
        for _, tag in gmsh.model.getEntities(dim):
            if len(gmsh.model.getAdjacencies(dim, tag)[0]) == 0:
                path = path_of(gmsh.model.getEntityName(dim, tag))
                label = path[-1] if path else "without a name"
                names[label] = names.get(label, 0) + 1
        if names:
            count = sum(names.values())
            shown = ", ".join(f"{n} of {name}" for name, n in sorted(names.items())[:4])
            yield f"{count} {one if count == 1 else many} ({shown}): no solid, left out"


def part_of(gmsh: Any, tag: int, said: StepText) -> CadPart:
    """A solid as a part without its name."""
    occ = gmsh.model.occ
    faces = [abs(f) for _, f in gmsh.model.getBoundary([(3, tag)], oriented=False)]
    areas = [float(occ.getMass(2, f)) for f in faces]
    edges = {abs(e) for _, e in gmsh.model.getBoundary([(2, f) for f in faces], combined=False, oriented=False)}
    path = path_of(gmsh.model.getEntityName(3, tag))
    box = occ.getBoundingBox(3, tag)
    *colour, opacity = (int(c) for c in gmsh.model.getColor(3, tag))
    rounds = [cylinder for face in faces if (cylinder := round_face(gmsh, face)) is not None]
    product = path[-1] if path else ""
    return CadPart(
        name="",
        path=path,
        number=tag,
        volume=float(occ.getMass(3, tag)),
        area=sum(areas),
        centre=_triple(occ.getCenterOfMass(3, tag)),
        low=_triple(box[:3]),
        high=_triple(box[3:]),
        colour=tuple(colour) if opacity else None,  # type: ignore[arg-type]
        cylinders=tuple(merged(rounds)),
        outline=np.concatenate([_along(gmsh, edge) for edge in sorted(edges)] or [np.zeros((0, 3))]),
        smallest=min(areas) ** 0.5,
        material=said.materials.get(product),
        density=said.densities.get(product),
        longest=max((float(occ.getMass(1, edge)) for edge in edges), default=0.0),
    )


def _triple(values: Any) -> Triple:
    x, y, z = (float(v) for v in values)
    return x, y, z


def _along(gmsh: Any, edge: int) -> Array:
    """Places (n, 3) along an edge."""
    low, high = gmsh.model.getParametrizationBounds(1, edge)
    return np.array(gmsh.model.getValue(1, edge, np.linspace(low[0], high[0], ALONG))).reshape(-1, 3)


def round_face(gmsh: Any, face: int) -> CadCylinder | None:
    """A face as a cylinder; None where it is none: its normals are at right angles to one axis and meet it at one
    distance, whatever surface the file draws it with."""
    if gmsh.model.getType(2, face) == "Plane":
        return None
    low, high = gmsh.model.getParametrizationBounds(2, face)
    u, v = (np.linspace(low[i], high[i], _GRID) for i in (0, 1))
    places = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).ravel()
    points = np.array(gmsh.model.getValue(2, face, places)).reshape(-1, 3)
    normals = np.array(gmsh.model.getNormal(face, places)).reshape(-1, 3)
    if not (np.isfinite(points).all() and np.isfinite(normals).all()):
        return None
    values, vectors = np.linalg.eigh(normals.T @ normals / len(normals))
    # a plane has one direction of normals, a cylinder two, anything else three
    if values[0] > _ROUND**2 or values[1] < _LEAST_TURN**2:
        return None
    axis = vectors[:, 0]
    axis = axis * np.sign(axis[np.abs(axis).argmax()]) + 0.0
    # points and normals across the axis: p = c + r n
    across = vectors[:, 1:]
    flat, towards = points @ across, normals @ across
    rows = np.zeros((2 * len(flat), 3))
    rows[0::2, 0] = rows[1::2, 1] = 1.0
    rows[:, 2] = towards.ravel()
    solution = np.linalg.lstsq(rows, flat.ravel(), rcond=None)[0]
    radius = float(solution[2])
    off = np.abs(rows @ solution - flat.ravel()).max()
    if abs(radius) < 1e-9 or off > _ROUND * abs(radius) + 1e-9:
        return None
    edges = [abs(e) for _, e in gmsh.model.getBoundary([(2, face)], oriented=False)]
    if edges:
        heights = np.concatenate([_along(gmsh, edge) for edge in edges]) @ axis
    else:
        heights = points @ axis
    length = float(np.ptp(heights))
    if length <= 0.0:
        return None
    turn = float(gmsh.model.occ.getMass(2, face)) / (2.0 * np.pi * abs(radius) * length)
    point = across @ solution[:2]
    return CadCylinder(
        _triple(axis),
        _triple(point),
        abs(radius),
        float(heights.min()),
        float(heights.max()),
        radius > 0.0,
        min(turn, 1.0),
        (face,),
    )
