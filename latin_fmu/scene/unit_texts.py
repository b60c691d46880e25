"""Texts of units, and values with units: ``"kN"``, ``"m/s^2"``, ``"44 lbf in"``; for scenes, histories and meshes.

A unit is a product of names with whole powers, ``N m``, ``N*m``, ``N.m``, ``lbf-in``, ``kg m-3``, ``m/s2``, ``m/s^2``;
behind a stroke stands one factor, or several in brackets: ``N/(m s)``; a unit in brackets may have a power,
``(m/s2)^2/Hz``. Sizes are exact fractions, so that "20 um" is
the same number as 20e-6. ``g`` is the acceleration of gravity or a gram, by the dimension that is wanted.

Angles and cycles have dimensions of their own: 1 Hz is no 1/s (but 2 pi rad/s), and an angle is no pure number.
"""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from types import MappingProxyType
from typing import Final, NamedTuple

GRAVITY: Final = 9.80665
"""Standard acceleration of gravity, m s-2 (ISO 80000-3)."""


@dataclass(frozen=True)
class UnitSize:
    """A unit: its size in SI, and the powers of kg, m, s, K, rad, cycle and byte in it."""

    size: Fraction
    powers: tuple[int, ...]

    def times(self, other: "UnitSize", power: int = 1) -> "UnitSize":
        """The product with a power of another unit."""
        powers = tuple(a + power * b for a, b in zip(self.powers, other.powers, strict=True))
        return UnitSize(self.size * other.size**power, powers)


_BASES: Final = ("kg", "m", "s", "K", "rad", "cycle", "B")
_ONE: Final = UnitSize(Fraction(1), (0,) * len(_BASES))
_PI: Final = Fraction(math.pi)
_DEFINITIONS: Final[Mapping[str, tuple[str | Fraction, str]]] = MappingProxyType(
    {
        "1": ("1", ""),
        "%": ("1e-2", ""),
        "ppm": ("1e-6", ""),
        "N": ("1", "kg m s-2"),
        "Pa": ("1", "N m-2"),
        "J": ("1", "N m"),
        "W": ("1", "J s-1"),
        "Hz": ("1", "cycle s-1"),
        "Nm": ("1", "N m"),
        "Nmm": ("1e-3", "N m"),
        "bar": ("1e5", "Pa"),
        "t": ("1e3", "kg"),
        "min": ("60", "s"),
        "h": ("3600", "s"),
        "deg": (_PI / 180, "rad"),
        "rev": (2 * _PI, "rad"),
        "rpm": ("1", "rev min-1"),
        "in": ("0.0254", "m"),
        "inch": ("1", "in"),
        "ft": ("12", "in"),
        "lb": ("0.45359237", "kg"),
        "lbm": ("1", "lb"),
        "lbf": ("9.80665", "lb m s-2"),
        "slug": ("1", "lbf s2 ft-1"),
        "kip": ("1e3", "lbf"),
        "psi": ("1", "lbf in-2"),
        "ksi": ("1e3", "psi"),
        "kgf": ("9.80665", "N"),
    }
)
"""Size and unit that a name stands for; pound and inch by the agreement of 1959, exactly."""
_PREFIXES: Final[Mapping[str, tuple[str, frozenset[str]]]] = MappingProxyType(
    {
        "n": ("1e-9", frozenset({"m", "s"})),
        "u": ("1e-6", frozenset({"m", "s", "g", "N", "Pa", "rad"})),
        "m": ("1e-3", frozenset({"m", "s", "g", "N", "Pa", "J", "W", "K", "Hz", "rad", "bar", "Nm"})),
        "c": ("1e-2", frozenset({"m"})),
        "d": ("1e-1", frozenset({"m"})),
        "da": ("10", frozenset({"N"})),
        "h": ("1e2", frozenset({"Pa"})),
        "k": ("1e3", frozenset({"m", "g", "N", "Pa", "J", "W", "Hz", "B", "Nm"})),
        "M": ("1e6", frozenset({"N", "Pa", "J", "W", "Hz", "B", "Nm"})),
        "G": ("1e9", frozenset({"N", "Pa", "J", "W", "Hz", "B"})),
    }
)
"""Size of a prefix, and the names before which it stands: "Ms" and "cd" are slips, or mean other things."""


class Dimension(NamedTuple):
    """What has a unit, in words, and names of units that messages offer for it."""

    words: str
    names: tuple[str, ...]


