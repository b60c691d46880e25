"""Names by which screws, nuts and washers are known: words of several languages and numbers of standards."""

from __future__ import annotations

import re
from collections.abc import Sequence
from fnmatch import fnmatchcase
from itertools import pairwise
from typing import Final

_SCREWS: Final = (
    "*bolt",
    "bolts",
    "*screw",
    "screws",
    "*schraube",
    "*schrauben",
    "stud",
    "studs",
    "shcs",
    "hhcs",
    "bhcs",
)
_NUTS: Final = ("nut", "nuts", "locknut*", "hexnut*", "*mutter")
_WASHERS: Final = ("*washer", "*washers", "*scheibe", "*scheiben")
_STANDARDS: Final = frozenset(
    {84, 912, 931, 933, 938, 939, 960, 961, 963, 964, 965, 966, 1207, 1580, 2009, 2010, 4014, 4017, 4762, 4766, 6912}
    | {6921, 7045, 7046, 7047, 7380, 7984, 7985, 7991, 8676, 8765, 10642, 14579, 14580, 14581, 14583, 14584}
)
_NUT_STANDARDS: Final = frozenset({934, 936, 985, 4032, 4033, 4034, 4035, 6923, 7040, 8673, 10511})
_MOST_OF_NAME: Final = frozenset({"iso", "din", "en"})


def words_of_name(name: str) -> list[str]:
    """Words of a name, in small letters, numbers apart.

    >>> words_of_name("ISO 4762-M6x20"), words_of_name("hexBolt_3")
    (['iso', '4762', 'm', '6', 'x', '20'], ['hex', 'bolt', '3'])
    """
    return re.findall(r"[a-z]+|\d+", re.sub(r"([a-z])([A-Z])", r"\1 \2", name).lower())


def fits(words: Sequence[str], patterns: Sequence[str], numbers: frozenset[int] = frozenset()) -> bool:
    """Whether a word fits one of the patterns, or the words name one of the standards with these numbers."""
    standard = any(a in _MOST_OF_NAME and b.isdigit() and int(b) in numbers for a, b in pairwise(words))
    return standard or any(fnmatchcase(word, pattern) for word in words for pattern in patterns)


def is_screw(words: Sequence[str]) -> bool:
    """Whether these are words of a name of a screw.

    >>> is_screw(words_of_name("din_912_m4x12_1")), is_screw(words_of_name("dowel pin"))
    (True, False)
    """
    return fits(words, _SCREWS, _STANDARDS)


def is_nut(words: Sequence[str]) -> bool:
    """Whether these are words of a name of a nut."""
    return fits(words, _NUTS, _NUT_STANDARDS)


def is_washer(words: Sequence[str]) -> bool:
    """Whether these are words of a name of a washer."""
    return fits(words, _WASHERS)
