"""XML files of an FMU: modelDescription.xml (FMI 2.0, 3.0, Model Exchange) and terminalsAndIcons.xml.

They carry no date: equal contents give equal bytes.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import prod
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from latin_fmu.cosim.variable import UNITS, Variable
from latin_fmu.model_exchange.equations import Local, Names
from latin_fmu.scene.schema import Scene
from latin_fmu.scene.units import SI, UnitSystem, unit_text

NAME = "latin_fmu"
AUTHOR = "The latin-fmu developers"
LICENCE = "MIT, see documentation/licenses"
LOG_CATEGORIES = {
    "logAll": "All messages",
    "logStatusWarning": "Settings that were adjusted, inputs that have no effect",
    "logStatusDiscard": "Steps that were not made, where a shorter one or another input may help: why, and what to do",
    "logStatusError": "Initialization that failed, steps that cannot be made, states that cannot be used",
    "logStatusFatal": "Nothing can be done any more",
}


@dataclass(frozen=True)
class Facts:
    """Facts of one FMU.

    Attributes
    ----------
    model : name of the model, that of the scene. identifier : name of the binaries. token : digest of the content.
    description : text. stop_time, step_size : of the default experiment, s. tolerance : relative accuracy that
    belongs to the tolerance of the scene. table : the variables; their order is the value reference.
    units : of the scene; hosts convert them by the factors of the description.
    version : of the package. time_step : of a compiled FMU, which needs no Python, s; None for others.
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
    time_step: float | None = None
    units: UnitSystem = SI

    def unit_name(self, unit: str) -> str:
        """What the FMI calls a unit of the table (UDUNITS, SI) in the units of the scene."""
        return UNITS[unit].name if self.units is SI else unit_text(self.units.label(unit)).replace(" ", ".") or "1"

    def references(self) -> dict[str, int]:
        """Value reference by name."""
        return {variable.name: number for number, variable in enumerate(self.table)}


def identifier_of(scene: Scene) -> str:
    """The name of the scene as one word: of the binaries and the files of the reference run."""
    return re.sub(r"\W", "_", scene.name)


def suggested_step(scene: Scene) -> float:
    """Suggested communication step, s: about a fiftieth of the interval, a whole number of time steps."""
    n = scene.time.n_step
    parts = next((p for p in range(min(50, n), 0, -1) if n % p == 0), 1)
    return scene.time.end / parts


def xml_bytes(root: Element) -> bytes:
    """The document as indented UTF-8; equal trees give equal bytes."""
    indent(root)
    text: bytes = tostring(root, encoding="utf-8")
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + text + b"\n"


def _text(value: float | int | str) -> str:
    """A value with all its digits."""
    return repr(float(value)) if isinstance(value, float) else str(value)


def _root(facts: Facts, fmi: str, kind: str, abilities: dict[str, str], units: Iterable[str | None] = ()) -> Element:
    """The description up to its variables: kind of FMU, units of the table and ``units``, log, default experiment."""
    token = "guid" if fmi == "2.0" else "instantiationToken"
    description = {
        "fmiVersion": fmi,
        "modelName": facts.model,
        token: facts.token,
        "description": facts.description,
        "author": AUTHOR,
        "version": facts.version,
        "license": LICENCE,
        "generationTool": f"{NAME} {facts.version}",
        "variableNamingConvention": "structured",
    }
    root = Element("fmiModelDescription", description)
    needs_tool = "true" if facts.time_step is None else "false"
    shared = {"needsExecutionTool": needs_tool, "canBeInstantiatedOnlyOncePerProcess": "false"}
    SubElement(root, kind, {"modelIdentifier": facts.identifier, **shared, **abilities})
    definitions = SubElement(root, "UnitDefinitions")
    used = {*(variable.unit for variable in facts.table), *units}
    defined: dict[str, Element] = {}
    for key, unit in UNITS.items():
        if key in used:
            if (name := facts.unit_name(key)) in defined:
                continue
            defined[name] = SubElement(definitions, "Unit", {"name": name})
            if facts.units.measurable:
                base = {base: str(power) for base, power in unit.exponents.items()}
                size = facts.units.size(key)
                SubElement(defined[name], "BaseUnit", base | ({} if size == 1.0 else {"factor": repr(size)}))
    categories = SubElement(root, "LogCategories")
    for name, meaning in LOG_CATEGORIES.items():
        SubElement(categories, "Category", {"name": name, "description": meaning})
    numbers = {"stopTime": facts.stop_time, "tolerance": facts.tolerance, "stepSize": facts.step_size}
    experiment = {"startTime": "0.0", **{key: repr(number) for key, number in numbers.items()}}
    SubElement(root, "DefaultExperiment", experiment)
    return root


