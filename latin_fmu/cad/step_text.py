"""What a STEP file says of its unit of length, of materials and densities, from its text.

The geometry is read by a library; of these entities it hands on the colours alone.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Final

UNITS: Final = MappingProxyType({"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 25.4e-3, "ft": 0.3048, "um": 1e-6})
"""Units of length that ``--unit`` takes, m."""
MOST: Final = 200_000_000  # bytes of a file whose text is looked through
_ENTITY: Final = re.compile(r"#(\d+)\s*=\s*([^;]*);", re.DOTALL)
_NUMBER: Final = re.compile(r"#(\d+)")
_TEXT: Final = re.compile(r"'((?:[^']|'')*)'")
_PREFIXES: Final = MappingProxyType({"MILLI": "mm", "CENTI": "cm", "MICRO": "um", "$": "m", "": "m"})
_CONVERTED: Final = MappingProxyType({"INCH": "in", "FOOT": "ft", "MILLIMETRE": "mm", "CENTIMETRE": "cm"})
_METALS: Final = (300.0, 25000.0)  # kg/m3, between which a density is one of a solid


@dataclass
class StepText:
    """What is found: the unit of length, None where it is not known; materials and densities, kg/m3, by product."""

    unit: str | None = None
    materials: dict[str, str] = field(default_factory=dict)
    densities: dict[str, float] = field(default_factory=dict)


def read_step_text(path: Path) -> StepText:
    """Unit, materials and densities of a STEP file."""
    if path.stat().st_size > MOST:
        return StepText()
    text = path.read_text(encoding="utf-8", errors="replace")
    return StepText(_unit(text), *_properties(text))


def _unit(text: str) -> str | None:
    """Unit of length of the shapes: that of the first context that assigns units."""
    context = re.search(r"GLOBAL_UNIT_ASSIGNED_CONTEXT\s*\(\s*\(([^)]*)\)", text)
    if context is None:
        return None
    for number in _NUMBER.findall(context[1]):
        entity = re.search(rf"#{number}\s*=\s*([^;]*);", text)
        words = re.sub(r"\s+", "", entity[1]) if entity is not None else ""
        if "LENGTH_UNIT()" not in words:
            continue
        converted = re.search(r"CONVERSION_BASED_UNIT\('([A-Za-z]+)'", words)
        if converted is not None:
            return _CONVERTED.get(converted[1].upper())
        plain = re.search(r"SI_UNIT\((?:\.(\w+)\.|(\$)),\.METRE\.\)", words)
        if plain is not None:
            return _PREFIXES.get(plain[1] or "")
    return None


def _properties(text: str) -> tuple[dict[str, str], dict[str, float]]:
    """Materials and densities that representations of property definitions name, by product."""
    if "PROPERTY_DEFINITION_REPRESENTATION" not in text:
        return {}, {}
    entities = {int(found[1]): found[2] for found in _ENTITY.finditer(text)}
    materials, densities = dict[str, str](), dict[str, float]()
    for body in entities.values():
        if not body.startswith("PROPERTY_DEFINITION_REPRESENTATION"):
            continue
        numbers = [int(n) for n in _NUMBER.findall(body)][:2]
        if len(numbers) < 2:
            continue
        product = _product(numbers[0], entities)
        if product is None:
            continue
        for kind, name, value in _items(numbers[1], entities):
            if kind == "text" and "material" in name and value and product not in materials:
                materials[product] = value
            if kind == "number" and "density" in name:
                density = _density(float(value))
                if density is not None:
                    densities.setdefault(product, density)
    return materials, densities


def _items(representation: int, entities: Mapping[int, str]) -> Iterator[tuple[str, str, str]]:
    """Items of a representation: their kind, name in small letters and value."""
    whole = entities.get(representation, "")
    heading = " ".join(_TEXT.findall(whole)).lower()
    for number in _NUMBER.findall(whole):
        body = entities.get(int(number), "")
        words = _TEXT.findall(body)
        if "DESCRIPTIVE_REPRESENTATION_ITEM" in body and len(words) >= 2:
            yield "text", f"{heading} {words[0].lower()}", words[1].strip()
        measure = re.search(r"MEASURE\s*\(\s*([-+0-9.eE]+)\s*\)", body)
        if "MEASURE_REPRESENTATION_ITEM" in body and measure is not None:
            yield "number", f"{heading} {' '.join(words).lower()}", measure[1]


def _product(definition: int, entities: Mapping[int, str], depth: int = 6) -> str | None:
    """Name of the product that a property definition belongs to, along its references."""
    body = entities.get(definition, "")
    if re.match(r"PRODUCT\s*\(", body):
        words = _TEXT.findall(body)
        return (words[1] if len(words) > 1 and words[1] else words[0]) if words else None
    if depth == 0:
        return None
    for number in _NUMBER.findall(body):
        if (name := _product(int(number), entities, depth - 1)) is not None:
            return name
    return None


def _density(value: float) -> float | None:
    """A density as kg/m3, from one in kg/m3, g/cm3, kg/mm3 or t/mm3; None where it is of no solid."""
    for factor in (1.0, 1e3, 1e9, 1e12):
        if _METALS[0] <= value * factor <= _METALS[1]:
            return value * factor
    return None
