"""modelDescription.xml of an FMI 3.0 Model Exchange FMU."""

from __future__ import annotations

from dataclasses import replace
from xml.etree.ElementTree import Element, SubElement

from latin_fmu.cosim.variable import UNITS, output
from latin_fmu.model_exchange.system import Local, Names

from .facts import Facts
from .fmi3_description import add_variable
from .xml_text import add_logging_and_experiment, add_units, head, value_text


def model_exchange_description(facts: Facts, names: Names) -> Element:
    """The model description; ``facts.table`` is that of ``names``."""
    root = head(facts, "3.0", "instantiationToken")
    SubElement(
        root,
        "ModelExchange",
        {
            "modelIdentifier": facts.identifier,
            "needsExecutionTool": "true",
            "canBeInstantiatedOnlyOncePerProcess": "false",
            "canGetAndSetFMUState": "true",
            "canSerializeFMUState": "true",
            "needsCompletedIntegratorStep": "false",
        },
    )
    units = [output(local.name, local.unit, local.description) for local in names.locals]
    add_units(root, replace(facts, table=[*facts.table, *units]))
    add_logging_and_experiment(root, facts)
    _add_variables(root, facts, names)
    _add_structure(root, facts, names)
    return root


def _add_variables(root: Element, facts: Facts, names: Names) -> None:
    variables = SubElement(root, "ModelVariables")
    references = facts.references()
    for reference, variable in enumerate(facts.table):
        add_variable(variables, references, variable)
        if reference in names.states:
            variables[-1].set("initial", "exact")
            variables[-1].set("start", "0.0")
    for reference, local in enumerate(names.locals, len(facts.table)):
        SubElement(variables, "Float64", _local(reference, local))


def _local(reference: int, local: Local) -> dict[str, str]:
    facts = {
        "name": local.name,
        "valueReference": str(reference),
        "description": local.description,
        "causality": "local",
        "variability": "continuous",
        "initial": "calculated" if local.start is None else "exact",
        "unit": UNITS[local.unit].name,
    }
    if local.nominal is not None:
        facts["nominal"] = value_text(local.nominal)
    if local.start is not None:
        facts["start"] = value_text(local.start)
    if local.derivative_of is not None:
        facts["derivative"] = str(local.derivative_of)
    return facts


def _add_structure(root: Element, facts: Facts, names: Names) -> None:
    """Dependencies are left out: everything may depend on everything."""
    structure = SubElement(root, "ModelStructure")
    outputs = [i for i, variable in enumerate(facts.table) if variable.causality == "output"]
    derivatives = range(names.derivatives, names.derivatives + len(names.states))
    indicators = range(names.indicators, names.count)
    calculated = [i for i in outputs if i not in names.states]
    for tag, references in (
        ("Output", outputs),
        ("ContinuousStateDerivative", derivatives),
        ("InitialUnknown", [*calculated, *derivatives]),
        ("EventIndicator", indicators),
    ):
        for reference in references:
            SubElement(structure, tag, {"valueReference": str(reference)})
