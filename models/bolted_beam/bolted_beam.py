"""Mesh of the Brake-Reuss beam with its three bolts; needs gmsh (``pip install "latin-fmu[meshes]"``).

    python models/bolted_beam/bolted_beam.py [--thin] [--fine] [FILE]

writes bolted_beam.msh beside this script, in mm: x along the beam, z along the bolts, the joint in the plane z = 0.
``--fine`` makes about 30,000 hexahedra (bolted_beam_fine.msh). ``--thin`` makes the beam of half the height, with
narrow rings around the washers, where the pressure ends: models/thin_beam/thin_beam.msh, thin_beam_fine.msh with
``--fine``.

All parts are plane figures of blocks with four sides, extruded along z: hexahedra only, in rows. The upper half is the
lower one turned half around about y. A bolt is one part with its nut and its two washers, which are bonded.
"""

from __future__ import annotations

import math
from argparse import ArgumentParser
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path

import gmsh

END, LAP, WIDE = 360.0, 60.0, 12.7  # half lengths, half width
PLACES, PITCH, HOLE = (-30.0, 0.0, 30.0), 30.0, 4.25  # of the holes along x; radius
SHANK, WASHER, FLATS = 3.969, (4.366, 8.731), 6.35  # radii; of the circle inside the hexagon
DISC, HEAD, TIP = 1.5875, 5.16, 4.365  # heights of washer, of head and nut; of the tip over the nut
CORE = 0.55  # of the radius of the shank: hexagon in its middle

Arcs = tuple[int | None, int | None]


@dataclass(frozen=True)
class Beam:
    """Height of a half in the lap, mm; parts of it that the layers have, from the joint on; numbers of elements: on a
    side of the rectangle around a hole, under the washer, from there to the rectangle, from the last rectangle to the
    end of the lap, along a half outside the lap; of the bolt: on a sixth of the circle, along the shank between the
    washers, through head and nut."""

    high: float = 12.7
    layers: tuple[float, ...] = (1, 1, 1)
    side: int = 6
    under: int = 3
    outside: int = 2
    rest: int = 3
    along: int = 24
    sixth: int = 2
    shank: int = 6
    head: int = 2


BEAMS = {
    "bolted_beam": Beam(),
    "bolted_beam_fine": Beam(under=4, outside=3, rest=4, layers=(1,) * 8, along=84, sixth=3, shank=14, head=4),
    "thin_beam": Beam(high=6.35, layers=(1, 2, 3), under=6, outside=8),
    "thin_beam_fine": Beam(
        high=6.35, layers=(1, 2, 3, 4), side=8, under=9, outside=12, rest=6, along=36, sixth=3, shank=8
    ),
}


class Plane:
    """Blocks in a plane z = constant; points and lines are made once."""

    def __init__(self, z: float) -> None:
        self._z = z
        self._points: dict[tuple[float, float], int] = {}
        self._lines: dict[tuple[int, int], int] = {}

    def point(self, x: float, y: float) -> int:
        """The point at a place."""
        key = round(x, 6), round(y, 6)
        if key not in self._points:
            self._points[key] = gmsh.model.geo.addPoint(x, y, self._z)
        return self._points[key]

    def line(self, start: int, end: int, count: int, centre: int | None = None) -> int:
        """The line between two points, or the arc about a third, cut into ``count`` equal parts."""
        if (end, start) in self._lines:
            return -self._lines[end, start]
        if (start, end) not in self._lines:
            geo = gmsh.model.geo
            made = geo.addLine(start, end) if centre is None else geo.addCircleArc(start, centre, end)
            geo.mesh.setTransfiniteCurve(made, count + 1)
            self._lines[start, end] = made
        return self._lines[start, end]

    def block(self, a: int, b: int, c: int, d: int, along: int, across: int, arcs: Arcs = (None, None)) -> int:
        """Quadrangles in rows between four points; ``arcs``: centres of the sides a d and b c where they are arcs."""
        geo = gmsh.model.geo
        lines = (
            self.line(a, b, along),
            self.line(b, c, across, arcs[1]),
            self.line(c, d, along),
            self.line(d, a, across, arcs[0]),
        )
        surface = geo.addPlaneSurface([geo.addCurveLoop(list(lines))])
        geo.mesh.setTransfiniteSurface(surface, cornerTags=[a, b, c, d])
        geo.mesh.setRecombine(2, surface)
        return surface

    def rectangle(self, left: float, right: float, along: int, across: int) -> int:
        """The whole width from ``left`` to ``right``."""
        corners = (self.point(*p) for p in ((left, -WIDE), (right, -WIDE), (right, WIDE), (left, WIDE)))
        return self.block(*corners, along, across)

    def ring(self, inner: Sequence[int], outer: Sequence[int], counts: tuple[int, int], arcs: Arcs) -> list[int]:
        """Blocks between two closed rows of points.

        Parameters
        ----------
        counts : elements on a piece of a row, and from row to row. arcs : centres of the rows that are circles.
        """
        around, across = counts
        rows = zip(inner, outer, [*outer[1:], outer[0]], [*inner[1:], inner[0]], strict=True)
        return [self.block(*corners, across, around, arcs) for corners in rows]

    def circle(self, x: float, radius: float, pieces: int, first: float = 0.0) -> list[int]:
        """Points on a circle about (x, 0), from the angle ``first``."""
        angles = [first + 2 * math.pi * k / pieces for k in range(pieces)]
        return [self.point(x + radius * math.cos(t), radius * math.sin(t)) for t in angles]


