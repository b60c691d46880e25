"""Units of the exchanged variables: UDUNITS strings (netCDF) and their FMI names and SI exponents."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class Unit:
    """An SI unit: ``name`` as FMI writes it, ``exponents`` of kg, m, s."""

    name: str
    exponents: Mapping[str, int]


UNITS: Final[Mapping[str, Unit]] = {
    "1": Unit("1", {}),
    "s-1": Unit("1/s", {"s": -1}),
    "s": Unit("s", {"s": 1}),
    "m": Unit("m", {"m": 1}),
    "m s-1": Unit("m/s", {"m": 1, "s": -1}),
    "m s-2": Unit("m/s2", {"m": 1, "s": -2}),
    "W": Unit("W", {"kg": 1, "m": 2, "s": -3}),
    "N": Unit("N", {"kg": 1, "m": 1, "s": -2}),
    "N s": Unit("N.s", {"kg": 1, "m": 1, "s": -1}),
    "J": Unit("J", {"kg": 1, "m": 2, "s": -2}),
    "Pa": Unit("Pa", {"kg": 1, "m": -1, "s": -2}),
}
"""By UDUNITS string."""
