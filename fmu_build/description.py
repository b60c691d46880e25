"""What a model description says about the FMU as a whole."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from latin_fmu.cosim.variable import UNITS, Variable, output
from latin_fmu.model_exchange.system import Local, Names
from latin_fmu.scene.schema import Scene

NAME = "latin_fmu"
AUTHOR = "The latin-fmu developers"
LICENCE = "MIT; the exporter's library under its own licence, see documentation/licenses"
LOG_CATEGORIES = {
    "logAll": "All messages",
    "logStatusWarning": "Settings that were adjusted, inputs that have no effect",
    "logStatusDiscard": "Steps that were refused: why, and what to do",
    "logStatusError": "Initialization that failed: every later step is refused",
    "logStatusFatal": "Nothing can be done any more",
}


@dataclass(frozen=True)
class Facts:
    """Facts of one FMU.

    Attributes
    ----------
    model : name of the model, that of the scene. identifier : of the binaries. token : changes with the content.
    description, version : text and version of the package. stop_time, step_size : s. tolerance : relative
    accuracy that the tolerance of the scene goes with.
    table : the variables; their order is the value reference.
    """

    model: str
    identifier: str
    token: str
    description: str
    version: str
    stop_time: float
    step_size: float
    tolerance: float
    table: Sequence[Variable]

    def references(self) -> dict[str, int]:
        """Value reference by name."""
        return {variable.name: number for number, variable in enumerate(self.table)}


def identifier_of(scene: Scene) -> str:
    """The name of the scene as one word: of the binaries and the cross-check files."""
    return re.sub(r"\W", "_", scene.name)


def suggested_step(scene: Scene) -> float:
    """Suggested communication step, s: about a fiftieth of the interval, a whole number of time steps."""
    n = scene.time.n_step
    parts = next((p for p in range(min(50, n), 0, -1) if n % p == 0), 1)
    return scene.time.end / parts


# -- Small XML helpers shared by the two model descriptions.
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


# -- modelDescription.xml of FMI 2.0 from the variable table.
_TYPES_2 = {"real": "Real", "integer": "Integer", "string": "String"}


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
    SubElement(element, _TYPES_2[variable.kind], facts)


# -- modelDescription.xml of FMI 3.0 from the variable table.
_TYPES_3 = {"real": "Float64", "integer": "Int32", "string": "String", "count": "UInt64"}


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
    element = SubElement(parent, _TYPES_3[variable.kind], attributes)
    for size in variable.dimensions:
        if isinstance(size, int):
            SubElement(element, "Dimension", {"start": str(size)})
        else:
            SubElement(element, "Dimension", {"valueReference": str(references[size])})
    if variable.kind == "string":
        SubElement(element, "Start", {"value": str(variable.start)})


# -- modelDescription.xml of an FMI 3.0 Model Exchange FMU.
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


# -- terminalsAndIcons.xml (FMI 3.0): one terminal per load, interface and sensor.
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
