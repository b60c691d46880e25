"""CAD assemblies by gmsh, written as STEP files with names: ``python -m tests.cad.assemblies bracket out.step``.

A script of its own, as a process: the library is not loaded into that of the tests. Lengths in mm.
"""

from __future__ import annotations

import math
import re
import sys
from pathlib import Path
from typing import Any

import gmsh

Entities = list[tuple[int, int]]


def cylinder(x: float, y: float, z: float, height: float, radius: float) -> Entities:
    """A cylinder along z."""
    return [(3, gmsh.model.occ.addCylinder(x, y, z, 0, 0, height, radius))]


def box(low: tuple[float, float, float], size: tuple[float, float, float]) -> Entities:
    """A box along the axes."""
    return [(3, gmsh.model.occ.addBox(*low, *size))]


def without(body: Entities, *tools: Entities) -> Entities:
    """A body without others."""
    return gmsh.model.occ.cut(body, [one for tool in tools for one in tool])[0]


def together(body: Entities, *more: Entities) -> Entities:
    """Bodies as one."""
    return gmsh.model.occ.fuse(body, [one for other in more for one in other])[0]


def screw(x: float, y: float, under_head: float, length: float, size: float) -> Entities:
    """A cap screw along -z: a shank of its nominal diameter, a head of 1.5 diameters with a hexagon in it."""
    shank = cylinder(x, y, under_head - length, length, size / 2)
    head = cylinder(x, y, under_head, size, 0.75 * size)
    return without(together(shank, head), hexagon(x, y, under_head + 0.5 * size, size, 0.4 * size))


def hexagon(x: float, y: float, z: float, height: float, radius: float) -> Entities:
    """A hexagonal prism along z."""
    occ = gmsh.model.occ
    points = [
        occ.addPoint(x + radius * math.cos(i * math.pi / 3), y + radius * math.sin(i * math.pi / 3), z)
        for i in range(6)
    ]
    lines = [occ.addLine(a, b) for a, b in zip(points, points[1:] + points[:1], strict=True)]
    face = occ.addPlaneSurface([occ.addCurveLoop(lines)])
    return [one for one in occ.extrude([(2, face)], 0, 0, height) if one[0] == 3]


def nut(x: float, y: float, z: float, size: float) -> Entities:
    """A hexagonal nut of 0.8 diameters."""
    return without(hexagon(x, y, z, 0.8 * size, 0.95 * size), cylinder(x, y, z - 1, 3 * size, size / 2))


def bracket(move: float = 0.0, name: str = "bracket") -> dict[str, Entities]:
    """An angle bracket on a base, held by a screw M6 in a tapped hole of the base and located by a pin.

    move : of the hole for the pin, mm. name : of the bracket.
    """
    base = without(box((0, 0, 0), (80, 40, 15)), cylinder(20, 20, 3, 20, 2.5), cylinder(45 + move, 20, 5, 20, 2.0))
    foot = without(box((5, 5, 15), (50, 30, 8)), cylinder(20, 20, 10, 20, 3.3), cylinder(45 + move, 20, 10, 20, 2.0))
    wall = box((5, 5, 23), (8, 30, 40))
    return {
        "base": base,
        name: together(foot, wall),
        "ISO 4762 M6x16": screw(20, 20, 23, 16, 6.0),
        "dowel pin": cylinder(45 + move, 20, 7, 12, 2.0),
    }


def bracket_without_pin() -> dict[str, Entities]:
    """The bracket without its pin, whose holes stay."""
    parts = bracket()
    gmsh.model.occ.remove(parts.pop("dowel pin"), recursive=True)
    return parts


