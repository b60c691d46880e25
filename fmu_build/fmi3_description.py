"""modelDescription.xml of FMI 3.0 from the variable table."""

from __future__ import annotations

from xml.etree.ElementTree import Element, SubElement

from latin_fmu.cosim.variable import Variable

from .facts import Facts
from .xml_text import add_logging_and_experiment, add_units, head, identity, quantity, value_text

_TYPES = {"real": "Float64", "integer": "Int32", "string": "String", "count": "UInt64"}


def fmi3_description(facts: Facts) -> Element:
    """The model description."""
    root = head(facts, "3.0", "instantiationToken")
    SubElement(
        root,
        "CoSimulation",
        {
            "modelIdentifier": facts.identifier,
            "needsExecutionTool": "true",
            "canBeInstantiatedOnlyOncePerProcess": "false",
            "canGetAndSetFMUState": "true",
            "canSerializeFMUState": "true",
            "canHandleVariableCommunicationStepSize": "true",
        },
    )
    add_units(root, facts)
    add_logging_and_experiment(root, facts)
    references = facts.references()
    variables = SubElement(root, "ModelVariables")
    for variable in facts.table:
        add_variable(variables, references, variable)
    structure = SubElement(root, "ModelStructure")
    outputs = [variable for variable in facts.table if variable.causality == "output"]
    for variable in outputs:
        SubElement(structure, "Output", {"valueReference": str(references[variable.name]), "dependencies": ""})
    for variable in outputs:
        depends = " ".join(str(references[name]) for name in variable.initial_dependencies)
        SubElement(
            structure, "InitialUnknown", {"valueReference": str(references[variable.name]), "dependencies": depends}
        )
    return root


def add_variable(parent: Element, references: dict[str, int], variable: Variable) -> None:
    attributes = identity(variable, references[variable.name]) | quantity(variable)
    if variable.start is not None and variable.kind != "string":
        attributes["start"] = value_text(variable.start)
    element = SubElement(parent, _TYPES[variable.kind], attributes)
    for size in variable.dimensions:
        if isinstance(size, int):
            SubElement(element, "Dimension", {"start": str(size)})
        else:
            SubElement(element, "Dimension", {"valueReference": str(references[size])})
    if variable.kind == "string":
        SubElement(element, "Start", {"value": str(variable.start)})
