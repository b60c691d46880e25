"""Mesh of an electronics box: tray, lid, circuit board, component, four standoffs, four screws; needs gmsh.

    python models/electronics_box/electronics_box.py [SIZE [FILE]]

writes electronics_box.msh beside this script, in mm: tetrahedra of second order, edges of at most SIZE (10), eight
around a circle. Parts that meet share their nodes. ``pip install "latin-fmu[meshes]"`` brings gmsh.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import gmsh

LENGTH, WIDTH, HEIGHT, WALL = 90.0, 60.0, 18.0, 3.0  # of the tray
PLACES = [(x, y) for x in (-36.0, 36.0) for y in (-21.0, 21.0)]  # of the screws
BOSS, STANDOFF, HOLE = 4.0, 3.5, 1.7  # radii of bosses of the tray and of standoffs; of the holes above
THREAD, NECK, HEAD = 1.5, 1.3, 3.0  # radii of a screw
FLOOR, GRIP, LOW = 3.0, (6.0, 8.0), 9.0  # heights: floor of the tray, ends of the engaged thread, top of the bosses
TOP, SEAT, ROOF, END = LOW + 1.6, 18.0, 20.0, 22.0  # of the board, of the standoffs, of the lid, of the heads
COMPONENT = (5.0, -4.0, 20.0, 16.0, 5.0)  # corner, lengths and height of the component on the board

Volumes = list[tuple[int, int]]


def cylinders(bottom: float, top: float, radius: float) -> Volumes:
    """Cylinders at the places of the screws."""
    return [(3, gmsh.model.occ.addCylinder(x, y, bottom, 0, 0, top - bottom, radius)) for x, y in PLACES]


def plate(length: float, width: float, bottom: float, top: float) -> Volumes:
    """A plate about the z axis."""
    return [(3, gmsh.model.occ.addBox(-length / 2, -width / 2, bottom, length, width, top - bottom))]


def parts() -> dict[str, int]:
    """The volumes by name; faces that two of them share are one."""
    occ = gmsh.model.occ
    cavity = plate(LENGTH - 2 * WALL, WIDTH - 2 * WALL, FLOOR, HEIGHT)
    tray = occ.cut(plate(LENGTH, WIDTH, 0, HEIGHT), cavity)[0]
    tray = occ.cut(occ.fuse(tray, cylinders(FLOOR - 1, LOW, BOSS))[0], cylinders(FLOOR, LOW, THREAD))[0]
    board = occ.cut(plate(80, 50, LOW, TOP), cylinders(LOW, TOP, HOLE))[0]
    lid = occ.cut(plate(LENGTH - 2 * WALL - 1, WIDTH - 2 * WALL - 1, SEAT, ROOF), cylinders(SEAT, ROOF, HOLE))[0]
    x, y, length, width, height = COMPONENT
    made = {"tray": tray[0], "board": board[0], "lid": lid[0]}
    made["component"] = (3, occ.addBox(x, y, TOP, length, width, height))
    sleeves = zip(cylinders(TOP, SEAT, STANDOFF), cylinders(TOP, SEAT, HOLE), strict=True)
    made |= {f"standoff{i}": occ.cut([outer], [inner])[0][0] for i, (outer, inner) in enumerate(sleeves, 1)}
    screws = zip(cylinders(*GRIP, THREAD), cylinders(GRIP[1], ROOF, NECK), cylinders(ROOF, END, HEAD), strict=True)
    made |= {f"screw{i}": occ.fuse([thread], [neck, head])[0][0] for i, (thread, neck, head) in enumerate(screws, 1)}
    pieces = occ.fragment(list(made.values()), [])[1]
    occ.synchronize()
    return {name: piece[0][1] for name, piece in zip(made, pieces, strict=True)}


def name_groups(volumes: dict[str, int]) -> None:
    """Groups of the parts, of the base of the tray and of the top of the component."""
    for name, volume in volumes.items():
        gmsh.model.addPhysicalGroup(3, [volume], name=name)
    for part, name, height in (("tray", "base", 0.0), ("component", "top", TOP + COMPONENT[-1])):
        for _, face in gmsh.model.getBoundary([(3, volumes[part])], oriented=False):
            box = gmsh.model.occ.getBoundingBox(2, face)
            if max(abs(box[2] - height), abs(box[5] - height)) < 1e-4:
                gmsh.model.addPhysicalGroup(2, [face], name=name)


def main(size: float, file: Path) -> None:
    """Write the mesh with edges of at most ``size``, mm; coordinates to 1e-4 mm, which halves the packed file."""
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    name_groups(parts())
    for option, value in (
        ("MeshSizeMax", size),
        ("MeshSizeMin", 1.0),
        ("MeshSizeFromCurvature", 8),
        ("ElementOrder", 2),
        ("HighOrderOptimize", 2),
    ):
        gmsh.option.setNumber(f"Mesh.{option}", value)
    gmsh.model.mesh.generate(3)
    gmsh.write(str(file))
    gmsh.finalize()
    text = re.sub(r"-?\d+\.\d{6,}(e-\d+)?", lambda number: f"{float(number[0]):.4f}".rstrip("0"), file.read_text())
    file.write_text(text)


if __name__ == "__main__":
    given = sys.argv[1:]
    main(float(given[0]) if given else 10.0, Path(given[1]) if given[1:] else Path(__file__).with_suffix(".msh"))
