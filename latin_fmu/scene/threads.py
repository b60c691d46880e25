"""Sizes of threads, metric and unified, and the yield stresses of property classes."""

import math
import re
from dataclasses import dataclass
from fractions import Fraction
from typing import Final

_COARSE_PITCHES: Final = {
    1.6: 0.35, 2: 0.4, 2.5: 0.45, 3: 0.5, 3.5: 0.6, 4: 0.7, 5: 0.8, 6: 1, 7: 1, 8: 1.25, 10: 1.5, 12: 1.75, 14: 2,
    16: 2, 18: 2.5, 20: 2.5, 22: 2.5, 24: 3, 27: 3, 30: 3.5, 33: 3.5, 36: 4, 39: 4, 42: 4.5, 45: 4.5, 48: 5, 52: 5,
    56: 5.5, 60: 5.5, 64: 6,
}  # fmt: skip
"""Pitch of the coarse metric threads by their nominal diameter (ISO 261), mm."""
_UNC: Final = {
    "#1": 64, "#2": 56, "#3": 48, "#4": 40, "#5": 40, "#6": 32, "#8": 32, "#10": 24, "#12": 24, "1/4": 20, "5/16": 18,
    "3/8": 16, "7/16": 14, "1/2": 13, "9/16": 12, "5/8": 11, "3/4": 10, "7/8": 9, "1": 8,
}  # fmt: skip
_UNF: Final = {
    "#0": 80, "#1": 72, "#2": 64, "#3": 56, "#4": 48, "#5": 44, "#6": 40, "#8": 36, "#10": 32, "#12": 28, "1/4": 28,
    "5/16": 24, "3/8": 24, "7/16": 20, "1/2": 20, "9/16": 18, "5/8": 18, "3/4": 16, "7/8": 14, "1": 12,
}  # fmt: skip
"""Threads per inch of the unified coarse and fine series by size (ASME B1.1)."""
_METRIC: Final = re.compile(r"M(\d{1,3}(?:\.\d+)?)(?:x(\d{1,3}(?:\.\d+)?))?")
_UNIFIED: Final = re.compile(r"(#\d{1,2}|\d/\d{1,2}|1)(?:-(\d{1,2}))?(?: (UNC|UNF))?")
_INCH: Final = 25.4
# A_s = pi / 4 (d - c P)^2, core diameter d - c' P: ISO 898-1 and ISO 724; ASME B1.1, appendix B and the UNR profile
_OF_METRIC: Final = (3.0 / 4.0 + 17.0 / 12.0) * math.sqrt(3.0) / 4.0, 17.0 / 12.0 * math.sqrt(3.0) / 2.0
_OF_UNIFIED: Final = 0.9743, 1.19078


@dataclass(frozen=True)
class ThreadSize:
    """A thread, lengths in mm.

    Attributes
    ----------
    diameter : nominal. pitch : P. stressed, core : what the diameters of stress area and core are less than the nominal
        one, over the pitch.
    """

    diameter: float
    pitch: float
    stressed: float
    core: float

    @property
    def stress_area(self) -> float:
        """Tensile stress area A_s, mm2."""
        return math.pi / 4.0 * self.stress_diameter**2

    @property
    def stress_diameter(self) -> float:
        """Diameter d_S of the stress area, mm."""
        return self.diameter - self.stressed * self.pitch

    @property
    def flank_diameter(self) -> float:
        """Pitch diameter d_2, mm: d - 3/8 sqrt(3) P, of metric (ISO 724) and unified threads alike."""
        return self.diameter - 0.375 * math.sqrt(3.0) * self.pitch

    @property
    def core_diameter(self) -> float:
        """Diameter at the root of the thread, d_3, mm."""
        return self.diameter - self.core * self.pitch


