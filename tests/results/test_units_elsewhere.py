"""Units of results as UDUNITS and pint read them: of every quantity that the package stores, in every system."""

from __future__ import annotations

import importlib
import pkgutil
import re
from collections.abc import Iterator
from functools import cache

import pytest

import latin_fmu
from latin_fmu.calibration.data import MEASURABLE
from latin_fmu.parametric.point import QUANTITIES
from latin_fmu.results.quantities import StoredQuantity
from latin_fmu.scene.quantity_table import RUN_SCALARS
from latin_fmu.scene.unit_texts import QUANTITIES as UNITS
from latin_fmu.scene.unit_texts import unit_size
from latin_fmu.scene.units import UNIT_SYSTEMS, UnitSystem

BASE = {
    "kg": (1, 0, 0),
    "m": (0, 1, 0),
    "s": (0, 0, 1),
    "Hz": (0, 0, -1),
    "N": (1, 1, -2),
    "Pa": (1, -1, -2),
    "J": (1, 2, -2),
    "W": (1, 2, -3),
    "rad": (0, 0, 0),
    "K": (0, 0, 0),
    "1": (0, 0, 0),
}
"""Powers of kilogram, metre and second; temperatures are left as they are."""
FACTOR = re.compile(r"([A-Za-z]+|1)(-?[0-9]+)?")


@cache
def stored() -> tuple[str, ...]:
    """Units in SI of all quantities that modules of the package define."""
    found = (
        {q.unit for q in QUANTITIES} | {q.unit for q in RUN_SCALARS.values()} | {m.unit for m in MEASURABLE.values()}
    )
    for module in pkgutil.walk_packages(latin_fmu.__path__, "latin_fmu."):
        if module.name.rpartition(".")[2].startswith("_"):
            continue
        for value in vars(importlib.import_module(module.name)).values():
            rows = value.values() if isinstance(value, dict) else ()
            found |= {row.unit for row in rows if isinstance(row, StoredQuantity) and row.unit}
    return tuple(sorted(found))


def dimension(unit: str) -> tuple[int, int, int]:
    """Powers of kilogram, metre and second of a unit in SI; whole ones, or an error."""
    total = [0, 0, 0]
    for part in unit.split():
        match = FACTOR.fullmatch(part)
        assert match is not None, f"{unit}: UDUNITS takes a broken power as a factor"
        total = [t + int(match[2] or 1) * p for t, p in zip(total, BASE[match[1]], strict=True)]
    return tuple(total)  # type: ignore[return-value]


def base_unit(unit: str) -> str:
    """The unit by its dimension, in kilogram, metre, second and kelvin."""
    named = [f"{name}{power}" for name, power in zip(("kg", "m", "s"), dimension(unit), strict=True) if power]
    kelvin = [part for part in unit.split() if part.startswith("K")]
    return " ".join([*named, *kelvin]) or "1"


def cases() -> Iterator[tuple[UnitSystem, str]]:
    return ((system, unit) for system in UNIT_SYSTEMS.values() if system.measurable for unit in stored())


def test_all_kinds_of_results_are_among_them() -> None:
    assert {"N", "m", "m s-2", "J", "Pa", "Hz", "N s", "kg", "W", "s", "m2", "J m-2", "N m"} <= set(stored())
    for unit in stored():
        dimension(unit)


def test_udunits_reads_dimension_and_factor() -> None:
    """By the library itself, through cf-units."""
    cf_units = pytest.importorskip("cf_units")
    for system, unit in cases():
        label = system.label(unit)
        read = cf_units.Unit(label)
        assert read.is_convertible(base_unit(unit)), (system.name, label)
        assert read.convert(1.0, base_unit(unit)) == pytest.approx(system.size(unit), rel=1e-12), (system.name, label)


def test_pint_reads_dimension_and_factor() -> None:
    """With powers behind the units as in UDUNITS, which pint takes from a function."""
    pint = pytest.importorskip("pint")
    power = re.compile(r"(?<=[A-Za-z])(?=-?[0-9])")
    registry = pint.UnitRegistry(preprocessors=[lambda text: power.sub("**", text)])
    for system, unit in cases():
        label = system.label(unit)
        one = registry.Quantity(1.0, registry.parse_units(" * ".join(label.split())) if label != "1" else "")
        expected = registry.parse_units(" * ".join(base_unit(unit).split())) if base_unit(unit) != "1" else ""
        assert one.to(expected).magnitude == pytest.approx(system.size(unit), rel=1e-9), (system.name, label)


def test_units_of_files_and_scenes_are_those_of_udunits() -> None:
    """Names of units beside files of numbers, and of values with units, as far as UDUNITS has them."""
    cf_units = pytest.importorskip("cf_units")
    words = {"%": "percent", "kip": "1000 lbf", "ksi": "1000 psi", "lb": "pound", "lbf in": "lbf inch"}
    words["g^2/Hz"] = "gravity^2/Hz"
    for si, (_, names) in UNITS.items():
        for name in names if si != "GB" else ():  # a bel there
            read = cf_units.Unit(
                "gravity" if (si, name) == ("m s-2", "g") else words.get(name, name).replace("deg", "degree")
            )
            assert read.convert(1.0, si) == pytest.approx(float(unit_size(name, si) or 0), rel=1e-8), name
