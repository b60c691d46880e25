"""Texts of units, and values with units, beside pint: an independent library with its own table of units."""

from __future__ import annotations

import re
from fractions import Fraction
from itertools import product
from typing import Any

import pytest

from latin_fmu.scene.unit_texts import DENSITY, QUANTITIES, is_unit, si_unit, unit_size, value_and_unit
from latin_fmu.scene.units import SI, UNIT_SYSTEMS

POWER = re.compile(r"(?<=[A-Za-z])(?=-?[0-9])")
WORDS = {"Nm": "N*m", "Nmm": "N*mm", "kNm": "kN*m", "%": "percent", "lb": "pound", "1": ""}


def by_pint(registry: Any, text: str, si: str) -> float:
    """Size in SI of a unit, by pint."""
    words = WORDS.get(text, text).replace("lb ", "pound ")
    if si in ("m s-2", DENSITY):
        words = re.sub(r"\bg\b", "g_0", words)
    words = words.replace("(m/s2)", "(m/s**2)").replace("^", "**")
    parts = [words] if "(" in words else words.split("/")
    above, *below = (" * ".join(POWER.sub("**", part).split()) for part in parts)
    wanted = " * ".join(POWER.sub("**", si).split()) if si != "1" else ""
    made = registry.Quantity(1.0, registry.parse_units("/".join([above, *below]) if below else above))
    return float(made.to(registry.parse_units(wanted)).magnitude)


@pytest.fixture(scope="module")
def registry() -> Any:
    pint = pytest.importorskip("pint")
    return pint.UnitRegistry()


@pytest.mark.parametrize("si", QUANTITIES)
def test_sizes_are_those_of_pint(registry: Any, si: str) -> None:
    for name in QUANTITIES[si].names:
        assert float(unit_size(name, si) or 0) == pytest.approx(by_pint(registry, name, si), rel=1e-9), name


MORE = {
    "N": ("uN", "daN", "kgf", "kg m/s2", "lb ft/s2"),
    "Pa": ("hPa", "mbar", "N/mm2", "lbf/in2"),
    "m": ("nm", "dm", "km", "inch"),
    "N m": ("Nm", "Nmm", "kNm", "J", "mJ"),
    "kg": ("mg", "slug", "lbf s2/in", "N s2/m"),
    "rad s-1": ("mrad/s", "deg/ms", "rpm"),
    "N m-3": ("MPa/mm", "lbf/in3"),
    "kg m2": ("t mm2", "lbf in s2"),
    "s": ("h", "min"),
    "Hz": ("MHz",),
}


@pytest.mark.parametrize(("si", "name"), [(si, name) for si, names in MORE.items() for name in names])
def test_other_products_and_prefixes(registry: Any, si: str, name: str) -> None:
    assert float(unit_size(name, si) or 0) == pytest.approx(by_pint(registry, name, si), rel=1e-9)


@pytest.mark.parametrize(
    ("texts", "si"),
    [
        (("N m", "N*m", "N.m", "N·m", "Nm", "(N m)", "N  m"), "N m"),
        (("m/s2", "m/s^2", "m/s**2", "m s-2", "m.s-2", "m/s/s", "m s^-2", "m/s²", "m/(s s)"), "m s-2"),
        (("lbf in", "lbf-in", "lbf*in"), "N m"),
        (("um", "µm", "μm"), "m"),
        (("N s/m3", "N s m-3", "N/(m3/s)", "Pa s/m", "Pa/(m/s)"), "N s m-3"),
    ],
)
def test_spellings_of_one_unit(texts: tuple[str, ...], si: str) -> None:
    readable = [text for text in texts if "/(m3/" not in text and "/(m/" not in text]  # one stroke in another is none
    sizes = {unit_size(text, si) for text in readable}
    assert len(sizes) == 1
    assert None not in sizes
    assert all(unit_size(text, si) is None for text in texts if text not in readable)


def test_g_is_gravity_or_gram_by_what_is_wanted() -> None:
    assert unit_size("g", "m s-2") == Fraction("9.80665")
    assert unit_size("g", "kg") == Fraction("0.001")
    assert unit_size("g/cm3", "kg m-3") == 1000
    assert unit_size("kg", "kg") == 1
    assert unit_size("kg", "m s-2") is None
    assert unit_size("g", "N") is None
    assert unit_size("mg", "m s-2") is None  # milligram, and no thousandth of gravity


@pytest.mark.parametrize(
    "text", ["", "furlong", "W/m K", "N//m", "/s", "m0", "m--2", "Ms", "cd", "mS", "5", "2 m", "°", "m/"]
)
def test_what_is_no_unit(text: str) -> None:
    assert not is_unit(text)
    assert si_unit(text) is None


def test_angles_and_cycles_are_no_pure_numbers() -> None:
    assert unit_size("deg", "1") is None
    assert unit_size("1/s", "Hz") is None
    assert unit_size("Hz", "s-1") is None
    assert unit_size("rpm", "Hz") is None
    assert unit_size("mm/m", "1") == Fraction(1, 1000)


@pytest.mark.parametrize(
    ("text", "number", "unit"),
    [
        ("5.5 N m", "5.5", "N m"),
        ("6ms", "6", "ms"),
        ("-1.5e-3 m", "-0.0015", "m"),
        ("\u22122 mm", "-2", "mm"),
        (" .5 mm ", "0.5", "mm"),
        ("5. mm", "5", "mm"),
        ("44 lbf in", "44", "lbf in"),
        ("5 %", "5", "%"),
        ("7", "7", ""),
    ],
)
def test_values_with_units(text: str, number: str, unit: str) -> None:
    assert value_and_unit(text) == (Fraction(number), unit)


@pytest.mark.parametrize("text", ["5,5 mm", "1,000 mm", "mm", "", "nan m", "inf m", "--5 m", "1e m,", "0x10 m"])
def test_what_is_no_value(text: str) -> None:
    found = value_and_unit(text)
    assert found is None or not is_unit(found[1])


def test_sizes_of_systems_are_exact() -> None:
    for name, units in UNIT_SYSTEMS.items():
        for unit, power in product(("m", "kg", "N"), (-3, -1, 2)):
            text = f"{unit}{power}"
            assert units.size(text) == float(units.exact_size(unit) ** power), (name, text)
    assert UNIT_SYSTEMS["mm-t-s-MPa"].size("kg m-3") == 1e12
    assert float(Fraction("20") * (unit_size("um", "m") or 0) / SI.exact_size("m")) == 20e-6