def flange() -> dict[str, Entities]:
    """Two flanges of pipes with a gasket ring between them and eight bolts M8 with nuts."""

    def ring(z: float, height: float, outer: float, inner: float) -> Entities:
        return without(cylinder(0, 0, z, height, outer), cylinder(0, 0, z - 1, height + 2, inner))

    places = [(45 * math.cos(a), 45 * math.sin(a)) for a in (i * math.pi / 4 for i in range(8))]
    holes = [cylinder(x, y, -50, 100, 4.5) for x, y in places]
    more = [cylinder(x, y, -50, 100, 4.5) for x, y in places]
    lower = together(ring(-14, 12, 60, 25), ring(-44, 30, 32, 25))
    upper = together(ring(0, 12, 60, 25), ring(12, 30, 32, 25))
    parts = {
        "flange lower": without(lower, *holes),
        "gasket": ring(-2, 2, 36, 25),
        "flange upper": without(upper, *more),
    }
    for i, (x, y) in enumerate(places, start=1):
        parts[f"hex bolt {i}"] = screw(x, y, 12, 36, 8.0)
        parts[f"nut {i}"] = nut(x, y, -14 - 6.4, 8.0)
    return parts


def electronics_box() -> dict[str, Entities]:
    """A box with a lid on four screws M4 in its corners, a board on four standoffs with screws M3 in it."""
    outer, inner = box((0, 0, 0), (100, 70, 30)), box((4, 4, 4), (92, 62, 30))
    corners = [(8, 8), (92, 8), (8, 62), (92, 62)]
    mounts = [(20, 18), (80, 18), (20, 52), (80, 52)]
    housing = without(outer, inner)
    housing = together(housing, *(cylinder(x, y, 4, 26, 5.5) for x, y in corners))
    housing = without(housing, *(cylinder(x, y, 18, 13, 1.65) for x, y in corners))
    lid = without(box((0, 0, 30), (100, 70, 3)), *(cylinder(x, y, 29, 5, 2.25) for x, y in corners))
    board = without(box((12, 12, 12), (76, 46, 1.6)), *(cylinder(x, y, 11, 4, 1.6) for x, y in mounts))
    parts = {"housing": housing, "lid": lid, "board": board}
    for i, (x, y) in enumerate(mounts, start=1):
        tapped = without(hexagon(x, y, 4, 8, 3.2), cylinder(x, y, 5, 10, 1.25))
        parts[f"standoff {i}"] = tapped
        parts[f"screw M3x6 {i}"] = screw(x, y, 13.6, 6.0, 3.0)
    for i, (x, y) in enumerate(corners, start=1):
        parts[f"DIN 912 M4x12 {i}"] = screw(x, y, 33, 12, 4.0)
    return parts


def handed() -> dict[str, Entities]:
    """A clip without a plane of symmetry, its mirror image, and one more of it."""

    def clip(x: float) -> Entities:
        return together(box((x, 0, 0), (20, 10, 4)), box((x, 0, 0), (5, 10, 15)), box((x, 6, 0), (30, 4, 4)))

    image = clip(0)
    gmsh.model.occ.mirror(image, 1, 0, 0, 5)  # x = -5
    return {"clip": clip(0), "clip left": image, "spare clip": clip(130)}


def write(file: Path, parts: dict[str, Entities]) -> None:
    """Write parts with their names, which the library leaves out."""
    gmsh.model.occ.synchronize()
    bodies = {entity[1] for body in parts.values() for entity in body}
    assert {tag for _, tag in gmsh.model.getEntities(3)} == bodies
    names = {tag: name for name, body in parts.items() for _, tag in body}
    gmsh.write(str(file))
    text = file.read_text(encoding="utf-8")
    for number, tag in enumerate(sorted(names), start=1):
        name = re.sub(r" [0-9]$", "", names[tag])  # several of one product have one name
        text = re.sub(rf"'Open CASCADE STEP translator [0-9.]+ 1\.{number}'", f"'{name}'", text)
    file.write_text(text, encoding="utf-8")


MADE: dict[str, Any] = {
    "bracket": bracket,
    "moved": lambda: bracket(move=5.0),
    "renamed": lambda: bracket(name="angle"),
    "gone": bracket_without_pin,
    "flange": flange,
    "handed": handed,
    "box": electronics_box,
}


def main() -> None:
    """Write the assembly of the first argument to the file of the second."""
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    write(Path(sys.argv[2]), {name: list(body) for name, body in MADE[sys.argv[1]]().items()})
    gmsh.finalize()


if __name__ == "__main__":
    main()