def thread_named(text: str) -> ThreadSize | None:
    """A metric or unified thread; None where the text is none, or names no pitch of a size without a coarse one.

    >>> thread_named("M6").pitch, thread_named("M10x1").pitch, thread_named("M6.1")
    (1.0, 1.0, None)
    >>> round(thread_named("1/4-20 UNC").diameter, 2), round(thread_named("#10 UNF").pitch, 3)
    (6.35, 0.794)
    """
    if (found := _METRIC.fullmatch(text)) is not None:
        diameter = float(found[1])
        pitch = float(found[2] or _COARSE_PITCHES.get(diameter, 0.0))
        # beyond half of the diameter there is no core to speak of
        if 0.0 < pitch < 0.5 * diameter:
            return ThreadSize(diameter, pitch, *_OF_METRIC)
        return None
    if (found := _UNIFIED.fullmatch(text)) is None:
        return None
    size = found[1]
    count = int(found[2] or 0)
    series = found[3]
    counts = {name: table.get(size, 0) for name, table in (("UNC", _UNC), ("UNF", _UNF))}
    # without a series the number of threads has to be one of the two
    allowed = tuple(counts.values())
    if series is not None:
        count = count or counts[series]
        allowed = (counts[series],)
    if not count or count not in allowed:
        return None
    if size.startswith("#"):
        inches = 0.06 + 0.013 * int(size[1:])
    else:
        inches = float(Fraction(size))
    return ThreadSize(_INCH * inches, _INCH / count, *_OF_UNIFIED)


def tensile_stress_area(thread: str) -> float:
    """A_s of a thread, mm2: pi / 4 ((d2 + d3) / 2)^2 (ISO 898-1), with the pitch diameter d2 = d - 3/4 H and the core
    diameter d3 = d - 17/12 H (ISO 724), H = sqrt(3) / 2 P; of a unified one pi / 4 (d - 0.9743 P)^2 (ASME B1.1).

    >>> round(tensile_stress_area("M6"), 1), round(tensile_stress_area("1/4-20"), 1)
    (20.1, 20.5)
    """
    size = thread_named(thread)
    assert size is not None, thread
    return size.stress_area


_ISO: Final = re.compile(r"(\d{1,2})\.(\d)")
_NAMED: Final = {
    "A2-50": 210.0, "A2-70": 450.0, "A2-80": 600.0, "A4-50": 210.0, "A4-70": 450.0, "A4-80": 600.0,
    "grade 2": 393.0, "grade 5": 634.0, "grade 8": 896.0,
}  # fmt: skip
"""Yield stress of stainless screws (ISO 3506-1) and of the grades of SAE J429, MPa."""
_CLASSES: Final = ("4.6", "4.8", "5.6", "5.8", "6.8", "8.8", "9.8", "10.9", "12.9")
CLASSES: Final = (*_CLASSES, *_NAMED)


def class_yield(name: str) -> float | None:
    """Nominal yield stress of a property class, MPa: of "8.8" 8 x 8 x 10 (ISO 898-1); None where there is none.

    >>> class_yield("8.8"), class_yield("A2-70"), class_yield("8.9")
    (640.0, 450.0, None)
    """
    if name in _NAMED:
        return _NAMED[name]
    found = _ISO.fullmatch(name)
    if found is not None and name in _CLASSES:
        return 10.0 * int(found[1]) * int(found[2])
    return None


_MINIMA: Final = {"9.8": 720.0, "10.9": 940.0, "12.9": 1100.0}
_LARGE: Final = 16.0  # mm, nominal diameter above which class 8.8 has more
_LARGE_88: Final = 660.0


def class_minimum(name: str, diameter: float) -> float | None:
    """Least R_p0.2 of a property class, MPa (ISO 898-1, table 3), which VDI 2230 takes: of "8.8" 640, from a nominal
    ``diameter`` above 16 mm on 660; of classes without one the nominal yield stress.

    >>> class_minimum("8.8", 10.0), class_minimum("8.8", 20.0), class_minimum("10.9", 10.0)
    (640.0, 660.0, 940.0)
    """
    if name == "8.8" and diameter > _LARGE:
        return _LARGE_88
    return _MINIMA.get(name, class_yield(name))
