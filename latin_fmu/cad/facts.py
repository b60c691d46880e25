"""What is known of a CAD assembly: its parts, their round faces, who touches whom. Plain data, which no CAD library is
needed for; lengths in mm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

Array = np.ndarray
Triple = tuple[float, float, float]


@dataclass(frozen=True)
class CadCylinder:
    """A round face, or several about one axis with one radius that continue each other.

    Attributes
    ----------
    axis, point : unit direction and a point of the axis, mm. radius : mm. low, high : its ends as heights along the
        axis, from the origin, mm. outward : whether it is the outside of a shaft; else it is a hole. turn : share of
        the full circle. faces : their numbers in the geometry.
    """

    axis: Triple
    point: Triple
    radius: float
    low: float
    high: float
    outward: bool
    turn: float
    faces: tuple[int, ...]

    @property
    def length(self) -> float:
        """Length along the axis, mm."""
        return self.high - self.low

    def about(self, other: CadCylinder, slack: float) -> bool:
        """Whether both have one axis, up to ``slack``, mm, over the longer of them."""
        axis, off = np.array(self.axis), np.array(other.point) - np.array(self.point)
        across = np.linalg.norm(np.cross(off, axis))
        turned = np.linalg.norm(np.cross(np.array(other.axis), axis))
        return bool(across <= slack and turned * max(self.length, other.length) <= 2.0 * slack)

    def overlap(self, other: CadCylinder) -> float:
        """Length along the axis that both have in common, mm; negative: the distance between them."""
        return min(self.high, other.high) - max(self.low, other.low)


@dataclass(frozen=True)
class CadPart:
    """A solid of the assembly.

    Attributes
    ----------
    name : of its substructure. path : from the assembly down to the part, as the file names them. number : of the
        volume in the geometry. volume, area : mm3, mm2. centre : of mass, mm. low, high : corners of its box, mm.
        colour : red, green, blue, 0 to 255; None where the file has none. material, density : as the file names them,
        kg/m3. cylinders : its round faces. outline : (n, 3) places along its edges, mm. smallest : size of its smallest
        face, the root of its area, mm. longest : length of its longest edge, mm.
    """

    name: str
    path: tuple[str, ...]
    number: int
    volume: float
    area: float
    centre: Triple
    low: Triple
    high: Triple
    colour: tuple[int, int, int] | None
    cylinders: tuple[CadCylinder, ...]
    outline: Array
    smallest: float
    material: str | None = None
    density: float | None = None
    longest: float = 0.0

    @property
    def thickness(self) -> float:
        """Twice the volume over the surface: the thickness of a plate, half the diameter of a long rod, mm."""
        return 2.0 * self.volume / self.area

    @property
    def diagonal(self) -> float:
        """Diagonal of the box, mm."""
        return float(np.linalg.norm(np.subtract(self.high, self.low)))

    def near(self, other: CadPart, distance: float) -> bool:
        """Whether the boxes of two parts are no farther apart than this, mm."""
        apart = np.maximum(np.subtract(other.low, self.high), np.subtract(self.low, other.high))
        return bool((apart <= distance).all())

    def same_shape(self, other: CadPart) -> bool:
        """Whether volume, surface and size are those of another part."""
        mine, theirs = (np.array([p.volume, p.area, p.diagonal]) for p in (self, other))
        return bool(np.allclose(mine, theirs, rtol=_SAME))

    def same_place(self, other: CadPart) -> bool:
        """Whether the boxes are those of another part."""
        mine, theirs = np.array([*self.low, *self.high]), np.array([*other.low, *other.high])
        return bool(np.abs(mine - theirs).max() <= _SAME * self.diagonal)

    @property
    def handedness(self) -> int:
        """1 or -1, the opposite of that of a mirror image; 0 of a part that is its own mirror image, as far as the
        moments of its edges show it.

        The main axes of the places along the edges, each towards the side of its positive third moment, are
        right-handed or left-handed.
        """
        if len(self.outline) < 4:
            return 0
        off = self.outline - self.outline.mean(axis=0)
        values, axes = np.linalg.eigh(off.T @ off / len(off))
        third = ((off @ axes) ** 3).mean(axis=0)
        size = float(np.sqrt(values[2]))
        distinct = min(values[1] - values[0], values[2] - values[1]) > _CHIRAL * size**2
        if not (distinct and (np.abs(third) > _CHIRAL * size**3).all()):
            return 0
        return int(np.sign(np.linalg.det(axes) * np.prod(np.sign(third))))

    @property
    def turns(self) -> float:
        """How many times the longest edge would wind around the part, by the second of the lengths of its box."""
        around = float(np.pi * np.sort(np.subtract(self.high, self.low))[1])
        return self.longest / around if around > 0.0 else 0.0

    def profile(self, line: CadCylinder) -> tuple[Array, Array]:
        """Heights along a line and distances from it, mm, of the places along the edges."""
        off = self.outline - np.array(line.point)
        axis = np.array(line.axis)
        heights = self.outline @ axis
        return heights, np.linalg.norm(off - (off @ axis)[:, None] * axis, axis=1)


_SAME = 1e-5
_CHIRAL = 1e-3  # of moments over those of the size: below, a part counts as symmetric


@dataclass(frozen=True)
class CadPair:
    """Two parts that touch, nearly touch or overlap.

    Attributes
    ----------
    parts : their names. gap : distance, mm, 0 where they touch. overlap : common volume, mm3. faces : numbers of the
        touching faces of the first and the second.
    """

    parts: tuple[str, str]
    gap: float
    overlap: float
    faces: tuple[tuple[int, ...], tuple[int, ...]]


@dataclass(frozen=True)
class Screw:
    """A part that is taken, or might be taken, for a screw.

    Attributes
    ----------
    part : its name. used : whether the scene tightens it. kind : "screw", "bolt with nut", "stud", or what it seems to
        be. why : in words. diameter : of the shank, mm. size : thread, "M10"; None where the diameter is that of none.
        threads : parts that its thread engages. clamped : other parts around the shank, from the head on. axis,
        middle : of the shank, mm. grip : from the head to the first thread, mm; 0 where it is not known.
    """

    part: str
    used: bool
    kind: str
    why: str
    diameter: float
    size: str | None = None
    threads: tuple[str, ...] = ()
    clamped: tuple[str, ...] = ()
    axis: Triple = (0.0, 0.0, 1.0)
    middle: Triple = (0.0, 0.0, 0.0)
    grip: float = 0.0


@dataclass
class CadAssembly:
    """A CAD assembly as it was read, and meshed.

    Attributes
    ----------
    file : its name. unit : of length in the file, "mm", "in". scale : m for a unit of the mesh. parts, pairs, screws :
        of it. left_out : what is no part, in words, by kind. remarks : on the parts. faces : names of the faces of the
        mesh by part. ends : area, mm2, of end faces that nothing touches, "part.face". counts : figures of the mesh, by
        what is counted. seconds : of processor time, by stage. guessed : whether the
        unit is, by the size. whole : parts before planes of symmetry have cut them; none without such planes.
        symmetry : part and face of those on these planes.
    """

    file: str
    unit: str
    scale: float
    parts: list[CadPart] = field(default_factory=list)
    pairs: list[CadPair] = field(default_factory=list)
    screws: list[Screw] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    faces: dict[str, list[str]] = field(default_factory=dict)
    ends: dict[str, float] = field(default_factory=dict)
    counts: dict[str, float] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    guessed: bool = False
    whole: list[CadPart] = field(default_factory=list)
    symmetry: list[tuple[str, str]] = field(default_factory=list)

    @cached_property
    def by_name(self) -> dict[str, CadPart]:
        """Parts by name."""
        return {part.name: part for part in self.parts}

    def pairs_of(self, name: str) -> list[CadPair]:
        """Pairs of a part."""
        return [pair for pair in self.pairs if name in pair.parts]


def merged(faces: Sequence[CadCylinder]) -> list[CadCylinder]:
    """Round faces of a part as whole cylinders: halves and quarters of one radius about one axis are one, and so are
    pieces along the axis that continue each other."""
    whole: list[CadCylinder] = []
    for face in sorted(faces, key=_order):
        for i, other in enumerate(whole):
            slack = _SLACK * other.radius
            alike = face.outward == other.outward and abs(face.radius - other.radius) <= slack
            if alike and other.about(face, slack) and other.overlap(face) >= -slack:
                whole[i] = _joined(other, face)
                break
        else:
            whole.append(face)
    return whole


_SLACK = 0.01


def _order(face: CadCylinder) -> Any:
    return (*(round(x, 4) for x in (face.radius, *face.axis, *face.point, face.low)), face.faces)


def _joined(one: CadCylinder, other: CadCylinder) -> CadCylinder:
    """Two round faces as one; its share of the circle is that of the area."""
    low, high = min(one.low, other.low), max(one.high, other.high)
    turn = (one.turn * one.length + other.turn * other.length) / max(high - low, 1e-12)
    return CadCylinder(
        one.axis, one.point, one.radius, low, high, one.outward, min(turn, 1.0), (*one.faces, *other.faces)
    )