def half(turned: int, beam: Beam) -> list[int]:
    """Volumes of the lower half (1), which goes to x = -END, or of the upper one (-1), which is turned about y."""
    plane = Plane(-turned * beam.high)
    figure: list[int] = []
    for x in PLACES:
        centre, first = plane.point(x, 0.0), math.pi / 4
        hole, washer = (plane.circle(x, r, 4, first) for r in (HOLE, WASHER[1]))
        corners = [plane.point(x + s * PITCH / 2, t * WIDE) for s, t in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
        figure += plane.ring(hole, washer, (beam.side, beam.under), (centre, centre))
        figure += plane.ring(washer, corners, (beam.side, beam.outside), (centre, None))
    last = PLACES[-1] + PITCH / 2
    figure += [
        plane.rectangle(*sorted(turned * x for x in ends), beam.rest, beam.side)
        for ends in ((-LAP, -last), (last, LAP))
    ]
    figure.append(plane.rectangle(*sorted((-turned * END, -turned * LAP)), beam.along, beam.side))
    volumes, tops = extruded(figure, turned * beam.high, beam.layers[::-1])
    return volumes + extruded(tops[-1:], turned * beam.high, beam.layers)[0]


def bolt(x: float, beam: Beam) -> list[int]:
    """Volumes of a bolt with its nut and its washers; the tip of the shank sticks out of the nut."""
    plane = Plane(-beam.high - DISC - HEAD)
    centre, n = plane.point(x, 0.0), beam.sixth
    core, shank, bore = (plane.circle(x, r, 6) for r in (CORE * SHANK, SHANK, WASHER[0]))
    flats, rim = plane.circle(x, FLATS / math.cos(math.pi / 6), 6), plane.circle(x, WASHER[1], 6)
    inside = [plane.block(core[k], core[k + 1], core[(k + 2) % 6], centre, n, n) for k in range(0, 6, 2)]
    inside += plane.ring(core, shank, (n, max(1, n - 1)), (None, centre))
    collar = plane.ring(shank, bore, (n, 1), (centre, centre))
    hexagon = plane.ring(bore, flats, (n, max(1, n - 1)), (centre, None))
    outer = plane.ring(flats, rim, (n, 1), (None, centre))
    figure, volumes = [*inside, *collar, *hexagon, *outer], []
    levels = (
        (HEAD, beam.head, {*inside, *collar, *hexagon}),
        (DISC, 1, {*inside, *hexagon, *outer}),
        (2 * beam.high, beam.shank, {*inside}),
        (DISC, 1, {*inside, *hexagon, *outer}),
        (HEAD, beam.head, {*inside, *collar, *hexagon}),
        (TIP, 1, {*inside}),
    )
    level = figure
    for height, layers, kept in levels:
        over, level = extruded(level, height, (1.0,) * layers)
        volumes += [v for v, s in zip(over, figure, strict=True) if s in kept]
    return volumes


def extruded(figure: Sequence[int], height: float, layers: Sequence[float]) -> tuple[list[int], list[int]]:
    """Volumes over plane figures in layers of these parts of the height, and their other ends."""
    ends = [part / sum(layers) for part in accumulate(layers)]
    made = gmsh.model.geo.extrude([(2, s) for s in figure], 0, 0, height, [1] * len(layers), ends, recombine=True)
    places = [i for i, (dim, _) in enumerate(made) if dim == 3]
    return [made[i][1] for i in places], [made[i - 1][1] for i in places]


def name_faces(name: str, volumes: Sequence[int]) -> None:
    """Name the lap of a half and its far end: ``NAME_lap``, ``NAME_end``."""
    around = [t for _, t in gmsh.model.getBoundary([(3, v) for v in volumes], oriented=False)]
    boxes = {t: gmsh.model.getBoundingBox(2, t) for t in around}
    lap = [
        t for t, box in boxes.items() if max(abs(box[2]), abs(box[5])) < 1e-3 and abs(box[0]) + abs(box[3]) < 2.5 * LAP
    ]
    end = [t for t, box in boxes.items() if min(abs(box[0]), abs(box[3])) > END - 1e-3]
    gmsh.model.addPhysicalGroup(2, lap, name=f"{name}_lap")
    gmsh.model.addPhysicalGroup(2, end, name=f"{name}_end")


def main(path: Path, beam: Beam) -> None:
    """Make the mesh and write it."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    parts = {"lower": half(1, beam), "upper": half(-1, beam)}
    parts |= {f"bolt{i}": bolt(x, beam) for i, x in enumerate(PLACES, 1)}
    gmsh.model.geo.synchronize()
    for name, volumes in parts.items():
        gmsh.model.addPhysicalGroup(3, volumes, name=name)
        if name in ("lower", "upper"):
            name_faces(name, volumes)
    gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
    gmsh.model.mesh.generate(3)
    gmsh.write(str(path))
    gmsh.finalize()


if __name__ == "__main__":
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--thin", action="store_true", help="half the height, models/thin_beam")
    parser.add_argument("--fine", action="store_true", help="more elements")
    parser.add_argument("file", nargs="?", type=Path)
    given = parser.parse_args()
    model = "thin_beam" if given.thin else "bolted_beam"
    name = f"{model}_fine" if given.fine else model
    main(given.file or Path(__file__).resolve().parents[1] / model / f"{name}.msh", BEAMS[name])
