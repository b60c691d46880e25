"""Small XML helpers shared by the two model descriptions."""

from __future__ import annotations

from xml.etree.ElementTree import Element, SubElement, indent, tostring

from latin_fmu.cosim.variable import UNITS, Variable

from .facts import AUTHOR, LICENCE, LOG_CATEGORIES, NAME, Facts


def xml_bytes(root: Element) -> bytes:
    """The document, indented, UTF-8; the same tree gives the same bytes."""
    indent(root)
    text: bytes = tostring(root, encoding="utf-8")
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + text + b"\n"


def value_text(value: float | int | str) -> str:
    """A value with all its digits."""
    return repr(float(value)) if isinstance(value, float) else str(value)


def head(facts: Facts, version: str, token: str) -> Element:
    """The root element; ``token`` is the attribute that holds the token. It carries no date: equal content gives
    equal bytes."""
    return Element(
        "fmiModelDescription",
        {
            "fmiVersion": version,
            "modelName": facts.model,
            token: facts.token,
            "description": facts.description,
            "author": AUTHOR,
            "version": facts.version,
            "license": LICENCE,
            "generationTool": f"{NAME} {facts.version}",
            "variableNamingConvention": "structured",
        },
    )


def identity(variable: Variable, reference: int) -> dict[str, str]:
    """Attributes that say what a variable is, the same in FMI 2 and FMI 3."""
    found = {
        "name": variable.name,
        "valueReference": str(reference),
        "description": variable.description,
        "causality": variable.causality,
        "variability": variable.variability,
    }
    return {**found, "initial": "calculated"} if variable.causality == "output" else found


def quantity(variable: Variable) -> dict[str, str]:
    """Attributes of the values a variable takes: unit, range, nominal."""
    found = {}
    if variable.kind == "real" and variable.unit is not None:
        found["unit"] = UNITS[variable.unit].name
    for key, value in (("min", variable.minimum), ("max", variable.maximum), ("nominal", variable.nominal)):
        if value is not None:
            found[key] = value_text(float(value) if variable.kind == "real" else int(value))
    return found


def add_units(root: Element, facts: Facts) -> None:
    """Units in use."""
    definitions = SubElement(root, "UnitDefinitions")
    used = {variable.unit for variable in facts.table if variable.unit is not None}
    for key, unit in UNITS.items():
        if key in used:
            element = SubElement(definitions, "Unit", {"name": unit.name})
            SubElement(element, "BaseUnit", {base: str(power) for base, power in unit.exponents.items()})


def add_logging_and_experiment(root: Element, facts: Facts) -> None:
    """Log categories and default experiment."""
    categories = SubElement(root, "LogCategories")
    for name, description in LOG_CATEGORIES.items():
        SubElement(categories, "Category", {"name": name, "description": description})
    experiment = {
        "startTime": "0.0",
        "stopTime": repr(facts.stop_time),
        "tolerance": repr(facts.tolerance),
        "stepSize": repr(facts.step_size),
    }
    SubElement(root, "DefaultExperiment", experiment)
