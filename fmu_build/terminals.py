"""terminalsAndIcons.xml (FMI 3.0): one terminal per load, interface and sensor."""

from __future__ import annotations

import re
from xml.etree.ElementTree import Element, SubElement

from .facts import Facts

_TERMINAL = re.compile(r"(load|interface|sensor)\.(\w+)\.(.+)")


def terminals(facts: Facts) -> Element:
    """Members are the variables below the name of the load, interface or sensor; matched by name."""
    root = Element("fmiTerminalsAndIcons", {"fmiVersion": "3.0"})
    picture = SubElement(root, "GraphicalRepresentation")
    square = {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100"}
    SubElement(picture, "CoordinateSystem", {**square, "suggestedScalingFactorTo_mm": "0.1"})
    SubElement(picture, "Icon", square)
    found: dict[str, Element] = {}
    for variable in facts.table:
        match = _TERMINAL.fullmatch(variable.name)
        if match is None or variable.causality not in ("input", "output"):
            continue
        kind, name, member = match.groups()
        if (key := f"{kind}.{name}") not in found:
            found[key] = Element(
                "Terminal",
                {
                    "name": key,
                    "matchingRule": "bus",
                    "terminalKind": f"latin_fmu.{kind}",
                    "description": f"{kind} {name} of the scene",
                },
            )
        SubElement(
            found[key],
            "TerminalMemberVariable",
            {"variableName": variable.name, "memberName": member, "variableKind": "signal"},
        )
    if found:
        SubElement(root, "Terminals").extend(found.values())
    return root