def _identity(variable: Variable, reference: int) -> dict[str, str]:
    """Attributes of a variable that FMI 2 and FMI 3 share, without those of its values."""
    attributes = {
        "name": variable.name,
        "valueReference": str(reference),
        "description": variable.description,
        "causality": variable.causality,
        "variability": variable.variability,
    }
    return {**attributes, "initial": "calculated"} if variable.causality == "output" else attributes


def _values(variable: Variable, facts: Facts) -> dict[str, str]:
    """Attributes of the values of a variable: unit, range, nominal, start."""
    attributes = {}
    if variable.kind == "real" and variable.unit is not None:
        attributes["unit"] = facts.unit_name(variable.unit)
    for key, value in (("min", variable.minimum), ("max", variable.maximum), ("nominal", variable.nominal)):
        if value is not None:
            attributes[key] = _text(float(value) if variable.kind == "real" else int(value))
    if variable.start is not None:
        attributes["start"] = _text(variable.start)
    return attributes


def _dependencies(variable: Variable, places: dict[str, int]) -> str:
    """Variables an output depends on at initialization, by the numbers the version of the FMI uses."""
    return " ".join(str(places[name]) for name in variable.initial_dependencies)


# -- co-simulation ------------------------------------------------------------------------------------------------
def fmi2_description(facts: Facts) -> Element:
    """modelDescription.xml of FMI 2.0 for co-simulation; the table must hold scalars only."""
    types = {"real": "Real", "integer": "Integer", "string": "String"}
    abilities = {
        "canHandleVariableCommunicationStepSize": "true",
        "canInterpolateInputs": "false",
        "canNotUseMemoryManagementFunctions": "true",
        "canGetAndSetFMUstate": "true",
        "canSerializeFMUstate": "true",
        "providesDirectionalDerivative": "true" if facts.time_step is None else "false",
    }
    root = _root(facts, "2.0", "CoSimulation", abilities)
    variables = SubElement(root, "ModelVariables")
    places: dict[str, int] = {}
    for number, variable in enumerate(facts.table):
        if variable.causality != "independent":  # optional in FMI 2, and some hosts require a start value for it
            element = SubElement(variables, "ScalarVariable", _identity(variable, number))
            SubElement(element, types[variable.kind], _values(variable, facts))
            places[variable.name] = len(places) + 1
    structure = SubElement(root, "ModelStructure")
    now, start = SubElement(structure, "Outputs"), SubElement(structure, "InitialUnknowns")
    for variable in facts.table:
        if variable.causality == "output":
            place = str(places[variable.name])
            SubElement(now, "Unknown", {"index": place, "dependencies": ""})
            SubElement(start, "Unknown", {"index": place, "dependencies": _dependencies(variable, places)})
    return root


def fmi3_description(facts: Facts) -> Element:
    """modelDescription.xml of FMI 3.0 for co-simulation."""
    abilities = {
        "canGetAndSetFMUState": "true",
        "canSerializeFMUState": "true",
        "canHandleVariableCommunicationStepSize": "true",
        "providesDirectionalDerivatives": "true" if facts.time_step is None else "false",
    }
    if facts.time_step is not None:
        abilities["fixedInternalStepSize"] = repr(facts.time_step)
    abilities["mightReturnEarlyFromDoStep"] = "true"  # after a contact event
    root = _root(facts, "3.0", "CoSimulation", abilities)
    places = facts.references()
    variables = SubElement(root, "ModelVariables")
    counts = {v.name: int(v.start or 0) for v in facts.table if v.kind == "count"}
    for variable in facts.table:
        _add_variable(variables, places, variable, facts)
        if variable.is_array and variable.start is not None:  # one start value an element: some hosts need them all
            n = prod(size if isinstance(size, int) else counts[size] for size in variable.dimensions)
            variables[-1].set("start", " ".join([_text(variable.start)] * n))
    structure = SubElement(root, "ModelStructure")
    outputs = [variable for variable in facts.table if variable.causality == "output"]
    for tag in ("Output", "InitialUnknown"):
        for variable in outputs:
            depends = "" if tag == "Output" else _dependencies(variable, places)
            SubElement(structure, tag, {"valueReference": str(places[variable.name]), "dependencies": depends})
    return root


