"""Mesh of an electronics box: tray with standoffs, circuit board, component, four screws; needs gmsh.

    python models/electronics_box/electronics_box.py [SIZE [FILE]]

writes electronics_box.msh beside this script, in mm: tetrahedra of second order, edges of at most SIZE (9), finer along
curved edges. ``pip install "latin-fmu[meshes]"`` brings gmsh.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import gmsh

LENGTH, WIDTH, HEIGHT, WALL = 90.0, 60.0, 18.0, 3.0  # of the tray
STANDOFF, RADIUS, POSTS = 6.0, 4.0, [(x, y) for x in (-36.0, 36.0) for y in (-21.0, 21.0)]
BOARD, HOLE = 1.6, 1.7  # thickness, radius of its holes
THREAD, NECK, HEAD, SUNK = 1.5, 1.3, 3.0, 2.0  # radii of a screw; its neck begins so far below the board
LOW = WALL + STANDOFF  # lower face of the board
TOP = LOW + BOARD
Box = tuple[float, float, float, float, float, float]


def volumes() -> dict[str, int]:
    """The parts by name."""
    occ = gmsh.model.occ

    def cylinders(bottom: float, height: float, radius: float) -> list[tuple[int, int]]:
        return [(3, occ.addCylinder(x, y, bottom, 0, 0, height, radius)) for x, y in POSTS]

    outer = occ.addBox(-LENGTH / 2, -WIDTH / 2, 0, LENGTH, WIDTH, HEIGHT)
    inner = occ.addBox(-LENGTH / 2 + WALL, -WIDTH / 2 + WALL, WALL, LENGTH - 2 * WALL, WIDTH - 2 * WALL, HEIGHT)
    tray = occ.cut([(3, outer)], [(3, inner)])[0]
    tray = occ.fuse(tray, cylinders(WALL - 1, STANDOFF + 1, RADIUS))[0]
    tray = occ.cut(tray, cylinders(WALL, STANDOFF, THREAD))[0]
    board = occ.cut([(3, occ.addBox(-40, -25, LOW, 80, 50, BOARD))], cylinders(LOW, BOARD, HOLE))[0]
    parts = {"tray": tray[0][1], "board": board[0][1], "component": occ.addBox(-10, -8, TOP, 20, 16, 4)}
    shanks, necks = cylinders(WALL + 0.5, STANDOFF - SUNK - 0.5, THREAD), cylinders(LOW - SUNK, SUNK + BOARD, NECK)
    heads = cylinders(TOP, 2.0, HEAD)
    for i, (shank, neck, head) in enumerate(zip(shanks, necks, heads, strict=True), 1):
        parts[f"screw{i}"] = occ.fuse([shank], [neck, head])[0][0][1]
    occ.synchronize()
    return parts


def at(height: float) -> Callable[[Box], bool]:
    """Faces in a horizontal plane."""
    return lambda box: abs(box[2] - height) < 1e-4 and abs(box[5] - height) < 1e-4


def between(low: float, high: float) -> Callable[[Box], bool]:
    """Lateral faces of the thread."""
    return lambda box: abs(box[2] - low) < 1e-4 and abs(box[5] - high) < 1e-4 and box[3] - box[0] < 2.1 * THREAD


def name_parts(parts: dict[str, int]) -> None:
    """Volume groups of the parts, and their faces ``PART_FACE``."""
    faces = [("tray", "bottom", at(0.0)), ("tray", "posts", at(LOW)), ("tray", "threads", between(WALL, LOW))]
    faces += [("board", "bottom", at(LOW)), ("board", "top", at(TOP))]
    faces += [("component", "bottom", at(TOP)), ("component", "top", at(TOP + 4))]
    for i in range(1, 5):
        faces += [(f"screw{i}", "head", at(TOP)), (f"screw{i}", "shank", between(WALL + 0.5, LOW - SUNK))]
    for part, volume in parts.items():
        gmsh.model.addPhysicalGroup(3, [volume], name=part)
    for part, name, chosen in faces:
        skin = [tag for _, tag in gmsh.model.getBoundary([(3, parts[part])], oriented=False)]
        tags = [tag for tag in skin if chosen(gmsh.model.occ.getBoundingBox(2, tag))]
        gmsh.model.addPhysicalGroup(2, tags, name=f"{part}_{name}")


def main(size: float, file: Path) -> None:
    """Write the mesh with edges of at most ``size``, mm."""
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    name_parts(volumes())
    for option, value in (
        ("MeshSizeMax", size),
        ("MeshSizeMin", 1.2),
        ("MeshSizeFromCurvature", 8),
        ("ElementOrder", 2),
        ("HighOrderOptimize", 2),
    ):
        gmsh.option.setNumber(f"Mesh.{option}", value)
    gmsh.model.mesh.generate(3)
    gmsh.write(str(file))
    gmsh.finalize()


if __name__ == "__main__":
    given = sys.argv[1:]
    main(float(given[0]) if given else 9.0, Path(given[1]) if given[1:] else Path(__file__).with_suffix(".msh"))
