"""Screws among the parts of an assembly: a shank with a head, a nut or a name, in a hole that its thread fits.

A part is a screw where a round shank is in holes of other parts about its axis, and has a head, a nut, or a name such
as "bolt" or "ISO 4762". Its thread is in its nuts, else in the hole of 0.75 to 1.1 of its diameter that is farthest
from the head. Holes of parts that it clamps may be wider (ISO 273). What is called a pin or a standoff, is hollow, or
clamps nothing, is possible: it is in the table and not used.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ..scene.screw_names import fits, is_nut, is_screw, is_washer, words_of_name
from ..scene.threads import thread_named
from .facts import CadCylinder, CadPart, Screw

FITS: Final = 0.75, 1.1
"""Diameter of the hole of a thread over that of the shank."""
CLEARANCE: Final = 1.4
"""Diameter of the hole of a part that is clamped over that of the shank, at most."""
_SLACK: Final = 0.02  # of these
_TIGHT: Final = 1.03  # of the diameter: a hole that has play is no thread where there is a tighter one
_COAXIAL: Final = 0.1  # of the radius
_ENGAGED: Final = 0.25  # of the diameter, along the axis
_WHOLE: Final = 0.6  # share of the full circle of a shank and of a hole
_HEAD: Final = 1.12  # radius from which on there is a head, over that of the shank
_WIDEST: Final = 2.8  # the largest radius of a screw, over that of the shank
_TALLEST: Final = 1.6  # height of head and of a nut, over the diameter
_NUT: Final = 2.6  # radius of a nut over that of its hole
_HOLLOW: Final = 0.6  # of the length
_SIZES: Final = 0.02  # difference of a diameter from that of a thread
_METRIC: Final = (1.6, 2, 2.5, 3, 3.5, 4, 5, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 27, 30, 33, 36, 39, 42, 48, 56, 64)
_UNIFIED: Final = ("#2 UNC", "#4 UNC", "#6 UNC", "#8 UNC", "#10 UNF", "1/4 UNC", "5/16 UNC", "3/8 UNC", "7/16 UNC",
                   "1/2 UNC", "5/8 UNC", "3/4 UNC", "7/8 UNC", "1 UNC")  # fmt: skip
_NO_SCREW: Final = (
    ("pin", ("pin", "pins", "dowel*", "*stift", "zylinderstift*")),
    ("standoff", ("standoff*", "stand", "spacer*", "distanz*", "abstand*")),
    ("rivet", ("rivet*", "niet*")),
    ("shaft", ("shaft*", "axle*", "*welle", "rod", "rods")),
    ("bush", ("bush*", "sleeve*", "*buchse", "*huelse", "insert*", "bearing*")),
    ("washer", ("*washer", "*washers", "*scheibe")),
    ("nut", ("nut", "nuts", "locknut*", "*mutter")),
)


@dataclass(frozen=True)
class _Around:
    """A part around a shank: its hole, and whether it is a nut."""

    part: CadPart
    hole: CadCylinder
    ratio: float
    nut: bool


def find_screws(parts: Sequence[CadPart], inch: bool = False, scale: float = 1e-3) -> list[Screw]:
    """Screws, and what might be some, in the order of the parts; ``inch`` : the file is in inches. ``scale`` : m for a
    unit of the parts."""
    found = [(part, screw) for part in parts if (screw := _screw(part, parts)) is not None]
    return [
        replace(screw, size=size_of(part, 1e3 * scale * screw.diameter, inch)) if screw.used else screw
        for part, screw in found
    ]


def words_of(part: CadPart) -> list[str]:
    """Words of the name of a product."""
    return words_of_name(" ".join(part.path[-2:][-1:] or (part.name,)))


def is_named_screw(part: CadPart) -> bool:
    """Whether the name of a part is that of a screw."""
    return is_screw(words_of(part))


def _other_kind(part: CadPart) -> str | None:
    """What a part is by its name that is no screw; None where the name does not say."""
    words = words_of(part)
    if is_nut(words):
        return "nut"
    return next((kind for kind, patterns in _NO_SCREW if fits(words, patterns)), None)


def _screw(part: CadPart, parts: Sequence[CadPart]) -> Screw | None:
    """What a part is; None where nothing speaks for a screw."""
    named, other = is_named_screw(part), _other_kind(part)
    found = _in_holes(part, parts)
    if found is None:
        if named:
            return Screw(
                part.name, False, "no hole", "its name is that of a screw; no hole of a part is around it", 0.0
            )
        return None
    shank, around = found
    nuts = [a for a in around if a.nut]
    ends = _heads(part, shank)
    if other in ("nut", "washer", "bush"):
        return None
    # a rod with two nuts is a stud, whatever it is called
    stud = len(nuts) >= 2 and not any(ends)
    if not (named or nuts or any(ends)):
        if other is None and not _pin_like(part, shank):
            return None
        return _possible(part, shank, other or "pin", "a shank in holes, without a head, a nut or a name")
    if (doubt := _doubt(part, shank, ends, named)) is not None:
        # a flange, a lever, a housing: nobody would look for them among the screws
        return _possible(part, shank, other or "no screw", doubt) if named or nuts or other else None
    if other is not None and not named and not stud:
        return _possible(part, shank, other, "its name is that of another kind of part")
    return _with_thread(part, shank, around, ends)


def _possible(part: CadPart, shank: CadCylinder, kind: str, why: str) -> Screw:
    return Screw(part.name, False, kind, why, 2.0 * shank.radius, axis=shank.axis, middle=_middle(shank))


def _middle(shank: CadCylinder) -> tuple[float, float, float]:
    axis, point = np.array(shank.axis), np.array(shank.point)
    x, y, z = (point + axis * (0.5 * (shank.low + shank.high) - axis @ point)).tolist()
    return x, y, z


def _in_holes(part: CadPart, parts: Sequence[CadPart]) -> tuple[CadCylinder, list[_Around]] | None:
    """The shank of a part and the parts around it; None where no shank is in a hole that a thread fits."""
    best: tuple[float, CadCylinder, list[_Around]] | None = None
    for shank in part.cylinders:
        if not shank.outward or shank.turn < _WHOLE:
            continue
        around = [a for other in parts if other is not part and part.near(other, 0.0) for a in _around(shank, other)]
        fitting = [a for a in around if a.ratio <= FITS[1] + _SLACK]
        length = sum(a.hole.overlap(shank) for a in fitting)
        if fitting and (best is None or length > best[0]):
            best = length, shank, around
    return None if best is None else best[1:]


def _around(shank: CadCylinder, other: CadPart) -> Iterator[_Around]:
    """A part around a shank, once: with its tightest hole."""
    holes = [
        (hole.radius / shank.radius, hole)
        for hole in other.cylinders
        if not hole.outward
        and hole.turn >= _WHOLE
        and FITS[0] - _SLACK <= hole.radius / shank.radius <= CLEARANCE
        and hole.about(shank, _COAXIAL * shank.radius)
        and hole.overlap(shank) > 0.05 * shank.radius
    ]
    if holes:
        ratio, hole = min(holes, key=lambda pair: (round(pair[0], 3), pair[1].low))
        yield _Around(other, hole, ratio, _is_nut(other, hole, ratio))


def _is_nut(part: CadPart, hole: CadCylinder, ratio: float) -> bool:
    """Whether a part around a shank is a nut: by its name, or small, with a thread through it and no round outside."""
    words = words_of(part)
    if is_nut(words):
        return True
    if is_washer(words) or ratio > _TIGHT:
        return False
    heights, radii = part.profile(hole)
    widest = float(radii.max())
    round_outside = any(
        c.outward and c.radius > 0.9 * widest and c.about(hole, _COAXIAL * hole.radius) for c in part.cylinders
    )
    low_enough = float(np.ptp(heights)) <= _TALLEST * 2.0 * hole.radius
    through = hole.length >= 0.7 * float(np.ptp(heights))
    return widest <= _NUT * hole.radius and low_enough and through and not round_outside


def _heads(part: CadPart, shank: CadCylinder) -> tuple[bool, bool]:
    """Whether the part is wider than its shank below the lower end of this, and above the upper one."""
    heights, radii = part.profile(shank)
    wide = radii > _HEAD * shank.radius
    slack = 0.05 * shank.radius
    return bool((wide & (heights <= shank.low + slack)).any()), bool((wide & (heights >= shank.high - slack)).any())


def _pin_like(part: CadPart, shank: CadCylinder) -> bool:
    """Whether a part is hardly more than its shank."""
    return part.volume <= 1.3 * np.pi * shank.radius**2 * shank.length and shank.length >= shank.radius


def _doubt(part: CadPart, shank: CadCylinder, ends: tuple[bool, bool], named: bool) -> str | None:
    """What speaks against a screw; None where nothing does."""
    heights, radii = part.profile(shank)
    length, diameter = float(np.ptp(heights)), 2.0 * shank.radius
    inner = [c for c in part.cylinders if not c.outward and c.about(shank, _COAXIAL * shank.radius)]
    if any(c.length >= _HOLLOW * length for c in inner):
        return "it is hollow"
    if named:
        return None
    if all(ends):
        return "it is wider than its shank at both ends"
    if any(c.radius <= FITS[1] * shank.radius and c.length >= 0.8 * diameter for c in inner):
        return "it has a thread inside, as a standoff has"
    if radii.max() > _WIDEST * shank.radius:
        return f"it is {2.0 * radii.max():.3g} mm wide about a shank of {diameter:.3g} mm"
    wide = heights[radii > _HEAD * shank.radius]
    if len(wide) and float(np.ptp(wide)) > _TALLEST * diameter:
        return f"its head is {float(np.ptp(wide)):.3g} mm tall"
    return None


def _with_thread(part: CadPart, shank: CadCylinder, around: Sequence[_Around], ends: tuple[bool, bool]) -> Screw:
    """A screw with the parts that its thread engages; a possible one where there is none."""
    nuts = [a for a in around if a.nut]
    from_low = ends[0] or not ends[1]  # the head is at the lower end

    def distance(one: _Around) -> float:
        return one.hole.low - shank.low if from_low else shank.high - one.hole.high

    ordered = sorted((a for a in around if not a.nut), key=lambda a: (distance(a), a.part.name))
    threads, kind = nuts, "bolt with nut"
    if not any(ends):
        kind = "stud"
    if not nuts or (kind == "stud" and len(nuts) == 1):
        tapped = _tapped(shank, ordered, nuts)
        if kind == "stud" and (not nuts or tapped is None):
            return _possible(part, shank, "stud", "without a head, and without nuts or threads at both ends")
        if tapped is None:
            return _possible(part, shank, "screw", "no hole of 0.75 to 1.1 of its diameter is left for its thread")
        threads = [*nuts, tapped]
        kind = "screw" if not nuts else "stud"
    clamped = [a for a in ordered if a not in threads]
    if not clamped:
        return _possible(part, shank, kind, f"it clamps nothing: {threads[0].part.name} alone is around it")
    names = tuple(sorted(a.part.name for a in threads))
    why = f"{'two nuts' if len(nuts) > 1 else 'a nut' if nuts else 'a head'} and {len(clamped)} clamped"
    return Screw(
        part.name,
        True,
        kind,
        why,
        2.0 * shank.radius,
        None,
        names,
        tuple(a.part.name for a in clamped),
        shank.axis,
        _middle(shank),
        _grip(shank, [a.hole for a in threads], ends),
    )


def _grip(shank: CadCylinder, holes: Sequence[CadCylinder], ends: tuple[bool, bool]) -> float:
    """Length of the shank from the head to the first thread, mm; 0 of studs."""
    if all(ends) or not any(ends):
        return 0.0
    if ends[0]:
        return min(hole.low for hole in holes) - shank.low
    return shank.high - max(hole.high for hole in holes)


def _tapped(shank: CadCylinder, ordered: Sequence[_Around], nuts: Sequence[_Around]) -> _Around | None:
    """The part, farthest from the head or the nut, whose hole fits the thread; tight holes first."""
    if nuts and nuts[0].hole.low > 0.5 * (shank.low + shank.high):
        ordered = ordered[::-1]
    engaged = [a for a in ordered if a.hole.overlap(shank) >= _ENGAGED * 2.0 * shank.radius]
    for most in (_TIGHT, FITS[1] + _SLACK):
        fitting = [a for a in engaged if a.ratio <= most]
        if fitting:
            return fitting[-1]
    return None


def size_of(part: CadPart, diameter: float, inch: bool = False) -> str | None:
    """The thread of a shank: by the name of the part where it fits, else by a nominal diameter or a core, of metric
    threads first, of unified ones where the file is in ``inch``.

    >>> bolt = CadPart("bolt", ("bolt",), 1, 1, 1, (0,) * 3, (0,) * 3, (0,) * 3, None, (), None, 1)
    >>> size_of(bolt, 10.0), size_of(bolt, 6.35, inch=True), size_of(bolt, 4.773), size_of(bolt, 7.3)
    ('M10', '1/4 UNC', 'M6', None)
    """
    text = " ".join(part.path[-1:]).upper().replace("_", " ")
    found = re.search(r"\bM(\d{1,2}(?:[.,]\d)?)(?!\d)", text)
    names = [f"M{found[1].replace(',', '.')}"] if found else []
    for name in names:
        size = thread_named(name)
        if size is not None and 0.97 * size.core_diameter <= diameter <= (1 + _SIZES) * size.diameter:
            return name
    metric, unified = tuple(f"M{d:g}" for d in _METRIC), _UNIFIED
    trials = [(metric, "diameter"), (metric, "core_diameter"), (unified, "diameter")]
    if inch:
        trials = [trials[2], *trials[:2]]
    for series, attribute in trials:
        sizes = [(name, size) for name in series if (size := thread_named(name)) is not None]
        off, name = min((abs(diameter / getattr(size, attribute) - 1.0), name) for name, size in sizes)
        if off <= _SIZES:
            return name
    return None