DENSITY: Final = "m2 s-4 Hz-1"
"""Unit (UDUNITS, SI) of power spectral densities of accelerations."""
QUANTITIES: Final[Mapping[str, Dimension]] = MappingProxyType(
    {
        "s": Dimension("a time", ("s", "ms", "us", "ns", "min", "h")),
        "N": Dimension("a force", ("N", "mN", "kN", "MN", "lbf", "kip")),
        "N m": Dimension("a moment", ("N m", "N mm", "kN m", "lbf in", "lbf ft")),
        "Pa": Dimension("a pressure", ("Pa", "kPa", "MPa", "GPa", "bar", "psi", "ksi")),
        "m": Dimension("a length", ("m", "cm", "mm", "um", "in", "ft")),
        "m s-1": Dimension("a velocity", ("m/s", "cm/s", "mm/s", "km/h", "in/s", "ft/s")),
        "m s-2": Dimension("an acceleration", ("m/s2", "mm/s2", "g", "in/s2", "ft/s2")),
        "N m-3": Dimension("a force per volume", ("N/m3", "kN/m3", "N/mm3")),
        "K": Dimension("a change of temperature", ("K",)),
        "rad s-1": Dimension("an angular velocity", ("rad/s", "deg/s", "rpm")),
        "1": Dimension("a pure number", ("1", "%")),
        "kg": Dimension("a mass", ("kg", "g", "t", "lb")),
        "kg m-3": Dimension("a density", ("kg/m3", "g/cm3", "t/mm3")),
        "kg m2": Dimension("a moment of inertia", ("kg m2", "kg mm2", "g mm2")),
        "N m-1": Dimension("a stiffness", ("N/m", "N/mm", "kN/mm", "lbf/in")),
        "N s m-1": Dimension("a viscosity", ("N s/m", "N s/mm", "lbf s/in")),
        "N s m-3": Dimension("a force per area and velocity", ("N s/m3", "MPa s/mm", "N s/mm3")),
        "Pa s m-1": Dimension("a pressure per velocity", ("Pa s/m", "MPa s/m", "MPa s/mm")),
        "K-1": Dimension("an expansion per kelvin", ("1/K", "ppm/K", "um/m/K")),
        "s-1": Dimension("a rate", ("1/s", "1/ms")),
        "Hz": Dimension("a frequency", ("Hz", "kHz")),
        "GB": Dimension("an amount of memory", ("GB", "MB")),
        "rad": Dimension("an angle", ("rad", "deg")),
        "m-1": Dimension("a curvature", ("1/m", "1/mm")),
        "m2": Dimension("an area", ("m2", "mm2")),
        DENSITY: Dimension("a spectral density of an acceleration", ("g^2/Hz", "(m/s2)^2/Hz")),
    }
)
"""By the unit in SI, a UDUNITS string."""

_MARKS: Final = str.maketrans({"²": "2", "³": "3", "µ": "u", "μ": "u", "^": None, "·": " ", "\u2212": "-", "*": " "})
_FACTOR: Final = re.compile(r"(%|[A-Za-z]+)(-?[1-9])?|1")
_POWER_OF: Final = re.compile(r"\(([^()]+)\)([1-9])(.*)")
_BETWEEN: Final = re.compile(r"[ .]+|-(?=[A-Za-z])")


def plain_unit(text: str) -> str:
    """A text of a unit without raised digits, Greek letters, and signs of products and powers."""
    return " ".join(text.replace("**", "").translate(_MARKS).split())


def unit_size(text: str, unit: str) -> Fraction | None:
    """Size in SI of a unit by its text, where it has the dimension of ``unit`` (UDUNITS, SI); None where it has not.

    >>> float(unit_size("g", "m s-2")), float(unit_size("g", "kg")), unit_size("g", "m")
    (9.80665, 0.001, None)
    """
    wanted = _product(unit, gravity=False)
    fitting = (found for found in _readings(text) if wanted is not None and found.powers == wanted.powers)
    return next((found.size / wanted.size for found in fitting if wanted is not None), None)


def si_unit(text: str) -> str | None:
    """Unit in SI (UDUNITS) of the quantity that has a unit with this text; None where none has. ``g`` is that of
    gravity.

    >>> si_unit("kN"), si_unit("in/s2"), si_unit("furlong")
    ('N', 'm s-2', None)
    """
    return next((unit for found in _readings(text) for unit in QUANTITIES if _of(unit).powers == found.powers), None)


