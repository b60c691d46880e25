"""Parameter sets of the SSP standard (.ssv): values of variables by name, with units.

A file of version 1.0 is valid in SSP 2.0, too, so that tools of both read it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final
from xml.etree.ElementTree import Element, SubElement

from .description import xml_bytes

_SSP: Final = "http://ssp-standard.org/SSP1"
NAMESPACES: Final[Mapping[str, str]] = {
    "xmlns:ssd": f"{_SSP}/SystemStructureDescription",
    "xmlns:ssc": f"{_SSP}/SystemStructureCommon",
    "xmlns:ssv": f"{_SSP}/SystemStructureParameterValues",
}
MIME: Final = "application/x-ssp-parameter-set"
Row = tuple[str, str, float | int | str, str | None]
"""Variable, its kind (Real, Integer or String), its value, name of its unit."""


def parameter_set(name: str, rows: Iterable[Row], units: Iterable[Element]) -> bytes:
    """A parameter set; ``units`` : definitions of the units that rows name, as a model description has them."""
    root = Element("ssv:ParameterSet", {**NAMESPACES, "version": "1.0", "name": name})
    place = SubElement(root, "ssv:Parameters")
    for variable, kind, value, unit in rows:
        text = repr(float(value)) if kind == "Real" else str(value)
        parameter = SubElement(place, "ssv:Parameter", {"name": variable})
        SubElement(parameter, f"ssv:{kind}", {"value": text, **({} if unit is None else {"unit": unit})})
    add_units(root, "ssv:Units", units)
    return xml_bytes(root)


def add_units(parent: Element, tag: str, units: Iterable[Element]) -> None:
    """Add units, where there are some."""
    found = list(units)
    if not found:
        return
    place = SubElement(parent, tag)
    for unit in found:
        element = SubElement(place, "ssc:Unit", {"name": str(unit.get("name"))})
        base = unit.find("BaseUnit")
        SubElement(element, "ssc:BaseUnit", {} if base is None else dict(base.attrib))
