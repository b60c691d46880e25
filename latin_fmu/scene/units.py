"""Systems of units: what a unit of SI is called in the system of a scene, and how large it is there.

Numbers are not converted. The equations hold in every consistent system; its names label the results, and its sizes
scale what is compared with numbers in SI, such as plausible ranges, and what has a unit beside it: files of numbers and
texts such as "5.5 N m".
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from math import prod
from types import MappingProxyType
from typing import Final, Literal

from .unit_texts import unit_size

_FACTOR: Final = re.compile(r"([A-Za-z%]+|1)(-?[0-9]+)?")
_RAISED: Final = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")

ACCELERATION: Final = "m s-2"
AS_G: Final = " as g"
"""Behind a unit of acceleration whose numbers are shown in g."""
SystemName = Literal["SI", "mm-t-s-MPa", "in-lbf-s-psi", "none"]


def unit_text(unit: str, figure: bool = False) -> str:
    """A UDUNITS string as people write it, ``figure``: with raised digits.

    >>> unit_text("m s-2"), unit_text("m s-2", figure=True), unit_text("N s"), unit_text("1")
    ('m/s2', 'm/s²', 'N s', '')
    """
    above: list[str] = []
    below: list[str] = []
    for name, power in _factors(unit):
        if name != "1":
            size = power.lstrip("-")
            if size == "1":
                raised = ""
            else:
                if figure:
                    raised = size.translate(_RAISED)
                else:
                    raised = size
            (below if power.startswith("-") else above).append(name + raised)
    text = " ".join(above) or "1" * bool(below)  # "1/s" of what stands below alone
    if below:
        return "/".join([text, *below])
    return text


def _factors(unit: str) -> list[tuple[str, str]]:
    """Names and powers of the factors of a UDUNITS string, which has whole powers: it takes ``.5`` as a factor."""
    matches = [_FACTOR.fullmatch(factor) for factor in unit.split()]
    return [(match[1], match[2] or "1") for match in matches if match is not None]


@dataclass(frozen=True)
class UnitSystem:
    """A consistent system of units.

    Attributes
    ----------
    name : as in a scene. names : by the unit of SI, a UDUNITS string each; those of SI where left out, and "1" in a
    system of pure numbers, which leaves only the second. in_g : whether accelerations are shown in g, 9.80665 m s-2,
    by figures, texts and tables; numbers and stored results stay in the system.

    >>> UNIT_SYSTEMS["mm-t-s-MPa"].label("N s m-1"), UNIT_SYSTEMS["mm-t-s-MPa"]["kg m-3"]
    ('N s mm-1', 't/mm3')
    >>> UNIT_SYSTEMS["mm-t-s-MPa"].size("m s-2"), UNIT_SYSTEMS["SI"]["Pa"]
    (0.001, 'Pa')
    """

    name: SystemName
    names: Mapping[str, str]
    in_g: bool = False

    def label(self, unit: str) -> str:
        """What a unit of SI is called, both UDUNITS strings."""
        parts = []
        for name, power in _factors(unit):
            text = self.names.get(name, name)
            if text != "1":
                # a name of two words, raised to a power, would raise the last one only
                assert power == "1" or " " not in text, unit
                parts.append(text if power == "1" else text + power)
        return " ".join(parts) or "1"

    def __getitem__(self, unit: str) -> str:
        """What a unit of SI (UDUNITS string) is called in messages."""
        label = self.label(unit)
        if label == "1":
            return "units"
        return unit_text(label)

    def shown(self, unit: str) -> str:
        """Unit for ``readable`` of what has one of SI: that of ``label``, marked where it is shown in g.

        >>> SI.shown("m s-2"), SI.with_g.shown("m s-2"), SI.with_g.shown("N")
        ('m s-2', 'm s-2 as g', 'N')
        """
        if self.in_g and unit == ACCELERATION:
            return self.label(unit) + AS_G
        return self.label(unit)

    @property
    def with_g(self) -> "UnitSystem":
        """The same system, with accelerations shown in g."""
        return replace(self, in_g=True)

    @property
    def measurable(self) -> bool:
        """Whether numbers can be compared with those in SI."""
        return self.name != "none"

    # one object for each name: systems are compared by identity after unpickling, too
    def __reduce__(self) -> tuple[Callable[[object, bool], "UnitSystem"], tuple[str, bool]]:
        return system_named, (self.name, self.in_g)

    def size(self, unit: str) -> float:
        """Size in SI of what a unit of SI is called here."""
        return float(self.exact_size(unit))

    def exact_size(self, unit: str) -> Fraction:
        """Size in SI of what a unit of SI is called here, without round-off."""
        return prod((self._size(name) ** int(power) for name, power in _factors(unit)), start=Fraction(1))

    def _size(self, name: str) -> Fraction:
        """Of one name of SI; 1 of one that is the same here, and of pure numbers."""
        size = None
        if name in self.names:
            size = unit_size(self.names[name], name)
        if size is None:
            return Fraction(1)
        return size


_NAMES: Final[Mapping[SystemName, dict[str, str]]] = MappingProxyType(
    {
        "mm-t-s-MPa": {"m": "mm", "kg": "t", "Pa": "MPa", "J": "mJ", "W": "mW"},
        "in-lbf-s-psi": {
            "m": "in", "kg": "lbf s2 in-1", "N": "lbf", "Pa": "psi", "J": "lbf in", "W": "lbf in s-1",
        },
        "none": dict.fromkeys(("m", "kg", "N", "Pa", "J", "W"), "1"),
    }
)  # fmt: skip
"""What units of SI are called in other consistent systems of seconds."""

SI: Final = UnitSystem("SI", MappingProxyType({}))
UNIT_SYSTEMS: Final[Mapping[str, UnitSystem]] = MappingProxyType(
    {"SI": SI, **{name: UnitSystem(name, MappingProxyType(names)) for name, names in _NAMES.items()}}
)
"""The systems by name; "none": pure numbers, as in papers."""
PREFIXED: Final = frozenset({"m", "kg", "s", "N", "Pa", "J", "W", "Hz", "B"})
"""Units that are written with a prefix, such as kN: those of SI. Those of other systems stay as they are."""


def system_named(name: object, in_g: bool = False) -> UnitSystem:
    """The system of a name; SI for what names none."""
    if isinstance(name, str):
        system = UNIT_SYSTEMS.get(name, SI)
    else:
        system = SI
    if in_g and system.measurable:
        return system.with_g
    return system