def words_for(unit: str) -> str:
    """What has a unit of SI, in words."""
    if unit in QUANTITIES:
        return QUANTITIES[unit].words
    return f"a number in {unit}"


def names_for(unit: str) -> str:
    """Names of units of the dimension of one of SI, for messages."""
    if unit in QUANTITIES:
        names = QUANTITIES[unit].names
    else:
        names = (unit,)
    return ", ".join(names)


def is_unit(text: str) -> bool:
    """Whether a text is a unit, of whatever."""
    return any(True for _ in _readings(text))


def _readings(text: str) -> Iterator[UnitSize]:
    """Units that a text may mean: with ``g`` as gravity, and as a gram."""
    for gravity in (True, False):
        if (found := _product(text, gravity)) is not None:
            yield found


def _of(unit: str) -> UnitSize:
    found = _product(unit, gravity=False)
    assert found is not None, unit
    return found


@lru_cache(maxsize=1024)
def _product(text: str, gravity: bool) -> UnitSize | None:
    """A unit by its text, None where it is none."""
    plain = plain_unit(text)
    if power := _POWER_OF.fullmatch(plain):
        inner, rest = _product(power[1], gravity), _product(f"1{power[3]}", gravity)
        return None if inner is None or rest is None else rest.times(inner, int(power[2]))
    above, *below = plain.split("/")
    product = _factors(above, gravity)
    for part in below:
        bare = part.strip()
        found = _factors(bare, gravity)
        # W/m K: whether K is above or below the stroke depends on who writes it
        if found is None or product is None or (_BETWEEN.search(bare) and not bare.startswith("(")):
            return None
        product = product.times(found, -1)
    return product


def _factors(text: str, gravity: bool) -> UnitSize | None:
    """A product without strokes, in brackets or not."""
    bare, product = text.strip(), _ONE
    if bare.startswith("(") and bare.endswith(")"):
        bare = bare[1:-1].strip()
    for word in _BETWEEN.split(bare):
        match = _FACTOR.fullmatch(word)
        found = None
        if match is not None:
            found = _named(match[1] or "1", gravity)
        if match is None or found is None:
            return None
        product = product.times(found, int(match[2] or 1))
    return product


@lru_cache(maxsize=1024)
def _named(name: str, gravity: bool) -> UnitSize | None:
    """A unit by its name, without power."""
    if name in _BASES:
        return UnitSize(Fraction(1), tuple(int(name == base) for base in _BASES))
    if name == "g":
        if gravity:
            return _of("m s-2").times(UnitSize(Fraction(repr(GRAVITY)), _ONE.powers))
        return _of("kg").times(UnitSize(Fraction("1e-3"), _ONE.powers))
    if name in _DEFINITIONS:
        written, of = _DEFINITIONS[name]
        return (_of(of) if of else _ONE).times(UnitSize(Fraction(written), _ONE.powers))
    for prefix, (written, names) in _PREFIXES.items():
        if name.startswith(prefix) and name.removeprefix(prefix) in names:
            # a kilogram is no thousand times the gravity
            found = _named(name.removeprefix(prefix), gravity=False)
            if found is None:
                return None
            return found.times(UnitSize(Fraction(written), _ONE.powers))
    return None


_VALUE: Final = re.compile(r"([-+]?(?:\d{1,30}\.?\d{0,30}|\.\d{1,30})(?:[eE][-+]?\d{1,3})?)(?![\d,])(.*)", re.DOTALL)
_LIKE_NUMBER: Final = re.compile(r"[-+\u2212]?\s*[.,]?\d")


def begins_as_number(text: str) -> bool:
    """Whether a text is meant as a value, with a unit or without."""
    return _LIKE_NUMBER.match(text.strip()) is not None


def value_and_unit(text: str) -> tuple[Fraction, str] | None:
    """The number of a value with a unit, and the text of its unit, which may be empty or none; None without a number.

    >>> value_and_unit("5.5 N m"), value_and_unit("6ms"), value_and_unit("5,5 mm")
    ((Fraction(11, 2), 'N m'), (Fraction(6, 1), 'ms'), None)
    """
    match = _VALUE.fullmatch(text.strip().replace("\u2212", "-"))
    if match is None:
        return None
    return (Fraction(match[1]), match[2].strip())