def _add_variable(parent: Element, references: dict[str, int], variable: Variable, facts: Facts) -> None:
    types = {"real": "Float64", "integer": "Int32", "string": "String", "count": "UInt64"}
    attributes = _identity(variable, references[variable.name]) | _values(variable, facts)
    start = attributes.pop("start", "") if variable.kind == "string" else None
    element = SubElement(parent, types[variable.kind], attributes)
    for size in variable.dimensions:
        place = {"start": str(size)} if isinstance(size, int) else {"valueReference": str(references[size])}
        SubElement(element, "Dimension", place)
    if start is not None:
        SubElement(element, "Start", {"value": start})


# -- Model Exchange -----------------------------------------------------------------------------------------------
def model_exchange_description(facts: Facts, names: Names) -> Element:
    """modelDescription.xml of FMI 3.0 for Model Exchange; ``facts.table`` is that of ``names``."""
    abilities = {
        "canGetAndSetFMUState": "true",
        "canSerializeFMUState": "true",
        "needsCompletedIntegratorStep": "false",
    }
    root = _root(facts, "3.0", "ModelExchange", abilities, (local.unit for local in names.locals))
    variables = SubElement(root, "ModelVariables")
    references = facts.references()
    for reference, variable in enumerate(facts.table):
        _add_variable(variables, references, variable, facts)
        if reference in names.states:
            variables[-1].set("initial", "exact")
            variables[-1].set("start", "0.0")
    for reference, local in enumerate(names.locals, len(facts.table)):
        SubElement(variables, "Float64", _local(reference, local, facts))
    structure = SubElement(root, "ModelStructure")  # without dependencies: everything may depend on everything
    outputs = [i for i, variable in enumerate(facts.table) if variable.causality == "output"]
    derivatives = range(names.derivatives, names.derivatives + len(names.states))
    calculated = [i for i in outputs if i not in names.states]
    for tag, unknowns in (
        ("Output", outputs),
        ("ContinuousStateDerivative", derivatives),
        ("InitialUnknown", [*calculated, *derivatives]),
        ("EventIndicator", range(names.indicators, names.count)),
    ):
        for reference in unknowns:
            SubElement(structure, tag, {"valueReference": str(reference)})
    return root


def _local(reference: int, local: Local, facts: Facts) -> dict[str, str]:
    attributes = {
        "name": local.name,
        "valueReference": str(reference),
        "description": local.description,
        "causality": "local",
        "variability": "continuous",
        "initial": "calculated" if local.start is None else "exact",
        "unit": facts.unit_name(local.unit),
    }
    numbers = {"nominal": local.nominal, "start": local.start, "derivative": local.derivative_of}
    return attributes | {key: _text(number) for key, number in numbers.items() if number is not None}


# -- terminals ----------------------------------------------------------------------------------------------------
_TERMINAL = re.compile(r"(load|interface|sensor|port|bolt)\.(\w+)\.(.+)")


def terminals(facts: Facts) -> Element:
    """terminalsAndIcons.xml (FMI 3.0): one terminal per load, interface, sensor, port and bolt, matched by name."""
    root = Element("fmiTerminalsAndIcons", {"fmiVersion": "3.0"})
    picture = SubElement(root, "GraphicalRepresentation")
    square = {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100"}
    SubElement(picture, "CoordinateSystem", {**square, "suggestedScalingFactorTo_mm": "0.1"})
    SubElement(picture, "Icon", square)
    by_name: dict[str, Element] = {}
    for variable in facts.table:
        match = _TERMINAL.fullmatch(variable.name)
        if match is None or variable.causality not in ("input", "output"):
            continue
        kind, name, member = match.groups()
        key = f"{kind}.{name}"
        about = {"name": key, "matchingRule": "bus", "terminalKind": f"latin_fmu.{kind}"}
        terminal = by_name.setdefault(key, Element("Terminal", {**about, "description": f"{kind} {name} of the scene"}))
        signal = {"variableName": variable.name, "memberName": member, "variableKind": "signal"}
        SubElement(terminal, "TerminalMemberVariable", signal)
    if by_name:
        SubElement(root, "Terminals").extend(by_name.values())
    return root
