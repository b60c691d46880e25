"""Numbers with SI prefixes, for people to read."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

_PREFIXES: Final = {-15: "f", -12: "p", -9: "n", -6: "u", -3: "m", 0: "", 3: "k", 6: "M", 9: "G", 12: "T"}


def prefix_for(largest: float, unit: str, micro: str = "u") -> tuple[float, str]:
    """Divisor and prefixed unit that bring ``largest`` between 1 and 1000.

    Micro is written "u", which every terminal can print; figures pass ``micro="µ"``.

    >>> prefix_for(2.5e-5, "s")
    (1e-06, 'us')
    """
    size = abs(largest)
    if not math.isfinite(size) or size == 0.0:
        return 1.0, unit
    power = 3 * math.floor(math.log10(size * (1 + 1e-12)) / 3)
    power = min(max(power, min(_PREFIXES)), max(_PREFIXES))
    return float(f"1e{power}"), (micro if power == -6 else _PREFIXES[power]) + unit


def readable(value: float | None, unit: str, digits: int = 4) -> str:
    """``value`` with a prefixed unit and ``digits`` significant digits; ``-`` for None.

    >>> readable(26800.0, "N")
    '26.80 kN'
    """
    if value is None:
        return "-"
    divisor, label = prefix_for(value, unit)
    return f"{_digits(value / divisor, digits)} {label}"


def readable_vector(values: Sequence[float], unit: str, digits: int = 4) -> str:
    """Components with one common prefix, e.g. ``(0, 0, -3.9) mN s``; components below round-off are 0."""
    size = max((abs(value) for value in values), default=0.0)
    divisor, label = prefix_for(size, unit)
    shown = (0.0 if abs(value) < 1e-6 * size else value / divisor for value in values)
    return f"({', '.join(_digits(value, digits) for value in shown)}) {label}"


def _digits(value: float, digits: int) -> str:
    """Significant digits, trailing zeros kept; a plain 0 for zero."""
    return "0" if value == 0.0 else f"{value:#.{digits}g}".rstrip(".")
