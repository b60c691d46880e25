"""modelDescription.xml of FMI 2.0 from the variable table."""

from __future__ import annotations

from xml.etree.ElementTree import Element, SubElement

from latin_fmu.cosim.variable import Variable

from .facts import Facts
from .xml_text import add_logging_and_experiment, add_units, head, identity, quantity, value_text

_TYPES = {"real": "Real", "integer": "Integer", "string": "String"}


def fmi2_description(facts: Facts) -> Element:
    """The model description; the table must hold scalars only."""
    root = head(facts, "2.0", "guid")
    SubElement(
        root,
        "CoSimulation",
        {
            "modelIdentifier": facts.identifier,
            "needsExecutionTool": "true",
            "canHandleVariableCommunicationStepSize": "true",
            "canInterpolateInputs": "false",
            "canNotUseMemoryManagementFunctions": "true",
            "canGetAndSetFMUstate": "true",
            "canSerializeFMUstate": "true",
            "canBeInstantiatedOnlyOncePerProcess": "false",
        },
    )
    add_units(root, facts)
    add_logging_and_experiment(root, facts)
    variables = SubElement(root, "ModelVariables")
    places: dict[str, int] = {}
    for number, variable in enumerate(facts.table):
        if variable.causality != "independent":  # optional in FMI 2, and some hosts want a start value for it
            _add_variable(variables, number, variable)
            places[variable.name] = len(places) + 1
    structure = SubElement(root, "ModelStructure")
    outputs = [variable for variable in facts.table if variable.causality == "output"]
    now, start = SubElement(structure, "Outputs"), SubElement(structure, "InitialUnknowns")
    for variable in outputs:
        place = str(places[variable.name])
        SubElement(now, "Unknown", {"index": place, "dependencies": ""})
        depends = " ".join(str(places[name]) for name in variable.initial_dependencies)
        SubElement(start, "Unknown", {"index": place, "dependencies": depends})
    return root


def _add_variable(parent: Element, number: int, variable: Variable) -> None:
    element = SubElement(parent, "ScalarVariable", identity(variable, number))
    facts = quantity(variable)
    if variable.start is not None:
        facts["start"] = value_text(variable.start)
    SubElement(element, _TYPES[variable.kind], facts)
