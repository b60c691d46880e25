"""Mesh of a bolted lap joint, every part with a mesh of its own; needs gmsh (``pip install "latin-fmu[meshes]"``).

    python models/lap_joint/lap_joint.py [FILE]

writes lap_joint.msh beside this script, in mm. Every part is extruded from a plane figure: hexahedra, and wedges where
the plane mesh has triangles.
"""

from __future__ import annotations

import sys
from pathlib import Path

import gmsh

HOLE, SHANK, WASHER, HEAD = 3.3, 3.0, 6.0, 5.0  # radii
LENGTH, WIDTH, EDGE = 40.0, 20.0, 10.0  # of a plate; from the hole to the end that lies on the other plate
PLATE, DISC, HEAD_HIGH, NUT_HIGH = 4.0, 1.6, 4.0, 5.0  # heights
LOWER_SIZE, UPPER_SIZE, WASHER_SIZE, BOLT_SIZE = 2.6, 2.0, 1.7, 1.5  # of elements


def plate(name: str, left: float, bottom: float, size: float) -> None:
    """A plate with the hole at the origin; its ends are ``NAME_left`` and ``NAME_right``."""
    occ = gmsh.model.occ
    outline = occ.addRectangle(left, -WIDTH / 2, bottom, LENGTH, WIDTH)
    hole = occ.addDisk(0, 0, bottom, HOLE, HOLE)
    figure = occ.cut([(2, outline)], [(2, hole)])[0]
    volumes = extruded(figure, PLATE, 2)
    part(name, volumes, size)
    for side, x in (("left", left), ("right", left + LENGTH)):
        faces = [t for t in boundary(volumes) if abs(gmsh.model.occ.getCenterOfMass(2, t)[0] - x) < 1e-6]
        gmsh.model.addPhysicalGroup(2, faces, name=f"{name}_{side}")


def washer() -> None:
    """A ring on the upper plate."""
    occ = gmsh.model.occ
    ring = occ.cut([(2, occ.addDisk(0, 0, PLATE, WASHER, WASHER))], [(2, occ.addDisk(0, 0, PLATE, HOLE, HOLE))])[0]
    part("washer", extruded(ring, DISC, 1), WASHER_SIZE)


def half_bolt(name: str, under: float, height: float) -> None:
    """Head or nut with its half of the shank, which ends at the cut z = 0: the face ``NAME_cut``."""
    occ = gmsh.model.occ
    core, ring = occ.addDisk(0, 0, under, SHANK, SHANK), occ.addDisk(0, 0, under, HEAD, HEAD)
    figures = occ.fragment([(2, ring)], [(2, core)])[0]
    head = extruded(figures, height, 2)
    inner = min((t for _, t in figures), key=lambda t: occ.getMass(2, t))
    shank = extruded([(2, inner)], -under, max(2, round(abs(under) / 2.0)))
    volumes = [*head, *shank]
    part(name, volumes, BOLT_SIZE)
    cut = [t for t in boundary(shank) if abs(occ.getCenterOfMass(2, t)[2]) < 1e-6]
    gmsh.model.addPhysicalGroup(2, cut, name=f"{name}_cut")


def extruded(figures: list[tuple[int, int]], height: float, layers: int) -> list[int]:
    """Volumes over plane figures."""
    found = gmsh.model.occ.extrude(figures, 0, 0, height, [layers], recombine=True)
    gmsh.model.occ.synchronize()
    return [tag for dim, tag in found if dim == 3]


def part(name: str, volumes: list[int], size: float) -> None:
    """A volume group, its elements of a size."""
    gmsh.model.addPhysicalGroup(3, volumes, name=name)
    entities = [(3, v) for v in volumes]
    gmsh.model.mesh.setSize(gmsh.model.getBoundary(entities, combined=False, recursive=True), size)
    for dim, tag in gmsh.model.getBoundary(entities, combined=False, oriented=False):
        gmsh.model.mesh.setRecombine(dim, tag)


def boundary(volumes: list[int]) -> list[int]:
    """Faces around volumes, those between them left out."""
    return [t for _, t in gmsh.model.getBoundary([(3, v) for v in volumes], oriented=False)]


def main(path: Path) -> None:
    """Make the mesh and write it."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    plate("lower", -EDGE, -PLATE, LOWER_SIZE)
    plate("upper", EDGE - LENGTH, 0.0, UPPER_SIZE)
    washer()
    half_bolt("bolt", PLATE + DISC, HEAD_HIGH)
    half_bolt("nut", -PLATE, -NUT_HIGH)
    gmsh.option.setNumber("Mesh.Algorithm", 8)  # frontal for quadrangles
    gmsh.option.setNumber("Mesh.RecombinationAlgorithm", 1)  # blossom
    gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
    gmsh.model.mesh.generate(3)
    gmsh.write(str(path))
    gmsh.finalize()


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("lap_joint.msh"))
