"""Numbers with units as they are printed, and rows of a table in columns."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from .unit_texts import GRAVITY, unit_size
from .units import ACCELERATION, AS_G, PREFIXED, unit_text

_UNPREFIXED: Final = ("m s-2",)  # 4e4 m/s2 rather than 40 km/s2
_PREFIXES: Final = {-15: "f", -12: "p", -9: "n", -6: "u", -3: "m", 0: "", 3: "k", 6: "M", 9: "G", 12: "T"}


def _takes_prefix(unit: str) -> bool:
    """Whether a UDUNITS unit is written with a prefix, which belongs to its first factor alone."""
    return unit not in _UNPREFIXED and not unit.endswith(AS_G) and unit.split()[0] in PREFIXED


def prefix_for(largest: float, unit: str, figure: bool = False) -> tuple[float, str]:
    """Divisor and prefixed unit that bring ``largest`` between 1 and 1000; ``unit`` is a UDUNITS string.

    There is no prefix where the first factor of the unit has a power or is no unit of SI. Micro is written "u", which
    every terminal can print; ``figure``: "µ", and raised digits. Accelerations may be shown in g, see
    ``UnitSystem.shown``.

    >>> prefix_for(2.5e-5, "s"), prefix_for(1.5e-3, "N s"), prefix_for(4e-6, "m2"), prefix_for(0.02, "kg")
    ((1e-06, 'us'), (0.001, 'mN s'), (1.0, 'm2'), (0.001, 'g'))
    """
    size = abs(largest)
    if unit.endswith(AS_G):
        metric = unit_size(unit.removesuffix(AS_G), ACCELERATION)
        assert metric is not None, unit
        return GRAVITY / float(metric), "g"
    if not _takes_prefix(unit) or not math.isfinite(size) or size == 0.0:
        return 1.0, unit_text(unit, figure)
    # the prefix of kg belongs to the gram
    gram, name = 1.0, unit
    if unit.split()[0] == "kg":
        gram, name = 1e3, unit.replace("kg", "g", 1)
    # 1 + 1e-12: 999.9999999999999 is a thousand
    power = 3 * math.floor(math.log10(size * gram * (1 + 1e-12)) / 3)
    power = min(max(power, min(_PREFIXES)), max(_PREFIXES))
    if figure and power == -6:
        prefix = "µ"
    else:
        prefix = _PREFIXES[power]
    return float(f"1e{power}") / gram, prefix + unit_text(name, figure)


def readable(value: float | None, unit: str, digits: int = 4, figure: bool = False) -> str:
    """``value`` with a prefixed unit (UDUNITS) and ``digits`` significant digits; ``-`` for None.

    >>> readable(26800.0, "N"), readable(1.458e-3, "N s"), readable(31250.0, "m s-2"), readable(0.25, "1")
    ('26.80 kN', '1.458 mN s', '3.125e+04 m/s2', '0.25')
    """
    if value is None:
        return "-"
    divisor, label = prefix_for(value, unit, figure)
    if _takes_prefix(unit):
        number = _digits(value / divisor, digits)
    else:
        number = f"{value / divisor:.{digits}g}"
    return f"{number} {label}".rstrip()


def readable_vector(values: Sequence[float], unit: str, digits: int = 4) -> str:
    """Components with one common prefix, e.g. ``(0, 0, -3.9) mN s``; components below round-off are 0."""
    size = max((abs(value) for value in values), default=0.0)
    divisor, label = prefix_for(size, unit)
    shown = (0.0 if abs(value) < 1e-6 * size else value / divisor for value in values)
    return f"({', '.join(_digits(value, digits) for value in shown)}) {label}"


def percent(error: float) -> str:
    """A relative error in per cent, two digits; ``-`` for NaN."""
    if math.isnan(error):
        return "-"
    return f"{100 * error:.2g} %"


def _digits(value: float, digits: int) -> str:
    """Significant digits, trailing zeros kept; a plain 0 for zero."""
    if value == 0.0:
        return "0"
    return f"{value:#.{digits}g}".rstrip(".")


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Columns two spaces apart; the first one to the left, the others to the right."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    cells = [[row[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(row[1:], widths[1:], strict=True))] for row in rows]
    return ["  " + "  ".join(row).rstrip() for row in cells]
